"""Springs by the arm's own weight against those by pulls of the same robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.base.arrays import Array, Locked
from pipeline.base.tails import chi2_beyond


class ChiSquare(NamedTuple):
    """A chi-square with its degrees of freedom."""

    chi2: float
    dof: int

    @property
    def p(self) -> float:
        """Its p-value; 1 without degrees of freedom."""
        return float(chi2_beyond(self.chi2, self.dof)) if self.dof else 1.0


_NOTHING = ChiSquare(0.0, 0)


class CommonFactorFit(NamedTuple):
    """Common factor of springs by pulls over those by weight, with chi-square misfit and dof."""

    factor: float
    std: float
    chi2: float
    dof: int


@dataclass(frozen=True, eq=False)
class SpringAgreement(Locked):
    """Comparison of the springs by the arm's weight and by the pulls.

    Attributes:
        chi2: Chi-square of their difference.
        dof: Number of springs, or combinations of them, that both determine.
        weight: Compliances and standard uncertainties by the weight, infinite where undetermined,
            (n, 2).
        pulls: The same by the pulls.
        factor: Factor by which springs are softer than with an arm of usual weight, where no masses
            are stated; else None [1].
        common: The same where masses are stated, if a common factor explains the difference; else
            None.
        table_p: P-value of the pulls' unloaded readings under the model from the positions.
        elements: Chi-square of the difference of other elements under weight and under pulls.
        held: Names of these elements.
    """

    chi2: float
    dof: int
    weight: Array
    pulls: Array
    factor: float | None
    common: CommonFactorFit | None = None
    table_p: float = 1.0
    elements: ChiSquare = _NOTHING
    held: tuple[str, ...] = ()

    @property
    def most(self) -> tuple[int, float]:
        """Joint from 0 with the most significant difference, and pulls over weight there."""
        (w, sw), (p, sp) = self.weight.T, self.pulls.T
        k = int(np.argmax(np.abs(p - w) / np.hypot(sp, sw)))
        return k, float(p[k] / w[k])

    @property
    def p(self) -> float:
        """Smaller p-value of the differences in springs and in elements, twice it if both exist."""
        springs = ChiSquare(self.chi2, self.dof).p
        return min(2 * min(springs, self.elements.p), 1.0) if self.elements.dof else springs
