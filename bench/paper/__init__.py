"""Reproduction of the paper's tables and figures: evidence, not product."""
