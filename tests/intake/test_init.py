"""`init` with existing files: proposes what they state, and leaves open what they do not."""

import csv
import io
import re
import tomllib

import numpy as np
import openpyxl
import pytest
import typer
from small_case import PLAN

from pipeline.app import cli
from pipeline.base.errors import InputError
from pipeline.base.patterns import named
from pipeline.intake.files import propose
from pipeline.machine.robot import load
from pipeline.machine.robot.axes import from_log_units
from pipeline.reduction.ingest import ingest
from pipeline.reduction.settings import parse, unfilled
from pipeline.simulate import simulate
from pipeline.store.campaign import in_memory

MADE = simulate(PLAN, np.random.default_rng(3)).files
FILES = {name: data for name, data in MADE.items() if name != "campaign.toml"}
TRUE = tomllib.loads(MADE["campaign.toml"].decode())


def foreign(form):
    """The export as from another laboratory: group names, separator, decimal mark, no unit."""
    rows = [row.split(",") for row in FILES["tracker.csv"].decode().splitlines()[1:]]
    lines = []
    for group, target, *xyz, _ in rows:
        parts = re.fullmatch(r"pose(\d+)_rep(\d+)_(\w+)", group)
        name = form(int(parts[1]), int(parts[2]), parts[3]) if parts else group
        lines.append(";".join([name, target, *(x.replace(".", ",") for x in xyz)]))
    return FILES | {"tracker.csv": "\n".join([*lines, ""]).encode()}


def german(pose, repeat, state):
    """Without a number for the first zero."""
    word = "leer" if state == "unloaded" else "Last"
    return f"Pose {pose} {word} {repeat}" if repeat else f"Pose {pose} {word}"


def short(pose, repeat, state):
    """The state in front."""
    return f"{'Z' if state == 'unloaded' else 'F'}-{pose:03d}-{repeat}"


def test_what_the_files_say_is_proposed():
    """Which file is which, targets, chain, base, and all robots with the joints of the log."""
    said = propose(FILES)

    assert (said.exports, said.loads, said.joints) == (("tracker.csv",), "loads.csv", "joints.csv")
    assert list(said.measured) == TRUE["naming"]["measured"]
    assert list(said.chain) == TRUE["naming"]["chain"]
    assert set(said.base) == set(TRUE["base_frame"])
    assert said.reach is None
    assert "kr500_rail" in said.robots
    assert "fanuc_r2000ic" not in said.robots


@pytest.mark.parametrize(("form", "states"), [(german, ("leer", "Last")), (short, ("Z", "F"))])
def test_the_names_of_others_are_understood_from_what_was_read(form, states):
    """The state with more reflectors is the loaded one; a repeat may be missing."""
    said = propose(foreign(form))

    assert said.group.states == states
    assert named(said.group.pattern) == {"pose", "repeat", "state"}
    for pose, repeat, state in ((1, 0, "unloaded"), (6, 2, "loaded"), (3, 3, "unloaded")):
        found = re.fullmatch(said.group.pattern, form(pose, repeat, state))
        assert int(found["pose"]) == pose
        assert found["state"] == states[state == "loaded"]
        assert int(found["repeat"] or 0) == repeat
    assert list(said.measured) == TRUE["naming"]["measured"]
    assert set(said.base) == set(TRUE["base_frame"])
    assert said.reach == pytest.approx(12560, rel=0.3)


def up_and_down(restart):
    """The branch in place of the state, pulls numbered continuously or restarting."""

    def named(pose, repeat, state):
        if state == "unloaded":
            return f"Pose {pose} leer {repeat}"
        down = repeat > 1
        return f"Pose {pose} {'ab' if down else 'auf'} {repeat - down * restart}"

    return named


def test_several_words_may_be_loaded_states(init):
    """As on the way up and down, with continuous numbers."""
    text = tomllib.loads(init(foreign(up_and_down(0))))

    assert text["naming"]["states"] == {"leer": "unloaded", "auf": "loaded", "ab": "loaded"}
    assert text["naming"]["chain"] == TRUE["naming"]["chain"]
    assert re.fullmatch(text["naming"]["group"], "Pose 3 ab 2")["repeat"] == "2"


def test_an_unloaded_state_read_twice_under_one_name_is_that_state_in_a_column_of_any_title():
    """Before the first pull and after the last one; the title row stands below lines of words."""
    lines = [row.split(";") for row in foreign(german)["tracker.csv"].decode().splitlines()]
    named = [[re.sub(r"leer \d$", "leer", one[0]), *one[1:]] for one in lines]
    text = ["Projekt;Zelle", "Einheit;mm", "", "Nr.;Messgruppe;Punkt;X [mm];Y [mm];Z [mm]"]
    text += [f"{k};{';'.join(one)}" for k, one in enumerate(named, 1)]
    said = propose(FILES | {"tracker.csv": "\n".join(text).encode()})

    assert len({*map(tuple, (one[:2] for one in named))}) < len(named)
    assert said.offer.hints.mapping.columns["group"] == "Messgruppe"
    assert said.group.states == ("leer", "Last")
    assert said.base


