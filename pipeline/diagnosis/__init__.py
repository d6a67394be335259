"""Diagnosis: detect what the model lacks, name it, extend the model, and propose further poses."""
