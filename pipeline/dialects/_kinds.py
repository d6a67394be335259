"""Rows of several kinds in one table: nominal beside measured ones, and those of another frame.

A column of few words, or a line between the rows, tells them apart.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError, listed
from pipeline.readers._cells import shown

NEAR = 0.01
"""Movement over distance up to which a place is the same: what a load or a repetition moves."""
_NOMINAL = {
    "nominal", "nominals", "nom", "soll", "sollwert", "sollwerte", "sollpunkte", "goal", "cad",
    "design", "theoretical", "theoretisch", "nominell", "théorique", "commanded", "planned",
}  # fmt: skip
"""Words of rows that nobody has measured."""
_MEASURED = {
    "measured", "measurement", "meas", "actual", "actuals", "act", "ist", "istwert", "istwerte",
    "istpunkte", "gemessen", "messwert", "messwerte", "observed", "mesuré", "uppmätt",
}  # fmt: skip
_OF_POINTS = {
    "point", "points", "punkt", "punkte", "value", "values", "werte", "coordinates", "koordinaten",
    "position", "positions", "data", "daten", "section",
}  # fmt: skip
"""Words that leave a line between rows that of a section."""
_MOST_WORDS = 4
"""Words of a column at most that tell kinds of rows apart; more are names."""
_FEWEST = 3
"""Names at least that come again for every word: fewer may be chance."""
_MOST = 0.8
"""Share of the names that come as often for one word as for the other."""


def few(cells: Iterable[str]) -> set[str]:
    """The words of a column that may tell kinds of rows apart; none where it holds more."""
    words = {cell for cell in cells if cell}
    wordy = any(any(map(str.isalpha, word)) for word in words)
    return words if wordy and len(words) <= _MOST_WORDS else set()


def nominal(words: Iterable[str]) -> set[str]:
    """The words of rows that nobody has measured, where others are there beside them."""
    all_of_them = {word for word in words if word}
    found = {word for word in all_of_them if _says(word) & _NOMINAL}
    found -= {word for word in found if _says(word) & _MEASURED}
    return found if found < all_of_them else set()


def section(line: str) -> str:
    """What a line says of the rows below it: `nominal`, `measured` or nothing."""
    words = _says(line)
    if len(words & (_NOMINAL | _MEASURED)) != 1 or words - _NOMINAL - _MEASURED - _OF_POINTS:
        return ""
    return "nominal" if words & _NOMINAL else "measured"


def _says(words: str) -> set[str]:
    return set(re.findall(r"[^\W\d_]+", words.lower()))


def apart(names: Sequence[object], words: Sequence[str], position: Array) -> bool:
    """Whether the same names are elsewhere for each word: in another frame, or not measured.

    Args:
        names: Group and target of each reading.
        words: What a column says of each.
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
    """What is asked where a column tells rows apart in which the same targets are elsewhere."""
    found = sorted({*words})
    return InputError(
        f'column "{shown(title)}" holds {listed(found)}, and the same targets are elsewhere for '
        "each",
        f'say which is meant: instrument = "{shown(found[0])}" (or another) in [tracker.mapping] '
        f'of campaign.toml, with instrument = "{shown(title)}" among its columns',
        line=line,
    )


def _alike(counts: dict[str, int]) -> bool:
    return len({*counts.values()}) == 1


_AVERAGES = {"average", "averaged", "avg", "mean", "mittelwert", "mittel", "gemittelt", "moyenne"}
"""What programs call the row that they compute from several shots."""


def is_average(word: str) -> bool:
    """Whether a word of a column says that a row was computed from others."""
    return bool({*re.findall(r"[^\W\d_]+", word.lower())} & _AVERAGES)
