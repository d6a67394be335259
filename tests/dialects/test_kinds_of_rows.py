"""Tables with nominal and measured rows, or with points of two frames."""

import numpy as np
import pytest

from pipeline.dialects._kinds import apart, few, is_average, nominal, section

PLACES = np.array([[1.0, 0, 0], [0, 2.0, 0], [0, 0, 3.0], [1.0, 1.0, 1.0]])


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["Nominal", "Actual"], {"Nominal"}),
        (["Soll", "Ist", ""], {"Soll"}),
        (["nominal"], set()),
        (["measured nominal", "ist"], set()),
        (["A", "B"], set()),
    ],
)
def test_rows_are_nominal_only_beside_others(words, found):
    """A table of nominal rows alone, or a word that says both, leaves nothing to drop."""
    assert nominal(words) == found


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        ("Nominal Points:", "nominal"),
        ("Messwerte", "measured"),
        ("Nominal and actual", ""),
        ("Measured in Hall 3", ""),
    ],
)
def test_a_title_between_rows_says_what_follows(line, kind):
    """And nothing where it says both, or more."""
    assert section(line) == kind


def test_a_column_of_names_tells_no_kinds():
    """Four words may, five are names, and numbers are none."""
    assert few("abcd") == {*"abcd"}
    assert few("abcde") == few(["1", "2"]) == set()


@pytest.mark.parametrize(("step", "other"), [(0.001, False), (0.5, True)])
def test_targets_that_stand_elsewhere_for_each_word_are_of_another_frame(step, other):
    """A load moves them by less than one per cent of their distance."""
    names, words = [*"PQRS"] * 2, ["base"] * 4 + ["tool"] * 4

    assert apart(names, words, np.vstack([PLACES, PLACES + step])) is other


def test_two_shared_names_may_be_chance():
    """At least three have to be read for every word."""
    names, words = [*"PQ", *"PQ"], ["base"] * 2 + ["tool"] * 2

    assert not apart(names, words, np.vstack([PLACES[:2], 9 + PLACES[:2]]))


@pytest.mark.parametrize(("word", "mean"), [("P1_avg", True), ("Mittelwert 3", True), ("P1", False),
                                            ("meander", False)])  # fmt: skip
def test_a_row_that_was_computed_says_so(word, mean):
    """As a whole word."""
    assert is_average(word) is mean
