"""START HERE: the order of the stages. Tracker exports in, stiffnesses and a report out.

Every stage is a function from named tables to named tables (tables.py); this file puts them in
order and keeps every table. How a stage is carried out (plainly, or as a Prefect task) is `step`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.answer import archive, fleet
from pipeline.answer.answer import answer as answer_of
from pipeline.answer.contract import Answer, Which
from pipeline.answer.findings import Findings, Told
from pipeline.answer.pictures import pictured
from pipeline.answer.recommended import (
    Basis,
    Values,
    decide,
    identified,
    joint_springs,
    recommend,
    standing,
)
from pipeline.answer.reliability import control
from pipeline.answer.standing import stood
from pipeline.answer.tables import (
    covariance_table,
    errors_table,
    estimate_table,
    residuals_table,
    system_table,
)
from pipeline.base.errors import InputError, at
from pipeline.diagnosis.settle import settle
from pipeline.diagnosis.tables import apart_table, clues_table, examined_table
from pipeline.diagnosis.verdict import verdict
from pipeline.faults.conventions import conventions
from pipeline.machine.robot import Robot
from pipeline.prediction import handover
from pipeline.prediction.model import Model
from pipeline.prediction.tolerance import Shown, asked, judge
from pipeline.prediction.validate import none as no_validation
from pipeline.prediction.validate import validate
from pipeline.prediction.workspace import none as no_workspace
from pipeline.prediction.workspace import workspace
from pipeline.reduction.bring import Keep, Reduced, Step, bring, conformed, plain
from pipeline.reduction.case import Case
from pipeline.reduction.case import tool as tool
from pipeline.reduction.ingest import ingest
from pipeline.reduction.measured import Measured
from pipeline.reduction.pose_of_interest import Where
from pipeline.reduction.stations import one_station
from pipeline.report import workbook
from pipeline.report.render import render
from pipeline.report.wear import told
from pipeline.store.campaign import Campaign, Raw, dump
from pipeline.system.fit import fit
from pipeline.system.one_pose import as_measured

_SEED = 20261103
_LAST_RESORT = "campaign.toml"
"""Named in what rejects an input for reasons that stand in no one file."""

_CORRECTED = (("22_forces", tables.FORCES), ("23_displacements", tables.DISPLACEMENTS))
"""Tables that a mistake in the data changes, and that the answer rests on."""


def run(campaign: Campaign, step: Step = plain, force: bool = False) -> Answer:
    """Bring one campaign up to date and give its answer.

    Nothing is computed when inputs, code and libraries are those of the last finished run.
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


@at(_LAST_RESORT)
def reduce(raw: Raw, keep: Keep, step: Step = plain) -> Reduced:
    """The first half, with nothing implausible let through: to forces and displacements in F_b."""
    return bring(ingested(raw, keep, step), keep, step)


def ingested(raw: Raw, keep: Keep, step: Step, plausible: bool = True) -> Case:
    """A campaign's tables as read.

    Raises:
        InputError: A file cannot be trusted; with `plausible` also when only a wrong unit or
            convention explains its values, else when not even that does. Poses beyond the robot's
            limits are left out where no wrong unit or convention explains them.
    """
    case, doubt = as_read(raw, keep, step, plausible)
    if doubt is None:
        return case
    if not conventions(case):
        return as_read(raw, keep, step)[0]
    doubted = pd.concat([case.rejected, _doubt_row(doubt)], ignore_index=True)
    return replace(case, rejected=keep("13_rejected", doubted, tables.REJECTED))


def as_read(
    raw: Raw, keep: Keep = conformed, step: Step = plain, plausible: bool = True
) -> tuple[Case, InputError | None]:
    """What was ingested, and why its values are implausible where that was not to stop it."""
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
        displacements=got.displacements,
        forces=got.forces,
        stale=got.stale,
        unused=got.unused,
        treated=got.treated,
        torques=got.torques,
        stations=stations,
    )
    return case, got.doubt


def _doubt_row(doubt: InputError) -> pd.DataFrame:
    """A file that no value of can be right as given, as a row of REJECTED."""
    reason = f"{doubt.thing}; {doubt.way_out}"
    line = pd.array([doubt.line], dtype="Int64")
    return pd.DataFrame({"file": [doubt.file or _LAST_RESORT], "line": line, "reason": [reason]})


def _compute(campaign: Campaign, raw: Raw, step: Step) -> Answer:
    """Everything: to the answer, and a report on disk."""
    began = time.perf_counter()
    found = answered(campaign.name, raw, campaign.keep, step)
    run_time_s = time.perf_counter() - began
    before = archive.earlier(campaign, found.answer)
    answers = {
        "result.json": dump(found.answer.as_json()),
        **handover.files(found.model),
        **found.files,
        **workbook.files(found.answer, found.shown),
    }
    wear = told(found.answer, fleet.wear(campaign.root))  # as known before this campaign
    pages = step(render)(found.answer, found.shown, run_time_s, before, list(answers), wear)
    about = {
        "run_time_s": run_time_s,
        "previous": archive.mark(before),
        "wear": wear,
        "verdict": str(found.answer.diagnosis.verdict),
        **archive.about(found.answer),
    }
    campaign.finish(raw.key, answers | pages, about)
    return found.answer


@dataclass(frozen=True, eq=False)
class Answered:
    """What the files of a campaign say.

    Attributes:
        answer: What result.json holds.
        shown: The tables a reader wants to see, by name.
        model: The identified robot, for those who load it elsewhere.
        files: Further files for others, by name.
    """

    answer: Answer
    shown: dict[str, pd.DataFrame]
    model: Model
    files: dict[str, bytes] = field(default_factory=dict)


