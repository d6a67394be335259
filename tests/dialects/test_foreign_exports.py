"""Every kind of file on a tracker's PC is read, or asked about with an answer to paste."""

import csv
import json

import numpy as np
import pytest
from foreign_exports import GON, KINDS, MATRIX, POSE, TWO, TWO_PLACES, mirrored, polar, rows
from random_tables import written
from scipy import stats

from pipeline import readers
from pipeline.app.cli import main
from pipeline.base.errors import InputError
from pipeline.intake.inspect import inspect
from pipeline.intake.offer import offer
from pipeline.readers import Columns, ExportSettings
from pipeline.run import campaign_answer
from pipeline.store.campaign import in_memory


def run(capsys, *arguments):
    """Exit code, stdout and stderr of the command."""
    with pytest.raises(SystemExit) as stopped:
        main(["inspect", *map(str, arguments)])
    said = capsys.readouterr()
    return stopped.value.code, said.out, said.err


def options(said):
    """[tracker] as options of the command."""
    return [word for k, v in said.items() for word in (f"--{k.replace('angle', 'angles')}", v)]


def names(export):
    """Group and target of every reading, None where there are none."""
    columns = [
        [None] * len(export.line) if column is None else column.to_pylist()
        for column in (export.group, export.target)
    ]
    return list(zip(*columns, strict=True))


def right(export, kind):
    """Whether the readings agree with the file."""
    assert names(export) == kind.names
    np.testing.assert_allclose(export.position, kind.places, atol=kind.tolerance, rtol=0)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", KINDS)
def test_every_kind_is_read_or_asked(name, tmp_path, capsys):
    """Read if only the unit is open; otherwise the proposal with the answers reads it."""
    kind, path = KINDS[name], tmp_path / "export.txt"
    path.write_bytes(kind.data)
    if kind.read:
        right(readers.read("export.txt", kind.data, ExportSettings(**kind.said)), kind)
        seen = inspect("export.txt", kind.data, ExportSettings(**kind.said)).to_json()
        assert {word: seen.get(word) for word in kind.facts} == kind.facts

    code, out, _ = run(capsys, path, *options(kind.said if not kind.read else {}), "--json")
    answer = json.loads(out)
    if kind.read and not kind.said:
        assert code == 0
        return
    assert code == 5
    assert answer["error"]["line"]
    assert answer["question"]["answers"]
    mapping = tmp_path / "try.toml"
    mapping.write_text(answer["proposal"])
    code, out, _ = run(
        capsys, path, "--mapping", mapping, *options(kind.said | kind.answers), "--json"
    )

    assert json.loads(out).get("readings") == len(kind.places)
    tried = readers.read("export.txt", kind.data, hints_of(answer["proposal"], kind))
    right(tried, kind)


def hints_of(proposal, kind):
    """A proposal with the answers of a user who knows."""
    import tomllib

    said = tomllib.loads(proposal)["tracker"]
    return ExportSettings.model_validate(said | kind.said | kind.answers)


@pytest.mark.parametrize("unit", ["mm", "m", "in"])
@pytest.mark.parametrize("name", ["two faces", "Hz V D", "instrument report", "total station"])
def test_polar_is_never_cartesian_whatever_unit_is_stated(name, unit):
    """Read as polar, or asked."""
    try:
        export = readers.read("t", KINDS[name].data, ExportSettings(unit=unit))
    except InputError:
        return

    assert export.meaning.kind == "spherical"
    assert name == "two faces"


SENSES = {
    "Hz [gon];V [gon];D [mm]": -1,
    "Horizontal Angle (gon);Zenith Angle (gon);Slope Distance (mm)": -1,
    "HR (gon);VZ (gon);SD (mm)": -1,
    "HL (gon);VZ (gon);SD (mm)": 1,
    "Theta (gon);Zenith (gon);R (mm)": 1,
    "Azimuth (gon);Zenith (gon);Distance (mm)": None,
    "# clockwise\nPoint;Azimuth (gon);Zenith (gon);Distance (mm)": -1,
    "# Azimuths: counter-clockwise\nPoint;Azimuth (gon);Zenith (gon);Distance (mm)": 1,
    "# spherical coordinates\nPoint;Hz (gon);Zenith (gon);Distance (mm)": None,
    "Collection;Azimuth (gon);Zenith (gon);Distance (mm)": 1,
}


