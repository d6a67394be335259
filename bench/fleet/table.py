"""Results of the fleets as lines of Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy import stats

from bench.fleet.run import Watched
from bench.fleet.world import CAMPAIGNS, KINDS

NAMES = {
    "model": "model of the fleet",
    "trends": "trend of each joint, Bonferroni",
    "pairs": "newest beside the one before, told of the scatter",
    "pairs_as_they_are": "the same, as `compare` does it",
}
WORN = ("one", "two", "all")


def lines(watched: Sequence[Watched]) -> list[str]:
    """Two tables: wear found, and false alarms."""
    fleets = {(one.kind, one.number) for one in watched}
    worn = sum(kind in WORN for kind, _ in fleets)
    return [
        f"{worn} fleets of 6 robots with wear in the first of them, {len(fleets) - worn} others.",
        "",
        "| campaigns until found: median; mean (95 %); not found | " + " | ".join(NAMES.values())
        + " |",
        "|---" * (1 + len(NAMES)) + "|",
        *(_found(kinds, says, watched) for kinds, says in _changed(watched)),
        "",
        "| false alarms in 100 robot-years (95 %) | " + " | ".join(NAMES.values()) + " |",
        "|---" * (1 + len(NAMES)) + "|",
        *(_false(kinds, says, watched) for kinds, says in _steady(watched)),
    ]  # fmt: skip


def _changed(watched: Sequence[Watched]) -> Iterable[tuple[tuple[str, ...], str]]:
    kinds = {one.kind for one in watched if one.worn}
    yield WORN, "all three thirds"
    yield from (((kind,), KINDS[kind].says) for kind in KINDS if kind in kinds)


def _steady(watched: Sequence[Watched]) -> Iterable[tuple[tuple[str, ...], str]]:
    kinds = {one.kind for one in watched if not one.worn} - {*WORN}
    yield WORN, "robots beside the worn one, days differ by 1 %"
    yield from (((kind,), KINDS[kind].says) for kind in KINDS if kind in kinds)


def _found(kinds: Sequence[str], says: str, watched: Sequence[Watched]) -> str:
    cells = []
    for name in NAMES:
        mine = [w.found for w in watched if w.worn and w.kind in kinds and w.detector == name]
        after = np.array([CAMPAIGNS + 1 if found is None else found for found in mine])
        half = 1.96 * after.std(ddof=1) / np.sqrt(len(after)) if len(after) > 1 else np.nan
        missed = sum(found is None for found in mine)
        cells.append(
            f"{np.median(after):g}; {after.mean():.1f} ({after.mean() - half:.1f} to "
            f"{after.mean() + half:.1f}); {missed} of {len(mine)}"
        )
    return f"| {says} | " + " | ".join(cells) + " |"


def _false(kinds: Sequence[str], says: str, watched: Sequence[Watched]) -> str:
    cells = []
    for name in NAMES:
        mine = [w for w in watched if not w.worn and w.kind in kinds and w.detector == name]
        count, years = sum(w.found is not None for w in mine), sum(w.years for w in mine)
        low, high = poisson(count)
        cells.append(
            f"{100 * count / years:.2f} ({100 * low / years:.2f} to {100 * high / years:.2f}; "
            f"{count} in {years:.0f})"
        )
    return f"| {says} | " + " | ".join(cells) + " |"


def poisson(count: int) -> tuple[float, float]:
    """95 % interval of an expected count (Garwood, Biometrika 28 (1936) 437)."""
    low = stats.chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    return float(low), float(stats.chi2.ppf(0.975, 2 * count + 2) / 2)
