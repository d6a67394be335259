"""A base reflector that is off in every round: its nominal position is wrong, or it was moved."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.base.errors import InputError
from pipeline.base.tails import chi2_beyond
from pipeline.faults.base_reading import shifts
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake, apart, outlying
from pipeline.faults.reading import smallest
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ, Registration, agreed, register
from pipeline.system import alarms

_FEWEST = 4
"""Minimum number of reflectors; with fewer the others cannot outvote one."""

_AGREE = 0.01
"""Minimum p-value of the others for them to agree [1]. A target whose removal leaves a misfit less
probable than alarms.READING is no rival."""


def base_target(case: Case, registration: Registration, scale: float) -> list[Mistake]:
    """The target of [base_frame] that the others contradict, if no other removal explains it.

    All readings of a target are shifted together while the tracker's pose is estimated as well; p
    is multiplied by the number of targets (Bonferroni). The target with the smallest residual sum
    of squares is then left out of the registration.

    Args:
        case: The campaign.
        registration: Pose of the tracker.
        scale: Scatter of the readings over the stated one.
    """
    table, chi2 = registration.table, registration.chi2
    which, names = pd.factorize(table["target"], sort=True)
    if chi2 is None or len(names) < _FEWEST:
        return []
    if chi2_beyond(chi2 / scale**2, registration.dof) > alarms.READING:
        return []
    off = shifts(agreed(registration)[0], scale, which)
    left = np.where(off.rank == 3, off.rest - off.drop, np.inf)
    best, rival = np.argsort(left, kind="stable")[:2].tolist()
    if not np.isfinite(left[rival]):
        return []
    free = _freed(case, registration, str(names[best]))
    if free is None:
        return []
    rest, shift, dof = free[0] / scale**2, free[1], registration.dof - 3
    drop, size = chi2 / scale**2 - rest, float(np.linalg.norm(shift))
    p = len(names) * float(chi2_beyond(drop, 3))
    fits = chi2_beyond(rest, dof) > _AGREE
    alone = chi2_beyond(left[rival], dof) < alarms.READING
    if not (fits and alone) or p > alarms.READING or size < smallest(table, scale):
        return []
    sigmas, after = float(np.sqrt(drop)), float(np.sqrt(max(rest, 0)))
    return [_finding(str(names[best]), size, sigmas, after, p)]


def _freed(case: Case, registration: Registration, name: str) -> tuple[float, Array] | None:
    """Weighted sum of squares with the position of a target free, and its shift [m], F_b.

    The registration without the target, plus sum_i (p_i - p)' V_i (p_i - p) of its own readings in
    F_b about their weighted mean p = (sum V_i)^-1 sum V_i p_i, V_i = (R C_i R')^-1; shift p - p_0.

    None where the others do not determine the registration, for example if nearly collinear.
    """
    try:
        lost = register(_without_target(case, name).settings, case.readings)
    except InputError:
        return None
    rows = case.readings.loc[registration.table.index[registration.table["target"] == name]]
    at = lost.into_base_frame(rows[XYZ].to_numpy(float))
    C = registration.weighing[(registration.table["target"] == name).to_numpy()]
    V = linear.inverse(lost.R @ C @ lost.R.T)
    mean = linear.solve(V.sum(axis=0), np.einsum("mij,mj->i", V, at))
    own = float(np.einsum("mi,mij,mj->", at - mean, V, at - mean))
    return float(lost.chi2 or 0.0) + own, mean - np.array(case.settings.base_frame[name])


def _finding(name: str, size: float, sigmas: float, after: float, p: float) -> Mistake:
    return outlying(
        name,
        f"the base reflector {name} is {1e3 * size:.2f} mm from its place in "
        f"[base_frame] in every round, {apart(sigmas)}, and the others agree "
        f"without it: its nominal coordinates are wrong, or it was moved before the first round",
        f"recomputed without {name}",
        before=sigmas,
        after=after,
        size=size,
        p_value=p,
        entry=("base_frame", name),
        correct=partial(_without_target, name=name),
    )


def _without_target(case: Case, name: str) -> Case:
    """The campaign without one reflector of [base_frame]."""
    base = {one: at for one, at in case.settings.base_frame.items() if one != name}
    return replace(case, settings=case.settings.model_copy(update={"base_frame": base}))


FAULT = Fault(
    "outlier",
    lambda asked: base_target(asked.case, asked.reduced.registration, asked.spread[0]),
)