@pytest.mark.parametrize("head", SENSES)
def test_which_way_azimuths_grow_is_said_or_asked(head):
    """From titles and lines above; if these are silent or contradictory, it is asked."""
    above, _, titles = head.rpartition("Point;") if "\n" in head else ("", "", head)
    data = rows(*above.splitlines(), f"Point;{titles}", f"P1;{'A;' * ('Coll' in head)}100;50;2000")
    x, y, z = polar(2.0, 100 * GON, 50 * GON)
    if SENSES[head] is None:
        with pytest.raises(InputError, match='write horizontal = "counter-clockwise" \\(or "clock'):
            readers.read("t", data.encode(), ExportSettings(vertical="zenith"))
    for said in ({}, {"horizontal": "clockwise"}, {"horizontal": "counter-clockwise"}):
        side = {"clockwise": -1, "counter-clockwise": 1}.get(said.get("horizontal"), SENSES[head])
        if side is not None:
            export = readers.read("t", data.encode(), ExportSettings(vertical="zenith", **said))
            np.testing.assert_allclose(export.position, [[x, side * y, z]], atol=1e-12)


@pytest.mark.parametrize(
    ("line", "unit"),
    [
        ("Units: temperature degC, radius mm", None),
        ("Unit of the probe's radius: mm", None),
        ("Units: mm, temperature deg C, radius m", "mm"),
        ("Coordinates: x, y and z in m; offset in mm", "m"),
        ("Length unit: inch", "in"),
        ("Uncertainty units: um", None),
        ("Tolerance unit: mm", None),
        ("Resolution unit: um", None),
        ("// Target offset units: in", None),
        ("Uncertainty of the coordinates: um", None),
        ("Job Hall 3; Units: mm; Uncertainty units: um", "mm"),
        ("Tolerance unit: mm\nCoordinates exported in metres", "m"),
        ("Measurement units: mm", "mm"),
    ],
)
def test_a_unit_belongs_to_what_it_is_said_of(line, unit):
    """The unit of a radius or of a temperature says nothing about the coordinates."""
    data = rows(*line.splitlines(), "Point;X;Y;Z", "P1;1500;2500;3500").encode()
    if unit is None:
        with pytest.raises(InputError, match="does not say its unit of length"):
            readers.read("t", data)
    else:
        assert readers.read("t", data).meaning.unit == unit


def test_the_unit_of_an_offset_is_none_of_spatialanalyzers_header():
    """It is neither the unit of the coordinates nor a second one."""
    body = rows("A::g::P1, 1500.0, 2500.0, 3500.0", "A::g::P2, 1600.0, 2500.0, 3500.0")
    for head, unit in (("// Cartesian, Units: Millimeters\n", "mm"), ("// Cartesian\n", None)):
        data = (head + "// Target offset units: in\n" + body).encode()
        if unit:
            assert readers.read("t", data).meaning.unit == unit
            continue
        with pytest.raises(InputError, match="does not say its unit of length"):
            readers.read("t", data)


@pytest.mark.parametrize(
    "title", ["HD [m]", "Horizontaldistanz [m]", "Distance 2D [m]", "Horiz. Dist. [m]", "Hor Dist"]
)
def test_a_horizontal_distance_is_no_range(title):
    """Alone it is refused, also in a mapping; with the slope distance it is ignored."""
    head, row = f"Pkt;Hz [gon];V [gon];{title}", "B1;326.99737;109.38258;10.56544"
    columns = {"target": "Pkt", "azimuth": "Hz [gon]", "vertical": "V [gon]", "range": title}
    for mapping in (None, Columns(columns=columns)):
        hints = ExportSettings(
            unit="m" if "[" not in title else None, vertical="zenith", mapping=mapping
        )
        with pytest.raises(InputError, match=r"t:1: .*is a horizontal distance.* slope distance"):
            readers.read("t", rows(head, row).encode(), hints)

    beside = rows(f"{head};SD [m]", f"{row};10.68124").encode()
    got = readers.read("t", beside, ExportSettings(vertical="zenith"))
    assert np.linalg.norm(got.position[0]) == pytest.approx(10.68124, abs=1e-9)


