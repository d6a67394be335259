"""One campaign in the formats of many programs: read to a micrometre, or asked, or refused."""

import numpy as np
import pytest
from campaign_exports import POINTS, dms, german, polar, table, workbook, xyz

from pipeline import readers
from pipeline.base.errors import InputError
from pipeline.intake import describe_file
from pipeline.readers import ExportSettings

PLACES = np.array([place for _, _, place in POINTS])
NAMES = [(group, target) for group, target, _ in POINTS]
HEAD = "Group;Point;X [mm];Y [mm];Z [mm]"
POLAR = "Group;Point;Hz;V;D [m]"
CSV = "group,target,x_mm,y_mm,z_mm"
GERMAN = "Gruppe;Punkt;X [mm];Y [mm];Z [mm]"


def names(export):
    """Group and target of every reading."""
    group = export.group.to_pylist() if export.group is not None else [None] * len(export.line)
    return list(zip(group, export.target.to_pylist(), strict=True))


def spaced(gap):
    """Numbers with a gap between thousands."""
    return table(";", GERMAN, lambda k, g, t, p: [g, t, *german(xyz(p), gap)])


def angled(form):
    """Angles in degrees, minutes and seconds, distances in metres."""
    return table(
        ";",
        POLAR,
        lambda k, g, t, p: [g, t, *(dms(a, form) for a in polar(p)[1:]), f"{polar(p)[0]:.7f}"],
    )


