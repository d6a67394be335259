"""Measurements as arrays, days, growth, forces: against rigid motions and sums worked out here."""

from dataclasses import replace
from datetime import datetime
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from pipeline.base.errors import InputError
from pipeline.machine.cell import Tool
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import configure, load
from pipeline.reduction._raw_readings import stale
from pipeline.reduction.case import Case
from pipeline.reduction.course import Course
from pipeline.reduction.days import days
from pipeline.reduction.forces import forces
from pipeline.reduction.idle import Idle
from pipeline.reduction.limits import beyond
from pipeline.reduction.measured import Measured, _in_frame, _in_poses
from pipeline.reduction.register import Registration, agreed, dated, register
from pipeline.reduction.settings import Scale, tells_a_pose
from pipeline.reduction.stations import one_station, with_rounds_exchanged

UR10 = load("ur10")
POINTS = np.array([[0.2, 0.0, 0.1], [-0.1, 0.15, 0.0], [-0.1, -0.2, 0.05]])
TOOL = Tool(np.zeros(3), np.array(["P1", "P2", "P3"], object), POINTS, six=True)
SIX = [f"c{pair}_m2" for pair in ("xx", "xy", "xz", "yy", "yz", "zz")]
XYZ, OFF = ["x_m", "y_m", "z_m"], ["dx_m", "dy_m", "dz_m"]


def covariances(rng: np.random.Generator, n: int) -> np.ndarray:
    """Covariances of arbitrary axes [m^2]."""
    half = 1e-5 * (rng.normal(size=(n, 3, 3)) + np.eye(3))
    return half @ half.swapaxes(1, 2)


def measured(pull: list[int], target: list[int], **more: object) -> Measured:
    """Pulls in poses 3, 3, 8 of which some targets were read; displacements are drawn."""
    rng, m, d = np.random.default_rng(8), 3, len(pull)
    q = rng.normal(size=(2, 6))[[0, 0, 1]]
    pulls = replace(Pulls.at(q, rng.normal(size=(m, 3)) * 100), pose=np.array([3, 3, 8]))
    fields = {
        "pulls": pulls, "pull": np.array(pull), "target": np.array(target),
        "name": TOOL.targets[target], "delta": rng.normal(size=(d, 3)) * 1e-3,
        "unloaded": np.zeros((d, 3)), "loaded_cov": covariances(rng, d),
        "zero_cov": covariances(rng, d), "zero": np.arange(d), "reading_std": np.ones(m),
        "direction_cov": covariances(rng, m), "rotation_cov": np.zeros((3, 3)),
        "scale": Scale(), "noise_stated": True,
    }  # fmt: skip
    return Measured(**(fields | more))


def idle(pose: list[int], target: list[int]) -> Idle:
    """Positions of targets in these poses."""
    rng, z = np.random.default_rng(9), len(pose)
    pulls = replace(Pulls.at(rng.normal(size=(z, 6)), np.zeros((z, 3))), pose=np.array(pose))
    return Idle(pulls, np.array(target), rng.normal(size=(z, 3)), covariances(rng, z))


def test_noise_is_multiplied_wherever_it_is_that_of_readings() -> None:
    """Readings, zeros, directions and idle poses by the square; the scale is another's."""
    own = replace(idle([1, 1], [0, 1]), turned=1e-10 * np.eye(3)[None])
    data = measured([0, 1], [0, 0], idle=own)
    found = data.scaled(3.0)

    for name in ("loaded_cov", "zero_cov", "direction_cov"):
        np.testing.assert_allclose(getattr(found, name), 9 * getattr(data, name))
    np.testing.assert_allclose(found.idle.cov, 9 * own.cov)
    np.testing.assert_allclose(found.idle.turned, 9 * own.turned)
    np.testing.assert_allclose(own.with_rotation(2.0).turned, 4 * own.turned)
    assert own.with_rotation(2.0).cov is own.cov
    assert idle([1], [0]).scaled(2.0).turned is None
    np.testing.assert_array_equal(found.reading_std, data.reading_std)
    heavier = data.reweighed(np.array([2.0, 5.0]), np.array([3.0, 1.0]))
    np.testing.assert_allclose(heavier.loaded_cov[1], 5 * data.loaded_cov[1])
    np.testing.assert_allclose(heavier.zero_cov[0], 3 * data.zero_cov[0])
    assert (own.poses, len(own)) == (1, 2)


