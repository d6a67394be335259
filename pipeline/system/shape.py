"""The shape of the noise beside a model: its beam, tails of single readings, a common wander.

First how good the range is beside the angles, then tails, in readings whitened by that: a tracker
with one figure for both would else pass for one with tails. All are found in what springs and
causes leave of the readings and carried in V: each reading's variance, the beam's and the wander's
at their posterior means, so that nothing is switched on by a test. First beside everything that the
catalogue knows, which no hidden cause can spoil; once the causes are accepted, beside these alone,
where far more is left to see the noise in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base.arrays import Array, Locked
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.assemble import Block, inputs, with_readings
from pipeline.system.beam import Beam, beam
from pipeline.system.beyond import Beyond, RowReadings, columns, estimates, free
from pipeline.system.family import LIKELY, Family, family, likelihood
from pipeline.system.linearised import Linearised
from pipeline.system.system import Goodness, System
from pipeline.system.wander import Wander, wander
from pipeline.system.whiten import whitener

_ROUNDS = 8
"""How often readings are weighed at most where blunders are among them: a bad one spoils what is
seen of its neighbours."""

_STILL = 0.3
"""Change of a log variance from which they are weighed once more [1]."""

_MANY = 20_000
"""Rows from which the springs alone stand for the model: a catalogue beside them fills a memory.
The same where the catalogue would take half of the rows."""

_DRAWS = 2000
"""Campaigns of pure noise that a misfit is compared with."""

_FEWEST = 12
"""Degrees of freedom from which the residuals say anything of tails."""

_HEAVY = 0.05
"""Below this probability of heavier tails the misfit is chi-square [1]."""

_SEEN = 0.1
"""Change of a variance, over that of a reading, that is worth looking at a campaign again [1]: a
twentieth of a standard uncertainty, which no reader would see."""


@dataclass(frozen=True, eq=False)
class Shape(Locked):
    """What is found of the noise beside what is stated of its size.

    Attributes:
        family: Tails of single readings.
        variance: Of each reading over its stated one, posterior mean, shape (n,).
        readings: Which readings these are.
        wander: Common to all targets, in time.
        weighed: Each reading has a variance of its own.
        beam: The parts of all readings along and across it.
    """

    family: Family
    variance: Array
    readings: RowReadings
    wander: Wander
    weighed: bool
    beam: Beam

    @classmethod
    def unseen(cls, data: Measured) -> Shape:
        """Nothing but what is stated, all readings alike."""
        readings = RowReadings.unseen(data)
        variance = np.ones(readings.loaded + len(readings.zero))
        family, slow, parts = Family.stated(data.paper), Wander.none(data), Beam.stated(data)
        return cls(family, variance, readings, slow, False, parts)

    @property
    def likely(self) -> bool:
        """Whether there rather is heavier noise, or a wander, than not."""
        return self.family.likely_heavy or self.wander.probability > LIKELY

    @property
    def tailed(self) -> bool:
        """Whether tails heavier than stated are carried and beyond chance."""
        return self.weighed and self.family.p_value < alarms.COMPONENT

    @property
    def wanders(self) -> bool:
        """Whether a wander is carried and beyond chance."""
        likely = self.wander.probability > LIKELY
        return self.weighed and likely and self.wander.p_value < alarms.COMPONENT

    def on(self, data: Measured) -> Measured:
        """The measurements with all of it in their covariances."""
        weighed = self.readings.scaled(self.beam.on(data), self.variance)
        heavy = self.family.heavy if self.weighed else 0.0
        return replace(weighed, wander=self.wander.factor, heavy=heavy)

    def off(self, data: Measured) -> Measured:
        """The measurements without it, all readings alike again."""
        return replace(self.beam.off(self.alike(data)), wander=None, heavy=0.0)

    def alike(self, data: Measured) -> Measured:
        """The measurements as of `on` with no reading's own variance, but beam and wander."""
        return replace(self.readings.scaled(data, 1 / self.variance), heavy=0.0)

    def differs(self, other: Shape) -> bool:
        """Whether the two weigh a campaign differently enough to look at it again."""
        own, theirs = (
            float(np.sum(one.wander.factor**2)) / (3 * len(one.wander.factor))
            for one in (self, other)
        )
        unit = self.wander.unit**2
        weights = np.log(self.variance / other.variance)
        changed = np.sqrt(np.mean(weights**2)) > _SEEN or self.beam.change(other.beam) > _SEEN
        return bool(abs(own - theirs) > _SEEN * unit or changed)


def shape(seen: Linearised, accepted: tuple[int, ...] | None = None, loose: bool = False) -> Shape:
    """The shape of a campaign's noise.

    Beside the accepted causes each reading is weighed by its own variance; beside the whole
    catalogue it is not, as many columns leave too little of some readings to weigh them by. Where
    there are too few rows for the catalogue, a stiffness of its own for each pose takes its place;
    where there are too many, the springs alone.

    Args:
        seen: The campaign linearised at a model; the noise of its data is as it is stated or was
            found in contrasts, that of its rows plays no part.
        accepted: Suspects that are taken out beside the springs; all of them when not given.
        loose: A stiffness of its own for each pose is taken out, too: whatever a machine does in
            proportion to the pull, listed or not, leaves nothing there.
    """
    # once: weights that follow from weights trust what is off towards the others more than it is
    # worth, and uncertainties come out too small
    parts, told = _seen(seen, accepted, 1, loose)
    readings, found, variance, beyond = told
    if accepted is None:
        variance = np.ones(len(variance))
    springs = seen.B * np.array(
        [one.typical for one in seen.model.cell.parameters[: seen.model.springs]]
    )
    slow = wander(parts.on(seen.data), beyond, beyond.base.dof >= _FEWEST, springs)
    return Shape(found, variance, readings, slow, accepted is not None, parts)


