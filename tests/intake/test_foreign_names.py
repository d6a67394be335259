"""The demo campaign as others would write it: names, marks, times and tables."""

import re
from datetime import datetime
from pathlib import Path

import pytest
from pandas.testing import assert_frame_equal
from workbooks import workbook

from pipeline import readers
from pipeline.base.errors import InputError
from pipeline.intake._group_names import Group, states_of, ways_to_read
from pipeline.intake.files import propose
from pipeline.intake.log_columns import may_be_log, understood_loads
from pipeline.machine.robot import load
from pipeline.readers import logs
from pipeline.readers.export_settings import LogForm
from pipeline.reduction._raw_readings import gather
from pipeline.reduction.ingest import ingest
from pipeline.reduction.settings import parse
from pipeline.run import campaign_answer
from pipeline.store.campaign import dump, in_memory

DEMO = Path(__file__).parents[2] / "data/raw/kr500_demo"
OURS = {path.name: path.read_text("utf-8") for path in sorted(DEMO.iterdir())}
NAMES = {"P1": "M1", "P2": "M2", "P3": "M3", "Pl1": "K1", "Pl2": "K2"}
"""Names of their reflectors."""
GROUP = re.compile(r"pose(\d+)_rep(\d+)_(unloaded|loaded)")
NAMING = """[naming]
group = "Pose (?P<pose>[0-9]+) (?P<state>leer|Last) ?(?P<repeat>[0-9]*)"
states = { leer = "unloaded", Last = "loaded" }
measured = ["M1", "M2", "M3"]
chain = ["K1", "K2"]
"""
LOADS = {"Pose": "pose", "Zug": "repeat", "Kraft [N]": "force_N", "Richtung": "branch"}
JOINTS = {"Pose": "pose", "Bahn [m]": "r1_m", "Anfahrt": "approach"} | {
    f"Winkel {k} [°]": f"theta{k}_deg" for k in range(2, 8)
}


def table(text):
    """Header and rows of one of our files."""
    header, *rows = [line.split(",") for line in text.splitlines()]
    return header, rows


def group(name):
    """Their name of a group; the pulls of a pose are counted, not numbered."""
    found = GROUP.fullmatch(name)
    if not found:
        return f"Basis {name.removeprefix('base_')}"
    pose, repeat, state = found.groups()
    word = {"loaded": "Last", "unloaded": "leer"}[state]
    return f"Pose {int(pose)} {word}" + (f" {repeat}" if int(repeat) > 1 else "")


def settings(text, tracker, loads, joints, mapping=""):
    """campaign.toml for their files."""
    text = re.sub(r"\[naming\]\n.*\n.*\n", lambda _: NAMING, text)
    for ours, theirs in NAMES.items():
        text = re.sub(rf"^{ours} = ", f"{theirs} = ", text, flags=re.MULTILINE)
    text = text.replace('"tracker.csv"', f'"{tracker}"').replace('"loads.csv"', f'"{loads}"')
    text = text.replace('file = "joints.csv"', f'file = "{joints}"')
    maps = {"scale": LOADS, "joints": JOINTS}
    columns = (
        "\n".join([f"[{of}.columns]", *(f'"{a}" = "{b}"' for a, b in names.items()), ""])
        for of, names in maps.items()
    )
    return "\n".join([text, mapping, *columns])


def sheets():
    """Their three tables, cells as text with decimal points: tracker, loads and joints."""
    _, readings = table(OURS["tracker.csv"])
    tracker = [["Gruppe", "Punkt", "X [mm]", "Y [mm]", "Z [mm]", "Zeit"]]
    for name, target, x, y, z, time in readings:
        tracker.append([group(name), NAMES.get(target, target), x, y, z, time])
    loads = [list(LOADS), *table(OURS["loads.csv"])[1]]
    angles = [f"Winkel {k} [°]" for k in range(2, 8)]
    joints = [["Pose", "Bahn [m]", *angles, "Anfahrt"], *table(OURS["joints.csv"])[1]]
    return tracker, loads, joints


MAPPING = """[tracker.mapping]
columns = { group = "Gruppe", target = "Punkt", x = "X [mm]", y = "Y [mm]", z = "Z [mm]", \
time = "Zeit" }
"""


