"""Results of each entry over all games, with intervals."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from bench.open_league import entries, sealed
from bench.open_league.reply import read
from bench.open_league.score import Score, Value, score
from bench.open_league.truth import Truth
from pipeline.base.arrays import Array

DRAWS, SEED = 4000, 20
"""Number of resamples of whole games for an interval, and seed of their draws."""


@dataclass(frozen=True)
class Scored:
    """A game of one entry.

    Attributes:
        game: Name of the game.
        truth: The truth.
        score: The score.
        cpu_s: CPU time [s]; None if unknown.
    """

    game: str
    truth: Truth
    score: Score
    cpu_s: float | None


def scored(games: Path) -> dict[str, list[Scored]]:
    """All entries that answered before the truths were opened; later answers do not count."""
    truths = sealed.truths(games)
    out: dict[str, list[Scored]] = {}
    for entry in sealed.revealed(games).answers:
        for game, truth in truths.items():
            path = entries.place(games, entry, game)
            said = json.loads(path.read_bytes()) if _counts(games, path) else None
            one = score(truth, read(said["answer"] if said else None)[0])
            spent = said["cpu_s"] if said else None
            out.setdefault(entry, []).append(Scored(game, truth, one, spent))
    return out


def _counts(games: Path, path: Path) -> bool:
    return path.is_file() and sealed.in_time(games, path)


def rows(entry: Sequence[Scored]) -> list[tuple[str, str]]:
    """The measures and their values, in the order of docs/open-league.md."""
    clean = [g for g in entry if not g.truth.causes]
    listed = [g for g in entry if g.truth.causes and all(c.listed for c in g.truth.causes)]
    strange = [g for g in entry if any(not c.listed for c in g.truth.causes)]
    causes = sum(len(g.truth.causes) for g in listed)
    others = sum(not c.listed for g in strange for c in g.truth.causes)
    return [
        ("games, answered", f"{len(entry)}, {sum(g.score.answered for g in entry)}"),
        ("clean: a cause is named", share(sum(g.score.wrong > 0 for g in clean), len(clean))),
        ("... a name, or any verdict but adequate", _games(clean, lambda s: s.noticed)),
        ("causes of the catalogue: right", share(sum(g.score.right for g in listed), causes)),
        ("... missed", share(sum(g.score.missed for g in listed), causes)),
        ("... games with a wrong name", _games(listed, lambda s: s.wrong > 0)),
        ("... games with exactly the true names", _games(listed, lambda s: s.exact)),
        ("outside the catalogue: noticed", _games(strange, lambda s: s.noticed)),
        ("... named as a law at its place", share(sum(g.score.placed for g in strange), others)),
        ("... games with a wrong name", _games(strange, lambda s: s.wrong > 0)),
        ("wrong names per game", mean(entry, lambda s: float(s.wrong), "{:.2f}")),
        ("log score per game, in nats", mean(entry, lambda s: s.log_score, "{:.2f}")),
        ("stiffness: median error", median(entry, lambda s: s.springs, _off, "{:.2f}", 100)),
        (
            "... 95 % intervals that hold the truth",
            median(entry, _springs, _held, "{:.1f}", 100, True),
        ),
        ("... the same, clean", median(clean, _springs, _held, "{:.1f}", 100, True)),
        (
            "... median width of an interval",
            median(entry, _springs, lambda v: v.width, "{:.2f}", 100),
        ),
        ("test pose: rms error over rms deflection, median game", predictions(entry)),
        (
            "... 95 % intervals that hold the truth",
            median(entry, _moves, _held, "{:.1f}", 100, True),
        ),
        ("processor seconds per game, median", _seconds(entry)),
    ]


def _seconds(entry: Sequence[Scored]) -> str:
    known = [g.cpu_s for g in entry if g.cpu_s is not None]
    return f"{np.median(known):.1f}" if known else "-"


def _springs(one: Score) -> tuple[Value, ...]:
    return one.springs


def _moves(one: Score) -> tuple[Value, ...]:
    return one.deflections


def _off(value: Value) -> float | None:
    return None if value.error is None else abs(value.error)


def _held(value: Value) -> float | None:
    return None if value.covered is None else float(value.covered)


def share(hits: int, of: int) -> str:
    """A fraction with its 95 % interval after Wilson (J. Am. Stat. Assoc. 22, 1927)."""
    if not of:
        return "-"
    ends = stats.binomtest(hits, of).proportion_ci(method="wilson")
    return (
        f"{100 * hits / of:.0f} % ({hits} of {of}; {100 * ends.low:.0f} to {100 * ends.high:.0f})"
    )


def _games(some: Sequence[Scored], hit: Callable[[Score], bool]) -> str:
    return share(sum(hit(g.score) for g in some), len(some))


def mean(some: Sequence[Scored], of: Callable[[Score], float | None], form: str) -> str:
    """Mean over games with its bootstrap interval; a dash if a game has no number."""
    values = [of(g.score) for g in some]
    if not values or any(v is None for v in values):
        return "-"
    own = [[v] for v in values if v is not None]
    return _with_ends(own, lambda all_: float(np.mean(all_)), form)


def median(
    some: Sequence[Scored],
    of: Callable[[Score], tuple[Value, ...]],
    number: Callable[[Value], float | None],
    form: str,
    unit: float = 1.0,
    averaged: bool = False,
) -> str:
    """Median, or mean, over all values of all games; whole games are resampled for the interval."""
    own = [[unit * v for one in of(g.score) if (v := number(one)) is not None] for g in some]
    return _with_ends(own, np.mean if averaged else np.median, form, " %" if unit == 100 else "")


def predictions(some: Sequence[Scored]) -> str:
    """Root mean square error of a game's predictions over that of the deflections themselves."""
    own = []
    for g in some:
        off = [v.error for v in g.score.deflections if v.error is not None]
        own.append([100 * float(np.sqrt(np.mean(np.square(off)))) / g.score.scale_m] if off else [])
    return _with_ends(own, np.median, "{:.2f}", " %")


