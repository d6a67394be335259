"""Tables joined into arrays: every field worked out apart, whatever the order of rows."""

from dataclasses import fields, is_dataclass, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from pipeline.base import covariance
from pipeline.machine.effect import MOUNTED, PULLED
from pipeline.machine.robot import load
from pipeline.readers.logs import GroupState
from pipeline.reduction import _raw_readings
from pipeline.reduction.case import Case
from pipeline.reduction.displacements import displacements
from pipeline.reduction.forces import forces
from pipeline.reduction.growth import BaseGrowth
from pipeline.reduction.measured import measured
from pipeline.reduction.register import Registration, place
from pipeline.reduction.settings import Naming, PositionsSettings, Settings, parse
from pipeline.tables import XYZ, joint_column

RAIL = load("kr500_rail")
COLUMNS = [joint_column(joint.name, joint.prismatic) for joint in RAIL.joints]
TOML = """
format = 1
name = "t"
robot = "kr500_rail"
[tracker]
files = ["t.csv"]
[scale]
sigma_n = 2.0
sigma_rel = 0.001
[joints]
sigma_m = 1e-4
sigma_rad = 2e-4
[gravity]
direction = [0.0, 3.0, -4.0]
m_s2 = 9.5
[payload.gun]
mass_kg = 40.0
mass_sigma_kg = 0.2
center_m = [0.1, 0.2, 0.3]
center_sigma_m = 3e-3
[tool]
load_point = [0.15, 0.0, 0.25]
P1 = [0.20, 0.05, 0.12]
P2 = [-0.12, 0.19, 0.10]
P3 = [-0.10, -0.18, 0.22]
[tool_uncertainty]
sigma_m = 5e-4
load_point_sigma_m = 7e-4
[instrument]
"""


def tables():
    """Pose 9 is pulled by a chain twice and carries the gun, 2 is pulled once, 5 is read only.

    Table PLACED with drawn places, and the tables of loads and joints.
    """
    rng = np.random.default_rng(31)
    states = [(9, 0, "z9", "unloaded"), (9, 4, "y9", "unloaded"), (2, 0, "z2", "unloaded"),
              (5, 0, "z5", "unloaded")]  # fmt: skip
    states += [(9, k, f"p9{k}", "loaded") for k in (1, 2, 3)] + [(2, 1, "p21", "loaded")]
    rows = [(*one, target) for one in states for target in ("P1", "P2", "P3")]
    pulled = [one for one in states if one[3] == "loaded" and one[:2] != (9, 3)]
    rows += [(*one, end) for one in pulled for end in ("Pl1", "Pl2")]
    placed = pd.DataFrame(rows, columns=["pose", "repeat", "group", "state", "target"])
    half = rng.normal(size=(len(rows), 3, 3)) * 1e-5
    six = covariance.flat(half @ half.swapaxes(1, 2))
    placed = placed.assign(
        time_s=7.0 * np.arange(len(rows)), covariance_from="stated",
        **dict(zip(XYZ, rng.normal(size=(3, len(rows))), strict=True)),
        **dict(zip(covariance.columns(), six.T, strict=True)),
    )  # fmt: skip
    loads = pd.DataFrame(
        {"pose": [9, 9, 9, 2], "repeat": [1, 2, 3, 1], "force_n": [901.3, 1511.9, np.nan, 777.1],
         "branch": ["up", "down", None, "up"], "payload": [None, None, "gun", None],
         "mass_kg": np.nan, "mass_sigma_kg": 0.0}
    )  # fmt: skip
    joints = pd.DataFrame(0.1 * np.arange(21.0).reshape(3, 7), columns=COLUMNS)
    return placed, loads, joints.assign(pose=[9, 2, 5], approach=[1.0, -1.0, 0.0])


def joined(settings, placed, loads, joints, **registered):
    """The arrays of a campaign in F_b."""
    nothing = pd.DataFrame({"target": []})
    there = Registration(
        np.eye(3), np.array([1.0, 2, 3]), np.diag(np.arange(1.0, 7)), np.zeros(3), nothing, None, 0
    )  # fmt: skip
    there = replace(there, **registered)
    load_, moved = forces(settings, placed, loads), displacements(settings, placed)
    return measured(settings, RAIL, there, joints, load_, moved, placed)


def same(one, other, of=""):
    """Whether all fields are equal, and those of records in them."""
    for each in fields(one):
        mine, theirs = getattr(one, each.name), getattr(other, each.name)
        if is_dataclass(mine) and each.name in ("pulls", "idle"):
            same(mine, theirs, each.name)
        elif isinstance(mine, np.ndarray) and mine.dtype != object:
            np.testing.assert_allclose(theirs, mine, rtol=1e-12, err_msg=f"{of} {each.name}")
        else:
            np.testing.assert_equal(theirs, mine, err_msg=f"{of} {each.name}")


