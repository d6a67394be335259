"""Folders as other people hand them over: letters, lists and exports beside each other."""

import math
import re
import tomllib

import pytest
from workbooks import workbook

from pipeline import readers
from pipeline.app import cli
from pipeline.intake._folder import in_workbooks
from pipeline.intake._prose import PROSE, is_prose
from pipeline.intake.describe_file import inspect
from pipeline.intake.files import propose
from pipeline.intake.log_columns import understood_loads
from pipeline.intake.which_logs import called
from pipeline.readers import ExportSettings

LETTER = b"""Hello everybody,

enclosed is everything from yesterday, the tracker files and the log of the scale.
The reflectors are in the flange frame, measured in the drawing office last week:
    R1  X 160  Y 120  Z 205
    R2  X -150  Y 135  Z 205
A1 about -Z   A2 about +Y   A3 about +Y   A4 about -X   A5 about +Y   A6 about -X
The truck was in the hall during the break, I believe it touched nothing.
Pose 12 was taken from the second spot, and the force is in the log only.
"""
LOG = b"pose,repeat,force_n,remark\n" + b"".join(
    b"%d,1,%d,somebody stopped beside the robot here\n" % (k, 700 + k) for k in range(1, 9)
)


def test_a_letter_is_neither_log_nor_export():
    """Though it names axes, poses, forces and some points."""
    found = propose({"letter.txt": LETTER, "loads.csv": LOG})

    assert found.refused == {"letter.txt": PROSE}
    assert (found.loads, found.joints, found.exports) == ("loads.csv", None, ())


def test_a_letter_is_not_described_as_a_table(tmp_path):
    """Nothing of it is proposed, nor asked."""
    (tmp_path / "letter.txt").write_bytes(LETTER)

    said = inspect(tmp_path / "letter.txt", {})

    assert "text for people" in said.content["error"]["message"]
    assert {"columns", "proposal", "question"}.isdisjoint(said.content)


def test_a_log_with_long_remarks_is_no_letter():
    assert not is_prose("loads.csv", LOG)
    assert not is_prose("p.src", b"&ACCESS RVP\nDEF STIFF( )\nPTP {A1 0,A2 -90,A3 90}\nEND\n")


def _polar(x, y, z):
    """Azimuth and zenith angle [deg], distance [mm]."""
    far = math.sqrt(x * x + y * y + z * z)
    return math.degrees(math.atan2(y, x)), math.degrees(math.acos(z / far)), far


BASE = {"BASE1": (2000, 100, -800), "BASE2": (100, 2500, -700), "BASE3": (-1500, 900, -900)}
"""Base reflectors as seen by the instrument [mm]."""


def _round(places):
    rows = (
        f"{name};{a:.6f};{z:.6f};{d:.4f};0.005"
        for name, at in places.items()
        for a, z, d in [_polar(*at)]
    )
    return "\n".join(["Nome;Azimut [deg];Zenit [deg];Distanza [mm];RMS [mm]", *rows, ""]).encode()


def _polar_folder():
    files = {"FARO/base_start.csv": _round(BASE), "FARO/base_end.csv": _round(BASE)}
    for k in range(1, 7):
        for n, state in enumerate(("rest", "pull1")):
            at = (3000 - 150 * k, 500 + 210 * k + n, 300 + 60 * k - n)
            ends = {"E1": (at[0] - 90, at[1] - 300, at[2] - 400),
                    "E2": (at[0] - 200, at[1] - 600, at[2] - 900)}  # fmt: skip
            tool = {"T1": at, "T2": (at[0] + 200, at[1], at[2] + 30),
                    "T3": (at[0], at[1] + 220, at[2] - 40)}  # fmt: skip
            files[f"FARO/P{k:02d}_{state}.csv"] = _round(tool | (ends if n else {}))
    return files


@pytest.mark.whole
def test_a_short_list_of_places_beside_files_in_polar_coordinates_is_no_export():
    """Their titles say distance and angles by the units only; one answer holds for all of them."""
    turned = {name: (y, -x, z + 300) for name, (x, y, z) in BASE.items()}
    rows = (f"{name};{x}.0;{y}.0;{z}.0" for name, (x, y, z) in turned.items())
    files = _polar_folder() | {"base.csv": "\n".join(["Punto;X;Y;Z", *rows, ""]).encode()}

    found = propose(files, ExportSettings())

    assert found.patterns == ("FARO/*.csv",)
    assert [question.about for question in found.offer.questions] == ["horizontal"]
    assert {*found.base} == {*BASE}
    assert {*found.measured} == {"T1", "T2", "T3"}
    assert "base.csv is a list of nominal places" in found.nominal.seen[0]


