"""What speaks for each cause, which causes look alike, and what naming them is worth."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure as Canvas

from pipeline.base.quantities import plain
from pipeline.diagnosis.nextpose import APART
from pipeline.report import words
from pipeline.report.captions import cause_in_words
from pipeline.report.figures.marks import Tips, integer_ticks, legend_above
from pipeline.report.summaries import Result, Tables, gain, separability, suspects
from pipeline.report.svg import BLUE, MUTED, RED, SHADES

APART_STEPS = (1.0, 2.0, APART, 10.0)
APART_SHADES = SHADES[::2]
"""Dark where two causes are alike."""


def draw_evidence(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    """Bars of the best suspects, the named ones in another colour."""
    best = suspects(tables["diagnosis"])
    canvas.set_size_inches(5.6, 0.9 + 0.24 * len(best))
    axes = canvas.subplots()
    at = np.arange(len(best))
    named = best["named"].to_numpy(bool)
    size = best["log_evidence"].to_numpy(float)
    axes.barh(at, size, color=np.where(named, RED, BLUE).tolist(), height=0.7, gid="evidence")
    axes.axvline(3, color=MUTED, linewidth=1, linestyle="--")
    said = [cause_in_words(row) for _, row in best.iterrows()]
    axes.set_yticks(at, [f"{s} (named)" if n else s for s, n in zip(said, named, strict=True)])
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("Evidence, natural log of the odds")
    rows = zip(said, size, named, strict=True)
    return {"evidence": [f"{s}: {plain(v, 2)}{', named' if n else ''}" for s, v, n in rows]}


def draw_separability(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    """A triangle of squares, dark where two causes are alike."""
    apart = separability(tables["separability"])
    names, n = [words.from_label(label) for label in apart.index], len(apart)
    canvas.set_size_inches(5.6, 0.5 + 0.13 * n + 0.038 * max(map(len, names)))
    axes = canvas.subplots()
    rows, columns = np.tril_indices(n, -1)
    sigmas = apart.to_numpy()[rows, columns]
    steps = np.searchsorted(APART_STEPS, sigmas, "right")
    size = min(0.13, 3.4 / n) * 72  # of a square, in points
    for step, shade in enumerate(APART_SHADES):
        here = steps == step
        low, high = [0, *APART_STEPS][step], [*APART_STEPS, None][step]
        said = f"{low:g} to {high:g} σ" if high else f"above {low:g} σ"
        key = f"apart-{step}"
        axes.scatter(
            columns[here],
            rows[here],
            s=(0.9 * size) ** 2,
            marker="s",
            color=shade,
            linewidths=0,
            gid=key,
            label=said,
        )
    axes.set_yticks(range(1, n), names[1:], fontsize=6)
    axes.set_xticks(range(n - 1), names[:-1], fontsize=6, rotation=90)
    axes.set_ylim(n - 0.4, 0.4)
    axes.set_xlim(-0.6, n - 1.4)
    axes.grid(visible=False)
    axes.legend(loc="upper right", title="Apart by")
    tips = {}
    for step in range(len(APART_SHADES)):
        here = np.flatnonzero(steps == step)
        tips[f"apart-{step}"] = [
            f"{names[rows[i]]} or {names[columns[i]]}: {plain(sigmas[i], 2)} σ" for i in here
        ]
    return {key: said for key, said in tips.items() if said}


def draw_gain(canvas: Canvas, result: Result, tables: Tables) -> Tips:
    """Error at every pose left out, without and with the named causes."""
    poses = gain(tables["examined"]).dropna()
    axes = canvas.subplots()
    at = np.arange(len(poses))
    before, after = poses["before"].to_numpy(), poses["after"].to_numpy()
    axes.vlines(at, before, after, color=MUTED, linewidth=0.8)
    tips = {}
    kinds = (
        ("before", before, MUTED, "o", "joint springs"),
        ("after", after, RED, "D", "with causes"),
    )
    for key, mm, colour, marker, name in kinds:
        axes.scatter(at, mm, color=colour, marker=marker, s=18, gid=key, label=name, zorder=3)
        pairs = zip(poses["pose"].astype(int), mm, strict=True)
        tips[key] = [f"pose {pose} left out, {name}: {plain(v)} mm" for pose, v in pairs]
    integer_ticks(axes, at, poses["pose"].astype(int).tolist())
    axes.set_ylim(0)
    axes.grid(axis="x", visible=False)
    axes.set_xlabel("Pose left out")
    axes.set_ylabel("Rms error per coordinate [mm]")
    legend_above(axes, 2)
    return tips
