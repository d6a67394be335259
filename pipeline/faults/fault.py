"""Interface of a fault: a kind of mistake in the data that can be found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from pipeline.base.arrays import Array
from pipeline.faults.mistake import Mistake
from pipeline.machine.cell import Cell
from pipeline.machine.effect import Effect
from pipeline.reduction.bring import Reduced, bring
from pipeline.reduction.case import Case
from pipeline.reduction.measured import Measured
from pipeline.system.contrasts import Zeros, pure_error, repeated_zeros
from pipeline.system.estimate import identify, solve
from pipeline.system.family import Family
from pipeline.system.fit import beside_everything
from pipeline.system.noise_shape import tails
from pipeline.system.system import Errors, Estimate, System
from pipeline.system.whiten import whitener
from pipeline.system.whitened import of_laws

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
        suspects: Further laws, by which those of the model's causes are uncertain within tolerance.
    """

    case: Case
    cell: Cell
    start: Array
    known: Reduced | None = None
    accepted: Family | None = None
    beside_causes: bool = False
    suspects: tuple[Effect, ...] = ()

    @cached_property
    def reduced(self) -> Reduced:
        """Its measurements."""
        return self.known or bring(self.case)

    @cached_property
    def _exact(self) -> tuple[System, Estimate]:
        """As `_identified`, with the laws of the causes exact."""
        return identify(self.cell, self.reduced.data, self.start)

    @cached_property
    def _identified(self) -> tuple[System, Estimate]:
        return self._uncertain(*self._exact)

    @cached_property
    def laws(self) -> Errors | None:
        """Errors of the laws of the model's causes, None where it has none."""
        causes = self.cell.effects[len(self.case.cell.effects) :]
        if not causes or not self.suspects:
            return None
        return of_laws(self.cell, self.reduced.data, self._exact[1].value, causes, self.suspects)

    def widened(self, system: System) -> System:
        """A system of the same rows with the laws of the causes uncertain by their tolerance."""
        laws = self.laws
        return system if laws is None else replace(system, errors=system.errors.beside(laws))

    def identified(self, data: Measured, start: Array) -> tuple[System, Estimate]:
        """The system of the model and its solution, laws uncertain as for `widened`."""
        return self._uncertain(*identify(self.cell, data, start))

    def _uncertain(self, system: System, estimate: Estimate) -> tuple[System, Estimate]:
        if self.laws is None:
            return system, estimate
        system = self.widened(system)
        return system, solve(system, estimate.value)

    @property
    def system(self) -> System:
        """The linear system of the model."""
        return self._identified[0]

    @property
    def estimate(self) -> Estimate:
        """Its solution."""
        return self._identified[1]

    @property
    def loss(self) -> tuple[int, float]:
        """Number M of rows, and minus twice the log likelihood, up to a constant.

        M ln(v s^2) + chi2 / v, v the mean square of the whitened residuals, at least 1, and s the
        noise [m] where it was estimated, else 1.
        """
        rows, found = len(self.system.rows), self.system.found_m or 1.0
        v = max(self.estimate.chi2 / max(self.estimate.dof, 1), 1.0)
        return rows, rows * float(np.log(v * found**2)) + self.estimate.chi2 / v

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
            or self.family.rather.mistaken(one.before**2, one.axes, self._state(one), one.near)
            > _BLUNDER_PROBABILITY
        )

    def _state(self, one: Mistake) -> tuple[int, int] | None:
        """Pose and pull of a single reading, -1 for a zero; None for one of the base."""
        rows = self.case.readings
        mine = rows[(rows["group"] == one.where.rpartition("/")[0]) & rows["pose"].notna()]
        if not len(mine):
            return None
        row = mine.iloc[0]
        return int(row["pose"]), int(row["repeat"]) if row["state"] == "loaded" else -1

    @cached_property
    def spread(self) -> tuple[float, int]:
        """Scatter of the readings over the stated one, and the number of contrasts behind it."""
        return noise_scale(self.system, self.estimate, self.reduced.data, self.zeros, self.cell)


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


def noise_scale(
    system: System, estimate: Estimate, data: Measured, zeros: Zeros, cell: Cell
) -> tuple[float, int]:
    """Scatter of the effector's readings against each other over the stated one, robustly.

    s = median|w| / 0.6745 of the whitened contrasts w, then five iterations of
    s^2 = mean(w^2) / 0.9733 over |w| <= 3 s, with 0.9733 the variance of a standard normal
    truncated at 3. At least one: a certificate may be conservative, but chance must not create
    outliers.

    Returns:
        The factor, and the number of contrasts that it is estimated from.
    """
    contrasts = pure_error(system, estimate.residual, data, zeros, cell)
    if len(contrasts.rows) < 12:
        return 1.0, max(estimate.dof, 1)
    w = whitener(contrasts.errors, contrasts.rows.pose).by_pose(contrasts.c)
    scale = float(np.median(np.abs(w)) / special.ndtri(0.75))
    for _ in range(5):
        inside = w[np.abs(w) <= 3 * scale]  # never empty, also if all rows are equal
        scale = float(np.sqrt(np.mean(inside**2) / 0.9733))  # normal truncated at 3 sigma
    return max(scale, 1.0), len(w)
