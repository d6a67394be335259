"""Rows of the joint log, and groups of the tracker, that are in each other's place.

The robot's table predicts the reflectors in each pose to millimetres, and poses are decimetres
apart. Which row of the joint log belongs to each pose, and which pose to each group, are
assignments (see `assignment`): of two rows or of all of them, off by one or shuffled.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings
from pipeline.faults.assignment import (
    OUTSTANDING_MISFIT,
    Ring,
    in_words,
    lines,
    misplacement,
    rings,
)
from pipeline.faults.conventions import FEWEST_POSES, aligned, anchored
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake, as_read, length, lines_of
from pipeline.machine.robot import configure
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ

_LEAST_M = 1e-4
"""Minimum expected deviation of readings from the table [m]."""

_MOST = 400
"""Number of poses above which no log is written by hand."""

_SOFT = 0.9
"""Quantile of the pulls whose distance from the unloaded robot counts as usual [1]."""

_FITTED = 3
"""Number of fits of the readings to the table."""

_OTHERWISE = 0.5
"""Additional cost of an exchange with a group of the other state, or of another load step [1]; it
decides only between places that fit equally well."""


_STAND = ["pose", "repeat", "state"]
"""Columns of a reading that are determined by its group."""


@dataclass(frozen=True, eq=False)
class _LaidGroups(Locked):
    """Groups of readings of the effector, aligned with the robot's table.

    Attributes:
        name: Name of each group, shape (g,).
        pose: Index of its pose in `poses`, shape (g,).
        loaded: Whether it is a pull, shape (g,).
        repeat: Its number in the pose, shape (g,).
        poses: Numbers of the poses, shape (p,).
        off: Mean squared distance of each group from each pose of the table [m^2], shape (g, p).
        R: Rotation from the tracker's frame into F_b, shape (3, 3).
        t: Origin of the tracker's frame in F_b [m], shape (3,).
    """

    name: Strings
    pose: Ints
    loaded: Bools
    repeat: Ints
    poses: Ints
    off: Array
    R: Array
    t: Array

    @property
    def own(self) -> Array:
        """Squared distance of each group from its own pose [m^2], shape (g,)."""
        return np.asarray(self.off[np.arange(len(self.pose)), self.pose])

    @property
    def usual(self) -> Array:
        """Usual distance of groups of its state from their best pose [m], (g,).

        The median for unloaded groups; for pulls the quantile `_SOFT`, since soft poses move more.
        """
        near, out = np.sqrt(self.off.min(axis=1)), np.zeros(len(self.name))
        for state, part in ((True, _SOFT), (False, 0.5)):
            here = self.loaded == state
            placed = near[here & (near < GROSS_DISTANCE_M)]
            out[here] = np.quantile(placed, part) if len(placed) else GROSS_DISTANCE_M
        return np.maximum(out, _LEAST_M)

    @property
    def in_order(self) -> bool:
        """Whether no group is elsewhere."""
        usual = max(float(np.median(self.own)), _LEAST_M**2)
        return usual < GROSS_DISTANCE_M**2 and bool(self.own.max() <= OUTSTANDING_MISFIT**2 * usual)


def exchanged(case: Case) -> list[Mistake]:
    """Exchanged rows of the joint log, then exchanged groups."""
    found: list[Mistake] = []
    for look in (_rows, _groups):
        laid = _lay(case)
        if laid is None or laid.in_order:
            return found
        new = list(look(case, laid))
        for one in new:
            case = one.correct(case)
        found += new
    return found


def misplaced(case: Case) -> frozenset[int] | None:
    """Poses in which most groups are elsewhere than the table predicts; None if unknown."""
    laid = _lay(case)
    if laid is None or laid.in_order:
        return None if laid is None else frozenset()
    away = pd.Series(laid.own > (OUTSTANDING_MISFIT * laid.usual) ** 2).groupby(
        laid.poses[laid.pose]
    )
    most = away.mean() > 0.5
    return frozenset(most.index[most].tolist())


def misplaced_groups(case: Case) -> frozenset[str]:
    """Groups that are elsewhere than the robot's table predicts; empty if not decidable."""
    laid = _lay(case)
    if laid is None:
        return frozenset()
    away = laid.own > (OUTSTANDING_MISFIT * laid.usual) ** 2
    return frozenset(str(name) for name, far in zip(laid.name, away, strict=True) if far)


