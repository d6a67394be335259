"""Read workbooks (.xlsx) by converting the relevant sheet to delimited text.

Each row becomes one line with cells separated by tabs, so that line numbers are those of Excel.
"""

from __future__ import annotations

import copy
import datetime
import io
import re
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import replace
from functools import lru_cache
from html import escape, unescape
from typing import IO, Any

from python_calamine import CalamineError, CalamineSheet, CalamineWorkbook, SheetTypeEnum

from pipeline.base.errors import InputError, listed
from pipeline.base.files import UNREADABLE_ZIP
from pipeline.base.shown import too_large
from pipeline.dialects._number_formats import POINT, shown, telling
from pipeline.readers._text import LARGEST_WORKBOOK, Text, text

_UNPACKED = 1_000_000_000
"""Maximum unpacked size of a workbook [byte]; the XML of sheets is compressed to a tenth."""
_PIECE = 1 << 20
"""Size of the pieces that are unpacked at a time [byte]."""
_MOST_CELLS = 10_000_000
"""Maximum number of cells of a sheet, and of all that are read [1]: ten columns of Excel's million
rows; each takes a microsecond or more."""
_MOST_SHEETS = 500
"""Maximum number of sheets among which one is sought [1]: each is read as far as a file is."""
_CELLS, _ROWS = (re.compile(rb"<(?:[^\s<>/]+:)?%s[\s/>]" % name) for name in (b"c", b"row"))
_FAR = re.compile(rb"""\sr\s*=\s*["'](?:[A-Za-z]{4}|[A-Za-z]{0,3}\d{8})""")
"""References beyond XFD1048576, the last cell of Excel."""
_PLACE = re.compile(rb"""\sr\s*=\s*["']([A-Za-z]{0,3})(\d{1,7})["']""")
"""Reference of a cell, or number of a row."""
_MOST_SPANNED = 2 * _MOST_CELLS
"""Maximum number of cells from the first to the last one, empty ones included [1]: the reader has
32 byte for each, and ends the whole process if there is no memory for them."""
_REFERENCE = 16
"""Overlap of pieces so that no reference is cut [byte]."""
_MILLISECOND = 1000
"""Resolution of times [us]; Excel displays no finer times, and stores days as numbers that are
accurate to 1 us."""
_BREAKS = re.compile(r"[\t\r\n]+")
_HAS_ERROR = re.compile(rb"""\st\s*=\s*["']e["']""")
_ERROR = re.compile(rb"""(<(?:[^\s<>/]+:)?c\s[^<>]*?\bt\s*=\s*["'])e(?=["'])""")
"""Type of a cell that holds an error, as `#N/A`; the whole beginning of such a cell."""
_CELL_OR_VALUE = re.compile(
    rb"""(?P<cell><(?:[^\s<>/]+:)?c(?=[\s/>]))(?P<about>[^<>]*)"""
    rb"""|(?P<value><(?:[^\s<>/]+:)?v(?:\s[^<>]*)?>)(?P<content>[^<]*)"""
)
_TYPE = re.compile(rb"""\st\s*=\s*["'](?P<type>[^"']*)["']""")
_STYLE = re.compile(rb"""\ss\s*=\s*["'](\d+)["']""")
_SHEETS = "xl/worksheets/"
"""Folder of the sheets in a workbook."""
_STYLES = "xl/styles.xml"
"""Part of a workbook with its number formats."""
_MOST_STYLES = 50_000_000
"""Maximum size of that part [byte]; Excel writes 65 000 styles at most, in a fifth of it."""


def opened(
    name: str,
    data: bytes,
    sheet: str | None,
    mark: str | None,
    table: str | None,
    fits: Callable[[Text], int],
) -> Text:
    """Open a workbook as text, on behalf of `readers`.

    Raises:
        InputError: It is too large, or not exactly one sheet fits.
    """
    filled = sheets(name, data, sheet, mark, table)
    return _chosen(filled, fits, table)


