"""`python -m bench.open_league`: games by anyone, played by any program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app import cli

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)

BEGIN = "<!-- python -m bench.open_league score writes from here -->"

Games = Annotated[Path, typer.Argument(metavar="GAMES", help="Folder of the games.")]
Hidden = Annotated[Path, typer.Option("--truth", help="Folder of the truths, apart from GAMES.")]


@command.command()
def draw(
    games: Games,
    count: Annotated[int, typer.Option(min=1, help="How many games.")] = 72,
    seeds: Annotated[Path | None, typer.Option(help="Whole numbers, one per game.")] = None,
) -> None:
    """Draw games of our own into GAMES, each with its truth.json, not sealed yet."""
    from bench.open_league.draw import SEEDS, fixtures
    from bench.open_league.draw import draw as drawn
    from pipeline.base.errors import UsageError

    if (games / "manifest.json").exists():
        raise UsageError(f"{games} is sealed already: draw into another folder")
    for one in fixtures(count, seeds or SEEDS):
        if not (games / one.name / "truth.json").exists():
            drawn(one, games)
    typer.echo(f"{count} games in {games}")


@command.command()
def seal(games: Games, truth: Hidden) -> None:
    """Take every truth.json out of GAMES and publish its SHA-256 in manifest.json."""
    from bench.open_league.sealed import seal as locked

    typer.echo(f"{len(locked(games, truth).games)} games sealed; the truths are in {truth}")


@command.command()
def play(
    games: Games,
    entry: Annotated[
        list[str], typer.Option(help='NAME=COMMAND, "ours=pipeline run {campaign} --json".')
    ],
) -> None:
    """Let entries play sealed games; what is played already is kept."""
    from bench.open_league.entries import Entry
    from bench.open_league.entries import play as played
    from bench.open_league.reply import read

    for one in played(games, [Entry.of(text) for text in entry]):
        ended = "" if one.answer else f", exit code {one.exit_code}"
        said = f"{read(one.answer)[1] or 'answered'}{ended}"
        typer.echo(f"{one.game} {one.entry}: {said}", err=True)


@command.command()
def reveal(games: Games, truth: Hidden) -> None:
    """Check the truths against their hashes and publish them; later answers do not count."""
    from bench.open_league.sealed import reveal as opened

    entries = opened(games, truth).answers
    typer.echo(f"revealed; answers of {', '.join(entries) or 'nobody'} count")


@command.command()
def score(
    games: Games,
    page: Annotated[Path | None, typer.Option(help="Markdown page for the tables.")] = None,
) -> None:
    """Count what every entry said of the games."""
    from bench.exam import write_between
    from bench.open_league.table import by_kind, lines, scored

    all_ = scored(games)
    said = [*lines(all_), "", *by_kind(all_)] if all_ else ["Nobody has played."]
    typer.echo("\n".join(said))
    if page is not None:
        write_between(page, BEGIN, "The open league", ["", *said, ""])


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.open_league")