def test_pulls_whose_numbers_begin_again_stay_open():
    """Two groups would be the same pull."""
    said = propose(foreign(up_and_down(1)))

    assert said.group is None
    assert said.groups


def test_names_that_tell_nothing_stay_open():
    """Two words with equally many reflectors, a file of another kind."""
    rows = FILES["tracker.csv"].decode().splitlines()
    unloaded = [row for row in rows if not re.search(r",Pl\d,", row)]
    swapped = [re.sub(r"(\d)_(un)?loaded", r"\1_\2x", row) for row in unloaded]
    said = propose({"tracker.csv": "\n".join(swapped).encode(), "notes.txt": b"hello"})

    assert said.group is None
    assert said.groups[1].startswith("pose01")
    assert "notes.txt" in said.refused


def test_readings_without_names_are_asked_for(init):
    """In a table that says what each row is."""
    rows = [row.split(",")[2:5] for row in FILES["tracker.csv"].decode().splitlines()[1:]]
    text = init(FILES | {"tracker.csv": "\n".join(map(";".join, rows)).encode()})

    assert {"assignment", "unit"} <= set(unfilled(text).values())


def test_readings_without_groups_are_said_to_have_none(init):
    """Their targets are named: the column of the groups must be found."""
    rows = [row.split(",") for row in FILES["tracker.csv"].decode().splitlines()]
    cut = "\n".join("\t".join(row[1:5]) for row in [["", "Name", "X", "Y", "Z"], *rows[1:]])
    text = init({"tracker.csv": cut.encode()})

    assert "assignment" in unfilled(text).values()
    assert "the readings have no groups: name their column in [tracker.mapping]" in text


def test_inspect_helps_to_fill_in_what_is_open(init, tmp_path, capsys):
    """A campaign.toml with open lines provides its hints, and stops nothing."""
    text = init(foreign(german))
    folder = tmp_path / "data" / "raw" / "mine"
    (folder / "campaign.toml").write_text(re.sub(r"# unit = \?", 'unit = "mm"', text))
    capsys.readouterr()
    code = cli._exit_code(["inspect", str(folder / "tracker.csv")])

    assert unfilled(text)
    assert code == 0
    assert re.search(r"unit +mm", capsys.readouterr().out)


