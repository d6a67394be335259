"""What the operator sets aside, with a reason, is neither used nor rejected."""

import numpy as np
import pytest

from pipeline.base.errors import InputError
from tests.reduction.test_ingest import (
    BASE,
    JOINTS,
    LOADS,
    TOML,
    read,
    reasons,
    tracker_csv,
    tracker_rows,
)

FOURTH = {"B4": (600, 9500, -310)}


def campaign(*names, rows=None, **files):
    """The small campaign with these names set aside."""
    toml = TOML + "[set_aside]\n" + "".join(f'"{name}" = "knocked"\n' for name in names)
    return read(tracker_csv(rows), toml=toml, **files)


def used(got):
    """Readings by group and target, and the pulls and poses of the logs."""
    readings, loads = got.readings.to_pandas(), got.loads.to_pandas()
    there = set(zip(readings["group"], readings["target"], strict=True))
    pulls = set(zip(loads["pose"], loads["repeat"], strict=True))
    return there, pulls, set(got.joints.to_pandas()["pose"])


ALL = used(read())
TARGETS = {"P1", "P2", "P3"}


@pytest.mark.parametrize(
    ("name", "groups", "targets", "pulls", "poses"),
    [
        ("pose01_rep2_loaded", ["pose01_rep2_loaded"], None, {(1, 2)}, set()),
        ("pose 1 pull 2", ["pose01_rep2_loaded"], None, {(1, 2)}, set()),
        ("loads.csv:3", ["pose01_rep2_loaded"], None, {(1, 2)}, set()),
        ("Pose 2", ["pose02_rep0_unloaded", "pose02_rep1_loaded"], None, {(2, 1)}, {2}),
        ("pose02_rep0_unloaded", ["pose02_rep0_unloaded", "pose02_rep1_loaded"], None, {(2, 1)},
         {2}),
        ("pose01_rep2_loaded/Pl1", ["pose01_rep2_loaded"], None, {(1, 2)}, set()),
        ("pose01_rep2_loaded/P2", ["pose01_rep2_loaded"], {"P2"}, set(), set()),
        ("pose02_rep0_unloaded/P2", ["pose02_rep0_unloaded", "pose02_rep1_loaded"], {"P2"}, set(),
         set()),
        ("P3", ["pose01_rep0_unloaded", "pose01_rep1_loaded", "pose01_rep2_loaded",
                "pose02_rep0_unloaded", "pose02_rep1_loaded"], {"P3"}, set(), set()),
    ],
)  # fmt: skip
def test_it_goes_with_what_is_of_no_use_without_it(name, groups, targets, pulls, poses):
    """And nothing else goes, and nothing is rejected for it."""
    got = campaign(name)
    there, pulled, stood = used(got)

    gone = {one for one in ALL[0] if one[0] in groups and (targets is None or one[1] in targets)}
    assert there == ALL[0] - gone
    assert (pulled, stood) == (ALL[1] - pulls, ALL[2] - poses)
    assert reasons(got) == []
    assert (got.aside[-1].reason, got.aside[-1].readings) == ("knocked", len(gone))


def test_a_base_reflector_that_was_knocked_is_set_aside():
    """The others register the tracker; B4 stays in [base_frame]."""
    rows = [*tracker_rows(), *(("base_start", name, *at) for name, at in FOURTH.items())]
    toml = TOML.replace("[scale]", "B4 = [0.6, 9.5, -0.31]\n[scale]")
    got = read(tracker_csv(rows), toml=toml + '[set_aside]\nB4 = "hit by the fork lift"\n')
    base = got.readings.to_pandas().query("pose.isna()")["target"]

    assert set(base) == set(BASE)
    assert reasons(got) == []
    assert [(one.name, one.readings) for one in got.aside] == [("B4", 1)]


def test_a_force_that_was_not_written_down_goes_with_its_pull():
    """The pose keeps its zero, from which the robot's table is judged."""
    loads = LOADS.replace("2,1,698.0,down", "2,1,,down")
    got = campaign("pose02_rep1_loaded", loads=loads)

    assert reasons(got) == []
    assert used(got)[1:] == ({(1, 1), (1, 2)}, {1, 2})
    assert reasons(campaign("Pose 2", loads=loads)) == []


@pytest.mark.parametrize("name", ["pose 3", "joints.csv:4"])
def test_what_only_the_logs_have_is_set_aside(name):
    """A pose that was driven to and written down, and never read: no rejected row is left."""
    joints = JOINTS + "3,6.0,-20,30,20,40,10,0,1\n"
    assert [one[:2] for one in reasons(campaign("Pose 2", joints=joints))] == [("joints.csv", 4)]

    got = campaign(name, joints=joints)

    assert reasons(got) == []
    assert used(got) == ALL
    assert (got.aside[-1].name, got.aside[-1].readings) == (name, 0)


@pytest.mark.parametrize("line", ["²", "999999999"])
def test_a_row_has_a_number(line):
    """A superscript is no number, although it is a digit; others name rows that nothing has."""
    with pytest.raises(InputError, match="no group, target, pose or row"):
        campaign(f"tracker.csv:{line}")


def test_a_name_that_nothing_has_is_an_error_with_its_line():
    with pytest.raises(InputError) as caught:
        campaign("pose01_rep3_loaded")
    problem = str(caught.value)
    assert "pose01_rep3_loaded" in problem
    assert "is it pose01_rep" in problem


def test_readings_that_stay_are_as_they_were():
    """Coordinates, covariances and lines of what is left are untouched."""
    before, after = read().readings.to_pandas(), campaign("pose 1 pull 2").readings.to_pandas()
    left = before[before["group"] != "pose01_rep2_loaded"].reset_index(drop=True)
    for name in ("line", "x_m", "y_m", "z_m", "cxx_m2"):
        assert np.array_equal(left[name], after[name])
