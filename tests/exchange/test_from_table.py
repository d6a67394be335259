"""Robot files of tables, compared with a chain of steps computed here."""

import numpy as np
import openpyxl
import pytest

from pipeline.app import cli
from pipeline.machine.robot.configuration import configure
from pipeline.machine.robot.mdh import parse

ROWS = [("S", 0.92, 0.4, 90), ("H", 0, 1.25, 0), ("V", 0, 0.2, 90), ("R2", 1.3, 0, -90),
        ("B", 0, 0, 90), ("R1", 0.28, 0, 0)]  # fmt: skip
"""Joint, d [m], a [m], alpha [deg]."""
AXES = """Kawasaki, all axes at 0, mm
axis   point     direction
JT1       0     0      0      -Z (clockwise from above)
JT2       0   450    750      -X
JT3       0   450   1850      +X
JT4       0   250   1850      +Z
JT5       0   250   3100      -X
JT6       0   250   3100      +Z
flange    0   250   3350      parallel to the base
JT7 (rail) along +X, mm
"""


def turn(axis, angle, point=(0, 0, 0)):
    """Rotation about an axis through a point, (4, 4), by Rodrigues' formula."""
    k = np.array(axis, float)
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    out = np.eye(4)
    out[:3, :3] += np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    out[:3, 3] = np.array(point) - out[:3, :3] @ point
    return out


def shift(x, y, z):
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out


def flange(robot, shown):
    """Flange for what the controller shows [m, rad]."""
    q = robot.controller_matrix @ np.array(shown) + robot.controller_offset
    here = configure(robot, q[None])
    return here.flange_origin[0], here.flange_axes[0]


def made(capsys, tmp_path, text, *options):
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    assert cli._exit_code(["robot", str(path), *options]) == 0
    shown = capsys.readouterr()
    assert "With all axes at 0 the flange is at" in shown.err
    return parse(shown.out, "table.toml")


SHOWN = np.array([0.3, 1.1, -0.4, 0.7, -1.2, 0.5])


@pytest.mark.parametrize("titles", ["axis;theta (deg);d (mm);a (mm);alpha (deg)",
                                    "축;θ [°];d [mm];a [mm];α [°]",
                                    "Achse;theta_i;d_i;a_i;alpha_i"])  # fmt: skip
@pytest.mark.parametrize("railed", [True, False])
def test_a_classical_table(capsys, tmp_path, titles, railed):
    """Rz(theta) Tz(d) Tx(a) Rx(alpha), on a rail along x turned by -90 degrees or alone."""
    rows = [f"{n};{n};{1e3 * d:g};{1e3 * a:g};{alpha}" for n, d, a, alpha in ROWS]
    rail = ("--rail=x", "--turn=-90", "--foot", "0.1,0.2,0.62") if railed else ()
    robot = made(capsys, tmp_path, "\n".join([titles, *rows]), "--payload", "400", *rail)
    T = np.eye(4)
    if railed:
        T = shift(2.5, 0, 0) @ shift(0.1, 0.2, 0.62) @ turn((0, 0, 1), -np.pi / 2)
    for q, (_, d, a, alpha) in zip(SHOWN, ROWS, strict=True):
        T = T @ turn((0, 0, 1), q) @ shift(a, 0, d) @ turn((1, 0, 0), np.deg2rad(alpha))

    at, turned = flange(robot, [*[2.5] * railed, *SHOWN])

    assert at == pytest.approx(T[:3, 3], abs=1e-9)
    assert turned == pytest.approx(T[:3, :3], abs=1e-9)
    assert list(robot.controller) == [*["E1"] * railed, *(name for name, *_ in ROWS)]
    assert robot.payload_kg == 400


