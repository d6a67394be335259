"""Every dialect reads its golden files to the last digit, or says why it cannot."""

import csv
import io
import itertools
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from pipeline import readers
from pipeline.base.errors import InputError
from pipeline.readers import Columns, ExportSettings, OutgoingReadings, Reader, catalogue, writers

READERS = catalogue()
WRITERS = writers()

GOLDEN = Path(__file__).parents[1] / "golden"
MM = ExportSettings(unit="mm")


def golden(name, hints=None):
    """Readings of a golden file."""
    return readers.read(name, (GOLDEN / name).read_bytes(), hints)


def names(export):
    """Group and target of every reading."""
    return list(zip(export.group.to_pylist(), export.target.to_pylist(), strict=True))


def times(export):
    """Times as text."""
    return [str(moment) for moment in export.time.to_pylist()]


FIRST = [4347.4342, 9629.5569, -1568.5193]
UNLOADED = [4685.0611, 5282.1400, -550.2172]
LOADED = [4683.9307, 5282.5332, -550.5429]
GROUPS = ["base_start", "pose01_rep0_unloaded", "pose01_rep1_loaded"]


# --- golden files ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path", sorted((GOLDEN / "emscon_vive").glob("*.csv")), ids=lambda p: p.stem
)
def test_real_emscon_dumps_are_read_to_the_last_digit(path):
    """Coordinates, both covariances and nothing else, of three files from the instrument."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    number = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name}
    mm2 = 1e-6

    export = readers.read(path.name, path.read_bytes(), MM)
    scatter = readers.read(
        path.name, path.read_bytes(), ExportSettings(unit="mm", covariance="standard")
    )

    assert (export.dialect, export.meaning.kind, export.rejected) == (
        "Leica emScon dump",
        "cartesian",
        (),
    )
    xyz = np.column_stack([number[f"dVal{k}"] for k in (1, 2, 3)])
    np.testing.assert_array_equal(export.position, xyz / 1000)
    assert (export.covariance_kind, scatter.covariance_kind) == ("a-priori", "standard")
    for got, start in ((export, "dApriori"), (scatter, "d")):
        var = [number[f"{start}Std{k}"] ** 2 for k in (1, 2, 3)]
        cov = [number[f"{start}Covar{k}"] for k in (12, 13, 23)]
        expected = np.column_stack([var[0], cov[0], cov[1], var[1], cov[2], var[2]]) * mm2
        np.testing.assert_allclose(got.covariance, expected, rtol=1e-14)
    assert export.order.tolist() == list(range(1, len(rows) + 1))
    assert export.group is None
    assert export.target is None


def test_spatial_analyzer_with_compound_names():
    """`Collection::Group::Target` below a header, with timestamps month first."""
    export = golden("sa_compound.txt")

    assert export.dialect == "SpatialAnalyzer ASCII"
    assert names(export) == list(zip(GROUPS, ["B1", "P1", "P1"], strict=True))
    assert export.position.tolist() == [
        [4347.43421 / 1000, 9629.55687 / 1000, -1568.51932 / 1000],
        [4685.06113 / 1000, 5282.14004 / 1000, -550.21722 / 1000],
        [4683.93070 / 1000, 5282.53321 / 1000, -550.54294 / 1000],
    ]
    assert times(export)[0] == "2026-11-03 08:00:08"
    assert export.line.tolist() == [6, 7, 8]


def test_spatial_analyzer_with_names_in_columns():
    """The fourth line of the real header names the columns; a target may be a bare number."""
    export = golden("sa_columns.txt")

    assert names(export) == list(zip(GROUPS, ["1", "P1", "P1"], strict=True))
    np.testing.assert_array_equal(
        export.position[0], np.array([171.1588, 379.1164, -61.7527]) * 0.0254
    )


def test_spatial_analyzer_without_header():
    """Group and target, no header: names keep blanks and brackets, the unit must be stated."""
    export = golden("sa_group_target.txt", ExportSettings(unit="m"))

    assert names(export)[:2] == [("base [north]", "B 1"), ("pose01_rep0_unloaded", "P1 (upper)")]
    assert export.position[1].tolist() == [4.68506113, 5.28214004, -0.55021722]
    with pytest.raises(InputError, match="does not say its unit of length; write unit = "):
        golden("sa_group_target.txt")


def test_spatial_analyzer_with_targets_only():
    """The fourth way of naming: groups must come from an assignment."""
    export = golden("sa_target_only.txt")

    assert export.group is None
    assert export.target.to_pylist() == ["B1", "P1", "P1"]


def test_spatial_analyzer_with_everything_appended():
    """Timestamp, uncertainties, weather and RMS: each according to its title."""
    export = golden("sa_everything.txt")

    assert times(export) == ["2025-02-12 16:38:29", "2025-02-12 16:41:07"]
    assert export.covariance_kind == "standard"
    np.testing.assert_allclose(
        export.covariance[0], [1.25e-5**2, 0, 0, 2.5e-5**2, 0, 5e-5**2], rtol=1e-14
    )
    assert export.unused == ("Temperature", "Pressure", "Humidity", "RMS")
    rms = golden("sa_everything.txt", ExportSettings(covariance="rms"))
    assert rms.covariance[1, [0, 3, 5]].sum() == pytest.approx(4.2e-6**2)


def test_expanded_uncertainties_are_divided_by_their_factor():
    """An export with two sigmas needs coverage_factor = 2."""
    once, twice = (
        golden("sa_everything.txt"),
        golden("sa_everything.txt", ExportSettings(coverage_factor=2)),
    )

    np.testing.assert_allclose(once.covariance, 4 * twice.covariance, rtol=1e-14)


def test_spherical_coordinates():
    """Range, azimuth from x towards y, angle from the zenith."""
    export = golden("sa_spherical.txt")

    h = np.sqrt(3) / 2
    expected = [[0, 5, 0], [2 * h * h, 2 * h / 2, -1], [-0.5, -0.5, np.sqrt(0.5)]]
    np.testing.assert_allclose(export.position, expected, atol=1e-15)
    assert (export.meaning.kind, export.meaning.vertical) == ("spherical", "zenith")


def test_cylindrical_coordinates():
    """Radius, azimuth, z, angles in radians."""
    export = golden("sa_cylindrical.txt")

    np.testing.assert_allclose(export.position, [[0, 5, -1.25], [np.sqrt(3), 1, 0.5]], atol=1e-15)


def test_t_mac_csv():
    """cp1252, decimal comma, apostrophe before the time, U(95) with k = 2, deleted rows."""
    export = golden("leica_6dof.csv")

    assert (export.dialect, export.encoding) == ("Leica 6DoF CSV", "cp1252")
    assert names(export) == [("Sockel Süd", "B1"), ("pose01_rep0_unloaded", "P1")]
    np.testing.assert_array_equal(export.position, np.array([FIRST, UNLOADED]) / 1000)
    assert times(export)[1] == "2026-11-03 08:00:48"
    assert export.covariance_kind == "expanded"
    np.testing.assert_allclose(
        export.covariance[0], [1.5e-5**2, 0, 0, 2.5e-5**2, 0, 2.05e-5**2], rtol=1e-14
    )
    assert [line for line, _ in export.rejected] == [5]
    assert "marked it as deleted" in export.rejected[0][1]


def test_tracker_pilot_csv():
    """Columns are found by their titles."""
    export = golden("tracker_pilot.csv")

    assert export.dialect == "Leica Tracker Pilot CSV"
    assert names(export) == [("base_start", "B1"), ("pose01_rep0_unloaded", "P1")]
    np.testing.assert_array_equal(export.position, np.array([FIRST, UNLOADED]) / 1000)
    assert times(export) == ["2026-11-03 08:00:08", "2026-11-03 08:00:48"]


def test_semicolon_xyz():
    """No header, decimal comma."""
    export = golden("semicolon.xyz", MM)

    assert export.dialect == "semicolon xyz"
    assert names(export) == list(zip(GROUPS, ["B1", "P1", "P1"], strict=True))
    np.testing.assert_array_equal(export.position, np.array([FIRST, UNLOADED, LOADED]) / 1000)


LEFT = "counter-clockwise"
MAPPING = Columns(
    columns={
        "group": "Serie",
        "target": 3,
        "azimuth": "Hz",
        "vertical": "V",
        "range": "D",
        "time": 2,
    },
    comment="#",
    time_format="%Y/%m/%d %H.%M.%S",
)


@pytest.mark.parametrize(
    ("said", "side"), [({}, -1), ({"horizontal": "clockwise"}, -1), ({"horizontal": LEFT}, 1)]
)
def test_any_table_by_its_mapping(said, side):
    """Columns by name or number, gons, decimal comma, own time format; Hz is clockwise."""
    hints = ExportSettings(unit="mm", angle="gon", vertical="zenith", mapping=MAPPING, **said)
    export = golden("odd_table.txt", hints)

    assert names(export) == list(zip(GROUPS[:2], ["B1", "P1"], strict=True))
    places = [[0, 5 * side, 0], [1, side, -np.sqrt(2)]]
    np.testing.assert_allclose(export.position, places, atol=1e-15)
    assert times(export) == ["2026-11-03 08:00:08", "2026-11-03 08:00:48"]


@pytest.mark.parametrize(
    "titles",
    [
        "X [mm];U(95) [mm];Y [mm];U(95) [mm];Z [mm];U(95) [mm]",
        "X (mm);U(95) X (µm);Y (mm);U(95) Y (µm);Z (mm);U(95) Z (µm)",
        "X mm;UX(95) mm;Y mm;UY(95) mm;Z mm;UZ(95) mm",
        "x_mm;std_x_um;y_mm;std_y_um;z_mm;std_z_um",
    ],
)
def test_uncertainties_are_found_by_their_titles(titles):
    """After their axis or by its name, in the unit of the coordinates or in micrometres."""
    factor = 1000 if "µm" in titles or "um" in titles else 1
    u = [f"{value * factor:g}" for value in (0.02, 0.04, 0.06)]
    text = f"Group;Name;{titles}\ng;P1;1;{u[0]};2;{u[1]};3;{u[2]}\n"
    export = readers.read("t", text.encode())

    k = 1 if "std" in titles else 2
    assert export.position.tolist() == [[0.001, 0.002, 0.003]]
    expected = [(value * 1e-3 / k) ** 2 for value in (0.02, 0.04, 0.06)]
    np.testing.assert_allclose(export.covariance[0][[0, 3, 5]], expected, rtol=1e-12)


def test_dates_and_times_of_day_in_two_columns():
    """Combined to a time; a row that lacks one of them is rejected, one that lacks both is kept."""
    head = "Name;Date;Time;X [mm];Y [mm];Z [mm]"
    rows = ["P1;03.11.2026;'08:00:08", "P2;03.11.2026;", "P3;;", "P4;03.11.2026;08:00:60"]
    export = readers.read("t", "\n".join([head, *(f"{row};1;2;3" for row in rows)]).encode())

    assert export.target.to_pylist() == ["P1", "P3"]
    assert times(export) == ["2026-11-03 08:00:08", "None"]
    assert [line for line, _ in export.rejected] == [3, 5]


def test_tables_with_runs_of_blanks():
    """Delimiter = " " treats any number of blanks as one."""
    text = "  P1   1.5  -2.5\t3.5  \n P2 4 5  6\n"
    hints = ExportSettings(
        unit="mm", mapping=Columns(columns={"target": 1, "x": 2, "y": 3, "z": 4}, delimiter=" ")
    )
    export = readers.read("t", text.encode(), hints)

    assert export.target.to_pylist() == ["P1", "P2"]
    np.testing.assert_array_equal(
        export.position, [[0.0015, -0.0025, 0.0035], [0.004, 0.005, 0.006]]
    )


# --- ambiguity leads to a question ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "hints", "asked"),
    [
        ("emscon_vive/20200710_Exp1_laserData.csv", ExportSettings(), 'write unit = "mm"'),
        ("semicolon.xyz", ExportSettings(), 'write unit = "mm"'),
        ("sa_compound.txt", ExportSettings(unit="m"), "says mm .* says m; remove unit"),
        ("sa_everything.txt", ExportSettings(covariance="a-priori"), "has no a-priori covariance"),
        (
            "odd_table.txt",
            ExportSettings(),
            'odd_table.txt:2: .* unit of length; write unit = "mm"',
        ),
        ("odd_table.txt", MM, 'odd_table.txt:2: .* unit of angles; write angle = "gon"'),
        ("odd_table.txt", ExportSettings(unit="mm", mapping=MAPPING), 'write angle = "deg"'),
        (
            "odd_table.txt",
            ExportSettings(
                unit="mm",
                angle="gon",
                mapping=Columns(columns={"x": "Nr", "y": 9, "z": 7}, comment="#"),
            ),
            "no column 9",
        ),
        (
            "odd_table.txt",
            ExportSettings(
                unit="mm", mapping=Columns(columns={"x": "Nr", "y": "XX", "z": 7}, comment="#")
            ),
            'no column "XX"',
        ),
    ],
)
def test_what_is_not_said_is_asked(name, hints, asked):
    """Unit, angle, columns: an error that says what to write, never a guess."""
    with pytest.raises(InputError, match=asked):
        golden(name, hints)


def test_vertical_angles_that_may_be_either_are_asked():
    """Between 0 and 90 degrees zenith angles and elevations cannot be distinguished."""
    text = (GOLDEN / "sa_spherical.txt").read_text("utf-8").replace("120.0", "20.0")
    with pytest.raises(InputError, match='write vertical = "zenith"'):
        readers.read("s.txt", text.encode())

    said = [
        readers.read("s.txt", text.encode(), ExportSettings(vertical=way)).position[:, 2]
        for way in ("zenith", "elevation")
    ]
    assert said[0][2] == pytest.approx(np.sqrt(0.5))
    assert said[1][0] == pytest.approx(5)


def test_thousands_or_decimals_is_asked():
    """`1,234` in every number may be 1.234 or 1234."""
    text = "a;P1;1,234;2,345;3,456\nb;P1;1,235;2,346;3,457\n"
    with pytest.raises(
        InputError, match=r'^t.xyz:1: "1,234" may be 1.234 or 1234; say which .* decimal'
    ):
        readers.read("t.xyz", text.encode(), MM)

    comma = readers.read("t.xyz", text.encode(), ExportSettings(unit="mm", decimal=","))
    assert comma.position[0].tolist() == [1.234 / 1000, 2.345 / 1000, 3.456 / 1000]
    one_settles = readers.read("t.xyz", text.replace("3,457", "3,45").encode(), MM)
    assert one_settles.position[0].tolist() == [1.234 / 1000, 2.345 / 1000, 3.456 / 1000]


def test_points_among_decimal_commas_are_left_out():
    """`12.5` is not a number in a file of decimal commas; `1.234,5` has a thousands separator."""
    text = "a;P1;1,25;2,5;3,5\nb;P1;1.234,5;2,5;3,5\nc;P1;12.5;2,5;3,5\n"
    export = readers.read("t.xyz", text.encode(), MM)

    assert export.line.tolist() == [1, 2]
    assert export.position[1, 0] == 1.2345
    assert [line for line, _ in export.rejected] == [3]


def test_a_file_of_two_dialects_is_asked():
    """Two readers that recognise a file are an error that names both."""
    twin = READERS["plain"]
    fake = type(twin)("twin", twin.recognise, twin.read)
    READERS["twin"] = fake
    try:
        with pytest.raises(InputError, match="may be plain CSV, twin; describe its columns"):
            readers.read("t.csv", b"group,target,x_mm,y_mm,z_mm\na,b,1,2,3\n")
    finally:
        del READERS["twin"]


def test_a_dialect_with_a_mark_of_its_own_comes_before_tracker_pilot(monkeypatch):
    """Titles that also fit Tracker Pilot do not make its file ambiguous."""
    pilot = READERS["tracker_pilot"]
    marked = Reader("marked", lambda lines: lines[0].startswith("#MARK"), pilot.read)
    monkeypatch.setitem(READERS, "marked", marked)
    text = readers.text("t", b"#MARK\nPoint Group;Point Name;X [mm];Y [mm];Z [mm]\na;P1;1;2;3\n")

    assert pilot.recognise(text.sample())
    assert readers.recognise(text) is marked


def test_golden_files_are_recognised_by_one_reader_only():
    """No golden file fits two dialects."""
    for path in sorted(GOLDEN.rglob("*.*")):
        if path.suffix in (".csv", ".xyz", ".txt") and "odd" not in path.name:  # for a mapping
            assert readers.recognise(readers.text(path.name, path.read_bytes())) in READERS.values()


# --- round trips ----------------------------------------------------------------------------------


def some_readings(unit, decimals, seed=20261103):
    """Readings as an instrument states them: numbers with few decimals in its unit."""
    rng = np.random.default_rng(seed)
    scale = 1000.0 if unit == "mm" else 1.0
    numbers = np.round(rng.uniform(-20, 20, (200, 3)) * scale, decimals)
    group = [
        f"pose{k // 10:02d}_rep{k % 2}_{'loaded' if k % 2 else 'unloaded'}" for k in range(200)
    ]
    start = datetime(2026, 11, 3, 8)
    six = np.tile([4e-10, 0.0, 0.0, 9e-10, 0.0, 1e-10], (200, 1))
    return OutgoingReadings(
        group=group,
        target=[f"P{k % 7}" for k in range(200)],
        position=numbers / scale,
        time=[start.replace(minute=k % 60, second=k % 59) for k in range(200)],
        covariance=six,
    )


@pytest.mark.sampled(6)
@pytest.mark.parametrize("unit", ["mm", "m"])
@pytest.mark.parametrize("name", WRITERS)
def test_written_readings_come_back_exactly(name, unit):
    """Write -> read gives the same names, the same bits of coordinates, and the same times."""
    reader = READERS[name]
    readings = some_readings(unit, 4 if unit == "mm" else 7)
    hints = ExportSettings(unit=None if reader.says_unit else unit)
    for digits in (4 if unit == "mm" else 7, None):
        export = readers.read("t", reader.write(readings, unit, digits), hints)

        assert export.dialect == reader.name
        np.testing.assert_array_equal(export.position, readings.position)
        if reader.says_names:
            assert names(export) == list(zip(readings.group, readings.target, strict=True))
        if export.time.null_count == 0:
            assert export.time.to_pylist() == readings.time
        if export.covariance is not None:
            np.testing.assert_allclose(
                export.covariance, readings.covariance, rtol=1e-12, atol=1e-25
            )


def test_in_metres_any_coordinate_comes_back_exactly():
    """Written in metres with all digits, any coordinate keeps every bit."""
    readings = some_readings("m", 17)
    for reader in WRITERS.values():
        hints = ExportSettings(unit=None if reader.says_unit else "m")
        export = readers.read("t", reader.write(readings, "m", None), hints)
        np.testing.assert_array_equal(export.position, readings.position)


# --- what must not be lost silently ---------------------------------------------------------------

PLAIN = "group,target,x_mm,y_mm,z_mm,time\na,P1,1,2,3,2026-11-03T08:00:00\n"


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        (PLAIN.replace("y_mm", "x_mm"), r"t:1: .*no column y_mm|both look like"),
        (
            PLAIN.replace("z_mm,time", "z_mm,z_m").replace("2026-11-03T08:00:00", "3"),
            "both look like the z",
        ),
        (
            PLAIN.replace("time", "tine"),
            't:1: column "tine" is not known, but looks like "time"; correct',
        ),
        (
            PLAIN.replace("time", "when"),
            't:1: column "when" contains times, but is not called time; call it',
        ),
        (PLAIN.replace("time", "std_x_mm"), "t:1: the uncertainties lack std y, std z; correct"),
        (PLAIN.replace("target", "tarhet"), "t:1: there is no column target; add it"),
    ],
    ids=["twice", "two units", "misspelt", "renamed", "partly", "target"],
)
def test_columns_that_would_be_lost_are_asked_about(text, asked):
    """A misspelt title must not silently lose the times or the uncertainties."""
    with pytest.raises(InputError, match=asked):
        readers.read("t", text.encode())


@pytest.mark.parametrize("cell", ["2026-11-03", "2026-11-03T08", "08:00:00", "2026-11-03T08:00:0"])
def test_half_a_time_is_no_time(cell):
    """A date or an hour alone: the row is damaged."""
    text = PLAIN + "a,P2,1,2,3,2026-11-03T08:00:48\n"
    export = readers.read("t", text.replace("2026-11-03T08:00:00", cell).encode())

    assert export.line.tolist() == [3]


def test_times_with_a_zone_become_utc():
    """09:00 in Paris in winter is 08:00 UTC; a file with both kinds of times is refused."""
    zoned = PLAIN.replace("T08:00:00", "T09:00:00+01:00")
    assert times(readers.read("t", zoned.encode())) == ["2026-11-03 08:00:00"]
    assert times(readers.read("t", PLAIN.replace(":00\n", ":00Z\n").encode())) == [
        "2026-11-03 08:00:00"
    ]
    with pytest.raises(InputError, match="some times have a zone and some have none"):
        readers.read("t", (zoned + "a,P2,1,2,3,2026-11-03T08:00:00\n").encode())


def test_times_under_a_misspelt_title_are_times():
    """SpatialAnalyzer's columns are known by position; a time is recognised by its format."""
    text = (GOLDEN / "sa_compound.txt").read_text().replace("Timestamp", "Tmsp")

    assert times(readers.read("t", text.encode())) == times(golden("sa_compound.txt"))


