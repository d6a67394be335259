"""A design problem: the aim of a plan and its limits, as a checked problem from its TOML text."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.base.arrays import Array, Bools, Locked
from pipeline.base.covariance import symmetric
from pipeline.base.errors import InputError, listed
from pipeline.design import criteria
from pipeline.design.arm import arm_alone, bodied
from pipeline.design.criteria import Criterion
from pipeline.design.information import Experiment
from pipeline.design.pull import REFERENCE_PULL_N, round_pull, share
from pipeline.design.room import Room, room_of
from pipeline.design.scatter import PulledReadings, TrackerBeam
from pipeline.design.spec import Limits, NoiseSpec, ProblemFile, revised
from pipeline.library import holds
from pipeline.machine.cell import Tool, jacobian, paper_cell
from pipeline.machine.effect import Pulls
from pipeline.machine.instrument import PAPER_SHARE, PAPER_SIGMA_M
from pipeline.machine.robot import Joint, Robot, axes, configure
from pipeline.machine.robot.axes import rounded
from pipeline.machine.robot.configuration import velocity
from pipeline.machine.surroundings import turns

_G_N_PER_KG = 9.81
"""Weight of a kilogram [N], with as many digits as a payload has."""


@dataclass(frozen=True, eq=False)
class Problem(Locked):
    """A checked problem, in SI and F_b.

    Attributes:
        spec: The file it came from.
        robot: The robot.
        tool: Load point and reflectors.
        experiment: What is done at every pose.
        criterion: The criterion to minimise.
        limits: Limits of every pose.
        room: Free space of the cell; None where it is not described.
        poses: m_0.
        repeats: Number of passes through the load steps at each pose.
        lower: Lower joint limits [m] or [rad], shape (n,).
        upper: Upper joint limits [m] or [rad], shape (n,).
        anchor_lower: Lower limits of the anchor [m], shape (3,).
        anchor_upper: Upper limits of the anchor [m], shape (3,); equal where it is fixed.
        known: Prior information about the scaled compliances, shape (n, n).
    """

    spec: ProblemFile
    robot: Robot
    tool: Tool
    experiment: Experiment
    criterion: Criterion
    limits: Limits
    room: Room | None
    poses: int
    repeats: int
    lower: Array
    upper: Array
    anchor_lower: Array
    anchor_upper: Array
    known: Array

    @property
    def free(self) -> Bools:
        """Which coordinates of the anchor are free, shape (3,)."""
        return self.anchor_upper > self.anchor_lower

    def as_printed(self, q: Array) -> Array:
        """Joint values (m, n) rounded to 1e-6 m and 1e-6 degrees, clipped to their limits."""
        return np.clip(rounded(self.robot, q), self.lower, self.upper)


def build(spec: ProblemFile, robot: Robot) -> Problem:
    """Make the arrays of a problem and refuse requests that no plan can meet.

    Args:
        spec: The problem file.
        robot: Its robot.

    Raises:
        InputError: The request cannot be met; says why and what to change.
    """
    tool = Tool.of(spec.tool)
    spec = _one_tracker(_pulled(spec, robot, tool))
    repeats = _shared_repeats(spec, robot)
    scale = robot.nominal_compliance
    scatter = _scatter(spec.noise, np.array(spec.pull.steps_n), repeats)
    experiment = Experiment(robot, tool.load_point, tool.points, scale, scatter)
    wide, (lower, upper) = (_joint_limits(spec, robot, *ends) for ends in _turning(spec, robot))
    anchor = spec.anchor
    ends = np.array([np.broadcast_to(at, 2) for at in (anchor.x_m, anchor.y_m, anchor.z_m)])
    _check_payload(spec, robot)
    _check_every_joint_turns(robot, tool, lower, upper)
    return Problem(
        spec=spec,
        robot=robot,
        tool=tool,
        experiment=experiment,
        criterion=_criterion(spec, robot, tool, scale, *wide),
        limits=spec.limits,
        room=_room(spec, robot, tool),
        poses=spec.plan.poses,
        repeats=repeats,
        lower=lower,
        upper=upper,
        anchor_lower=ends[:, 0],
        anchor_upper=ends[:, 1],
        known=np.zeros((robot.n, robot.n)),
    )


def _room(spec: ProblemFile, robot: Robot, tool: Tool) -> Room | None:
    """Free space of the cell; without a cell, of the arm itself, if the limits ask for that."""
    if spec.cell is not None:
        own = bodied(robot) if spec.limits.clear_of_itself else robot
        return room_of(own, tool.named, spec, _hardest(spec))
    return arm_alone(robot, tool, spec) if spec.limits.clear_of_itself else None


def _pulled(spec: ProblemFile, robot: Robot, tool: Tool) -> ProblemFile:
    """The problem with a load step; where none is stated, one that suits the robot."""
    if spec.pull.steps_n:
        return spec
    pull = round_pull(REFERENCE_PULL_N * share(robot, tool.load_point))
    return revised(spec, {"pull": {"steps_n": [pull]}})


def _one_tracker(spec: ProblemFile) -> ProblemFile:
    """The problem with the tracker's position of the cell for the noise of the readings.

    Raises:
        InputError: The noise states another position of the tracker.
    """
    at = spec.cell.tracker_m if spec.cell else None
    if at is None:
        return spec
    said = spec.noise.tracker_position_m
    if "tracker_position_m" in spec.noise.model_fields_set and said != at:
        raise InputError(
            f"the tracker stands at {list(at)} m by [cell] tracker_m and at {list(said)} m by "
            "[noise] tracker_position_m",
            "leave out one of them",
        )
    noise = spec.noise.model_copy(update={"tracker_position_m": at})
    return spec.model_copy(update={"noise": noise})


def _hardest(spec: ProblemFile) -> float:
    """Largest force of the problem, programmes included [N]."""
    programmes = spec.diagnosis.programmes if spec.diagnosis else []
    return max(*spec.pull.steps_n, 0.0, *(abs(step) for steps in programmes for step in steps))


def _shared_repeats(spec: ProblemFile, robot: Robot) -> int:
    """Number of passes through the load steps at each pose.

    Raises:
        InputError: The readings are too few, or cannot be shared equally among the poses.
    """
    poses, readings, steps = spec.plan.poses, spec.plan.readings, len(spec.pull.steps_n)
    seen_per_reading = min(3 * len(spec.targets), 6)  # a rigid effector has six coordinates
    fewest = max(3, -(-robot.n // seen_per_reading))
    if readings < fewest:
        raise InputError(
            f"{readings} readings are too few for the {robot.n} stiffnesses of {robot.name} and a "
            f"check of their fit",
            f"plan at least {fewest} readings",
        )
    repeats, rest = divmod(readings, poses * steps)
    if rest or not repeats:
        asked = f"{readings} readings" if steps == 1 else f"{readings} readings in {steps} steps"
        raise InputError(
            f"{asked} cannot be shared equally among {poses} poses",
            f"plan a multiple of {poses * steps} readings",
        )
    return repeats


def _scatter(noise: NoiseSpec, force: Array, repeats: int) -> PulledReadings:
    sigma = noise.displacement_sigma_m or noise.reading_sigma_m or 0.0  # one of three is given
    tracker: Array | TrackerBeam = sigma**2 * np.eye(3)
    if noise.tracker == "paper":
        tracker = PAPER_SIGMA_M**2 * symmetric(PAPER_SHARE[None])[0]
    elif noise.tracker is not None:
        tracker = TrackerBeam(noise.tracker, noise.tracker_position_m)
    return PulledReadings(
        force=force,
        repeats=np.full(len(force), float(repeats)),
        force_std=np.hypot(noise.scale_sigma_n, noise.scale_sigma_rel * force),
        zero=noise.zero_share,
        tracker=tracker,
    )


def with_steps(problem: Problem, steps: Array) -> Experiment:
    """The experiment of a pose that is pulled once at each of these steps [N], signs ignored."""
    return replace(problem.experiment, scatter=_scatter(problem.spec.noise, np.abs(steps), 1))


def _turning(spec: ProblemFile, robot: Robot) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Joint limits of the robot alone, and those that cables and hoses allow."""
    return (robot.lower, robot.upper), turns(robot, spec)