def german():
    """Semicolons, decimal commas, dd.mm.yyyy, Windows encoding and line ends."""

    def cell(text):
        if re.fullmatch(r"-?\d+\.\d+", text):
            return text.replace(".", ",")
        if re.fullmatch(r"\d{4}-\d\d-\d\dT.*", text):
            return f"{datetime.fromisoformat(text):%d.%m.%Y %H:%M:%S}"
        return text

    files = {
        name: "\r\n".join([*(";".join(map(cell, row)) for row in rows), ""]).encode("cp1252")
        for name, rows in zip(("messung.csv", "kraft.csv", "achsen.csv"), sheets(), strict=True)
    }
    toml = settings(OURS["campaign.toml"], *files, MAPPING)
    return files | {"campaign.toml": toml.encode()}


def ingested(files):
    """The tables of a campaign, without the places of their rows."""
    raw = in_memory(files)
    got = ingest(raw.settings, raw.robot, raw.files)
    assert got.rejected.num_rows == 0
    tables = {name: getattr(got, name).to_pandas() for name in ("readings", "loads", "joints")}
    names = ["file", "group", "target"]
    return {name: table.drop(columns=names, errors="ignore") for name, table in tables.items()}


def demo():
    return {name: text.encode() for name, text in OURS.items()}


def by_number(zero="0", first=None):
    """Groups 001, 002, ...; only the log of the loads, where they are 1, 2, ..., says what each is.

    Args:
        zero: What it shows of the force of an unloaded state.
        first: What it shows of that of the first pull; None as it was.
    """
    (header, *readings), (_, loads) = sheets()[0], table(OURS["loads.csv"])
    names = [name for name, *_ in table(OURS["tracker.csv"])[1]]
    number = {name: str(k) for k, name in enumerate(dict.fromkeys(names), 1)}
    tracker = [
        [f"{int(number[name]):03d}", *row[1:]] for name, row in zip(names, readings, strict=True)
    ]
    force = {tuple(map(int, row[:2])): row[2:] for row in loads}
    listed = [["Number", "Pose", "Force (N)", "Branch"]]
    for name, k in number.items():
        if found := GROUP.fullmatch(name):
            pose, repeat, state = int(found[1]), int(found[2]), found[3]
            said = force[pose, repeat] if state == "loaded" else [zero, ""]
            listed.append([k, str(pose), *said])
        else:
            listed.append([k, "", "", ""])
    if first is not None:
        listed[3][2] = first
    rows = {"messung.csv": [header, *tracker], "kraft.csv": listed, "achsen.csv": sheets()[2]}
    files = {name: "\n".join([*map(";".join, of), ""]).encode() for name, of in rows.items()}
    toml = settings(OURS["campaign.toml"], *files, MAPPING)
    toml = re.sub(r'"Pose" = "pose"\n"Zug".*\n.*\n"Richtung"', '"Number" = "group"\n"Branch"', toml)
    return files | {"campaign.toml": toml.encode()}


@pytest.mark.parametrize("form", ["german", "excel", "blanks"])
def test_the_same_campaign_in_their_form_is_the_same_campaign(form):
    """Tables after reading are equal to the last digit, whatever names, marks and times."""
    ours, others = ingested(demo()), ingested(globals()[form]())

    for name, table in ours.items():
        assert_frame_equal(others[name], table, check_exact=True)


@pytest.mark.parametrize("shown", ["0", "0.00", ""])
def test_a_log_may_say_what_the_groups_are(shown):
    """Readings, pulls and poses equal those with descriptive names; zeros are counted."""
    ours, others = ingested(demo()), ingested(by_number(shown))
    zero = ours["readings"]["state"] == "unloaded"
    for tables in (ours, others):
        tables["readings"].loc[zero, "repeat"] = (
            tables["readings"].loc[zero, "repeat"].clip(upper=1)
        )

    for name, table in ours.items():
        left = table.drop(columns="line", errors="ignore")
        assert_frame_equal(others[name][left.columns], left, check_exact=True)