def test_a_workbook_may_hold_everything():
    """Loads, joints and points, each on a sheet."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name in ("tracker", "loads", "joints"):
        page = book.create_sheet(name)
        for row in csv.reader(FILES[f"{name}.csv"].decode().splitlines()):
            page.append([float(x) if re.fullmatch(r"-?\d+(\.\d+)?", x) else x for x in row])
    book.save(made := io.BytesIO())
    said = propose({"all.xlsx": made.getvalue()})

    assert (said.exports, said.loads, said.joints) == (("all.xlsx",), "all.xlsx", "all.xlsx")
    assert (list(said.measured), said.refused) == (TRUE["naming"]["measured"], {})


def test_without_an_export_none_is_made_up(init):
    """Files none of which is an export leave it open."""
    files = {name: FILES[name] for name in ("loads.csv", "joints.csv")}

    assert {"files", "robot"} <= set(unfilled(init(files)).values())


def unknown(between, title=""):
    """The export as a table with unknown columns, group and target around the numbers."""
    rows = [row.split(",") for row in FILES["tracker.csv"].decode().splitlines()[1:]]
    lines = [between.join([group, *xyz, target]) for group, target, *xyz, _ in rows]
    return FILES | {"tracker.csv": "\n".join([title, *lines, ""]).encode()}


def test_a_table_that_nobody_knows_is_proposed_and_asked(init):
    """As `inspect` proposes it; uncertain entries stay open."""
    text = init(unknown("|", "Serie|A|B|C|Ziel"))
    mapping = tomllib.loads(text)["tracker"]["mapping"]

    assert mapping["columns"] == {"group": "Serie", "target": "Ziel", "x": "A", "y": "B", "z": "C"}
    assert {"columns", "unit"} <= set(unfilled(text).values())
    assert tomllib.loads(text)["naming"]["measured"] == TRUE["naming"]["measured"]


def test_what_inspect_asks_of_a_table_is_asked(init):
    """On a terminal: the columns, then the unit, each once."""
    places = [""] * (len(TRUE["tool"]) + len(TRUE["base_frame"]))
    text = init(
        unknown("|", "Serie|A|B|C|Ziel"), "1", "1", "kr500_rail", "", "0.03", "2", "", *places
    )

    assert tomllib.loads(text)["tracker"]["unit"] == "mm"
    assert tomllib.loads(text)["tracker"]["mapping"]["columns"]["z"] == "C"
    assert not {"columns", "unit"} & set(unfilled(text).values())


LOADS = "Waage 12;;\nPose Nr.;Zug Nr.;Kraft [kg];Richtung\n1;1;122,5;auf\n1;2;305,0;ab\n"
JOINTS = "Pose;Lineareinheit [mm];" + ";".join(f"Achse {k} [°]" for k in range(1, 7))
JOINTS += "\n1;3988,357;52,2396;-46,5960;7,3074;-173,0226;-63,4588;-121,5295\n"


RADIANS = "1;3988,357;0,9144;-0,8132;0,1275;-3,0198;-1,1076;-2,1211\n"
"""The same pose; in degrees it is possible for the robot, too."""


def test_titles_of_others_are_proposed_for_the_logs(init):
    """With the units that they state; of two logs the one with more rows is used, in any order."""
    logs = {"kraft.csv": LOADS.encode("cp1252"), "achsen.csv": JOINTS.encode("cp1252")}
    files = {"tracker.csv": FILES["tracker.csv"], **logs}
    text = init(files, "kr500_rail", *[""] * 12)

    for both in (logs | FILES, FILES | logs):
        said = propose(both)
        assert said.refused["kraft.csv"] == "loads.csv is such a log, too"
        assert "loads.csv" not in said.refused
    assert propose(files).robots == ("kr500_rail", "kr500_rail_kuka")
    assert tomllib.loads(text)["scale"]["columns"] == {
        "Pose Nr.": "pose", "Zug Nr.": "repeat", "Kraft [kg]": "force_kg",
        "Richtung": "branch"}  # fmt: skip
    assert tomllib.loads(text)["joints"]["columns"]["Achse 6 [°]"] == "A6_deg"


@pytest.mark.parametrize("other", ["Reading", "Anzeige", "Peak"])
def test_loads_that_count_in_every_pose_are_pulls(other):
    """`Load` 1, 2, 3 is no force where another column of numbers is left for it."""
    rows = [f"{pose},{pull},{900 + 7.5 * pull * pose}" for pose in (1, 2) for pull in (1, 2, 3)]
    said = propose({"gauge.csv": "\n".join([f"Pose,Load,{other}", *rows, ""]).encode()})
    heavy = [row.replace(",1,", ",1200,", 1) for row in rows]
    as_force = propose({"gauge.csv": "\n".join([f"Pose,Load,{other}", *heavy, ""]).encode()})

    assert said.load_columns["Load"] == "repeat"
    assert said.load_columns[other].startswith("force_n|")
    assert as_force.load_columns["Load"].startswith("force_n|")


def test_a_direction_that_is_no_branch_is_not_proposed():
    """Its words would cost every row."""
    said = propose({"kraft.csv": LOADS.replace(";auf", ";nach Norden").encode()})

    assert said.load_columns == {
        "Pose Nr.": "pose", "Zug Nr.": "repeat", "Kraft [kg]": "force_kg"}  # fmt: skip


def test_angles_that_can_only_be_degrees_are_degrees(init):
    """As radians they exceed the limits of the robot by far."""
    files = FILES | {"achsen.csv": JOINTS.replace("[°]", "").replace("[mm]", "").encode()}
    del files["joints.csv"]
    columns = tomllib.loads(init(files))["joints"]["columns"]

    assert columns["Achse 6"] == "A6_deg"
    assert columns["Lineareinheit"] == "E1_mm"


@pytest.fixture(scope="module")
def numbered():
    """Groups called 1, 2, ...; the log of loads has a row for each state of a pose."""
    readings = [row.split(",") for row in FILES["tracker.csv"].decode().splitlines()]
    number = {name: str(k) for k, name in enumerate(dict.fromkeys(row[0] for row in readings[1:]))}
    tracker = [readings[0], *([number[group], *row] for group, *row in readings[1:])]
    force = dict(re.findall(r"(?m)^(\d+,\d+),([\d.]+)", FILES["loads.csv"].decode()))
    loads = [["Nr.", "Pose", "Kraft [N]"]]
    for name, k in number.items():
        if parts := re.fullmatch(r"pose(\d+)_rep(\d+)_(\w+)", name):
            pull = f"{int(parts[1])},{int(parts[2])}"
            loads.append([k, str(int(parts[1])), force[pull] if parts[3] == "loaded" else "0"])
    return tracker, loads


def as_files(tracker, loads):
    """A campaign with these rows."""
    rows = {"tracker.csv": tracker, "loads.csv": loads}
    text = {name: "\n".join([*map(",".join, of), ""]) for name, of in rows.items()}
    return FILES | {name: one.encode() for name, one in text.items()}


def test_the_column_that_names_the_groups_is_found(init, numbered):
    """By what was read in them, whatever its name; the campaign is then read unchanged."""
    text = init(as_files(*numbered))
    said = propose(as_files(*numbered))

    assert tomllib.loads(text)["scale"]["columns"]["Nr."] == "group"
    assert "group" not in unfilled(text).values()
    assert list(said.measured) == TRUE["naming"]["measured"]
    assert list(said.chain) == TRUE["naming"]["chain"]
    assert set(said.base) == set(TRUE["base_frame"])


@pytest.mark.parametrize("title", ["Grp", "Q"])
def test_the_groups_of_a_table_are_found_by_the_log(init, numbered, title):
    """Whatever their column in the export is called, if no title says which it is."""
    (_, *rows), loads = numbered
    titles = [title, "Name", "X", "Y", "Z"]
    wide = [[k, target, *xyz] for k, target, *xyz, _ in rows]
    files = as_files([titles, *wide], loads)
    text = init(files | {"tracker.csv": files["tracker.csv"].replace(b",", b"|")})
    said = tomllib.loads(text)

    assert said["tracker"]["mapping"]["columns"]["group"] == title
    assert said["naming"]["measured"] == TRUE["naming"]["measured"]
    assert set(unfilled(text).values()) >= set(TRUE["base_frame"])
    assert "assignment" not in unfilled(text).values()


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "changed",
    [
        lambda rows: [[str(int(k) - 1), *row] for k, *row in rows],
        lambda rows: [[str(int(k) + 1), *row] for k, *row in rows],
        lambda rows: rows[:4],
        lambda rows: [[k, pose, "0" if force != "0" else "900"] for k, pose, force in rows],
    ],
    ids=["one before", "one behind", "only some", "the other state"],
)
def test_a_column_that_only_counts_names_no_groups(numbered, changed):
    """It names base readings, omits states, or calls loaded what has no chain."""
    tracker, (titles, *rows) = numbered
    said = propose(as_files(tracker, [titles, *changed(rows)]))

    assert said.group is None
    assert "Nr." not in said.load_columns
    assert said.groups


def test_a_log_that_states_no_unit_is_a_log(init):
    """Its unit stays open, and an ambiguous comma does not make it an export."""
    logs = {
        "kraft.csv": LOADS.replace("[kg]", "").replace(",5", ",225").replace(",0", ",000").encode(),
        "achsen.csv": (JOINTS.replace("[°]", "").partition("\n")[0] + "\n" + RADIANS).encode(),
    }
    text = init({"tracker.csv": FILES["tracker.csv"], **logs})

    assert {"Kraft ", "Achse 6 "} <= {f"{name} " for name in unfilled(text).values()}
    assert '# "Achse 6" = ?   # A6_deg or A6_rad: the title states no unit' in text
    assert tomllib.loads(text)["tracker"]["files"] == ["tracker.csv"]
    points = b"Pose;Last;Punkt;X [mm];Y [mm];Z [mm]\n1;0;A;10,5;20,5;30,5\n1;1;A;10,6;20,5;30,5\n"
    assert propose({"points.csv": points}).loads is None


@pytest.fixture
def init(tmp_path, monkeypatch, capsys):
    """`init` on some files, with these answers on a terminal or none."""

    def typed(files, *answers, words=()):
        folder = tmp_path / "data" / "raw" / "mine"
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in files.items():
            (folder / name).write_bytes(data)
        left = list(answers)
        if answers:
            monkeypatch.setattr("sys.stdin.isatty", lambda: True)
            monkeypatch.setattr(typer, "prompt", lambda *_, **__: left.pop(0))
        code = cli._exit_code(["init", "mine", *words, "--root", str(tmp_path)])
        assert code == 0, capsys.readouterr().err
        assert not left
        return (folder / "campaign.toml").read_text()

    return typed


def test_with_all_answers_it_is_the_campaign_that_was_measured(init):
    """One question at a time: robot, uncertainties, positions; nothing else is needed."""
    points = TRUE["tool"] | TRUE["base_frame"]
    order = ["B1", "B2", "B3", "B4", "load_point", "P1", "P2", "P3"]  # as campaign.toml
    places = ["; ".join(str(x).replace(".", ",") for x in points[name]) for name in order]
    said = parse(init(FILES, "kr500_rail", "", "0.03", "2,0", "21,5", *places))
    true = parse(MADE["campaign.toml"].decode())

    for part in ("robot", "tool", "base_frame", "joints"):
        assert getattr(said, part) == getattr(true, part)
    assert said.naming.measured == true.naming.measured
    assert said.scale.sigma_n == true.scale.sigma_n
    assert said.tracker.sigma_m == pytest.approx(true.tracker.sigma_m)
    assert said.temperature_c == 21.5
    assert said.tracker.files == true.tracker.files


def test_answers_may_have_their_own_units(init):
    """As on a drawing in mm or in inches, and on a scale in pounds."""
    points = TRUE["tool"] | TRUE["base_frame"]
    order = ["B1", "B2", "B3", "B4", "load_point", "P1", "P2", "P3"]  # as campaign.toml
    mm = [" ".join(f"{1e3 * x:.10g}" for x in points[name]) + " mm" for name in order]
    mm[5] = ", ".join(f"{x / 0.0254:.16g}" for x in points["P1"]) + "in"
    said = parse(init(FILES, "kr500_rail", "", "3e-5 m", "0,5 lbf", "", *mm))

    assert said.tool["P1"] == pytest.approx(points["P1"], rel=1e-11)
    assert said.tool["load_point"] == tuple(points["load_point"])
    assert said.base_frame["B2"] == tuple(points["B2"])
    assert said.scale.sigma_n == pytest.approx(0.5 * 4.4482216152605, rel=1e-5)
    assert said.tracker.sigma_m == 3e-5


def test_a_unit_that_is_none_is_asked_again(init):
    """A word after the number that is not a unit of it."""
    said = init(FILES, "", "", "0.03 kg", "0.03", "2 mm", "2", *[""] * 9)

    assert tomllib.loads(said)["tracker"]["sigma_m"] == pytest.approx(3e-5)
    assert tomllib.loads(said)["scale"]["sigma_n"] == 2
    assert "robot" in unfilled(said).values()


def test_a_tracker_whose_data_sheet_is_known_has_its_noise(init):
    """Its type is asked first, and the noise only for one that is in no list."""
    text = init(FILES, "kr500_rail", "leica at960 mr", "2", *[""] * 9)
    said = tomllib.loads(text)

    assert said["instrument"]["model"] == "leica at960 mr"
    assert "sigma_m" not in said["tracker"]


def test_a_tracker_that_is_in_no_list_is_asked_once_more(init, capsys):
    """With similar names; the next answer is accepted, and its noise is asked."""
    said = tomllib.loads(init(FILES, "kr500_rail", "AT96O", "AT96X", "0.03", "2", *[""] * 9))

    assert "like it: Leica AT960" in capsys.readouterr().err
    assert said["instrument"]["model"] == "AT96X"
    assert said["tracker"]["sigma_m"] == pytest.approx(3e-5)


def test_the_unit_of_titles_that_state_none_is_asked(init):
    """Once for all with the same possible units."""
    titles, angles = JOINTS.replace("[°]", "").partition("\n")[0], RADIANS
    files = {
        "tracker.csv": FILES["tracker.csv"],
        "kraft.csv": LOADS.replace("[kg]", "").encode("cp1252"),
        "achsen.csv": f"{titles}\n{angles}".encode(),
    }
    said = tomllib.loads(init(files, "kr500_rail", "kp", "rad", *[""] * 12))

    assert said["scale"]["columns"]["Kraft"] == "force_kp"
    assert {said["joints"]["columns"][f"Achse {k}"] for k in range(1, 7)} == {
        f"A{k}_rad" for k in range(1, 7)
    }


def test_names_with_blanks_stay_apart(init, capsys):
    """In the description of the files before the first question."""
    blanks = FILES["tracker.csv"].replace(b",P1,", b",Ball 1,").replace(b",P2,", b",Ball 2,")
    init(FILES | {"tracker.csv": blanks})

    assert "measured targets: Ball 1, Ball 2, P3\n" in capsys.readouterr().err


def test_a_blank_gives_way_to_files(init, tmp_path):
    """Unfilled logs made by `init` do not count; those of the campaign are found."""
    init({}, words=("--robot", "kr500_rail"))
    (tmp_path / "data" / "raw" / "mine" / "campaign.toml").unlink()
    logs = {"zug.csv": LOADS.encode("cp1252"), "winkel.csv": JOINTS.encode("cp1252")}
    said = tomllib.loads(init({"tracker.csv": FILES["tracker.csv"], **logs}))

    assert (said["scale"]["file"], said["joints"]["file"]) == ("zug.csv", "winkel.csv")


def test_what_nobody_said_is_named_with_its_lines(init):
    """No number that was not given is in the file, not even in a comment."""
    text = init(foreign(german))
    rows = text.splitlines()
    left = unfilled(text)

    assert set(left.values()) == {"robot", "unit", "sigma_n", "load_point", *["P1", "P2", "P3"],
                                  *TRUE["base_frame"]}  # fmt: skip
    assert all(f"{name} = ?" in rows[line - 1] for line, name in left.items())
    with pytest.raises(InputError) as refused:
        parse(text.replace("states", "# states"))
    assert all(f"{name} (line {line})" in str(refused.value) for line, name in left.items())
    assert refused.value.line == min(left)
    assert not re.search(r"^# \w+ = *[-0-9\[]", text, re.M)


def test_a_blank_cannot_be_run_by_accident(init, tmp_path, capsys):
    """Tool, base and scale must be filled in; the logs have the titles of the robot."""
    text = init({}, words=("--robot", "fanuc_r2000ic"))
    titles = (tmp_path / "data" / "raw" / "mine" / "joints.csv").read_text().split(",")
    for command in (["check", "mine"], ["run", "mine", "--engine", "local"]):
        assert cli._exit_code([*command, "--root", str(tmp_path)]) == 5
        assert "not filled in yet" in capsys.readouterr().err

    assert {"load_point", "P1", "B1", "sigma_n"} <= set(unfilled(text).values())
    assert titles[1:7] == [f"{joint.name}_deg" for joint in load("fanuc_r2000ic").joints]


def test_a_campaign_is_never_written_over(init, tmp_path, capsys):
    """A second `init` is refused if nothing is open, and existing files are unchanged."""
    folder = tmp_path / "data" / "raw" / "mine"
    text = "\n".join(line for line in init(FILES).split("\n") if not re.match("# .* = [?]", line))
    (folder / "campaign.toml").write_text(text)

    assert cli._exit_code(["init", "mine", "--root", str(tmp_path)]) == 2
    assert "has a campaign.toml already: 'pipeline check mine'" in capsys.readouterr().err
    assert (folder / "campaign.toml").read_text() == text
    assert all((folder / name).read_bytes() == data for name, data in FILES.items())


def test_a_second_init_takes_new_files_and_keeps_what_was_filled_in(init, tmp_path):
    """As its own sentences ask for, while campaign.toml is still open."""
    folder = tmp_path / "data" / "raw" / "mine"
    loads = {name: data for name, data in FILES.items() if name != "loads.csv"}
    text = init(loads).replace("# load_point = ?", "load_point = [0.1, 0.2, 0.3] # by hand")
    (folder / "campaign.toml").write_text(text)
    (folder / "loads.csv").write_bytes(FILES["loads.csv"])

    assert cli._exit_code(["init", "mine", "--root", str(tmp_path)]) == 0
    again = (folder / "campaign.toml").read_text()

    assert 'file    = "loads.csv"' not in text
    assert 'file    = "loads.csv"' in again
    assert "load_point = [0.1, 0.2, 0.3]   # by hand" in again


def joined(form):
    """Names that hold group and target, without a column of groups; unknown titles."""
    rows = [row.split(",") for row in FILES["tracker.csv"].decode().splitlines()]
    lines = ["\t".join(["Nom", "X [mm]", "Y [mm]", "Z [mm]"])]
    for group, target, *xyz, _ in rows[1:]:
        parts = re.fullmatch(r"pose(\d+)_rep(\d+)_(\w+)", group)
        values = (str(1e3 * float(x)) for x in xyz) if "x_m" in rows[0] else xyz
        lines.append("\t".join([form(parts and parts.groups(), group, target), *values]))
    return FILES | {"tracker.csv": "\n".join(lines).encode()}


def behind(parts, group, target):
    """The target is last."""
    pose, repeat, state = parts or ("", "", "")
    return f"Pos-{pose}/{state[:2]}{repeat}/{target}" if parts else f"{group}/{target}"


def in_front(parts, group, target):
    """The target is first."""
    pose, repeat, state = parts or ("", "", "")
    return f"{target} Pose {pose} {state} {repeat}" if parts else f"{target} {group}"


def underlined(parts, group, target):
    """The same separator is also within the group."""
    pose, repeat, state = parts or ("", "", "")
    return f"p{pose}_{'on' if state == 'loaded' else 'off'}{repeat}_{target}" if parts else (
        f"{group}_{target}")  # fmt: skip


@pytest.mark.sampled(1)
@pytest.mark.parametrize("form", [behind, in_front, underlined])
def test_names_that_hold_group_and_target_are_parted(init, form):
    """At the separator next to a part with few values that recurs with the others."""
    text = tomllib.loads(init(joined(form)))

    pattern = text["tracker"]["names"]
    found = re.fullmatch(pattern, form(("07", "2", "loaded"), "", "P2"))
    assert found["target"] == "P2"
    assert text["naming"]["measured"] == TRUE["naming"]["measured"]
    assert text["naming"]["chain"] == TRUE["naming"]["chain"]


def test_two_ways_to_part_names_are_asked(init):
    """If distances do not decide, the first or the last part may be the target."""
    places = np.random.default_rng(5).uniform(-900, 900, (24, 3)).round(3).tolist()
    names = [f"{one}-{two}-{three}" for one in "ABC" for two in "RSTU" for three in "PQ"]
    rows = [";".join([name, *map(str, at)]) for name, at in zip(names, places, strict=True)]
    files = {"tracker.csv": "\n".join(["Punkt;X [mm];Y [mm];Z [mm]", *rows]).encode()}
    last, first = "(?P<group>.+)-(?P<target>.+)", "(?P<target>.+?)-(?P<group>.+)"

    assert propose(files).names == (last, first)
    text = init(files)
    assert "names" in unfilled(text).values()
    assert f'# names = ?                 # how names hold group and target: "{last}" or' in text


def test_answers_on_an_export_show_its_names(init, tmp_path):
    """Angles without units leave names open; `--stated` tells them."""
    rows = []
    for line in FILES["tracker.csv"].decode().splitlines()[1:]:
        group, target, *xyz, _ = line.split(",")
        x, y, z = map(float, xyz)
        far = np.linalg.norm([x, y, z])
        turns = np.degrees([np.arctan2(y, x), np.arccos(z / far)])
        rows.append(f"{group}.{target};{far / 1e3:.7f};{turns[0]:.7f};{turns[1]:.7f}")
    raw = "\n".join(["pt;dist;hor;vert", *rows, ""]).encode()
    before = init({**FILES, "tracker.csv": raw})
    stated = tmp_path / "stated.toml"
    stated.write_text('[tracker]\nunit = "m"\nangle = "deg"\nhorizontal = "counter-clockwise"\n')
    folder = tmp_path / "again" / "data" / "raw" / "hall"
    folder.mkdir(parents=True)
    for name, data in (FILES | {"tracker.csv": raw}).items():
        (folder / name).write_bytes(data)

    words = ["init", "hall", "--stated", str(stated), "--root", str(tmp_path / "again")]
    assert cli._exit_code(words) == 0
    after = (folder / "campaign.toml").read_text()
    assert {"unit", "angle"} <= set(unfilled(before).values())
    assert "mm measured" not in before
    left = set(unfilled(after).values())
    assert not {"unit", "angle", "vertical", "horizontal", "names"} & left
    assert set(TRUE["base_frame"]) <= left
    apart = np.linalg.norm(np.subtract(TRUE["tool"]["P1"], TRUE["tool"]["P2"]))
    read = float(re.search(r"P1 to P2: ([0-9.]+) mm measured", after)[1])
    assert abs(read - 1e3 * apart) < 0.5


def test_the_way_to_part_names_that_is_chosen_holds(init, capsys):
    """It is asked by number, and the readings then have groups."""
    rows = [f"{one}-{two}-{three};{k};{k * k % 7};{k * 3 % 11}" for k, (one, two, three) in
            enumerate((a, b, c) for a in "ABC" for b in "RSTU" for c in "PQ")]  # fmt: skip
    files = {"tracker.csv": "\n".join(["Punkt;X [mm];Y [mm];Z [mm]", *rows]).encode()}
    text = init(files, "2", *[""] * 5)

    assert tomllib.loads(text)["tracker"]["names"] == "(?P<target>.+?)-(?P<group>.+)"
    assert "How do names hold group and target?" in capsys.readouterr().err


def test_a_mapping_without_coordinates_is_said_in_our_words(tmp_path, capsys):
    """The number of columns present and required, without internal words."""
    (tmp_path / "campaign.toml").write_text('[tracker.mapping]\ncolumns = { group = "Nom" }\n')
    (tmp_path / "tracker.csv").write_text("Nom;X [mm];Y [mm];Z [mm]\nA;1;2;3\n")
    code = cli._exit_code(["inspect", str(tmp_path / "tracker.csv")])

    assert code == 5
    assert "there are 1 here and at least 3 are needed" in capsys.readouterr().err


def without_chain(form):
    """Differently named groups with the same reflectors, loaded or not."""
    files = foreign(form)
    rows = files["tracker.csv"].decode().splitlines()
    kept = [row for row in rows if not re.search(r";Pl\d;", row)]
    return files | {"tracker.csv": "\n".join([*kept, ""]).encode()}


def french(pose, repeat, state):
    """Numbers after the words."""
    return f"Pos-{pose:02d}/{'sans' if state == 'unloaded' else 'avec'}{repeat or ''}"


def test_words_of_any_language_are_asked(init):
    """After one answer everything is known, as with words that the readings distinguish."""
    files = without_chain(french)
    text = tomllib.loads(init(files, "avez", "sans", *["", "mm"], *[""] * 12))

    assert text["naming"]["states"] == {"sans": "unloaded", "avec": "loaded"}
    assert text["naming"]["measured"] == TRUE["naming"]["measured"]


def test_words_that_nobody_explains_stay_open(init):
    """With everything independent of them, and a line for either way to fill in."""
    text = init(without_chain(french))
    left = unfilled(text)

    assert {"states", "load_point", "P1", *TRUE["base_frame"]} <= set(left.values())
    assert not {"group", "base_frame"} & set(left.values())
    for word, other in (("sans", "avec"), ("avec", "sans")):
        filled = f'states = {{ "{word}" = "unloaded", "{other}" = "loaded" }}'
        assert filled.removeprefix("states = ") in text
        said = tomllib.loads(text.replace("[naming]", f"[naming]\n{filled}"))
        assert re.fullmatch(said["naming"]["group"], "Pos-03/avec2")["repeat"] == "2"


def test_words_of_groups_without_a_target_in_common_are_no_states():
    """Base reflectors that were read as often as the poses."""
    both = {"Halle": "BCD", "Arm": "PQR"}.items()
    rows = [
        f"{word} {k};{name};{k}.5;2.5;1.5" for k in range(6) for word, some in both for name in some
    ]
    said = propose(
        {"tracker.csv": "\n".join(["Gruppe;Punkt;X [mm];Y [mm];Z [mm]", *rows]).encode()}
    )

    assert said.groups
    assert not said.either


def test_a_base_that_nobody_knows_is_said(init, capsys):
    """Readings are then assumed to be in the robot's frame."""
    files = without_chain(german)
    rows = [row for row in files["tracker.csv"].decode().splitlines() if row.startswith("Pose")]
    text = init(files | {"tracker.csv": "\n".join([*rows, ""]).encode()})

    assert "without them readings are taken to be in F_b" in text
    assert "without [base_frame] readings are taken to be in F_b" in capsys.readouterr().err


