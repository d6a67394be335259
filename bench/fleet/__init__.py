"""Simulated fleets, in which robots wear, scatter and are repaired, watched by detectors."""
