"""The one forward model: a cell with its effects, and what the tracker would read.

The simulator, B of Eq. (19), score tests, the extended model and pose design all use this file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TypeVar

import numpy as np

from pipeline.base.arrays import Array, Ints, Locked, Parameter, Strings
from pipeline.machine import six
from pipeline.machine.effect import (
    Effect,
    Elastic,
    Geometry,
    Loaded,
    Noise,
    Observation,
    Pulls,
    Reflectors,
    Table,
    Wrench,
)
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.configuration import cross, rigid_motions, torque, velocity

_E = TypeVar("_E", bound=Effect)


@dataclass(frozen=True, eq=False)
class Tool(Locked):
    """Points of the effector in the flange frame.

    Attributes:
        load_point: Where the chain pulls and weights hang [m], shape (3,).
        targets: Names of the reflectors, shape (t,).
        points: Their coordinates [m], shape (t, 3).
        six: True if the targets were computed from one measured 6-DOF pose (module `six`).
    """

    load_point: Array
    targets: Strings
    points: Array
    six: bool = False

    @classmethod
    def of(cls, points: Mapping[str, Sequence[float]]) -> Tool:
        """Create a tool from points by name [m]: load_point, and the reflectors in their order."""
        targets = [name for name in points if name != "load_point"]
        at = np.array([points[name] for name in targets])
        return cls(np.array(points["load_point"]), np.array(targets, dtype=object), at)

    @property
    def read(self) -> Strings:
        """Names of the observed vectors: targets, or position and rotation of a pose."""
        return np.array(six.ROWS, dtype=object) if self.six else self.targets

    def coordinates(self, here: Configuration, moved: Array) -> Array:
        """Observed components of small target motions, (m, t, 3[, k]) [m], F_b."""
        if not self.six:
            return moved
        middle = self.points - self.points.mean(axis=0)
        levers = np.einsum("mij,tj->mti", here.flange_axes, middle)
        return six.coordinates(levers, moved, six.radius(self.points))

    @property
    def named(self) -> dict[str, Array]:
        """The points by name [m], load_point first."""
        return {"load_point": self.load_point, **dict(zip(self.targets, self.points, strict=True))}


@dataclass(frozen=True, eq=False)
class Cell:
    """A robot with its tool and everything that acts on it.

    Attributes:
        robot: Geometry.
        tool: Load point and reflectors.
        effects: Effects with unknown parameters, in any order.
        equilibrium: `undeformed`: geometry of the unloaded pose, c = B x as in the paper.
            `deformed`: the wrench acts on the deflected robot (second order in the load).
        held: Further effects with known, fixed parameter values; they add no unknowns.
    """

    robot: Robot
    tool: Tool
    effects: tuple[Effect, ...]
    equilibrium: str = "undeformed"
    held: tuple[tuple[Effect, Array], ...] = ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Unknown parameters of all effects, in the order of the effects."""
        return tuple(p for effect in self.effects for p in effect.parameters)

    def with_effects(self, *more: Effect) -> Cell:
        """Copy of this cell with further effects appended."""
        return replace(self, effects=self.effects + more)

    def split(self, values: Array) -> list[tuple[Effect, Array]]:
        """Pair each facet of each effect with its parameters, known effects last."""
        values, parts, end = np.asarray(values, float), [], 0
        for effect in self.effects:
            begin, end = end, end + len(effect.parameters)
            parts += [(facet, values[begin:end]) for facet in effect.facets]
        return parts + [(facet, part) for one, part in self.held for facet in one.facets]


@dataclass(frozen=True, eq=False)
class Prediction(Locked):
    """Response of the cell to the pulls, in F_b as observed by the tracker.

    Attributes:
        unloaded: Positions of the targets before the pull [m], shape (m, t, 3).
        loaded: Positions under load [m], shape (m, t, 3).
        displacement: loaded - unloaded [m], computed without cancellation, shape (m, t, 3); for a
            tool that was measured as one 6-DOF pose its six coordinates, shape (m, 2, 3).
        load_point: Load point under load [m], shape (m, 3).
    """

    unloaded: Array
    loaded: Array
    displacement: Array
    load_point: Array


def baseline(robot: Robot) -> tuple[Elastic, ...]:
    """One linear spring per joint, Eqs. (3), (5): one effect with the parameters x of Eq. (6)."""
    return (
        Elastic(
            name="joint_compliance",
            noun="stiffness of the joint",
            place="joint",
            parameters=tuple(
                Parameter(
                    f"c_{joint.name}", joint.compliance_unit, 1 / joint.typical_stiffness, 0.0
                )
                for joint in robot.joints
            ),
            signature="every joint gives way about its own axis in proportion to its torque",
            needs="poses whose pull turns every joint",
            source="Eqs. (3) to (7)",
            carrier=tuple(range(1, robot.n + 1)),
        ),
    )


