"""Stepwise regression by F tests: the most significant cause enters as long as it is significant.

F = ((S_0 - S_1) / k) / (S_1 / (M - p)) for a cause of k parameters added to a model, p parameters
in all, with S the sums of squares of whitened rows; after each entry, causes that are no longer
significant leave (Efroymson, in Ralston and Wilf, Mathematical Methods for Digital Computers, 1960;
Draper and Smith, Applied Regression Analysis, ch. 15). With Bonferroni's inequality, a cause enters
below 0.05 over the number of suspects, otherwise below 0.05.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from bench.open_league.solvers.answer import Json, answer
from bench.open_league.solvers.least_squares import ordinary
from bench.open_league.solvers.problem import Problem, Suspect
from pipeline.base.arrays import Array

ENTER = 0.05
"""Significance level at which a cause enters [1]."""

LEAVE = 2.0
"""Factor to the level above which a cause leaves [1]; with equal levels, one could enter and leave
forever."""

MOST = 8
"""Maximum number of causes; more would not be credible."""

NOTHING = 1e-6
"""Independent fraction of a column below which it counts as a combination of those in the model
[1]."""


@dataclass(frozen=True, eq=False)
class _Rows:
    """Whitened rows, the columns of the suspects, and the level at which one enters."""

    y: Array
    B: Array
    Z: Array
    enter: float

    def with_(self, causes: Sequence[Suspect]) -> Array:
        return np.hstack([self.B, *(self.Z[:, one.columns] for one in causes)])

    def p_value(self, one: Suspect, beside: Sequence[Suspect]) -> float:
        """P-value of the F test of one cause added to others; 1 if they span it already."""
        A = self.with_(beside)
        Q = np.linalg.qr(A / np.linalg.norm(A, axis=0))[0]
        new = self.Z[:, one.columns]
        left = new - Q @ (Q.T @ new)
        size = np.linalg.norm(new, axis=0)
        if (np.linalg.norm(left, axis=0) <= NOTHING * size).any():
            return 1.0
        rest = self.y - Q @ (Q.T @ self.y)
        U, s, _ = np.linalg.svd(left / size, full_matrices=False)
        k, freedom = len(s), len(self.y) - A.shape[1] - len(s)
        if s[-1] <= NOTHING or freedom < 1:
            return 1.0
        gain = float(np.sum((U.T @ rest) ** 2))
        return float(stats.f.sf(gain / k / ((rest @ rest - gain) / freedom), k, freedom))


def solve(given: Problem, bonferroni: bool) -> Json:
    """Causes that enter, and the springs estimated together with them."""
    labels = {one.label for one in given.suspects}
    enter = ENTER / len(labels) if bonferroni else ENTER
    W = given.root
    rows = _Rows(W @ given.c, W @ given.B, W @ given.Z, enter)
    causes = _chosen(rows, given.suspects)
    x, cov, rest = ordinary(rows.with_(causes), rows.y)
    dof = len(rows.y) - len(x)
    columns = [int(k) for one in causes for k in one.columns]
    verdict = "explained" if causes else "adequate"
    return answer(given, verdict, x, cov * max(rest / dof, 1.0), 0, causes, columns)


def _chosen(rows: _Rows, suspects: Sequence[Suspect]) -> list[Suspect]:
    causes: list[Suspect] = []
    for _ in range(2 * MOST):
        if len(causes) == MOST:
            break
        taken = {one.label for one in causes}
        free = [one for one in suspects if one.label not in taken]
        p = [rows.p_value(one, causes) for one in free]
        best = int(np.argmin(p))
        if p[best] >= rows.enter:
            break
        causes = _without_idle(rows, [*causes, free[best]])
    return causes


def _without_idle(rows: _Rows, causes: list[Suspect]) -> list[Suspect]:
    """Causes that remain significant given the others; the least significant leaves first."""
    while len(causes) > 1:
        p = [rows.p_value(one, [o for o in causes if o is not one]) for one in causes]
        worst = int(np.argmax(p))
        if p[worst] <= LEAVE * rows.enter:
            break
        causes = causes[:worst] + causes[worst + 1 :]
    return causes
