"""`check`: lines of campaign.toml that the readings contradict, a summary, and the next step."""

import contextlib
import functools
import io
import json
import re
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_case import PLAN, small

from bench.bench_check import KINDS, named
from pipeline.app import cli
from pipeline.check import proven
from pipeline.check.report import _Seen
from pipeline.check.wrong_lines import wrong_lines
from pipeline.machine.robot import load
from pipeline.reduction.bring import bring
from pipeline.run import campaign_answer, ingested
from pipeline.simulate import revised, simulate
from pipeline.store.campaign import in_memory

FILES = simulate(PLAN, np.random.default_rng(3)).files
TOML = FILES["campaign.toml"].decode()


def changed(old, new, files=FILES):
    """The campaign with a changed campaign.toml, and the number of the changed line."""
    text = files["campaign.toml"].decode()
    assert text.count(old) == 1
    line = text[: text.index(old)].count("\n") + 1
    return files | {"campaign.toml": text.replace(old, new).encode()}, line


def lines(files):
    """Lines of campaign.toml reported as wrong."""
    return [one.line for one in wrong_lines(in_memory(files))]


POINTS = {
    "across the triangle": ("P1 = [0.2, 0.05, 0.12]", "P1 = [0.2, 0.05, 0.125]"),
    "typed sign": ("P2 = [-0.12, 0.19, 0.1]", "P2 = [0.12, 0.19, 0.1]"),
    "millimetres": ("P3 = [-0.1, -0.18, 0.22]", "P3 = [-100, -180, 220]"),
    "a base point": ("B2 = [0.6, 18.5, -0.3]", "B2 = [0.6, 18.52, -0.3]"),
    "a base point below": ("B4 = [-0.6, -0.5, -0.28]", "B4 = [-0.6, -0.5, -0.3]"),
    "a base point in another bay": ("B1 = [0.6, -0.5, -0.3]", "B1 = [0.6, -5.0, -0.3]"),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", POINTS)
def test_a_wrong_point_is_named_in_its_line(name):
    """From 5 mm for the tool and 20 mm for the base, up to any distance."""
    files, line = changed(*POINTS[name])

    assert lines(files) == [line]


def test_two_points_exchanged_are_named_together():
    """In both tables, with both lines."""
    for one, other in (("P1", "P3"), ("B2", "B4")):
        places = {name: TOML.split(f"\n{name} = ")[1].split("\n")[0] for name in (one, other)}
        text = TOML.replace(places[one], "?").replace(places[other], places[one])
        text = text.replace("?", places[other])
        (found,) = wrong_lines(in_memory(FILES | {"campaign.toml": text.encode()}))
        rows = text.splitlines()

        assert rows[found.line - 1].startswith(f"{one} = ")
        second = 1 + next(k for k, row in enumerate(rows) if row.startswith(f"{other} = "))
        assert f"{one} and {other} (line {second})" in found.said


def test_a_decimal_comma_is_named_in_its_line(said):
    """Whether it makes the file invalid TOML or three numbers six."""
    for comma in ("[0,2, 0,05, 0,12]", "[0,2, 0,5, 0,12]"):
        files, line = changed("P1 = [0.2, 0.05, 0.12]", f"P1 = {comma}")
        code, _, err = said(files)

        assert code == 5
        assert err.startswith(f"c: campaign.toml:{line}: ")
        assert err.endswith("write numbers with a decimal point.\n")


def test_a_whole_table_in_millimetres_is_named_in_its_head():
    """And not as one of its points."""
    text = TOML
    for name, at in {"P1": "200, 50, 120", "P2": "-120, 190, 100", "P3": "-100, -180, 220"}.items():
        start = text.index(f"\n{name} = ") + 1
        text = text[:start] + f"{name} = [{at}]" + text[text.index("\n", start) :]
    (found,) = wrong_lines(in_memory(FILES | {"campaign.toml": text.encode()}))

    assert found.key == "tool"
    assert text.splitlines()[found.line - 1] == "[tool]"
    assert "is in mm" in found.said


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", ["unit", "decimal", "angle", "horizontal"])
def test_a_wrong_word_is_named_in_its_line(kind):
    """Unit, decimal mark, unit and sense of angles, for an export that states none of them."""
    assert named(0, kind) == "right"


def test_a_word_that_contradicts_the_export_is_named_in_its_line():
    """Also if the export states it itself, and cannot be read with the contradiction."""
    files, line = changed("sigma_m = 3e-05", 'sigma_m = 3e-05\nunit = "m"')
    (found,) = wrong_lines(in_memory(files))

    assert found.line == line + 1
    assert "cannot be read" in found.said


def test_a_good_campaign_is_not_accused():
    """Nor one with a gross error, a mistyped joint row, or a robot with DH errors."""
    rows = FILES["tracker.csv"].decode().splitlines()
    k = next(k for k, row in enumerate(rows) if row.startswith("pose03_rep0_unloaded,P2"))
    cells = rows[k].split(",")
    cells[2] = str(float(cells[2]) + 60.0)
    far = {"tracker.csv": "\n".join([*rows[:k], ",".join(cells), *rows[k + 1 :], ""]).encode()}
    log = FILES["joints.csv"].decode().splitlines()
    cells = log[4].split(",")
    cells[2] = str(float(cells[2]) + 3.0)
    row = {"joints.csv": "\n".join([*log[:4], ",".join(cells), *log[5:], ""]).encode()}
    off = revised(PLAN, {"hidden": {"effects": ["joint_offset:5=5e-3"]}})

    for more in ({}, far, row, simulate(off, np.random.default_rng(3)).files):
        assert lines({**FILES, **more}) == []


def checked(root, files, *words):
    """`check` of some files: exit code, stdout, stderr."""
    folder = root / "data" / "raw" / "c"
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = cli._exit_code(["check", "c", "--root", str(root), *words])
    return code, out.getvalue(), err.getvalue()


@pytest.fixture
def said(tmp_path):
    """`checked` in a folder of the test's own."""
    return functools.partial(checked, tmp_path)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """Output for the unchanged campaign."""
    return checked(tmp_path_factory.mktemp("good"), FILES)


def test_what_is_there_is_listed_and_what_comes_next(good):
    """Poses, forces, distances with their lines, times, and the next command."""
    code, out, err = good
    line = 1 + TOML[: TOML.index("\nP1 = ") + 1].count("\n")

    assert (code, err) == (0, "")
    assert out.splitlines()[-1].split() == ["next", "pipeline", "run", "c"]
    assert f"349.86 mm nominal (lines {line} and {line + 1})" in out
    assert "2026-11-03 08:00 to" in out
    assert "not used" not in out
    robot = load("kr500_rail")  # r1 is E1; the other joints are axes with sign and offset
    for pose, row in enumerate(FILES["joints.csv"].decode().splitlines()[1:], 1):
        q = np.array([float(cell) for cell in row.split(",")[1:-1]])
        shown = np.linalg.solve(robot.controller_matrix, q - np.rad2deg(robot.controller_offset))
        values = [f"{x:.3f}" for x in shown * [1e3, *6 * [1.0]]]
        assert [str(pose), *values, "2"] in [one.split()[:9] for one in out.splitlines()]


@pytest.mark.whole
def test_programs_get_the_same_as_json(said):
    """In addition to the counts: forces, distances, poses, times, groups that are not used."""
    rows = FILES["tracker.csv"] + b"trial shot,P1,1.0,2.0,3.0,2026-11-03T12:00:00\n"
    code, out, _ = said(FILES | {"tracker.csv": rows}, "--json")
    content = json.loads(out)

    assert code == 5
    assert content["unused_groups"] == ["trial shot"]
    assert content["poses"] == len(content["each_pose"]) == 6
    assert {d["table"] for d in content["distances"]} == {"tool", "base_frame"}
    assert content["next"] == "pipeline run c"
    assert content["over_nominal"] == pytest.approx(1.0, abs=0.1)


def test_a_wrong_line_is_said_with_exit_5_and_comes_before_the_run(said):
    """In a sentence with file, line, size and the position of the point from the readings."""
    files, line = changed(*POINTS["across the triangle"])
    code, out, err = said(files)

    assert code == 5
    assert err.startswith(f"c: campaign.toml:{line}: P1 in [tool] is 4.9")
    assert "about [0.2000, 0.05" in err
    assert "correct campaign.toml, then: pipeline check c" in out


@pytest.mark.whole
def test_a_reading_at_the_origin_is_said_with_its_line(said):
    """Programs write (0, 0, 0) for what was not measured; a row that is set aside is no problem."""
    rows = FILES["tracker.csv"] + b"base_end,B1,0.0,0.0,0.0,2026-11-03T12:00:00\n"
    line = rows.count(b"\n")
    _, _, err = said(FILES | {"tracker.csv": rows})
    assert f"B1 in base_end (tracker.csv:{line}) is at (0, 0, 0)" in err

    toml = FILES["campaign.toml"] + f'\n[set_aside]\n"tracker.csv:{line}" = "no sight"\n'.encode()
    code, out, err = said(FILES | {"tracker.csv": rows, "campaign.toml": toml})
    assert (code, err) == (0, "")
    assert f"set aside    tracker.csv:{line} (readings: 1): no sight" in out


def test_a_line_that_stops_the_campaign_is_named_before_its_symptom(said):
    """The complaint about the export is below it."""
    files, line = changed("sigma_m = 3e-05", 'sigma_m = 3e-05\nunit = "m"')
    code, out, err = said(files, "--json")

    assert code == 5
    assert err.splitlines()[0].startswith(f'c: campaign.toml:{line + 1}: unit = "m" is wrong')
    assert json.loads(out)["error"]["line"] == line + 1


@pytest.mark.whole
def test_a_joint_log_in_another_unit_is_told(said):
    """Whether or not its values exceed the robot's limits."""
    rows = FILES["joints.csv"].decode().splitlines()
    log = {"joints.csv": "\n".join([rows[0].replace("_deg", "_rad"), *rows[1:], ""]).encode()}
    code, _, err = said(FILES | log)
    assert code == 5
    assert "in the joint log the numbers are degrees and were read as radians" in err

    cells = [row.split(",") for row in rows[1:]]
    turned = [[p, r, *(str(np.deg2rad(float(x))) for x in q), way] for p, r, *q, way in cells]
    log = {"joints.csv": "\n".join([rows[0], *map(",".join, turned), ""]).encode()}
    code, _, err = said(FILES | log)
    assert code == 0
    assert "in the joint log the numbers are radians and were read as degrees" in err


@pytest.mark.whole
def test_forces_in_another_unit_and_clocks_in_another_zone_are_doubted(said):
    """Both may be right: reported, without an exit code."""
    loads = FILES["loads.csv"].decode().splitlines()
    titles = loads[0].replace("force_n", "force_kgf")
    code, _, err = said(FILES | {"loads.csv": "\n".join([titles, *loads[1:], ""]).encode()})
    assert (code, "the displacements are 0.1" in err) == (0, True)

    timed = [loads[0] + ",time", *(f"{row},2026-11-03T11:00:00" for row in loads[1:])]
    code, _, err = said(FILES | {"loads.csv": "\n".join([*timed, ""]).encode()})
    assert code == 0
    assert "loads.csv: its times are 2.6 h after those of the readings" in err


@pytest.mark.slow
def test_of_200_wrong_entries_98_percent_are_named():
    """Drawn at random; as many good campaigns are not accused."""
    count = 200 // len(KINDS)
    said = Counter(named(seed, kind) for kind in KINDS for seed in range(count))
    clean = Counter(named(seed, None) for seed in range(count))

    assert said["right"] >= 0.98 * count * len(KINDS), said
    assert clean["silent"] == count


def test_a_name_with_blanks_is_found_in_its_line():
    """As many instruments write them."""
    files = {name: data.replace(b"P1", b"P 1") for name, data in FILES.items()}
    files["campaign.toml"] = files["campaign.toml"].replace(b"\nP 1 = ", b'\n"P 1" = ')
    files, line = changed("0.2, 0.05, 0.12]", "0.2, 0.05, 0.13]", files)

    assert lines(files) == [line]


@pytest.mark.whole
def test_a_campaign_without_base_reflectors_is_said_to_be_in_the_frame_of_the_robot(said, good):
    """The base position is not stated anywhere else."""
    points = TOML[TOML.index("[base_frame]") :].partition("\n\n")[0]
    kept = TOML.replace(points, "")
    assert "B1" not in kept
    _, content, _ = said(FILES | {"campaign.toml": kept.encode()}, "--json")

    assert "taken to be in F_b" not in good[1]
    assert "has no reflectors: readings are taken to be in F_b" in content


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(("copied", "onto"), [("P2", "load_point"), ("load_point", "P2")])
def test_a_load_at_the_place_of_a_reflector_is_doubted(said, good, copied, onto):
    """A copied line in [tool]: one sentence with both names and both lines."""
    rows = TOML.splitlines()
    at = {row.partition(" =")[0]: k for k, row in enumerate(rows)}
    rows[at[onto]] = f"{onto} = {rows[at[copied]].partition('= ')[2]}"
    _, _, err = said(FILES | {"campaign.toml": "\n".join(rows).encode()})

    assert "load_point and P2" not in good[1] + good[2]
    assert "load_point and P2 have the same coordinates in [tool]" in err
    assert f"lines {at['load_point'] + 1} and {at['P2'] + 1}" in err


@pytest.mark.slow
def test_what_check_says_of_a_point_run_says_too():
    """P3 of the demo off by 8 mm: check names the line, run the error, on the first screen."""
    folder = Path(__file__).parents[2] / "data" / "raw" / "kr500_demo"
    files = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    text = files["campaign.toml"].decode().replace("P3 = [-0.1, -0.18,", "P3 = [-0.1, -0.188,")
    raw = in_memory(files | {"campaign.toml": text.encode()})
    (wrong,) = wrong_lines(raw)
    answer = campaign_answer("demo", raw).answer

    assert "campaign.toml:33: P3 in [tool] is 8.0" in wrong.sentence
    assert "P3 is 8.0" in answer.verdict_sentence[0]
    assert "its place in [tool]" in answer.verdict_sentence[0]
    assert answer.diagnosis.verdict == "bad_data"
    assert not [
        line for line in answer.verdict_sentence if line.startswith("Nothing detectable in")
    ]


def next_of(out):
    """The next command proposed."""
    return json.loads(out)["next"]


@pytest.mark.whole
def test_base_distances_that_no_motion_explains_are_told_before_a_run(said):
    """Coordinates off by metres; no rotated frame is claimed."""
    text = TOML
    for name, at in (("B2", "[1.6, 12.5, -0.3]"), ("B3", "[-0.6, 16.5, -1.28]"),
                     ("B4", "[-2.6, -0.5, 0.28]")):  # fmt: skip
        (row,) = (row for row in text.splitlines() if row.startswith(f"{name} = "))
        text = text.replace(row, f"{name} = {at}")
    _, out, err = said(FILES | {"campaign.toml": text.encode()}, "--json")

    assert "B1 to B2 is 19000.0" in err
    assert "13038.40 mm as stated" in err
    assert "turned by" not in err
    assert next_of(out) == "pipeline run c"  # which judges it


def test_a_reflector_in_millimetres_is_refused_with_its_line(said):
    """As `run` does: a coordinate of 210 m is on no effector."""
    files, line = changed("P1 = [0.2, 0.05, 0.12]", "P1 = [210, 0.05, 0.12]")
    code, _, err = said(files)

    assert code == 5
    assert f"campaign.toml:{line}: [tool] P1: a coordinate of 210 m is on no effector" in err


@pytest.mark.parametrize(
    ("file", "column", "row", "off", "says"),
    [
        ("joints.csv", 1, 3, 900.0, ""),
        ("campaign.toml", None, None, 0.005, ": the robot stands about 5.0 mm from where its file"),
    ],
)
def test_where_the_robot_stands_is_no_worse_at_best(file, column, row, off, says):
    """One carriage value typed wrong spoils a fit by least squares; a base frame is elsewhere."""
    text = FILES[file].decode()
    if column is None:
        frame = tomllib.loads(text)["base_frame"]
        for name, (x, y, z) in frame.items():
            was = next(one for one in text.splitlines() if one.startswith(f"{name} = ["))
            text = text.replace(was, f"{name} = {[x + off, y, z]}")
    else:
        rows = [one.split(",") for one in text.splitlines()]
        rows[row][column] = str(float(rows[row][column]) + off)
        text = "\n".join(map(",".join, rows))
    files = in_memory(FILES | {file: text.encode()})
    seen = _Seen(ingested(files, plausible=False), [], None, None, [])

    assert seen.unloaded["at best"] <= seen.unloaded["in the base frame"]
    assert seen._stands().startswith(says)
    assert bool(seen._stands()) == bool(says)


def wrong_link():
    """The campaign with a robot file that is wrong by 34 mm in one link."""
    robot = load("kr500_rail").text.replace("d_m = 1.3", "d_m = 1.266")
    text = TOML.replace('robot = "kr500_rail"', 'robot = "robot.toml"')
    return FILES | {"campaign.toml": text.encode(), "robot.toml": robot.encode()}


@pytest.mark.whole
def test_a_wrong_link_of_the_robot_file_is_told_before_a_run(said):
    """Named with its size, as by `run`, while the robot is still available."""
    _, out, err = said(wrong_link(), "--json")
    value = err.partition("d_4 = ")[2].partition(" mm")[0].split(" ")

    assert "wrong link length in joint 4 (A3)" in err
    assert abs(float(value[0]) - 1300) < 3 * float(value[2])
    assert "not 1266 mm" in err
    assert next_of(out) == "pipeline run c"  # which judges it


@pytest.mark.slow
def test_a_wrong_link_of_the_robot_file_is_a_cause_in_the_answer():
    """`run` names the same."""
    found = campaign_answer("c", in_memory(wrong_link())).answer

    assert "link_length" in {cause.name for cause in found.diagnosis.causes}


def in_inches(table):
    """All numbers of a table of campaign.toml as an American sheet has them."""

    def typed(row):
        name, _, at = row.partition(" = ")
        return f"{name} = {[x / 0.0254 for x in json.loads(at)]}"

    head, _, rest = TOML.partition(f"[{table}]\n")
    inside, gap, after = rest.partition("\n\n")
    return f"{head}[{table}]\n" + "\n".join(map(typed, inside.splitlines())) + gap + after


@pytest.mark.parametrize("table", ["tool", "base_frame"])
def test_a_table_in_inches_is_wrong_and_not_the_export_that_states_its_unit(said, table):
    """Every file has its unit in its titles; the sentence spells the unit out."""
    code, out, err = said(FILES | {"campaign.toml": in_inches(table).encode()})

    assert code == 5
    assert f"[{table}] is in inches" in out + err
    assert "unit of the export" not in out + err
    assert " is in in," not in out + err


def test_a_load_point_metres_from_every_reflector_is_named_with_its_place_in_metres(said):
    """No unloaded reading shows where a load acts; the size of the effector does."""
    inches = [round(x / 0.0254, 6) for x in (0.15, 0.0, 0.25)]
    files, line = changed("load_point = [0.15, 0.0, 0.25]", f"load_point = {inches}")

    code, out, err = said(files)

    assert code == 5
    assert f"campaign.toml:{line}: load_point is" in out + err
    assert "if these are inches, write [0.15, 0, 0.25]" in out + err


@pytest.mark.whole
def test_times_that_a_mapping_leaves_out_are_told_with_their_titles(said):
    """They are not lost silently: without them drift is not sought."""
    head, *rows = FILES["tracker.csv"].decode().splitlines()
    german = [re.sub(r",(\d+)-(\d+)-(\d+)T", r",\3.\2.\1,", row) for row in rows]
    export = "\n".join([head.replace("time", "Datum,Uhrzeit"), *german, ""]).encode()
    columns = 'group = "group", target = "target", x = "x_mm", y = "y_mm", z = "z_mm"'
    short = TOML.replace("[naming]", f"[tracker.mapping]\ncolumns = {{ {columns} }}\n\n[naming]", 1)
    write = 'date = "Datum", time = "Uhrzeit"'
    whole = short.replace('z = "z_mm"', f'z = "z_mm", {write}')

    _, out, err = said(FILES | {"tracker.csv": export, "campaign.toml": short.encode()})
    assert "has times (Datum, Uhrzeit), which columns in [tracker.mapping] leaves" in out + err
    assert f"write {write} into it" in out + err
    _, out, err = said(FILES | {"tracker.csv": export, "campaign.toml": whole.encode()})
    assert "has times" not in out + err


def test_a_force_that_contradicts_all_others_is_told_before_any_run():
    """Half as large again in one pull of eighteen: with its line; none in the right ones."""
    case = small(4, poses={"count": 9})
    rows, mine = case.loads, (case.loads["pose"] == 5) & (case.loads["repeat"] == 2)
    typed = rows["force_n"].where(~mine, 1.5 * rows["force_n"])
    wrong = replace(case, loads=rows.assign(force_n=typed))

    (told,) = proven._forces(wrong, bring(wrong))

    assert f"(line {rows['line'][mine].item()}) says " in told
    assert not [*proven._forces(case, bring(case))]
