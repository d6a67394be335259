"""Delimited rows against a loop over them: accepted rows, their values, and named rejections."""

import re
from datetime import datetime

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.base.errors import InputError
from pipeline.dialects._delimited import rows
from pipeline.readers._layout import Field, Layout
from pipeline.readers._text import text

FORM = "%m/%d/%y %H:%M:%S"
FIELDS = (
    Field("target", "name"),
    Field("x", "number"),
    Field("std", "number", needed=False),
    Field("remark", "any", needed=False),
    Field("time", "time", needed=False),
)
ODD = ["", "nan", "-inf", "1e999", "1_0", "0x10", "+5", "5.", ".5", ".", "1e-400", "\u00a05.1", "٣"]


def layout(decimal=".", first=1):
    return Layout(FIELDS, ";", first, decimal, moment=FORM)


def number(cell, mark):
    """The number in a cell, or None; float() alone accepts 1_0, nan and digits of all scripts."""
    cell = cell.strip()
    if not set(cell) <= set(f"0123456789+-eE{mark}"):
        return None
    try:
        value = float(cell.replace(mark, "."))
    except ValueError:
        return None
    return value if abs(value) <= 1e30 else None


def moment(cell):
    """The time in a cell, or None; strptime alone also accepts 8:0:5."""
    if not re.fullmatch(r"[0-9/]+ [0-9]+:[0-9]{2}:[0-9]{2}", cell.strip()):
        return None
    try:
        return datetime.strptime(cell.strip(), FORM)
    except ValueError:
        return None


def said(cells, mark):
    """Values of a row, or None if it is rejected."""
    if len(cells) != len(FIELDS):
        return None
    name, x, std, _, time = cells
    found = name.strip(), number(x, mark), number(std, mark), moment(time)
    sound = found[0] and found[1] is not None
    sound = sound and (found[2] is not None or not std.strip())
    return found if sound and (found[3] is not None or not time.strip()) else None


def line_of(cells, quoted):
    """A row as a program writes it, with or without quotation marks around every cell."""
    return ";".join(f'"{cell}"' for cell in cells) if quoted else ";".join(cells)


def numbers(mark):
    written = st.floats().map(lambda value: repr(value).replace(".", mark))
    strewn = st.text(st.sampled_from("0123456789.,+-eE \t"), max_size=8)
    sound = st.floats(-1e4, 1e4).map(lambda value: f"{value:.4f}".replace(".", mark))
    return st.one_of(sound, sound, sound, written, strewn, st.sampled_from(ODD))


MOMENTS = st.one_of(
    st.datetimes(datetime(1969, 1, 1), datetime(2068, 12, 31)).map(lambda t: t.strftime(FORM)),
    st.text(st.sampled_from("0123456789/: "), max_size=18),
    st.sampled_from(["", "02/30/26 08:00:00", "2/3/26 8:00:00", "12/31/68 23:59:60", "11/03/26"]),
)
NAMES = st.text(st.sampled_from("ABPµ: \t\u00a0"), max_size=4)


@st.composite
def tables(draw):
    """Cells row by row, mostly in the right number, and their decimal mark."""
    mark = draw(st.sampled_from(".,"))
    row = st.tuples(NAMES, numbers(mark), numbers(mark), NAMES, MOMENTS).map(list)
    other = st.lists(NAMES, min_size=1, max_size=7)
    return draw(st.lists(st.one_of(row, row, row, row, other), min_size=1, max_size=12)), mark


@settings(max_examples=50, deadline=None)
@given(tables(), st.booleans())
def test_rows_are_taken_or_named_as_a_loop_over_them_does(table, quoted):
    """The same rows, the same values to the last digit, and a way out for every other row."""
    cells, mark = table
    lines = [line_of(row, quoted) for row in cells]
    expected = [(n, said(row, mark)) for n, row in enumerate(cells, 1) if lines[n - 1].strip()]

    found = rows(
        text("t", "".join(f"{line}\n" for line in ["head", *lines]).encode()), layout(mark, 2)
    )

    taken = [(n + 1, row) for n, row in expected if row]
    assert found.line.tolist() == [n for n, _ in taken]
    columns = (found.columns[name].to_pylist() for name in ("target", "x", "std", "time"))
    assert list(zip(*columns, strict=True)) == [row for _, row in taken]
    assert [n for n, _ in found.rejected] == [n + 1 for n, row in expected if not row]
    assert all("; " in reason for _, reason in found.rejected)
    order = [k for k, (_, row) in enumerate(expected, 1) if row]
    assert found.order.tolist() == order


@pytest.mark.parametrize("cell", ["02/30/26 08:00:00", "11/03/26 08:00:60", "11/03/26\t08:00:00"])
def test_a_time_that_no_clock_shows_costs_its_row_also_among_good_ones(cell):
    """30 February is not 2 March."""
    good = "P1;1.0;;;11/03/26 08:00:00\n"

    found = rows(text("t", f"{good}P2;1.0;;;{cell}\n{good}".encode()), layout())

    assert found.line.tolist() == [1, 3]
    assert [(n, "not a time" in reason) for n, reason in found.rejected] == [(2, True)]


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("P1;1", "has 2 fields where 5 are expected"),
        ("P1;a;b;c;d", 'x is "a", not a number'),
        ('"P1";;;;', "has nothing in column x"),
    ],
)
def test_what_is_no_export_is_not_explained_row_by_row(monkeypatch, row, said):
    """A message with the first row if none of many can be read; a single readable one is kept."""
    for module in ("_cut", "_delimited"):
        monkeypatch.setattr(f"pipeline.dialects.{module}.HOPELESS", 5)
    bad = f"{row}\n".encode()
    with pytest.raises(InputError, match=f"nothing can be read, because 5 rows .*: {said}") as no:
        rows(text("a.csv", bad * 5), layout())
    assert no.value.line == 1

    found = rows(text("a.csv", b"P1;1;;;\n" + bad * 5), layout())
    assert found.line.tolist() == [1]
    assert len(found.rejected) == 5


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("piece", [1, 2, 7, 1000])
def test_lines_are_counted_as_an_editor_does_wherever_a_piece_ends(monkeypatch, end, piece):
    """Lines of no to nine letters, scanned in pieces that end within, at and after a line's end."""
    monkeypatch.setattr("pipeline.readers._text._CHUNK", piece)
    lines = [b"x" * (k * k % 10) for k in range(1, 60)] + [b"last"]

    for data in (end.join(lines), end.join(lines) + end):
        found = text("a.csv", data)
        assert [found.line(k).encode() for k in range(1, len(lines) + 1)] == lines
        assert len(found.starts) == len(lines) + 1
