"""Mistakes in the data found and named, and the campaign without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from pipeline.base import doors
from pipeline.base.arrays import Array
from pipeline.faults import FAULTS
from pipeline.faults.exchanged_pulls import misfit
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake
from pipeline.faults.reading import lock_lost
from pipeline.machine.cell import Cell
from pipeline.machine.effect import Effect
from pipeline.readers.reflector_sets import CLEARLY_NEARER
from pipeline.reduction.bring import Reduced, bring
from pipeline.reduction.case import Case
from pipeline.system.family import Family
from pipeline.system.odds import DECIDES

_ENDS = "pipeline.dialects.anchored:again"
"""Door to the ends of chains without reflectors, which follow from readings, tool and log."""

_MOST = 40
"""Maximum number of rounds of screening, each of which corrects one kind of mistake."""


@dataclass(frozen=True, eq=False)
class Screened:
    """Mistakes in the data.

    Attributes:
        findings: Every mistake, in the order of their correction.
        case: The campaign with all of them corrected; the given one if there are none.
        doubted: Significant outliers that stay in use, since tails of the noise may explain them,
            which are hardly visible in a model of everything that a machine could do.
    """

    findings: tuple[Mistake, ...]
    case: Case
    doubted: tuple[Mistake, ...] = ()

    @property
    def key(self) -> tuple[tuple[str, str], ...]:
        """What was found, independent of the order."""
        return tuple(sorted((one.name, one.where) for one in self.findings))

    def without_doubt(self, files: Screened) -> Case:
        """The campaign without its mistakes, but with all readings that noise may have moved.

        Args:
            files: The campaign with its files corrected; mistakes in these are found first.
        """
        single = self.findings[len(files.findings) :]
        return _corrected_case(files.case, [one for one in single if not one.may_be_noise])


@dataclass(frozen=True, eq=False)
class ScreeningBase:
    """Model with which single readings and pulls are tested.

    Attributes:
        cell: The model.
        start: Initial values of its estimate, shape (k,).
        family: Tails of the readings as estimated with that model; by default they are estimated
            given everything that a machine could do.
        suspects: Further laws, by which those of its causes are uncertain within tolerance.
    """

    cell: Cell
    start: Array
    family: Family | None = None
    suspects: tuple[Effect, ...] = ()

    def asked(
        self, case: Case, known: Reduced | None, family: Family | None, sought: bool
    ) -> Screening:
        """A campaign tested with this model, arguments as for `Screening`."""
        return Screening(case, self.cell, self.start, known, family, sought, self.suspects)


def files_of(case: Case, reduced: Reduced) -> Screened:
    """Mistakes that affect whole files, corrected one after the other.

    Each is found beside those that are known by then; at last those are dropped without which the
    others bring the pulls nearer to one robot.

    Args:
        case: The campaign as given.
        reduced: Its measurements.
    """
    findings, given = list[list[Mistake]](), case
    for fault in _asked(case, in_files=True):
        known = None if findings else reduced
        found = fault.find(Screening(case, case.cell, case.robot.nominal_compliance, known))
        found, case = _righted(case, found)
        findings += [found] if found else []
    return _without_spoiling(given, Screened(tuple(chain.from_iterable(findings)), case), findings)


def _without_spoiling(case: Case, all_right: Screened, found: list[list[Mistake]]) -> Screened:
    """The campaign without the faults whose correction raises the misfit `CLEARLY_NEARER` times."""
    best = misfit(all_right.case) if found else np.nan
    for one in list(found):
        others = [other for other in found if other is not one]
        kept = tuple(chain.from_iterable(others))
        right = _corrected_case(case, kept)
        if (without := misfit(right)) * CLEARLY_NEARER < best:
            found, best, all_right = others, without, Screened(kept, right)
    return all_right


def files_beside(case: Case, files: Screened, base: ScreeningBase) -> Screened:
    """The campaign with only those of its file mistakes that a better model does not refute.

    They were found one by one, given the joint springs alone, and what a cause does, or many bad
    readings, may look like rows in each other's place. What was found in the pulls has to make them
    likelier by odds of more than 100, and of as many more as there were places to look for it; what
    was found elsewhere must not make them less likely by more than that, given causes. Both are
    compared from the same number of rows.

    Args:
        case: The campaign as given.
        files: Its file mistakes.
        base: Springs and causes.
    """
    richer = len(base.cell.parameters) > len(case.cell.parameters)
    for one in (one for one in files.findings if richer or one.places):
        kept = tuple(other for other in files.findings if other is not one)
        less = Screened(kept, _corrected_case(case, kept))
        (rows, loss), (as_many, without) = (
            base.asked(each.case, None, base.family, True).loss for each in (files, less)
        )
        needed = DECIDES + 2 * np.log(one.places) if one.places else -DECIDES
        if rows == as_many and without < loss + needed:
            files = less
    return files


def singles_of(
    given: Screened, reduced: Reduced | None, beside: ScreeningBase | None = None
) -> Screened:
    """Find mistakes in single readings and pulls, those with the largest effect first.

    Args:
        given: The campaign with its files corrected.
        reduced: Its measurements, if available.
        beside: Model of the tests; by default the joint springs.
    """
    case, findings = given.case, list(given.findings)
    sought = beside is not None
    beside = beside or ScreeningBase(case.cell, case.robot.nominal_compliance)
    asked = beside.asked(case, reduced, beside.family, sought)
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
        asked = beside.asked(case, None, family, sought)
    return Screened(tuple(findings), case, tuple(doubted))


def _righted(case: Case, found: list[Mistake]) -> tuple[list[Mistake], Case]:
    """The mistakes and the campaign without them, or unchanged if too little would be left."""
    right = _corrected_case(case, found)
    if not found or bring(right).data.enough(right.robot.n):
        return found, right
    return [one.lost for one in found], case


def _corrected_case(case: Case, findings: Sequence[Mistake]) -> Case:
    """The campaign with some mistakes corrected, and what follows from them."""
    for finding in findings:
        case = finding.correct(case)
    return doors.opened(_ENDS)(case) if findings and (case.anchors or case.anchors_read) else case


def _asked(case: Case, in_files: bool) -> list[Fault]:
    reads = case.settings.displacements is None
    return [one for one in FAULTS if one.in_files == in_files and (one.in_forces or reads)]


def _first(tests: Sequence[Fault], asked: Screening) -> tuple[list[Mistake], list[Mistake]]:
    """Findings of the first test that has any beyond what the tails of the noise explain.

    Returns:
        These findings, and those of the tests run so far that the tails of the noise may explain.
    """
    doubted: list[Mistake] = []
    for fault in tests:
        found = fault.find(asked)
        sure = [one for one in found if asked.sure(one)]
        doubted += [one for one in found if one not in sure]
        if sure:
            return [lock_lost(one, asked.case) for one in sure], doubted
    return [], doubted
