"""Predicted deflections at the test pose and along the path, and conformity by ISO 14253-1."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from pipeline.answer import contract
from pipeline.answer.contract import AxisValue, JudgedPath, Stretch, TestPose, Tip, Tolerance
from pipeline.answer.words import listed
from pipeline.base.arrays import Array
from pipeline.base.quantities import MM, plain, with_uncertainty
from pipeline.machine.robot import Robot, axes
from pipeline.prediction.decision import GUARD, Decision, decide
from pipeline.prediction.tolerance import JudgedTolerance, stretches
from pipeline.reduction import settings
from pipeline.reduction.pose_of_interest import PoseOfInterest


def pose_entry(robot: Robot, where: PoseOfInterest, found: JudgedTolerance) -> TestPose:
    """The test pose with its force and the deflection of the load point."""
    x, y, z = where.force.tolist()
    dx, dy, dz = (MM * found.at.moved[0]).tolist()
    return TestPose(
        deflection_mm=MM * float(found.at.size[0]),
        std_mm=MM * float(found.at.std[0]),
        axes=axis_values(robot, where.q),
        force_n=(x, y, z),
        vector_mm=(dx, dy, dz),
        along_force_mm=float(np.dot((dx, dy, dz), where.force) / np.linalg.norm(where.force)),
        stated=where.stated,
    )


def axis_values(robot: Robot, q: Array) -> tuple[AxisValue, ...]:
    """Values of the controller's axes [m] or [deg], or of the joints if the file maps no axes."""
    of = axes.of(robot)
    values = of.values(q[None])[0]
    return tuple(
        AxisValue(
            name=name,
            value=round(float(value if slides else np.rad2deg(value)), 9),
            unit="m" if slides else "deg",
        )
        for name, slides, value in zip(of.names, of.slides, values, strict=True)
    )


def tolerance_entry(
    asked: settings.ToleranceSettings | None, where: PoseOfInterest, found: JudgedTolerance
) -> contract.Tolerance | None:
    """Conformity with the tolerance; None if campaign.toml states none."""
    if asked is None:
        return None
    here = found.at.decisions(asked.deflection_mm / MM)[0]
    path = None
    if asked.path is not None and found.path is not None:
        path = _path(asked.path, found.path)
    return contract.Tolerance(
        deflection_mm=asked.deflection_mm, test_pose=here if where.stated else None, path=path
    )


def _path(file: str, rows: pd.DataFrame) -> JudgedPath:
    size = np.linalg.norm(rows[["fx_n", "fy_n", "fz_n"]].to_numpy(), axis=1)
    found = tuple(
        _stretch(rows.iloc[one.first : one.last + 1], one.decision)
        for one in stretches(rows["decision"].to_numpy(object))
    )
    return JudgedPath(
        file=file,
        points=len(rows),
        force_n=(float(size.min()), float(size.max())),
        decision=_worst([one.decision for one in found]),
        stretches=found,
    )


def _stretch(rows: pd.DataFrame, decision: Decision) -> Stretch:
    """Consecutive points with the same decision; the values are those of the largest deflection."""
    worst = rows.iloc[int(rows["deflection_m"].argmax())]
    pose = rows["pose"].tolist()
    return Stretch(
        deflection_mm=MM * float(worst["deflection_m"]),
        std_mm=MM * float(worst["std_m"]),
        decision=decision,
        first=pose[0],
        last=pose[-1],
        points=len(rows),
        at=int(worst["pose"]),
    )


def _worst(decisions: Sequence[Decision]) -> Decision:
    """Decision on a whole path: it fails if any point fails, and passes if every point passes."""
    order = (Decision.FAIL, Decision.UNDECIDED, Decision.PASS)
    return next(one for one in order if one in decisions)


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


def tolerated(asked: Tolerance, pose: TestPose | None = None, *, holds: bool = True) -> str:
    """The tolerance, and the decisions at the test pose and along the path.

    Args:
        asked: The tolerance.
        pose: The test pose with its deflection.
        holds: Whether the model explains the readings; nothing is decided otherwise.
    """
    most = f"campaign.toml allows a deflection of {asked.deflection_mm:g} mm"
    if not holds:
        return f"{most}; conformity is undecided, since the model does not explain the readings."
    decided = " ".join(_decided(asked, pose))
    return f"{most}; decision rule of ISO 14253-1, guard band {GUARD} u. {decided}"


