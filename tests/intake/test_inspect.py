"""`pipeline inspect`: description of a tracker export, as a function and as a command."""

import csv
import json
import re
from pathlib import Path

import pytest

from pipeline.app import cli
from pipeline.app.cli import main
from pipeline.intake import log_columns
from pipeline.intake.inspect import inspect
from pipeline.readers import ExportSettings

GOLDEN = Path(__file__).parents[1] / "golden"


def run(capsys, *arguments):
    """Exit code, stdout and stderr of the command."""
    with pytest.raises(SystemExit) as stopped:
        main(["inspect", *map(str, arguments)])
    said = capsys.readouterr()
    return stopped.value.code, said.out, said.err


def test_everything_recognised_is_said():
    """Dialect, encoding, unit, coordinates, count, names, time span, uncertainty, rejected rows."""
    seen = inspect("t.csv", (GOLDEN / "leica_6dof.csv").read_bytes()).to_json()

    assert seen == {
        "file": "t.csv",
        "dialect": "Leica 6DoF CSV",
        "encoding": "cp1252",
        "unit": "mm",
        "coordinates": "cartesian",
        "angle": None,
        "vertical": None,
        "horizontal": None,
        "readings": 2,
        "groups": 2,
        "targets": ["B1", "P1"],
        "time_first": "2026-11-03T08:00:08",
        "time_last": "2026-11-03T08:00:48",
        "covariance": "expanded",
        "unused": ["Rx [°]", "Ry [°]", "Rz [°]"],
        "rejected": [
            {
                "line": 5,
                "reason": "the operator marked it as deleted; clear the mark if it is to be used",
            }
        ],
    }


def test_coordinates_that_are_not_cartesian_are_said():
    """Kind, angles, zero of the vertical angle and sense of the horizontal one."""
    seen = inspect("s.txt", (GOLDEN / "sa_spherical.txt").read_bytes())

    assert (seen.coordinates, seen.angle, seen.vertical) == ("spherical", "deg", "zenith")
    assert seen.horizontal == "counter-clockwise"
    assert "spherical, angles in deg from the zenith, azimuths counter-clockwise" in seen.to_text()


def test_a_file_without_names_or_times_says_so():
    """An emScon dump has neither."""
    name = "20200710_Exp1_laserData.csv"
    seen = inspect(name, (GOLDEN / "emscon_vive" / name).read_bytes(), ExportSettings(unit="mm"))

    assert (seen.groups, seen.targets, seen.time_first) == (None, None, None)
    assert (seen.readings, seen.covariance) == (16, "a-priori")


def test_the_command_prints_json(capsys):
    """One JSON object on stdout; without rejected rows the exit code is 0."""
    code, out, err = run(capsys, GOLDEN / "tracker_pilot.csv", "--json")

    assert (code, err) == (0, "")
    assert json.loads(out)["dialect"] == "Leica Tracker Pilot CSV"


def test_rejected_rows_are_said_on_stderr_with_their_line(capsys):
    """Rejected rows give exit code 5, and one sentence each."""
    code, out, err = run(capsys, GOLDEN / "leica_6dof.csv")

    assert code == 5
    assert "readings     2" in out
    assert err.startswith("leica_6dof.csv:5: the operator marked it as deleted")


def test_a_missing_unit_is_asked_and_can_be_answered(capsys, tmp_path):
    """Without a unit: exit code 5 and a way out; with --unit or a campaign.toml it is read."""
    path = tmp_path / "hall.xyz"
    path.write_bytes((GOLDEN / "semicolon.xyz").read_bytes())

    code, _, err = run(capsys, path)
    assert code == 5
    assert err.startswith("hall.xyz:1: the export does not say its unit of length; write unit =")

    code, out, _ = run(capsys, path, "--unit", "mm", "--json")
    assert (code, json.loads(out)["unit"]) == (0, "mm")

    code, _, err = run(capsys, path, "--unit", "km")
    assert (code, "use mm, m or in" in err) == (2, True)

    (tmp_path / "campaign.toml").write_text(
        'format = 1\nname = "n"\nrobot = "kr500_rail"\n[tracker]\nfiles = ["*.xyz"]\nunit = "m"\n'
        "[scale]\n[tool]\nload_point = [0, 0, 0]\nP1 = [0, 0, 0]\nP2 = [0, 0, 1]\nP3 = [0, 1, 0]\n"
    )
    code, out, _ = run(capsys, path, "--json")
    assert (code, json.loads(out)["unit"]) == (0, "m")

    code, out, _ = run(capsys, path, "--unit", "mm", "--json")
    assert (code, json.loads(out)["unit"]) == (0, "mm")  # an explicit option takes precedence


def test_readings_for_a_spreadsheet_hold_no_formulas(capsys, tmp_path):
    """Names that a spreadsheet would execute get an apostrophe; numbers are unchanged."""
    path = tmp_path / "t.csv"
    rows = ["=1+1,P1,-1", "pose,@P2,2", "+a,-b,3", ' =c,"d,e",4']
    path.write_text("\n".join(["group,target,x_m,y_m,z_m", *(f"{row},5,-6" for row in rows)]))

    code, out, _ = run(capsys, path, "--csv")
    table = list(csv.DictReader(out.splitlines()))

    assert code == 0
    assert [row["group"] for row in table] == ["'=1+1", "pose", "'+a", "'=c"]
    assert [row["target"] for row in table] == ["P1", "'@P2", "'-b", "d,e"]
    assert [row["x_m"] for row in table] == ["-1", "2", "3", "4"]


