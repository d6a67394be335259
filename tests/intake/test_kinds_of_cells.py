"""Kind of a column by its cells, and questions with numbers to choose from."""

import io
import sys

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.intake import asking
from pipeline.intake._contents import Content, _content, mark_of, values
from pipeline.intake._sheet import sheet
from pipeline.readers import text


@pytest.mark.parametrize(
    ("cells", "kind"),
    [
        (("1,5", "-2,25", "3", "", "4,0"), "number"),
        (("P1", "P2", "Pl1"), "word"),
        (("2026-03-01", "2026-03-02"), "date"),
        (("10:20:30", "10:20:31,5"), "clock"),
        (("2026-03-01T10:20:30", "2026-03-01T10:20:31"), "time"),
        (("", "", ""), "empty"),
        (("1", "2", "3", "4", "lost"), "number"),
        (("1", "2", "lost", "lost"), "word"),
    ],
)
def test_most_cells_determine_the_kind_of_a_column(cells, kind):
    """Four of five: the others are damaged."""
    assert _content(cells).kind == kind


@pytest.mark.parametrize(
    ("cells", "counts"),
    [
        (("7", "8", "", "9"), True),
        (("7", "9", "10"), False),
        (("1", "2"), False),
        (("1", "2", "x"), False),
        (("1" * 5000, "1" * 4999 + "2", "1" * 4999 + "3"), False),
    ],
)
def test_a_column_that_numbers_the_rows(cells, counts):
    """Each number one more than the one before; two rows are too few to tell."""
    assert Content(cells, "number").counts is counts


def test_numbers_of_a_column_by_the_mark_of_all():
    """With a comma; what is no number is none."""
    column = _content(("1,5", "-0,25", "lost", "1e3", "2,125"))
    mark = mark_of([column], [1, 2, 3, 4, 5])

    assert mark == ","
    assert values(column, mark) == pytest.approx([1.5, -0.25, np.nan, 1000.0, 2.125], nan_ok=True)


def test_commas_that_may_separate_thousands_are_asked_about():
    """Where every one of them may."""
    with pytest.raises(InputError, match="decimal"):
        mark_of([_content(("1,500", "2,250", "3,125"))], [1, 2, 3])


def test_an_answer_is_chosen_by_its_number(monkeypatch):
    """Asked until one of them is typed."""
    typed, shown = io.StringIO("0\n4\ntwo\n2\nmore\n"), []
    monkeypatch.setattr(sys, "stdin", typed)
    found = asking.numbered("Which?", ["one", "other"], ["mm", "in"], shown.append)

    assert found == "in"
    assert shown == ["Which?", "  1  one", "  2  other"]
    assert typed.read() == "more\n"


@pytest.mark.parametrize(
    ("above", "first"),
    [
        ("base;B1;nan;9.6;-1.5", 1),
        ("base;B1;4.3;--9.6;-1.5\nbase;B2;;-2.6;-0.9", 1),
        ("job;hall 3;tracker;2;mm", 2),
        ("job;hall 3;tracker;2.5;3.5\n", 3),
    ],
)
def test_an_unreadable_first_row_without_titles_is_a_row(above, first):
    """It is then reported: a line above the rows that lacks one number of three is no preamble."""
    rows = "".join(f"p{k};P1;{4.5 + k};5.{k};-0.{k}\n" for k in range(1, 7))

    assert sheet(text("t.csv", f"{above}\n{rows}".encode())).first == first
