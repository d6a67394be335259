"""Stage 5b. Bad data found and named, one after the other, and the campaign without them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pipeline.faults.base_reading import base_outlier
from pipeline.faults.base_reflector import base_target
from pipeline.faults.chain import chain_outlier
from pipeline.faults.conventions import conventions
from pipeline.faults.finding import Finding
from pipeline.faults.joint_row import wrong_rows
from pipeline.faults.labels import labels
from pipeline.faults.pull import force_unit, reversed_pull
from pipeline.faults.reading import noise_scale, outlier
from pipeline.faults.scale_reading import scale_outlier
from pipeline.machine.effects import Effect
from pipeline.reduction.bring import Reduced, bring
from pipeline.reduction.case import Case
from pipeline.system.contrasts import Zeros, repeated_zeros
from pipeline.system.estimate import identify
from pipeline.system.system import Estimate, System

_MOST = 12
"""With more bad readings than this, the campaign as a whole is wrong."""


@dataclass(frozen=True, eq=False)
class Screened:
    """What is wrong with the data.

    Attributes:
        findings: Every mistake, in the order in which they were put right.
        case: The campaign with all of them put right; the given one when there are none.
    """

    findings: tuple[Finding, ...]
    case: Case


def screen(case: Case, reduced: Reduced) -> Screened:
    """Name mistakes, from those that spoil everything to those that spoil one reading.

    Args:
        case: The campaign as given.
        reduced: Its measurements.
    """
    findings: list[Finding] = []
    brought = case
    if case.settings.displacements is None:
        case = _put_right(case, wrong_rows(case), findings)
        case = _put_right(case, conventions(case), findings)
        case = _put_right(case, labels(case), findings)
    for _ in range(_MOST):
        if case is not brought:
            reduced, brought = bring(case), case
        system, estimate = identify(case.cell, reduced.data, case.robot.nominal_compliance)
        found = next(filter(None, _asked(case, reduced, system, estimate)), [])
        case = _put_right(case, found, findings)
        if not found:
            break
    return Screened(tuple(findings), case)


def acquit(
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
    case = given
    for finding in kept:
        case = finding.correct(case)
    for _ in range(len(screened.findings) - len(kept)):
        reduced = bring(case)
        cell = case.cell.with_effects(*causes)
        system, estimate = identify(cell, reduced.data, extended.value)
        found = scale_outlier(case, cell, reduced.data, system, estimate)
        if not found:
            zeros, spread = _scatter(case, reduced, system, estimate)
            found = outlier(case, reduced, zeros, system, estimate, spread)
        case = _put_right(case, found, kept)
        if not found:
            break
    return Screened(tuple(kept), case) if len(kept) < len(screened.findings) else screened


def _put_right(case: Case, found: list[Finding], findings: list[Finding]) -> Case:
    for finding in found:
        findings.append(finding)
        case = finding.correct(case)
    return case


def _asked(
    case: Case, reduced: Reduced, system: System, estimate: Estimate
) -> Iterator[list[Finding]]:
    """What is found, the cheapest tests and the grossest mistakes first."""
    if case.settings.displacements is None:
        yield scale_outlier(case, case.cell, reduced.data, system, estimate)
    yield reversed_pull(case, estimate)
    yield force_unit(case, estimate)
    if case.settings.displacements is None:
        yield chain_outlier(case)
        zeros, spread = _scatter(case, reduced, system, estimate)
        yield base_outlier(reduced.registration, spread[0])
        yield base_target(case, reduced.registration, spread[0])
        yield outlier(case, reduced, zeros, system, estimate, spread)


def _scatter(
    case: Case, reduced: Reduced, system: System, estimate: Estimate
) -> tuple[Zeros, tuple[float, int]]:
    """Repeated zeros, and how much readings scatter."""
    zeros = repeated_zeros(case.settings, reduced.placed)
    return zeros, noise_scale(system, estimate, reduced.data, zeros, case.cell)