# --- where the groups are -------------------------------------------------------------------------


@lru_cache(maxsize=1)  # used by three tests of a clean campaign
def _lay(case: Case) -> _LaidGroups | None:
    """The groups aligned with the table, starting from the base reflectors or from the groups."""
    rows = case.readings
    known = rows["target"].isin(case.settings.measured) & rows["pose"].isin(case.joints["pose"])
    rows = rows[known].drop_duplicates(["group", "target"])
    poses = np.unique(rows["pose"].to_numpy(int))
    few = len(poses) < FEWEST_POSES  # then the base reflectors alone determine the frame
    if len(poses) < 2 or len(poses) > _MOST or (few and not case.settings.base_frame):
        return None
    starts = [anchored(case), None if few else _by_table(case)]
    found = [_laid(case, rows, poses, *at, not few) for at in starts if at is not None]
    best = min(found, key=_median, default=None)
    return best if best is not None and _median(best) < GROSS_DISTANCE_M else None


def _median(laid: _LaidGroups) -> float:
    """Median distance of the groups from their best poses [m]."""
    return float(np.median(np.sqrt(laid.off.min(axis=1))))


def _by_table(case: Case) -> tuple[Array, Array] | None:
    """R, t that transform most unloaded readings onto the table."""
    at = aligned(case)
    return None if at is None else (at[0].T, -at[0].T @ at[1])


def _laid(
    case: Case, rows: pd.DataFrame, poses: Ints, R: Array, t: Array, free: bool
) -> _LaidGroups:
    """The groups aligned with the table; if `free`, repeatedly by those that fit."""
    group, names = pd.factorize(rows["group"].astype(str))
    first = rows.groupby(group)[["pose", "repeat", "state"]].first()
    target = pd.Index(case.settings.measured).get_indexer(pd.Index(rows["target"]))
    seen = np.full((len(names), len(case.settings.measured), 3), np.nan)
    seen[group, target] = rows[XYZ].to_numpy(float)
    table = configure(case.robot, case.q(poses)).points(case.tool.points)
    for _ in range(_FITTED * free):
        R, t = _moved(seen, table, _square(seen @ R.T + t, table))
    return _LaidGroups(
        name=np.array(names, dtype=object),
        pose=np.searchsorted(poses, first["pose"].to_numpy(int)),
        loaded=(first["state"] == "loaded").to_numpy(bool),
        repeat=first["repeat"].to_numpy(int),
        poses=poses,
        off=_square(seen @ R.T + t, table),
        R=R,
        t=t,
    )


def _square(placed: Array, table: Array) -> Array:
    """Mean squared distance of the targets of each group from their places [m^2], (g, p)."""
    each = [np.nanmean(np.sum((placed - at) ** 2, axis=2), axis=1) for at in table]
    return np.stack(each, axis=1)


def _moved(seen: Array, table: Array, off: Array) -> tuple[Array, Array]:
    """R, t that transform the better half of the groups onto their best poses."""
    near = off.min(axis=1)
    good = near <= np.median(near)
    at, due = seen[good].reshape(-1, 3), table[off.argmin(axis=1)[good]].reshape(-1, 3)
    read = np.isfinite(at).all(axis=1)
    return linear.rigid(at[read], due[read])


# --- rows of the joint log ------------------------------------------------------------------------


