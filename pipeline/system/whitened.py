"""One campaign whitened at one model: every suspect's columns next to those of the springs.

All questions (is something missing, what, how much, what would another pose add) are then sums of
squares, computed from one matrix of products, columns [springs | common errors | suspects | c], and
from its part of each pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.machine.cell import load
from pipeline.machine.effect import Effect, same_element
from pipeline.system.elimination import coefficients
from pipeline.system.linearised import Linearised, Model, accepted_columns, owners
from pipeline.system.system import SOFT, Errors, Rows
from pipeline.system.whiten import Whitener, whitener

_LOOSE = 0.05
"""How far a law may be off in one pull alone, as a fraction of what it moves; the rest of its
tolerance applies to all pulls together."""


@dataclass(frozen=True, eq=False)
class Whitened(Locked):
    """A campaign linearised at one model and whitened.

    Attributes:
        model: The model; columns are derivatives there.
        suspects: All causes that are tested, accepted ones included.
        owner: Index of the suspect of each suspect column, shape (K,).
        typical: Typical size of each column's parameter: springs, common (1), suspects.
        rows: What each row of the campaign is.
        raw: Columns [springs | suspects | c] before whitening [m], c linearised at the model,
            shape (M, k + K + 1).
        A: [springs | common | suspects | c] in typical sizes, whitened by pose, with one row per
            common error below (its prior), shape (M + r, W). Least squares on these rows weighs
            with the whole V: common errors a ~ N(0, I) are columns with a prior row of their own.
        pose: Index of the pose of each row of A, -1 for priors, shape (M + r,).
        M: A'A, shape (W, W).
        springs: Number of spring columns.
        common: Number of columns of common errors.
        spread: Standard uncertainty of each row of c [m], shape (M,).
        noise: Standard uncertainties are this many times the stated ones.
        seen: The linearised campaign.
        white: Its whitener.
    """

    model: Model
    suspects: tuple[Effect, ...]
    owner: Ints
    typical: Array
    rows: Rows
    raw: Array
    A: Array
    pose: Ints
    M: Array
    springs: int
    common: int
    spread: Array
    noise: float
    seen: Linearised
    white: Whitener

    @cached_property
    def _scatter(self) -> tuple[float, int, float]:
        return _scatter(self.seen, self.white)

    @property
    def scatter(self) -> float:
        """Sum of squares [1] that no rigid motion of the effector can make."""
        return self._scatter[0] / self.noise**2

    @property
    def scatter_dof(self) -> int:
        """Degrees of freedom of `scatter`."""
        return self._scatter[1]

    @property
    def tells_scatter(self) -> bool:
        """Whether the rigid effector determines the scatter of the readings."""
        return self.scatter_dof >= 10

    @property
    def soft_p(self) -> float:
        """Probability of what the reflectors move against each other in proportion to the load.

        If that were scatter; 1 where no degrees of freedom are left for the test.
        """
        return self._scatter[2]

    @cached_property
    def free(self) -> Array:
        """Orthonormal whitened displacements of each pose by a free stiffness of its own.

        Six rigid motions of the effector in proportion to the force, shape (M + r, 6).
        """
        size = np.linalg.norm(self.seen.data.pulls.force, axis=1)[self.rows.pull, None]
        free = _orthonormal(self.white, self.white.by_pose(self.seen.motions * size))
        return np.vstack([free, np.zeros((self.common, 6))])

    @property
    def poses(self) -> int:
        """Number of poses."""
        return int(self.pose.max()) + 1

    def columns(self, suspects: Sequence[int]) -> Ints:
        """Columns of A of some suspects."""
        return self.first + np.flatnonzero(np.isin(self.owner, suspects))

    @property
    def first(self) -> int:
        """First suspect column of A."""
        return self.springs + self.common

    @property
    def base(self) -> Ints:
        """Columns of A of springs, common errors and accepted effects."""
        return np.concatenate([np.arange(self.first), self.columns(self.model.accepted)])

    @property
    def rows_left(self) -> int:
        """Rows of the campaign minus springs: priors of common errors pay for themselves."""
        return len(self.rows) - self.springs

    def without(self, pose: int) -> Array:
        """M without one pose."""
        part = self.A[self.pose == pose]
        return np.asarray(self.M - part.T @ part)


def whiten(
    seen: Linearised,
    noise: float,
    force_noise: float = 1.0,
    doubt: Sequence[tuple[int, float]] = (),
) -> Whitened:
    """Whiten a linearised campaign.

    Args:
        seen: The campaign linearised at a model.
        noise: Standard uncertainties are this many times the stated ones.
        force_noise: The scale's readings scatter this many times more than the tracker's do.
        doubt: Accepted suspects whose law is known to a fraction only: what they move in each
            pull is uncertain by that fraction.
    """
    errors = _widened(seen, doubt, force_noise)
    white = whitener(errors, seen.rows.pose)
    spread = np.sqrt(np.asarray(errors.G.multiply(errors.G).sum(axis=1)).ravel())
    kin = [_kin(seen, accepted, fraction) for accepted, fraction in doubt]
    more = np.concatenate([np.zeros((len(seen.rows), 0)), *kin], axis=1)
    return _view(seen, more, white, noise, spread)


def with_laws(seen: Linearised, errors: Errors, doubt: Sequence[tuple[int, float]]) -> Errors:
    """Errors of c including the uncertainty of the laws of accepted causes, source `law`.

    Args:
        seen: The campaign linearised at a model.
        errors: Its errors without the laws.
        doubt: Accepted suspects, each with the fraction to which its law is known.
    """
    wide = _widened(replace(seen, errors=errors), doubt, 1.0)
    kin = scipy.sparse.csr_array(
        np.concatenate(
            [np.zeros((len(seen.rows), 0)), *(_kin(seen, *one) for one in doubt)], axis=1
        )
    )
    more = kin.shape[1]
    return Errors(
        G=scipy.sparse.hstack([wide.G, kin], format="csr"),
        source=np.concatenate([wide.source, np.full(more, "law", dtype=object)]),
        common=np.concatenate([wide.common, np.ones(more, dtype=bool)]),
    )


def _kin(seen: Linearised, accepted: int, fraction: float) -> Array:
    """Other laws of the same gear, each moving a fraction of what the accepted one moves, (M, j).

    Column k is fraction |Z_a z_a| / |Z_k| Z_k [m], Z_a z_a what the accepted one moves.

    The shape of a law is known to that fraction only, and all pulls deviate together.
    """
    effect = seen.suspects[accepted]
    owner = owners(seen.suspects)
    mine = [c for c in range(len(owner)) if owner[c] == accepted]
    index = dict(accepted_columns(seen.model, seen.suspects))
    moved = seen.Z[:, mine] @ seen.model.values[[index[c] for c in mine]]
    others = [
        i
        for i, other in enumerate(seen.suspects)
        if i not in seen.model.accepted
        and (effect.label == other.label or same_element(effect, other))
    ]
    columns = seen.Z[:, np.isin(owner, others)]
    size = np.linalg.norm(columns, axis=0)
    scale = fraction * np.linalg.norm(moved) / np.where(size > 0, size, np.inf)
    return np.asarray(columns * scale)


def _widened(seen: Linearised, doubt: Sequence[tuple[int, float]], force_noise: float) -> Errors:
    """The errors with the doubt about accepted laws: one error per pull along what they move."""
    errors, rows, Z = seen.errors, seen.rows, seen.Z
    model, suspects = seen.model, seen.suspects
    G, source, common = errors.G, errors.source, errors.common
    if force_noise != 1.0:
        G = G @ scipy.sparse.diags_array(np.where(source == "force_reading", force_noise, 1.0))
        G = scipy.sparse.csr_array(G)
    parts = dict(accepted_columns(model, suspects))
    for accepted, fraction in doubt:
        column = [c for c in parts if owners(suspects)[c] == accepted]
        moved = min(fraction, _LOOSE) * Z[:, column] @ model.values[[parts[c] for c in column]]
        pulls = rows.pull.max() + 1
        block = scipy.sparse.csr_array(
            (moved, (np.arange(len(moved)), rows.pull)), (len(moved), pulls)
        )
        G = scipy.sparse.hstack([G, block], format="csr")
        source = np.concatenate([source, np.full(pulls, "law", dtype=object)])
        common = np.concatenate([common, np.zeros(pulls, dtype=bool)])
    return Errors(G, source, common)


def _view(seen: Linearised, more: Array, white: Whitener, noise: float, spread: Array) -> Whitened:
    model, suspects, rows = seen.model, seen.suspects, seen.rows
    typical_x = np.array([p.typical for p in model.cell.parameters[: model.springs]])
    typical_z = np.array([p.typical for effect in suspects for p in effect.parameters])
    by_pose = white.by_pose(np.column_stack([seen.B * typical_x, more, seen.Z * typical_z, seen.y]))
    k, extra = len(typical_x), more.shape[1]
    common = np.column_stack([white.common, by_pose[:, k : k + extra]])
    r = common.shape[1]
    top = np.column_stack([by_pose[:, :k], common, by_pose[:, k + extra :]]) / noise
    bottom = np.zeros((r, top.shape[1]))
    bottom[:, k : k + r] = np.eye(r)
    A = np.vstack([top, bottom])
    return Whitened(
        model=model,
        suspects=suspects,
        owner=owners(suspects),
        typical=np.concatenate([typical_x, np.ones(r), typical_z]),
        rows=rows,
        raw=np.column_stack([seen.B, seen.Z, seen.y]),
        A=A,
        pose=np.concatenate([white.pose, np.full(r, -1)]),
        M=A.T @ A,
        springs=k,
        common=r,
        spread=noise * spread,
        noise=noise,
        seen=seen,
        white=white,
    )


def _scatter(seen: Linearised, white: Whitener) -> tuple[float, int, float]:
    """Sum of squares of y that no rigid motion of the effector in any pull explains, and its dof.

    |y - Q Q' y|^2 with M - rank Q degrees of freedom, y whitened, Q the whitened rigid motions,
    six to a pull. Third, the p of an F test of what moves single reflectors by the load.

    The effector is stiff: whatever happens to arm, rail, force or tracker, its reflectors keep
    their distances. What changes them is the scatter of the readings alone; or, in proportion to
    the load, a loose nest or a soft effector, and then that is no scatter.
    """
    rows = seen.rows
    place = _place_in_pose(rows)
    wide = np.zeros((len(rows), 6 * (place.max() + 1)))
    wide[np.arange(len(rows))[:, None], 6 * place[:, None] + np.arange(6)] = seen.motions
    basis = _orthonormal(white, white.by_pose(wide))
    dof = len(rows) - round(float(np.sum(basis**2)))
    if dof < 10:
        return 0.0, 0, 1.0

    def bent(columns: Array) -> Array:
        inside = np.einsum("mk,mj->mkj", basis, columns)
        along = np.zeros((white.pose.max() + 1, *inside.shape[1:]))
        np.add.at(along, white.pose, inside)
        return np.asarray(columns - np.einsum("mk,mkj->mj", basis, along[white.pose]))

    mine = bent(white.by_pose(seen.y)[:, None])[:, 0]
    loose = bent(white.by_pose(_loose(seen)))
    U = linear.orthonormal(loose, 1e-6)
    square, k = float(mine @ mine), U.shape[1]
    along = float(np.sum((U.T @ mine) ** 2))
    left = dof - k
    if k == 0 or left < 10:
        return square, dof, 1.0
    p = float(special.fdtrc(k, left, (along / k) / ((square - along) / left)))
    return (square - along, left, p) if p < SOFT else (square, dof, p)


def _loose(seen: Linearised) -> Array:
    """Each reflector by itself, along each axis of F_b and of the tool, by the load, (M, 6 t)."""
    data, rows = seen.data, seen.rows
    axes = load(seen.model.cell, data.pulls, seen.model.values).configuration.flange_axes
    size = np.linalg.norm(data.pulls.force, axis=1)[rows.pull] / 1000.0
    along = np.concatenate([np.eye(3)[rows.axis], axes[rows.pull, rows.axis]], axis=1)
    target = np.repeat(data.target, 3)
    out = np.zeros((len(rows), 6 * (target.max() + 1)))
    out[np.arange(len(rows))[:, None], 6 * target[:, None] + np.arange(6)] = along * size[:, None]
    return out


def _orthonormal(white: Whitener, columns: Array) -> Array:
    """Orthonormal columns within each pose, zero where there are fewer; shape of `columns`."""
    p, s = white.inverse.shape[:2]
    padded = np.zeros((p, s, columns.shape[1]))
    padded[white.pose, white.place] = columns
    U = linear.spans(padded)
    out = np.zeros_like(columns)
    out[:, : U.shape[2]] = U[white.pose, white.place]
    return out


def _per_pose(pose: Ints, rows: Array) -> Array:
    """Sums of rows over each pose, shape (p, any)."""
    out = np.zeros((pose.max() + 1, rows.shape[1]))
    np.add.at(out, pose, rows)
    return out


def _place_in_pose(rows: Rows) -> Ints:
    """Number of each row's pull within its pose, from 0."""
    _, first = np.unique(rows.pose, return_inverse=True)
    start = np.full(first.max() + 1, np.iinfo(np.int64).max)
    np.minimum.at(start, first, rows.pull)
    return rows.pull - start[first]


def by_pose_drop(view: Whitened, base: Ints) -> tuple[float, int]:
    """Sum of squares that a free stiffness of each pose takes out of the base's residual; dof.

    sum_p |F_p' r_p|^2 with r = y - A_base b whitened and F_p the six columns of `free` in pose p;
    their ranks together minus springs and accepted causes are its degrees of freedom.
    """
    residual = view.A[:, -1] - view.A[:, base] @ coefficients(view.M, base)
    mine = view.pose >= 0
    along = _per_pose(view.pose[mine], view.free[mine] * residual[mine, None])
    dof = round(float(np.sum(view.free**2))) - view.springs - (len(base) - view.first)
    return float(np.sum(along**2)), max(dof, 1)
