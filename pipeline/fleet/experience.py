"""Frequencies and sizes of causes, learnt from finished campaigns, or guessed.

Causes belong to robots, so robots are counted, not campaigns: y_c is the sum over robots of the
fraction of their campaigns that name cause c. The rates p_c of the causes have a common
distribution,

    y_c ~ Binomial(R, p_c),   p_c ~ Beta(s m, s (1 - m)),

with s and m that maximise the marginal likelihood (empirical Bayes, beta-binomial); for sizes,

    ln(size / typical) ~ N(mu_c, SPREAD^2),   mu_c ~ N(0, BETWEEN^2),

so that a cause of few robots stays close to the guess: all causes equally likely, of typical size.
Campaigns whose own answer uses learnt priors are not counted. `pipeline priors` writes them as
tables for campaign.toml.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import optimize, special

from pipeline.answer.contract import Answer
from pipeline.base.arrays import Array, Ints
from pipeline.base.errors import UsageError
from pipeline.diagnosis.finding import Verdict
from pipeline.fleet.history import finished
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load

ROBOTS, CAMPAIGNS = 10, 20
"""Minimum number of robots and of campaigns from which rates are learnt."""

_SIZED = 3
"""Minimum number of robots with a cause from which its size is learnt."""

_CERTAIN = 0.5
"""Probability from which a cause counts as present [1]."""

_SPREAD, _BETWEEN = 0.8, 0.6
"""Standard deviations of ln(size / typical) [1]: within a cause, and of the means of the causes."""

_MOST_ODDS, _MOST_SIZE = 4.0, 3.0
"""Bounds of learnt odds and sizes [1]: no cause becomes certain (19 : 1) by being common (16 :
1)."""


@dataclass(frozen=True)
class _Expected:
    """Expectation of one cause.

    Attributes:
        name: Name of the cause.
        robots: Number of robots that have it, a sum of fractions.
        odds: Odds relative to a cause of mean rate, bounded.
        size: Size relative to the typical one, bounded.
        odds_learnt: Whether the odds are learnt rather than guessed.
        size_learnt: Likewise for the size.
    """

    name: str
    robots: float
    odds: float
    size: float
    odds_learnt: bool
    size_learnt: bool


@dataclass(frozen=True)
class _Experience:
    """What all campaigns teach.

    Attributes:
        robots: Number of robots.
        campaigns: Number of campaigns that count.
        causes: All possible causes, by name.
    """

    robots: int
    campaigns: int
    causes: tuple[_Expected, ...]

    @property
    def learnt(self) -> bool:
        """Whether rates are learnt at all."""
        return self.robots >= ROBOTS and self.campaigns >= CAMPAIGNS


def experience(answers: Iterable[Answer], names: Collection[str]) -> _Experience:
    """Expectations of the causes with these names from finished campaigns."""
    by_robot = _by_robot(answers)
    seen = {name: list(_shares(by_robot.values(), name)) for name in sorted(names)}
    sizes = {name: [size for own in by_robot.values() for size in _size(own, name)]
             for name in sorted(names)}  # fmt: skip
    count = sum(map(len, by_robot.values()))
    told = _Experience(len(by_robot), count, ())
    total = np.array([sum(one) for one in seen.values()])
    robots = np.array([len(one) for one in seen.values()])
    odds = _odds(total, robots) if told.learnt else np.ones(len(seen))
    causes = [
        _Expected(name, y, o, _expected_size(sizes[name]), told.learnt, len(sizes[name]) >= _SIZED)
        for name, y, o in zip(seen, total.tolist(), odds.tolist(), strict=True)
    ]
    return _Experience(len(by_robot), count, tuple(causes))


def _by_robot(answers: Iterable[Answer]) -> dict[str, list[Answer]]:
    """Campaigns of each robot that count; those with priors would repeat what was learnt.

    Odds apply to causes found from pulls; campaigns of positions find causes by another test under
    the arm's own weight, and do not count.
    """
    found: dict[str, list[Answer]] = {}
    for one in answers:
        if one.diagnosis.verdict in _TEACHES and not (one.model.priors or one.position_steps):
            found.setdefault(one.machine, []).append(one)
    return found


_TEACHES = (Verdict.ADEQUATE, Verdict.EXPLAINED, Verdict.AMBIGUOUS)


def _shares(robots: Iterable[Sequence[Answer]], name: str) -> Iterator[float]:
    """Fraction of each robot's campaigns that name a cause, among those that could detect it."""
    for own in robots:
        chosen = [one for one in own if _names(one, name) or not _blind(one, name)]
        if chosen:
            yield float(np.mean([_names(one, name) for one in chosen]))


