"""Logs with words of robot makers and of other languages, read to the same numbers."""

import numpy as np
import pytest
from workbooks import workbook

from pipeline import simulate_campaign
from pipeline.intake.files import propose
from pipeline.intake.log_columns import settled
from pipeline.machine.robot import axes, load
from pipeline.readers import logs

NEWTON = {"N": 1.0, "kN": 1e3, "daN": 10.0, "kgf": 9.80665, "kp": 9.80665, "lbf": 4.4482216152605}
"""Units by ISO 80000-4; kilopond and pound-force by standard gravity."""


@pytest.fixture(scope="module")
def hall():
    """Files from a Yaskawa hall; forces shown by the scale [N], axes of the controller [deg]."""
    made = simulate_campaign(seed=5, name="hall", robot="gp180", poses=4)
    files = {name: text for name, text in made.campaign.files.items() if name != "campaign.toml"}
    rows = [row.split(",") for row in files["loads.csv"].decode().splitlines()[1:]]
    joints = [row.split(",") for row in files["joints.csv"].decode().splitlines()[1:]]
    q = np.deg2rad([[float(x) for x in row[1:7]] for row in joints])
    return files, [row[:3] for row in rows], np.rad2deg(axes.of(load("gp180")).values(q))


def joint_log(degrees, titles, first="point", more=()):
    """A row for each pose, numbers as a pendant shows them."""
    lines = [",".join([first, *titles, *(title for title, _ in more)])]
    for number, row in enumerate(degrees, 1):
        lines.append(",".join([str(number), *(f"{x:.4f}" for x in row), *(x for _, x in more)]))
    return "\n".join([*lines, ""]).encode()


MAKERS = {
    "Yaskawa": ["S", "L", "U", "R", "B", "T"],
    "Yaskawa pendant": [f"{one}-axis [deg]" for one in "SLURBT"],
    "KUKA": [f"A{k} [°]" for k in range(1, 7)],
    "FANUC": [f"J{k} (deg)" for k in range(1, 7)],
    "ABB": [f"rax_{k}" for k in range(1, 7)],
    "Kawasaki": [f"JT{k}" for k in range(1, 7)],
    "Hyundai": ["S", "H", "V", "R2", "B", "R1"],
    "Panasonic": ["RT", "UA", "FA", "RW", "BW", "TW"],
    "Universal Robots": ["Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3"],
    "Comau": [f"Asse {k} (gradi)" for k in range(1, 7)],
    "Staubli": [f"Axe {k} angle (degrés)" for k in range(1, 7)],
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("maker", MAKERS)
def test_axes_of_a_maker_are_known_beside_other_columns(hall, maker):
    """With a speed or a TCP position beside them, columns are not guessed by order."""
    files, _, degrees = hall
    more = [("X", "812.5"), ("Y", "40.1"), ("Z", "933.0"), ("speed", "25")]
    own = files | {"joints.csv": joint_log(degrees, MAKERS[maker], more=more)}
    said = propose(own)
    columns = said.joint_columns["gp180"]
    form = settled({t: ours.replace("_rad", "_deg") for t, ours in columns.items()})
    log = logs.joints("joints.csv", own["joints.csv"], load("gp180"), form)

    assert said.joints == "joints.csv"
    shown = np.column_stack([log.number[name] for name in "SLURBT"])
    np.testing.assert_allclose(np.rad2deg(shown), degrees, atol=1e-4)


def test_a_log_is_read_once_for_all_robots_with_the_same_axes(hall, monkeypatch):
    """Of 46 robots that ship, sixteen have J1 to J6, eleven A1 to A6."""
    asked, joints = [], logs.joints
    monkeypatch.setattr(logs, "joints", lambda *given: asked.append(given) or joints(*given))

    said = propose(hall[0])

    assert len(said.robots) > 40
    assert len(asked) < 40


@pytest.mark.parametrize(
    ("more", "begins"),
    [
        (
            {"poses.mod": b"CONST jointtarget jPose01:=[[25.02,2.57,33.06,-107.64,66.85,-50.4],\n"},
            "irb",
        ),
        ({"notes.txt": b"hall 4, chain pull on KR 210\n"}, "kr"),
        ({"R-2000iC_remarks.txt": b"cold\n"}, "fanuc"),
    ],
)
def test_robots_of_the_maker_that_files_show_come_first(hall, more, begins):
    """A language of programs, or a type name in a remark or in the name of a file."""
    files, _, degrees = hall
    said = propose(files | more | {"joints.csv": joint_log(degrees, MAKERS["Staubli"])})

    first = [name.startswith(begins) for name in said.robots]
    assert any(first)
    assert sorted(first, reverse=True) == first


def test_robots_that_call_their_axes_so_come_first(hall):
    files, _, degrees = hall
    said = propose(files | {"joints.csv": joint_log(degrees, MAKERS["Yaskawa"])})

    assert {*said.robots[:8]} == {name for name in said.robots if name.startswith("gp")}


@pytest.mark.sampled(5)
@pytest.mark.parametrize("unit", NEWTON)
@pytest.mark.parametrize("form", ["title", "cell"])
def test_a_force_has_its_unit_in_the_title_or_in_every_cell(hall, unit, form):
    files, rows, _ = hall
    title, behind = ("tension", f" {unit}") if form == "cell" else (f"effort ({unit})", "")
    lines = [f"station;trial;{title}"]
    lines += [f"{p};{k};{float(f) / NEWTON[unit]:.6f}{behind}" for p, k, f in rows]
    own = {name: files[name] for name in files if name != "joints.csv"}
    own |= {"loads.csv": "\n".join([*lines, ""]).encode()}
    said = propose(own)
    log = logs.loads("loads.csv", own["loads.csv"], settled(said.load_columns))

    assert said.loads == "loads.csv"
    np.testing.assert_allclose(log.number["force"], [float(f) for *_, f in rows], atol=1e-4)
    assert log.number["pose"].tolist() == [float(p) for p, *_ in rows]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "title", ["point", "Pos.", "Punkt", "P#", "Station", "n° point", "Posa", "q17"]
)
def test_poses_are_known_by_a_word_or_by_counting(hall, title):
    """The last one is an unknown word: integers that change less often than those of pulls."""
    files, rows, degrees = hall
    lines = [f"{title},q18,reading [kgf]", *(",".join(row) for row in rows), ""]
    own = files | {"loads.csv": "\n".join(lines).encode(),
                   "joints.csv": joint_log(degrees, MAKERS["KUKA"], first=title)}  # fmt: skip
    said = propose(own)

    assert said.load_columns[title] == "pose"
    assert said.joint_columns["gp180"][title] == "pose"
    assert (said.load_columns.get("q18") == "repeat") == (title == "q17")


