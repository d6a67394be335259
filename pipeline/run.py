"""START HERE: the order of the stages. Tracker exports in, stiffnesses and a report out.

Every stage is a function from named tables to named tables (tables.py); this file puts them in
order and keeps every table. How a stage is carried out (plainly, or as a Prefect task) is `step`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline import handover, result, tables
from pipeline.campaign import Campaign, Raw, dump
from pipeline.cell import Tool, paper_cell
from pipeline.diagnosis.shown import apart_table, clues_table, examined_table
from pipeline.errors import InputError
from pipeline.report.render import render
from pipeline.robot import Robot
from pipeline.settings import Settings
from pipeline.stages.assemble import Measured, measured
from pipeline.stages.diagnose import diagnose
from pipeline.stages.displacements import displacements
from pipeline.stages.estimate import identify
from pipeline.stages.forces import forces
from pipeline.stages.ingest import ingest
from pipeline.stages.register import Registration, place, register
from pipeline.stages.validate import place_of_interest, validate
from pipeline.stages.variance import noise, rescaled, resting_on
from pipeline.stages.workspace import none as no_workspace
from pipeline.stages.workspace import workspace

T = TypeVar("T")
Step = Callable[[Callable[..., T]], Callable[..., T]]
Keep = Callable[[str, pd.DataFrame | pa.Table | None, pa.Schema], pd.DataFrame]
SEED = 20261103


def plain(stage: Callable[..., T]) -> Callable[..., T]:
    """Carry a stage out as it is."""
    return stage


def run(campaign: Campaign, step: Step[Any] = plain, force: bool = False) -> dict[str, Any]:
    """Bring one campaign up to date and give its result.json.

    Nothing is computed when inputs, code and libraries are those of the last finished run.
    """
    raw = step(campaign.read)()
    found = None if force else campaign.done(raw.key)  # a finished project may be read-only
    if found is not None:
        return found
    with campaign.locked() as waited:
        if waited:  # the other run may have done it, and the files may have changed since
            raw = step(campaign.read)()
            found = None if force else campaign.done(raw.key)
        return _compute(campaign, raw, step) if found is None else found


@dataclass(frozen=True, eq=False)
class Reduced:
    """A campaign's measurements, brought into F_b.

    Attributes:
        data: Pulls and displacements as arrays.
        registration: Where the tracker stands.
        placed: Table PLACED, the readings of the poses in F_b.
        shown: The tables a reader wants to see, by name.
    """

    data: Measured
    registration: Registration
    placed: pd.DataFrame
    shown: dict[str, pd.DataFrame]


def reduce(raw: Raw, keep: Keep, step: Step[Any] = plain) -> Reduced:
    """The first half: from raw files to forces and displacements in F_b."""
    settings, robot = raw.settings, raw.robot
    got = step(ingest)(settings, robot, raw.files)
    readings = keep("10_readings", got.readings, tables.READINGS)
    loads = keep("11_loads", got.loads, tables.LOADS)
    joints = keep("12_joints", got.joints, tables.joints(robot))
    rejected = keep("13_rejected", got.rejected, tables.REJECTED)

    registration = step(register)(settings, readings)
    base = keep("20_registration", registration.table, tables.REGISTRATION)
    placed = keep("21_placed", place(registration, readings), tables.PLACED)
    if settings.displacements is None:
        pulled = step(forces)(settings, placed, loads)
        moved = step(displacements)(settings, placed)
    else:
        pulled, moved = got.forces, got.displacements
    pulled = keep("22_forces", pulled, tables.FORCES)
    moved = keep("23_displacements", moved, tables.DISPLACEMENTS)

    gain = settings.scale.gain_sigma if settings.scale else 0.0
    rotation = registration.cov[:3, :3]
    names = tool(settings).targets
    off = np.where(robot.prismatic, settings.joints.sigma_m, settings.joints.sigma_rad)
    points = settings.tool_uncertainty.sigma_m
    data = measured(robot, names, joints, pulled, moved, rotation, gain, points, off)
    shown = {
        "readings": readings,
        "rejected": rejected,
        "registration": base,
        "forces": pulled,
        "displacements": moved,
    }
    return Reduced(data, registration, placed, shown)


def _compute(campaign: Campaign, raw: Raw, step: Step[Any]) -> dict[str, Any]:
    """The second half: from displacements to stiffnesses, their trustworthiness and a report."""
    began = time.perf_counter()
    keep = campaign.keep
    reduced = reduce(raw, keep, step)
    data, shown = reduced.data, reduced.shown
    cell = replace(
        paper_cell(raw.robot, tool(raw.settings)), equilibrium=raw.settings.model.equilibrium
    )

    enough(data, raw.robot)
    start = raw.robot.nominal_compliance
    system, estimate = step(identify)(cell, data, start)
    if not estimate.identifiable.any():
        raise InputError("these pulls determine no stiffness at all", "pull in more poses")
    data = data.in_metres(system.found_m)
    found = step(noise)(raw.settings, cell, reduced.placed, data, system, estimate)
    if found.used:
        data = rescaled(data, found)
        system, estimate = step(identify)(cell, data, start)
        estimate = resting_on(estimate, found)
    keep("30_system", result.system_table(system), tables.system(system.parameters))
    keep("31_errors", result.errors_table(system), tables.ERRORS)
    keep("40_estimate", result.estimate_table(estimate), tables.ESTIMATE)
    keep("41_covariance", result.covariance_table(estimate), tables.covariance(estimate.parameters))
    residuals = keep("42_residuals", result.residuals_table(system, estimate), tables.RESIDUALS)

    where = place_of_interest(raw.settings.test_pose, raw.robot, data.pulls)
    checked = step(validate)(cell, estimate, where, np.random.default_rng(SEED))
    checked = keep("60_validation", checked, tables.VALIDATION)
    soft = keep("61_workspace", step(workspace)(cell, estimate, where), tables.WORKSPACE)

    diagnosis = step(diagnose)(cell, data, estimate, where, np.random.default_rng(SEED))
    examined = examined_table(diagnosis, cell, data, system, estimate)
    examined = keep("50_examined", examined, tables.examined(raw.robot))
    clues = keep("51_diagnosis", clues_table(diagnosis), tables.DIAGNOSIS)
    separability = keep("52_separability", apart_table(diagnosis), tables.SEPARABILITY)
    causes = [cause.effect for cause in diagnosis.causes]
    richer = handover.extended(campaign.name, diagnosis.verdict, cell, causes, diagnosis.estimate)
    softer = workspace(richer.cell, richer, where) if richer else no_workspace()
    softer = keep("62_workspace_extended", softer, tables.WORKSPACE)

    answer = result.answer(
        result.Findings(
            campaign=campaign.name,
            raw=raw,
            cell=cell,
            data=data,
            registration=reduced.registration,
            system=system,
            estimate=estimate,
            noise=found,
            diagnosis=diagnosis,
            richer=richer,
            residuals=residuals,
            where=where,
            checked=checked,
            rejected=shown["rejected"],
        )
    )
    shown = shown | {
        "residuals": residuals,
        "validation": checked,
        "workspace": soft,
        "workspace_extended": softer,
        "examined": examined,
        "diagnosis": clues,
        "separability": separability,
    }
    pages = step(render)(answer, shown, time.perf_counter() - began)
    handed = handover.model(campaign.name, answer["diagnosis"]["verdict"], cell, estimate)
    campaign.finish(raw.key, {"result.json": dump(answer), **handover.files(handed), **pages})
    return answer


def enough(data: Measured, robot: Robot) -> None:
    """At least as many coordinates as stiffnesses, or there is nothing to estimate.

    Raises:
        InputError: Fewer.
    """
    if data.delta.size < robot.n:
        raise InputError(
            f"{data.delta.size} displacement coordinates for {robot.n} stiffnesses",
            "add pulls in more poses, or more reflectors",
        )


def tool(settings: Settings) -> Tool:
    """The effector of a campaign: its load point and the targets that are measured."""
    names = settings.measured
    return Tool(
        load_point=np.array(settings.tool["load_point"]),
        targets=np.array(names, dtype=object),
        points=np.array([settings.tool[name] for name in names]),
    )
