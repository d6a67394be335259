"""A path of joint values and forces."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.base.arrays import Array, Ints, Locked


@dataclass(frozen=True, eq=False)
class Path(Locked):
    """A path to be corrected or judged.

    Attributes:
        pose: Number of each point, shape (m,).
        q: Joint values [m] or [rad], shape (m, n).
        force: Force on the robot at the tip [N], F_b, shape (m, 3).
        controller: True if the file has the controller's axes instead of the model's joints.
        file: Name of the file.
        line: Line of each point in it; empty if there are no lines.
    """

    pose: Ints
    q: Array
    force: Array
    controller: bool = False
    file: str = ""
    line: tuple[int, ...] = ()


ARM_M = 0.3
"""Lever arm at which a rotation of the tool is compared with a displacement [m]."""
