"""One game of the league: a machine with secrets is measured; raw files and the sealed truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from bench.league.hidden_effect import NOMINAL, Course, Secret, Setup, setup
from bench.league.machine import turned
from pipeline.base.arrays import Array, Locked
from pipeline.design.poses import default_anchors, draw_poses
from pipeline.machine.robot import Robot

NAMES = ("P1", "P2", "P3")
CHAIN = ("Pl1", "Pl2")
TOOLS = (
    ((0.15, 0.0, 0.25), (0.20, 0.05, 0.12), (-0.12, 0.19, 0.10), (-0.10, -0.18, 0.22)),
    ((0.28, 0.05, 0.30), (0.25, 0.10, 0.20), (-0.15, 0.22, 0.18), (-0.05, -0.25, 0.35)),
    ((-0.10, 0.22, 0.34), (0.18, -0.16, 0.15), (-0.20, 0.02, 0.16), (0.02, 0.24, 0.28)),
)
"""Load point and three reflectors [m], flange frame."""

BASE = ((0.6, -0.5, -0.30), (0.6, 18.5, -0.30), (-0.6, 18.5, -0.28), (-0.6, -0.5, -0.28))
BEAM = "{ range_m = 8e-6, range_per_m = 0.3e-6, transverse_m = 7.5e-6, transverse_per_m = 3e-6 }"


@dataclass(frozen=True)
class Rules:
    """How a game is measured.

    Attributes:
        poses: Number of poses, drawn from the reachable ones.
        steps: Load steps in the order of the turnbuckle, as fractions of `force_n`.
        spread: Stiffnesses differ from nominal by a factor within 1 +- this.
        scatter: Range of true over stated noise of the tracker.
        tool_m: Error of the points of the tool [m], one sigma.
        force_n: Largest force [N].
        scale_n: Noise of the scale [N]; 2 N are stated.
    """

    poses: int = 16
    steps: tuple[float, ...] = (0.35, 0.7, 1.0, 0.5)
    spread: float = 0.25
    scatter: tuple[float, float] = (0.8, 1.3)
    tool_m: float = 2e-4
    force_n: float = 3000.0
    scale_n: float = 2.0


@dataclass(frozen=True, eq=False)
class Plan(Locked):
    """Where and with what a campaign is measured, whatever the machine hides.

    Attributes:
        tool: Nominal load point and reflectors, flange frame, shape (4, 3) [m].
        q: Joint values, shape (p, n).
        anchor: Where the chain is attached, F_b, shape (p, 3) [m].
        approach: Direction from which the carriage comes, shape (p,).
        isotropic: Whether campaign.toml states one uncertainty for all axes.
        scatter: True over stated noise of the tracker.
    """

    tool: Array
    q: Array
    anchor: Array
    approach: Array
    isotropic: bool
    scatter: float

    def further(self, q: Array, anchor: Array, approach: float) -> Plan:
        """The plan with one more pose at the end."""
        return replace(
            self,
            q=np.vstack([self.q, q]),
            anchor=np.vstack([self.anchor, anchor]),
            approach=np.append(self.approach, approach),
        )


@dataclass(frozen=True, eq=False)
class Game:
    """A campaign as brought home by the operator, and the truth.

    Attributes:
        files: Content of the raw folder.
        truth: Labels, places and sizes of the secrets; stiffnesses.
        course: Course of the measurement.
    """

    files: dict[str, bytes]
    truth: dict[str, Any]
    course: Course


def drawn(robot: Robot, rng: np.random.Generator, rules: Rules) -> Plan:
    """Random reachable poses, on both sides of the rail in turn."""
    tool = np.array(TOOLS[rng.integers(len(TOOLS))])
    anchors = default_anchors(robot)
    which = (np.arange(rules.poses) + rng.integers(len(anchors))) % len(anchors)
    return Plan(
        tool=tool,
        q=draw_poses(robot, tool, anchors, which, rng),
        anchor=anchors[which],
        approach=rng.permutation(np.where(np.arange(rules.poses) % 2 == 0, 1.0, -1.0)),
        isotropic=bool(rng.random() < 0.6),
        scatter=float(rng.uniform(*rules.scatter)),
    )


def play(
    robot: Robot,
    plan: Plan,
    secrets: Sequence[tuple[Secret, float]],
    rng: np.random.Generator,
    rules: Rules | None = None,
    name: str = "game",
    stiffness: Array | None = None,
) -> Game:
    """Measure a machine with secrets.

    A plan with further poses at its end measures the same machine, with the same readings at the
    poses that were there before.

    Args:
        robot: The KR500 on its rail.
        plan: Where and with what.
        secrets: The secrets, each with its size in typical sizes.
        rng: Source of the machine, the secrets and the noise.
        rules: How it is measured.
        name: Name of the campaign.
        stiffness: True ones of the joints [N/m] or [N m/rad], shape (n,); drawn if not given, which
            changes nothing else.
    """
    rules = rules or Rules()
    for_truth, for_noise, for_secrets = rng.spawn(3)
    made = _made(robot, plan, secrets, (for_truth, for_secrets), rules, stiffness)
    one, course, sizes = made.one, made.course, made.sizes
    files = _measure(one, course, made.tool, plan, for_noise, rules, name)
    truth: dict[str, Any] = {
        "secrets": [
            {
                "label": s.label,
                "place": s.place,
                "known": s.known,
                "size": size,
                "amplitudes": true,
                "law": s.law and asdict(s.law),
            }
            for (s, size), true in zip(secrets, sizes, strict=True)
        ],
        "stiffness": made.stiffness.tolist(),
        "tracker_scale": one.tracker_scale,
    }
    return Game(files, truth, course)


@dataclass(frozen=True, eq=False)
class _Made:
    """A machine, how it is measured, its true tool (1 + t, 3) [m] and the secrets' amplitudes."""

    one: Setup
    stiffness: Array
    course: Course
    tool: Array
    sizes: list[dict[str, float]]