_Told = tuple[RowReadings, Family, Array, Beyond]
"""The readings, their family, the variance of each (n,) over that of the noise without tails, and
the rows so weighed."""


def tails(
    seen: Linearised,
    accepted: tuple[int, ...] | None = None,
    rounds: int = _ROUNDS,
    loose: bool = False,
) -> _Told:
    """The tails of single readings beside a model, arguments as for `shape`.

    Args:
        seen: As for `shape`.
        accepted: As for `shape`.
        rounds: How often each reading is weighed by what the others, so weighed, say of it.
        loose: As for `shape`.
    """
    return _seen(seen, accepted, rounds, loose)[1]


def _seen(
    seen: Linearised, accepted: tuple[int, ...] | None, rounds: int, loose: bool
) -> tuple[Beam, _Told]:
    """Beam and tails; where there are tails, the beam anew in readings so weighed, and they."""
    X, data = _taken_out(seen, accepted, loose), replace(seen.data, bends=False)
    flat = replace(seen.model.cell, equilibrium="undeformed")
    others = inputs(flat, data, seen.model.values)
    parts = _beam(seen, X, data, others)
    told = _tails(seen, X, data, others, parts, rounds)
    if told[1].heavy < _HEAVY and np.abs(np.log(told[2])).max() < _STILL:
        return parts, told
    # where most readings are off it is the model, and no part of the noise is smaller for that
    weighed = told[0].scaled(data, told[2] / max(float(np.median(told[2])), 1.0))
    parts = _beam(seen, X, weighed, others)
    return parts, _tails(seen, X, data, others, parts, rounds)


def _beam(seen: Linearised, X: Array, data: Measured, others: Sequence[Block]) -> Beam:
    """Both parts of the noise beside these columns, the readings of `data` weighed as they are."""
    return beam(data, replace(seen.system, errors=with_readings(others, data)), X)


def _tails(
    seen: Linearised,
    X: Array,
    stated: Measured,
    others: Sequence[Block],
    parts: Beam,
    rounds: int,
) -> _Told:
    """The tails of the readings of `stated`, along and across the beam, beside these columns."""
    data = parts.on(stated)
    beyond = Beyond.of(seen, X, with_readings(others, data))
    readings, found = RowReadings.of(data, beyond.white), Family.stated(data.paper)
    variance = np.ones(readings.loaded + len(readings.zero))
    if beyond.base.dof < _FEWEST:
        return readings, found, variance, beyond
    for turn in range(rounds):
        square, spread, good = estimates(beyond.base, readings)
        told, mean = family(likelihood(square, spread, variance)[good], data.paper)
        first = found if turn else told
        found = replace(told, p_value=first.p_value, profile=first.profile, widest=parts.widest)
        before, variance = variance, np.ones(len(variance))
        variance[good] = mean
        beyond = Beyond.of(seen, X, with_readings(others, readings.scaled(data, variance)))
        readings = RowReadings.of(data, beyond.white)
        if np.abs(np.log(variance / before)).max() < _STILL:
            break
    return readings, found, variance, beyond


def _taken_out(seen: Linearised, accepted: tuple[int, ...] | None, loose: bool) -> Array:
    """Columns (M, k) of springs and accepted causes, or of all that a machine could do."""
    owner = np.repeat(np.arange(len(seen.suspects)), [len(e.parameters) for e in seen.suspects])
    many = len(seen.rows) > _MANY
    few = 2 * (seen.B.shape[1] + seen.Z.shape[1]) > len(seen.rows)
    loose = not many and (loose or (accepted is None and few))
    if accepted is None and not (many or few):
        return columns(seen, np.full(len(owner), True))
    own = columns(seen, np.isin(owner, accepted or ()))
    return np.hstack([own, free(seen)]) if loose else own


def goodness(system: System, found: Shape, rng: np.random.Generator) -> Goodness:
    """What a model leaves, and how likely noise of the family that is carried leaves as much.

    chi2 = y' V^-1 (y - X b) with V as stated and the wander; where heavier tails are carried,
    `_DRAWS` campaigns of pure noise are drawn, each reading with a lambda of its own. Tails that
    are seen and not carried change nothing: chi2 then stands beside the stated noise.

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
    n = len(found.variance)
    family = found.family if heavy >= _HEAVY else Family.stated(found.family.paper)
    spread = family.drawn(n * _DRAWS, rng).reshape(n, _DRAWS)
    e = rng.standard_normal((system.errors.G.shape[1], _DRAWS))
    e *= np.sqrt(np.where(which[:, None] >= 0, spread[which], 1.0))
    drawn = white.with_priors(np.asarray(system.errors.G @ e))
    left = np.sum(base.beyond(drawn) ** 2, axis=0)
    return Goodness.among(base.rest, base.dof, left)