@pytest.mark.parametrize("shown", ["0", ""])
def test_a_pull_without_its_force_is_no_zero(shown):
    """The chain was read in it; the line of the log is named."""
    with pytest.raises(InputError, match=r"kraft.csv:4: group 003 has no force here, and K1 was"):
        ingested(by_number(first=shown))


@pytest.mark.parametrize(
    ("rows", "read"),
    [
        ("1,0\n1,500\n1,250\n2,0\n2,300\n", [(1, 1, 500), (1, 2, 250), (2, 1, 300)]),
        ("1,500\n1,0\n2,300\n2,0\n", [(1, 1, 500), (2, 1, 300)]),
        ("1,500\n1,250\n1,0\n2,300\n", [(1, 1, 500), (1, 2, 250), (2, 1, 300)]),
    ],
)
def test_a_row_of_the_unloaded_state_is_no_pull(rows, read):
    """If every pose has one, or if no other pull of its pose follows."""
    assert load_log(f"pose,force_n\n{rows}") == read


def test_a_force_of_zero_that_may_be_a_pull_is_refused():
    """Only some poses have one: the pulls after it would get the wrong forces."""
    with pytest.raises(
        InputError, match=r"loads.csv:2: without a column repeat it is ambiguous wh.*"
    ):
        load_log("pose,force_n\n1,0\n1,500\n2,300\n")


@pytest.mark.parametrize(
    ("up", "down"), [("auf", "ab"), ("Belasten", "Entlasten"), ("loading", "unloading"),
                     ("hin", "zurück"), ("up", "DOWN")],
)  # fmt: skip
def test_the_way_of_the_turnbuckle_may_have_their_words(up, down):
    """The tables have our words; an unknown word costs its row."""
    text = f"pose,repeat,force_n,branch\n1,1,500,{up}\n1,2,200,{down}\n1,3,100,\n1,4,90,links\n"
    log = logs.loads("loads.csv", text.encode())

    assert log.word["branch"].tolist() == ["up", "down", ""]
    assert [line for _, line, _ in log.rejected] == [5]


def load_log(text, said=None):
    """Pose, repeat and force [N] of each row of loads.csv."""
    log = logs.loads("loads.csv", text.encode(), LogForm(**(said or {})))
    numbers = (log.number[name].tolist() for name in ("pose", "repeat", "force"))
    return list(zip(*numbers, strict=True))


@pytest.mark.parametrize(
    ("title", "factor"),
    [
        ("force_kg", 9.80665),
        ("force [kp]", 9.80665),
        ("Force (kN)", 1e3),
        ("force_daN", 10.0),
        ('"force [N]"', 1.0),
    ],
)
def test_a_scale_shows_what_its_title_says(title, factor):
    """Kilograms on a scale are kilogram-force, a decanewton is ten newtons."""
    assert load_log(f"pose;repeat;{title}\n1;1;50,5\n") == [(1, 1, pytest.approx(50.5 * factor))]


def test_axes_of_the_controller_may_have_their_units_in_brackets():
    """`A1 [°]` is `A1_deg`, and a rail read in millimetres moves in metres."""
    robot = load("kr500_rail")
    titles = ["E1", *(f"A{k}" for k in range(1, 7))]
    values = "7;1234,5;10;20;-30;40;50;-60\n"
    short = ";".join(["pose", *(f"{t}_{'mm' if t == 'E1' else 'deg'}" for t in titles)])
    long = ";".join(["Pose", *(f"{t} ({'mm' if t == 'E1' else '°'})" for t in titles)])
    ours, others = (
        logs.joints("j.csv", f"{header}\n{values}".encode(), robot) for header in (short, long)
    )

    assert others.number["r1"].tolist() == [pytest.approx(1.2345)]
    for name, column in ours.number.items():
        assert others.number[name].tolist() == column.tolist(), name


@pytest.mark.parametrize(
    ("title", "metres"), [("E1 [in]", 0.0254), ("E1_in", 0.0254), ("E1 (mm)", 1e-3)]
)
def test_a_rail_may_be_read_in_inches(title, metres):
    """Or in millimetres; an inch is 25.4 mm."""
    titles = ["pose", title, *(f"A{k}_deg" for k in range(1, 7))]
    log = logs.joints(
        "j.csv", f"{';'.join(titles)}\n7;40;0;0;0;0;0;0\n".encode(), load("kr500_rail")
    )

    assert log.number["r1"].tolist() == [pytest.approx(40 * metres, rel=1e-15)]


