"""Mistakes in tables of positions: units, columns, names, and exchanged rows.

The robot predicts every target from the joint values, to millimetres with its table as delivered;
poses are decimetres apart, and wrong units metres. Each series is aligned with the robot as a rigid
body by most of its rows (`initial.py`), so that up to half of them may be wrong; if more are, the
order in which most of them fit is sought first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations, permutations

import numpy as np
import pandas as pd
from scipy import optimize

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.quantities import plain
from pipeline.faults.assignment import (
    OUTSTANDING_MISFIT,
    Ring,
    in_words,
    lines,
    misplacement,
    rings,
)
from pipeline.faults.conventions import LOGGED, UNITS
from pipeline.faults.exchanged import exchange_mistake
from pipeline.faults.mistake import Mistake, length, lines_of
from pipeline.machine.robot import Robot, configure
from pipeline.positions.initial import begin
from pipeline.positions.mechanism import ArmWeights, Mechanism, placed
from pipeline.positions.positioned import by_pose, weights_of
from pipeline.positions.readings import PositionReadings
from pipeline.readers.logs import AXES
from pipeline.readers.reflector_sets import CLEARLY_NEARER, GROSS_DISTANCE_M
from pipeline.reduction.settings import Settings

PositionTable = pd.DataFrame
_Correction = Callable[[PositionTable], PositionTable]

_LEAST_M = 1e-4
"""Minimum expected deviation of targets from their predictions [m]."""

_MOST = 1500
"""Maximum number of units of rows of which an assignment is sought: two million costs."""

_SHUFFLED = 400
"""Maximum number of units if the frame of the instrument is sought as well."""

_FEW = 60
"""Maximum number of units used to test whether a whole column is wrong."""

_TRIMMED = 12
"""Maximum number of fits to the better half."""

_ROUNDS = 40
"""Maximum number of alternations between assignment and frame, from one initial guess."""

_RARE = 0.05
"""Fraction of the poses below which a target's name may be a mistyped one [1]."""


@dataclass(frozen=True, eq=False)
class PositionSheet:
    """A table of positions with the robot and settings that it is tested against.

    Attributes:
        robot: Robot as delivered.
        settings: campaign.toml.
        rows: Table POSITIONS, one row for each reading.
    """

    robot: Robot
    settings: Settings
    rows: PositionTable

    @cached_property
    def unit(self) -> Ints:
        """Unit of each row, (n,): rows of a pose with the same joint values, in file order."""
        keys = ["file", "series", "pose", *(joint.name for joint in self.robot.joints)]
        return np.asarray(self.rows.groupby(keys, sort=False, dropna=False).ngroup(), np.int64)

    @cached_property
    def readings(self) -> PositionReadings:
        """The readings, each unit as a pose."""
        return by_pose(self.rows.assign(pose=self.unit), self.robot, self.settings)

    @property
    def points(self) -> dict[str, Array]:
        """Nominal points of the targets, flange frame [m]."""
        return {name: np.array(at) for name, at in self.settings.tool.items()}

    def begun(self, order: Ints | None = None) -> Mechanism:
        """The robot with tool and frames fitted to most units, their joint values in `order`.

        If half of them do not fit, the fit is repeated with those that fit best (least trimmed
        squares by concentration; Rousseeuw and Van Driessen, Technometrics 41, 1999).
        """
        return self._as_read if order is None else self._begun(order)

    @cached_property
    def _as_read(self) -> Mechanism:
        return self._begun(None)

    def _begun(self, order: Ints | None) -> Mechanism:
        readings = self.readings
        if order is not None:
            readings = replace(readings, q=readings.q[order])
        weights = weights_of(self.settings, readings)
        part, found = np.arange(len(readings)), begin(self.robot, readings, self.points)
        for _ in range(_TRIMMED):
            seen = laid(readings, found, weights)
            better = _better_half(seen.own, readings.series)
            if seen.miss < GROSS_DISTANCE_M or np.array_equal(better, part):
                break
            part, found = better, begin(self.robot, readings.part(better), self.points)
        return found

    def laid(
        self, mechanism: Mechanism | None = None, order: Ints | None = None
    ) -> _AlignedTargets:
        """The units aligned with a robot, by default the one as delivered, and in `order`."""
        weights = weights_of(self.settings, self.readings)
        return replace(laid(self.readings, mechanism or self.begun(), weights), order=order)

    def of(self, correct: _Correction) -> PositionSheet:
        """The table after a correction."""
        return PositionSheet(self.robot, self.settings, correct(self.rows))

    def without(self, mistakes: Sequence[Mistake]) -> PositionSheet:
        """The table after several corrections, applied to rows labelled as in this one."""
        out = self
        for one in mistakes:
            out = out.of(one.correct)
        return out.of(lambda rows: rows.reset_index(drop=True))

    def at(self, units: Sequence[int] | Ints) -> tuple[str, ...]:
        """Lines of the rows of some units: `file:line`."""
        return lines_of(self.rows[np.isin(self.unit, units)])

    def called(self, unit: int) -> str:
        """`pose07`, with as many digits as the largest pose number."""
        pose = self.rows["pose"].to_numpy(int)
        return f"pose{pose[int(np.argmax(self.unit == unit))]:0{max(len(str(pose.max())), 2)}d}"


