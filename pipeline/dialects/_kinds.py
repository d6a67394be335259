"""Tables with several kinds of rows: nominal and measured points, or points of two frames.

They are told apart by a column of few words, or by a line between the rows.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError, listed
from pipeline.readers._text import shortened

NEAR = 0.01
"""Displacement relative to distance up to which two positions count as the same place [1]; loads
and repeats move a target less."""
_NOMINAL = {
    "nominal", "nominals", "nom", "soll", "sollwert", "sollwerte", "sollpunkte", "goal", "cad",
    "design", "theoretical", "theoretisch", "nominell", "théorique", "commanded", "planned",
}  # fmt: skip
"""Words that mark rows as nominal, not measured."""
_MEASURED = {
    "measured", "measurement", "meas", "actual", "actuals", "act", "ist", "istwert", "istwerte",
    "istpunkte", "gemessen", "messwert", "messwerte", "observed", "mesuré", "uppmätt",
}  # fmt: skip
_OF_POINTS = {
    "point", "points", "punkt", "punkte", "value", "values", "werte", "coordinates", "koordinaten",
    "position", "positions", "data", "daten", "section",
}  # fmt: skip
"""Words that a section title may contain in addition."""
_MOST_WORDS = 4
"""Maximum number of distinct words in a column that distinguishes kinds of rows [1]; more are
names."""
_FEWEST = 3
"""Minimum number of names that occur with every word [1]: fewer may be chance."""
_MOST = 0.8
"""Minimum fraction of the names that occur equally often with each word [1]."""


def few(cells: Iterable[str]) -> set[str]:
    """The words of a column that may distinguish kinds of rows; none if it holds more."""
    words = {cell for cell in cells if cell}
    wordy = any(any(map(str.isalpha, word)) for word in words)
    return words if wordy and len(words) <= _MOST_WORDS else set()


def nominal(words: Iterable[str]) -> set[str]:
    """The words that mark rows as nominal, provided that other rows exist."""
    all_of_them = {word for word in words if word}
    found = {word for word in all_of_them if _says(word) & _NOMINAL}
    found -= {word for word in found if _says(word) & _MEASURED}
    return found if found < all_of_them else set()


def section(line: str) -> str:
    """The kind of rows below a section title: `nominal`, `measured` or empty."""
    words = _says(line)
    if len(words & (_NOMINAL | _MEASURED)) != 1 or words - _NOMINAL - _MEASURED - _OF_POINTS:
        return ""
    return "nominal" if words & _NOMINAL else "measured"


def _says(words: str) -> set[str]:
    return set(re.findall(r"[^\W\d_]+", words.lower()))


def apart(names: Sequence[object], words: Sequence[str], position: Array) -> bool:
    """Whether the same names have other positions for each word: in another frame, or nominal.

    Args:
        names: Group and target of each reading.
        words: Word in the column for each reading.
        position: Cartesian coordinates [any unit], shape (n, 3).
    """
    found: dict[object, dict[str, list[Array]]] = defaultdict(lambda: defaultdict(list))
    for name, word, place in zip(names, words, position, strict=True):
        found[name][word].append(place)
    kinds = {*words}
    both = [by for by in found.values() if _alike({word: len(by[word]) for word in kinds})]
    if len(kinds) == 1 or len(both) < max(_FEWEST, _MOST * len(found)):
        return False
    first = Counter(words).most_common()[-1][0]
    off = [
        np.linalg.norm(a - b) / np.linalg.norm(a)
        for by in both
        for word in kinds - {first}
        for a, b in zip(by[first], by[word], strict=True)
    ]
    return bool(np.median(off) > NEAR)


def several(title: str, words: Iterable[str], line: int | None) -> InputError:
    """Error that asks which rows are meant if the same targets have several positions."""
    found = sorted({*words})
    return InputError(
        f'column "{shortened(title)}" holds {listed(found)}, and the same targets are elsewhere '
        "for each",
        f'say which is meant: instrument = "{shortened(found[0])}" (or another) in '
        f'[tracker.mapping] of campaign.toml, with instrument = "{shortened(title)}" among its '
        "columns",
        line=line,
    )


def _alike(counts: dict[str, int]) -> bool:
    return len({*counts.values()}) == 1


_AVERAGES = {"average", "averaged", "avg", "mean", "mittelwert", "mittel", "gemittelt", "moyenne"}
"""Names that programs give to a row averaged from several shots."""


def is_average(word: str) -> bool:
    """Whether a word marks a row as computed from others."""
    return bool({*re.findall(r"[^\W\d_]+", word.lower())} & _AVERAGES)
