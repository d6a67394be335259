"""Bad readings in a pull that is left out, by the shape of the effector alone.

A pull whose chain was read wrong has no direction and takes no part in any fit, so that nothing is
seen of another bad reading in it. But the effector is one body: beside any rigid motion since the
zero of the pose, a shift of a single target is a suspect like any other (see `system.beside`).
With three targets that is what changes the sides of their triangle; across its plane nothing shows.
"""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np
import pandas as pd

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array
from pipeline.faults.fault import Screening
from pipeline.faults.mistake import Mistake
from pipeline.faults.reading import bad_reading, smallest
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.system import alarms
from pipeline.system.beside import Base, Beside
from pipeline.system.odds import DECIDES

_FEWEST = 3
"""Fewer targets have no shape but one distance, which does not say which of two is wrong."""


def lost_readings(given: Case, findings: Sequence[Mistake], asked: Screening) -> list[Mistake]:
    """The bad readings among those whose pull is left out, one to a pull at most.

    Args:
        given: The campaign as given.
        findings: What was found in it.
        asked: The campaign without that.
    """
    if not any(one.of_reading for one in findings):  # none has taken a pull along
        return []
    if asked.cell.tool.six or given.settings.displacements is not None:
        return []
    known = {one.where for one in findings}
    rows = _of_lost_pulls(given, known, asked)
    found = [_worst(group, asked) for _, group in rows.groupby("group", sort=False)]
    limit = alarms.READING / max(len(rows), 1)
    return [one for one in found if one is not None and (one.p_value or 0.0) < limit]


def _of_lost_pulls(given: Case, known: Set[str], asked: Screening) -> pd.DataFrame:
    """Loaded readings of targets, not yet accused, whose pull makes no row."""
    rows = given.readings
    rows = rows[(rows["state"] == "loaded") & rows["target"].isin(given.settings.measured)]
    rows = rows[rows["pose"].notna() & rows["repeat"].notna()]
    pulls = asked.reduced.data.pulls
    used = pd.MultiIndex.from_arrays([pulls.pose, pulls.repeat])
    pull = pd.MultiIndex.from_frame(rows[["pose", "repeat"]].astype("int64"))
    names = rows["group"].astype(str) + "/" + rows["target"].astype(str)
    return rows[~pull.isin(used) & ~names.isin(known).to_numpy()]


def _worst(group: pd.DataFrame, asked: Screening) -> Mistake | None:
    """The reading of a pull that breaks the shape its targets had unloaded."""
    zeros = asked.case.readings
    zeros = zeros[(zeros["state"] == "unloaded") & (zeros["pose"] == group["pose"].iloc[0])]
    names = [name for name in group["target"].unique() if (zeros["target"] == name).any()]
    if len(names) < _FEWEST:
        return None
    read = group.drop_duplicates("target").set_index("target").loc[names].reset_index()
    scale, contrasts = asked.spread
    unit_m = asked.system.found_m or 1.0
    found = _shifts(read, _mean(zeros, names), unit_m * scale)
    best, second = (int(k) for k in np.argsort(found.drop)[[-1, -2]])
    p, size = float(found.p(1.0, contrasts)[best]), float(np.linalg.norm(found.size[best]))
    decided = found.drop[best] - found.drop[second] > DECIDES
    if not decided or size < smallest(asked.reduced.placed, scale):
        return None
    others = "the other targets, as they stood unloaded,"
    sigmas = float(np.sqrt(found.drop[best]))
    return bad_reading(read.iloc[best], others, size, sigmas, p)


def _mean(zeros: pd.DataFrame, names: Sequence[str]) -> tuple[Array, Array]:
    """Where the targets stood unloaded [m], (t, 3), and the covariance of that, (t, 3, 3)."""
    each = [zeros[zeros["target"] == name] for name in names]
    at = np.stack([rows[XYZ].to_numpy(float).mean(axis=0) for rows in each])
    C = [covariance.weighing(rows).sum(axis=0) / len(rows) ** 2 for rows in each]
    return at, np.stack(C)


def _shifts(read: pd.DataFrame, zero: tuple[Array, Array], scale: float) -> Beside:
    """A shift of each target [m], tracker's frame, beside six rigid motions of all."""
    at, C = zero
    lever = at - at.mean(axis=0)
    turns = linear.turning(lever)
    rigid = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2)
    white = linear.whitening((C + covariance.weighing(read)) * scale**2)
    y = np.einsum("tij,tj->ti", white, read[XYZ].to_numpy(float) - at)
    base = Base.of((white @ rigid).reshape(-1, 6), y.ravel())
    D = white[:, :, None, :] * np.eye(len(at))[:, None, :, None]
    return base.beside(D.reshape(1, -1, *D.shape[2:])).of_block(0)