@pytest.mark.parametrize(
    ("head", "row", "wrong"),
    [
        ("Pkt;Hz [deg];V [deg];SD [m]", "B1;373.2;109.4;10.7", "Hz .deg.. holds 373.2, .* 360 deg"),
        ("Pkt;Hz [rad];Elevation [rad];SD [m]", "B1;1;-9.4;10.7", "Elevation .rad.. holds -9.4"),
        ("Pkt;Hz;V;SD", "B1;100;400.5;10.7", "V. holds 400.5, more than the 400 gon"),
    ],
)
def test_an_angle_beyond_its_circle_is_in_another_unit(head, row, wrong):
    """Neither its title nor campaign.toml is trusted; a circle rounded upwards is accepted."""
    hints = ExportSettings(
        vertical="elevation" if "Elev" in head else "zenith", unit="m", angle="gon"
    )
    if "[" in head:
        hints = hints.model_copy(update={"angle": None, "unit": None})
    first = "B2;6.28319;1;5"
    with pytest.raises(InputError, match=f"t:3: .*{wrong}.*; correct its unit"):
        readers.read("t", rows(head, first, row).encode(), hints)

    assert len(readers.read("t", rows(head, first).encode(), hints).line) == 1


def test_spatialanalyzers_angles_keep_within_their_circle_too():
    """Its header states a unit of angles that its rows exceed."""
    head = ["// Spherical, Zenith, Units: Meters, Degrees", "// Group::Target, R, Theta, Phi"]
    for theta, sound in (("359.5", True), ("373.2", False)):
        data = rows(*head, f"A::g::B1, 10.7, {theta}, 98.0").encode()
        if sound:
            assert readers.read("t", data).meaning.angle == "deg"
            continue
        with pytest.raises(InputError, match=r"t:3: .* holds 373\.2"):
            readers.read("t", data)


@pytest.mark.parametrize(("moved", "left"), [(0.0, 1), (0.01, 1), (0.05, 2)])
def test_two_places_are_no_two_faces(moved, left):
    """A target displaced by more than any collimation error stays two readings."""
    far = 2.0 + moved
    data = rows("Pkt;Hz [gon];V [gon];SD [m]", "P1;50.0;98.0;2.0", f"P1;250.0;302.0;{far}").encode()
    export = readers.read("t", data, ExportSettings(vertical="zenith"))

    assert len(export.line) == left
    assert export.faces.pairs == 2 - left


STATISTICS = ["Mean", "Std Dev", "Std. Dev.", "Min", "Max", "Mittelwert", "Standardabweichung",
              "Average", "RMS", "Centroid", "Range", "Count", "Std_Dev"]  # fmt: skip


@pytest.mark.parametrize("head", ["Point;X [mm];Y [mm];Z [mm]", "group;target;x_mm;y_mm;z_mm"])
@pytest.mark.parametrize("above", [True, False])
def test_statistics_of_the_points_are_no_readings(head, above):
    """Rejected with their lines, whatever the statistic.

    A target that contains such a word stays.
    """
    group = "g;" if head.startswith("group") else ""
    points = [f"{group}{name};4347.4;9629.5;-1568.5" for name in ("B1", "Max1", "Min Plate")]
    below = [f"{group.replace('g', 'Statistics')}{name};0.1;0.2;0.3" for name in STATISTICS]
    data = rows(head, *(below + points if above else points + below)).encode()
    export = readers.read("t", data)

    assert export.target.to_pylist() == ["B1", "Max1", "Min Plate"]
    first = 2 if above else 5
    assert [n for n, why in export.rejected if "a statistic" in why] == [
        *range(first, first + len(STATISTICS))
    ]


SPREAD = [("B1", 4347.4, 9629.5, -1568.5), ("B2", -3925.1, 6118.3, -1571.2),
          ("B3", -2441.9, -5220.7, -1550.1), ("P1", 2847.7, 1877.5, -196.7)]  # fmt: skip


def kinds_of_rows(head, first, second, shift):
    """Every point twice: as `first` calls it, displaced by `shift` mm, and as `second` does."""
    lines = []
    for group in ("g", "h"):
        for name, x, y, z in SPREAD:
            for word, off in ((first, shift), (second, 0.0)):
                lines.append(f"{group};{name};{word};{x + off};{y - off};{z + off}")
    return rows(head, *lines).encode()


@pytest.mark.parametrize(
    ("title", "nominal", "measured"),
    [("Typ", "Soll", "Ist"), ("Type", "Nominal", "Measured"), ("Kind", "CAD", "Probed")],
)
@pytest.mark.parametrize("names", ["group;target", "Gruppe;Punkt"])
def test_nominal_rows_are_not_read_beside_measured_ones(title, nominal, measured, names):
    """Rejected with their lines, however near they are."""
    data = kinds_of_rows(f"{names};{title};x [mm];y [mm];z [mm]", nominal, measured, 0.4)
    export = readers.read("t", data)

    np.testing.assert_allclose(export.position[:4] * 1e3, [p[1:] for p in SPREAD], atol=1e-9)
    assert [line for line, _ in export.rejected] == [*range(2, 18, 2)]
    assert f"its {title} is {nominal}" in export.rejected[0][1]
    assert title not in export.unused