def test_every_field_is_that_of_its_rows():
    """Pulls by pose and number, their targets in the order of the tool, zeros by pose."""
    settings = parse(TOML + "length_sigma_rel = 4e-6")
    placed, loads, joints = tables()
    found = joined(settings, placed, loads, joints)
    pulls = [(2, 1), (9, 1), (9, 2), (9, 3)]

    def at(pose, repeat, target, state="loaded"):
        hit = placed[(placed.pose == pose) & (placed.target == target) & (placed.state == state)]
        return hit if repeat is None else hit[hit["repeat"] == repeat]

    assert [*zip(found.pulls.pose, found.pulls.repeat, strict=True)] == pulls
    assert found.pull.tolist() == [0] * 3 + [1] * 3 + [2] * 3 + [3] * 3
    assert found.target.tolist() == [0, 1, 2] * 4
    assert found.name.tolist() == ["P1", "P2", "P3"] * 4
    assert found.zero.tolist() == [0, 1, 2] + [3, 4, 5] * 3
    for k, (row, target) in enumerate(zip(found.pull, found.name, strict=True)):
        zero, pulled = (at(pulls[row][0], None, target, "unloaded"), at(*pulls[row], target))
        np.testing.assert_allclose(found.unloaded[k], zero[XYZ].mean(), rtol=1e-12)
        np.testing.assert_allclose(found.delta[k], pulled[XYZ].iloc[0] - zero[XYZ].mean())
        C = covariance.full(covariance.numbers(pulled))[0]
        np.testing.assert_allclose(found.loaded_cov[k], C, rtol=1e-12)
        C = covariance.full(covariance.numbers(zero)).sum(axis=0) / len(zero) ** 2
        np.testing.assert_allclose(found.zero_cov[k], C, rtol=1e-9)
    for k, (pose, repeat) in enumerate(pulls[:3]):
        chain = at(pose, repeat, "Pl2")[XYZ].iloc[0] - at(pose, repeat, "Pl1")[XYZ].iloc[0]
        size = loads[(loads.pose == pose) & (loads["repeat"] == repeat)].force_n.item()
        expected = size * chain / np.linalg.norm(chain)
        np.testing.assert_allclose(found.pulls.force[k], expected, rtol=1e-12)
        assert found.reading_std[k] == pytest.approx(np.hypot(2.0, 0.001 * size), rel=1e-4)
        np.testing.assert_allclose(found.direction_cov[k] @ expected, 0, atol=1e-18)
        assert np.trace(found.direction_cov[k]) > 0
        assert found.pulls.time[k] == at(pose, repeat, "P2").time_s.item()
    np.testing.assert_allclose(found.pulls.force[3], 40 * 9.5 * np.array([0, 0.6, -0.8]))
    assert (found.reading_std[3], np.abs(found.direction_cov[3]).max()) == (0.0, 0.0)
    assert found.pulls.by.tolist() == [PULLED] * 3 + [MOUNTED]
    assert found.pulls.body.tolist() == ["", "", "", "gun"]
    assert found.body.tolist() == [-1, -1, -1, 0]
    np.testing.assert_allclose(found.mass_std, [0, 0, 0, 0.2 * 9.5])
    assert found.center_std.tolist() == [0, 0, 0, 3e-3]
    np.testing.assert_allclose(found.pulls.acts_at[3], [0.1, 0.2, 0.3])
    assert found.pulls.branch.tolist() == [1, 1, -1, 0]
    assert found.pulls.approach.tolist() == [-1, 1, 1, 1]
    q = joints.set_index("pose")[COLUMNS]
    np.testing.assert_array_equal(found.pulls.q, q.loc[[2, 9, 9, 9]])
    first, second = (at(9, r, "P2", "unloaded").time_s.item() for r in (0, 4))
    np.testing.assert_allclose(found.pulls.time_zero[1:], (first + second) / 2)
    np.testing.assert_array_equal(found.zero_times[1], [second, first])  # y9 before z9
    assert (found.noise_stated, found.tracked, found.paper, found.poses) == (
        True,
        True,
        False,
        False,
    )
    assert (found.tool_std, found.load_point_std, found.length_rel) == (5e-4, 7e-4, 4e-6)
    assert found.joint_std.tolist() == [1e-4] + [2e-4] * 6
    assert found.idle.pulls.pose.tolist() == [5] * 3
    assert found.tracker is None
    np.testing.assert_array_equal(found.rotation_cov, np.diag([1.0, 2, 3]))


