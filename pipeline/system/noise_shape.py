"""Shape of the noise: parts along and across the beam, tails of single readings, common wander.

The beam comes first, then tails, in readings whitened accordingly: otherwise a tracker with one
figure for range and angles would seem to have tails. All are estimated from the residuals of
springs and causes and carried in V: the variances of readings, beam and wander at their posterior
means, so no test switches anything on or off. The first estimate is made with everything in the
catalogue as fixed effects, which no hidden cause can spoil; once the causes are accepted, with
these alone, which leaves far more degrees of freedom for the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.machine.effect import Pulls
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.assemble import ErrorBlock, inputs, with_readings
from pipeline.system.beam import BeamNoise, beam
from pipeline.system.family import FAR_OFF, PRESENT, Family, LoosestTarget, family, likelihood
from pipeline.system.linearised import Linearised
from pipeline.system.odds import DECIDES
from pipeline.system.rows_by_pose import ReadingsOfRows, RowsByPose, columns, estimates, free
from pipeline.system.spells import States
from pipeline.system.system import Goodness, System
from pipeline.system.wander import Wander, wander
from pipeline.system.whiten import whitener

_ROUNDS = 8
"""Maximum number of reweighting iterations where blunders are among the readings: a bad one
spoils the estimates of its neighbours."""

_STILL = 0.3
"""Maximum change of a log variance for the iteration to stop [1]."""

_MANY = 20_000
"""Number of rows above which the springs alone are fixed effects: the whole catalogue would exceed
the memory. The same applies where the catalogue would take half of the rows."""

_DRAWS = 2000
"""Number of simulated campaigns of pure noise that a misfit is compared with."""

_FEWEST = 12
"""Minimum degrees of freedom for tails to be estimated from the residuals."""

_HEAVY = 0.05
"""Probability of heavier tails below which the misfit is compared with chi-square [1]."""

_SEEN = 0.1
"""Change of a variance, relative to that of a reading, for which a campaign is analysed again [1]:
a twentieth of a standard uncertainty, which no reader would notice."""


@dataclass(frozen=True, eq=False)
class NoiseShape(Locked):
    """What is found of the noise in addition to its stated size.

    Attributes:
        family: Tails of single readings.
        variance: Variance of each reading over its stated one, posterior mean, shape (n,).
        readings: The readings these belong to.
        wander: Slow error common to all targets.
        weighed: Whether each reading has a variance of its own.
        beam: The parts of all readings along and across the beam.
    """

    family: Family
    variance: Array
    readings: ReadingsOfRows
    wander: Wander
    weighed: bool
    beam: BeamNoise

    @classmethod
    def unseen(cls, data: Measured) -> NoiseShape:
        """The stated noise, all readings alike."""
        readings = ReadingsOfRows.unseen(data)
        variance = np.ones(readings.loaded + len(readings.zero))
        family, slow, parts = Family.stated(data.paper), Wander.none(data), BeamNoise.stated(data)
        return cls(family, variance, readings, slow, False, parts)

    @property
    def likely(self) -> bool:
        """Whether heavier tails, or a wander, are more likely than not."""
        return self.family.likely_heavy or self.wander.probability > PRESENT

    @property
    def wide_m(self) -> float:
        """Scatter of a reading per axis, beam, tails and wander included, root mean square [m].

        The variance of a single reading counts up to that of one at `FAR_OFF`.
        """
        core = float(np.sqrt(np.mean(np.minimum(self.variance, FAR_OFF**2 / 3))))
        return float(np.hypot(core * self.wander.unit, self.wander.size))

    @property
    def tailed(self) -> bool:
        """Whether heavier tails than stated are applied and significant."""
        return self.weighed and self.family.p_value < alarms.COMPONENT

    @property
    def loosest(self) -> LoosestTarget | None:
        """The target that scatters more than the others, if that is applied and significant."""
        one = self.family.loosest
        sure = one is not None and one.probability > PRESENT and one.p_value < alarms.COMPONENT
        return one if self.weighed and sure else None

    @property
    def wanders(self) -> bool:
        """Whether a wander is applied and significant."""
        likely = self.wander.probability > PRESENT
        return self.weighed and likely and self.wander.p_value < alarms.COMPONENT

    def on(self, data: Measured) -> Measured:
        """The measurements with the whole shape in their covariances."""
        weighed = self.readings.scaled(self.beam.on(data), self.variance)
        heavy = self.family.heavy if self.weighed else 0.0
        return replace(weighed, wander=self.wander.factor, heavy=heavy)

    def off(self, data: Measured) -> Measured:
        """The measurements without it, all readings alike again."""
        return replace(self.beam.off(self.alike(data)), wander=None, heavy=0.0)

    def alike(self, data: Measured) -> Measured:
        """Measurements as from `on` without the variances of single readings.

        BeamNoise and wander are kept.
        """
        return replace(self.readings.scaled(data, 1 / self.variance), heavy=0.0)

    def differs(self, other: NoiseShape) -> bool:
        """Whether the two weight a campaign differently enough to analyse it again."""
        own, theirs = (
            float(np.sum(one.wander.factor**2)) / (3 * len(one.wander.factor))
            for one in (self, other)
        )
        unit = self.wander.unit**2
        weights = np.log(self.variance / other.variance)
        changed = np.sqrt(np.mean(weights**2)) > _SEEN or self.beam.change(other.beam) > _SEEN
        return bool(abs(own - theirs) > _SEEN * unit or changed)


_Told = tuple[ReadingsOfRows, Family, Array, RowsByPose]
"""The readings, their family, the variance of each (n,) relative to the noise without tails, and
the rows weighted accordingly."""


_COLLAPSED, _FEW = 0.5, 100
"""Mean variance of the readings over that of all residuals [1], below which readings of so few
degrees of freedom have lost the scale as they judge each other (see `_overstated`): the stated
noise, which the residuals do not contradict, then stands."""


def shape(
    seen: Linearised, accepted: tuple[int, ...] | None = None, loose: bool = False
) -> NoiseShape:
    """Estimate the shape of a campaign's noise.

    With the accepted causes as fixed effects each reading gets its own variance; with the whole
    catalogue it does not, since so many columns leave some readings too little redundancy. Where
    there are too few rows for the catalogue, a free stiffness for each pose takes its place; where
    there are too many, the springs alone do.

    Args:
        seen: The campaign linearised at a model; the noise of its data is as stated or as found in
            contrasts, that of its rows is not used.
        accepted: Suspects that are fixed effects besides the springs; all of them when not given.
        loose: Whether a free stiffness for each pose is a fixed effect, too: it absorbs whatever a
            machine does in proportion to the pull, in the catalogue or not.
    """
    # one iteration only: weights derived from weights favour readings that deviate in the
    # same direction, and uncertainties come out too small
    parts, told = _seen(seen, accepted, 1, loose)
    slow = _wander(seen, parts, told[3])
    variance = np.ones(len(told[2])) if accepted is None else told[2]
    return NoiseShape(told[1], variance, told[0], slow, accepted is not None, parts)


def _wander(seen: Linearised, parts: BeamNoise, beyond: RowsByPose) -> Wander:
    """The wander beside beam and tails."""
    springs = seen.B * np.array(
        [one.typical for one in seen.model.cell.parameters[: seen.model.springs]]
    )
    return wander(parts.on(seen.data), beyond, beyond.base.dof >= _FEWEST, springs)


def tails(
    seen: Linearised,
    accepted: tuple[int, ...] | None = None,
    rounds: int = _ROUNDS,
    loose: bool = False,
) -> _Told:
    """Estimate the tails of single readings relative to a model, arguments as for `shape`.

    Args:
        seen: As for `shape`.
        accepted: As for `shape`.
        rounds: Maximum number of reweighting iterations.
        loose: As for `shape`.
    """
    return _seen(seen, accepted, rounds, loose)[1]


def _seen(
    seen: Linearised,
    accepted: tuple[int, ...] | None,
    rounds: int,
    loose: bool,
) -> tuple[BeamNoise, _Told]:
    """BeamNoise and tails; where there are tails, both again with the readings so weighted."""
    X, data = _taken_out(seen, accepted, loose), replace(seen.data, bends=False)
    Q, dof = linear.orthonormal(X), len(X) - X.shape[1]
    flat = replace(seen.model.cell, equilibrium="undeformed")
    others = inputs(flat, data, seen.model.values)
    parts = _beam(seen, Q, dof, data, others)
    told = _tails(seen, Q, data, others, parts, rounds)
    if told[1].heavy < _HEAVY and np.abs(np.log(told[2])).max() < _STILL:
        return parts, told
    # where most readings are off the model is wrong, which makes no part of the noise smaller
    middle = float(np.median(told[2]))
    weighed = told[0].scaled(data, told[2] / max(middle, 1.0))
    again = _beam(seen, Q, dof, weighed, others)
    if not (middle > 1.0 and again.along < parts.along):
        along, across = np.sqrt(min(middle, 1.0)) * np.array(again.found)
        parts = replace(again, found=(float(along), float(across)))
    return parts, _tails(seen, Q, data, others, parts, rounds)


def _beam(
    seen: Linearised, Q: Array, dof: int, data: Measured, others: Sequence[ErrorBlock]
) -> BeamNoise:
    """Both parts of the noise with fixed effects Q, readings weighted as in `data`."""
    return beam(data, replace(seen.system, errors=with_readings(others, data)), Q, dof)


def _tails(
    seen: Linearised,
    Q: Array,
    stated: Measured,
    others: Sequence[ErrorBlock],
    parts: BeamNoise,
    rounds: int,
) -> _Told:
    """Tails of the readings of `stated`, after the beam is applied, with fixed effects Q."""
    data = parts.on(stated)
    beyond = RowsByPose.beside(seen, Q, with_readings(others, data))
    readings, found = ReadingsOfRows.of(data, beyond.white), Family.stated(data.paper)
    variance = np.ones(readings.loaded + len(readings.zero))
    if beyond.base.dof < _FEWEST:
        return readings, found, variance, beyond
    less = _overstated(beyond)
    if less < 1:
        variance *= less
        beyond = RowsByPose.beside(seen, Q, with_readings(others, readings.scaled(data, variance)))
        readings = ReadingsOfRows.of(data, beyond.white)
    start, least = variance, variance[0] * min(beyond.base.rest / beyond.base.dof, 1.0)
    for turn in range(rounds):
        square, spread, good = estimates(beyond.base, readings)
        states, targets = _in_time(readings.state[good], data.pulls), readings.targets(data)[good]
        told, mean = family(likelihood(square, spread, variance)[good], states, data.paper, targets)
        if beyond.base.dof < _FEW and mean.sum() < _COLLAPSED * least * len(mean):
            told, mean = Family.stated(data.paper), start[good]
        first = found if turn else told
        found = replace(
            told,
            p_value=first.p_value,
            profile=first.profile,
            widest=parts.widest,
            loosest=first.loosest,
        )
        before, variance = variance, np.ones(len(variance))
        variance[good] = mean
        if turn + 1 < rounds and told.in_spells:
            away = np.sum(square / (spread - before[:, None] + start[:, None]), axis=1)
            variance[good] = told.among_spells(mean, start[good], away[good])
        beyond = RowsByPose.beside(seen, Q, with_readings(others, readings.scaled(data, variance)))
        readings = ReadingsOfRows.of(data, beyond.white)
        if np.abs(np.log(variance / before)).max() < _STILL:
            break
    if found.in_spells and rounds > 1:
        variance[good] = mean
        beyond = RowsByPose.beside(seen, Q, with_readings(others, readings.scaled(data, variance)))
        readings = ReadingsOfRows.of(data, beyond.white)
    return readings, found, variance, beyond


def _in_time(keys: Ints, pulls: Pulls) -> States:
    """States of readings with these keys (n, 2), by the times of the pulls, or else as recorded.

    Zeros stand before the first and after the last pull of their pose, where any were read.
    """
    m, timed = len(pulls), bool(np.isfinite(pulls.time).all())
    place = np.argsort(np.argsort(pulls.time, kind="stable")) if timed else np.arange(m)
    _, of = np.unique(pulls.pose, return_inverse=True)
    first, last = (np.lexsort((way * place, of)) for way in (1, -1))
    first, last = (one[np.unique(of[one], return_index=True)[1]] for one in (first, last))
    first, last = first[pulls.zeros_after[first] < 1], last[pulls.zeros_after[last] > 0]
    which = np.concatenate([np.arange(m), first, last])
    nth = np.concatenate([pulls.repeat, np.full(len(first) + len(last), -1)])
    when = np.concatenate([place, place[first] - 0.5, place[last] + 0.5])
    return States.each(keys, np.column_stack([pulls.pose[which], nth])[np.argsort(when)])


def _overstated(beyond: RowsByPose) -> float:
    """Common variance of the residuals over the stated one where it is certainly smaller, else 1.

    A reading is judged by the errors of its prediction from the others, which are overstated, too:
    s^2 (1 + S) in place of 1 + S would be taken for a variance of s^2 - (1 - s^2) S of its own.
    """
    dof, rest = beyond.base.dof, beyond.base.rest
    less = max(rest / dof, linear.TINY)
    return less if less < 1 and dof * (less - 1 - np.log(less)) > DECIDES else 1.0


def _taken_out(seen: Linearised, accepted: tuple[int, ...] | None, loose: bool) -> Array:
    """Fixed effects (M, k): springs and accepted causes, or all that a machine could do."""
    owner = np.repeat(np.arange(len(seen.suspects)), [len(e.parameters) for e in seen.suspects])
    many = len(seen.rows) > _MANY
    few = 2 * (seen.B.shape[1] + seen.Z.shape[1]) > len(seen.rows)
    loose = not many and (loose or (accepted is None and few))
    if accepted is None and not (many or few):
        return columns(seen, np.full(len(owner), True))
    own = columns(seen, np.isin(owner, accepted or ()))
    return np.hstack([own, free(seen)]) if loose else own


def goodness(system: System, found: NoiseShape, rng: np.random.Generator) -> Goodness:
    """Goodness of fit of a model with noise of the family in use.

    chi2 = y' V^-1 (y - X b) with V as stated and the wander; where heavier tails are in use,
    `_DRAWS` campaigns of pure noise are simulated, each reading with a lambda of its own. Tails
    that are found but not used change nothing: chi2 is then compared with the stated noise.

    Args:
        system: c = B x + G e with the wander, each reading as it is stated.
        found: The shape of the noise.
        rng: Source of the draws.
    """
    white = whitener(system.errors, system.rows.pose)
    base = white.base(system.B * system.typical, system.c)
    heavy = found.family.heavy if found.weighed else 0.0
    if base.dof < _FEWEST or (heavy < _HEAVY and not found.family.paper):
        return Goodness.of(base.rest, base.dof)
    which = found.readings.columns(system)
    family = found.family if heavy >= _HEAVY else Family.stated(found.family.paper)
    spread = family.drawn(found.readings.state, _DRAWS, rng)
    e = rng.standard_normal((system.errors.G.shape[1], _DRAWS))
    e *= np.sqrt(np.where(which[:, None] >= 0, spread[which], 1.0))
    drawn = white.with_priors(np.asarray(system.errors.G @ e))
    return Goodness.among(base.rest, base.dof, np.sum(base.beyond(drawn) ** 2, axis=0))
