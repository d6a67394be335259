"""A pose measured again has letters behind its number, in exports as in logs: 4bis, 4 R."""

import numpy as np
import pytest

from pipeline.readers import pose_names
from tests.reduction.test_ingest import JOINTS, TOML, read, reasons, tracker_csv, tracker_rows

GROUP = r"P(?P<pose>[0-9]+){}_rep(?P<repeat>[0-9]+)_(?P<state>unloaded|loaded)"


def campaign(behind, log, pattern="(?:[a-zA-Z _-]*)"):
    """Pose 2 measured again, 1 mm farther in x, under a name with `behind` after its number."""
    rows = [(g.replace("pose", "P"), *r) for g, *r in tracker_rows()]
    rows += [(g.replace("P02", f"P02{behind}"), t, x + 1, y, z)
             for g, t, x, y, z in rows if g.startswith("P02")]  # fmt: skip
    toml = TOML.replace(
        "[base_frame]", f"[naming]\ngroup = '{GROUP.format(pattern)}'\n[base_frame]"
    )
    loads = f"pose,repeat,force_n\n1,1,702\n1,2,1403\n2,1,698\n{log},1,555\n"
    return rows, toml, loads


def pulls(got):
    """Force and mean x [mm] of P1 under load, by pose and pull."""
    readings, loads = got.readings.to_pandas(), got.loads.to_pandas()
    one = readings[(readings["target"] == "P1") & (readings["state"] == "loaded")]
    both = one.merge(loads, on=["pose", "repeat"])
    return {(r.pose, r.repeat): (r.force_n, round(1e3 * r.x_m, 3)) for r in both.itertuples()}


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("behind", "log", "pattern"),
    [
        ("bis", "2bis", "(?:bis)?"),
        ("bis", "02 BIS", "(?:bis)?"),
        ("b", "P2b", "[a-z]?"),
        ("_ter", "2ter", "(?:_ter)?"),
        ("R", "2-R", "R?"),
        ("재", "2재", "재?"),
    ],
)
@pytest.mark.parametrize("both", [True, False], ids=["both", "the first was removed"])
def test_each_pull_has_its_own_force(behind, log, pattern, both):
    """Also where the readings of the abandoned pull are gone: its force is nobody else's."""
    rows, toml, loads = campaign(behind, log, pattern)
    rows = [row for row in rows if both or not row[0].startswith("P02_rep")]
    got = read(tracker_csv(rows), toml=toml, loads=loads)
    found = pulls(got)

    assert found.pop((1002, 1)) == (555.0, 2201.5)
    assert found == {(1, 1): (702.0, 1200.5), (1, 2): (1403.0, 1201.0)} | (
        {(2, 1): (698.0, 2200.5)} if both else {}
    )
    assert "as pose 1002" in got.treated[0].settled[0]


def test_joint_values_of_the_pose_hold_for_it_unless_it_has_its_own():
    """A program has one point, and the pose was driven to twice."""
    rows, toml, loads = campaign("bis", "2bis")
    again = JOINTS.splitlines()[2].replace("2,7.5", "2bis,7.6")
    for log, rail in ((JOINTS, 7.5), (f"{JOINTS}{again}\n", 7.6)):
        table = read(tracker_csv(rows), toml=toml, loads=loads, joints=log).joints.to_pandas()
        assert dict(zip(table["pose"], table["r1_m"], strict=True))[1002] == rail


def test_letters_count_within_the_expression_too():
    """Where the part `pose` has them, the log needs a row of that name."""
    rows, toml, loads = campaign("bis", "2", pattern="")
    toml = toml.replace("[0-9]+)_rep", "[0-9]+(?:bis)?)_rep")
    loads = loads.rpartition("2,1,555")[0]
    got = read(tracker_csv(rows), toml=toml, loads=loads)

    assert (2, 1) in pulls(got)
    assert (1002, 1) not in pulls(got)
    assert any("pose 1002 repeat 1 has no force" in why for _, _, why in reasons(got))


def test_letters_that_every_pose_has_are_no_name():
    """`7st` is 7, and pulls without a number are counted as ever where no log has letters."""
    rows = [(g.replace("pose01", "1st").replace("pose02", "2st"), *r) for g, *r in tracker_rows()]
    group = r"(?P<pose>[0-9]+)st_rep(?P<repeat>[0-9]+)_(?P<state>unloaded|loaded)"
    toml = TOML.replace("[base_frame]", f"[naming]\ngroup = '{group}'\n[base_frame]")

    assert set(pulls(read(tracker_csv(rows), toml=toml))) == {(1, 1), (1, 2), (2, 1)}


def test_numbers_of_names_do_not_meet_others():
    """Every name gets one number, whatever plain numbers there are, and shows as it was."""
    names = ["4bis", "4ter", "12a", "999zzzz", "4재", "4повт", "9é"]
    codes = [pose_names.coded(name) for name in names]
    own = pose_names.numbers([*codes, 4, 12, 1004, 2999])

    assert [pose_names.shown(code) for code in codes] == names
    assert len({*own.values()} | {4, 12, 1004, 2999}) == len(names) + 4
    assert np.all(np.array(codes) < 2**31)
    assert pose_names.coded("P4") is pose_names.coded("4toolong") is pose_names.coded("4") is None


def test_no_two_words_have_one_code(monkeypatch):
    """All of two letters between Cyrillic a and ya: 1024 words, of which several meet by chance."""
    monkeypatch.setattr(pose_names, "_words", {})
    words = [chr(0x430 + a) + chr(0x430 + b) for a in range(32) for b in range(32)]
    codes = [pose_names.coded(f"7{word}") for word in words]

    assert len({*codes}) == len(words)
    assert [pose_names.letters_of(code) for code in codes] == words
    assert [pose_names.coded(f"7{word}") for word in words] == codes


def test_a_word_without_a_code_is_no_name(monkeypatch):
    """Where a file has more words than there are codes; the search for one ends."""
    monkeypatch.setattr(pose_names, "_words", {})
    monkeypatch.setattr(pose_names, "_OTHERS", 5)
    words = [chr(0x430 + k) for k in range(9)]

    assert [pose_names.coded(f"7{word}") is None for word in words] == [False] * 5 + [True] * 4