@lru_cache(maxsize=1)  # a log is looked for with each robot
def sheets(
    name: str,
    data: bytes,
    sheet: str | None = None,
    mark: str | None = None,
    table: str | None = None,
) -> dict[str, Text]:
    """The sheets of a workbook that are not empty, or the one that is named; as for `opened`."""
    forms = _bounded(data)
    data = data if forms is None else _legible(data, forms)
    try:
        book = CalamineWorkbook.from_filelike(io.BytesIO(data))
        there = [one.name for one in book.sheets_metadata if one.typ == SheetTypeEnum.WorkSheet]
        wanted = [one for one in there if sheet in (None, one)]
        lines = _lines_of(book, wanted, mark, table)
    except CalamineError as problem:
        thing = f"the workbook cannot be read ({problem})"
        raise InputError(thing, "save it again, or as CSV") from problem
    if sheet and not wanted:
        raise InputError(
            f'the workbook has no sheet "{sheet}", only {listed(there)}',
            f"correct sheet in [{table}] of campaign.toml",
        )
    filled = {one: _text(name, one, lines[one]) for one in wanted if lines[one].strip()}
    if not filled:
        raise InputError("the workbook is empty", "export it again")
    return filled


def _lines_of(
    book: CalamineWorkbook, wanted: Sequence[str], mark: str | None, table: str | None
) -> dict[str, bytes]:
    """The lines of some sheets.

    Raises:
        InputError: They are too many, or have too many cells.
    """
    if len(wanted) > _MOST_SHEETS:
        thing = f"the workbook has {len(wanted)} sheets, more than the {_MOST_SHEETS}"
        raise InputError(f"{thing} that are read", _which(table))
    lines, left = {}, _MOST_CELLS
    for one in wanted:
        rows = _without_stated_units(_filled_down(book.get_sheet_by_name(one)))
        left -= sum(map(len, rows))
        if left < 0:
            raise InputError(f"the sheets have more than {_MOST_CELLS} cells", _which(table))
        lines[one] = _lines(rows, mark)
    return lines


def _chosen(sheets: Mapping[str, Text], fits: Callable[[Text], int], table: str | None) -> Text:
    """Select the sheet.

    Raises:
        InputError: Of several sheets none fits, or more than one.
    """
    if len(sheets) == 1:
        return next(iter(sheets.values()))
    rank = {one: fits(sheet) for one, sheet in sheets.items()}
    fitting = [one for one, how in rank.items() if how and how == max(rank.values())]
    if len(fitting) == 1:
        return sheets[fitting[0]]
    which = listed(fitting or sheets)
    thing = f"{len(fitting) or 'none'} of the workbook's {len(sheets)} sheets fit, of {which}"
    raise InputError(thing, _which(table))


def _which(table: str | None) -> str:
    """What to do where one of several sheets is meant."""
    way_out = f'say which is meant with sheet = "..." in [{table}] of campaign.toml'
    return way_out if table else "keep one of them"


def _text(name: str, sheet: str, data: bytes) -> Text:
    return replace(text(name, data), encoding=f'workbook, sheet "{sheet}"')


def _filled_down(sheet: CalamineSheet) -> list[list[Any]]:
    """The rows of a sheet, with the content of cells merged over several rows in each of them."""
    rows = [*sheet.iter_rows()]
    for (top, at), (bottom, _) in sheet.merged_cell_ranges or ():
        for row in rows[top + 1 : bottom + 1]:
            row[at : at + 1] = rows[top][at : at + 1]
    return rows


def _without_stated_units(rows: list[list[Any]]) -> list[list[Any]]:
    """The rows with no unit from a number format where a title in the column says the same."""
    texts = [(row, k, one) for row in rows for k, one in enumerate(row) if isinstance(one, str)]
    formed = [one for one in texts if one[2].startswith(_OF_FORMAT)]
    stated = _units_of_titles(texts) if formed else {}
    for row, k, number in formed:
        found = _WITH_UNIT.fullmatch(number)
        if found and found[2] in stated.get(k, ()):
            row[k] = found[1]
    return rows


def _units_of_titles(texts: Iterable[tuple[list[Any], int, str]]) -> dict[int, set[str]]:
    """Units at the end of the titles of each column."""
    stated: dict[int, set[str]] = {}
    for _, k, title in texts:
        found = None if title.startswith(_OF_FORMAT) else _STATED.search(title)
        if found:
            stated.setdefault(k, set()).update({found[1], found[1].replace("deg", "°")})
    return stated


_OF_FORMAT = "\ue001"
"""Before a number that is text since its format says more."""
_STATED = re.compile(r"(?:^|[\s_\[(/])([^\W\d_]+|°)[\])]?\s*$")
"""Unit at the end of a title."""
_WITH_UNIT = re.compile(rf"({_OF_FORMAT}[-+0-9e{POINT}]+)\s*([^\W\d_]+|°)")


