"""Logs filled in by hand: a value once for several rows, remarks between rows, other units."""

import pytest

from pipeline import readers
from pipeline.base.errors import InputError
from pipeline.intake import log_columns
from pipeline.machine.robot import load
from pipeline.readers import logs
from pipeline.readers.export_settings import OWN_LOG

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


@pytest.mark.parametrize("first", ["2.5 kN", "3 mm", "1.2 kgf"])
def test_a_unit_in_the_first_row_is_that_of_its_cell(first):
    """As in any other row: it neither renames a column of ours nor makes it disappear."""
    head = "pose,repeat,force_n,mass_kg,mass_sigma_kg,payload\n"
    rows, log = read(f"{head}1,1,{first},,,\n1,2,700,,,\n2,1,,50,20 g,\n")
    first_mass = logs.loads("f.csv", f"{head}1,1,,50,20 g,\n1,2,,60,0.1,\n2,1,,,,20 kg\n".encode())

    assert (2 in [n for _, n, _ in log.rejected]) == ("mm" in first)
    assert rows[-2][2] == 700
    assert first_mass.number["mass_sigma"][:2] == pytest.approx([0.02, 0.1])
    assert first_mass.word["payload"].tolist() == ["", "", "20 kg"]


def test_a_unit_behind_the_number_of_a_first_pull_is_none():
    """The pulls are not numbered anew, as in a log without that column."""
    _, log = read("pose,repeat,force_n\n1,2 m,700\n1,1,800\n2,1,500\n")

    assert [n for _, n, _ in log.rejected] == [2]
    weights = logs.loads("f.csv", b"pose,mass_kg,mass_sigma_kg\n1,20,5mm\n2,20m,0.1\n3,20,0.1\n")
    assert [n for _, n, _ in weights.rejected] == [2, 3]
    named = logs.loads("f.csv", b"pose,repeat,payload\n1,1,20 kg\n2,1,40 kg\n")
    assert named.word["payload"].tolist() == ["20 kg", "40 kg"]


@pytest.mark.parametrize("unit", ["1", "-", "#"])
def test_the_unit_of_a_number_of_a_pull_is_one(unit):
    """Its numbers are read, not counted."""
    rows, _ = read(f"Pose [{unit}],Repeat [{unit}],force_n\n1,3,900\n1,1,700\n2,2,800\n")

    assert rows == [(1, 3, 900), (1, 1, 700), (2, 2, 800)]


def test_a_column_that_is_there_twice_is_named_so():
    """A repeated title of ours is not one of each pull before it."""
    with pytest.raises(InputError, match="there are two columns theta2_deg"):
        logs.joints(
            "j.csv", b"pose,theta1_deg,theta2_deg,theta2_deg\n1,2.5,3.5,3.5\n", load("ur10")
        )


def test_a_unit_of_another_quantity_is_refused():
    _, log = read("pose,repeat,force_n\n1,1,700\n1,2,3 mm\n2,1,500\n")

    assert [n for _, n, _ in log.rejected] == [3]


@pytest.mark.parametrize("cell", ["12°30'15\"", "12-30-15.5", "12d30m15s"])
def test_degrees_minutes_and_seconds_are_no_force(cell):
    """Nor a coordinate: only a column of angles may hold them."""
    _, log = read(f"pose,repeat,force_n\n1,1,700.5\n1,2,{cell}\n2,1,500.5\n")
    rows = f"g,P1,1.5,2.5,3.5\ng,P2,{cell},2.5,3.5\n"
    export = readers.read("t.csv", f"group,target,x_mm,y_mm,z_mm\n{rows}".encode())

    assert [n for _, n, _ in log.rejected] == [3]
    assert [n for n, _ in export.rejected] == [3]


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


TAGGED = (
    "Dillon EDjunior log\nSerial;EDJ-2;Capacity;500 lbf\nRecord;Date;Value;Unit;Tag\n"
    "1;28-10-2026;0.0;lbf;zero\n2;28-10-2026;46.6;lbf;P01/1 W1\n3;28-10-2026;82.1;lbf;P01/2 W7\n"
    "4;28-10-2026;29.3;lbf;P02/1 W1\n5;28-10-2026;109.0;lbf;P02/2 W3\n"
)