def test_pulls_without_numbers_are_counted():
    """Rows of each pose in order, if the log has no column for them."""
    assert load_log("pose,force_n\n1,500\n2,300\n1,250\n") == [
        (1, 1, 500),
        (2, 1, 300),
        (1, 2, 250),
    ]


def test_a_pull_that_cannot_be_read_is_not_counted_past():
    """Every later pull of its pose would get the force of another."""
    with pytest.raises(InputError, match=r"loads.csv:2: without a column repeat it is ambiguous"):
        load_log("pose,force_n\n1,5oo\n1,250\n1,260\n")


def test_titles_may_stand_below_remarks():
    """Lines above the titles are skipped; a data row there is not."""
    text = "Waage 12;;\nKraft in der Kette;;\n\npose;repeat;force_n\n1;1;500,5\n"
    log = logs.loads("loads.csv", ("7;1;100\n" + text).encode())

    assert log.number["force"].tolist() == [500.5]
    assert [(line, why.partition(";")[0]) for _, line, why in log.rejected] == [
        (1, "the row is above the header")
    ]


def test_blanks_separate_cells_of_a_log():
    """Any number of blanks counts as one, also before the first cell."""
    assert load_log("  pose repeat   force_n\n 1   1    500,5\n") == [(1, 1, 500.5)]


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("pose,repeat,force\n,,N\n1,1,500.5\n", {}),
        ("Export\npose;repeat;force_n\n[-];[-];[N]\n1;1;500.5\n", {}),
        ("pose repeat Kraft\n- - kN\n1 1 0.5005\n", {"Kraft": "force_kn"}),
        ("pose;repeat;force [daN];remark\n;;[daN];\n1;1;50.05;good\n", {}),
    ],
)
def test_a_line_of_units_below_the_titles_belongs_to_them(text, columns):
    """It is not a data row, and states the unit of the title above it."""
    log = logs.loads("loads.csv", text.encode(), LogForm(columns=columns))

    assert log.number["force"].tolist() == [pytest.approx(500.5)]
    assert log.rejected == ()


def test_a_line_of_units_contradicts_as_a_title_does():
    """And a row of numbers below the titles stays a data row."""
    with pytest.raises(InputError, match=r'calls "Kraft" force_n, and the title says \[kn\]'):
        load_log("pose,repeat,Kraft\n,,kN\n1,1,0.5\n", {"columns": {"Kraft": "force_n"}})
    assert load_log("pose,repeat,force_n\n1,1,500\n2,1,\n") == [(1, 1, 500.0)]


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"Kraft": "force_n"}, r'loads.csv:1: there is no column "Kraft" among pose, repeat, last'),
        ({"Last [t]": "force_t"}, r'campaign.toml: \[scale.columns\] calls "Last .t." force_t'),
        ({"repeat": "pose"}, r"loads.csv:1: there are two columns pose"),
        ({}, r"loads.csv:1: there is no column force_n .*; add it .* in \[scale.columns\]"),
    ],
)
def test_a_mapping_that_does_not_fit_is_refused(columns, said):
    """With the title, the existing ones, and where to write it."""
    with pytest.raises(InputError, match=said):
        load_log("pose,repeat,Last [t]\n1,1,0.05\n", {"columns": columns})


@pytest.mark.parametrize("twin", ["force_n\u200b", "\u202eforce_n", "ｆｏｒｃｅ_ｎ"])
def test_two_titles_that_look_alike_are_one_title_twice(twin):
    """With invisible letters or in full width: nobody could see which of them was read."""
    with pytest.raises(
        InputError, match=r"loads.csv:1: there are two columns .*; remove or rename"
    ):
        load_log(f"pose,repeat,force_n,{twin}\n1,1,500,900\n", {})