def paper_cell(robot: Robot, tool: Tool) -> Cell:
    """The paper's model of a robot: joint springs only."""
    return Cell(robot, tool, baseline(robot))


def load(cell: Cell, pulls: Pulls, values: Array) -> Loaded:
    """Compute the kinematics and the acting wrench: geometry first, then the force chain."""
    acting = [
        (effect, part)
        for effect, part in cell.split(values)
        if isinstance(effect, Geometry | Table | Wrench | Reflectors) and part.any()
    ]
    of = _loaded if len(pulls) <= _FEW else _loaded.__wrapped__
    parts = tuple(part.tobytes() for _, part in acting)
    return of(cell.robot, cell.tool, pulls, _Same(effect for effect, _ in acting), parts)


class _Same(tuple[_E, ...]):
    """Tuple of effects compared by identity, since their contents need not be hashable."""

    __slots__ = ()

    def __hash__(self) -> int:
        return hash(tuple(map(id, self)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and [*map(id, self)] == [*map(id, other)]


@lru_cache(maxsize=256)
def _loaded(
    cell_robot: Robot, tool: Tool, pulls: Pulls, effects: _Same[Effect], values: tuple[bytes, ...]
) -> Loaded:
    """Cached `load`, keyed by all it depends on; derivatives repeat it with unchanged arguments."""
    parts = [
        (effect, np.frombuffer(part).copy()) for effect, part in zip(effects, values, strict=True)
    ]
    robot, q = cell_robot, pulls.q
    for effect, part in parts:
        if isinstance(effect, Geometry):
            q = q + (effect.geometry(cell_robot, pulls, part) - pulls.q)
        elif isinstance(effect, Table):
            robot = effect.true(robot, part)
    configuration = configure(robot, q)
    points = configuration.points(np.vstack([tool.load_point, tool.points]))
    loaded = Loaded(
        pulls=pulls,
        configuration=configuration,
        load_point=_acts_at(configuration, pulls, points[:, 0]),
        force=pulls.force,
        points=points[:, 1:],
        targets=tool.targets,
    )
    for effect, part in parts:
        if isinstance(effect, Wrench):
            load_point, force = effect.wrench(loaded, part)
            loaded = replace(loaded, load_point=load_point, force=force)
        elif isinstance(effect, Reflectors):
            loaded = replace(loaded, points=effect.points(loaded, part))
    return loaded


def _acts_at(configuration: Configuration, pulls: Pulls, load_point: Array) -> Array:
    """Point of application of each force in F_b [m], (m, 3): its own flange point or load_point."""
    own = np.isfinite(pulls.acts_at)
    if not own.any():
        return load_point
    turned = np.einsum("mij,mj->mi", configuration.flange_axes, np.where(own, pulls.acts_at, 0.0))
    return np.where(own, configuration.flange_origin + turned, load_point)


def columns(effect: Elastic, loaded: Loaded) -> Array:
    """Displacement of the targets per unit of each parameter, Eq. (7): J_m (J_l' f).

    Returns:
        Shape (m, t, 3, k).
    """
    return _columns(_Same([effect]), loaded)[0]


def _columns(effects: _Same[Elastic], loaded: Loaded) -> tuple[Array, ...]:
    """`columns` of several elastic effects in one vectorised evaluation."""
    own = [effect.screws(loaded) for effect in effects]
    ends = np.cumsum([twists.shape[1] for twists in own])[:-1]
    twists = np.concatenate(own, axis=1)
    tau = np.split(torque(twists, loaded.load_point, loaded.force), ends, axis=1)
    answers = [effect.response(loaded, one) for effect, one in zip(effects, tau, strict=True)]
    moved = velocity(twists, loaded.points).swapaxes(2, 3)
    moved *= np.concatenate(answers, axis=1)[:, None, None, :]
    moved.flags.writeable = False
    return tuple(
        part @ np.eye(len(effect.parameters))[list(effect.shared)] if effect.shared else part
        for effect, part in zip(effects, np.split(moved, ends, axis=3), strict=True)
    )


_of_springs, _of_suspects = lru_cache(maxsize=256)(_columns), lru_cache(maxsize=4)(_columns)
"""Cached `_columns`; they do not depend on the parameter values at which derivatives are taken."""


def further_work(effect: Elastic, loaded: Loaded) -> Array:
    """Work of a small further part of each load, over that part, per unit of each parameter.

    w_k = sum over the virtual joints v of parameter k of tau_v d r_v((1 + s) tau) / ds at s = 0 [J
    per unit]: that of a linear spring is tau^2. Nothing yields against its load: the sum over all
    that acts at a joint, each times its parameter, is not negative.

    Returns:
        Shape (m, k).
    """
    tau = torque(effect.screws(loaded), loaded.load_point, loaded.force)
    more, less = (effect.response(loaded, (1 + s) * tau) for s in (_SMALL, -_SMALL))
    own = np.eye(len(effect.parameters))[list(effect.parameter_of)]
    return np.asarray((tau * (more - less) / (2 * _SMALL)) @ own)


def predict(cell: Cell, pulls: Pulls, values: Array) -> Prediction:
    """Predict the positions of the targets, unloaded and under load.

    Args:
        cell: The cell.
        pulls: Commanded and measured inputs.
        values: Parameters of all effects, shape (k,), SI.
    """
    loaded = load(cell, pulls, values)
    if cell.equilibrium == "deformed":
        displacement, load_point = _deformed(cell, loaded, values)
    else:
        displacement, load_point = _undeformed(cell, loaded, values)
    before, after = loaded.points, loaded.points + displacement
    for effect, part in cell.split(values):
        if isinstance(effect, Observation):
            seen = effect.observe(loaded, before, pulls.time_zero, part)
            seen_after = effect.observe(loaded, after, pulls.time, part)
            displacement = displacement + (seen_after - after) - (seen - before)
            before, after = seen, seen_after
    return Prediction(before, after, _read(cell, pulls, displacement), load_point)


def _read(cell: Cell, pulls: Pulls, moved: Array) -> Array:
    """Observed components of target motions at the logged joint values, as `Tool.coordinates`."""
    if not cell.tool.six:
        return moved
    return cell.tool.coordinates(configure(cell.robot, pulls.q), moved)


def _elastic(cell: Cell, values: Array) -> list[tuple[Elastic, Array]]:
    return [(e, part) for e, part in cell.split(values) if isinstance(e, Elastic)]


@lru_cache(maxsize=256)
def _with_load_point(loaded: Loaded) -> Loaded:
    """Append the load point to the targets."""
    ends = np.concatenate([loaded.points, loaded.load_point[:, None]], axis=1)
    return replace(loaded, points=ends)


def _undeformed(cell: Cell, loaded: Loaded, values: Array) -> tuple[Array, Array]:
    few = len(loaded.pulls) <= _FEW
    here = (_with_load_point if few else _with_load_point.__wrapped__)(loaded)
    moved = np.zeros_like(here.points)
    acting = [(effect, part) for effect, part in _elastic(cell, values) if part.any()]
    if acting:
        effects, parts = zip(*acting, strict=True)
        found = (_of_springs if few else _columns)(_Same(effects), here)
        for column, part in zip(found, parts, strict=True):
            moved = moved + column @ part
    return moved[:, :-1], loaded.load_point + moved[:, -1]


def _deformed(cell: Cell, loaded: Loaded, values: Array, rounds: int = 30) -> tuple[Array, Array]:
    """Equilibrium of the deflected robot, by products of exponentials of the virtual screws."""
    parts = _elastic(cell, values)
    twists = np.concatenate([effect.screws(loaded) for effect, _ in parts], axis=1)
    order = np.argsort(np.concatenate([effect.carrier for effect, _ in parts]), kind="stable")
    ends = np.cumsum([len(effect.carrier) for effect, _ in parts])[:-1]
    ends_points = np.concatenate([loaded.points, loaded.load_point[:, None]], axis=1)
    bent, at = twists, loaded.load_point
    deflection, before = np.full(twists.shape[:2], np.inf), np.full(len(twists), np.nan)
    still = np.zeros(len(twists), dtype=bool)
    for _ in range(rounds):
        tau = torque(bent, at, loaded.force)
        amount = np.concatenate(
            [
                effect.response(loaded, tau_e) * part[list(effect.parameter_of)]
                for (effect, part), tau_e in zip(parts, np.split(tau, ends, axis=1), strict=True)
            ],
            axis=1,
        ).clip(-_FARTHEST, _FARTHEST)
        change = np.max(np.abs(amount - deflection), axis=1, initial=0.0)
        # a step no smaller than the previous one is rounding, or there is no equilibrium
        still |= (change < 1e-15) | (change >= before)
        deflection, before = amount, change
        bent, R, t = _chain(twists, deflection, order)
        moved = np.einsum("ijm,mtj->mti", R - np.eye(3)[:, :, None], ends_points) + t.T[:, None]
        at = loaded.load_point + moved[:, -1]
        if still.all():
            break
    return moved[:, :-1], at


def _chain(twists: Array, deflection: Array, order: Ints) -> tuple[Array, Array, Array]:
    """Each screw displaced by the deflections of all preceding ones, and the total end motion.

    Its rotation is (3, 3, m), its translation (3, m): poses are contiguous in memory.
    """
    m, n = deflection.shape
    w, v = np.ascontiguousarray(twists.T).reshape(2, 3, n, m)
    turns, shifts = _exponential(w * deflection.T, v * deflection.T)
    moves = np.concatenate([turns, shifts[:, None]], axis=1)
    before, at = np.empty((3, 3, n, m)), np.empty((3, n, m))
    R, t = np.repeat(np.eye(3)[:, :, None], m, axis=2), np.zeros((3, m))
    for k in order:
        before[:, :, k], at[:, k] = R, t
        moved = _turned(R[:, :, None], moves[:, :, k])
        R, t = moved[:, :3], t + moved[:, 3]
    omega = _turned(before, w)
    return np.concatenate([omega, _turned(before, v) + cross(at.T, omega.T).T]).T, R, t


def _turned(R: Array, vectors: Array) -> Array:
    """R v, for rotations (3, 3, ...) and vectors (3, ...)."""
    return R[:, 0] * vectors[0] + R[:, 1] * vectors[1] + R[:, 2] * vectors[2]


def _exponential(w: Array, v: Array) -> tuple[Array, Array]:
    """Rotation (3, 3, n, m) and translation (3, n, m) of screws w, v times their amounts.

    R = cos|w| + a [w] + b w w', t = a v + b w x v + c (w . v) w, by series up to |w|^9: deflections
    are milliradians.
    """
    x = np.sum(w * w, axis=0)
    b = 1 / 2 - x * (1 / 24 - x * (1 / 720 - x / 40320))
    c = 1 / 6 - x * (1 / 120 - x * (1 / 5040 - x / 362880))
    a, near, after = 1 - c * x, [1, 2, 0], [2, 0, 1]
    R = b * w[:, None] * w
    R[range(3), range(3)] += 1 - b * x
    R[after, near] += a * w
    R[near, after] -= a * w
    return R, a * v + b * cross(w.T, v.T).T + c * np.sum(w * v, axis=0) * w


_FARTHEST = 1.0
"""Bound on the deflection of one virtual joint [m] or [rad]; a force that exceeds it has a wrong
unit, and beyond a radian the fixed-point iteration and the series of `_exponential` diverge."""

_SMALL = 1e-4
"""Part of its load by which the slope of a law is found [1]."""

_FEW = 256
"""Maximum number of pulls whose loads and columns are cached, about 50 MB in total."""

_BLOCK = 1024
"""Number of pulls computed at a time, so that their frames fit into the processor's cache."""


def jacobian(cell: Cell, pulls: Pulls, values: Array) -> Array:
    """Derivative of the displacements with respect to the parameters at `values`: B of Eq. (19).

    Exact for elastic effects of an undeformed cell, which are linear in their parameters;
    differences for all others.

    Returns:
        Shape (m, t, 3, k).
    """
    values = np.asarray(values, dtype=float)
    m, t = len(pulls), len(cell.tool.read)
    if m <= _BLOCK:
        return _jacobian(cell, pulls, values)
    B = np.empty((m, t, 3, len(values)))
    for start in range(0, m, _BLOCK):
        part = slice(start, start + _BLOCK)
        B[part] = _jacobian(cell, pulls.part(part), values)
    return B


def _jacobian(cell: Cell, pulls: Pulls, values: Array) -> Array:
    loaded = load(cell, pulls, values)
    firsts = np.cumsum([0, *(len(effect.parameters) for effect in cell.effects)]).tolist()
    parts = tuple(zip(cell.effects, firsts[:-1], strict=True))
    linear = _linear(cell, cell.effects, loaded)
    return np.concatenate(
        [
            linear[i] if i in linear else _derivative(cell, *part, loaded, values)
            for i, part in enumerate(parts)
        ],
        axis=-1,
    )


def sensitivity(cell: Cell, pulls: Pulls, values: Array, effects: Sequence[Effect]) -> Array:
    """Derivative of the displacements with respect to additional effects, at zero magnitude.

    Args:
        cell: The model without these effects.
        pulls: Commanded and measured inputs.
        values: Parameters of the cell, shape (k,).
        effects: The additional effects, with K parameters in total; noise effects have zero
            columns.

    Returns:
        Shape (m, t, 3, K), zero in the columns of effects that displace nothing.
    """
    loaded = load(cell, pulls, values)
    linear = _linear(cell, effects, loaded)
    out = []
    for i, effect in enumerate(effects):
        more = np.append(values, np.zeros(len(effect.parameters)))
        out.append(
            linear[i]
            if i in linear
            else _derivative(cell.with_effects(effect), effect, len(values), loaded, more)
        )
    return np.concatenate(out, axis=-1)


def seated_elsewhere(
    cell: Cell, pulls: Pulls, values: Array, effect: Elastic, part: Array, by: float
) -> Array:
    """Change of the displacements if an elastic element sat elsewhere on what carries it.

    Its screws are turned by the angle `by` about each axis of its carrier's frame, and shifted
    along each by the same fraction of the lever from which they move the targets (rms).

    Args:
        cell: The cell.
        pulls: Commanded and measured inputs.
        values: Parameters of the cell, shape (k,).
        effect: The element, with screws of its own.
        part: Its parameters, shape (j,).
        by: Angle [rad], and fraction of the lever [1].

    Returns:
        Shape (m, t, 3, 6): three turns, then three shifts [m].
    """
    loaded = load(cell, pulls, values)
    screws, here = effect.screws(loaded), _columns(_Same([effect]), loaded)[0] @ part
    moved = velocity(screws, loaded.points)[:, :, screws[:, :, :3].any(axis=(0, 2))]
    lever = float(np.sqrt(np.mean(np.sum(moved**2, axis=-1)))) if moved.size else 0.0
    out = []
    for motion in _motions(loaded, effect.carrier[0]):
        size = by if motion[:, :3].any() else by * lever
        there = replace(effect, twists=partial(_moved_by, effect, size * motion))
        out.append(_read(cell, pulls, _columns(_Same([there]), loaded)[0] @ part - here))
    return np.stack(out, axis=-1)


def _motions(loaded: Loaded, joint: int) -> tuple[Array, ...]:
    """Turns about, then shifts along the axes of a joint's frame, those of F_b for 0, (m, 6)."""
    axes, origin = np.eye(3)[None], np.zeros((1, 3))
    if joint:
        axes, origin = loaded.configuration.frame(joint)
    return rigid_motions(origin, axes)


def _moved_by(effect: Elastic, motion: Array, loaded: Loaded) -> Array:
    """Screws of an element that a small motion (m, 6) carries along, to first order, (m, v, 6)."""
    screws, turn = effect.screws(loaded), motion[:, None, :3]
    omega = cross(turn, screws[:, :, :3])
    shift = cross(turn, screws[:, :, 3:]) + cross(motion[:, None, 3:], screws[:, :, :3])
    return screws + np.concatenate([omega, shift], axis=2)


def _linear(cell: Cell, effects: Sequence[Effect], loaded: Loaded) -> dict[int, Array]:
    """Exact derivatives for the elastic effects, by index; empty for a deformed cell."""
    if cell.equilibrium != "undeformed":
        return {}
    elastic = {i: effect for i, effect in enumerate(effects) if isinstance(effect, Elastic)}
    if not elastic:
        return {}
    of = _of_suspects if len(loaded.pulls) <= _FEW else _columns
    found = of(_Same(elastic.values()), loaded)
    return {i: _read(cell, loaded.pulls, one) for i, one in zip(elastic, found, strict=True)}


def _derivative(cell: Cell, effect: Effect, first: int, loaded: Loaded, values: Array) -> Array:
    """Derivative with respect to the parameters of one effect, from index `first` on.

    f' = (8 (f(h) - f(-h)) - (f(2 h) - f(-2 h))) / 12 h with an error of h^4 f'''''/30. With steps h
    of an eighth of the typical size that is below the rank limit of `linear`, and so is rounding,
    which with the small steps of f' = (f(h) - f(-h)) / 2 h is a direction of its own.
    """
    if isinstance(effect, Noise):
        return np.zeros((len(loaded.pulls), len(cell.tool.read), 3, len(effect.parameters)))
    out = []
    for k, parameter in enumerate(effect.parameters, first):
        one = np.zeros_like(values)
        one[k] = parameter.typical / 8
        far, ahead, behind, back = (
            predict(cell, loaded.pulls, values + steps * one).displacement
            for steps in (2, 1, -1, -2)
        )
        out.append((8 * (ahead - behind) - (far - back)) / (12 * one[k]))
    return np.stack(out, axis=-1)
