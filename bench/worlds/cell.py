"""One game's measurement: a machine, the station of the tracker, and the time of each reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.league.hidden_effect import Course, Secret, Setup, setup
from bench.league.play import CHAIN, NAMES, Moves, Plan, Rules, drawn, pull_to, strained
from bench.worlds.payloads import (
    GRAVITY,
    Carrying,
    Log,
    Payload,
    drawn_center,
    mounted,
    read_torques,
    rows_of,
)
from pipeline.base.arrays import Array, Ints
from pipeline.design.poses import default_anchors, draw_poses
from pipeline.machine.robot import Robot

REFLECTORS = np.array(
    [
        (0.6, -0.5, -0.30),
        (0.6, 18.5, -0.30),
        (-0.6, 18.5, -0.28),
        (-0.6, -0.5, -0.28),
        (1.4, 9.0, 0.35),
    ]
)
"""Positions of the base reflectors, F_b [m]; the first three to five are used."""

READING_S = (10.0, 25.0)
"""Time from one reading to the next [s]: the operator carries the reflector or turns the
tracker."""
TIGHTEN_S = (30.0, 60.0)
"""Time to the next load step [s]."""
MOUNT_S = (240.0, 600.0)
"""Time to the next payload [s]: a crane, and the bolts of the flange."""
MOVE_S = (60.0, 150.0)
"""Time to the next pose [s]: drive, hook the chain in, wait."""
ROUND_POSES = (3, 7)
"""Number of poses between two rounds of the base reflectors, drawn once per campaign."""


@dataclass(frozen=True)
class Manner(Rules):
    """How a game is measured, beyond the league's rules; the tracker has its stated noise.

    Attributes:
        scatter: Range of true over stated noise of the tracker.
        hang: Whether weights hang at the load point instead of a chain and a scale.
        targets: Number of reflectors on the tool that are read, the first of three.
        at_once: Whether all of them are read at the same moment, by an instrument that reads poses.
        carries: Payloads on the flange instead of chain and weights; as many load steps as
            payloads, or a single one: then each pose has one payload, in turn.
    """

    scatter: tuple[float, float] = (1.0, 1.0)
    hang: bool = False
    targets: int = 3
    at_once: bool = False
    carries: Carrying | None = None


@dataclass(frozen=True)
class Slot:
    """One reading in the timetable.

    Attributes:
        group: Its group in the export.
        target: Its target in the export.
        hours: Time since the start [h].
        state: base, unloaded, loaded or chain.
        pull: Row of the course to which it belongs; -1 for the base.
        which: Number of the reflector within its state.
    """

    group: str
    target: str
    hours: float
    state: str
    pull: int
    which: int


@dataclass(frozen=True, eq=False)
class Cell:
    """The truth before anything is read.

    Attributes:
        robot: For the placements of its joints.
        plan: Where and with what.
        rules: How it is measured.
        one: The machine with its secrets.
        tool: True load point and reflectors, flange frame, shape (4, 3) [m].
        stiffness: True stiffnesses, shape (n,) [N/m] or [N m/rad].
        base: Base reflectors, F_b, shape (b, 3) [m].
        origin: The tracker's station, F_b, shape (3,) [m].
        axes: Its axes as columns, F_b, shape (3, 3).
        slots: The readings in the order of time.
        course: The pulls.
        scale: Readings of the scale, shape (m,) [N].
        points: Position of each reading's reflector, F_b, shape (r, 3) [m].
        test_q: Test pose, shape (n,) [m] or [rad].
        test_force: Force there, F_b, shape (3,) [N].
        amplitudes: Planted secrets, as required by the league's judge.
        payloads: Mounted payloads; empty if there are none.
        which: Payload of each pull, shape (m,).
        log: Joint torques read by the controller; None if they are not used.
    """

    robot: Robot
    plan: Plan
    rules: Manner
    one: Setup
    tool: Array
    stiffness: Array
    base: Array
    origin: Array
    axes: Array
    slots: tuple[Slot, ...]
    course: Course
    scale: Array
    points: Array
    test_q: Array
    test_force: Array
    amplitudes: tuple[dict[str, Any], ...]
    payloads: tuple[Payload, ...]
    which: Ints
    log: Log | None

    @property
    def hours(self) -> Array:
        """Time of each reading, shape (r,) [h]."""
        return np.array([slot.hours for slot in self.slots])

    @property
    def local(self) -> Array:
        """The points in the tracker's frame, shape (r, 3) [m]."""
        return np.asarray((self.points - self.origin) @ self.axes)

    def deflection(self) -> Array:
        """Displacements of the reflectors due to the test force, F_b, shape (t, 3) [m]."""
        calm = setup(self.robot, self.stiffness).machine
        q = self.test_q[None]
        loaded, _ = calm.settle(q, self.tool[1:], self.tool[0], self.test_force[None])
        rest, _ = calm.settle(q, self.tool[1:], self.tool[0], np.zeros((1, 3)))
        return np.asarray((loaded - rest)[0])


