"""Measurement sheet of a proposal as page, PDF, workbook and pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.annex.words import axes_of
from pipeline.base.language import Language, Say, spoken, translated
from pipeline.base.quantities import MM
from pipeline.design.control import controls
from pipeline.design.curves import ByAnchor, BySize, by_anchor, by_size
from pipeline.design.plan_book import book
from pipeline.design.plan_figures import anchor_curve, pose_picture, sight_chart, size_curves
from pipeline.design.plan_sheet import SheetExtras, sheet
from pipeline.design.propose import BoundedPlan
from pipeline.report.render import page, pdf
from pipeline.report.svg import Drawing

_SIZES = (3, 4, 6, 12)
"""Numbers of poses and of readings of Table II."""
_PLACES = 9
"""Number of anchor positions along an axis that the sheet shows."""
_FREE = 0.9
"""Fraction of the largest allowed uncertainty [1]: a plan below it is the best one without that
limit, too."""


def plan_files(
    proposal: BoundedPlan, seconds: float, seed: int, language: Language = Language.EN
) -> dict[str, bytes]:
    """Every file of a measurement sheet.

    Args:
        proposal: The plan.
        seconds: Duration of its search.
        seed: Of the searches for the curves.
        language: Of the sheet.

    Returns:
        Content by path: sheet.html, sheet.pdf, sheet.xlsx, figures/*.svg.
    """
    extras = SheetExtras(
        proposal.sights(),
        _sizes(proposal, seed),
        _anchors(proposal, seed),
        controls(proposal.problem, proposal.measurement),
    )
    say = spoken(language)
    report = translated(sheet(proposal, extras, seconds), say)
    report = replace(report, frame=replace(report.frame, language=language.value))
    drawings = _drawn(proposal, extras, say)
    return {
        "sheet.html": page(report, {n: d.inline for n, d in drawings.items()}).encode(),
        "sheet.xlsx": book(proposal, say),
        "sheet.pdf": pdf(report, {n: d.svg for n, d in drawings.items()}),
        **{f"figures/{n}.svg": d.svg.encode() for n, d in drawings.items()},
    }


def _sizes(proposal: BoundedPlan, seed: int) -> BySize | None:
    """Curves by size, if one search is quick and readings are independent, as in the paper."""
    problem, plan = proposal.problem, proposal.plan
    if problem.experiment.scatter.zero or proposal.mixed is not None:
        return None
    limited = plan.relative_std.max() > _FREE * problem.limits.max_relative_std
    own = plan if len(problem.spec.pull.steps_n) == 1 and not limited else None
    return by_size(problem, _SIZES, _SIZES, seed, own=own)


def _anchors(proposal: BoundedPlan, seed: int) -> ByAnchor | None:
    """Curve along the first free coordinate of the anchor."""
    problem = proposal.problem
    if not problem.free.any() or proposal.mixed is not None:
        return None
    axis = int(np.argmax(problem.free))
    at = np.linspace(problem.anchor_lower[axis], problem.anchor_upper[axis], _PLACES)
    return by_anchor(problem, proposal.plan, at, seed, axis)


def _drawn(proposal: BoundedPlan, extras: SheetExtras, say: Say) -> dict[str, Drawing]:
    problem, measurement = proposal.problem, proposal.measurement
    out = {
        f"pose-{number + 1}": pose_picture(problem, measurement, number, say)
        for number in range(len(measurement.q))
    }
    out["sights"] = sight_chart(extras.sights, axes_of(proposal.problem.robot))
    scale, unit = (MM, " [mm]") if problem.criterion.unit == "m" else (1.0, "")
    label = f"{problem.criterion.meaning[0].upper()}{problem.criterion.meaning[1:]}{unit}"
    if extras.sizes is not None:
        out["size"] = size_curves(extras.sizes, scale, label)
    if extras.anchors is not None:
        out["anchor"] = anchor_curve(extras.anchors, scale, label)
    return out
