"""What the unloaded reflectors show of the robot's table, its base frame and the arm's weight.

Delivered robots deviate from their table everywhere by some tenths of a millimetre and milliradian,
and their joints err at every pose. Both are estimated; only what is far beyond them is a cause.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, compared
from pipeline.base.bootstrap import interval
from pipeline.base.linear import rms
from pipeline.diagnosis.facts import (
    NO_UNLOADED,
    CrossValidation,
    PossibleCause,
    TableCause,
    UnloadedFacts,
)
from pipeline.geometry import remastered
from pipeline.geometry.roughness import (
    ScaleGrid,
    SuspectUnknowns,
    cells,
    left_out,
    products,
    same,
    straight,
    unrefined,
)
from pipeline.geometry.unloaded import (
    START,
    USUAL,
    MidChange,
    PoseRows,
    Unloaded,
    off,
    reach,
    unloaded,
)
from pipeline.machine.cell import Cell, load
from pipeline.machine.effect import Effect, Elastic, Geometry, Observation, Pulls
from pipeline.machine.effects import (
    base_moved,
    base_rotation,
    joint_offset,
    table,
    target_moved,
)
from pipeline.machine.robot import Robot
from pipeline.machine.robot.dh_parameters import changed
from pipeline.machine.robot.weight import weighs
from pipeline.reduction.course import Course
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.system import Estimate

OUTSTANDING = 5.0
"""Minimum ratio of a cause to the deviations of the rest of the table, or of a usual table [1]."""

_MISFIT = 1e-6
"""P-value below which the readings' noise alone does not explain the reflectors' positions [1]."""

MOST_CAUSES = 4
"""Maximum number of causes named in one table."""

_SEED = 20261123
"""Seed of the draws; another one changes numbers within their stated scatter."""

WIDE = 0.1
"""Largest size of a suspect [m or rad]; for masses it is ten times their usual size."""

_POWER = 0.84
"""Standard deviations by which a magnitude must exceed a threshold to be detected in 80 % of the
cases [1]."""


@dataclass(frozen=True, kw_only=True)
class _Suspect(SuspectUnknowns):
    """A possible cause.

    Attributes:
        effect: The effect.
    """

    effect: Effect

    @property
    def sags(self) -> bool:
        """Whether it is the weight of the arm, which is estimated in any case."""
        return self.effect.name == "gravity_sag"


def from_unloaded(
    cell: Cell,
    data: Measured,
    scale: float,
    effects: Sequence[Effect],
    wander_m: float = 0.0,
    grown: Course | None = None,
) -> UnloadedFacts:
    """Estimate the table from the unloaded positions, and find the parameters that are far off.

    That an arm sags whose links weigh by its file is no finding.

    Args:
        cell: The joint springs model with the identified stiffnesses.
        data: The measurements; `unloaded` may be NaN, then nothing is found.
        scale: Scatter of the tracker over its stated standard uncertainty.
        effects: The catalogue.
        wander_m: Slow error of the instrument common to all targets, which moves whole poses [m].
        grown: Growth of the base frame, with which the robot may have grown or not.
    """
    known = weighs(cell.robot)
    zeros = unloaded(cell.robot, cell.tool, None if known else _sag(effects), data, scale, grown)
    if zeros is None:
        return NO_UNLOADED
    asked = tuple(_suspects(zeros, effects))
    x = np.zeros(zeros.columns.count)
    rows = zeros.about(x)
    sums = products(rows)
    table_only = straight(zeros, sums)
    search = _Search(zeros, asked, x, rows, cells(zeros, sums), wander_m)
    if not _fits(zeros, rows, table_only):
        search = _weighed(search, effects, known)
    found, zeros = search.found, search.zeros
    missed = left_out(table_only, rows), left_out(found, search.rows)
    stated = np.sum((rows.Z * (zeros.joint_std if zeros.joint_std.size else 0.0)) ** 2, axis=2)
    stood = UnloadedFacts(
        miss_m=rms((rows.y - rows.D @ table_only.mean)[rows.place]),
        left_m=off(zeros, found.mean),
        visible=dict.fromkeys(_unseen(effects, asked), np.inf) | _visible(search),
        cells=found,
        causes=tuple(_off(search, k) for k in range(len(found.free))),
        gain=_gain(missed, zeros, found),
        rough=found.p_exact() < alarms.GEOMETRY,
        tool_m=_moved_tool(zeros, found),
        noise_m=float(np.sqrt(np.mean(np.einsum("vii->vi", zeros.errors)))),
        usual_m=float(np.sqrt(np.mean((np.einsum("pii->pi", rows.cov(1.0)) + stated)[rows.place]))),
    )
    asks = stood.unexplained and not found.free
    return replace(stood, down=_down(zeros, found)) if asks else stood


def _weighed(search: _Search, effects: Sequence[Effect], known: bool) -> _Search:
    """The whole search, with links that weigh by the file if that is certainly likelier.

    Args:
        search: The search without causes.
        effects: The catalogue.
        known: Whether the file states what the links weigh.
    """
    heavy = search.over(replace(search.zeros, sag=None, weighs=True), effects).with_free(())
    search, heavy = search.whole(effects), heavy.whole(effects)
    sure = 0.0 if known or any(one.sags for one in search.free) else _SURE
    return heavy if heavy.found.log_evidence > search.found.log_evidence + sure else search


def _down(zeros: Unloaded, found: ScaleGrid) -> tuple[str, float] | None:
    """Axis of F_b along which gravity makes the readings certainly likelier; what is then left."""
    best, down = found.log_evidence + _SURE, None
    for axis, sign in product(range(3), (1.0, -1.0)):
        gravity = sign * np.linalg.norm(zeros.robot.gravity) * np.eye(3)[axis]
        other = replace(zeros, robot=zeros.robot.under(gravity), sag=None, weighs=True)
        there = unrefined(other, products(other.about(np.zeros(other.columns.count))))
        if there.log_evidence > best and other.hangs(there.mean):
            left_m = off(other, there.mean)
            best, down = there.log_evidence, (f"{'+-'[sign < 0]}{'xyz'[axis]}", left_m)
    return down


_SURE = 10.0
"""Log odds from which on the links weigh, or gravity acts along another axis than stated [1]:
twenty thousand to one, against one of a thousand files that state it wrongly."""


def _moved_tool(zeros: Unloaded, found: ScaleGrid) -> float:
    """Largest distance of an estimated target from its position in [tool] [m]."""
    if zeros.turned is not None:  # one pose stands for all targets
        return 0.0
    moved = found.mean[zeros.columns.tool].reshape(-1, 3)
    return float(np.linalg.norm(moved, axis=1).max(initial=0.0))


def _sag(effects: Sequence[Effect]) -> Geometry | None:
    facets = (f for effect in effects if effect.name == "gravity_sag" for f in effect.facets)
    return next((facet for facet in facets if isinstance(facet, Geometry)), None)


def _suspects(zeros: Unloaded, effects: Sequence[Effect]) -> Iterator[_Suspect]:
    """Every geometric parameter by itself, the base frame's rotation, the weight of the arm."""
    known = {effect.label: effect for effect in (*effects, *table.effects(zeros.robot))}
    where = zeros.columns
    for k, letter in enumerate(zeros.letters, where.table.start):
        if letter.label in known:
            yield _Suspect(letter.label, (k,), WIDE, effect=known[letter.label])
    for label, at, wide in (
        ("base_rotation", where.loose, WIDE),
        ("gravity_sag", where.masses, 10.0),
    ):
        if label in known and at.stop > at.start:
            yield _Suspect(label, tuple(range(at.start, at.stop)), wide, effect=known[label])
    tries = remastered.places(zeros)
    for one, at in zeros.changed:
        effect: Effect = base_moved.since(one.before, one.since)
        if one.joint:
            at_joint = one.joint, one.before, one.since, one.slipped
            effect = joint_offset.since(zeros.robot, *at_joint)
        if one.target is not None:
            name = str(zeros.tool.targets[one.target])
            effect = target_moved.since(name, one.target, one.before, one.since)
        label, columns = f"{effect.label} {effect.form}", tuple(range(at.start, at.stop))
        yield _Suspect(label, columns, WIDE, (1 + (one.joint > 0)) * tries, effect=effect)


