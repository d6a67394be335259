"""Counts of the worlds' results: one table per exam, one row per world."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from bench.league.judge import SCATTER
from bench.league.table import share
from bench.worlds.judge import Interval
from bench.worlds.noise import SIGMA_M
from bench.worlds.run import Played
from bench.worlds.tables import ENTRIES
from bench.worlds.worlds import EXAMS, WORLDS

CLEARLY = 1.5
"""Multiple of the smallest detectable error from which a blunder must be named [1]."""

SHOWN = 4.806
"""Distance of torques and statement that is detected in 80 % of the cases [1]: root of the
noncentrality at which a chi-square test of four quantities at 0.001 has a power of 0.80."""

ROW_MM = 1e3 * SIGMA_M * np.sqrt(1.5)
"""Noise of a loaded reading minus the mean of two unloaded ones [mm]."""

Games = Sequence[Played]
Column = tuple[str, Callable[[Games], str]]


def _parts(games: Games) -> list[tuple[str, bool]]:
    there = {(_exam(g), _caused(g)) for g in games}
    order = [(exam, cause) for exam in EXAMS for cause in (False, True)]
    return [part for part in order if part in there]


def _rows(games: Games, exam: str, cause: bool) -> list[list[str]]:
    mine = [g for g in games if (_exam(g), _caused(g)) == (exam, cause)]
    columns = CAUSE if cause else COLUMNS[exam]
    rows = [["world", "games", *(title for title, _ in columns)]]
    for world in dict.fromkeys(g.world for g in mine):
        of = [g for g in mine if g.world == world]
        rows.append([world, str(len(of)), *(count(of) for _, count in columns)])
    said = [k for k in range(len(rows[0])) if any(row[k] != "-" for row in rows[1:])]
    return [[row[k] for k in said] for row in rows]


def titled(exam: str, cause: bool) -> str:
    """Heading of a table."""
    return f"{exam}, with a hidden cause" if cause else exam


def _exam(game: Played) -> str:
    return WORLDS[game.world.partition("+")[0]].exam


def _caused(game: Played) -> bool:
    return game.world.endswith("+cause")


def _answered(games: Games) -> Games:
    return [g for g in games if g.judged.outcome == "answered"]


def _false_alarms(games: Games) -> str:
    return share(g.judged.accused for g in games)


def _family(games: Games) -> str:
    """Fraction with the right family named; in a world without one, with any family."""
    if WORLDS[games[0].world.partition("+")[0]].family:
        return share(g.judged.family for g in games)
    return share(any(c in SCATTER for c in g.judged.causes) for g in games) + " falsely"


def covered(intervals: Iterable[Interval]) -> str:
    """Fraction of the intervals that contain the truth."""
    return share(one.covered for one in intervals)


def _springs(games: Games) -> str:
    return covered(one for g in games for one in g.judged.springs)


def _deflections(games: Games) -> str:
    return covered(one for g in games for one in g.judged.deflections)


def _combinations(games: Games) -> str:
    return covered(one for g in games for one in g.judged.combinations)


def _width(games: Games) -> str:
    """Median width of the springs' intervals relative to the truth."""
    wide = [one.width for g in games for one in g.judged.springs if one.width is not None]
    return f"{100 * np.median(wide):.2f} %" if wide else "-"


def _outcomes(games: Games) -> str:
    count = Counter(g.judged.outcome for g in games)
    return ", ".join(f"{n} {outcome}" for outcome, n in count.most_common())


def _verdicts(games: Games) -> str:
    count = Counter(g.judged.verdict or g.judged.outcome for g in games)
    return ", ".join(f"{n} {verdict}" for verdict, n in count.most_common())


def _seconds(games: Games) -> str:
    return f"{np.median([g.seconds for g in games]):.1f}"


def _placed(clearly: bool) -> Callable[[Games], str]:
    def count(games: Games) -> str:
        return share(
            k < len(g.judged.placed) and g.judged.placed[k]
            for g in games
            for k, one in enumerate(g.spoilt)
            if one.above(CLEARLY) == clearly
        )

    return count


def _hidden(game: Played) -> bool:
    """Whether a game has errors, but none that must be named."""
    return bool(game.spoilt) and not any(one.above(CLEARLY) for one in game.spoilt)


