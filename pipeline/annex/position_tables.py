"""Tables that only the figures of a campaign of positions need: curves, laws, held-out poses."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pipeline.annex import promises
from pipeline.base.arrays import Array
from pipeline.machine.effects.unlisted import NAME
from pipeline.reduction.bring import Keep

if TYPE_CHECKING:
    from pipeline.positions.calibrate import Calibration
    from pipeline.positions.laws import JointLaw
    from pipeline.positions.study import Study

_ACROSS = 400
"""Points of a curve that is drawn."""

_LEVER = 0.05
"""Squared motion of the targets by a joint, over the median one, below which a pose says nothing of
the joint's laws [1]."""

_TOGETHER = 40
"""Groups of poses over the range of a joint."""

_CURVE = ["joint", "q", "error", "error_std", "poses"]


def identified(
    found: Study, keep: Keep, pulls: pd.DataFrame | None = None
) -> dict[str, pd.DataFrame]:
    """Tables of the laws of the joints and of the poses that were left out.

    Args:
        found: What was identified from the positions.
        keep: Keeps each table.
        pulls: Table LAWS of the pulls of the same campaign; None without any.
    """
    last, laws = found.final, _laws(found)
    every = laws if pulls is None else pd.concat([laws, pulls], ignore_index=True)
    return {
        "curves": keep("50_curves", _curves(last), promises.CURVES),
        "curve_readings": keep("51_curve_readings", _curve_readings(last), promises.CURVE_READINGS),
        "held_out": keep("60_held_out", _held_out(found), promises.HELD_OUT),
        "laws": keep("53_laws", every, promises.LAWS),
    }


def _curves(found: Calibration) -> pd.DataFrame:
    """The curves of the joints with their uncertainties, and how many poses stand there."""
    mechanism, at = found.mechanism, len(found.known.std)  # knots follow what has a scale
    parts = []
    for curve in mechanism.curves[: len(found.wanted.curves)]:
        q = np.linspace(curve.first, curve.knots[-1], _ACROSS)
        part = slice(at, at + curve.count)
        rows = curve.rows(q)
        var = np.asarray((rows @ found.solution.of(part)).T * rows.T.toarray()).sum(axis=0)
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
        determined = square > _LEVER * np.median(square)
        each = (
            curve.value(q[determined], knots)
            + np.sum(Z * left, axis=1)[determined] / square[determined]
        )
        order = np.argsort(q[determined], kind="stable")
        for group in np.array_split(order, min(_TOGETHER, max(len(order) // 3, 1))):
            error = each[group]
            std = np.std(error, ddof=1) / np.sqrt(len(group)) if len(group) > 1 else np.nan
            mean = q[determined][group].mean()
            parts.append((curve.joint + 1, mean, error.mean(), std, len(group)))
    table = pd.DataFrame(parts, columns=_CURVE)
    return table.astype({"joint": "i4", "poses": "i4"})


def _laws(whole: Study) -> pd.DataFrame:
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
        seen = np.flatnonzero(square > _LEVER * np.median(square))
        value = (law.basis(inputs) @ b)[seen]
        rest = np.sum(Z * left, axis=1)[seen] / square[seen]
        of, unit, x = _over(law, found)
        parts.append(
            pd.DataFrame(
                {
                    "cause": f"{'joint_offset' if law.once else NAME}:{law.joint}",
                    "part": np.int32(count[law.joint]),
                    "pose": readings.pose[seen].astype(np.int32),
                    "repeat": readings.series[seen].astype(np.int32),
                    "of": of,
                    "x_unit": unit,
                    "x": x[seen],
                    "is": "shift" if slides else "turn",
                    "y_unit": "m" if slides else "rad",
                    "y": value + rest,
                    "y_std": np.full(len(seen), np.std(rest)),
                    "law": value,
                }
            )
        )
    return (
        pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=promises.LAWS.names)
    )


def _over(law: JointLaw, found: Calibration) -> tuple[str, str, Array]:
    """What a law is shown over, its unit, and that of each pose."""
    x = law.of(found.linear.inputs)
    if law.variable == "time":
        return "order", "1", np.arange(1.0, len(x) + 1)
    if law.variable != "angle":
        return law.variable, {"torque": "N m", "temperature": "°C"}[law.variable], x
    slides = bool(found.mechanism.table.prismatic[(law.source or law.joint) - 1])
    return ("position", "m", x) if slides else ("angle", "rad", x)


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