def _unseen(effects: Sequence[Effect], asked: Sequence[_Suspect]) -> set[str]:
    """Causes that move unloaded reflectors exactly as F_b or the tool do: the zero of the rail."""
    return {one.label for one in effects if one.shows_unloaded} - {one.label for one in asked}


def _fits(zeros: Unloaded, rows: PoseRows, plain: ScaleGrid) -> bool:
    """Whether position, stated rotation, tool and noise of the readings explain the positions."""
    left = rows.y - rows.D @ plain.mean
    chi2 = float(np.sum(np.einsum("pij,pj->pi", linear.whitening(rows.N), left) ** 2))
    return zeros.dof < 1 or bool(special.chdtrc(zeros.dof, chi2) > _MISFIT)


@dataclass(frozen=True, eq=False)
class _Search:
    """State of the search for causes.

    Attributes:
        zeros: The readings.
        asked: All possible causes.
        x: Linearisation point.
        rows: The readings linearised there.
        found: Estimates with the causes free.
        wander_m: Slow error of the instrument common to all targets [m].
    """

    zeros: Unloaded
    asked: tuple[_Suspect, ...]
    x: Array
    rows: PoseRows
    found: ScaleGrid
    wander_m: float

    def whole(self, effects: Sequence[Effect]) -> _Search:
        """All steps of the search."""
        search = self.with_slip(effects).with_changes(effects).done()
        again = search.with_changes(effects)
        return (search if again is search else again.done()).with_sag()

    def done(self) -> _Search:
        """Add causes one by one while each of them is far beyond the rest."""
        now = self
        for _ in range(MOST_CAUSES):
            more = now.with_free((*now.free, now.likeliest()))
            if not all(more.far(one) for one in more.free):
                return now
            now = more
        return now

    def with_sag(self) -> _Search:
        """The sag as a cause, too, where it stands far beyond the rest beside all others."""
        sag = [one for one in self.asked if one.sags]
        more = self.with_free((*self.free, *sag))
        heavy = bool(sag) and all(map(more.possible, sag))
        return more if heavy and all(more.far(one) for one in more.free) else self

    def possible(self, one: _Suspect) -> bool:
        """Whether its magnitude is within the bounds of its parameters: no mass is negative."""
        values = self.found.mean[list(one.columns)] * _units(one)
        pairs = zip(one.effect.parameters, values, strict=True)
        return all(parameter.lower <= value <= parameter.upper for parameter, value in pairs)

    def with_slip(self, effects: Sequence[Effect]) -> _Search:
        """The search with the target that moved on the effector by its shape alone, if any did."""
        slips = remastered.slipped(self.zeros, self.rows)
        likeliest = min(slips, key=lambda one: slips[one], default=None)
        tries = self._tries + len(slips) * remastered.places(self.zeros)
        if likeliest is None or tries * slips[likeliest] >= alarms.GEOMETRY:
            return self
        more = self.over(replace(self.zeros, changes=tuple(slips)), effects)
        which = [one for one in more.asked if more.change_of(one) == likeliest]
        return more.with_free((*more.free, *which))

    @property
    def _tries(self) -> int:
        """Number of suspects with all their alternatives."""
        return sum(one.tries for one in self.asked)

    def change_of(self, one: _Suspect) -> MidChange | None:
        """The change in mid-campaign that a suspect is; None of others."""
        first = one.columns[0]
        return next((change for change, at in self.zeros.changed if at.start == first), None)

    def with_changes(self, effects: Sequence[Effect]) -> _Search:
        """The search extended by changes of joint zeros, if the residuals call for any."""
        if any(one.columns[0] >= self.zeros.columns.changes.start for one in self.free):
            return self
        changes = remastered.changes(self.zeros, self.rows, self.found)
        zeros = replace(self.zeros, changes=changes)
        return self if changes == self.zeros.changes else self.over(zeros, effects)

    def over(self, zeros: Unloaded, effects: Sequence[Effect]) -> _Search:
        """The search in the same readings, with other changes or weights among the unknowns."""
        stays = zeros.columns.masses.start
        x = np.append(self.x[:stays], np.zeros(zeros.columns.count - stays))
        asked, rows = tuple(_suspects(zeros, effects)), zeros.about(x)
        free = tuple(one for one in asked if one.label in {old.label for old in self.free})
        return _Search(zeros, asked, x, rows, cells(zeros, products(rows), free), self.wander_m)

    @property
    def free(self) -> tuple[_Suspect, ...]:
        """The causes found so far."""
        return tuple(one for one in self.asked if one in self.found.free)

    def likeliest(self) -> _Suspect:
        """The suspect with the largest evidence, other than the sag that every arm has."""
        rest = [one for one in self.asked if one not in self.found.free and not one.sags]
        return max(rest, key=lambda one: compared(self.found.evidence(one)))

    def with_free(self, free: tuple[_Suspect, ...]) -> _Search:
        """The estimate with some causes free, linearised at the corrected robot."""
        x, rows = self.x, self.rows
        for _ in range(_ROUNDS):
            x, before = unrefined(self.zeros, products(rows), free).mean, x
            rows = self.zeros.about(x)
            if np.max(np.abs(x - before)[self.zeros.columns.table], initial=0.0) < _STILL:
                break
        found = cells(self.zeros, products(rows), free)
        return replace(self, x=x, rows=rows, found=found)

    def far(self, one: _Suspect) -> bool:
        """Whether a cause is significant and far beyond the rest of the table and the wander.

        A target that moved changes the effector's shape, which no error of the robot does.
        """
        change = self.change_of(one)
        if change and change.target is not None and len(self.zeros.tool.points) > 1:
            p = remastered.slipped(self.zeros, self.rows).get(change, 1.0)
            return p * self._tries < alarms.GEOMETRY
        if self.p_value(one) >= alarms.GEOMETRY or _size(self.found, one) <= OUTSTANDING:
            return False
        moves = _moves(self.found, one) @ self.found.mean[list(one.columns)]
        return rms(moves) > OUTSTANDING * self.wander_m

    def p_value(self, one: _Suspect) -> float:
        """P-value of a cause, corrected for the number of suspects and their alternatives."""
        at = np.array(one.columns) - self.zeros.columns.table.start
        beside = np.zeros((len(self.found.log), len(at)))
        if one.columns[0] == self.zeros.columns.loose.start:
            beside = np.repeat(self.found.rough[:, 1:], len(at), axis=1)
        elif at[0] < len(self.zeros.letters):
            own = np.hypot(self.found.rough[:, int(self.zeros.turns[at[0]])], self.zeros.stated[at])
            beside = own[:, None]
        return min(1.0, self._tries * self.found.p_value(one, beside))


