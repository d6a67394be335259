"""One file per part of the report, in the words of the people who read it."""