@pytest.mark.parametrize(
    ("change", "columns"),
    [
        ({}, {"Value": "force_lbf", "Tag": "pose_repeat"}),
        ({"Record;": "% Record;", "P0": "Pose "}, {"Value": "force_lbf", "Tag": "pose_repeat"}),
        ({"/": " - pull ", "lbf;z": "N;z", "lbf;P": "N;P"}, {"Value": "force_n"}),
    ],
)
def test_a_log_of_a_dynamometer_is_read_by_its_cells(change, columns):
    """The unit and the numbers of pose and pull are in cells; a row of zero is no pull."""
    text = TAGGED
    for old, new in change.items():
        text = text.replace(old, new)
    form = log_columns.understood_loads("dillon.csv", text.encode())
    log = logs.loads("dillon.csv", text.encode(), form)
    factor = 1.0 if "N;P" in text else LBF

    assert columns.items() <= form.columns.items()
    assert log.number["pose"].tolist() == [1, 1, 2, 2]
    assert log.number["repeat"].tolist() == [1, 2, 1, 2]
    assert log.number["force"] == pytest.approx([factor * x for x in (46.6, 82.1, 29.3, 109.0)])
    assert log.line.tolist() == [5, 6, 7, 8]
    assert not log.rejected


def test_a_recorder_numbers_poses_and_pulls_in_its_records():
    """Its heading is no title, and of its titles only the unit is left open."""
    text = (
        "HBM S9M   canal 1   unidade N   tara 07:48\n data     hora      registro   valor\n"
        + "".join(
            f"14/07/2026 07:5{3 * p + r}:33   {p:02}-{r}   {700 + 50 * r},5\n"
            for p in (1, 2)
            for r in (1, 2)
        )
    )
    form = log_columns.understood_loads("c.txt", text.encode())

    assert form.columns["registro"] == "pose_repeat"
    assert form.columns["valor"].startswith("force_n|")


def test_titles_without_their_accents_are_those_with_them():
    """And a dynamometer in the heading says that kg are a force."""
    text = "Dynamometr DSE;;\nPozycja;Obciazenie;Sila [kG]\n1;1;145,0\n1;2;77,0\n"
    form = log_columns.understood_loads("p.csv", text.encode())

    assert form.columns == {"Pozycja": "pose", "Obciazenie": "repeat", "Sila [kG]": "force_kg"}


@pytest.mark.parametrize(("last", "force"), [("5", None), ("905", "force_n")])
def test_numbers_of_readings_are_no_forces(last, force):
    """`lectura n` may be the force in newtons; records count on."""
    text = "postura;tiron;lectura n\n1;1;2\n1;2;3\n2;1;4\n2;2;" + last
    form = log_columns.understood_loads("h.csv", text.encode())

    assert (form and form.columns["lectura n"]) == force


@pytest.mark.parametrize("tag", ["P02/3", "P1/2", "W7"])
def test_names_that_do_not_count_on_are_no_numbers_of_pulls(tag):
    text = TAGGED.replace("P02/1", tag)

    assert "Tag" not in (log_columns.understood_loads("d.csv", text.encode()) or OWN_LOG).columns


def test_rows_of_numbers_are_no_titles():
    """Nor is the unit of a force among them its title."""
    rows = "\n".join(TAGGED.splitlines()[4:])

    assert not log_columns.may_be_log("d.csv", rows.encode())


def test_rows_of_one_standstill_are_one():
    """Two logs of a pose differ by what encoders show; by more they contradict each other."""
    head = "pose,A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg\n"
    row = "1,10,-90,90,20,30,40\n1,10.{}00001,-90,90,20,30,40\n2,15,-80,90,20,30,40\n"
    robot = load("kr210_r2700_2")
    why = [
        [
            reason
            for *_, reason in logs.joints(
                "j.csv", (head + row.format(one)).encode(), robot
            ).rejected
        ]
        for one in ("0", "9")
    ]

    assert why[0] == ["repeats line 2; remove it"]
    assert all("contradict each other" in one for one in why[1])
