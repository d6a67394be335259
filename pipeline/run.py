"""START HERE: the order of the stages. Tracker exports in, stiffnesses and a report out.

Every stage is a function from named tables to named tables (tables.py); this file puts them in
order and keeps every table. `step` determines how a stage is executed (inline, or as a Prefect
task).
"""

from __future__ import annotations

import time
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.answer import archive
from pipeline.answer.answer import answer as answer_of
from pipeline.answer.contract import Answer, Which
from pipeline.answer.recommended import (
    DecisionBasis,
    decide,
    identified,
    joint_springs,
    recommend,
    springs_of_extended,
)
from pipeline.answer.results import CampaignAnswer, CampaignResults, WithPositions
from pipeline.answer.tables import kept, predicted
from pipeline.base import doors
from pipeline.base.appearance import appearances
from pipeline.base.errors import InputError
from pipeline.base.threads import alone
from pipeline.diagnosis.converge import converge
from pipeline.diagnosis.verdict import verdict
from pipeline.faults.conventions import conventions
from pipeline.faults.joint_row import contradicted
from pipeline.faults.mistake import told_once
from pipeline.machine.robot import Robot
from pipeline.prediction.tolerance import HeldOutError, judge, path_of
from pipeline.reduction.bring import Keep, Step, bring, conformed, inline
from pipeline.reduction.case import Case, FilesAsRead
from pipeline.reduction.ingest import ingest
from pipeline.reduction.measured import Measured
from pipeline.reduction.stations import one_station
from pipeline.report.render import render
from pipeline.store.campaign import CampaignFolder, Raw, dump
from pipeline.system.fit import fit
from pipeline.system.one_pose import as_measured

_FOR_OTHERS = "pipeline.exchange.files:files"
"""Door of the exports: a workbook, and the robot for simulators."""
_MODEL = "pipeline.library.model_file:dumps"
"""Door of the library: the identified model as text, which it reads again."""
_CONTROL = "pipeline.annex.reliability:control"
"""Door of the annex: how the readings check each other."""
_POSITIONS = "pipeline.positions.campaign:identify_positions"
_CONCLUDED = "pipeline.positions.campaign:conclude"
_JOINED = "pipeline.positions.both:PositionsAndPulls"
"""Doors of the positions: what they say, as an answer of their own, and beside pulls."""
_LAST_RESORT = "campaign.toml"
"""File named when input is rejected for reasons that concern no single file."""


def run(campaign: CampaignFolder, step: Step = inline, force: bool = False) -> Answer:
    """Bring one campaign up to date and return its answer.

    Nothing is computed if inputs, code and libraries are those of the last finished run.
    """
    raw = step(campaign.read)()
    # before any lock, because a finished project may be read-only
    found = None if force else archive.done(campaign, raw.key)
    if found is not None:
        return found
    with campaign.locked() as waited:
        if waited:  # the other run may have done it, and the files may have changed since
            raw = step(campaign.read)()
            found = None if force else archive.done(campaign, raw.key)
        if found is not None:
            return found
        with campaign.remembering(raw.key):
            return _compute(campaign, raw, step)


def ingested(raw: Raw, keep: Keep = conformed, step: Step = inline, plausible: bool = True) -> Case:
    """Ingest the tables of a campaign.

    Poses beyond the robot's limits that no wrong unit or convention explains are left out, and so
    are readings that contradict their rows.

    Args:
        raw: Files, settings and robot of the campaign.
        keep: Keeps each table.
        step: How a stage is executed.
        plausible: Whether implausible values are to be rejected; otherwise they are kept for the
            diagnosis of faults if a wrong unit or convention, or a contradicted row of joint
            values, explains them.

    Raises:
        InputError: A file cannot be trusted; with `plausible` also if only a wrong unit or
            convention explains its values, otherwise if not even that does.
    """
    case, doubt = ingested_with_doubt(raw, keep, step, plausible)
    if doubt is None:
        return case
    if not (contradicted(case) or conventions(case)):
        return ingested_with_doubt(raw, keep, step)[0]
    doubted = pd.concat([case.rejected, _doubt_row(doubt)], ignore_index=True)
    return replace(case, rejected=keep("13_rejected", doubted, tables.REJECTED))


def ingested_with_doubt(
    raw: Raw, keep: Keep = conformed, step: Step = inline, plausible: bool = True
) -> tuple[Case, InputError | None]:
    """The tables of a campaign, and why their values are in doubt if they are kept nevertheless."""
    got = step(ingest)(raw.settings, raw.robot, raw.files, plausible)
    raws = keep("10_readings", got.readings, tables.READINGS)
    readings, stations = one_station(raw.settings, raws)
    case = Case(
        raw.settings,
        raw.robot,
        readings=readings,
        loads=keep("11_loads", got.loads, tables.LOADS),
        joints=keep("12_joints", got.joints, tables.joints(raw.robot)),
        rejected=keep("13_rejected", got.rejected, tables.REJECTED),
        stations=stations,
        **{one.name: getattr(got, one.name) for one in fields(FilesAsRead)},
    )
    return case, got.doubt


def _doubt_row(doubt: InputError) -> pd.DataFrame:
    """Row of REJECTED for a file whose values cannot be right as given."""
    reason = f"{doubt.thing}; {doubt.way_out}"
    line = pd.array([doubt.line], dtype="Int64")
    return pd.DataFrame({"file": [doubt.file or _LAST_RESORT], "line": line, "reason": [reason]})