@dataclass(frozen=True, eq=False)
class _AlignedTargets(Locked):
    """Predicted and measured positions of targets.

    Attributes:
        expected: Prediction by the joint values of each unit [m], F_b, shape (u, t, 3).
        at: Readings of the instrument [m], F_b, NaN where not read, shape (u, t, 3).
        order: Unit whose joint values belong here, where that is not its own, (u,).
    """

    expected: Array
    at: Array
    order: Ints | None = None

    @cached_property
    def off(self) -> Array:
        """Distance of each reading from its prediction [m], shape (u, t)."""
        return np.asarray(np.linalg.norm(self.expected - self.at, axis=2))

    @cached_property
    def own(self) -> Array:
        """Mean squared distance of each unit from its prediction [m^2], shape (u,)."""
        return np.asarray(np.nanmean(self.off**2, axis=1))

    @property
    def miss(self) -> float:
        """Median rms distance of the units, in their order, from their predictions [m]."""
        expected = self.expected if self.order is None else self.expected[self.order]
        off = np.sum((expected - self.at) ** 2, axis=2)
        return float(np.sqrt(np.median(np.nanmean(off, axis=1))))

    @property
    def limit(self) -> float:
        """Squared distance above which a unit is elsewhere [m^2]."""
        return (OUTSTANDING_MISFIT * max(self.miss, _LEAST_M)) ** 2

    @property
    def away(self) -> Bools:
        """Units that are elsewhere, shape (u,)."""
        return np.asarray(self.own > self.limit)

    def cost(self, units: Ints) -> Array:
        """Mean squared distance [m^2] of predictions (rows) from readings (columns), some units."""
        expected, at = self.expected[units], self.at[units]
        total, count = np.zeros((2, len(units), len(units)))
        for k in range(at.shape[1]):
            there = np.isfinite(at[:, k, 0])
            square = np.sum((expected[:, None, k] - at[None, there, k]) ** 2, axis=2)
            total[:, there] += square
            count[:, there] += 1
        return np.asarray(total / count)


def _better_half(own: Array, series: Ints) -> Ints:
    """The units of each series with at most its median misfit."""
    limit = np.array([np.median(own[series == k]) for k in range(int(series.max()) + 1)])
    return np.flatnonzero(own <= limit[series])


def laid(readings: PositionReadings, mechanism: Mechanism, weights: ArmWeights) -> _AlignedTargets:
    """Readings aligned with a robot."""
    return _AlignedTargets(*placed(readings, mechanism, weights))


def position_rows(sheet: PositionSheet) -> tuple[list[Mistake], PositionSheet]:
    """Mistakes in columns, rows and names of a table of positions, and the table without them.

    None if the targets are where the robot predicts them. What no single mistake explains is left.
    """
    found: list[Mistake] = []
    sheet = sheet.without(())
    for look in (_units, _order, _names, since):
        new = list(look(sheet))
        sheet = sheet.without(new) if new else sheet
        found += new
    return found, sheet


# --- columns of the whole table -------------------------------------------------------------------


@dataclass(frozen=True)
class _Guess:
    """A column or name that may be wrong throughout, as `faults.conventions.SupposedMistake`."""

    name: str
    where: str
    says: str
    correct: _Correction


def _units(sheet: PositionSheet) -> Iterator[Mistake]:
    before = sheet.laid().miss
    if before < GROSS_DISTANCE_M:
        return
    tried = [(guess, _plainly(sheet.of(guess.correct))) for guess in _guesses(sheet)]
    guess, after = min(tried, key=lambda one: one[1])
    if after < GROSS_DISTANCE_M and CLEARLY_NEARER * after < before:
        yield _of_column(guess, before, after, ())


