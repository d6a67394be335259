"""Outbuilding: the figures behind the first page of a report, each in a file with its words.

The report draws its certificate, the stiffnesses and the cell itself; what an engineer looks at
when a number is doubted stands here: residuals, rivals, laws, cross-validation, where the robot was
and what it would do elsewhere. Without this folder a report has its tables and sentences.

Door: `PLOTS`.
Tests: `tests/report/`, for whole pages.
"""

from __future__ import annotations

import pipeline.report.svg  # noqa: F401  # imports Matplotlib, before a figure does
from pipeline.annex import (
    causes,
    enough,
    geometry,
    heldout,
    laws,
    models,
    places,
    prediction,
    residuals,
    tolerance,
    workspace,
)
from pipeline.report.figures.plot import Plot

PLOTS: tuple[Plot, ...] = (
    heldout.HELD_OUT,
    prediction.PREDICTION,
    prediction.MEASURED,
    models.MODELS,
    causes.EVIDENCE,
    causes.SEPARABILITY,
    laws.LAWS,
    enough.ENOUGH,
    enough.CORRELATION,
    residuals.POSE_RMS,
    residuals.RESIDUAL_FORCE,
    residuals.RESIDUAL_COURSE,
    residuals.WHITENED,
    places.ARROWS,
    tolerance.PATH,
    workspace.WORKSPACE,
    workspace.WORKSPACE_JOINT_SPRINGS,
    places.REGISTRATION,
    geometry.POSITION_STEPS,
    geometry.CURVES,
)
"""One line each."""
