"""Figures of the evidence for each suspect, and of causes that cannot be distinguished."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas

from pipeline.annex.figures.sheet import PixelSheet
from pipeline.annex.summaries import separability, suspects
from pipeline.annex.words import from_label, label
from pipeline.answer.contract import Answer
from pipeline.base.quantities import plain
from pipeline.diagnosis.facts import DETECTED, SEPARATED
from pipeline.diagnosis.finding import Verdict
from pipeline.report.figures.plot import Plot, Tips
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables
from pipeline.report.svg import APART_SHADES, BLUE, MUTED, RED

_APART_STEPS = (1.0, 2.0, SEPARATED, 10.0)
_SIDE, _LETTER, _KEY = 15.0, 6.3, 150.0
"""Side of a square, high enough for a line of text; width of a letter; width of the key [px]."""

_AS_FOUND = ", magnitudes found"

_STANDING = {
    Verdict.EXPLAINED: "identified",
    Verdict.BAD_DATA: "identified",
    Verdict.AMBIGUOUS: "likeliest",
}
"""How causes named by the answer are marked, by verdict."""


def _draw_evidence(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Draw bars for the suspects with the most evidence, those named by the answer in red."""
    best = suspects(tables["diagnosis"])
    canvas.set_size_inches(5.6, 0.9 + 0.24 * len(best))
    axes = canvas.subplots()
    at = np.arange(len(best))
    named = best["named"].to_numpy(bool)
    size = best["log_evidence"].to_numpy(float)
    axes.barh(at, size, color=np.where(named, RED, BLUE).tolist(), height=0.7, gid="evidence")
    axes.axvline(3, color=MUTED, linewidth=1, linestyle="--")
    labels = [_cause_in_words(row, answer) for _, row in best.iterrows()]
    word = _STANDING.get(answer.diagnosis.verdict, "nearest")
    axes.set_yticks(at, [f"{s} ({word})" if n else s for s, n in zip(labels, named, strict=True)])
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("Evidence, natural log of the odds", loc="right")
    rows = zip(labels, size, named, strict=True)
    return {"evidence": [f"{s}: {plain(v, 2)}{f', {word}' if n else ''}" for s, v, n in rows]}


def _draw_separability(answer: Answer, tables: Tables) -> str:
    """Draw a triangle of squares, dark where two causes cannot be distinguished."""
    apart = _compared(answer, tables)
    names, n = [from_label(label, answer.axes) for label in apart.index], len(apart)
    beside = _LETTER * max(map(len, names)) + 8
    sheet = PixelSheet(beside + max(_SIDE * n, _KEY), _SIDE * n + beside)
    found = np.isin(apart.index, apart.attrs["found"])
    for i, j in zip(*np.tril_indices(n, -1), strict=True):
        sigmas, framed = float(apart.to_numpy()[i, j]), bool(found[i] | found[j])
        x, y = beside + _SIDE * j, _SIDE * (i - 1)
        shade = APART_SHADES[int(np.searchsorted(_APART_STEPS, sigmas, "right"))]
        frame = {"stroke": BLUE, "stroke_width": 1.2} if framed else {}
        tip = f"{names[i]} or {names[j]}: {plain(sigmas, 2)} σ{_AS_FOUND * framed}"
        sheet.square(x, y, 0.9 * _SIDE, tip, fill=shade, **frame)
    for k in range(1, n):
        sheet.text(beside - 5, _SIDE * (k - 0.3), names[k], 11, text_anchor="end")
        across, foot = float(beside + _SIDE * (k - 0.3)), _SIDE * (n - 1) + 5
        turned = {"transform": f"rotate(-90 {across:.1f} {foot:.1f})", "text_anchor": "end"}
        sheet.text(across, foot, names[k - 1], 11, **turned)
    _apart_key(sheet, bool(found.any()))
    return sheet.svg