def test_rows_below_a_line_of_nominal_points_are_left_out():
    """Until the title of the measured ones."""
    points = [f"{name};{x};{y};{z}" for name, x, y, z in SPREAD]
    titles = "Point;X [mm];Y [mm];Z [mm]"
    places = [f"{name};{x + 0.5};{y};{z}" for name, x, y, z in SPREAD]
    data = rows("Nominal points", titles, *places, "Measured points", titles, *points)
    export = readers.read("t", data.encode())

    np.testing.assert_allclose(export.position * 1e3, [p[1:] for p in SPREAD], atol=1e-9)
    assert [line for line, why in export.rejected if "nominal points" in why] == [3, 4, 5, 6]


@pytest.mark.parametrize("names", ["group;target", "Gruppe;Punkt"])
def test_a_column_that_tells_frames_apart_is_asked_for(names):
    """Targets metres apart by a word are in two frames; those moved by a load are in one."""
    head = f"{names};Frame;x [mm];y [mm];z [mm]"
    data = kinds_of_rows(head, "World", "Tracker", 1000.0)
    with pytest.raises(InputError, match=r't:1: .*"Frame" holds Tracker, World, .* in \[tracker'):
        readers.read("t", data)
    asked = offer("t", data, ExportSettings()).question
    assert [answer.said for answer in asked.answers] == ["Tracker", "World"]
    chosen = readers.read("t", data, ExportSettings(**asked.answers[0].hints))
    np.testing.assert_allclose(chosen.position[:4] * 1e3, [p[1:] for p in SPREAD], atol=1e-9)
    columns = dict(zip(("group", "target"), names.split(";"), strict=True))
    columns |= {"instrument": "Frame"} | {axis: f"{axis} [mm]" for axis in "xyz"}
    hints = ExportSettings(mapping=Columns(columns=columns, instrument="Tracker"))
    export = readers.read("t", kinds_of_rows(head, "World", "Tracker", 1000.0), hints)
    np.testing.assert_allclose(export.position[:4] * 1e3, [p[1:] for p in SPREAD], atol=1e-9)

    near = readers.read("t", kinds_of_rows(head, "up", "down", 2.0))
    assert (len(near.line), near.unused) == (16, ("Frame",))


@pytest.mark.parametrize("many", [1, 2, 3, 10])
@pytest.mark.parametrize("bad", ["beam broken;beam broken;beam broken", ";;", "-;-;-", "–1;2;3"])
@pytest.mark.parametrize("units", [False, True])
def test_rows_that_cannot_be_read_below_the_titles_leave_these_alone(many, bad, units):
    """Each is rejected with its line; the titles still define columns and unit."""
    head = ["Point;Z;X;Y", ";[in];[in];[in]"] if units else ["Point;Z [in];X [in];Y [in]"]
    good = [f"{name};{z};{x};{y}" for name, x, y, z in SPREAD]
    export = readers.read("t", rows(*head, *[f"B1;{bad}"] * many, *good).encode())

    np.testing.assert_allclose(export.position / 0.0254, [p[1:] for p in SPREAD], rtol=1e-12)
    assert [line for line, _ in export.rejected] == [len(head) + 1 + k for k in range(many)]


@pytest.mark.parametrize("first", [True, False])
def test_two_kinds_in_one_file_without_titles_are_refused(first):
    """A tool keeps its distances only if one part is angles and the other x, y, z."""
    rng = np.random.default_rng(23)
    tool = np.array([[200.0, 50, 120], [-120, 190, 100], [-100, -180, 220]])
    lines = []
    for pose in range(6):
        at, turn = rng.uniform([2000, -4000, -500], [5000, 3000, 900]), rng.permutation(3)
        for k, place in enumerate(tool[:, turn] * (1 if list(turn) != [0, 1, 2] else -1) + at):
            cells = place
            if (pose < 3) == first:
                far = np.linalg.norm(place)
                cells = np.degrees([np.arctan2(place[1], place[0]), np.arccos(place[2] / far)])
                cells = [*cells, far]
            lines.append(f"g{pose};P{k};" + ";".join(f"{c:.5f}" for c in cells))

    with pytest.raises(InputError, match=r"t:10: .* of two kinds.* split the export"):
        readers.read("t", rows(*lines).encode(), ExportSettings(unit="mm"))
    alone = rows(*(line for line in lines if (line < "g3") != first)).encode()
    assert readers.read("t", alone, ExportSettings(unit="mm")).meaning.kind == "cartesian"
    every = readers.read(
        "t", rows(*lines).encode(), ExportSettings(unit="mm", coordinates="cartesian")
    )
    assert len(every.line) == 18


