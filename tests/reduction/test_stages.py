"""Stages on small tables with an answer known independently."""

import re

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pipeline.base import covariance
from pipeline.base.errors import InputError
from pipeline.machine.robot import load
from pipeline.reduction.displacements import displacements
from pipeline.reduction.forces import forces
from pipeline.reduction.growth import BaseGrowth
from pipeline.reduction.idle import idle
from pipeline.reduction.register import XYZ, Registration, agreed, place, register
from pipeline.reduction.settings import parse
from pipeline.tables import joint_column

SETTINGS = """
format = 1
name = "t"
robot = "kr500_rail"
[tracker]
files = ["t.csv"]
sigma_m = 3e-5
[scale]
sigma_n = 2.0
sigma_rel = 0.001
[base_frame]
B1 = [0.6, -0.5, -0.30]
B2 = [0.6, 18.5, -0.30]
B3 = [-0.6, 18.5, -0.28]
B4 = [2.0, 9.0, 3.0]
[tool]
load_point = [0.15, 0.0, 0.25]
P1 = [0.20, 0.05, 0.12]
P2 = [-0.12, 0.19, 0.10]
P3 = [-0.10, -0.18, 0.22]
"""
START = pd.Timestamp("2026-11-03T08:00:00")


def readings(rows, cov=None):
    """Table READINGS from (group, target, pose, repeat, state, xyz, seconds)."""
    frame = pd.DataFrame(
        rows, columns=["group", "target", "pose", "repeat", "state", "xyz", "seconds"]
    )
    xyz = np.array(frame.pop("xyz").tolist(), dtype=float)
    C = np.broadcast_to(np.eye(3) * 9e-10, (len(frame), 3, 3)) if cov is None else cov
    return frame.assign(
        file="t.csv",
        line=np.arange(2, len(frame) + 2),
        **dict(zip(["x_m", "y_m", "z_m"], xyz.T, strict=True)),
        **dict(zip(covariance.columns(), covariance.flat(C).T, strict=True)),
        covariance_from="stated",
        time=START + pd.to_timedelta(frame["seconds"], unit="s"),
        time_s=frame.pop("seconds").astype(float),
    )


@pytest.fixture
def settings():
    return parse(SETTINGS)


def base_rows(settings, R, t, rng=None, sigma=0.0):
    """Readings of base reflectors by a tracker at (R, t): p_t = R' (p_b - t)."""
    rows = []
    for i, (name, at) in enumerate(settings.base_frame.items()):
        seen = R.T @ (np.array(at) - t) + (sigma * rng.standard_normal(3) if rng else 0.0)
        rows.append(("base_start", name, None, None, None, seen, i))
    return rows


R0 = Rotation.from_euler("zyx", [130, 2, -3], degrees=True).as_matrix()
T0 = np.array([4.0, 7.5, 1.4])


def test_exact_base_readings_give_back_the_trackers_place(settings):
    """Rotation and origin to rounding, residuals zero."""
    found = register(settings, readings(base_rows(settings, R0, T0)))

    assert np.abs(found.R - R0).max() < 1e-14
    assert np.abs(found.t - T0).max() < 1e-13
    assert found.table[["dx_m", "dy_m", "dz_m"]].abs().to_numpy().max() < 1e-13


@pytest.mark.parametrize("yaw", range(0, 360, 30))
def test_three_reflectors_in_a_plane_never_mirror_the_hall(yaw):
    """Coplanar points also fit a reflection: the result is a rotation."""
    settings = parse(SETTINGS.replace("B4 = [2.0, 9.0, 3.0]\n", ""))
    R = Rotation.from_euler("zyx", [yaw, 1, 2], degrees=True).as_matrix()
    found = register(settings, readings(base_rows(settings, R, T0)))

    assert np.abs(found.R - R).max() < 1e-13


def test_weighted_registration_is_the_maximum_of_the_likelihood(settings):
    """With unequal full covariances the fit equals that of a generic optimiser."""
    rng = np.random.default_rng(5)
    table = readings(base_rows(settings, R0, T0, rng, 2e-4))
    half = rng.normal(size=(len(table), 3, 3)) * 1e-4
    C = half @ np.swapaxes(half, 1, 2) + 1e-9 * np.eye(3)
    table[covariance.columns()] = covariance.flat(C)
    nominal = np.array(list(settings.base_frame.values()))
    points = table[["x_m", "y_m", "z_m"]].to_numpy()
    W = [np.linalg.cholesky(np.linalg.inv(c)).T for c in C]

    def misfit(p):  # in the tracker's frame, where the covariances are given
        R = Rotation.from_rotvec(p[:3]).as_matrix() @ R0
        t = T0 + p[3:]
        back = (nominal - t) @ R
        return np.concatenate([w @ (x - y) for w, x, y in zip(W, points, back, strict=True)])

    best = least_squares(misfit, np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale=1e-4)
    found = register(settings, table)
    expected = Rotation.from_rotvec(best.x[:3]).as_matrix() @ R0

    assert np.abs(found.R - expected).max() < 1e-8
    assert np.abs(found.t - T0 - best.x[3:]).max() < 1e-7
    assert found.chi2 == pytest.approx(2 * best.cost, rel=1e-6)
    assert found.dof == 3 * 4 - 6