def _lines(rows: Sequence[list[Any]], mark: str | None) -> bytes:
    """Write rows as lines; a row without a filled cell becomes a blank line."""
    mark = mark or _mark_of_texts(cell for row in rows for cell in row)
    lines = ("\t".join(_cell(value, mark) for value in row) for row in rows)
    return "".join(f"{line}\n" if line.strip("\t") else "\n" for line in lines).encode()


_COMMA, _POINT = (re.compile(rf"\s*[+-]?[0-9]+{mark}[0-9]+\s*") for mark in (",", r"\."))
_THOUSANDS = re.compile(r"\s*[+-]?[1-9][0-9]{0,2},[0-9]{3}\s*")


def _mark_of_texts(cells: Iterable[Any]) -> str:
    """Decimal mark of numbers that were entered as text; numeric cells have none.

    Excel stores 765,3 as text if its own decimal mark is the point.
    """
    texts = [one for one in cells if isinstance(one, str)]
    commas = any(_COMMA.fullmatch(one) and not _THOUSANDS.fullmatch(one) for one in texts)
    return "," if commas and not any(map(_POINT.fullmatch, texts)) else "."


def _cell(value: Any, mark: str) -> str:
    """Text of a cell, as in a delimited file."""
    if isinstance(value, float):
        plain = str(int(value)) if value.is_integer() and abs(value) < 2**53 else repr(value)
        return plain.replace(".", mark)
    if isinstance(value, datetime.datetime):
        return _time(value).isoformat()
    if isinstance(value, datetime.timedelta):
        minutes, seconds = divmod(round(value.total_seconds(), 3), 60)
        clock = f"{minutes // 60:.0f}:{minutes % 60:02.0f}:{seconds:06.3f}"
        return clock.removesuffix(".000")
    if isinstance(value, str):
        bare = _BREAKS.sub(" ", value.removeprefix(_OF_FORMAT)).replace(POINT, mark)
        return '"' + bare.replace('"', '""') + '"' if '"' in bare else bare
    return str(value)


def _time(value: datetime.datetime) -> datetime.datetime:
    """Round a time to the millisecond."""
    whole = round(value.microsecond / _MILLISECOND) * _MILLISECOND
    return value.replace(microsecond=0) + datetime.timedelta(microseconds=whole)


def _bounded(data: bytes) -> dict[int, str] | None:
    """Check the size of a workbook and of its parts, without trusting their stated sizes.

    Returns:
        Number formats that show more than the number, by style; None if no cell is in one of them
        or holds an error.

    Raises:
        InputError: It is too large, or not a workbook.
    """
    if len(data) > LARGEST_WORKBOOK:
        raise InputError(f"the workbook {too_large(len(data), LARGEST_WORKBOOK)}", _SMALLER)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            size = sum(one.file_size for one in packed.infolist())
            if size > _UNPACKED:
                raise InputError(f"the workbook unpacked {too_large(size, _UNPACKED)}", _SMALLER)
            if "xl/workbook.xml" not in packed.namelist():
                raise InputError("the file is a ZIP archive and no workbook", "unpack it")
            forms = telling(_styles(packed))
            styles = {b"%d" % k for k in forms}
            found = [_as_said(packed, one, styles) for one in packed.infolist()]
            return forms if any(found) or 0 in forms else None
    except UNREADABLE_ZIP as problem:
        thing = f"the workbook is damaged ({problem})"
        raise InputError(thing, "save it again, or as CSV") from problem


_SMALLER = "save the sheet as CSV, which may be larger"


def _styles(packed: zipfile.ZipFile) -> bytes:
    """The part of a workbook with its number formats; empty if there is none."""
    for one in packed.namelist():
        if one.lower() == _STYLES:
            with packed.open(one) as part:
                found = part.read(_MOST_STYLES + 1)
            if len(found) > _MOST_STYLES:
                says = f"the styles of the workbook {too_large(len(found), _MOST_STYLES)}"
                raise InputError(says, _SMALLER)
            return found
    return b""


