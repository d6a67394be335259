"""A pull towards another anchor than the one of which the place was written down.

The direction of a force is that of its far end, so that a wrong anchor leaves displacements across
it that no force along it causes. With y_i the displacements of pull i, f_i its force, G_i(u) x
those per newton along u, and x the compliances on which most pulls agree, the anchor is the one
that leaves the least of

    |y_i - f_i G_i(u_a) x|^2,    u_a = (p_a - near_i) / |p_a - near_i|,

of the places p_a at which the chain ended in pulls of two or more poses, or of those that
campaign.toml states.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.base.errors import listed
from pipeline.faults.assignment import OUTSTANDING_MISFIT
from pipeline.faults.exchanged_pulls import PullMoves, response, rows_of
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.labels import anchors
from pipeline.faults.mistake import Mistake, lines_of
from pipeline.readers.reflector_sets import CLEARLY_NEARER
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.system import odds


def wrong_anchors(asked: Screening) -> list[Mistake]:
    """Pulls whose displacements are those of a pull towards another anchor.

    A reading of the scale does not explain them as well; another anchor beside the best may.
    """
    known = bool(asked.case.anchors) or anchors(asked.case)["anchor"].any()
    if not known or (moved := PullMoves.of(asked)) is None:
        return []
    near, place, at = _ends(asked, moved)
    x = moved.solved(moved.force)
    along = moved.G @ x
    given, scaled = (_left(moved.y, f, along) for f in (moved.force, moved.due(x)[0]))
    usual, found = moved.usual(given), list[Mistake]()
    astray = (place >= 0) & (given > OUTSTANDING_MISFIT**2 * usual) & (len(at) > 1)
    for i in np.flatnonzero(astray).tolist():
        others = np.delete(np.arange(len(at)), place[i])
        u = linear.normed(at[others] - near[i])
        each = response(asked, np.full(len(u), moved.pull[i]), u) @ x
        left = _left(moved.y[i], moved.force[i, None], each)
        best = left.min()
        least = best + odds.DECIDES * usual[i] / moved.y.shape[1]
        if scaled[i] > least and best <= CLEARLY_NEARER**2 * usual[i]:
            alike = others[np.argsort(left)[: np.sum(left <= least)]]
            says = _said(asked.case, int(place[i]), alike)
            mm = 1e3 * np.sqrt([given[i], best])
            found += [_finding(asked, moved, i, says, (int(alike[0]), at[alike[0]]), mm)]
    return found


def _left(y: Array, force: Array, each: Array) -> Array:
    """Mean square that forces leave of displacements [m^2], shape (m,)."""
    return np.asarray(np.mean((y - force[:, None] * each) ** 2, axis=-1))


def _ends(asked: Screening, moved: PullMoves) -> tuple[Array, Ints, Array]:
    """Near end of each chain in F_b [m], its anchor, -1 for none, and the places of all anchors."""
    rows = asked.reduced.placed
    rows = rows[rows["state"] == "loaded"].drop_duplicates(["group", "target"])
    pulls, chain = asked.reduced.data.pulls, asked.case.settings.naming.chain
    key = pd.MultiIndex.from_arrays([pulls.pose[moved.pull], pulls.repeat[moved.pull]])
    of_pulls = rows.set_index(["target", "pose", "repeat"]).sort_index()
    begins, ends = (of_pulls.loc[name].reindex(key) for name in chain)
    near, far = (one[XYZ].to_numpy(float) for one in (begins, ends))
    if own := asked.case.anchors:
        stated = pd.Series(asked.case.settings.anchors)
        place = stated.index.get_indexer(pd.Index([own.get(one, "") for one in key]))
        return near, place, np.array([*stated])
    read = anchors(asked.case)
    where = read["place"].where(read["anchor"], -1).reindex(ends["group"]).fillna(-1)
    known, place = np.unique(where[where >= 0]), where.to_numpy(int)
    at = np.array([np.median(far[place == one], axis=0) for one in known])
    return near, np.where(place < 0, -1, np.searchsorted(known, place)), at


def _said(case: Case, own: int, there: Ints) -> str:
    """The anchor that is written down for a pull, and those that fit, in words."""
    if case.anchors:
        names = [*case.settings.anchors]
        return f"{names[own]}, as its row says, probably {' or '.join(names[k] for k in there)}"
    end, where = case.settings.naming.chain[1], anchors(case)
    known = np.unique(where["place"][where["anchor"]])
    rows = case.readings[(case.readings["state"] == "loaded") & (case.readings["target"] == end)]
    others = rows[rows["group"].isin(where.index[where["place"].isin(known[there])])]
    return (
        f"its {end} says, that of {listed(others['group'].astype(str), 3)} ({lines_of(others)[0]})"
    )


def _finding(
    asked: Screening, moved: PullMoves, i: int, says: str, there: tuple[int, Array], mm: Array
) -> Mistake:
    """Of pull i: its anchor, by number and place in F_b [m]; rms left by its own and that [mm]."""
    case, chain = asked.case, asked.case.settings.naming.chain
    row = case.loads.iloc[rows_of(case, asked.reduced.data, moved.pull)[[i]]]
    key = ["pose", "repeat"]
    rows, placed = (
        one[(one["state"] == "loaded") & (one[key] == row[key].iloc[0]).all(axis=1)]
        for one in (case.readings, asked.reduced.placed)
    )
    far = rows[rows["target"] == chain[1]].iloc[:1]
    group, at = str(far["group"].iloc[0]), tuple(dict.fromkeys((*lines_of(row), *lines_of(far))))
    both = rows.merge(placed, on="target")
    R, t = linear.rigid(*(both[[f"{c}_{k}" for c in XYZ]].to_numpy(float) for k in ("y", "x")))
    pull = int(row["pose"].iloc[0]), int(row["repeat"].iloc[0])
    to, name = (R @ there[1] + t).tolist(), dict(enumerate(case.settings.anchors)).get(there[0], "")
    return Mistake(
        name="label_swap",
        where=group,
        evidence=f"{group} ({', '.join(at)}) was pulled towards another anchor than {says}: "
        f"towards that one the joint springs leave {mm[1]:.2g} mm rms of its displacements instead "
        f"of {mm[0]:.2g} mm",
        correction=f"recomputed with {chain[1]} of {group} at that anchor",
        before=float(mm[0]),
        after=float(mm[1]),
        correct=partial(_anchored, group=group, pull=pull, at=to, name=name),
        at=at,
    )


def _anchored(case: Case, group: str, pull: tuple[int, int], at: list[float], name: str) -> Case:
    """The campaign with the far end of a chain elsewhere [m], tracker's frame, or by name."""
    if pull in case.anchors:
        return replace(case, anchors={**case.anchors, pull: name})
    if pull in case.anchors_read:
        return replace(case, anchors_read={**case.anchors_read, pull: np.array(at)})
    rows, end = case.readings.copy(), case.settings.naming.chain[1]
    rows.loc[(rows["group"] == group) & (rows["target"] == end), XYZ] = at
    return replace(case, readings=rows)


FAULT = Fault("label_swap", wrong_anchors, in_files=True)
