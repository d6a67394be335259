"""Logs filled in by hand: a value once for several rows, remarks between rows, other units."""

import pytest

from pipeline.base.errors import InputError
from pipeline.readers import logs

LBF = 4.4482216152605


def read(text):
    log = logs.loads("loads.csv", text.encode())
    numbers = (log.number[name].tolist() for name in ("pose", "repeat", "force"))
    return list(zip(*numbers, strict=True)), log


def test_an_empty_pose_below_another_is_the_same():
    rows, log = read("pose,repeat,force_n\n1,1,700\n,2,800\n4,1,500\n,2,600\n,3,650\n")

    assert rows == [(1, 1, 700), (1, 2, 800), (4, 1, 500), (4, 2, 600), (4, 3, 650)]
    assert not log.rejected
    assert log.notes == ("loads.csv, lines 3, 5, 6: an empty pose is that of the row above",)


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("pose,force_1_kn,force_2_lbf\n1,1.5,500\n2,,600\n", [1000, LBF, LBF]),
        ("pose,repeat,force_lbf\n1,1,500\n1,2,600\n", [LBF, LBF]),
    ],
)
def test_the_unit_of_each_force_is_kept(text, units):
    assert read(text)[1].number["unit"] == pytest.approx(units)


def test_without_numbers_of_pulls_the_whole_log_must_be_filled_in_so():
    """One empty cell among many, or one where a number is missing, is an oversight."""
    rows, _ = read("pose,force_n\n1,700\n,800\n2,500\n,600\n")
    assert rows == [(1, 1, 700), (1, 2, 800), (2, 1, 500), (2, 2, 600)]

    _, log = read("pose,force_n\n1,700\n2,500\n3,500\n,600\n")
    assert [n for _, n, _ in log.rejected] == [5]
    with pytest.raises(InputError, match="ambiguous which pulls"):
        read("pose,force_n\n1,700\n,800\n,650\n4,500\n,600\n,700\n")


@pytest.mark.parametrize(
    "text",
    [
        ",1,700\n2,1,500\n",  # nothing above
        "1,1,700\n,1,800\n2,1,500\n",  # not the next pull
        "1,1,700\n4?,1,800\n,2,500\n",  # the pose above was rejected
    ],
)
def test_an_empty_pose_that_may_be_another_is_rejected(text):
    rows, log = read("pose,repeat,force_n\n" + text)

    assert any("nothing in column pose" in why for _, _, why in log.rejected)
    assert len(rows) + len(log.rejected) == text.count("\n")


@pytest.mark.parametrize("line", ["- break (truck) -", "- break (truck) -,,", ",,forgotten"])
def test_a_line_of_words_alone_is_a_remark(line):
    rows, log = read(f"pose,repeat,force_n\n1,1,700\n1,2,800\n{line}\n2,1,500\n")

    assert [row[0] for row in rows] == [1, 1, 2]
    assert not log.rejected
    assert log.notes == (f"loads.csv, line 4: {line.strip(',')}",)


@pytest.mark.parametrize("line", ["2b,,", "7,1,", "2,1,forgotten"])
def test_a_row_that_lacks_its_force_is_rejected(line):
    _, log = read(f"pose,repeat,force_n\n1,1,700\n1,2,800\n{line}\n3,1,500\n")

    assert [n for _, n, _ in log.rejected] == [4]


@pytest.mark.parametrize(
    ("title", "cell", "newtons"),
    [
        ("force_n", "2.223 kN", 2223.0),
        ("Force [kN]", "2223N", 2223.0),
        ("force_kgf", "100 lbf", 100 * LBF),
        ("force_n", "12 daN", 120.0),
    ],
)
def test_a_cell_with_its_own_unit_is_converted(title, cell, newtons):
    rows, log = read(f"pose,repeat,{title}\n1,1,2.5\n1,2,{cell}\n2,1,2.5\n")

    assert not log.rejected
    assert rows[1][2] == pytest.approx(newtons, rel=1e-12)


def test_a_unit_of_another_quantity_is_refused():
    _, log = read("pose,repeat,force_n\n1,1,700\n1,2,3 mm\n2,1,500\n")

    assert [n for _, n, _ in log.rejected] == [3]


def test_a_unit_behind_every_number_against_the_title():
    """The cells say what the instrument showed."""
    rows, _ = read("pose,repeat,force [kN]\n1,1,700 N\n1,2,800 N\n")

    assert [row[2] for row in rows] == [pytest.approx(700.0), pytest.approx(800.0)]


@pytest.mark.parametrize(("one", "two"), [("P01", "P02"), ("Pose 1", "Pose 2"), ("p_1", "2")])
def test_the_number_of_a_pose_may_have_a_name(one, two):
    rows, log = read(f"pose,repeat,force_n\n{one},1,700\n{one},2,800\n{two},1,500\n")

    assert [row[:2] for row in rows] == [(1, 1), (1, 2), (2, 1)]
    assert not log.rejected


def test_names_that_differ_are_no_poses():
    """A2 is not the pose of B2."""
    _, log = read("pose,repeat,force_n\nA1,1,700\nB1,2,800\n2,1,500\n")

    assert [n for _, n, _ in log.rejected] == [2, 3]
