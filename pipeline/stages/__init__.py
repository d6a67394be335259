"""The stages of run.py: named tables in, named tables out."""
