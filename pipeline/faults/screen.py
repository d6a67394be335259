"""Stage 5b. Bad data found and named, one after the other, and the campaign without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pipeline.faults import FAULTS
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.lost_pull import lost_readings
from pipeline.faults.mistake import Mistake
from pipeline.faults.reading import lock_lost
from pipeline.machine.effect import Effect
from pipeline.reduction.bring import Reduced, bring
from pipeline.reduction.case import Case
from pipeline.system.family import Family
from pipeline.system.fit import Fitted
from pipeline.system.linearised import Linearised, linearise
from pipeline.system.shape import tails
from pipeline.system.system import Estimate

_SURE = 0.9
"""Probability from which a reading is a blunder [1]: odds of 9 to 1, those of the stated family."""

_MOST = 12
"""With more bad readings than this, the campaign as a whole is wrong."""


@dataclass(frozen=True, eq=False)
class Screened:
    """What is wrong with the data.

    Attributes:
        findings: Every mistake, in the order in which they were put right.
        case: The campaign with all of them put right; the given one when there are none.
        doubted: Readings so far off that chance does not explain it, and that stay: tails of the
            noise may, which beside everything that a machine could do are hardly seen.
    """

    findings: tuple[Mistake, ...]
    case: Case
    doubted: tuple[Mistake, ...] = ()


def screen(case: Case, reduced: Reduced) -> Screened:
    """Name mistakes, from those that spoil everything to those that spoil one reading.

    Args:
        case: The campaign as given.
        reduced: Its measurements.
    """
    findings: list[Mistake] = []
    given, reads = case, case.settings.displacements is None
    tests = [fault for fault in FAULTS if fault.in_forces or reads]
    for fault in tests:
        if fault.in_files:
            known = reduced if case is given else None
            asked = Screening(case, case.cell, case.robot.nominal_compliance, known)
            found = fault.find(asked)
            findings += found
            case = _put_right(case, found)
    single = [fault for fault in tests if not fault.in_files]
    before: Screening | None = None
    doubted: list[Mistake] = []
    for _ in range(_MOST):
        known = reduced if case is given else None
        before = Screening(case, case.cell, case.robot.nominal_compliance, known, before)
        found, doubted = _first(single, before)
        findings += found
        case = _put_right(case, found)
        if not found:
            break
    if before is not None and before.case is case:
        lost = lost_readings(given, findings, before)
        findings, case = findings + lost, _put_right(case, lost)
    return Screened(tuple(findings), case, tuple(doubted))


def screen_again(
    given: Case, screened: Screened, causes: tuple[Effect, ...], extended: Estimate | None
) -> Screened:
    """Screen again with the causes: test flagged readings beside the extended model.

    The causes were identified without these readings. What contradicts the joint springs alone may
    follow from a cause: a reading that agrees with the extended model is used again.

    Args:
        given: The campaign as given.
        screened: What was found in it.
        causes: The causes.
        extended: Joint springs and causes, estimated together; None where there are none.

    Returns:
        `screened` itself where every flagged reading stays flagged.
    """
    kept = [finding for finding in screened.findings if not finding.beside_model]
    richer = given.cell.with_effects(*causes).parameters
    if len(kept) == len(screened.findings) or not causes or extended is None:
        return screened
    if richer != extended.parameters:  # unloaded geometry was corrected, which no cell can hold
        return screened
    case = _put_right(given, kept)
    again = [fault for fault in FAULTS if fault.beside_model]
    for _ in range(len(screened.findings) - len(kept)):
        asked = Screening(case, case.cell.with_effects(*causes), extended.value)
        found = _first(again, asked)[0]
        kept += found
        case = _put_right(case, found)
        if not found:
            break
    return (
        replace(screened, findings=tuple(kept), case=case)
        if len(kept) < len(screened.findings)
        else screened
    )


def acquit(given: Case, screened: Screened, right: Fitted, seen: Linearised) -> Screened:
    """Give back readings that the noise throws as far by itself, as seen beside the accepted model.

    Screening knows the tails beside everything that a machine could do, which leaves little to see
    them in. Here all doubted readings are back among the others, in whose tails they belong.

    Args:
        given: The campaign as given.
        screened: What was found in it.
        right: The campaign without it, for the size of the noise in use.
        seen: The same linearised at the accepted model.

    Returns:
        `screened` itself where every reading stays out.
    """
    if not right.plain.noise_stated or not any(one.may_be_noise for one in screened.findings):
        return screened
    case = _put_right(given, [one for one in screened.findings if not one.may_be_noise])
    data = right.as_noisy(bring(case).data)
    found = tails(linearise(seen.model, data, seen.suspects), seen.model.accepted)[1]
    if not found.likely_heavy:  # then no reading owes its place to the noise
        return screened
    kept = [one for one in screened.findings if not one.may_be_noise or _sure(one, found)]
    if len(kept) == len(screened.findings):
        return screened
    return replace(screened, findings=tuple(kept), case=_put_right(given, kept))


def confirm(
    screened: Screened, found: Family, causes: tuple[Effect, ...], extended: Estimate | None
) -> Screened:
    """Leave out doubted readings that are none of the noise, as seen beside the accepted model.

    The counterpart of `acquit`: far more is left there to see the noise in. Each is tested anew,
    beside the joint springs and the causes, but where the tails are heavy: then the farthest
    reading of a thousand is as far by chance.

    Args:
        screened: What was found in the campaign.
        found: Tails of the readings beside the accepted model.
        causes: The causes.
        extended: Joint springs and causes, estimated together; None where there are none.

    Returns:
        `screened` itself where every doubted reading stays.
    """
    if found.likely_heavy:
        return screened
    case, findings = screened.case, list(screened.findings)
    cell, start = case.cell, case.robot.nominal_compliance
    if causes and extended is not None:
        cell, start = cell.with_effects(*causes), extended.value
        if cell.parameters != extended.parameters:
            return screened
    tests = [fault for fault in FAULTS if not fault.in_files]
    for _ in screened.doubted:
        sure = _first(tests, Screening(case, cell, start, accepted=found))[0]
        findings += sure
        case = _put_right(case, sure)
        if not sure:
            break
    return screened if case is screened.case else Screened(tuple(findings), case)


def _put_right(case: Case, findings: Sequence[Mistake]) -> Case:
    """The campaign without some mistakes."""
    for finding in findings:
        case = finding.correct(case)
    return case


def _first(tests: Sequence[Fault], asked: Screening) -> tuple[list[Mistake], list[Mistake]]:
    """What the first test finds that finds anything beyond what such noise may do by itself.

    Returns:
        That, and what the tests that were asked found and such noise may do.
    """
    doubted: list[Mistake] = []
    for fault in tests:
        found = fault.find(asked)
        sure = [one for one in found if not one.may_be_noise or _sure(one, asked)]
        doubted += [one for one in found if one not in sure]
        if sure:
            return [lock_lost(one, asked.case) for one in sure], doubted
    return [], doubted


def _sure(one: Mistake, of: Screening | Family) -> bool:
    """Whether a reading that is off is a blunder, and not of the family that the others show."""
    return of.mistaken(one.before**2, one.axes) > _SURE
