"""How the identified causes move the robot."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.annex.figures.certificate import REACH, WIDE, arm_of, draw_causes
from pipeline.annex.figures.sheet import FROM, TO, PixelSheet
from pipeline.answer.contract import Answer
from pipeline.answer.words import capital
from pipeline.base.quantities import MM, plain
from pipeline.report import words
from pipeline.report.figures.plot import Plot
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables
from pipeline.report.svg import RED

_LEAST_M = 1e-9
"""Largest motion by the causes below which it is treated as zero [m]."""


def _ghost(tables: Tables) -> tuple[pd.DataFrame, float]:
    """Table POSTURE displaced by the causes alone, magnified, and the magnification [1].

    The table is empty if the causes do not move the robot.
    """
    rows = tables["posture"]
    by = {
        end: rows[[f"{end}_caused_{a}_m" for a in "xyz"]].to_numpy(float) for end in ("from", "to")
    }
    most = max(float(np.linalg.norm(one, axis=1).max()) for one in by.values())
    if most < _LEAST_M:
        return rows.iloc[:0], 1.0
    size = float(np.ptp(rows[rows["part"] != "base"][FROM].to_numpy(float), axis=0).max())
    times = 10.0 ** np.floor(np.log10(REACH * size / most))
    times *= max(m for m in (1, 2, 5) if m * times * most <= REACH * size)
    moved = rows.copy()
    for end, columns in (("from", FROM), ("to", TO)):
        moved[columns] = rows[columns].to_numpy(float) + times * by[end]
    return moved[moved["part"].isin(("carriage", "arm", "tool"))], float(times)


def _draw(answer: Answer, tables: Tables) -> str:
    """Draw the arm at the test pose, and an outline of it displaced by the causes, magnified."""
    sheet = PixelSheet(WIDE, 330)
    arm = arm_of(tables, 316, 14)
    arm.bodies(sheet, arm.solid, stroke_opacity=0.8)
    ghost, _ = _ghost(tables)
    arm.bodies(sheet, ghost, fill="none", stroke=RED, stroke_width=1.6)
    ends = (tables["posture"].loc[ghost.index[-4:]], ghost.iloc[-4:])
    for a, b in zip(*(arm(one[TO].to_numpy(float)) for one in ends), strict=True):
        sheet.line(a, b, RED, 1.2, stroke_dasharray="3 3")
    draw_causes(sheet, arm, answer)
    return sheet.svg


def _write(answer: Answer, tables: Tables) -> Figure | None:
    ghost, times = _ghost(tables)
    causes = [words.placed(one) for one in answer.diagnosis.causes if not one.evidence]
    pose = answer.test_pose
    if ghost.empty or not causes or pose is None:
        return None
    tip = tables["posture"][tables["posture"]["name"] == "load_point"]
    moved = tip[[f"to_caused_{a}_m" for a in "xyz"]].to_numpy(float)[0]
    text = (
        f"{capital(' and '.join(causes))} alone {'moves' if len(causes) == 1 else 'move'} the load "
        f"point by {plain(MM * float(np.linalg.norm(moved)))} mm at the test pose."
    )
    return Figure(
        "motion",
        "What gives way, and how the robot moves with it",
        f"{text} Orange: the same, {times:,.0f} times magnified.",
        f"Drawing of the robot with an outline of where the identified causes move it. {text}",
    )


MOTION = Plot("motion", ("posture",), _write, by_hand=_draw)
