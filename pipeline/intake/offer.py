"""Interpretation of a file that cannot be read yet: questions, and the answer to paste."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.base.errors import InputError, at
from pipeline.base.quantities import MM
from pipeline.base.shown import in_toml
from pipeline.dialects._circle import FULL
from pipeline.dialects._coordinates import AXES, SENSES, ZEROS
from pipeline.dialects._time import shown
from pipeline.intake.proposal import propose
from pipeline.intake.question import ColumnRole, Question, Reply, TableProposal
from pipeline.readers import (
    TABLE,
    Columns,
    Export,
    ExportSettings,
    Text,
    opened_as_text,
    read,
    recognise,
)
from pipeline.readers._units import USUAL_UNITS
from pipeline.readers.export_settings import ROLES

_FIRST = 5
"""Number of rows of a preview."""
_MAY_BE: dict[str, tuple[str, ...]] = {
    "unit": USUAL_UNITS,
    "coordinates": tuple(AXES),
    "angle": tuple(FULL),
    "vertical": ZEROS,
    "horizontal": tuple(SENSES),
    "decimal": (".", ","),
}
"""Entries of [tracker] that a dialect may leave open, with their possible values."""


@dataclass(frozen=True)
class Offer:
    """Interpretation of a file.

    Attributes:
        dialect: Name of its reader.
        columns: Probable roles of its columns; empty for dialects whose columns are known.
        preview: The first rows as they would be read: group, target, x_mm, y_mm, z_mm, time.
        proposal: [tracker] and [tracker.mapping] for campaign.toml, as TOML.
        questions: Open questions, in the order in which they are asked.
        hints: The same as `proposal`, as a record.
    """

    dialect: str
    columns: tuple[ColumnRole, ...]
    preview: tuple[Mapping[str, Any], ...]
    proposal: str
    questions: tuple[Question, ...]
    hints: ExportSettings

    @property
    def question(self) -> Question | None:
        """The first open question, None if there is none."""
        return self.questions[0] if self.questions else None

    def to_json(self) -> dict[str, Any]:
        """Content for `--json`."""
        out: dict[str, Any] = {"dialect": self.dialect, "proposal": self.proposal}
        if self.question:
            answers = [answer.said for answer in self.question.answers]
            out["question"] = {"about": self.question.about, "answers": answers}
        if self.columns:
            out["columns"] = [column.to_json() for column in self.columns]
            out["roles"] = list(ROLES)
        return out | {"preview": [dict(row) for row in self.preview]}


def offer(name: str, data: bytes, hints: ExportSettings) -> Offer | None:
    """Interpretation of a file, None if nothing can be proposed.

    Args:
        name: File name, for messages.
        data: Content of the file.
        hints: Statements so far.

    Raises:
        InputError: It is not a table, or it contradicts the statements.
    """
    return _offered(name, data, proposal(name, data, hints))


def as_table(name: str, data: bytes, hints: ExportSettings) -> Offer | None:
    """Interpretation of a file as a table of no dialect.

    Raises:
        InputError: As for `offer`.
    """
    with at(name):
        return _offered(name, data, propose(opened_as_text(name, data, hints), hints))


def _offered(name: str, data: bytes, found: TableProposal | None) -> Offer | None:
    if found is None:
        return None
    with at(name):
        reader = recognise(opened_as_text(name, data, found.hints))
    return Offer(
        dialect=reader.name,
        columns=found.columns,
        preview=_preview(name, data, found.hints),
        proposal=_as_toml(found),
        questions=found.questions,
        hints=found.hints,
    )


def proposal(name: str, data: bytes, hints: ExportSettings) -> TableProposal | None:
    """How a file would be read and what is open, None if nothing can be proposed.

    Raises:
        InputError: It is not a table, or it contradicts the statements.
    """
    with at(name):
        file = opened_as_text(name, data, hints)
        unknown = hints.mapping is not None or recognise(file).name == TABLE
        return propose(file, hints) if unknown else _of_dialect(name, data, file, hints)


def _of_dialect(name: str, data: bytes, file: Text, hints: ExportSettings) -> TableProposal | None:
    """Open questions of a dialect: those that its table leaves open, else those of its entries."""
    wrong = _wrong(name, data, hints)
    found = propose(file, hints)
    asked = found if found and found.questions else None
    if asked and (wrong is None or _says(asked.questions[0].problem(), wrong)):
        return asked if wrong else None
    return _of_words(name, data, hints, wrong) or asked


def _says(one: InputError, other: InputError) -> bool:
    """Whether two errors have the same message, wherever they are."""
    return one.thing == other.thing


def _of_words(
    name: str, data: bytes, hints: ExportSettings, wrong: InputError | None
) -> TableProposal | None:
    """The first entry of [tracker] whose values change a reader's complaint, and those after it."""
    questions: list[Question] = []
    while wrong is not None:
        found = _open(name, data, hints, wrong)
        if found is None:
            return None
        questions.append(found)
        hints = hints.model_copy(update=dict(found.answers[0].hints))
        wrong = _wrong(name, data, hints)
    return TableProposal(hints, (), tuple(questions)) if questions else None


