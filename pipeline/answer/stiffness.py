"""`stiffness`, `budget` and `combinations`: what is determined of joints, singly and together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from pipeline.answer import remarks
from pipeline.answer.contract import (
    BudgetPart,
    BySign,
    Combination,
    JointType,
    Odd,
    OneWay,
    Remark,
    Stiffness,
)
from pipeline.answer.recommended import ModelValues
from pipeline.base import doors, linear
from pipeline.base.arrays import Array
from pipeline.diagnosis.average import (
    Dependence,
    Hypothesis,
    Springs,
    at_pose,
    dependences,
    each_way,
    information,
    springs,
    together,
    two_sided,
)
from pipeline.machine import sides
from pipeline.machine.cell import Cell
from pipeline.machine.robot import Joint, axes
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.system.budget import budget

_WHICH = "which_cause"
"""Source of the uncertainty about which cause is true."""

_NEEDS = "pipeline.design.parting:needs"
"""Door of the design: what would separate the members of a combination."""

_SHOWN = 1e-3
"""Share of the variance up to which `which_cause` is treated as zero, being rounding [1]."""


def stiffness_entries(
    cell: Cell, hypotheses: Sequence[Hypothesis], where: PoseOfInterest | None = None
) -> tuple[Stiffness, ...]:
    """One record per joint: the stiffness with its budget, or the reason why there is none.

    Args:
        cell: The cell, for names and units of the joints.
        hypotheses: Hypotheses, the identified causes first; a single one for a single model.
        where: The test pose, whose sign of the torque counts for a joint with a stiffness for each
            sign; without it such a joint has the mean of both compliances.
    """
    both = {} if where is None else _by_sign(cell, hypotheses, where)
    if where is not None:
        hypotheses = at_pose(hypotheses, where.q, where.force)
    found = springs(hypotheses)
    parts = _parts(hypotheses, cell.robot.n)
    names = axes.alone(cell.robot)
    system, depends = hypotheses[0].system, dependences(hypotheses)
    idle, partners = linear.nothing(system.B * system.typical), _partners(hypotheses, found)
    out = []
    for k, joint in enumerate(cell.robot.joints):
        silent = stiffness_entry(joint, found, k, _budget(found, parts, k), names[k])
        on = [one for one in depends if one.spring == k]
        odd = _odd(found, k, bool(idle[k]), partners[k])
        others = tuple(f"k_{cell.robot.joints[j].name}" for j in partners[k])
        said = tuple(_remarks(silent, odd, on, others))
        complete = silent.model_copy(update={"remarks": said, "by_sign": both.get(k)})
        out.append(complete.model_copy(update={"finding": remarks.finding(complete)}))
    return tuple(out)


def _by_sign(
    cell: Cell, hypotheses: Sequence[Hypothesis], where: PoseOfInterest
) -> dict[int, BySign]:
    """Stiffnesses for both signs of the torque, by index of the joint, where a cause causes two."""
    first = hypotheses[0]
    if not two_sided(first):
        return {}
    signs = sides.at_pose(first.cell, first.estimate.value, where.q, where.force)
    forms = {one.where: one.form for one in first.effects}
    out = {}
    for joint, sign in signs.items():
        found, turns = each_way(hypotheses, joint), axes.sense(cell.robot, joint)
        positive, negative = (_one_way(found, k, turns * way) for k, way in enumerate((1, -1)))
        std = found.std
        out[joint] = BySign(
            positive=positive,
            negative=negative,
            of="total" if forms[joint + 1] == "total" else "pull",
            correlation=float(found.cov[0, 1] / (std[0] * std[1])),
            value_of="positive" if sign > 0 else "negative",
        )
    return out


def _one_way(found: Springs, k: int, turns: int) -> OneWay:
    """One of the stiffnesses of `each_way`; its torque turns the axis to plus (1) or minus (-1).

    `turns` is 0 if no axis is mapped to the joint.
    """
    x, std = float(found.value[k]), float(found.std[k])
    has_value = bool(found.identifiable[k]) and x > 0
    return OneWay(
        value=1 / x if has_value else None,
        std=std / x**2 if has_value else None,
        ci95=_inverted(float(found.low[k]), float(found.high[k])),
        compliance=x if np.isfinite(std) else None,
        compliance_std=std,
        axis_turns="plus" if turns > 0 else "minus" if turns < 0 else None,
    )


def _inverted(low: float, high: float) -> tuple[float | None, float | None]:
    """Interval of a stiffness from that of its compliance; None for a limit that does not exist."""
    return 1 / high if 0 < high < np.inf else None, 1 / low if low > 0 else None


def _parts(hypotheses: Sequence[Hypothesis], n: int) -> dict[str, Array]:
    """Contribution of each source to the variance of each compliance, shape (n,), by source.

    Those of each hypothesis are scaled to its own variance: they know neither the ratio of its
    remainder nor the prior of a cause that is too small to be identified.
    """
    out: dict[str, Array] = {}
    for one in hypotheses:
        split, own = budget(one.system, one.estimate), np.diag(one.estimate.cov)[:n]
        for name, share in zip(split.source.tolist(), split.share[:, :n], strict=True):
            out[name] = out.get(name, np.zeros(n)) + one.weight * np.multiply(
                share, own, out=np.zeros(n), where=share > 0
            )
    return out


def _budget(found: Springs, parts: Mapping[str, Array], k: int) -> tuple[BudgetPart, ...]:
    """Budget of stiffness k by source: standard uncertainty [its unit], share of the variance."""
    x, total = float(found.value[k]), float(found.cov[k, k])
    if not (found.identifiable[k] and x > 0 and 0 < total < np.inf):
        return ()
    shares = {name: float(variance[k]) / total for name, variance in parts.items()}
    rest = 1 - sum(shares.values())
    if rest > _SHOWN:
        shares[_WHICH] = rest
    return tuple(
        BudgetPart(source=name, std=float(np.sqrt(max(share, 0.0) * total)) / x**2, share=share)
        for name, share in shares.items()
    )


def budget_entries(stiffness: Sequence[Stiffness]) -> tuple[dict[str, str | float], ...]:
    """Budgets of all stiffnesses, one row per source: shares of their variances [%]."""
    rows: dict[str, dict[str, str | float]] = {}
    for joint in stiffness:
        for part in joint.budget:
            row = rows.setdefault(part.source, {"source": part.source.replace("_", " ")})
            row[f"{joint.name} [%]"] = 100 * part.share
    return tuple(rows.values())


def stiffness_entry(
    joint: Joint, found: Springs, k: int, parts: tuple[BudgetPart, ...], axis: str | None
) -> Stiffness:
    """Record of one joint with its values, without remarks."""
    x, std = float(found.value[k]), float(found.std[k])
    low, high = float(found.low[k]), float(found.high[k])
    identifiable = bool(found.identifiable[k])
    has_value = identifiable and x > 0
    return Stiffness(
        joint=k + 1,
        joint_name=joint.name,
        name=f"k_{joint.name}",
        unit=joint.stiffness_unit,
        value=1 / x if has_value else None,
        std=std / x**2 if has_value else None,
        ci95=_inverted(low, high),
        identifiable=identifiable,
        joint_type=JointType.PRISMATIC if joint.prismatic else JointType.REVOLUTE,
        axis=axis,
        compliance=x if np.isfinite(std) else None,
        compliance_std=std,
        compliance_unit=joint.compliance_unit,
        relative_std=std / x if has_value else None,
        nominal=joint.stiffness,
        finding=None,
        budget=parts,
    )


def _remarks(
    joint: Stiffness, odd: Odd | None, on: Sequence[Dependence], partners: tuple[str, ...]
) -> Iterator[Remark]:
    """Remarks on a stiffness; if it is lost because of a rival cause, no other reason is given."""
    if odd is not None and not any(one.lost for one in on):
        yield Remark(odd=odd, others=partners if odd is Odd.TOGETHER else ())
    for cause in dict.fromkeys(one.cause for one in on):
        yield _dependence(cause, [one for one in on if one.cause == cause], joint.identifiable)


def _odd(found: Springs, k: int, idle: bool, partners: Sequence[int]) -> Odd | None:
    """The peculiarity of spring k that follows from its estimate, or None.

    Args:
        found: All springs.
        k: Index of the spring.
        idle: Whether no pull loads it.
        partners: The others in combination with which alone it is determined.
    """
    x, std, low = found.value[k], found.std[k], found.low[k]
    if idle:
        return Odd.NO_LEVER
    if np.isfinite(std) and found.high[k] < 0:
        return Odd.NEGATIVE
    if partners:
        return Odd.TOGETHER
    if not found.identifiable[k]:
        return Odd.UNCERTAIN if np.isfinite(std) else Odd.MIXED
    if low <= 0:
        return Odd.ZERO_BESIDE_A_CAUSE if x - 2 * std > 0 else Odd.MAY_BE_ZERO
    return None


def _partners(hypotheses: Sequence[Hypothesis], found: Springs) -> list[list[int]]:
    """For each spring, those with which it is determined in combination, if not by itself."""
    n = len(found.value)
    out: list[list[int]] = [[] for _ in range(n)]
    if found.identifiable.all():
        return out
    for one in together(hypotheses, information(hypotheses), found.identifiable):
        for k in one.of.tolist():
            out[k] = sorted({*out[k], *one.of.tolist()} - {k})
    return out


def _dependence(cause: str, on: Sequence[Dependence], identifiable: bool) -> Remark:
    """Remark on a spring that depends on which of several causes is true."""
    lost = dict.fromkeys(one.rival for one in on if one.lost)
    if lost:
        return Remark(odd=Odd.LOST, cause=cause, others=tuple(lost))
    odd = Odd.DEPENDS if identifiable else Odd.SCATTERED
    return Remark(odd=odd, cause=cause, others=tuple(dict.fromkeys(one.rival for one in on)))


def combination_entries(values: ModelValues) -> tuple[Combination, ...]:
    """One record per combination that is determined of joints that are not determined singly."""
    fitted, n = values.fitted, values.fitted.case.robot.n
    alone = values.found.identifiable[:n]
    if n - int(alone.sum()) < 2:
        return ()
    N = information(values.hypotheses)
    joints, needs = fitted.case.robot.joints, doors.found(_NEEDS)
    return tuple(
        Combination(
            of=tuple(f"k_{joints[j].name}" for j in one.of),
            weights=tuple(one.weights.tolist()),
            value=one.value,
            std=one.std,
            ci95=(one.low, one.high),
            unit=joints[int(one.of[0])].compliance_unit,
            needs=needs(fitted, N, one.of) if needs else "",
        )
        for one in together(values.hypotheses, N, alone)
    )