def test_what_is_said_of_a_title_holds_with_its_unit():
    """`Kraft` is `Kraft [kg]`; a contradicting unit is trusted if written out."""
    text = "pose;Zug Nr. (heute);Kraft [kg]\n1;1;50,5\n"
    pull = {"Zug Nr.": "repeat"}

    assert load_log(text, {"columns": pull | {"Kraft": "force_kg"}})[0][2] == 50.5 * 9.80665
    assert load_log(text, {"columns": pull | {"Kraft [kg]": "force_n"}})[0][2] == 50.5
    with pytest.raises(InputError, match=r'calls "Kraft" force_n, and the title says \[kg\]; corr'):
        load_log(text, {"columns": pull | {"Kraft": "force_n"}})


def test_a_comma_that_may_be_two_things_is_asked_of_the_log():
    """In its own table of campaign.toml."""
    text = "pose;repeat;force_n\n1;1;1,234\n"

    with pytest.raises(InputError, match=r'decimal = ".+" in \[scale\] of campaign.toml'):
        load_log(text)
    assert load_log(text, {"decimal": ","}) == [(1, 1, 1.234)]


def read_states(groups, naming):
    """Pose, repeat and state read from group names."""
    rows = "".join(f"{name},P1,1,2,{k}\n" for k, name in enumerate(groups))
    export = readers.read("t.csv", f"group,target,x_m,y_m,z_m\n{rows}".encode())
    shots = gather({"t.csv": export}, parse(OURS["campaign.toml"].replace("[naming]", naming)))
    return [(int(shots.pose[k]), int(shots.repeat[k]), bool(shots.loaded[k])) for k in shots.slot]


@pytest.mark.parametrize(
    ("groups", "read"),
    [
        (["P 1 leer", "P 1 Last"], [(1, 0, False), (1, 1, True)]),
        (["P 1 Last", "P 1 Last 2", "P 1 leer"], [(1, 1, True), (1, 2, True), (1, 0, False)]),
        (["P 1 Last 1", "P 1 last"], [(1, 1, True), (1, 2, True)]),
        (["P 1 leer", "P 1 Last", "P 1 LEER"], [(1, 0, False), (1, 1, True), (1, 1, False)]),
        (["P 1 loaded 4", "P 2 Last"], [(1, 4, True), (2, 1, True)]),
    ],
)
def test_groups_without_numbers_are_counted(groups, read):
    """0 unloaded and 1, 2, ... loaded, skipping numbers of other groups of the pose."""
    naming = """[naming]
group = "P (?P<pose>[0-9]+) (?P<state>[A-Za-z]+) ?(?P<repeat>[0-9]*)"
states = { leer = "unloaded", Last = "loaded" }"""

    assert read_states(groups, naming) == read


def test_a_state_nobody_knows_is_refused_with_those_that_are():
    """And with the line to write."""
    naming = """[naming]
group = "P (?P<pose>[0-9]+) (?P<state>[a-z]+)"
states = { leer = "unloaded" }"""

    with pytest.raises(InputError, match=r'state "voll" from group "P 1 voll"; .* leer, or write '
                                         r'states = { "voll" = "loaded" }'):  # fmt: skip
        read_states(["P 1 leer", "P 1 voll"], naming)


def test_a_word_is_one_state():
    """Upper and lower case do not distinguish states."""
    states = '[naming]\nstates = { Last = "loaded", last = "unloaded" }'

    with pytest.raises(InputError, match='states has "Last" for unloaded and for loaded'):
        parse(OURS["campaign.toml"].replace("[naming]", states))


def typed(cell):
    """Text as a number or a time, if it is one."""
    if re.fullmatch(r"-?\d+(\.\d+)?", cell):
        return float(cell) if "." in cell else int(cell)
    return datetime.fromisoformat(cell) if re.fullmatch(r"\d{4}-\d\d-\d\dT.*", cell) else cell


def excel():
    """One workbook for each, with a sheet of remarks and an empty one."""
    notes = [["Roboter", "KR 500"], ["Messung", "gut"]]
    names = ("messung.xlsx", "kraft.xlsx", "achsen.xlsx")
    files = {
        name: workbook(Notizen=notes, Werte=[list(map(typed, row)) for row in rows], Leer=[])
        for name, rows in zip(names, sheets(), strict=True)
    }
    toml = settings(OURS["campaign.toml"], *files, MAPPING)
    return files | {"campaign.toml": toml.encode()}


