"""A pull towards another anchor than the one of which the place was written down.

The direction of a force is that of its far end, so that a wrong anchor leaves displacements across
it that no force along it causes. With y_i the displacements of pull i, f_i its force, G_i(u) x
those per newton along u, and x the compliances on which most pulls agree, the anchor is the one
that leaves the least of

    |y_i - f_i G_i(u_a) x|^2,    u_a = (p_a - near_i) / |p_a - near_i|,

of the places p_a at which the chain ended in pulls of two or more poses, or of those of anchors in
campaign.toml, and of reflectors of the base that rows name. A row of the loads with force f_j that
names an anchor may be in the place of another one, which leaves |y_i - f_j G_i(u_a) x|^2 (see
`assignment`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from pipeline.base import doors, linear
from pipeline.base.arrays import Array, Ints
from pipeline.base.errors import listed
from pipeline.faults import exchanged_pulls
from pipeline.faults.assignment import Ring, rings
from pipeline.faults.exchanged_pulls import PullMoves, response, rows_of
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.labels import anchors
from pipeline.faults.mistake import Mistake, lines_of
from pipeline.readers.reflector_sets import CLEARLY_NEARER
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.reduction.settings import Point
from pipeline.system import odds


def wrong_anchors(asked: Screening) -> list[Mistake]:
    """Pulls whose displacements are those of another row of the loads, or towards another anchor.

    A reading of the scale does not explain them as well; another anchor beside the best may.
    """
    known = bool(asked.case.anchors) or anchors(asked.case)["anchor"].any()
    if not known or (moved := PullMoves.of(asked)) is None:
        return []
    near, place, at = ends(asked, moved)
    x = moved.solved(moved.force)
    given, scaled = (_left(moved.y, f, moved.G @ x) for f in (moved.force, moved.due(x)[0]))
    usual = moved.usual(given)
    astray = np.flatnonzero((place >= 0) & (given > CLEARLY_NEARER**2 * usual))
    if len(at) < 2 or not 0 < 2 * len(astray) < len(place):  # of more, x is theirs
        return []
    some = moved.only(astray)
    u = linear.normed(at - near[astray, None]).reshape(-1, 3)
    towards = np.repeat(some.pull, len(at))
    each = (response(asked, towards, u) @ x).reshape(len(astray), len(at), -1)
    left = _left(some.y[:, None], some.force[:, None], each)
    left[np.arange(len(astray)), place[astray]] = np.inf
    found = list[Mistake]()
    for ring, one in _exchanged_rows(asked, some, each[:, place[astray]], usual[astray]):
        found, left[list(ring.members)] = [*found, one], np.inf
    best = left.min(axis=1)
    least = best + odds.DECIDES * usual[astray] / moved.y.shape[1]
    most = np.minimum(given, CLEARLY_NEARER**4 * usual)[astray] / CLEARLY_NEARER**2
    for n in np.flatnonzero((best <= most) & (scaled[astray] > least)).tolist():
        i, alike = int(astray[n]), np.argsort(left[n])[: np.sum(left[n] <= least[n])]
        says, mm = _said(asked.case, int(place[i]), alike), 1e3 * np.sqrt([given[i], best[n]])
        found += [_finding(asked, moved, i, says, (int(alike[0]), at[alike[0]]), mm)]
    return found


def _left(y: Array, force: Array, each: Array) -> Array:
    """Mean square that forces (...) leave of displacements (..., c) [m^2], shape (...)."""
    return np.asarray(np.mean((y - force[..., None] * each) ** 2, axis=-1))


def _exchanged_rows(
    asked: Screening, moved: PullMoves, each: Array, usual: Array
) -> Iterator[tuple[Ring, Mistake]]:
    """Rows of the loads that are in each other's place, with the anchors that they name.

    Args:
        asked: The campaign.
        moved: Pulls that do not fit, m.
        each: Displacement of each per newton towards the anchor of each row, (m, m, c) [m/N].
        usual: Usual mean square of each [m^2], shape (m,).
    """
    if not asked.case.anchors:
        return
    off = _left(moved.y, moved.force[:, None], np.swapaxes(each, 0, 1)) / usual
    for ring in rings(off, CLEARLY_NEARER**2, CLEARLY_NEARER**2):
        right = replace(
            moved, G=each[np.arange(len(off)), exchanged_pulls.ordering([ring], len(off)), :, None]
        )
        fit = exchanged_pulls.OrderFit(np.ones(1), off, model=0.0, left=0.0)
        yield ring, exchanged_pulls.of_loads(asked, right, fit, ring, anchors=True)


def ends(asked: Screening, moved: PullMoves) -> tuple[Array, Ints, Array]:
    """Near end of each chain in F_b [m], its anchor, -1 for none, and the places of all anchors.

    Where the log names them, they are those stated, then the reflectors of the base that it names.
    """
    rows = asked.reduced.placed
    rows = rows[rows["state"] == "loaded"].drop_duplicates(["group", "target"])
    pulls, case = asked.reduced.data.pulls, asked.case
    key = pd.MultiIndex.from_arrays([pulls.pose[moved.pull], pulls.repeat[moved.pull]])
    of_pulls = rows.set_index(["target", "pose", "repeat"]).sort_index()
    both = [of_pulls.loc[name].reindex(key) for name in case.settings.naming.chain]
    near, far = (one[XYZ].to_numpy(float) for one in both)
    if own := case.anchors:
        named, places = [own.get(one, "") for one in key], _places(case)
        place = pd.Index([*places]).get_indexer(pd.Index(named))
        return near, place, np.array([*places.values()])
    read = anchors(case)
    where = read["place"].where(read["anchor"], -1).reindex(both[1]["group"]).fillna(-1)
    known, place = np.unique(where[where >= 0]), where.to_numpy(int)
    at = np.array([np.median(far[place == one], axis=0) for one in known])
    return near, np.where(place < 0, -1, np.searchsorted(known, place)), at


def _places(case: Case) -> dict[str, Point]:
    """Places to which a chain may go, by name: anchors, then reflectors of the base as named."""
    own, named = case.settings.anchors, {*case.anchors.values()}
    return own | {k: at for k, at in case.settings.base_frame.items() if k in named - {*own}}


def _said(case: Case, own: int, there: Ints) -> str:
    """The anchor that is written down for a pull, and those that fit, in words."""
    if case.anchors:
        names = [*_places(case)]
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
    pull = int(row["pose"].iloc[0]), int(row["repeat"].iloc[0])
    rows, placed = (
        one[(one["state"] == "loaded") & (one[["pose", "repeat"]] == [*pull]).all(axis=1)]
        for one in (case.readings, asked.reduced.placed)
    )
    far = rows[rows["target"] == chain[1]].iloc[:1]
    group, at = str(far["group"].iloc[0]), tuple(dict.fromkeys((*lines_of(row), *lines_of(far))))
    both = rows.merge(placed, on="target")
    R, t = linear.rigid(*(both[[f"{c}_{k}" for c in XYZ]].to_numpy(float) for k in ("y", "x")))
    to, name = (R @ there[1] + t).tolist(), dict(enumerate(_places(case))).get(there[0], "")
    return Mistake(
        name="label_swap",
        where=group,
        evidence=f"{group} ({', '.join(at)}) was pulled towards another anchor than {says}: "
        f"towards that one the joint springs leave {mm[1]:.2g} mm rms of its displacements instead "
        f"of {mm[0]:.2g} mm",
        correction=f"recomputed with {chain[1]} of {group} at that anchor",
        before=float(mm[0]),
        after=float(mm[1]),
        places=len(moved.pull),
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


_MISPLACED = "pipeline.check.misplaced_anchors:misplaced"
"""Door to anchors of campaign.toml in the wrong place, and a column of them that is off by one."""


def _misplaced(asked: Screening) -> list[Mistake]:
    find = doors.found(_MISPLACED) if asked.case.anchors else None
    return find(asked) if find else []


PLACE = Fault("outlier", _misplaced, in_files=True)

FAULT = Fault("label_swap", wrong_anchors, in_files=True)
