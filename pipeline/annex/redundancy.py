"""How well the readings control each other, and the influence of each pull on the estimates.

Every error e_j of c = B x + G e is tested against the model as a blunder would be: with W = V^-1
and H = B (B'WB)^+ B'W its redundancy number, standardised residual and minimal detectable bias are

    r_j = g_j' W (I - H) g_j,    w_j = g_j' W (c - B x) / sqrt(r_j),    d_j = sqrt(l / r_j),

g_j the column of G and l the noncentrality at which |w_j| > z(1 - `_ALPHA` / 2) with probability
`_POWER`, d_j in standard uncertainties of e_j: Baarda's internal reliability (A Testing Procedure
for Use in Geodetic Networks, 1968). Since sum_j g_j g_j' = V, the r_j add up to rows minus
parameters. The effect of d_j on the estimate, (B'WB)^+ B'W g_j d_j, is the external reliability.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Locked
from pipeline.reduction.register import XYZ, Registration
from pipeline.system.blocks import Blocks
from pipeline.system.system import System
from pipeline.system.whiten import Whitener, whitener

_ALPHA = 0.001
"""False-alarm probability of the test of one reading [1]; Baarda's own choice."""

_POWER = 0.80
"""Probability that the test detects an error of the minimal detectable bias [1]; Baarda's own
choice."""

CRITICAL = float(special.ndtri(1 - _ALPHA / 2))
"""|w| from which a reading is suspected [1]."""

_SHIFT = CRITICAL + float(special.ndtri(_POWER))
"""Mean of |w| at which it is detected with probability `_POWER` [1]:
z(1 - `_ALPHA` / 2) + z(`_POWER`)."""


@dataclass(frozen=True, eq=False)
class Reliability(Locked):
    """How well each of E errors is controlled by the others, and its effect on q quantities a' x.

    Attributes:
        r: Redundancy number, 0 where uncontrolled, shape (E,).
        w: Standardised residual, 0 where uncontrolled, shape (E,).
        visible: Minimal detectable bias in standard uncertainties of the error; infinite where
            uncontrolled, shape (E,).
        moves: Effect of an error of that size, in standard uncertainties of each quantity, shape
            (E, q).
    """

    r: Array
    w: Array
    visible: Array
    moves: Array


@dataclass(frozen=True, eq=False)
class Solution(Locked):
    """A solved system: orthonormal directions of its rows, and the effect of each.

    Rows are whitened by pose, those of the common errors' priors below: [c; 0] = [B A; 0 I] (x, a).

    Attributes:
        white: The whitener.
        U: Orthonormal directions, shape (M + r, d).
        left: Whitened residual, shape (M + r,).
        reach: Effect of each direction on q quantities a' x, shape (q, d).
        std: Their standard uncertainties, infinite where undetermined, shape (q,).
        scale: Factor on the standard uncertainties that the rows are whitened with.
    """

    white: Whitener
    U: Array
    left: Array
    reach: Array
    std: Array
    scale: float

    def sigmas(self, along: Array) -> Array:
        """Effect of steps (..., d) along the directions, in standard uncertainties, (..., q)."""
        return np.asarray(along @ (self.reach / self.std[:, None]).T)


def solution(system: System, asked: Array, scale: float = 1.0) -> Solution:
    """Solve a system once for all questions about its errors and pulls.

    Args:
        system: c, B and G.
        asked: Coefficients a of quantities a' x in the units of x, shape (q, k).
        scale: Factor on the standard uncertainties in G; where G is still relative to the noise of
            the tracker, it is estimated from the residuals instead.
    """
    white = whitener(system.errors, system.rows.pose)
    inverse = linear.pseudoinverse(
        np.hstack([white.with_priors(system.B * system.typical), white.columns])
    )
    y = white.with_priors(system.c)
    left = y - inverse.U @ (inverse.U.T @ y)
    k = system.B.shape[1]
    if system.relative:
        scale = float(np.sqrt(left @ left / max(len(left) - inverse.rank, 1)))
    reach = (asked * system.typical) @ inverse.half[:k]
    std = scale * np.linalg.norm(reach, axis=1)
    lost = (np.abs(asked * system.typical) @ inverse.lost[:k]) > 0
    return Solution(white, inverse.U, left, reach, np.where(lost | (std == 0), np.inf, std), scale)


