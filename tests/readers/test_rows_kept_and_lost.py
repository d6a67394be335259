"""Rows of logs and exports: which are kept, in which unit, and what is said of the others."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from pipeline.base.errors import InputError
from pipeline.dialects._cells import delimiter_of
from pipeline.machine.robot import load
from pipeline.readers import logs, pose_names
from pipeline.readers._layout import TypedRows
from pipeline.readers._log_table import (
    Log,
    Quantity,
    column,
    known_columns,
    names_of,
    once,
    suffixed,
)
from pipeline.readers._reader import (
    Export,
    Meaning,
    in_a_hall,
    kept,
    named_by_file,
    of_targets,
    split,
)
from pipeline.readers._text import Text, refuse_other_programs, shortened, squeezed, text
from pipeline.readers._units import in_unit, metres
from pipeline.readers.export_settings import LogForm

G = 9.80665


def table(head: str, *rows: str) -> bytes:
    """A CSV file."""
    return "\n".join([head, *rows, ""]).encode()


def lost(log: Log) -> dict[int, str]:
    """Reason by line of the rows that were rejected."""
    return {line: reason for _, line, reason in log.rejected}


@pytest.mark.parametrize(
    ("unit", "newtons"),
    [("n", 1.0), ("kn", 1e3), ("kgf", G), ("kg", G), ("kp", G), ("dan", 10.0), ("lbf", 4.4482216)],
)
def test_forces_become_newtons_and_keep_their_unit(unit: str, newtons: float) -> None:
    """By the title of their column; pulls of a pose are numbered from 1."""
    log = logs.loads("l.csv", table(f"pose,force_{unit}", "4,20.5", "4,30.5", "5,10.5"))

    assert log.number["force"] == pytest.approx(newtons * np.array([20.5, 30.5, 10.5]), rel=1e-6)
    assert log.number["unit"] == pytest.approx(np.full(3, newtons), rel=1e-6)
    assert log.number["pose"].tolist() == [4, 4, 5]
    assert log.number["repeat"].tolist() == [1, 2, 1]
    assert log.line.tolist() == [2, 3, 4]
    assert not log.rejected


@pytest.mark.parametrize(("unit", "kg"), [("kg", 1.0), ("g", 1e-3), ("lb", 0.45359237)])
def test_weights_become_kilograms(unit: str, kg: float) -> None:
    """With their uncertainty; other kinds of load are empty."""
    log = logs.loads("l.csv", table(f"pose,repeat,mass_{unit},mass_sigma_{unit}", "1,1,20.5,0.5"))

    assert log.number["mass"] == pytest.approx([20.5 * kg])
    assert log.number["mass_sigma"] == pytest.approx([0.5 * kg])
    assert np.isnan(log.number["force"]).all()
    assert log.word["payload"].tolist() == [""]


def test_a_row_has_one_load_above_zero() -> None:
    """None, two, or one that is not above zero is rejected with its reason."""
    rows = [
        "1,1,100.5,,",
        "1,2,,,",
        "1,3,100.5,20.5,",
        "2,1,,20.5,",
        "2,2,,,box",
        "2,3,-5.5,,",
        "2,4,,-1.5,",
    ]
    rows += ["2,5,100.5,,box", "2,6,0.0000005,,", "2,7,,0.00000005,"]
    log = logs.loads("l.csv", table("pose,repeat,force_n,mass_kg,payload", *rows))

    assert log.line.tolist() == [2, 5, 6]
    assert log.word["payload"].tolist() == ["", "", "box"]
    said = lost(log)
    assert sorted(said) == [3, 4, 7, 8, 9, 10, 11]
    assert "has no force, mass or payload" in said[3]
    assert all("more than one of" in said[line] for line in (4, 9))
    assert all("force is not above zero" in said[line] for line in (7, 10))
    assert all("mass is not above zero" in said[line] for line in (8, 11))

    stated = table("pose,repeat,mass_kg,mass_sigma_kg", "1,1,20,-0.5", "1,2,20,0", "1,3,20,0.1")
    assert [*lost(logs.loads("l.csv", stated))] == [2]


def test_a_row_may_be_a_pose_with_a_column_for_each_pull() -> None:
    """An empty cell is no pull; numbers of pulls and hooks are those of the columns."""
    head = "pose,force_1_n,force_3_kn,anchor_1,anchor_3"
    log = logs.loads("l.csv", table(head, "7,100.5,2.5,left,right", "8,,1.5,left,top", "9,,,a,b"))

    assert log.number["pose"].tolist() == [7, 7, 8]
    assert log.number["repeat"].tolist() == [1, 3, 3]
    assert log.number["force"] == pytest.approx([100.5, 2500, 1500])
    assert log.number["unit"] == pytest.approx([1, 1e3, 1e3])
    assert log.word["anchor"].tolist() == ["left", "right", "top"]
    assert log.line.tolist() == [2, 2, 3]
    assert [*lost(log)] == [4]


def test_words_for_the_turnbuckle_are_up_or_down() -> None:
    """In several languages; any other is rejected, an empty one stays."""
    rows = [f"1,{k},100.5,{word}" for k, word in enumerate(["up", " Auf", "zurück", "", "left"], 1)]
    log = logs.loads("l.csv", table("pose,repeat,force_n,branch", *rows))

    assert log.word["branch"].tolist() == ["up", "up", "down", ""]
    assert "neither up nor down" in lost(log)[6]


def test_a_row_of_force_zero_is_the_unloaded_state_if_every_pose_has_one() -> None:
    """Without groups it is dropped; as a pull among others it is asked about."""
    log = logs.loads("l.csv", table("pose,force_n", "1,0", "1,100.5", "2,0", "2,200.5", "2,300.5"))
    assert log.number["force"].tolist() == [100.5, 200.5, 300.5]
    assert log.number["repeat"].tolist() == [1, 1, 2]
    assert not log.rejected

    with pytest.raises(InputError, match=r"^l\.csv:2: without a column repeat it is ambiguous"):
        logs.loads("l.csv", table("pose,force_n", "1,0", "1,100.5", "2,200.5"))
    log = logs.loads("l.csv", table("pose,repeat,force_n", "1,0,0", "1,1,100.5", "2,1,0"))
    assert log.line.tolist() == [3]
    assert [*lost(log)] == [4]


def test_a_column_of_groups_says_the_state_of_each() -> None:
    """Unloaded without a load; the name of a group loses its zeros in front."""
    rows = ["1,,007", "1,100.5,008", "2,0,9", "2,50.5,g10", "2,60.5,", ",,base"]
    log = logs.loads("l.csv", table("pose,force_n,group", *rows))

    assert {name: (s.pose, s.repeat, s.loaded, s.line) for name, s in log.states.items()} == {
        "7": (1, 0, False, 2),
        "8": (1, 1, True, 3),
        "9": (2, 0, False, 4),
        "g10": (2, 1, True, 5),
    }
    assert log.number["force"].tolist() == [100.5, 50.5]
    assert "names no group" in lost(log)[6]
    assert [logs.group_name(one) for one in ("0", "000", "0a", "10")] == ["0", "0", "0a", "10"]


@pytest.mark.parametrize(
    ("tag", "numbers"),
    [
        ("P01/2 W7", (1, 2)),
        ("12-3", (12, 3)),
        ("pose 4, pull 10", (4, 10)),
        ("007_01", (7, 1)),
        ("P1/2.5", None),
        ("P1", None),
        ("a b", None),
    ],
)
def test_a_name_may_begin_with_pose_and_pull(tag: str, numbers: tuple[int, int] | None) -> None:
    """Words and zeros in front do not count."""
    assert logs.pose_and_repeat(tag) == numbers
    bis = logs.pose_and_repeat("P4bis/2")
    assert bis == (pose_names.coded("4bis"), 2)


def test_numbers_of_poses_are_whole_and_not_negative() -> None:
    """Up to those that tables hold."""
    number = {"pose": np.array([0.0, 1.5, -1.0, 2.0**31 - 1, 2.0**31]), "x": np.arange(5.0)}
    log = Log("a", number, {}, np.arange(2, 7), ())
    found = logs.whole_numbers(log)

    assert found.line.tolist() == [2, 5]
    assert found.number["x"].tolist() == [0, 3]
    assert [*lost(found)] == [3, 4, 6]
    assert found.pose_of == pytest.approx({3: 1.5, 4: -1.0, 6: 2.0**31})


def test_of_equal_rows_one_is_kept_and_of_contradicting_ones_none() -> None:
    """By all columns but the key, up to rounding if any; lines are named."""
    number = {"pose": np.array([1, 1, 2, 2, 3, 4, 4.0]), "x": np.array([5, 5, 6, 7, 8, 9, 9.001])}
    word = {"w": np.array(["a", "a", "b", "b", "c", "d", "d"], object)}
    log = Log("a", number, word, np.arange(10, 17), ())

    assert once(log, ["pose"]).line.tolist() == [10, 14]
    said = lost(once(log, ["pose"]))
    assert said[11] == "repeats line 10; remove it"
    assert said[12] == said[13] == "lines 12, 13 contradict each other; keep the right one"
    assert [*said] == [11, 12, 13, 15, 16]
    assert once(log, ["pose"], still=0.01).line.tolist() == [10, 14, 15]
    other = replace(log, word={"w": np.array(list("axbbcdd"), object)})
    assert once(other, ["pose"]).line.tolist() == [14]
    holes = replace(log, number=number | {"x": np.where(np.arange(7) == 1, np.nan, number["x"])})
    assert once(holes, ["pose"]).line.tolist() == [14]
    assert once(log, ["pose", "x"]).line.tolist() == [10, 12, 13, 14, 15, 16]


def test_reduced_tables_are_read_in_metres_and_newtons() -> None:
    """Displacements by pose, pull and target, forces by pose and pull; a force of zero is none."""
    log = logs.displacements(
        "d.csv", table("pose,repeat,target,dx_mm,dy_m,dz_in", "1,2,P1,1.5,2.5,3.5")
    )
    assert [log.number[one][0] for one in ("dx", "dy", "dz")] == pytest.approx(
        [1.5e-3, 2.5, 0.0889]
    )
    assert log.word["target"].tolist() == ["P1"]
    log = logs.forces(
        "f.csv", table("pose,repeat,fx_n,fy_kn,fz_n", "1,1,1.5,2.5,0.5", "1,2,0.0,0.0,0.0")
    )
    assert [log.number[one].tolist() for one in ("fx", "fy", "fz")] == [[1.5], [2500.0], [0.5]]
    assert "the force is zero" in lost(log)[3]
    assert logs.columns("f.csv", table("pose,repeat,fx_n", "1,1,2.5")) == ("pose", "repeat", "fx_n")


def test_a_joint_log_is_in_joints_of_the_robot_from_either_names() -> None:
    """From a controller's axes by q = C a + q_0; only the first row of a pose counts."""
    robot = load("kr500_rail")
    axes = np.array([[8500.0, 10, -80, 70, 20, 30, 40], [1500.0, -5, -90, 95, 5, -40, 60]])
    si = np.column_stack([1e-3 * axes[:, 0], np.deg2rad(axes[:, 1:])])
    units = ["mm", *["deg"] * 6]
    head = ",".join(["pose", *(f"{a}_{u}" for a, u in zip(robot.controller, units, strict=True))])
    rows = [
        ",".join([str(k), *map(repr, row)]) for k, row in zip((3, 5), axes.tolist(), strict=True)
    ]
    log = logs.joints("j.csv", table(head, *rows), robot)

    q = si @ robot.controller_matrix.T + robot.controller_offset
    np.testing.assert_allclose(logs.joint_values(log, robot), q, atol=1e-12)
    titles = head.lower().split(",")
    assert logs.has_joints(robot, titles)
    assert not logs.has_joints(robot, titles[:-1])
    twice = replace(
        log,
        number={k: np.repeat(v, 2) for k, v in log.number.items()},
        word={},
        line=np.arange(2, 6),
    )
    assert logs.of_poses(twice).line.tolist() == [2, 4]
    assert logs.of_poses(log) is log


