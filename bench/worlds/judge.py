"""Judge: compares result.json with the sealed truth, and uses nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.league.judge import SCATTER, label
from bench.league.play import NAMES
from bench.worlds.payloads import Payload
from bench.worlds.worlds import FORCE
from pipeline.base.arrays import Array

Json = Mapping[str, Any]

DATA = ("outlier", "label_swap", "unit_mixup", "sign_or_convention", "tool_point")
"""Causes that are mistakes in the data."""

MOVED = ("tracker_moved", "tracker_moved_or_knocked")
"""Findings that the tracker did not stand still."""

LISTED = 0.01
"""Probability below which a rival is not counted [1]."""

CONTRADICTS = 1e-3
"""p-value below which a payload must be reported as different from stated [1] (docs/causes.md)."""

WIDE = 1.959964
"""Half width of a 95 % interval in standard uncertainties [1]."""


@dataclass(frozen=True)
class Interval:
    """A true value with the answer's estimate.

    Attributes:
        name: Name of the quantity.
        true: Planted value [SI].
        value: Estimate.
        std: Stated standard uncertainty.
        low: Lower end of the 95 % interval; None if there is no limit.
        high: Upper end.
    """

    name: str
    true: float
    value: float
    std: float
    low: float | None
    high: float | None

    @property
    def covered(self) -> bool:
        """Whether the interval contains the truth."""
        above = self.low is None or self.low <= self.true
        return above and (self.high is None or self.true <= self.high)

    @property
    def pull(self) -> float:
        """Error of the estimate in standard uncertainties."""
        return (self.value - self.true) / self.std

    @property
    def width(self) -> float | None:
        """Width of the interval relative to the truth; None without limits."""
        if self.low is None or self.high is None:
            return None
        return (self.high - self.low) / abs(self.true)


@dataclass(frozen=True)
class Spoilt:
    """A reading that was spoilt.

    Attributes:
        name: group/target.
        line: Line in tracker.csv.
        off_m: Size of the error [m].
        visible_m: Smallest detectable error of that reading in that direction [m]; None if none is.
        companions: file:line of everything that is left out with its pull.
    """

    name: str
    line: int
    off_m: float
    visible_m: float | None
    companions: tuple[str, ...] = ()

    def meant(self, where: object) -> bool:
        """Whether a cause's place is this reading, or two ends of a chain including it."""
        group, _, targets = str(where).partition("/")
        mine, _, target = self.name.partition("/")
        return group == mine and target in targets.split("-")

    def above(self, times: float) -> bool:
        """Whether it exceeds a multiple of the smallest detectable error."""
        return self.visible_m is not None and self.off_m > times * self.visible_m


@dataclass(frozen=True)
class Truth:
    """The sealed truth.

    Attributes:
        stiffness: Shape (n,) [N/m] or [N m/rad].
        deflection: At the test pose, shape (t, 3) [m], F_b; None if a hidden cause adds to it.
        spoilt: Spoilt readings.
        secrets: Labels of hidden causes.
        allowed: Names of causes that are right in addition to those of noise.
        family: Names of noise that are right.
        payloads: Mounted payloads.
    """

    stiffness: Sequence[float]
    deflection: Array | None
    spoilt: tuple[Spoilt, ...] = ()
    secrets: tuple[str, ...] = ()
    allowed: tuple[str, ...] = ()
    family: tuple[str, ...] = ()
    payloads: tuple[Payload, ...] = ()


