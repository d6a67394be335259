"""Title, caption and alternative text of every figure, with the numbers of this campaign in them.

A figure whose data are missing is left out: each writer below answers None for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.base.quantities import known, percent, plain, with_std
from pipeline.diagnosis.nextpose import APART
from pipeline.report import words
from pipeline.report.record import Figure
from pipeline.report.summaries import (
    Result,
    Tables,
    arrows,
    courses,
    gain,
    has,
    places,
    pose_rms,
    prediction_error,
    registration_by_target,
    residual_force,
    separability,
    suspects,
    whitened,
)


def figures(names: Sequence[str], result: Result, tables: Tables) -> list[Figure]:
    """The figures of these names that this campaign has data for."""
    written = [WRITERS[name](result, tables) for name in names]
    return [figure for figure in written if figure is not None]


def comparable(result: Result) -> list[Mapping[str, Any]]:
    """Stiffnesses that have a value, an uncertainty and a nominal value to be shown beside."""
    return [
        joint
        for joint in result.get("stiffness") or []
        if joint.get("identifiable", True)
        and known(joint.get("nominal"))
        and joint["nominal"]
        and known(joint.get("value"))
        and known(joint.get("std"))
    ]


def _stiffness(result: Result, tables: Tables) -> Figure | None:
    joints = comparable(result)
    if not joints:
        return None
    endless = [str(j["name"]) for j in joints if not all(map(known, j.get("ci95") or [None]))]
    off = {str(j["name"]): j["value"] / j["nominal"] for j in joints}
    off = {name: share for name, share in off.items() if name not in endless} or off
    softest, stiffest = min(off, key=off.__getitem__), max(off, key=off.__getitem__)
    widest = max(
        (j for j in joints if str(j["name"]) in off), key=lambda j: j["std"] / j["nominal"]
    )
    said = (
        f"{softest} is at {percent(off[softest], 3)} and {stiffest} at {percent(off[stiffest], 3)} "
        f"of its nominal value; {widest['name']} has the widest interval"
        + (f", and {', '.join(endless)} no upper limit." if endless else ".")
    )
    return Figure(
        "stiffness",
        "Stiffness as a share of the nominal value",
        f"{said} Bars are 95 % intervals, an arrow has no upper limit: where one does not reach "
        f"the line at 100 %, the joint differs from nominal by more than the measurement's "
        f"uncertainty.{_circles(result)}",
        f"Interval plot of {len(joints)} joint stiffnesses relative to nominal. {said}",
    )


def _circles(result: Result) -> str:
    """What the open circles of the interval plot are."""
    other = words.beside(result)
    return f" Open circles, where they are near: {other[0]}." if other else ""


def _pose_rms(result: Result, tables: Tables) -> Figure | None:
    if not has(tables, "residuals"):
        return None
    poses = pose_rms(tables["residuals"])
    worst = poses.iloc[int(poses["fitted"].argmax())]
    said = (
        f"Pose {int(worst['pose'])} is the worst with {plain(worst['fitted'])} mm; the middle of "
        f"all {len(poses)} poses is {plain(poses['fitted'].median())} mm."
    )
    left_out = poses["left_out"].dropna()
    if len(left_out):
        said += f" Left out of the estimate, the worst is missed by {plain(left_out.max())} mm."
    return Figure(
        "pose-rms",
        "Residual of each pose",
        f"{said} A diamond far above its bar marks a pose that the others do not predict.",
        f"Bar chart of the rms residual per pose, with a marker for the pose left out. {said}",
    )


def _gain(result: Result, tables: Tables) -> Figure | None:
    causes = (result.get("diagnosis") or {}).get("causes")
    if not (causes and has(tables, "examined")):
        return None
    poses = gain(tables["examined"]).dropna()
    if poses.empty:
        return None
    better = int((poses["after"] < poses["before"]).sum())
    worst = poses.iloc[int(poses["before"].argmax())]
    said = (
        f"With the named causes {better} of {len(poses)} poses are predicted better; pose "
        f"{int(worst['pose'])}, the worst, goes from {plain(worst['before'])} mm to "
        f"{plain(worst['after'])} mm."
    )
    return Figure(
        "gain",
        "Error at poses left out, without and with the named causes",
        f"{said} Each pose is predicted from all others, the causes chosen anew without it.",
        f"Pairs of marks per pose: error with joint springs alone and with causes. {said}",
    )


def _evidence(result: Result, tables: Tables) -> Figure | None:
    if not has(tables, "diagnosis"):
        return None
    best = suspects(tables["diagnosis"])
    if best.empty or best["log_evidence"].iloc[0] < 3:
        return None
    first = best.iloc[0]
    said = (
        f"By itself {cause_in_words(first)} has the most evidence, "
        f"{plain(first['log_evidence'], 2)}; {int((best['log_evidence'] > 3).sum())} of "
        f"{len(tables['diagnosis'])} suspects lie above 3."
    )
    return Figure(
        "evidence",
        "Evidence for each suspect by itself",
        f"{said} Scale: natural logarithm of the odds against the joint springs alone; 3 is 20 to "
        f"1. Suspects close to each other are hard to tell apart; the named ones are marked.",
        f"Bars of the evidence for the {len(best)} best suspects. {said}",
    )


def _separability(result: Result, tables: Tables) -> Figure | None:
    if not has(tables, "separability"):
        return None
    apart, whole = separability(tables["separability"]), tables["separability"]["cause"].nunique()
    if len(apart) < 2:
        return None
    rows, columns = np.tril_indices(len(apart), -1)
    sigmas = apart.to_numpy()[rows, columns]
    close, order = int((sigmas < APART).sum()), np.argsort(sigmas, kind="stable")
    first, second = (words.from_label(apart.index[at[order[0]]]) for at in (rows, columns))
    said = (
        f"{len(apart)} of {whole} causes would show at their typical size. Of their {len(sigmas)} "
        f"pairs {close} could then not be told apart by these readings; the closest are {first} "
        f"and {second}, {plain(sigmas[order[0]], 2)} standard deviations from each other."
    )
    return Figure(
        "separability",
        "Which causes these readings can tell apart",
        f"{said} Each square is what one cause of typical size leaves when the other is fitted in "
        f"its place; dark is alike, and from {APART} on the right one of two is found in 95 % of "
        f"the cases. A pair in a dark square needs another pose or another sensor.",
        f"Triangular map of the distances between {len(apart)} causes. {said}",
    )


def cause_in_words(suspect: Any) -> str:
    """A row of table DIAGNOSIS in words."""
    where = str(suspect["where"])
    return words.from_label(f"{suspect['name']}:{where}" if where else str(suspect["name"]))


def _residual_force(result: Result, tables: Tables) -> Figure | None:
    if not (has(tables, "residuals") and has(tables, "forces")):
        return None
    points = residual_force(tables["residuals"], tables["forces"])
    if points.empty:
        return None
    low, high = points["force_n"].min(), points["force_n"].max()
    said = (
        f"Pulls reach from {plain(low)} N to {plain(high)} N and the largest residual is "
        f"{plain(points['mm'].abs().max())} mm."
    )
    return Figure(
        "residual-force",
        "Residual against pull",
        f"{said} An even band is noise; a band that opens or bends with the pull is an effect that "
        f"grows with load, such as a joint that hardens.",
        f"Scatter plot of {len(points)} residual coordinates against the size of the pull. {said}",
    )


def _residual_course(result: Result, tables: Tables) -> Figure | None:
    if not has(tables, "examined") or "residual_extended_m" not in tables["examined"]:
        return None
    _, told = courses(tables)
    if not told:
        return None
    said = "Steps of " + ", ".join(
        f"{one.name} explain {percent(one.explained)} of the residuals of the joint springs"
        if k == 0
        else f"of {one.name} {percent(one.explained)}"
        for k, one in enumerate(told)
    )
    said += f"; pure noise would give {percent(told[0].by_chance)}."
    return Figure(
        "residual-course",
        "Residual against " + ", ".join(one.name for one in told),
        f"{said} A band that bends, steps or drifts is an effect the joint springs do not have; "
        f"diamonds are what is left with the named causes.",
        f"{len(told)} scatter plots of residual coordinates. {said}",
    )


def _whitened(result: Result, tables: Tables) -> Figure | None:
    if not has(tables, "residuals"):
        return None
    values = whitened(tables["residuals"])
    if not len(values):
        return None
    spread, beyond = float(np.sqrt(np.mean(values**2))), int(np.sum(np.abs(values) > 3))
    expected = 0.0027 * len(values)
    said = (
        f"Their spread is {plain(spread)} where 1 is expected; {beyond} of {len(values)} lie "
        f"beyond ±3 where about {plain(expected, 2)} are expected."
    )
    return Figure(
        "whitened",
        "Residuals in standard deviations",
        f"{said} Bars that follow the curve are noise as assumed; wide shoulders are a missing "
        f"effect or a noise stated too small.",
        f"Histogram of weighted residuals with the normal curve. {said}",
    )


def _arrows(result: Result, tables: Tables) -> Figure | None:
    if not all(has(tables, name) for name in ("residuals", "displacements", "forces")):
        return None
    vectors = arrows(tables["residuals"], places(tables), tables["forces"])
    if vectors.empty:
        return None
    size = np.linalg.norm(vectors[["rx", "ry", "rz"]].to_numpy(float), axis=1)
    worst = vectors.iloc[int(size.argmax())]
    said = (
        f"The longest of {len(vectors)} arrows is {plain(size.max())} mm, at {worst['target']} in "
        f"pose {int(worst['pose'])}."
    )
    return Figure(
        "arrows",
        "Residual at each pose, seen in the base frame",
        f"{said} Each arrow is what is left of one reflector's displacement under the strongest "
        f"pull of its pose. Arrows in all directions are noise; arrows that agree within a pose or "
        f"along the rail are an effect.",
        f"Residual vectors drawn at the poses, from above and from the side. {said}",
    )


def _registration(result: Result, tables: Tables) -> Figure | None:
    if not has(tables, "registration"):
        return None
    by_target = registration_by_target(tables["registration"])
    worst = by_target.iloc[int(by_target["largest"].argmax())]
    said = (
        f"The largest deviation is {plain(worst['largest'])} mm at {worst['target']}, in "
        f"{len(tables['registration'])} readings of {len(by_target)} reflectors."
    )
    return Figure(
        "registration",
        "Base reflectors after registration",
        f"{said} A step or a slope from the first to the last reading is a tracker that moved.",
        f"Deviation of each base reading from nominal, in order of the readings. {said}",
    )


def _prediction(result: Result, tables: Tables) -> Figure | None:
    if not has(tables, "validation"):
        return None
    errors = prediction_error(tables["validation"])
    said = " ".join(
        f"{SETS.get(where, where).capitalize()} half of the poses are predicted within "
        f"{percent(np.median(mu))} and 95 % within {percent(np.quantile(mu, 0.95))}."
        for (where, draw), mu in errors.items()
        if draw == "covariance"
    )
    return Figure(
        "prediction",
        "Relative error of the predicted deflection",
        f"{said} The further left a curve, the better; dashed curves draw each stiffness "
        f"by itself, as the paper does.",
        f"Cumulative curves of the relative prediction error of Eq. (22). {said}",
    )


def _workspace(result: Result, tables: Tables) -> Figure | None:
    return _softness("workspace", words.values_of(result), tables)


def _workspace_joint_springs(result: Result, tables: Tables) -> Figure | None:
    other = words.beside(result)
    return _softness("workspace-joint-springs", other[0], tables) if other else None


def _softness(name: str, model: str, tables: Tables) -> Figure | None:
    table = name.replace("-", "_")
    if not has(tables, table) or len(tables[table]) < 20:
        return None
    soft = tables[table]
    here, worst = soft.iloc[0], soft.iloc[int(soft["worst_m_per_n"].to_numpy().argmax())]
    size = 1e6 * soft["worst_m_per_n"]
    axis = "xyz"[int(np.abs(here[[f"direction_{a}" for a in "xyz"]].to_numpy(float)).argmax())]
    said = (
        f"At the test pose (cross) one newton moves the load point by "
        f"{with_std(1e6 * here['worst_m_per_n'], 1e6 * here['std_m_per_n'])} µm in its softest "
        f"direction, mostly along {axis}. Over the plane it is {plain(size.min(), 2)} µm to "
        f"{plain(size.max(), 2)} µm, most at a reach of {worst['reach_m']:.1f} m and a height of "
        f"{worst['height_m']:.1f} m."
    )
    return Figure(
        name,
        f"Deflection per newton over the arm's plane, {model}",
        f"{said} Shoulder and elbow go through their ranges, the other joints stay as in the test "
        f"pose; bright is soft.",
        f"Map of the deflection per newton of load over reach and height, {model}. {said}",
    )


SETS = {"test_pose": "around the test pose", "global": "over the workspace"}
DRAWS = {"covariance": "full covariance", "independent": "independent"}

WRITERS: dict[str, Callable[[Result, Tables], Figure | None]] = {
    "stiffness": _stiffness,
    "prediction": _prediction,
    "gain": _gain,
    "evidence": _evidence,
    "separability": _separability,
    "pose-rms": _pose_rms,
    "residual-force": _residual_force,
    "residual-course": _residual_course,
    "whitened": _whitened,
    "arrows": _arrows,
    "workspace": _workspace,
    "workspace-joint-springs": _workspace_joint_springs,
    "registration": _registration,
}