def test_the_column_of_a_quantity_has_its_unit_in_its_title() -> None:
    """Whatever the case of our unit; without one it is asked for, without a column, too."""
    x = Quantity("x", {"mm": 1e-3, "m": 1.0})
    assert names_of(x) == ["x_mm", "x_m"]
    assert names_of(Quantity("pose", {})) == ["pose"]
    assert suffixed(["y", "x_mm"], x) == ("x_mm", "mm")
    assert suffixed(["x"], x) == ("x", None)
    assert suffixed(["xx_mm"], x) is None
    assert column(["x_mm"], x, None) == ("x_mm", 1e-3)
    assert column(["a"], replace(x, needed=False), None) is None
    assert column(["pose"], Quantity("pose", {}), None) == ("pose", 1.0)
    with pytest.raises(InputError, match=r"no column x_mm among a; add it .* in \[t\.columns\]"):
        column(["a"], x, "t")
    with pytest.raises(InputError, match="does not say its unit; call it x_mm or x_m"):
        column(["x"], x, None)


def test_a_column_that_is_none_of_ours_is_refused() -> None:
    """With a similar one, or all of them."""
    known_columns(LogForm(columns={"Kraft": "FORCE_N"}), "scale", logs.of_loads())
    with pytest.raises(InputError, match=r"did you mean force_n\?"):
        known_columns(LogForm(columns={"Kraft": "forse_n"}), "scale", logs.of_loads())
    with pytest.raises(InputError, match="there are pose, repeat, force_n") as wrong:
        known_columns(LogForm(columns={"Kraft": "zzz"}), "scale", logs.of_loads())
    assert wrong.value.key == ["scale", "columns", "Kraft"]