def _apart_key(sheet: PixelSheet, framed: bool) -> None:
    """Draw the key of the shades in the empty corner."""
    x = sheet.width - _KEY + 8
    ends = [*map(str, (0, *(f"{one:g}" for one in _APART_STEPS)))]
    labels = [f"{low} to {high} σ" for low, high in pairwise(ends)] + [f"above {ends[-1]} σ"]
    sheet.text(x, 14, "Apart by", 12, font_weight="bold")
    for k, (text, shade) in enumerate(zip(labels, APART_SHADES, strict=True), 1):
        sheet.square(x, 18 * k + 4, 12, fill=shade)
        sheet.text(x + 18, 18 * k + 15, text, 12)
    if framed:
        sheet.square(x, 112, 12, fill="none", stroke=BLUE, stroke_width=1.2)
        sheet.text(x + 18, 123, "magnitudes found", 12)


def _compared(answer: Answer, tables: Tables) -> pd.DataFrame:
    """Distances between the causes [standard deviations], those of the answer as large as found."""
    named = [label(one).replace(" ", ":") for one in answer.diagnosis.causes]
    return separability(tables["separability"], named)


def _cause_in_words(suspect: Any, answer: Answer) -> str:
    """A row of table DIAGNOSIS in words."""
    return from_label(f"{suspect['name']}:{suspect['where']}", answer.axes)


def _write_evidence(answer: Answer, tables: Tables) -> Figure | None:
    best = suspects(tables["diagnosis"])
    if best.empty or best["log_evidence"].iloc[0] < 3:
        return None
    first = best.iloc[0]
    text = (
        f"Tested alone, {_cause_in_words(first, answer)} has the strongest evidence, "
        f"{plain(first['log_evidence'], 2)}; {int((best['log_evidence'] > 3).sum())} of "
        f"{len(tables['diagnosis'])} suspects exceed 3."
    )
    return Figure(
        "evidence",
        "Evidence for each suspect by itself",
        f"{text} Evidence is the natural logarithm of the odds against the joint springs alone; 3 "
        f"is 20 to 1. Suspects of similar evidence are hard to distinguish; the identified ones "
        f"are marked.",
        f"Bars of the evidence for the {len(best)} best suspects. {text}",
    )


def _apart(sigmas: float) -> str:
    """A distance in standard deviations; below 0.01 it is rounding."""
    return plain(sigmas, 2) if sigmas >= 0.01 else "less than 0.01"


def _magnitudes(apart: pd.DataFrame) -> str:
    """Sentence on the magnitudes at which the causes are compared."""
    if not apart.attrs["found"]:
        return "All are compared at their typical magnitudes."
    return (
        "Framed: pairs with an identified cause, at the magnitude that these readings give, as in "
        "the verdict; all others at typical magnitudes."
    )


def _write_separability(answer: Answer, tables: Tables) -> Figure | None:
    apart = _compared(answer, tables)
    if len(apart) < 2:
        return None
    rows, columns = np.tril_indices(len(apart), -1)
    sigmas = apart.to_numpy()[rows, columns]
    close, order = int((sigmas < SEPARATED).sum()), np.argsort(sigmas, kind="stable")
    first, second = (from_label(apart.index[at[order[0]]], answer.axes) for at in (rows, columns))
    text = (
        f"Of the {len(sigmas)} pairs of the {len(apart)} causes compared, {close} could not be "
        f"distinguished by these readings; the closest are {first} and {second}, "
        f"{_apart(sigmas[order[0]])} standard deviations apart."
    )
    return Figure(
        "separability",
        "Which causes these readings can distinguish",
        f"{text} {_magnitudes(apart)} Compared are the causes that at their typical magnitude are "
        f"at least {DETECTED:g} standard deviations above the scatter, so that they are almost "
        f"certainly detected. Each square is one pair. Pale: this campaign distinguishes the two. "
        f"Dark: it does not, and the pair needs another pose or another sensor. Above {SEPARATED} "
        f"standard deviations the right one is chosen in 95 % of the cases.",
        f"Triangular map of the distances between {len(apart)} causes. {text}",
    )


EVIDENCE = Plot("evidence", ("diagnosis",), _write_evidence, _draw_evidence)
SEPARABILITY = Plot(
    "separability", ("separability",), _write_separability, by_hand=_draw_separability
)