def _joint_limits(
    spec: ProblemFile, robot: Robot, lower: Array, upper: Array
) -> tuple[Array, Array]:
    """These limits, narrowed by the problem's; a joint without limits turns once.

    Raises:
        InputError: The problem names an unknown joint, or leaves nothing of its limits.
    """
    lower = np.where(np.isfinite(lower), lower, -np.pi)
    upper = np.where(np.isfinite(upper), upper, np.pi)
    lower, upper = _drivable(spec.limits, robot, lower, upper)
    names = [joint.name for joint in robot.joints]
    for name, bounds in spec.limits.joints.items():
        if name not in names:
            raise InputError(
                f'{robot.name} has no joint "{name}"', f"its joints are {listed(names)}"
            )
        k = names.index(name)
        low, high = bounds if robot.joints[k].prismatic else np.deg2rad(bounds)
        lower[k], upper[k] = max(lower[k], low), min(upper[k], high)
        if lower[k] >= upper[k]:
            raise InputError(
                f"limits.joints.{name} = {list(bounds)} leaves nothing of the robot's own limits",
                f"give an interval that meets {_span(robot.joints[k])}",
            )
    return lower, upper


def _drivable(limits: Limits, robot: Robot, lower: Array, upper: Array) -> tuple[Array, Array]:
    """These limits inside the robot's own by a margin, and within the window of the wrist.

    A joint with less room than its margins keeps its limits.
    """
    margin = np.where(robot.prismatic, limits.margin_m, np.deg2rad(limits.margin_deg))
    room = robot.upper - robot.lower > 2 * margin
    low = np.where(room, np.maximum(lower, robot.lower + margin), lower)
    high = np.where(room, np.minimum(upper, robot.upper - margin), upper)
    most, mapped = np.deg2rad(limits.wrist_within_deg), axes.of(robot)
    for joint in np.flatnonzero(~robot.prismatic)[-_WRIST:]:
        zero = float(mapped.offset[joint]) if mapped.alone(int(joint)) else 0.0
        if low[joint] < zero + most and high[joint] > zero - most:
            low[joint] = max(low[joint], zero - most)
            high[joint] = min(high[joint], zero + most)
    return low, high


