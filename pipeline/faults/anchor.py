"""A pull towards another anchor than the one of which the place was written down.

The direction of a force is that of its far end, so that a wrong anchor leaves displacements across
it that no force along it causes. With y_i the displacements of pull i, f_i its force, G_i(u) x
those per newton along u, and x the compliances on which most pulls agree, the anchor is the one
that leaves the least of

    |y_i - f_i G_i(u_a) x|^2,    u_a = (p_a - near_i) / |p_a - near_i|,

of the places p_a at which the chain ended in pulls of two or more poses.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.errors import listed
from pipeline.faults.assignment import OUTSTANDING_MISFIT
from pipeline.faults.exchanged_pulls import PullMoves, response, rows_of
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.labels import anchors
from pipeline.faults.mistake import Mistake, lines_of
from pipeline.readers.reflector_sets import CLEARLY_NEARER
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ


def wrong_anchors(asked: Screening) -> list[Mistake]:
    """Pulls whose displacements are those of a pull towards another anchor.

    A reading of the scale does not explain them as well.
    """
    if not anchors(asked.case)["anchor"].any() or (moved := PullMoves.of(asked)) is None:
        return []
    near, far, place, anchored = _ends(asked, moved)
    x = moved.solved(moved.force)
    along = moved.G @ x
    given, scaled = (_left(moved.y, f, along) for f in (moved.force, moved.due(x)[0]))
    usual, found = moved.usual(given), list[Mistake]()
    for i in np.flatnonzero(anchored & (given > OUTSTANDING_MISFIT**2 * usual)).tolist():
        others = np.unique(place[(place >= 0) & (place != place[i])])
        u = np.array([np.median(far[place == one], axis=0) for one in others]) - near[i]
        u = u / np.linalg.norm(u, axis=1, keepdims=True)
        each = response(asked, np.full(len(u), moved.pull[i]), u) @ x
        left = np.append(_left(moved.y[i], moved.force[i, None], each), scaled[i])
        best, second = np.argsort(left)[:2]
        fits = left[best] <= CLEARLY_NEARER**2 * usual[i]
        if fits and CLEARLY_NEARER**2 * left[best] < left[second] and best < len(others):
            found += [_finding(asked, moved, i, int(others[best]), given[i], left[best])]
    return found


def _left(y: Array, force: Array, each: Array) -> Array:
    """Mean square that forces leave of displacements [m^2], shape (m,)."""
    return np.asarray(np.mean((y - force[:, None] * each) ** 2, axis=-1))


def _ends(asked: Screening, moved: PullMoves) -> tuple[Array, Array, Ints, Bools]:
    """Both ends of each chain in F_b [m], the place of the far one, and whether it is an anchor."""
    rows = asked.reduced.placed
    rows = rows[rows["state"] == "loaded"].drop_duplicates(["group", "target"])
    pulls, (near, far) = asked.reduced.data.pulls, asked.case.settings.naming.chain
    key = pd.MultiIndex.from_arrays([pulls.pose[moved.pull], pulls.repeat[moved.pull]])
    ends = rows.set_index(["target", "pose", "repeat"]).sort_index()
    at = [ends.loc[name].reindex(key) for name in (near, far)]
    where = anchors(asked.case).reindex(at[1]["group"])
    return (
        at[0][XYZ].to_numpy(float),
        at[1][XYZ].to_numpy(float),
        where["place"].fillna(-1).to_numpy(int),
        where["anchor"].eq(True).to_numpy(bool),
    )


def _finding(
    asked: Screening, moved: PullMoves, i: int, place: int, before: float, after: float
) -> Mistake:
    case, end = asked.case, asked.case.settings.naming.chain[1]
    row = case.loads.iloc[rows_of(case, asked.reduced.data, moved)[[i]]]
    rows = case.readings[(case.readings["state"] == "loaded") & (case.readings["target"] == end)]
    mine = rows[(rows["pose"] == row["pose"].item()) & (rows["repeat"] == row["repeat"].item())]
    where = anchors(case)["place"]
    there = rows[rows["group"].isin(where.index[where == place])]
    group, at = str(mine["group"].iloc[0]), (*lines_of(row), *lines_of(mine.iloc[:1]))
    others = listed(there["group"].astype(str), 3)
    mm = [1e3 * float(np.sqrt(square)) for square in (before, after)]
    return Mistake(
        name="label_swap",
        where=group,
        evidence=f"{group} ({', '.join(at)}) was pulled towards another anchor than its {end} "
        f"says, that of {others} ({lines_of(there)[0]}): towards that one the joint springs leave "
        f"{mm[1]:.2g} mm rms of its displacements instead of {mm[0]:.2g} mm",
        correction=f"recomputed with {end} of {group} at that anchor",
        before=mm[0],
        after=mm[1],
        correct=partial(_anchored, group=group, at=tuple(there[XYZ].median().tolist())),
        at=at,
    )


def _anchored(case: Case, group: str, at: tuple[float, float, float]) -> Case:
    """The campaign with the far end of a chain elsewhere [m], tracker's frame."""
    rows, end = case.readings.copy(), case.settings.naming.chain[1]
    rows.loc[(rows["group"] == group) & (rows["target"] == end), XYZ] = at
    return replace(case, readings=rows)


FAULT = Fault("label_swap", wrong_anchors, in_files=True)
