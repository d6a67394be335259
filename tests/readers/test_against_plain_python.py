"""Texts, times, tables and workbooks against what Python's own library says of the same bytes."""

import csv
import io
import re
from datetime import UTC, datetime
from itertools import product

import numpy as np
import pyarrow as pa
import pytest

from pipeline import readers
from pipeline.base.errors import InputError
from pipeline.machine.robot import load
from pipeline.readers import _text, logs, plain, pose_names, text
from pipeline.readers._iso import at_once, possible
from pipeline.readers._layout import Field, Layout
from pipeline.readers._plain_rows import is_plain, plain_rows
from pipeline.readers._reader import OutgoingReadings, text_of
from pipeline.readers.export_settings import OWN_LOG, ExportSettings
from tests.workbooks import workbook

RAIL = load("kr500_rail")


def any_text(size):
    """All texts of this size from a letter and two ends of line."""
    return (bytes(one) for one in product(b"a\r\n", repeat=size))


@pytest.mark.parametrize("size", range(1, 6))
def test_lines_end_where_python_ends_them(size):
    r"""At \n, \r\n or \r, whichever come together; a lone \r is one that no \n follows."""
    for data in any_text(size):
        starts = _text._starts(data)
        begins = [0, *(one.end() for one in re.finditer(b"\n", data))]
        expected = begins if data.endswith(b"\n") else [*begins, size]
        assert starts.tolist() == expected, data
        assert _text._lone_return(data, starts) == bool(re.search(rb"\r(?!\n)", data)), data
        if data.isspace():
            continue
        found = text("a", data)
        assert [line for _, line in found.lines()] == data.decode().splitlines(), data
        assert found.ended() == data.endswith((b"\n", b"\r")), data


def test_lines_are_found_in_pieces_as_in_one(monkeypatch):
    """Whatever stands at the border of two pieces, and whether threads look at them."""
    data = b"".join(b"x" * k + b"\r\n" for k in range(40))
    whole = _text._starts(data)
    for piece in (7, 100):
        monkeypatch.setattr(_text, "_CHUNK", piece)
        assert _text._starts(data).tolist() == whole.tolist()


def test_files_may_be_as_large_as_their_kind(monkeypatch):
    """Workbooks by their name, in any case; a text of the largest size is read."""
    sizes = [readers.largest(name) for name in ("a.xlsx", "B.XLSM", "a.xls", "xlsx", "a.csv")]
    assert sizes == [100 * 2**20] * 2 + [2_000_000_000] * 3
    monkeypatch.setattr(_text, "_LARGEST_FILE", 6)
    assert len(text("a", b"abcde\n")) == 1
    with pytest.raises(InputError, match="split it into several exports"):
        text("a", b"abcdef\n")


@pytest.mark.parametrize(
    ("cells", "zone"),
    [
        (["2026-11-03T08:00:01", "", "2026-11-03 09:59:59.123456"], False),
        (["2026-11-03T08:00", "2026-02-28 23:00"], False),
        (["2026-11-03T08:00:01+02:00", "2026-11-03T08:00:01-0530", "2026-11-03T08:00:01Z"], True),
        (["1900-01-01T00:00:00", "2199-12-31T23:59:59"], False),
    ],
)
def test_times_are_those_of_python(cells, zone):
    """With a zone in UTC; an empty cell is none."""
    python = [datetime.fromisoformat(one) if one else None for one in cells]
    expected = [one.astimezone(UTC).replace(tzinfo=None) if zone else one for one in python]
    assert possible(at_once(pa.array(cells))).to_pylist() == expected


@pytest.mark.parametrize(
    "cells", [["2026-11-03"], ["2026-11-03T08"], ["x"], ["2026-13-03T08:00:00"]]
)
def test_what_is_no_time_is_refused_and_an_impossible_one_is_none(cells):
    """A date alone is no time; nobody measured in 1899 or 2200."""
    with pytest.raises(pa.ArrowInvalid):
        at_once(pa.array(["2026-11-03T08:00:00", *cells]))
    beyond = ["1899-12-31T23:59:59", "2200-01-01T00:00:00"]
    assert possible(at_once(pa.array(beyond))).to_pylist() == [None, None]


