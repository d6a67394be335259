"""The answer as a workbook and as CSV, opened by independent programs."""

import csv
import io
import zipfile

import numpy as np
import openpyxl
import pandas as pd
import pyarrow as pa
import pytest
import report_sample
from python_calamine import CalamineWorkbook

from pipeline.answer.contract import Combination, Rejected
from pipeline.exchange import workbook
from pipeline.library.spreadsheets import harmless

SHEETS = [
    "summary",
    "stiffness",
    "combinations",
    "causes",
    "predictions",
    "validation",
    "residuals",
    "reliability",
    "rejected",
]
EVIL = '=HYPERLINK("http://x","y")'


@pytest.fixture(scope="module")
def answer():
    """An answer with content on every sheet, and names that a spreadsheet would execute."""
    mixed = Combination(
        of=("k_theta2", "k_theta4"),
        weights=(1.0, 0.58),
        value=8.5e-5,
        std=1.1e-6,
        ci95=(8.3e-5, 8.7e-5),
        unit="rad/(N m)",
        needs=EVIL,
    )
    bad = (
        Rejected(file=EVIL, line=17, reason="-1+1 is no coordinate\x1b"),
        Rejected(file="loads.csv", line=None, reason="http://a link"),
    )
    return report_sample.answer().model_copy(update={"combinations": (mixed,), "rejected": bad})


@pytest.fixture(scope="module")
def tables():
    return report_sample.tables()


@pytest.fixture(scope="module")
def written(answer, tables):
    return workbook.files(answer, tables)


def rows(written, name):
    """A sheet as numbers and texts, by heading, from an independent reader."""
    book = CalamineWorkbook.from_filelike(io.BytesIO(written["results.xlsx"]))
    titles, *cells = book.get_sheet_by_name(name).to_python(skip_empty_area=False)
    return [dict(zip(titles, line, strict=True)) for line in cells]


def test_the_workbook_has_its_sheets_with_bold_headings_that_stay(written):
    """In the order of the report; columns wide enough for a number."""
    book = openpyxl.load_workbook(io.BytesIO(written["results.xlsx"]))

    assert book.sheetnames == SHEETS
    for sheet in book:
        assert sheet.freeze_panes == "A2"
        assert all(cell.font.bold for cell in sheet[1])
        assert not any(cell.font.bold for line in sheet.iter_rows(min_row=2) for cell in line)
        assert min(c.width for c in sheet.column_dimensions.values()) >= 9


def test_every_stiffness_is_a_number_to_sixteen_digits(written, answer):
    """Value, uncertainty and interval; empty if unknown, never zero."""
    for row, joint in zip(rows(written, "stiffness"), answer.stiffness, strict=True):
        said = [row["value"], row["standard uncertainty"], row["95 % from"], row["95 % to"]]
        known = [joint.value, joint.std, *joint.ci95]
        assert said == ["" if x is None else pytest.approx(x, rel=1e-15) for x in known]
        assert row["unit"] == joint.unit
        assert row["determined"] == ("yes" if joint.identifiable else "no")
    alone = [j.value for j in answer.joint_springs.stiffness]
    assert [row["joint springs alone"] for row in rows(written, "stiffness")] == [
        "" if x is None else pytest.approx(x, rel=1e-15) for x in alone
    ]


def test_every_reading_is_on_the_sheet_of_reliability(answer, tables):
    """Not only the ten of result.json; unknown sizes are empty cells, in Excel and in CSV."""
    one = {"source": "tracker_noise", "reading": "g/P1", "file": "tracker.csv", "line": 7}
    one |= {"axis": "x", "r": 0.5, "w": -1.5, "smallest_visible": 3e-4, "unit": "m"}
    one |= {"moves_sigmas": 0.25, "moves_most": "k_theta2"}
    lost = one | {"reading": None, "line": None, "w": np.nan, "smallest_visible": np.inf}
    told = pd.DataFrame([one, lost] * 20)
    made = workbook.files(answer, tables | {"reliability": told})
    first, second, *others = rows(made, "reliability")

    assert len(others) == 38
    assert (first["reading"], first["line"], first["redundancy [1]"]) == ("g/P1", 7, 0.5)
    assert first["minimal detectable bias"] == 3e-4
    assert [second[k] for k in ("reading", "line", "minimal detectable bias")] == [""] * 3
    assert made["csv/reliability.csv"].count(b"g/P1") == 20