def _made(
    robot: Robot,
    plan: Plan,
    secrets: Sequence[tuple[Secret, float]],
    sources: tuple[np.random.Generator, np.random.Generator],
    rules: Rules,
    stiffness: Array | None = None,
) -> _Made:
    """Set up the machine of a game; `sources` are those of the machine and of the secrets."""
    for_truth, for_secrets = sources
    course = _course(plan, rules, for_secrets)
    own = 1 / NOMINAL * for_truth.uniform(1 - rules.spread, 1 + rules.spread, robot.n)
    stiffness = own if stiffness is None else stiffness
    one = setup(robot, stiffness)
    one.tracker_scale = plan.scatter
    tool = plan.tool + rules.tool_m * for_truth.standard_normal(plan.tool.shape)
    sizes = [secret.plant(one, size, course) or {} for secret, size in secrets]
    return _Made(one, stiffness, course, tool, sizes)


@dataclass(frozen=True, eq=False)
class Further(Locked):
    """Forces at poses that are not in the campaign, and the resulting displacements.

    Attributes:
        q: Joint values, shape (k, n).
        force: At the nominal load point, F_b, shape (k, 3) [N].
        moved: Displacement of that point due to the force, F_b, shape (k, 3) [m].
    """

    q: Array
    force: Array
    moved: Array


def at_further_poses(
    robot: Robot,
    plan: Plan,
    secrets: Sequence[tuple[Secret, float]],
    seed: Sequence[int],
    rules: Rules,
    count: int = 3,
) -> Further:
    """Displacements of the machine of a game under the largest force at further poses.

    The force is known and acts at the nominal load point, so that errors of scale, chain and
    readings have no influence. The pose is approached from the other end of the rail, and the force
    is the first there, so that a machine with memory starts from rest.

    Args:
        robot: The KR500 on its rail.
        plan: Where and with what.
        secrets: The secrets. For those that draw something for each pose of a campaign, this is a
            different machine.
        seed: Seed of the game.
        rules: How it is measured.
        count: Number of further poses.
    """
    rng = np.random.default_rng([*seed, 2])
    anchors = default_anchors(robot)
    which = rng.integers(len(anchors), size=count)
    q = draw_poses(robot, plan.tool, anchors, which, rng)
    for pose, anchor in zip(q, anchors[which], strict=True):
        plan = plan.further(pose, anchor, 1.0)
    for_truth, _, for_secrets = np.random.default_rng(seed).spawn(3)
    made = _made(robot, plan, secrets, (for_truth, for_secrets), rules)
    course, machine = made.course, made.one.machine
    here = course.q + made.one.joint_shift
    none = np.zeros((len(here), 3))
    rest, at = machine.settle(here, plan.tool[:1], plan.tool[0], none)
    force = rules.force_n * pull_to(plan.anchor[course.pose])(at)
    loaded, _ = machine.settle(here, plan.tool[:1], plan.tool[0], force)
    asked = (course.pose >= len(plan.q) - count) & (course.repeat == 0)
    return Further(course.q[asked], force[asked], (loaded - rest)[asked, 0])