def _legible(data: bytes, forms: Mapping[int, str]) -> bytes:
    """A workbook whose errors (`#N/A`), and numbers in some formats, are text.

    The reader takes errors for empty cells, and does not see formats.

    Args:
        data: The workbook.
        forms: Number formats that show more than the number, by style.
    """
    out = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(data)) as packed,
        zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as copied,
    ):
        for one in packed.infolist():
            with packed.open(one) as part, copied.open(one.filename, "w", force_zip64=True) as to:
                pieces = _elements(part)
                for piece in _cells(pieces, forms) if one.filename.startswith(_SHEETS) else pieces:
                    to.write(piece)
    return out.getvalue()


def _cells(pieces: Iterable[bytes], forms: Mapping[int, str]) -> Iterator[bytes]:
    """A sheet in pieces, with errors as text, and numbers in some formats as these show them."""
    form: str | None = None

    def as_text(found: re.Match[bytes]) -> bytes:
        nonlocal form
        if found["cell"]:
            form = _form(found["about"], forms)
            if form is None:
                return found[0]
            return found["cell"] + b' t="str"' + _TYPE.sub(b"", found["about"])
        if form is None:
            return found[0]
        number = unescape(found["content"].decode("utf-8", "replace"))
        return found["value"] + escape(_OF_FORMAT + shown(number, form)).encode()

    for piece in pieces:
        text = _ERROR.sub(rb"\1str", piece)
        yield _CELL_OR_VALUE.sub(as_text, text) if forms else text


def _form(about: bytes, forms: Mapping[int, str]) -> str | None:
    """The format that shows more than the number in a cell; None if it has none, or no number."""
    style, of = _STYLE.search(about), _TYPE.search(about)
    if of and of["type"] != b"n":
        return None
    return forms.get(int(style[1]) if style else 0)


def _elements(part: IO[bytes]) -> Iterator[bytes]:
    """A part in pieces that end where an element begins, unless one is longer than a piece."""
    left = b""
    while piece := part.read(_PIECE):
        left += piece
        cut = left.rfind(b"<") if len(left) <= 2 * _PIECE else len(left)
        yield left[: max(cut, 0)]
        left = left[max(cut, 0) :]
    yield left


def _spanned(piece: bytes) -> tuple[int, int]:
    """Number of columns and of rows up to the last cell of a piece of a sheet that has a name."""
    places = {*_PLACE.findall(piece)}
    named = (sum((one - 64) * 26**k for k, one in enumerate(w.upper()[::-1])) for w, _ in places)
    return max(named, default=0), max((int(row) for _, row in places), default=0)


def _as_said(packed: zipfile.ZipFile, one: zipfile.ZipInfo, styles: Set[bytes]) -> bool:
    """Check that a part is no longer than stated; zipfile stops there, but later readers do not.

    Args:
        packed: The workbook.
        one: The part.
        styles: Numbers of styles that are sought.

    Returns:
        Whether a cell may hold an error, or have one of the styles.
    """
    longer = copy.copy(one)
    longer.file_size += 1
    del longer.CRC  # which belongs to the stated length
    found = cells = rows = columns = counted = unfinished = 0
    before, told = b"", False
    with packed.open(longer) as part:
        for piece in iter(lambda: part.read(_PIECE), b""):
            found, seen = found + len(piece), before[-_REFERENCE:] + piece
            by_row = [len(_CELLS.findall(row)) for row in _ROWS.split(seen)]
            cells, counted = cells + sum(by_row), counted + len(by_row) - 1
            by_row[0] += unfinished
            unfinished = by_row[-1]
            if _FAR.search(seen):
                raise zipfile.BadZipFile(f"{one.filename} has a cell where no sheet has one")
            if cells > _MOST_CELLS:
                raise InputError(f"a sheet has more than {_MOST_CELLS} cells", _SMALLER)
            wide, high = _spanned(seen)
            rows, columns = max(rows, high, counted), max(columns, wide, *by_row)
            if rows * columns > _MOST_SPANNED:
                thing = f"a sheet spans {columns} columns and {rows} rows, most of them empty"
                raise InputError(thing, _SMALLER)
            before, told = piece, told or _told(seen, styles)
    if found > one.file_size:
        raise zipfile.BadZipFile(f"{one.filename} is longer than it says")
    return told


def _told(piece: bytes, styles: Set[bytes]) -> bool:
    """Whether a piece of a sheet may have an error, or one of some styles."""
    if _HAS_ERROR.search(piece):
        return True
    return bool(styles) and not styles.isdisjoint(_STYLE.findall(piece))