@pytest.mark.slow
def test_a_base_reading_that_is_left_out_takes_its_three_coordinates_with_it():
    """Five reflectors, one of them half a metre off: 4 * 3 - 6 degrees of freedom are left."""
    settings = parse(SETTINGS.replace("[tool]", "B5 = [3.0, 2.0, 1.0]\n[tool]"))
    table = readings(base_rows(settings, R0, T0))
    table.loc[4, "z_m"] += 0.5
    found, agree = agreed(register(settings, table))

    assert agree.tolist() == [True] * 4 + [False]
    assert found.dof == 4 * 3 - 6
    assert np.abs(found.t - T0).max() < 1e-9


@pytest.mark.whole
def test_registration_claims_the_scatter_it_has(settings):
    """Over 400 noisy registrations the rotation scatters as its covariance states."""
    rng = np.random.default_rng(9)
    turns, claims = [], []
    for _ in range(400):
        found = register(settings, readings(base_rows(settings, R0, T0, rng, 3e-5)))
        turns.append(Rotation.from_matrix(found.R @ R0.T).as_rotvec())
        claims.append(np.diag(found.cov)[:3])

    ratio = np.var(turns, axis=0) / np.mean(claims, axis=0)

    assert (np.abs(ratio - 1) < 5 * np.sqrt(2 / 400)).all()


def test_a_reading_without_any_uncertainty_is_refused(settings):
    """It would dominate all others; the message names its line."""
    table = readings(base_rows(settings, R0, T0))
    for nothing in (0.0, 1e-320):
        table.loc[2, covariance.columns()] = [nothing, 0.0, 0.0, nothing, 0.0, nothing]
        with pytest.raises(InputError, match=r"t\.csv:4: the uncertainty of B3 is zero"):
            register(settings, table)


def test_two_base_reflectors_are_refused(settings):
    """The message states their number."""
    with pytest.raises(InputError, match="only 2 base reflectors"):
        register(settings, readings(base_rows(settings, R0, T0)[:2]))


def test_base_reflectors_on_a_line_are_refused():
    """Three collinear reflectors leave the rotation about their line undetermined."""
    text = SETTINGS.replace("B3 = [-0.6, 18.5, -0.28]\nB4 = [2.0, 9.0, 3.0]", "B3 = [0.6, 9, -0.3]")
    settings = parse(text)
    with pytest.raises(InputError, match="on one line"):
        register(settings, readings(base_rows(settings, R0, T0)))


@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-3])
def test_base_reflectors_in_one_place_are_refused(apart):
    """They define no direction; half-inch balls cannot be a millimetre apart."""
    places = [[0.6 + k * apart, -0.5, -0.3 + k % 2 * apart] for k in range(4)]
    text = SETTINGS
    for k, at in enumerate(places, 1):
        text = re.sub(rf"B{k} = .*", f"B{k} = {at}", text)
    settings = parse(text)
    with pytest.raises(InputError, match="B1, B2, B3, B4 are all in one place"):
        register(settings, readings(base_rows(settings, R0, T0)))


def test_placing_turns_points_and_covariances(settings):
    """A reading with known position in F_b is recovered; its covariance rotates with it."""
    p = np.array([1.0, 5.0, 0.7])
    C = np.diag([1e-10, 4e-10, 9e-10])
    rows = [
        *base_rows(settings, R0, T0),
        ("pose01_rep1_loaded", "P1", 1, 1, "loaded", R0.T @ (p - T0), 9),
    ]  # the first reading is that of a base reflector at 0 s
    table = readings(rows)
    table.loc[len(table) - 1, covariance.columns()] = covariance.flat(C[None])[0]

    placed = place(register(settings, table), table)

    assert np.abs(placed[["x_m", "y_m", "z_m"]].to_numpy() - p).max() < 1e-12
    assert placed["time_s"].tolist() == [9.0]
    assert np.abs(covariance.matrices(placed)[0] - R0 @ C @ R0.T).max() < 1e-20


LOADS = pd.DataFrame(
    {"pose": [1], "repeat": [1], "force_n": [3000.0], "branch": ["down"], "file": "l", "line": 2}
)


