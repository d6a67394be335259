"""Springs and causes of a campaign of pulls, estimated together with absolute positions.

The pulls' rows c = B x + G e are extended by the estimate from the positions of the table, the tool
and the elements that deflect under the arm's weight (`positions.positions_estimate`):

    c       = B x + B_y y - J F a + G e
    [c0 y0] = [x_s y]     + K a   + W w

with y the elements that deflect under the weight, x_s the joints' compliances in x, and a the
errors of table and tool left by the positions. a, w and e are independent unit errors. Least
squares of these rows is equivalent to that of all readings of both kinds at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.sparse

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.tails import chi2_beyond
from pipeline.diagnosis.agreement import ChiSquare, SpringAgreement
from pipeline.diagnosis.average import Hypothesis
from pipeline.machine.cell import Cell, sensitivity
from pipeline.machine.effect import Effect, Elastic
from pipeline.positions.positions_estimate import PositionsEstimate, laws_of_gears
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.assemble import POSITIONS, by_stance
from pipeline.system.estimate import solve
from pipeline.system.system import Errors, Estimate, RowIndex, System
from pipeline.system.whiten import whitener


@dataclass(frozen=True, eq=False)
class _CombinedHypothesis(Locked):
    """One set of causes, estimated together with the positions.

    Attributes:
        hypothesis: Springs, causes, and elements that deflect under the weight.
        stance: Result of the positions, with the elements among the causes held.
        value: Springs and elements in the order of the stance, and errors of table and points,
            (s,).
        cov: Their covariance, shape (s, s).
        springs: Increase of chi-square by the stance's rows of the springs that the weight
            determines.
        elements: Increase by the rows of the elements, without those of the springs.
    """

    hypothesis: Hypothesis
    stance: PositionsEstimate
    value: Array
    cov: Array
    springs: ChiSquare
    elements: ChiSquare


def combined(one: Hypothesis, data: Measured, usual: Array | None = None) -> _CombinedHypothesis:
    """A hypothesis of the pulls, estimated together with the positions.

    Elements among its causes are held by the positions, too. The spring of a joint whose gear
    follows another law in the hypothesis is a different number under the weight than under a pull.

    Args:
        one: The hypothesis, from the pulls alone.
        data: The measurements, with their stance.
        usual: Prior standard deviations about zero of its last parameters.
    """
    assert isinstance(data.stance, PositionsEstimate)
    stance = data.stance.holding(one.cell.effects)
    there = _Places.of(one, stance)
    system = _beside(one, data, stance, there, usual)
    start = np.append(one.estimate.value, there.fresh_yields)
    found = solve(system, start)
    told = np.zeros(len(system.rows), dtype=bool)
    below = np.flatnonzero(system.rows.pull < 0)[: len(there.rows)]
    springs = there.rows < len(stance.told)
    told[below[springs]] = stance.told[there.rows[springs]]
    less = solve(system.part(~told), start)
    told[below[~springs]] = True
    least = solve(system.part(~told), start) if stance.held else less
    M = int((system.rows.pull >= 0).sum())
    estimate = replace(
        found,
        residual=found.residual[:M],
        goodness=one.estimate.goodness,
        residual_std_m=one.estimate.residual_std_m,
        quantile=one.estimate.quantile,
        noise_from=one.estimate.noise_from,
    )
    whole = replace(one.cell, held=stance.weighs, effects=(*one.cell.effects, *there.fresh))
    own = replace(one, effects=(*one.effects, *there.fresh), cell=whole)
    now = replace(own, system=system, estimate=estimate, ratio=1.0, sized=None)
    value, cov = _of_stance(system, stance, there)
    return _CombinedHypothesis(now, stance, value, cov, _more(found, less), _more(less, least))


class _Places(NamedTuple):
    """Correspondence between a stance and the parameters of a hypothesis.

    Attributes:
        rows: Springs and elements of the stance that are parameters of the hypothesis, too,
            shape (r,).
        columns: Their indices among its parameters, shape (r,).
        fresh: Elements that the hypothesis lacks; their parameters are appended to its own.
        fresh_yields: Parameters of these.
    """

    rows: Ints
    columns: Ints
    fresh: tuple[Elastic, ...]
    fresh_yields: Array

    @classmethod
    def of(cls, one: Hypothesis, stance: PositionsEstimate) -> _Places:
        """Correspondence for a hypothesis and a stance that holds the elements among its causes."""
        n, effects = len(stance.compliance), one.cell.effects
        first = np.cumsum([0, *(len(each.parameters) for each in effects)])
        at = {(e.label, e.form): int(k) for e, k in zip(effects, first, strict=False)}
        fresh = tuple(e for e in stance.held if (e.label, e.form) not in at)
        end = int(first[-1])
        for each in fresh:
            at[each.label, each.form] = end
            end += len(each.parameters)
        columns = [k for e in stance.held for k in _span(at[e.label, e.form], e)]
        laws = laws_of_gears(effects, stance.elements)
        joints = np.array([j for j in range(n) if j + 1 not in laws], dtype=np.int64)
        return cls(
            np.append(joints, n + np.arange(len(columns))),
            np.append(joints, np.array(columns, dtype=np.int64)),
            fresh,
            stance.yields[np.array(columns, dtype=np.int64) >= int(first[-1])],
        )


def _span(first: int, effect: Effect) -> range:
    return range(first, first + len(effect.parameters))


def _more(one: Estimate, less: Estimate) -> ChiSquare:
    """Increase of chi-square and degrees of freedom by the rows that `less` lacks."""
    return ChiSquare(max(one.chi2 - less.chi2, 0.0), max(one.dof - less.dof, 0))


def spring_agreement(
    one: Hypothesis, beside: _CombinedHypothesis, lighter: float
) -> SpringAgreement:
    """Compare the springs by the weight with those by the pulls alone.

    Args:
        one: The hypothesis from the pulls alone.
        beside: The same estimated together with the positions.
        lighter: Factor of the springs over those with an arm of usual weight.
    """
    stance, n = beside.stance, len(beside.stance.told)
    laws = laws_of_gears(one.cell.effects, stance.elements)
    both = np.array([j not in laws for j in range(1, n + 1)])
    own = np.sqrt(np.diag(stance.cov)[:n])
    weight = np.column_stack([stance.compliance, np.where(stance.told & both, own, np.inf)])
    pulls = np.column_stack([one.estimate.value[:n], one.estimate.std[:n]])
    shared = int(stance.factor > 0)  # one of them has determined the weight
    only, cov = one.estimate.value[:n], one.estimate.cov[:n, :n]
    known = one.estimate.identifiable[:n] & both
    common = None if shared else stance.common(only, cov, known)
    fits = common is not None and chi2_beyond(common.chi2, common.dof) >= alarms.MISFIT
    return SpringAgreement(
        chi2=beside.springs.chi2,
        dof=max(beside.springs.dof - shared, 0),
        weight=weight,
        pulls=pulls,
        factor=lighter if shared else None,
        common=common if fits else None,
        elements=beside.elements,
        held=tuple(one.called for one in stance.held),
    )


def _beside(
    one: Hypothesis, data: Measured, stance: PositionsEstimate, there: _Places, usual: Array | None
) -> System:
    """The rows of the pulls, followed by those of springs and elements.

    Elements that were subtracted with given values when the pulls were fitted are added back.
    """
    acted, old = data.stance, one.system
    assert isinstance(acted, PositionsEstimate)
    flat = replace(one.cell, equilibrium="undeformed")
    M, k, s = len(old.rows), old.B.shape[1], len(there.rows)
    about = replace(data, stance=stance)  # whose errors of the table are those of K
    jacobian = by_stance(flat, about, one.estimate.value).reshape(M, -1)
    held, fresh = (_held(flat, data, one.estimate.value, e) for e in (acted.held, there.fresh))
    kept = old.errors.source != POSITIONS
    _, K, W = (part[there.rows] if i else part for i, part in enumerate(stance.parts))
    known = _known(one, usual)
    below = np.zeros((s + len(known), k + len(there.fresh_yields)))
    below[np.arange(s), there.columns] = 1.0
    below[s:, :k] = known
    blocks = [
        [old.errors.G[:, kept] * one.ratio, jacobian, None, None],
        [None, K, W, None],
    ]
    if len(known):
        assert usual is not None
        blocks.append([None, None, None, np.diag(usual)])
    more = [jacobian.shape[1], W.shape[1], len(known)]
    parameters = tuple(p for effect in there.fresh for p in effect.parameters)
    told = np.append(stance.compliance, stance.yields)[there.rows]
    return replace(
        old,
        parameters=(*old.parameters, *parameters),
        rows=_rows(old.rows, len(below)),
        B=np.vstack([np.column_stack([old.B, fresh]), below]),
        c=np.concatenate([old.c + held @ acted.yields, told, np.zeros(len(known))]),
        errors=Errors(
            scipy.sparse.csr_array(scipy.sparse.block_array(blocks[: 2 + bool(len(known))])),
            np.append(old.errors.source[kept], np.full(sum(more), POSITIONS, dtype=object)),
            np.concatenate([old.errors.common[kept], np.repeat([True, False, False], more)]),
        ),
    )


def _held(cell: Cell, data: Measured, values: Array, effects: Sequence[Effect]) -> Array:
    """Motion by elements per unit of their parameters, shape (M, e)."""
    if not effects:
        return np.zeros((3 * len(data.pull), 0))
    moved = sensitivity(cell, data.pulls, values, effects)[data.pull, data.target]
    return np.asarray(moved.reshape(3 * len(data.pull), -1))


def _known(one: Hypothesis, usual: Array | None) -> Array:
    """Rows that select the last parameters, which have a prior, (j, k)."""
    k = len(one.estimate.value)
    return np.eye(k)[k - (0 if usual is None else len(usual)) :]


def _rows(old: RowIndex, more: int) -> RowIndex:
    """The pulls' rows extended by rows of no pull."""
    none, name = np.full(more, -1, dtype=np.int64), np.full(more, POSITIONS, dtype=object)
    nothing = np.zeros(more, dtype=np.int64)
    return RowIndex(
        np.append(old.pose, nothing),
        np.append(old.repeat, nothing),
        np.append(old.target, name),
        np.append(old.axis, nothing),
        np.append(old.pull, none),
    )