_ROUNDS = 4
"""Maximum number of linearisations: 50 mm and some milliradians leave nanometres after two."""

_STILL = 1e-6
"""Change of the table's parameters below which the iteration ends [m or rad]."""


def _rest(found: ScaleGrid, one: SuspectUnknowns) -> float:
    """What the rest of the table, or a usual one, is off by: in the unit of a cause [m] or [rad].

    What the weight of the arm moves is compared with lengths, as it moves reflectors, and a motion
    of the robot with what one joint errs by at a pose.
    """
    zeros, first = found.zeros, one.columns[0]
    where = zeros.columns
    if where.table.start <= first < where.table.stop:
        k = first - where.table.start
        return max(float(zeros.usual()[k]), float(found.per_letter[k]))
    if first >= where.changes.start:
        joint = next(change.joint for change, at in zeros.changed if at.start == first)
        size = max(float(np.sqrt(found.weight @ found.transmission**2)), 1 / OUTSTANDING)
        if joint:
            return START[bool(zeros.robot.prismatic[joint - 1])] * size
        usual = np.where(zeros.robot.prismatic, START[True], START[False])
        return rms(zeros.about(found.mean).Z * usual) * size
    if first == where.loose.start:
        return max(USUAL[1], float(found.roughness[1]), rms(zeros.rotation))
    return max(USUAL[0], float(found.roughness[0]))


