"""What speaks for each cause, and which causes look alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas

from pipeline.answer.contract import Answer
from pipeline.base.quantities import plain
from pipeline.diagnosis.facts import APART, DETECTED
from pipeline.diagnosis.finding import Verdict
from pipeline.report import words
from pipeline.report.figures.marks import Tips, dots
from pipeline.report.figures.plot import Plot
from pipeline.report.record import Figure
from pipeline.report.summaries import Tables, separability, suspects
from pipeline.report.svg import APART_SHADES, BLUE, MUTED, RED

_APART_STEPS = (1.0, 2.0, APART, 10.0)
_SQUARE = 0.14
"""Side of a square [in], with room for a line of words."""

_AS_FOUND = ", magnitudes found"

_STANDING = {
    Verdict.EXPLAINED: "identified",
    Verdict.BAD_DATA: "identified",
    Verdict.AMBIGUOUS: "likeliest",
}
"""What the causes with the largest evidence are called."""


def _draw_evidence(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """Bars of the best suspects, the identified ones in another colour."""
    best = suspects(tables["diagnosis"])
    canvas.set_size_inches(5.6, 0.9 + 0.24 * len(best))
    axes = canvas.subplots()
    at = np.arange(len(best))
    named = best["named"].to_numpy(bool)
    size = best["log_evidence"].to_numpy(float)
    axes.barh(at, size, color=np.where(named, RED, BLUE).tolist(), height=0.7, gid="evidence")
    axes.axvline(3, color=MUTED, linewidth=1, linestyle="--")
    said = [_cause_in_words(row, answer) for _, row in best.iterrows()]
    word = _STANDING.get(answer.diagnosis.verdict, "nearest")
    axes.set_yticks(at, [f"{s} ({word})" if n else s for s, n in zip(said, named, strict=True)])
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("Evidence, natural log of the odds", loc="right")
    rows = zip(said, size, named, strict=True)
    return {"evidence": [f"{s}: {plain(v, 2)}{f', {word}' if n else ''}" for s, v, n in rows]}


def _draw_separability(canvas: Canvas, answer: Answer, tables: Tables) -> Tips:
    """A triangle of squares, dark where two causes are alike."""
    apart = _compared(answer, tables)
    names, n = [words.from_label(label, answer.axes) for label in apart.index], len(apart)
    beside = 0.062 * max(map(len, names))
    canvas.set_size_inches(max(5.6, 0.4 + _SQUARE * n + beside), 0.6 + _SQUARE * n + beside)
    axes = canvas.subplots()
    rows, columns = np.tril_indices(n, -1)
    sigmas = apart.to_numpy()[rows, columns]
    steps = np.searchsorted(_APART_STEPS, sigmas, "right")
    size = 72 * _SQUARE
    found = np.isin(apart.index, apart.attrs["found"])
    tips: Tips = {}
    for step, shade in enumerate(APART_SHADES):
        here = np.flatnonzero(steps == step)
        low, high = [0, *_APART_STEPS][step], [*_APART_STEPS, None][step]
        label = f"{low:g} to {high:g} σ" if high else f"above {low:g} σ"
        style = {"s": (0.9 * size) ** 2, "marker": "s", "color": shade, "linewidths": 0}
        pairs = zip(rows[here], columns[here], sigmas[here], strict=True)
        said = [
            f"{names[i]} or {names[j]}: {plain(apart, 2)} σ{_AS_FOUND * bool(found[i] | found[j])}"
            for i, j, apart in pairs
        ]
        tips |= dots(axes, f"apart-{step}", columns[here], rows[here], said, label=label, **style)
    framed = np.flatnonzero(found[rows] | found[columns])
    if len(framed):
        axes.scatter(
            columns[framed],
            rows[framed],
            s=(0.9 * size) ** 2,
            marker="s",
            facecolors="none",
            edgecolors=BLUE,
            linewidths=1.2,
            label="magnitudes found",
        )
    axes.set_yticks(range(1, n), names[1:], fontsize=8)
    axes.set_xticks(range(n - 1), names[:-1], fontsize=8, rotation=90)
    axes.set(xlim=(-0.6, n - 1.4), ylim=(n - 0.4, 0.4))
    axes.grid(visible=False)
    axes.legend(loc="upper right", title="Apart by")
    return {key: said for key, said in tips.items() if said}


def _compared(answer: Answer, tables: Tables) -> pd.DataFrame:
    """How far the causes are apart, those of the answer at the magnitudes found."""
    named = [words.label(one).replace(" ", ":") for one in answer.diagnosis.causes]
    return separability(tables["separability"], named)


def _cause_in_words(suspect: Any, answer: Answer) -> str:
    """A row of table DIAGNOSIS in words."""
    return words.from_label(f"{suspect['name']}:{suspect['where']}", answer.axes)


def _write_evidence(answer: Answer, tables: Tables) -> Figure | None:
    best = suspects(tables["diagnosis"])
    if best.empty or best["log_evidence"].iloc[0] < 3:
        return None
    first = best.iloc[0]
    said = (
        f"Tested alone, {_cause_in_words(first, answer)} has the strongest evidence, "
        f"{plain(first['log_evidence'], 2)}; {int((best['log_evidence'] > 3).sum())} of "
        f"{len(tables['diagnosis'])} suspects exceed 3."
    )
    return Figure(
        "evidence",
        "Evidence for each suspect by itself",
        f"{said} Evidence is the natural logarithm of the odds against the joint springs alone; 3 "
        f"is 20 to 1. Suspects of similar evidence are hard to distinguish; the identified ones "
        f"are marked.",
        f"Bars of the evidence for the {len(best)} best suspects. {said}",
    )


def _apart(sigmas: float) -> str:
    """A distance; what is rounding is none."""
    return plain(sigmas, 2) if sigmas >= 0.01 else "less than 0.01"


def _magnitudes(apart: pd.DataFrame) -> str:
    """At which magnitudes the causes are compared."""
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
    close, order = int((sigmas < APART).sum()), np.argsort(sigmas, kind="stable")
    first, second = (
        words.from_label(apart.index[at[order[0]]], answer.axes) for at in (rows, columns)
    )
    said = (
        f"Of the {len(sigmas)} pairs of the {len(apart)} causes compared, {close} could not be "
        f"distinguished by these readings; the closest are {first} and {second}, "
        f"{_apart(sigmas[order[0]])} standard deviations apart."
    )
    return Figure(
        "separability",
        "Which causes these readings can distinguish",
        f"{said} {_magnitudes(apart)} Compared are the causes that at their typical magnitude are "
        f"at least {DETECTED:g} standard deviations above the scatter, so that they are almost "
        f"certainly detected. Each square is one pair. Pale: this campaign distinguishes the two. "
        f"Dark: it does not, and the pair needs another pose or another sensor. Above {APART} "
        f"standard deviations the right one is chosen in 95 % of the cases.",
        f"Triangular map of the distances between {len(apart)} causes. {said}",
    )


EVIDENCE = Plot("evidence", ("diagnosis",), _write_evidence, _draw_evidence)
SEPARABILITY = Plot("separability", ("separability",), _write_separability, _draw_separability)