def test_a_pose_with_letters_has_its_code_and_its_name() -> None:
    """The same in any case and with zeros in front; every name its own; plain ones have none."""
    words = ["4bis", "4ter", "7a", "7b", "7z", "7aa", "999zzzz", "4é", "4ö"]
    codes = [pose_names.coded(one) for one in words]

    assert len({*codes}) == len(words)
    assert [pose_names.shown(one) for one in codes] == words
    assert [pose_names.plain(one) for one in codes] == [4, 4, 7, 7, 7, 7, 999, 4, 4]
    assert max(codes) < 2**31
    assert pose_names.coded("04 BIS") == pose_names.coded("4-bis") == codes[0]
    assert [pose_names.coded(one) for one in ("4", "bis", "1000a", "4abcde")] == [None] * 4
    assert pose_names.letters_of(4) == ""
    assert pose_names.plain(4) == 4


def test_poses_with_letters_are_numbered_by_word_beside_all_others() -> None:
    """A thousand for each word in the order of the alphabet, and another one where it is taken."""
    a, b, again = (pose_names.coded(one) for one in ("4a", "4b", "9a"))

    assert pose_names.numbers([1, 4, a, b, again]) == {a: 1004, again: 1009, b: 2004}
    assert pose_names.numbers([1500, a, b]) == {a: 2004, b: 3004}
    assert pose_names.numbers([1, 2]) == {}


