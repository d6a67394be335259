"""The languages of robot programs: a file each, with what is particular to it.

`SUFFIXES` of its files; `SIGN`, with which a remark begins; `HEADS`, by suffix the pattern of the
beginning of the line below which the remark of a corrected program stands; `read`, from text to
`Program`. How it writes poses is in `notation.py`.
"""

from __future__ import annotations

from types import ModuleType

from pipeline.programs import krl, rapid, tp, urscript

LANGUAGES = (krl, rapid, tp, urscript)


def is_program(file: str) -> bool:
    """Whether a file is a robot program, judged by its suffix."""
    return file.lower().endswith(tuple(end for one in LANGUAGES for end in one.SUFFIXES))


def language(file: str) -> ModuleType:
    """The language of a robot program, by its suffix."""
    return next(one for one in LANGUAGES if file.lower().endswith(one.SUFFIXES))