def _size(found: ScaleGrid, one: _Suspect) -> float:
    """How often a cause is what the rest is off by."""
    x = found.mean[list(one.columns)]
    if one.effect.name not in _OF_MANY:
        return float(np.linalg.norm(x)) / _rest(found, one)
    return rms(_moves(found, one) @ x) / _rest(found, one)


_OF_MANY = ("gravity_sag", "base_moved")
"""Causes whose unknowns count by what they move the reflectors."""


def _moves(found: ScaleGrid, one: SuspectUnknowns) -> Array:
    """Motion per unit of each of its unknowns, shape (p, r, columns) [m]."""
    return np.asarray(found.zeros.about(found.mean).D[:, :, list(one.columns)])


def _visible(search: _Search) -> dict[str, float]:
    """Multiples of the typical magnitude from which a cause is found in 80 % of the cases."""
    out, found = dict[str, float](), search.found
    asked = [one for one in search.asked if not search.change_of(one)]
    best, free = found.best, {one.label for one in found.free}
    far = float(special.ndtri(1 - alarms.GEOMETRY / len(asked) / 2)) + _POWER
    for one in asked:
        at = list(one.columns)
        C = found.cov[best][np.ix_(at, at)]
        if one.label not in free:
            less = np.diag(1 / (found.std[best, at] ** -2 - one.wide**-2))
            C = C + C @ linear.solve(less - C, C)
        typical = np.array([parameter.typical for parameter in one.effect.parameters])
        units = 1.0 if one.sags else 1 / typical  # masses are in such units
        spread = float(np.sqrt(np.mean(np.diag(C) * np.square(units))))
        out[one.label] = max(far * spread, _least(found, one))
    return out


