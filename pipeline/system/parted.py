"""Rows whose noise has two parts, along and across a direction, and their restricted likelihood.

With rows turned so that one of each displacement lies along its direction u and two across,

    V_p = a^2 A_p + b^2 B_p + F_p F_p',

A_p on the rows along only, B_p on those across, F_p a few other errors of the pose. Whitened by A
and B, with Z = [X, y] and S_p = I + F_p' A_p^-1 F_p / a^2 + F_p' B_p^-1 F_p / b^2,

    Z' V^-1 Z = Z' A^-1 Z / a^2 + Z' B^-1 Z / b^2 - sum_p H_p' H_p,
    S_p^1/2 H_p = F_p' A_p^-1 Z_p / a^2 + F_p' B_p^-1 Z_p / b^2,
    log|V| = log|A| + log|B| + 2 n_A log a + 2 n_B log b + sum_p log|S_p|

(Woodbury, 1950): products of rows are formed once for all a and b.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.system.blocks import Blocks
from pipeline.system.restricted import lowest, of_fixed
from pipeline.system.system import Errors, System
from pipeline.system.whiten import Whitener, whitener


@dataclass(frozen=True, eq=False)
class _PartProducts(Locked):
    """Products of the rows of one part, whitened by its covariance.

    Attributes:
        count: Number of rows.
        log_det: Natural logarithm of the determinant of their covariance.
        ZZ: Z'Z, shape (k, k).
        FZ: F'Z of each pose, shape (p, e, k), of poses that are computed together.
        FF: F'F of each pose, shape (p, e, e), likewise.
    """

    count: int
    log_det: float
    ZZ: Array
    FZ: list[Array]
    FF: list[Array]

    @classmethod
    def of(cls, white: Whitener, rows: Array, errors: Blocks, size: Array) -> _PartProducts:
        """The products of rows [F, Z] (n, e + k), errors multiplied by `size` (n,)."""
        rows = white.by_pose(rows / size[:, None])
        k = rows.shape[1] - errors.shape[1]
        ZZ, FZ, FF = np.zeros((k, k)), list[Array](), list[Array]()
        for poses in errors.alike:
            mine, blocks = white.blocks.only(poses)
            both = blocks.padded(rows[mine])
            F, Z = both[..., : errors.count[poses].max()], both[..., errors.shape[1] :]
            flat = Z.reshape(-1, Z.shape[2])
            ZZ += flat.T @ flat
            FZ.append(np.swapaxes(F, 1, 2) @ Z)
            FF.append(np.swapaxes(F, 1, 2) @ F)
        inverse = np.einsum("pii->pi", white.inverse)
        return cls(len(rows), 2 * float(np.log(size).sum() - np.log(inverse).sum()), ZZ, FZ, FF)


@dataclass(frozen=True, eq=False)
class PartedRows(Locked):
    """Rows of a campaign, turned along and across their directions.

    Attributes:
        errors: Other errors F by pose, at most e each.
        white: Whitener of the rows along, and of those across.
        rows: Their columns [F, X, common errors, y], (d, e + k) and (2 d, e + k).
        prior: 0 for the fixed effects, 1 for the common errors, which are random, (k - 1,).
        rough: Common log scale of both parts that reproduces the residual mean square.
        parts: Products of both.
    """

    errors: Blocks
    white: tuple[Whitener, Whitener]
    rows: tuple[Array, Array]
    prior: Array
    rough: float
    parts: tuple[_PartProducts, _PartProducts]

    @classmethod
    def of(cls, system: System, Q: Array, u: Array, own: Bools) -> PartedRows:
        """The rows of a system.

        Args:
            system: Rows c and their errors, three rows to a displacement.
            Q: Orthonormal fixed effects, shape (M, j).
            u: Direction of each displacement, shape (d, 3).
            own: Errors that have the two parts, shape (E,).

        Raises:
            LinAlgError: A row has no noise.
        """
        errors, pose = system.errors, system.rows.pose
        unit = linear.rms(system.c) or 1.0
        y = (system.c - Q @ (Q.T @ system.c)) / unit  # free of the fixed effects
        A = errors.G[:, errors.common].toarray() / unit
        which, F = Blocks.of(pose).dense(errors.G[:, ~errors.common & ~own])
        frames = linear.principal(u[:, None])[2]
        rows = frames @ np.column_stack([F / unit, Q, A, y]).reshape(len(u), 3, -1)
        turn = scipy.sparse.bsr_array((frames, np.arange(len(u)), np.arange(len(u) + 1)))
        G = scipy.sparse.csr_array(turn @ (errors.G[:, own] / unit))
        along, across = np.arange(0, 3 * len(u), 3), np.flatnonzero(np.arange(3 * len(u)) % 3)
        white = _whitener(G[along], pose[along]), _whitener(G[across], pose[across])
        rest = max(y @ y, linear.TINY) / max(G.power(2).sum(), linear.TINY)
        cut = rows[:, 0], rows[:, 1:].reshape(2 * len(u), -1)
        parts = [
            _PartProducts.of(w, r, which, np.ones(len(r))) for w, r in zip(white, cut, strict=True)
        ]
        return cls(
            errors=which,
            white=white,
            rows=cut,
            prior=np.repeat([0.0, 1.0], [Q.shape[1], A.shape[1]]),
            rough=0.5 * float(np.log(rest)),
            parts=(parts[0], parts[1]),
        )

    def grown(self, size: Array) -> PartedRows:
        """The same with the part across multiplied by `size` (d,)."""
        across = _PartProducts.of(self.white[1], self.rows[1], self.errors, np.repeat(size, 2))
        return replace(self, parts=(self.parts[0], across))

    def loss(self, log_scale: Array) -> tuple[Array, float]:
        """Minus twice the restricted log likelihood: log|S_p|, shape (p,), and the rest."""
        (along, across), (a, b) = self.parts, np.exp(-2 * log_scale)
        ZZ, own = a * along.ZZ + b * across.ZZ, list[Array]()
        every = zip(self.errors.alike, along.FZ, across.FZ, along.FF, across.FF, strict=True)
        for poses, FZ, more_FZ, FF, more_FF in every:
            L = np.linalg.cholesky(a * FF + b * more_FF + np.eye(FF.shape[1]))
            H = self.errors.only(poses)[1].solve(L, a * FZ + b * more_FZ).reshape(-1, len(ZZ))
            ZZ -= H.T @ H
            own.append(2 * np.log(np.einsum("pii->pi", L)).sum(axis=1))
        pairs = zip(self.parts, log_scale, strict=True)
        fixed = sum(part.log_det + 2 * part.count * t for part, t in pairs)
        N = ZZ[:-1, :-1] + np.diag(self.prior)
        return np.concatenate(own), float(fixed + ZZ[-1, -1] + of_fixed(N, ZZ[:-1, -1]))

    def whole(self, log_scale: Array) -> float:
        """Minus twice the restricted log likelihood, up to a constant."""
        own, rest = self.loss(log_scale)
        return float(own.sum() + rest)

    def alike(self) -> float:
        """Minimum of the loss with one scale for both parts."""
        one = lowest(lambda x: self.loss(np.repeat(x, 2)), np.array([self.rough]))
        return self.whole(np.repeat(one, 2))


def _whitener(G: scipy.sparse.csr_array, pose: Ints) -> Whitener:
    """Whitener of rows with errors G that each stay within one pose."""
    n = G.shape[1]
    return whitener(Errors(G, np.full(n, "own", dtype=object), np.zeros(n, dtype=bool)), pose)
