"""Titles of logs as people keep them: two lines of them, or one that comes again for each pull."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

from pipeline.dialects._cells import IN_BRACKETS, from_above, is_number

ALIKE = {"°": "deg", "kg": "kgf", "kp": "kgf"}
"""Synonyms of units: a scale in kilograms shows kilogram-force."""
UNITS = {"n", "kn", "dan", "kgf", "lbf", "g", "lb", "m", "mm", "in", "deg", "rad", "nm", "knm"}
"""Units that, in the brackets of a title, can contradict the name assigned to the column."""
BELOW = {*UNITS, *ALIKE, "degrees", "grad", "kp", ""}
"""Words that may appear in a line of units below the titles."""


def titles(first: list[str], below: list[str]) -> tuple[list[str], int]:
    """The titles of a line with those of the line below it, and how many of the two they are."""
    own = _apart(first)
    both = _in_two_lines(own, below)
    return ([*map(_joined, *zip(*both, strict=True))], 2) if both else (own, 1)


def _joined(head: str, below: str) -> str:
    return with_unit(head, below) if below.lower() in BELOW else f"{head} {below}"


def _apart(titles: Sequence[str]) -> list[str]:
    """The titles; one that comes again behind numbered ones with each of these before it.

    `Pull 1 kg`, `Hook`, `Pull 2 kg`, `Hook` are what each pull was and where it was hooked.
    """
    digit = re.compile("[0-9]").search  # a title with a number of its own is there twice
    again = {one for one in titles if one and titles.count(one) > 1 and not digit(one)}
    both = enumerate(pairwise(["", *titles]))
    heads = {k: before for k, (before, one) in both if one in again}
    numbered = all(map(digit, heads.values()))
    if not numbered or len({*heads.values()}) < len(heads):
        return [*titles]
    return [f"{heads[k]} {one}" if k in heads else one for k, one in enumerate(titles)]


def _in_two_lines(titles: Sequence[str], below: Sequence[str]) -> list[tuple[str, str]]:
    """Title of each column, and what a second line says below it; empty where it says the same.

    Some of a first line head several of the second, `Load-1` those of `kg` and `Hook`. None at all
    if the lines are no such titles: each below a gap differs from its neighbour.
    """
    heads = from_above(titles)
    gaps = [k for k, own in enumerate(titles) if own != heads[k] and below[k]]
    same = [k for k in gaps if below[k] == below[k - 1]]
    several = len({*filter(None, titles)}) > 1
    if not gaps or same or not several or any(map(is_number, below)):
        return []
    both = zip(titles, heads, below, strict=True)
    return [(head, own) if own not in ("", title) else (title, "") for title, head, own in both]


def with_unit(title: str, unit: str) -> str:
    """A title with the unit of its column appended, if it has none itself."""
    return f"{title} [{unit}]" if unit and not parted(title)[1] else title


def parted(title: str) -> tuple[str, str]:
    """Split a title into its text and the unit in brackets at its end."""
    unit = next((one for one in IN_BRACKETS.finditer(title) if one.end() == len(title)), None)
    return (title[: unit.start()], unit[1]) if unit else (title, "")
