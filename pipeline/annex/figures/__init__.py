"""The figures: each module writes the texts of its figures and draws them, from the same data."""

from __future__ import annotations

import pipeline.report.svg  # noqa: F401  # imports Matplotlib, before a figure does
from pipeline.annex.figures import (
    causes,
    certificate,
    enough,
    geometry,
    heldout,
    laws,
    models,
    motion,
    places,
    prediction,
    residuals,
    scene,
    stiffness,
    tolerance,
    workspace,
)
from pipeline.report.figures.plot import Plot

PLOTS: tuple[Plot, ...] = (
    certificate.CERTIFICATE,
    certificate.GAUGE,
    motion.MOTION,
    stiffness.STIFFNESS,
    scene.SCENE,
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
"""Every figure of a report: the two of its first page, and those after it."""
