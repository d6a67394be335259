"""What people read on paper, in their language: the certificate and the measurement sheet.

Both are made in English as ever. Here every text of them is looked up in a catalogue of gettext,
as a whole, else as one of the texts with `{}` where something varies; what stands there is looked
up in turn. A text that begins or ends with a space, a comma or a semicolon is said behind or before
another one. What is in no catalogue, as a name or a sentence of the user's, stays as it is. English
asks no catalogue.
"""

from __future__ import annotations

import gettext
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import StrEnum
from functools import cache, cached_property
from importlib import resources
from typing import Any, TypeVar

_Any = TypeVar("_Any")
Say = Callable[[str], str]
"""A text in another language."""


class Language(StrEnum):
    """The language of a certificate or a sheet."""

    EN = "en"
    DE = "de"
    FR = "fr"


_KEPT = {"kind", "name", "key", "tone", "sort", "link", "language", "held"}
"""Fields of the records of a report that nobody reads, or that are no words."""

_GLUE = " ,;"
"""Signs at an end of a text that is said beside another one."""

_SPECIFIC = 4
"""So many letters make a text of its own; of one with fewer the parts are looked up first."""

_PARTS = (r"; ", r"(?<=[.!?]) (?=[A-Z])", r", ")
"""Where a text is cut into parts, the coarsest first."""

_NUMBER = r"(?<!\w)[-−+]?\d+(?:\.\d+)?"
_FIGURES = re.compile(
    rf"{_NUMBER}|[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+|°C|[±×→%°σ(),;=\s]|U\b|k\b|\b[AEJS]\d\b"
    r"|\b[pnµmkMG]?(?:N|m|rad|g|deg|s|h|min)\b(?:[·/][\w()·/]*)?"
)
"""What a text of numbers consists of: numbers, units, names of axes, signs between them."""

_WORD = re.compile(r"(?<![\w./:-])[a-z]{2,}(?![\w./:]|-\d)")
"""A word, and no part of a name as `loads.csv` or `pose01_rep1`."""

_NAME = 2
"""A name has fewer spaces."""


def spoken(language: str) -> Say:
    """How a text is said in a language."""
    return str if language == Language.EN else _catalogue(Language(language)).say


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


def capital_like(text: str, there: str) -> str:
    """With a capital where the English has one."""
    return there[:1].upper() + there[1:] if text[:1].isupper() else there


@dataclass(frozen=True)
class _Said:
    """A text in another language, and whether all of its words are."""

    text: str
    whole: bool = True


@dataclass
class _Part:
    """What varies in a text: said where a catalogue has `{0}`, as it is where it has `{0!r}`.

    `{0:small}` begins with a small letter.
    """

    text: str
    find: Callable[[str], _Said]
    whole: bool = True

    def __format__(self, spec: str) -> str:
        found = self.find(self.text)
        self.whole &= found.whole
        return _small(found.text) if spec == "small" else found.text

    def __repr__(self) -> str:
        self.whole &= self.text.count(" ") < _NAME or not _prose(self.text)
        return self.text


class Catalogue(gettext.GNUTranslations):
    """The texts of a language: whole ones, and those in which something varies."""

    @cached_property
    def texts(self) -> dict[str, str]:
        """English texts and how they are said."""
        every: dict[str, str] = vars(self)["_catalog"]
        return {one: there for one, there in every.items() if one}

    @cached_property
    def varied(self) -> Sequence[tuple[bool, re.Pattern[str], str]]:
        """Whether a text is one of its own, its pattern and how it is said, the longest first."""
        those = [_between(one, there) for one, there in self.texts.items() if _varies(one)]
        return [
            (
                _letters(one) >= _SPECIFIC,
                re.compile("(.*?)".join(map(re.escape, one.split("{}"))), re.DOTALL),
                there,
            )
            for one, there in sorted(those, key=lambda pair: -_letters(pair[0]))
        ]

    def say(self, text: str) -> str:
        """A text in this language; what is in no catalogue as it is, numbers apart."""
        plain = text.replace("\N{NO-BREAK SPACE}", " ")
        found = self.find(plain).text
        return text if found == plain else found

    def find(self, text: str) -> _Said:
        """The first way to say a text that leaves no word of it in English, else the first."""
        if text not in self._found:
            first = None if (shown := _figures(text)) == text else _Said(shown)
            for one in () if first else self._ways(text):
                first = first or one
                if one.whole:
                    first = one
                    break
            self._found[text] = first or _Said(text, not _prose(text))
        return self._found[text]

    @cached_property
    def _found(self) -> dict[str, _Said]:
        return {}

    def _ways(self, text: str) -> Iterator[_Said]:
        if (there := self.texts.get(text)) is not None:
            yield _Said(there)
        elif text[:1].isupper() and (there := self.texts.get(_small(text))) is not None:
            yield _Said(capital_like(text, there))
        yield from self._filled(text, specific=True)
        yield from self._parted(text)
        yield from self._filled(text, specific=False)
        if text[-1:] == ".":
            rest = self.find(text[:-1])
            if rest.text != text[:-1]:
                yield _Said(f"{rest.text}.", rest.whole)

    def _filled(self, text: str, *, specific: bool) -> Iterator[_Said]:
        """Texts in which something varies."""
        for own, pattern, there in self.varied:
            if own == specific and (
                found := pattern.fullmatch(text) or pattern.fullmatch(_small(text))
            ):
                parts = [_Part(one, self.find) for one in found.groups()]
                said_ = capital_like(text, there.format(*parts))
                yield _Said(said_, all(one.whole for one in parts))

    def _parted(self, text: str) -> Iterator[_Said]:
        """Several texts beside each other, some of which are known."""
        for cut in _PARTS:
            parts = re.split(cut, text)
            found = [self.find(one) for one in parts] if len(parts) > 1 else []
            if found and any(one.text != part for one, part in zip(found, parts, strict=True)):
                ends = [*re.findall(cut, text), ""]
                there = "".join(a.text + b for a, b in zip(found, ends, strict=True))
                yield _Said(there, all(one.whole for one in found))


def _figures(text: str) -> str:
    """A text of numbers with decimal commas, and semicolons between them; another as it is."""
    if not re.search(r"\d\.\d", text) or _FIGURES.sub("", text):
        return text
    return re.sub(r"(?<=\d)\.(?=\d)", ",", text.replace(", ", "; "))


def _prose(text: str) -> bool:
    """Whether it has an English word, and not only names and numbers."""
    return bool(_WORD.search(_FIGURES.sub(" ", text)))


def _small(text: str) -> str:
    return text[:1].lower() + text[1:]


def _varies(text: str) -> bool:
    return "{}" in text or text[0] in _GLUE or text[-1] in _GLUE


def _between(text: str, there: str) -> tuple[str, str]:
    """A text that is said beside another one as one in which that varies."""
    count = text.count("{}")
    if text[-1] in _GLUE:
        text, there = f"{text}{{}}", f"{there}{{{count}}}"
    if text[0] in _GLUE:
        there = re.sub(r"\{(\d)", lambda one: f"{{{int(one[1]) + 1}", there)
        text, there = f"{{}}{text}", f"{{0}}{there}"
    return text, there


def _letters(text: str) -> int:
    """How much of a text is said, the parts that vary apart."""
    return len(re.sub(r"\{\}|[^\w]", "", text))


@cache
def _catalogue(language: Language) -> Catalogue:
    with (resources.files("pipeline.base") / "locale" / f"{language}.mo").open("rb") as compiled:
        return Catalogue(compiled)
