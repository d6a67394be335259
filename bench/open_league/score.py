"""One answer beside the truth: what docs/open-league.md says is counted, and nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.open_league.truth import Cause, Prediction, Truth

Json = Mapping[str, Any]

NEUTRAL = ("tracker_noise", "force_noise", "heavy_tails", "tracker_wander")
"""They say how readings scatter, not what moves them: naming one is neither right nor wrong."""

FLOOR = 1e-3
"""Probabilities are held between this and one minus this, so that no single game decides."""

NORMAL_95 = 1.959963984540054


@dataclass(frozen=True)
class Value:
    """A number beside the true one.

    Attributes:
        error: Estimated minus true, over true for a stiffness, in metres for a deflection; None
            where nothing was estimated.
        covered: The 95 % interval holds the truth; None where there is no interval.
        width: Of the interval, over the truth or in metres; None where it has no end.
    """

    error: float | None
    covered: bool | None
    width: float | None


@dataclass(frozen=True)
class Score:
    """What came of one game.

    Attributes:
        answered: There was an answer.
        right: True causes that were named.
        missed: True causes of the catalogue that were not named.
        wrong: Names that no true cause has.
        noticed: Something was said to be wrong with the model or the data.
        exact: All true causes of the catalogue were named and nothing else.
        log_score: Sum over labels of -ln(probability of what came true); None where the entry
            states no probabilities.
        springs: Of every joint.
        deflections: Of every target and axis of every prediction.
        scale_m: Root mean square of the true deflections [m], what their errors compare with.
    """

    answered: bool
    right: int
    missed: int
    wrong: int
    noticed: bool
    exact: bool
    log_score: float | None
    springs: tuple[Value, ...]
    deflections: tuple[Value, ...]
    scale_m: float


def score(truth: Truth, answer: Json | None) -> Score:
    """Compare an answer with the truth; whoever gives none has named and estimated nothing."""
    said = answer or {}
    diagnosis: Json = said.get("diagnosis") or {}
    causes = [c for c in diagnosis.get("causes") or () if c.get("name") not in NEUTRAL]
    named = [label(cause) for cause in causes]
    listed = [cause for cause in truth.causes if cause.listed]
    right = sum(any(name in cause.labels for name in named) for cause in listed)
    wrong = sum(not any(name in cause.labels for cause in truth.causes) for name in named)
    true = [v for p in truth.predictions for three in p.deflection_m.values() for v in three]
    return Score(
        answered=answer is not None,
        right=right,
        missed=len(listed) - right,
        wrong=wrong,
        noticed=answer is not None and (bool(named) or diagnosis.get("verdict") != "adequate"),
        exact=answer is not None and right == len(listed) and not wrong,
        log_score=_log_score(truth.causes, causes),
        springs=_springs(truth, said),
        deflections=tuple(v for p in truth.predictions for v in _deflections(p, said)),
        scale_m=float(np.sqrt(np.mean(np.square(true)))) if true else 0.0,
    )


def label(cause: Json) -> str:
    """`joint_tilt:3`, or `rail_roll` where it has no place."""
    where = cause.get("where")
    return str(cause["name"]) if where is None else f"{cause['name']}:{where}"


def _log_score(true: Iterable[Cause], causes: list[Json]) -> float | None:
    """Good's logarithmic score over every label that is stated or true.

    A label is stated with its probability as cause or rival, what is not stated with `FLOOR`.
    None where a named cause has no probability.
    """
    if any(cause.get("probability") is None for cause in causes):
        return None
    odds: dict[frozenset[str], float] = {one.labels: 0.0 for one in true if one.labels}
    wrong: dict[str, float] = {}
    for one in (o for cause in causes for o in (cause, *cause.get("rivals", ()))):
        mine = next((labels for labels in odds if label(one) in labels), None)
        if mine is not None:
            odds[mine] += one["probability"]
        else:
            wrong[label(one)] = wrong.get(label(one), 0.0) + one["probability"]
    happened = [*odds.values(), *(1 - p for p in wrong.values())]
    return float(-np.sum(np.log(np.clip(happened, FLOOR, 1 - FLOOR)))) if happened else 0.0


def _springs(truth: Truth, said: Json) -> tuple[Value, ...]:
    """By name; a joint of which the answer says nothing counts as not estimated."""
    given = {one["name"]: one for one in said.get("stiffness") or ()}
    return tuple(_spring(one.value, given.get(one.name) or {}) for one in truth.stiffness)


def _spring(true: float, said: Json) -> Value:
    value = said.get("value")
    error = None if value is None else value / true - 1
    ends = said.get("ci95")
    if not ends or (ends[0] is None and ends[1] is None):
        return Value(error, None, None)
    low, high = (
        np.inf * sign if end is None else end for end, sign in zip(ends, (-1, 1), strict=True)
    )
    width = (high - low) / true if np.isfinite(high - low) else None
    return Value(error, bool(low <= true <= high), width)


def _deflections(true: Prediction, said: Json) -> Iterable[Value]:
    """Of the test pose from `test_pose_deflection`, of others from `predictions` by name."""
    key = "test_pose_deflection"
    rows = said.get(key) if true.name == "test_pose" else said.get("predictions", {}).get(true.name)
    given = {row["target"]: row for row in rows or ()}
    for target, three in true.deflection_m.items():
        row = given.get(target) or {}
        std = row.get("std_mm") or (None,) * 3
        for axis, at, u in zip("xyz", three, std, strict=True):
            yield _deflection(at, row.get(f"d{axis}_mm"), u)


def _deflection(true: float, said_mm: float | None, std_mm: float | None) -> Value:
    if said_mm is None:
        return Value(None, None, None)
    error = 1e-3 * said_mm - true
    if std_mm is None:
        return Value(error, None, None)
    half = NORMAL_95 * 1e-3 * std_mm
    return Value(error, bool(abs(error) <= half), 2 * half)
