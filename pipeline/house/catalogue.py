"""Gettext catalogues: texts of certificate and sheet in other languages.

Each text is looked up as a whole, or as a text with `{}` for its variable parts, which are looked
up in turn. An entry that begins or ends with a space, a comma or a semicolon is used next to
another text. Text that is in no catalogue, such as a name or a sentence of the user's, is left
unchanged. English needs no catalogue.
"""

from __future__ import annotations

import gettext
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import resources

_GLUE = " ,;"
"""Characters at an end of a text that is used next to another one."""

_SPECIFIC = 4
"""Minimum number of letters of a specific text; for texts with fewer the parts are looked up
first."""

_PARTS = (r"; ", r"(?<=[.!?]) (?=[A-Z])", r", ")
"""Separators at which a text is split into parts, the coarsest first."""

_NUMBER = r"(?<!\w)[-−+]?\d+(?:\.\d+)?"
_FIGURES = re.compile(
    rf"{_NUMBER}|[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+|°C|[±×→%°σ(),;=\s]|k\b|\b(?:[A-Z]|[A-Za-z]\w*[\d_]\w*)\b"
    r"|\b[pnµmkMG]?(?:N|m|rad|g|deg|s|h|min)\b(?:[·/][\w()·/]*)?"
)
"""Components of a text of numbers: numbers, units, names of axes, signs between them."""

_WORD = re.compile(r"(?<![\w./:-])[a-z]{2,}(?![\w./:]|-\d)")
"""A word that is not part of a name such as `loads.csv` or `pose01_rep1`."""

_NAME = 2
"""Number of spaces from which a text is more than a name."""


def _capital_like(text: str, there: str) -> str:
    """Capitalise the translation if the English text is capitalised."""
    return there[:1].upper() + there[1:] if text[:1].isupper() else there


@dataclass(frozen=True)
class _Said:
    """A translated text, and whether all of its words were translated."""

    text: str
    whole: bool = True


@dataclass
class _Part:
    """Variable part of a text: translated where a catalogue has `{0}`, unchanged where `{0!r}`.

    `{0:small}` begins with a lower-case letter.
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
    """Texts of a language: complete ones, and those with variable parts."""

    @cached_property
    def texts(self) -> dict[str, str]:
        """English texts and their translations."""
        every: dict[str, str] = vars(self)["_catalog"]
        return {one: there for one, there in every.items() if one}

    @cached_property
    def varied(self) -> Sequence[tuple[bool, re.Pattern[str], str]]:
        """Whether a text is specific, its pattern and translation, the longest first."""
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
        """Translate a text; without a catalogue entry only its numbers are adapted."""
        plain = text.replace("\N{NO-BREAK SPACE}", " ")
        found = self.find(plain).text
        return text if found == plain else found

    def find(self, text: str) -> _Said:
        """The first translation that leaves no English word, else the first one."""
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
            yield _Said(_capital_like(text, there))
        yield from self._filled(text, specific=True)
        yield from self._parted(text)
        yield from self._filled(text, specific=False)
        if text[-1:] == ".":
            rest = self.find(text[:-1])
            if rest.text != text[:-1]:
                yield _Said(f"{rest.text}.", rest.whole)

    def _filled(self, text: str, *, specific: bool) -> Iterator[_Said]:
        """Translations by texts with variable parts."""
        for own, pattern, there in self.varied:
            if own == specific and (
                found := pattern.fullmatch(text) or pattern.fullmatch(_small(text))
            ):
                parts = [_Part(one, self.find) for one in found.groups()]
                said_ = _capital_like(text, there.format(*parts))
                yield _Said(said_, all(one.whole for one in parts))

    def _parted(self, text: str) -> Iterator[_Said]:
        """Translations part by part, if some parts are known."""
        for cut in _PARTS:
            parts = re.split(cut, text)
            found = [self.find(one) for one in parts] if len(parts) > 1 else []
            if found and any(one.text != part for one, part in zip(found, parts, strict=True)):
                ends = [*re.findall(cut, text), ""]
                there = "".join(a.text + b for a, b in zip(found, ends, strict=True))
                yield _Said(there, all(one.whole for one in found))


def _figures(text: str) -> str:
    """A text of numbers with decimal commas and separated by semicolons; others unchanged."""
    if not re.search(r"\d\.\d", text) or _FIGURES.sub("", text):
        return text
    return re.sub(r"(?<=\d)\.(?=\d)", ",", text.replace(", ", "; "))


def _prose(text: str) -> bool:
    """Whether it contains an English word, besides names and numbers."""
    return bool(_WORD.search(_FIGURES.sub(" ", text)))


def _small(text: str) -> str:
    return text[:1].lower() + text[1:]


def _varies(text: str) -> bool:
    return "{}" in text or text[0] in _GLUE or text[-1] in _GLUE


def _between(text: str, there: str) -> tuple[str, str]:
    """Write a text that is used next to another one with `{}` in that one's place."""
    count = text.count("{}")
    if text[-1] in _GLUE:
        text, there = f"{text}{{}}", f"{there}{{{count}}}"
    if text[0] in _GLUE:
        there = re.sub(r"\{(\d)", lambda one: f"{{{int(one[1]) + 1}", there)
        text, there = f"{{}}{text}", f"{{0}}{there}"
    return text, there


def _letters(text: str) -> int:
    """Number of letters in the fixed parts of a text."""
    return len(re.sub(r"\{\}|[^\w]", "", text))


@cache
def _catalogue(language: str) -> Catalogue:
    """The catalogue of a language."""
    with (resources.files(__package__) / "locale" / f"{language}.mo").open("rb") as compiled:
        return Catalogue(compiled)


def translator(language: str) -> Callable[[str], str]:
    """Function that translates a text into a language."""
    return _catalogue(language).say
