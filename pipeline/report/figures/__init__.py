"""What a figure is, and every figure by its name: those of the annex, if it is installed."""

import pipeline.report.svg  # noqa: F401  # imports Matplotlib, before a figure does
