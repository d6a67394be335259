"""Conformity with a tolerance, in one sentence."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from pipeline.answer.contract import JudgedPath, Stretch, TestPose, Tip, Tolerance
from pipeline.answer.words import listed
from pipeline.base.quantities import plain, with_uncertainty
from pipeline.prediction.decision import GUARD, Decision

DECIDED = {
    Decision.PASS: "pass",
    Decision.FAIL: "fail",
    Decision.UNDECIDED: "undecided",
}
"""Decisions in one word."""

_MOST = 4
"""Maximum number of stretches of a path that are listed singly."""


def expanded(one: Tip) -> str:
    """`0.614 mm, U = 0.075 mm (k = 2)`; without U if a stiffness is not determined."""
    if one.deflection_mm is None:
        return "an unknown amount"
    if one.expanded_mm is None:
        return (
            f"{plain(one.deflection_mm)} mm, with unknown uncertainty: a stiffness that "
            f"contributes there "
            "is not determined"
        )
    value, u = with_uncertainty(one.deflection_mm, one.expanded_mm)
    return f"{value} mm, U = {u} mm (k = 2)"


def tolerated(asked: Tolerance, pose: TestPose | None = None) -> str:
    """The tolerance, and the decisions at the test pose and along the path."""
    decided = " ".join(_decided(asked, pose))
    return (
        f"campaign.toml allows a deflection of {asked.deflection_mm:g} mm; decision rule of ISO "
        f"14253-1. {decided}"
    )


def largest_force(asked: Tolerance, pose: Tip, force_n: float) -> float | None:
    """Largest force at the test pose that would pass, for a deflection proportional to it [N].

    Args:
        asked: The tolerance T.
        pose: Predicted deflection d and its standard uncertainty u, which is kept, since most of
            it does not decrease with the force.
        force_n: Force F at the test pose [N].

    Returns:
        F (T - 1.65 u) / d; None if F passes, or if no force would.
    """
    if asked.test_pose in (None, Decision.PASS) or not pose.deflection_mm or not pose.std_mm:
        return None
    share = (asked.deflection_mm - GUARD * pose.std_mm) / pose.deflection_mm
    return share * force_n if 0 < share < 1 else None


def _decided(asked: Tolerance, pose: TestPose | None) -> Iterator[str]:
    if asked.test_pose is not None:
        by = "" if pose is None else f" with {expanded(pose)}"
        yield f"Test pose: {DECIDED[asked.test_pose]}{by}."
    if asked.path is not None:
        yield f"{asked.path.file}: {_along(asked.path)}; {_largest(asked.path)}."


def _along(path: JudgedPath) -> str:
    """Decision on each stretch, or number of points per decision if there are many stretches."""
    if len(path.stretches) == 1:
        return f"{DECIDED[path.decision]} at all {path.points} points"
    if len(path.stretches) <= _MOST:
        return listed([_stretch(one) for one in path.stretches])
    count: Counter[Decision] = Counter()
    for one in path.stretches:
        count[one.decision] += one.points
    found = listed([f"{count[one]} {DECIDED[one]}" for one in Decision if count[one]])
    return f"of {path.points} points {found}"


def _stretch(one: Stretch) -> str:
    points = f"pose {one.first}" if one.points == 1 else f"poses {one.first} to {one.last}"
    return f"{DECIDED[one.decision]} at {points}"


def _largest(path: JudgedPath) -> str:
    worst = max(path.stretches, key=lambda one: one.deflection_mm or 0.0)
    return f"up to {expanded(worst)}, at pose {worst.at}"
