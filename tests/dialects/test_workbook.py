"""Workbooks: which sheet is read, values of its cells, and refusals before unpacking."""

import io
import zipfile
from datetime import datetime

import numpy as np
import pytest
from workbooks import workbook

from pipeline import readers
from pipeline.base.errors import InputError
from pipeline.base.files import read as read_file
from pipeline.intake.offer import offer
from pipeline.readers import ExportSettings, logs
from pipeline.readers.export_settings import LogForm

TITLES = ["group", "target", "x_mm", "y_mm", "z_mm", "time"]
NOON = datetime(2026, 11, 3, 12, 0, 0, 250_000)
ROWS = [["a", "P1", 1.0625, -2, 3e-7, NOON], ["a", 2, 4.5, 5.25, 6.125, NOON]]


def read(data, name="t.xlsx", **hints):
    return readers.read(name, data, ExportSettings(**hints))


def test_cells_say_what_they_show():
    """Numbers to the last digit, times to the millisecond, a numeric name without a point."""
    got = read(workbook(A=[TITLES, *ROWS]))

    assert got.position.tolist() == [[1.0625e-3, -2e-3, 3e-10], [4.5e-3, 5.25e-3, 6.125e-3]]
    assert got.target.to_pylist() == ["P1", "2"]
    assert got.time.to_pylist() == [NOON, NOON]
    assert got.line.tolist() == [2, 3]
    assert got.encoding == 'workbook, sheet "A"'


def test_lines_are_those_that_excel_shows():
    """Rows above the titles and empty ones count."""
    bad = ["a", "P3", "n/a", 1, 1, NOON]
    remarks = [["Messung 7"], [], ['sagt "Meier"\nund\tMüller']]
    columns = {"group": "group", "target": "target", "x": 3, "y": 4, "z": 5, "time": "time"}
    data = workbook(A=[[], *remarks, TITLES, ROWS[0], [], bad])
    got = read(data, mapping={"header": 5, "columns": columns})

    assert got.line.tolist() == [6]
    assert [line for line, _ in got.rejected] == [8]


def test_a_decimal_comma_is_expected_of_text_only():
    """A numeric cell in Excel has no decimal mark."""
    rows = [["a", "P1", 1.5, 2, "3,25", NOON]]

    assert read(workbook(A=[TITLES, *rows]), decimal=",").position.tolist() == [
        [1.5e-3, 2e-3, 3.25e-3]
    ]


def test_the_sheet_that_fits_is_read():
    """Notes, charts and empty sheets are skipped."""
    got = read(workbook(Notizen=[["gut"]], Werte=[TITLES, *ROWS], Leer=[]))

    assert got.encoding == 'workbook, sheet "Werte"'


def test_two_sheets_that_fit_are_asked():
    """And one of them is read if it is named."""
    two = workbook(Heute=[TITLES, ROWS[0]], Gestern=[TITLES, *ROWS])

    with pytest.raises(InputError, match=r"t.xlsx: 2 of .* sheets fit, of Heute, Gestern; .*sheet"):
        read(two)
    assert len(read(two, sheet="Heute").line) == 1
    with pytest.raises(InputError, match=r'no sheet "Morgen", only Heute, Gestern; .*tracker'):
        read(two, sheet="Morgen")


def test_no_sheet_that_fits_is_asked_for():
    """For a named sheet the message says what it lacks."""
    with pytest.raises(InputError, match="none of the workbook's 2 sheets fit, of A, B"):
        read(workbook(A=[["x"]], B=[["y"]]))


def test_a_sheet_that_leaves_its_unit_open_is_asked_for_it_alone():
    """The sheet with the points is taken, and a mapping of its columns is proposed."""
    rows = [[*row[:2], 1000.5 * row[2], 2000.5, -3000.5] for row in ROWS]
    data = workbook(info=[["hall", 7]], points=rows)
    found = offer("t.xlsx", data, ExportSettings())

    assert found.question.about == "unit"
    with pytest.raises(InputError, match="does not say its unit of length"):
        read(data)
    assert len(readers.read("t.xlsx", data, found.hints).line) == len(rows)


def test_a_log_finds_its_sheet_too():
    """By the column that all logs have."""
    rows = [["pose", "repeat", "force_n"], [1, 1, 500.5]]
    log = logs.loads("loads.xlsx", workbook(Notizen=[["gut"]], Last=rows))
    two = workbook(A=rows, B=[*rows, [1, 2, 700]])

    assert log.number["force"].tolist() == [500.5]
    with pytest.raises(InputError, match=r"loads.xlsx: 2 of .* in \[scale\] of campaign.toml"):
        logs.loads("loads.xlsx", two)
    assert len(logs.loads("loads.xlsx", two, LogForm(sheet="B")).line) == 2