def test_two_faces_are_one_reading_and_their_difference_is_told(capsys, tmp_path):
    """The mean of both, and their difference."""
    path = tmp_path / "polar.txt"
    path.write_bytes(KINDS["two faces"].data)
    apart = np.subtract(
        polar(1.9968235, 236.31352 * np.pi / 200, 110.43128 * np.pi / 200),
        polar(1.9968231, 36.31478 * np.pi / 200, 289.56919 * np.pi / 200),
    )

    said = ["--unit", "mm", "--horizontal", "clockwise"]
    seen = json.loads(run(capsys, path, *said, "--json")[1])["two_faces"]

    assert (seen["pairs"], seen["single"]) == (1, 0)
    assert seen["largest_mm"] == pytest.approx(1e3 * np.linalg.norm(apart), rel=1e-6)


def test_a_covariance_without_titles_is_known_by_its_symmetry():
    """Row by row after the coordinates, in their unit squared."""
    kind = KINDS["uncertainties and covariance"]
    C = np.array([float(cell) for cell in MATRIX.split(",")])
    got = readers.read("t", kind.data, ExportSettings(unit="mm")).covariance

    np.testing.assert_allclose(got[0], C[[0, 1, 2, 4, 5, 8]] * 1e-6, rtol=1e-12)


def test_most_pairs_say_which_angle_is_which():
    """A point exactly to the left at instrument height is the same either way."""
    shots = [("100.0", "100.0"), ("300.0", "300.0"), ("40.0", "95.0"), ("240.0", "305.0")]
    lines = [f"P{k // 2} {hz} {v} 2500.0" for k, (hz, v) in enumerate(shots)]
    export = readers.read(
        "t", rows(*lines).encode(), ExportSettings(unit="mm", horizontal="clockwise")
    )

    places = [mirrored(polar(2.5, float(hz) * GON, float(v) * GON)) for hz, v in shots[::2]]
    np.testing.assert_allclose(export.position, places, atol=1e-9)


def test_instruments_in_one_file_are_told_apart():
    """Polar readings of two instruments are in two frames: one must be chosen."""
    kind = KINDS["two faces"]
    other = kind.data.replace(b"Instrument_0", b"Instrument_1")
    with pytest.raises(InputError, match=r"several instruments .*Instrument_0.*Instrument_1"):
        readers.read("t", kind.data + other, ExportSettings(unit="mm"))


def test_reports_of_two_instruments_in_one_file_are_told_apart(capsys, tmp_path):
    """Each below its own lines; the proposal reads only the first."""
    data = KINDS["instrument report"].data
    second = data.removeprefix("\ufeff".encode()).replace(b"A::0", b"A::1")
    path = tmp_path / "report.csv"
    path.write_bytes(data + second)
    code, out, _ = run(capsys, path, "--vertical", "zenith", "--json")
    answer = json.loads(out)

    assert code == 5
    assert answer["question"]["about"] == "instrument"
    assert len(answer["question"]["answers"]) == 2
    mapping = tmp_path / "try.toml"
    mapping.write_text(answer["proposal"])
    code, out, _ = run(capsys, path, "--mapping", mapping, "--json")
    assert json.loads(out)["readings"] == 2

    hints = ExportSettings(vertical="zenith")
    for about in ("instrument", None):  # asked once
        found = offer("report.csv", data + second, hints)
        assert (found.question and found.question.about) == about
        if found.question:
            hints = hints.model_copy(update=dict(found.question.answers[1].hints))
    assert readers.read("report.csv", data + second, hints).line.min() > len(data.splitlines())


