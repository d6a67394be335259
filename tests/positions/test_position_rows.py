"""Tables of positions with wrong rows, columns and names, of a machine computed otherwise."""

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
from made_positions import TOOL, TURN, made, stands

from pipeline.positions.position_readings import dated_beside, outliers
from pipeline.positions.position_rows import PositionSheet, farther_than_real, position_rows
from pipeline.positions.positioned import as_read, usable
from pipeline.positions.study import study
from pipeline.store.campaign import in_memory

JOINTS = [f"theta{k}_deg" for k in range(1, 7)]
TOML = 'format = 1\nname = "a hall"\nrobot = "ur10"\n[positions]\nfile = "p.csv"\n'
MARKS = {"A": TOOL, "B": TOOL + np.array([0.1, 0.0, 0.0]), "C": TOOL + np.array([0.0, 0.15, 0.05])}
NAMED = TOML + "[tool]\n" + "".join(f"{k} = {list(map(float, v))}\n" for k, v in MARKS.items())


@pytest.fixture(scope="module")
def right():
    """Sixty poses of one target of a machine whose DH parameters are wrong by a millimetre."""
    readings = made(60, np.random.default_rng(3))
    rows = pd.DataFrame(np.rad2deg(readings.q), columns=JOINTS)
    return rows.assign(**{f"{a}_mm": 1e3 * readings.at[:, 0, k] for k, a in enumerate("xyz")})


def three(right):
    """The same poses with three targets on the effector, one row each."""
    at, turn = stands(np.deg2rad(right[JOINTS].to_numpy()), 0.0)
    axes = turn @ TURN.T
    parts = []
    for name, point in MARKS.items():
        there = 1e3 * (at + axes @ (point - TOOL))
        rows = right.assign(pose=np.arange(1, len(right) + 1), target=name)
        parts.append(rows.assign(**{f"{a}_mm": there[:, k] for k, a in enumerate("xyz")}))
    return pd.concat(parts).sort_values(["pose", "target"], ignore_index=True)


def sheet(rows, toml=TOML):
    raw = in_memory({"campaign.toml": toml.encode(), "p.csv": rows.to_csv(index=False).encode()})
    return PositionSheet(raw.robot, raw.settings, as_read(raw.settings, raw.robot, raw.files)[0])


def screened(rows, toml=TOML):
    found, put_right = position_rows(sheet(rows, toml))
    return found, put_right.rows


def joints(rows):
    return np.rad2deg(rows[[name.removesuffix("_deg") for name in JOINTS]].to_numpy())


def with_joints(rows, values):
    return rows.assign(**dict(zip(JOINTS, np.asarray(values).T, strict=True)))


def test_a_right_table_has_no_mistake(right):
    """Nor do three targets of a pose, whether or not their positions on the tool are known."""
    for rows, toml in ((right, TOML), (three(right), TOML), (three(right), NAMED)):
        found, left = screened(rows, toml)

        assert found == []
        assert len(left) == len(rows)


def test_two_rows_that_stand_for_each_other_are_named_with_their_lines(right):
    q = right[JOINTS].to_numpy(copy=True)
    q[[5, 40]] = q[[40, 5]]

    (one,), put_right = screened(with_joints(right, q))

    assert (one.name, one.where) == ("exchanged", "pose06/pose41")
    assert one.at == ("p.csv:7", "p.csv:42")
    assert np.allclose(joints(put_right), right[JOINTS])


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("first", [20, 0, 45])
def test_joint_rows_off_by_one_are_named_from_where_on_they_are(right, first):
    """All of them, most, or the last ones: a missing row, or a duplicated one."""
    q = right[JOINTS].to_numpy(copy=True)
    q[first:] = np.roll(q[first:], 1, axis=0)

    (one,), put_right = screened(with_joints(right, q))

    assert one.name == "exchanged"
    assert one.where == f"pose{first + 1:02d}/pose60 off by one"
    assert "stand one pose too late; those of the first belong to the last (p.csv:" in one.evidence
    assert one.at == tuple(f"p.csv:{k + 2}" for k in range(first, 60))
    assert np.allclose(joints(put_right), right[JOINTS])


