"""Judge: which results of a spoilt campaign are allowed."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from functools import cache

from bench.fuzz.bases import base
from bench.fuzz.catalogue import Case
from bench.fuzz.play import ANSWER, SCREENED, Played, Reported, play

GOOD = ("same", "said", "meant", "rejected", "misled")
"""Same answer; different answer with a warning; different answer, as it should be; rejection;
different answer with a warning that states that the values hold: not counted as failure, but
undesirable."""

BAD = ("exit 1", "not finite", "silent", "sentence", "unreadable", "hang", "memory", "killed")
"""Exception; number that is not finite; different answer without warning; unhelpful rejection;
output that no reader accepts; time-out; out of memory; process died."""

SIGMAS = 5.0
"""Change of a stiffness in combined standard uncertainties from which it counts as changed [1]."""

LOUD_P = 1e-6
"""Misfit probability below which a report cannot be silent, so that diagnosis is not needed [1]."""

GAIN = 1.5
"""Common factor on all forces up to which it is undetectable [1]: blind spot scale_gain."""

_DIRECTIONS = "\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
"""Invisible characters that change the direction of text."""

LONGEST = 1000
"""Maximum number of characters of a sentence."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case.

    Attributes:
        word: One of `GOOD` or `BAD`.
        why: Reason.
    """

    word: str
    why: str = ""


@cache
def clean(name: str, to: str = SCREENED) -> Reported:
    """Result of the pipeline for a clean campaign, up to a given stage.

    Raises:
        AssertionError: It reports something, so that the campaign cannot serve as reference.
    """
    played = play(base(name), to, lambda reported: False)
    if played.refused or played.error or played.reported.verdict not in ("", "adequate"):
        raise AssertionError(f"{name} is no clean campaign: {played}")
    return played.reported


def suspicious(case: Case, seen: Reported) -> bool:
    """Whether the diagnosis is needed: stiffnesses have changed without any warning so far."""
    before = clean(case.base)
    if case.meant or seen.words - before.words or seen.rejected > before.rejected:
        return False
    if seen.p_value is not None and seen.p_value < LOUD_P:
        return False
    return bool(_moved(case, before, seen))


def judge(case: Case, played: Played) -> Outcome:
    """Judge the result of a case."""
    if played.error:
        return Outcome("exit 1", f"{played.error.splitlines()[0][:200]} at {played.where}")
    if played.refused:
        wrong = _sentence(case, played)
        return Outcome("sentence", wrong) if wrong else Outcome("rejected")
    if odd := [*played.not_finite, *played.reported.not_finite]:
        return Outcome("not finite", ", ".join(list(dict.fromkeys(odd))[:6]))
    if played.unreadable:
        return Outcome("unreadable", "; ".join(played.unreadable))
    reported = played.reported
    before = clean(case.base, ANSWER if reported.verdict else SCREENED)
    moved = _moved(case, before, reported)
    if case.meant:
        return Outcome("meant" if moved else "same")
    told = reported.factor and _factor(before, reported) is not None
    if moved and reported.rejected == before.rejected and _stands(reported) and not told:
        return Outcome("misled", f"{reported.verdict}, {reported.reason}, {moved}")
    if new := reported.words - before.words:
        return Outcome("said", "; ".join(sorted(new))[:200])
    if reported.rejected > before.rejected:
        return Outcome("said", f"{reported.rejected - before.rejected} rows rejected")
    if moved and not reported.verdict:
        return Outcome("said", f"p {reported.p_value}")
    if moved and case.covered & reported.blind:
        return Outcome("said", f"blind spot {', '.join(sorted(case.covered & reported.blind))}")
    return Outcome("silent", moved) if moved else Outcome("same")


def _stands(reported: Reported) -> bool:
    """Whether something was reported although the values are stated to hold."""
    return reported.verdict not in ("", "adequate") and not reported.reason.endswith("unexplained")


def _moved(case: Case, before: Reported, after: Reported) -> str:
    """The stiffness that has changed most, in words; empty if none has."""
    if len(before.compliance) != len(after.compliance):
        return f"{len(after.compliance)} joints"
    rows = zip(before.compliance, before.std, after.compliance, after.std, strict=True)
    known = [
        (abs(new - old) / (s_old**2 + s_new**2) ** 0.5, k, old, new)
        for k, (old, s_old, new, s_new) in enumerate(rows, 1)
        if None not in (old, s_old, new, s_new) and (s_old or s_new)
    ]
    most = max(known, default=None)
    if most is None or most[0] <= SIGMAS or _one_factor(before, after):
        return ""
    return f"compliance {most[1]} from {most[2]:.4g} to {most[3]:.4g}, {most[0]:.0f} sigma"


def _one_factor(before: Reported, after: Reported) -> bool:
    """Whether all changes are one undetectable factor on all forces.

    Up to `GAIN` always, and any factor if the robot file states no stiffness for comparison;
    scale_gain is then among the blind spots.
    """
    factor = _factor(before, after)
    return factor is not None and (1 / GAIN < factor < GAIN or not after.nominal)


def _factor(before: Reported, after: Reported) -> float | None:
    """The factor by which all compliances have changed; None if they have not changed alike."""
    pairs = [
        (new / old, ((s_old / old) ** 2 + (s_new / new) ** 2) ** 0.5)
        for old, s_old, new, s_new in zip(
            before.compliance, before.std, after.compliance, after.std, strict=True
        )
        if old and new and s_old is not None and s_new is not None
    ]
    if not pairs or min(ratio for ratio, _ in pairs) <= 0:
        return None
    weights = [1 / max(std, 1e-9) ** 2 for _, std in pairs]
    factor = sum(w * r for w, (r, _) in zip(weights, pairs, strict=True)) / sum(weights)
    alike = all(abs(ratio / factor - 1) < SIGMAS * std + 1e-3 for ratio, std in pairs)
    return factor if alike else None


def _sentence(case: Case, played: Played) -> str:
    """Defect of the sentence of a rejection; empty if there is none."""
    reported = played.refused
    if played.exit_code == 1:
        return f"exit code 1: {reported[:150]}"
    odd = [c for c in reported if unicodedata.category(c) in ("Cc", "Cs") or c in _DIRECTIONS]
    if re.search(r"[\n\r\u2028\u2029\x85]", reported):
        return f"several lines, {played.where}"
    if odd:
        return f"control character {odd[0]!a}, {played.where}"
    if len(reported) > LONGEST:
        return f"{len(reported)} letters, {played.where}"
    if not played.way_out:
        return f"no way out: {reported[:150]}"
    names = {*case.files, "campaign.toml"}
    named = played.file in names or any(name in reported for name in names)
    return "" if named or played.file else f"names no file: {reported[:150]}"
