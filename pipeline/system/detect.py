"""Is something missing? F tests of all suspects at one false-alarm rate, and lack of fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.system import alarms
from pipeline.system.beside import Base, Beside
from pipeline.system.elimination import eliminate
from pipeline.system.whitened import Whitened, by_pose_drop


@dataclass(frozen=True)
class Threshold:
    """What a suspect's F test must fall below.

    Attributes:
        p: For one suspect, so that the smallest of all stays above it with 1 - FALSE_ALARM.
        independent: As many independent tests the correlated ones amount to.
    """

    p: float
    independent: float


def threshold(
    view: Whitened, base: Ints, dof: int, rng: np.random.Generator, draws: int = 3000
) -> Threshold:
    """Calibrate the smallest p of all suspects on draws of pure scatter.

    p_min = min_j P[F(k_j, dof - k_j) > F_j], F_j = (T_j / k_j) / ((rest - T_j) / (dof - k_j)),
    T_j = |U_j' e|^2, e ~ N(0, I), U_j what suspect j adds to the base. With q the 2 % quantile of
    p_min, m = ln(1 - 0.02) / ln(1 - q) independent tests would do the same, so that each may use
    p = 1 - (1 - alpha)^(1/m), alpha = `alarms.SUSPECT` (Sidak, J. Am. Stat. Assoc. 62, 1967).

    Only the part of the scatter in the span of base and suspects needs drawing; the rest is one
    chi-square. The F tests do not depend on the size of the scatter. The tail is
    taken from the number of independent tests at 2 %, where 3000 draws give it to 13 %.

    Where no suspect leaves a row to tell the scatter from, none can be found, and nothing is drawn.
    """
    every = _bases(view, base, dof) if dof > 1 else []
    bases = [basis for basis in every if basis.shape[1] < dof]
    if not bases:
        return Threshold(alarms.SUSPECT, 1.0)
    inside = sum(basis.shape[0] for basis in bases[:1])
    e = rng.standard_normal((draws, inside))
    rest = np.sum(e**2, axis=1) + rng.chisquare(max(dof - inside, 1), draws)
    least = np.ones(draws)
    rank = np.array([basis.shape[1] for basis in bases])
    T = np.add.reduceat((e @ np.hstack(bases)) ** 2, np.cumsum(rank) - rank, axis=1)
    for k in np.unique(rank):  # of suspects of one rank the largest drop counts
        most, left = T[:, rank == k].max(axis=1), dof - k
        least = np.minimum(least, special.fdtrc(k, left, (most / k) / ((rest - most) / left)))
    tests = np.log1p(-0.02) / np.log1p(-np.quantile(least, 0.02))
    return Threshold(-np.expm1(np.log1p(-alarms.SUSPECT) / tests), float(tests))


def _bases(view: Whitened, base: Ints, dof: int) -> list[Array]:
    """Orthonormal bases of what each suspect adds to the base, in coordinates of them all."""
    coordinates = _coordinates(view, base, dof)
    bases = []
    for suspect in range(len(view.suspects)):
        U = linear.span(coordinates[:, view.owner == suspect], float(np.sqrt(linear.LEFT)))
        if U.shape[1]:
            bases.append(U)
    return bases


_MANY = 500
"""Columns of which the products are decomposed faster than those of the rows, however few."""


def _coordinates(view: Whitened, base: Ints, dof: int) -> Array:
    """What the base leaves of all suspects' columns, in an orthonormal basis of it, (d, K).

    From the products of columns, or of rows where these are fewer and the columns many.
    """
    mine = view.first + np.arange(len(view.owner))
    size = np.sqrt(np.maximum(np.diag(view.M)[mine], 1e-300))
    if len(mine) <= max(dof, _MANY):
        S = eliminate(view.M, base)
        values, vectors = linear.directions(S[np.ix_(mine, mine)] / np.outer(size, size))
        kept = values > linear.LEFT
        return np.asarray((np.sqrt(values[kept]) * vectors[:, kept]).T)
    left = Base.of(view.A[:, base], view.A[:, -1]).beyond(view.A[:, mine] / size)
    values, vectors = linear.directions(left @ left.T)
    return np.asarray(vectors[:, values > linear.LEFT].T @ left)


@dataclass(frozen=True)
class Lack:
    """Lack of fit: what free motions of the effector explain beyond the model.

    Attributes:
        p_poses: A free stiffness matrix for each pose, in proportion to the force.
        p_pulls: Free rigid motions of the effector in each pull.
    """

    p_poses: float
    p_pulls: float

    @property
    def found(self) -> bool:
        """True when either is too unlikely."""
        return min(self.p_poses, self.p_pulls) < alarms.LACK_OF_FIT


def lack_of_fit(view: Whitened, base: Ints, score: Beside) -> Lack:
    """Test the base against free motions; the scatter comes from the effector's own rigidity.

    F = (drop / k) / (scatter / nu), with k and nu degrees of freedom: the lack of fit against the
    pure error. drop is the part of the base's residual that free motions explain: those of each
    pose in proportion to the force, or (rest - scatter, dof - nu) those of each pull.

    Without three reflectors the scatter is unknown, and nothing is found; nor where
    free motions add nothing.
    """
    if not view.tells_scatter:
        return Lack(1.0, 1.0)
    noise = max(view.scatter / view.scatter_dof, view.least)

    def p(drop: float, dof: int) -> float:
        return float(special.fdtrc(dof, view.scatter_dof, drop / dof / noise)) if dof > 0 else 1.0

    by_pulls = max(score.rest - view.scatter, 0.0), score.dof - view.scatter_dof
    return Lack(p(*by_pose_drop(view, base)), p(*by_pulls))
