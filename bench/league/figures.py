"""The league's figures: power curves, and confusion matrix."""

from __future__ import annotations

import io
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib import rc_context
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from bench.league.hidden import SECRETS
from bench.league.run import KNOWN_LABELS, STEPS, Played
from bench.league.table import MEASURES, curve, interval
from pipeline.report.svg import BLUE, GREEN, INK, MUTED, RED, SHADES, STYLE

mpl.use("Agg")

OTHERWISE = ("other or several names", "no name", "adequate")
"""Columns of the confusion matrix in addition to the names."""


def figures(games: Sequence[Played]) -> dict[str, bytes]:
    """File name -> SVG, on white."""
    with rc_context(STYLE):
        return {
            "league-power.svg": _svg(_power(games)),
            "league-confusion.svg": _svg(_confusion(games)),
        }


def _svg(canvas: Figure) -> bytes:
    text = io.BytesIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    canvas.savefig(text, format="svg", metadata=nothing, facecolor="white")
    return text.getvalue()


def _power(games: Sequence[Played]) -> Figure:
    canvas = Figure(figsize=(6.4, 3.6))
    axes = canvas.subplots()
    mine = [g for g in games if g.kind == "power" and g.scores]
    count = np.array([sum(g.times == times for g in mine) for times in STEPS])
    predicted = 100 * curve(mine, lambda g: g.power)
    axes.plot(STEPS, predicted, color=MUTED, linestyle="--", label="predicted to be detected")
    marks = zip(MEASURES, (BLUE, GREEN, RED), "os^", strict=True)
    for (name, hit), colour, marker in marks:
        shares = curve(mine, hit)
        ends = [
            interval(round(s * n), n) if n else (s, s) for s, n in zip(shares, count, strict=True)
        ]
        low, high = 100 * np.array(ends).T
        axes.plot(STEPS, 100 * shares, color=colour, marker=marker, markersize=5, label=name)
        axes.fill_between(STEPS, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.axvline(1.0, color=MUTED, linewidth=0.8)
    axes.set_xscale("log")
    axes.set_xticks(STEPS, [f"{s:g}" for s in STEPS])
    axes.minorticks_off()
    axes.set_ylim(0, 101)
    axes.set_xlabel("Size over the smallest identifiable size")
    axes.set_ylabel("Games [%]")
    axes.legend(loc="lower right")
    return canvas


def _confusion(games: Sequence[Played]) -> Figure:
    hidden, columns, cells = confusion_matrix(games)
    canvas = Figure(figsize=(3.2 + 0.16 * len(columns), 2.2 + 0.16 * len(hidden)))
    axes = canvas.subplots()
    shades = ListedColormap(["#ffffff", *SHADES[::-1]])
    edges = [0.0, 1e-9, *np.linspace(0, 1, len(SHADES) + 1)[1:]]
    norm = mpl.colors.BoundaryNorm(edges, len(edges) - 1)
    image = axes.imshow(cells, cmap=shades, norm=norm, aspect="equal")
    bar = canvas.colorbar(
        image, ax=axes, shrink=0.35, label="Share of the games", spacing="uniform"
    )
    bar.set_ticks([0, edges[4], edges[7], 1], labels=["0", "1/3", "2/3", "1"])
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=5.5)
    axes.set_yticks(range(len(hidden)), hidden, fontsize=5.5)
    axes.set_xlabel("Named")
    axes.set_ylabel("Hidden")
    axes.grid(visible=False)
    strangers = [i for i, name in enumerate(hidden) if name not in columns]
    if strangers:
        axes.axhline(strangers[0] - 0.5, color=INK, linewidth=0.8)
    return canvas


def confusion_matrix(games: Sequence[Played]) -> tuple[list[str], list[str], np.ndarray]:
    """Fractions of names given, by hidden cause, in the order of the catalogue, others last.

    Returns:
        Hidden causes, names given (and `OTHERWISE`), fractions of shape (hidden, named).
    """
    mine = [g for g in games if g.kind in ("single", "strange") and g.scores]
    there = {g.secrets[0] for g in mine}
    hidden = [name for name in SECRETS if name in there]
    said = [_said(g) for g in mine]
    columns = [*(name for name in KNOWN_LABELS if name in {*there, *said}), *OTHERWISE]
    cells = np.zeros((len(hidden), len(columns)))
    for g, name in zip(mine, said, strict=True):
        cells[hidden.index(g.secrets[0]), columns.index(name)] += 1
    return hidden, columns, cells / np.maximum(cells.sum(axis=1, keepdims=True), 1)


def _said(game: Played) -> str:
    verdict, named = game.score.verdict, game.score.named
    if verdict in ("explained", "ambiguous") and len(named) == 1 and named[0] in KNOWN_LABELS:
        return named[0]
    if verdict in ("explained", "ambiguous") and named:
        return "other or several names"
    return "adequate" if verdict == "adequate" else "no name"
