"""Is something missing? F tests of all suspects at one false-alarm rate, and lack of fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base.arrays import Array, Ints
from pipeline.system import alarms
from pipeline.system.score_tests import Base, ScoreTests, by_products
from pipeline.system.whitened import Whitened, by_pose_drop


@dataclass(frozen=True)
class Threshold:
    """Threshold of the F tests of the suspects.

    Attributes:
        p: Limit for one suspect, such that the smallest p of all stays above it with probability
            1 - `alarms.SUSPECT`.
        independent: Equivalent number of independent tests.
    """

    p: float
    independent: float


def threshold(
    view: Whitened, base: Ints, dof: int, rng: np.random.Generator, draws: int = 3000
) -> Threshold:
    """Calibrate the smallest p of all suspects on random draws of pure scatter.

    p_min = min_j P[F(k_j, dof - k_j) > F_j], F_j = (T_j / k_j) / ((rest - T_j) / (dof - k_j)), T_j
    the drop of the sum of squares of the scatter e ~ N(0, I) when suspect j joins the base. With q
    the 2 % quantile of p_min, m = ln(1 - 0.02) / ln(1 - q) independent tests would do the same, so
    that each may use p = 1 - (1 - alpha)^(1/m), alpha = `alarms.SUSPECT` (Sidak, J. Am. Stat.
    Assoc. 62, 1967).

    The F tests do not depend on the size of the scatter. The tail is extrapolated from the number
    of independent tests at 2 %, which 3000 draws give to 13 %.

    e is drawn row by row, and T_j = g' N^+ g, g = D_j' P e, follows from it as from readings: no
    arbitrary direction or sign chosen by an algorithm enters, and rounding moves the result no more
    than these products.

    Where no suspect leaves a row from which to estimate the scatter, none can be found, and nothing
    is drawn.
    """
    now = by_products(view.M, base, view.at, dof)
    able = (now.rank > 0) & (now.rank < dof)
    if not able.any():
        return Threshold(alarms.SUSPECT, 1.0)
    at, cov, rank = view.at[able], now.cov[able], now.rank[able]
    known, columns = Base.of(view.A[:, base], view.A[:, -1]), view.A.T
    least, some = [], max(1, _AT_ONCE // (len(view.A) + cov.size))
    for start in range(0, draws, some):
        e = known.beyond(rng.standard_normal((min(some, draws - start), len(view.A))).T)
        g = (columns @ e)[at] * (at >= 0)[:, :, None]  # (n, k, draws)
        drop = np.einsum("nkd,nkd->nd", cov @ g, g)
        least.append(_least(drop, rank, np.sum(e**2, axis=0), dof))
    tests = np.log1p(-0.02) / np.log1p(-np.quantile(np.concatenate(least), 0.02))
    return Threshold(-np.expm1(np.log1p(-alarms.SUSPECT) / tests), float(tests))


_AT_ONCE = 4_000_000
"""Maximum count of random numbers drawn at once: 32 MB."""


def _least(drop: Array, rank: Ints, rest: Array, dof: int) -> Array:
    """Smallest p of all suspects in each draw, from their drops (n, draws), shape (draws,)."""
    least = np.ones(len(rest))
    for k in np.unique(rank):  # of suspects of one rank the largest drop counts
        most, left = drop[rank == k].max(axis=0), dof - k
        least = np.minimum(least, special.fdtrc(k, left, (most / k) / ((rest - most) / left)))
    return least


@dataclass(frozen=True)
class LackOfFit:
    """Lack of fit: what free motions of the effector explain beyond the model.

    Attributes:
        p_poses: p-value against a free stiffness matrix for each pose, proportional to the force.
        p_pulls: p-value against free rigid motions of the effector in each pull.
    """

    p_poses: float
    p_pulls: float

    @property
    def found(self) -> bool:
        """Whether either p-value is below `alarms.LACK_OF_FIT`."""
        return min(self.p_poses, self.p_pulls) < alarms.LACK_OF_FIT


def lack_of_fit(view: Whitened, base: Ints, score: ScoreTests) -> LackOfFit:
    """Test the base against free motions; the scatter comes from the rigidity of the effector.

    F = (drop / k) / (scatter / nu), with k and nu degrees of freedom: the lack of fit against the
    pure error. drop is the part of the base's residual that free motions explain: those of each
    pose in proportion to the force, or (rest - scatter, dof - nu) those of each pull.

    Without three reflectors the scatter is unknown and nothing is found (p = 1); likewise where
    free motions add no degrees of freedom.
    """
    if not view.tells_scatter:
        return LackOfFit(1.0, 1.0)
    noise = max(view.scatter / view.scatter_dof, view.least)

    def p(drop: float, dof: int) -> float:
        return float(special.fdtrc(dof, view.scatter_dof, drop / dof / noise)) if dof > 0 else 1.0

    by_pulls = max(score.rest - view.scatter, 0.0), score.dof - view.scatter_dof
    return LackOfFit(p(*by_pose_drop(view, base)), p(*by_pulls))
