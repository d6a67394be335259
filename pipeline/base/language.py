"""Translation of printed documents: the certificate and the measurement sheet.

Both are composed in English, and their texts are translated behind a door.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from enum import StrEnum
from typing import Any, TypeVar

from pipeline.base import doors

_Any = TypeVar("_Any")
Say = Callable[[str], str]
"""Function that translates a text."""


class Language(StrEnum):
    """Language of a certificate or a sheet."""

    EN = "en"
    DE = "de"
    FR = "fr"


_KEPT = {"kind", "name", "key", "tone", "sort", "link", "language", "held"}
"""Fields of report records that are never displayed, or are not words."""

_TRANSLATOR = "pipeline.house.catalogue:translator"
"""Door of the catalogues of other languages."""


def spoken(language: str) -> Say:
    """Translator into a language.

    Raises:
        UsageError: It is not English, and this installation lacks the catalogues.
    """
    if language == Language.EN:
        return str
    translator: Say = doors.opened(_TRANSLATOR)(language)
    return translator


def translated(record: _Any, say: Say) -> _Any:
    """Translate all texts of a report record; fields in `_KEPT` and other objects are unchanged."""
    if isinstance(record, str):
        return say(record)  # type: ignore[return-value]
    if isinstance(record, tuple):
        return tuple(translated(one, say) for one in record)  # type: ignore[return-value]
    if not is_dataclass(record):
        return record
    new: dict[str, Any] = {
        one.name: translated(getattr(record, one.name), say)
        for one in fields(record)
        if one.name not in _KEPT
    }
    return replace(record, **new)  # type: ignore[type-var]
