"""Growth with length of the time to reject malformed robot programs."""

from __future__ import annotations

import time
from collections.abc import Iterator

from pipeline.base.errors import InputError
from pipeline.programs import read

LENGTHS = (100_000, 400_000)
"""Number of characters of each text."""

TEXTS = (
    ("p.src", "", "DECL POS P={X 1,(\n"),
    ("p.src", "LIN {X ", "9"),
    ("p.mod", "", "a{"),
    ("p.mod", "", "VAR num a{"),
    ("p.mod", "", "p:=[[;"),
    ("p.mod", "a", " "),
    ("p.script", "", "a["),
    ("p.script", "", "a=[\n"),
    ("p.script", "a", " "),
    ("p.ls", "", "\n"),
    ("p.ls", "/POS\n", "P[1]{"),
    ("p.ls", "/MN\n", "1:\n"),
)
"""File, beginning of the text, and the part that is repeated."""


def written(head: str, again: str, letters: int) -> bytes:
    """A text of about the given number of characters."""
    return (head + again * (letters // len(again)) + "e}").encode()


def run() -> Iterator[tuple[str, float, str]]:
    """CPU time for the longer text [s], and its ratio to that of the shorter one."""
    for file, head, again in TEXTS:
        took = []
        for letters in LENGTHS:
            began = time.process_time()
            try:
                read(file, written(head, again, letters))
            except InputError:
                took.append(time.process_time() - began)
        ratio = took[1] / max(took[0], 1e-3)
        yield f"{file} {again.strip() or 'blanks'!r}", took[1], f"s, {ratio:.1f} times a quarter"
