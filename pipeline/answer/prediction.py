"""`validation` and `test_pose_deflection`: how far predictions can be trusted."""

from __future__ import annotations

import pandas as pd

from pipeline.answer.contract import Deflection, Drawn, Validation
from pipeline.answer.numbers import finite, left_out_mm
from pipeline.base.arrays import Array
from pipeline.prediction.model import Model
from pipeline.reduction.pose_of_interest import Where


def validation_entry(checked: pd.DataFrame, left_out_m: Array, where: Where) -> Validation:
    """Means of Eq. (22) per target, from the full covariance and as in Eq. (23).

    Args:
        checked: Table VALIDATION.
        left_out_m: Residuals of poses that were left out [m]; NaN where nothing predicts them.
        where: The test pose.
    """
    full = _drawn(checked, "covariance")
    return Validation(
        test_pose=full.test_pose,
        global_=full.global_,
        held_out_rms_mm=left_out_mm(left_out_m),
        independent=_drawn(checked, "independent"),
        poses=int(checked["index"].max()),
        test_pose_stated=where.stated,
    )


def _drawn(checked: pd.DataFrame, draw: str) -> Drawn:
    """The means where the stiffnesses are drawn in one way."""
    drawn = checked[checked["draw"] == draw]
    near, far = (drawn[drawn["set"] == name] for name in ("test_pose", "global"))
    return Drawn(test_pose=_means(near), global_=_means(far))


def _means(rows: pd.DataFrame) -> dict[str, float]:
    """Of each target, in their order."""
    means = rows.groupby("target", sort=False)["mu"].mean()
    return {str(target): float(mean) for target, mean in means.items()}


def deflection_entries(model: Model, where: Where) -> tuple[Deflection, ...]:
    """Predicted deflection at the test pose with its standard uncertainty."""
    moved, std = (1e3 * part for part in model.deflection(where.q, where.force))
    return tuple(
        Deflection(target=name, dx_mm=x, dy_mm=y, dz_mm=z, std_mm=(finite(a), finite(b), finite(c)))
        for name, (x, y, z), (a, b, c) in zip(model.tool.targets, moved.tolist(), std, strict=True)
    )
