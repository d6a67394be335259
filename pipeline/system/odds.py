"""How clearly one explanation must beat another: choices between models, which find nothing wrong.

The rates of tests that do, and of their false alarms, are in alarms.py.
"""

FITS = 1e-3
"""Minimum p-value of the misfit of a model that fits [1]; statistics: of a thousand correct models
one is rejected, and the only consequence is that another is tried."""

DECIDES = 9.2
"""Drop of chi-square that decides between two explanations with equally many unknowns [1];
statistics: odds of 100 to 1, 2 ln 100."""