def by_controller(change, titles=None):
    """The joint log as from a controller: a remark, times, titles of its own."""
    head, *rows = [row.split(",") for row in FILES["joints.csv"].decode().splitlines()]
    assert head[:2] == ["pose", "r1_m"]
    titles = titles or [f"q_{k}" for k in range(1, 8)]
    lines = ["# log of task T_ROB1, its q", ";".join(["pos", "timestamp", *titles])]
    robot = load("kr500_rail")
    for k, (pose, *own) in enumerate(rows):
        q = from_log_units(robot, np.array(own[:7], float)) - robot.controller_offset
        rail, *turned = np.linalg.solve(robot.controller_matrix, q).tolist()
        cells = change([f"{one:.6f}" for one in [*np.rad2deg(turned), rail]], k)
        lines.append(";".join([pose, f"2026-11-03 08:{k:02d}:00", *cells]))
    return FILES | {"joints.csv": "\n".join([*lines, ""]).encode()}


def test_a_joint_log_is_known_by_its_numbers(init):
    """With the rail after the joints; limits imply degrees, but not the rail's unit."""
    files = by_controller(lambda cells, _: cells)
    said = propose(files)
    text = init(files, words=("--robot", "kr500_rail"))

    assert said.joints == "joints.csv"
    assert {"kr500_rail"} <= set(said.robots) <= {"kr500_rail", "kr500_rail_kuka"}
    assert '"q_6" = "A6_deg"' in text
    assert '# "q_7" = ?   # E1_m or E1_mm or E1_in: the title states no unit' in text
    assert not said.refused