def _of_stance(system: System, stance: PositionsEstimate, there: _Places) -> tuple[Array, Array]:
    """Springs and elements, errors of table and points, and the covariance of all, (s,), (s, s).

    The errors a are columns of the least squares as a ~ N(0, I); table and points err by F a.
    Springs that are not parameters of the pulls follow from their covariance with the rest in the
    stance.
    """
    white = whitener(system.errors, system.rows.pose)
    X = np.hstack([white.with_priors(system.B * system.typical), white.columns])
    inverse = linear.pseudoinverse(X)
    x, cov = inverse(white.with_priors(system.c)), inverse.half @ inverse.half.T
    p = system.B.shape[1]
    own: Ints = np.flatnonzero(system.errors.source[system.errors.common] == POSITIONS)
    mine = np.append(there.columns, p + own)
    F, r = stance.parts[0], len(there.rows)
    T = np.zeros((r + len(F), len(mine)))
    T[:r, :r], T[r:, r:] = np.diag(system.typical[there.columns]), -F
    return _completed(stance, there.rows, T @ x[mine], T @ cov[np.ix_(mine, mine)] @ T.T)


def _completed(
    stance: PositionsEstimate, rows: Ints, value: Array, cov: Array
) -> tuple[Array, Array]:
    """The estimate extended to all springs, where some rows of the stance are given."""
    C, every = stance.cov, np.arange(len(stance.cov))
    part = np.append(rows, every[stance.springs :])
    if len(part) == len(C):
        return value, cov
    size = np.sqrt(np.diag(C))
    unit = C / size / size[:, None]
    gain = (unit[:, part] @ linear.inverse(unit[np.ix_(part, part)])) * size[:, None] / size[part]
    before = np.pad(np.append(stance.compliance, stance.yields), (0, len(C) - stance.springs))
    return (
        before + gain @ (value - before[part]),
        C - gain @ (C[np.ix_(part, part)] - cov) @ gain.T,
    )
