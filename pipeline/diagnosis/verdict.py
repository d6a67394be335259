"""The verdict: one table of findings; the most severe of those that hold decides.

Each subject (data, base reflectors, unloaded reflectors, displacements, bounds, agreement of pulls
and positions) contributes at most one finding, that of its first row whose condition holds.
Sentences are made elsewhere, from findings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

from pipeline.diagnosis.facts import Facts, FoundCause
from pipeline.diagnosis.finding import Finding, Verdict
from pipeline.machine.effect import same_element
from pipeline.system import alarms

CERTAIN = 0.95
"""Minimum probability of a cause among its rivals to be identified [1]: the odds of 19 to 1 that
correspond to a 95 % interval."""

_UNKNOWN = 0.5
"""Probability of something outside the catalogue above which it replaces a cause [1]."""


@dataclass(frozen=True)
class VerdictRow:
    """One row of the table.

    Attributes:
        finding: The finding.
        verdict: Its verdict, unless something more severe was found.
        holds: Condition.
    """

    finding: Finding
    verdict: Verdict
    holds: Callable[[Facts], bool]


def _outside(facts: Facts) -> float:
    return facts.outside.probability if facts.outside else 0.0


def outside_likelier(facts: Facts) -> bool:
    """Whether something outside the catalogue is likelier than a cause in its place."""
    return _outside(facts) > _UNKNOWN


def _worse(facts: Facts) -> bool:
    return facts.gain is not None and facts.gain.reduction <= 0


def _gain_uncertain(facts: Facts) -> bool:
    unproven = any(one.unproven > 0 for one in facts.causes)
    return unproven or (facts.gain is not None and facts.gain.ci95[0] <= 0)


def certain(cause: FoundCause) -> bool:
    """Whether a cause is identified rather than one of several that fit equally well."""
    return not cause.twins and cause.probability * cause.of_one_driver >= CERTAIN


def two_laws(facts: Facts) -> int | str | None:
    """The joint whose gear seems to follow two laws of the catalogue, hence really a third one."""
    for one, other in combinations([cause.effect for cause in facts.causes], 2):
        if same_element(one, other):
            return one.where
    return None


_DATA = (VerdictRow(Finding.MISTAKE, Verdict.BAD_DATA, lambda f: bool(f.mistakes)),)

_BASE = (
    VerdictRow(
        Finding.TRACKER_MOVED_OR_KNOCKED,
        Verdict.AMBIGUOUS,
        lambda f: f.drift is not None and f.drift.undecided,
    ),
    VerdictRow(
        Finding.TRACKER_KNOCKED,
        Verdict.AMBIGUOUS,
        lambda f: f.base is not None and f.base.knocked is not None,
    ),
    VerdictRow(Finding.TRACKER_MOVED, Verdict.EXPLAINED, lambda f: f.drift is not None),
    VerdictRow(
        Finding.BASE_GREW,
        Verdict.EXPLAINED,
        lambda f: f.base is not None and f.base.grown is not None,
    ),
)

_UNLOADED = (
    VerdictRow(
        Finding.STANDS_UNEXPLAINED,
        Verdict.UNEXPLAINED,
        lambda f: f.unloaded.unexplained and f.agreement is None and not f.unloaded.refuted,
    ),
    VerdictRow(
        Finding.STANDS_ELSEWHERE_OR_RIVAL,
        Verdict.AMBIGUOUS,
        lambda f: any(one.probability < CERTAIN for one in f.moved),
    ),
    VerdictRow(Finding.STANDS_ELSEWHERE, Verdict.EXPLAINED, lambda f: bool(f.moved)),
    VerdictRow(
        Finding.TABLES_DISAGREE,
        Verdict.UNEXPLAINED,
        lambda f: f.agreement is not None and f.agreement.table_p < alarms.GEOMETRY,
    ),
    VerdictRow(
        Finding.ROUGH_TABLE,
        Verdict.ADEQUATE,
        lambda f: f.unloaded.corrects and f.agreement is None,
    ),
)

_DISPLACEMENTS = (
    VerdictRow(Finding.GEOMETRY_REFUTED, Verdict.UNEXPLAINED, lambda f: f.unloaded.refuted),
    VerdictRow(Finding.REFLECTORS_LOOSE, Verdict.UNEXPLAINED, lambda f: f.loose_p < alarms.LOOSE),
    VerdictRow(Finding.NO_CAUSE_FITS, Verdict.UNEXPLAINED, lambda f: f.detected and not f.causes),
    VerdictRow(Finding.PREDICTS_WORSE, Verdict.UNEXPLAINED, lambda f: f.detected and _worse(f)),
    VerdictRow(Finding.UNCONFIRMED, Verdict.UNEXPLAINED, lambda f: f.detected and not f.helps),
    VerdictRow(Finding.REMAINDER, Verdict.UNEXPLAINED, lambda f: f.detected and not f.explains),
    VerdictRow(
        Finding.OUTSIDE_CATALOGUE,
        Verdict.UNEXPLAINED,
        lambda f: f.detected and outside_likelier(f),
    ),
    VerdictRow(
        Finding.GAIN_UNCERTAIN, Verdict.AMBIGUOUS, lambda f: f.detected and _gain_uncertain(f)
    ),
    VerdictRow(Finding.TWO_LAWS, Verdict.AMBIGUOUS, lambda f: two_laws(f) is not None),
    VerdictRow(Finding.RIVALS, Verdict.AMBIGUOUS, lambda f: not all(map(certain, f.causes))),
    VerdictRow(
        Finding.OUTSIDE_CATALOGUE_POSSIBLE,
        Verdict.AMBIGUOUS,
        lambda f: f.detected and _outside(f) > 1 - CERTAIN,
    ),
    VerdictRow(
        Finding.SCALE_SCATTERS, Verdict.AMBIGUOUS, lambda f: bool(f.causes) and f.scale_ratio > 1
    ),
    VerdictRow(
        Finding.BEYOND_CERTIFICATE,
        Verdict.UNEXPLAINED,
        lambda f: not f.detected and not f.scatter and f.beyond_certificate,
    ),
    VerdictRow(
        Finding.OFF_THE_TABLE,
        Verdict.UNEXPLAINED,
        lambda f: f.unloaded.useless and (f.drift is None or not f.unloaded.since),
    ),
    VerdictRow(Finding.MISFIT, Verdict.UNEXPLAINED, lambda f: f.misfit_p < alarms.MISFIT),
    VerdictRow(Finding.CAUSE_IDENTIFIED, Verdict.EXPLAINED, lambda f: f.detected),
    VerdictRow(Finding.SCATTER, Verdict.EXPLAINED, lambda f: bool(f.scatter)),
    VerdictRow(
        Finding.BEYOND_A_TRACKER,
        Verdict.UNEXPLAINED,
        lambda f: f.beyond_a_tracker and not f.moved and f.drift is None,
    ),
    VerdictRow(Finding.NOTHING, Verdict.ADEQUATE, lambda _: True),
)

_BOUNDS = (
    VerdictRow(Finding.NOTHING_DETERMINED, Verdict.UNEXPLAINED, lambda f: not f.bounds.determined),
    VerdictRow(Finding.PREDICTS_NOTHING, Verdict.UNEXPLAINED, lambda f: not f.bounds.predicts),
    VerdictRow(Finding.BEYOND_NOISE, Verdict.UNEXPLAINED, lambda f: f.bounds.faulty),
    VerdictRow(Finding.SCATTERED, Verdict.UNEXPLAINED, lambda f: f.bounds.scattered),
)
"""Bounds that a sound campaign must keep whatever causes were found: a model that predicts, and a
possible noise."""

_TOGETHER = (
    VerdictRow(
        Finding.SPRINGS_DISAGREE,
        Verdict.UNEXPLAINED,
        lambda f: f.agreement is not None and f.agreement.p < alarms.MISFIT,
    ),
)

TABLE = (_DATA, _BASE, _UNLOADED, _DISPLACEMENTS, _BOUNDS, _TOGETHER)
"""Rows by subject, in the order in which their sentences are read."""


def findings(facts: Facts) -> tuple[VerdictRow, ...]:
    """The first row of each subject that holds; for the displacements there is always one."""
    first = (next((row for row in rows if row.holds(facts)), None) for rows in TABLE)
    return tuple(row for row in first if row is not None)


def of_both(facts: Facts) -> tuple[VerdictRow, ...]:
    """The findings, and those of absolute positions in the same campaign."""
    beside = () if facts.positions is None else findings(facts.positions)
    return tuple(dict.fromkeys((*findings(facts), *beside)))


def verdict(facts: Facts) -> Verdict:
    """The most severe verdict of all findings."""
    return max((row.verdict for row in of_both(facts)), key=lambda one: one.severity)