def test_a_noise_found_takes_the_place_of_the_one_before() -> None:
    """First for a relative one, then for the former; it is told from then on."""
    data = measured([0, 1], [0, 0], noise_stated=False)
    first = data.in_metres(2e-5)

    assert not data.tells_noise
    assert first.tells_noise
    assert measured([0], [0]).tells_noise
    np.testing.assert_allclose(first.loaded_cov, 4e-10 * data.loaded_cov)
    np.testing.assert_allclose(first.in_metres(5e-5).zero_cov, 25e-10 * data.zero_cov)
    assert first.in_metres(5e-5).found_m == 5e-5
    assert first.in_metres(None) is first
    assert [data.enough(n) for n in (5, 6)] == [True, False]
    assert first.enough(600)
    assert not replace(first, delta=np.zeros((0, 3))).enough(0)


@pytest.mark.parametrize("rad", [None, 2e-4])
def test_a_pose_has_the_rigid_motion_of_its_targets(rad: float | None) -> None:
    """Planted s and w; the pull that lacks a target is left out, and zeros are those of poses."""
    rng = np.random.default_rng(4)
    rows = [0, 0, 0, 1, 1, 2, 2, 2], [0, 1, 2, 0, 2, 0, 1, 2]
    data = measured(*rows, idle=idle([2, 2, 5, 5, 5, 7, 7, 7], [0, 1, 0, 1, 2, 0, 1, 2]))
    s, w = rng.normal(size=(3, 3)) * 1e-3, rng.normal(size=(3, 3)) * 1e-3
    levers = configure(UR10, data.pulls.q).flange_axes @ (POINTS - POINTS.mean(axis=0)).T
    levers = levers.swapaxes(1, 2)
    moved = s[:, None] + np.cross(w[:, None], levers)
    data = replace(data, delta=moved[rows])
    found = _in_poses(data, UR10, TOOL, SimpleNamespace(sigma_rad=rad))

    L = np.sqrt(np.mean(np.sum((POINTS - POINTS.mean(axis=0)) ** 2, axis=1)))
    expected = [s[0], L * w[0], s[2], L * w[2]]
    np.testing.assert_allclose(found.delta, expected, rtol=1e-9, atol=1e-15)
    assert found.poses
    assert found.pull.tolist() == [0, 0, 2, 2]
    assert found.target.tolist() == [0, 1, 0, 1]
    assert found.name.tolist() == ["position", "rotation"] * 2
    assert found.zero.tolist() == [0, 1, 2, 3]
    assert found.shifts.tolist() == [True, False, True, False]
    assert found.unloaded.shape == (4, 3)
    assert np.isnan(found.unloaded).all()
    own = found.idle
    assert own.pulls.pose.tolist() == [5] * 3 + [7] * 3
    np.testing.assert_array_equal(own.at, data.idle.at[2:])
    loaded = np.array([data.loaded_cov[:3].sum(axis=0), data.loaded_cov[5:].sum(axis=0)]) / 3
    zero = np.array([data.zero_cov[:3].sum(axis=0), data.zero_cov[5:].sum(axis=0)]) / 3
    alone = np.array([data.idle.cov[2:5].sum(axis=0), data.idle.cov[5:].sum(axis=0)]) / 3
    np.testing.assert_allclose(own.cov, np.repeat(alone, 3, axis=0))
    one = np.mean([np.trace(C) for C in loaded])
    for got, turned, position in (
        (found.loaded_cov[::2], found.loaded_cov[1::2], loaded),
        (found.zero_cov[::2], found.zero_cov[1::2], zero),
        (alone, own.turned, alone),
    ):
        np.testing.assert_allclose(got, position)
        of = position if rad is None else [
            np.trace(C) / one * (L * rad) ** 2 * np.eye(3) for C in position
        ]  # fmt: skip
        np.testing.assert_allclose(turned, of)