def test_numbers_that_no_robot_can_take_are_no_joint_log():
    """One pose beyond the limits, an additional column, or titles counted backwards."""
    far = by_controller(lambda cells, k: [*cells[:-1], "95000"] if k == 1 else cells)
    more = [f"q_{k}" for k in range(1, 8)] + ["speed"]
    many = by_controller(lambda cells, k: [*cells, str(100 + k)], more)
    back = by_controller(lambda cells, _: cells, [f"a_{k}" for k in range(7, 0, -1)])

    for files in (far, many, back):
        assert propose(files).joints is None


def test_inspect_proposes_joints_for_the_robot_of_the_campaign(tmp_path, capsys):
    """By their names there, in the unit of their titles; never coordinates."""
    titles = "Position;Horodatage;" + ";".join(f"Axe {k} [rad]" for k in range(1, 7))
    rows = [f"{k};2026-11-17 08:0{k}:00;-0.99;-0.17;0.2{k};-2.4;0.38;1.3{k}" for k in range(1, 6)]
    (tmp_path / "abb.csv").write_text("\n".join(["# ABB IRC5 log, T_ROB1", titles, *rows, ""]))
    code = cli._exit_code(["inspect", str(tmp_path / "abb.csv")])
    alone = capsys.readouterr().out
    (tmp_path / "campaign.toml").write_text('robot = "irb6640"\n')
    cli._exit_code(["inspect", str(tmp_path / "abb.csv")])
    named_robot = capsys.readouterr().out

    assert code == 0
    assert "joints as fanuc_m20ia calls them: name the robot in campaign.toml" in alone
    assert tomllib.loads(named_robot.partition("\n\n")[2])["joints"]["columns"] == {
        "Position": "pose", **{f"Axe {k} [rad]": f"joint_{k}_rad" for k in range(1, 7)}
    }  # fmt: skip