def test_a_list_of_places_belongs_to_an_export_that_joins_its_names_with_others():
    rows = [f"{name}_round{k} 4510.{k}409 -4289.0{k}41 -1360.5270" for k in (1, 2) for name in BASE]
    rows += [f"P0{k}_{state}_T{n} {k}019.7315 -2889.8{n}78 -79.4{k}25"
             for k in (1, 2) for state in ("rest", "pull1") for n in (1, 2, 3)]  # fmt: skip
    listed = "".join(f"{name}  {x}.0  {y}.0  {z}.0\n" for name, (x, y, z) in BASE.items())

    found = propose({"all.txt": "\n".join(rows).encode(), "base.txt": listed.encode()})

    assert found.exports == ("all.txt",)


def test_an_arm_that_the_files_name_is_proposed_on_a_rail(tmp_path, capsys):
    """And taken when the file is there, as the sentence says."""
    folder = tmp_path / "data" / "raw" / "hall"
    folder.mkdir(parents=True)
    axes = "".join(f"{k},{100 * k},{5 * k},-60,80,{4 * k},20,{k}\n" for k in range(1, 6))
    (folder / "KR 210 R2700-2.csv").write_text(
        f"pose,E1 [mm],A1 [deg],A2 [deg],A3 [deg],A4 [deg],A5 [deg],A6 [deg]\n{axes}"
    )
    init = ["init", "hall", "--root", str(tmp_path)]

    assert cli._exit_code(init) == 0
    said = capsys.readouterr().err
    command = re.search(r"pipeline (robot kr210_r2700_2 --rail y --output \S+\.toml)", said)
    assert cli._exit_code(command[1].split()) == 0
    assert cli._exit_code(init) == 0

    assert re.search(
        '^robot += "kr210_r2700_2_rail.toml"', (folder / "campaign.toml").read_text(), re.M
    )


def _french(swapped=False, day="08/10/2024", title="Heure"):
    """An export with rounds named behind the reflectors, and states named before the targets."""
    base = {"B1": (4510.5, -4289.0, -1360.5), "B2": (6634.2, -1646.5, -1303.1),
            "B3": (3888.7, 312.2, -1319.0), "B4": (5974.9, 3001.4, -885.9)}  # fmt: skip
    tool = {"R1": (140.0, -120.0, 190.0), "R2": (-155.0, -105.0, 190.0), "R3": (0.0, 180.0, 240.0)}
    ends = {"D1": (210.0, 85.0, 350.0), "D2": (260.0, 150.0, 800.0)}
    rows = [
        (f"{name}_tour{k}", (x + 0.01 * k, y, z))
        for k in (1, 2, 3)
        for name, (x, y, z) in base.items()
    ]
    rows[9] = "B2_tour3", (0.0, 0.0, 0.0)
    for k in range(1, 9):
        states = ["AV", "CH"] if not (swapped and k == 4) else ["CH", "AV"]
        for state, places in zip(states, (tool, tool | ends), strict=True):
            for name, (x, y, z) in places.items():
                c, d = math.cos(k), math.sin(k)
                at = x * c - y * d + 900 * k, x * d + y * c + 300 * (k % 3), z - (state == "CH")
                rows.append((f"P{k:02}_{state}_{name}", at))
    lines = [
        f"{name};Point;{x:.3f};{y:.3f};{z:.3f};{day};09:{k // 60:02}:{k % 60:02}".replace(".", ",")
        for k, (name, (x, y, z)) in enumerate(rows)
    ]
    head = [
        "Repere : machine;;;;;;",
        "Unites : mm;;;;;;",
        f"Nom;Type;X mes.;Y mes.;Z mes.;Date;{title}",
    ]
    return "\n".join([*head, *lines, ""]).encode()


