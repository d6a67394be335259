"""A campaign on disk, and the tables that are promised there."""
