"""Bad readings of the base reflectors, which no robot moves."""

from __future__ import annotations

import numpy as np
from scipy import stats

from pipeline.base import covariance, linear
from pipeline.base.arrays import Ints
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake
from pipeline.faults.reading import bad_reading, smallest
from pipeline.reduction.register import XYZ, Registration
from pipeline.system import alarms
from pipeline.system.beside import Base, Beside


def base_outlier(registration: Registration, scale: float) -> list[Mistake]:
    """The base reading that contradicts the other base reflectors, if removing it makes them agree.

    Args:
        registration: Where the tracker stands.
        scale: Scatter of the readings over the stated one.
    """
    table = registration.table
    if registration.chi2 is None or registration.dof < 6:
        return []
    off = shifts(registration, scale, np.arange(len(table)))
    best = int(np.argmax(off.drop))
    p = len(off.drop) * float(off.p(1.0, np.inf)[best])
    size = float(np.linalg.norm(off.size[best]))
    rest = stats.chi2.sf(off.rest - off.drop[best], registration.dof - 3)
    if p > alarms.READING or size < smallest(table, scale) or rest < 0.01:
        return []
    sigmas = float(np.sqrt(off.drop[best]))
    return [bad_reading(table.iloc[best], "the other base reflectors", size, sigmas, p)]


def shifts(registration: Registration, scale: float, which: Ints) -> Beside:
    """Base readings shifted together [m], F_b, beside where the tracker stands.

    Args:
        registration: Where the tracker stands.
        scale: Scatter of the readings over the stated one.
        which: Number of the suspect that each reading belongs to, shape (m,).
    """
    table = registration.table
    C = registration.R @ covariance.matrices(table) @ registration.R.T
    white = linear.whitening(C * scale**2)
    lever = table[XYZ].to_numpy() - registration.centre
    turns = np.swapaxes(np.cross(np.eye(3)[None], lever[:, None, :]), 1, 2)
    moves = np.concatenate([turns, np.broadcast_to(np.eye(3), turns.shape)], axis=2)
    y = white @ table[["dx_m", "dy_m", "dz_m"]].to_numpy()[..., None]
    base = Base.of((white @ moves).reshape(-1, 6), y.ravel())
    D = white[:, :, None, :] * np.eye(which.max() + 1)[which][:, None, :, None]
    return base.beside(D.reshape(1, -1, *D.shape[2:])).of_block(0)


FAULT = Fault(
    "outlier",
    "outlying reading",
    lambda asked: base_outlier(asked.reduced.registration, asked.spread[0]),
)
