"""The figures: each module has words and picture of its own, from the same digest."""

import pipeline.report.svg  # noqa: F401  # imports Matplotlib, before a figure does
