"""Simulated fleets, in which robots wear, scatter, are repaired, and are watched by detectors."""
