"""Joint values of the robot at the targets of a program, also of those given as poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.base.errors import InputError, UsageError, listed
from pipeline.machine.robot import Robot, axes
from pipeline.prediction.model import IdentifiedModel
from pipeline.programs.inverse import FixedSlidingArm
from pipeline.programs.notation import Notation
from pipeline.programs.program import Program, Target

_BEYOND = 1e-3
"""Tolerance on joint limits [rad or m]; coordinates in programs have three decimals."""


@dataclass(frozen=True, eq=False)
class Setting(Locked):
    """Settings that a program or a path does not contain.

    Attributes:
        tools: Tools in the flange frame by name in lower case, each (4, 4); "" for any other.
        bases: Frames in the controller's world frame, likewise.
        world: World frame of the controller in F_b, shape (4, 4).
        flange: Flange frame of the controller in that of the robot file, shape (4, 4).
        tip: Point where the force acts, flange frame of the robot file [m], shape (3,); if None,
            the tool's origin, and without a tool the campaign's load point.
        start: Axis values of the controller before the first motion [m] or [rad], in its order.
        in_tool: Whether forces are given in the tool frame rather than in F_b.
    """

    tools: Mapping[str, Array] = field(default_factory=dict)
    bases: Mapping[str, Array] = field(default_factory=dict)
    world: Array = field(default_factory=lambda: np.eye(4))
    flange: Array = field(default_factory=lambda: np.eye(4))
    tip: Array | None = None
    start: Array | None = None
    in_tool: bool = False


@dataclass(frozen=True, eq=False)
class Aimed(Locked):
    """Targets with their joint values.

    Attributes:
        q: Joint values [m] or [rad], shape (m, n).
        world: Frames of the coordinates of the targets, in F_b, shape (m, 4, 4).
        tool: Tools of the targets in the flange frame of the robot file, shape (m, 4, 4).
        tip: Point where the force acts, in the same frame [m], shape (m, 3).
    """

    q: Array
    world: Array
    tool: Array
    tip: Array


class Refusal(InputError):
    """Some targets cannot be reached or cannot be corrected.

    Attributes:
        others: The errors of all but the last such target; that of the last is this error itself.
    """

    def __init__(self, wrong: Sequence[InputError]) -> None:
        *others, last = wrong
        super().__init__(last.thing, last.way_out, file=last.file, line=last.line)
        self.others = others


def aim(
    model: IdentifiedModel,
    notation: Notation,
    targets: Sequence[Target],
    setting: Setting,
    known: Program | None = None,
) -> Aimed:
    """Joint values of targets, each searched for from the previous one.

    Args:
        model: Model with the robot and its load point.
        notation: How the targets are written.
        targets: In the order of the motions.
        setting: Frames and start.
        known: The program, for the frames that it defines.

    Raises:
        Refusal: Some targets cannot be reached, or a frame or the position of the rail is unknown.
    """
    aiming = _Aiming(model, notation, setting, known)
    found = [aiming.next(target) for target in targets]
    q, world, tool, tip = (np.array(part) for part in zip(*found, strict=True))
    if aiming.rejected:
        raise Refusal(aiming.rejected)
    return Aimed(q, world, tool, tip)


class _Aiming:
    """State of the robot while the targets are processed one by one."""

    def __init__(
        self, model: IdentifiedModel, notation: Notation, setting: Setting, program: Program | None
    ) -> None:
        robot = model.robot
        self.notation, self.setting, self.program = notation, setting, program
        self.robot, self.axes = robot, axes.of(robot)
        self.arm = FixedSlidingArm(robot, self.axes)
        self.load_point = model.tool.load_point
        self.rejected: list[InputError] = []
        self.known = setting.start is not None
        self.rail_known = not robot.prismatic.any() or self.known
        if setting.start is None:
            self.q = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
        else:
            self.q = self.axes.joints(np.atleast_2d(setting.start))[0]

    def next(self, target: Target) -> tuple[Array, Array, Array, Array]:
        """Joint values, frame, tool and tip of a target; an error is recorded in `rejected`."""
        world = tool = np.eye(4)
        tip = self.load_point if self.setting.tip is None else self.setting.tip
        try:
            world, named = self._frames(target)
            if named is None and self.setting.in_tool:
                raise self._unknown("tool", "--tool", target, target.tool)
            tool = self.setting.flange @ (named if named is not None else np.eye(4))
            tip = tip if named is None or self.setting.tip is not None else tool[:3, 3]
            self._rail(target)
            if target.kind == "joint":
                self._to_joints(target)
            else:
                self._to_pose(target, world, tool)
            self.known = True
        except InputError as problem:
            self.rejected.append(problem)
        return self.q, world, tool, tip

    def _frames(self, target: Target) -> tuple[Array, Array | None]:
        """Frame of a target's coordinates in F_b, and its tool (None if unknown, for axes only)."""
        given, program = self.setting, self.program
        if target.kind == "joint":
            named = _frame(target.tool, given.tools, program.tools if program else {})
            return np.eye(4), named
        tool = _frame(target.tool, given.tools, program.tools if program else {})
        base = _frame(target.base, given.bases, program.bases if program else {})
        for word, option, name, frame in (
            ("tool", "--tool", target.tool, tool),
            ("frame", "--base", target.base, base),
        ):
            if frame is None:
                raise self._unknown(word, option, target, name)
        assert tool is not None
        assert base is not None
        return given.world @ base, tool

    def _unknown(self, word: str, option: str, target: Target, name: str) -> InputError:
        """Error for a tool or frame that is not defined."""
        which = f"{word} {name}" if name else f"its {word}"
        equals = f"{name}=" if name and " " not in name else ""
        way_out = f"give it as {option} {equals}{self.notation.letters}"
        return target_error(target, f"{which} is not defined", way_out)

    def _rail(self, target: Target) -> None:
        """Move the sliding joints to the position that the target states, if it does."""
        slides = self.axes.slides
        count = int(slides.sum())
        if count and len(target.external) >= count:
            values = np.zeros(len(slides))
            values[slides] = 1e-3 * np.array(target.external[:count])
            q = self.axes.joints(values[None])[0]
            self.q = np.where(self.robot.prismatic, q, self.q)
            self.rail_known = True
        if not self.rail_known:
            raise target_error(
                target,
                f"the position of {listed(np.array(self.axes.names)[slides])} is not stated",
                "add it to the target, or give the axes before it with --start",
            )
        self._within(target, self.q, only=self.robot.prismatic)

    def _to_joints(self, target: Target) -> None:
        q = self._joints(target, target.values)
        self._within(target, q, only=~self.robot.prismatic)
        self.q = q

    def _joints(self, target: Target, values: Sequence[float]) -> Array:
        """Joint values for the arm's axis values of a program; the other joints keep theirs."""
        turning = np.flatnonzero(~self.axes.slides)
        if len(values) != len(turning):
            raise UsageError(
                f"{target.file} is for an arm of {len(values)} axes and {self.robot.name} has "
                f"{len(turning)}: give the campaign of its robot"
            )
        now = self.axes.values(self.q[None])[0]
        now[turning] = self.notation.angle * np.array(values)
        return np.where(self.robot.prismatic, self.q, self.axes.joints(now[None])[0])

    def _to_pose(self, target: Target, world: Array, tool: Array) -> None:
        try:
            frame = self.notation.frame(target.values)
        except ValueError as problem:
            thing, way_out = "its quaternion has no length", "correct it"
            raise target_error(target, thing, way_out) from problem
        flange = world @ frame @ linear.solve(tool, np.eye(4))
        start = self._joints(target, target.near) if target.near else self.q
        known = self.known or bool(target.near)
        found = self.arm.reach(flange, start, known, target.ranges)
        if found.why_not is not None:
            raise target_error(target, *found.why_not)
        self.q = found.q

    def _within(self, target: Target, q: Array, only: Bools) -> None:
        """Reject joint values beyond the limits, of the joints in `only`."""
        if worst := worst_limit(self.robot, np.where(only, q, np.nan)):
            raise target_error(target, worst, "correct the target")