def test_what_is_said_of_instrument_and_registration_is_handed_on():
    """Its kind, the paper's noise, the place of the tracker, an uncertainty from scatter."""
    placed, loads, joints = tables()
    base = pd.DataFrame({"target": ["B1"]})
    settings = parse(TOML + 'kind = "arm"')
    papers = placed.assign(covariance_from=["paper"] + ["file"] * (len(placed) - 1))
    found = joined(settings, papers, loads, joints, table=base, from_scatter=True)

    assert (found.tracked, found.paper, found.rotation_found) == (False, True, True)
    assert found.tracker.tolist() == [1, 2, 3]
    assert not joined(settings, placed, loads, joints).rotation_found
    bare = placed.assign(**dict.fromkeys(covariance.columns(), np.nan))
    unstated = joined(settings, bare, loads, joints)
    assert not unstated.noise_stated
    np.testing.assert_array_equal(unstated.loaded_cov, [np.eye(3)] * 12)
    np.testing.assert_array_equal(unstated.zero_cov[[0, 3]], [np.eye(3), np.eye(3) / 2])
    chain = placed[(placed.group == "p21") & placed.target.str.startswith("Pl")][XYZ].to_numpy()
    square = np.sum((chain[1] - chain[0]) ** 2)  # both ends by 1 m^2 across the chain
    values = np.linalg.eigvalsh(unstated.direction_cov[0])
    np.testing.assert_allclose(values, [0, 2 / square, 2 / square], atol=1e-12)


def test_the_order_of_rows_changes_no_array():
    """Of readings, loads and joints: each field as before."""
    settings, rng = parse(TOML), np.random.default_rng(5)
    inputs = tables()
    drawn = [one.iloc[rng.permutation(len(one))].reset_index(drop=True) for one in inputs]

    same(joined(settings, *inputs), joined(settings, *drawn))


def test_a_pull_alone_is_what_it_is_among_others():
    """Chain or payload, it is not changed by rows of the other kind, and neither by fewer."""
    settings = parse(TOML)
    placed, loads, _ = tables()
    every = forces(settings, placed, loads).drop(columns="body").set_index(["pose", "repeat"])
    numbers = every.drop(columns=["by"]).columns
    for k in range(len(loads)):
        one = forces(settings, placed, loads.iloc[[k]]).set_index(["pose", "repeat"])
        np.testing.assert_allclose(
            one[numbers].to_numpy(float), every.loc[one.index, numbers].to_numpy(float), rtol=1e-12
        )
    gun = every.loc[(9, 3)]
    assert gun[covariance.columns("u", "")].tolist() == [0.0] * 6


def test_readings_come_back_whatever_the_base_grew_by():
    """Into F_b and out of it; points one by one as in a table."""
    rng = np.random.default_rng(6)
    R, t = Rotation.random(random_state=7).as_matrix(), np.array([3.0, -2, 1])
    there, points = rng.normal(size=(5, 3)), None
    for growth in (0.0, 0.25, -0.1):
        points = ((1 + growth) * there - t) @ R
        one = Registration(
            R, t, np.eye(6), np.zeros(3), pd.DataFrame(), None, 0, growth=BaseGrowth(value=growth)
        )  # fmt: skip
        np.testing.assert_allclose(one.into_base_frame(points), there, atol=1e-12)
        np.testing.assert_allclose(one.into_base_frame(np.zeros((1, 3)))[0], one.tracker)
        table = pd.DataFrame(points, columns=XYZ).assign(
            pose=1, repeat=0, group="a", time=pd.NaT, **dict.fromkeys(covariance.columns(), 1e-10)
        )
        np.testing.assert_allclose(place(one, table)[XYZ], there, atol=1e-12)


# --- names and settings ---------------------------------------------------------------------------


def test_pose_zero_is_a_pose_whoever_says_so():
    """By its name or by a log; what has no pose has no state."""
    names = pa.array(["pose0_rep0_unloaded", "pose0_rep1_loaded", "hall", "mine"])
    states = {"mine": GroupState(0, 2, True, 9)}
    slot, pose, repeat, loaded = _raw_readings._slots(names, Naming(), states, frozenset())

    assert slot.tolist() == [0, 1, -1, 2]
    assert (pose.tolist(), repeat.tolist(), loaded.tolist()) == (
        [0, 0, 0], [0, 1, 2], [False, True, True]
    )  # fmt: skip


