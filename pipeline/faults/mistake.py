"""The record of a mistake in the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pipeline.reduction.case import Case


@dataclass(frozen=True)
class Mistake:
    """One mistake, the evidence for it, and what would put it right.

    Attributes:
        name: That of its fault: `outlier`, `label_swap`, `unit_mixup`, `sign_or_convention`, ...
        where: A reading `group/target`, a group, or which unit, sign or convention.
        evidence: Sentence for the engineer, with its numbers.
        correction: Sentence: what was done to get the corrected result.
        before: Misfit that speaks for the mistake, in `unit`.
        after: The same once it is corrected.
        unit: `mm`, `sigma`, `1`.
        size: How large the mistake is, where it has a size.
        size_unit: Unit of `size`.
        p_value: Probability of such evidence by chance, None where chance plays no part.
        beside_model: The evidence is a residual of the joint springs, which a richer model may
            explain.
        correct: The corrected campaign.
    """

    name: str
    where: str
    evidence: str
    correction: str
    before: float
    after: float
    unit: str
    correct: Callable[[Case], Case]
    size: float | None = None
    size_unit: str = "1"
    p_value: float | None = None
    beside_model: bool = False

    @property
    def of_tracker(self) -> bool:
        """Whether it accuses one reading of the tracker, which heavy tails may throw as far."""
        told = self.name == "outlier" and self.p_value is not None
        return told and (self.unit, self.size_unit) == ("sigma", "m")


def outlying(where: str, evidence: str, correction: str, **known: Any) -> Mistake:
    """One reading, or one row, that contradicts all others; `known` as in `Mistake`."""
    usual: dict[str, Any] = {"name": "outlier", "after": 0.0, "unit": "sigma", "size_unit": "m"}
    told = usual | known
    if told.get("p_value") is not None:
        told["p_value"] = min(told["p_value"], 1.0)  # a sum over readings may exceed 1
    return Mistake(where=where, evidence=evidence, correction=correction, **told)
