"""Every figure of the report by its name; captions.py writes what stands below each."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from matplotlib.figure import Figure as Canvas

from pipeline.answer.history import robots
from pipeline.report.figures.causes import draw_evidence, draw_gain, draw_separability
from pipeline.report.figures.marks import Tips
from pipeline.report.figures.places import draw_arrows, draw_registration
from pipeline.report.figures.prediction import draw_prediction
from pipeline.report.figures.residuals import (
    draw_pose_rms,
    draw_residual_course,
    draw_residual_force,
    draw_whitened,
)
from pipeline.report.figures.stiffness import draw_history, draw_stiffness
from pipeline.report.figures.workspace import draw_workspace, draw_workspace_joint_springs
from pipeline.report.summaries import Result, Tables
from pipeline.report.svg import Drawing, drawn

DRAWERS: dict[str, Callable[[Canvas, Result, Tables], Tips]] = {
    "stiffness": draw_stiffness,
    "prediction": draw_prediction,
    "gain": draw_gain,
    "evidence": draw_evidence,
    "separability": draw_separability,
    "pose-rms": draw_pose_rms,
    "residual-force": draw_residual_force,
    "residual-course": draw_residual_course,
    "whitened": draw_whitened,
    "arrows": draw_arrows,
    "workspace": draw_workspace,
    "workspace-joint-springs": draw_workspace_joint_springs,
    "registration": draw_registration,
}


def draw(name: str, result: Result, tables: Tables) -> Drawing:
    """Draw one of the figures of the report."""
    return drawn(name, lambda canvas: DRAWERS[name](canvas, result, tables))


def draw_robot(name: str, results: Sequence[Result]) -> Drawing:
    """Draw the history of one robot: `history-0` is that of the first of `robots`."""
    own = list(robots(results).values())[int(name.rpartition("-")[2])]
    return drawn(name, lambda canvas: draw_history(canvas, own))
