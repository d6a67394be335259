"""`diagnosis` and `noise`: mistakes in the data first, then what the model misses."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.answer.findings import Findings
from pipeline.answer.numbers import left_out_mm
from pipeline.answer.words import why
from pipeline.diagnosis import facts as verdicts
from pipeline.diagnosis.verdict import findings
from pipeline.system.estimate import left_out
from pipeline.system.system import Estimate
from pipeline.system.variance import NAMES, Components, at_most


def diagnosis_entry(found: Findings) -> dict[str, Any]:
    """`diagnosis`: mistakes in the data first, then the diagnosis of the corrected data.

    Scatter that the repeats have found already joins the causes.
    """
    said = verdicts.entry(found.diagnosis, found.right.case.robot)
    named = {cause["name"] for cause in said["causes"]}
    noisy = [cause for cause in _noise_causes(found.right.noise) if cause["name"] not in named]
    said["causes"] = [*_data_causes(found), *said["causes"], *noisy]
    reasons = [row.finding.value for row in findings(found.facts)]
    return {"verdict": str(found.verdict), "why": why(found.facts), "reasons": reasons, **said}


def _data_causes(found: Findings) -> list[dict[str, Any]]:
    """The mistakes in the data, as causes."""
    if not found.mistakes:
        return []
    before, after = (left_out_mm(left_out(one.system)) for one in (found.given, found.right))
    gain = {
        "held_out_rms_before_mm": before,
        "held_out_rms_after_mm": after,
        "reduction": 1 - after / before if before and after is not None else None,
        "ci95": None,
        "test_pose_change_mm": None,
    }
    return [
        {
            "name": one.name,
            "where": one.where,
            "probability": 1 - (one.p_value or 0.0),
            "parameters": []
            if one.size is None
            else [{"name": "size", "value": one.size, "std": None, "unit": one.size_unit}],
            "p_value": one.p_value,
            "rivals": [],
            "gain": gain,
            "evidence": {
                "sentence": one.evidence,
                "correction": one.correction,
                "before": one.before,
                "after": one.after,
                "unit": one.unit,
            },
        }
        for one in found.mistakes
    ]


def noise_entry(found: Components, estimate: Estimate) -> dict[str, Any]:
    """The noise found in the data relative to the stated one."""
    return {
        "from": estimate.noise_from,
        "contrasts": found.dof,
        "components": [
            {
                "name": name,
                "found_over_stated": float(found.scale[i]),
                "std": float(found.std[i] * found.scale[i]),
                "p_value": float(found.p_value[i]),
            }
            for i, name in enumerate(found.name)
            if np.isfinite(found.std[i])
        ],
    }


def _noise_causes(found: Components) -> list[dict[str, Any]]:
    """The noise components that are larger than stated, as causes."""
    return [
        {
            "name": NAMES[name],
            "where": None,
            "probability": at_most(float(found.p_value[i])),
            "parameters": [
                {
                    "name": f"s_{name.split('_')[0]}",
                    "value": float(found.scale[i]) - 1,
                    "std": float(found.std[i] * found.scale[i]),
                    "unit": "1",
                }
            ],
            "p_value": float(found.p_value[i]),
            "rivals": [],
            "gain": None,
        }
        for i, name in enumerate(found.name)
        if found.larger[i]
    ]
