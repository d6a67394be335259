"""What leaves the pipeline: result.json as the campaign contract words it, and result tables."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from datetime import date
from typing import Any

import numpy as np
import pandas as pd
from scipy import special

from pipeline import files, handover
from pipeline.campaign import Raw, versions
from pipeline.cell import Cell, jacobian, predict
from pipeline.diagnosis import verdict as verdicts
from pipeline.effects import Pulls
from pipeline.results import Array, Estimate, System
from pipeline.robot import Joint
from pipeline.screening.finding import Finding
from pipeline.screening.fit import Fitted
from pipeline.settings import Settings
from pipeline.stages.assemble import Measured
from pipeline.stages.budget import Budget, budget
from pipeline.stages.estimate import left_out
from pipeline.stages.register import Registration
from pipeline.stages.validate import Where
from pipeline.stages.variance import NAMES, Components, at_most
from pipeline.stages.whiten import whitener
from pipeline.stages.workspace import Known

TRACKER_MEASURES_M = 1e-4
"""A laser tracker measures displacements in a hall to this or better (MPE of the AT500 class)."""

SURE = 0.01
"""A misfit that chance produces less often than this is a misfit."""

AXES = np.array(["x", "y", "z"], dtype=object)


def rows_table(system: System) -> pd.DataFrame:
    """What each row of a system is."""
    rows = system.rows
    return pd.DataFrame(
        {
            "row": np.arange(len(rows)),
            "pose": rows.pose,
            "repeat": rows.repeat,
            "target": rows.target,
            "axis": AXES[rows.axis],
        }
    )


def system_table(system: System) -> pd.DataFrame:
    """Table `tables.system`."""
    columns = {f"B_{p.name}": system.B[:, k] for k, p in enumerate(system.parameters)}
    return rows_table(system).assign(c_m=system.c, **columns)


def errors_table(system: System) -> pd.DataFrame:
    """Table ERRORS."""
    G = system.errors.G.tocoo()
    return pd.DataFrame(
        {
            "error": G.col,
            "source": system.errors.source[G.col],
            "common": system.errors.common[G.col],
            "row": G.row,
            "value_m": G.data,
        }
    )


def residuals_table(system: System, estimate: Estimate) -> pd.DataFrame:
    """Table RESIDUALS; without stated noise, whitened by their own scatter."""
    white = whitener(system.errors, system.rows.pose)
    whitened = white(estimate.residual)
    if not system.noise_stated:
        whitened = whitened / np.sqrt(np.sum(whitened**2) / max(estimate.dof, 1))
    return rows_table(system).assign(
        residual_m=estimate.residual, whitened=whitened, left_out_m=left_out(system, white)
    )


def estimate_table(estimate: Estimate) -> pd.DataFrame:
    """Table ESTIMATE."""
    return pd.DataFrame(
        {
            "parameter": [p.name for p in estimate.parameters],
            "unit": [p.unit for p in estimate.parameters],
            "value": estimate.value,
            "std": estimate.std,
            "identifiable": estimate.identifiable,
        }
    )


def covariance_table(estimate: Estimate) -> pd.DataFrame:
    """Table `tables.covariance`."""
    names = [p.name for p in estimate.parameters]
    return pd.DataFrame(estimate.cov, columns=names).assign(parameter=names)


@dataclass(frozen=True, eq=False)
class Findings:
    """All that a run found out about a campaign.

    Attributes:
        campaign: Name of the campaign.
        raw: What its folder holds.
        given: The joint springs from the data as given.
        right: The joint springs from the data with every mistake put right; the same without any.
        mistakes: What is wrong with the data.
        diagnosis: What the model misses, beside the mistakes.
        richer: The machine with the named causes in it, None without any.
        residuals: Table RESIDUALS of `given`.
        where: The test pose.
        checked: Table VALIDATION of `given`.
    """

    campaign: str
    raw: Raw
    given: Fitted
    right: Fitted
    mistakes: tuple[Finding, ...]
    diagnosis: verdicts.Diagnosis
    richer: handover.Model | None
    residuals: pd.DataFrame
    where: Where
    checked: pd.DataFrame

    @property
    def estimate(self) -> Estimate:
        """The joint springs from the data as given."""
        return self.given.estimate


def measured_on(settings: Settings, readings: pd.DataFrame | None) -> str | None:
    """The date in campaign.toml, else the first reading's, else a date within the name."""
    if settings.date is not None:
        return settings.date.isoformat()
    if readings is not None and readings["time"].notna().any():
        return pd.Timestamp(readings["time"].min()).isoformat()
    found = re.search(r"\b\d{4}-\d{2}-\d{2}\b", settings.name)
    try:
        return date.fromisoformat(found[0]).isoformat() if found else None
    except ValueError:
        return None


