"""Which causes are common and how large they are, learnt from finished campaigns, or guessed.

A robot keeps its causes, so robots are counted, not campaigns: y_c = sum over robots of the share
of their campaigns that name cause c. The rates p_c of the causes come of one distribution,

    y_c ~ Binomial(R, p_c),   p_c ~ Beta(s m, s (1 - m)),

s and m where the marginal likelihood is largest (empirical Bayes, beta-binomial), and sizes of

    ln(size / typical) ~ N(mu_c, SPREAD^2),   mu_c ~ N(0, BETWEEN^2),

so that a cause that few robots have keeps close to what is guessed: all causes equally likely, of
typical size. Campaigns whose own answer rests on learnt priors teach nothing.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from pipeline.answer.contract import Answer
from pipeline.base.arrays import Array, Ints
from pipeline.diagnosis.finding import Verdict

ROBOTS, CAMPAIGNS = 10, 20
"""From so many robots and campaigns on, rates are learnt."""

_SIZED = 3
"""From so many robots with a cause on, its size is learnt."""

_CERTAIN = 0.5
"""Probability from which a cause counts as there."""

_SPREAD, _BETWEEN = 0.8, 0.6
"""Of ln(size / typical): within a cause, and of their means."""

_MOST_ODDS, _MOST_SIZE = 4.0, 3.0
"""Learnt odds and sizes are bounded: no cause is certain (19 : 1) by being common (16 : 1)."""


@dataclass(frozen=True)
class Expected:
    """What is expected of one cause.

    Attributes:
        name: Of the cause.
        robots: How many have it.
        odds: Over a cause of the mean rate, bounded.
        size: Over the typical size, bounded.
        odds_learnt: False: guessed.
        size_learnt: Likewise.
    """

    name: str
    robots: float
    odds: float
    size: float
    odds_learnt: bool
    size_learnt: bool


@dataclass(frozen=True)
class Experience:
    """What all campaigns teach.

    Attributes:
        robots: How many robots they are of.
        campaigns: How many count.
        causes: All that may be, by name.
    """

    robots: int
    campaigns: int
    causes: tuple[Expected, ...]

    @property
    def learnt(self) -> bool:
        """Whether rates are learnt at all."""
        return self.robots >= ROBOTS and self.campaigns >= CAMPAIGNS


def experience(answers: Iterable[Answer], names: Collection[str]) -> Experience:
    """What finished campaigns teach of causes with these names."""
    by_robot = _by_robot(answers)
    seen = {name: list(_shares(by_robot.values(), name)) for name in sorted(names)}
    sizes = {name: [size for own in by_robot.values() for size in _size(own, name)]
             for name in sorted(names)}  # fmt: skip
    count = sum(map(len, by_robot.values()))
    told = Experience(len(by_robot), count, ())
    total = np.array([sum(one) for one in seen.values()])
    robots = np.array([len(one) for one in seen.values()])
    odds = _odds(total, robots) if told.learnt else np.ones(len(seen))
    causes = [
        Expected(name, y, o, _expected_size(sizes[name]), told.learnt, len(sizes[name]) >= _SIZED)
        for name, y, o in zip(seen, total.tolist(), odds.tolist(), strict=True)
    ]
    return Experience(len(by_robot), count, tuple(causes))


def _by_robot(answers: Iterable[Answer]) -> dict[str, list[Answer]]:
    """Campaigns of each robot that teach something; those with priors repeat what was learnt.

    Odds are those of causes beside pulls: what positions show under the arm's weight, they show by
    another test.
    """
    found: dict[str, list[Answer]] = {}
    for one in answers:
        if one.diagnosis.verdict in _TEACHES and not (one.model.priors or one.position_steps):
            found.setdefault(one.machine, []).append(one)
    return found


_TEACHES = (Verdict.ADEQUATE, Verdict.EXPLAINED, Verdict.AMBIGUOUS)


def _shares(robots: Iterable[Sequence[Answer]], name: str) -> Iterator[float]:
    """Part of each robot's campaigns that name a cause, of those that could have seen it."""
    for own in robots:
        told = [one for one in own if _names(one, name) or not _blind(one, name)]
        if told:
            yield float(np.mean([_names(one, name) for one in told]))


def _names(one: Answer, name: str) -> bool:
    return any(c.name == name and c.probability > _CERTAIN for c in one.diagnosis.causes)


def _blind(one: Answer, name: str) -> bool:
    """Whether a cause of one place would have gone unnoticed there at its typical size."""
    return any(spot.name == name and spot.where is None for spot in one.diagnosis.blind_spots)


def _size(own: Sequence[Answer], name: str) -> list[float]:
    """Mean ln(size / typical) of a robot's cause; nothing where it has none."""
    logs = [
        math.log(cause.times_typical)
        for one in own
        for cause in one.diagnosis.causes
        if cause.name == name and cause.probability > _CERTAIN and cause.times_typical
    ]
    return [float(np.mean(logs))] if logs else []


def _expected_size(logs: Sequence[float]) -> float:
    """Exp of the mean of mu_c, shrunk to ln 1; typical where too few tell."""
    n = len(logs)
    if n < _SIZED:
        return 1.0
    mean = float(np.mean(logs)) * n / (n + (_SPREAD / _BETWEEN) ** 2)
    return float(np.clip(math.exp(mean), 1 / _MOST_SIZE, _MOST_SIZE))


def _odds(total: Array, robots: Ints) -> Array:
    """Posterior odds of each rate over their geometric mean, bounded, shape (n,)."""

    def loss(at: Array) -> float:
        a, b = np.exp(at)
        each = special.betaln(total + a, robots - total + b) - special.betaln(a, b)
        # one robot's worth of prior on either, so that a fleet without causes has a rate, too
        return float(-each.sum() + 0.5 * (at[0] ** 2 + (at[1] - 2.0) ** 2) / 2)

    a, b = np.exp(optimize.minimize(loss, np.array([0.0, 2.0]), method="Nelder-Mead").x)
    rate = (total + a) / (robots + a + b)
    log = special.logit(rate)
    most = math.log(_MOST_ODDS)
    return np.asarray(np.exp(np.clip(log - log.mean(), -most, most)))
