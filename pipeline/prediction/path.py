"""A path of joint values and forces, and whether its forces are in the range of the campaign."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.base.arrays import Array, Ints, Locked, compared
from pipeline.base.quantities import plain


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


def against_pulls(force_n: Array, pulled: tuple[float, float] | None) -> list[str]:
    """Warning if forces [N], shape (m,), are outside the range of the pulls, as a list.

    A model is valid where it was tested: above the largest pull its error grows with the force. If
    all forces are below the smallest pull by the ratio of two units, they may be in another unit.
    """
    if pulled is None:
        return []
    hardest, lowest, highest = compared([force_n.max(), pulled[0] / _LBF_N, pulled[1]])
    if lowest < hardest <= highest:
        return []
    least, most, reached = (plain(one) for one in (*pulled, hardest))
    text = f"The forces reach {reached} N; the campaign pulled with {least} to {most} N"
    if hardest < pulled[0]:
        return [f"{text}: check their unit."]
    return [f"{text}: beyond that its model was not tested, and its error grows with the force."]


_LBF_N = 4.4482
"""A pound-force [N] (NIST SP 811): the smallest ratio between two units of force."""

ARM_M = 0.3
"""Lever arm at which a rotation of the tool is compared with a displacement [m]."""