def test_a_pose_cannot_be_had_of_too_few_targets_nor_of_half_a_noise() -> None:
    """Each refused with what to change."""
    none, rad = SimpleNamespace(sigma_rad=None), SimpleNamespace(sigma_rad=1e-4)
    with pytest.raises(InputError, match="all targets of a measured pose"):
        _in_poses(measured([0, 0, 2], [0, 1, 1]), UR10, TOOL, none)
    whole = measured([0, 0, 0], [0, 1, 2], noise_stated=False)
    with pytest.raises(InputError, match="sigma_rad but no noise"):
        _in_poses(whole, UR10, TOOL, rad)
    assert _in_poses(whole, UR10, TOOL, none).poses
    assert [tells_a_pose(POINTS[:n]) for n in (2, 3)] == [False, True]
    assert not tells_a_pose(np.outer(np.arange(4.0), [1.0, 2, 3]))


@pytest.mark.parametrize(("count", "far_m", "moves"), [(12, 4e-3, 1), (11, 4e-3, 0), (12, 3.0, 0)])
def test_points_are_moved_as_one_body(count: int, far_m: float, moves: int) -> None:
    """By all that are known in both frames; not by a few, and not by metres."""
    rng = np.random.default_rng(3)
    there, R = rng.normal(size=(14, 3)), Rotation.from_rotvec([0.002, -0.001, 0.003])
    at = R.inv().apply(there - [far_m, 0, 0])
    at[0], there[1] = np.nan, np.nan
    found = _in_frame(at[: count + 2], there[: count + 2])

    expected = R.apply(at) + np.array([far_m, 0, 0]) if moves else at
    np.testing.assert_allclose(found, expected[: count + 2], atol=1e-12)


def test_a_robot_that_did_not_grow_with_its_base_parts_from_it() -> None:
    """Halfway between two rounds by half of the strain, without the rotation of the round."""
    turn = Rotation.from_rotvec([1e-5, 2e-5, 3e-5]).as_matrix() - np.eye(3)
    gradient = np.array([np.zeros((3, 3)), 4e-5 * np.eye(3) + (turn - turn.T) / 2])
    centre = np.array([1.0, 2.0, 3.0])
    course = Course(
        ("a", "b"), np.array([0.0, 100.0]), centre, np.ones((2, 3)), gradient,
        np.array([0.0, 4e-5]), np.zeros(2), 6.0, 0.0, 0.0, 4,
    )  # fmt: skip
    points = np.random.default_rng(1).normal(size=(4, 3))
    found = course.parting(points, np.array([50.0, 100.0, np.nan, 500.0]))

    for k, share in enumerate((0.5, 1, 0, 1)):
        np.testing.assert_allclose(found[k, :, 0], share * 4e-5 * (points[k] - centre), atol=1e-18)
        np.testing.assert_allclose(found[k, :, 1:], share * 4e-5 * 6.0 * np.eye(3))


def two_days(force: float, b: list[float], **more: object) -> Measured:
    """One pose pulled along x on two days, read at one target: a = (1, 0, 0) mm and b."""
    pulls = Pulls.at(np.zeros((2, 6)), np.array([[1000.0, 0, 0], [force, 0, 0]]))
    pulls = replace(pulls, pose=np.array([1, 2]), time=np.array([0.0, 86400.0]))
    fields = {
        "pulls": pulls, "pull": np.arange(2), "target": np.zeros(2, int),
        "name": np.array(["P1", "P1"], object), "delta": np.array([[1e-3, 0, 0], b]),
        "unloaded": np.zeros((2, 3)), "loaded_cov": np.tile(4e-12 * np.eye(3), (2, 1, 1)),
        "zero_cov": np.tile(1e-12 * np.eye(3), (2, 1, 1)), "zero": np.arange(2),
        "reading_std": np.array([1.0, 2.0]), "direction_cov": np.zeros((2, 3, 3)),
        "rotation_cov": np.zeros((3, 3)), "scale": Scale(), "noise_stated": True,
    }  # fmt: skip
    return Measured(**(fields | more))