def _compute(campaign: CampaignFolder, raw: Raw, step: Step) -> Answer:
    """Run all stages: to the answer, and a report on disk."""
    began, dress = time.perf_counter(), appearances(campaign.root)
    found = campaign_answer(campaign.name, raw, campaign.keep, step)
    run_time_s = time.perf_counter() - began
    for_others, model_text = doors.found(_FOR_OTHERS), doors.found(_MODEL)
    answers = {
        "result.json": dump(found.answer.as_json()),
        **({"model.toml": model_text(found.model).encode()} if model_text else {}),
        **found.files,
        **(for_others(found.answer, found.shown, found.model) if for_others else {}),
    }
    others = archive.among(campaign, found.answer)  # as known before this campaign
    entries = {"language": raw.settings.language, "fields": raw.settings.fields}
    look = dress(entries, found.answer)
    pages = step(render)(
        found.answer, found.shown, run_time_s, others.previous, list(answers), others.wear, look
    )
    about = {
        **entries,
        "look": look.key,
        "run_time_s": run_time_s,
        "verdict": str(found.answer.diagnosis.verdict),
        **others.kept,
    }
    campaign.finish(raw.key, answers | pages, about)
    return found.answer


def campaign_answer(
    name: str, raw: Raw, keep: Keep = conformed, step: Step = inline
) -> CampaignAnswer:
    """Run the stages up to stiffnesses, and what is wrong with data or model."""
    with raw.placing(), alone():
        if raw.settings.positions is None:
            return _of_pulls(name, raw, None, keep, step)
        read = doors.opened(_POSITIONS)(name, raw, keep, step)
        if not raw.settings.of_positions:
            return _of_pulls(name, raw, read, keep, step)
        concluded: CampaignAnswer = doors.opened(_CONCLUDED)(read, keep, step)
        return concluded


def _of_pulls(name: str, raw: Raw, read: Any | None, keep: Keep, step: Step) -> CampaignAnswer:
    """Answer of a campaign of pulls, combined with what its positions say if there are any."""
    case, both = _joined(raw, read, keep, step)
    path = path_of(raw.settings.tolerance, raw.files, case.robot, case.tool)
    case, reduced, pose = step(as_measured)(case, bring(case, keep, step))
    _enough(reduced.data, raw.robot)
    given = step(fit)(case, reduced)
    end = converge(case, reduced, given, step)
    screened, right, test_pose, diagnosis = end.screened, end.right, end.where, end.diagnosis
    given = given if screened.findings else right

    stated = raw.files["campaign.toml"].decode("utf-8", "replace")
    facts = replace(diagnosis.facts, mistakes=told_once(screened.findings, stated))
    springs = springs_of_extended(right, diagnosis)
    if both is not None:
        both = both.beside(springs, diagnosis)
        facts = both.facts(facts)
    word = verdict(facts)
    row = decide(DecisionBasis.of(facts, diagnosis))
    values = of_pulls = recommend(row, springs, diagnosis, test_pose)
    if both is not None and both.agrees:
        values = both.recommended(of_pulls, step)
    reported = predicted(values.model(name, word, row), values, test_pose, step)
    springs_only, delivered = reported, given if both is None else both.given(step)
    if row.model != Which.JOINT_SPRINGS or springs is not delivered:
        unextended = joint_springs(delivered)
        springs_only = predicted(unextended.model(name, word, row), unextended, test_pose, step)
    control = doors.found(_CONTROL)
    holds = row.reason.holds_for_its_readings
    held_out = HeldOutError(reported.model.held_out_m, right.data.pulls.range_n[1], holds)
    found = CampaignResults(
        campaign=name,
        raw=raw,
        given=given,
        right=right,
        diagnosis=diagnosis,
        facts=facts,
        row=row,
        told=reported,
        springs=springs_only,
        extended=identified(springs, diagnosis, test_pose),
        where=test_pose,
        control=step(control)(of_pulls, test_pose) if control else None,
        judged=step(judge)(
            reported.model, test_pose.q, test_pose.force, held_out, path, _most_m(raw)
        ),
        one_pose=pose,
    )
    shown = {**right.reduced.shown, "rejected": case.rejected, **kept(found, keep, step)}
    if both is None:
        return CampaignAnswer(answer_of(found), shown, reported.model)
    shown |= both.shown(shown, keep)
    model = reported.model
    return CampaignAnswer(both.answer(found, answer_of(found)), shown, model, both.files(model))


def _joined(
    raw: Raw, read: Any | None, keep: Keep, step: Step
) -> tuple[Case, WithPositions | None]:
    """Tables of the pulls, and their combination with positions if there are any."""
    raw.settings.within_reach(raw.files[_LAST_RESORT].decode("utf-8", "replace"))
    case = ingested(raw, keep, step, plausible=False)
    if read is None:
        return case, None
    both: WithPositions = doors.opened(_JOINED).of(case, read, step)
    return both.case, both


def _most_m(raw: Raw) -> float:
    """The tolerance [m]; infinite if none is given."""
    asked_mm = np.inf if raw.settings.tolerance is None else raw.settings.tolerance.deflection_mm
    return 1e-3 * asked_mm


def _enough(data: Measured, robot: Robot) -> None:
    """Check that there are enough measurements, as in `Measured.enough`.

    Raises:
        InputError: There are fewer.
    """
    size, noise = data.delta.size, data.tells_noise
    if not data.enough(robot.n):
        raise InputError(
            f"{size} displacement coordinates for {robot.n} stiffnesses"
            + ("" if size < robot.n else " leave none to estimate the noise from"),
            "add pulls in more poses, or more reflectors"
            + ("" if noise else ", or state the noise as sigma_m"),
        )
