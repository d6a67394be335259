"""Outbuilding: correct paths and robot programs; only the coordinates of targets change.

The targets of a program (`program.py`), how controllers write poses (`notation.py`), the joint
values at the targets (`aim.py`, `inverse.py`), and one file per language (`languages.py`). The
offsets come from `prediction`. A table of joint values is also a path; for it, `predict` states the
positions of the targets.

Door: `programs.command:compensate` and `predict`; `programs.path_file:read`, the path that
[tolerance] names.
Tests: `tests/programs/`.
"""

from __future__ import annotations

from pipeline.base.errors import InputError
from pipeline.programs import krl, stamp
from pipeline.programs._text import LARGEST_PROGRAM, one_byte_characters
from pipeline.programs.languages import is_program, language
from pipeline.programs.program import Program

__all__ = ["LARGEST_PROGRAM", "Program", "is_program", "other_suffix", "read"]


def other_suffix(file: str) -> str | None:
    """Suffix of the companion file (.src or .dat); None if the program is a single file."""
    low = file.lower()
    both = dict(zip(krl.SUFFIXES, reversed(krl.SUFFIXES), strict=True))
    return next((other for end, other in both.items() if low.endswith(end)), None)


def read(file: str, data: bytes, other: tuple[str, bytes] | None = None) -> Program:
    """Read a program in the language given by its suffix.

    Args:
        file: Name of the file.
        data: Content of the file.
        other: Name and content of its companion file.

    Raises:
        InputError: It is not text, has no target that can be corrected, or has already been
            corrected.
    """
    beside = None if other is None else (other[0], one_byte_characters(*other))
    text = one_byte_characters(file, data)
    for name, content in ((file, text), *([] if beside is None else [beside])):
        stamp.refuse(name, content)
    program: Program = language(file).read(file, text, beside)
    if not program.own:
        raise _nothing(program, None if other is None else other[0])
    return program


def _nothing(program: Program, other: str | None) -> InputError:
    """Explain why a file has nothing to correct."""
    elsewhere = f"correct {other}, which has targets" if program.targets and other else None
    if not program.left:
        thing = "contains no motion to a target with coordinates"
        return InputError(thing, elsewhere or "give a program that has one", file=program.file)
    first = next((one for one in program.left if one.counts), program.left[0])
    thing = f"none of its targets can be corrected: {first.why}"
    way_out = elsewhere or "write coordinates instead"
    return InputError(thing, way_out, file=program.file, line=first.line)