def _frame(name: str, given: Mapping[str, Array], own: Mapping[str, Array]) -> Array | None:
    """Frame by name: from the options, from the program, or the default of the options."""
    return given.get(name.lower(), own.get(name, given.get("")))


def target_error(target: Target, thing: str, way_out: str) -> InputError:
    """Error about a target, with its line."""
    return InputError(f"{target.name}: {thing}", way_out, file=target.file, line=target.line)


def worst_limit(robot: Robot, q: Array) -> str | None:
    """Describe the joint furthest beyond its limits; None if there is none. NaN is ignored."""
    over = np.nan_to_num(np.maximum(robot.lower - q, q - robot.upper), nan=-np.inf)
    j = int(over.argmax())
    if over[j] <= _BEYOND:
        return None
    joint = robot.joints[j]
    size = f"{1e3 * over[j]:.1f} mm" if joint.prismatic else f"{np.rad2deg(over[j]):.2f} deg"
    return f"joint {joint.name} is {size} beyond its limit"


def with_start(setting: Setting, robot: Robot, values: Sequence[float]) -> Setting:
    """A setting with the axis values before the first motion, in degrees and mm as displayed.

    Raises:
        UsageError: Their number is not that of the robot's axes.
    """
    of = axes.of(robot)
    if len(values) != len(of.names):
        raise UsageError(f"--start has {len(values)} numbers: give {listed(of.names)} [deg, mm]")
    given = np.array(values)
    return replace(setting, start=np.where(of.slides, 1e-3 * given, np.deg2rad(given)))
