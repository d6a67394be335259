"""Poses outside the joint limits of the robot file: slightly, or by far.

A controller stops a joint at its software limit, and robot files round the limits: a joint slightly
beyond one is only reported. One that is farther off was mistyped, or has another unit or sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Ints
from pipeline.base.errors import InputError
from pipeline.base.quantities import plain
from pipeline.machine.robot import Joint, Robot
from pipeline.machine.robot.axes import LIMIT_SLACK
from pipeline.readers.logs import Log, joint_values
from pipeline.reduction.case import Case

LEEWAY = float(np.deg2rad(1.0))
"""Maximum excess over a joint limit of the robot file: 1 deg [rad]; for a sliding joint as many
metres, the distance by which 1 deg moves a point at a metre."""


@dataclass(frozen=True)
class _BeyondLimit:
    """A joint beyond a limit of the robot file.

    Attributes:
        pose: Number of the pose.
        joint: The joint.
        value: Its value [m] or [rad].
        file: The joint log.
        line: Its line there.
    """

    pose: int
    joint: Joint
    value: float
    file: str
    line: int

    @property
    def over(self) -> float:
        """Excess over the limit [m] or [rad]."""
        return max(self.joint.lower - self.value, self.value - self.joint.upper)

    @property
    def out(self) -> bool:
        """Whether the pose is impossible: beyond the limit by more than `LEEWAY`."""
        return self.over > LEEWAY

    @property
    def said(self) -> str:
        """First half of the message, with its numbers."""
        unit, one = ("m", 1.0) if self.joint.prismatic else ("deg", float(np.rad2deg(1.0)))
        return (
            f"pose {self.pose}: joint {self.joint.name} is at {self.value * one:.6g} {unit}, "
            f"{plain(self.over * one, 2)} {unit} outside its limits "
            f"{self.joint.lower * one:.6g} to {self.joint.upper * one:.6g} {unit}"
        )


_WAY_OUT = "correct the value or the unit in the column name, or the limits in the robot file"


def beyond(case: Case) -> list[_BeyondLimit]:
    """Every joint of a campaign that is beyond a limit of its robot."""
    rows = case.joints
    if not len(rows):
        return []
    pose, line = (rows[name].to_numpy() for name in ("pose", "line"))
    q = rows[case.joint_columns].to_numpy(float)
    return _beyond(case.robot, str(rows["file"].iloc[0]), pose, line, q)


def _beyond(robot: Robot, file: str, pose: Array, line: Ints, q: Array) -> list[_BeyondLimit]:
    """The same of joint values (p, n) [m] or [rad], each pose with its line in the log."""
    outside = (q < robot.lower - LIMIT_SLACK) | (q > robot.upper + LIMIT_SLACK)
    return [
        _BeyondLimit(int(pose[k]), robot.joints[j], float(q[k, j]), file, int(line[k]))
        for k, j in np.argwhere(outside).tolist()
    ]


def impossible(log: Log, robot: Robot) -> dict[int, _BeyondLimit]:
    """Impossible rows of a joint log, by row number, each with its worst joint."""
    every = _beyond(robot, log.file, log.number["pose"], log.line, joint_values(log, robot))
    row = {line: k for k, line in enumerate(log.line.tolist())}
    worst = sorted((one for one in every if one.out), key=lambda one: one.over)
    return {row[one.line]: one for one in worst}


def reason(one: _BeyondLimit) -> str:
    """Reason for which a row is left out."""
    return f"{one.said}; {_WAY_OUT}"


def doubt(found: Sequence[_BeyondLimit]) -> InputError | None:
    """The error to report where such rows are let through; None without any."""
    if not found:
        return None
    first = min(found, key=lambda one: one.line)
    return InputError(first.said, _WAY_OUT, file=first.file, line=first.line)
