"""Iterated linear estimate of kinematic parameters, tool, frames, compliances and laws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.geometry.arm_weight import usual
from pipeline.machine.effect import Elastic
from pipeline.machine.robot import Robot
from pipeline.machine.robot.weight import weighs
from pipeline.positions import random_curve
from pipeline.positions.estimate import (
    FIXED_SIGMA,
    Posterior,
    Prior,
    ReadRows,
    by_a_factor,
    held_step,
    larger,
    of_scales,
    padded,
    precision,
    prior,
    promised,
    rougher,
    rows,
    scale_groups,
    softer,
    solved,
    unwhitened,
)
from pipeline.positions.laws import JointLaw
from pipeline.positions.mechanism import ArmWeights, Linear, Mechanism, layout, linearised
from pipeline.positions.outstanding import outstanding
from pipeline.positions.readings import PositionReadings
from pipeline.positions.scatter import PoseScatter

_SETTLED, _MOST = 8, 14
"""Numbers of linearisations: those that re-estimate scatter and prior scales, maximum. The product
of a weight and the compliance it acts on needs more of them than DH parameters that are off by
milliradians."""

_STRAIGHT = 0.02
"""Convergence limit on the change of the residuals in the last linearisation, in standard
deviations of the noise [1]."""
_MOST_OF_THEM = 0.98
"""Fraction of the readings that must meet `_STRAIGHT` [1]; where a torque is about zero, steps at
its sign keep changing."""

_STILL, _LEAST_STD = 2e-2, 0.1
"""Convergence limit on the change of a compliance in the last linearisation, over its standard
uncertainty [1], and the least one that is asked for, over the nominal compliance [1]."""

_UPDATES, _FLAT = 4, 0.05
"""Maximum number of updates of scatter and prior scales in one linearisation, and the change of
the log evidence below which they end [1]: a decision takes units."""

_LOUD = 0.5
"""Change of the log evidence [1] up to which scatter is left as it is, and entries are not asked
again whether they are outstanding."""

_SIZE = {True: 1e-4, False: 2e-4}
"""Initial prior size of a curve: sliding [m] (True), rotary [rad] (False)."""


@dataclass(frozen=True)
class ModelStructure:
    """Model structure: what is estimated in addition to tool and frames.

    Attributes:
        table: Whether the DH parameters are estimated.
        springs: Whether joint compliances under the arm's weight are estimated.
        laws: Laws of joints.
        curves: Joints with a curve of their own, from 0, each with its length [m] or [rad].
        yields: Elastic elements other than joint springs under the arm's weight.
        moments: Whether masses and first moments of the links are estimated, because the robot file
            states none, or wrong ones.
        bed: Whether the rail has a bed that is not straight.
        soft: Whether bearings, links and rails may be as soft as gears, and a rail's scale as wrong
            as racks are.
    """

    table: bool = True
    springs: bool = True
    laws: tuple[JointLaw, ...] = ()
    curves: tuple[tuple[int, float], ...] = ()
    yields: tuple[Elastic, ...] = ()
    moments: bool = False
    bed: bool = False
    soft: bool = False

    def weighs(self, robot: Robot) -> bool:
        """Whether masses are parameters: nobody states them, or springs depend on stated ones."""
        return self.moments or (self.springs and weighs(robot))


@dataclass(frozen=True, eq=False)
class Calibration(Locked):
    """An estimated mechanism with all that it was estimated from.

    Attributes:
        mechanism: The estimate.
        readings: The readings.
        weights: Gravity and payloads on the arm.
        known: Priors, with their estimated scales.
        scatter: Scatter of the readings about the model.
        linear: The last linearisation, from which `solution` was estimated.
        rows: The same, whitened.
        solution: The parameters with their covariance.
        wanted: Structure of the model.
    """

    mechanism: Mechanism
    readings: PositionReadings
    weights: ArmWeights
    known: Prior
    scatter: PoseScatter
    linear: Linear
    rows: ReadRows
    solution: Posterior
    wanted: ModelStructure

    @property
    def likely(self) -> float:
        """Logarithm of the marginal likelihood of the readings."""
        return self.solution.evidence + float(linear.log_det(self.rows.W).sum())

    @cached_property
    def by_readings(self) -> Posterior:
        """The solution without an unknown common factor of all masses."""
        own = self.rows, self.mechanism, self.known
        return solved(*own) if self.mechanism.unknown else self.solution

    @cached_property
    def cov(self) -> Array:
        """Covariance of the parameters, including the uncertainty of the scales of their priors.

        The latter is that for known masses: their common factor is uncertain by itself.
        """
        return self.solution.cov + of_scales(self.known, self.by_readings)

    @cached_property
    def held(self) -> Array:
        """Covariance of what is predicted at each pose, whitened, shape (m, r, r)."""
        return self.rows.variance(self.by_readings)

    @property
    def left(self) -> Array:
        """Residuals: readings minus mechanism [m], [rad], shape (m, 6 t), F_b."""
        e = self.rows.y - self.rows.along(self.solution.x)
        return self.linear.spread((self.rows.L @ e[..., None])[..., 0])


def calibrate(
    begun: Mechanism,
    readings: PositionReadings,
    weights: ArmWeights,
    wanted: ModelStructure,
    scatter: PoseScatter,
    stated: tuple[float, float] = (np.nan, np.nan),
    known: Prior | None = None,
) -> Calibration:
    """Estimate a mechanism.

    Args:
        begun: Starting point; its laws and curves are replaced by those of `wanted`.
        readings: The readings.
        weights: Gravity and payloads on the arm.
        wanted: Structure of the model.
        scatter: Initial scatter of the readings about the model.
        stated: Roughness of lengths [m] and angles [rad] in the robot file; NaN where not stated.
        known: Priors of an earlier estimate to start from.
    """
    mechanism = _equipped(begun, readings, wanted)
    before = prior(mechanism, stated, weights.payloads)
    known = _only(_scaled(before, layout(mechanism).letters, known), mechanism, wanted)
    now = _LinearFit(mechanism, known, scatter, linearised(readings, mechanism, weights))
    change, flat = np.inf, False
    for turn in range(_MOST):
        if turn < _SETTLED and not (flat and change < _FLAT):
            now, flat = now.with_outstanding(change).rescaled(wanted, _UPDATES, change=change)
        fit, moved, now, straight = now, *now.stepped(readings, weights)
        if straight:
            break
        change = abs(now.likely - fit.likely)
    # with unknown masses, where it ends: their common factor must move nothing there
    return (now if moved.unknown else fit).ended(moved, readings, weights, wanted)


@dataclass(frozen=True, eq=False)
class _LinearFit:
    """Least squares about one linearisation, with the fields of `Calibration`.

    `white` are the rows if they are known, and `held` is what a fit near this one absorbs of the
    noise, shape (m, r, r).
    """

    mechanism: Mechanism
    known: Prior
    scatter: PoseScatter
    here: Linear
    damped: float = 0.0
    white: ReadRows | None = None
    held: Array | None = None

    @cached_property
    def rows(self) -> ReadRows:
        return self.white or rows(self.here, self.mechanism, self.scatter)

    @cached_property
    def found(self) -> Posterior:
        return solved(self.rows, self.mechanism, self.known)

    @cached_property
    def likely(self) -> float:
        return self.found.evidence + float(linear.log_det(self.rows.W).sum())

    def ended(
        self,
        moved: Mechanism,
        readings: PositionReadings,
        weights: ArmWeights,
        wanted: ModelStructure,
    ) -> Calibration:
        """The estimate, with a mechanism that a step was made to."""
        found = self.found
        if self.mechanism.unknown:
            found = by_a_factor(self.rows, self.mechanism, found, weights.any)
        own = self.known, self.scatter, self.here, self.rows
        return Calibration(moved, readings, weights, *own, found, wanted)

    def rescaled(
        self, wanted: ModelStructure, most: int, least: float = -np.inf, change: float = np.inf
    ) -> tuple[_LinearFit, bool]:
        """The fit with scatter and scales of the priors that the readings make likeliest.

        Updates gain less and less; they end where as much as the next one promises in each would
        not bring the log evidence to `least` any more. After one that has gained little, or a
        `change` as little by what came before, only prior scales are updated: scatter converges at
        once. The second value says whether the last one has gained nothing any more.
        """
        now = self
        for left in range(most, 0, -1):
            then, gain = now._likelier(wanted, change > _LOUD)
            if now.likely + left * gain < least:
                break
            change = abs(then.likely - now.likely)
            now = then
            if change < _FLAT:
                return now, True
        return now, False

    def hopeless(self, wanted: ModelStructure, held: Array, least: float) -> bool:
        """Whether all updates together do not promise to bring the log evidence to `least`.

        `held` is what another estimate of the same readings absorbs of the noise, (m, r, r).
        """
        if self.likely > least:
            return False
        _, by_scatter = self._scattered(held)
        _, by_priors = self._likelier(wanted, False)
        return self.likely + _UPDATES * (by_scatter + by_priors) < least

    def _scattered(self, held: Array) -> tuple[PoseScatter, float]:
        """Scatter by the residuals and by what an estimate absorbs of the noise, and its gain."""
        e = self.rows.y - self.rows.along(self.found.x)
        return self.scatter.better(self.here, unwhitened(self.rows, e, held))

    def _likelier(self, wanted: ModelStructure, scatters: bool) -> tuple[_LinearFit, float]:
        """The fit with updated scales of the priors, and scatter, and what it promises to gain.

        What the fit absorbs is computed anew only where the earlier one shows that scatter gains.
        """
        mechanism = larger(self.mechanism, self.found)
        known = _only(rougher(self.known, self.found), self.mechanism, wanted)
        gain = promised(self.found, (self.mechanism, self.known), (mechanism, known))
        then = replace(self, mechanism=mechanism, known=known, white=self.rows)
        if not scatters:
            return then, gain
        held, by_scatter = self.held, np.inf
        if held is not None:
            scatter, by_scatter = self._scattered(held)
        if by_scatter > _FLAT:
            held = self.rows.variance(self.found)
            scatter, by_scatter = self._scattered(held)
        if by_scatter > _FLAT:
            then = replace(then, scatter=scatter, white=None)
        return replace(then, held=held), gain + by_scatter

    def with_outstanding(self, change: float) -> _LinearFit:
        """The fit with those DH parameters free that are far beyond the rest of the table."""
        free = outstanding(self.known, self.found) if change > _LOUD else self.known.free
        same = np.array_equal(free, self.known.free)
        known = replace(self.known, free=free)
        return self if same else replace(self, known=known, white=self.rows)

    def stepped(
        self, readings: PositionReadings, weights: ArmWeights
    ) -> tuple[Mechanism, _LinearFit, bool]:
        """The mechanism and fit after a step, and whether the iteration ends.

        Where products of parameters bend the objective so much that a step to the solution does
        not lessen it as predicted, the step is damped (Levenberg and Marquardt). A damped step is
        small in any case: the iteration then ends where the whole one promises nothing, or where
        more damping gains less or nothing, as between the flanks of a gear.
        """
        where, x = layout(self.mechanism), self.found.x
        x0, P = self.mechanism.at(where), precision(self.mechanism, self.known)[0]
        off = padded(self.known.mean, len(x)) - x0
        before = np.einsum("mij,mj->mi", self.rows.W, self.here.seen[0])
        slope = self.rows.products(before[..., None])[:, 0] + P @ off
        damped, earlier = self.damped, -np.inf
        while True:
            step = x - x0
            if damped:
                step = held_step(self.rows, self.mechanism, self.known, slope, damped)
            moved = self.mechanism.moved(x0 + step, where)
            then = linearised(readings, moved, weights)
            left = np.einsum("mij,mj->mi", self.rows.W, then.y[:, then.used])
            expected = before - self.rows.along(step)
            prior_gain = float(step @ P @ (2 * off - step))
            gain = float(np.sum(before**2) - np.sum(left**2)) + prior_gain
            promised = float(np.sum(before**2) - np.sum(expected**2)) + prior_gain
            fails = gain <= _KEPT[0] * promised - _TINY
            lost = damped > _MOST_DAMPED or (fails and 0 < gain < earlier)
            if lost or not fails:
                break
            damped, earlier = max(10 * damped, 1.0), gain
        if gain > _KEPT[1] * promised:
            damped = damped / 10 * (damped > 1)
        straight = float(np.quantile(np.abs(left - expected), _MOST_OF_THEM)) < _STRAIGHT
        settled = slope @ (x - x0) < 2 * _FLAT if damped else True
        ends = lost or all([straight, settled, self._still(moved)])
        return moved, replace(self, mechanism=moved, here=then, damped=damped, white=None), ends

    def _still(self, moved: Mechanism) -> bool:
        """Whether a step has hardly changed the compliances."""
        nominal, part = self.mechanism.table.nominal_compliance, layout(self.mechanism).compliance
        std = np.sqrt(self.found.dense_var[part])
        turned = np.abs(moved.compliance - self.mechanism.compliance)
        return bool((turned < _STILL * np.maximum(std, _LEAST_STD * nominal)).all())


_KEPT, _TINY = (0.25, 0.75), 1e-6
"""Gains over those of the linear model [1] below which a step is damped more, and beyond which the
next one is damped less; change of the objective that is rounding [1]."""

_MOST_DAMPED = 1e6
"""Precision of a damped step over that of the prior, beyond which the step is taken [1]."""


def _scaled(new: Prior, letters: slice, earlier: Prior | None) -> Prior:
    """The prior `new` with earlier scales of DH parameters, of elements and of laws."""
    if earlier is None:
        return new
    std = new.std.copy()
    std[letters] = earlier.std[: len(new.turns)]
    for name, now in new.groups.items():
        if (then := earlier.groups.get(name)) and then.stop - then.start == now.stop - now.start:
            std[now] = earlier.std[then]
    return replace(new, std=std, free=earlier.free, returning=earlier.returning)


def _only(known: Prior, mechanism: Mechanism, wanted: ModelStructure) -> Prior:
    """The prior with DH parameters and compliances held fixed unless they are to be estimated."""
    where = layout(mechanism)
    std, mean = known.std.copy(), known.mean.copy()
    if not wanted.table:
        std[where.letters] = FIXED_SIGMA
    if not wanted.springs:
        std[where.compliance], mean[where.compliance] = FIXED_SIGMA, 0.0
    only = replace(known, std=std, mean=mean)
    return softer(only, mechanism) if wanted.soft else only


def _amplitudes(begun: Mechanism, wanted: ModelStructure) -> Array:
    """Initial amplitudes of the wanted laws: the earlier ones, 0 for new laws."""
    ends = np.cumsum([law.amplitudes for law in begun.laws])[:-1]
    known = dict(zip(begun.laws, np.split(begun.amplitudes, ends), strict=False))
    each = [known.get(law, np.zeros(law.amplitudes)) for law in wanted.laws]
    return np.concatenate([np.zeros(0), *each])


def _equipped(begun: Mechanism, readings: PositionReadings, wanted: ModelStructure) -> Mechanism:
    """The mechanism with the wanted structure, new parameters at zero."""
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
        loose=wanted.weighs(begun.table),
        unknown=wanted.moments,
        laws=wanted.laws,
        amplitudes=_amplitudes(begun, wanted),
        curves=fresh,
        knots=np.zeros(sum(one.count for one in fresh)),
    )


def _curves(
    robot: Robot, readings: PositionReadings, wanted: ModelStructure
) -> Iterator[random_curve.Curve]:
    """Curves of joints, then the six of the bed."""
    for j, length in wanted.curves:
        slides = bool(robot.prismatic[j])
        yield random_curve.over(j, readings.q[:, j], slides, length, _SIZE[slides])
    if wanted.bed:
        for k in range(6):
            yield random_curve.along_bed(readings.q[:, 0], _SIZE[k < 3], robot.n + k)


def likeliest(
    found: Calibration, choices: Sequence[ModelStructure], known: float | None = None
) -> tuple[Calibration | None, float]:
    """The first choice after which the evidence of the readings does not grow, with its evidence.

    None is the first, where its evidence is known.

    Args:
        found: An estimate.
        choices: Model structures in the order in which they are tried.
        known: Evidence of the first, if it is known.
    """
    best, taken = -np.inf if known is None else known, None
    for wanted in choices if known is None else choices[1:]:
        now = tried(found, wanted, best)
        if now.likely < best:
            break
        best, taken = now.likely, now
    return taken, best


def tried(found: Calibration, wanted: ModelStructure, least: float = -np.inf) -> Calibration:
    """Estimate with another structure from one linearisation, about an estimate.

    Args:
        found: An estimate.
        wanted: Another structure.
        least: Log evidence below which the estimate is not needed.
    """
    mechanism = _equipped(found.mechanism, found.readings, wanted)
    here = _beside(found, mechanism, wanted)
    if here is None:
        here = linearised(found.readings, mechanism, found.weights)
    known = found.known
    new_masses = mechanism.unknown != found.mechanism.unknown
    others = known.groups != scale_groups(mechanism)  # as many amplitudes may be of other laws
    if new_masses or others or len(known.std) != layout(mechanism).dense:
        new = prior(mechanism, known.stated, found.weights.payloads)
        known = _scaled(new, layout(mechanism).letters, known)
    known = _only(known, mechanism, wanted)
    fit = _LinearFit(mechanism, known, _scatter_without(found, wanted), here)
    if not fit.hopeless(wanted, found.held, least):
        fit, _ = fit.rescaled(wanted, _UPDATES, least)
    return fit.ended(fit.mechanism, found.readings, found.weights, wanted)


def _beside(found: Calibration, mechanism: Mechanism, wanted: ModelStructure) -> Linear | None:
    """The linearisation of an estimate for other laws and curves; None where it needs a new one.

    In absolute parameters the left-hand side of its rows is the same.
    """
    old, rows, laws = found.mechanism, found.rows, mechanism.laws
    if wanted.moments or replace(found.wanted, laws=wanted.laws, curves=wanted.curves) != wanted:
        return None
    if any(law.by_balancer for law in set(laws) ^ set(old.laws)):
        return None
    here, where = found.linear, layout(old)
    _, old_D, Z, _ = here.seen
    ends = np.cumsum([where.laws.start, *(law.amplitudes for law in old.laws)])
    known = {law: old_D[..., a:b] for law, a, b in zip(old.laws, ends[:-1], ends[1:], strict=True)}
    columns = [
        known[law]
        if law in known
        else Z[..., law.joint - 1, None] * law.basis(here.inputs)[:, None]
        for law in laws
    ]
    D = np.concatenate([old_D[..., : where.laws.start], *columns], axis=2)
    y = (rows.L @ rows.y[..., None])[..., 0] - D @ mechanism.at(layout(mechanism))[: D.shape[2]]
    return replace(here, y=here.spread(y), slopes=lambda _: (D, Z))


def _scatter_without(found: Calibration, wanted: ModelStructure) -> PoseScatter:
    """Scatter of an estimate with, at each pose, what curves explain that waves replace."""
    there, rows, inputs = found.mechanism, found.rows, found.linear.inputs
    kept = {joint for joint, _ in wanted.curves}
    at, beside = layout(there).knots.start, 0.0
    for curve in there.curves:
        f = curve.value(inputs.q[:, curve.joint], found.solution.x[at : at + curve.count])
        at += curve.count
        if curve.screw == curve.joint and curve.joint not in kept:
            own = [law.basis(inputs) for law in wanted.laws if law.joint == curve.joint + 1]
            X = linear.orthonormal(np.hstack([np.ones((len(f), 1)), *own]))
            Z = found.linear.seen[2][..., curve.joint]
            beside = beside + np.einsum("mij,mj->mi", rows.W, Z * (f - X @ (X.T @ f))[:, None])
    if isinstance(beside, float):
        return found.scatter
    e = rows.y - rows.along(found.solution.x) + beside
    return found.scatter.better(found.linear, unwhitened(rows, e, found.held))[0]