def test_a_modified_table_by_the_order_of_its_columns(capsys, tmp_path):
    rows = [f"J{k},{alpha},{1e3 * a:g},q{k}{' - 30' * (k == 2)},{1e3 * d:g}"
            for k, (_, d, a, alpha) in enumerate(ROWS, 1)]  # fmt: skip
    text = "\n".join(["joint,alpha_i-1 (deg),a_i-1 (mm),theta_i,d_i (mm)", *rows])
    T = np.eye(4)
    for k, (q, (_, d, a, alpha)) in enumerate(zip(SHOWN, ROWS, strict=True), 1):
        q -= np.deg2rad(30) * (k == 2)
        T = T @ turn((1, 0, 0), np.deg2rad(alpha)) @ shift(a, 0, 0) @ turn((0, 0, 1), q)
        T = T @ shift(0, 0, d)

    at, _ = flange(made(capsys, tmp_path, text), SHOWN)

    assert at == pytest.approx(T[:3, 3], abs=1e-9)


def test_the_sense_and_the_zero_of_each_axis(capsys, tmp_path):
    """It is theta = sign q + offset, in Craig's rows as Yaskawa's are written down."""
    signs = [1, 1, -1, -1, -1, -1]
    rows = [
        f"{n};{alpha};{1e3 * a:g};{1e3 * d:g};{-90 * (k == 1)};{sign:+d}"
        for k, ((n, d, a, alpha), sign) in enumerate(zip(ROWS, signs, strict=True))
    ]
    text = "\n".join(["# mm e gradi", "asse;alpha(i-1);a(i-1);d(i);offset;segno", *rows])
    T = np.eye(4)
    for k, (q, (_, d, a, alpha)) in enumerate(zip(signs * SHOWN, ROWS, strict=True)):
        T = T @ turn((1, 0, 0), np.deg2rad(alpha)) @ shift(a, 0, 0)
        T = T @ turn((0, 0, 1), q - np.pi / 2 * (k == 1)) @ shift(0, 0, d)

    at, turned = flange(made(capsys, tmp_path, text), SHOWN)

    assert at == pytest.approx(T[:3, 3], abs=1e-9)
    assert turned == pytest.approx(T[:3, :3], abs=1e-9)


FORMULAS = ["-q1", "90 - q2", "-(q3 + 30)", "θ4 + π/2", "−J5", "A6*"]
"""Sense and zero [deg] of each axis: -1 0, -1 90, -1 -30, 1 90, -1 0, 1 0."""


@pytest.mark.parametrize("mark", [";", "\t", "   "])
@pytest.mark.parametrize("titles", ["asse;theta;d;a;alfa", "軸;θ;d;a;α"])
def test_sense_and_zero_in_the_cells_of_theta(capsys, tmp_path, titles, mark):
    """With other lists and remarks around the table, which says that it is the classical one."""
    both = enumerate(zip(FORMULAS, ROWS, strict=True), 1)
    rows = [f"{k};{cell};{1e3 * d:g};{1e3 * a:g};{alpha}" for k, (cell, (_, d, a, alpha)) in both]
    table = [one.replace(";", mark) for one in (titles, *rows)]
    lines = ["Rz(theta) Tz(d) Tx(a) Rx(alfa), mm", "", *table]
    text = "\n".join([*lines, "", "TOOL", "R1  210,4  31,7  145,0", "R2  -128,6  184,2  117,8"])
    signs, zeros = [-1, -1, -1, 1, -1, 1], np.deg2rad([0, 90, -30, 90, 0, 0])
    T = np.eye(4)
    for q, (_, d, a, alpha) in zip(signs * SHOWN + zeros, ROWS, strict=True):
        T = T @ turn((0, 0, 1), q) @ shift(a, 0, d) @ turn((1, 0, 0), np.deg2rad(alpha))

    at, turned = flange(made(capsys, tmp_path, text), SHOWN)

    assert at == pytest.approx(T[:3, 3], abs=1e-9)
    assert turned == pytest.approx(T[:3, :3], abs=1e-9)


@pytest.mark.parametrize("cell", ["A2 + A3", "2 A2", "A2 / 3", "-A2 90"])
def test_a_cell_that_is_no_axis_is_named_with_its_line(capsys, tmp_path, cell):
    rows = [f"{k};{cell if k == 2 else f'A{k}'};100;0;90" for k in range(1, 7)]
    (tmp_path / "t.csv").write_text("\n".join(["# mm", "axis;theta;d;a;alpha", *rows]))

    assert cli._exit_code(["robot", str(tmp_path / "t.csv")]) == 5
    assert f't.csv:4: the cell "{cell}" below "theta"' in capsys.readouterr().err


