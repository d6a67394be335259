"""Counts of the league's results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from scipy import stats

from bench.league.judge import UNLISTED, Score, Size, Stated
from bench.league.run import MOST, NEVER, STEPS, Played
from pipeline.base.arrays import Array
from pipeline.diagnosis.facts import SEPARATED
from pipeline.diagnosis.verdict import CERTAIN

TWINS = ("joint_tilt:5", "joint_tilt:6", "joint_tilt:7", "tool_flex")

WORTH_HAVING = 0.05
"""True gain below which no significant gain is required [1]."""

EDGES = np.array([0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 0.99, 1.0])
"""Bins of stated probabilities."""


def rows(games: Sequence[Played]) -> list[tuple[str, str, str]]:
    """The table of targets: what, measured, aim."""
    of = {kind: [g for g in games if g.kind == kind and g.scores] for kind in _kinds(games)}
    clean, single = of["clean"], of["single"]
    blind = [g for g in single if g.secrets[0] in NEVER]
    told = [g for g in single if g.secrets[0] not in NEVER]
    twins = [g for g in told if g.secrets[0] in TWINS]
    strange, pairs = of["strange"], of["pair"]
    known = [*told, *pairs, *of["power"], *of["doubtful"]]
    seen = [g for g in known if g.score.detected]
    better = [g.score for g in told if true_gain(g) > WORTH_HAVING]
    remainders = [g.score.remainder for g in told if g.score.right and g.score.remainder]
    sizes = [size for g in known for size in g.score.sizes]
    return [
        (
            "clean campaigns called adequate",
            share(g.score.verdict == "adequate" for g in clean),
            "99 %",
        ),
        (
            "single cause at twice its smallest identifiable size: right name and place "
            "(twins as one)",
            share(g.score.right for g in told),
            "97 %",
        ),
        (
            "... with the verdict that is due (explained; twins ambiguous)",
            share(g.score.right and g.score.verdict == _due(g.secrets) for g in told),
            "",
        ),
        (
            "truth among cause and rivals, whenever anything is detected, all games of known "
            "causes at every size",
            share(g.score.in_list for g in seen),
            "99 %",
        ),
        ("... at twice the smallest identifiable size", share(_listed(told)), "99 %"),
        (
            "confidently wrong name, cause in the catalogue, all games of known causes at every "
            "size",
            share(wrong(g.score) for g in known),
            "<= 0.5 %",
        ),
        (
            "confident name for a cause outside the catalogue",
            share(wrong(g.score) for g in strange),
            "<= 5 %",
        ),
        (
            "... in the wrong place",
            share(g.score.confident and g.score.misplaced for g in strange),
            "<= 2 %",
        ),
        ("cause outside the catalogue noticed", share(g.score.detected for g in strange), ""),
        *_laws(strange, clean, known),
        ("two causes: both named, nothing else", share(g.score.right for g in pairs), "90 %"),
        (
            "twins never named singly",
            share(not g.score.confident for g in [*twins, *blind]),
            "100 %",
        ),
        (
            "amplitude: 95 % interval covers the truth, causes whose parameter means the same in "
            "the machine and in the catalogue",
            share(size.covered for size in sizes),
            "93-97 %",
        ),
        (
            "... at twice the smallest identifiable size and above",
            share(size.covered for g in known if g.times >= 2 for size in g.score.sizes),
            "93-97 %",
        ),
        (
            "... and the same law: without backlash and lost motion",
            share(
                size.covered
                for g in known
                if g.times >= 2
                for size in g.score.sizes
                if not size.name.startswith("b_")
            ),
            "93-97 %",
        ),
        *_intervals([*clean, *known]),
        (
            "gain interval above zero where the true gain is above 5 %",
            share(s.gain is not None and s.gain[1] > 0 for s in better),
            "95 %",
        ),
        *_next(of["doubtful"]),
        (
            "remainder over scatter after extension, median and 95 %",
            _quantiles(remainders),
            "<= 1.05",
        ),
        (
            "error of the stated probabilities (expected calibration error), causes named / all "
            "held possible",
            f"{ece(_first(known)):.3f} / {ece(_stated(known)):.3f}",
            "<= 0.03",
        ),
        (
            "processor seconds for one diagnosis, median and 95 %",
            _quantiles([g.diagnosing for g in games if g.scores]),
            "2",
        ),
        (
            "... with everything else, files to answer",
            _quantiles([g.seconds for g in games if g.scores]),
            "",
        ),
    ]


def _kinds(games: Sequence[Played]) -> list[str]:
    return ["clean", "single", "pair", "strange", "power", "doubtful"]


def _listed(games: Iterable[Played]) -> list[bool]:
    return [g.score.in_list for g in games if g.score.detected]


def wrong(score: Score) -> bool:
    """Whether a cause is named without reservation that is not present."""
    return score.confident and score.strayed


def true_gain(game: Played) -> float:
    """Fraction by which the cross-validation error would fall if the model missed nothing."""
    whole = game.score.left_out_mm
    if not whole:
        return 0.0
    return 1 - float(np.sqrt(max(1 - (game.missed_mm / whole) ** 2, 0.0)))


def settled(game: Played, most: int) -> bool:
    """Whether at most `most` proposed poses have turned an open name into a right one."""
    return any(s.confident and s.right for s in game.scores[1 : 1 + most])


def rivalled(score: Score) -> bool:
    """Whether a name is open because of a rival, not because of its gain."""
    return any(said.probability < CERTAIN for said in score.stated if _is_named(said, score))


def _intervals(games: Sequence[Played]) -> list[tuple[str, str, str]]:
    """Stiffnesses and predictions, whatever the verdict; exact twins of stiffnesses apart."""
    what = "stiffness of the recommended model: 95 % interval covers the truth"
    how = "deflection of the load point under 3 kN at poses that were not measured: the same"
    of = {
        what: lambda g: g.score.springs,
        how: lambda g: g.score.deflections,
    }
    out = []
    for name, sizes in of.items():
        out.append((f"{name}, known causes and none", _held(games, sizes), "95 +- 1.5 %"))
        for verdict in ("adequate", "explained", "ambiguous", "unexplained"):
            mine = [g for g in games if g.score.verdict == verdict]
            out.append((f"... `{verdict}`", _held(mine, sizes), ""))
    return out


def _held(games: Sequence[Played], sizes: Callable[[Played], Sequence[Size]]) -> str:
    return share(size.covered for g in games for size in sizes(g))


def _laws(
    strange: Sequence[Played], clean: Sequence[Played], known: Sequence[Played]
) -> list[tuple[str, str, str]]:
    """Laws that are not in the catalogue."""
    found = [g.score.law for g in strange if g.score.law and g.score.detected]
    named = [law for law in found if law.named]
    aimless = [g.score for g in strange if g.score.law is None]
    return [
        (
            "law outside the catalogue, of something that a pull varies, once noticed: right place",
            share(law.place for law in found),
            "90 %",
        ),
        ("... right kind and variable", share(law.what for law in found), "70 %"),
        ("... and right order", share(law.order for law in found), ""),
        ("... cross-validation error at least halved", share(law.halved for law in found), "60 %"),
        (
            "... what of it exceeds the scatter of the readings at least halved",
            share(law.beyond for law in found),
            "",
        ),
        ("... named as such a law", share(law.named for law in found), ""),
        ("... of these in the right place", share(law.place for law in named), ""),
        ("... of these right kind and variable", share(law.what for law in named), ""),
        (
            "such a law named where something acts that follows nothing a pull varies",
            share(_unlisted(score) for score in aimless),
            "",
        ),
        ("... in clean campaigns", share(_unlisted(g.score) for g in clean), "<= 0.5 %"),
        ("... for causes of the catalogue", share(_unlisted(g.score) for g in known), "<= 3 %"),
    ]


def _unlisted(score: Score) -> bool:
    """Whether a law that is not in the catalogue is among the causes."""
    return any(name.partition(":")[0] == UNLISTED for name in score.named)


def _next(doubtful: Sequence[Played]) -> list[tuple[str, str, str]]:
    opened = [g for g in doubtful if g.score.verdict == "ambiguous"]
    rivals = [g for g in opened if rivalled(g.score) and g.score.apart is not None]
    apart = [g for g in rivals if (g.score.apart or 0.0) >= SEPARATED]
    others = [g for g in opened if g not in rivals and len(g.scores) > 1]
    return [
        (
            "proposed next pose makes a right name of `ambiguous`: rivals that can be separated, "
            "one pose",
            share(settled(g, 1) for g in apart),
            "80 %",
        ),
        ("... with up to four", share(settled(g, MOST) for g in apart), "95 %"),
        (
            "... all rivals for which a pose is proposed, one / up to four",
            f"{share(settled(g, 1) for g in rivals)} / {share(settled(g, MOST) for g in rivals)}",
            "",
        ),
        (
            "... a pose is proposed where only the gain is not certain, one / up to four",
            f"{share(settled(g, 1) for g in others)} / {share(settled(g, MOST) for g in others)}",
            "",
        ),
        (
            "... ambiguous with nothing to propose",
            f"{len(opened) - len(rivals) - len(others)} of {len(opened)}",
            "",
        ),
    ]


def _due(truth: tuple[str, ...]) -> str:
    return "ambiguous" if truth[0] in TWINS else "explained"


def _quantiles(values: Sequence[float]) -> str:
    if not values:
        return "-"
    return f"{np.median(values):.2f}, {np.quantile(values, 0.95):.2f}"


def interval(k: int, n: int) -> tuple[float, float]:
    """Clopper and Pearson's 95 % interval of a fraction."""
    low = stats.beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = stats.beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return float(low), float(high)


