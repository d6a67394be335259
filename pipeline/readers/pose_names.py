"""Poses with letters behind their number, as one that was measured again has: `4bis`, `7a`.

While files are read such a pose is one whole number, `coded`, the same in every log and export. Its
number among the poses of the campaign, `numbers`, follows once all files are read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from zlib import crc32

_FIRST = 1_500_000_000
"""Smallest code; with four letters it stays below `NUMBER_LIMIT`."""
_PLAIN = 1000
"""Number of poses that may have letters, and the step between `4` and `4bis` in the campaign."""
_LETTERS = 26 + 1
"""Base in which Latin letters are one number; 0 is none."""
_OTHERS = 100_000
"""Number of codes of words with any other letter, behind those of four Latin ones."""
_TRIED = 16
"""Codes tried for such a word, each in place of one that another word has."""
NAME = re.compile(r"0*(?P<number>[0-9]{1,3})[ _-]?(?P<letters>[^\W\d_]{1,4})")
"""The number of a pose and letters behind it."""
_words: dict[int, str] = {}
"""Words with other letters that were met, by their code: the same in every process, unless another
word was met that has it already, once in 100 000."""


def coded(name: str) -> int | None:
    """The code of a name such as `04bis`, in any case; None if it is none or no code is free."""
    found = NAME.fullmatch(name)
    if found is None:
        return None
    letters, word = 0, found["letters"].lower()
    for letter in word:
        letters = _LETTERS * letters + ord(letter) - ord("a") + 1
    if not word.isascii():
        first = crc32(word.encode()) % _OTHERS
        places = (_LETTERS**4 + (first + k) % _OTHERS for k in range(_TRIED))
        letters = next((one for one in places if _words.setdefault(one, word) == word), 0)
        if not letters:
            return None
    return _FIRST + _PLAIN * letters + int(found["number"])


def letters_of(pose: float) -> str:
    """Letters of a pose by its code; empty for a plain number."""
    out, rest = "", int(max(pose - _FIRST, 0)) // _PLAIN
    if rest in _words:
        return _words[rest]
    while rest:
        rest, letter = divmod(rest, _LETTERS)
        out = chr(ord("a") + letter - 1) + out
    return out


def plain(pose: int) -> int:
    """The number without the letters."""
    return (pose - _FIRST) % _PLAIN if letters_of(pose) else pose


def numbers(poses: Iterable[float]) -> dict[int, int]:
    """Number in the campaign of every pose with letters, by its code: 1004 for `4bis`.

    Each word has a thousand of its own, in the order of the alphabet; a further one where a pose
    has that number already.
    """
    every = {int(pose) for pose in poses}
    words = sorted({letters_of(pose) for pose in every} - {""})
    taken = {pose // _PLAIN for pose in every if not letters_of(pose)}
    free = (k for k in range(1, len(words) + len(taken) + 1) if k not in taken)
    block = dict(zip(words, free, strict=False))
    return {
        pose: _PLAIN * block[letters_of(pose)] + plain(pose)
        for pose in sorted(every)
        if letters_of(pose)
    }


def shown(pose: int) -> str:
    """The name of a pose by its code or number: `4bis`."""
    return f"{plain(pose)}{letters_of(pose)}"
