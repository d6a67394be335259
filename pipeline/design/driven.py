"""Check whether a plan can be driven: motions between poses against arm, floor, chain and beams.

Joints move together in a straight line, as in joint motions of controllers. Arm and floor are
checked along the whole way: an interval is halved until the gaps at its ends exceed the motion of
any point of the arm in it,

    g_a + g_b >= sum_j |dq_j| L_j,

with L_j the length of the arm for a revolute joint, 1 for a prismatic one. The chain is slack
meanwhile and the tracker follows: a way on which both lines stay free is preferred to a shorter one
that crosses them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.design.arm import arm_alone
from pipeline.design.gaps import gaps
from pipeline.design.problem import Problem
from pipeline.design.room import Room
from pipeline.machine.robot import Robot, configure

_STEP_RAD, _STEP_M = np.deg2rad(1.0), 0.02
"""Step at which lines are checked, and initial step of the halving [rad], [m]."""
_FINEST_M = 1e-3
"""Motion within an interval below which it is not halved again [m]: hulls are good to 50 mm."""
_MOST = 20_000
"""Maximum number of points of one way [1]: a way with more creeps along an obstacle."""
_DRAWN, _NODES, _ROOM_M = 2000, 250, 0.01
"""Number of random points, maximum number of these that are kept as nodes of ways round, and the
clearance required of them [m]."""
_NEAREST, _LOOKS = 25, 150
"""Number of neighbours of each node, and maximum number of attempts to find a way through them."""
_ORDERS = 4
"""Maximum number of times that the order is changed to avoid blocked ways."""
_RAIL_M_S, _JOINT_RAD_S = 1.0, np.deg2rad(90.0)
"""Speeds of rail [m/s] and joints [rad/s] for ordering the poses: only their ratio matters, and
carriages of 18 m and arms of 200 kg have about these."""


@dataclass(frozen=True, eq=False)
class _Leg(Locked):
    """The way to a pose from the previous one.

    Attributes:
        pose: Number of the pose it leads to, from 1.
        via: Joint values [m] or [rad] of points on the way, shape (k, n).
        blocked: Rule that is violated on the way, in words; None where none is.
        crossed: Line, chain or beam, that is not free all the way; None where both are.
    """

    pose: int
    via: Array
    blocked: str | None = None
    crossed: str | None = None

    @property
    def sentence(self) -> str:
        """Reason why the way cannot be driven."""
        return (
            f"from pose {self.pose - 1} to pose {self.pose} the arm does not keep "
            f"{self.blocked}, neither straight nor by way of other poses that are free"
        )


def legs(problem: Problem, q: Array, anchor: Array) -> list[_Leg]:
    """The ways between consecutive poses, straight where that is free.

    Args:
        problem: Robot, cell and effector.
        q: Joint values of the poses [m] or [rad], shape (m, n).
        anchor: Of the chain, F_b [m], shape (3,).
    """
    road, lines = _Roadmap.of(problem, _arm(problem)), _lines(problem)
    return [_leg(road, lines, anchor, k, q[k - 1], q[k]) for k in range(1, len(q))]


def pose_violations(problem: Problem, q: Array) -> list[str]:
    """Violations of arm and floor at the poses themselves, in sentences.

    Args:
        problem: Robot, cell and effector.
        q: Joint values [m] or [rad], shape (m, n).
    """
    room = _arm(problem)
    found = ((k, _broken(problem, room, one[None])) for k, one in enumerate(q, 1))
    return [f"pose {k} does not keep {rule}" for k, rule in found if rule is not None]


def unwound(problem: Problem, q: Array) -> Array:
    """The same poses, joints of more than one turn moved to the turn of the others, (m, n).

    An arm on a floor cannot wind its shoulder from one turn to the next.

    Args:
        problem: Robot and limits.
        q: Joint values of the poses [m] or [rad], shape (m, n).
    """
    out = q.copy()
    for j in np.flatnonzero(~problem.robot.prismatic):
        mean = float(np.angle(np.exp(1j * q[:, j]).mean()))
        turns = q[:, j, None] + 2 * np.pi * np.arange(-2, 3)
        away = np.abs(turns - mean)
        away[(turns < problem.lower[j]) | (turns > problem.upper[j])] = np.inf
        near = turns[np.arange(len(q)), away.argmin(axis=1)]
        out[:, j] = np.where(np.isfinite(away.min(axis=1)), near, q[:, j])
    return problem.as_printed(out)


def in_order(problem: Problem, q: Array, anchor: Array) -> Ints:
    """Order of the poses for the shortest driving time, with every way free if possible.

    The time of a way is that of its slowest joint. Nearest neighbour, then reversal of sections as
    long as that gains; blocked ways are excluded, and the order is found again.

    Args:
        problem: Robot, cell and effector.
        q: Joint values of the poses [m] or [rad], shape (m, n).
        anchor: Of the chain, F_b [m], shape (3,).
    """
    cost = _times(problem, q)
    order = np.arange(len(q)) if problem.robot.prismatic.any() else _shortest(cost)  # along a rail
    road, lines = _Roadmap.of(problem, _arm(problem)), _lines(problem)
    free: dict[tuple[int, int], bool] = {}
    for _ in range(_ORDERS * bool(problem.spec.limits.clear_of_itself)):
        for a, b in pairwise(order.tolist()):
            if (a, b) not in free:
                free[a, b] = _leg(road, lines, anchor, b, q[a], q[b]).blocked is None
                free[b, a] = free[a, b]
        wrong = [pair for pair in pairwise(order.tolist()) if not free[pair]]
        if not wrong:
            break
        for a, b in wrong:
            cost[a, b] = cost[b, a] = 1e6
        order = _shortest(cost)
    return order


def _lines(problem: Problem) -> Room:
    """Lines that a way should not cross: chain and beams."""
    return problem.room or arm_alone(problem.robot, problem.tool, problem.spec)


def _times(problem: Problem, q: Array) -> Array:
    """Time of the slowest joint from each pose to each other [s], shape (m, m)."""
    speed = np.where(problem.robot.prismatic, _RAIL_M_S, _JOINT_RAD_S)
    return np.asarray(np.abs((q[:, None] - q[None]) / speed).max(axis=-1))


def _shortest(cost: Array) -> Ints:
    """An open tour through all places of a symmetric cost matrix (m, m)."""
    best = min((_turned(_nearest(cost, k), cost) for k in range(len(cost))),
               key=lambda way: _length(way, cost))  # fmt: skip
    return np.array(best, dtype=np.int64)


def _nearest(cost: Array, first: int) -> list[int]:
    way, left = [first], {*range(len(cost))} - {first}
    while left:
        way.append(min(left, key=lambda k: (cost[way[-1], k], k)))
        left.remove(way[-1])
    return way


def _turned(way: list[int], cost: Array) -> list[int]:
    """The tour with sections reversed, as long as it gets shorter."""
    better = True
    while better:
        better = False
        for a in range(len(way)):
            for b in range(a + 2, len(way) + 1):
                tried = way[:a] + way[a:b][::-1] + way[b:]
                if _length(tried, cost) < _length(way, cost) - 1e-9:
                    way, better = tried, True
    return way


def _length(way: Sequence[int], cost: Array) -> float:
    return float(sum(cost[a, b] for a, b in pairwise(way)))


def _arm(problem: Problem) -> Room:
    """The arm and the floor: what a motion must not touch."""
    room = arm_alone(problem.robot, problem.tool, problem.spec)
    return replace(room, cones=(), crossed=np.zeros_like(room.crossed))


def _leg(road: _Roadmap, lines: Room, anchor: Array, k: int, start: Array, end: Array) -> _Leg:
    """The first way on which everything is free, else the first that is free of arm and floor."""
    problem = road.problem
    blocked, left = _met(problem, road.arm, start, end), None
    for via in _ways(road, start, end, blocked is None):
        points = [start, *via, end]
        every = np.concatenate([_between(problem.robot, a, b) for a, b in pairwise(points)])
        crossed = _broken(problem, lines, every, anchor)
        if crossed is None:
            return _Leg(k + 1, via)
        left = left or _Leg(k + 1, via, crossed=crossed)
    return left or _Leg(k + 1, np.zeros((0, len(start))), blocked)


def _ways(road: _Roadmap, start: Array, end: Array, straight: bool) -> Iterator[Array]:
    """Points on ways free of arm and floor, (k, n) each: straight, by the middle, by free nodes."""
    if straight:
        yield np.zeros((0, len(start)))
    middle, slides = road.nodes[0], road.problem.robot.prismatic
    held = np.arange(len(middle)) <= np.flatnonzero(~slides)[0]  # the arm turns folded
    folded = np.stack([np.where(held, start, middle), np.where(held, end, middle)])
    ways = pairwise([start, *folded, end])
    if all(_met(road.problem, road.arm, a, b) is None for a, b in ways):
        yield folded
    if not straight and (found := road.way(start, end)) is not None:
        yield found


@dataclass(eq=False)
class _Roadmap:
    """Random free poses and the ways between them, checked only where a way would lead.

    Bohlin and Kavraki, Path planning using lazy PRM, ICRA 2000.

    Attributes:
        problem: The problem whose arm drives.
        arm: What it must not touch.
        nodes: The middle of the joint ranges, then free poses, shape (k, n).
        known: Whether the straight way between two of them is free, where checked.
    """

    problem: Problem
    arm: Room
    nodes: Array
    known: dict[tuple[int, int], bool]

    @classmethod
    def of(cls, problem: Problem, arm: Room) -> _Roadmap:
        """Draw poses within the limits that leave enough clearance."""
        size = (_DRAWN, len(problem.lower))
        drawn = np.random.default_rng(0).uniform(problem.lower, problem.upper, size)
        free = _widths(problem, arm, drawn, _ROOM_M) >= _ROOM_M
        middle = (problem.lower + problem.upper)[None] / 2
        return cls(problem, arm, np.vstack([middle, drawn[free][:_NODES]]), {})

    def way(self, start: Array, end: Array) -> Array | None:
        """Points on the shortest free way, (k, n); None where none was found."""
        nodes, first = np.vstack([self.nodes, start, end]), len(self.nodes)
        cost = _times(self.problem, nodes)
        beyond = np.sort(cost, axis=1)[:, min(_NEAREST, len(cost) - 1), None]
        cost = np.where((cost <= beyond) | (cost <= beyond).T, cost, np.inf)
        own = dict(self.known)  # knowledge about start and end holds for this way alone
        for (a, b), free in own.items():
            if not free:
                cost[a, b] = cost[b, a] = np.inf
        for _ in range(_LOOKS):
            found = _path(cost, first, first + 1)
            if found is None:
                return None
            unknown = [k for k in map(_edge, found[:-1], found[1:]) if k not in own]
            for a, b in unknown:
                free = _met(self.problem, self.arm, nodes[a], nodes[b]) is None
                own[a, b] = free
                if max(a, b) < first:
                    self.known[a, b] = free
                if not free:
                    cost[a, b] = cost[b, a] = np.inf
                    break
            else:
                return nodes[found[1:-1]]
        return None


def _edge(a: int, b: int) -> tuple[int, int]:
    return min(a, b), max(a, b)


def _path(cost: Array, first: int, last: int) -> list[int] | None:
    """The cheapest path from one node to another (Dijkstra); None where there is none."""
    far, before = np.full(len(cost), np.inf), np.full(len(cost), -1)
    far[first], left = 0.0, np.ones(len(cost), dtype=bool)
    while left.any():
        here = int(np.argmin(np.where(left, far, np.inf)))
        if not left[here] or not np.isfinite(far[here]):
            return None
        if here == last:
            break
        left[here] = False
        better = left & (far[here] + cost[here] < far)
        far[better], before[better] = (far[here] + cost[here])[better], here
    found = [last]
    while found[-1] != first:
        found.append(int(before[found[-1]]))
    return found[::-1]


def _between(robot: Robot, start: Array, end: Array) -> Array:
    """Joint values on the straight way between two poses, both ends included, shape (s, n)."""
    step = np.where(robot.prismatic, _STEP_M, _STEP_RAD)
    count = int(np.ceil(np.max(np.abs(end - start) / step, initial=1.0)))
    return np.asarray(start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start))


def _met(problem: Problem, room: Room, start: Array, end: Array) -> str | None:
    """The rule that is violated on the straight way, by halving; None where none is."""
    share = np.linspace(0.0, 1.0, len(_between(problem.robot, start, end)))
    far = float(np.abs(end - start) @ _lever(problem))
    near = far * float(share[1]) + _FINEST_M
    wide = _widths(problem, room, start + share[:, None] * (end - start), near)
    while len(share) < _MOST:
        if wide.min() < 0:
            at = start + share[int(np.argmin(wide))] * (end - start)
            return _broken(problem, room, at[None]) or Room.ITSELF
        open_ = (np.diff(share) * far > wide[:-1] + wide[1:]) & (np.diff(share) * far > _FINEST_M)
        if not open_.any():
            return None
        new = (share[:-1] + share[1:])[open_] / 2
        more = _widths(problem, room, start + new[:, None] * (end - start), near)
        share, wide = np.append(share, new), np.append(wide, more)
        order = np.argsort(share)
        share, wide = share[order], wide[order]
    return Room.ITSELF


def _lever(problem: Problem) -> Array:
    """Maximum motion of any point of arm or effector per metre or radian of a joint, (n,)."""
    robot = problem.robot
    at = configure(robot, ((problem.lower + problem.upper) / 2)[None])
    turns = ~robot.prismatic
    links = np.diff(np.concatenate([at.origin[0][turns], at.flange_origin]), axis=0)
    tool = np.vstack([problem.tool.load_point[None], problem.tool.points])
    reach = np.linalg.norm(links, axis=1).sum() + np.linalg.norm(tool, axis=1).max()
    return np.where(robot.prismatic, 1.0, reach)


def _widths(problem: Problem, room: Room, q: Array, near: float) -> Array:
    """Width of the narrowest gap at joint values (m, n) [m], at most `near`, shape (m,)."""
    at = configure(problem.robot, q)
    places = _places(problem, q)
    out = np.full(len(q), near)
    for found in gaps(room, at, places, places[0], near):
        np.minimum.at(out, found.pose, found.value)
    return out


def _places(problem: Problem, q: Array) -> Array:
    """Load point and reflectors in F_b [m], shape (1 + t, 3, m)."""
    tool = np.vstack([problem.tool.load_point[None], problem.tool.points])
    return np.moveaxis(configure(problem.robot, q).points(tool), 0, -1)


def _broken(problem: Problem, room: Room, q: Array, anchor: Array | None = None) -> str | None:
    """The first rule that some of these joint values (m, n) violate; None where all keep all."""
    at, places = configure(problem.robot, q), _places(problem, q)
    end = places[0] if anchor is None else np.broadcast_to(anchor[:, None], places[0].shape)
    for rule in room.rules:
        found = gaps(room.only(rule), at, places, end, 0.0)
        if any(len(one.pose) for one in found):
            return rule
    return None