def packed(*names):
    """A ZIP archive with some parts."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            archive.writestr(name, "<workbook/>")
    return out.getvalue()


def lying(said):
    """A workbook whose directory states a wrong size of its sheet."""
    good = workbook(A=[TITLES, *ROWS])
    with zipfile.ZipFile(io.BytesIO(good)) as archive:
        size = archive.getinfo("xl/worksheets/sheet1.xml").file_size
    return good.replace(*(np.array([n], "<u4").tobytes() for n in (size, said)))


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (lambda: lying(2_000_000_000), "unpacked has 2.0 GB, more than the 1 GB that are read"),
        (lambda: packed("a.txt"), "a ZIP archive and no workbook; unpack it"),
        (lambda: packed("xl/workbook.xml"), "cannot be read"),
        (lambda: workbook(A=[TITLES, *ROWS])[:-500], "damaged"),
        (lambda: workbook(A=[TITLES, *ROWS])[:-6] + b"\xff" * 4 + b"\0" * 2, "damaged"),
        (lambda: workbook(A=[[]]), "the workbook is empty"),
    ],
    ids=["bomb", "archive", "no sheets", "cut off", "far directory", "empty"],
)
def test_what_is_no_workbook_is_refused(data, said):
    """In one sentence, before anything is kept in memory."""
    with pytest.raises(InputError, match=rf"t.xlsx: .*{said}"):
        read(data())


def test_a_part_that_is_longer_than_it_says_is_refused():
    """The size in the directory of the archive is not trusted."""
    with pytest.raises(InputError, match=r"sheet1.xml is longer than it says"):
        read(lying(7))


@pytest.mark.parametrize(
    ("cell", "times", "most", "said"),
    [
        ('<c r="ZZZZ1"><v>1</v></c>', 1, None, "has a cell where no sheet has one"),
        ('<c r="A99999999"><v>1</v></c>', 1, None, "has a cell where no sheet has one"),
        ("<c r='ZZZZ1'><v>1</v></c>", 1, None, "has a cell where no sheet has one"),
        ('<c r="XFD1048576"><v>1</v></c>', 1, None, "spans 16384 columns and 1048576 rows"),
        ("<c r='ABC900000'><v>1</v></c>", 1, None, "spans 731 columns and 900000 rows"),
        ('</row><row r="1048576">' + "<c><v>1</v></c>" * 40, 1, None, "spans 40 columns and 10485"),
        ('<c r="xfd1048576"><v>1</v></c>', 1, None, "spans 16384 columns and 1048576 rows"),
        ("<c/>" * 2000 + "</row>" + "<row/>" * 10_500 + "<row>", 1, None, "spans 2000 columns and"),
        ("<c><v>1</v></c>", 1100, 1000, "a sheet has more than 1000 cells"),
        ("<x:c/><c\t/>", 550, 1000, "a sheet has more than 1000 cells"),
        pytest.param(
            "<c><v>1</v></c>",
            10_000_100,
            None,
            r"spans \d+ columns and 4 rows",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_sheet_without_end_is_refused(cell, times, most, said, monkeypatch):
    """A few bytes of it, unpacked, took a minute and more; also with a lower limit."""
    if most is not None:
        monkeypatch.setattr("pipeline.dialects.workbook._MOST_CELLS", most)
    good = workbook(A=[TITLES, *ROWS])
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(good)) as old, zipfile.ZipFile(out, "w", 8) as new:
        for name in old.namelist():
            text = old.read(name)
            row = f"<row>{cell * times}</row></sheetData>".encode()
            new.writestr(name, text.replace(b"</sheetData>", row))

    with pytest.raises(InputError, match=said):
        read(out.getvalue())


@pytest.mark.parametrize(
    ("limit", "most", "said"),
    [("_MOST_SHEETS", 1, "2 sheets, more than the 1"), ("_MOST_CELLS", 30, "more than 30 cells")],
)
def test_sheets_without_end_are_refused(limit, most, said, monkeypatch):
    """One part of the archive may be listed as any number of sheets."""
    monkeypatch.setattr(f"pipeline.dialects.workbook.{limit}", most)
    with pytest.raises(InputError, match=said):
        read(workbook(A=[TITLES, *ROWS], B=[TITLES, *ROWS]))


def test_a_workbook_that_is_too_large_is_not_read(tmp_path):
    """Its size is checked before it is opened, with another limit than for text."""
    huge = tmp_path / "huge.xlsx"
    with huge.open("wb") as file:
        file.truncate(readers.largest("huge.xlsx") + 1)

    with pytest.raises(InputError, match="more than the 100 MiB that are read"):
        read_file(huge, "huge.xlsx", readers.largest("huge.xlsx"), begins=pytest.fail)


def test_a_workbook_under_another_name_is_asked_to_be_named():
    """The size limit depends on the name, so that the name must be right."""
    with pytest.raises(InputError, match=r"tracker.csv: .*Excel workbook.*save it as .xlsx"):
        read(workbook(A=[TITLES, *ROWS]), "tracker.csv")


@pytest.mark.parametrize("piece", [1 << 20, 40])
def test_an_error_of_a_formula_is_no_empty_cell(piece, monkeypatch):
    """An empty pose is that of the row above, an empty force a pull that was not made."""
    monkeypatch.setattr("pipeline.dialects.workbook._PIECE", piece)
    rows = [[1, 702.5, 1402.5], ["#N/A", 712.5, 1412.5], [3, "#DIV/0!", 1422.5], [4, 732.5, None]]
    log = logs.loads("l.xlsx", workbook(loads=[["pose", "force_1_n", "force_2_n"], *rows]))

    assert [(line, why.partition(",")[0]) for _, line, why in log.rejected] == [
        (3, 'pose is "#N/A"'),
        (4, 'force_1_n is "#DIV/0!"'),
    ]
    assert log.number["pose"].tolist() == [1, 1, 4]