def test_the_number_of_a_load_is_no_load(hall):
    files, rows, _ = hall
    lines = ["pose,load no,tension (N)", *(",".join(row) for row in rows), ""]
    said = propose(files | {"loads.csv": "\n".join(lines).encode()})

    assert said.load_columns["tension (N)"] == "force_n"
    assert "force" not in said.load_columns.get("load no", "")


def test_coordinates_are_no_log(hall):
    """Points by easting and northing, or by two angles and a distance, with their numbers."""
    files, _, _ = hall
    for head in ("point,E,N,H,a,b,c", "point,Hz,V,D,a,b,c"):
        rows = [f"{k},1.{k},2.{k},3.{k},4.{k},5.{k},6.{k}" for k in range(1, 6)]
        said = propose(
            {"loads.csv": files["loads.csv"], "p.csv": "\n".join([head, *rows]).encode()}
        )
        assert said.joints is None


@pytest.mark.parametrize("beside", [",", "."])
def test_commas_are_decimal_marks_where_those_of_the_other_files_are(hall, beside):
    """Three digits after each comma of the loads may be thousands; commas alone decide it."""
    _, rows, degrees = hall
    loads = [
        "pose;repeat;force_dan",
        *(f"{p};{k};{int(float(f) / 10)},125" for p, k, f in rows),
        "",
    ]
    joints = joint_log(degrees, MAKERS["KUKA"]).decode().replace(",", ";").replace(".", beside)
    said = propose({"loads.csv": "\n".join(loads).encode(), "joints.csv": joints.encode()})

    assert said.decimal_commas == (("loads.csv",) if beside == "," else ())


def test_pose_state_and_pull_in_columns_of_their_own_make_the_group(hall):
    """As typed into a spreadsheet, with reflectors under an unknown word."""
    files, _, _ = hall
    sheet = [["Stellung", "Zustand", "Zug", "Kugel", "X [mm]", "Y [mm]", "Z [mm]"]]
    for row in files["tracker.csv"].decode().splitlines()[1:]:
        group, target, *xyz, _ = row.split(",")
        pose, _, rest = group.removeprefix("pose").partition("_rep")
        pull, _, state = rest.partition("_")
        own = (
            [int(pose), {"loaded": "Last", "unloaded": "Null"}[state], int(pull)]
            if rest
            else [None, "Basis", None]
        )
        sheet.append([*own, target, *map(float, xyz)])
    said = propose(
        {name: files[name] for name in ("loads.csv", "joints.csv")}
        | {"t.xlsx": workbook(Tracker=sheet)}
    )
    usual = propose(files)

    assert said.offer.hints.mapping.columns["target"] == "Kugel"
    assert not said.offer.questions
    assert said.group.state_of == {"Null": "unloaded", "Last": "loaded"}
    assert (said.measured, said.chain, said.base) == (usual.measured, usual.chain, usual.base)
    assert said.apart_m == pytest.approx(usual.apart_m)
