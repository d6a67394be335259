"""Sections on residuals, uncertainty budget, number of poses, registration and reliability."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from operator import attrgetter
from typing import Any

import pandas as pd

from pipeline.annex.summaries import registration_by_target
from pipeline.annex.words import parameter, size, source
from pipeline.answer.contract import (
    LEAST_CONTROLLED,
    Answer,
    BaseResiduals,
    Growth,
    NoiseComponent,
    Stiffness,
    TestPose,
)
from pipeline.answer.pose_budget import HELD_OUT
from pipeline.base.quantities import known, p_value, percent, plain, with_std
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import (
    Cells,
    Paragraph,
    ReportTable,
    Section,
    measured_column,
    number_column,
    roughly,
    section_of,
    table_of,
    word_column,
)
from pipeline.report.summaries import Tables, each_row, has


def residuals(answer: Answer, tables: Tables) -> Section | None:
    """Figures of the residuals."""
    names = ("pose-rms", "residual-force", "residual-course", "whitened", "arrows")
    return section_of("residuals", "Residuals", figures(names, answer, tables))


def enough(answer: Answer, tables: Tables) -> Section | None:
    """Whether more poses would help: uncertainty over the number of poses, and correlation."""
    names = ("enough", "correlation")
    return section_of("enough", "Are the poses enough?", figures(names, answer, tables))


def budget(answer: Answer, tables: Tables) -> Section | None:
    """Budget of the deflection at the test pose and of each stiffness, and estimated noise."""
    return section_of(
        "budget",
        "Uncertainty budget",
        [
            _pose_table(answer.test_pose),
            _budget_table(answer.stiffness),
            _calibrations(answer),
            _noise_table(answer.noise.components),
        ],
    )


_BEYOND = (
    " The cross-validation error is larger than what the model states, and u is never below it: "
    "what it has beyond the other lines is a line of its own."
)

_Line = tuple[str, float, float | None]
"""A line of the budget: source, standard uncertainty [mm], share of the variance [%]."""


def _pose_table(pose: TestPose | None) -> ReportTable | None:
    """Budget of the deflection at the test pose; its lines add in quadrature."""
    if pose is None or not pose.budget or pose.std_mm is None:
        return None
    u = pose.std_mm
    lines: list[_Line] = [
        (source(part.source), part.std_mm, 100 * (part.std_mm / u) ** 2) for part in pose.budget
    ]
    lines += [("combined standard uncertainty u", u, None)]
    lines += [("expanded uncertainty U (k = 2)", 2 * u, None)]
    digits = max(0, 3 - math.floor(math.log10(u)))  # four digits of u, so that the squares add up
    columns: list[Cells[_Line]] = [
        word_column("Source", lambda line: line[0]),
        number_column("Standard uncertainty [mm]", lambda line: line[1], partial(_fixed, digits)),
        number_column("Share of variance [%]", lambda line: line[2], _percent),
    ]
    note = (
        "Along the deflection of the load point; u is the root of the sum of the squares above it."
        + _BEYOND * any(part.source == HELD_OUT for part in pose.budget)
    )
    title = "Uncertainty of the deflection at the test pose"
    return table_of("pose-budget", title, columns, lines, note)


def _fixed(digits: int, value: float | None) -> str:
    """A number with this many decimals, or `below 0.01` if it is less than one unit of the last."""
    least = 10.0**-digits
    small = value is None or value < least
    return f"below {least:.{digits}f}" if small else f"{value:.{digits}f}"


def _budget_table(joints: Sequence[Stiffness]) -> ReportTable | None:
    columns: list[Cells[str]] = [
        word_column("Source", source),
        *(_shares_of(joint) for joint in joints if joint.budget),
    ]
    sources = dict.fromkeys(part.source for joint in joints for part in joint.budget)
    note = (
        "Shares of the variance of each stiffness; result.json has the standard uncertainties in "
        "its unit. A calibration of which campaign.toml states no "
        "uncertainty has no line."
    )
    return table_of("budget", "Uncertainty of each stiffness", columns, sources, note)


def _shares_of(joint: Stiffness) -> Cells[str]:
    shares = {part.source: 100 * part.share for part in joint.budget}
    return number_column(f"{joint.axis or joint.name} [%]", shares.get, _percent)


def _percent(share: float | None) -> str:
    return "below 0.1" if share is not None and share < 0.1 else roughly(share)


def _calibrations(answer: Answer) -> Paragraph | None:
    """Whether the budget includes calibrations and day-to-day scatter; None without a budget."""
    sources = {part.source for joint in answer.stiffness for part in joint.budget}
    if not sources:
        return None
    texts = [
        f"{name}: {'in the budget' if source in sources else missing}."
        for source, name, missing in _CALIBRATED
    ]
    seen = answer.day_to_day
    days = (
        "Day-to-day scatter: not known, no pose was repeated on another day."
        if seen is None
        else f"Day-to-day scatter: {percent(seen.relative_std)} of the displacements, from "
        f"{seen.poses} poses repeated on another day ({p_value(seen.p_value)})."
    )
    return Paragraph(" ".join((*texts, days)))


_CALIBRATED = (
    (
        "force_gain",
        "Calibration of the scale (ISO 376)",
        "not stated; give gain_sigma in [scale] of campaign.toml",
    ),
    (
        "tracker_scale",
        "Calibration of the tracker (ISO 10360-10)",
        "not stated; give length_sigma_rel in [instrument] of campaign.toml",
    ),
)
"""Sources of error that calibration certificates state: name in the budget, name in words, and what
to do if none is stated."""


def _noise_table(found: Sequence[NoiseComponent]) -> ReportTable | None:
    columns: list[Cells[NoiseComponent]] = [
        word_column("Noise of", lambda one: source(one.name)),
        measured_column("Estimated over stated", lambda one: (one.found_over_stated, one.std)),
        number_column("p-value", lambda one: one.p_value, p_value),
    ]
    note = (
        "Estimated from repeated readings, repeated zeros and the distances between the "
        "effector's reflectors; 1 means as stated."
    )
    title = "Estimated and stated noise of the readings"
    return table_of("noise", title, columns, found, note)


def registration(answer: Answer, tables: Tables) -> Section | None:
    """Residuals of the base reflectors after registration."""
    given = answer.registration
    return section_of(
        "registration",
        "Registration of the tracker",
        [
            None if given is None else _registration_text(given),
            _reflectors(tables),
            *figures(("registration",), answer, tables),
        ],
    )


def _reflectors(tables: Tables) -> ReportTable | None:
    if not has(tables, "registration"):
        return None
    parts = {"mean dx": "dx", "mean dy": "dy", "mean dz": "dz", "rms": "rms", "largest": "largest"}
    columns: list[Cells[Any]] = [
        word_column("Base reflector", lambda row: row.target),
        number_column("Readings", lambda row: row.readings, str),
        *(number_column(f"{name} [mm]", attrgetter(part), roughly) for name, part in parts.items()),
    ]
    rows = each_row(registration_by_target(tables["registration"]))
    title = "Base reflectors: measured minus nominal, base frame"
    return table_of("registration", title, columns, rows)


def _registration_text(given: BaseResiduals) -> Paragraph:
    rotation, translation = max(given.rotation_std_rad), max(given.translation_std_m)
    tested = "" if given.p_value is None else f" ({p_value(given.p_value)})"
    chi2 = f" chi² is {plain(given.chi2, 4)} for {given.dof} degrees of freedom{tested}."
    return Paragraph(
        f"The base reflectors fit their nominals to {plain(given.rms_mm)} mm rms, "
        f"{plain(given.max_mm)} mm at worst.{'' if given.chi2 is None else chi2} The standard "
        f"uncertainty of its orientation is {plain(1e6 * rotation, 2)} µrad. That of its origin is "
        f"{plain(1e6 * translation, 2)} µm.{_growth_text(given.growth)}"
    )


def _growth_text(grown: Growth | None) -> str:
    """Sentence on the thermal growth of the base frame; empty if none was found."""
    if grown is None:
        return ""
    from_what = (
        "the temperature and its reflectors" if grown.expected is not None else "its reflectors"
    )
    size = with_std(1e3 * grown.value, 1e3 * grown.std)
    return f" A metre of the base frame is longer by {size} mm, by {from_what}."


def reliability(answer: Answer, tables: Tables) -> Section | None:
    """Readings with the lowest redundancy, and the effect of an undetected error in one of them."""
    if not has(tables, "reliability"):
        return None
    single = tables["reliability"].dropna(subset=["reading"])
    most = [parameter(answer, str(name)) for name in single["moves_most"]]
    single = single.assign(moves_most=most)
    return section_of("reliability", "Reliability of the readings", [_harm(single), _least(single)])


def _harm(single: pd.DataFrame) -> Paragraph | None:
    """The reading whose undetected error shifts a parameter most, in standard uncertainties."""
    if single.empty:
        return None
    row = next(each_row(single.nlargest(1, "moves_sigmas")))
    who = f"{row.reading}{f' along {row.axis}' if known(row.axis) else ''}"
    bias = size(row.smallest_visible, row.unit)
    if not known(row.moves_sigmas):
        return Paragraph(
            f"{who} is an uncontrolled observation: no other reading checks it, and any error in "
            f"it shifts {row.moves_most}."
        )
    return Paragraph(
        f"An undetected error does most harm in {who}: one of up to {bias} may go unnoticed "
        f"and shift {row.moves_most} by {plain(row.moves_sigmas, 2)} standard uncertainties."
    )


def _least(single: pd.DataFrame) -> ReportTable | None:
    columns: list[Cells[Any]] = [
        word_column("Reading", lambda row: row.reading),
        word_column("Of", lambda row: source(row.source)),
        word_column("Along", lambda row: row.axis),
        number_column("Redundancy", lambda row: row.r, roughly),
        number_column("w", lambda row: row.w, roughly),
        word_column("Minimal detectable bias", lambda row: size(row.smallest_visible, row.unit)),
        number_column("Shifts by [σ]", lambda row: row.moves_sigmas, roughly),
        word_column("Which", lambda row: row.moves_most),
    ]
    rows = each_row(single.nsmallest(LEAST_CONTROLLED, "r"))
    note = (
        "Redundancy is the part of an error that the residuals show, 0 to 1. The minimal "
        "detectable bias is found in 80 % of the cases at 0.1 % false alarms; the last two "
        "columns say what one so large moves most, in standard uncertainties. All readings "
        'are in results.xlsx, sheet "reliability".'
    )
    return table_of("reliability", "Readings with the lowest redundancy", columns, rows, note)
