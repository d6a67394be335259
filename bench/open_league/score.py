"""Comparison of one answer with the truth, as specified in docs/open-league.md."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.open_league.reply import Cause as Stated
from bench.open_league.reply import Reply, Spring
from bench.open_league.truth import Cause, Prediction, Truth

NEUTRAL = ("tracker_noise", "force_noise", "heavy_tails", "tracker_wander")
"""Causes that describe the scatter of readings; naming one is neither right nor wrong."""

FLOOR = 1e-3
"""Bound of probabilities [1]: they are clipped to this and one minus this, so that no single game
dominates."""

NORMAL_95 = 1.959963984540054


@dataclass(frozen=True)
class Value:
    """A number compared with the true one.

    Attributes:
        error: Estimated minus true, relative to the truth for a stiffness, in metres for a
            deflection; None if nothing was estimated.
        covered: Whether the 95 % interval contains the truth; None without an interval.
        width: Width of the interval, relative to the truth or in metres; None if it is unlimited.
    """

    error: float | None
    covered: bool | None
    width: float | None


NOTHING = Value(None, None, None)
"""Value without an estimate."""


@dataclass(frozen=True)
class Score:
    """Score of one game.

    Attributes:
        answered: Whether there was an answer.
        right: Number of true causes of the catalogue that were named.
        placed: Number of true causes outside the catalogue that were named as a law at their place.
        missed: Number of true causes of the catalogue that were not named.
        wrong: Number of names that no true cause has.
        noticed: Whether something was reported to be wrong with the model or the data.
        exact: Whether all true causes of the catalogue were named and nothing else.
        log_score: Sum over labels of -ln(probability of what is true); None if the entry states no
            probabilities.
        springs: Values of all joints.
        deflections: Values of every target and axis of every prediction.
        scale_m: Root mean square of the true deflections [m], for comparison with their errors.
    """

    answered: bool
    right: int
    placed: int
    missed: int
    wrong: int
    noticed: bool
    exact: bool
    log_score: float | None
    springs: tuple[Value, ...]
    deflections: tuple[Value, ...]
    scale_m: float


def score(truth: Truth, reply: Reply | None) -> Score:
    """Compare an answer with the truth; without an answer, nothing counts as named or estimated."""
    causes = [one for one in reply.diagnosis.causes if one.name not in NEUTRAL] if reply else []
    named = {one.label for one in causes}
    listed = [cause for cause in truth.causes if cause.listed]
    hit = [cause for cause in truth.causes if cause.labels & named]
    right = sum(cause.listed for cause in hit)
    wrong = sum(not any(one.label in cause.labels for cause in truth.causes) for one in causes)
    true = [v for p in truth.predictions for three in p.deflection_m.values() for v in three]
    return Score(
        answered=reply is not None,
        right=right,
        placed=len(hit) - right,
        missed=len(listed) - right,
        wrong=wrong,
        noticed=reply is not None and (bool(named) or reply.diagnosis.verdict != "adequate"),
        exact=reply is not None and right == len(listed) and not wrong,
        log_score=_log_score(truth.causes, causes),
        springs=_springs(truth, reply),
        deflections=tuple(v for p in truth.predictions for v in _deflections(p, reply)),
        scale_m=float(np.sqrt(np.mean(np.square(true)))) if true else 0.0,
    )


def _log_score(true: Iterable[Cause], causes: Sequence[Stated]) -> float | None:
    """Good's logarithmic score over every label that is stated or true.

    A label has its stated probability as cause or rival, or `FLOOR` if it is not stated. None if a
    cause has no probability.
    """
    stated = [(one.label, one.probability) for c in causes for one in (c, *c.rivals)]
    odds: dict[frozenset[str], float] = {one.labels: 0.0 for one in true if one.labels}
    wrong: dict[str, float] = {}
    for label, probability in stated:
        if probability is None:
            return None
        mine = next((labels for labels in odds if label in labels), None)
        if mine is not None:
            odds[mine] += probability
        else:
            wrong[label] = wrong.get(label, 0.0) + probability
    happened = [*odds.values(), *(1 - p for p in wrong.values())]
    return float(-np.sum(np.log(np.clip(happened, FLOOR, 1 - FLOOR)))) if happened else 0.0


def _springs(truth: Truth, reply: Reply | None) -> tuple[Value, ...]:
    """Values by name; a joint that the answer does not mention counts as not estimated."""
    given = {one.name: one for one in reply.stiffness} if reply else {}
    return tuple(_spring(one.value, given.get(one.name)) for one in truth.stiffness)


def _spring(true: float, said: Spring | None) -> Value:
    if said is None:
        return NOTHING
    error = None if said.value is None else said.value / true - 1
    if said.ci95 == (None, None):
        return Value(error, None, None)
    low = -np.inf if said.ci95[0] is None else said.ci95[0]
    high = np.inf if said.ci95[1] is None else said.ci95[1]
    width = (high - low) / true if np.isfinite(high - low) else None
    return Value(error, bool(low <= true <= high), width)


def _deflections(true: Prediction, reply: Reply | None) -> Iterator[Value]:
    given = reply.deflections(true.name) if reply else {}
    for target, three in true.deflection_m.items():
        row = given.get(target)
        if row is None:
            yield from [NOTHING] * 3
        else:
            said = (row.dx_mm, row.dy_mm, row.dz_mm)
            yield from (_deflection(*one) for one in zip(three, said, row.std_mm, strict=True))


def _deflection(true: float, said_mm: float | None, std_mm: float | None) -> Value:
    if said_mm is None:
        return NOTHING
    error = 1e-3 * said_mm - true
    if std_mm is None:
        return Value(error, None, None)
    half = NORMAL_95 * 1e-3 * std_mm
    return Value(error, bool(abs(error) <= half), 2 * half)