def _wrong(name: str, data: bytes, hints: ExportSettings) -> InputError | None:
    try:
        read(name, data, hints)
    except InputError as problem:
        return problem
    return None


def _open(name: str, data: bytes, hints: ExportSettings, wrong: InputError) -> Question | None:
    for word, answers in _MAY_BE.items():
        if getattr(hints, word) is not None:
            continue
        after = {one: _wrong(name, data, hints.model_copy(update={word: one})) for one in answers}
        fitting = [one for one, then in after.items() if str(then) != str(wrong)]
        if fitting:
            offered = tuple(Reply(one, {word: one}) for one in fitting)
            return Question(word, offered, wrong.line or 1, wrong)  # type: ignore[arg-type]
    return None


def _preview(name: str, data: bytes, hints: ExportSettings) -> tuple[Mapping[str, Any], ...]:
    """The first readings as proposed; none if that is refused."""
    try:
        return _first_rows(read(name, data, hints))
    except InputError:
        return ()


def _first_rows(export: Export) -> tuple[Mapping[str, Any], ...]:
    """The first readings of an export, coordinates in mm."""
    n = min(_FIRST, len(export.line))
    names = {
        "group": export.group,
        "target": export.target,
        "time": export.time,
    }
    words = {key: [None] * n if column is None else column[:n].to_pylist()
             for key, column in names.items()}  # fmt: skip
    words["time"] = [shown(one) for one in words["time"]]
    xyz = [[float(x) for x in row] for row in (export.position[:n] * MM).round(6)]
    return tuple(
        {"group": words["group"][k], "target": words["target"][k]}
        | dict(zip(("x_mm", "y_mm", "z_mm"), xyz[k], strict=True))
        | {"time": words["time"][k]}
        for k in range(n)
    )


def _as_toml(found: TableProposal) -> str:
    """[tracker] and [tracker.mapping], with alternative answers of open questions as comments."""
    others: dict[str, list[str]] = {
        one.about: [in_toml(other.said) for other in one.answers[1:]] for one in found.questions
    }
    entries = {word: value for word, value in found.hints if value is not None}
    mapping = entries.pop("mapping", None)
    lines = ["[tracker]"]
    for word, value in entries.items():
        behind = f"   # or {', '.join(others[word])}" if others.get(word) else ""
        lines.append(f"{word} = {_value(value)}{behind}")
    if mapping:
        lines += ["", "[tracker.mapping]", *mapping_lines(mapping)]
    lines += [f"# or: {one}" for one in others.get("columns") or others.get("instrument", [])]
    return "\n".join(lines) + "\n"


def mapping_lines(mapping: Columns) -> list[str]:
    """The lines below [tracker.mapping]."""
    values = {word: getattr(mapping, word) for word in type(mapping).model_fields}
    columns = ", ".join(f"{role} = {_value(one)}" for role, one in values.pop("columns").items())
    lines = [f"{word} = {_value(one)}" for word, one in values.items() if one is not None]
    return [*lines, f"columns = {{ {columns} }}"]


def _value(value: Any) -> str:
    return in_toml(value) if isinstance(value, str) else str(value)