def answer(found: Findings) -> dict[str, Any]:
    """result.json of a campaign."""
    given, raw, where = found.given, found.raw, found.where
    cell, estimate = given.case.cell, given.estimate
    stiffness = stiffness_entries(cell, given.system, estimate)
    diagnosis = diagnosis_entry(found)
    return {
        "format": 1,
        "campaign": found.campaign,
        "name": raw.settings.name,
        "robot": raw.settings.robot,
        "measured": measured_on(raw.settings, given.reduced.shown["readings"]),
        "verdict_sentence": sentences(diagnosis["verdict"], diagnosis["why"], stiffness, found),
        "stiffness": stiffness,
        "fit": fit_entry(cell, given.data, estimate),
        "diagnosis": diagnosis,
        "extended": extended_entry(found),
        "validation": validation_entry(found.checked, found.residuals, where),
        "budget": budget_entries(stiffness),
        "noise": noise_entry(found.right.noise, found.right.estimate),
        "rejected": rejected_entries(given.case.rejected),
        "findings": [
            *registration_findings(given.reduced.registration),
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


def diagnosis_entry(found: Findings) -> dict[str, Any]:
    """`diagnosis`: mistakes in the data first, then what the diagnosis says of the corrected data.

    Scatter that the repeats have found already joins the causes.
    """
    said = verdicts.entry(found.diagnosis, found.right.case.robot)
    named = {cause["name"] for cause in said["causes"]}
    noisy = [cause for cause in noise_causes(found.right.noise) if cause["name"] not in named]
    said["causes"] = [*data_causes(found), *said["causes"], *noisy]
    if found.mistakes:
        return said | {"verdict": "bad_data", "why": bad_data_sentence(found.mistakes)}
    unstated = found.estimate.p_value is None
    if said["verdict"] == "adequate" and unstated and not fits(found.estimate):
        return said | {"verdict": "unexplained", "why": "No known cause explains the misfit."}
    return said


def bad_data_sentence(mistakes: tuple[Finding, ...]) -> str:
    """What is wrong with the data, and what was done about it."""
    first, *more = mistakes
    others = f", and {len(more)} more mistakes were found" if more else ""
    return (
        f"The data hold a mistake: {first.evidence}{others}. Nothing was repaired: the "
        f"stiffnesses are those of the data as given, the corrected ones stand beside them."
    )


def data_causes(found: Findings) -> list[dict[str, Any]]:
    """The mistakes in the data, as causes."""
    if not found.mistakes:
        return []
    before, after = (rms_mm(left_out(one.system)) for one in (found.given, found.right))
    gain = {
        "held_out_rms_before_mm": before,
        "held_out_rms_after_mm": after,
        "reduction": 1 - after / before if before else None,
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


def extended_entry(found: Findings) -> dict[str, Any]:
    """`extended`: stiffnesses and fit with mistakes put right and named causes in the model."""
    right, said = found.right, found.diagnosis
    known = said.system is not None and said.estimate is not None
    system, estimate = (said.system, said.estimate) if known else (right.system, right.estimate)
    assert system is not None  # known, or the joint springs
    assert estimate is not None
    return {
        "stiffness": stiffness_entries(right.case.cell, system, estimate),
        "fit": fit_entry(right.case.cell, right.data, estimate),
        "test_pose_deflection": (
            deflection_entries(found.richer.cell, found.richer, found.where)
            if found.richer
            else deflection_entries(right.case.cell, right.estimate, found.where)
        ),
    }


def fits(estimate: Estimate) -> bool:
    """Whether chance alone may have made the misfit; without stated noise, a tracker's noise."""
    if estimate.p_value is None:
        return estimate.residual_std_m < TRACKER_MEASURES_M
    return estimate.p_value >= SURE


def stiffness_entries(cell: Cell, system: System, estimate: Estimate) -> list[dict[str, Any]]:
    """One entry per joint: the stiffness with its budget, or why there is none."""
    split = budget(system, estimate)
    lever = np.linalg.norm(system.B, axis=0)
    return [
        _stiffness(number, joint, estimate, number - 1, float(lever[number - 1]))
        | {"budget": _budget(estimate, split, number - 1)}
        for number, joint in enumerate(cell.robot.joints, 1)
    ]


def _budget(estimate: Estimate, split: Budget, k: int) -> list[dict[str, Any]]:
    """What each source adds to one stiffness: standard uncertainty [its unit], part of variance."""
    x = float(estimate.value[k])
    if not estimate.identifiable[k] or x <= 0:
        return []
    std, share = split.std[:, k] / x**2, split.share[:, k]
    return [
        {"source": name, "std": float(std[i]), "share": float(share[i])}
        for i, name in enumerate(split.source)
    ]


def budget_entries(stiffness: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The same by source: share of each stiffness' variance in percent."""
    rows: dict[str, dict[str, Any]] = {}
    for entry in stiffness:
        for part in entry["budget"]:
            row = rows.setdefault(part["source"], {"source": part["source"].replace("_", " ")})
            row[f"{entry['name']} [%]"] = 100 * part["share"]
    return list(rows.values())


def noise_entry(found: Components, estimate: Estimate) -> dict[str, Any]:
    """The noise found in the data beside the stated one."""
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


def noise_causes(found: Components) -> list[dict[str, Any]]:
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


def _stiffness(
    number: int, joint: Joint, estimate: Estimate, k: int, lever: float
) -> dict[str, Any]:
    x, std = float(estimate.value[k]), float(estimate.std[k])
    identifiable = bool(estimate.identifiable[k])
    low, high = x - estimate.quantile * std, x + estimate.quantile * std
    has_value = identifiable and x > 0
    return {
        "joint": number,
        "name": f"k_{joint.name}",
        "unit": joint.stiffness_unit,
        "value": 1 / x if has_value else None,
        "std": std / x**2 if has_value else None,
        "ci95": [1 / high if 0 < high < np.inf else None, 1 / low if low > 0 else None],
        "identifiable": identifiable,
        "joint_type": "prismatic" if joint.prismatic else "revolute",
        "compliance": x if np.isfinite(std) else None,
        "compliance_std": finite(std),
        "compliance_unit": joint.compliance_unit,
        "relative_std": std / x if has_value else None,
        "nominal": joint.stiffness,
        "finding": _finding(joint, x, std, low, high, identifiable, lever),
    }


def _finding(
    joint: Joint, x: float, std: float, low: float, high: float, identifiable: bool, lever: float
) -> str | None:
    name = f"k_{joint.name}"
    work = "pulls along the rail" if joint.prismatic else "pulls with a lever about its axis"
    if not np.isfinite(std):
        if lever * x < 1e-12:
            return (
                f"{name} is not identifiable: in every pose the line of pull has no lever about "
                f"joint {joint.name}; attach the chain off that joint's axis."
            )
        return f"{name} is not identifiable: these poses mix it with another joint; add {work}."
    if high < 0:
        return (
            f"The compliance of {joint.name} is negative ({x:.2g} +- {std:.1g} "
            f"{joint.compliance_unit}), which no spring can be: the model misses something that "
            f"acts there, so no stiffness is stated."
        )
    if not identifiable:
        return (
            f"{name} is not identifiable: its compliance is {x:.2g} +- {std:.1g} "
            f"{joint.compliance_unit}; add {work}, or pull harder."
        )
    if low <= 0:
        return (
            f"{name} has no upper limit: its compliance of {x:.2g} +- {std:.1g} "
            f"{joint.compliance_unit} may be zero; add {work}, or pull harder."
        )
    return None


def fit_entry(cell: Cell, data: Measured, estimate: Estimate) -> dict[str, Any]:
    """How well the model meets the data."""
    return {
        "rms_mm": rms_mm(estimate.residual),
        "chi2": estimate.chi2,
        "dof": estimate.dof,
        "p_value": estimate.p_value,
        "noise_from": estimate.noise_from,
        "residual_std_mm": 1e3 * estimate.residual_std_m,
        "second_order_rms_mm": second_order_mm(cell, data, estimate),
        "noise_statement": noise_statement(estimate),
    }


def second_order_mm(cell: Cell, data: Measured, estimate: Estimate) -> float:
    """How far the deflected robot's geometry would move the targets, rms [mm]; c = B x omits it."""
    n = len(cell.parameters)  # the springs stand first
    known = estimate.identifiable[:n] & (estimate.value[:n] > 0)
    x = np.where(known, estimate.value[:n], cell.robot.nominal_compliance)
    flat, bent = (
        predict(replace(cell, equilibrium=kind), data.pulls, x).displacement
        for kind in ("undeformed", "deformed")
    )
    return rms_mm((bent - flat)[data.pull, data.target])


def noise_statement(estimate: Estimate) -> str:
    """One sentence on where the noise comes from and what depends on it."""
    if estimate.noise_from == "stated":
        return (
            "Uncertainties, chi-squared and its p-value rest on the noise stated in campaign.toml."
        )
    if estimate.noise_from == "replicates":
        return (
            "Uncertainties, chi-squared and its p-value rest on the noise found in the data: "
            "repeated zeros and pulls, and the effector's own triangle."
        )
    std = 1e3 * estimate.residual_std_m
    more = (
        "; a laser tracker measures better than that, so the model does not fit as well as a "
        "tracker measures"
        if not fits(estimate)
        else ""
    )
    return (
        f"No noise is stated, so every uncertainty rests on the residuals' own scatter of "
        f"{std:.3f} mm, there is no independent test of the model{more}."
    )


def sentences(
    verdict: str, why: str, stiffness: list[dict[str, Any]], found: Findings
) -> list[str]:
    """The verdict in two sentences."""
    good = [entry["name"] for entry in stiffness if entry["value"] is not None]
    some = "all" if len(good) == len(stiffness) else f"{len(good)} of {len(stiffness)}"
    error = left_out_mm(found.residuals)
    left = 1e3 * found.estimate.residual_std_m
    first = {
        "adequate": "The joint stiffness model explains the measured deflections.",
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
    )
    if found.mistakes:
        first = why
    elif not good:
        first = "These pulls determine no stiffness."
    return [first, f"{some.capitalize()} stiffnesses have a value, and {told}."]


def validation_entry(
    checked: pd.DataFrame, residuals: pd.DataFrame, where: Where
) -> dict[str, Any]:
    """Means of Eq. (22) per target, from the full covariance and as in Eq. (23)."""

    def both(draw: str) -> dict[str, dict[Any, float]]:
        drawn = checked[checked["draw"] == draw]
        sets = {name: drawn[drawn["set"] == name] for name in ("test_pose", "global")}
        return {
            name: rows.groupby("target", sort=False)["mu"].mean().to_dict()
            for name, rows in sets.items()
        }

    return {
        **both("covariance"),
        "held_out_rms_mm": left_out_mm(residuals),
        "independent": both("independent"),
        "poses": int(checked["index"].max()),
        "test_pose_stated": where.stated,
    }


def rejected_entries(rejected: pd.DataFrame) -> list[dict[str, Any]]:
    """What was left out, where it stands and why."""
    return [
        {
            "file": row["file"],
            "line": None if pd.isna(row["line"]) else int(row["line"]),
            "reason": row["reason"],
        }
        for row in rejected.to_dict("records")
    ]


def registration_entry(registration: Registration) -> dict[str, Any] | None:
    """How well the base reflectors fit; None when the readings are in F_b already."""
    table = registration.table
    if table.empty:
        return None
    miss = np.linalg.norm(table[["dx_m", "dy_m", "dz_m"]].to_numpy(), axis=1)
    std = np.sqrt(np.diag(registration.cov))
    chi2, dof = registration.chi2, registration.dof
    return {
        "rms_mm": 1e3 * float(np.sqrt(np.mean(miss**2))),
        "max_mm": 1e3 * float(miss.max()),
        "chi2": chi2,
        "dof": dof,
        "p_value": None if chi2 is None or dof < 1 else float(special.chdtrc(dof, chi2)),
        "rotation_std_rad": std[:3].tolist(),
        "translation_std_m": std[3:].tolist(),
    }


def registration_findings(registration: Registration) -> list[str]:
    """A sentence when the base reflectors disagree by more than chance explains."""
    told = registration_entry(registration)
    if told is None or told["p_value"] is None or told["p_value"] >= SURE:
        return []
    table = registration.table
    miss = np.linalg.norm(table[["dx_m", "dy_m", "dz_m"]].to_numpy(), axis=1)
    worst = table.iloc[int(np.argmax(miss))]
    return [
        f"The base reflectors do not fit their nominal coordinates (p = {told['p_value']:.1g}): "
        f"{worst['target']} in {worst['group']} is off by {1e3 * miss.max():.3g} mm; check "
        f"[base_frame] and whether the tracker or a reflector moved."
    ]


def deflection_entries(cell: Cell, estimate: Known, where: Where) -> list[dict[str, Any]]:
    """Predicted deflection at the test pose with its standard uncertainty."""
    unset, zero = np.zeros(1), np.zeros(1, dtype=np.int64)
    pulls = Pulls(zero, zero, where.q[None], where.force[None], unset, unset, unset, unset)
    moved = predict(cell, pulls, estimate.value).displacement[0]
    A = jacobian(cell, pulls, estimate.value)[0]
    known = np.isfinite(estimate.std)
    cov = estimate.cov[np.ix_(known, known)]
    out = []
    for name, move, rows in zip(cell.tool.targets, 1e3 * moved, A, strict=True):
        std = 1e3 * np.sqrt(np.diag(rows[:, known] @ cov @ rows[:, known].T))
        axes = dict(zip(("dx_mm", "dy_mm", "dz_mm"), move.tolist(), strict=True))
        out.append({"target": name, **axes, "std_mm": std.tolist()})
    return out


def assumptions(raw: Raw, where: Where) -> list[str]:
    """What the numbers rest on beside the data."""
    out = list(raw.robot.assumptions)
    if not where.stated:
        out.append("campaign.toml has no [test_pose]: the strongest pull of the campaign stands in")
    out.append(
        "validation poses lie within 0.25 m and 10 deg of the test pose, or anywhere within the "
        "joint limits, always under the test pose's force"
    )
    return out


def rms_mm(values: Array) -> float:
    """Root mean square over coordinates [mm], unweighted."""
    return 1e3 * float(np.sqrt(np.mean(np.asarray(values, dtype=float) ** 2)))


def left_out_mm(residuals: pd.DataFrame) -> float | None:
    """The same of the left-out residuals that the other poses can tell; None when there is none."""
    known = residuals["left_out_m"].dropna().to_numpy()
    return rms_mm(known) if len(known) else None


def finite(value: float) -> float | None:
    """A number JSON can hold."""
    return float(value) if np.isfinite(value) else None
