"""The command line: results on stdout, progress on stderr; exit codes are in the README."""

from __future__ import annotations

import atexit
import contextlib
import io
import os
import sys
import threading
import time
import warnings
from typing import Any

import typer
from typer.exceptions import Abort, TyperException

from pipeline.app.commands._shared import app as everything
from pipeline.app.commands._shared import fitted
from pipeline.base.errors import Interrupted, PipelineError, UsageError, ended
from pipeline.base.files import refused

_FAREWELL_S = 60.0
"""Time for which libraries may delay the end of the process when its work is done [s]."""
_LAST_S = 10.0
"""Time after that in which they may end the processes that they have started [s]."""


def main(
    arguments: list[str] | None = None, app: typer.Typer = everything, name: str = "pipeline"
) -> None:
    """Run the command line; it always ends with a documented exit code and without a traceback.

    Args:
        arguments: Arguments after the program's name; by default those of this process.
        app: The commands.
        name: Name of the program as typed.
    """
    _prepare_streams()
    try:
        code = _exit_code(arguments, app, name)
        if arguments is None:  # otherwise the process is the caller's
            threading.Thread(target=_end_at_last, args=[code], daemon=True).start()
        sys.exit(code)
    finally:
        if arguments is None:
            _discard_unwritten()


def _discard_unwritten() -> None:
    """Discard what a full disk or an ended reader does not take: Python would end with 120."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _end_at_last(code: int) -> None:
    """End the process even if a library waits without end for something that no longer answers.

    Prefect sends its last messages before the process may end, and waits for its server.
    """
    time.sleep(_FAREWELL_S)
    last = threading.Thread(target=atexit._run_exitfuncs, daemon=True)
    last.start()
    last.join(_LAST_S)
    os._exit(code)


def _prepare_streams() -> None:
    """Discard output to a closed stream, print characters that cannot be encoded as `?`.

    A warning is its sentence, without the line of our code that it comes from.
    """
    warnings.formatwarning = lambda message, *_: f"{message}\n"
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115  # until the process ends
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _exit_code(
    arguments: list[str] | None, app: typer.Typer = everything, name: str = "pipeline"
) -> int:
    try:
        return _carried_out(arguments, app, name)
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # reader ended: `pipeline ... | head`
            return 0
        raise
    except (Exception, KeyboardInterrupt) as problem:
        return _say(*_told(problem, name))


def _carried_out(arguments: list[str] | None, app: typer.Typer, name: str) -> int:
    words = sys.argv[1:] if arguments is None else arguments
    if app is everything:
        words = words or ["--help"]
    code: Any = app(args=words, standalone_mode=False, prog_name=name)
    if code == Interrupted.exit_code:  # Typer returns this for a KeyboardInterrupt
        raise KeyboardInterrupt
    return code if isinstance(code, int) else 0


def _told(problem: Exception | KeyboardInterrupt, name: str) -> tuple[str, int]:
    """One sentence on the problem, and its exit code."""
    problem = refused(problem) or problem
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
        case _:  # any other error: a sentence for the engineer, details in a file
            from pipeline.app.outcome import record_crash

            return record_crash(problem), 1


def _say(sentence: str, code: int) -> int:
    with contextlib.suppress(OSError):  # stderr goes to a full disk: the exit code says it
        if code == Interrupted.exit_code and sys.stderr.isatty():
            typer.echo(err=True)  # the terminal has printed ^C at the beginning of this line
        typer.secho(fitted(sentence, sys.stderr), err=True, fg="red")
    return code
