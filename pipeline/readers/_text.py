"""Decode a file to text with countable lines: encoding, line ends and limits are settled once."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Ints, Locked
from pipeline.base.doors import found
from pipeline.base.doors import opened as behind
from pipeline.base.errors import InputError
from pipeline.base.files import TYPE_BYTES
from pipeline.base.shown import too_large
from pipeline.base.threads import spread

_LARGEST_FILE = 2_000_000_000
"""Maximum size of a file [byte]: 25 million readings, and Arrow's offsets fit into 32 bits."""
_MAX_LINE_BYTES = 10_000
"""Maximum length of a line [byte]; fifty columns of twenty digits take a tenth of it."""
_MANY_PIECES = 8
"""Number of pieces from which a second thread saves more time than it costs [1]."""
SAMPLE_LINES = 60
"""Number of leading lines from which a dialect is recognised [1]; headers are shorter."""
_CHUNK = 1 << 20
"""Size of the pieces scanned at a time [byte]: temporary arrays of this size stay in the cache."""

LARGEST_WORKBOOK = 100 * 2**20
"""Maximum size of a workbook [byte]: Excel's million rows of six columns take a third of it."""
_ZIP = b"PK\x03\x04"
_WORKBOOKS = (".xlsx", ".xlsm")
_OTHER_PROGRAMS = {
    _ZIP: "an Excel workbook or a ZIP archive",
    b"\xd0\xcf\x11\xe0": "an old Excel workbook",
    b"\x1f\x8b": "compressed",
    b"%PDF": "a PDF",
}
"""Leading bytes of files that are not text, and what they are."""

_NEARLY = 0.9
"""Minimum fraction of ASCII characters in a text of any language with numbers in it [1]."""
_MARKS = {b"\xef\xbb\xbf": "utf-8", b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}


@dataclass(frozen=True, eq=False)
class Text(Locked):
    r"""A text file; lines are counted from 1 as an editor does.

    Attributes:
        name: File name relative to the campaign folder.
        data: Its content as UTF-8, without byte order mark; lines end in \n or \r\n.
        encoding: Original encoding of the file.
        starts: Byte offset of each line in `data`, then the end of `data`, shape (lines + 1,).
    """

    name: str
    data: bytes
    encoding: str
    starts: Ints

    def __len__(self) -> int:
        """Number of lines."""
        return len(self.starts) - 1

    def line(self, number: int) -> str:
        """Line `number`, counted from 1, without its line end."""
        raw = self.data[self.starts[number - 1] : self.starts[number]]
        return raw.decode("utf-8").rstrip("\r\n")

    def lines(self, first: int = 1, most: int | None = None) -> Iterator[tuple[int, str]]:
        """Line numbers and lines from line `first` on."""
        last = len(self) if most is None else min(len(self), first + most - 1)
        for number in range(first, last + 1):
            yield number, self.line(number)

    def first(self) -> tuple[int, str]:
        """Number and content of the first line that is not blank, of line 1 if all are."""
        return next((one for one in self.lines() if one[1].strip()), (1, self.line(1)))

    def sample(self) -> list[str]:
        """The leading lines from which its dialect and header are recognised."""
        return [line for _, line in self.lines(1, SAMPLE_LINES)]

    def ended(self) -> bool:
        """Whether the last line has its line end."""
        return self.data.endswith(b"\n")


def text(name: str, data: bytes) -> Text:
    """Decode a file and check its limits.

    Raises:
        InputError: The file is empty, too large or not text, or a line is too long.
    """
    if len(data) > _LARGEST_FILE:
        raise InputError(
            f"the file {too_large(len(data), _LARGEST_FILE)}",
            "split it into several exports and list them in [tracker] files",
        )
    refuse_other_programs(name, data)
    data, encoding = _as_utf8(data)
    if b"\0" in data:
        raise InputError(_ZERO, "export it as text")
    if not data or data.isspace():
        raise InputError("the file is empty", "export it again")
    starts = _starts(data)
    if _lone_return(data, starts):  # Arrow treats it as a line end, and so do we
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        starts = _starts(data)
    _short_lines(starts)
    return Text(name, data, encoding, starts)


def is_workbook(begin: bytes) -> bool:
    """Whether a file begins as a workbook does, which is zipped XML."""
    return begin.startswith(_ZIP)


def largest(name: str) -> int:
    """Maximum size of a file by its name, known before it is opened [byte]."""
    return LARGEST_WORKBOOK if name.lower().endswith(_WORKBOOKS) else _LARGEST_FILE