def test_rounds_that_stand_behind_the_reflector_are_read_the_other_way_round():
    """Also where one of them holds no reading; and the list of places is then proposed."""
    places = (
        b"# reperes au sol (mm)\nB1 -446.1 1198.0 28.4\nB2 1901.0 -1249.1 33.9\nB4 6598.3 -1 412\n"
    )
    found = propose({"releve.csv": _french(), "sol.txt": places})

    assert (found.base, found.chain) == (("B1", "B2", "B3", "B4"), ("D1", "D2"))
    assert found.measured == ("R1", "R2", "R3")
    assert found.offer is None
    assert found.reach is None  # "Unites : mm"
    export = readers.read("releve.csv", _french(), ExportSettings(names=found.names[0]))
    pairs = zip(export.group.to_pylist(), export.target.to_pylist(), strict=True)
    assert {("tour1", "B1"), ("P08_CH", "D2")} <= {*pairs}


def test_one_pose_with_exchanged_states_leaves_no_doubt_of_the_others():
    """The unloaded state is the one that usually has fewer targets."""
    found = propose({"releve.csv": _french(swapped=True)})

    assert found.group.state_of == {"AV": "unloaded", "CH": "loaded"}
    assert (found.measured, found.chain) == (("R1", "R2", "R3"), ("D1", "D2"))


@pytest.mark.parametrize(
    ("day", "title", "month"),
    [("08/10/2024", "Heure", 10), ("08/10/2024", "Time", 8), ("23/10/2024", "Time", 10)],
)
def test_a_day_before_the_month(day, title, month):
    """The language of the titles says it, or a number that is no month."""
    text = _french(day=day, title=title).replace(b"Nom;", b"Nom;" if title == "Heure" else b"Name;")
    export = readers.read("releve.csv", text, ExportSettings())

    assert {one.month for one in export.time.to_pylist()} == {month}
    assert not export.rejected


@pytest.mark.parametrize(
    ("line", "unit"),
    [
        ("Unites : mm", "mm"), ("Unité de longueur : mm", "mm"), ("Unità: mm", "mm"),
        ("单位：mm", "mm"), ("Unidades: in", "in"), ("Diamètre des billes : 38 mm", None),
    ],
)  # fmt: skip
def test_units_above_a_table_in_other_languages(line, unit):
    text = f"{line}\nNom;X mes.;Y mes.;Z mes.\nA;1,5;2;3\nB;2,5;2;4\nC;7,5;2;4\n".encode()
    found = propose({"releve.csv": text, "other.csv": text})

    assert found.exports
    assert (found.reach is None) == (unit is not None)
    if unit:
        assert readers.read("releve.csv", text).meaning.unit == unit


def _inches():
    """Points as SpatialAnalyzer writes them with commas: its titles are a remark with gaps."""
    rows = [f"BASE-AM::MON::M{k}, {97 * k}.5, {(k * 37) % 11 * 20}.1, -63.75" for k in range(1, 5)]
    for pose in range(1, 9):
        x, y = 60 * math.cos(pose), 60 * math.sin(pose)
        rows += [
            f"P{pose:02}::{state}::T{k}, {x + k * 5:.4f}, {y + k % 2 * 7:.4f}, {z}.25"
            for state, z in (("UNL", 6), ("LD1", 5), ("LD2", 4))[: 2 + pose % 2]
            for k in (1, 2, 3)
        ]
    head = ["// SpatialAnalyzer   ASCII export: points", "// Units: Inches, Degrees",
            "// Format: Collection::Group::Target  X  Y  Z"]  # fmt: skip
    return "\n".join([*head, *rows, ""]).encode()


def test_titles_in_a_remark_and_states_in_short():
    """Degrees are those of no coordinate where X, Y, Z are; UNL is unloaded, whatever is LD."""
    found = propose({"points.txt": _inches()})

    assert found.offer is None
    assert found.group.state_of == {"UNL": "unloaded", "LD": "loaded"}
    assert found.measured == ("T1", "T2", "T3")
    export = readers.read("points.txt", _inches())
    assert export.meaning.kind == "cartesian"
    assert math.isclose(export.position[0, 0], 97.5 * 0.0254)