def reliability(system: System, at: Solution) -> Reliability:
    """Redundancy, w and minimal detectable bias of every column of G.

    The sum of all r is M - rank B, errors common to all poses included: those are columns of the
    least squares, a ~ N(0, I), for which r_k = 1 - |U_k|^2 with U_k the row of the prior.

    Args:
        system: c, B and G.
        at: Its solution.
    """
    errors, blocks, M = system.errors, at.white.blocks, len(system.rows)
    along = np.empty((len(errors.source), at.U.shape[1]))
    r, g = np.empty(len(along)), np.empty(len(along))
    own = np.flatnonzero(~errors.common)
    G = errors.G[:, own].tocoo()
    pose = np.zeros(len(own), np.int64)
    pose[G.col] = blocks.index[G.row]
    place = Blocks.of(pose).place
    D = np.zeros((*blocks.shape, place.max(initial=0) + 1))
    D[blocks.index[G.row], blocks.place[G.row], place[G.col]] = G.data
    D = at.white.inverse @ D
    to = np.swapaxes(D, 1, 2)
    along[own] = (to @ blocks.padded(at.U[:M]))[pose, place]
    g[own] = np.einsum("psn,ps->pn", D, blocks.padded(at.left[:M]))[pose, place]
    r[own] = np.einsum("psn,psn->pn", D, D)[pose, place] - np.sum(along[own] ** 2, axis=1)
    along[errors.common], g[errors.common] = -at.U[M:], -at.left[M:]
    r[errors.common] = 1 - np.sum(at.U[M:] ** 2, axis=1)
    return _reliability(r, g, at.sigmas(along), at.scale)


def _reliability(r: Array, g: Array, moves: Array, scale: float) -> Reliability:
    """From r, g = g_j' W (c - B x), effect of unit errors; none is seen with r up to rounding."""
    seen = r > linear.ROUNDING_LEFT
    root = np.sqrt(np.where(seen, r, 1.0))
    visible = np.where(seen, scale * _SHIFT / root, np.inf)
    with np.errstate(invalid="ignore"):
        moved = np.where(
            np.abs(moves) > linear.ROUNDING_LEFT, np.abs(moves) * visible[:, None], 0.0
        )
    r = np.where(r > linear.PRODUCTS, r, 0.0)
    return Reliability(r, np.where(seen, g / (root * scale), 0.0), visible, moved)


@dataclass(frozen=True, eq=False)
class _BaseReliability(Locked):
    """The same for the readings of the base reflectors, three errors each.

    Attributes:
        each: Of all errors, one reading after the other; their r add up to 3 n - 6.
        error: The errors of one standard uncertainty [m], F_b, shape (3 n, 3).
    """

    each: Reliability
    error: Array


_PIECE = 20_000
"""Maximum number of base readings treated at once: their effects on thirty quantities are 15
MB."""


def of_base(
    registration: Registration, at: Solution, turned: Array, cov: Array
) -> Iterator[_BaseReliability]:
    """Base readings in the adjustment that registers the tracker, 3 n rows and six parameters.

    Their errors affect c through the rotation w of the tracker alone, as `turned` w. Many readings
    are yielded in pieces, in their order.

    Args:
        registration: Registration of the tracker.
        at: The solution of the campaign's system.
        turned: Effect on c of a small rotation of the tracker about the axes of F_b, (M, 3) [m].
        cov: Covariance of that rotation in use [rad^2], shape (3, 3).

    Yields:
        Reliability of the next piece of the readings.
    """
    r, g, rotation, error, scale = _in_registration(registration, cov)
    M = len(turned)
    steps = at.white.by_pose(turned).T @ at.U[:M]  # effect of each axis of the rotation, (3, d)
    for begin in range(0, len(r), 3 * _PIECE):
        some = slice(begin, begin + 3 * _PIECE)
        moves = at.sigmas(rotation[some] @ steps)
        yield _BaseReliability(_reliability(r[some], g[some], moves, scale), error[some])


