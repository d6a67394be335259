"""Error of each model at held-out poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.annex.figures.sheet import PixelSheet
from pipeline.annex.summaries import rms_of_poses
from pipeline.answer.contract import Answer, Validation, Which
from pipeline.answer.words import capital
from pipeline.base.arrays import Array
from pipeline.base.linear import rms
from pipeline.base.quantities import known, plain
from pipeline.report import words
from pipeline.report.figures.plot import Plot
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, has
from pipeline.report.svg import BLUE, GREEN, GRID, MUTED, RED

_WIDE, _LEFT, _RIGHT, _ROW, _TOP = 560.0, 16.0, 500.0, 56.0, 34.0
"""Width of the sheet, left and right ends of the scale, height of a row, height above the first row
[px]."""

_LEAST_MM = 1e-4
"""Smallest error on the scale [mm]."""


@dataclass(frozen=True, eq=False)
class _ModelAtHeldOut:
    """One model at held-out poses.

    Attributes:
        name: Name of the model.
        poses: Columns pose and mm, the rms error per coordinate of each pose.
        mm: Rms error of all poses [mm]; the value stated by the answer if there is one.
        colour: Colour of the drawing.
    """

    name: str
    poses: pd.DataFrame
    mm: float
    colour: str


def judged(answer: Answer, tables: Tables) -> list[_ModelAtHeldOut]:
    """The models in the order nominal, joint springs, recommended."""
    found: list[_ModelAtHeldOut | None] = []
    if has(tables, "models"):
        models = tables["models"].assign(off_m=lambda t: t["measured_m"] - t["nominal_m"])
        found += [_judged("nominal stiffnesses of the robot file", models, "off_m", None, MUTED)]
    if has(tables, "examined"):
        stated = answer.joint_springs.validation
        name = "joint springs, as in the paper"
        found += [_judged(name, tables["examined"], "left_out_m", stated, BLUE)]
    if has(tables, "residuals") and answer.recommended.model is not Which.JOINT_SPRINGS:
        name = f"joint springs {words.MODELS[answer.recommended.model]}"
        if answer.recommended.model is Which.AVERAGED:
            name = words.MODELS[answer.recommended.model]
        found += [_judged(name, tables["residuals"], "left_out_m", answer.validation, GREEN)]
    return [one for one in found if one is not None]


def _judged(
    name: str, rows: pd.DataFrame, column: str, stated: Validation | None, colour: str
) -> _ModelAtHeldOut | None:
    poses = rms_of_poses(rows, mm=column).dropna()
    if poses.empty:
        return None
    own = stated.held_out_rms_mm if stated else None
    return _ModelAtHeldOut(name, poses, own if known(own) else rms(poses["mm"].to_numpy()), colour)


def _draw(answer: Answer, tables: Tables) -> str:
    """Draw a row of dots per model, one for each pose, and a bar at their rms."""
    models, noise = judged(answer, tables), answer.diagnosis.noise_floor_mm
    foot = _TOP + _ROW * len(models)
    sheet = PixelSheet(_WIDE, foot + 44)
    every = np.concatenate([one.poses["mm"].to_numpy(float) for one in models])
    size = [*every, *(one.mm for one in models), *([noise] if noise else [])]
    ends = (max(0.8 * min(size), _LEAST_MM), 1.15 * max(size))

    def at(mm: float) -> float:
        return float(_placed(mm, ends, (_LEFT, _RIGHT)))

    for mark in _decades(*ends):
        sheet.line((at(mark), _TOP), (at(mark), foot), GRID, 1)
        sheet.text(at(mark), foot + 16, f"{mark:g}", 12, text_anchor="middle")
    if noise:
        sheet.line((at(noise), _TOP - 8), (at(noise), foot), RED, 2, stroke_dasharray="5 4")
        side = "start" if at(noise) < 0.6 * _RIGHT else "end"
        sheet.text(at(noise), _TOP - 14, "noise of the readings", 12, fill=RED, text_anchor=side)
    for k, one in enumerate(models):
        _row(sheet, one, _TOP + _ROW * k, at)
    sheet.text(
        _LEFT,
        foot + 36,
        "Error at poses that took no part [mm], rms per coordinate, logarithmic",
        12,
    )
    return sheet.svg


def _row(sheet: PixelSheet, one: _ModelAtHeldOut, top: float, at: Callable[[float], float]) -> None:
    """Draw dots, bar and name of one model."""
    y = top + 38
    sheet.line((_LEFT, y), (_RIGHT, y), GRID, 1)
    for pose, mm in one.poses[["pose", "mm"]].itertuples(index=False):
        tip = f"pose {int(pose)} left out, {one.name}: {plain(mm)} mm"
        sheet.disc((at(mm), y), 4, tip, fill=one.colour, fill_opacity=0.55)
    sheet.line((at(one.mm), y - 11), (at(one.mm), y + 11), one.colour, 4)
    sheet.text(_LEFT, top + 18, one.name, 13)
    sheet.text(_WIDE - 4, y + 5, f"{plain(one.mm)}", 14, text_anchor="end", font_weight="bold")


def _write(answer: Answer, tables: Tables) -> Figure | None:
    models, noise = judged(answer, tables), answer.diagnosis.noise_floor_mm
    if not models or answer.of_positions:
        return None
    text = f"{'; '.join(f'{one.name} {plain(one.mm)} mm' for one in models)}."
    floor = f" The noise of the readings alone makes {plain(noise)} mm." if noise else ""
    return Figure(
        "held-out",
        "Error at poses that took no part",
        f"{capital(text)}{floor}{_better(models)} Each pose is predicted from all others, the "
        "causes chosen anew without it; a dot is a pose, a bar the rms of all.",
        f"Dots of the error at each pose, a row for each model. {text}{floor}",
    )


def _better(models: Sequence[_ModelAtHeldOut]) -> str:
    """Number of poses that the last model predicts better than the one before it."""
    if len(models) < 2:
        return ""
    before, after = models[-2:]
    both = before.poses.merge(after.poses, on="pose", suffixes=("_before", "_after"))
    better = int((both["mm_after"] < both["mm_before"]).sum())
    worst = both.iloc[int(both["mm_before"].argmax())]
    return (
        f" The last model predicts {better} of {len(both)} poses better than the one above it; at "
        f"pose {int(worst['pose'])}, the worst, {plain(worst['mm_after'])} mm in place of "
        f"{plain(worst['mm_before'])} mm."
    )


HELD_OUT = Plot("held-out", (), _write, by_hand=_draw)


def _decades(low: float, high: float) -> list[float]:
    """Marks 1, 2, 5 times a power of ten between two values."""
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    every = [m * 10.0**p for p in powers for m in (1, 2, 5)]
    return [one for one in every if low * 0.999 <= one <= high * 1.001]


def _placed(values: Any, ends: tuple[float, float], pixels: tuple[float, float]) -> Array:
    """Places of values on a logarithmic scale [px], clipped to its ends."""
    low, high = np.log10(ends)
    share = (np.log10(np.clip(np.asarray(values, float), *ends)) - low) / (high - low)
    return np.asarray(pixels[0] + share * (pixels[1] - pixels[0]))
