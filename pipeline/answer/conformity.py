"""Predicted deflections at the test pose and along the path, and conformity by ISO 14253-1."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.answer import contract
from pipeline.answer.contract import AxisValue, JudgedPath, Stretch, TestPose
from pipeline.base.arrays import Array
from pipeline.base.quantities import MM
from pipeline.machine.robot import Robot, axes
from pipeline.prediction.decision import Decision
from pipeline.prediction.path import beside_pulls
from pipeline.prediction.tolerance import JudgedTolerance, stretches
from pipeline.reduction import settings
from pipeline.reduction.pose_of_interest import PoseOfInterest


def pose_entry(robot: Robot, where: PoseOfInterest, found: JudgedTolerance) -> TestPose:
    """The test pose with its force and the deflection of the load point."""
    x, y, z = where.force.tolist()
    return TestPose(
        deflection_mm=MM * float(found.at.size[0]),
        std_mm=MM * float(found.at.std[0]),
        axes=axis_values(robot, where.q),
        force_n=(x, y, z),
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


def path_findings(asked: contract.Tolerance | None, pulled: tuple[float, float]) -> list[str]:
    """A sentence if the path's forces [N] exceed those of the pulls or are far below them."""
    path = None if asked is None else asked.path
    force = None if path is None else path.force_n
    return [] if force is None else beside_pulls(np.array(force), pulled)


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
