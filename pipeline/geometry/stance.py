"""What an estimate from absolute positions hands to pulls of the same robot, and gets back."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.geometry.estimate import rows, softened
from pipeline.geometry.identify import Identified
from pipeline.geometry.mechanism import Mechanism, Weights, layout, linearised
from pipeline.machine.stance import Stance
from pipeline.reduction.bring import bring
from pipeline.reduction.case import Case
from pipeline.system.estimate import identify as estimate_of

_KNOWN = 0.5
"""Variance over that of the prior below which the weight alone knows more than the prior does."""


@dataclass(frozen=True, eq=False)
class _Unloaded:
    """Where a mechanism has its joints and targets under its own weight, as `Stance.unloaded`."""

    mechanism: Mechanism
    weights: Weights
    which: Ints

    def __call__(self, q: Array) -> tuple[Array, Array]:
        m, never = len(q), np.full(len(q), np.nan)
        weights = replace(self.weights, carried=np.zeros(m, dtype=np.int64))
        stand = self.mechanism.stand(q, weights, never, never, never)
        plain = stand.here.points(self.mechanism.tool[:, :3, 3])
        return stand.here.q - q, (stand.at - plain)[:, self.which]


def stance(found: Identified, targets: Collection[str]) -> Stance:
    """What the positions say, springs and elements of which the weight tells nothing left out.

    Args:
        found: The whole model.
        targets: Points of the tool that pulls may have read, too.
    """
    mechanism, cov = found.mechanism, found.solution.cov
    v, factor = softened(mechanism), 0.0
    if mechanism.unknown:
        factor = 1 / float(v @ linear.cholesky(cov).solve(v))
    prior = np.append(found.known.std, np.full(len(cov) - len(found.known.std), np.inf))
    told = np.diag(cov) - factor * v**2 < _KNOWN * prior**2
    which = np.array(
        [k for k, name in enumerate(found.readings.targets) if name in targets], dtype=np.int64
    )
    held = tuple(_held(mechanism, told))
    T = _chosen(found, [i for _, at in held for i in at], which)
    where = layout(mechanism)
    return Stance(
        robot=mechanism.robot,
        letters=mechanism.letters,
        points={str(found.readings.targets[k]): mechanism.tool[k, :3, 3] for k in which},
        compliance=mechanism.compliance,
        told=told[where.compliance],
        held=tuple(mechanism.elements[k] for k, _ in held),
        yields=mechanism.at(where)[[i for _, at in held for i in at]],
        cov=T @ cov @ T.T,
        unloaded=_Unloaded(mechanism, found.weights, which),
        factor=factor,
    )


def standing(case: Case, found: Identified) -> tuple[Case, float]:
    """A campaign of pulls with its robot where its positions have it.

    Where nobody states masses, the springs by the pulls tell how heavy the arm is.

    Returns:
        The campaign, and springs over those of the model.
    """
    known, factor = stance(found, case.settings.measured), 1.0
    there = case.standing(known)
    for _ in range(_ROUNDS if known.factor else 0):
        start = there.robot.nominal_compliance
        estimate = estimate_of(there.cell, bring(there).data, start)[1]
        more = known.lighter(estimate.value, estimate.cov, estimate.identifiable)
        known, factor = known.softer(more), factor * more
        there = case.standing(known)
        if abs(more - 1) < _STILL:
            break
    return there, factor


_ROUNDS, _STILL = 4, 0.01
"""A factor that is known to ten per cent at best stands still at one."""


def _held(mechanism: Mechanism, told: Bools) -> Iterator[tuple[int, list[int]]]:
    """Elements of which the weight tells something, and where their parameters stand."""
    first = layout(mechanism).yields.start
    for k, effect in enumerate(mechanism.elements):
        at = list(range(first, first + len(effect.parameters)))
        first = at[-1] + 1
        if told[at].any():
            yield k, at


def _chosen(found: Identified, held: list[int], which: Ints) -> Array:
    """Rows that take springs, elements, letters and points out of all parameters, (s, k)."""
    where, one = layout(found.mechanism), np.eye(len(found.solution.x))
    points = []
    for k in which:
        first = where.tool.start + 6 * k + 3
        points.append(found.mechanism.tool[k, :3, :3] @ one[first : first + 3])
    return np.concatenate([one[where.compliance], one[held], one[where.letters], *points])


def _rows_of(found: Identified, known: Stance) -> Array:
    """The same as a stance has them."""
    first, held = layout(found.mechanism).yields.start, list[int]()
    for effect in found.mechanism.elements:
        at = range(first, first + len(effect.parameters))
        first = at.stop
        held += at if effect in known.held else []
    targets = found.readings.targets.tolist()
    return _chosen(found, held, np.array([targets.index(name) for name in known.points]))


def lighter(found: Identified, factor: float) -> Identified:
    """The same of an arm lighter by a factor whose springs are softer by it, which moves nothing.

    Args:
        found: The whole model, of masses that nobody states.
        factor: Springs over those of the model.
    """
    if factor == 1.0:
        return found
    there, where = found.mechanism, layout(found.mechanism)
    scale = np.ones(len(found.solution.x))
    scale[where.compliance] = scale[where.yields] = factor
    scale[where.moments] = 1 / factor
    moved = replace(
        there,
        compliance=there.compliance * factor,
        yields=there.yields * factor,
        moments=there.moments / factor,
    )
    return _about(found, moved, found.solution.cov * scale * scale[:, None])


def beside_pulls(found: Identified, known: Stance, value: Array, cov: Array) -> Identified:
    """The whole model with what pulls add to springs, elements, table and points.

    x' = x + K (z' - z), C' = C + K (C_z' - C_z) K' with K = C_xz C_z^-1: what goes with them.

    Args:
        found: The estimate from the positions alone, of an arm of the weight that pulls tell.
        known: `stance` of it.
        value: z', springs and elements, and errors of letters and points, shape (s,).
        cov: Their covariance C_z', shape (s, s).
    """
    there, where, C = found.mechanism, layout(found.mechanism), found.solution.cov
    T = _rows_of(found, known)
    size = np.sqrt(np.diag(known.cov))
    half = linear.shortest(linear.factor(known.cov / size / size[:, None])) / size
    K = (C @ T.T @ half.T) @ half
    before = np.concatenate([known.compliance, known.yields, np.zeros(len(T) - known.springs)])
    moved = there.moved(there.at(where) + K @ (value - before), where)
    return _about(found, moved, C + K @ (cov - known.cov) @ K.T)


def _about(found: Identified, moved: Mechanism, cov: Array) -> Identified:
    """The readings about another mechanism, which then is the estimate."""
    here = linearised(found.readings, moved, found.weights)
    solution = replace(found.solution, x=moved.at(layout(moved)), cov=cov)
    return replace(
        found,
        mechanism=moved,
        linear=here,
        rows=rows(here, moved, found.scatter),
        solution=solution,
    )
