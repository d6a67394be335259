"""Effect of a force as estimated from pulls, in place of springs estimated from positions.

A model of positions deflects each joint by its spring under weight and force alike. If the same
robot was pulled, a force displaces targets by

    d(q, f) = sum over hypotheses of w (S_h p_h),        p_h = springs and causes,

including laws that weight does not show. This replaces S x, where x are the springs and elements
that positions have in common with p_h. Parameters estimated jointly from both have a single value,
and the other parameters e of p_h are correlated with it,

    e = e_h + G (x - x_h) + r,    G = cov(e, x) cov(x)^-1,    r independent of all positions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.library.kinematic_model import ByPulls
from pipeline.machine.cell import Cell, Tool, jacobian, paper_cell
from pipeline.machine.cell import predict as forward
from pipeline.machine.effect import Pulls
from pipeline.positions.mechanism import Mechanism, layout
from pipeline.positions.positions_estimate import laws_of_gears
from pipeline.positions.yielding import by_weight_alone
from pipeline.prediction.model import NOTHING_M, ModelHypothesis


class UnderForce(NamedTuple):
    """Displacement of targets by a force, under one hypothesis, relative to the model of positions.

    Attributes:
        weight: Its probability.
        shift: Difference of the displacements [m], F_b, shape (m, t, 3).
        by_positions: Change of the derivatives by parameters of the positions, (m, t, 3, dense).
        own: Derivatives by independent unit errors of its own, shape (m, t, 3, k).
        unknown: Whether an undetermined parameter acts on the coordinate, shape (m, t, 3).
    """

    weight: float
    shift: Array
    by_positions: Array
    own: Array
    unknown: Array

    @classmethod
    def of_positions(cls, m: int, t: int, dense: int) -> UnderForce:
        """The model of positions as it is, where nothing was pulled."""
        still = np.zeros((m, t, 3))
        none, certain = still[..., None][..., :0], np.zeros((m, t, 3), dtype=bool)
        return cls(1.0, still, np.zeros((m, t, 3, dense)), none, certain)


def under_force(
    by_pulls: ByPulls, there: Mechanism, tip: Array, q: Array, force: Array
) -> list[UnderForce]:
    """Evaluate all hypotheses of the pulls.

    Args:
        by_pulls: Model estimated from pulls.
        there: The robot as estimated from positions.
        tip: Point at which the force acts, flange frame [m], shape (3,).
        q: Joint values [m] or [rad], shape (m, n).
        force: Force at the tip [N], F_b, shape (m, 3).
    """
    points, pulls = there.tool[:, :3, 3], Pulls.at(q, force)
    tool = Tool(tip, np.array([str(k) for k in range(len(points))], dtype=object), points)
    return [_one(h, by_pulls.joined, there, tool, pulls) for h in by_pulls.model.hypotheses]


def _one(
    h: ModelHypothesis, joined: bool, there: Mechanism, tool: Tool, pulls: Pulls
) -> UnderForce:
    mine = replace(h.cell, tool=tool)
    places = _Columns.of(h, joined, there)
    own, held = _of_positions(mine, there)
    known = places.values(h, there)
    shift = forward(mine, pulls, known).displacement - forward(own, pulls, held).displacement
    A = jacobian(replace(mine, equilibrium="undeformed"), pulls, known)
    S = jacobian(replace(own, equilibrium="undeformed"), pulls, held)
    C, e, s = h.cov, places.rest, places.shared[:, 0]
    follow = C[np.ix_(e, s)] @ linear.inverse(C[np.ix_(s, s)])
    more = np.zeros((*shift.shape, layout(there).dense))
    more[..., places.replaced[:, 1]] = -S[..., places.replaced[:, 0]]
    more[..., places.shared[:, 1]] += A[..., e] @ follow
    left = linear.factor(C[np.ix_(e, e)] - follow @ C[np.ix_(s, e)])
    typical = np.array([p.typical for p in h.cell.parameters])
    loose = np.abs(A[..., places.open] * typical[places.open]).max(axis=-1, initial=0.0)
    return UnderForce(h.weight, shift, more, A[..., e] @ left, loose > NOTHING_M)


def _of_positions(mine: Cell, there: Mechanism) -> tuple[Cell, Array]:
    """Cell of springs and elements, as estimated from positions, that pulls replace; values."""
    which = _acting(there)
    held = [k for one in which for k in _span(there, one)]
    cell = paper_cell(mine.robot, mine.tool).with_effects(*(there.elements[k] for k in which))
    return replace(cell, equilibrium=mine.equilibrium), np.append(
        there.compliance, there.yields[held]
    )


def _acting(there: Mechanism) -> list[int]:
    """Indices of the elements of the positions that a force moves in their model.

    Pulls say of each whether it yields to a force. What they do not call for would move the targets
    by what weight and priors left of it, which no pull has shown.
    """
    return [k for k, one in enumerate(there.elements) if not by_weight_alone(one)]


def _span(there: Mechanism, element: int) -> range:
    """Range of an element's parameters among those of all elements."""
    ends = np.cumsum([0, *(len(one.parameters) for one in there.elements)]).tolist()
    return range(ends[element], ends[element + 1])


@dataclass(frozen=True, eq=False)
class _Columns(Locked):
    """Correspondence between parameters of a hypothesis and those of positions.

    Attributes:
        shared: Parameters of both that were estimated jointly: column in each, shape (s, 2).
        replaced: Springs and elements of the positions that the hypothesis replaces: column among
            these alone and among all parameters of the positions, shape (r, 2).
        rest: Columns of its own determined parameters, shape (e,).
        open: Columns of its own undetermined parameters, shape (o,).
    """

    shared: Ints
    replaced: Ints
    rest: Ints
    open: Ints

    @classmethod
    def of(cls, h: ModelHypothesis, joined: bool, there: Mechanism) -> _Columns:
        """Correspondence for a hypothesis."""
        pairs = np.array(_pairs(h, there), dtype=np.int64)
        known, mine = np.isfinite(h.std), pairs[:, 0]
        laws = np.array(sorted(laws_of_gears(h.cell.effects, there.elements)), dtype=np.int64) - 1
        told = (mine < 0) | known[mine]
        both = (mine >= 0) & told & joined & ~np.isin(mine, laws)
        every = np.setdiff1d(np.arange(len(known)), mine[both | ~told])
        return cls(
            pairs[both][:, [0, 2]],
            pairs[told & ~both][:, 1:],
            every[known[every]],
            every[~known[every]],
        )

    def values(self, h: ModelHypothesis, there: Mechanism) -> Array:
        """Values of its parameters; undetermined springs have the values of the positions."""
        out, n = h.value.copy(), there.table.n
        unknown = np.flatnonzero(~np.isfinite(h.std[:n]))
        out[unknown] = there.compliance[unknown]
        return out


def _pairs(h: ModelHypothesis, there: Mechanism) -> list[tuple[int, int, int]]:
    """Columns of springs and elements of `_acting`: in a hypothesis, among these, in positions.

    The first is -1 if the hypothesis lacks it.
    """
    where, effects = layout(there), h.cell.effects
    first = np.cumsum([0, *(len(one.parameters) for one in effects)]).tolist()
    at = {(one.label, one.form): k for one, k in zip(effects, first, strict=False)}
    pairs = [(j, j, where.compliance.start + j) for j in range(there.table.n)]
    for k in _acting(there):
        mine = at.get((there.elements[k].label, there.elements[k].form))
        for i, column in enumerate(_span(there, k)):
            own = -1 if mine is None else mine + i
            pairs.append((own, len(pairs), where.yields.start + column))
    return pairs
