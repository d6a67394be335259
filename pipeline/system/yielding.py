"""No element yields against its load: the bound on what changes a spring's compliance.

A small further part of a pull does the work

    w = sum_j c_j tau_j^2 + sum_k z_k w_k >= 0

at the joints whose compliances c_j a suspect changes (`machine.cell.further_work`): one that varies
with posture, load, sense or time is nowhere negative. The springs are estimated beside the size z,
c = c_0 - R z, so that each pull bounds it by o + n' z >= 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.machine.cell import baseline, further_work, load
from pipeline.machine.effect import Effect, Elastic
from pipeline.system.linearised import Linearised
from pipeline.system.score_tests import ScoreTests

_NOTHING = 1e-100
"""Lower limit of a standard uncertainty, which keeps quotients finite."""

_ROUNDED = 1e-12
"""Part of the work of a pull at several springs that is rounding [1]: their torques carry more than
six digits."""


@dataclass(frozen=True, eq=False)
class Yielding:
    """The bound of each suspect in the pull in which its size comes closest to it, or is beyond.

    Attributes:
        offset: o, infinite for suspects whose compliance no pull bounds, shape (n,).
        normal: n per typical size, shape (n, k).
        var: Variance of o, by the springs, at unit variance of the rows, shape (n,).
    """

    offset: Array
    normal: Array
    var: Array

    def distance(self, size: Array, cov: Array) -> tuple[Array, Array]:
        """The work o + n' z and its standard uncertainty at unit variance of the rows, (..., n).

        Args:
            size: z, shape (..., n, k).
            cov: Its covariance, shape (..., n, k, k).
        """
        var = np.einsum("nk,...nkl,nl->...n", self.normal, cov, self.normal) + self.var
        std = np.sqrt(np.maximum(var, _NOTHING**2))
        return self.offset + np.einsum("nk,...nk->...n", self.normal, size), std


@dataclass(frozen=True, eq=False)
class Work:
    """Work of a small further part of each pull, in typical sizes, where a suspect acts.

    Attributes:
        suspects: Those that change the compliance of an element, shape (n,).
        springs: Work by the joint springs that each of them changes, shape (n, m, s).
        own: Work by itself, shape (n, m, k).
    """

    suspects: Ints
    springs: Array
    own: Array

    @classmethod
    def of(cls, seen: Linearised, suspects: Sequence[Effect], typical: Array, most: int) -> Work:
        """Of some suspects with at most so many parameters; typical sizes of the springs first."""
        some = {i: e for i, e in enumerate(suspects) if isinstance(e, Elastic) and e.modulates}
        if not some:
            return cls(np.zeros(0, np.int64), np.zeros((0, 1, 1)), np.zeros((0, 1, most)))
        loaded = load(seen.model.cell, seen.data.pulls, seen.model.values)
        (joints,) = baseline(seen.model.cell.robot)
        tau2 = further_work(joints, loaded) * typical[: len(joints.parameters)]
        springs, own = np.zeros((len(some), *tau2.shape)), np.zeros((len(some), len(tau2), most))
        for n, effect in enumerate(some.values()):
            scale = [p.typical for p in effect.parameters]
            own[n, :, : len(scale)] = further_work(effect, loaded) * scale
            at = [] if effect.twists else [joint - 1 for joint in effect.carrier]
            springs[n, :, at] = tau2[:, at].T
        return cls(np.array([*some]), springs, own)

    def bound(self, M: Array, base: Ints, at: Ints, now: ScoreTests) -> Yielding:
        """The bounds in addition to one base.

        A pull bounds what it loads, and only where the data determine the springs there.

        Args:
            M: Products of whitened columns, the last one c, shape (W, W).
            base: Columns of the base, those of the springs first.
            at: Columns of each suspect, padded with -1, shape (n, k).
            now: The statistics of the suspects beside that base.
        """
        out = Yielding(np.full(len(at), np.inf), np.zeros(at.shape), np.zeros(len(at)))
        mine, s = self.suspects, self.springs.shape[2]
        if not len(mine):
            return out
        cov, there = linear.covariance(M[np.ix_(base, base)])[:s], at[mine, None]
        lost = np.isinf(np.diag(cov))
        cov[lost] = 0.0
        offset = np.maximum(self.springs @ (cov @ M[base, -1]), 0.0)
        normal = self.own - self.springs @ (cov @ (M[base[:, None], there] * (there >= 0)))
        var = np.sum((self.springs @ cov[:, :s]) * self.springs, axis=2)
        spread = np.sqrt(np.sum((normal @ now.cov[mine]) * normal, axis=2) + var)
        unknown = self.springs[:, :, lost] > _ROUNDED * self.springs.max(axis=2, keepdims=True)
        offset[unknown.any(axis=2) | (spread <= _NOTHING)] = np.inf
        value = offset + np.einsum("nmk,nk->nm", normal, now.size[mine])
        least = np.arange(len(mine)), np.argmin(value / np.maximum(spread, _NOTHING), axis=1)
        out.offset[mine], out.normal[mine], out.var[mine] = offset[least], normal[least], var[least]
        return out
