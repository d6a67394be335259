"""The command line: stdout is data, stderr is progress; exit codes are in the README."""

from __future__ import annotations

import sys
from typing import Any

import typer
from typer.exceptions import Abort, TyperException

from pipeline.commands import campaigns, planning, service
from pipeline.commands._shared import app
from pipeline.errors import Interrupted, PipelineError, UsageError

__all__ = ["campaigns", "main", "planning", "service"]


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; every way out has a documented exit code and no traceback."""
    sys.exit(_exit_code(arguments))


def _exit_code(arguments: list[str] | None) -> int:
    try:
        words = (sys.argv[1:] if arguments is None else arguments) or ["--help"]
        code: Any = app(args=words, standalone_mode=False, prog_name="pipeline")
        if code == Interrupted.exit_code:  # Typer's word for a KeyboardInterrupt
            raise KeyboardInterrupt
        return code if isinstance(code, int) else 0
    except PipelineError as problem:
        return _say(str(problem), problem.exit_code)
    except (Abort, KeyboardInterrupt):
        return _say(
            "Interrupted; run it again to go on, nothing half-written counts.",
            Interrupted.exit_code,
        )
    except TyperException as problem:
        return _say(f"{problem} Try `pipeline --help`.", UsageError.exit_code)
    except BrokenPipeError:
        return 0
    except Exception as problem:  # the last net: a sentence for the engineer, the rest in a file
        from pipeline.outcome import record_crash

        return _say(record_crash(problem), 1)


def _say(sentence: str, code: int) -> int:
    typer.secho(sentence, err=True, fg="red")
    return code
