"""Plain least squares, as in the paper: joint springs, equal weights, no search for causes.

x = (B'B)^-1 B' c,    cov(x) = s^2 (B'B)^-1,    s^2 = r'r / (M - n),  r = c - B x.

Guerin, Caro, Garnier, Girin, Eqs. (19), (20). Only the misfit is tested: `unexplained` if r' V^-1 r
of the weighted fit exceeds the 99 % quantile of chi-square.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from bench.open_league.solvers.answer import Json, answer
from bench.open_league.solvers.problem import Problem
from pipeline.base.arrays import Array

MISFIT_P = 0.01


def solve(given: Problem) -> Json:
    """Springs and their intervals."""
    x, cov, rest = ordinary(given.B, given.c)
    dof = len(given.c) - len(x)
    weighed = ordinary(given.root @ given.B, given.root @ given.c)[2]
    verdict = "adequate" if stats.chi2.sf(weighed, dof) >= MISFIT_P else "unexplained"
    return answer(given, verdict, x, cov * rest / dof, dof)


def ordinary(A: Array, y: Array) -> tuple[Array, Array, float]:
    """x, (A'A)^-1 and r'r by QR with columns of unit length; raises if A is rank deficient."""
    size = np.linalg.norm(A, axis=0)
    Q, R = np.linalg.qr(A / size)
    inverse = np.linalg.inv(R) / size[:, None]
    x = inverse @ (Q.T @ y)
    return x, inverse @ inverse.T, float(np.sum((y - A @ x) ** 2))