def loads_of(title, cells):
    """The log with another load in each row."""
    rows = [row.split(",")[:2] for row in FILES["loads.csv"].decode().splitlines()[1:]]
    lines = [",".join(["pose", "repeat", *title])]
    lines += [",".join([*row, *cells]) for row in rows]
    return FILES | {"loads.csv": "\n".join([*lines, ""]).encode()}


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("files", "asked"),
    [
        (loads_of(["force_n"], ["500"]), {"sigma_n"}),
        (loads_of(["mass_kg"], ["60"]), {"mass_sigma_kg"}),
        (loads_of(["mass_kg", "mass_sigma_kg"], ["60", "0.01"]), set()),
        (loads_of(["payload"], ["box"]), set()),
    ],
)
def test_only_the_uncertainty_of_what_loads_is_asked(init, files, asked):
    """That of a scale, of a weight, or none if the log or [payload] states it."""
    text = init(files)

    assert {"sigma_n", "mass_sigma_kg"} & set(unfilled(text).values()) == asked
    assert ("gain_sigma" in text) == ("sigma_n" in asked)


def test_the_uncertainty_of_weights_is_asked_and_used(init):
    """It holds for the rows without their own."""
    files = loads_of(["mass_kg", "mass_sigma_kg"], ["60", ""])
    lines = files["loads.csv"].decode().splitlines()
    files |= {"loads.csv": "\n".join([*lines[:-1], lines[-1] + "0.5", ""]).encode()}
    toml = tomllib.loads(init(files, "kr500_rail", "", "", "20 g", *[""] * 9))
    scale = MADE["campaign.toml"].decode().replace("[scale]", "[scale]\nmass_sigma_kg = 0.02")
    raw = in_memory(files | {"campaign.toml": scale.encode()})
    sigma = ingest(raw.settings, raw.robot, raw.files).loads["mass_sigma_kg"].to_pylist()

    assert toml["scale"] == {"file": "loads.csv", "mass_sigma_kg": 0.02}
    assert sigma == [0.02] * (len(lines) - 2) + [0.5]