def share(hits: Iterable[bool]) -> str:
    """`97.1 % (340 of 350; 94.8 to 98.5)`, with the 95 % interval."""
    every = list(hits)
    if not every:
        return "-"
    k, n = sum(every), len(every)
    low, high = interval(k, n)
    return f"{100 * k / n:.1f} % ({k} of {n}; {100 * low:.1f} to {100 * high:.1f})"


def _first(games: Iterable[Played]) -> list[Stated]:
    """Stated probabilities of the causes that are named."""
    return [said for g in games for said in g.score.stated if _is_named(said, g.score)]


def _is_named(said: Stated, score: Score) -> bool:
    return any(name in said.label.split(" = ") for name in score.named)


def _stated(games: Iterable[Played]) -> list[Stated]:
    return [said for g in games for said in g.score.stated]


def reliability(said: Sequence[Stated]) -> list[tuple[float, float, int, int]]:
    """By bin of the stated probability: its mean, frequency of being true, times true, count."""
    probability = np.array([s.probability for s in said])
    true = np.array([s.true for s in said])
    at = np.clip(np.searchsorted(EDGES, probability, "right") - 1, 0, len(EDGES) - 2)
    out = []
    for k in range(len(EDGES) - 1):
        here = at == k
        if here.any():
            hits, n = int(true[here].sum()), int(here.sum())
            out.append((float(probability[here].mean()), hits / n, hits, n))
    return out


