"""Judge: compares the sealed truth with result.json, and uses nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.base.arrays import Array
from pipeline.diagnosis.isolability import Twins

Json = Mapping[str, Any]

SCATTER = ("tracker_noise", "force_noise", "heavy_tails", "tracker_wander")
"""Causes that describe the scatter of readings rather than a displacement."""

HALF_WIDTH = 1.959964
"""Half width of a 95 % interval in standard uncertainties [1]."""

LISTED = 0.01
"""Probability below which a rival is not counted [1]."""


@dataclass(frozen=True)
class Stated:
    """One cause that the answer considers possible.

    Attributes:
        label: Its class of twins.
        probability: Stated probability, of all its twins together.
        true: Whether it is one of the secrets.
    """

    label: str
    probability: float
    true: bool


@dataclass(frozen=True)
class Size:
    """A true value, such as an amplitude, with the interval of the answer.

    Attributes:
        name: Name of the parameter.
        true: Planted value [SI].
        low: Lower end of the 95 % interval; None if there is no limit.
        high: Upper end.
    """

    name: str
    true: float
    low: float | None
    high: float | None

    @property
    def covered(self) -> bool:
        """Whether the interval contains the truth."""
        above = self.low is None or self.low <= self.true
        return above and (self.high is None or self.true <= self.high)


@dataclass(frozen=True)
class Found:
    """What was found of a law that is in no catalogue.

    Attributes:
        named: Whether a law outside the catalogue is among the causes.
        place: Whether causes are named, all of them at the place of the law.
        what: Whether a law at the right place has the right kind and variable.
        order: The same with the right order.
        halved: Whether the cross-validation error falls to half or less.
        beyond: The same for its excess over the scatter of the readings, squares subtracted.
    """

    named: bool
    place: bool
    what: bool
    order: bool
    halved: bool
    beyond: bool


@dataclass(frozen=True)
class Score:
    """Score of one answer.

    Attributes:
        verdict: The verdict; `refused` if there is no answer.
        named: Labels of the causes, without those of scatter.
        right: Whether all secrets are named (twins as one), and nothing else.
        in_list: Whether all secrets are among causes and rivals.
        strayed: Whether something was named that is no secret.
        misplaced: Whether something was named in a part of the cell without a secret.
        stated: The causes considered possible, with their probabilities.
        sizes: Amplitudes of causes that are named and true.
        gain: Reduction of the cross-validation error with its 95 % interval.
        left_out_mm: Cross-validation error of the joint springs.
        remainder: Residuals with the causes over the scatter found, root mean square.
        apart: Separation in sigma that the proposed poses promise between the pair they separate
            least; None if nothing is proposed.
        law: For a secret with a law that is in no catalogue.
        springs: Stiffnesses that the answer determines.
        deflections: Of the load point under further forces, axis by axis.
    """

    verdict: str
    named: tuple[str, ...]
    right: bool
    in_list: bool
    strayed: bool
    misplaced: bool
    stated: tuple[Stated, ...]
    sizes: tuple[Size, ...]
    gain: tuple[float, float, float] | None
    left_out_mm: float | None
    remainder: float | None
    apart: float | None
    law: Found | None = None
    springs: tuple[Size, ...] = ()
    deflections: tuple[Size, ...] = ()

    @property
    def detected(self) -> bool:
        """Whether the verdict is anything but adequate."""
        return self.verdict != "adequate"

    @property
    def confident(self) -> bool:
        """Whether a cause is named without reservation."""
        return self.verdict == "explained" and bool(self.named)


REFUSED = Score("refused", (), False, False, False, False, (), (), None, None, None, None)
"""Score without an answer."""


def same(label: str, known: Twins) -> str:
    """Common name for twins."""
    for pair in known.pairs:
        if label in pair:
            return " = ".join(sorted(pair))
    return label


def label(cause: Json) -> str:
    """`rail_roll`, or `joint_tilt:2` with a place."""
    where = cause["where"]
    return cause["name"] if where is None else f"{cause['name']}:{where}"


def score(truth: Json, answer: Json | None, known: Twins) -> Score:
    """Compare the sealed truth with result.json.

    Args:
        truth: As sealed by `play`.
        answer: result.json; None if the pipeline rejected the campaign.
        known: Causes that no pull can distinguish.
    """
    if answer is None:
        return REFUSED
    diagnosis = answer["diagnosis"]
    causes = [cause for cause in diagnosis["causes"] if cause["name"] not in SCATTER]
    secrets = truth["secrets"]
    want = {same(secret["label"], known) for secret in secrets}
    places = {place for secret in secrets for place in secret["place"].split(" | ")}
    got = {_name(cause, secrets, known) for cause in causes}
    stated = tuple(said for cause in causes for said in _stated(cause, want, known))
    listed = got | {said.label for said in stated if said.probability > LISTED}
    worth = causes[0]["gain"] if causes else None
    return Score(
        verdict=diagnosis["verdict"],
        named=tuple(label(cause) for cause in causes),
        right=want == got,
        in_list=want <= listed,
        strayed=not got <= want,
        misplaced=any(not _placed(cause, secrets, places) for cause in causes),
        stated=stated,
        sizes=tuple(size for cause in causes for size in _sizes(cause, secrets)),
        gain=(worth["reduction"], *worth["ci95"]) if worth and worth["ci95"] else None,
        left_out_mm=(answer["joint_springs"]["validation"] or {}).get("held_out_rms_mm"),
        remainder=diagnosis["detection"]["remainder_over_scatter"],
        apart=_apart(diagnosis["next_poses"]),
        law=_law(secrets, causes, places, diagnosis["noise_floor_mm"]),
        springs=tuple(_springs(answer, truth)),
    )


UNLISTED = "unlisted_law"


def _name(cause: Json, secrets: list[Json], known: Twins) -> str:
    """A cause's label; that of the secret if the cause is its law."""
    hit = (one["label"] for one in secrets if _fits(cause, one.get("law")))
    return next(hit, same(label(cause), known))