def test_a_scale_in_kg_whose_heading_has_commas():
    text = b"Bilancia CAS 500 kg, div. 0,5 kg - azzerata\npos   tiro   kg\n" + b"".join(
        b"P%02d    %d     21%d,5\n" % (k // 2 + 1, k % 2 + 1, k) for k in range(8)
    )
    found = propose({"forze.txt": text})

    assert found.loads == "forze.txt"
    assert found.load_columns == {"pos": "pose", "tiro": "repeat", "kg": "force_kg"}


def test_kg_without_a_scale_may_be_weights():
    text = b"pos   tiro   kg\n" + b"".join(b"P%02d    1    21%d,5\n" % (k, k) for k in range(1, 9))

    assert propose({"pesi.txt": text}).loads is None


URDF = b"""<robot name="arm"><link name="foot"/><link name="one"/><link name="tip"/>
<joint name="a1" type="revolute"><parent link="foot"/><child link="one"/></joint>
<joint name="a2" type="revolute"><parent link="one"/><child link="tip"/></joint></robot>"""


def test_a_urdf_is_answered_with_its_command():
    said = propose({"arm.urdf": URDF}).refused["arm.urdf"]

    assert "`pipeline robot arm.urdf --base foot --flange tip --output arm.toml`" in said


BOOK = {
    "about": [["Robot on a rail"], ["measured on Thursday"]],
    "readings": [["Time", "Name", "X [mm]", "Y [mm]", "Z [mm]"]]
    + [[f"2025-05-22 09:{k:02}:00", f"R{k % 3}", 100.5 * k, 7.5 * k * k, 12.25] for k in range(30)],
    "places": [["Name", "X [mm]", "Y [mm]", "Z [mm]"], ["R0", 1.5, 2, 3], ["R1", 2.5, 9, 3]],
    "forces": [["begin", "force [kN]"], ["09:16:34", 3.659], ["09:23:03", 3.8]],
    "axes": [["time", *(f"A{k}(deg)" for k in range(1, 7)), "E1(mm)"]]
    + [[f"09:{k:02}:00", *(k * j % 70 for j in range(1, 7)), 100 * k] for k in range(3)],
}


def test_the_sheets_of_a_workbook_are_what_they_are():
    """The larger of two lists of points is the export, and the log lacks poses, not a robot."""
    data = workbook(**BOOK)
    found = propose({"day.xlsx": data})
    (said,) = in_workbooks({"day.xlsx": data})

    assert found.exports == ("day.xlsx",)
    assert found.offer.hints.sheet == "readings"
    assert "no column numbers the poses" in found.refused["day.xlsx"]
    assert "no robot" not in found.refused["day.xlsx"]
    assert said == (
        'day.xlsx has 5 sheets: "about" is text, "readings" has points with times, "places" is a '
        'list of points, "forces" is a log of loads, "axes" is a joint log (A1(deg) to A6(deg)), '
        "without poses."
    )


def test_a_configuration_of_abb_names_the_robot():
    text = b'ROBOT:\n\n -name "ROB_1" -use_robot_type "ROB1_6700_200/2.60" \\\n'

    assert called({"MOC.cfg": text}, ["irb6700_200_260", "irb6700_235_265"]) == ("irb6700_200_260",)


@pytest.mark.whole
def test_listed_places_settle_the_sense_of_azimuths():
    """Four base reflectors off one plane: only one sense moves their places onto the readings."""
    four = BASE | {"BASE4": (3000, -2500, 300)}
    files = {"FARO/base_start.csv": _round(four), "FARO/base_end.csv": _round(four)}
    for k in range(1, 7):
        at = {
            f"SMR{j}": (2500 + 300 * k + 90 * j, 400 * k + 50 * j * j, 120 * j) for j in (1, 2, 3)
        }
        ends = {"DINA_A": (2700 + 300 * k, 400 * k, 0), "DINA_B": (2700 + 300 * k, 400 * k, -500)}
        files |= {
            f"FARO/P{k:02}_scarico.csv": _round(at),
            f"FARO/P{k:02}_tiro1.csv": _round(at | ends),
        }
    turned = "".join(f"{name};{y};{-x};{z}\n" for name, (x, y, z) in four.items())
    found = propose({**files, "basi.csv": f"Punto;X;Y;Z\n{turned}".encode()})

    assert found.offer.hints.horizontal == "counter-clockwise"
    assert not found.offer.questions
    assert found.nominal.places["BASE4"] == (-2.5, -3.0, 0.3)


def test_anchors_that_the_log_names_are_no_base_reflectors():
    anchors = "".join(
        f"BASE-AM::EYES::E{k}, {30 * k}.5, {9 * k * k}.1, -61.5\n" for k in range(1, 5)
    )
    log = "Pose,Pull,Eyebolt,Scale (lbf)\n" + "".join(
        f"{pose},{pull},E{(pose + pull) % 4 + 1},9{pose}{pull}\n"
        for pose in range(1, 9)
        for pull in (1, 2)[: 1 + pose % 2]
    )
    found = propose({"points.txt": _inches() + anchors.encode(), "log.csv": log.encode()})

    assert found.anchors == {"Eyebolt": ("E1", "E2", "E3", "E4")}
    assert found.base == ("M1", "M2", "M3", "M4")


BY_HAND = (
    "Konum;Çekme;lbf\n1;1;213\n;2;606\n;3;553\n2;1;197\n;2;592\n;3;616\n",
    "자세;하중;힘 (N)\n1;1;2213\n1;2;4606\n2;1;2197\n2;2;4592\n9재;1;2190\n9재;2;4600\n",
)


@pytest.mark.parametrize("log", BY_HAND)
def test_the_pose_is_what_changes_less_often_than_the_pull(log):
    """Though its cells are empty below the first pull, or have letters behind the number."""
    pose, pull, _ = log.split("\n", 1)[0].split(";")

    columns = understood_loads("log.csv", log.encode()).columns

    assert (columns[pose], columns[pull]) == ("pose", "repeat")


def test_a_load_that_counts_leaves_its_unit_to_the_force():
    """`carga` numbers the pulls here, and the reading beside it states kgf."""
    log = "pose;carga;leitura (kgf)\n1;1;281,0\n1;2;560,5\n2;1;279,4\n2;2;558,1\n"

    columns = understood_loads("log.csv", log.encode()).columns

    assert columns == {"carga": "repeat", "leitura (kgf)": "force_kgf"}


FLANGE = {"R1": (200, 140, 200), "R2": (-190, 150, 210), "R3": (20, -230, 280)}
FLOOR = {"N1": (-600, 1670, 60), "N2": (1910, -1905, 58), "N3": (4600, 1764, 46)}
HOOK = (290, 50, 360)


def _shots(again="7재"):
    """Pose, state, target, x, y, z [mm] as read; a pose was measured again."""
    rows = [["기준", "시작", name, *at] for name, at in FLOOR.items()]
    for pose in (1, 2, 3, 4, 5, 6, 7, again):
        k = int(str(pose)[0])
        for state in ("무부하", "하중1", "하중2", "무부하(후)"):
            moved = 0.3 * ("하중" in state) * int(state[-1] if state[-1].isdigit() else 0)
            for name, (x, y, z) in FLANGE.items():
                a, b = math.cos(k), math.sin(k)
                place = (3000 + a * x - b * y, 400 * k + b * x + a * y, 900 + z - moved)
                rows.append([pose, state, name, *(round(one, 4) for one in place)])
            if "하중" in state:
                rows += [[pose, state, f"C{end}", 3000 + 9 * end + moved, 400 * k, 500 - 400 * end]
                         for end in (1, 2)]  # fmt: skip
    return rows


@pytest.mark.parametrize("titles", [["자세", "상태", "타겟"], ["qa", "qb", "qc"]])
def test_titles_below_a_heading_with_pose_and_state_in_columns_of_their_own(titles):
    """Known or not, numbers and words; where known a sheet lists places, the hook beside them."""
    axes = ["X (mm)", "Y (mm)", "Z (mm)"]
    points = [["HX400L - API Radian"], [], ["No.", *titles, *axes]]
    points += [[k, *row] for k, row in enumerate(_shots(), 1)]
    places = [["floor"], ["", "X", "Y", "Z"], *([n, *at] for n, at in FLOOR.items()), [],
              ["tool"], *([n, *at] for n, at in FLANGE.items()), ["체인 고리", *HOOK]]  # fmt: skip
    log = [["자세", "하중", "힘 (N)"]]
    log += [[p, k, 2000.5 + k] for p in (1, 2, 3, 4, 5, 6, 7, "7재") for k in (1, 2)]
    known = titles[0] == "자세"
    more = {"places": places, "log": log} if known else {}
    data = workbook(points=points, **more)
    found = propose({"day.xlsx": data})

    assert found.offer.hints.mapping.header == 3
    assert found.group.state_of == {
        "무부하": "unloaded",
        "무부하(후)": "unloaded",
        "하중": "loaded",
    }
    assert (found.measured, found.chain, found.base) == (
        tuple(FLANGE), ("C1", "C2"), tuple(FLOOR))  # fmt: skip
    export = readers.read("day.xlsx", data, found.offer.hints)
    assert "7재 하중2" in export.group.to_pylist()
    if known:
        assert found.load_columns == {"자세": "pose", "하중": "repeat", "힘 (N)": "force_n"}
        assert found.nominal.places["load_point"] == (0.29, 0.05, 0.36)
        assert {*FLANGE, *FLOOR} < found.nominal.places.keys()


def test_a_note_with_places_side_by_side_and_numbers_as_names():
    """Three points in one line of a letter; and names that are numbers, in a table of their own."""
    shots = "\n".join(f"{p}/{s};{n};{x};{y};{z}" for p, s, n, x, y, z in _shots("7b"))
    export = shots.replace("R1;", "1;").replace("R2;", "2;").replace("R3;", "3;")
    note = "Dear all,\nthese are the points on the tool, from the drawing, in mm:   " + (
        "    ".join(f"{n} {x} {y} {z}" for n, (x, y, z) in FLANGE.items())
    )
    hook = f"    chain hook {' '.join(map(str, HOOK))}\n"
    letter = (note + hook + "The truck was in the hall.\nNobody touched anything.\n" * 3).encode()
    table = "".join(f"{n[1]};{x},0;{y},0;{z},0;tool, mm\n" for n, (x, y, z) in FLANGE.items())
    head = "group;target;x_mm;y_mm;z_mm\n"
    one = propose({"points.csv": (head + shots).encode(), "note.txt": letter})
    other = propose({"points.csv": (head + export).encode(), "tool.csv": table.encode()})

    assert one.nominal.places == {
        **{n: tuple(1e-3 * x for x in at) for n, at in FLANGE.items()},
        "load_point": (0.29, 0.05, 0.36),
    }
    assert other.nominal.places.keys() == {"1", "2", "3"}


def test_a_target_that_fell_off_leaves_the_states_what_they_are():
    """SC and SCF have as many targets, and begin alike; only T has a chain."""
    rows = [f"P{p:02}_{s};{n};{100 * p + k};{7 * k * p};{k}"
            for p in range(1, 15)
            for s, names in (("SC", "ABCD"), ("T1", "ABCDXY"), ("T2", "ABCDXY"), ("SCF", "ABCD"))
            for k, n in enumerate(names)
            if n != "D" or p < 8 or (p == 8 and s in ("SC", "T1"))]  # fmt: skip
    found = propose({"points.csv": "\n".join(["group;target;x_mm;y_mm;z_mm", *rows]).encode()})

    assert found.group.state_of == {"SC": "unloaded", "SCF": "unloaded", "T": "loaded"}


def test_a_table_of_a_robot_is_answered_with_its_command(tmp_path):
    rows = "".join(f"{k};q{k};{100 * k};{50 * k};90\n" for k in range(1, 7))
    table = ("axis;theta (deg);d (mm);a (mm);alpha (deg)\n" + rows).encode()

    asked = propose({"DH.csv": table, "points.txt": _inches()})
    made = propose({"DH.csv": table, "points.txt": _inches(), "arm.toml": b'source = "DH.csv"'})

    assert "pipeline robot DH.csv --output DH.toml" in asked.refused["DH.csv"]
    assert made.refused["DH.csv"] == "it describes a robot, that of arm.toml"


@pytest.mark.parametrize("rail", ["E1  rail  along +Y\n", ""])
def test_a_rail_is_advised_only_for_a_table_without_one(rail):
    axes = "".join(f"J{k}  {200 * k}.0  0.0  {500 + 90 * k}.0  about +{'ZYYXYX'[k - 1]}\n"
                   for k in range(1, 7))  # fmt: skip
    table = f"axis X Y Z direction (mm)\n{axes}{rail}flange  1500.0  0.0  1000.0\n".encode()
    refused = propose({"axes.txt": table, "points.txt": _inches()}).refused["axes.txt"]

    assert "pipeline robot axes.txt --output axes.toml" in refused
    assert ("--rail" in refused) == (not rail)


def test_positions_listed_one_file_each_in_a_folder_are_one_joint_log(tmp_path, capsys):
    """FANUC's CURPOS beside an export: `init` names all of them by their pattern."""
    folder = tmp_path / "data/raw/hall"
    (folder / "CURPOS").mkdir(parents=True)
    (folder / "points.txt").write_bytes(_inches())
    for pose in range(1, 9):
        text = "CURRENT JOINT POSITION:\n" + "".join(
            f" Joint {k}: {k * pose:.3f} deg\n" for k in range(1, 7)
        )
        (folder / f"CURPOS/C{pose:02}.DG").write_text(text)
    assert cli._exit_code(["init", "hall", "--root", str(tmp_path)]) == 0

    assert 'file = "CURPOS/*.DG"' in (folder / "campaign.toml").read_text("utf-8")
    assert "not looked at" not in capsys.readouterr().err


@pytest.mark.whole
def test_what_is_stated_holds_for_exports_beside_those_that_need_nothing():
    """`init --stated`: columns and unit of files that do not say them, a round of the base does."""
    base = "group;target;x_mm;y_mm;z_mm\n" + "".join(
        f"start;{n};{x};{y};{z}\n" for n, (x, y, z) in FLOOR.items()
    )
    rows = "".join(f"{p} {s};{n};{x / 25.4:.5f};{z / 25.4:.5f};{y / 25.4:.5f}\n"
                   for p, s, n, x, y, z in _shots("7b")[3:])  # fmt: skip
    files = {"base.csv": base.encode(), "day.txt": ("u;v;k;l;m\n" + rows).encode()}
    columns = {"group": "u", "target": "v", "x": "k", "y": "m", "z": "l"}
    stated = ExportSettings(unit="in", mapping={"columns": columns})

    assert propose(files).exports == ("base.csv",)
    found = propose(files, stated)

    assert found.exports == ("base.csv", "day.txt")
    assert found.offer.hints == stated
    assert (found.measured, found.base) == (tuple(FLANGE), tuple(FLOOR))
    assert found.apart_m["R1", "R2"] == pytest.approx(0.39026, abs=2e-5)


@pytest.mark.parametrize(("own", "robot"), [(["mine"], "mine.toml"), (["mine", "other"], None),
                                            ([], None)])  # fmt: skip
def test_a_robot_is_written_only_if_the_folder_shows_it(tmp_path, capsys, own, robot):
    """With a log of forces alone; the default robot is for a campaign without files."""
    folder = tmp_path / "data/raw/hall"
    folder.mkdir(parents=True)
    log = "pose;repeat;force_n;备注\n1;1;800;点\n1;2;900;\n"
    (folder / "loads.csv").write_text(log, encoding="gb18030")
    assert cli._exit_code(["robot", "--show", "kr210_r2700_2"]) == 0
    shown = capsys.readouterr().out
    for name in own:
        (folder / f"{name}.toml").write_text(shown, encoding="utf-8")

    assert cli._exit_code(["init", "hall", "--root", str(tmp_path)]) == 0
    assert tomllib.loads((folder / "campaign.toml").read_text("utf-8")).get("robot") == robot
    assert "loads.csv: read as gb18030" in capsys.readouterr().err


def test_points_that_are_no_poses_are_offered_for_the_test_pose(tmp_path, capsys):
    """A rail first, as in the robot file, wherever the program has it."""
    folder = tmp_path / "data/raw/hall"
    folder.mkdir(parents=True)
    assert cli._exit_code(["robot", "kr210_r2700_2", "--rail=y"]) == 0
    (folder / "mine.toml").write_text(capsys.readouterr().out, encoding="utf-8")
    points = {
        "home": (0, -90, 90, 0, 0, 0, 1200),
        "k01": (1, -60, 70, 2, 40, 3, 150),
        "k02": (4, -50, 80, 5, 30, 6, 2500),
        "k03": (7, -70, 60, 8, 50, 9, 350.5),
    }
    lines = [f"#{name} {' '.join(map(str, at))}" for name, at in points.items()]
    (folder / "test.as").write_text("\n".join([".JOINTS", *lines, ".END"]))

    assert cli._exit_code(["init", "hall", "--root", str(tmp_path)]) == 0
    text = (folder / "campaign.toml").read_text("utf-8")

    assert 'robot  = "mine.toml"' in text
    assert "# home in test.as is [1200, 0, -90, 90, 0, 0, 0]\n" in text
    assert "k01 in" not in text
