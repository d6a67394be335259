"""Rows of tables as numbers: against dictionaries and loops."""

import numpy as np
import pandas as pd
import pytest

from pipeline.reduction._index import found, means, numbered, places, pull_numbers, run

RNG = np.random.default_rng(4)


@pytest.mark.parametrize("kind", ["object", "category"])
def test_each_cell_has_the_place_of_its_word(kind):
    """Unknown words and empty cells have none."""
    cells = ["P2", "l1", None, "P1", "P2", "odd"]

    assert places(pd.Series(cells, dtype=kind), ["P1", "P2", "l1"]).tolist() == [1, 2, -1, 0, 1, -1]


@pytest.mark.parametrize(
    "wanted",
    [
        np.repeat([3, 1, 9, 3], 50),
        RNG.permutation(np.repeat([3, 1, 9, 4], 5)),
        np.array([1, 2, 3]),
        np.zeros(0, int),
    ],
    ids=["runs", "mixed", "the same", "none"],
)
@pytest.mark.parametrize("known", [[1, 2, 3], [3, 1, 2], [1, 3, 3, 4], []])
def test_a_number_is_found_where_a_dictionary_has_it(known, wanted):
    """The last of equal ones; -1 where it is not known."""
    last = {number: row for row, number in enumerate(known)}

    rows = found(np.array(known, dtype=int), wanted)

    assert rows.tolist() == [last.get(number, -1) for number in wanted.tolist()]


@pytest.mark.parametrize("keys", [[2, 2, 5, 7, 7], [5, 2, 5, 2], [4], []])
def test_keys_are_numbered_in_their_order(keys):
    """Every row's key is again that of its number."""
    different, of = numbered(np.array(keys, dtype=int))

    assert different.tolist() == sorted({*keys})
    assert different[of].tolist() == keys


def test_rows_without_a_gap_become_a_slice():
    """And only those."""
    values = np.arange(10)

    assert run(np.array([3, 4, 5])) == slice(3, 6)
    assert values[run(np.array([3, 5]))].tolist() == [3, 5]
    assert values[run(np.zeros(0, int))].tolist() == []


def test_the_mean_of_a_group_leaves_out_what_is_not_known():
    """A group without a known value has none."""
    values = np.array([1.0, np.nan, 3.0, 5.0, np.nan])

    assert means(values, np.array([0, 0, 0, 2, 3]), 4) == pytest.approx(
        [2.0, np.nan, 5.0, np.nan], nan_ok=True
    )


def test_pulls_are_ordered_by_pose_and_then_by_repeat():
    """No two have one number, up to the largest repeat that a log may have."""
    table = pd.DataFrame({"pose": [1, 1, 2], "repeat": [0, 9_999, 0]})

    numbers = pull_numbers(table)

    assert (np.diff(numbers) > 0).all()
