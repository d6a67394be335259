"""Degrees, minutes and seconds: read in a column of angles, refused in any other."""

import numpy as np
import pytest

from pipeline import readers
from pipeline.base.errors import InputError
from pipeline.dialects._cells import bare_number, is_turn
from pipeline.machine.robot import load
from pipeline.readers import ExportSettings, logs

FORMS = ["12°34'56\"", "12 34 56", "12d34m56s", "12° 34' 56\"", "12º34’56”", "12-34-56.0",
         "12°34'56''", "12°34.9333333333333'"]  # fmt: skip
TURN = 12 + 34 / 60 + 56 / 3600
SIGHT = ExportSettings(horizontal="clockwise", vertical="zenith")


def quoted(cell):
    return '"' + cell.replace('"', '""') + '"' if '"' in cell else cell


def polar(cell, place, delimiter=";", unit="deg"):
    """A table of ranges and angles in which one of each row is written so."""
    rows = [["group", "target", f"Hz [{unit}]", f"V [{unit}]", "D [m]"]]
    for k in range(5):
        row = [f"g{k}", "P1", "12.5", "93.25", "3.125"]
        row[place] = quoted(cell)
        rows.append(row)
    return "\n".join(delimiter.join(row) for row in rows).encode() + b"\n"


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("sign", ["", "-", "−"])
def test_it_is_a_number_of_degrees(form, sign):
    """With either sign, also at zero degrees."""
    assert is_turn(sign + form)
    assert float(bare_number(sign + form)) == pytest.approx(-TURN if sign else TURN, abs=1e-11)
    assert float(bare_number("-0°30'00\"")) == -0.5
    assert float(bare_number("12d34m")) == pytest.approx(12 + 34 / 60)


@pytest.mark.parametrize("form", ["12°75'00\"", "12 34.5", "12:34:56", "2026 11 28", "12-34-56"])
def test_what_may_be_something_else_is_no_angle(form):
    """Minutes beyond 59, two parts alone, times of day and dates."""
    assert not is_turn(form)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("delimiter", [";", "\t", ",", "|"])
def test_an_angle_is_read_and_a_range_is_refused(form, delimiter):
    """Whatever separates the cells; a range in degrees is refused with its line or as a whole."""
    same = readers.read("t", polar(f"{TURN:.12f}", 2, delimiter), SIGHT)
    found = readers.read("t", polar(form, 2, delimiter), SIGHT)

    assert found.position == pytest.approx(same.position, abs=1e-9)
    try:
        far = readers.read("t", polar(form, 4, delimiter), SIGHT)
    except InputError:
        return
    assert not len(far.line)
    assert far.rejected[0][0] == 2


@pytest.mark.parametrize("delimiter", ["\t", "  ", " "])
@pytest.mark.parametrize("form", ["12 34 56", "12 34.5"])
@pytest.mark.parametrize("place", [2, 3, 4])
def test_parts_of_a_cell_are_no_cells(form, delimiter, place):
    """A row is not cut at the blanks in it, its first part taken and the others dropped."""
    try:
        found = readers.read("t", polar(form, place, delimiter), SIGHT)
    except InputError:
        return
    if place == 4:
        assert not len(found.line)
        return
    same = readers.read("t", polar(f"{TURN:.12f}", place), SIGHT)
    assert found.position == pytest.approx(same.position)


@pytest.mark.parametrize("unit", ["gon", "rad", "dms"])
def test_degrees_in_a_column_of_another_unit_are_asked(unit):
    """Not taken for gons, radians or packed degrees."""
    with pytest.raises(InputError, match=r"several units of angles"):
        readers.read("t", polar("12°34'56\"", 2, unit=unit), SIGHT)


@pytest.mark.parametrize("head", ["Spherical, Units: Meters, Degrees, zenith", "Cartesian, Meters"])
def test_spatial_analyzer_writes_angles_so(head):
    """A coordinate of a Cartesian export is refused with its line, an angle of a spherical read."""
    lines = ["// SpatialAnalyzer ASCII point export", f"// {head}"]
    of = {cell: "\n".join([*lines, *(f"A::g{k}::P1, 3.125, {cell}, 93.25" for k in range(5))])
          for cell in (quoted("12°34'56\""), f"{TURN:.12f}")}  # fmt: skip
    found, same = (readers.read("t", (one + "\n").encode()) for one in of.values())

    if "Cartesian" in head:
        assert not len(found.line)
        assert found.rejected[0][0] == 3
        assert '12°34\'56"", not a number' in found.rejected[0][1]
    else:
        assert found.position == pytest.approx(same.position, abs=1e-9)


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_a_joint_is_in_degrees_whatever_its_column(unit):
    """In a column of radians, too: the sign tells the unit."""
    robot = load("ur10")
    head = ",".join(["pose", *(f"{joint.name}_{unit}" for joint in robot.joints)])
    rows = [f"{k},{quoted(FORMS[0])},0.25,0.5,0.75,1,1.25" for k in range(1, 4)]
    log = logs.joints("j.csv", "\n".join([head, *rows, ""]).encode(), robot)

    assert log.number["theta1"] == pytest.approx(np.full(3, np.deg2rad(TURN)))
