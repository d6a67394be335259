"""`validation` and `test_pose_deflection`: how far predictions can be trusted."""

from __future__ import annotations

from typing import Any

import pandas as pd

from pipeline.answer.numbers import finite, left_out_mm
from pipeline.base.arrays import Array
from pipeline.prediction.model import Model
from pipeline.reduction.pose_of_interest import Where


def validation_entry(checked: pd.DataFrame, left_out_m: Array, where: Where) -> dict[str, Any]:
    """Means of Eq. (22) per target, from the full covariance and as in Eq. (23).

    Args:
        checked: Table VALIDATION.
        left_out_m: Residuals of poses that were left out [m]; NaN where nothing predicts them.
        where: The test pose.
    """

    def both(draw: str) -> dict[str, dict[Any, float]]:
        drawn = checked[checked["draw"] == draw]
        sets = {name: drawn[drawn["set"] == name] for name in ("test_pose", "global")}
        return {
            name: rows.groupby("target", sort=False)["mu"].mean().to_dict()
            for name, rows in sets.items()
        }

    return {
        **both("covariance"),
        "held_out_rms_mm": left_out_mm(left_out_m),
        "independent": both("independent"),
        "poses": int(checked["index"].max()),
        "test_pose_stated": where.stated,
    }


def deflection_entries(model: Model, where: Where) -> list[dict[str, Any]]:
    """Predicted deflection at the test pose with its standard uncertainty."""
    moved, std = model.deflection(where.q, where.force)
    out = []
    for name, move, spread in zip(model.tool.targets, 1e3 * moved, 1e3 * std, strict=True):
        axes = dict(zip(("dx_mm", "dy_mm", "dz_mm"), move.tolist(), strict=True))
        out.append({"target": name, **axes, "std_mm": [finite(s) for s in spread]})
    return out
