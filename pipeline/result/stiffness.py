"""`stiffness` and `budget`: one entry per joint, or why it has no value."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.cell import Cell
from pipeline.report.numbers import with_std
from pipeline.result.numbers import finite
from pipeline.results import Estimate, System
from pipeline.robot import Joint
from pipeline.stages.budget import Budget, budget


def stiffness_entries(cell: Cell, system: System, estimate: Estimate) -> list[dict[str, Any]]:
    """One entry per joint: the stiffness with its budget, or why there is none."""
    split = budget(system, estimate)
    lever = np.linalg.norm(system.B, axis=0)
    return [
        _stiffness(number, joint, estimate, number - 1, float(lever[number - 1]))
        | {"budget": _budget(estimate, split, number - 1)}
        for number, joint in enumerate(cell.robot.joints, 1)
    ]


def _budget(estimate: Estimate, split: Budget, k: int) -> list[dict[str, Any]]:
    """What each source adds to one stiffness: standard uncertainty [its unit], part of variance."""
    x = float(estimate.value[k])
    if not estimate.identifiable[k] or x <= 0:
        return []
    std, share = split.std[:, k] / x**2, split.share[:, k]
    return [
        {"source": name, "std": float(std[i]), "share": float(share[i])}
        for i, name in enumerate(split.source)
    ]


def budget_entries(stiffness: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The same by source: share of each stiffness' variance in percent."""
    rows: dict[str, dict[str, Any]] = {}
    for entry in stiffness:
        for part in entry["budget"]:
            row = rows.setdefault(part["source"], {"source": part["source"].replace("_", " ")})
            row[f"{entry['name']} [%]"] = 100 * part["share"]
    return list(rows.values())


def _stiffness(
    number: int, joint: Joint, estimate: Estimate, k: int, lever: float
) -> dict[str, Any]:
    x, std = float(estimate.value[k]), float(estimate.std[k])
    identifiable = bool(estimate.identifiable[k])
    low, high = x - estimate.quantile * std, x + estimate.quantile * std
    has_value = identifiable and x > 0
    return {
        "joint": number,
        "name": f"k_{joint.name}",
        "unit": joint.stiffness_unit,
        "value": 1 / x if has_value else None,
        "std": std / x**2 if has_value else None,
        "ci95": [1 / high if 0 < high < np.inf else None, 1 / low if low > 0 else None],
        "identifiable": identifiable,
        "joint_type": "prismatic" if joint.prismatic else "revolute",
        "compliance": x if np.isfinite(std) else None,
        "compliance_std": finite(std),
        "compliance_unit": joint.compliance_unit,
        "relative_std": std / x if has_value else None,
        "nominal": joint.stiffness,
        "finding": _finding(joint, x, std, low, high, identifiable, lever),
    }


def _finding(
    joint: Joint, x: float, std: float, low: float, high: float, identifiable: bool, lever: float
) -> str | None:
    name = f"k_{joint.name}"
    work = "pulls along the rail" if joint.prismatic else "pulls with a lever about its axis"
    if not np.isfinite(std):
        if lever * x < 1e-12:
            return (
                f"{name} is not identifiable: in every pose the line of pull has no lever about "
                f"joint {joint.name}; attach the chain off that joint's axis."
            )
        return f"{name} is not identifiable: these poses mix it with another joint; add {work}."
    if high < 0:
        return (
            f"The compliance of {joint.name} is negative ({with_std(x, std)} "
            f"{joint.compliance_unit}), which no spring can be: the model misses something that "
            f"acts there, so no stiffness is stated."
        )
    if not identifiable:
        return (
            f"{name} is not identifiable: its compliance is {with_std(x, std)} "
            f"{joint.compliance_unit}; add {work}, or pull harder."
        )
    if low <= 0:
        return (
            f"{name} has no upper limit: its compliance of {with_std(x, std)} "
            f"{joint.compliance_unit} may be zero; add {work}, or pull harder."
        )
    return None