_WRIST = 3
"""Number of joints of a wrist."""


def _span(joint: Joint) -> str:
    unit, one = ("m", 1.0) if joint.prismatic else ("deg", np.rad2deg(1.0))
    return f"{one * joint.lower:g} to {one * joint.upper:g} {unit}"


def _check_payload(spec: ProblemFile, robot: Robot) -> None:
    payload, pull = spec.limits.payload_kg, _hardest(spec)
    if payload is not None and pull > payload * _G_N_PER_KG:
        raise InputError(
            f"a pull of {pull:g} N is more than the payload of {payload:g} kg carries "
            f"({payload * _G_N_PER_KG:.0f} N)",
            "pull less, or correct limits.payload_kg",
        )
    holds.refuse_absurd(robot, pull, "state other load steps, or leave pull.steps_n out")


def _check_every_joint_turns(robot: Robot, tool: Tool, lower: Array, upper: Array) -> None:
    """Refuse a load point about which no pull at any pose exerts a torque on some joint.

    Raises:
        InputError: Names the joint.
    """
    rng = np.random.default_rng(0)
    at = configure(robot, rng.uniform(lower, upper, (64, robot.n)))
    lever = velocity(at.twists, at.points(tool.load_point[None]))
    size = np.linalg.norm(lever, axis=-1).max(axis=(0, 1))
    for joint, reach in zip(robot.joints, size, strict=True):
        if reach < 1e-6:
            raise InputError(
                f"the load point lies on the axis of joint {joint.name}: no pull can turn it",
                "move tool.load_point off that axis",
            )


def _criterion(
    spec: ProblemFile, robot: Robot, tool: Tool, scale: Array, lower: Array, upper: Array
) -> Criterion:
    kind = spec.criterion.kind
    if kind in criteria.CLASSIC:
        return criteria.CLASSIC[kind]
    if kind == "test_pose":
        q = np.array([pose.joint_values(robot, "problem.toml") for pose in spec.test_pose])
        force = np.array([pose.force_n for pose in spec.test_pose])
        weights = np.array([pose.weight for pose in spec.test_pose])
    else:
        q, force = _workspace(spec, lower, upper)
        weights = np.ones(len(q))
    cell = paper_cell(robot, tool)
    points = [spec.targets.index(name) for name in spec.criterion.points or spec.targets]
    A = jacobian(cell, Pulls.at(q, force), np.zeros(robot.n))[:, points] * scale
    weights = np.repeat(weights, len(points))
    return criteria.prediction(A.reshape(-1, 3, robot.n), weights, kind)


def _workspace(spec: ProblemFile, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Poses and forces spread over the whole workspace, the same for every seed of the search."""
    rng = np.random.default_rng(20150526)
    q = rng.uniform(lower, upper, (spec.criterion.samples, len(lower)))
    direction = rng.normal(size=(len(q), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return q, spec.criterion.force_n * direction
