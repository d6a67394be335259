"""`python -m bench.paper`: the paper's tables and figures, computed again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app import cli
from pipeline.app.commands._shared import AsJson, Root, at_work

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


@command.command()
def paper(
    repetitions: Annotated[int, typer.Option(min=10, help="Of Table IV.")] = 200,
    poses: Annotated[int, typer.Option(min=10, help="Validation poses of each set.")] = 1000,
    seed: Annotated[int, typer.Option(help="Determines every draw and search.")] = 1,
    write: Annotated[
        bool | None, typer.Option("--write/--no-write", help="Page and PDF; not with --json.")
    ] = None,
    as_json: AsJson = False,
    root: Root = Path(),
) -> None:
    """Compute the paper's tables and figures again, and show what a better plan gives."""
    from bench.paper import reproduction

    made = reproduction.run(seed, repetitions, poses, at_work)
    typer.echo(made.as_json() if as_json else made.as_text())
    if write or (write is None and not as_json):
        typer.echo(reproduction.write(root, made))


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.paper")
