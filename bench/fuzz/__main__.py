"""`python -m bench.fuzz`: spoil campaigns, and list what the pipeline must not do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from pipeline.app import cli

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


@command.command()
def fuzz(
    cases: Annotated[int, typer.Option(min=0, help="How many, from --first on.")] = 100,
    first: Annotated[int, typer.Option(min=0, help="Number of the first case.")] = 0,
    to: Annotated[Literal["screened", "answer"], typer.Option(help="How far.")] = "screened",
    results: Annotated[
        Path, typer.Option(help="Where finished cases are kept, one JSON line each.")
    ] = Path("build/fuzz.jsonl"),
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    case: Annotated[int | None, typer.Option(help="Play one case, and tell all of it.")] = None,
    keep: Annotated[
        Path | None, typer.Option(help="Folder in which the files of --case are written.")
    ] = None,
    verbose: Annotated[bool, typer.Option("-v", help="With the stack of an error.")] = False,
) -> None:
    """Spoil the files and settings of campaigns, and list what the pipeline must not do with them.

    With failures the exit code is 1.
    """
    from bench.fuzz.judge import GOOD
    from bench.fuzz.run import contest
    from bench.fuzz.table import summary

    if case is not None:
        _one(case, to, keep, verbose)
        return
    rows = contest(range(first, first + cases), to, results, jobs)
    typer.echo("\n".join(summary(rows)))
    if any(row["outcome"] not in GOOD for row in rows):
        raise typer.Exit(1)


def _one(number: int, to: str, keep: Path | None, verbose: bool) -> None:
    """Play one case again, in this process and with the same time limit."""
    from bench.fuzz import judge
    from bench.fuzz.catalogue import case
    from bench.fuzz.play import play
    from bench.fuzz.run import SECONDS, Row, limited

    made = case(number)
    typer.echo(f"case {number}: {made.base}, {' + '.join(m.name for m in made.mutations)}")
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        for name, data in made.files.items():
            (keep / name).write_bytes(data)
        typer.echo(f"its files are in {keep}")

    def playing(number: int, to: str) -> Row:
        played = play(made.files, to, lambda seen: judge.suspicious(made, seen), made.shown)
        outcome = judge.judge(made, played)
        if verbose:
            typer.echo(played.trace or str(played))
        return {"outcome": outcome.word, "why": outcome.why or played.refused}

    row = limited(playing, number, to, SECONDS)
    typer.echo(f"{row['outcome']} after {row['ms']} ms: {row['why']}")


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.fuzz")
