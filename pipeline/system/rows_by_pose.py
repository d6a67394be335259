"""Rows of a campaign with springs and causes as fixed effects: their residuals show the noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.reduction.measured import Measured
from pipeline.system.blocks import Blocks
from pipeline.system.contrasts import own_columns, ways
from pipeline.system.linearised import Linearised
from pipeline.system.score_tests import Base
from pipeline.system.system import Errors, System
from pipeline.system.whiten import Whitener, whitener


@dataclass(frozen=True, eq=False)
class RowsByPose(Locked):
    """A campaign's rows, whitened by pose, and the columns that are estimated in any case.

    Attributes:
        white: Their whitener.
        X: Springs and causes, orthonormal, then common errors, shape (M, k + r).
        prior: 0 for springs and causes, which are fixed, 1 for common errors, which are random,
            shape (k + r,).
        y: The rows, shape (M,).
    """

    white: Whitener
    X: Array
    prior: Array
    y: Array

    @classmethod
    def beside(cls, seen: Linearised, Q: Array, errors: Errors) -> RowsByPose:
        """The rows with orthonormal fixed columns (M, k): they stay independent when whitened."""
        white = whitener(errors, seen.rows.pose)
        fixed = linear.independent(white.by_pose(Q))
        prior = np.repeat([0.0, 1.0], [fixed.shape[1], white.common.shape[1]])
        return cls(white, np.hstack([fixed, white.common]), prior, white.by_pose(seen.y))

    @cached_property
    def base(self) -> Base:
        """The same as a `Base`, for tests of single readings."""
        r = int(self.prior.sum())
        rows = np.vstack([self.X, np.diag(self.prior)[self.prior > 0]])
        fixed = rows.shape[1] - r
        y = np.append(self.y, np.zeros(r))
        return Base.spanned(rows[:, :fixed], y, self.white.key).more(rows[:, fixed:])

    def rotated(self, factor: Array) -> tuple[Array, Array, Array]:
        """Rows in which the covariance of each pose with this factor (M, j) is diagonal.

        It is W = A A', A the factor whitened by pose.

        Returns:
            Variances on its diagonal (M,), and y (M,) and X (M, k + r) in these rows.
        """
        A, both, found = self.white.by_pose(factor), np.column_stack([self.y, self.X]), []
        blocks = self.white.blocks
        for mine, some in map(blocks.only, blocks.alike):
            a = some.padded(A[mine])
            W = a @ np.swapaxes(a, 1, 2) + np.eye(some.shape[1]) * some.there[:, None, :]
            values, C = linear.directions(W)
            there = values > 0.5  # padding has none
            turned = np.swapaxes(C, 1, 2) @ some.padded(both[mine])
            found.append((values[there] - 1, turned[there]))
        w, rows = (np.concatenate(each) for each in zip(*found, strict=True))
        return np.maximum(w, 0.0), rows[:, 0], rows[:, 1:]


def columns(seen: Linearised, causes: Bools) -> Array:
    """Springs and the suspect columns selected by `causes`, in their typical sizes, (M, k)."""
    typical = np.array([p.typical for p in seen.model.cell.parameters[: seen.model.springs]])
    others = np.array([p.typical for effect in seen.suspects for p in effect.parameters])
    return np.hstack([seen.B * typical, (seen.Z * others)[:, causes]])


def free(seen: Linearised) -> Array:
    """Six motions in proportion to the pull for each way of loading each pose, (M, 6 n)."""
    pulls, at = seen.data.pulls, seen.rows.pull
    size = np.linalg.norm(pulls.force, axis=1)[at, None]
    both = np.column_stack([pulls.pose, ways(pulls)])
    number = np.unique(both, axis=0, return_inverse=True)[1].ravel()
    return own_columns(seen.motions * size, number[at])


@dataclass(frozen=True, eq=False)
class ReadingsOfRows(Locked):
    """The readings behind the rows: each loaded target, and the zero of each target in each pose.

    Attributes:
        loaded: Number of loaded readings: one for each displacement, in that order.
        zero: Number in `Measured.zero` of each unloaded reading.
        zero_of: Number of the zero of each displacement, shape (d,).
        state: Pose of each reading, loaded ones first, and its pull, -1 for zeros, shape (n, 2).
        D: Effect of one standard uncertainty of each reading, along three axes, on the rows of its
            pose, whitened, shape (p, s, q, 3).
        blocks: Readings by pose, at most q each.
    """

    loaded: int
    zero: Ints
    zero_of: Ints
    state: Ints
    D: Array
    blocks: Blocks

    @classmethod
    def of(cls, data: Measured, white: Whitener) -> ReadingsOfRows:
        """All readings of a campaign."""
        d, blocks = len(data.pull), white.blocks
        pose_of = blocks.index[3 * np.arange(d)]
        zero, first, number = np.unique(data.zero, return_index=True, return_inverse=True)
        of = Blocks.of(np.concatenate([pose_of, pose_of[first]]))
        raw, at = np.zeros((d, 3, of.shape[1], 3)), np.arange(d)
        raw[at, :, of.place[:d]] = covariance.factors(data.loaded_cov)
        raw[at, :, of.place[d:][number]] = covariance.factors(data.zero_cov)
        D = white.by_pose(raw.reshape(3 * d, -1)).reshape(3 * d, -1, 3)
        return cls(d, zero, data.zero, _states(data), blocks.padded(D), of)

    def targets(self, data: Measured) -> Ints:
        """Index of the target of each reading, loaded ones first, shape (n,)."""
        return data.target[_first(data)]

    @classmethod
    def unseen(cls, data: Measured) -> ReadingsOfRows:
        """The same without their effect on the rows, where it is not needed."""
        zero, state, none = np.unique(data.zero), _states(data), np.zeros((0, 0, 0, 3))
        return cls(len(data.pull), zero, data.zero, state, none, Blocks.of(state[:0, 0]))

    def columns(self, system: System) -> Ints:
        """Number of the reading behind each column of G, -1 where there is none, shape (E,)."""
        source = system.errors.source.astype(str)
        out = np.full(len(source), -1)
        G = system.errors.G.tocsc()
        for name, start in (("tracker", 0), ("zero", self.loaded)):
            mine = np.flatnonzero(source == name)
            row = G.indices[G.indptr[mine]] // 3
            of = row if name == "tracker" else np.searchsorted(self.zero, self.zero_of[row])
            out[mine] = start + of
        return out

    def scaled(self, data: Measured, variance: Array) -> Measured:
        """The measurements with the covariance of each reading multiplied by `variance` (n,)."""
        of_zero = np.ones(int(data.zero.max()) + 1)
        of_zero[self.zero] = variance[self.loaded :]
        return data.reweighed(variance[: self.loaded], of_zero[data.zero])


def _first(data: Measured) -> Ints:
    """A displacement of each loaded reading, and of each zero."""
    return np.append(np.arange(len(data.pull)), np.unique(data.zero, return_index=True)[1])


def _states(data: Measured) -> Ints:
    """Pose of each reading, loaded ones first, and its pull, -1 for zeros, shape (n, 2)."""
    pulls, of = data.pulls, data.pull[_first(data)]
    nth = np.where(np.arange(len(of)) < len(data.pull), pulls.repeat[of], -1)
    return np.column_stack([pulls.pose[of], nth])


def estimates(base: Base, readings: ReadingsOfRows) -> tuple[Array, Array, Bools]:
    """Each reading's error estimated from the other readings, in its standard uncertainties.

    x = N^-1 g with N = D'PD and g = D'Py, see `beside`; its covariance is N^-1 = R diag(v) R'.

    Returns:
        Squares of R'x (n, 3), variances v (n, 3), and where all three axes are controlled, (n,).
    """
    found = base.beside(readings.D).rows(readings.blocks)
    good = found.rank == 3
    N = np.where(good[:, None, None], found.N, np.eye(3))
    values, R = linear.directions(N)
    return (np.einsum("nij,ni->nj", R, found.g) / values) ** 2, 1 / values, np.asarray(good)