def ece(said: Sequence[Stated]) -> float:
    """Expected calibration error: mean difference of stated probability and frequency."""
    total = max(len(said), 1)
    return sum(abs(p - f) * n for p, f, _, n in reliability(said)) / total


def calibration(games: Sequence[Played]) -> list[str]:
    """Stated probability and frequency, as a table."""
    known = [g for g in games if g.kind in ("single", "pair", "power", "doubtful") and g.scores]
    lines = ["| stated, mean | true | of all named and rivals |", "|---|---|---|"]
    for p, _, hits, n in reliability(_stated(known)):
        lines.append(f"| {p:.3f} | {share([True] * hits + [False] * (n - hits))} | {n} |")
    return lines


MEASURES: tuple[tuple[str, Callable[[Played], bool]], ...] = (
    ("detected", lambda g: g.score.detected),
    ("listed", lambda g: g.score.in_list),
    ("named", lambda g: g.score.right and g.score.confident),
)
"""Measures of a game of the power curves."""


def curve(games: Iterable[Played], hit: Callable[[Played], float]) -> Array:
    """Mean of a measure at each of `STEPS`; NaN if no game was played."""
    every = [g for g in games if g.kind == "power" and g.scores]
    values = [[hit(g) for g in every if g.times == times] for times in STEPS]
    return np.array([np.mean(v) if v else np.nan for v in values])


def power(games: Sequence[Played]) -> list[str]:
    """Power curves, as a table: all causes together, then each."""
    heads = " | ".join(f"{times:g}" for times in STEPS)
    lines = [f"| | {heads} |", "|---" * (1 + len(STEPS)) + "|"]
    lines.append(_line("all: predicted to be detected", curve(games, lambda g: g.power)))
    lines += [_line(f"all: {name}", curve(games, hit)) for name, hit in MEASURES]
    for cause in dict.fromkeys(g.secrets[0] for g in games if g.kind == "power"):
        mine = [g for g in games if g.secrets[:1] == (cause,)]
        lines.append(_line(f"`{cause}`: detected", curve(mine, MEASURES[0][1])))
        lines.append(_line(f"`{cause}`: named", curve(mine, MEASURES[2][1])))
    return lines


def _line(name: str, shares: Array) -> str:
    cells = ("-" if np.isnan(s) else f"{100 * s:.0f} %" for s in shares)
    return f"| {name} | {' | '.join(cells)} |"


def confusion(games: Sequence[Played]) -> list[str]:
    """One line per hidden cause with the answers given, the most frequent first."""
    said: dict[str, Counter[str]] = {}
    for g in games:
        if g.kind in ("single", "strange", "clean") and g.scores:
            names = " + ".join(g.score.named) or "nothing"
            hidden = " + ".join(g.secrets) or "nothing"
            said.setdefault(hidden, Counter())[f"{g.score.verdict}: {names}"] += 1
    lines = ["| hidden | said |", "|---|---|"]
    for hidden, counts in sorted(said.items()):
        words = "; ".join(f"{n}x {w}" for w, n in counts.most_common(4))
        lines.append(f"| {hidden} | {words} |")
    return lines


def unplayed(games: Sequence[Played]) -> str:
    """Causes that the plans show only at an implausible size, with the number of such plans."""
    count = Counter(g.secrets[0] for g in games if g.kind == "single" and not g.scores)
    total = Counter(g.secrets[0] for g in games if g.kind == "single")
    return (
        ", ".join(f"`{name}` ({n} of {total[name]})" for name, n in sorted(count.items())) or "none"
    )
