"""Questions about an export at a terminal: one at a time, each with the first rows of the file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import typer

if TYPE_CHECKING:  # its types import the numerical libraries, which takes a second
    from pipeline.intake.offer import Offer

_Answer = TypeVar("_Answer")

_ASKED = {
    "columns": "Which columns are the coordinates?",
    "coordinates": "Which kind of coordinates are they?",
    "instrument": "Which instrument's readings?",
    "unit": "In which unit are lengths?",
    "angle": "In which unit are angles?",
    "vertical": "Where are vertical angles zero: at the zenith, or at the horizon (elevation)?",
    "horizontal": "Which way do horizontal angles grow, seen from above?",
    "decimal": "Which is the decimal mark?",
}


def ask(found: Offer, say: Callable[[str], None]) -> dict[str, Any]:
    """Ask the question of an offer; the answer as entries of [tracker].

    Args:
        found: The interpretation of a file.
        say: Shows a line.
    """
    from pipeline.intake.inspect import rows_in_words

    question = found.question
    assert question is not None
    for line in rows_in_words(found.preview):
        say(line)
    items = [answer.said for answer in question.answers]
    return dict(numbered(_ASKED[question.about], items, question.answers, say).hints)


def numbered(
    question: str, texts: Sequence[str], answers: Sequence[_Answer], say: Callable[[str], None]
) -> _Answer:
    """Have one of some answers chosen by its number.

    Args:
        question: The question.
        texts: Each answer in words.
        answers: Their values.
        say: Shows a line.
    """
    say(question)
    for number, words in enumerate(texts, 1):
        say(f"  {number}  {words}")
    return answers[_number(len(answers)) - 1]


def _number(most: int) -> int:
    """The number of an answer, asked until it is valid."""
    while True:
        typed = str(typer.prompt(f"1 to {most}", "1", err=True))
        if typed.isdecimal() and 1 <= int(typed) <= most:
            return int(typed)