def test_axes_by_unit_vectors_in_a_sheet_of_a_workbook(capsys, tmp_path):
    """The flange is turned as the sheet says; another sheet is no table."""
    lines = [((0, 0, 1), (0, 0, 780)), ((0, 1, 0), (320, 0, 780)), ((0, 1, 0), (320, 0, 1855)),
             ((1, 0, 0), (320, 0, 2055)), ((0, 1, 0), (1462.5, 0, 2055))]  # fmt: skip
    book = openpyxl.Workbook()
    book.active.append(["Points", 1, 2, 3])
    sheet = book.create_sheet("dims")
    sheet.append(["Joint", "direction X", "Y", "Z", "through X", "Y", "Z"])
    for k, (way, at) in enumerate(lines, 1):
        sheet.append([f"J{k}", *way, *at])
    sheet.append(["tool0: origin at 1662.5, 0, 2055; z forward (base +X), x down (base -Z)"])
    book.save(tmp_path / "all.xlsx")
    T = np.eye(4)
    for q, (way, at) in zip(SHOWN, lines, strict=False):
        T = T @ turn(way, q, np.array(at) / 1e3)
    T = T @ shift(1.6625, 0, 2.055) @ turn((0, 1, 0), np.pi / 2)

    assert cli._exit_code(["robot", str(tmp_path / "all.xlsx")]) == 0
    at, turned = flange(parse(capsys.readouterr().out, "t"), SHOWN[:5])

    assert at == pytest.approx(T[:3, 3], abs=1e-9)
    assert turned == pytest.approx(T[:3, :3], abs=1e-9)


@pytest.mark.parametrize("end", ["flange ", "kolnierz: srodek"])
def test_axes_by_point_and_direction(capsys, tmp_path, end):
    """The product of rotations about the stated lines, from the rail outwards."""
    lines = [((0, 0, -1), (0, 0, 0)), ((-1, 0, 0), (0, 0.45, 0.75)), ((1, 0, 0), (0, 0.45, 1.85)),
             ((0, 0, 1), (0, 0.25, 1.85)), ((-1, 0, 0), (0, 0.25, 3.1)),
             ((0, 0, 1), (0, 0.25, 3.1))]  # fmt: skip
    T = shift(1.8598, 0, 0)
    for q, (axis, point) in zip(SHOWN, lines, strict=True):
        T = T @ turn(axis, q, point)
    T = T @ shift(0, 0.25, 3.35)

    at, turned = flange(made(capsys, tmp_path, AXES.replace("flange ", end)), [1.8598, *SHOWN])

    assert at == pytest.approx(T[:3, 3], abs=1e-9)
    assert turned == pytest.approx(T[:3, :3], abs=1e-9)


def test_a_file_of_an_arm_is_put_on_a_rail_with_its_payload(capsys, tmp_path):
    assert cli._exit_code(["robot", "--show", "kr210_r2700_2"]) == 0
    path = tmp_path / "mine.toml"
    path.write_text(capsys.readouterr().out, encoding="utf-8")

    assert cli._exit_code(["robot", str(path), "--rail=y", "--payload", "123"]) == 0
    own = parse(capsys.readouterr().out, "mine.toml")

    assert own.payload_kg == 123
    assert next(iter(own.controller)) == "E1"


@pytest.mark.parametrize("text", ["a,b,c\n1,2,3\n", "theta,d,a,alpha\n0,1,2,3\n", "JT1 0 0 0 -Z\n"])
def test_another_table_is_refused_with_the_way_out(capsys, tmp_path, text):
    (tmp_path / "t.csv").write_text(text)

    assert cli._exit_code(["robot", str(tmp_path / "t.csv")]) == 5
    assert "columns theta, d, a, alpha" in capsys.readouterr().err