def _least(found: ScaleGrid, one: _Suspect) -> float:
    """`OUTSTANDING`, as a multiple of the typical magnitude."""
    typical = one.effect.parameters[0].typical
    if one.sags:
        typical = max(rms(_moves(found, one).sum(axis=2)), 1e-12)
    return OUTSTANDING * _rest(found, one) / typical


def _off(search: _Search, number: int) -> TableCause:
    """One cause with its magnitude and what else could replace it."""
    zeros, one = search.zeros, search.free[number]
    rest = tuple(other for other in search.free if other is not one)
    sums = products(search.rows)
    beside = unrefined(zeros, sums, rest)
    others = [other for other in search.asked if other not in rest]
    odds = special.softmax([beside.evidence(other) for other in others])
    twins = [other for other in others if other is not one and same(zeros, sums, one, other)]
    mine = [i for i, other in enumerate(others) if other is one or other in twins]
    at, units = list(one.columns), _units(one)
    cov = search.found.covariance[np.ix_(at, at)] * units[:, None] * units
    return TableCause(
        effect=one.effect,
        value=search.found.mean[at] * units,
        std=np.sqrt(np.diag(cov)),
        p_value=search.p_value(one),
        probability=float(sum(odds[i] for i in mine)),
        rivals=_rivals(others, odds, mine),
        twins=tuple(other.effect for other in twins),
    )


def _rivals(others: list[_Suspect], odds: Array, mine: list[int]) -> tuple[PossibleCause, ...]:
    """The other suspects that are not improbable, the likeliest first."""
    order = np.argsort(-compared(odds), kind="stable")
    return tuple(
        PossibleCause(others[i].effect, float(odds[i]))
        for i in order
        if odds[i] > alarms.GEOMETRY and i not in mine
    )


def _units(one: _Suspect) -> Array:
    """SI value of one unit of each of its unknowns: masses are in units of their usual sizes."""
    if not one.sags:
        return np.ones(len(one.columns))
    return np.array([parameter.typical for parameter in one.effect.parameters])


def _gain(missed: tuple[Array, Array], zeros: Unloaded, found: ScaleGrid) -> CrossValidation:
    """Cross-validation of the corrected table against the table as it is."""
    before, after = (part.ravel() for part in missed)
    rng = np.random.default_rng(_SEED)
    reduction, ci95 = interval(before, after, np.repeat(zeros.read, 3), rng)
    chosen = (tuple(one.label for one in found.free),) * zeros.poses
    return CrossValidation(before, after, reduction, ci95, chosen, "unloaded positions")


