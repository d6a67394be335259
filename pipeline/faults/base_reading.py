"""Bad readings of the base reflectors, which no robot moves."""

from __future__ import annotations

import numpy as np
from scipy import stats

from pipeline.base import covariance, linear
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake
from pipeline.faults.reading import bad_reading, smallest
from pipeline.reduction.register import XYZ, Registration
from pipeline.system import alarms


def base_outlier(registration: Registration, scale: float) -> list[Mistake]:
    """The base reading that contradicts the other base reflectors, if removing it makes them agree.

    Args:
        registration: Where the tracker stands.
        scale: Scatter of the readings over the stated one.
    """
    table, chi2 = registration.table, registration.chi2
    if chi2 is None or registration.dof < 6:
        return []
    C = registration.R @ covariance.matrices(table) @ registration.R.T
    V = linear.inverse(C * scale**2)
    lever = table[XYZ].to_numpy() - registration.centre
    X = np.zeros((len(table), 3, 6))
    X[:, :, :3] = np.swapaxes(np.cross(np.eye(3)[None], lever[:, None, :]), 1, 2)
    X[:, :, 3:] = np.eye(3)
    cov = linear.inverse(np.einsum("mia,mij,mjb->ab", X, V, X))
    r = table[["dx_m", "dy_m", "dz_m"]].to_numpy()
    N = V - V @ X @ cov @ np.swapaxes(X, 1, 2) @ V
    g = np.einsum("mij,mj->mi", V, r)
    shift = np.einsum("mij,mj->mi", linear.shortest(N), g)
    drop = np.sum(shift * g, axis=1)
    best = int(np.argmax(drop))
    rest, dof = chi2 / scale**2 - drop[best], registration.dof - 3
    p = len(drop) * float(stats.chi2.sf(drop[best], 3))
    size = float(np.linalg.norm(shift[best]))
    if p > alarms.READING or size < smallest(table, scale) or stats.chi2.sf(rest, dof) < 0.01:
        return []
    sigmas = float(np.sqrt(drop[best]))
    return [bad_reading(table.iloc[best], "the other base reflectors", size, sigmas, p)]


FAULT = Fault(
    "outlier",
    "outlying reading",
    lambda asked: base_outlier(asked.reduced.registration, asked.spread[0]),
)