@pytest.mark.whole
def test_joint_rows_that_are_shuffled_find_their_positions(right):
    """Tool and frame are unknown: order and frame are found together."""
    order = np.random.default_rng(2).permutation(60)
    moved = np.flatnonzero(order != np.arange(60))

    found, put_right = screened(with_joints(right, right[JOINTS].to_numpy()[order]))

    assert {one.name for one in found} == {"exchanged"}
    assert sorted(at for one in found for at in one.at) == sorted(f"p.csv:{k + 2}" for k in moved)
    assert np.allclose(joints(put_right), right[JOINTS])


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("column", "factor", "where"),
    [("z_mm", 1e-3, "z_m"), ("theta3_deg", np.pi / 180, "theta3_rad")],
)
def test_a_column_in_another_unit_is_named(right, column, factor, where):
    (one,), put_right = screened(right.assign(**{column: right[column] * factor}))

    assert (one.name, one.where, one.since) == ("unit_mixup", where, None)
    assert np.allclose(joints(put_right), right[JOINTS])
    assert np.allclose(1e3 * put_right["z"], right["z_mm"])


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(("factor", "unit"), [(0.1, "cm"), (1 / 304.8, "ft")])
def test_a_unit_that_no_title_can_state_is_named(right, factor, unit):
    """Else the identified robot is a tenth of its size."""
    places = {f"{axis}_mm": factor * right[f"{axis}_mm"] for axis in "xyz"}
    (one,), put_right = screened(right.assign(**places))

    assert (one.name, one.where) == ("unit_mixup", unit)
    assert np.allclose(1e3 * put_right["z"], right["z_mm"])


def test_a_table_off_by_more_than_any_robot_is_pointed_out():
    assert not [*farther_than_real(0.015)]
    assert "check the units" in next(farther_than_real(0.5))


def test_a_unit_that_changes_in_mid_file_is_named_with_the_line(right):
    x = right["x_mm"].to_numpy(copy=True)
    x[35:] *= 1e-3

    (one,), put_right = screened(right.assign(x_mm=x))

    assert (one.name, one.where, one.since) == ("unit_mixup", "x_m", "p.csv:37")
    assert np.allclose(1e3 * put_right["x"], right["x_mm"])


def in_rad(right, column, first):
    """One column of the joint log in radians from some row on."""
    values = right[column].to_numpy(copy=True)
    values[first:] = np.deg2rad(values[first:])
    return right.assign(**{column: values})


@pytest.mark.parametrize("first", [35, 42])
def test_rows_whose_value_hardly_differs_in_the_other_unit_are_put_right_too(right, first):
    """Angles near zero leave a target within millimetres, which is not elsewhere."""
    assert (np.abs(right["theta6_deg"].to_numpy())[first:] < 8.0).any()

    (one,), put_right = screened(in_rad(right, "theta6_deg", first))

    assert (one.name, one.since) == ("unit_mixup", f"p.csv:{first + 2}")
    assert one.at == tuple(f"p.csv:{k + 2}" for k in range(first, len(right)))
    assert np.allclose(joints(put_right), right[JOINTS])


@pytest.mark.whole
def test_a_unit_up_to_some_row_and_in_single_rows(right):
    """The first ten rows in radians; and three in the midst, which are no beginning of anything."""
    other = right.assign(theta5_deg=in_rad(right.iloc[::-1], "theta5_deg", 50)["theta5_deg"])
    (one,), put_right = screened(other)
    assert (one.since, len(one.at), one.at[0]) == (None, 10, "p.csv:2")
    assert np.allclose(joints(put_right), right[JOINTS])

    values = right["x_mm"].to_numpy(copy=True)
    values[[4, 30, 31]] *= 1e-3
    (one,), put_right = screened(right.assign(x_mm=values))
    assert (one.since, one.at) == (None, ("p.csv:6", "p.csv:32", "p.csv:33"))
    assert np.allclose(1e3 * put_right["x"], right["x_mm"])


def studied(raw, rows):
    """A robot identified from a table of positions, and the table as it was used."""
    left = usable(raw.settings, raw.robot, rows, ())
    tool = {name: np.array(at) for name, at in raw.settings.tool.items()}
    rng, rough = np.random.default_rng(1), raw.robot.roughness
    return study(raw.robot, left.readings, left.weights, tool, 2e-5, rough, rng), left.table


