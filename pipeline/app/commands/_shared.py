"""Shared by the commands: the application, common options, and the output of results."""

from __future__ import annotations

import shutil
import sys
import textwrap
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer
from typer import Argument, Option
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command_from_info
from typer.models import CommandInfo

from pipeline.app.commands import COMMANDS
from pipeline.base.doors import is_there, opened
from pipeline.base.errors import UsageError
from pipeline.base.shown import lines, quoted

if TYPE_CHECKING:
    from pipeline.app.outcome import Outcome, Several


class _Doors(TyperGroup):
    """Group of commands, each of which is imported when it is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Commands of this installation, in the order of `COMMANDS`."""
        return [name for name, one in COMMANDS.items() if is_there(one.door)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command by its name; for completion in a shell only its line of help."""
        if cmd_name in COMMANDS and cmd_name not in self.commands:
            if ctx.resilient_parsing:
                return TyperCommand(cmd_name, short_help=COMMANDS[cmd_name].line)
            self._open(cmd_name)
        return super().get_command(ctx, cmd_name)

    def _open(self, name: str) -> None:
        """Import a command."""
        door, line = COMMANDS[name]
        self.add_command(
            get_command_from_info(
                CommandInfo(name, callback=opened(door), short_help=line),
                pretty_exceptions_short=False,
                rich_markup_mode=None,
            )
        )

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write one line of help per command, without importing it."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name].line) for name in self.list_commands(ctx)])

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command meant; the error about a misspelt one suggests similar names."""
        wanted = [args[0]] if args[0] in COMMANDS else self.list_commands(ctx)
        for name in wanted:
            if name not in self.commands:
                self._open(name)
        return super().resolve_command(ctx, args)


app = typer.Typer(cls=_Doors, pretty_exceptions_enable=False, rich_markup_mode=None)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"pipeline {metadata.version('rail-stiffness')}")
        raise typer.Exit


@app.callback()
def _everything(
    context: typer.Context,
    root: Annotated[
        Path | None, Option(help="Project folder, before the command or behind it.")
    ] = None,
    version: Annotated[
        bool,
        Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Identify the joint stiffnesses of a robot from laser tracker measurements.

    Every value comes with its uncertainty and with a diagnosis of what the model leaves out.
    """
    if root is not None:
        context.default_map = {name: {"root": str(root)} for name in COMMANDS}


Root = Annotated[Path, Option(help="Project folder, with data/ and reports/ in it.")]
Named = Annotated[
    str, Argument(metavar="CAMPAIGN", help="Name of a folder in data/raw, or a path.")
]
AsJson = Annotated[bool, Option("--json", help="Print JSON on stdout, one line per result.")]

Jobs = Annotated[int | None, Option(min=1, help="Number of parallel processes on this machine.")]
On = Annotated[
    str | None,
    Option(metavar="ADDRESS", help="Run on a Dask cluster: its scheduler, tcp://host:port."),
]


def several(jobs: int | None, on: str | None) -> Several | None:
    """Function that computes many campaigns at a time; None if neither option is given."""
    if jobs and on:
        raise UsageError("--jobs is for this machine and --on for a cluster: give one of them")
    if not jobs and not on:
        return None
    found: Several = opened("pipeline.service.many:several")(jobs, on)
    return found


Steps = Annotated[
    list[float] | None, Option(help="Load step [N]; repeat the option for each step, up and down.")
]


def show(outcome: Outcome, as_json: bool) -> None:
    """Print the result on stdout and complaints on stderr."""
    typer.echo(outcome.as_json() if as_json else fitted(outcome.text, sys.stdout))
    for line in outcome.complaints:
        typer.secho(fitted(line, sys.stderr), err=True, fg="red")


def fitted(text: str, stream: TextIO) -> str:
    """Printable text; on a terminal, long lines are wrapped between words."""
    text = quoted(lines(text))
    if not stream.isatty():
        return text
    width = max(40, shutil.get_terminal_size().columns)
    return "\n".join(
        line
        if "  " in line.strip()  # aligned columns, which wrapping would break
        else textwrap.fill(
            line,
            width,
            subsequent_indent="  ",
            break_long_words=False,
            break_on_hyphens=False,
        )
        for line in text.split("\n")
    )


def at_work(words: str) -> None:
    """One line of progress; on a terminal only."""
    if sys.stderr.isatty():
        typer.secho(fitted(words, sys.stderr), err=True, dim=True)


def open_it(path: Path) -> None:
    """Open a file in the browser or in the program for such files."""
    import webbrowser

    if not webbrowser.open(path.resolve().as_uri()):
        raise UsageError(f"no program opens {path} here: open it yourself")