def chain_rows(near, far):
    return [
        ("pose01_rep1_loaded", "Pl1", 1, 1, "loaded", near, 10),
        ("pose01_rep1_loaded", "Pl2", 1, 1, "loaded", far, 20),
    ]


def test_force_points_from_the_robot_to_the_anchor(settings):
    """Eqs. (10), (11): 3000 N along (2, -1, -2)/3 from Pl1 to Pl2."""
    near = np.array([1.0, 2.0, 1.5])
    table = forces(settings, readings(chain_rows(near, near + np.array([0.4, -0.2, -0.4]))), LOADS)

    assert table[["fx_n", "fy_n", "fz_n"]].to_numpy()[0] == pytest.approx([2000, -1000, -2000])
    assert table["branch"][0] == -1
    assert table["reading_std_n"][0] == pytest.approx(np.sqrt(2.0**2 + 3.0**2))


def test_direction_covariance_is_the_scatter_of_the_direction(settings):
    """Monte Carlo of the two chain reflectors with unequal covariances."""
    rng = np.random.default_rng(3)
    near, far = np.array([1.0, 2.0, 1.5]), np.array([1.3, 1.9, 1.1])
    C = np.array([np.diag([4e-10, 1e-10, 9e-10]), np.diag([1e-10, 16e-10, 1e-10])])
    table = forces(settings, readings(chain_rows(near, far), C), LOADS)
    noise = rng.standard_normal((2, 40000, 3)) * np.sqrt([np.diag(c) for c in C])[:, None, :]
    chain = far + noise[1] - near - noise[0]
    u = chain / np.linalg.norm(chain, axis=1, keepdims=True)

    claimed = covariance.matrices(table, covariance.columns("u", ""))[0]

    assert np.abs(np.cov(u.T) - claimed).max() < 0.03 * np.abs(claimed).max()


def test_zeros_before_and_after_are_averaged_and_shared(settings):
    """Displacement is loaded minus the mean zero; the zero's variance halves; time is its mean."""
    rows = []
    for repeat, state, x, seconds in [
        (0, "unloaded", 1.000, 0),
        (1, "loaded", 1.010, 60),
        (2, "loaded", 1.020, 120),
        (3, "unloaded", 1.002, 180),
    ]:
        group = f"pose01_rep{repeat}_{state}"
        rows.append((group, "P1", 1, repeat, state, np.array([x, 2.0, 3.0]), seconds))

    table = displacements(settings, readings(rows))

    assert table["dx_m"].to_numpy() == pytest.approx([0.009, 0.019])
    assert table["zero_cxx_m2"].to_numpy() == pytest.approx([4.5e-10, 4.5e-10])
    assert table["loaded_cxx_m2"].to_numpy() == pytest.approx([9e-10, 9e-10])
    assert (table["zero_time_s"] == 90).all()
    assert (table["zero_count"] == 2).all()


def test_a_target_without_a_zero_has_no_displacement(settings):
    """P2 was not read unloaded: its loaded reading is of no use."""
    at = np.array([1.0, 2.0, 3.0])
    rows = [
        ("pose01_rep0_unloaded", "P1", 1, 0, "unloaded", at, 0),
        ("pose01_rep1_loaded", "P1", 1, 1, "loaded", at, 60),
        ("pose01_rep1_loaded", "P2", 1, 1, "loaded", at, 70),
    ]

    assert displacements(settings, readings(rows))["target"].tolist() == ["P1"]


def test_the_order_of_rows_does_not_matter(settings):
    """Readings and loads in any order, names as text or as codes: the same tables."""
    rng = np.random.default_rng(4)
    rows, loads = [], []
    for pose in (3, 1, 2):
        for repeat, state in [(0, "unloaded"), (1, "loaded"), (2, "loaded"), (3, "unloaded")]:
            group = f"pose{pose}_rep{repeat}_{state}"
            names = ["P1", "P2", "P3"] + (["Pl1", "Pl2"] if state == "loaded" else [])
            rows += [(group, n, pose, repeat, state, rng.normal(size=3), len(rows)) for n in names]
            loads += [(pose, repeat, 100.0 * repeat, "up")] * (state == "loaded")
    table = readings(rows)
    loads = pd.DataFrame(loads, columns=["pose", "repeat", "force_n", "branch"])
    mixed, mixed_loads = table.sample(frac=1, random_state=1), loads.sample(frac=1, random_state=2)
    coded = mixed.astype({"target": "category", "state": "category"})

    for other in (mixed, coded):
        pulled, moved = forces(settings, other, mixed_loads), displacements(settings, other)
        pd.testing.assert_frame_equal(pulled, forces(settings, table, loads), rtol=1e-12)
        pd.testing.assert_frame_equal(moved, displacements(settings, table), rtol=1e-12)
    assert len(pulled) == 6
    assert len(moved) == 18