def test_spatial_analyzer_with_times_of_another_form():
    """ISO times on the full hour after joined names."""
    text = (
        (GOLDEN / "sa_compound.txt").read_text().replace("11/03/26 08:00:08", "11/03/26 08:00:00")
    )
    text = text.replace(" 11/03/26 ", "2026-11-03T")

    assert times(readers.read("t", text.encode()))[0] == "2026-11-03 08:00:00"


def test_half_a_second_of_a_time_is_refused():
    """`08:00:0` has lost a digit."""
    data = (GOLDEN / "sa_compound.txt").read_bytes().replace(b"08:00:08", b"08:00:0")
    export = readers.read("t", data)

    assert export.line.tolist() == [7, 8]


def test_names_of_which_only_some_hold_a_group_are_not_cut():
    """A single name with `::` among others without is a name."""
    text = "Name;X [mm];Y [mm];Z [mm]\na::P1;1;2;3\nP2;1;2;3\n"
    export = readers.read("t", text.encode())

    assert export.group is None
    assert export.target.to_pylist() == ["a::P1", "P2"]


def test_bytes_that_windows_does_not_know_are_latin_1():
    """Five bytes are undefined in cp1252; the file is read as latin-1, which is reported."""
    export = readers.read("t", PLAIN.replace("a,", "a\x81,").encode("latin-1"))

    assert (export.encoding, export.group.to_pylist()) == ("latin-1", ["a\x81"])


