"""Weights, growth, limits and stations: each against arithmetic by hand or plain least squares."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from pipeline.machine.effect import HUNG, MOUNTED, PULLED, Pulls
from pipeline.machine.robot import load
from pipeline.readers.logs import Log
from pipeline.reduction.displacements import displacements, zeros
from pipeline.reduction.growth import STEEL, BaseGrowth, by_temperature, with_reflectors
from pipeline.reduction.limits import _beyond, doubt, impossible, reason
from pipeline.reduction.pose_of_interest import place_of_interest
from pipeline.reduction.register import agreeing, apart, seconds
from pipeline.reduction.stations import Round, Station, _stations, moved_by
from pipeline.reduction.weights import PULL, Weights

RAIL = load("kr500_rail")
RNG = np.random.default_rng(81)


def payload(
    mass: float, std: float, center: tuple[float, float, float], center_std: float
) -> object:
    """A payload of campaign.toml."""
    return SimpleNamespace(
        mass_kg=mass, mass_sigma_kg=std, center_m=center, center_sigma_m=center_std
    )


def test_weights_and_payloads_are_bodies_and_pulls_are_none() -> None:
    """Payloads by their name, equal weights as one body; mass, place and uncertainty of each."""
    payloads = {
        "box": payload(120.0, 0.5, (0.1, 0.2, 0.3), 2e-3),
        "rod": payload(40.0, 0.1, (0, 0, 1), 1e-3),
    }
    loads = pd.DataFrame(
        {"payload": ["rod", None, None, "box", None, None],
         "mass_kg": [np.nan, 20.0, np.nan, np.nan, 20.0, 50.0],
         "mass_sigma_kg": [np.nan, 0.02, np.nan, np.nan, 0.02, 0.03]}
    )  # fmt: skip
    found = Weights.of(payloads, loads)

    assert found.by.tolist() == [MOUNTED, HUNG, PULLED, MOUNTED, HUNG, HUNG]
    assert found.body[[0, 2, 3]].tolist() == [1, PULL, 0]
    assert found.body[1] == found.body[4] != found.body[5]
    assert min(found.body[[1, 5]]) >= 2
    np.testing.assert_array_equal(found.mass, [40, 20, np.nan, 120, 20, 50])
    np.testing.assert_array_equal(found.mass_std[[0, 1, 3, 5]], [0.1, 0.02, 0.5, 0.03])
    np.testing.assert_array_equal(found.center[[0, 3]], [[0, 0, 1], [0.1, 0.2, 0.3]])
    assert np.isnan(found.center[[1, 2, 4, 5]]).all()
    assert found.center_std.tolist() == [1e-3, 0, 0, 2e-3, 0, 0]
    gravity = np.array([0.0, 3.0, -4.0])
    np.testing.assert_array_equal(found.force(gravity)[1], [0, 60, -80])
    settings = SimpleNamespace(gravity=SimpleNamespace(vector=gravity))
    columns = found.columns(settings)
    assert columns["mass_std_n"][0] == pytest.approx(0.5)
    assert columns["at_z_m"][0] == 1
    assert found.only(found.by == HUNG).mass.tolist() == [20, 20, 50]
    bare = Weights.of({}, pd.DataFrame({"pose": [1, 2]}))
    assert bare.by.tolist() == [PULLED, PULLED]
    assert bare.body.tolist() == [PULL, PULL]


def test_steel_grows_with_the_temperature() -> None:
    """11.5 um/(m K) from 20 degC on; a kelvin and the material are uncertain."""
    warm = by_temperature(30.0)
    assert warm.value == warm.expected == pytest.approx(1.15e-4)
    assert warm.std == warm.expected_std == pytest.approx(np.hypot(11.5e-6, 10e-6 / np.sqrt(3)))
    assert by_temperature(20.0).value == 0
    assert by_temperature(10.0).value == pytest.approx(-1.15e-4)
    unknown = by_temperature(None)
    assert (unknown.value, unknown.std, unknown.probability) == (0, 0, 0)
    assert unknown.expected_std == pytest.approx(10 * STEEL)


@pytest.mark.parametrize(("stated", "noise"), [(True, 0.5), (True, 3.0), (False, 0.5)])
def test_growth_is_the_seventh_parameter_of_a_regression(stated: bool, noise: float) -> None:
    """Estimated by numpy beside a rigid motion, and combined with the thermometer by weights."""
    n, D = RNG.normal(size=30) * 5e4, RNG.normal(size=(30, 6)) * 1e4
    r = -2e-5 * n + D @ RNG.normal(size=6) * 1e-4 + noise * RNG.normal(size=30)
    before = by_temperature(23.0)
    found = with_reflectors(before, stated, r, n, D)

    X = np.column_stack([-n, D])
    x, square, *_ = np.linalg.lstsq(X, r, rcond=None)
    factor = square[0] / 23
    factor = max(factor, 1.0) if stated else factor
    std = np.sqrt(factor * np.linalg.inv(X.T @ X)[0, 0])
    w = np.array([before.expected_std, std]) ** -2.0
    assert found.seen == pytest.approx(x[0], rel=1e-9)
    assert found.seen_std == pytest.approx(std, rel=1e-9)
    assert found.value == pytest.approx(w @ [before.value, x[0]] / w.sum())
    assert found.std == pytest.approx(w.sum() ** -0.5)
    assert found.determined == pytest.approx(w[1] / w.sum())
    assert with_reflectors(before, stated, r[:7], n[:7], D[:7]) is before


def test_without_a_thermometer_growth_is_believed_as_far_as_it_explains() -> None:
    """None where noise explains the reflectors, all of it where only growth does."""
    n, D = RNG.normal(size=60) * 5e4, RNG.normal(size=(60, 6))
    e = RNG.normal(size=60)
    none = with_reflectors(BaseGrowth(), True, e, n, D)
    grown = with_reflectors(BaseGrowth(), True, e - 1e-3 * n, n, D)

    assert none.probability < 0.5
    assert abs(none.value) < 1e-6
    assert grown.probability == pytest.approx(1.0, abs=1e-6)
    assert grown.value == pytest.approx(1e-3, abs=4 * grown.std)
    assert grown.expected is None


def joint_log(q: np.ndarray) -> Log:
    """A log of these joint values, poses from 11, lines from 2."""
    number = {"pose": np.arange(11.0, 11 + len(q))} | {
        joint.name: q[:, k] for k, joint in enumerate(RAIL.joints)
    }
    return Log("j.csv", number, {}, np.arange(2, 2 + len(q)), ())


def test_a_joint_beyond_its_limit_is_named_with_how_far() -> None:
    """Either limit; impossible from a degree on; of two the worse one is the reason."""
    middle = (RAIL.lower + RAIL.upper) / 2
    q = np.tile(middle, (4, 1))
    q[0, 2] = RAIL.upper[2] + np.deg2rad(0.5)
    q[1, 3] = RAIL.lower[3] - np.deg2rad(2.0)
    q[2, 1], q[2, 4] = RAIL.upper[1] + np.deg2rad(1.5), RAIL.lower[4] - np.deg2rad(5.0)
    log = joint_log(q)
    every = _beyond(RAIL, "j.csv", log.number["pose"], log.line, q)

    assert [(one.pose, one.joint.name, one.line) for one in every] == [
        (11, RAIL.joints[2].name, 2),
        (12, RAIL.joints[3].name, 3),
        (13, RAIL.joints[1].name, 4),
        (13, RAIL.joints[4].name, 4),
    ]
    assert [np.rad2deg(one.over) for one in every] == pytest.approx([0.5, 2, 1.5, 5])
    assert [one.out for one in every] == [False, True, True, True]
    lost = impossible(log, RAIL)
    assert {row: one.joint.name for row, one in lost.items()} == {
        1: RAIL.joints[3].name,
        2: RAIL.joints[4].name,
    }
    assert "2.0 deg outside its limits" in reason(lost[1])
    assert "correct the value or the unit" in reason(lost[1])
    assert doubt([]) is None
    assert doubt(every[::-1]).line == 2
    slid = np.tile(middle, (1, 1))
    slid[0, 0] = RAIL.upper[0] + 0.25
    (one,) = _beyond(RAIL, "j.csv", np.array([5]), np.array([2]), slid)
    assert "0.25 m outside" in one.said


def test_without_a_test_pose_the_strongest_pull_stands_in() -> None:
    """By the size of its force, not by a component."""
    q, force = RNG.normal(size=(3, 7)), np.array([[0.0, 0, -900], [600, 600, 600], [0, 999, 0]])
    found = place_of_interest(None, RAIL, Pulls.at(q, force))

    assert not found.stated
    np.testing.assert_array_equal(found.q, q[1])
    np.testing.assert_array_equal(found.force, force[1])
    asked = SimpleNamespace(joint_values=lambda _: q[0], force_n=(1.0, 2.0, 3.0))
    own = place_of_interest(asked, RAIL, Pulls.at(q, force))
    assert own.stated
    assert own.force.tolist() == [1, 2, 3]


def readings(at: np.ndarray, seconds_: list[float]) -> pd.DataFrame:
    """Readings with a covariance each, at these seconds."""
    half = RNG.normal(size=(len(at), 3, 3)) * 1e-5
    C = half @ half.swapaxes(1, 2)
    six = {
        f"c{a}{b}_m2": C[:, "xyz".index(a), "xyz".index(b)]
        for a, b in ("xx", "xy", "xz", "yy", "yz", "zz")
    }
    time = pd.Timestamp("2026-11-03") + pd.to_timedelta(seconds_, unit="s")
    places = dict(zip(("x_m", "y_m", "z_m"), at.T, strict=True))
    return pd.DataFrame({"group": "g", **places, **six, "time": time})


def matrices(table: pd.DataFrame) -> np.ndarray:
    """Covariances as matrices."""
    xx, xy, xz, yy, yz, zz = (
        table[f"c{p}_m2"].to_numpy() for p in ("xx", "xy", "xz", "yy", "yz", "zz")
    )
    return np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), -1, 0)


def test_readings_of_each_station_are_turned_from_its_first_round_on() -> None:
    """R p + t and R C R' between the beginning of a station and that of the next, and back."""
    table = readings(RNG.normal(size=(5, 3)), [0, 10, 20, 30, 40])
    turns = Rotation.random(2, random_state=4).as_matrix()
    two = [
        Station("a", 1.0, 10.0, turns[0], np.array([1.0, 2, 3])),
        Station("b", 1.0, 30.0, turns[1], np.array([-1.0, 0, 2])),
    ]
    found = moved_by(table, two)

    xyz, before = found[["x_m", "y_m", "z_m"]].to_numpy(), table[["x_m", "y_m", "z_m"]].to_numpy()
    for k, of in enumerate((None, 0, 0, 1, 1)):
        R, t = (np.eye(3), np.zeros(3)) if of is None else (two[of].turn, two[of].shift)
        np.testing.assert_allclose(xyz[k], R @ before[k] + t, atol=1e-12)
        np.testing.assert_allclose(matrices(found)[k], R @ matrices(table)[k] @ R.T, atol=1e-16)
    again = moved_by(found, [one.back for one in two])
    np.testing.assert_allclose(again[["x_m", "y_m", "z_m"]], before, atol=1e-12)