def _course(plan: Plan, rules: Rules, rng: np.random.Generator) -> Course:
    p, k = len(plan.q), len(rules.steps)
    pose, repeat = np.repeat(np.arange(p), k), np.tile(np.arange(k), p)
    branch = np.concatenate([[1.0], np.sign(np.diff(rules.steps))])
    time = 0.05 + 0.13 * pose + 0.025 * (repeat + 1.0)
    return Course(pose, repeat, time, np.tile(branch, p), plan.approach[pose], plan.q[pose], rng)


def _measure(
    one: Setup,
    course: Course,
    tool: Array,
    plan: Plan,
    rng: np.random.Generator,
    rules: Rules,
    name: str,
) -> dict[str, bytes]:
    at_the_base, *at_pose = rng.spawn(1 + len(plan.q))
    jitter, misread = np.concatenate(
        [pose.normal(0, [[15.0], [rules.scale_n]], (2, len(rules.steps))) for pose in at_pose],
        axis=1,
    )
    reading = np.round(rules.force_n * np.array(rules.steps)[course.repeat] + jitter, 2)
    shown = reading
    for hook in one.tension:
        shown = hook(shown, course)
    tension = shown + misread
    moves = strained(one, course, tool, pull_to(plan.anchor[course.pose]), tension)
    for target, shift in one.loose.items():
        moves.loaded[:, target] += shift * (reading / rules.force_n)[:, None]
    tracker = _Tracker(one, plan.isotropic, at_the_base)
    readings = _readings(tracker, course, moves, at_the_base, at_pose)
    return {
        "campaign.toml": _toml(one, plan.tool, plan.isotropic, name).encode(),
        "tracker.csv": readings.encode(),
        "loads.csv": loads_log(course, reading).encode(),
        "joints.csv": joints_log(one.machine.robot, course).encode(),
    }


Direction = Callable[[Array], Array]
"""Function from load points [m], F_b, shape (m, 3), to unit vectors of the force there."""


@dataclass(frozen=True, eq=False)
class Moves:
    """Positions of everything that is read, pull by pull, F_b [m].

    Attributes:
        rest: Reflectors before the pull, shape (m, t, 3).
        loaded: The same under load.
        chain: Both reflectors on the chain, shape (m, 2, 3).
    """

    rest: Array
    loaded: Array
    chain: Array


def pull_to(anchor: Array) -> Direction:
    """A chain to anchors, F_b, shape (m, 3) [m]."""

    def towards(at: Array) -> Array:
        return np.asarray((anchor - at) / np.linalg.norm(anchor - at, axis=1, keepdims=True))

    return towards


def strained(
    one: Setup,
    course: Course,
    tool: Array,
    along: Direction,
    size: Array,
    load_point: Array | None = None,
) -> Moves:
    """Let the machine come to rest under every pull, and without.

    Args:
        one: The machine and its secrets.
        course: Course of the measurement.
        tool: True load point and reflectors, flange frame, shape (1 + t, 3) [m].
        along: Direction of the force.
        size: True forces, shape (m,) [N].
        load_point: Where each of them acts, flange frame, shape (m, 3) [m]; if None, the tool's.
    """
    q = course.q + one.joint_shift
    pull_at = (tool[0] if load_point is None else load_point) + one.load_shift
    targets = tool[1:] + one.target_shift
    rest, at = one.machine.settle(q, targets, pull_at, np.zeros((len(q), 3)))
    for _ in range(4):
        unit = along(at)
        force = size[:, None] * unit
        for hook in one.force:
            force = hook(force, course)
        moved, at = one.machine.settle(q, targets, pull_at, force)
    chain = at[:, None] + np.array([0.1, 0.5])[:, None] * unit[:, None]
    chain[:, 0] += _flange_axes(one, q) @ (one.chain_shift * 1.0)
    return Moves(rest, moved, chain)


def _flange_axes(one: Setup, q: Array) -> Array:
    unit, _ = one.machine.settle(
        q, np.vstack([np.zeros(3), np.eye(3)]), np.zeros(3), np.zeros((len(q), 3))
    )
    return np.asarray(np.swapaxes(unit[:, 1:] - unit[:, :1], 1, 2))


