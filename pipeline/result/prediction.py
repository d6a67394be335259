"""`validation` and `test_pose_deflection`: how far predictions can be trusted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.cell import Cell, jacobian, predict
from pipeline.effects import Pulls
from pipeline.result.numbers import left_out_mm
from pipeline.stages.validate import Where
from pipeline.stages.workspace import Known


def validation_entry(
    checked: pd.DataFrame, residuals: pd.DataFrame, where: Where
) -> dict[str, Any]:
    """Means of Eq. (22) per target, from the full covariance and as in Eq. (23)."""

    def both(draw: str) -> dict[str, dict[Any, float]]:
        drawn = checked[checked["draw"] == draw]
        sets = {name: drawn[drawn["set"] == name] for name in ("test_pose", "global")}
        return {
            name: rows.groupby("target", sort=False)["mu"].mean().to_dict()
            for name, rows in sets.items()
        }

    return {
        **both("covariance"),
        "held_out_rms_mm": left_out_mm(residuals),
        "independent": both("independent"),
        "poses": int(checked["index"].max()),
        "test_pose_stated": where.stated,
    }


def deflection_entries(cell: Cell, estimate: Known, where: Where) -> list[dict[str, Any]]:
    """Predicted deflection at the test pose with its standard uncertainty.

    Where the geometry is that of the undeformed robot, the uncertainty holds all that this leaves
    out at the test pose.
    """
    unset, zero = np.zeros(1), np.zeros(1, dtype=np.int64)
    pulls = Pulls(zero, zero, where.q[None], where.force[None], unset, unset, unset, unset)
    kinds = (cell, replace(cell, equilibrium="deformed"))
    moved, bent = (predict(one, pulls, estimate.value).displacement[0] for one in kinds)
    A = jacobian(cell, pulls, estimate.value)[0]
    known = np.isfinite(estimate.std)
    cov = estimate.cov[np.ix_(known, known)]
    out = []
    for name, move, rows, more in zip(cell.tool.targets, 1e3 * moved, A, bent - moved, strict=True):
        std = 1e3 * np.sqrt(np.diag(rows[:, known] @ cov @ rows[:, known].T) + more**2)
        axes = dict(zip(("dx_mm", "dy_mm", "dz_mm"), move.tolist(), strict=True))
        out.append({"target": name, **axes, "std_mm": std.tolist()})
    return out
