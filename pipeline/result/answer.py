"""What leaves the pipeline: result.json as the campaign contract words it."""

from __future__ import annotations

from typing import Any

from pipeline import files
from pipeline.campaign import versions
from pipeline.result.diagnosis import diagnosis_entry, noise_entry
from pipeline.result.findings import Findings
from pipeline.result.fit import fit_entry, fits, larger_scatter
from pipeline.result.inputs import (
    assumptions,
    measured_on,
    registration_entry,
    registration_findings,
    rejected_entries,
)
from pipeline.result.numbers import left_out_mm
from pipeline.result.prediction import deflection_entries, validation_entry
from pipeline.result.stiffness import budget_entries, stiffness_entries


def answer(found: Findings) -> dict[str, Any]:
    """result.json of a campaign."""
    given, raw, where = found.given, found.raw, found.where
    cell, estimate = given.case.cell, given.estimate
    stiffness = stiffness_entries(cell, given.system, estimate)
    diagnosis = diagnosis_entry(found)
    drifts = any(cause.effect.name == "tracker_drift" for cause in found.diagnosis.causes)
    return {
        "format": 1,
        "campaign": found.campaign,
        "name": raw.settings.name,
        "robot": raw.settings.robot,
        "measured": measured_on(raw.settings, given.reduced.shown["readings"]),
        "verdict_sentence": sentences(diagnosis, stiffness, found),
        "stiffness": stiffness,
        "fit": fit_entry(cell, given.data, estimate),
        "diagnosis": diagnosis,
        "extended": extended_entry(found),
        "validation": validation_entry(found.checked, found.residuals, where),
        "budget": budget_entries(stiffness),
        "noise": noise_entry(found.right.noise, found.right.estimate),
        "rejected": rejected_entries(given.case.rejected),
        "findings": [
            *registration_findings(given.reduced.registration, drifts),
            *(entry["finding"] for entry in stiffness if entry["finding"]),
        ],
        "registration": registration_entry(given.reduced.registration),
        "test_pose_deflection": deflection_entries(cell, estimate, where),
        "model": {"equilibrium": cell.equilibrium},
        "assumptions": assumptions(raw, where),
        "inputs": [
            {"file": name, "sha256": files.sha256(content), "bytes": len(content)}
            for name, content in sorted(raw.files.items())
        ],
        "versions": versions(),
    }


def extended_entry(found: Findings) -> dict[str, Any]:
    """`extended`: stiffnesses and fit with mistakes put right and named causes in the model."""
    right, said = found.right, found.diagnosis
    known = said.system is not None and said.estimate is not None
    system, estimate = (said.system, said.estimate) if known else (right.system, right.estimate)
    assert system is not None  # known, or the joint springs
    assert estimate is not None
    return {
        "stiffness": stiffness_entries(
            right.case.cell, system, estimate, said.doubts if known else ()
        ),
        "fit": fit_entry(right.case.cell, right.data, estimate),
        "test_pose_deflection": (
            deflection_entries(found.richer.cell, found.richer, found.where)
            if found.richer
            else deflection_entries(right.case.cell, right.estimate, found.where)
        ),
    }


def sentences(
    diagnosis: dict[str, Any], stiffness: list[dict[str, Any]], found: Findings
) -> list[str]:
    """The verdict in two sentences."""
    verdict, why = diagnosis["verdict"], diagnosis["why"]
    good = [entry["name"] for entry in stiffness if entry["value"] is not None]
    some = "all" if len(good) == len(stiffness) else f"{len(good)} of {len(stiffness)}"
    half = [e["name"] for e in stiffness if e["value"] is not None and e["ci95"][1] is None]
    limits = f", {', '.join(half)} only a lower limit" if half else ""
    error = left_out_mm(found.residuals)
    worth = [c["gain"]["held_out_rms_after_mm"] for c in diagnosis["causes"] if c["gain"]]
    better = worth[0] if worth and verdict == "explained" else None
    left = 1e3 * found.estimate.residual_std_m
    first = {
        "adequate": f"The joint stiffness model explains the measured deflections"
        f"{larger_scatter(found.estimate)}.",
        "unexplained": "The joint stiffness model does not explain the measured deflections: "
        "do not rely on the stated uncertainties.",
    }.get(verdict, why)
    if found.estimate.p_value is None and not fits(found.estimate):
        first = (
            f"The joint stiffness model does not fit as well as a tracker measures: {left:.3f} mm "
            f"remain. {why}"
        )
    told = (
        "no pose can be predicted from the others"
        if error is None
        else f"poses left out of the estimate are predicted to {error:.3f} mm"
        if better is None
        else f"poses left out of the estimate are predicted to {better:.3f} mm with what is named, "
        f"to {error:.3f} mm without"
    )
    if found.mistakes:
        first = why
    elif not good:
        first = "These pulls determine no stiffness."
    return [first, f"{some.capitalize()} stiffnesses have a value{limits}, and {told}."]