def build(
    robot: Robot,
    plan: Plan,
    rules: Manner,
    seed: int,
    secrets: Sequence[tuple[Secret, float]] = (),
) -> Cell:
    """Set up a cell: machine, timetable and station depend on the seed, not on the secrets.

    Args:
        robot: Any robot.
        plan: Where and with what.
        rules: How it is measured.
        seed: Seed of everything that is drawn here.
        secrets: The secrets, each with its size in typical sizes.
    """
    of_truth, of_clock, of_secrets, of_station, of_scale, of_test = np.random.default_rng(
        [seed, 1]
    ).spawn(6)
    spread = of_truth.uniform(1 - rules.spread, 1 + rules.spread, robot.n)
    stiffness = spread / robot.nominal_compliance
    tool = plan.tool + rules.tool_m * of_truth.standard_normal(plan.tool.shape)
    base = REFLECTORS[: of_station.integers(3, len(REFLECTORS) + 1)]
    slots = timetable(len(plan.q), len(base), rules, of_clock)
    course = _course(plan, rules, slots, of_secrets)
    one = setup(robot, stiffness)
    planted: tuple[dict[str, Any], ...] = tuple(
        {"label": s.label, "place": s.place, "amplitudes": s.plant(one, size, course) or {}}
        for s, size in secrets
    )
    payloads, which, log = _mounted(one, course, rules, np.random.default_rng([seed, 5]))
    if payloads:
        scale, moves = _carried(one, course, tool, *rows_of(payloads, which))
    else:
        scale, moves = _pulled(one, course, tool, plan, rules, of_scale)
    u, _, v = np.linalg.svd(of_station.normal(size=(3, 3)))
    return Cell(
        robot=robot,
        plan=plan,
        rules=rules,
        one=one,
        tool=tool,
        stiffness=stiffness,
        base=base,
        origin=np.array([6.5, 8.0, 0.7]) + of_station.normal(0, 0.5, 3),
        axes=u @ v * np.linalg.det(u @ v),
        slots=slots,
        course=course,
        scale=scale,
        points=_points(slots, moves, base, one),
        test_q=draw_poses(robot, plan.tool, default_anchors(robot), np.zeros(1, int), of_test)[0],
        test_force=_test_force(rules, of_test),
        amplitudes=planted,
        payloads=payloads,
        which=which,
        log=log,
    )


def random_plan(robot: Robot, rules: Manner, seed: int) -> Plan:
    """Random reachable poses, as in the league; with payloads, a further one at the load point."""
    plan = drawn(robot, np.random.default_rng([seed, 0]), rules)
    if rules.carries is None:
        return plan
    center = drawn_center(np.random.default_rng([seed, 6]))
    return replace(plan, tool=np.vstack([center, plan.tool[1:]]))