def blanks():
    """Blanks between cells, and titles without any."""

    def line(row):
        return "   ".join(cell.replace(" ", "_") for cell in row)

    files = {
        name: "\n".join([*map(line, rows), ""]).encode()
        for name, rows in zip(("messung.txt", "kraft.txt", "achsen.txt"), sheets(), strict=True)
    }
    toml = settings(OURS["campaign.toml"], *files, MAPPING.replace("]\n", ']\ndelimiter = " "\n'))
    toml = toml.replace("(?P<pose>[0-9]+) ", "(?P<pose>[0-9]+)_").replace('"Pose (', '"Pose_(')
    toml = toml.replace("leer|Last) ?", "leer|Last)_?")
    mapped = re.sub(r'"([^"\n]*[\[°][^"\n]*)"', lambda one: one[0].replace(" ", "_"), toml)
    return files | {"campaign.toml": mapped.encode()}


def answer(files):
    """result.json of a campaign without the file details, and with our names."""
    content = campaign_answer("demo", in_memory(files)).answer.as_json()
    assert {entry["file"] for entry in content.pop("inputs")} == {*files}
    said = dump(content).decode()
    for theirs, ours in FILES.items():
        said = said.replace(theirs, ours)
    groups = {group(name): name for name, *_ in table(OURS["tracker.csv"])[1]}
    for theirs, ours in sorted(groups.items(), key=lambda pair: -len(pair[0])):
        for word in (theirs, theirs.replace(" ", "_")):
            said = re.sub(rf"{word}(?=[/,])", ours, said)
    for ours, theirs in NAMES.items():
        said = re.sub(rf"\b{theirs}\b", ours, said)
    return said


FILES = {
    f"{theirs}.{end}": f"{ours}.csv"
    for theirs, ours in {"messung": "tracker", "kraft": "loads", "achsen": "joints"}.items()
    for end in ("csv", "txt", "xlsx")
}


@pytest.mark.slow
def test_their_campaign_has_our_answer():
    """In all three forms, letter for letter, once names are ours again."""
    ours = answer(demo())

    for form in (german, excel, blanks):
        assert answer(form()) == ours, form.__name__


def test_a_column_of_times_may_be_called_time():
    """In both logs, whatever its title; a remark above unknown titles is no title."""
    text = "# taken by night\nNr;Uhrzeit;Kraft\n1;2026-11-17 08:00:00;500\n"

    with pytest.raises(InputError, match="no column pose among nr, uhrzeit, kraft"):
        load_log(text)
    called = {"Nr": "pose", "Uhrzeit": "time", "Kraft": "force_n"}
    assert load_log(text, {"columns": called}) == [(1, 1, 500.0)]


def test_a_state_without_a_word_is_asked_for_and_can_be_written():
    """`P07` beside `P07-L1`: which is unloaded is unknown; campaign.toml may say so."""
    names = ["P07", "P07-L1", "P07-L2", "P08", "P08-L1", "base_start"]
    written = Group(r"P(?P<pose>[0-9]+)(?P<state>(?:-L)?)(?P<repeat>[0-9]*)", ("", "-L"))
    states = states_of(names, written)

    assert ways_to_read({name: {"P1": [0.0]} for name in names}) == ()
    assert {name for name in names if states.get(name) == "unloaded"} == {"P07", "P08"}
    assert {name for name in names if states.get(name) == "loaded"} == {
        "P07-L1",
        "P07-L2",
        "P08-L1",
    }


@pytest.mark.parametrize(
    ("unloaded", "loaded", "repeat"),
    [
        ("Stellung {} - ohne Last", "Stellung {} - Zug {}", 2),
        ("pos {} no load", "pos {} pull {}", 2),
        ("posture {} à vide 1", "posture {} traction {}", 1),
    ],
)
def test_a_state_of_two_words_is_read_like_one_of_one(unloaded, loaded, repeat):
    """Whether its pulls are numbered or not; the ends of the chain are read under load only."""
    free, pulled = {"P1": [0.0]}, {"P1": [0.0], "Pl1": [1.0]}
    rows = {"Basis": {"B1": [2.0]}}
    for pose in range(1, 5):
        rows |= {unloaded.format(pose): free}
        rows |= {loaded.format(pose, k): pulled for k in range(1, 4)}

    (way,) = ways_to_read(rows)

    states = states_of(list(rows), way)
    assert states == {
        name: "unloaded" if here is free else "loaded"
        for name, here in rows.items()
        if name != "Basis"
    }
    assert re.fullmatch(way.pattern, loaded.format(3, repeat))["repeat"] == str(repeat)