@dataclass(frozen=True)
class Judged:
    """Result of one answer.

    Attributes:
        outcome: answered, refused (InputError) or crashed.
        message: Message of the error.
        verdict: The verdict.
        causes: Labels of all causes.
        accused: Whether something is wrongly reported: a cause that is neither noise nor allowed
            nor hidden, or a verdict that leaves doubt.
        family: Whether a name of noise that is right was given.
        springs: Stiffnesses that are reported as identifiable.
        deflections: At the test pose, each axis of each reflector.
        combinations: Combinations of compliances that are determined only together.
        placed: For each spoilt reading, whether it is named at its place or listed as rejected.
        innocents: Readings accused that are not spoilt.
        false_causes: Causes of the machine that are neither allowed nor hidden.
        drift_said: Whether the tracker is reported to have moved.
        listed: Whether all hidden causes are among causes and rivals.
        weighed: Masses and centres of mass according to the joint torques.
        contradicted: Payloads reported as different from stated.
        left_mm: Residuals of each payload's rows with the springs of all others, rms [mm].
        measures: What the instrument is reported to measure.
        positions_mm: Deviation of unloaded reflectors from nominal DH parameters, and of those at
            left-out poses from estimated ones, rms per coordinate [mm]; empty if not stated.
    """

    outcome: str
    message: str = ""
    verdict: str = ""
    causes: tuple[str, ...] = ()
    accused: bool = True
    family: bool = False
    springs: tuple[Interval, ...] = ()
    deflections: tuple[Interval, ...] = ()
    combinations: tuple[Interval, ...] = ()
    placed: tuple[bool, ...] = ()
    innocents: tuple[str, ...] = ()
    false_causes: tuple[str, ...] = ()
    drift_said: bool = False
    listed: bool = False
    weighed: tuple[Interval, ...] = ()
    contradicted: tuple[str, ...] = ()
    left_mm: tuple[float, ...] = ()
    measures: str = ""
    positions_mm: tuple[float, ...] = ()


def _positions(answer: Json) -> tuple[float, ...]:
    held = (answer["validation"] or {}).get("held_out_position_mm")
    before = answer["diagnosis"]["unloaded_off_mm"][0]
    return () if held is None else (before, held["rms"] / float(np.sqrt(3.0)))


def judged(truth: Truth, answer: Json) -> Judged:
    """Compare result.json with the sealed truth."""
    said = answer["diagnosis"]
    every = said["causes"]
    names = {cause["name"] for cause in every}
    right = {*SCATTER, *truth.allowed}
    found = bool(names & set(truth.allowed)) or bool({*map(label, every)} & set(truth.secrets))
    excused = found and said["verdict"] in ("explained", "ambiguous")
    hidden = set(truth.secrets)
    strange = [
        c for c in every if c["name"] not in right and not hidden & {label(c), *c.get("twins", ())}
    ]
    accused = [c for c in strange if c["name"] in DATA]
    rejected = {(row["file"], row["line"]) for row in answer["rejected"]}
    return Judged(
        outcome="answered",
        verdict=said["verdict"],
        causes=tuple(label(cause) for cause in every),
        accused=bool(strange) or (said["verdict"] != "adequate" and not excused),
        family=bool(names & {*truth.family, *truth.allowed}),
        springs=_springs(answer, truth.stiffness),
        deflections=_deflections(answer, truth.deflection),
        combinations=_combinations(answer, truth.stiffness),
        placed=tuple(
            any(one.meant(c["where"]) for c in accused) or ("tracker.csv", one.line) in rejected
            for one in truth.spoilt
        ),
        innocents=_innocents(accused, rejected, truth.spoilt),
        false_causes=tuple(label(c) for c in strange if c["name"] not in DATA),
        drift_said="tracker_drift" in names or any(one in MOVED for one in said["reasons"]),
        positions_mm=_positions(answer),
        listed=set(truth.secrets) <= _listed(every),
        weighed=_weighed(answer, truth.payloads),
        contradicted=_contradicted(answer),
        left_mm=_left(answer),
        measures=(answer.get("instrument") or {}).get("measures", ""),
    )


def _innocents(
    accused: Sequence[Json], rejected: set[tuple[str, int]], spoilt: Sequence[Spoilt]
) -> tuple[str, ...]:
    along = {row for one in spoilt for row in one.companions}
    named = [label(c) for c in accused if not any(one.meant(c["where"]) for one in spoilt)]
    return (*named, *sorted({f"{file}:{line}" for file, line in rejected} - along))


def _listed(causes: Sequence[Json]) -> set[str]:
    rivals = [r for c in causes for r in c["rivals"] if r["probability"] > LISTED]
    return {label(one) for one in (*causes, *rivals)}


def _springs(answer: Json, true: Sequence[float]) -> tuple[Interval, ...]:
    return tuple(
        Interval(row["name"], true[row["joint"] - 1], row["value"], row["std"], *row["ci95"])
        for row in answer["stiffness"]
        if row["identifiable"] and row["value"] is not None and row["std"] is not None
    )


