"""What leaves the pipeline: the answer to a campaign, whose dump is result.json."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from pipeline.answer import contract
from pipeline.answer.conformity import pose_entry, tolerance_entry
from pipeline.answer.contract import Answer
from pipeline.answer.diagnosis import best_pose, diagnosis_entry, noise_entry, placed
from pipeline.answer.inputs import (
    assumptions,
    identity_entry,
    left_out_entries,
    measured_on,
    of_campaign,
    payload_entries,
    registration_entry,
    rejected_entries,
)
from pipeline.answer.pose_budget import pose_budget
from pipeline.answer.recommended import ModelValues
from pipeline.answer.results import AgainstStated, CampaignResults
from pipeline.answer.sentences import FirstScreen, first_screen, joint_to_pull
from pipeline.answer.stiffness import (
    budget_entries,
    combination_entries,
    stiffness_entries,
)
from pipeline.answer.values import stated, values_entry, with_positions
from pipeline.answer.words import BECAUSE
from pipeline.base import doors
from pipeline.machine.effects import catalogue
from pipeline.reduction.days import days
from pipeline.reduction.register import timed

_AGAINST = "pipeline.check.contradictions:against_stated"
_FINDINGS = "pipeline.check.findings:findings"
"""Doors of the check: what contradicts what was stated, and what else is odd about the files."""

_TABLE = "pipeline.positions.table_entries:estimated"
"""Door of the positions: the robot's table as unloaded reflectors show it."""


def answer(found: CampaignResults) -> Answer:
    """The answer to a campaign."""
    given, raw, where = found.given, found.raw, found.where
    values, springs = values_entry(found.told, where), values_entry(found.springs, where)
    stood = found.diagnosis.facts.unloaded
    values, table = with_positions(values, stood), doors.found(_TABLE)
    letters, mixed = table(stood) if table else ((), ())
    against, findings = doors.found(_AGAINST), doors.found(_FINDINGS)
    against_stated = against(found, values.stiffness) if against else AgainstStated()
    together = combination_entries(found.told.values)
    diagnosis = diagnosis_entry(found)
    best = best_pose(found.diagnosis, raw.robot, joint_to_pull(found, diagnosis, values.stiffness))
    diagnosis = diagnosis.model_copy(update={"best_pose": best})
    parts = pose_budget(found.told.values, found.told.model, where.q, where.force, found.judged.at)
    pose = pose_entry(raw.robot, where, found.judged).model_copy(update={"budget": parts})
    tolerance = tolerance_entry(raw.settings.tolerance, where, found.judged)
    effective = _effective(found)
    told_first = FirstScreen(
        *(values, springs, effective or springs.stiffness, together, diagnosis, pose, tolerance),
        against_stated.sentences,
    )
    lines = first_screen(found, told_first)
    whole = Answer(
        **of_campaign(found.campaign, raw, given.case.settings, lines),
        measured=measured_on(raw.settings, given.reduced.shown["readings"]),
        recommended=_recommended(found),
        **dict(values),
        combinations=together,
        test_pose=pose,
        tolerance=tolerance,
        identity=_identity(found),
        day_to_day=_day_to_day(found),
        diagnosis=diagnosis,
        joint_springs=springs,
        effective=effective,
        extended=_extended_entry(found),
        budget=budget_entries(values.stiffness),
        noise=noise_entry(found.right),
        rejected=(
            *rejected_entries(given.case.rejected),
            *left_out_entries(given.case, found.right.case, found.mistakes),
        ),
        set_aside=tuple(contract.SetAside(**asdict(one)) for one in given.case.aside),
        findings=(),
        registration=registration_entry(found.right.reduced.registration),
        reliability=found.control.least if found.control else (),
        influence=found.control.most if found.control else (),
        payloads=payload_entries(given.case),
        overload=against_stated.overload,
        geometry=letters,
        geometry_combinations=mixed,
        common_factor=against_stated.factor,
        model=contract.Forward(
            equilibrium=contract.Equilibrium(found.told.values.first.cell.equilibrium),
            priors=tuple(sorted(raw.settings.priors)),
        ),
        assumptions=tuple(assumptions(raw, where, timed(given.case.readings))),
    )
    if findings is None:
        return whole
    said = tuple(findings(found, whole, against_stated.sentences))
    return whole.model_copy(update={"findings": said})


def _effective(found: CampaignResults) -> tuple[contract.Stiffness, ...]:
    """Joint springs from the corrected data; empty without mistakes."""
    if not found.mistakes:
        return ()
    return stiffness_entries(found.right.case.cell, found.effective.hypotheses)


def _recommended(found: CampaignResults) -> contract.Recommended:
    """Which values hold, and why."""
    corrects = found.diagnosis.facts.unloaded.corrects
    return contract.Recommended(
        model=found.row.model,
        data=found.row.data,
        table=contract.TableSource.ESTIMATED if corrects else contract.TableSource.AS_DELIVERED,
        reason=found.row.reason,
        why=BECAUSE[found.row.reason],
        hypotheses=_hypothesis_entries(found.told.values),
    )


def _identity(found: CampaignResults) -> contract.Identity:
    """What the report is filed by."""
    readings, data = found.given.reduced.shown["readings"], found.right.data
    pulled = np.union1d(data.pulls.pose, found.given.case.loads["pose"].dropna())
    alone = 0 if data.idle is None else len(np.setdiff1d(data.idle.pulls.pose, pulled))
    return identity_entry(
        found.raw.settings, readings["time"], data.pulls.pose, data.pulls.force, alone
    )


def _day_to_day(found: CampaignResults) -> contract.DayToDay | None:
    """None where no pose was repeated on another day."""
    seen = days(found.right.plain)
    if seen is None:
        return None
    return contract.DayToDay(poses=seen.poses, relative_std=seen.relative, p_value=seen.p_value)


def _hypothesis_entries(values: ModelValues) -> tuple[contract.Weighed, ...]:
    """What the values are averaged over, with the weight of each."""
    known = {effect.label for effect in catalogue(values.fitted.case.robot)}
    return tuple(
        contract.Weighed(
            weight=one.weight,
            causes=tuple(
                contract.Believed(**placed(effect), in_catalogue=effect.label in known)
                for effect in one.effects
            ),
        )
        for one in values.hypotheses
    )


def _extended_entry(found: CampaignResults) -> contract.Extended | None:
    """`extended`: the identified causes' own fit; None without causes."""
    own = found.extended
    if own is None:
        return None
    model = own.model(found.campaign, found.verdict, found.row)
    return contract.Extended(**stated(own, model, found.where))
