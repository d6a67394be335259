"""`python -m bench.cliff`: the campaign that ships, some of its loaded readings shifted.

The answer must degrade as a slope: every shifted reading identified, or a verdict that doubts;
never a model that fits beside readings far beyond their noise.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from pydantic import TypeAdapter

import pipeline
from bench.exam import Kept, code_of, contest, package, seeds
from bench.league.judge import label
from bench.league.table import share
from bench.worlds.judge import DATA, Spoilt
from bench.worlds.run import SEEDS, SHELL, asked
from pipeline.app import cli
from pipeline.service.executor import InProcesses

COUNTS, SIZES_M = (4, 10, 14, 20, 30), (1e-3, 4e-3, 20e-3)
"""Shifted readings of a campaign, of 144, and by how much [m]; every pair is a cell."""

BESIDE = Path(pipeline.__file__).parents[1] / "data" / "raw" / "kr500_demo"
"""Campaign that is spoilt; its readings scatter by 0.03 mm per axis, so that each is off by more
than ten standard uncertainties."""

GREEN = ("adequate", "explained")
"""Verdicts that recommend a model."""

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


@dataclass(frozen=True)
class Cell:
    """One game before it is played: so many readings shifted by so much [m], drawn from a seed."""

    count: int
    size_m: float
    seed: int

    @property
    def name(self) -> str:
        """Name of its cell in the table."""
        return f"{self.count} x {1e3 * self.size_m:g} mm"

    @property
    def key(self) -> str:
        """Name among games that are kept."""
        return f"{self.name} {self.seed}"


@dataclass(frozen=True)
class Slope:
    """A game with its result.

    Attributes:
        cell: Name of its cell.
        seed: Its seed.
        verdict: The verdict; for no answer, its reason.
        shifted: Number of shifted readings.
        left: Those neither named nor rejected, `group/target`.
        others: Causes that are mistakes elsewhere, and rejected lines that are not shifted.
        causes: Every other cause.
    """

    cell: str
    seed: int
    verdict: str
    shifted: int
    left: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()

    @property
    def silent(self) -> bool:
        """Whether a model is recommended beside more than one reading far off."""
        return self.verdict in GREEN and len(self.left) > 1


def shifted(raw: bytes, cell: Cell) -> tuple[bytes, tuple[Spoilt, ...]]:
    """An export with loaded readings of targets off in random directions, and which."""
    rows, rng = pd.read_csv(io.BytesIO(raw)), np.random.default_rng([cell.seed, cell.count])
    own = rows["group"].str.endswith("_loaded") & rows["target"].isin(["P1", "P2", "P3"])
    at = np.sort(rng.choice(np.flatnonzero(own), cell.count, replace=False))
    way = rng.standard_normal((cell.count, 3))
    way *= cell.size_m / np.linalg.norm(way, axis=1, keepdims=True)
    rows.loc[at, ["x_mm", "y_mm", "z_mm"]] += np.round(1e3 * way, 4)
    names = (rows["group"] + "/" + rows["target"]).to_numpy()[at]
    spoilt = tuple(
        Spoilt(str(name), int(k) + 2, cell.size_m, None) for k, name in zip(at, names, strict=True)
    )
    return rows.to_csv(index=False).encode(), spoilt


def play(cell: Cell) -> Slope:
    """Play one game; the result depends on nothing else."""
    files = {path.name: path.read_bytes() for path in BESIDE.iterdir()}
    files["tracker.csv"], spoilt = shifted(files["tracker.csv"], cell)
    said = asked(files)
    if said.answer is None:
        return Slope(cell.name, cell.seed, said.message, len(spoilt))
    causes = said.answer["diagnosis"]["causes"]
    wrong = [one for one in causes if one["name"] in DATA]
    lines = {(row["file"], row["line"]) for row in said.answer["rejected"]}
    named = [
        one
        for one in spoilt
        if ("tracker.csv", one.line) in lines or any(one.meant(c["where"]) for c in wrong)
    ]
    mine = {("tracker.csv", one.line) for one in spoilt}
    strange = [label(c) for c in wrong if not any(one.meant(c["where"]) for one in spoilt)]
    return Slope(
        cell.name,
        cell.seed,
        str(said.answer["diagnosis"]["verdict"]),
        len(spoilt),
        left=tuple(one.name for one in spoilt if one not in named),
        others=(*strange, *(f"{file}:{line}" for file, line in sorted(lines - mine))),
        causes=tuple(label(one) for one in causes if one not in wrong),
    )


@cache
def code() -> str:
    """Hash of the code that makes an answer, and of the exam itself."""
    return code_of([*package(*SHELL), Path(__file__), *BESIDE.iterdir()])


def table(games: Sequence[Slope]) -> list[str]:
    """A row per cell; fractions with 95 % intervals after Clopper and Pearson."""
    out = ["| cell | games | readings identified | silent | other rows | verdicts |"]
    out.append("|---|---|---|---|---|---|")
    every = [(name, [g for g in games if g.cell == name]) for name in {g.cell: 0 for g in games}]
    for name, of in [*every, ("all", list(games))]:
        found = (k < one.shifted - len(one.left) for one in of for k in range(one.shifted))
        counts = pd.Series([one.verdict for one in of]).value_counts()
        cells = [name, str(len(of)), share(found), share(one.silent for one in of)]
        cells += [share(bool(one.others) for one in of)]
        out.append(f"| {' | '.join(cells)} | {', '.join(f'{n} {v}' for v, n in counts.items())} |")
    return out


@command.command()
def cliff(
    games: Annotated[int, typer.Option(min=1, help="Games per cell.")] = 20,
    first: Annotated[int, typer.Option(min=0, help="Number of the first game.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    log: Annotated[
        Path, typer.Option(help="Where finished games are kept, one JSON line each.")
    ] = Path("reports/cliff.jsonl"),
    minutes: Annotated[float, typer.Option(help="No game begins later.")] = np.inf,
) -> None:
    """Shift 4 to 30 of 144 loaded readings by 1 to 20 mm, and count what is identified."""
    drawn = seeds(SEEDS, first, games)
    wanted = [Cell(k, size, seed) for seed in drawn for k, size in product(COUNTS, SIZES_M)]
    kept = Kept(log, code(), TypeAdapter(Slope))
    for line in table(contest(wanted, play, _key, code, kept, InProcesses(jobs), minutes)):
        typer.echo(line)


def _key(cell: Cell) -> str:
    return cell.key


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.cliff")