READ = {
    "points between thousands": spaced("."),
    "blanks between thousands": spaced(" "),
    "blanks that do not break": spaced("\u00a0"),
    "narrow blanks": spaced("\u202f"),
    "commas in quotes": table(
        ",", "Group,Point,X (mm),Y (mm),Z (mm)",
        lambda k, g, t, p: [g, t, *(f'"{float(cell):,.4f}"' for cell in xyz(p))],
    ),
    "apostrophes": table(
        ";", HEAD,
        lambda k, g, t, p: [g, t, *(f"{float(c):,.4f}".replace(",", "'") for c in xyz(p))],
    ),
    "typographer's minus": table(
        ";", HEAD, lambda k, g, t, p: [g, t, *(c.replace("-", "\u2212") for c in xyz(p))]
    ),
    "Fortran": table(
        ";", "Group;Point;X [m];Y [m];Z [m]",
        lambda k, g, t, p: [g, t, *(f"{v:.9E}".replace("E", "D") for v in p)],
    ),
    "feet": table(
        ";", "Group;Point;X [ft];Y [ft];Z [ft]", lambda k, g, t, p: [g, t, *xyz(p, "ft", 7)]
    ),
    "centimetres": table(
        ";", "Group;Point;X [cm];Y [cm];Z [cm]", lambda k, g, t, p: [g, t, *xyz(p, "cm", 6)]
    ),
    "a counter beside names": table(
        ";", "No.;Point;Group;X/mm;Y/mm;Z/mm", lambda k, g, t, p: [str(k + 1), t, g, *xyz(p)]
    ),
    "a counter beside an unknown title": table(
        ";", "Nr.;Merkmal;Gruppe;X [mm];Y [mm];Z [mm]",
        lambda k, g, t, p: [str(k + 1), t, g, *xyz(p)],
    ),
    "an id beside names": table(
        ";", "ID;Name;Group;X [mm];Y [mm];Z [mm]",
        lambda k, g, t, p: [f"{k * 7919:08x}-ab", t, g, *xyz(p)],
    ),
    "deviations are no uncertainties": table(
        ";", "Name;Group;Nom X;X [mm];Dev X;Nom Y;Y [mm];Dev Y;Nom Z;Z [mm];Dev Z",
        lambda k, g, t, p: [t, g, *(c for v in xyz(p) for c in ("0.0", v, "-1.5"))],
    ),
    "remarks between rows": table(
        ",", CSV,
        lambda k, g, t, p: ["# next pose\n" * (k % 7 == 0) + g, t, *xyz(p)],
    ),
    "names that begin with a mark of remarks": (
        "group,target,x_mm,y_mm,z_mm\n#1,P1,1,2,3\n#1,P2,4,2,3\n",
        [("#1", "P1"), ("#1", "P2")], np.array([[1e-3, 2e-3, 3e-3], [4e-3, 2e-3, 3e-3]]),
    ),
    "UTF-16 without a mark": table(";", HEAD, lambda k, g, t, p: [g, t, *xyz(p)]).encode(
        "utf-16-le"
    ),
    "feet in a workbook": workbook({
        "Notes": [["nothing"]],
        "Points": [["Group", "Point", "X [ft]", "Y [ft]", "Z [ft]"],
                   *([g, t, *(v / 0.3048 for v in p)] for g, t, p in POINTS)],
    }),
    "one target is the origin": (
        f"{CSV}\na,B1,0,0,0\na,P1,1.5,2,3\nb,B1,0.02,0,0\nb,P1,2.5,2,3\n",
        [("a", "B1"), ("a", "P1"), ("b", "B1"), ("b", "P1")],
        np.array([[0, 0, 0], [1.5, 2, 3], [0.02, 0, 0], [2.5, 2, 3]]) / 1e3,
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", READ)
def test_what_a_program_writes_is_read(kind):
    """Every name unchanged, every position to a micrometre, nothing rejected."""
    data, said, places = (
        READ[kind] if isinstance(READ[kind], tuple) else (READ[kind], NAMES, PLACES)
    )
    data = data if isinstance(data, bytes) else data.encode()
    export = readers.read("export.xlsx" if data[:2] == b"PK" else "export.txt", data)

    assert export.rejected == ()
    assert names(export) == said
    np.testing.assert_allclose(export.position, places, atol=1e-6, rtol=0)
    assert export.covariance is None


@pytest.mark.parametrize(
    "form", ["{}°{:02d}'{:07.4f}\"", "{}-{:02d}-{:07.4f}", "{}d{:02d}m{:07.4f}s"]
)
def test_degrees_minutes_and_seconds_are_degrees(form):
    """They state their unit themselves; gon or radians are not asked for."""
    export = readers.read("t", angled(form).encode(), ExportSettings(vertical="zenith"))

    assert names(export) == NAMES
    np.testing.assert_allclose(export.position, PLACES, atol=6e-9 * 12, rtol=1e-8)


PACKED = "{}.{:02d}{:07.4f}"
"""Minutes and seconds after the point: 123.45067000 is 123 degrees, 45 minutes, 6.7 seconds."""


def packed(titles):
    """The campaign with angles as D.MMSS under some titles, in metres."""

    def row(k, g, t, p):
        far, *angles = polar(p)
        cells = [dms(a, PACKED) for a in angles]
        return [g, t, *(c[:-7] + c[-7:].replace(".", "") for c in cells), f"{far:.7f}"]

    return table(";", titles, row).encode()


@pytest.mark.parametrize(
    ("titles", "said"),
    [
        ("Group;Point;Hz [dms];V [D.MMSS];D [m]", {}),
        ("Group;Point;Hz;V;D [m]", {"angle": "dms"}),
        ("Group;Point;Hz [deg];V [deg];D [m]", {"angle": "dms"}),
        (
            None,
            {"angle": "dms", "coordinates": "spherical", "horizontal": "clockwise", "unit": "m"},
        ),
    ],
)
def test_minutes_behind_the_point_are_read_where_they_are_said(titles, said):
    """By a title or by the user, whatever else a title says of degrees."""
    export = readers.read("t", packed(titles), ExportSettings(vertical="zenith", **said))

    assert names(export) == NAMES
    np.testing.assert_allclose(export.position, PLACES, atol=6e-9 * 12, rtol=1e-8)


@pytest.mark.parametrize("title", ["Hz;V", "Hz [deg];V [deg]"])
def test_angles_that_may_have_minutes_behind_the_point_are_asked(title, tmp_path):
    """Decimals that are all possible minutes are only a hint; decimal degrees remain possible."""
    path = tmp_path / "t.txt"
    path.write_bytes(packed(f"Group;Point;{title};D [m]"))
    question = describe_file.inspect(path, {}).content["question"]

    assert question["about"] == "angle"
    assert question["answers"][0] == "dms"
    assert "deg" in question["answers"]
    export = readers.read("t", path.read_bytes(), ExportSettings(vertical="zenith", angle="deg"))
    assert np.abs(export.position - PLACES).max() > 1e-3


def test_degrees_with_decimals_are_not_asked_for_minutes():
    """Decimals that cannot be minutes suffice; a few round angles show nothing."""
    for cells in (["10.75", "100.7512"], ["10.5", "100.25"]):
        line = f"Point;Hz [deg];V [deg];D [m]\nP1;{cells[0]};{cells[1]};2.5\n"
        export = readers.read("t", line.encode(), ExportSettings(vertical="zenith"))
        assert export.meaning.angle == "deg"


@pytest.mark.parametrize("form", ["1-02-3.5", "1D+3", "12 345.6"])
def test_a_name_like_a_number_stays_a_name(form):
    """Only columns of numbers are read as numbers."""
    data = table(";", HEAD, lambda k, g, t, p: [g, form if t == "P1" else t, *xyz(p)])
    export = readers.read("t", data.encode())

    assert [t for _, t in names(export)] == [form if t == "P1" else t for _, t in NAMES]


@pytest.mark.parametrize("nothing", ["-9999", "99999.999"])
def test_numbers_that_stand_for_no_reading_are_left_out(nothing):
    """The row is listed with its line, the others are read."""
    data = table(",", CSV, lambda k, g, t, p: [g, t, *([nothing] * 3 if k == 9 else xyz(p))])
    export = readers.read("t", data.encode())

    assert [line for line, _ in export.rejected] == [11]
    assert "stand for no reading" in export.rejected[0][1]
    np.testing.assert_allclose(export.position, np.delete(PLACES, 9, axis=0), atol=1e-6, rtol=0)


def later(line):
    """A row with another line above it, from the middle on in metres."""
    return lambda k, g, t, p: [line * (k == 34) + g, t, *xyz(p, "mm" if k < 34 else "m", 7)]


REFUSED = {
    "the unit of length changes here to m, above it was mm": table(
        " ", None, later("# Units: m\n"), above=["# Units: mm"]
    ),
    "the row is in m by its unit": table(
        ",", "group,target,x_mm,y_mm,z_mm,unit",
        lambda k, g, t, p: [g, t, *xyz(p, "m", 7), "m"],
    ),
    'the coordinates of column "X [km]" are in km': table(
        ";", "Point;X [km];Y [km];Z [km]", lambda k, g, t, p: [t, *(f"{v / 1e3:.9f}" for v in p)]
    ),
    "another header begins here, with other columns": table(
        ";", HEAD, lambda k, g, t, p: [f"{POLAR}\n" * (k == 34) + g, t, *xyz(p)]
    ),
    "each row contains one coordinate of a point": table(
        " ", None,
        lambda k, g, t, p: [f"{a} 1000.0 {v} 0.1\n" for a, v in zip("XYZ", xyz(p), strict=True)],
    ),
    "each row contains x, y, z of several targets (Tool:P1, Tool:P2)": "\n".join([
        "Format Version,1.23,Length Units,Meters,,,,", "",
        ",Type,Marker,Marker,Marker,Marker,Marker,Marker",
        ",ID,1001,1001,1001,1002,1002,1002",
        ",Name,Tool:P1,Tool:P1,Tool:P1,Tool:P2,Tool:P2,Tool:P2",
        ",,Position,Position,Position,Position,Position,Position",
        "Frame,Time (Seconds),X,Y,Z,X,Y,Z",
        *(f"{k},{k / 120:.6f},1.{k},2.5,0.3,1.{k},2.1,0.4" for k in range(9)),
    ]),
    "each row contains x, y, z of several targets (p1, p2, p3)": table(
        ";", "Group;P1 X;P1 Y;P1 Z;P2 X;P2 Y;P2 Z;P3 X;P3 Y;P3 Z",
        lambda k, g, t, p: [g, *xyz(p), *xyz(p + 1), *xyz(p + 2)],
    ),
    "the angle 91.7559 has more than 59 minutes or seconds behind the point": table(
        ";", "Group;Point;Hz [dms];V [dms];D [m]",
        lambda k, g, t, p: [g, t, "123.4512", "91.7559", f"{polar(p)[0]:.6f}"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("why", REFUSED)
def test_what_would_be_misread_is_refused_with_its_reason(why):
    """No reading is accepted."""
    with pytest.raises(InputError) as refused:
        readers.read("t", REFUSED[why].encode())

    assert why in str(refused.value)


def test_a_number_with_its_unit_says_so():
    """The reason says what to write, and where."""
    data = table(",", CSV, lambda k, g, t, p: [g, t, *(f"{cell} mm" for cell in xyz(p))])
    export = readers.read("t", data.encode())

    assert len(export.rejected) == len(POINTS)
    assert all("a number with its unit" in reason for _, reason in export.rejected)


def answering(answers):
    """A user who knows the file: chooses the answer that contains a word."""

    def ask(found):
        word = answers[found.question.about]
        return dict(next(a.hints for a in found.question.answers if word in a.said))

    return ask


ASKED = {
    "a workbook without a unit": (
        workbook({"Points": [["Gruppe", "Punkt", "X", "Y", "Z"],
                             *([g, t, *p] for g, t, p in POINTS)]}),
        {"unit": "m"},
    ),
    "a title over three columns": (
        workbook({"Notes": [["nothing"]], "Points": [
            ["Gruppe", "Punkt", "Koordinaten [mm]"], ["", "", "X", "Y", "Z"],
            *([g, t, *(v * 1e3 for v in p)] for g, t, p in POINTS)]}),
        {"columns": "x = X"},
    ),
    "measured beside nominal": (
        workbook({"Points": [["", "", "Actual", "", "", "Nominal", "", ""],
                             ["Gruppe", "Punkt", *["X [mm]", "Y [mm]", "Z [mm]"] * 2],
                             *([g, t, *p * 1e3, 1.5, 2.5, 3.5] for g, t, p in POINTS)]}),
        {"columns": "x = X [mm] column 3"},
    ),
    "angles before the coordinates": (
        table(" ", None, lambda k, g, t, p: [
            g, t, *(f"{a:.6f}" for a in polar(p)[1:]), f"{1e3 * polar(p)[0]:.4f}", *xyz(p)]),
        {"columns": "x = column 6", "unit": "mm"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", ASKED)
def test_the_right_answer_is_among_those_offered(kind, tmp_path):
    """And with it the file is read."""
    data, answers = ASKED[kind]
    data = data if isinstance(data, bytes) else data.encode()
    path = tmp_path / ("export.xlsx" if data[:2] == b"PK" else "export.txt")
    path.write_bytes(data)
    rows = describe_file.inspect(path, {}, csv=True, ask=answering(answers)).text.splitlines()[1:]
    cells = [row.replace('"', "").split(",") for row in rows]

    assert [(row[1], row[2]) for row in cells] == NAMES
    np.testing.assert_allclose(np.array([r[3:6] for r in cells], float), PLACES, atol=1e-6, rtol=0)


def test_a_question_is_the_one_that_the_error_names(tmp_path):
    """Not that of the unit if the coordinates are ambiguous."""
    path = tmp_path / "t.txt"
    path.write_text("1;1,234;2,345;3,456\n2;1,2345;2;3\n3;100,5;3,2;1\n")
    answer = describe_file.inspect(path, {}).content

    assert "the coordinates may be" in answer["error"]["message"]
    assert answer["question"]["about"] == "coordinates"
