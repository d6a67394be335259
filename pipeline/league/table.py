"""What the league says, as a page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
from scipy import stats

from pipeline.league.run import NEVER, Played

TWINS = ("joint_tilt:5", "joint_tilt:6", "joint_tilt:7", "tool_flex")


def page(played: Sequence[Played], command: str) -> str:
    """Markdown: the table of targets, then what was named for what."""
    parts = [
        "# The hidden-effect league",
        "",
        "A machine with a secret is measured, the pipeline sees the raw files only, a judge opens "
        "both. The machine is a chain of homogeneous matrices with finite rotations, its laws are "
        "piecewise or have a memory, its stiffnesses are off by up to 25 %, its tool points by "
        "0.2 mm, its scatter by 0.8 to 1.3; nothing of it is shared with the catalogue.",
        "",
        f"    {command}",
        "",
        "| what | measured | aim |",
        "|---|---|---|",
        *(f"| {what} | {value} | {aim} |" for what, value, aim in rows(played)),
        "",
        "## Named for what",
        "",
        *confusion(played),
        "",
    ]
    return "\n".join(parts)


def rows(played: Sequence[Played]) -> list[tuple[str, str, str]]:
    """The table of targets: what, measured, aim."""
    clean = [p.score for p in played if p.kind == "clean"]
    single = [p.score for p in played if p.kind == "single"]
    twins = [s for s in single if s.truth[0] in TWINS]
    blind = [s for s in single if s.truth[0] in NEVER]
    told = [s for s in single if s.truth[0] not in NEVER]
    pairs = [p.score for p in played if p.kind == "pair"]
    strange = [p.score for p in played if p.kind == "strange"]
    seen = [s for s in [*told, *pairs] if s.detected]
    gains = [s for s in told if s.gain is not None and s.gain[0] > 0.05]
    seconds = [p.seconds for p in played]
    fits = [s.fit_over_floor for s in told if s.right]
    return [
        ("clean campaigns called adequate", _share(s.verdict == "adequate" for s in clean), "99 %"),
        (
            "single cause at twice its smallest identifiable size: right name and place "
            "(twins as one)",
            _share(s.right for s in told),
            "97 %",
        ),
        (
            "... with the verdict explained (twins: ambiguous)",
            _share(s.right and s.verdict == _due(s.truth) for s in told),
            "",
        ),
        (
            "truth among cause and rivals, whenever anything is detected",
            _share(s.in_list for s in seen),
            "99 %",
        ),
        (
            "confidently wrong name, cause in the catalogue",
            _share(s.confident and not s.right for s in told),
            "<= 0.5 %",
        ),
        (
            "confident name for a cause outside the catalogue",
            _share(s.confident for s in strange),
            "<= 5 %",
        ),
        ("... in the wrong place", _share(s.wrong_place for s in strange), "<= 2 %"),
        ("cause outside the catalogue noticed", _share(s.detected for s in strange), ""),
        ("two causes: both named, nothing else", _share(s.right for s in pairs), "90 %"),
        ("twins never named singly", _share(not s.confident for s in [*twins, *blind]), "100 %"),
        (
            "gain interval above zero where the gain is above 5 %",
            _share(s.gain is not None and s.gain[1] > 0 for s in gains),
            "95 %",
        ),
        (
            "remainder over scatter after extension, median and 95 %",
            f"{np.median(fits):.3f}, {np.quantile(fits, 0.95):.3f}" if fits else "-",
            "<= 1.05",
        ),
        (
            "seconds for one campaign, files to diagnosis, median and 95 %",
            f"{np.median(seconds):.2f}, {np.quantile(seconds, 0.95):.2f}" if seconds else "-",
            "2",
        ),
    ]


def _due(truth: tuple[str, ...]) -> str:
    return "ambiguous" if truth[0] in TWINS else "explained"


def _share(hits: Iterable[bool]) -> str:
    """`97.1 % (340 of 350; 95 % interval 94.8 to 98.5)`, Clopper and Pearson."""
    every = list(hits)
    if not every:
        return "-"
    k, n = sum(every), len(every)
    low = stats.beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = stats.beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return f"{100 * k / n:.1f} % ({k} of {n}; {100 * low:.1f} to {100 * high:.1f})"


def confusion(played: Sequence[Played]) -> list[str]:
    """One line per secret: what was said of it, the most frequent first."""
    said: dict[tuple[str, str], Counter[str]] = {}
    for one in played:
        s = one.score
        names = " + ".join(s.named) if s.named else "-"
        said.setdefault((one.kind, " + ".join(s.truth) or "nothing"), Counter())[
            f"{s.verdict}: {names}"
        ] += 1
    lines = ["| hidden | said |", "|---|---|"]
    for (kind, truth), counts in sorted(said.items()):
        if kind != "pair":
            words = "; ".join(f"{n}x {w}" for w, n in counts.most_common(4))
            lines.append(f"| {truth} | {words} |")
    return lines
