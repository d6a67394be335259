"""An answer and its tables as a run makes them, made by code, for the report."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from pipeline.annex.posture import standing_posture
from pipeline.annex.scene import MOST_POSES
from pipeline.answer.contract import Answer
from pipeline.machine.cell import Tool
from pipeline.machine.robot import load
from pipeline.report.render import render

REPEATS, TARGETS = 3, ("P1", "P2", "P3")
ROLL = {"name": "rail_roll", "where": None, "form": None, "in_catalogue": True}
NOMINAL = (8.0e7, 3.8e6, 6.6e6, 3.9e6, 5.6e5, 6.6e5, 4.7e5)


def answer() -> Answer:
    """Answer to a campaign with a rolling carriage, with joint 7 undetermined."""
    return Answer.model_validate(_content(), strict=False)


@cache
def rendered() -> dict[str, bytes]:
    """All files of its report, rendered once for tests that only read them."""
    return render(answer(), tables(), run_time_s=1.234)


def revised(old: Answer, change: Callable[[dict[str, Any]], object]) -> Answer:
    """The answer with a change in its result.json."""
    content = old.as_json()
    change(content)
    return Answer.model_validate(content, strict=False)


def stiffer_one_way(content: dict[str, Any]) -> None:
    """Joint 4 holds 2.40 MN m/rad at the test pose and 1.50 where its torque is negative."""
    joint = content["stiffness"][3]
    joint |= {"value": 2.4e6, "std": 2e4}
    one = {"ci95": [None, None], "compliance": None, "compliance_std": None, "axis_turns": None}
    joint["by_sign"] = {
        "positive": {"value": 2.4e6, "std": 2e4} | one,
        "negative": {"value": 1.5e6, "std": 1e4} | one,
        "of": "pull",
        "correlation": None,
        "value_of": "positive",
    }


def _content() -> dict[str, Any]:
    joints = [_joint(number, nominal) for number, nominal in enumerate(NOMINAL, 1)]
    joints[6] |= {
        "value": None,
        "std": None,
        "ci95": [None, None],
        "relative_std": None,
        "identifiable": False,
        "compliance": None,
        "compliance_std": None,
        "finding": "k_theta7 is not identifiable: in every pose the line of pull has no lever "
        "about joint theta7; load the effector sideways, off that joint's axis.",
        "remarks": [{"odd": "no_lever"}],
        "budget": [],
    }
    springs = [j | {"value": j["value"] and j["value"] * 1.02} for j in joints]
    fit = {
        "rms_mm": 0.0312,
        "chi2": 512.4,
        "dof": 425,
        "p_value": 0.0023,
        "noise_from": "stated",
        "residual_std_mm": 0.0315,
        "second_order_rms_mm": 0.0021,
        "noise_statement": "Uncertainties rest on the noise stated for the readings.",
    }
    moved = [
        {
            "target": target,
            "dx_mm": -0.1234 - 0.01 * k,
            "dy_mm": 0.0456,
            "dz_mm": -0.4021,
            "std_mm": [0.0012, 0.00094, 0.00236],
        }
        for k, target in enumerate(TARGETS)
    ]
    return {
        "format": 1,
        "campaign": "kr500-sample",
        "name": "A carriage that rolls",
        "measured": None,
        "robot": "kr500_rail",
        "verdict_sentence": [
            "The carriage rolls about the rail and the paper's model does not know it.",
            "Add it to the model before you correct machining paths.",
        ],
        "first_screen": [
            {
                "about": "verdict",
                "text": "The carriage rolls about the rail and the paper's model does not know it.",
            },
            {
                "about": "to_do",
                "text": "Add it to the model before you correct machining paths.",
            },
        ],
        "stiffness": joints,
        "findings": [joints[6]["finding"]],
        "fit": fit,
        "diagnosis": _diagnosis(),
        "recommended": {
            "model": "extended",
            "data": "as_given",
            "reason": "cause_identified",
            "why": "The joint springs alone do not explain the readings.",
            "hypotheses": [{"weight": 1.0, "causes": [ROLL]}],
        },
        "joint_springs": {
            "stiffness": springs,
            "fit": fit | {"rms_mm": 0.049},
            "validation": None,
            "test_pose_deflection": [m | {"dx_mm": 1.1 * m["dx_mm"]} for m in moved],
        },
        "extended": {"stiffness": joints, "fit": fit, "test_pose_deflection": moved},
        "validation": {
            "test_pose": {"P1": 0.0016, "P2": 0.0019, "P3": 0.0020},
            "global": {"P1": 0.0068, "P2": 0.0067, "P3": 0.0069},
            "held_out_rms_mm": 0.0331,
            "poses": 1000,
            "test_pose_stated": True,
            "independent": {
                "test_pose": {"P1": 0.0026, "P2": 0.0029, "P3": 0.0030},
                "global": {"P1": 0.0088, "P2": 0.0087, "P3": 0.0089},
            },
        },
        "test_pose_deflection": moved,
        "test_pose": {
            "deflection_mm": 0.4231,
            "std_mm": 0.0331,
            "axes": [{"name": "E1", "value": 8.5, "unit": "m"}],
            "force_n": [-124.5, -175.4, -209.1],
            "stated": True,
        },
        "tolerance": {"deflection_mm": 0.5, "test_pose": "pass", "path": _judged()},
        "identity": {
            "first": "2026-11-03T08:00:08",
            "last": "2026-11-03T10:31:40",
            "operator": None,
            "temperature_c": 21.5,
            "scale": {"serial": "S-17", "certificate": None, "calibrated": "2026-03-01"},
            "poses": 16,
            "pulls": 48,
            "force_n": [1000.0, 3000.0],
        },
        "registration": {
            "rms_mm": 0.041,
            "max_mm": 0.083,
            "chi2": 21.3,
            "dof": 18,
            "p_value": 0.26,
            "rotation_std_rad": [2.1e-6, 3.0e-6, 1.9e-6],
            "translation_std_m": [1.2e-5, 0.9e-5, 1.1e-5],
        },
        "rejected": [
            {"file": "tracker.csv", "line": 17, "reason": "target P9 is not listed; add it"},
            {"file": "loads.csv", "line": None, "reason": "pose 4 has no load; weigh it again"},
        ],
        "budget": [
            {"source": "tracker", "k_r1 [%]": 99.9877, "k_theta2 [%]": 99.9877},
            {"source": "force gain", "k_r1 [%]": 0.0123, "k_theta2 [%]": 0.0123},
        ],
        "noise": {
            "from": "stated",
            "contrasts": 96,
            "components": [
                {"name": "tracker", "found_over_stated": 1.008, "std": 0.0519, "p_value": 0.437}
            ],
        },
        "model": {"equilibrium": "undeformed"},
        "assumptions": ["the rail reaches from 0 to 18 m", "Table I is used as printed"],
        "inputs": [
            {"file": "tracker.csv", "sha256": "0f" * 32, "bytes": 48123},
            {"file": "campaign.toml", "sha256": "a1" * 32, "bytes": 812},
        ],
        "versions": {"pipeline": "1.0.0", "numpy": "2.4.6"},
    }


def _judged() -> dict[str, Any]:
    """A path of six points, of which the first four pass and the last fails."""
    stretches = [("pass", 1, 4, 0.41), ("undecided", 5, 5, 0.48), ("fail", 6, 6, 0.61)]
    return {
        "file": "part.csv",
        "points": 6,
        "force_n": [250.0, 900.0],
        "decision": "fail",
        "stretches": [
            {
                "deflection_mm": mm,
                "std_mm": 0.0331,
                "decision": decision,
                "first": first,
                "last": last,
                "points": last - first + 1,
                "at": last,
            }
            for decision, first, last, mm in stretches
        ],
    }


def _path() -> pd.DataFrame:
    at = np.arange(6)
    return pd.DataFrame(
        {
            "point": at + 1,
            "pose": at + 1,
            "x_m": 1.0 + 0.1 * at,
            "y_m": 8.0 + 0.2 * at,
            "z_m": 1.2,
            "deflection_m": 1e-3 * np.array([0.2, 0.3, 0.35, 0.41, 0.48, 0.61]),
            "std_m": 3.31e-5,
            "decision": ["pass"] * 4 + ["undecided", "fail"],
        }
    )


def _joint(number: int, nominal: float) -> dict[str, Any]:
    value, std = nominal * (1 + 0.013 * (number - 3)), nominal * 0.004 * number
    rail = number == 1
    return {
        "joint": number,
        "joint_name": "r1" if rail else f"theta{number}",
        "name": "k_r1" if rail else f"k_theta{number}",
        "unit": "N/m" if rail else "N m/rad",
        "value": value,
        "std": std,
        "ci95": [value - 1.9 * std, value + 2.1 * std],
        "identifiable": True,
        "joint_type": "prismatic" if rail else "revolute",
        "compliance": 1 / value,
        "compliance_std": std / value**2,
        "compliance_unit": "m/N" if rail else "rad/(N m)",
        "relative_std": std / value,
        "nominal": nominal,
        "finding": None,
        "budget": [
            {"source": "tracker", "std": 0.99994 * std, "share": 0.999877},
            {"source": "force_gain", "std": 0.01109 * std, "share": 0.000123},
        ],
    }


def _diagnosis() -> dict[str, Any]:
    return {
        "verdict": "explained",
        "why": "The model with roll of the carriage about the rail fits the readings to within "
        "their scatter.",
        "reasons": ["cause_identified"],
        "causes": [
            {
                "name": "rail_roll",
                "where": None,
                "probability": 0.98,
                "parameters": [
                    {"name": "c_roll", "value": 2.1e-8, "std": 1e-9, "unit": "rad/(N m)"}
                ],
                "p_value": 1e-9,
                "rivals": [{"name": "joint_tilt", "where": 2, "probability": 0.01}],
                "gain": {
                    "held_out_rms_before_mm": 0.19,
                    "held_out_rms_after_mm": 0.05,
                    "reduction": 0.74,
                    "ci95": [0.69, 0.78],
                    "test_pose_change_mm": 0.011,
                },
            }
        ],
        "blind_spots": [
            {
                "name": "scale_gain",
                "where": None,
                "why": "multiplies every stiffness alike",
                "smallest_visible": None,
                "parameter": "gain",
                "unit": "1",
                "typical": 0.01,
                "needs": "a known dead weight on the scale",
            },
            {
                "name": "joint_lost_motion",
                "where": 3,
                "why": "too few load steps",
                "smallest_visible": 3.2e-5,
                "parameter": "play",
                "unit": "rad",
                "typical": 1e-5,
                "needs": "three load steps in one pose",
            },
        ],
        "next_poses": [
            {
                "separates": ["compensator", "joint_hardening"],
                "q": [8.5, -10.0, 35.0, 39.0, 81.0, 22.0, -10.0],
                "q_unit": ["m", *["deg"] * 6],
                "anchor_m": [3.5, 8.0, 0.4],
                "direction": [0.6, 0.0, -0.8],
                "force_n": 3000.0,
                "steps": 5,
                "approach": 1.0,
                "sigmas_before": 0.3,
                "sigmas_after": 12.0,
                "pose": 1,
            }
        ],
        "alone": [],
        "unloaded_off_mm": [None, None],
        "refused": [],
        "misfit_sits_at": [{"place": "rail", "share": 0.83, "p_value": 1e-9}],
        "detection": {
            "threshold_p": 1e-4,
            "smallest_p": 1e-9,
            "lack_of_fit_p": {"poses": 1e-7, "pulls": 0.3},
            "remainder_over_scatter": 1.02,
            "remainder_p": {"poses": 0.4, "pulls": 0.3, "further_cause": 0.2},
        },
        "scatter": {
            "tracker_over_stated": 1.01,
            "tracker_over_stated_std": 0.04,
            "scale_over_tracker": 1.0,
            "known_from": "repeats",
        },
        "equilibrium": "undeformed",
        "noise_floor_mm": 0.031,
    }


def tables(seed: int = 20261103, poses: int = 16) -> dict[str, pd.DataFrame]:
    """Tables that look like such a campaign."""
    rng = np.random.default_rng(seed)
    pulls = pd.MultiIndex.from_product(
        [range(1, poses + 1), range(1, REPEATS + 1)], names=["pose", "repeat"]
    ).to_frame(index=False)
    direction = rng.normal(size=(len(pulls), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    size = np.array([1000.0, 2000.0, 3000.0])[pulls["repeat"] - 1]
    pulls[["fx_n", "fy_n", "fz_n"]] = size[:, None] * direction
    points = pulls[["pose", "repeat"]].merge(pd.DataFrame({"target": TARGETS}), how="cross")
    rail = rng.uniform(0, 18, poses)[points["pose"] - 1]
    points[["zero_x_m", "zero_y_m", "zero_z_m"]] = (
        rng.uniform([1.2, -1, 0.8], [2.6, 1, 2.4], (poses, 3))[points["pose"] - 1]
        + np.outer(rail, [0, 1, 0])
        + 0.15 * rng.normal(size=(len(TARGETS), 3))[np.tile(range(3), len(pulls))]
    )
    moved = 1e-3 * np.repeat(size, len(TARGETS))[:, None] / 1000.0
    points[["dx_m", "dy_m", "dz_m"]] = moved * np.repeat(direction, len(TARGETS), axis=0)
    rows = points.merge(pd.DataFrame({"axis": ["x", "y", "z"]}), how="cross")
    rows["residual_m"] = 3e-5 * rng.standard_normal(len(rows))
    rows["whitened"] = rows["residual_m"] / 3e-5
    rows["left_out_m"] = 1.1 * rows["residual_m"]
    return {
        "forces": pulls,
        "displacements": points,
        "residuals": rows[
            ["pose", "repeat", "target", "axis", "residual_m", "whitened", "left_out_m"]
        ],
        "registration": _registration(rng),
        "validation": _validation(rng),
        "path": _path(),
        "workspace": _workspace(),
        "workspace_joint_springs": _workspace().eval("worst_m_per_n = 1.1 * worst_m_per_n"),
        "examined": _examined(rows),
        "diagnosis": _suspects(),
        "separability": _separability(),
        "rejected": pd.DataFrame({"file": [], "line": [], "reason": []}),
        "models": _models(rows),
        "enough": _enough(),
        "covariance": _covariance(),
        "laws": _laws(rng, pulls),
        "arm": _arm(),
        "posture": _posture(),
        **_cell(points, rows),
    }


_XYZ = ("x", "y", "z")


def _models(rows: pd.DataFrame) -> pd.DataFrame:
    """The robot file is too stiff by a tenth."""
    moved = rows[["dx_m", "dy_m", "dz_m"]].to_numpy()[
        np.arange(len(rows)), np.arange(len(rows)) % 3
    ]
    told = rows[["pose", "repeat", "target", "axis"]].assign(measured_m=moved)
    return told.assign(
        nominal_m=0.9 * moved,
        joint_springs_m=moved - 2 * rows["residual_m"],
        recommended_m=moved - rows["residual_m"],
    )


def _enough() -> pd.DataFrame:
    """Twice the poses, a seventh less uncertain; joint 7 is not determined."""
    counts = [2, 4, 8, 16, 32]
    table = pd.MultiIndex.from_product([counts, range(1, 8)], names=["poses", "joint"])
    out = table.to_frame(index=False)
    out["parameter"] = ["k_r1" if j == 1 else f"k_theta{j}" for j in out["joint"]]
    share = 0.02 * out["joint"] / np.sqrt(out["poses"])
    out["relative_std"] = np.where(out["joint"] == 7, np.inf, share)
    return out.drop(columns="joint")


def _covariance() -> pd.DataFrame:
    """Joints 3 and 4 are correlated; joint 7 is undetermined."""
    names = ["c_r1", *(f"c_theta{j}" for j in range(2, 8)), "c_roll"]
    cov = 1e-16 * np.eye(8)
    cov[2, 3] = cov[3, 2] = -0.8e-16
    cov[6, 6] = np.inf
    return pd.DataFrame(cov, columns=names).assign(parameter=names)


def _laws(rng: np.random.Generator, pulls: pd.DataFrame) -> pd.DataFrame:
    """A carriage that rolls in proportion to the torque."""
    x = 2000 * rng.uniform(-1, 1, len(pulls))
    law = 2.1e-8 * x
    out = pulls[["pose", "repeat"]].assign(cause="rail_roll", part=1, x=x, law=law, y_std=3e-6)
    out = out.assign(y=law + 3e-6 * rng.standard_normal(len(x)))
    return out.assign(of="torque", x_unit="N m", y_unit="rad").assign(**{"is": "turn"})


def _arm() -> pd.DataFrame:
    ends = [(0.0, 1.0, 0.9, 1.9), (0.9, 1.9, 2.2, 1.6)]
    names = ["from_reach_m", "from_height_m", "to_reach_m", "to_height_m"]
    return pd.DataFrame(ends, columns=names).assign(joint=[2, 3], radius_m=[0.3, 0.2])


def _posture() -> pd.DataFrame:
    """A KR500 whose load point sags by half a millimetre, a tenth of it by the carriage."""
    robot = load("kr500_rail")
    points = {name: np.array([0.1 * k, 0.05, 0.1]) for k, name in enumerate(TARGETS)}
    tool = Tool.of({"load_point": np.array([0.15, 0.0, 0.25]), **points})
    q = robot.from_degrees([8.5, -10, 35, 39, 81, 22, -10])
    table = standing_posture(robot, tool, q)
    for end in ("from", "to"):
        far = table[f"{end}_x_m"] / 3.4
        table[f"{end}_moved_z_m"], table[f"{end}_caused_z_m"] = -5e-4 * far, -5e-5 * far
    return table


def _cell(points: pd.DataFrame, rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """A rail, a tracker beside it, and an arm of two links ending at its reflectors."""
    left = rows.pivot_table(index=["pose", "repeat", "target"], columns="axis", values="residual_m")
    kept = points[points["repeat"] == REPEATS].reset_index(drop=True)
    last = left.xs(REPEATS, level="repeat").reset_index()
    vectors = pd.DataFrame({"pose": kept["pose"], "target": kept["target"]})
    for a in _XYZ:
        vectors[f"{a}_m"], vectors[f"moved_{a}_m"] = kept[f"zero_{a}_m"], kept[f"d{a}_m"]
        vectors[f"left_{a}_m"] = last[a].to_numpy()
    for pair in ("xx", "xy", "xz", "yy", "yz", "zz"):
        vectors[f"c{pair}_m2"] = 1e-9 if pair[0] == pair[1] else 0.0
    every = vectors["pose"].unique()  # with many poses the stage draws some
    drawn = every[np.unique(np.linspace(0, len(every) - 1, MOST_POSES).astype(int))]
    vectors = vectors[vectors["pose"].isin(drawn)].reset_index(drop=True)
    bodies = [_body(0, "base", "base", (0, -0.5, -0.4), (0, 18.5, -0.4), 0.4)]
    bodies.append(_body(0, "tracker", "tracker", (6.0, 9.0, 0.7), (6.0, 9.0, 0.7), 0.0))
    bodies.append(_body(0, "reflector", "B1", (0.6, -0.5, -0.3), (0.6, -0.5, -0.3), 0.0))
    for pose, group in vectors.groupby("pose"):
        end = group[["x_m", "y_m", "z_m"]].mean().to_numpy()
        foot, elbow = np.array([0, end[1], 0.3]), np.array([0.6, end[1], 1.6])
        bodies.append(_body(pose, "arm", "theta2", foot, elbow, 0.3))
        bodies.append(_body(pose, "arm", "theta3", elbow, end, 0.2))
        bodies.append(_body(pose, "tool", "P1", end, group.iloc[0, 2:5], 0.03))
    number = np.sort(vectors["pose"].unique())
    poses = pd.DataFrame({"pose": number, "label": [f"Pose {n}" for n in number]})
    first = 6 + 21 * np.arange(len(number))
    poses = poses.assign(file="tracker.csv", first_line=first, last_line=first + 20)
    poses = poses.assign(joints_file="joints.csv", joints_line=number + 1, pulls=3, force_n=3000.0)
    return {"scene": pd.DataFrame(bodies), "poses": poses, "vectors": vectors}


def _body(pose: Any, part: str, name: str, start: Any, end: Any, radius: float) -> dict[str, Any]:
    ends = {"from": np.asarray(start, float), "to": np.asarray(end, float)}
    at = {f"{key}_{a}_m": one[k] for key, one in ends.items() for k, a in enumerate(_XYZ)}
    return {"pose": int(pose), "part": part, "name": name, **at, "radius_m": radius}


def _registration(rng: np.random.Generator) -> pd.DataFrame:
    out = pd.DataFrame({"target": ["B1", "B2", "B3", "B4"] * 6})
    out[["dx_m", "dy_m", "dz_m"]] = 3e-5 * rng.standard_normal((len(out), 3))
    return out


def _suspects() -> pd.DataFrame:
    return pd.DataFrame(
        {
            "name": ["joint_tilt", "rail_roll", "scale_zero", "joint_offset"],
            "where": ["2", "", "", "3"],
            "log_evidence": [4.2, 31.0, -0.7, np.nan],
            "named": [False, True, False, False],
        }
    )


def _examined(rows: pd.DataFrame) -> pd.DataFrame:
    """The carriage rolls at long reach: the identified cause removes a trend."""
    rail = rows["zero_y_m"].to_numpy(float)
    return rows.assign(
        r1_m=rail,
        tau_r1=1000.0,
        tau_theta2=800.0 * np.sin(rows["pose"]) * rows["repeat"],
        time_s=600.0 * rows["pose"] + 90.0 * rows["repeat"],
        residual_m=rows["residual_m"] + 1e-5 * (rail - 9),
        residual_extended_m=rows["residual_m"],
        left_out_extended_m=0.6 * rows["left_out_m"],
    )


def _separability() -> pd.DataFrame:
    """Three visible causes, two of them alike, and an invisible one."""
    labels = ["rail_roll", "joint_tilt:2", "scale_zero", "joint_offset:3"]
    sigmas = [[30.0, 0.8, 12.0, 9.0], [1.5, 40.0, 25.0, 9.0], [14.0, 3.1, 16.0, 9.0], [0.2] * 4]
    return pd.DataFrame(
        {
            "cause": np.repeat(labels, 4),
            "rival": labels * 4,
            "sigmas": np.ravel(sigmas),
        }
    )


def _workspace() -> pd.DataFrame:
    row, column = (grid.ravel() for grid in np.mgrid[-1:12, -1:12])
    keep = ((row >= 0) & (column >= 0)) | ((row == -1) & (column == -1))
    out = pd.DataFrame({"row": row[keep], "column": column[keep]})
    shoulder, elbow = 0.1 * out["row"] - 0.3, 0.1 * out["column"] + 0.5
    out["reach_m"] = 1.3 * np.cos(shoulder) + 1.5 * np.cos(shoulder + elbow)
    out["height_m"] = 1.0 + 1.3 * np.sin(shoulder) + 1.5 * np.sin(shoulder + elbow)
    out["worst_m_per_n"] = 1e-6 * (1 + out["reach_m"] ** 2)
    out["std_m_per_n"] = 0.004 * out["worst_m_per_n"]
    return out.assign(direction_x=0.1, direction_y=-0.9, direction_z=0.4)


def _validation(rng: np.random.Generator) -> pd.DataFrame:
    index = pd.MultiIndex.from_product(
        [["test_pose", "global"], ["covariance", "independent"], range(1, 1001), TARGETS],
        names=["set", "draw", "index", "target"],
    )
    out = index.to_frame(index=False)
    size = np.where(out["set"] == "global", 0.007, 0.002) * np.where(
        out["draw"] == "independent", 1.4, 1.0
    )
    out["mu"] = size * np.abs(rng.standard_normal(len(out)))
    return out
