"""How clearly one explanation must beat another: choices of a model, which accuse nobody.

Rates of false alarms, which do, are those of alarms.py.
"""

FITS = 1e-3
"""A model fits whose misfit is this probable [1]; statistics: of a thousand models that are right
one is taken for a wrong one, and only another is tried in its place."""

DECIDES = 9.2
"""Drop of chi-square that decides between two explanations with as many unknowns [1]; statistics:
odds of 100 to 1, 2 ln 100."""
