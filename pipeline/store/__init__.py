"""A campaign on disk, and the tables kept there."""
