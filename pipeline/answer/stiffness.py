"""`stiffness` and `budget`: one entry per joint, or why it has no value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.answer.numbers import finite
from pipeline.base.arrays import Array
from pipeline.base.quantities import with_std
from pipeline.diagnosis.average import Dependence, Hypothesis, Springs, dependences, springs
from pipeline.machine.cell import Cell
from pipeline.machine.robot import Joint
from pipeline.system.budget import budget

_WHICH = "which_cause"
"""Source of the uncertainty that comes of not knowing which cause is true."""

_SHOWN = 1e-3
"""A smaller share of the variance than this is rounding."""


def stiffness_entries(cell: Cell, hypotheses: Sequence[Hypothesis]) -> list[dict[str, Any]]:
    """One entry per joint: the stiffness with its budget, or why there is none.

    Args:
        cell: For the names and units of the joints.
        hypotheses: What may be true, the identified causes first; one for a single model.
    """
    found = springs(hypotheses)
    parts = _parts(hypotheses, cell.robot.n)
    lever = np.linalg.norm(hypotheses[0].system.B, axis=0)
    depends = dependences(hypotheses)
    out = []
    for k, joint in enumerate(cell.robot.joints):
        entry = _stiffness(k + 1, joint, found, k, float(lever[k]))
        on = [one for one in depends if one.spring == k]
        entry |= _depends(joint, found, entry["finding"], on)
        out.append(entry | {"budget": _budget(found, parts, k)})
    return out


def _parts(hypotheses: Sequence[Hypothesis], n: int) -> dict[str, Array]:
    """What each source adds to the variance of each compliance, shape (n,), by source."""
    out: dict[str, Array] = {}
    for one in hypotheses:
        split = budget(one.system, one.estimate)
        for name, std in zip(split.source.tolist(), split.std[:, :n], strict=True):
            out[name] = out.get(name, np.zeros(n)) + one.weight * (one.ratio * std) ** 2
    return out


def _budget(found: Springs, parts: Mapping[str, Array], k: int) -> list[dict[str, Any]]:
    """What each source adds to one stiffness: standard uncertainty [its unit], part of variance."""
    x = float(found.value[k])
    if not found.identifiable[k] or x <= 0:
        return []
    total = float(found.cov[k, k])
    shares = {name: float(variance[k]) / total for name, variance in parts.items()}
    rest = 1 - sum(shares.values())
    if rest > _SHOWN:
        shares[_WHICH] = rest
    return [
        {"source": name, "std": float(np.sqrt(share * total)) / x**2, "share": share}
        for name, share in shares.items()
    ]


def _depends(
    joint: Joint, found: Springs, finding: str | None, on: Sequence[Dependence]
) -> dict[str, Any]:
    """The sentence on a spring that depends on which of two causes is true."""
    if not on:
        return {}
    name = f"k_{joint.name}"
    said = [finding] if finding and not any(one.lost for one in on) else []
    for cause in dict.fromkeys(one.cause for one in on):
        mine = [one for one in on if one.cause == cause]
        lost = list(dict.fromkeys(one.rival for one in mine if one.lost))
        others = " or ".join(dict.fromkeys(one.rival for one in mine))
        if lost:
            said.append(
                f"{name} is not identifiable: the data do not exclude {' or '.join(lost)} in the "
                f"place of {cause}, and beside it these poses do not tell it from the joint."
            )
        elif not found.identifiable[on[0].spring]:
            said.append(
                f"{name} is not identifiable: how large it is depends on whether the cause is "
                f"{cause} or {others}, which the data do not exclude."
            )
        else:
            said.append(
                f"{name} depends on whether the cause is {cause} or {others}, which the data do "
                "not exclude; its interval holds for each."
            )
    return {"finding": " ".join(said)}


def budget_entries(stiffness: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The same by source: share of each stiffness' variance in percent."""
    rows: dict[str, dict[str, Any]] = {}
    for entry in stiffness:
        for part in entry["budget"]:
            row = rows.setdefault(part["source"], {"source": part["source"].replace("_", " ")})
            row[f"{entry['name']} [%]"] = 100 * part["share"]
    return list(rows.values())


def _stiffness(number: int, joint: Joint, found: Springs, k: int, lever: float) -> dict[str, Any]:
    x, std = float(found.value[k]), float(found.std[k])
    identifiable = bool(found.identifiable[k])
    low, high = float(found.low[k]), float(found.high[k])
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
    if low <= 0 < x - 2 * std:
        return (
            f"{name} has no upper limit: its compliance is {with_std(x, std)} "
            f"{joint.compliance_unit}, but beside one of the possible causes it may be zero."
        )
    if low <= 0:
        return (
            f"{name} has no upper limit: its compliance of {with_std(x, std)} "
            f"{joint.compliance_unit} may be zero; add {work}, or pull harder."
        )
    return None
