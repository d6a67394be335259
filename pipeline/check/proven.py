"""Errors that the files prove by themselves, as `run` finds them, while the robot is still set up.

These are mistakes that spoil whole files, base reflectors that no position of the tracker makes
agree with [base_frame], single forces that contradict all other pulls, and evidence of unloaded
reflectors against the robot's table, beside a drift of the tracker. Causes and other single
readings, which only a full search can separate, are left to `run`.
"""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.answer.words import told_of
from pipeline.base.errors import PipelineError
from pipeline.base.quantities import plain
from pipeline.check.survey import distances
from pipeline.diagnosis.causes import of_motion
from pipeline.diagnosis.diagnose import between_poses, search_task
from pipeline.diagnosis.drift import motion
from pipeline.diagnosis.facts import Facts
from pipeline.diagnosis.finding import Finding
from pipeline.diagnosis.unloaded_geometry import as_stiff, from_unloaded
from pipeline.faults.base_names import not_rigid
from pipeline.faults.fault import Screening
from pipeline.faults.scale_reading import scale_outliers
from pipeline.faults.screen import files_of
from pipeline.reduction.bring import Reduced, bring
from pipeline.reduction.case import Case
from pipeline.system.fit import fit

_OF_THE_TABLE = (
    Finding.STANDS_ELSEWHERE,
    Finding.STANDS_ELSEWHERE_OR_RIVAL,
    Finding.GEOMETRY_REFUTED,
)


def proven(case: Case, reduced: Reduced) -> list[str]:
    """What is certainly wrong, in sentences.

    Args:
        case: The campaign as given.
        reduced: Its measurements.
    """
    files = files_of(case, reduced)
    selected = [one.evidence for one in files.findings]
    kept = reduced if files.case is case else None
    return [*selected, *_not_rigid(files.case), *_estimated(files.case, kept)]


def _not_rigid(case: Case) -> Iterator[str]:
    """Remark that distances between base reflectors contradict [base_frame]."""
    off_m = not_rigid(case)
    if off_m is None:
        return
    worst = max((d for d in distances(case) if d.table == "base_frame"), key=lambda d: d.off_m)
    yield (
        f"The base reflectors are {plain(1e3 * off_m, 3)} mm rms from their places in "
        f"[base_frame] wherever the tracker stands: {worst.first} to {worst.second} is "
        f"{1e3 * worst.read_m:.2f} mm as read and {1e3 * worst.stated_m:.2f} mm as stated. Compare "
        "names and coordinates with the survey; no result rests on them as they are."
    )


def _estimated(case: Case, reduced: Reduced | None) -> Iterator[str]:
    """Evidence of pulls and of unloaded reflectors against it; none if too few were read."""
    try:
        given = fit(case, reduced or bring(case))
    except PipelineError:  # `run` reports it
        return
    yield from _forces(given.case, given.reduced)
    if case.settings.positions is not None:  # the table is estimated from these
        return
    cell, data = given.case.cell, given.data
    effects, moves = motion(given)
    certain = search_task(cell, data, given.estimate)[0].certain_noise
    wander, stiff = between_poses(given.shape, moves), as_stiff(cell, given.estimate)
    stood = from_unloaded(stiff, data, certain, effects, wander, moves.grown if moves else None)
    facts = Facts(unloaded=stood, moved=of_motion(stood, moves)[0])
    yield from told_of(facts, _OF_THE_TABLE)


def _forces(case: Case, reduced: Reduced) -> Iterator[str]:
    """Forces that contradict all other pulls, unless a cause may do as much."""
    if case.loads.empty:  # of a campaign that arrives reduced no line is known
        return
    asked = Screening(case, case.cell, case.robot.nominal_compliance, reduced)
    yield from (one.evidence for one in scale_outliers(asked) if asked.sure(one))
