"""Gross errors of the effector's readings, found without a model: centimetres off, at the origin.

The effector is a nearly rigid body that hardly moves within a pose. Both hold whatever the robot
does, so that medians show which reading is wrong, however many others are: in linear tests two
gross readings in one pose mask each other.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pandas as pd

from pipeline.base import covariance
from pipeline.base.arrays import Array, Bools
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake
from pipeline.faults.reading import bad_reading
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ

_USUAL = 10.0
"""Ratio to the usual deviation that a gross reading must exceed in addition [1]: a soft robot may
deflect by centimetres in every pull."""

_STATES = 3
"""Minimum number of readings of a target in a pose, or of distances over all poses, for a
median."""


def gross(case: Case) -> list[Mistake]:
    """Readings of measured targets in the wrong place, compared with others of the same state.

    A reading is gross if it is away from the median of its target in its pose and changes a
    distance to another target of its state. In a pose with fewer than three states it is gross if
    it changes all of these distances, while the other targets have a correct one between them.
    """
    known = case.readings["target"].isin(case.settings.measured) & case.readings["pose"].notna()
    rows = case.readings[known].drop_duplicates(["group", "target"])
    if not len(rows):
        return []
    away, moved = _from_pose(rows)
    some, every, change = _changed(rows, case.settings.measured)
    known_place = np.isfinite(away)
    wrong = np.where(known_place, moved & some, every)
    size = np.where(known_place, away, change)
    std = np.sqrt(np.einsum("mii->m", covariance.matrices(rows)) / 3)
    return [
        bad_reading(
            rows.iloc[k],
            "all other readings",
            float(size[k]),
            float(size[k] / std[k]) if np.isfinite(std[k]) else np.inf,
        )
        for k in np.flatnonzero(wrong)
    ]


def _from_pose(rows: pd.DataFrame) -> tuple[Array, Bools]:
    """Distance [m] from the median of a target in its pose, NaN with few; whether it is gross."""
    here = rows.groupby(["pose", "target"], observed=True)[XYZ]
    away = np.linalg.norm((rows[XYZ] - here.transform("median")).to_numpy(float), axis=1)
    enough = here.transform("count").to_numpy()[:, 0] >= _STATES
    return np.where(enough, away, np.nan), away > _limit(away[enough])


def _limit(away: Array) -> float:
    return max(GROSS_DISTANCE_M, _USUAL * float(np.median(away))) if len(away) else np.inf


def _changed(rows: pd.DataFrame, names: list[str]) -> tuple[Bools, Bools, Array]:
    """Whether some, and whether all, distances of a reading to others of its state are wrong.

    All of them count only where the others agree. Third, the largest change [m], by reading.
    """
    at = {name: rows[rows["target"] == name].set_index("group")[XYZ] for name in names}
    groups = pd.Index(rows["group"].unique())
    off = np.full((len(names), len(names), len(groups)), np.nan)
    for i, k in combinations(range(len(names)), 2):
        between = (at[names[i]] - at[names[k]]).reindex(groups).to_numpy(float)
        length = np.linalg.norm(between, axis=1)
        if np.isfinite(length).sum() >= _STATES:
            off[i, k] = off[k, i] = np.abs(length - np.nanmedian(length))
    seen = np.isfinite(off)
    wrong = off > _limit(off[seen])
    right: Bools = np.asarray((seen & ~wrong).any(axis=0))  # by target and group
    some: Bools = np.asarray(wrong.any(axis=0))
    others = np.array([np.delete(right, t, axis=0).sum(axis=0) >= 2 for t in range(len(names))])
    every = some & ~right & others
    t = pd.Index(names).get_indexer(pd.Index(rows["target"]))
    g = groups.get_indexer(pd.Index(rows["group"]))
    return some[t, g], every[t, g], np.where(seen, off, 0.0).max(axis=0)[t, g]


FAULT = Fault("outlier", lambda asked: gross(asked.case))
