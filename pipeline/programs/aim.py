"""Where the robot stands at the targets of a program: joint values for its poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.base.errors import InputError, UsageError, listed
from pipeline.machine.robot import Robot, axes
from pipeline.prediction.model import IdentifiedModel
from pipeline.programs.inverse import Arm
from pipeline.programs.notation import Notation
from pipeline.programs.program import Program, Target

_BEYOND = 1e-3
"""[rad] or [m]: how far a joint may seem beyond its limit; programs have three decimals."""


@dataclass(frozen=True, eq=False)
class Setting(Locked):
    """What a program or a path does not say of itself.

    Attributes:
        tools: Tools in the flange frame by name in small letters, each (4, 4); "" for any other.
        bases: Frames in the controller's world, likewise.
        world: World of the controller in F_b, shape (4, 4).
        flange: Flange of the controller in that of the robot file, shape (4, 4).
        tip: Where the force acts, flange frame of the robot file [m], (3,); the tool's origin where
            not given, and without a tool the campaign's load point.
        start: Axes of the controller before the first motion [m] or [rad], in their order.
        in_tool: Forces are in the tool frame, not in F_b.
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
    """Targets of which the joint values are known.

    Attributes:
        q: Joint values [m] or [rad], shape (m, n).
        world: Frames that their coordinates stand in, in F_b, shape (m, 4, 4).
        tool: Their tools in the flange frame of the robot file, shape (m, 4, 4).
        tip: Where the force acts, in the same [m], shape (m, 3).
    """

    q: Array
    world: Array
    tool: Array
    tip: Array


class Refused(InputError):
    """Targets at which the robot cannot be, or not as corrected.

    Attributes:
        others: What is wrong with those before the last, which the error itself is about.
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
    """Joint values of targets, each looked for from the one before it.

    Args:
        model: Whose robot it is, and whose load point.
        notation: How the targets are written.
        targets: In the order of the motions.
        setting: Frames and start.
        known: The program, for the frames that it defines.

    Raises:
        Refused: The robot cannot reach some of them, or nothing says where.
    """
    aiming = _Aiming(model, notation, setting, known)
    found = [aiming.next(target) for target in targets]
    q, world, tool, tip = (np.array(part) for part in zip(*found, strict=True))
    if aiming.rejected:
        raise Refused(aiming.rejected)
    return Aimed(q, world, tool, tip)


class _Aiming:
    """Where the robot stands while one target after the other is looked for."""

    def __init__(
        self, model: IdentifiedModel, notation: Notation, setting: Setting, program: Program | None
    ) -> None:
        robot = model.robot
        self.notation, self.setting, self.program = notation, setting, program
        self.robot, self.axes = robot, axes.of(robot)
        self.arm = Arm(robot, self.axes)
        self.load_point = model.tool.load_point
        self.rejected: list[InputError] = []
        self.known = setting.start is not None
        self.rail_known = not robot.prismatic.any() or self.known
        if setting.start is None:
            self.q = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
        else:
            self.q = self.axes.joints(np.atleast_2d(setting.start))[0]

    def next(self, target: Target) -> tuple[Array, Array, Array, Array]:
        """Joint values, frame, tool and tip of a target; what is wrong with it is noted."""
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
        """What the coordinates of a target stand in, and its tool; None where none is needed."""
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
        """What is said of a tool or frame that nobody gives."""
        which = f"{word} {name}" if name else f"its {word}"
        equals = f"{name}=" if name and " " not in name else ""
        way_out = f"give it as {option} {equals}{self.notation.letters}"
        return wrong(target, f"{which} is not defined", way_out)

    def _rail(self, target: Target) -> None:
        """Put the sliding joints where the target has them, or leave them where they are."""
        slides = self.axes.slides
        count = int(slides.sum())
        if count and len(target.external) >= count:
            values = np.zeros(len(slides))
            values[slides] = 1e-3 * np.array(target.external[:count])
            q = self.axes.joints(values[None])[0]
            self.q = np.where(self.robot.prismatic, q, self.q)
            self.rail_known = True
        if not self.rail_known:
            raise wrong(
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
        """Joint values of the arm's axes as a program writes them; the others as they stand."""
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
            raise wrong(target, thing, way_out) from problem
        flange = world @ frame @ linear.solve(tool, np.eye(4))
        start = self._joints(target, target.near) if target.near else self.q
        known = self.known or bool(target.near)
        found = self.arm.reach(flange, start, known, target.ranges)
        if found.why_not is not None:
            raise wrong(target, *found.why_not)
        self.q = found.q

    def _within(self, target: Target, q: Array, only: Bools) -> None:
        """Refuse joint values beyond the limits."""
        if said := beyond(self.robot, np.where(only, q, np.nan)):
            raise wrong(target, said, "correct the target")


def _frame(name: str, given: Mapping[str, Array], own: Mapping[str, Array]) -> Array | None:
    """A frame by its name: as given, as the program defines it, or the one for all others."""
    return given.get(name.lower(), own.get(name, given.get("")))


def wrong(target: Target, thing: str, way_out: str) -> InputError:
    """What is wrong with a target, with its line."""
    return InputError(f"{target.name}: {thing}", way_out, file=target.file, line=target.line)


def beyond(robot: Robot, q: Array) -> str | None:
    """Which joint is furthest beyond its limits, in words; NaN is not looked at."""
    over = np.nan_to_num(np.maximum(robot.lower - q, q - robot.upper), nan=-np.inf)
    j = int(over.argmax())
    if over[j] <= _BEYOND:
        return None
    joint = robot.joints[j]
    size = f"{1e3 * over[j]:.1f} mm" if joint.prismatic else f"{np.rad2deg(over[j]):.2f} deg"
    return f"joint {joint.name} is {size} beyond its limit"


def with_start(setting: Setting, robot: Robot, values: Sequence[float]) -> Setting:
    """A setting with the axes before the first motion, in degrees and mm as controllers show them.

    Raises:
        UsageError: There are not as many as the robot has axes.
    """
    of = axes.of(robot)
    if len(values) != len(of.names):
        raise UsageError(f"--start has {len(values)} numbers: give {listed(of.names)} [deg, mm]")
    given = np.array(values)
    return replace(setting, start=np.where(of.slides, 1e-3 * given, np.deg2rad(given)))
