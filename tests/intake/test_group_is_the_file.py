"""Exports that name targets only: the group is the file, and the files may lie in a folder."""

import csv
import io
import re
from collections import defaultdict

import pytest

from pipeline.app import cli
from pipeline.intake._group_names import states_of, ways_to_read
from pipeline.intake.files import propose
from pipeline.reduction.ingest import ingest
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory


def by_file(named, timed=True):
    """Exports of the demo, one for each group, without the column of groups."""
    files = simulate(Plan()).files
    rows = defaultdict(list)
    for row in csv.DictReader(io.StringIO(files["tracker.csv"].decode())):
        rows[named(row["group"])].append(row)
    out = {
        name: data for name, data in files.items() if name.endswith(".csv") and "track" not in name
    }
    for name, some in rows.items():
        lines = ["Point;X (mm);Y (mm);Z (mm)" + ";Heure" * timed]
        for row in some:
            cells = [row["target"], *(row[f"{axis}_mm"].replace(".", ",") for axis in "xyz")]
            lines.append(";".join([*cells, *[row["time"][11:]] * timed]))
        out[f"releves/{name}.txt"] = "\r\n".join([*lines, ""]).encode()
    return files, out


def french(group):
    """pose05_rep2_loaded -> pose5_charge2, unloaded ones a_vide before and after."""
    pose, _, rest = group.partition("_rep")
    repeat, _, state = rest.partition("_")
    if not rest:
        return group
    number = f"pose{int(pose[4:])}"
    if state == "loaded":
        return f"{number}_charge{repeat}"
    return f"{number}_a_vide" + "_retour" * (repeat != "0")


@pytest.mark.whole
def test_init_proposes_it_and_the_campaign_is_the_same():
    """Names of groups of several words, one glob for the folder, and the readings of the demo."""
    files, split = by_file(french)
    said = propose(split)
    text = files["campaign.toml"].decode()
    text = re.sub(r"files *= .*", 'files = ["releves/*.txt"]\ngroups = "files"', text)
    states = ", ".join(f'"{word}" = "{state}"' for word, state in said.group.state_of.items())
    way = f"[naming]\ngroup = '{said.group.pattern}'\nstates = {{ {states} }}\n"
    text = text.replace("[naming]\n", way)
    raw = in_memory({**split, "campaign.toml": text.encode()})
    found = ingest(raw.settings, raw.robot, raw.files)
    order = [int(f[12:].split("_")[0]) for f in found.readings["file"].to_pylist() if "pose" in f]

    assert said.by_file
    assert said.nameless is None
    assert said.patterns == ("releves/*.txt",)
    assert set(said.measured) == {"P1", "P2", "P3"}
    assert found.readings.num_rows == files["tracker.csv"].count(b"\n") - 1
    assert order == sorted(order)  # pose2 before pose10
    assert "releves/pose2_charge1.txt" in found.readings["file"].to_pylist()


def test_names_that_say_nothing_are_left_open():
    """Files called 1, 2, 3: no group is made of them."""
    numbers = {}
    _, split = by_file(lambda group: str(numbers.setdefault(group, len(numbers) + 1)))
    said = propose(split)

    assert not said.by_file
    assert said.nameless == "groups"


@pytest.mark.parametrize(
    ("words", "rest"),
    [(("a_vide", "a_vide_retour", "charge"), 2), (("leer_vor", "leer_nach", "last_zug"), 2)],
)
def test_words_that_share_one_are_states_of_one_kind(words, rest):
    """Before and after the pulls, both are unloaded."""
    few, many = {key: [0.0] for key in "ABC"}, {key: [0.0] for key in "ABCDE"}
    names = {f"pose{k}_{w}": few if w in words[:rest] else many for k in (1, 2, 3) for w in words}
    (way,) = ways_to_read(names)
    unloaded = {name for name, state in states_of([*names], way).items() if state == "unloaded"}

    assert unloaded == {name for name in names if name.partition("_")[2] in words[:rest]}


@pytest.mark.whole
def test_a_folder_is_read_or_told(tmp_path, capsys):
    """Without an export beside it a folder is read; else the number of its files is told."""
    _, split = by_file(french)
    folder = tmp_path / "data/raw/c"
    for name, data in split.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    count = len([*(folder / "releves").iterdir()])
    code = cli._exit_code(["init", "c", "--root", str(tmp_path)])
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").unlink()
    (folder / "tracker.csv").write_bytes(simulate(Plan()).files["tracker.csv"])
    again = cli._exit_code(["init", "c", "--root", str(tmp_path)])
    asked = cli._exit_code(["inspect", str(folder / "releves")])
    told = capsys.readouterr().err

    assert (code, again, asked) == (0, 0, 5)
    assert 'groups  = "files"' in text
    assert "# B1 = ?" in text
    assert f"releves: {count} files are in this folder and not looked at" in told
    assert f"is a folder, with {count} files" in told
