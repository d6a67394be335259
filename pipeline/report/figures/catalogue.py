"""Every figure of the report, one line each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pipeline.answer.contract import Answer
from pipeline.base.language import Say
from pipeline.report.figures import (
    causes,
    certificate,
    enough,
    geometry,
    heldout,
    laws,
    models,
    places,
    prediction,
    residuals,
    scene,
    stiffness,
    tolerance,
    workspace,
)
from pipeline.report.figures.plot import Plot
from pipeline.report.record import Figure, present
from pipeline.report.summaries import Tables, has
from pipeline.report.svg import Drawing, by_hand, drawn

CATALOGUE: tuple[Plot, ...] = (
    certificate.CERTIFICATE,
    certificate.GAUGE,
    certificate.MOTION,
    heldout.HELD_OUT,
    stiffness.STIFFNESS,
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
    scene.SCENE,
    tolerance.PATH,
    workspace.WORKSPACE,
    workspace.WORKSPACE_JOINT_SPRINGS,
    places.REGISTRATION,
    geometry.POSITION_STEPS,
    geometry.CURVES,
)
_PLOTS = {plot.name: plot for plot in CATALOGUE}


def figures(names: Sequence[str], answer: Answer, tables: Tables) -> list[Figure]:
    """The figures of these names that this campaign has data for."""
    plots = [_PLOTS[name] for name in names]
    return list(present(one.write(answer, tables) for one in plots if has(tables, *one.needs)))


def draw(name: str, answer: Answer, tables: Tables, say: Say = str) -> Drawing:
    """Draw one of the figures of the report, the words of the certificate's in a language."""
    plot = _PLOTS[name]
    if plot.spoken:
        return by_hand(plot.spoken(answer, tables, say))
    if plot.by_hand:
        return by_hand(plot.by_hand(answer, tables))
    return drawn(name, lambda canvas: plot.draw(canvas, answer, tables))


def live(name: str, answer: Answer, tables: Tables) -> dict[str, Any] | None:
    """The numbers of a figure that the page itself draws; None for a still."""
    of = _PLOTS[name].live
    return of and of(answer, tables)