def _still(hidden: bool) -> Callable[[Games], str]:
    """Fraction in which no compliance or deflection changes by more than one u."""

    def count(games: Games) -> str:
        mine = [g for g in games if g.spoilt and _hidden(g) == hidden]
        return share(g.moved is not None and max(g.moved) <= 1.0 for g in mine)

    return count


def _good_reported(games: Games) -> str:
    return share(bool(g.judged.innocents) for g in games)


def _false(games: Games) -> str:
    return share(bool(g.judged.false_causes) for g in _answered(games))


def _pulls(games: Games) -> str:
    """Largest error of a spring in its standard uncertainties, 95 % quantile of the games."""
    worst = [max(abs(one.pull) for one in g.judged.springs) for g in games if g.judged.springs]
    return f"{np.quantile(worst, 0.95):.1f}" if worst else "-"


def _drift(games: Games) -> str:
    return share(g.judged.drift_said for g in games if WORLDS[g.world].drifts)


def _both(games: Games) -> str:
    """Fraction in which drift and blunder are reported, of games with a clearly visible blunder."""
    mine = [g for g in games if WORLDS[g.world].drifts and g.spoilt and not _hidden(g)]
    return share(
        g.judged.drift_said and bool(g.judged.placed) and all(g.judged.placed) for g in mine
    )


def _before(games: Games) -> str:
    """Fraction of false alarms without the errors; an allowed drift does not count."""
    return share(g.before.accused for g in games if g.before is not None)


def _said(games: Games) -> str:
    mine = [g for g in games if WORLDS[g.world].factors != (1.0, 1.0)]
    return share(g.said for g in mine)


def _named(games: Games) -> str:
    mine = [g for g in games if _caused(g) or WORLDS[g.world].secrets]
    return share(g.named for g in mine)


def _listed(games: Games) -> str:
    return share(g.judged.listed for g in games)


def _sizes(games: Games) -> str:
    return share(size.covered for g in games for size in g.sizes)


def _identified(games: Games) -> str:
    return f"{np.mean([len(g.judged.springs) for g in games]):.1f}"


def _mixed(games: Games) -> str:
    return f"{np.mean([len(g.judged.combinations) for g in games]):.1f}"


def _right(games: Games) -> str:
    """Fraction of false alarms although everything is as stated."""
    return share(g.judged.accused for g in games if not g.wrong)


def _weighed(games: Games) -> str:
    return covered(one for g in games for one in g.judged.weighed)


def _told(clearly: bool) -> Callable[[Games], str]:
    """Fraction in which the wrongly stated payload is reported, where torques show it."""

    def count(games: Games) -> str:
        mine = [g for g in games if g.apart and (g.apart > CLEARLY * SHOWN) == clearly]
        return share(g.wrong in g.judged.contradicted for g in mine)

    return count


def _right_reported(games: Games) -> str:
    """Fraction in which another payload is reported, of games with torques."""
    return share(bool({*g.judged.contradicted} - {g.wrong}) for g in games if g.judged.weighed)


def _doubted(games: Games) -> str:
    """Fraction in which anything is reported if a payload is stated wrong."""
    return share(g.judged.accused or bool(g.judged.contradicted) for g in games if g.wrong)


def _from_others(games: Games) -> str:
    """Median residual of a payload's rows with the springs of the others, over the noise."""
    left = [mm / ROW_MM for g in games for mm in g.judged.left_mm]
    return f"{np.median(left):.2f}" if left else "-"


def _poses(games: Games) -> str:
    """Fraction in which readings of a pose are recognised as such."""
    mine = [g for g in _answered(games) if WORLDS[g.world.partition("+")[0]].reads]
    return share(g.judged.measures == "poses" for g in mine)


def _wrong(games: Games) -> str:
    """Fraction in which the wrong entry is named, and nothing else."""
    return share(g.named for g in games if g.cause != "table")


def _wrong_reported(games: Games) -> str:
    """Fraction in which an entry is named although all are slightly wrong."""
    return share(any(_is_entry(c) for c in g.judged.causes) for g in games if g.cause == "table")


def _is_entry(label: str) -> bool:
    return label.partition(":")[0] in {*ENTRIES, *ODD}


def _far(games: Games) -> str:
    """Fraction `adequate` with a stiffness wrong by more than five standard uncertainties."""
    return share(
        g.judged.verdict == "adequate" and any(abs(one.pull) > 5 for one in g.judged.springs)
        for g in games
    )


