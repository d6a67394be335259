"""Open questions of a file, with the answers that fit, and the proposal that follows the first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pipeline.base.errors import InputError, listed
from pipeline.intake._beside import Why
from pipeline.readers.export_settings import ExportSettings

QuestionTopic = Literal["columns", "coordinates", "instrument", "unit", "angle", "vertical",
                        "horizontal", "decimal"]  # fmt: skip
"""Subject of a question."""


EVIDENCE: Mapping[Why, str] = {
    "title": "by its title",
    "words": "words that differ",
    "names": "names",
    "numbers": "numbers that name points",
    "time": "times",
    "matrix": "a covariance: symmetric",
    "faces": "a point is read in two faces",
    "rigid": "targets keep their distances while they move",
    "range": "no angles: too large, or no distance among them",
    "order": "three numbers, in this order",
    "stated": "as stated",
    "empty": "empty",
    "untold": "",
    "untimed": "no times that can be read",
}
"""Evidence for the role of a column, in words."""


@dataclass(frozen=True)
class ColumnRole:
    """Probable role of a column.

    Attributes:
        number: Counted from 1.
        title: As written, empty where it has none.
        example: Its first filled cell.
        role: A word of [tracker.mapping] columns, empty where it is not used.
        why: Evidence for the role.
        counted: Whether most of its cells are whole numbers, perhaps with letters behind them; None
            if they number the rows.
    """

    number: int
    title: str
    example: str
    role: str
    why: Why
    counted: bool | None = False

    def to_json(self) -> dict[str, Any]:
        """Content for `--json`, with the evidence in words."""
        shown = {word: own for word, own in vars(self).items() if word != "counted"}
        return shown | {"because": EVIDENCE[self.why]}


@dataclass(frozen=True)
class Reply:
    """One answer to a question.

    Attributes:
        said: The answer in a word: `mm`, `zenith`, or the columns it stands for.
        hints: Resulting entries of [tracker], by key.
    """

    said: str
    hints: Mapping[str, Any]


@dataclass(frozen=True)
class Question:
    """An open question of a file.

    Attributes:
        about: Its subject.
        answers: Sensible answers, the most plausible one first.
        line: Line of the file it is about.
        wrong: A reader's error on it, None if the question is the only complaint.
    """

    about: QuestionTopic
    answers: tuple[Reply, ...]
    line: int
    wrong: InputError | None = None

    def problem(self) -> InputError:
        """The same as an error, with the way out."""
        if self.wrong is not None:
            return self.wrong
        items = [answer.said for answer in self.answers]
        thing, way_out = _WORDS[self.about]
        shown = f'"{items[0]}"' + (f" (or {listed(map(_quoted, items[1:]))})" if items[1:] else "")
        paste = "paste what `pipeline inspect` proposes"
        return InputError(
            thing.format(listed(map(_quoted, items))),
            way_out.format(shown, paste),
            line=self.line,
        )


def _quoted(word: str) -> str:
    return f'"{word}"'


_WRITE = "into [tracker] of campaign.toml"
_WORDS: dict[str, tuple[str, str]] = {
    "columns": ("the table does not say for certain which columns are the coordinates (maybe {0})",
                "describe its columns in [tracker.mapping] of campaign.toml: {1}"),
    "coordinates": ("the coordinates may be {0}, the numbers allow each",
                    f"write coordinates = {{0}} {_WRITE}, or {{1}}"),
    "instrument": ("there are readings of several instruments ({0}), each in a frame of its own",
                   "describe those of one in [tracker.mapping] of campaign.toml: {1}"),
    "unit": ("the export does not say its unit of length", f"write unit = {{0}} {_WRITE}"),
    "angle": ("the export does not say its unit of angles", f"write angle = {{0}} {_WRITE}"),
    "vertical": ("the export does not say its vertical angle's zero",
                 f"write vertical = {{0}} {_WRITE}"),
    "horizontal": ("the export does not say its sense of horizontal angles",
                   f"write horizontal = {{0}} {_WRITE}"),
}  # fmt: skip


@dataclass(frozen=True)
class TableProposal:
    """How a table would be read.

    Attributes:
        hints: All entries of [tracker] that the reading needs, open questions answered by their
            first answer.
        columns: Probable role of each column.
        questions: Open questions, in the order in which they are asked.
    """

    hints: ExportSettings
    columns: tuple[ColumnRole, ...]
    questions: tuple[Question, ...] = ()