@pytest.mark.parametrize(
    ("title", "force"),
    [("LBS", 100 * 4.4482216152605), ("kN", 1e5), ("daN", 1e3), ("N", None), ("kg", None)],
)
def test_a_column_called_by_a_unit_of_forces_is_the_force(title, force):
    """`N` may number something, and kilograms may be a mass."""
    log = f"POS,PULL,{title}\n1,1,100\n1,2,100.5\n2,1,99.5\n".encode()

    form = understood_loads("log.csv", log)

    if force is None:
        assert form is None
    else:
        assert load_log(log.decode(), {"columns": form.columns})[0][2] == pytest.approx(force)


LBF = 4.4482216152605
"""A pound-force [N] by the international pound and standard gravity."""


@pytest.mark.parametrize(
    ("head", "rows", "newton"),
    [
        ("Cell 12,,,\nPose,Pull 1 (lbf),Pull 2 (lbf)", ["1,{},{}", "2,{},{}"], LBF),
        ("Stellung;Stufe 1 [N];Stufe 2 [N];Bemerkung", ["1;{};{};gut", "2;{};{};"], 1.0),
        ("No;F1 in kN;F2 in kN", ["1;{};{}", "2;{};{}"], 1e3),
        ("pose,force_1_n,force_2_n", ["1,{},{}", "2,{},{}"], 1.0),
        ("Palier 1 (daN)\tPalier 2 (daN)\tposition", ["{}\t{}\t1", "{}\t{}\t2"], 10.0),
    ],
)
@pytest.mark.parametrize("gap", [(), (1, 1)])
def test_forces_of_a_pose_in_one_row_are_its_pulls(head, rows, newton, gap):
    """As in a table of one row a pull; an empty cell is a pull that was not made."""
    forces = [[200.5, 401.25], [198.5, 0.75]]
    shown = [["" if (k, n) == gap else one for n, one in enumerate(row)]
             for k, row in enumerate(forces)]  # fmt: skip
    log = "\n".join([head, *(row.format(*two) for row, two in zip(rows, shown, strict=True)), ""])

    form = understood_loads("log.csv", log.encode())
    read = logs.loads("log.csv", log.encode(), form)

    found = zip(*(read.number[name] for name in ("pose", "repeat", "force")), strict=True)
    expected = [(k + 1.0, n + 1.0, forces[k][n] * newton) for k in (0, 1) for n in (0, 1)
                if (k, n) != gap]  # fmt: skip
    assert [*found] == [pytest.approx(one) for one in expected]
    assert not read.rejected
    assert may_be_log("log.csv", log.encode())


def test_a_row_without_any_force_is_rejected_with_its_line():
    """It is not lost: the pose was measured, and nobody wrote its forces down."""
    log = b"pose,force_1_n,force_2_n\n1,200,400\n2,,\n"

    read = logs.loads("log.csv", log)

    assert [*read.number["pose"]] == [1.0, 1.0]
    ((_, line, reason),) = read.rejected
    assert line == 3
    assert "has no force" in reason


def test_columns_of_pulls_beside_a_column_repeat_are_not_both_right():
    """One row cannot be one pull and several."""
    log = b"pose,repeat,force_1_n,force_2_n\n1,1,200,400\n"

    (row,) = logs.loads("log.csv", log).rejected
    assert "repeat beside one column a pull" in row[2]


def test_columns_in_a_unit_of_force_are_no_coordinates():
    """Whatever else they are called: three numbers a row alone do not make a point."""
    table = b"item,A (lbf),B (lbf),C (lbf)\nP1,197.1,378.2,549.4\nP2,188.4,388.8,525.8\n"

    said = propose({"table.csv": table})

    assert said.exports == ()
    assert "hold no three coordinates" in said.refused["table.csv"]
