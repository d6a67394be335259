"""Tails of distributions, from scipy.special: scipy.stats takes half a second to import."""

import numpy as np
from scipy import special

from pipeline.base.arrays import Array

NORMAL_95 = 1.96
"""95 % of a normal quantity lie within so many standard uncertainties [1]; statistics, with the
three digits of GUM table G.1."""


CHI2_95 = 3.84
"""95 % of chi2 of one degree of freedom lie below [1]: the square of it, as tables have it."""


def chi2_below(chi2: Array | float, dof: Array | float) -> Array:
    """P(chi2_dof < chi2); 0 below zero, and nan without freedom."""
    return special.chdtr(np.where(np.greater(dof, 0), dof, np.nan), np.maximum(chi2, 0.0))


def chi2_beyond(chi2: Array | float, dof: Array | float) -> Array:
    """P(chi2_dof > chi2); 1 below zero, where rounding may lead, and nan without freedom."""
    return special.chdtrc(np.where(np.greater(dof, 0), dof, np.nan), np.maximum(chi2, 0.0))
