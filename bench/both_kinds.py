"""`python -m bench.both_kinds`: springs by positions and pulls together, against either alone.

Campaigns of tests/mixed_campaign.py (Pinocchio alone), one per seed. Of the error e of an estimate
of the compliances e' N e / k is taken, with N the inverse covariance of the joint estimate, over
the k joints that both estimates determine: the metric is that of the better one, in which either
error is dimensionless and an error along what both know well counts most.

Let e and e + d be the errors of the joint estimate and of one kind alone, with covariances C and
C1. If all rows have their right weights, d is uncorrelated with e (Hausman, Econometrica 46, 1978):

    (e + d)' N (e + d) - e' N e = d' N d + 2 d' N e,     mean g = tr N (C1 - C) >= 0

with a variance of about 4 g + 2 tr (N (C1 - C))^2. Joints of which the other kind says nothing have
d = 0 and add no scatter, so that a pairing by campaigns loses nothing. Positions that state masses
to 5 %, or only products of mass and compliance, add little to pulls: with g = 0.8 of k = 6 the rms
error falls by 6 %, and p < 0.01 needs some 40 campaigns. The term 2 d' N e is shown as well:
below zero, the joint estimate relies too much on the other kind.

p is that of the mean difference under exchange of the two estimates in each campaign (randomisation
test): the claim is one of means.

A campaign of pulls alone has another model: its table is taken as exact, and it may choose other
causes or another equilibrium. `same` are the pulls by the joint estimate's own model, without the
rows that positions add on springs and elements.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import pipeline
from bench import exam
from bench.exam import Kept
from bench.worlds.run import SEEDS
from pipeline.app import cli
from pipeline.app.commands._shared import Jobs, On, Root
from pipeline.base.arrays import Array
from pipeline.base.errors import PipelineError
from pipeline.service.executor import InProcesses
from pipeline.service.many import executor

TESTS = Path(__file__).resolve().parents[1] / "tests"
COUNT = len(SEEDS.read_text("utf-8").split())
Json = dict[str, Any]
_ALONE = {
    "positions": "positions alone",
    "pulls": "pulls alone",
    "same": "pulls alone with the table and causes of both",
}

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


@command.command()
def both_kinds(
    games: Annotated[int, typer.Option(min=0, max=COUNT)] = 100,
    first: Annotated[int, typer.Option(min=0)] = 0,
    minutes: Annotated[float, typer.Option(help="No game is begun after these.")] = np.inf,
    jobs: Jobs = None,
    on: On = None,
    log: Annotated[Path | None, typer.Option(help="Where finished games are kept.")] = None,
    root: Root = Path(),
) -> None:
    """Play campaigns of positions and pulls, together and apart, and compare their springs."""
    kept = Kept(log or root / "reports" / "both_kinds.jsonl", code(), exam.JSON)
    wanted = exam.seeds(SEEDS, first, games)
    at = executor(jobs, on) or InProcesses()
    for line in spoken(exam.contest(wanted, play, str, code, kept, at, minutes)):
        typer.echo(line)


def code() -> str:
    """Hash of all that a game depends on."""
    made = [TESTS / "mixed_campaign.py", TESTS / "heavy_robot.py", Path(__file__)]
    return exam.code_of([*exam.package("app", "report", "design", "page", "annex"), *made])


def play(seed: int) -> Json:
    """Truth, and value and standard uncertainty of each joint by both kinds and by either."""
    sys.path.append(str(TESTS))
    from mixed_campaign import mixed

    rng = np.random.default_rng([seed, 1])
    masses = bool(rng.integers(2))
    made = mixed(
        seed,
        poses=int(rng.integers(30, 81)),
        pulled=int(rng.integers(5, 11)),
        masses=masses,
        noise=float(rng.choice([1e-5, 2e-5, 4e-5])),
        weight=1.0 if masses else float(rng.choice([0.8, 1.0, 1.2])),
    )
    out: Json = {"truth": made.compliance.tolist()}
    for name, left_out in (("both", None), ("positions", "tracker"), ("pulls", "positions")):
        try:
            found = pipeline.identify(pipeline.load_campaign(made.encoded(left_out)))
        except PipelineError as error:
            out[name] = {"error": str(error)}
            continue
        springs = found.answer.stiffness
        out[name] = {
            "verdict": str(found.answer.diagnosis.verdict),
            "value": [one.compliance for one in springs],
            "std": [one.compliance_std for one in springs],
        }
        if left_out is None and found.model is not None:
            out[name]["cov"] = found.model.compliance_cov.tolist()
            by = found.answer.springs_by
            out[name]["joined"] = by is not None and by.joined
            if by is not None and by.joined:
                each = [one.by_pulls for one in by.each]
                out["same"] = {
                    "value": [one and one.value for one in each],
                    "std": [one and one.std for one in each],
                }
    return out


def spoken(games: list[Json]) -> list[str]:
    """Figures of all games in which both kinds of readings have an answer."""
    there = [one for one in games if "cov" in one["both"]]
    z = np.concatenate([_off(one, "both") for one in there] or [np.zeros(0)])
    lines = [
        f"{len(games)} games, {sum(one['both'].get('joined', False) for one in there)} joined; "
        f"95 % intervals of the joint estimate hold {np.mean(np.abs(z) < 1.96):.3f} of {len(z)}"
    ]
    for alone, by in _ALONE.items():
        pairs = [pair for one in there if (pair := _paired(one, alone)) is not None]
        if len(pairs) < 2:
            continue
        joint, own, cross, larger, count = np.array(pairs).T
        other = joint + own + cross
        rms = [np.sqrt(np.sum(one) / np.sum(count)) for one in (joint, other)]
        p, lower = _by_chance(own + cross), int((other > joint).sum())
        lines.append(
            f"{len(pairs)} games: rms error over joint uncertainty {rms[0]:.3f}, "
            f"by {by} {rms[1]:.3f} (p {p:.2g}, lower in {lower}; d'Nd {own.mean():.2f}, "
            f"2 d'Ne {cross.mean():.2f} +- {cross.std() / len(pairs) ** 0.5:.2f}); "
            f"uncertainty larger than alone in {int(larger.sum())} of {int(count.sum())} joints"
        )
    return lines


def _by_chance(gain: Array) -> float:
    """Probability of as large a mean if signs were random."""
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (_DRAWS, len(gain)))
    return float((1 + (signs @ gain >= gain.sum()).sum()) / (1 + _DRAWS))


_DRAWS = 20_000
"""Number of random signs of all games [1]."""


def _numbers(one: Json, key: str) -> Array:
    return np.array([np.nan if x is None else x for x in one[key]], dtype=float)


def _off(game: Json, name: str) -> Array:
    """Errors over their standard uncertainties, of the joints that are determined."""
    z = (_numbers(game[name], "value") - np.array(game["truth"])) / _numbers(game[name], "std")
    return np.asarray(z[np.isfinite(z)])


def _paired(game: Json, alone: str) -> tuple[float, float, float, int, int] | None:
    """e'Ne, d'Nd, 2 d'Ne, how many uncertainties are larger than alone, and of how many."""
    if "value" not in game.get(alone, {}):
        return None
    truth, cov = np.array(game["truth"]), np.array(game["both"]["cov"])
    x, y = (_numbers(game[name], "value") - truth for name in ("both", alone))
    s, t = (_numbers(game[name], "std") for name in ("both", alone))
    of = np.isfinite(x) & np.isfinite(y) & np.isfinite(s) & np.isfinite(t)
    of &= np.isfinite(np.diag(cov))
    if not of.any():
        return None
    N, e, d = np.linalg.inv(cov[np.ix_(of, of)]), x[of], (y - x)[of]
    larger = int((s[of] > 1.001 * t[of]).sum())
    return float(e @ N @ e), float(d @ N @ d), float(2 * d @ N @ e), larger, int(of.sum())


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.both_kinds")