def _placed(cause: Json, secrets: list[Json], places: set[str]) -> bool:
    laws = [one["law"] for one in secrets if one.get("law")]
    if cause["name"] == UNLISTED and laws:
        return any(cause["where"] in law["where"] for law in laws)
    return (cause.get("location") or "data") in places


def _fits(cause: Json, law: Json | None) -> bool:
    """Whether a cause is a law of the right place, kind and variable."""
    said = cause.get("law")
    if said is None or law is None or cause["where"] not in law["where"]:
        return False
    return [said["kind"], said["variable"]] in [list(pair) for pair in law["what"]]


def _law(
    secrets: list[Json], causes: list[Json], places: set[str], floor: float | None
) -> Found | None:
    """What was found of the first secret that is a law."""
    law = next((one["law"] for one in secrets if one.get("law")), None)
    if law is None:
        return None
    right = [cause for cause in causes if _fits(cause, law)]
    gain = next((cause["gain"] for cause in causes if cause["gain"]), None)
    before, after = (
        (gain["held_out_rms_before_mm"] or 0.0, gain["held_out_rms_after_mm"] or 0.0)
        if gain
        else (1.0, 1.0)
    )
    least = (floor or 0.0) ** 2
    return Found(
        named=any(cause["name"] == UNLISTED for cause in causes),
        place=bool(causes) and all(_placed(cause, secrets, places) for cause in causes),
        what=bool(right),
        order=any(
            law["order"] is None or abs(cause["law"]["order"] - law["order"]) < 0.5
            for cause in right
        ),
        halved=after <= before / 2,
        beyond=after**2 - least <= (before**2 - least) / 4,
    )


def _stated(cause: Json, want: set[str], known: Twins) -> list[Stated]:
    """A cause and its rivals, twins as one, the cause first."""
    odds: dict[str, float] = {}
    for one in (cause, *cause["rivals"]):
        name = same(label(one), known)
        odds[name] = odds.get(name, 0.0) + one["probability"]
    return [Stated(name, odd, name in want) for name, odd in odds.items()]


def _sizes(cause: Json, secrets: list[Json]) -> list[Size]:
    true = {
        name: value
        for secret in secrets
        if secret["label"] == label(cause)
        for name, value in secret["amplitudes"].items()
    }
    return [
        Size(said["name"], true[said["name"]], *said["ci95"])
        for said in cause["parameters"]
        if said["name"] in true and None not in said["ci95"]
    ]


def _springs(answer: Json, truth: Json) -> list[Size]:
    """Stiffnesses with the true ones; for a gear with two, that of the stated direction."""
    true: list[float] = truth["stiffness"]
    sides = {name: c for one in truth["secrets"] for name, c in one["amplitudes"].items()}
    rows = [row for row in answer["stiffness"] if row["identifiable"] and row["value"] is not None]
    return [
        Size(row["name"], 1 / c if c else true[row["joint"] - 1], *row["ci95"])
        for row in rows
        for c in (sides.get(f"c_joint{row['joint']}_{row.get('by_sign', {}).get('value_of')}"),)
    ]


def foretold(true: Array, stated: Array, std: Array) -> tuple[Size, ...]:
    """True displacements with the stated ones and their standard uncertainties, (k, 3) [m]."""
    half = HALF_WIDTH * std
    rows = zip(true.ravel(), (stated - half).ravel(), (stated + half).ravel(), strict=True)
    return tuple(
        Size(f"deflection.{'xyz'[k % 3]}", *map(float, row))
        for k, row in enumerate(rows)
        if np.isfinite(row[1])
    )


def _apart(proposals: list[Json]) -> float | None:
    return proposals[-1]["sigmas_after"] if proposals else None