def _deflections(answer: Json, true: Array | None) -> tuple[Interval, ...]:
    if true is None:
        return ()
    out = []
    for row in answer["test_pose_deflection"]:
        t = NAMES.index(row["target"])
        for k, axis in enumerate("xyz"):
            value, std = row[f"d{axis}_mm"], (row["std_mm"] or [None] * 3)[k]
            if value is None or std is None:
                continue
            ends = (value - WIDE * std, value + WIDE * std)
            low, high = row["ci95_mm"][k] if "ci95_mm" in row else ends
            name = f"{row['target']}.{axis}"
            out.append(Interval(name, float(1e3 * true[t, k]), value, std, low, high))
    return tuple(out)


def _weighed(answer: Json, payloads: Sequence[Payload]) -> tuple[Interval, ...]:
    """Estimates of each payload from the torques, with the true values."""
    true = {one.name: one.true for one in payloads}
    out = []
    for row in answer.get("payloads", ()):
        found, body = row["found"], true[row["name"]]
        if found is None:
            continue
        values = (found["mass_kg"], *found["center_m"])
        stds = (found["mass_std_kg"], *np.broadcast_to(found["center_std_m"], 3).tolist())
        named = zip(("kg", *"xyz"), (body.mass_kg, *body.center_m), values, stds, strict=True)
        out += [
            Interval(f"{row['name']}.{what}", is_, said, std, said - WIDE * std, said + WIDE * std)
            for what, is_, said, std in named
        ]
    return tuple(out)


def _contradicted(answer: Json) -> tuple[str, ...]:
    """Payloads whose statement the torques contradict: by their p-value, and in a sentence."""
    return tuple(
        row["name"]
        for row in answer.get("payloads", ())
        if row["p_value"] is not None
        and row["p_value"] < CONTRADICTS
        and any(row["name"] in text for text in answer["findings"])
    )


def _left(answer: Json) -> tuple[float, ...]:
    by = (answer["validation"] or {}).get("by_payload") or {}
    return tuple(float(mm) for mm in by.values() if mm is not None)


def _combinations(answer: Json, stiffness: Sequence[float]) -> tuple[Interval, ...]:
    """Sums of weight times compliance; combinations with geometry parameters are skipped."""
    true = {row["name"]: 1 / stiffness[row["joint"] - 1] for row in answer["stiffness"]}
    out = []
    for one in answer.get("combinations") or []:
        if not set(one["of"]) <= set(true):
            continue
        exact = sum(w * true[name] for w, name in zip(one["weights"], one["of"], strict=True))
        half = WIDE * one["std"]
        ends = one.get("ci95") or (one["value"] - half, one["value"] + half)
        out.append(Interval("+".join(one["of"]), exact, one["value"], one["std"], *ends))
    return tuple(out)


def shift(answer: Json, before: Json) -> tuple[float, float]:
    """Largest changes of compliances and test-pose deflections, in stds of `before`.

    The change is infinite if a quantity is no longer determined.
    """
    return _moved(_compliances(before), _compliances(answer)), _moved(
        _predicted(before), _predicted(answer)
    )


Values = dict[str, tuple[float | None, float | None]]


def _moved(before: Values, after: Values) -> float:
    far = [0.0]
    for name, (value, std) in before.items():
        if value is None or not std:
            continue
        now = after.get(name, (None, None))[0]
        far.append(np.inf if now is None else abs(now - value) / std)
    return float(max(far))


def _compliances(answer: Json) -> Values:
    return {
        row["name"]: (row["compliance"], row["compliance_std"])
        for row in answer["stiffness"]
        if row["compliance_std"] is not None
    }


def _predicted(answer: Json) -> Values:
    return {
        f"{row['target']}.{axis}": (row[f"d{axis}_mm"], row["std_mm"][k])
        for row in answer["test_pose_deflection"]
        if row["std_mm"] is not None
        for k, axis in enumerate("xyz")
    }


def forces_doubted(answer: Json, before: Json) -> bool:
    """Whether forces, or all stiffnesses, are reported to be wrong by a large factor.

    By a cause, or by the common factor of the stiffnesses and its sentence.
    """
    causes = {cause["name"] for cause in answer["diagnosis"]["causes"]}
    return bool(causes & set(FORCE)) or (_factor(answer) and not _factor(before))


def _factor(answer: Json) -> bool:
    return "common_factor" in answer and any(
        "times" in text and "those of the robot file" in text for text in answer["findings"]
    )
