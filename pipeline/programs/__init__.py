"""Outbuilding: paths and robot programs, written again with other coordinates, all else unchanged.

Their targets (`program.py`), how controllers write poses (`notation.py`), where the robot stands at
them (`aim.py`, `inverse.py`), and one file per language. The offsets are `prediction`'s.
A table of joint values is a path as well, of which `predict` says where the targets stand.

Door: `programs.command:compensate`, `programs.predict:predict`; `programs.judged:read`, the path
that [tolerance] names.
Tests: `tests/programs/`.
"""

from __future__ import annotations

from pipeline.base.errors import InputError
from pipeline.programs import krl, rapid, stamp, tp, urscript
from pipeline.programs._text import LARGEST, letters
from pipeline.programs.program import Program

__all__ = ["LARGEST", "Program", "dialect", "other_suffix", "read"]

_DIALECTS = (krl, rapid, tp, urscript)


def dialect(file: str) -> bool:
    """Whether a file is a program, by the end of its name."""
    return file.lower().endswith(tuple(end for one in _DIALECTS for end in one.SUFFIXES))


def other_suffix(file: str) -> str | None:
    """How the name of the file ends that belongs to this one; None where it stands alone."""
    low = file.lower()
    both = dict(zip(krl.SUFFIXES, reversed(krl.SUFFIXES), strict=True))
    return next((other for end, other in both.items() if low.endswith(end)), None)


def read(file: str, data: bytes, other: tuple[str, bytes] | None = None) -> Program:
    """A program in the language that its name says.

    Args:
        file: Its name.
        data: Its content.
        other: Name and content of the file that belongs to it.

    Raises:
        InputError: It is no text, has no target that can be corrected, or is corrected already.
    """
    one = next(one for one in _DIALECTS if file.lower().endswith(one.SUFFIXES))
    beside = None if other is None else (other[0], letters(*other))
    text = letters(file, data)
    for name, content in ((file, text), *([] if beside is None else [beside])):
        stamp.refuse(name, content)
    program = one.read(file, text, beside)
    if not program.own:
        raise _nothing(program, None if other is None else other[0])
    return program


def _nothing(program: Program, other: str | None) -> InputError:
    """Why there is nothing to correct in a file."""
    elsewhere = f"correct {other}, which has targets" if program.targets and other else None
    if not program.left:
        thing = "contains no motion to a target with coordinates"
        return InputError(thing, elsewhere or "give a program that has one", file=program.file)
    first = program.left[0]
    thing = f"none of its targets can be corrected: {first.why}"
    way_out = elsewhere or "write coordinates instead"
    return InputError(thing, way_out, file=program.file, line=first.line)