@pytest.mark.parametrize(("carried", "stations"), [(0.05, [3]), (0.3, [1, 2])])
def test_a_tracker_that_was_carried_begins_a_station(carried: float, stations: list[int]) -> None:
    """Rounds that the pose of the round before misses by more than a decimetre."""
    nominal = RNG.normal(size=(4, 3)) * 5
    shift = np.array([[0, 0, 0], [carried, 0, 0], [carried, 0, 0]])
    rounds = [Round(str(k), float(k), nominal - s, nominal) for k, s in enumerate(shift)]

    assert [len(one) for one in _stations(rounds)] == stations
    R, t = rounds[1].pose()
    np.testing.assert_allclose(R, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(t, shift[1], atol=1e-12)
    assert rounds[0].off_m(R, t) == pytest.approx(carried)


@pytest.mark.parametrize("m", [7, 40])
def test_reflectors_that_agree_are_found_whatever_the_others_read(m: int) -> None:
    """Fewer than half of the readings anywhere in the hall; few and many."""
    nominal = RNG.normal(size=(m, 3)) * 5
    R = Rotation.from_rotvec([0.3, -1.0, 2.0])
    points = R.inv().apply(nominal - [4.0, 5, 6]) + 1e-4 * RNG.normal(size=(m, 3))
    wrong = np.arange(m) % 3 == 1
    points[wrong] += RNG.normal(size=(wrong.sum(), 3)) * 3

    assert agreeing(points, nominal).tolist() == (~wrong).tolist()
    line = np.outer(np.arange(5.0), [1.0, 2, 3])
    assert agreeing(line + RNG.normal(size=(5, 3)), line).all()
    assert not apart(line)
    assert not apart(nominal[:2])
    assert apart(nominal[:3])


def test_time_counts_from_the_first_reading() -> None:
    """In any order; without a time, groups in their order are the clock."""
    table = readings(np.zeros((3, 3)), [30.5, 0.0, 7.25])
    assert seconds(table).tolist() == [30.5, 0, 7.25]
    table.loc[2, "time"] = pd.NaT
    assert np.isnan(seconds(table)).tolist() == [False, False, True]
    bare = table.assign(time=pd.NaT, group=["a", "a", "b"])
    first, second, third = seconds(bare)
    assert first == second == 0 < third


def placed(rows: list[tuple[int, int, str, str, float]]) -> pd.DataFrame:
    """Table PLACED by pose, repeat, target, state and time; places and covariances drawn."""
    pose, repeat, target, state, time = zip(*rows, strict=True)
    made = readings(RNG.normal(size=(len(rows), 3)), list(time)).drop(columns=["time", "group"])
    words = {"target": pd.Categorical(target), "state": pd.Categorical(state)}
    return made.assign(
        pose=np.array(pose, np.int32), repeat=np.array(repeat, np.int32), time_s=time, **words
    )


def test_a_displacement_is_loaded_minus_the_mean_zero_of_its_pose() -> None:
    """Each target by itself, rows in any order; the zero has the covariance of a mean."""
    rows = [(2, 1, "P2", "loaded", 5.0), (1, 0, "P1", "unloaded", 0.0), (1, 2, "P1", "loaded", 3.0)]
    rows += [
        (1, 1, "P1", "loaded", 2.0),
        (1, 9, "P1", "unloaded", 8.0),
        (2, 0, "P2", "unloaded", 4.0),
    ]
    rows += [(2, 1, "P1", "loaded", 5.5), (1, 1, "L1", "loaded", 2.0)]
    table, settings = placed(rows), SimpleNamespace(measured=("P1", "P2"))
    found = displacements(settings, table)

    assert found[["pose", "repeat"]].to_numpy().tolist() == [[1, 1], [1, 2], [2, 1]]
    assert found["target"].tolist() == ["P1", "P1", "P2"]
    xyz, C = table[["x_m", "y_m", "z_m"]].to_numpy(), matrices(table)
    d = found[["dx_m", "dy_m", "dz_m"]].to_numpy()
    np.testing.assert_allclose(d[0], xyz[3] - (xyz[1] + xyz[4]) / 2, atol=1e-12)
    np.testing.assert_allclose(d[1], xyz[2] - (xyz[1] + xyz[4]) / 2, atol=1e-12)
    np.testing.assert_allclose(d[2], xyz[0] - xyz[5], atol=1e-12)
    mean = matrices(
        found.filter(like="zero_c").rename(columns=lambda one: one.removeprefix("zero_"))
    )
    np.testing.assert_allclose(mean[0], (C[1] + C[4]) / 4, rtol=1e-9)
    own = matrices(
        found.filter(like="loaded_").rename(columns=lambda one: one.removeprefix("loaded_"))
    )
    np.testing.assert_allclose(own, C[[3, 2, 0]])
    assert found["zero_count"].tolist() == [2, 2, 1]
    assert found["zero_time_s"].tolist() == [4.0, 4.0, 4.0]
    alone = zeros(settings, table)
    assert alone[["pose", "target", "zero_count"]].to_numpy().tolist() == [[1, 0, 2], [2, 1, 1]]