def exported(count=25, unit="mm", seed=1):
    """A plain export as Python's csv module writes it, and what stands in it."""
    rng = np.random.default_rng(seed)
    numbers = rng.normal(size=(count, 3)) * 5e3
    times = [datetime(2026, 11, 3, 8, k % 60, k // 60) for k in range(count)]
    rows = [
        [f"g{k % 4}", f"P{k % 3}", *map(repr, numbers[k].tolist()), times[k].isoformat()]
        for k in range(count)
    ]
    out = io.StringIO()
    head = ["group", "target", f"x_{unit}", f"y_{unit}", f"z_{unit}", "time"]
    csv.writer(out, lineterminator="\n").writerows([head, *rows])
    return out.getvalue().encode(), rows, numbers, times


@pytest.mark.parametrize(("unit", "metre"), [("mm", 1e-3), ("m", 1.0), ("in", 0.0254)])
def test_an_export_holds_what_the_csv_module_wrote(unit, metre):
    """Names, places, times and lines, in their order; written and read again, too."""
    data, rows, numbers, times = exported(unit=unit)
    found = readers.read("t.csv", data)

    assert found.group.to_pylist() == [row[0] for row in rows]
    assert found.target.to_pylist() == [row[1] for row in rows]
    np.testing.assert_allclose(found.position, numbers * metre, rtol=1e-15)
    assert found.time.to_pylist() == times
    assert found.line.tolist() == [*range(2, len(rows) + 2)]
    assert found.order.tolist() == [*range(1, len(rows) + 1)]
    assert (found.rows, found.rejected, found.meaning.unit) == (len(rows), (), unit)
    names = ([row[k] for row in rows] for k in (0, 1))
    again = readers.read(
        "t.csv", plain.write(OutgoingReadings(*names, found.position, times), unit, None)
    )
    np.testing.assert_allclose(again.position, found.position, rtol=1e-15)
    assert again.time.to_pylist() == times
    assert again.target.to_pylist() == found.target.to_pylist()


def test_numbers_are_written_with_their_digits():
    """As many decimals as asked for, or all that there are."""
    values = np.array([[1.0, -2.34567, 1 / 3], [1e-7, 0.5, 12.0]])
    assert text_of(values, 2) == [["1.00", "-2.35", "0.33"], ["0.00", "0.50", "12.00"]]
    assert [[float(cell) for cell in row] for row in text_of(values, None)] == values.tolist()


@pytest.mark.parametrize(
    ("head", "ours"),
    [
        ("group,target,x_mm,y_mm,z_mm,time", True),
        ("group,target,x_m,y_m,z_m", True),
        ("group,target,x_in,y_in,z_in\t", True),
        ("group,target,x_mm,y_m,z_mm", False),
        ("target,group,x_mm,y_mm,z_mm", False),
        ("group,target,x_mm,y_mm,z_mm,time,more", False),
    ],
)
def test_an_export_is_ours_by_its_titles(head, ours):
    """One unit for all axes; an empty file is nobody's."""
    assert plain.recognise([head, "a,b,1,2,3"]) == ours
    assert not plain.recognise([])


def table(*rows, kind="number", needed=True):
    """A file with two columns, and how it is read."""
    data = "".join(f"{row}\n" for row in ("a,b", *rows)).encode()
    fields = (Field("a", "name"), Field("b", kind, needed))
    return plain_rows(text("t", data), Layout(fields, ",", 2))


@pytest.mark.parametrize(
    ("cell", "kind", "needed", "whole"),
    [
        ("2.5", "number", True, True), ("-1e3", "number", True, True),
        ("1e30", "number", True, True), ("2e30", "number", True, False),
        ("-2e30", "number", True, False), ("nan", "number", True, False),
        ("", "number", True, False), ("", "number", False, True), ("x", "number", False, False),
        ("", "name", True, False), ("", "name", False, True), ("x", "name", True, True),
        ("", "time", True, False), ("", "time", False, True), ("2026-11-03", "time", False, False),
        ("2026-11-03T08:00:00", "time", True, True), ("1890-11-03T08:00:00", "time", False, False),
        ("anything", "any", True, True),
    ],
)  # fmt: skip
def test_a_table_is_plain_if_every_cell_is(cell, kind, needed, whole):
    """A cell that is missing, no number or no time leaves the whole table to others."""
    other = {"number": "1", "name": "y", "time": "2026-11-03T08:00:00", "any": ""}[kind]
    found = table(f"p,{other}", f"q,{cell}", f"r,{other}", kind=kind, needed=needed)
    assert (found is not None) == whole
    if found is not None:
        assert found.columns["a"].to_pylist() == ["p", "q", "r"]
        assert (found.line.tolist(), found.order.tolist()) == ([2, 3, 4], [1, 2, 3])
        assert ("b" in found.columns) == (kind != "any")
    assert table("p,1", "q,2,3") is None
    assert table("p,1", "q") is None


@pytest.mark.parametrize(
    ("data", "plain_"),
    [
        (b"a,b\n1,2\n", True), (b"a b,c\n1,2\r\n", True), (b"a,b\n1,2", False), (b"a, b\n", False),
        (b"a ,b\n", False), (b"a,b \n", False), (b"a,b\n c,d\n", False), (b"a,b \r\n", False),
        (b'a,"b"\n', False), (b"a;b\n", False), ("ä,b\n".encode(), False),
    ],
)  # fmt: skip
def test_a_plain_file_has_no_blanks_at_the_edges_of_cells(data, plain_):
    """Nor other characters, and its last line is whole."""
    assert is_plain(text("t", data)) == plain_


# --- whose file it is -----------------------------------------------------------------------------


def reader(name, fits, general=False):
    """A reader that recognises anything or nothing."""
    return readers.Reader(name, lambda _: fits, lambda *_: None, general=general)


def test_a_distinctive_dialect_comes_before_general_ones(monkeypatch):
    """One that fits is taken; of two or none an error tells which."""
    a, b, none = reader("A", True), reader("B", True, general=True), reader("C", False)
    assert readers._fitting([none, b, a], []) == [a]
    assert readers._fitting([none, b], []) == [b]
    assert readers._fitting([none], []) == []
    file = text("t", b"nothing here\n")
    for there, said in (
        ([a, reader("D", True), none], "may be A, D;"),
        ([none, reader("E", False)], "none of C, E, and there are no rows with three numbers"),
    ):
        monkeypatch.setattr(readers, "catalogue", lambda there=there: dict(enumerate(there)))
        with pytest.raises(InputError, match=said):
            readers.recognise(file)
    last = reader("any table", False)
    known = {"b": b, "c": none, readers.TABLE: last}
    monkeypatch.setattr(readers, "catalogue", lambda: known)
    assert readers.recognise(file) is b
    del known["b"]
    for holds in (True, False):
        monkeypatch.setattr(readers, "_holds_one", lambda _, holds=holds: holds)
        if holds:
            assert readers.recognise(file) is last
        else:
            with pytest.raises(InputError, match="none of C,"):
                readers.recognise(file)


def test_writers_are_the_readers_that_can_write():
    """Ours among them, by the same keys."""
    every = readers.catalogue()
    assert readers.writers() == {key: one for key, one in every.items() if one.write is not None}
    assert readers.writers()["plain"].name == "plain CSV"
    assert 1 < len(readers.writers()) < len(every)


POINTS = [
    ["group", "target", "x_mm", "y_mm", "z_mm"],
    ["a", "P1", 1.5, 2.5, 3.5],
    ["a", "P2", 4.5, 5.5, 6.5],
]


def test_of_several_sheets_the_one_with_readings_is_read():
    """Before one whose titles name coordinates, and that before one with numbers only."""
    titles = [["target", "x", "y", "z"], ["P1", 1.5, 2.5, 3.5], ["P2", 4.5, 5.5, 6.5]]
    numbers = [[1.5, 2.5, 3.5, 9.5], [4.5, 5.5, 6.5, 9.5]]
    words = [["remarks", "of the day"], ["none", "at all"]]
    every = {"R": words, "N": numbers, "T": titles, "P": POINTS}
    rated = {
        name: readers._fits(
            text(name, "".join(",".join(map(str, row)) + "\n" for row in rows).encode()),
            ExportSettings(),
        )
        for name, rows in every.items()
    }
    assert rated == {"R": 0, "N": 1, "T": 2, "P": 3}
    found = readers.read("a.xlsx", workbook(**every))
    assert found.position.tolist() == [[0.0015, 0.0025, 0.0035], [0.0045, 0.0055, 0.0065]]
    with pytest.raises(InputError):
        readers.read("a.xlsx", workbook(P=POINTS, Q=POINTS))
    far = ["a", "P1", 1e12, 1e12, 1e12]
    assert readers._fits(text("t", f"{','.join(POINTS[0])}\n{','.join(map(str, far))}\n".encode()),
                         ExportSettings()) == 0  # fmt: skip


def test_names_that_hold_groups_are_split_and_files_name_them():
    """As campaign.toml says, from the bytes of a file on."""
    data = b"group,target,x_m,y_m,z_m\ng,P1,1,2,3\nh,P2,4,5,6\n"
    assert readers.read("d/t.csv", data).group.to_pylist() == ["g", "h"]
    by_file = readers.read("d/t.csv", data, ExportSettings(groups="files::groups"))
    assert by_file.group.to_pylist() == ["t::g", "t::h"]
    with pytest.raises(InputError) as wrong:
        readers.read("d/t.csv", b"")
    assert wrong.value.file == "d/t.csv"


# --- logs -----------------------------------------------------------------------------------------


def test_titles_tell_which_log_it_is():
    """A load in any of its forms; all joints of a robot or all axes of its controller."""
    for title in ("force_n", "mass_kg", "payload", "force_3_kn", "mass_sigma_g"):
        assert logs.has_load(["pose", title]), title
    for titles in (["pose", "repeat"], ["branch", "group"], ["pose", "force_x_n"], []):
        assert not logs.has_load(titles), titles
    joints = [f"{j.name}_{'m' if j.prismatic else 'deg'}".lower() for j in RAIL.joints]
    axes = [
        f"{one}_{'mm' if s else 'rad'}".lower()
        for one, s in zip(RAIL.controller, RAIL.slides, strict=True)
    ]
    assert logs.has_joints(RAIL, ["pose", *joints])
    assert logs.has_joints(RAIL, axes[::-1])
    assert not logs.has_joints(RAIL, joints[1:])
    assert not logs.has_joints(RAIL, [*joints[:4], *axes[4:-1]])


@pytest.mark.parametrize("of_controller", [True, False])
def test_joint_values_stand_beside_further_columns(of_controller):
    """In radians and metres, from either names: q = C a + q_0."""
    rng = np.random.default_rng(3)
    a = rng.uniform(-0.5, 0.5, size=(4, RAIL.n))
    names = RAIL.controller if of_controller else [joint.name for joint in RAIL.joints]
    slides = RAIL.slides if of_controller else [joint.prismatic for joint in RAIL.joints]
    factor = np.where(slides, 1000.0, 180 / np.pi)
    head = [f"{one}_{'mm' if s else 'deg'}" for one, s in zip(names, slides, strict=True)]
    lines = [",".join([*head, "fx_n"])] + [
        ",".join(map(repr, [*row, 7.25])) for row in (a * factor).tolist()
    ]
    others = [logs.Quantity("fx", logs.FORCE)]
    log = logs.with_joints("p.csv", "\n".join([*lines, ""]).encode(), RAIL, OWN_LOG, others)

    expected = a @ RAIL.controller_matrix.T + RAIL.controller_offset if of_controller else a
    np.testing.assert_allclose(logs.joint_values(log, RAIL), expected, atol=1e-14)
    assert log.number["fx"].tolist() == [7.25] * 4
    first = logs.of_poses(
        logs.Log("a", {"pose": np.array([4.0, 4, 2, 4, 2])}, {}, np.arange(5), ())
    )
    assert (first.number["pose"].tolist(), first.line.tolist()) == ([4, 2], [0, 2])
    assert first.rejected == ()
    assert logs.of_poses(first) is first


@pytest.mark.parametrize(("unit", "newtons"), [("n", 1.0), ("kn", 1e3), ("nm", 1.0)])
def test_torques_and_axes_do_the_same_work(unit, newtons):
    """Torque times motion, summed over the joints, is that over the controller's axes."""
    rng = np.random.default_rng(4)
    a = rng.uniform(-0.5, 0.5, size=(3, RAIL.n))
    tau = rng.normal(size=(3, RAIL.n)) * 100
    head = [
        f"{one}_{'m' if s else 'rad'}" for one, s in zip(RAIL.controller, RAIL.slides, strict=True)
    ]
    head += [f"tau{k}_{unit if s else 'nm'}" for k, s in enumerate(RAIL.slides, 1)]
    lines = [",".join(["pose", *head])]
    lines += [
        ",".join(map(repr, [k, *row]))
        for k, row in enumerate(
            np.hstack([a, tau / np.where(RAIL.slides, newtons, 1.0)]).tolist(), 1
        )
    ]
    log = logs.joints("j.csv", "\n".join([*lines, ""]).encode(), RAIL)
    found = np.column_stack([log.number[f"tau{k}"] for k in range(1, RAIL.n + 1)])

    small = rng.normal(size=(RAIL.n, 5))  # motions of axes, and of joints by C
    np.testing.assert_allclose(found @ RAIL.controller_matrix @ small, tau @ small, rtol=1e-9)


def test_names_of_rows_hold_pose_and_pull_as_an_expression_reads_them():
    """Only where both are there; letters behind the pose belong to it."""
    for pose, repeat, letters in product((1, 40, 999), (1, 12), ("", "b")):
        for form in ("P{}{}/{}", "pose {}{} - pull {}", "00{}{}_{} W7"):
            tag = form.format(pose, letters, repeat)
            number = pose_names.coded(f"{pose}{letters}") if letters else pose
            assert logs.pose_and_repeat(f" {tag} ") == (number, repeat), tag
    for tag in ("", "P12", "W/2", "12.5/1", "/3", "4/1.5"):
        assert logs.pose_and_repeat(tag) is None, tag


def test_forces_of_a_reduced_campaign_are_vectors():
    """Each in newtons; the size of all three counts, not each of them."""
    data = b"pose,repeat,fx_n,fy_kn,fz_n\n1,1,0,1.5,0\n1,2,0,0,0\n2,1,-3,0,4\n2,1,-3,0,4\n"
    log = logs.forces("f.csv", data)
    assert np.column_stack([log.number[k] for k in ("fx", "fy", "fz")]).tolist() == [
        [0, 1500, 0], [-3, 0, 4]
    ]  # fmt: skip
    assert log.line.tolist() == [2, 4]
    assert [line for _, line, _ in log.rejected] == [3, 5]
    assert logs.columns("f.csv", data) == ("pose", "repeat", "fx_n", "fy_kn", "fz_n")
    assert log.pose_of == {3: 1.0, 5: 2.0}


def test_a_carriage_arrived_one_way_or_the_other_or_nobody_knows():
    """1, -1, 0 or nothing; any other number is rejected with its line."""
    names = ",".join(
        f"{one}_{'mm' if s else 'deg'}" for one, s in zip(RAIL.controller, RAIL.slides, strict=True)
    )
    rows = [
        f"{k},{way},{','.join(['10'] * RAIL.n)}"
        for k, way in enumerate(("1", "-1", "0", "", "2", "-2"), 1)
    ]
    log = logs.joints("j.csv", "\n".join([f"pose,approach,{names}", *rows, ""]).encode(), RAIL)
    np.testing.assert_array_equal(log.number["approach"], [1, -1, 0, np.nan])
    assert [line for _, line, _ in log.rejected] == [6, 7]
