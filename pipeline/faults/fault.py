"""Interface of a fault: a kind of mistake in the data that can be found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from pipeline.base.arrays import Array
from pipeline.faults.mistake import Mistake
from pipeline.faults.noise_scale import noise_scale
from pipeline.machine.cell import Cell
from pipeline.reduction.bring import Reduced, bring
from pipeline.reduction.case import Case
from pipeline.system.contrasts import Zeros, repeated_zeros
from pipeline.system.estimate import identify
from pipeline.system.family import Family
from pipeline.system.fit import beside_everything
from pipeline.system.noise_shape import tails
from pipeline.system.system import Estimate, System

_BLUNDER_PROBABILITY = 0.9
"""Minimum probability of a reading to be a blunder [1]: odds of 9 to 1, those of the stated
family."""


@dataclass(frozen=True, eq=False)
class Screening:
    """A campaign under test; results are computed once, when first needed.

    Attributes:
        case: The campaign, with the mistakes found so far corrected.
        cell: The model that the readings are tested against.
        start: Initial values of its estimate, shape (k,).
        known: Its measurements, if available.
        accepted: Tails of the readings, if known.
        beside_causes: Whether causes were sought already, and are in the model if any were found.
    """

    case: Case
    cell: Cell
    start: Array
    known: Reduced | None = None
    accepted: Family | None = None
    beside_causes: bool = False

    @cached_property
    def reduced(self) -> Reduced:
        """Its measurements."""
        return self.known or bring(self.case)

    @cached_property
    def _identified(self) -> tuple[System, Estimate]:
        return identify(self.cell, self.reduced.data, self.start)

    @property
    def system(self) -> System:
        """The linear system of the model."""
        return self._identified[0]

    @property
    def estimate(self) -> Estimate:
        """Its solution."""
        return self._identified[1]

    @cached_property
    def zeros(self) -> Zeros:
        """Repeated zeros."""
        return repeated_zeros(self.case.settings, self.reduced.placed)

    @cached_property
    def family(self) -> Family:
        """Tails of the readings; if unknown, estimated given everything a machine could do."""
        if self.accepted is not None:
            return self.accepted
        data, springs = self.reduced.data, self.case.cell
        data = data.in_metres(self.system.found_m)
        values = self.estimate.value[: len(springs.parameters)]
        return tails(beside_everything(springs, data, values))[1]

    def sure(self, one: Mistake) -> bool:
        """Whether an outlying reading is a blunder rather than part of the noise's tails.

        The tails are estimated from all readings, outliers included: otherwise outliers removed one
        by one would soon leave no tail. If the stated noise is likelier, it is used: uncertainty
        about the tails must not excuse a reading that is far off.
        """
        if one.rivalled and not self.beside_causes:
            return False
        return (
            not one.may_be_noise
            or self.family.rather.mistaken(one.before**2, one.axes) > _BLUNDER_PROBABILITY
        )

    @cached_property
    def spread(self) -> tuple[float, int]:
        """Scatter of the readings over the stated one, and the number of contrasts behind it."""
        data = self.reduced.data
        return noise_scale(self.system, self.estimate, data, self.zeros, self.cell)


@dataclass(frozen=True)
class Fault:
    """One kind of mistake.

    Attributes:
        name: Name of its findings in the list of causes; several faults may share one.
        find: Finds such mistakes; empty for a clean campaign.
        in_files: Whether it affects whole files: tested once, before any estimate.
        in_forces: Whether it is possible in a campaign that is given as forces and displacements.
    """

    name: str
    find: Callable[[Screening], list[Mistake]]
    in_files: bool = False
    in_forces: bool = False
