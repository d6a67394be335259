"""`python -m bench.league`: hidden effects in machines that share nothing with the catalogue."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app import cli
from pipeline.app.commands._shared import Jobs, On, Root
from pipeline.service.executor import InProcesses
from pipeline.service.many import executor

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


@command.command()
def league(
    clean: Annotated[int, typer.Option(min=0, help="Games without a secret.")] = 1000,
    single: Annotated[int, typer.Option(min=0, help="Games per known secret.")] = 6,
    pairs: Annotated[int, typer.Option(min=0, help="Games with two secrets.")] = 100,
    strange: Annotated[int, typer.Option(min=0, help="Games per unknown secret.")] = 15,
    power: Annotated[int, typer.Option(min=0, help="Games per point of a power curve.")] = 6,
    doubtful: Annotated[
        int, typer.Option(min=0, help="Games per secret and size that follow proposed poses.")
    ] = 1,
    seed: Annotated[int, typer.Option(help="Determines every game.")] = 2026,
    jobs: Jobs = None,
    on: On = None,
    minutes: Annotated[
        float | None,
        typer.Option(min=0, help="Begin no game after so long; 0: count those there are."),
    ] = None,
    log: Annotated[
        Path | None, typer.Option(help="Where finished games are kept, one JSON line each.")
    ] = None,
    page: Annotated[Path | None, typer.Option(help="Markdown page of the results.")] = None,
    root: Root = Path(),
) -> None:
    """Hide effects in machines that share nothing with the catalogue, and see what is named."""
    from bench.league import contest
    from bench.league.run import League, fixtures
    from bench.league.table import rows

    rules = League(clean, single, pairs, strange, power, doubtful, seed=seed)
    kept = log or root / "reports" / "league.jsonl"
    end = float("inf") if minutes is None else minutes
    games = contest.contest(rules, kept, executor(jobs, on) or InProcesses(), end)
    for what, value, aim in rows(games):
        typer.echo(f"{what}: {value}" + (f"  (aim {aim})" if aim else ""))
    if page is not None:
        command = (
            f"python -m bench.league --clean {clean} --single {single} --pairs {pairs} --strange "
            f"{strange} --power {power} --doubtful {doubtful} --seed {seed}"
        )
        contest.write_page(games, len(fixtures(rules)), command, contest.code(rules), page)


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.league")