def readings(names: list[str], position: np.ndarray, group: list[str] | None = None) -> Export:
    """An export of these targets."""
    n = len(names)

    def words(of: list[str]) -> pa.DictionaryArray:
        return pa.array(of).dictionary_encode()

    return Export(
        "day1/a.b.csv", "plain", "ascii", Meaning("mm"), group and words(group), words(names),
        np.asarray(position, float), None, None, pa.nulls(n, pa.timestamp("us")),
        np.arange(2, n + 2), np.arange(1, n + 1), n, (), (),
    )  # fmt: skip


def test_statistics_and_placeholders_are_no_readings() -> None:
    """Names of means in any form; three equal numbers of nines; any other place is one."""
    names = ["P1", "Std. Dev", "MEAN", "P2", "P3", "P4", "P5", "meaning"]
    numbers = np.array([1, 2, 3, -9999, 999.9, 99, 9999, 4.0])[:, None] * np.ones(3)
    numbers[6, 2] = 5
    found = of_targets(readings(names, numbers), list(numbers.T))

    assert found.target.to_pylist() == ["P1", "P4", "P5", "meaning"]
    assert [line for line, _ in found.rejected] == [3, 4, 5, 6]
    assert found.rows == 8
    plain = readings(["P1", "P2"], numbers[:2])
    assert of_targets(plain, list(numbers[:2].T)) is plain
    alone = replace(plain, target=None)
    assert of_targets(alone, list(numbers[:2].T)) is alone