def refuse_other_programs(name: str, begin: bytes) -> None:
    """Refuse a file that is not text by its leading bytes, whatever its length.

    Raises:
        InputError: The file is in another program's own format.
    """
    if is_workbook(begin) and name.lower().endswith(_WORKBOOKS):
        return
    for known, what in _OTHER_PROGRAMS.items():
        if begin.startswith(known):
            raise InputError(f"the file is {what}", "save it as .xlsx, CSV or text", file=name)
    marked = begin.startswith(tuple(_MARKS)) or _unmarked(begin)
    if not marked and b"\0" in begin[:TYPE_BYTES]:
        raise InputError(_ZERO, "export it as text", file=name)


_ZERO = "the file is not text (it contains zero bytes)"


def _as_utf8(data: bytes) -> tuple[bytes, str]:
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            return _recoded(data[len(mark) :], encoding)
    if unmarked := _unmarked(data):
        return _recoded(data, unmarked)
    if data.isascii():
        return data, "ascii"
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        page = found("pipeline.dialects.code_pages:page")
        return _recoded(data, page(data) if page else "cp1252")
    return data, "utf-8"


def _unmarked(data: bytes) -> str | None:
    """Detect UTF-16 without a byte order mark: nearly every second leading byte is zero."""
    begin = data[: min(TYPE_BYTES, len(data) // 2 * 2)]
    zeros = {"utf-16-le": begin[1::2].count(0), "utf-16-be": begin[::2].count(0)}
    encoding, most = max(zeros.items(), key=lambda one: one[1])
    clear = most > _NEARLY * len(begin) / 2 and sum(zeros.values()) == most
    return encoding if clear and begin.strip(b"\0") else None


def _recoded(data: bytes, encoding: str) -> tuple[bytes, str]:
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as problem:
        if encoding == "cp1252":  # has no letter for five bytes, which begin Japanese ones
            return _recoded(data, "cp932")
        if encoding == "cp932":  # none is in latin-1
            return _recoded(data, "latin-1")
        raise InputError(
            f"not valid {encoding} at byte {problem.start}", "export it again as UTF-8"
        ) from problem
    return text.encode("utf-8"), encoding


def _starts(data: bytes) -> Ints:
    """Offsets at which lines start, and the end; in pieces, which is faster and saves memory."""
    whole = np.frombuffer(data, dtype=np.uint8)

    def look(begin: int) -> Ints:
        return np.flatnonzero(whole[begin : begin + _CHUNK] == ord("\n")) + begin + 1

    begins = range(0, len(data), _CHUNK)
    ends = spread(look, begins, much=len(begins) >= _MANY_PIECES)
    end = [] if data.endswith(b"\n") else [np.array([len(data)])]
    return np.concatenate([np.zeros(1, dtype=np.int64), *ends, *end])


def _lone_return(data: bytes, starts: Ints) -> bool:
    r"""Whether a \r is not followed by \n."""
    if b"\r" not in data:
        return False
    ends = starts[1:] if data.endswith(b"\n") else starts[1:-1]
    before = np.frombuffer(data, dtype=np.uint8)[ends[ends > 1] - 2]
    return data.count(b"\r") > int(np.count_nonzero(before == ord("\r")))


def _short_lines(starts: Ints) -> None:
    length = np.diff(starts)
    longest = int(length.argmax())
    if length[longest] > _MAX_LINE_BYTES:
        raise InputError(
            f"the line has {length[longest]} bytes, more than the {_MAX_LINE_BYTES} allowed",
            "check that this is a text export with one reading per line",
            line=longest + 1,
        )


def squeezed(text: Text) -> Text:
    """The text with runs of blanks and tabs squeezed to one blank, none at the ends of lines."""
    data = re.sub(rb"[ \t]+", b" ", text.data)
    data = re.sub(rb"^ | (?=\r?$)", b"", data, flags=re.MULTILINE)
    return Text(text.name, data, text.encoding, _starts(data))


def opened(
    name: str,
    data: bytes,
    sheet: str | None,
    mark: str | None,
    table: str | None,
    fits: Callable[[Text], int],
) -> Text:
    """Open a file as text; workbooks are opened by the dialects.

    Args:
        name: File name, for messages.
        data: Its content.
        sheet: Name of the sheet to read, None if not stated.
        mark: Expected decimal mark, None for any.
        table: Table of campaign.toml that may state both; None if none may.
        fits: How well a sheet fits, 0 for not at all; used if there are several and none is named.

    Raises:
        InputError: The file is neither text nor a workbook, is too large, or not exactly one sheet
            fits.
    """
    if not is_workbook(data):
        return text(name, data)
    found: Text = behind("pipeline.dialects.workbook:opened")(name, data, sheet, mark, table, fits)
    return found


_GLANCE = 40
"""Maximum number of characters of a cell quoted in a message."""


def shortened(cell: str, most: int = _GLANCE) -> str:
    """Shorten a cell for a message, with control characters replaced."""
    plain = "".join(c if c.isprintable() else "?" for c in cell)
    return plain if len(plain) <= most else plain[: most - 1] + "…"
