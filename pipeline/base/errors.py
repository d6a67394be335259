"""Errors in the words of the test engineer: the thing, the number, the way out.

The core raises these; only the command line turns them into a sentence and an exit code.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from pipeline.base.shown import printable

if TYPE_CHECKING:
    from pydantic import ValidationError
    from pydantic_core import ErrorDetails

_PART, _SENTENCE = 500, 1600
"""Maximum length of a message in characters: of its file, thing and way out, and in total."""
_VALUE = 80
"""Maximum number of characters that are shown of a value."""
MISFIT = 4
"""Exit code of `run --strict` when the model does not fit; a verdict, not an error."""


class PipelineError(Exception):
    """Any error that can be explained in one sentence.

    Attributes:
        exit_code: Exit code of the command line, see the README.
    """

    exit_code = 1

    def __init__(self, sentence: str) -> None:
        """Keep the sentence with its full stop, made printable."""
        super().__init__(ended(printable(sentence, _SENTENCE)))


class UsageError(PipelineError):
    """The command or its options cannot be carried out as given."""

    exit_code = 2


class InputError(PipelineError):
    """Input was rejected: names the file, the line, the thing and the way out.

    Attributes:
        file: File name relative to the campaign folder, or None.
        line: Line in that file counted from 1, or None.
        thing: What is wrong.
        way_out: What to do about it, or a question that says so.
        passing: True if trying again a little later may help.
        key: Path of the entry of a TOML file that it concerns, which gives the line.
    """

    exit_code = 5

    def __init__(
        self,
        thing: str,
        way_out: str,
        *,
        file: str | None = None,
        line: int | None = None,
        passing: bool = False,
        key: Sequence[str | int] = (),
    ) -> None:
        """Compose the sentence from its parts."""
        self.file = None if file is None else printable(file, _PART)
        self.thing, self.way_out = printable(thing, _PART), printable(way_out, _PART)
        self.line, self.passing, self.key = line, passing, list(key)
        super().__init__(f"{place(self.file, line)}{self.thing}; {self.way_out}")

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle it as its parts, for other processes."""
        return partial(InputError, **self.parts), ()

    @property
    def parts(self) -> dict[str, Any]:
        """All constructor arguments by name, sufficient to create it again."""
        return dict(vars(self))


@contextmanager
def at(file: str | None = None, line: int | None = None) -> Iterator[None]:
    """Place of the input that is read within the block, for errors that name no file."""
    try:
        yield
    except InputError as wrong:
        if wrong.file is not None:
            raise
        placed = wrong.parts | {"file": file, "line": wrong.line or line}
        raise InputError(**placed) from wrong


class CannotWrite(PipelineError):
    """A result cannot be written: no permission, no space, or something blocks the path."""

    exit_code = 3


class Unfinished(PipelineError):
    """A campaign was abandoned: it exceeded its time or memory, or its process ended."""

    exit_code = 6

    def __init__(self, thing: str, way_out: str) -> None:
        """Compose the sentence from its parts."""
        self.thing, self.way_out = thing, way_out
        super().__init__(f"{thing}; {way_out}.")

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle it as its parts."""
        return Unfinished, (self.thing, self.way_out)


class Interrupted(PipelineError):
    """The user interrupted the run."""

    exit_code = 130


class TableMismatch(PipelineError):
    """A table does not conform to its schema."""


def ended(sentence: str) -> str:
    """A sentence with its full stop."""
    return sentence if sentence.endswith((".", "?", "!")) else f"{sentence}."


def first_wrong(problem: ValidationError) -> tuple[list[str], str]:
    """Path of the decisive error in a file, and what is wrong there."""
    first = decisive(problem)
    path = [printable(str(part), _VALUE) for part in first["loc"] if part != "[key]"]
    return path, _wrong(first).removeprefix("Value error, ")


def _wrong(first: ErrorDetails) -> str:
    """What is wrong with a value, by the kind of error."""
    kind = first["type"]
    if kind == "missing":
        last = first["loc"][-1]
        return f"value {last + 1} is missing" if isinstance(last, int) else "is missing"
    if kind == "extra_forbidden":
        return "unknown key"
    if kind in _FORMS:
        return f"should be {_FORMS[kind]}"
    if kind == "string_pattern_mismatch":
        return f'"{printable(first["input"], _VALUE)}" {_of_letters(first["ctx"]["pattern"])}'
    if kind in ("too_short", "too_long"):
        return _wrong_length(first["ctx"])
    return _wrong_value(first.get("input"), first["msg"])


def _of_letters(pattern: str) -> str:
    """Characters that a name may have, by the pattern that it must match."""
    if "_.-" in pattern:
        return "is not a name of letters, digits, dots, hyphens and underscores"
    return "is not a name of letters and digits that begins with a letter"


def _wrong_length(limits: Mapping[str, Any]) -> str:
    least, most = limits.get("min_length"), limits.get("max_length")
    bound = f"at most {most}" if least is None else f"at least {least}"
    return f"there are {limits['actual_length']} here and {bound} are needed"


def _wrong_value(value: object, message: str) -> str:
    """The value followed by what it should be, if it can be printed."""
    if not isinstance(value, str | int | float) or not message.startswith("Input should be "):
        return message
    shown = f'"{printable(value, _VALUE)}"' if isinstance(value, str) else value
    bound = message.removeprefix("Input should be ")
    for long, short in _BOUNDS.items():
        bound = bound.replace(long, short)
    return f"{shown} should be {bound}"


_BOUNDS = {
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
    "valid integer": "whole number",
    "valid number": "number",
    ", unable to parse string as an integer": "",
    ", unable to parse string as a number": "",
    ", got a number with a fractional part": "",
}


_FORMS = {
    "model_type": "a table",
    "dict_type": "a table",
    "list_type": "a list in square brackets",
    "tuple_type": "a list in square brackets",
    "string_type": "text in quotation marks",
}
"""Kinds of error of pydantic in the terms of a TOML file."""


def decisive(problem: ValidationError) -> ErrorDetails:
    """The first error, or else an unknown key, which may be a misspelt missing one."""
    every = problem.errors()
    return next((one for one in every if one["type"] == "extra_forbidden"), every[0])


def worst(codes: Iterable[int]) -> int:
    """The most important exit code: internal, disk, unfinished, usage, input, misfit, none."""
    ours = (1, CannotWrite.exit_code, Unfinished.exit_code)
    order = (*ours, UsageError.exit_code, InputError.exit_code, MISFIT, 0)
    return min(codes, key=order.index, default=0)


def place(file: str | None, line: int | None) -> str:
    """Place as `file:line: `, or empty."""
    if file is None:
        return ""
    return f"{file}: " if line is None else f"{file}:{line}: "


def listed(names: Iterable[str], most: int = 12) -> str:
    """Names for a sentence, `a, b, c and 4 more`."""
    names = list(names)
    shown = ", ".join(printable(name, _VALUE) for name in names[:most]) or "none"
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