def test_nothing_is_farther_away_than_a_thousand_kilometres() -> None:
    """In either direction of any axis."""
    near = np.diag([1e6, -1e6, 1e6])
    assert len(in_a_hall(readings(list("abc"), near)).line) == 3
    for axis in range(3):
        for sign in (1, -1):
            far = near.copy()
            far[1, axis] = 1.1e6 * sign
            found = in_a_hall(readings(list("abc"), far))
            assert found.line.tolist() == [2, 4]
            assert found.rejected[0][0] == 3
            assert "farther than 1 000 km" in found.rejected[0][1]


def test_names_that_hold_a_group_are_split() -> None:
    """By Group::Target if all have it, by an expression if some have; others stay as they are."""
    three = np.zeros((3, 3))
    found = split(readings(["c::g1::a", "g1::b", "g2::a"], three), None)
    assert found.group.to_pylist() == ["g1", "g1", "g2"]
    assert found.target.to_pylist() == ["a", "b", "a"]
    some = readings(["g1::a", "b", "g2::a"], three)
    assert split(some, None) is some
    own = split(readings(["1-a", "b", "2-a"], three), r"(?P<group>\d)-(?P<target>.)")
    assert own.group.to_pylist() == ["1", "2"]
    assert own.line.tolist() == [2, 4]
    assert own.rejected[0][0] == 3
    named = readings(["g::a"] * 3, three, ["x"] * 3)
    assert split(named, None) is named


def test_files_name_groups_as_is_stated() -> None:
    """Without suffix; with the folder, or before the groups of the export."""
    three, names = np.zeros((3, 3)), list("abc")
    bare, grouped = readings(names, three), readings(names, three, ["g", "h", "g"])

    assert named_by_file(bare, "files").group.to_pylist() == ["a.b"] * 3
    assert named_by_file(bare, "folders/files").group.to_pylist() == ["day1/a.b"] * 3
    assert named_by_file(bare, "files::groups") is bare
    assert named_by_file(grouped, "files") is grouped
    joined = named_by_file(grouped, "files::groups").group.to_pylist()
    assert joined == ["a.b::g", "a.b::h", "a.b::g"]


def test_rows_are_kept_with_all_their_columns() -> None:
    """Of an export and of typed rows; each rejected one with its line and reason."""
    found = kept(
        readings(list("abc"), np.arange(9).reshape(3, 3)), np.array([True, False, True]), "no"
    )
    assert found.position.tolist() == [[0, 1, 2], [6, 7, 8]]
    assert found.target.to_pylist() == ["a", "c"]
    assert found.order.tolist() == [1, 3]
    assert found.rejected == ((3, "no"),)
    rows = TypedRows(
        {"x": pa.array([1.0, None, 3.0])}, np.array([4, 6, 7]), np.arange(1, 4), ((5, "old"),)
    )
    fewer = rows.without({2: "two", 0: "nought"})
    assert fewer.line.tolist() == [6]
    assert fewer.order.tolist() == [2]
    assert fewer.rejected == ((5, "old"), (4, "nought"), (7, "two"))
    assert np.isnan(fewer.floats("x")).tolist() == [True]
    assert rows.without({}) is rows
    assert rows.only(np.ones(3, bool), "") is rows
    assert rows.only(np.array([True, True, False]), "why").rejected[-1] == (7, "why")