def beside_springs(stood: UnloadedFacts, cell: Cell, causes: Sequence[Effect]) -> UnloadedFacts:
    """The facts beside springs found in the displacements, which the weight loads, too.

    By how much no mass tells: the residuals of each pose are projected off the motions along the
    screws of the virtual joints.

    Args:
        stood: The facts without them.
        cell: The joint springs model.
        causes: What was found in the displacements.
    """
    springs = [facet for one in causes for facet in one.facets if isinstance(facet, Elastic)]
    if not springs or not stood.unexplained or stood.cells is None:
        return stood
    zeros, x = stood.cells.zeros, stood.cells.mean
    loaded = load(replace(cell, effects=(), held=()), zeros.where_it_is(x)[1], np.zeros(0))
    at = loaded.points[np.arange(len(zeros.target)), zeros.target]
    screws = np.concatenate([one.screws(loaded) for one in springs], axis=1)
    moves, left = reach(screws, at[:, None])[:, :3], zeros.seen(x)
    for pose in range(zeros.poses if zeros.turned is None else 0):
        mine = zeros.pose == pose
        S, e = moves[mine].reshape(-1, moves.shape[2]), left[mine].ravel()
        left[mine] = (e - S @ linear.least_squares(S, e)).reshape(-1, 3)
    return replace(stood, yields_m=rms(left))


def as_stiff(cell: Cell, estimate: Estimate) -> Cell:
    """The cell with the identified stiffnesses, which determine the sag under gravity."""
    known = estimate.identifiable & (estimate.value > 0)
    joints = tuple(
        joint.with_stiffness(float(1 / x)) if told else joint
        for joint, x, told in zip(cell.robot.joints, estimate.value, known, strict=True)
    )
    return replace(cell, robot=replace(cell.robot, joints=joints))


def corrected(cell: Cell, data: Measured, found: UnloadedFacts) -> tuple[Cell, Measured]:
    """The cell with corrected table, and the measurements at the corrected joint values.

    Readings and forces given in F_b are rotated back by the estimated rotation of F_b. A joint that
    slipped has another zero in the table, which is that of the robot as it stands at the end.
    """
    assert found.cells is not None
    zeros, x = found.cells.zeros, found.cells.mean
    table, slips = zeros.at_end @ x, np.zeros(cell.robot.n)
    np.add.at(slips, [one.joint - 1 for one in zeros.letters], table - x[zeros.columns.table])
    robot = changed(cell.robot, zeros.letters, table)
    q, delta = _sagged(zeros.robot, data.pulls, found), data.delta[:, None]
    pulls = zeros.as_changed(replace(data.pulls, q=q - slips), x)
    turn = x[zeros.columns.loose]
    for effect in base_rotation.effects(cell.robot):
        loaded = load(replace(cell, effects=(effect,)), pulls, turn)
        pulls = replace(pulls, force=loaded.force)
        for facet in effect.facets:
            if isinstance(facet, Observation):
                delta = facet.observe(loaded, delta, pulls.time, -turn)
    for turns in _bumps(zeros, x, pulls):
        pulls = replace(pulls, force=pulls.force - np.cross(turns, pulls.pulled * pulls.force))
        delta = delta - np.cross(turns[data.pull][:, None], delta)
    return replace(cell, robot=robot), replace(data, pulls=pulls, delta=delta[:, 0])


def _sagged(robot: Robot, pulls: Pulls, found: UnloadedFacts) -> Array:
    """Joint values of each pull as they are under the arm's own weight, (m, n)."""
    q = pulls.q
    for one in found.causes:
        for facet in one.effect.facets:
            if isinstance(facet, Geometry) and one.effect.name == "gravity_sag":
                q = facet.geometry(robot, pulls, one.value)
    return q


def _bumps(zeros: Unloaded, x: Array, pulls: Pulls) -> Iterator[Array]:
    """Rotation of robot or tracker at each pull, of every change that is no joint's, (m, 3)."""
    for change, at in zeros.changed:
        if change.unknowns == 6:
            yield np.outer(change.share(pulls), x[at][3:])
