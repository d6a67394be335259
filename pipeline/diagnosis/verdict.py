"""The verdict: one word, and the sentence that says why."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from pipeline.diagnosis.drift import Drift
from pipeline.diagnosis.facts import Cause
from pipeline.diagnosis.identify import ROUGH, Case, Found
from pipeline.diagnosis.improvement import Gain
from pipeline.diagnosis.unloaded_geometry import Standing
from pipeline.machine.effects.tracker_drift import HOUR_S
from pipeline.system.noise import SURE, Scatter
from pipeline.system.whitened import SOFT, same_element

CERTAIN = 0.95
"""A cause less probable than this among its rivals is not named singly."""

_NOTICED = 1.15
"""What is left over the scatter of the readings, from which it is more than chance, and said."""

_UNKNOWN = 0.5
"""What has no name stands where a cause was sought if it is likelier than this."""


def judge(
    case: Case,
    spread: Scatter,
    found: Found,
    worth: Gain | None,
    causes: tuple[Cause, ...],
    stood: Standing,
    stands: tuple[Cause, ...],
) -> tuple[str, str]:
    """Verdict and sentence.

    Args:
        case: What was asked.
        spread: Scatter of the readings.
        found: What the displacements say.
        worth: What its causes are worth at left-out poses.
        causes: Its causes, and those of scatter.
        stood: What the unloaded reflectors say.
        stands: Its causes.
    """
    verdict, why = _of_displacements(found, causes, worth)
    if verdict == "explained" and found.accepted and case.force_noise > 1:
        verdict = "ambiguous"
        why = (
            "What the causes leave is scatter only if the scale scatters "
            f"{case.force_noise * case.noise:.0f} times as much as stated."
        )
    if found.first.soft_p < SOFT:
        verdict = "unexplained"
        why = "The reflectors move against each other under load: a loose nest or a soft effector."
    if verdict == "adequate" and _too_much(spread, case.data.noise_stated):
        verdict, why = "unexplained", "The residuals are larger than any certificate may be wrong."
    if stood.useless and verdict in ("adequate", "explained"):
        return "unexplained", _stands_off(stood)
    return _with_standing(verdict, why, stands, stood) if stands else (verdict, why)


def _of_displacements(
    found: Found, causes: tuple[Cause, ...], worth: Gain | None
) -> tuple[str, str]:
    """One word and one sentence."""
    if not found.detected:
        if causes:
            said = ", ".join(cause.effect.name for cause in causes)
            return "explained", f"The readings scatter more than stated ({said}); else nothing."
        return "adequate", "The joint springs explain what was measured."
    if not found.accepted:
        return "unexplained", "Something is missing from the model, and no known cause explains it."
    if worth is not None and worth.reduction <= 0:
        return "unexplained", _useless(found, worth)
    named = [cause.effect.label for cause in causes[: len(found.accepted)]]
    names, s = " and ".join(named), "s" if len(named) == 1 else ""
    stranger = found.stranger
    unnamed = stranger.probability if stranger else 0.0
    looks = found.wide.suspects[stranger.suspect].signature if stranger else ""
    if not found.explains:
        return "unexplained", _left_over(
            found, worth, names, s, looks if unnamed > _UNKNOWN else ""
        )
    if unnamed > _UNKNOWN:
        return (
            "unexplained",
            f"{names} come{s} nearest, but something that the catalogue has no name for explains "
            f"more: it looks like {looks}.",
        )
    if worth is not None and worth.ci95[0] <= 0:
        does = "does" if s else "do"
        return (
            "ambiguous",
            f"{names} fit{s}, but {does} not predict left-out poses better for certain.",
        )
    twice = _two_laws(found, causes)
    if twice:
        return (
            "ambiguous",
            f"Joint {twice} turns by a law of its own: {names} describe it only together.",
        )
    doubtful = [c for c in causes if c.twins or c.probability < CERTAIN]
    if doubtful:
        sure = [c.effect.label for c in causes[: len(found.accepted)] if c not in doubtful]
        certain = f"{_and(sure)} {'is' if len(sure) == 1 else 'are'} certain. " if sure else ""
        told = "; ".join(_or(c) for c in doubtful)
        return "ambiguous", f"{certain}The data do not decide between {told}."
    if unnamed > 1 - CERTAIN:
        return (
            "ambiguous",
            f"The data cannot tell {names} from something that the catalogue has no name for, "
            f"which looks like {looks}.",
        )
    return (
        "explained",
        f"The model with {names} fits the readings to within their scatter."
        if found.rough is None or found.rough < _NOTICED
        else f"With {names} in the model {found.rough:.1f} times the scatter of the readings is "
        "left: as much as the laws of the causes may be others.",
    )


def _and(names: Sequence[str]) -> str:
    return " and ".join(names)


def _or(cause: Cause) -> str:
    """A cause and what it could be instead, with their probabilities."""
    mine = f"{cause.effect.label} ({100 * cause.probability:.0f} %)"
    others = [f"{r.effect.label} ({100 * r.probability:.0f} %)" for r in cause.rivals[:3]]
    return " and ".join([mine, *(others or [*cause.twins, "what is like it"][:1])])


def _useless(found: Found, worth: Gain) -> str:
    """Sentence of causes that fit the readings and predict other poses worse."""
    names = " and ".join(found.seen.suspects[i].label for i in found.accepted)
    nearest = "which comes nearest" if len(found.accepted) == 1 else "which together come nearest"
    return (
        "Something is missing from the model, and no known cause explains it: adding "
        f"{names}, {nearest}, makes predictions worse (cross-validation error "
        f"{1e3 * worth.rms_before_m:.3g} mm without, {1e3 * worth.rms_after_m:.3g} mm with)."
    )


def _left_over(found: Found, worth: Gain | None, names: str, s: str, looks: str) -> str:
    """Sentence of causes that do not explain the data; `s` is the ending of their verb."""
    much = found.rough is not None and found.rough > _NOTICED
    left = (
        f"what is left is {found.rough:.1f} times the scatter of the readings"
        if much
        else "something remains"
    )
    if looks:
        return (
            f"{names} come{s} nearest, but {left}, and something that the catalogue has no name "
            f"for explains more: it looks like {looks}."
        )
    if worth is None or worth.ci95[0] <= 0:
        return f"{names} come{s} nearest, but {left}: neither place nor law is certain."
    if found.rough is not None and found.rough > ROUGH:
        return f"{names} explain{s} most, but {left}: the place is likely, the law is another."
    return f"Beside {names} something remains that no known cause explains."


def _two_laws(found: Found, causes: Sequence[Cause]) -> int | str | None:
    """The joint whose gear needs two laws of the catalogue at once: it has a third one."""
    effects = [cause.effect for cause in causes[: len(found.accepted)]]
    for one, other in combinations(effects, 2):
        if same_element(one, other):
            return one.where
    return None


def _too_much(spread: Scatter, stated: bool) -> bool:
    """With one reflector nothing tells scatter from misfit but the certificate."""
    return stated and spread.known_from == "residuals" and spread.tracker_p < SURE


def _stands_off(stood: Standing) -> str:
    """Sentence of unloaded reflectors that no known cause predicts."""
    names = " and ".join(effect.label for effect in stood.effects)
    return (
        f"The unloaded reflectors stand {1e3 * stood.miss_m:.2g} mm off where the robot's table "
        f"puts them, and {names}, nearest to it, would make the prediction of other poses worse."
    )


def _with_standing(
    verdict: str, why: str, stands: tuple[Cause, ...], stood: Standing
) -> tuple[str, str]:
    """Verdict and sentence of the displacements, with what the unloaded reflectors say."""
    names = " and ".join(cause.effect.label for cause in stands)
    said = (
        f"The unloaded reflectors stand {1e3 * stood.miss_m:.2g} mm off where the robot's table "
        f"puts them (base and tool fitted), and {1e3 * stood.left_m:.2g} mm with {names}."
    )
    sure = all(cause.probability >= CERTAIN for cause in stands)
    if verdict == "adequate":
        return ("explained" if sure else "ambiguous"), said
    return (verdict if sure or verdict != "explained" else "ambiguous"), f"{said} {why}"


def with_drift(verdict: str, why: str, drift: Drift) -> tuple[str, str]:
    """Verdict and sentence, with what the base reflectors say of the tracker."""
    turn = 1e6 * float(np.linalg.norm(drift.turn))
    unit = "urad/h" if drift.effect.parameters[0].unit == "m/s" else "urad"
    said = (
        f"The base reflectors moved as one by {1e3 * drift.moved_m:.2g} mm in {drift.hours:.2g} h: "
        f"{drift.effect.label}, turning by "
        f"{turn * (HOUR_S if unit == 'urad/h' else 1.0):.2g} {unit}."
    )
    if drift.undecided:
        said += " As they were read, a tracker that was knocked once would look the same."
    told = "ambiguous" if drift.undecided else "explained"
    if verdict == "adequate":
        return told, said
    return (told if verdict == "explained" else verdict), f"{said} {why}"
