"""The shape of a fault: a mistake in the data that can be found, written once."""

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
from pipeline.system.shape import tails
from pipeline.system.system import Estimate, System

SURE = 0.9
"""Probability from which a reading is a blunder [1]: odds of 9 to 1, those of the stated family."""


@dataclass(frozen=True, eq=False)
class Screening:
    """A campaign under test; what a test asks for is computed once, and only then.

    Attributes:
        case: The campaign, with the mistakes that were found so far put right.
        cell: The model that the readings are tested against.
        start: Where its estimate starts, shape (k,).
        known: Its measurements, if they are at hand.
        accepted: Tails of the readings as they are known already.
    """

    case: Case
    cell: Cell
    start: Array
    known: Reduced | None = None
    accepted: Family | None = None

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
        """Tails of the readings, beside all that a machine could do where nobody knows better."""
        if self.accepted is not None:
            return self.accepted
        data, springs = self.reduced.data, self.case.cell
        data = data.in_metres(self.system.found_m)
        values = self.estimate.value[: len(springs.parameters)]
        return tails(beside_everything(springs, data, values))[1]

    def sure(self, one: Mistake) -> bool:
        """Whether a reading that is off is a blunder, and not of the family that all show.

        The family is that of all readings, those off included: a tail that was taken for blunders
        reading by reading would soon be none. Where it rather is as stated, it is taken to be: a
        doubt about the tails is none about a reading that is far off.
        """
        if one.rivalled:
            return False
        return not one.may_be_noise or self.family.rather.mistaken(one.before**2, one.axes) > SURE

    @cached_property
    def spread(self) -> tuple[float, int]:
        """Scatter of the readings over the stated one, and how many contrasts it rests on."""
        data = self.reduced.data
        return noise_scale(self.system, self.estimate, data, self.zeros, self.cell)


@dataclass(frozen=True)
class Fault:
    """One kind of mistake.

    Attributes:
        name: What its findings are called, a word of the list of causes; several may share one.
        noun: The same as a noun, so that it fits into any sentence.
        find: What of it is found; nothing in a clean campaign.
        in_files: It spoils whole files: tested once, before anything is estimated.
        in_forces: It can be made in a campaign that arrives reduced to forces and displacements.
    """

    name: str
    noun: str
    find: Callable[[Screening], list[Mistake]]
    in_files: bool = False
    in_forces: bool = False
