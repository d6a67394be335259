"""What a campaign of positions hands over: its answer, tables to show, and models."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.answer import positions
from pipeline.answer.contract import Answer
from pipeline.answer.positions import PositionsResults
from pipeline.answer.posture import standing_posture
from pipeline.base import doors
from pipeline.base.arrays import Array
from pipeline.base.quantities import plain
from pipeline.diagnosis.positions import UNLISTED
from pipeline.faults.mistake import Mistake
from pipeline.faults.position_readings import (
    dated_beside,
    exchanged_beside,
    implausible_outliers,
    outliers,
    wrong_entries,
)
from pipeline.faults.position_rows import PositionSheet, position_rows
from pipeline.geometry.calibrate import Calibration
from pipeline.geometry.laws import JointLaw
from pipeline.geometry.mechanism import layout
from pipeline.geometry.positioned import Positioned, as_read, usable
from pipeline.geometry.study import Study, study
from pipeline.machine.cell import Tool, paper_cell
from pipeline.prediction.kinematic_model import ByPulls, dumps, kinematic_model
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis
from pipeline.reduction.bring import Keep, Step
from pipeline.store.campaign import Raw

_SEED = 20261123
"""Of its draws: another one moves numbers within what they say of their scatter."""

_MODEL = "positions.npz"
"""What `pipeline predict` reads."""

_SCENE = "pipeline.annex.figure_tables:of_positions"
"""Tables of the picture of the cell."""

_ACROSS = 400
"""Points of a curve that is drawn."""


@dataclass(frozen=True, eq=False)
class _Stood:
    """The end of a campaign of positions.

    Attributes:
        answer: What result.json holds.
        shown: The tables a reader wants to see, by name.
        model: Springs and corrected table, for those who load it elsewhere.
        files: What `pipeline predict` reads, by name.
    """

    answer: Answer
    shown: dict[str, pd.DataFrame]
    model: IdentifiedModel
    files: dict[str, bytes]


def identify_positions(name: str, raw: Raw, keep: Keep, step: Step) -> PositionsResults:
    """From the tables of positions to what they say."""
    rows, rejects = step(as_read)(raw.settings, raw.robot, raw.files)
    given = PositionSheet(raw.robot, raw.settings, rows)
    wrong, sheet = step(position_rows)(given)
    read = usable(raw.settings, raw.robot, sheet.rows, rejects)
    found = _studied(raw, read, step)
    if dated := dated_beside(given, wrong, found):
        wrong, sheet = dated
        read = usable(raw.settings, raw.robot, sheet.rows, rejects)
        found = _studied(raw, read, step)
    late, sheet = exchanged_beside(PositionSheet(raw.robot, raw.settings, read.table), found)
    if late:  # a table as delivered shows decimetres, the identified one a millimetre
        read = usable(raw.settings, raw.robot, sheet.rows, rejects)
        found = _studied(raw, read, step)
    keep("10_positions", read.table, tables.positions(raw.robot))
    off = outliers(found, read.table)
    rejected = keep("13_rejected", _rejected(read, off), tables.REJECTED)
    mistakes = (*wrong, *late, *wrong_entries(found), *implausible_outliers(off, found))
    return PositionsResults.of(name, raw, found, mistakes, rejected)


def conclude(said: PositionsResults, keep: Keep, step: Step) -> _Stood:
    """The end of a campaign of nothing but positions."""
    found, given = said.found, positions.answer(said)
    laws = {"laws": keep("53_laws", law_table(found), tables.LAWS)}
    scene = doors.found(_SCENE)
    drawn = scene(found, keep, step) if scene else {}
    drawn["posture"] = keep("73_posture", _posture(found), tables.POSTURE)
    shown = {"rejected": said.rejected, **pictures(said, keep), **laws, **drawn}
    model = _model(said.campaign, found.final, given)
    return _Stood(given, shown, model, model_file(said))


def pictures(said: PositionsResults, keep: Keep) -> dict[str, pd.DataFrame]:
    """The tables of what only positions show."""
    found = said.found
    return {
        "curves": keep("50_curves", _curves(found.final), tables.CURVES),
        "curve_readings": keep(
            "51_curve_readings", _curve_readings(found.final), tables.CURVE_READINGS
        ),
        "held_out": keep("60_held_out", _held_out(found), tables.HELD_OUT),
    }


def model_file(said: PositionsResults, by_pulls: ByPulls | None = None) -> dict[str, bytes]:
    """What `pipeline predict` reads, by name."""
    settings = said.raw.settings
    tip = None if settings.of_positions else np.array(settings.tool["load_point"])
    return {_MODEL: dumps(kinematic_model(said.campaign, said.found.final, tip, by_pulls))}


def _studied(raw: Raw, read: Positioned, step: Step) -> Study:
    settings = raw.settings.positions
    return step(study)(
        raw.robot,
        read.readings,
        read.weights,
        {one: np.array(at) for one, at in raw.settings.tool.items()},
        None if settings is None else settings.sigma_m,
        raw.robot.roughness,
        np.random.default_rng(_SEED),
    )


def _posture(found: Study) -> pd.DataFrame:
    """The robot at the first pose, for the picture on the certificate."""
    mechanism, readings = found.final.mechanism, found.final.readings
    points = mechanism.tool[:, :3, 3]
    tool = Tool(points[0], np.array(readings.targets, dtype=object), points)
    return standing_posture(mechanism.robot, tool, readings.q[0])


def _rejected(read: Positioned, off: Sequence[Mistake]) -> pd.DataFrame:
    """What was left out when it was read, and the readings that are off."""
    bad = [
        (
            *one.at[0].rsplit(":", 1),
            f"stands {plain(one.before, 3)} mm from where all others put it",
        )
        for one in off
    ]
    told = pd.DataFrame(bad, columns=["file", "line", "reason"])
    return pd.concat([read.rejected, told.astype({"line": "int64"})], ignore_index=True)


def _curves(found: Calibration) -> pd.DataFrame:
    """The curves of the joints with their uncertainties, and how many poses stand there."""
    mechanism, at = found.mechanism, layout(found.mechanism).knots.start
    parts = []
    for curve in mechanism.curves[: len(found.wanted.curves)]:
        q = np.linspace(curve.first, curve.knots[-1], _ACROSS)
        part = slice(at, at + curve.count)
        rows = curve.rows(q)
        var = np.asarray((rows @ found.solution.cov[part, part]).T * rows.T.toarray()).sum(axis=0)
        seen, _ = np.histogram(found.readings.q[:, curve.joint], np.append(q, q[-1] + q[1] - q[0]))
        parts.append(
            pd.DataFrame(
                {
                    "joint": np.full(_ACROSS, curve.joint + 1, dtype=np.int32),
                    "q": q,
                    "error": rows @ found.solution.x[part],
                    "error_std": np.sqrt(np.maximum(var, 0.0)),
                    "poses": seen.astype(np.int32),
                }
            )
        )
        at = part.stop
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=_CURVE)


def _curve_readings(found: Calibration) -> pd.DataFrame:
    """What the poses say of each curve, `_TOGETHER` groups of poses with neighbouring joint values.

    A pose says f(q) + Z'r / Z'Z, with Z how the joint moves its targets and r what is left.
    """
    shifts = np.tile([True] * 3 + [False] * 3, len(found.readings.targets))
    left, parts = found.left[:, shifts], []
    start = 0
    for curve in found.mechanism.curves[: len(found.wanted.curves)]:
        knots = found.mechanism.knots[start : (start := start + curve.count)]
        Z, q = found.linear.Z[:, shifts, curve.joint], found.readings.q[:, curve.joint]
        square = np.sum(Z**2, axis=1)
        determined = square > 0.05 * np.median(square)
        said = (
            curve.value(q[determined], knots)
            + np.sum(Z * left, axis=1)[determined] / square[determined]
        )
        order = np.argsort(q[determined], kind="stable")
        for group in np.array_split(order, min(_TOGETHER, max(len(order) // 3, 1))):
            error = said[group]
            std = np.std(error, ddof=1) / np.sqrt(len(group)) if len(group) > 1 else np.nan
            mean = q[determined][group].mean()
            parts.append((curve.joint + 1, mean, error.mean(), std, len(group)))
    table = pd.DataFrame(parts, columns=_CURVE)
    return table.astype({"joint": "i4", "poses": "i4"})


def law_table(whole: Study) -> pd.DataFrame:
    """Table LAWS: what each pose says of each law but curves, all else as identified.

    As of a curve; with the standard uncertainty from the scatter of the poses.
    """
    found = whole.final
    shifts = np.tile([True] * 3 + [False] * 3, len(found.readings.targets))
    left, inputs, readings = found.left[:, shifts], found.linear.inputs, found.readings
    every = found.mechanism.laws
    ends = np.cumsum([0, *(law.amplitudes for law in every)])
    parts: list[pd.DataFrame] = []
    count: Counter[int] = Counter()
    for named in whole.laws:
        count[named.joint] += 1
        if named.number is None:
            continue
        law = every[named.number]
        b = found.mechanism.amplitudes[ends[named.number] : ends[named.number + 1]]
        slides = bool(found.mechanism.table.prismatic[law.joint - 1])
        Z = found.linear.Z[:, shifts, law.joint - 1]
        square = np.sum(Z**2, axis=1)
        told = np.flatnonzero(square > 0.05 * np.median(square))
        value = (law.basis(inputs) @ b)[told]
        rest = np.sum(Z * left, axis=1)[told] / square[told]
        of, unit, x = _over(law, found)
        parts.append(
            pd.DataFrame(
                {
                    "cause": f"{UNLISTED}:{law.joint}",
                    "part": np.int32(count[law.joint]),
                    "pose": readings.pose[told].astype(np.int32),
                    "repeat": readings.series[told].astype(np.int32),
                    "of": of,
                    "x_unit": unit,
                    "x": x[told],
                    "is": "shift" if slides else "turn",
                    "y_unit": "m" if slides else "rad",
                    "y": value + rest,
                    "y_std": np.full(len(told), np.std(rest)),
                    "law": value,
                }
            )
        )
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=tables.LAWS.names)


def _over(law: JointLaw, found: Calibration) -> tuple[str, str, Array]:
    """What a law is shown over, its unit, and that of each pose."""
    x = law.of(found.linear.inputs)
    if law.variable == "time":
        return "order", "1", np.arange(1.0, len(x) + 1)
    if law.variable != "angle":
        return law.variable, {"torque": "N m", "temperature": "°C"}[law.variable], x
    slides = bool(found.mechanism.table.prismatic[(law.source or law.joint) - 1])
    return ("position", "m", x) if slides else ("angle", "rad", x)


_TOGETHER = 40
"""Groups of poses over the range of a joint."""

_CURVE = ["joint", "q", "error", "error_std", "poses"]


def _held_out(found: Study) -> pd.DataFrame:
    """Distance of each target from its prediction by each model, by what was left out."""
    parts = []
    for stage in found.stages:
        readings = stage.found.readings
        for parting, off in stage.errors.items():
            m, t = off.shape
            parts.append(
                pd.DataFrame(
                    {
                        "model": np.full(m * t, stage.step.value, dtype=object),
                        "parting": np.full(m * t, parting.value, dtype=object),
                        "series": np.repeat(readings.names[readings.series], t),
                        "pose": np.repeat(readings.pose, t).astype(np.int32),
                        "target": np.tile(readings.targets, m),
                        "distance_m": off.ravel(),
                    }
                )
            )
    return pd.concat(parts, ignore_index=True)


def _model(name: str, found: Calibration, given: Answer) -> IdentifiedModel:
    """Corrected table and springs; the uncertainty of what is not determined is infinite."""
    mechanism, part = found.mechanism, layout(found.mechanism).compliance
    points = mechanism.tool[:, :3, 3]
    cell = paper_cell(mechanism.robot, Tool(points[0], found.readings.targets, points))
    cov: Array = found.solution.cov[part, part].copy()
    known = np.array([one.identifiable for one in given.stiffness])
    cov[~known], cov[:, ~known] = 0.0, 0.0
    cov[~known, ~known] = np.inf
    one = ModelHypothesis(1.0, cell, mechanism.compliance, cov)
    recommended = given.recommended
    return IdentifiedModel(
        name,
        str(given.diagnosis.verdict),
        {
            "model": str(recommended.model),
            "data": str(recommended.data),
            "reason": str(recommended.reason),
        },
        (one,),
        known,
    )
