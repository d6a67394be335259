"""`stiffness` and `budget`: one entry per joint, or why it has no value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.cell import Cell
from pipeline.diagnosis.hedge import Doubt
from pipeline.report.numbers import with_std
from pipeline.result.numbers import finite
from pipeline.results import Estimate, System
from pipeline.robot import Joint
from pipeline.stages.budget import Budget, budget

WHICH = "which_cause"
"""Source of the uncertainty that comes of not knowing which cause is true."""

SHOWN = 1e-3
"""A smaller share of the variance than this is rounding."""


def stiffness_entries(
    cell: Cell, system: System, estimate: Estimate, doubts: Sequence[Doubt] = ()
) -> list[dict[str, Any]]:
    """One entry per joint: the stiffness with its budget, or why there is none.

    Args:
        cell: For the names and units of the joints.
        system: The system that the estimate is from.
        estimate: The springs first.
        doubts: Springs that depend on which of two causes is true.
    """
    split = budget(system, estimate)
    lever = np.linalg.norm(system.B, axis=0)
    return [
        _stiffness(number, joint, estimate, number - 1, float(lever[number - 1]))
        | {"budget": _budget(estimate, split, number - 1)}
        | _doubted(joint, estimate, [d for d in doubts if d.spring == number - 1])
        for number, joint in enumerate(cell.robot.joints, 1)
    ]


def _budget(estimate: Estimate, split: Budget, k: int) -> list[dict[str, Any]]:
    """What each source adds to one stiffness: standard uncertainty [its unit], part of variance."""
    x = float(estimate.value[k])
    if not estimate.identifiable[k] or x <= 0:
        return []
    total = float(estimate.cov[k, k])
    std, share = split.std[:, k] / x**2, split.std[:, k] ** 2 / total
    parts = [
        {"source": name, "std": float(std[i]), "share": float(share[i])}
        for i, name in enumerate(split.source)
    ]
    rest = 1 - float(share.sum())
    if rest > SHOWN:
        parts.append({"source": WHICH, "std": float(np.sqrt(rest * total)) / x**2, "share": rest})
    return parts


def _doubted(joint: Joint, estimate: Estimate, doubts: Sequence[Doubt]) -> dict[str, Any]:
    """What to say of a spring that depends on which of two causes is true."""
    if not doubts:
        return {}
    name, cause = f"k_{joint.name}", doubts[0].cause
    lost = list(dict.fromkeys(d.rival for d in doubts if d.lost))
    others = " or ".join(dict.fromkeys(d.rival for d in doubts))
    if lost:
        return {
            "finding": f"{name} is not identifiable: the data do not exclude {' or '.join(lost)} "
            f"in the place of {cause}, and beside it these poses do not tell it from the joint."
        }
    if not estimate.identifiable[doubts[0].spring]:
        return {
            "finding": f"{name} is not identifiable: how large it is depends on whether {cause} "
            f"is true or {others}, which the data do not exclude."
        }
    return {
        "finding": f"{name} depends on whether {cause} is true or {others}, which the data do not "
        "exclude; its interval holds for each."
    }


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
