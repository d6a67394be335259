"""Tracker exports, one file per dialect."""