def _rows(case: Case, laid: _LaidGroups) -> Iterator[Mistake]:
    """Rows of the joint log that belong to other poses according to both pulls and zeros there."""
    count = len(laid.poses)
    cost, away = np.zeros((2, count, count))  # of each row in each pose
    for state in (True, False):
        for k in range(count):
            here = (laid.loaded == state) & (laid.pose == k)
            if here.any():
                off = np.median(laid.off[here], axis=0)
                away[:, k] = np.maximum(away[:, k], off)
                cost[:, k] = np.maximum(cost[:, k], off / laid.usual[here][0] ** 2)
    for ring in rings(cost, OUTSTANDING_MISFIT**2, OUTSTANDING_MISFIT**2):
        yield _of_rows(case, laid.poses, ring, away)


def _of_rows(case: Case, poses: Ints, ring: Ring, cost: Array) -> Mistake:
    true = {int(poses[i]): int(poses[j]) for i, j in ring.moves}
    numbers = [int(poses[k]) for k in ring.members]
    joints = case.joints.set_index("pose").loc[sorted(numbers)]
    file = str(joints["file"].iloc[0])
    names = [f"pose{k:02d}" for k in numbers]
    return exchange_mistake(
        ring,
        where=f"{file} {ring.where(names)}",
        what=f"{file}: the rows of {in_words(ring, names)}, or their groups in the tracker export,",
        stand=misplacement(ring, "row"),
        of="the reflectors of these poses are",
        cost=cost,
        at=lines_of(joints),
        correct=partial(_renumbered, true=true, lost=numbers[0] if ring.ended else None),
    )


def _renumbered(case: Case, true: dict[int, int], lost: int | None) -> Case:
    """Rows of the joint log under their true pose numbers; `lost` is a pose without a row."""

    def own(rows: pd.DataFrame) -> pd.DataFrame:
        rows = rows[rows["pose"].map(lambda k: k in true or k not in true.values())]
        return rows.assign(pose=rows["pose"].map(lambda k: true.get(k, k)).astype("int32"))

    joints, rows, loads = own(case.joints).sort_values("pose"), case.readings, case.loads
    torques = None if case.torques is None else own(case.torques)  # of the same rows
    if lost is not None:
        rows, loads = rows[rows["pose"].ne(lost).fillna(True)], loads[loads["pose"] != lost]
    return replace(case, joints=joints, readings=rows, loads=loads, torques=torques)


# --- groups ---------------------------------------------------------------------------------------


def _groups(case: Case, laid: _LaidGroups) -> Iterator[Mistake]:
    """Groups whose reflectors are where the table predicts another pose."""
    away = np.flatnonzero(laid.own > (OUTSTANDING_MISFIT * laid.usual) ** 2)
    unlike = laid.loaded[away][:, None] != laid.loaded[away]
    step = np.abs(laid.repeat[away][:, None] - laid.repeat[away])
    tie = _OTHERWISE * (unlike + step / (1 + step))
    fits = laid.off[away][:, laid.pose[away]]
    found = rings(
        fits / laid.usual[away][:, None] ** 2 + tie, OUTSTANDING_MISFIT**2, OUTSTANDING_MISFIT**2
    )
    alike: dict[frozenset[int], list[Ring]] = {}
    for ring in found:
        alike.setdefault(frozenset(laid.pose[away[list(ring.members)]].tolist()), []).append(ring)
    for several in alike.values():
        yield _of_groups(case, laid, away, several, fits)


def _of_groups(
    case: Case, laid: _LaidGroups, away: Ints, several: Sequence[Ring], cost: Array
) -> Mistake:
    """One mistake for several exchanges between the same poses, as of all their pulls."""
    names = laid.name[away]
    true = {str(names[i]): str(names[j]) for ring in several for i, j in ring.moves}
    out = {str(names[ring.members[-1]]) for ring in several if ring.ended}
    chain = _chain_too(case, laid, true)
    stands = [ring.among(away) for ring in several]
    sets = [in_words(one, [str(laid.name[k]) for k in one.members]) for one in stands]
    first = several[0]
    alone = stands[0] if len(several) == 1 else None
    here = as_read(case)
    here = here[here["group"].isin({*true, *true.values()})]
    at = lines_of(here[chain | here["target"].isin(case.settings.measured)])
    return exchange_mistake(
        first,
        where=stands[0].where([str(names[k]) for k in first.members]),
        what=f"the groups {', '.join(sets)}",
        stand=misplacement(alone, "group"),
        of="their reflectors are",
        cost=cost,
        at=at,
        correct=partial(regrouped, true=true, out=frozenset(out), at=at),
    )


