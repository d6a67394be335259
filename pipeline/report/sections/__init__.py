"""The sections of the report, one file each, in the terms of its readers."""