class _Watch:
    """The operator's day: what is read when."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.seconds = rng, 0.0
        self.slots: list[Slot] = []

    def wait(self, between: tuple[float, float]) -> None:
        self.seconds += float(self.rng.uniform(*between))

    def read(
        self, group: str, targets: Sequence[str], state: str, pull: int, at_once: bool = False
    ) -> None:
        for which, target in enumerate(targets):
            if which == 0 or not at_once:
                self.wait(READING_S)
            self.slots.append(Slot(group, target, self.seconds / 3600, state, pull, which))


def timetable(
    poses: int, reflectors: int, rules: Manner, rng: np.random.Generator
) -> tuple[Slot, ...]:
    """Times of all readings: base, pose by pose with rounds of the base in between, then base."""
    watch, every = _Watch(rng), int(rng.integers(*ROUND_POSES))
    fixed = [f"B{k + 1}" for k in range(reflectors)]
    names, steps = NAMES[: rules.targets], len(rules.steps)
    chain = () if rules.hang or rules.carries else CHAIN
    settles = MOUNT_S if rules.carries else TIGHTEN_S
    watch.read("base_start", fixed, "base", -1)
    for pose in range(poses):
        if pose and pose % every == 0:
            watch.read(f"base_mid{pose // every}", fixed, "base", -1)
        watch.wait(MOVE_S)
        head, first = f"pose{pose + 1:02d}_rep", pose * steps
        watch.read(f"{head}0_unloaded", names, "unloaded", first, rules.at_once)
        for step in range(steps):
            watch.wait(settles)
            watch.read(f"{head}{step + 1}_loaded", names, "loaded", first + step, rules.at_once)
            watch.read(f"{head}{step + 1}_loaded", chain, "chain", first + step)
        watch.wait(settles)
        last = first + steps - 1
        watch.read(f"{head}{steps + 1}_unloaded", names, "unloaded", last, rules.at_once)
    watch.read("base_end", fixed, "base", -1)
    return tuple(watch.slots)


def _course(plan: Plan, rules: Rules, slots: Sequence[Slot], rng: np.random.Generator) -> Course:
    p, k = len(plan.q), len(rules.steps)
    pose, repeat = np.repeat(np.arange(p), k), np.tile(np.arange(k), p)
    branch = np.concatenate([[1.0], np.sign(np.diff(rules.steps))])
    begins = {slot.pull: slot.hours for slot in reversed(slots) if slot.state == "loaded"}
    time = np.array([begins[i] for i in range(p * k)])
    return Course(pose, repeat, time, np.tile(branch, p), plan.approach[pose], plan.q[pose], rng)


def _pulled(
    one: Setup,
    course: Course,
    tool: Array,
    plan: Plan,
    rules: Manner,
    rng: np.random.Generator,
) -> tuple[Array, Moves]:
    """Readings of the scale, and the resulting positions of everything."""
    steps, m = np.array(rules.steps)[course.repeat], len(course.pose)
    nominal = np.round(rules.force_n * steps + (0 if rules.hang else rng.normal(0, 15.0, m)), 2)
    acts = nominal
    for hook in one.tension:
        acts = hook(acts, course)
    acts = acts + rng.normal(0, rules.scale_n, m)
    down = np.tile([0.0, 0.0, -1.0], (m, 1))
    along = (lambda _: down) if rules.hang else pull_to(plan.anchor[course.pose])
    moves = strained(one, course, tool, along, acts)
    for target, shift in one.loose.items():
        moves.loaded[:, target] += shift * (nominal / rules.force_n)[:, None]
    return nominal, moves


def _mounted(
    one: Setup, course: Course, rules: Manner, rng: np.random.Generator
) -> tuple[tuple[Payload, ...], Ints, Log | None]:
    """The payloads, which of them is mounted at each pull, and the torques due to it."""
    if rules.carries is None:
        return (), np.zeros(len(course.pose), int), None
    payloads = mounted(rules.carries, rng)
    which = course.repeat if len(rules.steps) > 1 else course.pose % len(payloads)
    if not rules.carries.torques:
        return payloads, which, None
    by_state = rules.carries.torques == "states"
    log = read_torques(one, course, *rows_of(payloads, which), by_state, rng)
    return payloads, which, log


def _carried(
    one: Setup, course: Course, tool: Array, mass: Array, center: Array
) -> tuple[Array, Moves]:
    """Weights of the payloads [N], and the resulting positions of everything."""
    down = np.tile([0.0, 0.0, -1.0], (len(mass), 1))
    weight = GRAVITY * mass
    moves = strained(one, course, tool, lambda _: down, weight, center)
    for target, shift in one.loose.items():
        moves.loaded[:, target] += shift * (weight / weight.max())[:, None]
    return weight, moves


def _test_force(rules: Manner, rng: np.random.Generator) -> Array:
    """A random force, mostly downwards, or the weight of a further payload, F_b, shape (3,) [N]."""
    if rules.carries:
        return np.array([0.0, 0.0, -GRAVITY * rules.carries.further_kg])
    return np.asarray(rng.normal(0, 300.0, 3) - np.array([0, 0, 300.0]))


def _points(slots: Sequence[Slot], moves: Moves, base: Array, one: Setup) -> Array:
    """Position of each reading's reflector at the time of reading."""
    stand = {"unloaded": moves.rest, "loaded": moves.loaded, "chain": moves.chain}
    rows = [base[s.which] if s.state == "base" else stand[s.state][s.pull, s.which] for s in slots]
    points = np.array(rows)
    if one.drift is not None:
        points = points + np.array([one.drift(np.array(s.hours)) for s in slots])
    return points


def indices(slots: Sequence[Slot], state: str) -> Ints:
    """Indices of the readings of one state."""
    return np.flatnonzero([slot.state == state for slot in slots])