def test_a_time_that_is_missing_leaves_the_others(settings):
    """The mean time of a pull is that of its readings with a time."""
    at = np.array([1.0, 2.0, 3.0])
    rows = [("g", name, 1, 1, "loaded", at, s) for name, s in [("P1", 10), ("P2", 20), ("P3", 90)]]
    table = readings([*rows, *chain_rows(at, at + 0.3)])
    table.loc[2, "time_s"] = np.nan

    assert forces(settings, table, LOADS)["time_s"].tolist() == [15.0]


@pytest.mark.parametrize("same", [True, False])
def test_covariances_turn_as_matrices_do(same):
    """Columns of R C R', all equal or all different; singular ones are detected."""
    rng = np.random.default_rng(6)
    half = rng.normal(size=(50, 3, 3)) * 1e-5
    half[7, :, 2] = half[7, :, 0]  # singular in one direction
    C = half @ np.swapaxes(half, 1, 2)
    C = np.broadcast_to(C[3], C.shape) if same else C
    six = list(np.ascontiguousarray(covariance.flat(C).T))

    turned = covariance.full(covariance.turned(six, R0))

    assert np.abs(turned - R0 @ C @ R0.T).max() < 1e-24
    assert np.flatnonzero(covariance.singular(six)).tolist() == ([] if same else [7])


def test_readings_on_a_grown_base_are_smaller_with_their_errors():
    """Grown by a half, lengths are two thirds and covariances four ninths of those read."""
    read = pd.DataFrame({"pose": [1, 1], "repeat": [0, 0], "state": "unloaded", "group": "g",
                         "target": ["A", "B"], "x": [3.0, 0.0], "y": [0.0, 6.0], "z": 1.5,
                         "cxx_m2": 9e-10, "cxy_m2": 0.0, "cxz_m2": 0.0, "cyy_m2": 18e-10,
                         "cyz_m2": 0.0, "czz_m2": 27e-10})  # fmt: skip
    read = read.rename(columns=dict(zip("xyz", XYZ, strict=True))).assign(time=pd.NaT)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    there = Registration(quarter, np.array([0.0, 0.0, 1.5]), np.eye(6), np.zeros(3),
                         pd.DataFrame(), None, 0, growth=BaseGrowth(value=0.5))  # fmt: skip
    found = place(there, read)

    assert found[XYZ].to_numpy() == pytest.approx(np.array([[0, 2, 2], [-4, 0, 2]]), abs=1e-12)
    assert found["cxx_m2"].to_numpy() == pytest.approx([8e-10] * 2)
    assert found["cyy_m2"].to_numpy() == pytest.approx([4e-10] * 2)
    assert found["czz_m2"].to_numpy() == pytest.approx([12e-10] * 2)


@pytest.mark.parametrize("stated", [True, False])
def test_poses_without_a_pull_count_by_their_readings(settings, stated):
    """Three of pose 3, one of pose 2: means with a third of the variance; pose 1 was pulled."""
    robot, names = load("kr500_rail"), settings.measured
    steps = {1: [0.0], 2: [0.1], 3: [0.2, 0.3, 0.7]}
    rows = [
        (f"p{pose}_{k}", name, pose, k, "unloaded", np.array([x, pose, 3.0]), 60.0 * k + pose)
        for pose, each in steps.items() for k, x in enumerate(each) for name in names[::-1]
    ]  # fmt: skip
    C = np.tile(4e-10 * np.eye(3) if stated else np.full((3, 3), np.nan), (len(rows), 1, 1))
    columns = [joint_column(joint.name, joint.prismatic) for joint in robot.joints]
    q = 0.1 * np.arange(21.0).reshape(3, 7)
    joints = pd.DataFrame(q, columns=columns).assign(pose=[1, 2, 3], approach=[1.0, -1.0, 1.0])

    found = idle(settings, robot, joints, readings(rows, C), np.array([1]))

    n = len(names)
    assert found.pulls.pose.tolist() == [2] * n + [3] * n
    assert found.target.tolist() == [*range(n)] * 2
    assert found.at == pytest.approx(np.repeat([[0.1, 2, 3], [0.4, 3, 3]], n, axis=0))
    unit = 4e-10 if stated else 1.0
    expected = unit * np.repeat([1, 1 / 3], n)[:, None, None] * np.eye(3)
    assert found.cov == pytest.approx(expected, rel=1e-9)
    assert found.pulls.q == pytest.approx(np.repeat(q[1:], n, axis=0))
    assert found.pulls.time == pytest.approx(np.repeat([2.0, 63.0], n))
    assert found.pulls.approach.tolist() == [-1.0] * n + [1.0] * n
    assert not found.pulls.force.any()
