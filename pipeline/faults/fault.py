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


@dataclass(frozen=True, eq=False)
class Screening:
    """A campaign under test; what a test asks for is computed once, and only then.

    Attributes:
        case: The campaign, with the mistakes that were found so far put right.
        cell: The model that the readings are tested against.
        start: Where its estimate starts, shape (k,).
        known: Its measurements, if they are at hand.
        before: The same campaign with one mistake more: what was put right since is missing from
            the tails of its readings.
        accepted: Tails of the readings beside the accepted model, where one is known.
    """

    case: Case
    cell: Cell
    start: Array
    known: Reduced | None = None
    before: Screening | None = None
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
        """Tails of the readings beside the accepted model, else all that a machine could do."""
        if self.accepted is not None:
            return self.accepted
        data, springs = self.reduced.data, self.case.cell
        data = data.in_metres(self.system.found_m)
        values = self.estimate.value[: len(springs.parameters)]
        return tails(beside_everything(springs, data, values))[1]

    def mistaken(self, square: float, axes: int) -> float:
        """Probability that a reading is a blunder, the square of its error in std along some axes.

        Of the families with and without the mistakes that were put right the lower one counts: a
        tail that was taken for blunders reading by reading would soon be none.
        """
        mine = self.family.mistaken(square, axes)
        return mine if self.before is None else min(mine, self.before.mistaken(square, axes))

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
        beside_model: Tested once more beside the causes that were identified without its readings.
    """

    name: str
    noun: str
    find: Callable[[Screening], list[Mistake]]
    in_files: bool = False
    in_forces: bool = False
    beside_model: bool = False
