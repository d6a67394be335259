"""Predictions of the identified model, and their uncertainty."""