def test_a_tool_that_keeps_its_size_tells_metres_from_angles():
    """Small numbers without titles: targets keep their distances as x, y, z, or as angles."""
    rng = np.random.default_rng(17)
    tool = np.array([[0.2, 0.0, 0.1], [-0.1, 0.2, 0.1], [-0.1, -0.2, 0.2]])
    turns = [np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.eye(3), np.diag([-1, -1, 1])]
    poses = [rng.uniform([2, -4, -1], [5, 4, 3]) + tool @ turn.T for turn in turns]
    places = np.concatenate(poses)
    far = np.linalg.norm(places, axis=1)
    azimuth = np.degrees(np.arctan2(places[:, 1], places[:, 0]))
    elevation = np.degrees(np.arcsin(places[:, 2] / far))

    def text(columns):
        lines = [f"P{k % 3} {' '.join(f'{v:.7f}' for v in row)}" for k, row in enumerate(columns)]
        return rows(*lines).encode()

    cartesian = readers.read("t", text(places), ExportSettings(unit="m"))
    angles = np.column_stack([far, azimuth, elevation])
    left = {"angle": "deg", "horizontal": "counter-clockwise"}
    turned = readers.read("t", text(angles), ExportSettings(unit="m", **left))

    assert (cartesian.meaning.kind, turned.meaning.kind) == ("cartesian", "spherical")
    np.testing.assert_allclose(turned.position, places, atol=1e-6)
    with pytest.raises(InputError, match='may be "spherical", "cartesian"'):
        readers.read("t", text(places[:3]), ExportSettings(unit="m"))


def test_a_mapping_is_tried_and_what_is_wrong_with_it_is_said(capsys, tmp_path):
    """The file with the mapping is named; an option of the command takes precedence."""
    path, mapping = tmp_path / "t.txt", tmp_path / "try.toml"
    path.write_bytes(KINDS["name x y z"].data)
    mapping.write_text('[tracker]\nunit = "km"\n')
    code, _, err = run(capsys, path, "--mapping", mapping)
    assert (code, "try.toml: unit: " in err) == (5, True)

    mapping.write_text('[tracker]\nunit = "mm"\n')
    code, out, _ = run(capsys, path, "--mapping", mapping, "--unit", "m", "--json")
    assert (code, json.loads(out)["unit"]) == (0, "m")


def test_on_a_terminal_one_question_is_asked_after_the_other(capsys, tmp_path, monkeypatch):
    """Which kind, unit and sense: answered by number."""
    path = tmp_path / "t.txt"
    path.write_bytes(KINDS["Hz V D"].data)
    typed = iter(["9", "1", "1", "1", "2"])
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setattr("typer.prompt", lambda *_, **__: next(typed))
    code, out, err = run(capsys, path)

    assert code == 0
    assert "spherical, angles in gon from the zenith, azimuths clockwise" in out
    asked = [line for line in err.splitlines() if line.endswith("?")]
    assert asked == [
        "Which kind of coordinates are they?",
        "In which unit are lengths?",
        "In which unit are angles?",
        "Which way do horizontal angles grow, seen from above?",
    ]


def test_names_that_begin_again_begin_a_round():
    """Six readings of three numbers are two rounds, and still need an assignment."""
    seen = inspect("t", KINDS["target only"].data, ExportSettings(unit="mm"))

    assert seen.rounds == 2
    assert "the names come in 2 rounds" in seen.to_text()


def test_a_comma_between_digits_may_not_be_two_columns():
    """Numbers split by the delimiter are no coordinates."""
    text = rows("P1,4685,0611,5282,1400,-550,2172", "P2,4785,0611,5182,1400,-530,2172")
    with pytest.raises(InputError, match="does not say for certain which columns"):
        readers.read("t", text.encode(), ExportSettings(unit="mm"))


def test_points_without_names_are_not_one_that_moves():
    """Neighbours along a beam do not reveal the kind of coordinates."""
    table = written(np.random.default_rng(12846))

    assert table.kind == "spherical"
    assert misread(table) == "asked"


def test_titles_decide_and_not_places():
    """The same columns in another order give the same readings."""
    head = "Z [mm];Temp;Y [mm];Name;X [mm];Serie"
    lines = [
        f"{z * 1e3:.4f};20;{y * 1e3:.4f};{t};{x * 1e3:.4f};{g}"
        for (g, t), (x, y, z) in zip(TWO, TWO_PLACES, strict=True)
    ]
    export = readers.read("t", rows("Hall 3", "", head, *lines).encode())

    assert names(export) == TWO
    np.testing.assert_allclose(export.position, TWO_PLACES, atol=1e-12)
    assert POSE in export.group.to_pylist()


# --- any table ------------------------------------------------------------------------------------


