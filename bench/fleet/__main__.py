"""`python -m bench.fleet`: which detector finds wear, after how many campaigns, at which cost."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app import cli
from pipeline.app.commands._shared import Jobs, Root
from pipeline.service.executor import InThisProcess
from pipeline.service.many import executor

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)

BEGIN = "<!-- python -m bench.fleet writes from here -->"


@command.command()
def fleet(
    worn: Annotated[int, typer.Option(min=0, help="Fleets in which something wears.")] = 200,
    others: Annotated[int, typer.Option(min=0, help="Fleets of each other kind.")] = 40,
    first: Annotated[int, typer.Option(min=0, help="Number of the first fleet.")] = 0,
    log: Annotated[
        Path | None, typer.Option(help="Where finished fleets are kept, one JSON line each.")
    ] = None,
    page: Annotated[Path | None, typer.Option(help="Markdown page of the results.")] = None,
    jobs: Jobs = None,
    root: Root = Path(),
) -> None:
    """Watch simulated fleets campaign by campaign with three detectors side by side."""
    from bench.exam import write_between
    from bench.fleet.run import contest, wanted
    from bench.fleet.table import lines

    kept = log or root / "reports" / "fleet.jsonl"
    said = lines(
        contest(wanted(worn, others, first), kept, executor(jobs, None) or InThisProcess())
    )
    typer.echo("\n".join(said))
    if page is not None:
        write_between(page, BEGIN, "Fleets", said)


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.fleet")