def test_the_scatter_of_two_days_is_a_sum_by_hand() -> None:
    """(f b - a) / a, its variance that of both readings, zeros and forces; chi-square of one."""
    data = two_days(980.0, [1.03e-3, 2e-4, 0.0])
    found = days(data)

    f = 1000 / 980
    g = f * 1.03 - 1
    u2 = (4e-12 + 1e-12) * (1 + f**2) / 1e-6 + (1 / 1000) ** 2 + (2 / 980) ** 2
    assert found.relative == pytest.approx(np.sqrt((g**2 - u2) / 2), rel=1e-9)
    assert found.p_value == pytest.approx(stats.chi2.sf(g**2 / u2, 1), rel=1e-9)
    assert (found.poses, found.day.tolist()) == (1, [0, 1])


def test_days_are_not_compared_without_a_noise_a_time_or_a_like_force() -> None:
    """A noise that was found is as good as a stated one."""
    b = [1.03e-3, 0.0, 0.0]
    assert days(two_days(980.0, b, noise_stated=False)) is None
    assert days(two_days(980.0, b, noise_stated=False, found_m=1e-5)) is not None
    assert days(two_days(960.0, b)) is None
    known = two_days(980.0, b)
    for time in ([0.0, np.nan], [0.0, 3600.0]):
        assert days(replace(known, pulls=replace(known.pulls, time=np.array(time)))) is None


def base_table(points: np.ndarray, nominal: np.ndarray, std: float) -> pd.DataFrame:
    """Table REGISTRATION of readings that are in F_b."""
    at = dict(zip([*XYZ, *OFF], np.hstack([points, points - nominal]).T, strict=True))
    noise = {name: std**2 * (name[1] == name[2]) for name in SIX}
    return pd.DataFrame({"target": [f"B{k}" for k in range(len(points))], **at, **noise})


@pytest.mark.parametrize(("stated", "noise"), [(True, 2e-5), (True, 4e-4), (False, 2e-5)])
def test_a_base_reflector_grossly_off_is_left_out_of_the_registration(
    stated: bool, noise: float
) -> None:
    """The pose is that of Kabsch's closed form by the others; equal noise weighs them equally."""
    rng, std = np.random.default_rng(2), 2e-5
    nominal = rng.normal(size=(9, 3)) * 4
    R, t = Rotation.from_rotvec([0.4, -0.2, 1.0]), np.array([1.0, -2.0, 0.5])
    points = R.inv().apply(nominal - t) + noise * rng.normal(size=(9, 3))
    good = np.arange(9) != 4
    points[4] += [0.3, 0.0, 0.0]
    rough = Rotation.from_rotvec([0.4, -0.21, 1.0]), t + 0.03
    table = base_table(rough[0].apply(points) + rough[1], nominal, std if stated else np.nan)
    before = Registration(
        rough[0].as_matrix(), rough[1], np.eye(6), np.zeros(3), table,
        1e9 if stated else None, 21,
    )  # fmt: skip
    found, agree = agreed(before)

    own, middle = nominal[good], points[good].mean(axis=0)
    best, _ = Rotation.align_vectors(own - own.mean(axis=0), points[good] - middle)
    shift = own.mean(axis=0) - best.apply(middle)
    assert agree.tolist() == good.tolist()
    np.testing.assert_allclose(found.R, best.as_matrix(), atol=1e-10)
    np.testing.assert_allclose(found.t, shift, atol=1e-9)
    left = best.apply(points) + shift - nominal
    chi2 = np.sum(left[good] ** 2) / std**2
    assert found.dof == 18
    assert found.from_scatter == (not stated or noise > std)
    assert found.chi2 == (pytest.approx(chi2, rel=1e-6) if stated else None)
    np.testing.assert_allclose(found.table[OFF], left, atol=1e-9)
    scatter = np.sum(left[good] ** 2) / 18 if found.from_scatter else std**2
    np.testing.assert_allclose(np.diag(found.cov)[3:], scatter / 8, rtol=1e-4)
    clean = replace(before, table=table[good].reset_index(drop=True))
    again, every = agreed(clean)
    assert again is clean
    assert every.all()


