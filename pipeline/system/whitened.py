"""One campaign whitened at one model: every suspect's columns next to those of the springs.

All questions (is something missing, what, how much, what would another pose add) are then sums of
squares, computed from one matrix of products, columns [springs | common errors | suspects | c], and
from the contribution of each pose to it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.bootstrap import unproven
from pipeline.machine.cell import Cell, load, seated_elsewhere
from pipeline.machine.effect import Effect, Elastic, same_element
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.blocks import Blocks
from pipeline.system.contrasts import own_columns, ways
from pipeline.system.elimination import coefficients
from pipeline.system.evidence import ROUNDING, Scores
from pipeline.system.linearised import CurrentModel, Linearised, accepted_columns, linearise, owners
from pipeline.system.score_tests import Base, by_products, left_out, padded
from pipeline.system.system import Errors, RowIndex
from pipeline.system.whiten import Whitener, whitener
from pipeline.system.yielding import Work

_FEWEST = 10
"""Minimum degrees of freedom of a scatter to test against it."""

_LOOSE = 0.05
"""Maximum error of a law in one pull alone, as a fraction of the displacement it causes [1]; the
rest of its tolerance applies to all pulls together."""


@dataclass(frozen=True, eq=False)
class Whitened(Locked):
    """A campaign linearised at one model and whitened.

    Attributes:
        model: The model; columns are derivatives there.
        suspects: All causes that are tested, accepted ones included.
        owner: Index of the suspect of each suspect column, shape (K,).
        typical: Typical size of each column's parameter: springs, common (1), suspects.
        rows: Identity of each row of the campaign.
        raw: Columns [springs | suspects | c] before whitening [m], c linearised at the model, shape
            (M, k + K + 1).
        A: [springs | common | suspects | c] in typical sizes, whitened by pose, with one row per
            common error below (its prior), shape (M + r, W). Least squares on these rows weights
            with the whole V: common errors a ~ N(0, I) are columns with a prior row of their own.
        pose: Index of the pose of each row of A, -1 for priors, shape (M + r,).
        M: A'A, shape (W, W).
        springs: Number of spring columns.
        common: Number of columns of common errors.
        spread: Standard uncertainty of each row of c [m], shape (M,).
        noise: Factor on the stated standard uncertainties.
        least: Lower limit of the residual mean square: below it residuals are rounding, or were
            reduced by reweighting.
        seen: The linearised campaign.
        white: Its whitener.
    """

    model: CurrentModel
    suspects: tuple[Effect, ...]
    owner: Ints
    typical: Array
    rows: RowIndex
    raw: Array
    A: Array
    pose: Ints
    M: Array
    springs: int
    common: int
    spread: Array
    noise: float
    least: float
    seen: Linearised
    white: Whitener

    @cached_property
    def _rigid(self) -> _Rigid:
        return _rigid(self.seen, self.white)

    @property
    def scatter(self) -> float:
        """Residual sum of squares after all rigid motions of the effector are estimated [1]."""
        return self._rigid.square / self.noise**2

    @property
    def scatter_dof(self) -> int:
        """Degrees of freedom of `scatter`."""
        return self._rigid.dof

    @property
    def tells_scatter(self) -> bool:
        """Whether the rigid effector determines the scatter of the readings."""
        return self.scatter_dof >= _FEWEST

    @property
    def soft_p(self) -> float:
        """p-value of the motion of reflectors against each other in proportion to the load.

        1 where no degrees of freedom are left for the test.
        """
        return self._rigid.soft_p

    @cached_property
    def free(self) -> Base:
        """A free stiffness of each way of loading each pose: six motions in proportion to force."""
        pulls, at = self.seen.data.pulls, self.rows.pull
        moves = self.seen.motions * np.linalg.norm(pulls.force, axis=1)[at, None]
        return self.white.own_base(own_columns(moves, ways(pulls)[at]), self.seen.y)

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

    @cached_property
    def rows_left(self) -> int:
        """Rows minus rank of the springs; common errors bring a prior row each."""
        return len(self.rows) - _taken(self)

    def beside(
        self, base: Ints, M: Array | None = None, fewer: int = 0, among: Ints | None = None
    ) -> Scores:
        """Every suspect tested in addition to a base.

        Args:
            base: Columns of A that are estimated in any case.
            M: Products to use instead of the whole campaign's.
            fewer: Number of rows missing in them.
            among: Columns of each suspect, padded with -1, shape (n, k); those of `at` when not
                given.
        """
        dof = self.dof(base) - fewer
        at = self.at if among is None else among
        found = by_products(self.M if M is None else M, base, at, dof, self.least)
        if among is not None:
            return Scores(**vars(found))
        odds = np.array([effect.odds for effect in self.suspects])
        expected = np.array([effect.size for effect in self.suspects])
        return Scores(
            **vars(found),
            bounds=self.bounds,
            yielding=self._work.bound(self.M if M is None else M, base, at, found),
            log_odds=np.log(odds),
            expected=expected,
        )

    @cached_property
    def _work(self) -> Work:
        return Work.of(self.seen, self.suspects, self.typical, self.at.shape[1])

    @cached_property
    def at(self) -> Ints:
        """Columns of each suspect, padded with -1, shape (n, k)."""
        first = np.searchsorted(self.owner, np.arange(len(self.suspects) + 1))  # one by one
        every = self.first + np.arange(len(self.owner))
        return padded([every[a:b] for a, b in itertools.pairwise(first.tolist())])

    @cached_property
    def bounds(self) -> Array:
        """Physical bounds of each of these columns, in typical sizes, shape (2, n, k)."""
        out = np.stack([np.full(self.at.shape, -np.inf), np.full(self.at.shape, np.inf)])
        for i, effect in enumerate(self.suspects):
            for k, p in enumerate(effect.parameters):
                out[:, i, k] = p.lower / p.typical, p.upper / p.typical
        return out

    def left_out(self, base: Ints) -> Array:
        """Residuals c - B x [m] of each pose left out of an estimate of the base, shape (M,)."""
        rows = np.zeros((len(self.rows), len(base)))
        kept, raw = self._raw(base)
        rows[:, kept] = self.raw[:, raw] * self.typical[base[kept]]
        return left_out(self.A[:, base], self.A[:, -1], self.pose, rows, self.raw[:, -1])[0]

    def unproven(
        self, kept: Ints, rng: np.random.Generator, tests: Bools | slice = slice(None)
    ) -> float:
        """`unproven` of the accepted causes beside those of their columns that are kept.

        Args:
            kept: Columns of causes that remain; springs and common errors do anyway.
            rng: Source of the bootstrap.
            tests: Readings that are compared, shape (M,).
        """
        before = self.left_out(np.concatenate([np.arange(self.first), kept]))[tests]
        pose = np.unique(self.pose[: len(self.rows)][tests], return_inverse=True)[1]
        return unproven(before, self.left_out(self.base)[tests], pose, rng)

    def predicted(self, base: Ints, M: Array, rows: Bools) -> Array:
        """Prediction of some rows of c [m] by a base estimated from products M."""
        kept, raw = self._raw(base)
        x = coefficients(M, base) * self.typical[base]
        return np.asarray(self.raw[np.ix_(rows, raw)] @ x[kept])

    def _raw(self, base: Ints) -> tuple[Bools, Ints]:
        """Base columns that contribute to a prediction, not common errors, and those of `raw`."""
        kept = (base < self.springs) | (base >= self.first)
        return kept, np.where(base < self.springs, base, base - self.common)[kept]

    def dof(self, base: Ints) -> int:
        """Residual degrees of freedom of a base."""
        return self.rows_left - (len(base) - self.first)

    def without(self, pose: int) -> Array:
        """M without one pose."""
        part = self.A[self.pose == pose]
        return np.asarray(self.M - part.T @ part)


def whiten(
    seen: Linearised,
    noise: float,
    force_noise: float = 1.0,
    doubt: Sequence[tuple[int, float]] = (),
    in_each: bool = True,
) -> Whitened:
    """Whiten a linearised campaign.

    Args:
        seen: The campaign linearised at a model.
        noise: Factor on the stated standard uncertainties.
        force_noise: Factor on the scatter of the scale's readings, relative to the tracker's.
        doubt: Accepted suspects whose law is known to a fraction only: their effect in each pull is
            uncertain by that fraction.
        in_each: Whether the law may err in each pull otherwise, or in all pulls alike only.
    """
    errors = _widened(seen, doubt if in_each else (), force_noise)
    white = whitener(errors, seen.rows.pose)
    spread = np.sqrt(np.asarray(errors.G.multiply(errors.G).sum(axis=1)).ravel())
    kin = [part for one in doubt for part in _kin(seen, *one)]
    more = np.concatenate([np.zeros((len(seen.rows), 0)), *kin], axis=1)
    return _view(seen, more, white, noise, spread)


def with_laws(seen: Linearised, errors: Errors, doubt: Sequence[tuple[int, float]]) -> Errors:
    """Errors of c including the uncertainty of the laws of accepted causes, source `law`.

    Where an element sits is common to all pulls too, of source `seat`.

    Args:
        seen: The campaign linearised at a model.
        errors: Its errors without the laws.
        doubt: Accepted suspects, each with the fraction to which its law is known.
    """
    errors = _widened(replace(seen, errors=errors), doubt, 1.0)
    for one in doubt:
        for source, G in zip(("law", "seat"), _kin(seen, *one), strict=True):
            names, common = np.full(G.shape[1], source, dtype=object), np.ones(G.shape[1], bool)
            errors = errors.beside(Errors(scipy.sparse.csr_array(G), names, common))
    return errors


def of_laws(
    cell: Cell, data: Measured, values: Array, causes: Sequence[Effect], suspects: Sequence[Effect]
) -> Errors:
    """Errors of c by the tolerance of the laws of a cell's causes alone, as of `with_laws`.

    Args:
        cell: Joint springs, then the causes.
        data: The measurements.
        values: Their parameters, shape (k,).
        causes: The causes.
        suspects: All causes that are tested; those of the same element as one of the cell's are
            what its law may be instead.
    """
    forms = {(one.label, one.form) for one in causes}
    others = [
        one
        for one in suspects
        if (one.label, one.form) not in forms
        and any(one.label == own.label or same_element(own, one) for own in causes)
    ]
    springs = len(values) - sum(len(one.parameters) for one in causes)
    model = CurrentModel(cell, values, springs, tuple(range(len(causes))))
    seen = linearise(model, data, (*causes, *others))
    nothing = Errors(
        scipy.sparse.csr_array((len(seen.rows), 0)), np.zeros(0, dtype=object), np.zeros(0, bool)
    )
    return with_laws(seen, nothing, [(k, one.tolerance) for k, one in enumerate(causes)])


def _kin(seen: Linearised, accepted: int, fraction: float) -> tuple[Array, Array]:
    """What an accepted law may be instead, each to a fraction of its effect, (M, j) and (M, 6).

    Alternative laws of the same element: column k is fraction |Z_a z_a| / |Z_k| Z_k [m], Z_a z_a
    the effect of the accepted one. And its own where an elastic element sits elsewhere.

    The shape of a law is known to that fraction only, and all pulls deviate together.
    """
    effect = seen.suspects[accepted]
    owner = owners(seen.suspects)
    mine = [c for c in range(len(owner)) if owner[c] == accepted]
    index = dict(accepted_columns(seen.model, seen.suspects))
    part = seen.model.values[[index[c] for c in mine]]
    moved = seen.Z[:, mine] @ part
    others = [
        i
        for i, other in enumerate(seen.suspects)
        if i not in seen.model.accepted
        and (effect.label == other.label or same_element(effect, other))
    ]
    columns = seen.Z[:, np.isin(owner, others)]
    size = np.linalg.norm(columns, axis=0)
    scale = fraction * np.linalg.norm(moved) / np.where(size > 0, size, np.inf)
    return columns * scale, _elsewhere(seen, effect, part, fraction)


def _elsewhere(seen: Linearised, effect: Effect, part: Array, fraction: float) -> Array:
    """`seated_elsewhere` of an element whose seat its joint does not give, (M, 6), else (M, 0)."""
    if not isinstance(effect, Elastic) or effect.twists is None:
        return np.zeros((len(seen.rows), 0))
    flat, data = replace(seen.model.cell, equilibrium="undeformed"), seen.data
    off = seated_elsewhere(flat, data.pulls, seen.model.values, effect, part, fraction)
    return off[data.pull, data.target].reshape(-1, off.shape[-1])


def _widened(seen: Linearised, doubt: Sequence[tuple[int, float]], force_noise: float) -> Errors:
    """Errors including the doubt about accepted laws: one error per pull along their effect."""
    errors, rows, Z = seen.errors, seen.rows, seen.Z
    model, suspects = seen.model, seen.suspects
    G, source, common = errors.G, errors.source, errors.common
    if force_noise != 1.0:
        G = G @ scipy.sparse.diags_array(np.where(source == "force_reading", force_noise, 1.0))
        G = scipy.sparse.csr_array(G)
    parts = dict(accepted_columns(model, suspects))
    widened = Errors(G, source, common)
    for accepted, fraction in doubt:
        column = [c for c in parts if owners(suspects)[c] == accepted]
        moved = min(fraction, _LOOSE) * Z[:, column] @ model.values[[parts[c] for c in column]]
        pulls = rows.pull.max() + 1
        block = scipy.sparse.csr_array(
            (moved, (np.arange(len(moved)), rows.pull)), (len(moved), pulls)
        )
        law = np.full(pulls, "law", dtype=object)
        widened = widened.beside(Errors(block, law, np.zeros(pulls, dtype=bool)))
    return widened


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
        pose=np.concatenate([white.blocks.index, np.full(r, -1)]),
        M=A.T @ A,
        springs=k,
        common=r,
        spread=noise * spread,
        noise=noise,
        least=max(ROUNDING, seen.data.heavy / noise**2),
        seen=seen,
        white=white,
    )


@dataclass(frozen=True)
class _Rigid:
    """What no rigid motion of the effector explains.

    Attributes:
        square: Its sum of squares, in units of the stated variance.
        dof: Its degrees of freedom; 0 where there are too few.
        soft_p: p-value of motions of single reflectors in proportion to the load.
    """

    square: float = 0.0
    dof: int = 0
    soft_p: float = 1.0


def _rigid(seen: Linearised, white: Whitener) -> _Rigid:
    """Residual of six rigid motions of the effector per pull; its part proportional to the load.

    The effector is stiff: whatever happens to arm, rail, force or tracker, its reflectors keep
    their distances. Changes of these are scatter of the readings alone, unless they are
    proportional to the load (a loose nest or a soft effector), in which case they are excluded from
    the scatter.
    """
    place = Blocks.of(seen.data.pulls.pose).place[seen.rows.pull]
    pulls = white.own_base(own_columns(seen.motions, place), seen.y)
    if pulls.dof < _FEWEST:
        return _Rigid()
    loose = pulls.beside_all(white.by_pose(_loose(seen)))
    left = pulls.dof - int(loose.rank)
    p = float(loose.p()) if loose.rank and left >= _FEWEST else 1.0
    if p < alarms.LOOSE:
        return _Rigid(pulls.rest - float(loose.drop), left, p)
    return _Rigid(pulls.rest, pulls.dof, p)


def _loose(seen: Linearised) -> Array:
    """Motion of each reflector along each axis of F_b and of the tool per kN of load, (M, 6 t)."""
    data, rows = seen.data, seen.rows
    axes = load(seen.model.cell, data.pulls, seen.model.values).configuration.flange_axes
    size = np.linalg.norm(data.pulls.force, axis=1)[rows.pull] / 1000.0
    along = np.concatenate([np.eye(3)[rows.axis], axes[rows.pull, rows.axis]], axis=1)
    return own_columns(along * size[:, None], np.repeat(data.target, 3))


def _taken(view: Whitened) -> int:
    """Rank of the springs' columns: a joint that no pull loads takes up no degree of freedom."""
    return linear.rank(view.M[: view.springs, : view.springs])


def by_pose_drop(view: Whitened, base: Ints) -> tuple[float, int]:
    """Drop of the base's residual sum of squares by a free stiffness of each pose; dof.

    |r|^2 - |P r|^2 with r = y - A_base b whitened and P orthogonal to `free`; the degrees of
    freedom are the rank of these columns minus springs and accepted causes.
    """
    rows = len(view.rows)
    residual = view.A[:rows, -1] - view.A[:rows, base] @ coefficients(view.M, base)
    dof = rows - view.free.dof - _taken(view) - (len(base) - view.first)
    return float(residual @ residual) - view.free.against(residual).rest, max(dof, 1)
