"""The figures: each module writes the texts of its figures and draws them, from the same data."""

import pipeline.report.svg  # noqa: F401  # imports Matplotlib, before a figure does
