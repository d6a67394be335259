"""Numbers and cells as people and programs write them."""

import numpy as np
import pytest

from pipeline.dialects._cells import BadCell, bare_number, cells, is_number, is_turn
from pipeline.readers._reader import text_of
from pipeline.readers._text import shortened


@pytest.mark.parametrize(
    ("written", "plain"),
    [
        ("1,234,567.25", "1234567.25"), ("1.234.567,25", "1234567,25"), ("1'234.5", "1234.5"),
        ("1\u202f234,5", "1234,5"), ("−12.5", "-12.5"), ("1.5D+03", "1.5E+03"), ("1.5", "1.5"),
        ("12-05", "12-05"),
    ],
)  # fmt: skip
def test_a_number_loses_what_no_program_reads(written, plain):
    """Separators, a typographic minus, Fortran's exponent; a date stays what it is."""
    assert bare_number(written) == plain


@pytest.mark.parametrize("turn", ["12°30'36\"", "12d30m36s", "12°30′36.0″", "12-30-36.0"])
def test_degrees_minutes_and_seconds_become_degrees(turn):
    """12 + 30/60 + 36/3600 = 12.51."""
    assert is_turn(turn)
    assert float(bare_number(turn)) == pytest.approx(12.51)
    assert float(bare_number(f"−{turn}")) == pytest.approx(-12.51)


@pytest.mark.parametrize(("cell", "number"), [("3,25", True), (".5e-3", True), ("1.2.3", False),
                                              ("", False), ("P1", False)])  # fmt: skip
def test_what_counts_as_a_number(cell, number):
    """With either decimal mark."""
    assert is_number(cell) is number


def test_a_quoted_cell_keeps_its_separator():
    """And one whose quotation mark is not closed is refused."""
    assert cells('a, "x, y",2 ', ",") == ["a", "x, y", "2"]
    with pytest.raises(BadCell, match="not closed"):
        cells('a,"x', ",")


def test_what_is_quoted_in_a_message_is_short_and_printable():
    """At most forty characters, the last of them a mark that there is more."""
    assert shortened("a\x1bb") == "a?b"
    assert shortened("x" * 41) == f"{'x' * 39}…"


def test_all_digits_are_written_unless_some_are_asked():
    """A third reads back as the same number."""
    third = np.array([[1 / 3]])

    assert text_of(third, 4) == [["0.3333"]]
    assert float(text_of(third, None)[0][0]) == 1 / 3