def test_a_missing_file_is_one_sentence(capsys, tmp_path):
    """No traceback, exit code 5, JSON error on stdout."""
    code, out, err = run(capsys, tmp_path / "nix.csv", "--json")

    assert code == 5
    assert err.strip().endswith("nix.csv: there is no such file; correct the path.")
    assert json.loads(out)["error"]["thing"] == "there is no such file"


POSES = [
    f"Pose {k} {word};{name};{k}{n}01,{n}5;-2{k}{n}1,5;30{n}{k},25"
    for k in (1, 2)
    for word in ("leer", "Last")
    for n, name in enumerate(("A", "B"))
]
"""Two targets in four groups."""


def test_the_number_of_a_row_is_no_target_beside_names():
    """`Nr.` counts rows if there are names; alone it is the name of a point."""
    numbered = [f"{k};{row}" for k, row in enumerate(POSES, 7)]
    unnamed = [re.sub(";.*?;.*?;", ";", row, count=1) for row in numbered]
    beside, alone = (
        inspect("m.csv", "\n".join([f"Nr.;{title}X [mm];Y [mm];Z [mm]", *rows, ""]).encode())
        for title, rows in (("Messgruppe;Punkt;", numbered), ("", unnamed))
    )

    assert (beside.groups, beside.targets, beside.unused) == (4, ["A", "B"], ["Nr."])
    assert alone.targets == sorted(map(str, range(7, 15)))


def test_a_point_may_have_a_number_behind_its_group():
    """Names that recur and are unique within a group; no question is asked about them."""
    rows = [row.replace("Pose ", "").replace(" ", "").replace(",", ".") for row in POSES]
    named = "\n".join(rows).replace(";A;", ";101;").replace(";B;", ";102;").replace(";", "  ")
    seen = inspect("points.txt", named.encode(), ExportSettings(unit="mm"))

    assert (seen.groups, seen.targets) == (4, ["101", "102"])
    assert seen.preview[0]["x_mm"] == 1001.05


def test_a_log_is_told_from_an_export(capsys, tmp_path):
    """With what to write into campaign.toml, and no question about coordinates."""
    log = tmp_path / "kraft.csv"
    log.write_text("Pose;Zug Nr.;Kraft [kg];Richtung\n1;1;122,5;auf\n1;2;305,1;ab\n")
    code, said, _ = run(capsys, log, "--json")
    joints = GOLDEN.parents[1] / "data/raw/kr500_demo/joints.csv"
    _, other, _ = run(capsys, joints, "--json")

    assert code == 0
    assert json.loads(said)["dialect"] == "log of loads"
    assert '[scale.columns]\n"Zug Nr." = "repeat"' in json.loads(said)["proposal"]
    assert json.loads(other)["proposal"] == '[joints]\nfile = "joints.csv"'
    assert "kr500_rail" in json.loads(other)["robots"]


def test_names_that_hold_group_and_target_are_parted(capsys, tmp_path):
    """And what to write is proposed."""
    rows = [f"Pos-{k:02d}/{state}/{target} {x + 300 * k}.125 {y}.25 {70 * k}.5"
            for k in range(6) for state in ("sans", "avec")
            for target, x, y in (("P1", 0, 0), ("P2", 200, 10), ("P3", 30, 150))]  # fmt: skip
    path = tmp_path / "points.txt"
    path.write_text("\n".join(["# Nom X Y Z", *rows, ""]))
    code, out, _ = run(capsys, path, "--unit", "mm")

    assert code == 0
    assert re.search(r"groups +12\n +targets +P1 P2 P3\n", out)
    assert 'names = "(?P<group>.+)/(?P<target>.+)"' in out


@pytest.mark.parametrize(
    "titles",
    [
        "A1;A2;A3;A4;A5;A6",
        "E1,A1,A2,A3,A4,A5,A6",
        "J1_deg,J2_deg,J3_deg,J4_deg",
        "r1_mm,theta2_deg,theta3_deg,theta4_deg,theta5_deg,theta6_deg,theta7_deg",
        "time,joint 1 [deg],joint 2 [deg],joint 3 [deg],joint 4 [deg]",
    ],
)
def test_a_joint_log_without_poses_is_told_in_one_sentence(tmp_path, capsys, titles):
    """Axes are not offered as azimuths, and the message says which column is missing."""
    mark = ";" if ";" in titles else ","
    rows = [mark.join(str(10.5 * k + n) for n in range(len(titles.split(mark)))) for k in (1, 2)]
    path = tmp_path / "axes.csv"
    path.write_text("\n".join([titles, *rows]) + "\n")
    code = cli._exit_code(["inspect", str(path)])
    out, err = capsys.readouterr()

    assert code == 5
    assert len(err.splitlines()) == 1
    assert "no column numbers the poses; add a column pose" in err
    assert "azimuth" not in out + err


@pytest.mark.parametrize("titles", ["A1,A2,A3", "x,y,z,q1,q2,q3,q4"])
def test_numbered_columns_of_a_point_are_no_axes(titles):
    """Three may be the coordinates of a point, and a quaternion is not of a robot."""
    rows = "\n".join([titles, ",".join("7.5" for _ in titles.split(","))])
    log_columns.refuse_without_poses("some.csv", rows.encode())


def test_titles_of_letters_that_cannot_be_seen_are_no_log():
    """A log of another encoding is no table of known titles, and no internal error."""
    rows = "\x8ep\x90,force_n\n1,1200\n2,1300\n".encode("latin-1") + b"3\x81,1400\n"

    assert log_columns.understood_loads("loads.csv", rows) is None