def test_without_a_base_frame_readings_are_where_they_are() -> None:
    """No rotation, no uncertainty, no degree of freedom."""
    table = base_table(np.ones((2, 3)), np.ones((2, 3)), 1e-5).drop(columns=OFF)
    table = table.assign(pose=pd.array([1, None], "Int32"), group="a", file="t", line=1)
    table = table.assign(time=pd.NaT)
    found = register(SimpleNamespace(base_frame={}), table)

    assert (found.dof, found.chi2) == (0, None)
    np.testing.assert_array_equal(found.R, np.eye(3))
    assert not found.t.any()
    assert not found.cov.any()


def test_a_time_of_day_alone_is_no_date() -> None:
    """Programs write it on the first day of 1900."""
    early, late = datetime(1900, 1, 1, 8), datetime(2026, 3, 1, 8)
    assert dated(pd.Series([pd.NaT, pd.Timestamp(late)]))
    assert not dated(pd.Series([pd.Timestamp(early), pd.Timestamp(early)]))
    assert not dated(pd.Series([pd.NaT, pd.NaT]))


def test_a_force_points_from_one_end_of_the_chain_to_the_other() -> None:
    """Ends in any row, also the first; a pull without both of them has no force."""
    rng = np.random.default_rng(5)
    rows = [(1, 2, "L2"), (1, 1, "L1"), (1, 1, "L2"), (1, 2, "L1"), (2, 1, "L1"), (3, 1, "L2"),
            (1, 2, "P1"), (1, 2, "P1")]  # fmt: skip
    pose, repeat, target = zip(*rows, strict=True)
    xyz, C = rng.normal(size=(8, 3)), covariances(rng, 8)
    placed = pd.DataFrame(
        {"pose": np.array(pose), "repeat": np.array(repeat), "target": pd.Categorical(target),
         "state": pd.Categorical(["loaded"] * 8), "time_s": np.arange(8.0),
         **dict(zip(XYZ, xyz.T, strict=True)),
         **{name: C[:, "xyz".index(name[1]), "xyz".index(name[2])] for name in SIX}}
    )  # fmt: skip
    loads = pd.DataFrame(
        {"pose": [3, 1, 2, 1], "repeat": [1, 2, 1, 1], "force_n": [70.3, 512.7, 90.1, 1041.9],
         "branch": pd.Categorical(["up", "down", "up", "up"])}
    )  # fmt: skip
    settings = SimpleNamespace(
        naming=SimpleNamespace(chain=("L1", "L2")), measured=["P1"], payload={},
        gravity=SimpleNamespace(vector=np.array([0, 0, -9.81])),
        scale=SimpleNamespace(sigma_n=3.0, sigma_rel=0.004),
    )  # fmt: skip
    found = forces(settings, placed, loads)

    assert found[["pose", "repeat"]].to_numpy().tolist() == [[1, 1], [1, 2]]
    for k, (near, far, size) in enumerate([(1, 2, 1041.9), (3, 0, 512.7)]):
        chain = xyz[far] - xyz[near]
        L = np.sqrt(chain @ chain)
        across = np.eye(3) - np.outer(chain, chain) / L**2
        np.testing.assert_allclose(found[["fx_n", "fy_n", "fz_n"]].iloc[k], size * chain / L)
        own = across @ (C[near] + C[far]) @ across / L**2
        six = [own["xyz".index(p[1]), "xyz".index(p[2])] for p in SIX]
        u = [f"u{name[1:3]}" for name in SIX]
        np.testing.assert_allclose(found[u].iloc[k], six, rtol=1e-9, atol=1e-20)
        std = np.sqrt(3.0**2 + (0.004 * size) ** 2)
        assert found["reading_std_n"][k] == pytest.approx(std, rel=1e-3)
    assert found["branch"].tolist() == [1, -1]
    assert found["time_s"].tolist()[1] == 6.5
    assert np.isnan(found["time_s"][0])


