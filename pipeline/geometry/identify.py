"""One estimate of table, tool, frames, springs and laws, linearised where the robot stands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.geometry import curves as curve
from pipeline.geometry.estimate import (
    HELD,
    Posterior,
    Prior,
    ReadRows,
    again,
    by_a_factor,
    larger,
    padded,
    prior,
    rougher,
    rows,
    solved,
)
from pipeline.geometry.laws import JointLaw
from pipeline.geometry.mechanism import ArmWeights, Linear, Mechanism, layout, linearised
from pipeline.geometry.readings import PositionReadings
from pipeline.geometry.scatter import PoseScatter
from pipeline.geometry.yielding import usual
from pipeline.machine.effect import Elastic
from pipeline.machine.robot import Robot

_FEWEST, _SETTLED, _MOST = 3, 8, 14
"""Linearisations: at least, with sizes estimated anew, at most. A weight and the spring that it
turns are a product, which takes more of them than a table that is off by milliradians."""

_STRAIGHT = 0.02
"""The same of nearly all of them, over the noise of one reading [1]."""
_MOST_OF_THEM = 0.98
"""How far so many of the readings may stand from where the last linearisation has them, in their
noise; where a torque is about zero, steps of its sign come and go."""

_STILL = 2e-3
"""How far a compliance may come from the last linearisation, over its nominal size."""

_STEPS = (4, 2, 2)
"""Steps of scatter and sizes before the first linearisation is left, the second, and later ones; an
estimate that begins where another one ended is beyond the first."""

_SIZE = {True: 1e-4, False: 2e-4}
"""Of a curve before any data: sliding [m], turning [rad]."""


@dataclass(frozen=True)
class Wanted:
    """What is estimated beside tool and frames.

    Attributes:
        table: Letters of the table.
        springs: Compliances under the arm's weight.
        laws: Laws of joints.
        curves: Joints with a curve of their own, from 0, and its length.
        yields: What may yield beside springs of joints under the arm's weight.
        moments: Masses and first moments of the links, which no table states, or a wrong one.
        bed: Length of the curves by which the rail is not straight [m]; None where it is.
    """

    table: bool = True
    springs: bool = True
    laws: tuple[JointLaw, ...] = ()
    curves: tuple[tuple[int, float], ...] = ()
    yields: tuple[Elastic, ...] = ()
    moments: bool = False
    bed: float | None = None


@dataclass(frozen=True, eq=False)
class Identified(Locked):
    """A mechanism with all that it was estimated from.

    Attributes:
        mechanism: The estimate.
        readings: What it is of.
        weights: What pulled at the arm.
        known: Priors, with their scales as found.
        scatter: What no model holds.
        linear: The readings about the estimate.
        rows: The same, whitened.
        solution: The parameters with their covariance.
        wanted: What was estimated.
    """

    mechanism: Mechanism
    readings: PositionReadings
    weights: ArmWeights
    known: Prior
    scatter: PoseScatter
    linear: Linear
    rows: ReadRows
    solution: Posterior
    wanted: Wanted

    @property
    def likely(self) -> float:
        """Log of the likelihood of the readings, whatever the parameters are."""
        return self.solution.evidence + float(linear.log_det(self.rows.W).sum())

    @property
    def left(self) -> Array:
        """Readings minus mechanism [m], [rad], shape (m, 6 t), F_b."""
        e = self.rows.y - self.rows.along(self.solution.x)
        return self.linear.spread(linear.solve(self.rows.W, e))


def identify(
    begun: Mechanism,
    readings: PositionReadings,
    weights: ArmWeights,
    wanted: Wanted,
    scatter: PoseScatter,
    stated: tuple[float, float] = (np.nan, np.nan),
    known: Prior | None = None,
) -> Identified:
    """Estimate a mechanism.

    Args:
        begun: Where to begin; its laws and curves are those of `wanted` from then on.
        readings: What it is to explain.
        weights: What pulled at the arm.
        wanted: What is estimated.
        scatter: What no model holds, to begin with.
        stated: Roughness of lengths [m] and angles [rad] as the robot file states it.
        known: Priors of an earlier estimate, to begin with.
    """
    mechanism = _equipped(begun, readings, wanted)
    shapes = [[(c.screw, c.length) for c in one.curves] for one in (begun, mechanism)]
    warm = known is not None and shapes[0] == shapes[1]
    before = prior(mechanism, stated, weights.payloads)
    known = _only(_scaled(before, mechanism, known), mechanism, wanted)
    here = linearised(readings, mechanism, weights)
    for turn in range(_MOST):
        for _ in range(_steps(turn, warm)):
            whitened = rows(here, mechanism, scatter)
            found = solved(whitened, mechanism, known)
            scatter = again(whitened, here, found, scatter)
            known = _only(rougher(known, found), mechanism, wanted)
            mechanism = larger(mechanism, found)
        whitened = rows(here, mechanism, scatter)
        found = solved(whitened, mechanism, known)
        moved = mechanism.moved(found.x, layout(mechanism))
        then = linearised(readings, moved, weights)
        off = np.einsum("mij,mj->mi", whitened.W, then.y[:, then.used]) - whitened.y
        far = float(np.quantile(np.abs(off + whitened.along(found.x)), _MOST_OF_THEM))
        turned = np.abs(moved.compliance - mechanism.compliance) / begun.table.nominal_compliance
        if _ends(turn + 1, far, float(turned.max())):
            break
        mechanism, here = moved, then
    if mechanism.unknown:
        found = by_a_factor(whitened, mechanism, found)
    return Identified(moved, readings, weights, known, scatter, here, whitened, found, wanted)


def _steps(turn: int, warm: bool) -> int:
    """How often scatter and sizes are estimated anew before a linearisation is left."""
    if turn >= _SETTLED:
        return 0
    return _STEPS[min(turn + warm, len(_STEPS) - 1)]


def _scaled(new: Prior, mechanism: Mechanism, earlier: Prior | None) -> Prior:
    """Priors of a mechanism with the scales of an earlier estimate."""
    if earlier is None:
        return new
    std = new.std.copy()
    std[layout(mechanism).letters] = earlier.std[: len(new.turns)]
    if len(earlier.groups) <= len(new.groups):
        for now, then in zip(new.groups, earlier.groups, strict=False):
            if now.stop - now.start == then.stop - then.start:
                std[now] = earlier.std[then]
    return replace(new, std=std, free=earlier.free)


def _only(known: Prior, mechanism: Mechanism, wanted: Wanted) -> Prior:
    """The prior with everything held that is not to be estimated."""
    where = layout(mechanism)
    std, mean = known.std.copy(), known.mean.copy()
    if not wanted.table:
        std[where.letters] = HELD
    if not wanted.springs:
        std[where.compliance], mean[where.compliance] = HELD, 0.0
    return replace(known, std=std, mean=mean)


def _amplitudes(begun: Mechanism, wanted: Wanted) -> Array:
    """Of the laws that are wanted, where those of before are the first of them."""
    count = sum(law.amplitudes for law in wanted.laws)
    if begun.laws != wanted.laws[: len(begun.laws)]:
        return np.zeros(count)
    return padded(begun.amplitudes, count)


def _ends(count: int, far: float, turned: float) -> bool:
    """Whether so many linearisations are enough: the last one holds, or there were many."""
    return count == _MOST or (count >= _FEWEST and far < _STRAIGHT and turned < _STILL)


def _equipped(begun: Mechanism, readings: PositionReadings, wanted: Wanted) -> Mechanism:
    """A mechanism with what is wanted, at zero where it is new."""
    size = {one.screw: one.size for one in begun.curves}
    fresh = tuple(
        replace(one, size=size.get(one.screw, one.size))
        for one in _curves(begun.table, readings, wanted)
    )
    elements = wanted.yields
    sizes_of = np.split(begun.yields, np.cumsum([len(e.parameters) for e in begun.elements])[:-1])
    size_of = dict(zip([e.label for e in begun.elements], sizes_of, strict=False))
    none = [np.zeros(len(e.parameters)) for e in elements]
    yields = [size_of.get(e.label, zero) for e, zero in zip(elements, none, strict=True)]
    moments, compliance = begun.moments, begun.compliance
    if wanted.moments and not begun.unknown:
        moments, compliance = usual(begun.table)[0], begun.table.nominal_compliance
    return replace(
        begun,
        elements=elements,
        yields=np.concatenate([np.zeros(0), *yields]),
        moments=moments,
        compliance=compliance,
        unknown=wanted.moments,
        laws=wanted.laws,
        amplitudes=_amplitudes(begun, wanted),
        curves=fresh,
        knots=np.zeros(sum(one.count for one in fresh)),
    )


def _curves(robot: Robot, readings: PositionReadings, wanted: Wanted) -> Iterator[curve.Curve]:
    """Curves of joints, then those of the bed."""
    for j, length in wanted.curves:
        slides = bool(robot.prismatic[j])
        yield curve.over(j, readings.q[:, j], slides, length, _SIZE[slides])
    if wanted.bed is not None:
        for k in range(6):
            size, screw = _SIZE[k < 3], robot.n + k
            yield curve.over(0, readings.q[:, 0], True, wanted.bed, size, screw)


def likeliest(found: Identified, choices: Sequence[Wanted]) -> Wanted:
    """What is wanted under which the readings are likeliest, the first choices first.

    The scatter and all sizes are estimated anew for each, about the same linearisation.
    """
    best, taken = -np.inf, choices[0]
    for wanted in choices:
        mechanism, scatter = _equipped(found.mechanism, found.readings, wanted), found.scatter
        here = found.linear
        anew = wanted.bed is not None or wanted.moments or wanted.yields != found.wanted.yields
        if found.mechanism.curves or anew:
            here = linearised(found.readings, mechanism, found.weights)
        known = found.known
        if len(known.std) != layout(mechanism).dense:
            new = prior(mechanism, known.stated, found.weights.payloads)
            known = _only(_scaled(new, mechanism, known), mechanism, wanted)
        for _ in range(_STEPS[0]):
            whitened = rows(here, mechanism, scatter)
            solution = solved(whitened, mechanism, known)
            scatter = again(whitened, here, solution, scatter)
            mechanism = larger(mechanism, solution)
        whitened = rows(here, mechanism, scatter)
        solution = solved(whitened, mechanism, known)
        evidence = solution.evidence + float(linear.log_det(whitened.W).sum())
        if evidence < best:
            break
        best, taken = evidence, wanted
    return taken