def compared(one: Tip, decision: Decision, most_mm: float, *, holds: bool = True) -> str:
    """`2.2204 - 1.65 × 0.0606 = 2.1204 mm is above 2.12 mm`: how d and u lead to a decision.

    With as many digits as the decision needs. Otherwise why it does not follow from d and u, see
    `TipDeflection.decisions`; empty where d or u is unknown.

    Args:
        one: Deflection d and its standard uncertainty u [mm].
        decision: Decision on it.
        most_mm: The tolerance T [mm].
        holds: Whether the model explains the readings.
    """
    d, u = one.deflection_mm, one.std_mm
    if not holds:
        return "the model does not explain the readings"
    if d is None or not u:
        return ""
    if differently(one, decision, most_mm):
        return "the possible causes decide differently"
    places = max(1 - math.floor(math.log10(u)), 0)
    while not _shows(d, u, most_mm, places) and places < _PLACES:
        places += 1
    low, high = (f"{_limit(d, u, sign, places):.{places}f} mm" for sign in (-1, 1))
    value, band = f"{d:.{places}f}", f"{GUARD} × {u:.{places}f}"
    return {
        Decision.PASS: f"{value} + {band} = {high} is at most {most_mm:g} mm",
        Decision.FAIL: f"{value} - {band} = {low} is above {most_mm:g} mm",
        Decision.UNDECIDED: f"{value} ± {band} is {low} to {high}, on both sides of {most_mm:g} mm",
    }[decision]


def differently(one: Tip, decision: Decision, most_mm: float) -> bool:
    """Whether a decision is open although d and u decide, because possible causes disagree."""
    d, u = one.deflection_mm, one.std_mm
    return d is not None and u is not None and decide(d, u, most_mm) is not decision


def causes_differ(asked: Tolerance, pose: Tip) -> bool:
    """Whether a decision is open because possible causes disagree."""
    stretches = asked.path.stretches if asked.path else ()
    every = [(pose, asked.test_pose), *((one, one.decision) for one in stretches)]
    return any(
        differently(one, decision, asked.deflection_mm)
        for one, decision in every
        if decision is Decision.UNDECIDED
    )


_PLACES = 9
"""Maximum number of decimal places of a deflection [mm]."""


def _limit(d: float, u: float, sign: int, places: int) -> float:
    """Limit d + 1.65 u or d - 1.65 u from d and u as they are printed."""
    return round(round(d, places) + sign * GUARD * round(u, places), places)


def _shows(d: float, u: float, most: float, places: int) -> bool:
    """Whether d, u and the limits agree with each other and with the decision as printed."""
    pairs = [(_limit(d, u, sign, places), d + sign * GUARD * u) for sign in (-1, 1)]
    return all(
        (shown > most) == (exact > most) and abs(shown - exact) <= 10.0**-places
        for shown, exact in pairs
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
        by = "" if pose is None else f" with {_by(pose, asked.test_pose, asked)}"
        yield f"Test pose: {DECIDED[asked.test_pose]}{by}."
    if asked.path is not None:
        worst = asked.path.largest
        up_to = _by(worst, worst.decision, asked)
        yield f"{asked.path.file}: {_along(asked.path)}; at pose {worst.at} up to {up_to}."


def _by(one: Tip, decision: Decision, asked: Tolerance) -> str:
    """The deflection, and how it leads to the decision."""
    return ": ".join(filter(None, (expanded(one), compared(one, decision, asked.deflection_mm))))


def _along(path: JudgedPath) -> str:
    """Decision on each stretch, or number of points per decision if there are many stretches."""
    if len(path.stretches) == 1:
        return f"{DECIDED[path.decision]} at all {path.points} points"
    if len(path.stretches) <= _MOST:
        return listed([_stretch_said(one) for one in path.stretches])
    count: Counter[Decision] = Counter()
    for one in path.stretches:
        count[one.decision] += one.points
    found = listed([f"{count[one]} {DECIDED[one]}" for one in Decision if count[one]])
    return f"of {path.points} points {found}"


def _stretch_said(one: Stretch) -> str:
    points = f"pose {one.first}" if one.points == 1 else f"poses {one.first} to {one.last}"
    return f"{DECIDED[one.decision]} at {points}"