def _with_ends(
    own: Sequence[Sequence[float]],
    statistic: Callable[[Array], float],
    form: str,
    unit: str = "",
) -> str:
    """A statistic and its 2.5 % and 97.5 % quantiles over games drawn with replacement.

    Efron's percentile interval (Ann. Statist. 7, 1979); games rather than values are drawn, as
    those of one game are correlated.
    """
    every = np.array([v for one in own for v in one], dtype=float)
    if not len(every):
        return "-"
    rng = np.random.default_rng(SEED)
    again = [
        np.concatenate([own[k] for k in rng.integers(len(own), size=len(own))])
        for _ in range(DRAWS)
    ]
    low, high = np.quantile([statistic(one) for one in again if len(one)], [0.025, 0.975])
    return f"{form.format(statistic(every))}{unit} ({form.format(low)} to {form.format(high)})"


def lines(all_: Mapping[str, Sequence[Scored]]) -> list[str]:
    """The table in Markdown, one column per entry."""
    columns = {name: rows(one) for name, one in all_.items()}
    first = next(iter(columns.values()))
    body = [
        " | ".join([f"| {what}", *(column[k][1] for column in columns.values())])
        for k, (what, _) in enumerate(first)
    ]
    head = " | ".join(["| ", *columns])
    return [f"{head} |", "|---" * (len(columns) + 1) + "|", *(f"{row} |" for row in body)]


def by_kind(all_: Mapping[str, Sequence[Scored]]) -> list[str]:
    """Names and coverage of intervals, by hidden cause and by noise."""
    cells = (
        ("exactly the true names", lambda some: _games(some, lambda s: s.exact)),
        (
            "95 % intervals of the stiffnesses that hold the truth",
            lambda some: median(some, _springs, _held, "{:.1f}", 100, True),
        ),
    )
    return [line for what, of in cells for line in [*_sorted(all_, what, of), ""]][:-1]


def _sorted(
    all_: Mapping[str, Sequence[Scored]], what: str, cell: Callable[[Sequence[Scored]], str]
) -> list[str]:
    """A table of one measure: a row for each kind and for each noise, a column for each entry."""
    some = next(iter(all_.values()))
    out = [" | ".join([f"| {what}", *all_]) + " |", "|---" * (len(all_) + 1) + "|"]
    by: tuple[Callable[[Truth], str], ...] = (lambda t: t.kind, lambda t: t.noise)
    for of in by:
        for word in dict.fromkeys(of(g.truth) for g in some):
            mine = [[g for g in one if of(g.truth) == word] for one in all_.values()]
            out.append(" | ".join([f"| {word}", *map(cell, mine)]) + " |")
    return out
