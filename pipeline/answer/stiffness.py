"""`stiffness` and `budget`: one record per joint, or why it has no value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.answer import remarks
from pipeline.answer.contract import BudgetPart, JointType, Odd, Remark, Stiffness
from pipeline.answer.numbers import finite
from pipeline.base.arrays import Array
from pipeline.diagnosis.average import Dependence, Hypothesis, Springs, dependences, springs
from pipeline.machine.cell import Cell
from pipeline.machine.robot import Joint
from pipeline.system.budget import budget

_WHICH = "which_cause"
"""Source of the uncertainty that comes of not knowing which cause is true."""

_SHOWN = 1e-3
"""A smaller share of the variance than this is rounding."""

_NO_LEVER_M = 1e-12
"""A joint whose usual compliance moves no target by more than this carries no load."""


def stiffness_entries(cell: Cell, hypotheses: Sequence[Hypothesis]) -> tuple[Stiffness, ...]:
    """One record per joint: the stiffness with its budget, or why there is none.

    Args:
        cell: For the names and units of the joints.
        hypotheses: What may be true, the identified causes first; one for a single model.
    """
    found = springs(hypotheses)
    parts = _parts(hypotheses, cell.robot.n)
    lever = np.linalg.norm(hypotheses[0].system.B, axis=0)
    depends = dependences(hypotheses)
    return tuple(
        _stiffness(
            joint,
            _Spring.of(found, k, float(lever[k])),
            [one for one in depends if one.spring == k],
            _budget(found, parts, k),
        )
        for k, joint in enumerate(cell.robot.joints)
    )


@dataclass(frozen=True)
class _Spring:
    """The compliance of one joint.

    Attributes:
        number: Of the joint, from 1.
        x: Compliance, SI.
        std: Its standard uncertainty; infinite where nothing determines it.
        low: Lower end of its 95 % interval.
        high: Upper end.
        identifiable: Whether the data determine it.
        lever_m: By how much all pulls together move the targets per unit of it.
    """

    number: int
    x: float
    std: float
    low: float
    high: float
    identifiable: bool
    lever_m: float

    @classmethod
    def of(cls, found: Springs, k: int, lever_m: float) -> _Spring:
        """That of joint `k`, counted from 0."""
        return cls(
            number=k + 1,
            x=float(found.value[k]),
            std=float(found.std[k]),
            low=float(found.low[k]),
            high=float(found.high[k]),
            identifiable=bool(found.identifiable[k]),
            lever_m=lever_m,
        )

    @property
    def has_value(self) -> bool:
        """Whether one over it is a stiffness."""
        return self.identifiable and self.x > 0

    @property
    def ci95(self) -> tuple[float | None, float | None]:
        """Of the stiffness; no limit where the compliance may be zero."""
        low = 1 / self.high if 0 < self.high < np.inf else None
        return low, 1 / self.low if self.low > 0 else None


def _parts(hypotheses: Sequence[Hypothesis], n: int) -> dict[str, Array]:
    """What each source adds to the variance of each compliance, shape (n,), by source."""
    out: dict[str, Array] = {}
    for one in hypotheses:
        split = budget(one.system, one.estimate)
        for name, std in zip(split.source.tolist(), split.std[:, :n], strict=True):
            out[name] = out.get(name, np.zeros(n)) + one.weight * (one.ratio * std) ** 2
    return out


def _budget(found: Springs, parts: Mapping[str, Array], k: int) -> tuple[BudgetPart, ...]:
    """What each source adds to one stiffness: standard uncertainty [its unit], part of variance."""
    x = float(found.value[k])
    if not found.identifiable[k] or x <= 0:
        return ()
    total = float(found.cov[k, k])
    shares = {name: float(variance[k]) / total for name, variance in parts.items()}
    rest = 1 - sum(shares.values())
    if rest > _SHOWN:
        shares[_WHICH] = rest
    return tuple(
        BudgetPart(source=name, std=float(np.sqrt(share * total)) / x**2, share=share)
        for name, share in shares.items()
    )


def budget_entries(stiffness: Sequence[Stiffness]) -> tuple[dict[str, str | float], ...]:
    """The same by source: share of each stiffness' variance in percent."""
    rows: dict[str, dict[str, str | float]] = {}
    for joint in stiffness:
        for part in joint.budget:
            row = rows.setdefault(part.source, {"source": part.source.replace("_", " ")})
            row[f"{joint.name} [%]"] = 100 * part.share
    return tuple(rows.values())


def _stiffness(
    joint: Joint, spring: _Spring, on: Sequence[Dependence], parts: tuple[BudgetPart, ...]
) -> Stiffness:
    x, std, has_value = spring.x, spring.std, spring.has_value
    silent = Stiffness(
        joint=spring.number,
        joint_name=joint.name,
        name=f"k_{joint.name}",
        unit=joint.stiffness_unit,
        value=1 / x if has_value else None,
        std=std / x**2 if has_value else None,
        ci95=spring.ci95,
        identifiable=spring.identifiable,
        joint_type=JointType.PRISMATIC if joint.prismatic else JointType.REVOLUTE,
        compliance=x if np.isfinite(std) else None,
        compliance_std=finite(std),
        compliance_unit=joint.compliance_unit,
        relative_std=std / x if has_value else None,
        nominal=joint.stiffness,
        finding=None,
        remarks=tuple(_remarks(spring, on)),
        budget=parts,
    )
    return silent.model_copy(update={"finding": remarks.finding(silent)})


def _remarks(spring: _Spring, on: Sequence[Dependence]) -> Iterator[Remark]:
    """What is to be known of a stiffness; what a rival takes away needs no other reason."""
    odd = _odd(spring)
    if odd is not None and not any(one.lost for one in on):
        yield Remark(odd=odd)
    for cause in dict.fromkeys(one.cause for one in on):
        yield _dependence(cause, [one for one in on if one.cause == cause], spring.identifiable)


def _odd(spring: _Spring) -> Odd | None:
    """What the numbers of a spring alone show."""
    if not np.isfinite(spring.std):
        return Odd.NO_LEVER if spring.lever_m * spring.x < _NO_LEVER_M else Odd.MIXED
    if spring.high < 0:
        return Odd.NEGATIVE
    if not spring.identifiable:
        return Odd.UNCERTAIN
    if spring.low <= 0:
        return Odd.ZERO_BESIDE_A_CAUSE if spring.x - 2 * spring.std > 0 else Odd.MAY_BE_ZERO
    return None


def _dependence(cause: str, on: Sequence[Dependence], identifiable: bool) -> Remark:
    """What a spring owes to not knowing which of two causes is true."""
    lost = dict.fromkeys(one.rival for one in on if one.lost)
    if lost:
        return Remark(odd=Odd.LOST, cause=cause, others=tuple(lost))
    odd = Odd.DEPENDS if identifiable else Odd.SCATTERED
    return Remark(odd=odd, cause=cause, others=tuple(dict.fromkeys(one.rival for one in on)))