def test_japanese_windows_is_read_where_western_windows_cannot_be():
    """Letters with a byte that means nothing in cp1252; as UTF-8 the groups are the same."""
    text = PLAIN.replace("a,", "姿勢3-無負荷,")
    export, same = (readers.read("t", text.encode(code)) for code in ("cp932", "utf-8"))

    assert (export.encoding, same.encoding) == ("cp932", "utf-8")
    assert export.group.to_pylist() == same.group.to_pylist() == ["姿勢3-無負荷"]


def test_rows_above_the_header_are_not_lost():
    """A data row above the header of a damaged export is listed."""
    text = "g;P9;1;2;3\nGroup;Name;X [mm];Y [mm];Z [mm]\ng;P1;1;2;3\n"
    export = readers.read("t", text.encode())

    assert export.line.tolist() == [3]
    assert export.rejected[0][0] == 1


def test_an_emscon_dump_with_a_missing_column_is_refused():
    """Without one of the a-priori columns the other covariance would silently be used."""
    text = (GOLDEN / "emscon_vive" / "20200710_Exp1_laserData.csv").read_text()
    with pytest.raises(InputError, match="not those of SingleMeasResultT or 2T"):
        readers.read("t", text.replace("dAprioriStd1", "", 1).encode(), MM)
    with pytest.raises(InputError, match=r"\(dAprioriStt1\)"):
        readers.read("t", text.replace("dAprioriStd1", "dAprioriStt1", 1).encode(), MM)


