"""A path of joint values and forces, and how these compare with those that a model is from."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.quantities import plain


@dataclass(frozen=True, eq=False)
class Path(Locked):
    """A path to be corrected or judged.

    Attributes:
        pose: Number of each point, shape (m,).
        q: Joint values [m] or [rad], shape (m, n).
        force: Force on the robot at the tip [N], F_b, shape (m, 3).
        controller: The file has the controller's axes instead of the model's joints.
        file: Its name.
        line: Of each point in it; none where they stand in no line.
    """

    pose: Ints
    q: Array
    force: Array
    controller: bool = False
    file: str = ""
    line: tuple[int, ...] = ()


def beside_pulls(force_n: Array, pulled: tuple[float, float] | None) -> list[str]:
    """A sentence where forces [N], shape (m,), are all gentler or some harder than any pull.

    A model is known where it was pulled: beyond the hardest pull its error grows with the force,
    and a path whose forces are that much gentler than any pull may be in another unit.
    """
    if pulled is None or pulled[0] / _LBF_N < (hardest := float(force_n.max())) <= pulled[1]:
        return []
    least, most = (plain(one) for one in pulled)
    told = f"The forces reach {plain(hardest)} N; the campaign pulled with {least} to {most} N"
    if hardest < pulled[0]:
        return [f"{told}: check their unit."]
    return [f"{told}: beyond that its model was not tested, and its error grows with the force."]


_LBF_N = 4.4482
"""A pound-force [N] (NIST SP 811): no two units of force are nearer each other."""

ARM_M = 0.3
"""Turning the tool by an angle counts as moving a point this far from it [m]."""