def _nearer(games: Games) -> str:
    """Median ratio of held-out reflectors' deviations from nominal and estimated parameters."""
    ratios = [before / after for g in games for before, after in [g.judged.positions_mm or (0, 1)]]
    return f"{np.median(ratios):.1f}"


ODD = ("axis_tilt", "link_turn")
"""Entries that are wrong in no world: Hayati's rotation between parallel axes, and that of the
rail."""


CAUSE: tuple[Column, ...] = (
    ("identified, nothing else", _named),
    ("among causes and rivals", _listed),
    ("family identified", _family),
    ("amplitudes covered", _sizes),
    ("springs covered", _springs),
    ("verdicts", _verdicts),
)

COLUMNS: dict[str, tuple[Column, ...]] = {
    "noise": (
        ("false alarm", _false_alarms),
        ("family identified", _family),
        ("springs covered", _springs),
        ("test pose covered", _deflections),
        ("width", _width),
        ("reading left out", _good_reported),
        ("verdicts", _verdicts),
        ("s", _seconds),
    ),
    "blunders": (
        ("found in place, clearly visible", _placed(True)),
        ("found in place, others", _placed(False)),
        ("nothing moved, clearly visible", _still(False)),
        ("nothing moved, others", _still(True)),
        ("good reading reported", _good_reported),
        ("false cause", _false),
        ("springs covered", _springs),
        ("test pose covered", _deflections),
        ("largest error over u, 95 %", _pulls),
        ("drift reported", _drift),
        ("drift and blunder reported", _both),
        ("forces doubted", _said),
        ("false alarm without the blunder", _before),
        ("verdicts", _verdicts),
        ("s", _seconds),
    ),
    "loads": (
        ("outcome", _outcomes),
        ("springs per game", _identified),
        ("springs covered", _springs),
        ("combinations per game", _mixed),
        ("combinations covered", _combinations),
        ("false alarm", _false_alarms),
        ("identified, nothing else", _named),
        ("verdicts", _verdicts),
        ("s", _seconds),
    ),
    "payloads": (
        ("outcome", _outcomes),
        ("false alarm", _right),
        ("false cause", _false),
        ("identified, nothing else", _named),
        ("wrong payload reported, clearly visible", _told(True)),
        ("wrong payload reported, others", _told(False)),
        ("right payload reported", _right_reported),
        ("any doubt", _doubted),
        ("mass and centre covered", _weighed),
        ("springs covered", _springs),
        ("further payload covered", _deflections),
        ("from the other, over noise", _from_others),
        ("verdicts", _verdicts),
        ("s", _seconds),
    ),
    "tables": (
        ("entry identified, nothing else", _wrong),
        ("among causes and rivals", _listed),
        ("wrong entry reported", _wrong_reported),
        ("springs covered", _springs),
        ("adequate, a spring beyond 5 sigma", _far),
        ("held-out reflectors closer, factor", _nearer),
        ("verdicts", _verdicts),
        ("s", _seconds),
    ),
    "instruments": (
        ("outcome", _outcomes),
        ("false alarm", _false_alarms),
        ("poses found", _poses),
        ("identified, nothing else", _named),
        ("springs covered", _springs),
        ("test pose covered", _deflections),
        ("width", _width),
        ("verdicts", _verdicts),
        ("s", _seconds),
    ),
}


def lines(games: Games) -> list[str]:
    """All tables as Markdown."""
    out = []
    for exam, cause in _parts(games):
        titles, *rows = _rows(games, exam, cause)
        out += ["", f"## {titled(exam, cause).capitalize()}", ""]
        out += [_line(titles), "|---" * len(titles) + "|", *map(_line, rows)]
    return out


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def spoken(games: Games) -> list[str]:
    """All tables for a screen: one world at a time, one figure per line."""
    out = []
    for exam, cause in _parts(games):
        titles, *rows = _rows(games, exam, cause)
        out += ["", titled(exam, cause)]
        for world, count, *cells in rows:
            out.append(f"  {world}, {count} games")
            out += [f"    {t:34} {c}" for t, c in zip(titles[2:], cells, strict=True) if c != "-"]
    return out


def failures(games: Games) -> list[str]:
    """Games without an answer, each with its message, identical ones once."""
    said = Counter(
        (g.world, g.judged.outcome, g.judged.message)
        for g in games
        if g.judged.outcome != "answered"
    )
    return [f"{n}x {world} {outcome}: {why}" for (world, outcome, why), n in said.most_common()]