class _Tracker:
    """Reads points: drift, frame, noise, millimetres."""

    def __init__(self, one: Setup, isotropic: bool, rng: np.random.Generator) -> None:
        self.one, self.isotropic = one, isotropic
        self.origin = np.array([6.5, 8.0, 0.7]) + rng.normal(0, 0.5, 3)
        turn = rng.normal(0, 1, (3, 3))
        u, _, v = np.linalg.svd(turn)
        self.axes = u @ v * np.linalg.det(u @ v)

    def read(self, point: Array, hours: float, rng: np.random.Generator) -> Array:
        if self.one.drift is not None:
            point = point + self.one.drift(np.array(hours))
        local = self.axes.T @ (point - self.origin)
        if self.isotropic:
            error = rng.normal(0, 3e-5, 3)
        else:
            far = np.linalg.norm(local)
            beam = local / far
            error = rng.normal(0, 7.5e-6 + 3e-6 * far, 3)
            along = rng.normal(0, 8e-6 + 0.3e-6 * far)
            error = error - beam * (beam @ error) + beam * along
        return np.asarray(1e3 * (local + self.one.tracker_scale * error))


def _clock(hours: float) -> str:
    seconds = round(hours * 3600)
    return f"2026-11-03T{8 + seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


def _line(group: str, target: str, at: Array, hours: float) -> str:
    return f"{group},{target},{at[0]:.4f},{at[1]:.4f},{at[2]:.4f},{_clock(hours)}"


def _readings(
    tracker: _Tracker,
    course: Course,
    moves: Moves,
    at_the_base: np.random.Generator,
    at_pose: Sequence[np.random.Generator],
) -> str:
    lines = ["group,target,x_mm,y_mm,z_mm,time"]

    def read(group: str, target: str, point: Array, hours: float, rng: np.random.Generator) -> None:
        lines.append(_line(group, target, tracker.read(point, hours, rng), hours))

    last = float(course.time.max()) + 0.1
    for group, hours in (("base_start", 0.0), ("base_end", last)):
        for k, point in enumerate(BASE):
            read(group, f"B{k + 1}", np.array(point), hours, at_the_base)
    count = int(course.repeat.max()) + 1
    for i, rng in enumerate(at_pose[pose] for pose in course.pose):
        pose, repeat, hours = int(course.pose[i]) + 1, int(course.repeat[i]) + 1, course.time[i]
        head = f"pose{pose:02d}_rep"
        if repeat in (1, count):
            number, when = (0, hours - 0.02) if repeat == 1 else (count + 1, hours + 0.02)
            for t, target in enumerate(NAMES):
                read(f"{head}{number}_unloaded", target, moves.rest[i, t], when, rng)
        points = np.concatenate([moves.loaded[i], moves.chain[i]])
        for target, point in zip((*NAMES, *CHAIN), points, strict=True):
            read(f"{head}{repeat}_loaded", target, point, hours, rng)
    return "\n".join(lines) + "\n"


def loads_log(course: Course, reading: Array, title: str = "force_n") -> str:
    """loads.csv of all pulls, with the readings under this title."""
    rows = zip(course.pose, course.repeat, reading, course.branch, strict=True)
    body = [f"{p + 1},{r + 1},{f:.2f},{'up' if b > 0 else 'down'}" for p, r, f, b in rows]
    return "\n".join([f"pose,repeat,{title},branch", *body]) + "\n"


def joints_log(robot: Robot, course: Course) -> str:
    """joints.csv, one row per pose."""
    names = [f"{j.name}_{'m' if j.prismatic else 'deg'}" for j in robot.joints]
    first = np.flatnonzero(course.repeat == 0)
    q = np.where(robot.prismatic, course.q[first], np.rad2deg(course.q[first]))
    body = [
        f"{int(course.pose[i]) + 1},{','.join(f'{v:.6f}' for v in row)},{int(course.approach[i])}"
        for i, row in zip(first, q, strict=True)
    ]
    return "\n".join([",".join(["pose", *names, "approach"]), *body]) + "\n"


def _toml(one: Setup, tool: Array, isotropic: bool, name: str) -> str:
    base = turned(np.array(BASE), one.base_turn)
    noise = "sigma_m = 3e-5" if isotropic else f"noise = {BEAM}"
    points = zip(("load_point", *NAMES), tool.tolist(), strict=True)
    return "\n".join(
        [
            "format = 1",
            f'name = "{name}"',
            'robot = "kr500_rail"',
            "[tracker]",
            'files = ["tracker.csv"]',
            noise,
            "[base_frame]",
            *(f"B{k + 1} = {[round(v, 7) for v in row]}" for k, row in enumerate(base.tolist())),
            "[scale]",
            'file = "loads.csv"',
            "sigma_n = 2.0",
            "[joints]",
            'file = "joints.csv"',
            "[tool]",
            *(f"{label} = {row}" for label, row in points),
            "",
        ]
    )
