"""A wrong row of the joint log and a wrong base reflector are named with their place."""

import io
import re

import pandas as pd
import pytest
from small_case import screen

from pipeline.faults.joint_row import wrong_rows
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.simulate import Plan, revised, simulate
from pipeline.store.campaign import in_memory

PLAN = Plan(name="bad", seed=12, poses={"count": 8}, pulls={"steps_n": [1500.0, 3000.0]})
CORNERS = {"B1": [1, -0.5, -0.3], "B2": [1, 15, -0.3], "B3": [-1, 15, 0.2], "B4": [-1, -0.5, 0]}


def files(*effects, **changes):
    """Raw files of a campaign, with something planted in the cell."""
    return simulate(revised(PLAN, {"hidden": {"effects": list(effects)}, **changes})).files


def case_of(campaign):
    return ingested(in_memory(campaign), plausible=False)


def findings(campaign):
    case = case_of(campaign)
    return screen(case, bring(case)).findings


def logged(campaign, change):
    """The campaign with a changed joint log; `change` modifies its table."""
    table = pd.read_csv(io.BytesIO(campaign["joints.csv"]), dtype=str)
    change(table)
    return {**campaign, "joints.csv": table.to_csv(index=False).encode()}


def added(pose, column, amount):
    def change(table):
        row = table["pose"].astype(int) == pose
        table.loc[row, column] = str(float(table.loc[row, column].iloc[0]) + amount)

    return change


def repeated(table):
    """Row 5 is a copy of row 4."""
    table.loc[4, table.columns[1:]] = table.loc[3, table.columns[1:]].to_numpy()


def exchanged(table):
    """Rows 2 and 7 are exchanged."""
    values = table.loc[[6, 1], table.columns[1:]].to_numpy()
    table.loc[[1, 6], table.columns[1:]] = values


@pytest.fixture(scope="module")
def clean():
    """A campaign in which nothing is wrong."""
    return files()


@pytest.fixture(scope="module")
def off_table():
    """A campaign with a wrong zero of theta3 and a rotated base frame."""
    return files("joint_offset:3", "base_rotation=2x")


@pytest.mark.whole
def test_a_robot_that_stands_off_its_table_has_no_wrong_row(off_table, clean):
    """Nor has one that agrees with its DH parameters."""
    assert not findings(off_table)
    assert not wrong_rows(case_of(clean))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("change", "pose"),
    [
        (added(7, "theta6_deg", -10.0), 7),
        (added(1, "r1_m", -0.1), 1),
        (repeated, 5),
    ],
    ids=["theta6", "r1", "repeated"],
)
def test_a_wrong_row_of_the_joint_log_is_named(off_table, change, pose):
    """Only that row is flagged, also for a robot with DH errors."""
    found = findings(logged(off_table, change))

    assert [(f.name, f.where) for f in found] == [("outlier", f"joints.csv pose{pose:02d}")]
    assert f"joints.csv:{pose + 1}" in found[0].evidence
    assert ("repeats that of pose 4" in found[0].evidence) == (change is repeated)


@pytest.mark.whole
def test_two_rows_in_each_others_place_are_both_named():
    """Two of a dozen poses."""
    found = findings(logged(files(poses={"count": 12}), exchanged))

    assert [f.where for f in found] == ["joints.csv pose02/pose07"]


@pytest.mark.whole
def test_without_the_pose_of_a_wrong_row_the_result_is_that_of_good_data(clean):
    """Exactly the readings, forces and joint values of the other poses remain."""
    good = case_of(clean)
    case = case_of(logged(clean, added(7, "theta6_deg", 2.0)))

    screened = screen(case, bring(case))
    right = screened.case

    for name in ("readings", "loads", "joints"):
        kept, given = getattr(right, name), getattr(good, name)
        pd.testing.assert_frame_equal(kept, given[given["pose"].ne(7).fillna(True)])
    assert [f.where for f in screened.findings] == ["joints.csv pose07"]


@pytest.mark.parametrize("column", ["theta3_deg", "r1_m"])
def test_a_log_that_is_wrong_in_every_row_accuses_no_row(clean, column):
    """A joint of opposite sense is left to another test."""

    def reversed_joint(table):
        table[column] = [str(-float(value)) for value in table[column]]

    assert not wrong_rows(case_of(logged(clean, reversed_joint)))


@pytest.mark.parametrize(
    "effect",
    ["label_swap:pose05_rep0_unloaded", "outlier:pose03_rep0_unloaded/P2=20e-3", "gravity_sag=3x"],
)
def test_what_is_no_wrong_row_is_not_called_one(effect):
    """Exchanged names, a single bad reading and a robot that sags."""
    assert not wrong_rows(case_of(files(effect)))


def test_a_tracker_knocked_before_the_last_pose_is_no_wrong_row(clean):
    """All readings of the last pose and the last base round are off by 8 mm together."""
    rows = [line.split(",") for line in clean["tracker.csv"].decode().splitlines()]
    column = rows[0].index("z_mm")
    for row in rows:
        if row[0].startswith(("pose08", "base_end")):
            row[column] = f"{float(row[column]) + 8:.4f}"
    knocked = {**clean, "tracker.csv": "\n".join(",".join(row) for row in rows).encode()}

    assert not wrong_rows(case_of(knocked))


def moved_base(campaign, name, axis, off_m):
    """The campaign with one wrong number in [base_frame]."""
    text = campaign["campaign.toml"].decode()
    line = next(line for line in text.splitlines() if re.match(rf"{name}\s*=", line))
    at = [float(v) for v in re.search(r"\[(.*)\]", line).group(1).split(",")]
    at[axis] += off_m
    return {**campaign, "campaign.toml": text.replace(line, f"{name} = {at}").encode()}


@pytest.fixture(scope="module")
def four():
    """A campaign with four base reflectors, read before and after."""
    return files(base_frame=CORNERS)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("name", "axis"), [("B2", 0), ("B4", 1)])
def test_a_wrong_nominal_of_a_base_reflector_is_named(four, name, axis):
    """One of four, 10 mm along or across the rail."""
    found = findings(moved_base(four, name, axis, 0.01))

    assert [(f.name, f.where) for f in found] == [("outlier", name)]
    assert found[0].size == pytest.approx(0.01, rel=0.1)


def test_base_reflectors_that_agree_are_left_alone(four):
    """Nothing is reported for a clean campaign."""
    assert not findings(four)


@pytest.mark.whole
def test_where_the_loss_of_another_reflector_would_do_as_well_none_is_named(four):
    """Of four coplanar reflectors any may be the one that is too high."""
    flat = {name: [*at[:2], 0.0] for name, at in CORNERS.items()}

    found = findings(moved_base(files(base_frame=flat), "B2", 2, 0.002))

    assert not found


@pytest.mark.whole
def test_three_reflectors_on_one_line_say_nothing_and_stop_nothing():
    """Without the fourth, the rotation of the tracker about that line is undetermined."""
    line = {"B1": [1, 0, -0.3], "B2": [1, 8, -0.3], "B3": [1, 16, -0.3], "B4": [-1, 8, 0]}

    found = findings(moved_base(files(base_frame=line), "B2", 1, 0.01))

    assert {f.where for f in found} <= {"B2"}