def test_a_reading_that_repeats_the_row_before_is_named() -> None:
    """Of another target of the same state and file; base readings have no state."""
    position = np.array([[1.0, 2, 3]] * 7)
    position[2] = [1.0, 2, 4]
    shots = SimpleNamespace(
        position=position, slot=np.array([0, 0, 0, 0, 1, -1, -1]),
        role=np.array([0, 1, 2, 0, 1, 2, 3]), file=np.zeros(7, int), files=("t.csv",),
        line=np.arange(2, 9), group=pa.array([*"aaaabcc"]),
        target=pa.array(["P1", "P2", "P3", "P1", "P2", "B1", "B2"]),
    )  # fmt: skip
    told = stale(shots)
    assert [(one.group, one.target, one.of, one.file, one.line) for one in told] == [
        ("a", "P2", "P1", "t.csv", 3)
    ]
    for other in ({"role": np.zeros(7, int)}, {"file": np.arange(7)}, {"slot": np.arange(7)}):
        assert stale(SimpleNamespace(**(vars(shots) | other))) == ()


def test_joint_values_are_those_of_the_log_in_the_order_of_poses() -> None:
    """A pose that the log lacks is an error; limits are those of the robot."""
    q = np.zeros((3, 6))
    q[:, 1] = [0.1, 0.2, UR10.upper[1] + 0.5]
    names = Case(None, UR10, None, None, None, None).joint_columns
    log = pd.DataFrame(dict(zip(names, q.T, strict=True)))
    case = Case(None, UR10, None, None, log.assign(pose=[7, 3, 9], file="j", line=[4, 5, 6]), None)

    np.testing.assert_array_equal(case.q(np.array([3, 7, 3])), q[[1, 0, 1]])
    with pytest.raises(KeyError, match="8"):
        case.q(np.array([3, 8]))
    (one,) = beyond(case)
    assert (one.pose, one.joint.name, one.line) == (9, UR10.joints[1].name, 6)
    assert one.over == pytest.approx(0.5)
    assert beyond(replace(case, joints=case.joints[:0])) == []


@pytest.mark.parametrize("moved", [True, False])
def test_two_rounds_exchanged_in_the_file_are_exchanged_back(moved: bool) -> None:
    """As if they had been right: stations, and all readings as from the first one."""
    rng = np.random.default_rng(7)
    base = {f"B{k}": at for k, at in enumerate(rng.normal(size=(4, 3)) * 5)}
    nominal, R = np.array(list(base.values())), Rotation.from_rotvec([0.1, 0.2, -0.3])
    carried = np.array([1.0, 0.5, 0.0])
    later = R.apply(nominal) + carried
    xyz = np.vstack([nominal, later, R.apply(nominal + 0.01) + carried])
    C = covariances(rng, 12)
    true = pd.DataFrame(
        {"group": ["a"] * 4 + ["b"] * 4 + ["p"] * 4, "target": [*base] * 3,
         "pose": pd.array([None] * 8 + [1] * 4, "Int32"),
         "time": pd.Timestamp("2026-01-01") + pd.to_timedelta(np.repeat([0, 60, 90], 4), unit="s"),
         **dict(zip(XYZ, xyz.T, strict=True)),
         **{name: C[:, "xyz".index(name[1]), "xyz".index(name[2])] for name in SIX}}
    )  # fmt: skip
    settings = SimpleNamespace(base_frame=base)
    wrong = true.copy()
    wrong.loc[range(8), XYZ + SIX] = true.loc[[4, 5, 6, 7, 0, 1, 2, 3], XYZ + SIX].to_numpy()
    seen, stations = one_station(settings, wrong) if moved else (wrong, ())
    again, told = with_rounds_exchanged(settings, seen, stations, ("a", "b"))

    expected, right = one_station(settings, true)
    np.testing.assert_allclose(again[XYZ], expected[XYZ], atol=1e-9)
    np.testing.assert_allclose(again[SIX], expected[SIX], atol=1e-18)
    assert [one.group for one in told] == ["b"]
    np.testing.assert_allclose(told[0].turn, right[0].turn, atol=1e-9)
    np.testing.assert_allclose(again[XYZ][4:8], nominal, atol=1e-9)
    same, kept = with_rounds_exchanged(settings, seen, stations, ("a", "nowhere"))
    assert same is seen
    assert kept == tuple(stations)