def _chain_too(case: Case, laid: _LaidGroups, true: dict[str, str]) -> bool:
    """Whether the chain's readings belong where those of the effector do, rather than where named.

    Decided by their distance from the load point, compared with that of all other pulls.
    """
    near = case.settings.naming.chain[0]
    rows = case.readings[case.readings["target"] == near].drop_duplicates("group")
    rows = rows[rows["pose"].isin(laid.poses)].set_index("group")
    if not len(rows):
        return True
    table = configure(case.robot, case.q(laid.poses)).points(case.tool.load_point[None])[:, 0]
    pose = pd.Series(laid.poses[laid.pose], laid.name)
    seen = rows[XYZ].to_numpy(float) @ laid.R.T + laid.t

    def away(names: list[str]) -> Array:
        at = np.searchsorted(laid.poses, pose.reindex(names).to_numpy(int))
        return np.asarray(np.linalg.norm(seen - table[at], axis=1))

    names = [str(name) for name in rows.index]
    mine = np.array([name in true and true[name] in pose.index for name in names])
    given = away(names)
    there = away([true.get(name, name) if m else name for name, m in zip(names, mine, strict=True)])
    if not mine.any():
        return True
    usual = float(np.median(given[~mine])) if (~mine).any() else 0.0
    return bool(np.abs(there[mine] - usual).sum() <= np.abs(given[mine] - usual).sum())


def regrouped(case: Case, true: dict[str, str], out: frozenset[str], at: Collection[str]) -> Case:
    """Readings in the groups where they belong, without those that belong nowhere.

    Args:
        case: The campaign.
        true: For each group, the one where its readings belong.
        out: Groups whose readings belong nowhere.
        at: The readings that move, `file:line`.
    """
    rows, named = case.readings, case.readings["group"].astype(str)
    free = np.isin(lines_of(rows), list(at))
    first = rows.drop_duplicates("group")
    of = first.set_index(first["group"].astype(str))
    new = [true.get(name, name) if moves else name for name, moves in zip(named, free, strict=True)]
    stands = of.loc[new, _STAND].set_axis(rows.index)
    own = (rows["state"] == "unloaded") & (stands["state"] == "unloaded")  # rounds may share a name
    stands = stands.assign(repeat=stands["repeat"].mask(own, rows["repeat"]))
    moved = rows.assign(group=new, **{name: stands[name] for name in _STAND})
    lost = free & named.isin(out).to_numpy()
    return replace(case, readings=moved[~lost].astype(rows.dtypes.drop("group").to_dict()))


# --- in words -------------------------------------------------------------------------------------


def exchange_mistake(
    ring: Ring,
    *,
    where: str,
    what: str,
    stand: str,
    of: str,
    cost: Array,
    at: tuple[str, ...],
    correct: Callable[[Any], Any],
) -> Mistake:
    """An exchange that the robot's table reveals; `cost` in m^2."""
    before = float(np.sqrt(max(cost[i, i] for i, _ in ring.moves)))
    after = float(np.sqrt(max(cost[i, j] for i, j in ring.moves)))
    left = "; what belongs to none is left out" if ring.ended else ""
    return Mistake(
        name="exchanged",
        where=where,
        evidence=f"{what} stand {stand} ({lines(at)}): as recorded, {of} up to "
        f"{length(before)} from where the robot file places them, and {length(after)} with the "
        "places exchanged",
        correction=f"recomputed with {where} exchanged{left}",
        before=1e3 * before,
        after=1e3 * after,
        correct=correct,
        at=at,
    )


FAULT = Fault("exchanged", lambda asked: exchanged(asked.case), in_files=True)
