"""Names in collections, groups, files and folders: which is the pose, which is the state."""

import csv
import io
import re
import tomllib
from collections import defaultdict
from functools import partial

import pytest

from pipeline.app import cli
from pipeline.intake._group_names import states_of, ways_to_read
from pipeline.intake.files import propose
from pipeline.reduction.ingest import ingest
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

FILES = simulate(Plan()).files
FILES["tracker.csv"] = re.sub(rb"(?m)^pose(0[7-9]|1).*\n", b"", FILES["tracker.csv"])
ROWS = [*csv.DictReader(io.StringIO(FILES["tracker.csv"].decode()))]
HEAD = "// SpatialAnalyzer export\n// Cartesian, Units: Millimeters"


def parts(group):
    """pose05_rep2_loaded -> 05, Pull2; unloaded ones Zero, and Zero_after at the end."""
    found = re.fullmatch(r"pose(\d+)_rep(\d+)_(\w+)", group)
    if not found:
        return "Datums", group.partition("_")[2].title()
    pose, repeat, state = found.groups()
    return pose, f"Pull{repeat}" if state == "loaded" else "Zero" + "_after" * (repeat != "0")


def lines(rows, name):
    """Rows of a SpatialAnalyzer export, by the name that each has."""
    xyz = [",".join(row[f"{axis}_mm"] for axis in "xyz") for row in rows]
    return "\n".join([HEAD, *(f"{name(r)},{at}" for r, at in zip(rows, xyz, strict=True)), ""])


def joined(form):
    """One file, in which names have this form."""

    def named(row):
        pose, state = parts(row["group"])
        called = f"Pose {pose}" if pose.isdigit() else pose
        return form.format(pose=called, number=pose, state=state, target=row["target"])

    return {"sa.txt": lines(ROWS, named)}


def each(where, name):
    """A file for each pose or group."""
    files = defaultdict(list)
    for row in ROWS:
        pose, state = parts(row["group"])
        called = f"Pose{pose}" if pose.isdigit() else pose
        files[where.format(pose=called, state=state)].append(row)
    named = partial(name_in_file, name)
    return {file: lines(rows, partial(named, file)) for file, rows in files.items()}


def name_in_file(form, file, row):
    return form.format(file=file, state=parts(row["group"])[1], target=row["target"])


def by_folder(folder):
    """A file for each group with the targets alone, in a folder for each pose."""
    made = each(folder + "/{state}.txt", "{target}")
    return {file: text.replace(HEAD, "Point,X (mm),Y (mm),Z (mm)") for file, text in made.items()}


def short(row):
    """05-2, 05-0 and 05-0R."""
    pose, state = parts(row["group"])
    if not pose.isdigit():
        return f"BASE-{state[0]}"
    return f"{pose}-{state.replace('Zero_after', '0R').replace('Zero', '0')[-2:].strip('l')}"


def assigned(files):
    """Pose, pull, state and target of every reading; unloaded ones have no pull."""
    raw = in_memory(files)
    read = ingest(raw.settings, raw.robot, raw.files).readings
    rows = read.select(["pose", "repeat", "state", "target"]).to_pylist()
    return sorted(
        str({**row, "repeat": row["state"] == "loaded" and row["repeat"]}) for row in rows
    )


OURS = assigned(FILES)
FORMS = {
    "a collection of each pose in a file of its own": lambda: each(
        "SA/{pose}.txt", "Collection {file}::{state}::{target}"
    ),
    "a collection of all": lambda: joined("A::{pose}::{state}::{target}"),
    "the state above the pose": lambda: joined("{state}::{pose}::{target}"),
    "a folder for each pose": lambda: by_folder("{pose}"),
    "a group for each state in the file of the pose": lambda: each(
        "{pose}.txt", "{state}::{target}"
    ),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("form", FORMS)
def test_the_level_of_the_pose_is_found_and_the_campaign_is_the_same(form):
    """Whichever level holds it, every reading is of the pose, pull and state that it was."""
    exports = {name: text.encode() for name, text in FORMS[form]().items()}
    said = propose(exports)
    states = ", ".join(f'"{word}" = "{state}"' for word, state in said.group.state_of.items())
    tracker = f"files = {[*said.patterns]}\n".replace("'", '"')
    tracker += f"names = '{said.names[0]}'\n" if said.names else ""
    tracker += f'groups = "{said.by_file}"\n' if said.by_file else ""
    text = re.sub(r"files *= .*\n", lambda _: tracker, FILES["campaign.toml"].decode())
    way = f"[naming]\ngroup = '{said.group.pattern}'\nstates = {{ {states} }}\n"
    text = text.replace("[naming]\n", way)

    assert {*said.measured} == {"P1", "P2", "P3"}
    assert {*said.base} == {"B1", "B2", "B3", "B4"}
    assert assigned(FILES | exports | {"campaign.toml": text.encode()}) == OURS


def test_numbers_alone_are_states_if_one_of_them_is_zero():
    """05-0, 05-1, 05-2, 05-0R: the place says which number is the pose."""
    rows = defaultdict(dict)
    for row in ROWS:
        at = [float(row[f"{axis}_mm"]) for axis in "xyz"]
        rows[short(row)][row["target"]] = at
    (way,) = ways_to_read(rows)
    states = states_of([*rows], way)

    assert {n for n, s in states.items() if s == "unloaded"} == {n for n in rows if "-0" in n}
    assert {n for n in rows if n not in states} == {n for n in rows if n.startswith("BASE")}
    shifted = {name: dict.fromkeys(own, (0.0, 0.0, 0.0)) for name, own in rows.items()}
    assert ways_to_read(shifted) == ()  # all in one place: nothing tells which is the pose


@pytest.mark.whole
def test_inner_folders_are_looked_at_beside_a_sketch(tmp_path, capsys):
    """What lies above is a list of places, a log that no robot has, and the type of the robot."""
    folder = tmp_path / "data/raw/c"
    (folder / "SA").mkdir(parents=True)
    said = tomllib.loads(FILES["campaign.toml"].decode())
    places = {**said["base_frame"], **said["tool"]}
    sketch = [
        "Cell of the MOTOMAN-GP180, m",
        *(" ".join(map(str, [k, *at])) for k, at in places.items()),
    ]
    (folder / "sketch.txt").write_text("\n".join([*sketch, ""]))
    axes = "Pose,J1,J2,J3,J4,J5,J6,J7,J8\n1,1,2,3,4,5,6,7,8\n2,2,3,4,5,6,7,8,9\n"
    (folder / "pendant.csv").write_text(axes)
    for name, text in FORMS["a collection of each pose in a file of its own"]().items():
        (folder / name).write_text(text)
    code = cli._exit_code(["init", "c", "--root", str(tmp_path)])
    text = (folder / "campaign.toml").read_text()
    told = capsys.readouterr().err

    assert code == 0
    assert 'files   = ["SA/*.txt"]' in text
    assert tomllib.loads(text)["base_frame"] == said["base_frame"]
    assert "pendant.csv is not used: seems to be a joint log (J1 to J8)" in told
    (folder / "campaign.toml").unlink()
    (folder / "pendant.csv").write_text(axes.replace(",J7,J8", "").replace(",7,8", ""))
    cli._exit_code(["init", "c", "--root", str(tmp_path)])
    text = (folder / "campaign.toml").read_text()

    assert 'robot  = "gp180"   # named in the files: confirm it' in text
