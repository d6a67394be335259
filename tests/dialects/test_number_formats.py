"""Numbers of a workbook are read as their format shows them, or refused."""

import io

import openpyxl
import pytest

from pipeline import readers
from pipeline.base.errors import InputError
from pipeline.dialects import workbook
from pipeline.dialects._number_formats import POINT, shown
from pipeline.readers import ExportSettings, logs


def formatted(rows, code, column=2, lines=None):
    """A workbook in which a column, or some of its lines, has a number format."""
    book = openpyxl.Workbook()
    page = book.active
    for row in rows:
        page.append(row)
    for line in lines or range(2, len(rows) + 1):
        page.cell(line, column + 1).number_format = code
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


FORCES = [["pose", "repeat", "force_n"], [1, 1, 702.5], [1, 2, 1402.5], [2, 1, 712.5]]
PLACES = [["group", "target", "x_mm", "y_mm", "z_mm"],
          *([f"g{k}", "P1", 1200.5 + k, 2345.25, 345.125] for k in range(5))]  # fmt: skip
ANGLES = [["group", "target", "Hz [deg]", "V [deg]", "D [m]"],
          *([f"g{k}", "P1", 123456, 93.25, 3.125] for k in range(5))]  # fmt: skip


@pytest.mark.parametrize(
    ("code", "number", "seen"),
    [
        ("0%", "0.5", "50%"),
        ('0.0" mm"', "765.3004", "765.3004 mm"),
        ('0.0," kN"', "1402.5", "1.4025 kN"),
        ("0.0,", "1402.5", "1402.5 in the number format 0.0,"),
        ('0.0,," M"', "1402.5", '1402.5 in the number format 0.0,," M"'),
        ("0.0;0.0", "-5", "-5 in the number format 0.0;0.0"),
        ("0.0;[Red]0.0", "-5", "-5"),
        ("#,##0_);(#,##0)", "-5", "-5"),
        ('_-* #,##0.00_-;-* #,##0.00_-;_-* "-"??_-', "0", "0"),
        ("# ##0.00", "1402.5", "1402.5"),
        ("0;-0;;@", "0", "0"),
        ('"P"00', "7", "P07"),
        ('0"°"00"\'"00', "123456", "12°34'56"),
        ("00 00 00", "123456", "12 34 56"),
        ('0.00"\'"00', "12.5", '12.5 in the number format 0.00"\'"00'),
        ('[<1]0.0" mm";0.0" m"', "0.5", "0.5 mm"),
        ('[<1]0.0" mm";0.0" m"', "2", "2 m"),
        ("# ?/8", "0.5", "0.5"),
        ('0.0E+00" N"', "1402.5", "1402.5 N"),
        ("aaa", "3", "3 in the number format aaa"),
        ('"yes";"no"', "-1", "no"),
    ],
)
def test_a_number_is_what_its_format_shows(code, number, seen):
    """To its last digit; where nothing tells what is meant, the text says so."""
    assert shown(number, code).replace(POINT, ".") == seen


@pytest.mark.parametrize(
    ("code", "forces"),
    [
        ('0.0" N"', [702.5, 1402.5, 712.5]),
        ('0.000," kN"', [702.5, 1402.5, 712.5]),
        ('0.0" kN"', [702.5e3, 1402.5e3, 712.5e3]),
        ("#,##0.00", [702.5, 1402.5, 712.5]),
    ],
)
@pytest.mark.parametrize("piece", [1 << 20, 40])
def test_a_force_has_the_unit_that_its_cell_shows(code, forces, piece, monkeypatch):
    """As if it were typed; a format without words changes nothing."""
    monkeypatch.setattr("pipeline.dialects.workbook._PIECE", piece)
    log = logs.loads("l.xlsx", formatted(FORCES, code))

    assert log.number["force"].tolist() == pytest.approx(forces)
    assert not log.rejected


@pytest.mark.parametrize(
    ("code", "why"),
    [
        ("0%", 'force_n is "140250%", not a number'),
        ("0.0,", 'force_n is "1402.5 in the number format 0.0,", which shows another number; '
                 "choose a format that shows the one that is meant"),
        ("[h]:mm", 'force_n is "33660:00:00", not a number'),
        ('0.0" mm"', 'force_n is "1402.5 mm", a number with its unit'),
    ],
)  # fmt: skip
def test_a_cell_that_shows_no_force_is_refused(code, why):
    """With its line, column and what it shows; the others are read."""
    log = logs.loads("l.xlsx", formatted(FORCES, code, lines=[3]))

    assert log.number["force"].tolist() == [702.5, 712.5]
    ((file, line, reason),) = log.rejected
    assert (file, line) == ("l.xlsx", 3)
    assert reason.startswith(why)


def test_a_length_is_in_the_unit_of_its_title_or_refused():
    """Millimetres under x_mm are read, metres are refused with their line."""
    mm, m = (readers.read("t.xlsx", formatted(PLACES, f'0.0" {unit}"')) for unit in ("mm", "m"))

    assert mm.position[:, 0].tolist() == pytest.approx([1.2005, 1.2015, 1.2025, 1.2035, 1.2045])
    assert m.rejected[0][0] == 2
    assert 'x_mm is "1200.5 m", a number with its unit' in m.rejected[0][1]


def test_an_angle_that_is_shown_in_minutes_is_read_so():
    """123456 that is shown as 12°34'56" is 12.58 degrees; as a length it is refused."""
    data = formatted(ANGLES, '0"°"00"\'"00"\'\'"')
    hints = ExportSettings(horizontal="clockwise")
    plain = [[*row[:2], 12 + 34 / 60 + 56 / 3600, *row[3:]] for row in ANGLES[1:]]
    same = readers.read("t.xlsx", formatted([ANGLES[0], *plain], "General"), hints)

    assert readers.read("t.xlsx", data, hints).position == pytest.approx(same.position)
    far = readers.read("t.xlsx", formatted(ANGLES, '0"°"00"\'"00"\'\'"', column=4), hints)
    assert not len(far.line)
    assert "not a number" in far.rejected[0][1]


def test_the_decimal_mark_of_the_file_is_that_of_formatted_numbers():
    """A column of text with decimal commas does not make 702.5 N another number."""
    rows = [[*row, text] for row, text in zip(FORCES, ["mass_kg", "", "", ""], strict=True)]
    rows += [[3, 1, None, "12,5"]]
    log = logs.loads("l.xlsx", formatted(rows, '0.0" N"', lines=[2, 3, 4]))

    assert log.number["force"][:3].tolist() == [702.5, 1402.5, 712.5]
    assert log.number["mass"][3] == 12.5


def test_styles_without_end_are_refused(monkeypatch):
    """Before they are searched."""
    monkeypatch.setattr(workbook, "_MOST_STYLES", 100)
    with pytest.raises(InputError, match=r"styles of the workbook has .*save the sheet as CSV"):
        logs.loads("l.xlsx", formatted(FORCES, "0%"))
