"""What the commands share: the application, common options, how an answer is shown."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.errors import UsageError

if TYPE_CHECKING:
    from pipeline.outcome import Outcome

app = typer.Typer(
    help="Joint stiffnesses of a robot from tracker campaigns, and how far to trust them.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Root = Annotated[Path, typer.Option(help="Project root with data/ and reports/.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON on stdout, one line each.")]


def show(outcome: Outcome, as_json: bool) -> None:
    """The answer to stdout, complaints to stderr."""
    typer.echo(outcome.as_json() if as_json else outcome.as_text())
    for line in outcome.complaints:
        typer.secho(line, err=True, fg="red")


def at_work(words: str) -> None:
    """One line of progress; on a terminal only."""
    if sys.stderr.isatty():
        typer.secho(words, err=True, dim=True)


def open_it(path: Path) -> None:
    """In the browser, or whatever program opens such files here."""
    import webbrowser

    if not webbrowser.open(path.resolve().as_uri()):
        raise UsageError(f"no program opens {path} here: open it yourself")
