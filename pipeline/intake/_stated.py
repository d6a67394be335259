"""Statements of the lines above a table: kind of coordinates, units, sense of azimuths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.base.errors import InputError
from pipeline.dialects._coordinates import KIND_WORDS
from pipeline.dialects._named import UNIT_LINE, WORD, said_units
from pipeline.intake._sheet import Sheet
from pipeline.readers._units import ANGLE_WORDS, UNIT_WORDS


@dataclass(frozen=True)
class TableStatements:
    """Statements of the lines above a table, which hold for the whole table.

    Attributes:
        kinds: Kinds of coordinates.
        units: Units of length.
        angles: Units of angles.
        senses: Senses in which azimuths increase.
    """

    kinds: frozenset[str]
    units: frozenset[str]
    angles: frozenset[str]
    senses: frozenset[str]

    @classmethod
    def of(cls, found: Sheet) -> TableStatements:
        """Collect words from lines about units or the kind of coordinates, and from no others.

        A reflector's diameter in millimetres says nothing about the coordinates. Only the sense of
        azimuths is taken from any line.
        """
        kinds, units, angles, senses = set(), set(), set(), set()
        for line in found.preamble:
            words = WORD.findall(line.lower())
            senses |= _senses(words)
            here = {KIND_WORDS[word] for word in words if word in KIND_WORDS}
            kinds |= here
            if not here and not UNIT_LINE.search(line):
                continue
            said = said_units(line, of_coordinates=True)
            units |= said & {*UNIT_WORDS.values()}
            angles |= said & {*ANGLE_WORDS.values()}
        return cls(*map(frozenset, (kinds, units, angles, senses)))

    def only(self, what: str) -> str | None:
        """The only statement on something, None if there is none.

        Raises:
            InputError: There are several.
        """
        found = sorted(getattr(self, what))
        if len(found) > 1:
            raise InputError(
                f"the lines above the table name several {what} ({', '.join(found)})",
                "correct them, or describe the table in [tracker.mapping] of campaign.toml",
            )
        return found[0] if found else None


def _senses(words: Sequence[str]) -> set[str]:
    """Sense in which azimuths increase, by the words of a line.

    Coordinates called spherical or cylindrical count from x towards y, those called polar may not.
    """
    if "clockwise" in words or "cw" in words:
        return {"counter-clockwise" if {"counter", "anti"} & {*words} else "clockwise"}
    from_x = {"spherical", "cylindrical", "counterclockwise", "anticlockwise", "ccw"}
    return {"counter-clockwise"} if from_x & {*words} else set()
