"""Tails of distributions by scipy.special, as scipy.stats takes half a second to import."""

import numpy as np
from scipy import special

from pipeline.base.arrays import Array

NORMAL_95 = 1.96
"""Coverage factor of 95 % of a normal distribution [1], to the three digits of GUM table G.1."""


CHI2_95 = 3.84
"""95 % quantile of chi2 with one degree of freedom [1], the square of `NORMAL_95`, as tabulated."""


def chi2_below(chi2: Array | float, dof: Array | float) -> Array:
    """P(chi2_dof < chi2); 0 below zero, NaN without degrees of freedom."""
    return special.chdtr(np.where(np.greater(dof, 0), dof, np.nan), np.maximum(chi2, 0.0))


def chi2_beyond(chi2: Array | float, dof: Array | float) -> Array:
    """P(chi2_dof > chi2); 1 below zero, as rounding may give, NaN without degrees of freedom."""
    return special.chdtrc(np.where(np.greater(dof, 0), dof, np.nan), np.maximum(chi2, 0.0))


def at_most(p: float, odds: float = 1.0) -> float:
    """Upper bound, given a p-value and prior odds, of the probability of what contradicts the null.

    No alternative makes the null less likely than -e p ln p relative to it (Sellke, Bayarri and
    Berger, American Statistician 55, 2001), so P = o / (o - e p ln p) for p < 1/e and odds o: at
    even odds 0.95 where p is 0.003, and a half where p says nothing.
    """
    against = 1.0 if p >= np.exp(-1) else -np.e * special.xlogy(p, p)
    return float(odds / (odds + against))
