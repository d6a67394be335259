"""Stage 5b. Bad data found and named, and the campaign without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.base.arrays import Array
from pipeline.faults import FAULTS
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake
from pipeline.faults.reading import lock_lost
from pipeline.machine.cell import Cell
from pipeline.reduction.bring import Reduced, bring
from pipeline.reduction.case import Case
from pipeline.system.family import Family

_MOST = 40
"""Rounds of screening, each of which puts one kind of mistake right; more is no campaign."""


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

    @property
    def key(self) -> tuple[tuple[str, str], ...]:
        """What was found, whatever the order."""
        return tuple(sorted((one.name, one.where) for one in self.findings))

    def without_doubt(self, files: Screened) -> Case:
        """The campaign without its mistakes, but with all readings that noise may have moved.

        Args:
            files: It with its files put right; what is wrong with these is found first.
        """
        single = self.findings[len(files.findings) :]
        return put_right(files.case, [one for one in single if not one.may_be_noise])


@dataclass(frozen=True, eq=False)
class ScreeningBase:
    """What single readings and pulls are tested beside.

    Attributes:
        cell: The model.
        start: Where its estimate starts, shape (k,).
        family: Tails of the readings as seen beside that model; beside all that a machine could do
            when not given.
    """

    cell: Cell
    start: Array
    family: Family | None = None


def files_of(case: Case, reduced: Reduced) -> Screened:
    """Mistakes that spoil whole files, put right one after the other.

    Args:
        case: The campaign as given.
        reduced: Its measurements.
    """
    findings: list[Mistake] = []
    for fault in _asked(case, in_files=True):
        known = None if findings else reduced
        found = fault.find(Screening(case, case.cell, case.robot.nominal_compliance, known))
        found, case = _righted(case, found)
        findings += found
    return Screened(tuple(findings), case)


def screen(case: Case, reduced: Reduced, beside: ScreeningBase | None = None) -> Screened:
    """Name mistakes, from those that spoil everything to those that spoil one reading.

    Args:
        case: The campaign as given.
        reduced: Its measurements.
        beside: As for `singles_of`.
    """
    files = files_of(case, reduced)
    return singles_of(files, None if files.findings else reduced, beside)


def singles_of(
    given: Screened, reduced: Reduced | None, beside: ScreeningBase | None = None
) -> Screened:
    """Name what is wrong with single readings and pulls, those that spoil most first.

    Args:
        given: The campaign with its files put right.
        reduced: Its measurements, if they are at hand.
        beside: What they are tested beside; the joint springs when not given.
    """
    case, findings = given.case, list(given.findings)
    beside = beside or ScreeningBase(case.cell, case.robot.nominal_compliance)
    asked = Screening(case, beside.cell, beside.start, reduced, beside.family)
    family, tests, doubted = beside.family, _asked(case, in_files=False), list[Mistake]()
    for _ in range(_MOST):
        found, doubted = _first(tests, asked)
        if not found:
            break
        found, case = _righted(case, found)
        findings += found
        if any(one.hopeless for one in found):
            break
        if any(one.may_be_noise for one in found):
            family = asked.family
        asked = Screening(case, beside.cell, beside.start, accepted=family)
    return Screened(tuple(findings), case, tuple(doubted))


def _righted(case: Case, found: list[Mistake]) -> tuple[list[Mistake], Case]:
    """The same and the campaign without it, or as it is where nothing would be left of that."""
    right = put_right(case, found)
    if not found or tells(right):
        return found, right
    return [one.lost for one in found], case


def tells(case: Case) -> bool:
    """Whether a campaign has displacements enough to say anything of its robot."""
    return bring(case).data.enough(case.robot.n)


def put_right(case: Case, findings: Sequence[Mistake]) -> Case:
    """The campaign without some mistakes."""
    for finding in findings:
        case = finding.correct(case)
    return case


def _asked(case: Case, in_files: bool) -> list[Fault]:
    reads = case.settings.displacements is None
    return [one for one in FAULTS if one.in_files == in_files and (one.in_forces or reads)]


def _first(tests: Sequence[Fault], asked: Screening) -> tuple[list[Mistake], list[Mistake]]:
    """What the first test finds that finds anything beyond what such noise may do by itself.

    Returns:
        That, and what the tests that were asked found and such noise may do.
    """
    doubted: list[Mistake] = []
    for fault in tests:
        found = fault.find(asked)
        sure = [one for one in found if asked.sure(one)]
        doubted += [one for one in found if one not in sure]
        if sure:
            return [lock_lost(one, asked.case) for one in sure], doubted
    return [], doubted