@pytest.mark.whole
def test_a_joint_value_typed_wrongly_is_one_mistake_of_its_pose(right):
    """All its targets turn about one axis; a wrong reading of another pose stays one."""
    toml = NAMED.replace('"p.csv"', '"p.csv"\nsigma_m = 2e-5')
    rows = three(right)
    rows.loc[rows["pose"] == 21, "theta5_deg"] += 9.0
    rows.loc[(rows["pose"] == 40) & (rows["target"] == "A"), "x_mm"] += 7.0
    given = sheet(rows, toml)
    raw = in_memory({"campaign.toml": toml.encode(), "p.csv": rows.to_csv(index=False).encode()})
    assert not position_rows(given)[0]

    joint, other = sorted(outliers(*studied(raw, given.rows)), key=lambda one: one.where)

    assert (joint.where, joint.at) == ("p.csv pose21", ("p.csv:62", "p.csv:63", "p.csv:64"))
    assert joint.size == pytest.approx(np.deg2rad(9.0), abs=1e-4)
    assert "theta5" in joint.evidence
    assert other.where == "pose40/A"
    left = joint.correct(given.rows)
    assert sorted(set(given.rows.index) - set(left.index)) == [60, 61, 62]


@pytest.mark.whole
def test_the_identified_robot_dates_a_unit_to_the_row(right):
    """Beside the table as delivered, whose own errors are millimetres, it was missed by one."""
    first = 40
    toml = TOML.replace('"p.csv"', '"p.csv"\nsigma_m = 2e-5')
    rows = in_rad(right, "theta6_deg", first)
    given = sheet(rows, toml)
    raw = in_memory({"campaign.toml": toml.encode(), "p.csv": rows.to_csv(index=False).encode()})
    wrong, _ = position_rows(given)
    short = replace(
        wrong[0], at=wrong[0].at[1:], correct=partial(_some_later, correct=wrong[0].correct)
    )
    found = studied(raw, given.without([short]).rows)[0]
    assert found.bad

    (one,), put_right = dated_beside(given, [short], found)

    assert (one.since, len(one.at)) == (f"p.csv:{first + 2}", len(right) - first)
    assert np.allclose(joints(put_right.rows), right[JOINTS])
    assert dated_beside(given, [one], found) is None


def _some_later(rows, correct):
    """A correction without its first row."""
    put_right = correct(rows)
    first = (put_right["theta6"] != rows["theta6"]).idxmax()
    put_right.loc[first] = rows.loc[first]
    return put_right


@pytest.mark.whole
def test_columns_that_stand_for_each_other_are_named(right):
    q = right[JOINTS].to_numpy()[:, [0, 3, 2, 1, 4, 5]]

    (one,), _ = screened(with_joints(right, q))

    assert (one.name, one.where) == ("exchanged", "theta2/theta4")


@pytest.mark.parametrize("toml", [TOML, NAMED])
@pytest.mark.parametrize("true", [{0: "B", 1: "A"}, {0: "B"}, {0: "Bee"}])
def test_a_wrong_name_of_a_target_is_named_with_its_line(right, toml, true):
    """Two exchanged, one duplicated, and an unknown one."""
    rows = three(right)
    names = rows["target"].to_numpy(object, copy=True)
    names[[30 + k for k in true]] = list(true.values())

    rows = rows.assign(was=rows["target"], target=names)
    if true == {0: "B"}:  # the right target of that pose was not read
        rows = rows.drop(31)
    (one,), put_right = screened(rows.drop(columns="was"), toml)

    assert one.name == "label_swap"
    assert one.at == tuple(f"p.csv:{32 + k}" for k in true)
    assert put_right["target"].tolist() == rows["was"].tolist()


def test_rows_off_by_one_beside_two_exchanged_ones_are_all_put_right(right):
    """Left-out rows shift no other row of similar appearance."""
    q = right[JOINTS].to_numpy(copy=True)
    q[5:13] = right[JOINTS].to_numpy()[4:12]
    q[[30, 31]] = q[[31, 30]]

    _, put_right = screened(with_joints(right, q))

    assert len(put_right) >= 59
    assert np.allclose(joints(put_right), right[JOINTS].to_numpy()[put_right["line"] - 2])
