"""The virtual cell: from a plan to a raw campaign."""