def misread(table):
    """What is wrong with how a table was read; None for nothing, `asked` if it was asked about."""
    try:
        export = readers.read("t", table.data, ExportSettings(**table.said))
    except InputError:
        return "asked"
    places = np.array([place for _, _, place in table.points])
    if len(export.line) != len(places):
        return f"{len(export.line)} readings of {len(places)}"
    if np.abs(export.position - places).max() > 1e-6:
        return f"places {export.position[0]} for {places[0]}"
    if names(export) != [(group, target) for group, target, _ in table.points]:
        return f"names {names(export)[0]}"
    return "times" if table.times and export.time.to_pylist() != table.times else None


def counted(seeds):
    """Misread tables, number of plain ones that were asked about, and its limit.

    With a probability of one in twenty, the limit is exceeded in one of 1000 cases.
    """
    wrong, plain, asked = [], 0, 0
    for seed in seeds:
        table = written(np.random.default_rng(seed))
        found = misread(table)
        plain, asked = plain + table.plain, asked + (table.plain and found == "asked")
        if found not in (None, "asked"):
            wrong.append((seed, found, table.told))
    return wrong, asked, stats.binom.ppf(0.999, plain, 0.05)


def test_tables_of_any_make_are_read_right_or_asked():
    """No silent misreading; plain Cartesian ones are rarely asked about."""
    wrong, asked, most = counted(range(100))

    assert wrong == []
    assert asked <= most


@pytest.mark.slow
def test_many_tables_of_any_make_are_read_right_or_asked():
    """The same with twenty thousand."""
    wrong, asked, most = counted(range(1000, 21_000))

    assert wrong == []
    assert asked <= most


@pytest.mark.whole
def test_whoever_runs_is_told_of_two_faces_and_of_times_that_are_none(small_campaign):
    """A campaign in polar coordinates, every point read in both faces, with a stopped clock."""
    rows = list(csv.DictReader(small_campaign.files["tracker.csv"].decode().splitlines()))
    lines = ["Group\tTarget\tHz (gon)\tZenith (gon)\tDistance (mm)\tTime"]
    for row in rows:
        x, y, z = (float(row[f"{axis}_mm"]) for axis in "xyz")
        distance, level = np.sqrt(x * x + y * y + z * z), np.hypot(x, y)
        azimuth, zenith = np.arctan2(-y, x) / GON, np.arctan2(level, z) / GON
        for turn, plunge in ((azimuth, zenith), (azimuth + 200.002, 400 - zenith)):
            cells = (f"{turn:.7f}", f"{plunge:.7f}", f"{distance:.5f}", "00:00.0")
            lines.append("\t".join((row["group"], row["target"], *cells)))
    files = small_campaign.files | {"tracker.csv": "\n".join([*lines, ""]).encode()}

    answer = campaign_answer("two", in_memory(files)).answer

    (faces,) = [line for line in answer.findings if "two faces" in line]
    (clock,) = [line for line in answer.findings if "no times that can be read" in line]
    assert f"{len(rows)} pairs are averaged" in faces
    assert "00:00.0" in clock
    assert sum(joint.identifiable for joint in answer.stiffness) >= 6


@pytest.mark.parametrize("number", ["\u20131.5", "(1.5)", "1.5-"])
def test_what_may_stand_for_a_minus_is_not_guessed(number):
    """An en dash, accountants' brackets, a trailing minus: the row is rejected, with its line."""
    data = f"group,target,x_mm,y_mm,z_mm\ng,a,-1.5,2,3\ng,b,{number},2,3\n"
    export = readers.read("t", data.encode())

    assert len(export.position) == 1
    assert [line for line, _ in export.rejected] == [3]


@pytest.mark.parametrize("unit", ["US ft", "ftUS", "sft", "US survey feet"])
def test_a_foot_of_the_us_survey_is_no_international_one(unit):
    """39.37 inches per metre by definition: 60 survey feet are 36 um longer than 60 feet."""
    head = f"Group;Target;X [{unit}];Y [{unit}];Z [{unit}]"
    export = readers.read("t", rows(head, "g;a;60.0;0.0;3.937").encode())

    np.testing.assert_allclose(export.position, [[60 * 12 / 39.37, 0.0, 1.2]], atol=1e-12)


@pytest.mark.parametrize(
    "titles",
    [
        "Northing;Easting;Height",
        "North;East;Elev",
        "North;East;Up",
        "N;E;H",
        "N [m];E [m];H [m]",
        "Hochwert;Rechtswert;Höhe",
        "X (North);Y (East);Z (Height)",
        "X/North [m];Y/East [m];Height [m]",
        "North X;East Y;Height Z",
        "X(N);Y(E);Z(H)",
    ],
)
def test_north_is_y_and_east_is_x(titles):
    """Read left to right they would be mirrored, and every angle would be reversed."""
    data = rows(f"Group;Target;{titles}", "g;a;1.0;2.0;3.0", "g;b;4.0;5.5;6.0").encode()
    export = readers.read("t", data, ExportSettings(unit="m"))

    np.testing.assert_allclose(export.position, [[2, 1, 3], [5.5, 4, 6]], atol=1e-12)