def test_causes_predictions_and_validation_are_those_of_the_answer(written, answer):
    """Each with its numbers and unit."""
    (cause,) = rows(written, "causes")
    found = rows(written, "predictions")
    errors = {row["target"]: row for row in rows(written, "validation")}
    (mixed,) = rows(written, "combinations")

    assert (cause["name"], cause["value"], cause["unit"]) == ("rail_roll", 2.1e-8, "rad/(N m)")
    assert cause["rivals"].endswith("(0.01)")
    assert [row["dz [mm]"] for row in found] == [d.dz_mm for d in answer.test_pose_deflection]
    assert [row["standard uncertainty y [mm]"] for row in found] == [9.4e-4] * 3
    assert found[0]["deflection [mm]"] == pytest.approx(0.42307, abs=1e-5)
    for target, value in answer.validation.global_.items():
        assert errors[target]["relative error in the workspace [1]"] == value
    for target, value in answer.validation.independent.test_pose.items():
        assert errors[target]["around the test pose, each stiffness by itself [1]"] == value
    assert (mixed["value"], mixed["compliances"]) == (8.5e-5, "c_theta2 + 0.580 c_theta4")


def test_every_residual_stands_there_in_millimetres(written, tables):
    """One row for each coordinate of each reading."""
    found, said = pd.DataFrame(rows(written, "residuals")), tables["residuals"]

    assert len(found) == len(said) > 100
    assert found["residual [mm]"].tolist() == pytest.approx((1e3 * said["residual_m"]).tolist())
    assert found["target"].tolist() == said["target"].tolist()
    assert found["pose"].tolist() == said["pose"].tolist()


def test_what_nobody_knows_is_an_empty_cell(answer, tables):
    """NaN is neither a number nor a text in a spreadsheet."""
    open_ = tables["residuals"].assign(left_out_m=float("nan"))
    made = workbook.files(answer, {"residuals": open_})

    assert {row["residual with the pose left out [mm]"] for row in rows(made, "residuals")} == {""}
    assert b"nan" not in made["csv/residuals.csv"].lower()


def test_without_tables_the_sheets_have_headings_only(answer):
    """Programs that read the tables always find the same sheets."""
    made = workbook.files(answer, {})

    assert rows(made, "residuals") == []
    assert made["csv/residuals.csv"].startswith(b'"pose","repeat","target"')


def test_the_csv_is_the_sheet(written):
    """The same headings and numbers, with comma and decimal point."""
    for name in SHEETS:
        text = written[f"csv/{name}.csv"].decode()
        plain = list(csv.DictReader(io.StringIO(text)))
        same = rows(written, name)
        assert len(plain) == len(same)
        for line, cells in zip(plain, same, strict=True):
            for title, cell in cells.items():
                if isinstance(cell, float):
                    assert float(line[title]) == pytest.approx(cell, rel=1e-15)
                else:
                    assert line[title].removeprefix("'") == cell


def test_no_cell_is_a_formula_or_a_link(written):
    """Names come from files; a spreadsheet that executes one would obey a stranger."""
    book = openpyxl.load_workbook(io.BytesIO(written["results.xlsx"]))
    cells = [cell for sheet in book for line in sheet.iter_rows() for cell in line]
    said = {cell.value for cell in cells}

    assert {cell.data_type for cell in cells} <= {"s", "n"}
    assert not any(cell.hyperlink for cell in cells)
    assert EVIL in said
    assert "-1+1 is no coordinate\\x1b" in said
    assert b"\"'=HYPERLINK" in written["csv/rejected.csv"]


def test_a_sheet_ends_where_excel_does(written, answer, tables, monkeypatch):
    """With more rows than Excel opens, the workbook has the first ones, the CSV all."""
    monkeypatch.setattr(workbook, "_MOST_ROWS", 5)
    made = workbook.files(answer, tables)

    assert len(rows(made, "residuals")) == 5
    assert made["csv/residuals.csv"] == written["csv/residuals.csv"]


def test_the_same_answer_gives_the_same_bytes(written, answer, tables):
    """The workbook contains no time of creation."""
    again = workbook.files(answer, tables)
    with zipfile.ZipFile(io.BytesIO(written["results.xlsx"])) as parts:
        times = {part.date_time[0] for part in parts.infolist()}
        core = parts.read("docProps/core.xml").decode()

    assert again == written
    assert times == {1980}
    assert core.count("1980-01-01T00:00:00Z") == 2


@pytest.mark.parametrize(
    "first", ["=", "+", "-", "@", " =", "\t=", "\u00a0=", "\u3000+", *"＝＋－＠"]
)
def test_no_name_is_a_formula(first):
    """Nor in the letters of full width that some spreadsheets take for the same."""
    (cell,) = harmless(pa.chunked_array([[f"{first}1+1"]])).to_pylist()

    assert cell == f"'{first}1+1"