def test_the_delimiter_is_the_most_frequent_one() -> None:
    """Of those that are known; without any the usual one."""
    assert [delimiter_of(one) for one in ("a,b;c;d", "a\tb", "a|b|c,d", "a b")] == [*";\t|,"]
    assert delimiter_of("a b", " ") == " "


def test_lines_are_numbered_from_one_without_their_ends() -> None:
    """Of any system; the first with content, and those from a line on."""
    for data in (b"\n a\nb\r\nc", b"\r a\rb\rc", b"\r\n a\r\nb\r\nc"):
        found = text("a", data)
        assert [line for _, line in found.lines()] == ["", " a", "b", "c"]
        assert list(found.lines(2, 2)) == [(2, " a"), (3, "b")]
        assert found.first() == (2, " a")
        assert len(found) == 4
        assert not found.ended()
    assert text("a", b"a\n").ended()
    assert text("a", b"\x1c\n\x1d").first() == (1, "\x1c")
    assert text("a", b"x\n" * 61).sample() == ["x"] * 60


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"]
)
def test_the_encoding_of_a_text_is_found(encoding: str) -> None:
    """With and without a mark at its beginning."""
    said = "group,target\nMüller,12.5\n" * 3
    assert text("a", said.encode(encoding)).data.decode() == said
    refuse_other_programs("a.csv", said.encode(encoding))


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.csv", b"PK\x03\x04..", "an Excel workbook or a ZIP archive"),
        ("a.csv", b"%PDF-1.4", "a PDF"),
        ("a.csv", b"\x1f\x8b..", "compressed"),
        ("a.xlsx", b"\xd0\xcf\x11\xe0", "an old Excel workbook"),
        ("a.csv", b"a\0bcdefgh", "contains zero bytes"),
        ("a.csv", b"", "empty"),
        ("a.csv", b" \n ", "empty"),
        ("a.csv", b"a\n" + b"x" * 10_000 + b"\n", "10001 bytes"),
    ],
)
def test_what_is_no_text_is_refused(name: str, data: bytes, said: str) -> None:
    """With the line of one that is too long."""
    with pytest.raises(InputError, match=said) as wrong:
        text(name, data)
    assert wrong.value.line == (2 if "bytes" in said and "zero" not in said else None)


def test_a_workbook_is_left_to_its_reader() -> None:
    """By its name and its first bytes; a line of the largest length is one."""
    refuse_other_programs("a.XLSX", b"PK\x03\x04")
    assert len(text("a", b"a\n" + b"x" * 9_999 + b"\n")) == 2


def test_blanks_are_squeezed() -> None:
    """Runs of them to one, none at either end of a line."""
    found: Text = squeezed(text("a", b"  a \t b  \r\nc\n"))
    assert found.data == b"a b\r\nc\n"
    assert found.starts.tolist() == [0, 5, 7]
    assert shortened("a" * 41) == "a" * 39 + "…"
    assert shortened("a" * 40) == "a" * 40
    assert shortened("a\x1bb") == "a?b"


@pytest.mark.parametrize(
    ("unit", "metre"),
    [
        ("mm", 1e-3),
        ("cm", 1e-2),
        ("m", 1.0),
        ("um", 1e-6),
        ("in", 0.0254),
        ("ft", 0.3048),
        ("ftUS", 1200 / 3937),
    ],
)
def test_lengths_in_their_units(unit: str, metre: float) -> None:
    """There and back."""
    assert metres(np.array([2.5]), unit) == pytest.approx([2.5 * metre])
    assert in_unit(np.array([2.5 * metre]), unit) == pytest.approx([2.5])