@pytest.mark.parametrize("titles", ["X (East);Y (North);Z (Height)", "E;N;H"])
def test_east_north_up_is_read_as_it_stands(titles):
    """Also if a letter beside the direction agrees."""
    data = rows(f"Group;Target;{titles}", "g;a;1.0;2.0;3.0", "g;b;4.0;5.5;6.0").encode()
    export = readers.read("t", data, ExportSettings(unit="m"))

    np.testing.assert_allclose(export.position, [[1, 2, 3], [4, 5.5, 6]], atol=1e-12)


def test_newtons_beside_x_are_no_north():
    """Forces in N beside coordinates, whose order is kept."""
    head = "Group;Target;X [m];Y [m];Z [m];Fx (N);Fy (N)"
    export = readers.read("t", rows(head, "g;a;1.0;2.0;3.0;5;6").encode())

    np.testing.assert_allclose(export.position, [[1, 2, 3]], atol=1e-12)


def test_the_average_of_shots_that_are_there_counts_once():
    """It is a reading only if the shots of its target are not in the table."""
    head = "Group;Target;Type;x [mm];y [mm];z [mm]"
    shots = ["g;a;Shot;1.0;2.0;3.0", "g;a;Shot;1.2;2.0;3.0", "g;a;Average;1.1;2.0;3.0"]
    export = readers.read("t", rows(head, *shots, "g;b;Average;7.0;8.0;9.0").encode())

    np.testing.assert_allclose(1e3 * export.position[:, 0], [1.0, 1.2, 7.0], atol=1e-9)
    ((line, why),) = export.rejected
    assert line == 4
    assert "is the average of other rows" in why


def test_one_angle_that_is_none_leaves_its_row_out():
    """9999.5 is an angle in no unit; 390 may be gon under a title of degrees, which is refused."""
    head = "Group;Target;Azimuth ({});Zenith ({});Distance (mm)"
    points = [f"g;P{k};{20 * k}.5;{90 + k}.5;{3000 + 100 * k}.0" for k in range(1, 9)]
    said = ExportSettings(horizontal="clockwise")
    spoilt = [*points[:3], "g;P4;9999.5;94.5;3400.0", *points[4:]]
    other = [*points[:3], "g;P4;390.5;94.5;3400.0", *points[4:]]
    none = [f"g;P{k};{1000 * k}.5;94.5;3400.0" for k in range(1, 9)]
    gon, deg = head.format("gon", "gon"), head.format("deg", "deg")
    export = readers.read("t", rows(gon, *spoilt).encode(), said)

    assert [line for line, _ in export.rejected] == [5]
    assert len(export.position) == 7
    with pytest.raises(InputError, match=r"^t:5: .* holds 390.5, more than the 360 deg"):
        readers.read("t", rows(deg, *other).encode(), said)
    with pytest.raises(InputError, match=r"^t:2: .* more than the 400 gon"):
        readers.read("t", rows(gon, *none).encode(), said)


@pytest.mark.parametrize(
    ("titles", "when"),
    [
        ("Coleção, Grupo, Alvo, X, Y, Z, Timestamp", "18/08/2026 09:52:16"),
        ("Coleção, Grupo, Alvo, X, Y, Z, Timestamp", "08/07/2026 09:52:16"),
        ("Collection, Group, Target, X, Y, Z, Timestamp", "18/08/2026 09:52:16"),
    ],
)
def test_spatialanalyzer_in_another_language_writes_its_own_unit_and_dates(titles, when):
    """The day comes first where the titles or the numbers say so, as in any other table."""
    body = rows(
        f"A, Base, P1, 1500.0, 2500.0, 3500.0, {when}", f"A, Base, P2, 1.0, 2.0, 3.0, {when}"
    )

    seen = readers.read("t", f"// Unidades: mm    U = incerteza\n// {titles}\n{body}".encode())

    assert seen.meaning.unit == "mm"
    day, month = (int(part) for part in when.split("/")[:2])
    assert (seen.time[0].as_py().day, seen.time[0].as_py().month) == (day, month)