def answered(name: str, raw: Raw, keep: Keep = conformed, step: Step = plain) -> Answered:
    """To stiffnesses and what is wrong with data or model."""
    with raw.placing():
        return _answered(name, raw, keep, step)


def _answered(name: str, raw: Raw, keep: Keep, step: Step) -> Answered:
    if raw.settings.positions is not None:
        end = stood(name, raw, keep, step)
        return Answered(end.answer, end.shown, end.model, end.files)
    raw.settings.within_reach(raw.files[_LAST_RESORT].decode("utf-8", "replace"))
    case = ingested(raw, keep, step, plausible=False)
    path = asked(raw.settings.tolerance, raw.files, case.robot, case.tool)
    case, reduced, pose = step(as_measured)(case, bring(case, keep, step))
    _enough(reduced.data, raw.robot)
    given = step(fit)(case, reduced)
    held = settle(case, reduced, given, step)
    screened, right, where, diagnosis = held.screened, held.right, held.where, held.diagnosis
    given = given if screened.findings else right

    facts = replace(diagnosis.facts, mistakes=screened.findings)
    word = verdict(facts)
    row = decide(Basis.of(facts, diagnosis))
    stands = standing(right, diagnosis)
    values = recommend(row, stands, diagnosis, where)
    told = _told(values.model(name, word, row), values, where, step)
    if row.model != Which.JOINT_SPRINGS or stands is not given:
        springs = joint_springs(given)
        paper = _told(springs.model(name, word, row), springs, where, step)
    else:
        paper = told
    controls, carried = step(control)(values, where)
    shown_m = Shown(told.model.held_out_m, right.data.pulls.range_n[1])
    most_m = 1e-3 * raw.settings.tolerance.deflection_mm if raw.settings.tolerance else np.inf
    found = Findings(
        campaign=name,
        raw=raw,
        given=given,
        right=right,
        diagnosis=diagnosis,
        facts=facts,
        row=row,
        told=told,
        springs=paper,
        extended=identified(stands, diagnosis, where),
        where=where,
        control=controls,
        carried=carried,
        judged=step(judge)(told.model, where.q, where.force, shown_m, path, most_m),
        one_pose=pose,
    )
    shown = {**right.reduced.shown, "rejected": case.rejected, **_kept(found, keep, step)}
    return Answered(answer_of(found), shown, told.model)


def _told(model: Model, values: Values, where: Where, step: Step) -> Told:
    """One model's values with what they predict."""
    checked = None
    if values.found.identifiable.any():
        checked = step(validate)(values.hypotheses, where, np.random.default_rng(_SEED))
    return Told(values, model, checked)


def _kept(found: Findings, keep: Keep, step: Step) -> dict[str, pd.DataFrame]:
    """The tables of the answer, and of the joint springs beside it."""
    values, paper, where = found.told.values, found.springs.values, found.where
    system, said = values.first.system, found.diagnosis
    if found.mistakes:  # what the answer rests on stands under the usual names
        given, used = found.given.reduced.shown, found.right.reduced.shown
        for name, promise in _CORRECTED:
            part = name[3:]
            keep(f"{name}_as_given", given[part], promise)
            keep(name, used[part], promise)
    keep("30_system", system_table(system), tables.system(system.parameters))
    keep("31_errors", errors_table(system), tables.ERRORS)
    for suffix, one in (("", values), ("_joint_springs", paper)):
        names, held = one.parameters, one.found
        keep(f"40_estimate{suffix}", estimate_table(names, held), tables.ESTIMATE)
        cov = covariance_table(names, held.cov)
        keep(f"41_covariance{suffix}", cov, tables.covariance(names))
    residuals = residuals_table(system, values.first.estimate, values.left_out_m)
    cell, data = found.right.case.cell, found.right.data
    keep("44_influence", found.carried, tables.INFLUENCE)
    examined = examined_table(said, cell, data, found.right.system, found.right.estimate)
    mine, alone = found.told.model.hypotheses, found.springs.model.hypotheses
    soft = step(workspace)(mine, where)
    other = no_workspace() if found.mistakes or alone is mine else workspace(alone, where)
    checked = no_validation() if found.told.checked is None else found.told.checked
    return pictured(found, keep, step) | {
        "residuals": keep("42_residuals", residuals, tables.RESIDUALS),
        "reliability": keep("43_reliability", found.control, tables.RELIABILITY),
        "examined": keep("50_examined", examined, tables.examined(found.raw.robot)),
        "diagnosis": keep("51_diagnosis", clues_table(said), tables.DIAGNOSIS),
        "separability": keep("52_separability", apart_table(said), tables.SEPARABILITY),
        "validation": keep("60_validation", checked, tables.VALIDATION),
        "workspace": keep("61_workspace", soft, tables.WORKSPACE),
        **_path(found, keep),
        "workspace_joint_springs": keep("62_workspace_joint_springs", other, tables.WORKSPACE),
    }


def _path(found: Findings, keep: Keep) -> dict[str, pd.DataFrame]:
    """The machining path, where [tolerance] names one."""
    path = found.judged.path
    return {} if path is None else {"path": keep("63_path", path, tables.PATH)}


def _enough(data: Measured, robot: Robot) -> None:
    """One coordinate at least, and more than stiffnesses where they must tell the noise too.

    Raises:
        InputError: Fewer.
    """
    size, noise = data.delta.size, data.noise_stated or data.found_m is not None
    if size == 0 or (size <= robot.n and not noise):
        raise InputError(
            f"{size} displacement coordinates for {robot.n} stiffnesses"
            + ("" if size < robot.n else " leave none to tell the noise from"),
            "add pulls in more poses, or more reflectors"
            + ("" if noise else ", or state the noise as sigma_m"),
        )
