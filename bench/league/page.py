"""The page of the league: what the command writes, between marks that preserve the rest."""

from __future__ import annotations

from collections.abc import Sequence

from bench.exam import between
from bench.league.run import Played
from bench.league.table import calibration, confusion, power, rows, unplayed

BEGIN = "<!-- make league writes from here -->"


def page(games: Sequence[Played], total: int, command: str, code: str, old: str) -> str:
    """The page with a new generated part; text outside the marks is unchanged.

    Args:
        games: The games that were played.
        total: Number of games of the whole league.
        command: Command that played them.
        code: Version of the code that played them.
        old: The present page; may be empty.
    """
    written = "\n".join(_written(games, total, command, code))
    return between(old or "# The hidden-effect league\n\n", BEGIN, written)


def _written(games: Sequence[Played], total: int, command: str, code: str) -> list[str]:
    part = f"{len(games)} games" if len(games) == total else f"{len(games)} of {total} games"
    several = sum(len(g.scores) for g in games)
    seconds = sum(g.cost for g in games)
    return [
        f"    {command}",
        "",
        f"{part}, {several} campaigns from raw files to answer, {seconds / 60:.0f} "
        f"minutes of one processor (code {code[:12]}). In brackets: count, and 95 % interval "
        "after Clopper and Pearson.",
        "",
        "| what | measured | aim |",
        "|---|---|---|",
        *(f"| {what} | {value} | {aim} |" for what, value, aim in rows(games)),
        "",
        "Causes that a plan shows at no sensible size (twice the smallest identifiable one is "
        f"beyond the physical bounds or twelve typical sizes) were not played: {unplayed(games)}.",
        "",
        "## Power",
        "",
        "Size in multiples of the smallest size at which the linear theory lets the cause be "
        "found and told from every other by that plan. *Listed*: the truth is among causes and "
        "rivals. *Named*: the right name, alone and without reservation.",
        "",
        "![Shares detected, listed and named against size](figures/league-power.svg)",
        "",
        *power(games),
        "",
        "## Stated probabilities",
        "",
        *calibration(games),
        "",
        "## Named for what",
        "",
        "![What was hidden against what was named](figures/league-confusion.svg)",
        "",
        *confusion(games),
    ]
