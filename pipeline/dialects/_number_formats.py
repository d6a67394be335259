"""Numbers of a workbook as Excel shows them: scaled, and with the words of their number format.

A cell that holds 0.5 in the format `0%` shows 50%, and one that holds 1.5 in `0.0" mm"` 1.5 mm. It
is read as in the CSV file that Excel saves of it, but with all digits of the number.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from html import unescape
from itertools import takewhile

POINT = "\ue000"
"""Decimal mark of a number among words, until that of the file is known."""
IN_FORMAT = "in the number format"
"""Words between a number and a format that shows another one."""
_QUOTED = rb"""(?:"[^"]*"|'[^']*'|[^"'<>])*"""
_NAME = rb"(?:[^\s<>/]+:)?"
_FORMATS, _STYLES = (
    re.compile(rb"<%s%s[\s>].*?</%s%s>" % (_NAME, name, _NAME, name), re.DOTALL)
    for name in (b"numFmts", b"cellXfs")
)
_FORMAT, _STYLE = (
    re.compile(rb"<%s%s\s(%s)>" % (_NAME, name, _QUOTED)) for name in (b"numFmt", b"xf")
)
_ID = re.compile(rb"""\bnumFmtId\s*=\s*["'](\d+)["']""")
_CODE = re.compile(rb"""\bformatCode\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_OWN = {9: "0%", 10: "0.00%", **dict.fromkeys((5, 6, 7, 8, 42, 44), '"$"0')}
"""Formats that a workbook does not write out, by number (ECMA-376, 18.8.30): per cent, and amounts
of money; the others show the number, or a date."""
_PIECES = re.compile(
    r'"(?P<quoted>[^"]*)"?|\\(?P<escaped>.)|[_*].|\[\$(?P<currency>[^\]-]*)[^\]]*\]'
    r"|\[(?P<test>[<>=]+ *-?[0-9.]+)\]|\[(?P<clock>h+|m+|s+)\]|\[(?P<other>[^\]]*)\]"
    r"|(?P<end>;)|(?P<digit>General|[0#?@]|(?<=/)[1-9][0-9]*)|(?P<comma>,)|(?P<point>\.)"
    r"|(?P<percent>%)|(?P<power>E[+-])|(?P<date>[ymdhs])|(?P<era>[a-z])|(?P<plain>.)",
    re.IGNORECASE | re.DOTALL,
)
"""The parts of a format (ECMA-376, 18.8.31); `_` and `*` make blanks of what follows them."""
_BLANK = " \u00a0\u202f\u2009'\u2019"
"""Characters that may stand between thousands."""
_MINUS = "-\u2212\u2013\u2014"


def telling(styles: bytes) -> dict[int, str]:
    """Number formats that show more than the number, by the index of the cell's style.

    Dates and times are left out: they are cells of another type.

    Args:
        styles: The part xl/styles.xml of a workbook.
    """
    written = {}
    for entry in _FORMAT.findall(b"".join(_FORMATS.findall(styles)[:1])):
        number, code = _ID.search(entry), _CODE.search(entry)
        if number and code:
            written[int(number[1])] = unescape(
                (code[1] or code[2] or b"").decode("utf-8", "replace")
            )
    known = _OWN | written
    entries = _STYLE.findall(b"".join(_STYLES.findall(styles)[:1]))
    ids = [int(found[1]) if (found := _ID.search(entry)) else 0 for entry in entries]
    return {k: known[one] for k, one in enumerate(ids) if one in known and _tells(known[one])}


def _tells(code: str) -> bool:
    """Whether a format shows more than a number, or numbers by sign, and no date or time."""
    sections = _sections(code)
    if any(one.has("date") for one in sections):
        return False
    return len(sections) > 1 or sections[0].tells()


@dataclass(frozen=True)
class _Section:
    """A part of a format between semicolons: how numbers of one sign, or in a range, are shown.

    Attributes:
        pieces: Kind and text of its parts; the kinds are `word`, `digit`, `comma`, `point`,
            `percent`, `power`, `test`, `date`, `era` and `other`, which is a colour or language.
    """

    pieces: tuple[tuple[str, str], ...]

    def has(self, kind: str) -> bool:
        """Whether there is such a part."""
        return any(kind == one for one, _ in self.pieces)

    def tells(self) -> bool:
        """Whether it shows more than a number."""
        begin, end = self.ends
        parted = not _of_thousands(self.pieces[begin:end])
        return bool(self.words.strip()) or self.has("era") or self.thousands > 0 or parted

    @property
    def test(self) -> str:
        """The condition under which it applies, empty if it has none."""
        return next((text for kind, text in self.pieces if kind == "test"), "")

    @property
    def words(self) -> str:
        """What it shows beside digits."""
        return "".join(text for kind, text in self.pieces if kind in ("word", "percent"))

    @property
    def ends(self) -> tuple[int, int]:
        """Index of the first digit, and of the part behind the last one; equal if there is none."""
        places = [k for k, (kind, _) in enumerate(self.pieces) if kind in ("digit", "power")]
        return (places[0], places[-1] + 1) if places else (0, 0)

    @property
    def thousands(self) -> int:
        """Number of commas behind the last digit before the point; each divides by 1000."""
        kinds = "".join(
            {"digit": "d", "comma": ",", "point": "."}.get(k, "") for k, _ in self.pieces
        )
        found = re.search(r"d(,+)(?:\.|$)", kinds)
        return len(found[1]) if found else 0

    def said(self, begin: int, end: int | None = None) -> str:
        """The words among some of its parts."""
        return _Section(self.pieces[begin:end]).words


def _sections(code: str) -> list[_Section]:
    """The sections of a format."""
    out: list[list[tuple[str, str]]] = [[]]
    for found in _PIECES.finditer(code):
        kind = found.lastgroup
        if kind == "end":
            out.append([])
        elif kind in ("quoted", "escaped", "currency", "plain", None):
            out[-1].append(("word", found[kind] if kind else " "))
        else:
            out[-1].append(("date" if kind == "clock" else kind, found[kind]))
    return [_Section(tuple(one)) for one in out]


def shown(number: str, code: str) -> str:
    """A number as its format shows it, with all of its digits and `POINT` for a decimal mark.

    If the format shows something else, as a number without its sign, the text says so.

    Args:
        number: Content of the cell.
        code: Its number format.
    """
    try:
        value = Decimal(repr(float(number)))
    except ValueError:
        return number
    if not value.is_finite():
        return number
    section, signed = _applies(value, _sections(code))
    text = _written(value, section, signed)
    return f"{number} {IN_FORMAT} {code}" if text is None else text


def _applies(value: Decimal, sections: Sequence[_Section]) -> tuple[_Section, bool]:
    """The section for a number, and whether the sign is among its words."""
    numbers = sections[:3]
    if any(one.test for one in numbers):
        return next((one for one in numbers if _meets(value, one.test)), numbers[-1]), False
    place = 0 if value > 0 or len(numbers) == 1 else 1 if value < 0 else 2
    return numbers[place if place < len(numbers) else 0], value < 0 and place == 1


def _meets(value: Decimal, test: str) -> bool:
    """Whether a number meets a condition, as `>=1000`; an empty one is always met."""
    found = re.fullmatch(r"([<>=]+) *(.*)", test)
    if not found:
        return True
    than = Decimal(found[2])
    both = {"<": value < than, ">": value > than, "=": value == than}
    return any(both[one] for one in found[1])


def _written(value: Decimal, section: _Section, signed: bool) -> str | None:
    """A number with the words of a section; None if they do not say what the number is."""
    begin, end = section.ends
    before, behind = section.said(0, begin), section.said(end)
    if section.has("era"):
        return None
    if begin == end:  # nothing but words, or a hidden number
        bare = section.words.strip()
        return bare if bare.strip(_MINUS) else _digits(value)
    if signed:
        if not (found := _unsigned(before, behind, section.has("other"))):
            return None
        before, behind = found
    if not value:
        before = before.strip(_MINUS + _BLANK)
    if section.thousands and behind.strip() in _NO_UNIT:
        return None
    return _between(before, behind, value, section)


def _between(before: str, behind: str, value: Decimal, section: _Section) -> str | None:
    """A number as a section scales it, between its words; None if some are behind the point."""
    per_cent = sum(kind == "percent" for kind, _ in section.pieces)
    scale = 2 * per_cent - 3 * section.thousands
    text = _laid_out(value.scaleb(scale), section)
    alone = before.strip(_BLANK), behind.strip(_BLANK)
    if text is None or alone in (("", ""), ("+", "")):
        return text
    return f"{before.lstrip()}{text}{behind.rstrip()}"


_NO_UNIT = ("", "M")
"""What may stand behind a number in thousands or millions and is no unit: nothing tells whether the
title means what is shown or what is stored, and M is a million here, no metre."""


def _unsigned(before: str, behind: str, coloured: bool) -> tuple[str, str] | None:
    """The words of a negative number without those that say so; None if none does."""
    bare = before.strip(_BLANK)
    if bare.startswith(tuple(_MINUS)):
        return bare[1:], behind
    if before.count("(") == behind.count(")") == 1:
        return before.replace("(", ""), behind.replace(")", "")
    return (before, behind) if coloured else None


def _laid_out(value: Decimal, section: _Section) -> str | None:
    """The digits of a number with the words among them; None if these are behind the point."""
    begin, end = section.ends
    pieces = section.pieces[begin:end]
    inner = _Section(pieces)
    point = next((k for k, (kind, _) in enumerate(pieces) if kind == "point"), len(pieces))
    if inner.said(point).strip():
        return None
    if inner.has("power") or "/" in inner.words or _of_thousands(pieces):
        padded = section.words.strip() and not inner.has("point") and not inner.has("power")
        zeros = sum(text == "0" for _, text in pieces) if padded else 0
        return _digits(value, zeros)
    return _among(value, pieces[:point])


def _of_thousands(pieces: Sequence[tuple[str, str]]) -> bool:
    """Whether all words among digits are blanks between thousands."""
    whole = [*takewhile(lambda one: one[0] not in ("point", "power"), pieces)]
    kinds = "".join("d" if kind == "digit" else " " for kind, _ in whole if kind != "comma")
    blank = not _Section(tuple(whole)).words.strip(_BLANK)
    return blank and all(len(group) % 3 == 0 for group in kinds.split()[1:])


def _among(value: Decimal, pieces: Sequence[tuple[str, str]]) -> str:
    """The digits of a number in the places of a format, with the words between them."""
    whole, _, rest = _digits(abs(value)).partition(POINT)
    out, places = "", sum(kind == "digit" for kind, _ in pieces)
    for kind, text in reversed(pieces):
        if kind == "digit":
            places -= 1
            digits, whole = (whole[-1:], whole[:-1]) if places else (whole, "")
            out = (digits or "0") + out
        elif kind == "word":
            out = text + out
    return ("-" if value < 0 else "") + out + (POINT + rest if rest else "")


def _digits(value: Decimal, zeros: int = 0) -> str:
    """All digits of a number, of a whole one at least `zeros`."""
    plain = float(value)
    if plain.is_integer() and abs(plain) < 2**53:
        return f"{int(plain):0{zeros + (plain < 0)}d}"
    return repr(plain).replace(".", POINT)
