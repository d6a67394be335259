"""Clearance conditions of a pose: beams, chain, self-collision and floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pipeline.answer.contract import CellLimits
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.errors import listed
from pipeline.machine.cell import Tool
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.capsules import Capsules
from pipeline.machine.robot.configuration import torque, velocity
from pipeline.machine.surroundings import Surrounded, turns

_SEAT_M = 0.01905
"""Height of the centre of a 1.5 inch reflector above its mounting surface [m]: a point no further
than this from a hull of the flange is mounted on it."""
_STILL = 1e-9
"""Rate of lift per metre or radian [m] below which a joint does not lift a body."""
_AXIS_M = 1e-6
"""Distance from the axis of a capsule below which a point has no outward direction [m]."""


@dataclass(frozen=True, eq=False)
class _Cone(Locked):
    """Directions from which a point of the effector can be reached.

    Attributes:
        rule: The condition, in words.
        point: 0 for the load point, whose line is the chain; k for the k-th reflector.
        axis: Unit vector, flange frame, shape (3,).
        half_angle: Half angle of the cone [rad].
    """

    rule: str
    point: int
    axis: Array
    half_angle: float


@dataclass(frozen=True, eq=False)
class Room(Locked):
    """Clearance conditions of a pose.

    Attributes:
        joints: Number of joints; the last one carries flange and effector.
        lower: Lower joint limits [m] or [rad], reduced by cables and hoses, shape (n,).
        upper: Upper limits, likewise, shape (n,).
        tracker: Origin of the beams in F_b [m], shape (3,), None if not given.
        floor: Height of the floor in F_b [m], None if not given.
        cones: Directions from which reflectors and load point can be reached.
        bodies: Capsules of robot and effector.
        pairs: Capsules that must not touch each other, the shorter one first, shape (2, p).
        crossed: Capsules that the line of each point (as in `_Cone`) must not cross, (1 + t, c).
        lifted: Capsules that some joint lifts, shape (c,): the others stand on the floor.
    """

    ITSELF: ClassVar[str] = "the arm clear of itself"
    BEAM: ClassVar[str] = "the beams clear of the arm"
    CHAIN: ClassVar[str] = "the chain clear of the arm"
    FLOOR: ClassVar[str] = "arm and effector above the floor"

    joints: int
    lower: Array
    upper: Array
    tracker: Array | None
    floor: float | None
    cones: tuple[_Cone, ...]
    bodies: Capsules
    pairs: Ints
    crossed: Bools
    lifted: Bools

    def only(self, rule: str) -> Room:
        """The room with one rule alone."""
        none = np.zeros((2, 0), dtype=np.int64)
        return replace(
            self,
            cones=tuple(one for one in self.cones if one.rule == rule),
            floor=self.floor if rule == self.FLOOR else None,
            pairs=self.pairs if rule == self.ITSELF else none,
            crossed=self.crossed & ([[_line(k) == rule] for k in range(len(self.crossed))]),
        )

    @property
    def rules(self) -> tuple[str, ...]:
        """The conditions, in words."""
        ground = [self.FLOOR] * (self.floor is not None)
        itself = [self.ITSELF] * bool(self.pairs.size)
        every = [
            *(one.rule for one in self.cones),
            *map(_line, np.flatnonzero(self.crossed.any(axis=1)).tolist()),
            *itself,
            *ground,
        ]
        return tuple(dict.fromkeys(every))

    def kept(self, robot: Robot) -> tuple[str, ...]:
        """All conditions in words, including joint limits reduced by cables."""
        turned = [
            f"{joint.name} within {np.rad2deg(low):g} to {np.rad2deg(high):g} deg"
            for joint, low, high in zip(robot.joints, self.lower, self.upper, strict=True)
            if low > joint.lower or high < joint.upper
        ]
        return (*self.rules, *turned)


def _line(point: int) -> str:
    """Rule for the line of a point: the chain, or a beam."""
    return Room.BEAM if point else Room.CHAIN


def room_of(
    robot: Robot, points: Mapping[str, Array], stated: Surrounded, hardest_n: float
) -> Room | None:
    """Clearance conditions of the cell in a file; None if the file has no `[cell]`.

    Args:
        robot: The robot.
        points: load_point, then the reflectors, flange frame [m].
        stated: Statements of the file about cell and effector.
        hardest_n: Largest pull [N]: a reflector must be visible unloaded and loaded, so that its
            acceptance is narrowed by the rotation of the beam relative to the flange under this
            pull.

    Raises:
        InputError: `[cell]` limits a joint that the robot does not have.
    """
    if stated.cell is None:
        return None
    lower, upper = turns(robot, stated)
    tool, at = np.array(list(points.values()), dtype=float), stated.cell.tracker_m
    tracker = None if at is None else np.array(at)
    bodies = together(robot.capsules, _effector(robot, stated))
    outward, crossed = _reached(robot, tool, bodies, tracker is not None)
    turned = 0.0 if tracker is None else _turned_by(robot, tool, lower, upper, hardest_n, tracker)
    shot = [] if tracker is None else accepted(points, stated)
    cones = [replace(one, half_angle=max(one.half_angle - turned, 0.0)) for one in shot]
    return Room(
        joints=robot.n,
        lower=lower,
        upper=upper,
        tracker=tracker,
        floor=stated.cell.floor_z_m,
        cones=(*cones, *outward),
        bodies=bodies,
        pairs=_pairs(robot, bodies)[0],
        crossed=crossed,
        lifted=_lifted(robot, bodies),
    )


def cell_limits(robot: Robot, tool: Tool, stated: Surrounded) -> CellLimits | None:
    """Conditions that proposed poses are checked for; None if the file has no `[cell]`."""
    room = room_of(robot, tool.named, stated, 0.0)
    if room is None:
        return None
    return CellLimits(
        kept=room.kept(robot),
        not_checked=unchecked(robot, tool.targets.tolist(), stated),
        capsules=robot.capsules.source or None,
    )


def unchecked(robot: Robot, targets: Sequence[str], stated: Surrounded) -> tuple[str, ...]:
    """Conditions that are not checked for lack of input, in words."""
    if stated.cell is None:
        return ("beams, collisions, floor and cables: there is no [cell]",)
    cell, out = stated.cell, list[str]()
    if cell.tracker_m is None:
        out.append("beams: [cell] has no tracker_m")
    elif lacking := [name for name in targets if name not in stated.tool_acceptance]:
        out.append(f"from where {listed(lacking)} can be shot: not in [tool.acceptance]")
    if not len(robot.capsules):
        out.append("collisions of the arm, its beams and its chain: the robot has no [[capsules]]")
    if not stated.tool_capsules:
        out.append("the body of the effector: there are no [[tool.capsules]]")
    if cell.floor_z_m is None:
        out.append("the floor: [cell] has no floor_z_m")
    if not cell.max_turn_deg:
        out.append("cables and hoses: [cell] has no max_turn_deg")
    touching = _pairs(robot, together(robot.capsules, _effector(robot, stated)))[1]
    out += [
        f"{one} against {other}: at the zero of all joints they touch" for one, other in touching
    ]
    return tuple(out)


def accepted(points: Mapping[str, Array], stated: Surrounded) -> list[_Cone]:
    """Stated acceptance cone of each reflector; `points` as in `room_of`."""
    names = list(points)
    return [
        _Cone(
            f"the beam within the acceptance of {name}",
            names.index(name),
            np.array(one.direction) / np.linalg.norm(one.direction),
            float(np.deg2rad(one.half_angle_deg)),
        )
        for name, one in stated.tool_acceptance.items()
    ]


def _turned_by(
    robot: Robot, tool: Array, lower: Array, upper: Array, force_n: float, tracker: Array
) -> float:
    """Largest rotation of a beam relative to the flange between unloaded and loaded [rad].

    With nominal stiffnesses, |sum_j c_j tau_j omega_j| + |sum_j c_j tau_j J_j| / L, Eqs. (4) to
    (7): the flange rotates, and the reflector moves across its beam of length L. Evaluated in a
    thousand random poses with random directions of the pull.

    Args:
        robot: The robot.
        tool: Load point, then reflectors, flange frame [m], shape (1 + t, 3).
        lower: Lower joint limits [m] or [rad], shape (n,).
        upper: Upper joint limits, shape (n,).
        force_n: Magnitude of the pull at the load point [N].
        tracker: Position in F_b [m], shape (3,).
    """
    rng, at = np.random.default_rng(0), _anywhere(robot, lower, upper, 1000)
    pull = rng.normal(size=(1000, 3))
    pull *= force_n / np.linalg.norm(pull, axis=1, keepdims=True)
    points = at.points(tool)
    amount = robot.nominal_compliance * torque(at.twists, points[:, 0], pull)
    tilt = np.linalg.norm(np.einsum("mn,mni->mi", amount, at.twists[..., :3]), axis=-1)
    moved = np.einsum("mn,mtni->mti", amount, velocity(at.twists, points[:, 1:]))
    reach = np.linalg.norm(points[:, 1:] - tracker, axis=-1)
    return float((tilt[:, None] + np.linalg.norm(moved, axis=-1) / reach).max(initial=0.0))


def _anywhere(robot: Robot, lower: Array, upper: Array, count: int) -> Configuration:
    """Random poses; joints without limits stay within half a turn or a metre of zero."""
    rng = np.random.default_rng(0)
    lower = np.where(np.isfinite(lower), lower, np.where(robot.prismatic, -1.0, -np.pi))
    upper = np.where(np.isfinite(upper), upper, np.where(robot.prismatic, 1.0, np.pi))
    return configure(robot, rng.uniform(lower, upper, (count, robot.n)))


def together(bodies: Capsules, others: Capsules) -> Capsules:
    """Capsules followed by others."""
    return Capsules(
        np.concatenate([bodies.carrier, others.carrier]),
        np.concatenate([bodies.ends, others.ends], axis=1),
        np.concatenate([bodies.radius, others.radius]),
        bodies.source,
    )


def _effector(robot: Robot, stated: Surrounded) -> Capsules:
    """Bodies of the effector, in the frame of the last joint."""
    ends = [[(one.start, one.end)[k] for one in stated.tool_capsules] for k in range(2)]
    at = np.array(ends, dtype=float).reshape(2, -1, 3)
    return Capsules(
        np.full(at.shape[1], robot.n),
        at @ robot.flange[:3, :3].T + robot.flange[:3, 3],
        np.array([one.radius for one in stated.tool_capsules], dtype=float),
    )


def _reached(robot: Robot, tool: Array, bodies: Capsules, seen: bool) -> tuple[list[_Cone], Bools]:
    """Directions and capsules that restrict the line from each point of the effector.

    A point that sits in or on capsules of its own link is restricted to leave them outwards, into
    the half space beyond the point, where the distance only grows. Its line must not cross any of
    the other capsules.
    """
    cones, crossed = list[_Cone](), np.zeros((len(tool), len(bodies)), dtype=bool)
    flange = robot.flange
    at = tool @ flange[:3, :3].T + flange[:3, 3]
    for point in range(len(tool) if seen else 1):
        for body, carrier in enumerate(bodies.carrier):
            a, b = bodies.ends[:, body, :, None]
            p = at[point][:, None]
            off = (p - a - _nearest(a, b, p) * (b - a))[:, 0]
            far = float(np.linalg.norm(off))
            if carrier != robot.n or far > bodies.radius[body] + _SEAT_M:
                crossed[point, body] = True
            elif far > _AXIS_M:
                cones.append(_Cone(_line(point), point, flange[:3, :3].T @ off / far, np.pi / 2))
    return cones, crossed


def _pairs(robot: Robot, bodies: Capsules) -> tuple[Ints, list[tuple[str, str]]]:
    """Capsules that must not touch, (2, p), and pairs of links that cannot be checked.

    Left out are capsules of the same link, of adjacent links among those that have capsules, and
    pairs that touch with every joint at zero, or at the limit nearest to it.
    """
    at = configure(robot, np.clip(np.zeros(robot.n), robot.lower, robot.upper)[None])
    order = np.unique(bodies.carrier, return_inverse=True)[1]
    i, j = np.triu_indices(len(bodies), 1)
    i, j = (one[np.abs(order[i] - order[j]) > 1] for one in (i, j))
    ends = at.placed(bodies)[..., 0]
    a, b, c, d = ends[0][:, i], ends[1][:, i], ends[0][:, j], ends[1][:, j]
    s, t = closest(a, b, c, d)
    distance = length(a + s * (b - a) - c - t * (d - c))
    touch = distance <= bodies.radius[i] + bodies.radius[j]
    names = ["base", *(joint.name for joint in robot.joints)]
    carrier = bodies.carrier.tolist()
    left = {(names[carrier[k]], names[carrier[m]]) for k, m in zip(i[touch], j[touch], strict=True)}
    i, j = i[~touch], j[~touch]
    longer = bodies.half[i] > bodies.half[j]
    return np.array([np.where(longer, j, i), np.where(longer, i, j)]), sorted(left)


def _lifted(robot: Robot, bodies: Capsules) -> Bools:
    """Capsules whose height some joint changes, tested in 64 poses, shape (c,)."""
    at = _anywhere(robot, robot.lower, robot.upper, 64)
    ends = np.moveaxis(at.placed(bodies), (0, 1, 2, 3), (1, 3, 2, 0))  # pose, end, capsule, xyz
    lift = np.abs(velocity(at.twists, ends.reshape(64, -1, 3))[..., 2])
    carried = np.arange(robot.n) < np.tile(bodies.carrier, 2)[:, None]
    return (lift.max(axis=0) * carried).max(axis=1).reshape(2, -1).max(axis=0) > _STILL


_POINT_M2 = 1e-18
"""Squared length [m^2] up to which a segment, shorter than a nanometre, is treated as a point."""
_PARALLEL = 1e-14
"""Squared sine of the angle [1] below which segments count as parallel, as rounding would
dominate."""


def closest(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Positions along the segments ab and cd at which they are closest, as fractions.

    Arrays have x, y, z on the first axis and the pairs on the last, so that numpy works on long
    rows.

    For unconstrained fractions s = (uv vw - vv uw) / (uu vv - uv^2) with u = b - a, v = d - c and
    w = a - c; then each is clamped to its segment and the other one follows (Ericson, Real-Time
    Collision Detection, 2005, 5.1.9).

    Args:
        a: Start points of the first segments [m], shape (3, k).
        b: Their end points.
        c: Start points of the second segments.
        d: Their end points.

    Returns:
        Fraction along ab and fraction along cd, 0 to 1, shape (k,) each.
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = dot(u, u), dot(v, v), dot(u, v)
    uw, vw = dot(u, w), dot(v, w)
    skew = uu * vv - uv * uv
    apart = skew > _PARALLEL * uu * vv
    s = np.where(apart, (uv * vw - vv * uw) / np.where(apart, skew, 1.0), 0.0)
    t = _held(np.clip(s, 0, 1) * uv + vw, vv)
    s = _held(t * uv - uw, uu)
    return s, _held(s * uv + vw, vv)


def _nearest(a: Array, b: Array, p: Array) -> Array:
    """Fraction along the segment ab closest to the point p, all (3, k); shape (k,)."""
    u = b - a
    return _held(dot(u, p - a), dot(u, u))


def length(v: Array) -> Array:
    """Norms of vectors (3, ...), shape (...)."""
    return np.asarray(np.sqrt(dot(v, v)))


def dot(a: Array, b: Array) -> Array:
    """Scalar products of vectors (3, ...), shape (...)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _held(part: Array, whole: Array) -> Array:
    """Part / whole, clamped to 0 to 1; 0 for a segment that is a point."""
    there = whole > _POINT_M2
    return np.where(there, np.clip(part / np.where(there, whole, 1.0), 0, 1), 0.0)