def test_emscon_coordinates_that_are_no_lengths_are_asked():
    """If dStdTotal is not the root sum of squares, the coordinates may be angles."""
    readings = some_readings("mm", 4)
    dump = READERS["emscon"].write(readings, "mm", 4).decode().splitlines()
    cells = dump[1].split(",")
    cells[6] = "0.5"
    dump[1] = ",".join(cells)
    with pytest.raises(InputError, match="does not say its coordinate system; write coordinates"):
        readers.read("t", "\n".join(dump).encode(), MM)


@pytest.mark.parametrize("horizontal", ["clockwise", LEFT])
@pytest.mark.parametrize("vertical", ["zenith", "elevation"])
@pytest.mark.parametrize("kind", ["spherical", "cylindrical"])
def test_covariances_of_angles_become_those_of_coordinates(kind, vertical, horizontal):
    """C = J C J', with J by differences of the reader's own conversion."""
    columns = {"range": 1, "azimuth": 2, ("vertical" if kind == "spherical" else "z"): 3}
    columns |= {"group": 10, "target": 11} | {
        f"c{ab}": k for k, ab in enumerate(("xx", "xy", "xz", "yy", "yz", "zz"), 4)
    }
    mapping = Columns(columns=columns, header=0)
    said = {"angle": "deg", "vertical": vertical, "horizontal": horizontal}
    hints = ExportSettings(unit="mm", mapping=mapping, **said)
    six = [4e-4, 1e-6, -2e-6, 9e-8, 1e-8, 6e-8]

    def at(values):
        row = ";".join(repr(float(value)) for value in [*values, *six]) + ";g;P1"
        return readers.read("t", row.encode(), hints)

    start, step = np.array([3000.0, 40.0, 70.0]), np.array([0.1, 1e-3, 1e-3])
    pairs = [(at(start + d), at(start - d)) for d in np.diag(step)]
    J = np.array([(a.position[0] - b.position[0]) for a, b in pairs]).T / (2 * step)
    C = np.array(six)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]

    got = at(start).covariance[0][[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    np.testing.assert_allclose(got, J @ C @ J.T, rtol=1e-6, atol=1e-20)


@pytest.mark.parametrize("size", range(1, 6))
def test_lines_are_cut_as_everywhere_else(size):
    """A line feed, a carriage return or both end a line, also if the last line has no end."""
    for letters in itertools.product("a\r\n", repeat=size):
        said = "".join(letters) + "b"
        file = readers.text("x", said.encode())

        assert [line for _, line in file.lines()] == io.StringIO(said, newline=None).read().split(
            "\n"
        )


@pytest.mark.parametrize(
    ("wrong", "odd"),
    [((3, -1.0), "variance"), ((0, -4e-4), "variance"), ((1, 9e-3), "correlation")],
)
def test_an_uncertainty_that_is_none_costs_its_row(wrong, odd):
    """A negative variance, a correlation above one: named, and never squared away."""
    columns = {"x": 1, "y": 2, "z": 3, "group": 10, "target": 11}
    columns |= {f"c{ab}": k for k, ab in enumerate(("xx", "xy", "xz", "yy", "yz", "zz"), 4)}
    hints = ExportSettings(unit="mm", mapping=Columns(columns=columns, header=0))
    good = [4e-4, 1e-4, 0.0, 4e-4, 0.0, 4e-4]
    place, value = wrong
    bad = [value if k == place else number for k, number in enumerate(good)]
    rows = "\n".join(f"1;2;3;{';'.join(map(repr, six))};g;P1" for six in (good, bad))
    export = readers.read("t", rows.encode(), hints)

    assert export.line.tolist() == [1]
    [(line, why)] = export.rejected
    assert line == 2
    assert odd in why


def test_a_negative_standard_uncertainty_is_none():
    """U(95) of -0.06 mm is not 0.06 mm."""
    readings = some_readings("mm", 4)
    export = READERS["leica_6dof"].write(readings, "mm", 4).decode("cp1252").splitlines()
    cells = export[1].split(";")
    cells[9] = f"-{cells[9]}"
    export[1] = ";".join(cells)
    got = readers.read("t", "\r\n".join(export).encode("cp1252"), MM)

    assert [line for line, _ in got.rejected] == [2]


@pytest.mark.parametrize("year", ["0000", "0001", "1899", "2200", "9999"])
def test_a_time_at_which_nobody_measured_costs_its_row(year):
    """Arrow accepts the year 0, later calendars do not."""
    good = "group,target,x_mm,y_mm,z_mm,time\ng,P1,1,2,3,2026-11-03T08:00:00\n"
    odd = f"g,P2,1,2,3,{year}-11-03T08:00:00\n"
    for text, rejected in ((good + odd, [3]), (good + odd.replace("T", " "), [3]), (good, [])):
        export = readers.read("t", text.encode(), MM)

        assert [line for line, _ in export.rejected] == rejected


@pytest.mark.parametrize("x", ["X", "X [m]", "x"])
def test_a_title_may_be_stated_without_its_unit(x):
    """Its unit is read all the same; a title that is written out goes first."""
    columns = {"group": "Serie", "target": "Punkt", "x": x, "y": "Y", "z": "Z"}
    row = "Serie;Punkt;X [m];Y [m];Z [m]\ng;P1;1.5;-2.5;0.25\n"

    got = readers.read("t", row.encode(), ExportSettings(mapping=Columns(columns=columns)))

    np.testing.assert_allclose(got.position, [[1.5, -2.5, 0.25]])


def test_a_title_that_two_columns_share_is_asked():
    """In millimetres and in inches: nobody says which."""
    columns = {"group": "g", "target": "P", "x": "X", "y": "Y", "z": "Z"}
    row = b"g;P;X [mm];X [in];Y [mm];Z [mm]\ng;P1;1;2;3;4\n"

    with pytest.raises(InputError, match='there are 2 columns "X" for x'):
        readers.read("t", row, ExportSettings(mapping=Columns(columns=columns)))