@pytest.mark.parametrize("count", [1, 8, 9, 41])
def test_names_in_two_threads_are_those_in_one(count, monkeypatch):
    """Each half of very many by itself, in their order."""
    monkeypatch.setattr(_raw_readings, "WORTH_A_THREAD", 8)
    words = [f"pose{k % 7}_rep{k // 7}_loaded" if k % 5 else f"hall{k}" for k in range(count)]
    slot, pose, repeat, loaded = _raw_readings._slots(pa.array(words), Naming(), {}, frozenset())
    k = np.arange(count)
    there = k % 5 > 0
    assert (slot >= 0).tolist() == there.tolist()
    assert (pose[slot[there]] == k[there] % 7).all()
    assert (repeat[slot[there]] == k[there] // 7).all()
    assert loaded.all()


def settings_with(tool, **more):
    """Settings of a campaign with these points on the tool."""
    least = {"format": 1, "name": "t", "robot": "kr500_rail", "tracker": {"files": ["t.csv"]}}
    return Settings.model_validate(least | {"scale": {"sigma_n": 1.0}, "tool": tool} | more)


def test_a_point_that_the_tool_lacks_is_named_with_one_that_is_near():
    """Not with one that is asked for anyway, and not with one that is quite another."""
    whole = {"load_point": (0, 0, 1), "P1": (1, 0, 0), "P2": (0, 1, 0), "P3": (0, 0, 0)}
    assert settings_with(whole).tool == whole
    for name, near in (("P3x", "P3x"), ("quite another", None)):
        tool = {(name if key == "P3" else key): at for key, at in whole.items()}
        with pytest.raises(ValidationError, match=r"\[tool\] lacks P3$|\[tool\] lacks P3\W") as bad:
            settings_with(tool)
        (one,) = (error["ctx"]["error"] for error in bad.value.errors())
        assert one.key == ["tool", *([near] if near else [])]
        assert one.way_out == (f"is it {near}? Then rename that" if near else "")
    two = whole | {"P3x": (5, 0, 0), "P3xx": (6, 0, 0)}
    with pytest.raises(ValidationError, match="lacks P3") as bad:
        settings_with({key: at for key, at in two.items() if key != "P3"})
    assert bad.value.errors()[0]["ctx"]["error"].key == ["tool", "P3x"]
    with pytest.raises(ValidationError, match="lacks load_point, P1") as bad:
        settings_with({"P2": (0, 1, 0), "P3": (0, 0, 0)})
    assert bad.value.errors()[0]["ctx"]["error"].key == ["tool"]
    positions = {"format": 1, "name": "t", "robot": "kr500_rail", "positions": {}}
    assert Settings.model_validate(positions).tool == {}


def test_gravity_has_a_direction_whatever_its_length():
    """Its size is said apart; no direction is refused."""
    tool = {"load_point": (0, 0, 1), "P1": (1, 0, 0), "P2": (0, 1, 0), "P3": (0, 0, 0)}
    for length in (0.01, 1.0, 50.0):
        said = {"direction": (0.0, 3 * length, -4 * length), "m_s2": 9.5}
        found = settings_with(tool, gravity=said).gravity.vector
        np.testing.assert_allclose(found, [0, 5.7, -7.6])
    with pytest.raises(ValidationError, match="the direction is zero"):
        settings_with(tool, gravity={"direction": (0.0, 0.0, 0.0)})


def test_series_of_positions_are_read_from_each_of_their_tables_once():
    """One table where none is named."""
    files = {"a": "one.csv", "b": "two.csv", "c": "one.csv"}
    assert PositionsSettings(files=files).named == ["one.csv", "two.csv"]
    assert PositionsSettings(file="own.csv").named == ["own.csv"]


def test_a_campaign_stands_where_its_positions_say():
    """Points of the tool that it has, joint values, and the corrected robot."""
    _, _, joints = tables()
    settings = parse(TOML)

    stance = SimpleNamespace(
        robot=replace(RAIL, name="corrected"), joints=lambda q: q + 0.1 * np.arange(7),
        points={"P1": np.array([1.0, 2, 3]), "other": np.array([4.0, 5, 6])},
    )  # fmt: skip
    case = Case(settings, RAIL, None, None, joints, None)
    found = case.standing(stance)

    assert found.settings.tool == settings.tool | {"P1": (1.0, 2.0, 3.0)}
    assert found.robot.name == "corrected"
    expected = joints[COLUMNS].to_numpy() + 0.1 * np.arange(7)
    np.testing.assert_allclose(found.joints[COLUMNS], expected)
    assert found.joints["pose"].tolist() == [9, 2, 5]
    np.testing.assert_allclose(found.q(np.array([2])), expected[[1]])
    assert found.tool.points[0].tolist() == [1.0, 2.0, 3.0]
