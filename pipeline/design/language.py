"""A measurement sheet in another language: its texts are data, one table for each language.

The sheet is made in English as ever. Here every text of it is looked up as a whole, else as one of
the texts with `{}` where something varies; what stands there is looked up in turn. What is in no
table, as a name or a sentence of the user's, stays as it is.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from enum import StrEnum
from functools import cache
from importlib import resources
from typing import Any, TypeVar

from pipeline.answer.words import capital

_Any = TypeVar("_Any")
Say = Callable[[str], str]
"""A text in another language."""


class Language(StrEnum):
    """The language of a sheet."""

    EN = "en"
    DE = "de"
    FR = "fr"


_KEPT = {"kind", "name", "key", "tone", "sort", "link", "language"}
"""Fields of the records of a report that nobody reads."""


def spoken(language: Language) -> Say:
    """How a text is said in a language."""
    return str if language is Language.EN else _Spoken(language).say


def said(record: _Any, say: Say) -> _Any:
    """A record of a report with all its texts said; cells of code stay."""
    if isinstance(record, str):
        return say(record)  # type: ignore[return-value]
    if isinstance(record, tuple):
        return tuple(said(one, say) for one in record)  # type: ignore[return-value]
    if not is_dataclass(record):
        return record
    new: dict[str, Any] = {
        one.name: said(getattr(record, one.name), say)
        for one in fields(record)
        if one.name not in _KEPT
    }
    return replace(record, **new)  # type: ignore[type-var]


class _Spoken:
    """The table of a language: whole texts, and those in which something varies."""

    def __init__(self, language: Language) -> None:
        whole, self.varied = _table(language)
        self.whole = whole

    def say(self, text: str) -> str:
        """A text in this language, or each of its parts between semicolons; else as it is."""
        plain = text.replace("\N{NO-BREAK SPACE}", " ")
        if (found := self._found(plain)) is not None:
            return found
        return "; ".join(map(self.say, plain.split("; "))) if "; " in plain else text

    def _found(self, text: str) -> str | None:
        if (known := self.whole.get(text)) is not None:
            return known
        if text[:1].isupper() and (lower := self.whole.get(text[0].lower() + text[1:])):
            return capital(lower)
        for pattern, there in self.varied:
            if found := pattern.fullmatch(text):
                return _capital_like(text, there.format(*map(self.say, found.groups())))
        return None


def _capital_like(text: str, there: str) -> str:
    """With a capital where the English has one."""
    return capital(there) if text[:1].isupper() else there


@cache
def _table(language: Language) -> tuple[dict[str, str], list[tuple[re.Pattern[str], str]]]:
    """Whole texts, and patterns of those in which something varies, the longest first."""
    path = resources.files("pipeline.design") / "languages" / f"{language}.toml"
    table = tomllib.loads(path.read_text("utf-8"))
    varied = sorted((one for one in table if "{}" in one), key=len, reverse=True)
    patterns = [
        (re.compile("(.+?)".join(map(re.escape, one.split("{}"))), re.DOTALL), table[one])
        for one in varied
    ]
    return {one: there for one, there in table.items() if "{}" not in one}, patterns