def _names(one: Answer, name: str) -> bool:
    return any(c.name == name and c.probability > _CERTAIN for c in one.diagnosis.causes)


def _blind(one: Answer, name: str) -> bool:
    """Whether a cause with a single place would have been missed at its typical size."""
    return any(spot.name == name and spot.where is None for spot in one.diagnosis.blind_spots)


def _size(own: Sequence[Answer], name: str) -> list[float]:
    """Mean ln(size / typical) of a robot's cause; empty if it does not have it."""
    logs = [
        math.log(cause.times_typical)
        for one in own
        for cause in one.diagnosis.causes
        if cause.name == name and cause.probability > _CERTAIN and cause.times_typical
    ]
    return [float(np.mean(logs))] if logs else []


def _expected_size(logs: Sequence[float]) -> float:
    """Exp of the mean of mu_c, shrunk to ln 1; 1 if too few robots have the cause."""
    n = len(logs)
    if n < _SIZED:
        return 1.0
    mean = float(np.mean(logs)) * n / (n + (_SPREAD / _BETWEEN) ** 2)
    return float(np.clip(math.exp(mean), 1 / _MOST_SIZE, _MOST_SIZE))


def _odds(total: Array, robots: Ints) -> Array:
    """Posterior odds of each rate relative to their geometric mean, bounded, shape (n,)."""

    def loss(at: Array) -> float:
        a, b = np.exp(at)
        each = special.betaln(total + a, robots - total + b) - special.betaln(a, b)
        # weak prior on a and b, so that a fleet without causes has rates, too
        return float(-each.sum() + 0.5 * (at[0] ** 2 + (at[1] - 2.0) ** 2) / 2)

    a, b = np.exp(optimize.minimize(loss, np.array([0.0, 2.0]), method="Nelder-Mead").x)
    rate = (total + a) / (robots + a + b)
    log = special.logit(rate)
    most = math.log(_MOST_ODDS)
    return np.asarray(np.exp(np.clip(log - log.mean(), -most, most)))


def learnt(root: Path, robot: str) -> _Experience:
    """Experience from all finished campaigns with the causes that a robot can have.

    Simulated campaigns are not counted, since their causes were chosen.

    Raises:
        InputError: There is no such robot.
        UsageError: No campaign is finished.
    """
    everyone = [one.answer for one in finished(root)]
    if not everyone:
        raise UsageError("no campaign is finished: run `pipeline run` first")
    answers = [one for one in everyone if not one.simulated]
    return experience(answers, {effect.name for effect in catalogue(load(robot))})


def toml(experience: _Experience) -> str:
    """Tables to append to campaign.toml; guesses are stated as such in comments."""
    return "\n".join(_lines(experience)) + "\n"


def _lines(experience: _Experience) -> Iterator[str]:
    yield (
        f"# From {experience.campaigns} campaigns of {experience.robots} robots by "
        "`pipeline priors`."
    )
    if not experience.learnt:
        yield (
            f"# Too few to learn how common causes are ({ROBOTS} robots and {CAMPAIGNS} campaigns "
            "are needed): all are guessed to be equally likely."
        )
    for one in experience.causes:
        if one.odds_learnt or one.size_learnt:
            yield from _table(one)
    guessed = [one.name for one in experience.causes if not one.size_learnt]
    if guessed:
        yield f"# Sizes are guessed, too few robots have them: {', '.join(guessed)}."


def _table(one: _Expected) -> Iterator[str]:
    yield f"[priors.{one.name}]  # in {one.robots:.2g} robots"
    if one.odds_learnt:
        yield f"odds = {one.odds:.3g}"
    if one.size_learnt:
        yield f"size = {one.size:.3g}"