def _plainly(sheet: PositionSheet) -> float:
    """Median rms distance of some units from their predictions, if at most half are wrong [m]."""
    some = sheet.readings.part(np.arange(0, len(sheet.readings), 1 + len(sheet.readings) // _FEW))
    weights = weights_of(sheet.settings, some)
    return laid(some, begin(sheet.robot, some, sheet.points), weights).miss


def _guesses(sheet: PositionSheet) -> Iterator[_Guess]:
    yield from _coordinates()
    yield from _joints(sheet.robot)
    for a, b in combinations(sheet.robot.joints, 2):
        if a.prismatic == b.prismatic:
            swap = {a.name: b.name, b.name: a.name}
            says = f"the columns of {a.name} and {b.name} stand in each other's place"
            yield _Guess("exchanged", f"{a.name}/{b.name}", says, partial(_swapped, names=swap))
    names = sorted(set(sheet.rows["target"]))
    if sheet.points and len(names) <= _MOST_NAMES:
        for order in permutations(names):
            if list(order) != names:
                true = dict(zip(names, order, strict=True))
                says = f"the targets {', '.join(names)} carry the names of {', '.join(order)}"
                yield _Guess("label_swap", "all rows", says, partial(_renamed, true=true))


_MOST_NAMES = 4
"""Maximum number of targets of which every permutation of names is tried."""


_OTHER_UNITS = {
    10.0: ("cm", "the numbers are centimetres and were read as millimetres"),
    1e-2: ("cm", "the numbers are centimetres and were read as metres"),
    304.8: ("ft", "the numbers are feet and were read as millimetres"),
    0.3048: ("ft", "the numbers are feet and were read as metres"),
}
"""Units that no title of a table of positions can state, as `UNITS`."""

_FAR_M = 0.02
"""Median distance of the targets from the nominal robot [m] above which a unit, a sense or a
convention is wrong: errors of tables are millimetres."""


def farther_than_real(off_m: float) -> Iterator[str]:
    """Remark that the targets are so far [m] from the nominal robot as on no real one."""
    if off_m > _FAR_M:
        yield (
            f"the targets are {plain(1e3 * off_m, 3)} mm from where the robot file places them, "
            "farther than on any real robot: check the units and signs of the joint values and "
            "the robot file"
        )


def _coordinates() -> Iterator[_Guess]:
    """Wrong units of all coordinates or of one, and a left-handed frame."""
    for factor, (unit, says) in _OTHER_UNITS.items():
        yield _Guess("unit_mixup", unit, says, partial(_scaled, names=AXES, factor=factor))
    for factor, (unit, says) in UNITS.items():
        yield _Guess("unit_mixup", unit, says, partial(_scaled, names=AXES, factor=factor))
        for axis in AXES:
            scaled = partial(_scaled, names=(axis,), factor=factor)
            yield _Guess("unit_mixup", f"{axis}_{unit}", f"in {axis} {says}", scaled)
    flipped = partial(_scaled, names=("y",), factor=-1.0)
    yield _Guess("sign_or_convention", "left_handed", "the frame is left-handed", flipped)


def _joints(robot: Robot) -> Iterator[_Guess]:
    """Wrong units of all joints or of one, in terms of the controller's axes."""
    for ending, unit, factor, says in LOGGED:
        slides = ending == "_m"
        mine = tuple(j.name for j in robot.joints if j.prismatic == slides)
        if mine:
            yield _Guess("unit_mixup", unit, says, partial(_logged, robot, mine, factor))
        for name in mine if len(mine) > 1 else ():
            scaled = partial(_logged, robot, (name,), factor)
            yield _Guess("unit_mixup", f"{name}_{unit}", f"in {name} {says}", scaled)


def _of_column(guess: _Guess, before: float, after: float, at: tuple[str, ...]) -> Mistake:
    where = f" ({lines(at)})" if at else ""
    return Mistake(
        name=guess.name,
        where=guess.where,
        evidence=f"{guess.says}{where}: the targets are {length(before)} from where the robot file "
        f"places them, and {length(after)} once that is put right",
        correction=f"recomputed with {guess.where} put right",
        before=1e3 * before,
        after=1e3 * after,
        correct=guess.correct,
        at=at,
        since=at[0] if at and guess.name == "unit_mixup" else None,
    )


def _scaled(
    rows: PositionTable, names: Sequence[str], factor: float, only: Bools | None = None
) -> PositionTable:
    where = np.ones(len(rows), dtype=bool) if only is None else only
    return rows.assign(**{one: rows[one].where(~where, rows[one] * factor) for one in names})


def _swapped(rows: PositionTable, names: dict[str, str]) -> PositionTable:
    return rows.assign(**{one: rows[other] for one, other in names.items()})


def _renamed(rows: PositionTable, true: dict[str, str]) -> PositionTable:
    return rows.assign(target=[true.get(one, one) for one in rows["target"]])


def _logged(
    robot: Robot, names: Sequence[str], factor: float, rows: PositionTable
) -> PositionTable:
    """Joint values multiplied by a factor, as axes of the controller where it has its own zeros.

    q = M a + q0: a unit applies to the number a in the file, without the zero.
    """
    every = [joint.name for joint in robot.joints]
    q = rows[every].to_numpy(float)
    times = np.where(np.isin(every, names), factor, 1.0)
    M, zero = robot.controller_matrix, robot.controller_offset
    if M.shape != (len(every), len(every)):
        M, zero = np.eye(len(every)), np.zeros(len(every))
    axes = linear.solve(M, (q - zero).T).T
    turned = (axes * times) @ M.T + zero
    return rows.assign(**dict(zip(every, turned.T, strict=True)))


# --- rows in each other's place -------------------------------------------------------------------


def _order(sheet: PositionSheet) -> Iterator[Mistake]:
    """Joint values that belong to other rows."""
    yield from in_order(sheet, _by_most(sheet))


def in_order(sheet: PositionSheet, seen: _AlignedTargets) -> Iterator[Mistake]:
    """Units whose joint values belong to another one.

    Args:
        sheet: The table.
        seen: Its units aligned with the robot.
    """
    away = np.flatnonzero(seen.away)
    if not 2 <= len(away) <= _MOST:
        return
    cost = seen.cost(away)
    for ring in rings(
        cost / max(seen.miss, _LEAST_M) ** 2, OUTSTANDING_MISFIT**2, OUTSTANDING_MISFIT**2
    ):
        yield _of_ring(sheet, away, ring, cost)


def _of_ring(sheet: PositionSheet, away: Ints, ring: Ring, cost: Array) -> Mistake:
    units = [int(away[k]) for k in ring.members]
    names, stands = [sheet.called(unit) for unit in units], ring.among(away)
    file = str(sheet.rows["file"].iloc[int(np.argmax(sheet.unit == units[0]))])
    own = [sheet.rows.index[sheet.unit == unit] for unit in units]
    return exchange_mistake(
        ring,
        where=stands.where(names),
        what=f"{file}: the joint values of {in_words(stands, names)}",
        stand=misplacement(stands, "pose"),
        of="their targets are",
        cost=cost,
        at=sheet.at(units),
        correct=partial(_moved, robot=sheet.robot, own=own, ended=ring.ended),
    )


def _moved(
    rows: PositionTable, robot: Robot, own: Sequence[pd.Index], ended: bool
) -> PositionTable:
    """Joint values of each unit moved to the next in the ring; if ended, the first is dropped."""
    every = [joint.name for joint in robot.joints]
    out = rows.copy()
    first = [rows.loc[mine[0], every].to_numpy(float) for mine in own]
    for values, mine in zip(first, (*own[1:], own[0]), strict=True):
        out.loc[mine, every] = values
    return out.drop(index=own[0]) if ended else out


def _by_most(sheet: PositionSheet) -> _AlignedTargets:
    """The units aligned with the robot by most of their joint values, in some order."""
    given = sheet.laid()
    if given.miss < GROSS_DISTANCE_M:
        return given
    every = np.arange(len(sheet.readings))
    for order in (np.roll(every, 1), np.roll(every, -1)):
        if (found := sheet.laid(sheet.begun(order), order)).miss < GROSS_DISTANCE_M:
            return found
    return _sought(sheet) or given


def _sought(sheet: PositionSheet) -> _AlignedTargets | None:
    """The units aligned with the robot, in any order of their joint values; None if none fits.

    Frame and order are alternated: the assignment of least sum for a frame, and the frame that fits
    it, starting from every rotation that aligns the principal axes of both point clouds.
    """
    readings = sheet.readings
    if len(readings) > _SHUFFLED or len(readings.names) > 1:
        return None
    here = configure(sheet.robot, readings.q)
    target = int(np.argmax(np.isfinite(readings.at[..., 0]).sum(axis=0)))
    seen = np.flatnonzero(np.isfinite(readings.at[:, target, 0]))
    cloud = here.flange_origin
    for R in _turns(cloud, readings.at[seen, target]):
        order = _matched(cloud, here.flange_axes, readings.at[:, target], seen, R)
        if (found := sheet.laid(sheet.begun(order), order)).miss < GROSS_DISTANCE_M:
            return found
    return None


def _turns(a: Array, b: Array) -> Iterator[Array]:
    """Rotations that align the principal axes of a (m, 3) with those of b (k, 3)."""
    (_, own), (_, other) = (linear.directions(np.cov((p - p.mean(axis=0)).T)) for p in (a, b))
    for order in permutations(range(3)):
        for signs in np.stack(np.meshgrid([1, -1], [1, -1], [1, -1]), -1).reshape(-1, 3):
            R = (other[:, list(order)] * signs) @ own.T
            if np.linalg.det(R) > 0:
                yield R


def _matched(cloud: Array, axes: Array, at: Array, seen: Ints, R: Array) -> Ints:
    """Order in which joint values fit the readings of a target, from an initial rotation, (u,)."""
    order, point = np.arange(len(cloud)), np.zeros(3)
    t = at[seen].mean(axis=0) - R @ cloud.mean(axis=0)
    for _ in range(_ROUNDS):
        expected = cloud + axes @ point
        cost = np.sum(((expected @ R.T + t)[:, None] - at[None, seen]) ** 2, axis=2)
        content, place = optimize.linear_sum_assignment(cost)
        new = np.setdiff1d(np.arange(len(cloud)), content)
        fits = np.empty(len(cloud), np.int64)
        fits[seen[place]] = content
        fits[np.setdiff1d(np.arange(len(cloud)), seen)] = new
        if np.array_equal(fits, order):
            break
        order = fits
        R, t, point = _refitted(cloud[order][seen], axes[order][seen], at[seen], point)
    return order


def _refitted(origin: Array, axes: Array, at: Array, point: Array) -> tuple[Array, Array, Array]:
    """Frame and tool point that fit an order, by alternation."""
    R, t = np.eye(3), np.zeros(3)
    for _ in range(10):
        R, t = linear.rigid(origin + axes @ point, at)
        base = (at - t) @ R - origin
        point = np.einsum("mij,mi->j", axes, base) / len(at)
    return R, t, point


# --- names of targets -----------------------------------------------------------------------------


def _names(sheet: PositionSheet) -> Iterator[Mistake]:
    """Readings with the name of another target of their pose, mistyped or exchanged."""
    seen = sheet.laid()
    if seen.miss >= GROSS_DISTANCE_M:
        return
    rows, names = sheet.rows, sheet.readings.targets
    k = pd.Index(names).get_indexer(pd.Index(rows["target"]))
    frame = sheet.begun().frames[sheet.readings.series]
    at = rows[list(AXES)].to_numpy(float)
    own = np.einsum("nji,nj->ni", frame[sheet.unit, :3, :3], at - frame[sheet.unit, :3, 3])
    away = np.linalg.norm(seen.expected[sheet.unit, k] - own, axis=1) ** 2 > seen.limit
    again = rows.duplicated(["series", "pose", "target"], keep=False).to_numpy() & away
    count = np.bincount(k, minlength=len(names))
    rare = count[k] < max(_RARE * len(sheet.readings), 2)
    for unit in np.unique(sheet.unit[away | again | rare]):
        mine = np.flatnonzero(sheet.unit == unit)
        if len(mine) < 2 and not rare[mine].any():
            continue
        cost = np.sum((own[mine, None] - seen.expected[unit][None]) ** 2, axis=2)
        cost[:, count < max(_RARE * len(sheet.readings), 2)] = np.inf
        yield from _in_pose(sheet, mine, k[mine], away[mine] | rare[mine], cost, seen.limit)


def _in_pose(
    sheet: PositionSheet, mine: Ints, named: Ints, doubted: Bools, cost: Array, limit: float
) -> Iterator[Mistake]:
    """Readings of one pose that fit another target, each a different one."""
    names, best = sheet.readings.targets, np.argmin(cost, axis=1)
    near = cost[np.arange(len(mine)), best] <= limit
    moved = doubted & near & (best != named)
    after = np.where(moved, best, named)
    if not moved.any() or len(np.unique(after)) < len(after):
        return
    true = {int(mine[i]): str(names[best[i]]) for i in np.flatnonzero(moved)}
    said_ = [f"{names[named[i]]} is {names[best[i]]}" for i in np.flatnonzero(moved)]
    at = lines_of(sheet.rows.iloc[sorted(true)])
    before = np.sqrt(np.nanmax(cost[np.flatnonzero(moved), named[moved]]))
    rest = float(np.sqrt(cost[np.flatnonzero(moved), best[moved]].max()))
    pose = sheet.called(int(sheet.unit[mine[0]]))
    yield Mistake(
        name="label_swap",
        where=f"{pose}/" + "/".join(sorted({str(names[named[i]]) for i in np.flatnonzero(moved)})),
        evidence=f"in {pose} a target carries the name of another one ({lines(at)}): "
        f"{', '.join(said_)}; {_off(before, rest)}",
        correction=f"recomputed with the names of {pose} put right",
        before=1e3 * float(before) if np.isfinite(before) else 1e3 * GROSS_DISTANCE_M,
        after=1e3 * rest,
        correct=partial(_called_right, true=true),
        at=at,
    )


def _off(named_m: float, other_m: float) -> str:
    """Distance of a target from its prediction, by its name and by the other one, in words."""
    if not np.isfinite(named_m):
        return f"[tool] has no target of that name; by the other it is {length(other_m)} off"
    return (
        f"as named it is {length(float(named_m))} from where the robot places it, and "
        f"{length(other_m)} under the other name"
    )


def _called_right(rows: PositionTable, true: dict[int, str]) -> PositionTable:
    names = rows["target"].to_numpy(object, copy=True)
    names[list(true)] = list(true.values())
    return rows.assign(target=names)


# --- from some row on -----------------------------------------------------------------------------


def since(sheet: PositionSheet, known: Mechanism | None = None) -> Iterator[Mistake]:
    """A unit that is wrong in some rows: from one on, or in single ones.

    Args:
        sheet: The table.
        known: The robot that predicts them; by default the one as delivered.
    """
    mechanism = known or sheet.begun()
    seen = sheet.laid(mechanism)
    away = seen.away
    if seen.miss >= GROSS_DISTANCE_M or not away.any():
        return
    best, most = None, 0
    for guess in (*_coordinates(), *_joints(sheet.robot)):
        other = sheet.of(guess.correct).laid(mechanism)
        right = away & (other.own < seen.limit)
        if right.sum() > most:
            best, most = (guess, other.own), int(right.sum())
    if best is None:
        return
    guess, corrected = best
    wrong, tail = _wrong_units(seen, corrected)
    only = wrong[sheet.unit]
    some = replace(guess, correct=partial(_some, correct=guess.correct, only=only))
    before, after = (float(np.sqrt(own[wrong].max())) for own in (seen.own, corrected))
    one = _of_column(some, before, after, sheet.at(np.flatnonzero(wrong)))
    yield replace(one, since=one.since if tail else None)


def _wrong_units(seen: _AlignedTargets, corrected: Array) -> tuple[Bools, bool]:
    """Which units a correction applies to, and whether these are all from some one on.

    All from one on, or all up to one, with which the sum of squares, of each unit at most
    `_AlignedTargets.limit`, is least, where that is no more than with those only that are
    elsewhere: a value may be wrong by so little that its unit is not.

    Args:
        seen: The units as given.
        corrected: Mean squared distance of each unit with the correction [m^2], shape (u,).
    """
    given, right = (np.minimum(own, seen.limit) for own in (seen.own, corrected))
    single = seen.away & (corrected < seen.limit)
    gain = np.append(0.0, np.cumsum(given - right))  # of all units before each
    first, last = int(np.argmin(gain)), int(np.argmax(gain))
    every, place = float((given - right)[single].sum()), np.arange(len(given))
    if gain[-1] - gain[first] >= max((1 - _EQUAL) * every, gain[last]):
        return place >= first, True
    return (place < last, False) if gain[last] >= (1 - _EQUAL) * every else (single, False)


_EQUAL = 1e-9
"""Relative difference of sums that are equal but for rounding [1]."""


def _some(rows: PositionTable, correct: _Correction, only: Bools) -> PositionTable:
    """A correction applied to some rows only."""
    out = rows.copy()
    out.loc[only] = correct(rows).loc[only]
    return out
