"""Readings of the effector that no model is needed for: centimetres off, at the origin, stale.

The effector is one body that hardly deforms, and within a pose it hardly moves. Both hold whatever
the robot does, so that medians tell which reading is wrong, however many others are: linear tests
with two gross readings in one pose hide each behind the other.
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
from pipeline.readers.known import GROSS_M
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ

_USUAL = 10.0
"""And so many times what is usual: a soft robot may give way by centimetres in every pull."""

_STATES = 3
"""So many readings of a target in a pose, or distances over all poses, have a median that holds."""


def gross(case: Case) -> list[Mistake]:
    """Readings of measured targets in the wrong place, beside others of the same state.

    A reading is gross where it is away from the median of its target in its pose and changes a
    distance to another target of its state; where a pose has fewer than three states, where it
    changes all of them and these have one between them that is right.
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
    C = covariance.matrices(rows)
    std = np.sqrt(np.einsum("mii->m", C) / 3)
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
    return max(GROSS_M, _USUAL * float(np.median(away))) if len(away) else np.inf


def _changed(rows: pd.DataFrame, names: list[str]) -> tuple[Bools, Bools, Array]:
    """Whether some, and alone all, distances from a reading to others of its state are wrong.

    And the largest change [m], by reading.
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


FAULT = Fault("outlier", "outlying reading", lambda asked: gross(asked.case))
