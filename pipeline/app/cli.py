"""The command line: stdout is data, stderr is progress; exit codes are in the README."""

from __future__ import annotations

import io
import os
import sys
from typing import Any

import typer
from typer.exceptions import Abort, TyperException

from pipeline.app.commands._shared import app as everything
from pipeline.app.commands._shared import fitted
from pipeline.base.errors import CannotWrite, Interrupted, PipelineError, UsageError, ended
from pipeline.base.files import FULL


def main(
    arguments: list[str] | None = None, app: typer.Typer = everything, name: str = "pipeline"
) -> None:
    """Run the command line; every way out has a documented exit code and no traceback.

    Args:
        arguments: Words behind the command's name; those of this process when not given.
        app: The commands.
        name: What is typed for them.
    """
    _prepare_streams()
    sys.exit(_exit_code(arguments, app, name))


def _prepare_streams() -> None:
    """A closed stream swallows what it gets; a sign that one cannot show becomes a `?`."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115  # for as long as we live
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _exit_code(
    arguments: list[str] | None, app: typer.Typer = everything, name: str = "pipeline"
) -> int:
    try:
        return _carried_out(arguments, app, name)
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # nobody reads on: `pipeline ... | head`
            return 0
        raise
    except (Exception, KeyboardInterrupt) as problem:
        return _say(*_told(problem, name))


def _carried_out(arguments: list[str] | None, app: typer.Typer, name: str) -> int:
    words = sys.argv[1:] if arguments is None else arguments
    if app is everything:
        words = words or ["--help"]
    code: Any = app(args=words, standalone_mode=False, prog_name=name)
    if code == Interrupted.exit_code:  # Typer's word for a KeyboardInterrupt
        raise KeyboardInterrupt
    return code if isinstance(code, int) else 0


def _told(problem: Exception | KeyboardInterrupt, name: str) -> tuple[str, int]:
    """What went wrong in one sentence, and the exit code for it."""
    match problem:
        case PipelineError():
            return str(problem), problem.exit_code
        case Abort() | KeyboardInterrupt():
            sentence = "Interrupted; run it again to go on, nothing half-written counts."
            return sentence, Interrupted.exit_code
        case TyperException():
            context = getattr(problem, "ctx", None)
            command = context.command_path if context else name
            sentence = f"{ended(problem.format_message())} Try `{command} --help`."
            return sentence, UsageError.exit_code
        case OSError() if problem.errno in FULL:
            why = f"The answer cannot be written ({problem.strerror})"
            return f"{why}; free some space and run it again.", CannotWrite.exit_code
        case _:  # the last net: a sentence for the engineer, the rest in a file
            from pipeline.app.outcome import record_crash

            return record_crash(problem), 1


def _say(sentence: str, code: int) -> int:
    if code == Interrupted.exit_code and sys.stderr.isatty():
        typer.echo(err=True)  # the terminal has written ^C where our sentence would begin
    typer.secho(fitted(sentence, sys.stderr), err=True, fg="red")
    return code