def _in_registration(
    registration: Registration, cov: Array
) -> tuple[Array, Array, Array, Array, float]:
    """r, g, resulting rotation [rad] and value [m], F_b, of every error, and their common scale."""
    table = registration.table
    C = covariance.full(covariance.turned(covariance.numbers(table), registration.R))
    if not np.isfinite(C).all():
        C = np.broadcast_to(np.eye(3), C.shape)
    factor, white = (covariance.alike(C, make) for make in (covariance.factors, linear.whitening))
    lever = table[XYZ].to_numpy() - registration.centre
    turns = linear.turning(lever)
    moves = np.concatenate([turns, np.broadcast_to(np.eye(3), turns.shape)], axis=2)
    inverse = linear.pseudoinverse((white @ moves).reshape(-1, 6))
    y = (white @ table[["dx_m", "dy_m", "dz_m"]].to_numpy()[..., None]).ravel()
    left = (y - inverse.U @ (inverse.U.T @ y)).reshape(-1, 3)
    D = white @ factor
    along = np.einsum("nij,nid->njd", D, inverse.U.reshape(-1, 3, inverse.rank)).reshape(len(y), -1)
    r = np.einsum("nij,nij->nj", D, D).ravel() - np.sum(along**2, axis=1)
    g = np.einsum("nij,ni->nj", D, left).ravel()
    scale = float(np.sqrt(np.trace(cov) / np.trace(inverse.cov[:3, :3])))
    error = np.swapaxes(factor, 1, 2).reshape(-1, 3) * scale
    return r, g, along @ inverse.half[:3].T, error, scale


def influence(system: System, at: Solution) -> Array:
    """Change of the estimate when each pull is left out, in its standard uncertainties, (m, q).

    Leaving rows out is equivalent to estimating a free error of each: with D their columns, unit
    vectors, and P orthogonal to the model, x moves by -X^+ D s with s = (D'PD)^-1 D'P y (Cook and
    Weisberg, Residuals and Influence, 1982). Infinite for quantities that the other pulls do not
    determine.

    Args:
        system: For its rows; all pulls of a pose share errors, which whitening has removed.
        at: Its solution.
    """
    blocks, pulls = at.white.blocks, Blocks.of(system.rows.pull)
    M = len(system.rows)
    pose = np.zeros(len(pulls.count), np.int64)
    pose[pulls.index] = blocks.index
    row = pulls.padded(blocks.place)
    D = np.swapaxes(at.white.inverse[pose[:, None], :, row], 1, 2) * pulls.there[:, None, :]
    along = np.swapaxes(D, 1, 2) @ blocks.padded(at.U[:M])[pose]
    whole = np.maximum(np.einsum("msn,msn->mn", D, D), ~pulls.there)
    N = np.swapaxes(D, 1, 2) @ D - along @ np.swapaxes(along, 1, 2)
    g = np.einsum("msn,ms->mn", D, blocks.padded(at.left[:M])[pose])
    steps = at.sigmas(along / np.sqrt(whole)[..., None])
    left, V = linear.directions(N / np.sqrt(whole[:, :, None] * whole[:, None, :]))
    seen = left > linear.ROUNDING_LEFT
    mine = np.swapaxes(V, 1, 2) @ steps  # effect of each direction, (m, n, q)
    size = np.einsum("mni,mn->mi", V, g / np.sqrt(whole)) * seen / np.where(seen, left, 1.0)
    alone = (np.abs(mine) * ~seen[..., None]).max(axis=1, initial=0.0) > linear.ROUNDING_LEFT
    return np.where(alone, np.inf, np.abs(np.einsum("mi,miq->mq", size, mine)))
