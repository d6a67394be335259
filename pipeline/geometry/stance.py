"""What an estimate from absolute positions hands to pulls of the same robot, and gets back."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.base.tails import chi2_beyond
from pipeline.geometry.estimate import rows, softened
from pipeline.geometry.identify import Identified
from pipeline.geometry.mechanism import Mechanism, Weights, layout, linearised
from pipeline.machine.stance import Stance
from pipeline.reduction.bring import bring
from pipeline.reduction.case import Case
from pipeline.system import alarms
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
    """What the positions say to pulls.

    An element that the weight does not call for is none, as causes are that pulls do not call for:
    the positions are then what they would be if it were known to be zero.

    Args:
        found: The whole model.
        targets: Points of the tool that pulls may have read, too.
    """
    mechanism, cov, where = found.mechanism, found.solution.cov, layout(found.mechanism)
    x, v, factor = mechanism.at(where), softened(mechanism), 0.0
    if mechanism.unknown:
        factor = 1 / float(v @ linear.cholesky(cov).solve(v))
    apart = cov - factor * np.outer(v, v) + by_masses(found)
    held = tuple(_held(mechanism, x, apart))
    there = [k for _, at in held for k in at]
    none = [k for k in range(where.yields.start, where.yields.stop) if k not in there]
    which = [k for k, name in enumerate(found.readings.targets) if name in targets]
    T = _chosen(found, there, which)
    gain = T @ apart[:, none] @ linear.inverse(apart[np.ix_(none, none)])
    z, C = T @ x - gain @ x[none], T @ apart @ T.T - gain @ apart[none] @ T.T
    n = mechanism.table.n
    s = n + len(there)
    z[s:], along = 0.0, np.append(z[:s], np.zeros(len(z) - s))
    prior = found.known.std[where.compliance]
    return Stance(
        robot=mechanism.robot,
        letters=mechanism.letters,
        points={str(found.readings.targets[k]): mechanism.tool[k, :3, 3] for k in which},
        compliance=z[:n],
        told=np.diag(C)[:n] < _KNOWN * prior**2,
        held=tuple(mechanism.elements[k] for k, _ in held),
        yields=z[n:s],
        cov=C + factor * np.outer(along, along),
        unloaded=_Unloaded(mechanism, found.weights, np.array(which, dtype=np.int64)),
        factor=factor,
        moments=mechanism.moments,
        gravity=found.weights.gravity,
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


def by_masses(found: Identified) -> Array:
    """What masses of a robot file that are off do to the estimate, (k, k).

    A link heavier by a part e than stated moves readings by E e, and least squares takes it for

        C X'W E e,    e ~ N(0, _MASSES^2) of each link,

    most of it for softer springs. Zero where the masses are estimated.
    """
    there, size = found.mechanism, len(found.solution.x)
    if there.unknown or not there.moments.any():
        return np.zeros((size, size))
    loose = replace(there, unknown=True)
    here = linearised(found.readings, loose, found.weights)
    D = here.D[:, here.used, layout(loose).moments]
    each = np.einsum("mrjk,jk->jmr", D.reshape(*D.shape[:2], *there.moments.shape), there.moments)
    X = [replace(found.rows, y=np.einsum("mij,mj->mi", found.rows.W, one)).b for one in each]
    S = found.solution.cov @ np.stack(X, axis=1)
    return np.asarray(_MASSES**2 * S @ S.T)


_MASSES = 0.05
"""Standard uncertainty of the mass of a link by its robot file, over that mass: drawings know
castings, but no cables, grease, hoses and dress packs."""


def _held(mechanism: Mechanism, x: Array, apart: Array) -> Iterator[tuple[int, list[int]]]:
    """Elements that the weight calls for, and where their parameters stand."""
    for k, at in enumerate(_places(mechanism)):
        said = linear.inverse(apart[np.ix_(at, at)])
        if chi2_beyond(float(x[at] @ said @ x[at]), len(at)) < alarms.SUSPECT:
            yield k, at


def _places(mechanism: Mechanism) -> Iterator[list[int]]:
    """Where the parameters of each element stand."""
    first = layout(mechanism).yields.start
    for effect in mechanism.elements:
        yield list(range(first, first := first + len(effect.parameters)))


def _chosen(found: Identified, held: Sequence[int], which: Sequence[int]) -> Array:
    """Rows that take springs, elements, letters and points out of all parameters, (s, k)."""
    where, one = layout(found.mechanism), np.eye(len(found.solution.x))
    points = []
    for k in which:
        first = where.tool.start + 6 * k + 3
        points.append(found.mechanism.tool[k, :3, :3] @ one[first : first + 3])
    return np.concatenate([one[where.compliance], one[list(held)], one[where.letters], *points])


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

    With z0, C0 what `stance` has of these and z, C_z the same beside the pulls, the pulls say

        N = C_z^-1 - C0^-1,    N z1 = C_z^-1 z - C0^-1 z0,

    and what goes with z = T x in the whole model moves with it:

        C' = C - C T' (1 + N C_T)^-1 N T C,    x' = x + C T' (1 + N C_T)^-1 N (z1 - T x).

    Args:
        found: The estimate from the positions alone, of an arm of the weight that pulls tell.
        known: `stance` of it.
        value: z, springs and elements, and errors of letters and points, shape (s,).
        cov: Their covariance C_z, shape (s, s).
    """
    there, where, C = found.mechanism, layout(found.mechanism), found.solution.cov
    targets, places = found.readings.targets.tolist(), list(_places(there))
    held = [k for one in known.held for k in places[there.elements.index(one)]]
    T = _chosen(found, held, [targets.index(name) for name in known.points])
    size = np.sqrt(np.diag(known.cov))
    T = T / size[:, None]
    own = T @ C @ T.T
    before, after = (linear.inverse(one / size / size[:, None]) for one in (known.cov, cov))
    share, along = linear.directions(after - before)
    N = (along * np.maximum(share, 0.0)) @ along.T
    zero = np.zeros(len(T) - known.springs)
    z0 = np.concatenate([known.compliance, known.yields, zero]) / size
    now = np.concatenate([(T @ there.at(where))[: known.springs], zero])  # letters count from here
    said = after @ (value / size) - before @ z0
    less = linear.solve(np.eye(len(T)) + N @ T @ by_masses(found) @ T.T, np.column_stack([N, said]))
    N, said = less[:, :-1], less[:, -1] - less[:, :-1] @ now
    gain = C @ T.T @ linear.solve(np.eye(len(T)) + N @ own, np.column_stack([N, said]))
    moved = there.moved(there.at(where) + gain[:, -1], where)
    return _about(found, moved, C - gain[:, :-1] @ T @ C)


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
