"""What leaves the pipeline: result.json as the campaign contract words it."""

from __future__ import annotations

from typing import Any

from pipeline.answer.contract import Answer
from pipeline.answer.diagnosis import diagnosis_entry, noise_entry
from pipeline.answer.findings import Findings, Told
from pipeline.answer.fit import fit_entry
from pipeline.answer.inputs import (
    assumptions,
    measured_on,
    registration_entry,
    registration_findings,
    rejected_entries,
)
from pipeline.answer.prediction import deflection_entries, validation_entry
from pipeline.answer.recommended import Values
from pipeline.answer.sentences import sentences
from pipeline.answer.stiffness import budget_entries, stiffness_entries
from pipeline.answer.words import because
from pipeline.base import files
from pipeline.machine.effects import Observation, catalogue
from pipeline.reduction.pose_of_interest import Where
from pipeline.store.campaign import versions


def answer(found: Findings) -> dict[str, Any]:
    """result.json of a campaign."""
    given, raw, where = found.given, found.raw, found.where
    drifts = any(
        isinstance(cause.effect, Observation) and cause.effect.instrument
        for cause in found.diagnosis.causes
    )
    registration = given.reduced.registration
    row, values = found.row, _values_entry(found.told, where)
    stiffness = values["stiffness"]
    said = {
        "format": 1,
        "campaign": found.campaign,
        "name": raw.settings.name,
        "robot": raw.settings.robot,
        "measured": measured_on(raw.settings, given.reduced.shown["readings"]),
        "verdict_sentence": [],
        "recommended": {
            "model": row.model,
            "data": row.data,
            "reason": row.reason,
            "why": because(row.reason),
            "hypotheses": _hypothesis_entries(found.told.values),
        },
        **values,
        "diagnosis": diagnosis_entry(found),
        "joint_springs": _values_entry(found.springs, where),
        "extended": _extended_entry(found),
        "budget": budget_entries(stiffness),
        "noise": noise_entry(found.right.noise, found.right.estimate),
        "rejected": rejected_entries(given.case.rejected),
        "findings": registration_findings(registration, drifts),
        "registration": registration_entry(registration),
        "model": {"equilibrium": found.told.values.first.cell.equilibrium},
        "assumptions": assumptions(raw, where),
        "inputs": [
            {"file": name, "sha256": files.sha256(content), "bytes": len(content)}
            for name, content in sorted(raw.files.items())
        ],
        "versions": versions(),
    }
    said["findings"] += [entry["finding"] for entry in stiffness if entry["finding"]]
    said |= {"verdict_sentence": sentences(found, said)}
    Answer.model_validate(said)
    return said


def _values_entry(told: Told, where: Where) -> dict[str, Any]:
    """Stiffnesses, fit, validation and deflection at the test pose of one model."""
    values = told.values
    fitted = values.fitted
    left = values.left_out_m
    return {
        "stiffness": stiffness_entries(fitted.case.cell, values.hypotheses),
        "fit": fit_entry(fitted.case.cell, fitted.data, values.first.estimate),
        "validation": (
            None if told.checked is None else validation_entry(told.checked, left, where)
        ),
        "test_pose_deflection": deflection_entries(told.model, where),
    }


def _hypothesis_entries(values: Values) -> list[dict[str, Any]]:
    """What the values are averaged over, with the weight of each."""
    known = {effect.label for effect in catalogue(values.fitted.case.robot)}
    return [
        {
            "weight": one.weight,
            "causes": [
                {
                    "name": e.name,
                    "where": e.where,
                    "form": e.form or None,
                    "in_catalogue": e.label in known,
                }
                for e in one.effects
            ],
        }
        for one in values.hypotheses
    ]


def _extended_entry(found: Findings) -> dict[str, Any] | None:
    """`extended`: the identified causes' own fit; None without causes."""
    own = found.extended
    if own is None:
        return None
    fitted = own.fitted
    model = own.model(found.campaign, found.verdict, found.row)
    return {
        "stiffness": stiffness_entries(fitted.case.cell, own.hypotheses),
        "fit": fit_entry(fitted.case.cell, fitted.data, own.first.estimate),
        "test_pose_deflection": deflection_entries(model, found.where),
    }
