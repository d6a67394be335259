"""Contrasts that contain noise only: what they exclude, what they include, and covariances."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from pipeline.base import covariance
from pipeline.machine.cell import Tool, paper_cell, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import load
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Scale, parse
from pipeline.system.assemble import assemble
from pipeline.system.contrasts import ZEROS, Zeros, pure_error, repeated_zeros, stacked, ways

KR500 = load("kr500_rail")
X = KR500.nominal_compliance
POINTS = np.array([[0.20, 0.05, 0.12], [-0.12, 0.19, 0.10], [-0.10, -0.18, 0.22]])
NO_ZEROS = Zeros(*[np.zeros(0, int)] * 3, np.zeros((0, 3)), np.zeros((0, 3, 3)))


def tool(targets=3):
    names = np.array([f"P{k + 1}" for k in range(targets)], object)
    return Tool(np.array([0.15, 0.0, 0.25]), names, POINTS[:targets])


def cell(targets=3):
    return paper_cell(KR500, tool(targets))


def tilted(rng, count, size):
    """Covariances with arbitrary axes and standard uncertainties of about `size`."""
    half = size * (rng.standard_normal((count, 3, 3)) + 2 * np.eye(3))
    return half @ half.swapaxes(1, 2)


def campaign(pulls, rng, targets=3, stated=True):
    """Measurements of some pulls (pose, force, branch, time) with tilted covariances."""
    pose, force, branch, time = (np.array(column) for column in zip(*pulls, strict=True))
    force = force.astype(float)
    m = len(pose)
    q = rng.uniform(KR500.lower, KR500.upper, (pose.max() + 1, KR500.n))[pose]
    repeat = np.array([np.sum(pose[:i] == pose[i]) for i in range(m)])
    none = np.zeros(m)
    asked = Pulls(pose, repeat, q, force, branch.astype(float), none, time.astype(float), none)
    moved = predict(cell(targets), asked, X)
    target = np.tile(np.arange(targets), m)
    zero = pose.repeat(targets) * targets + target
    d = m * targets
    return Measured(
        pulls=asked, pull=np.repeat(np.arange(m), targets), target=target,
        name=cell(targets).tool.targets[target], delta=moved.displacement.reshape(-1, 3),
        unloaded=moved.unloaded.reshape(-1, 3), loaded_cov=tilted(rng, d, 3e-5),
        zero_cov=tilted(rng, zero.max() + 1, 2e-5)[zero], zero=zero,
        reading_std=np.full(m, 8.0), direction_cov=tilted(rng, m, 1e-4),
        rotation_cov=1e-10 * np.eye(3), scale=Scale(gain_sigma=2e-3), noise_stated=stated,
        joint_std=np.zeros(KR500.n),
    )  # fmt: skip


EAST, NORTH = np.array([3000.0, 0.0, -400.0]), np.array([0.0, 2500.0, -900.0])
THREE = [(0, EAST, 1, 0), (0, 1.02 * EAST, 1, 1), (0, 0.99 * EAST, 1, 2), (0, NORTH, 1, 3)]
MORE = [*THREE, (2, NORTH, 1, 4), (2, NORTH, 1, 5), (2, 0.5 * NORTH, 1, 6)]


def zeros(data, rng, poses, each, targets=3):
    """Repeated zeros of every target, numbered from 1."""
    rows = [(p, t, n) for p in poses for t in range(targets) for n in range(1, each + 1)]
    pose, target, which = np.array(rows).T
    return Zeros(
        pose, target, which, 3e-5 * rng.standard_normal((len(pose), 3)),
        tilted(rng, len(pose), 2e-5),
    )  # fmt: skip


@pytest.fixture
def rng():
    return np.random.default_rng(12)


def as_contrasts(data, residual, again=NO_ZEROS, system=None):
    here = cell(len(set(data.target.tolist())))
    return pure_error(system or assemble(here, data, X), residual, data, again, here)


def rigid(points, rng):
    """Displacement of points by a small rigid motion, a rotation about an arbitrary point [m]."""
    turn, shift = 1e-7 * rng.standard_normal(3), 1e-6 * rng.standard_normal(3)
    centre = rng.standard_normal(3)
    return Rotation.from_rotvec(turn).apply(points - centre) - (points - centre) + shift


def test_what_moves_the_effector_as_a_whole_is_no_noise(rng):
    """Any rigid motion proportional to the force, a different one for each set of equal pulls."""
    data = campaign(MORE, rng)
    size = np.linalg.norm(data.pulls.force, axis=1)
    residual = 1e-5 * rng.standard_normal(3 * len(data.pull))
    more = np.zeros((len(data.pull), 3))
    for equal in ([0, 1, 2], [3], [4, 5], [6]):
        motion = rigid(data.unloaded[data.pull == equal[0]], rng)
        for pull in equal:
            more[data.pull == pull] = motion * size[pull] / 3000.0

    plain, moved = (as_contrasts(data, r).c for r in (residual, residual + more.ravel()))

    assert np.abs(more).max() > 1e-6
    assert moved == pytest.approx(plain, abs=1e-12)


def test_everything_else_is_seen(rng):
    """Each set of equal pulls loses exactly six coordinates."""
    data = campaign(MORE, rng)
    residual = 1e-5 * rng.standard_normal(3 * len(data.pull))
    before = as_contrasts(data, residual)
    alone = residual.copy()
    alone[4] += 1e-5  # one reflector of the first pull alone

    assert len(before.c) == (27 - 6) + (9 - 6) + (18 - 6) + (9 - 6)
    assert before.parameters == ()
    assert before.B.shape == (len(before.c), 0)
    assert np.linalg.norm(as_contrasts(data, alone).c - before.c) > 3e-6
    other = rigid(data.unloaded[data.pull == 0], rng)  # in one of two equal pulls only
    apart = residual.copy()
    apart[np.repeat(data.pull == 1, 3)] += other.ravel()
    assert np.linalg.norm(as_contrasts(data, apart).c - before.c) > 1e-7


def linear_map(work, n):
    """The matrix of a linear function of n numbers, column by column."""
    return np.column_stack([work(column) for column in np.eye(n)])


def test_the_stated_covariance_is_that_of_the_readings(rng):
    """Each reading propagated through the contrasts: K V K' is that of their own errors."""
    data = campaign(MORE, rng)
    again = zeros(data, rng, [0, 2], 2)
    n, k = 3 * len(data.pull), again.delta.size
    system = assemble(cell(), data, X)

    def of(both):
        made = replace(again, delta=both[n:].reshape(-1, 3))
        return as_contrasts(data, both[:n], made, system).c

    K = linear_map(of, n + k)
    V = np.zeros((n + k, n + k))
    V[:n, :n] = (system.errors.G @ system.errors.G.T).toarray()
    for i, C in enumerate(again.cov):
        at = slice(n + 3 * i, n + 3 * i + 3)
        V[at, at] = C
    stated = as_contrasts(data, np.zeros(n), again).errors
    stated_V = (stated.G @ stated.G.T).toarray()

    assert stated_V == pytest.approx(K @ V @ K.T, rel=1e-9, abs=1e-9 * stated_V.max())
    size = np.linalg.norm(data.pulls.force, axis=1)
    first = size[[0, 0, 0, 3, 4, 4, 6]] / size
    plain = K / np.append(np.repeat(first[data.pull], 3), np.ones(k))
    assert pytest.approx(np.eye(len(K)), abs=1e-12) == plain @ plain.T


def test_each_contrast_knows_its_pose_and_whether_it_is_of_zeros(rng):
    """A reading enters contrasts of its own pose only, a zero only those of zeros."""
    data = campaign(MORE, rng)
    again = zeros(data, rng, [0, 2], 1)
    flat = np.zeros(3 * len(data.pull))
    made = as_contrasts(data, flat, again)

    for pose in (0, 2):
        residual = flat.copy()
        residual[np.repeat(data.pulls.pose[data.pull] == pose, 3)] = rng.standard_normal(
            3 * int(np.sum(data.pulls.pose[data.pull] == pose))
        )
        change = as_contrasts(data, residual, again).c != made.c
        assert (change == ((made.rows.pose == pose) & (made.rows.pull != ZEROS))).all()
        delta = again.delta + (again.pose == pose)[:, None] * rng.standard_normal((6, 3))
        change = as_contrasts(data, flat, replace(again, delta=delta)).c != made.c
        assert (change == ((made.rows.pose == pose) & (made.rows.pull == ZEROS))).all()


def test_zeros_may_move_as_one_body_and_not_by_themselves(rng):
    """With three reflectors any rigid motion each time; with two none is assumed."""
    for targets, blind in ((3, True), (2, False)):
        data = campaign(THREE, rng, targets)
        again = zeros(data, rng, [0], 2, targets)
        flat = np.zeros(3 * len(data.pull))
        motion = np.empty_like(again.delta)
        for which in (1, 2):
            motion[again.which == which] = rigid(data.unloaded[:targets], rng)
        plain, moved = (
            as_contrasts(data, flat, one)
            for one in (again, replace(again, delta=again.delta + motion))
        )
        of_zeros = plain.rows.pull == ZEROS

        assert of_zeros.sum() == (2 * (9 - 6) if targets == 3 else 2 * 6)
        off = np.linalg.norm(moved.c - plain.c)
        assert (
            off < 1e-12 if blind else off == pytest.approx(np.linalg.norm(motion), rel=1e-6, abs=0)
        )


def test_zeros_of_poses_without_a_pull_are_left_alone(rng):
    """The position of the robot is unknown."""
    data = campaign(THREE, rng)
    again = zeros(data, rng, [0, 5], 1)

    assert not np.isin(as_contrasts(data, np.zeros(36), again).rows.pose, [5]).any()
    assert as_contrasts(data, np.zeros(36), again).c == pytest.approx(
        as_contrasts(data, np.zeros(36), zeros_of(again, 0)).c
    )


def zeros_of(again, pose):
    return Zeros(*(getattr(again, f)[again.pose == pose] for f in vars(again)))


@pytest.mark.parametrize("found_m", [None, 4e-5])
def test_unstated_noise_of_a_zero_read_again_is_that_of_a_mean(rng, found_m):
    """The n-th zero minus the mean of the n before it: variance 1 + 1/n in units of a reading."""
    data = replace(campaign(THREE, rng, stated=False), found_m=found_m)
    again = zeros(data, rng, [0], 3)
    stack = stacked(assemble(cell(), data, X), np.zeros(36), data, again, cell())
    V = (stack.errors.G @ stack.errors.G.T).toarray()[36:, 36:]

    assert stack.which[36:].tolist() == np.repeat(again.which, 3).tolist()
    expected = np.diag((found_m or 1.0) ** 2 * (1 + 1 / np.repeat(again.which, 3)))
    assert pytest.approx(expected, rel=1e-12, abs=1e-24) == V


def groups(pulls):
    """Pulls (by index) treated as repeats of one another, and force of the first over own."""
    rng = np.random.default_rng(1)
    data = campaign(pulls, rng, 1)
    stack = stacked(assemble(cell(1), data, X), np.zeros(3 * len(pulls)), data, NO_ZEROS, cell(1))
    group, to_first = stack.group[::3], stack.to_first[::3]
    sets = [np.flatnonzero(group == g).tolist() for g in dict.fromkeys(group.tolist())]
    return sets, to_first


def turned(force, angle):
    """A force turned by an angle about an axis across it [rad]."""
    across = np.cross(force, [0.3, -0.4, 0.5])
    return Rotation.from_rotvec(angle * across / np.linalg.norm(across)).apply(force)


@pytest.mark.parametrize(
    ("second", "repeats"),
    [
        ((0, 1.029 * EAST, 1, 1), True),
        ((0, 1.031 * EAST, 1, 1), False),
        ((0, 0.971 * EAST, 1, 1), True),
        ((0, 0.969 * EAST, 1, 1), False),
        ((0, turned(EAST, 0.0049), 1, 1), True),
        ((0, turned(EAST, 0.0051), 1, 1), False),
        ((0, -EAST, 1, 1), False),
        ((0, EAST, -1, 1), False),
        ((1, EAST, 1, 1), False),
    ],
    ids=["more", "too much", "less", "too little", "near", "turned", "back", "branch", "pose"],
)
def test_repeats_are_alike_in_pose_force_and_branch(second, repeats):
    """3 % of the size and 5 mrad of the direction, in the same pose and on the same branch."""
    sets, _ = groups([(0, EAST, 1, 0), second])

    assert sets == ([[0, 1]] if repeats else [[0], [1]])


def test_pulls_go_one_way_whatever_their_force_and_little_turned():
    """A twentieth of a radian; not towards another anchor, back, or in another pose."""
    pulls = [EAST, NORTH, 0.3 * turned(EAST, 0.05), -EAST, 0.5 * NORTH]
    made = [(0, force, 1, t) for t, force in enumerate(pulls)] + [(1, NORTH, 1, 9)]
    data = campaign(made, np.random.default_rng(1), 1)

    assert ways(data.pulls).tolist() == [0, 1, 0, 2, 1, 0]


def test_repeats_are_brought_to_the_force_of_the_earliest():
    """The earliest by time, not by the order of rows."""
    sets, to_first = groups([(0, 1.02 * EAST, 1, 30), (0, NORTH, 1, 20), (0, EAST, 1, 10)])

    assert sets == [[0, 2], [1]]
    assert to_first == pytest.approx([1 / 1.02, 1, 1])


def test_chains_of_small_steps_are_measured_from_the_first():
    """1, 1.02, 1.04: the third is within 3 % of the second, and not of the first."""
    sets, _ = groups([(0, f * EAST, 1, t) for t, f in enumerate([1.0, 1.02, 1.04, 1.05])])

    assert sets == [[0, 1], [2, 3]]


@pytest.mark.parametrize(
    ("steps", "sets"),
    [
        ([1, 2, 3, 2, 1], [[0], [1], [2], [3], [4]]),  # up and down
        ([1, 2, 1, 2, 1, 2], [[0], [1, 3, 5], [2, 4]]),  # nothing precedes the first
        ([2, 2, 2], [[0], [1, 2]]),  # nobody knows whence the first came, the others from itself
        ([1, 2, 2, 3, 2, 2], [[0], [1], [2], [3], [4], [5]]),
        ([1, 2, 2, 2, 1, 2, 2], [[0], [1, 5], [2, 3, 6], [4]]),
    ],
)
def test_without_a_branch_the_way_to_a_pull_counts(steps, sets):
    """The previous pull and the last different one must agree, too."""
    found, _ = groups([(0, 1000.0 * f * EAST / 3000, 0, t) for t, f in enumerate(steps)])

    assert found == sets


def test_the_way_to_a_pull_begins_anew_in_each_pose():
    """Pulls in the previous pose do not count."""
    found, _ = groups([(0, NORTH, 0, 0), (1, EAST, 0, 1), (1, EAST, 0, 2), (1, EAST, 0, 3)])

    assert found == [[0], [1], [2, 3]]


SETTINGS = parse(
    'format = 1\nname = "t"\nrobot = "kr500_rail"\n[tracker]\nfiles = ["t.csv"]\n'
    '[scale]\n[tool]\nload_point = [0, 0, 0.2]\nP1 = [0.2, 0, 0]\nP2 = [0, 0.2, 0]\n'
    '[naming]\nmeasured = ["P2", "P1"]'
)  # fmt: skip


def placed(points, cov=None, **columns):
    """Unloaded readings of P1 in pose 4, one a day."""
    n = len(points)
    C = np.broadcast_to(np.eye(3), (n, 3, 3)) if cov is None else cov
    table = {"pose": 4, "state": "unloaded", "target": "P1"}
    table |= {"time": pd.Timestamp("2026-01-01") + pd.to_timedelta(np.arange(n), "D")}
    table |= dict(zip(["x_m", "y_m", "z_m"], np.asarray(points, float).T, strict=True))
    table |= dict(zip(covariance.columns(), covariance.flat(C).T, strict=True))
    return pd.DataFrame(table | columns, index=np.arange(n)[::-1])


@pytest.mark.parametrize("n", [2, 3, 6])
def test_differences_of_zeros_are_helmerts_contrasts(n):
    """Zero for fixed points, orthogonal to each other and to the mean, with this covariance."""

    def differences(column):
        return repeated_zeros(SETTINGS, placed(np.outer(column, [1, -2, 0.5]))).delta[:, 0]

    H = linear_map(differences, n)
    said = repeated_zeros(SETTINGS, placed(np.zeros((n, 3)))).cov

    assert H.shape == (n - 1, n)
    assert pytest.approx(np.zeros(n - 1), abs=1e-14) == H @ np.ones(n)
    assert pytest.approx(np.diag(said[:, 0, 0]), abs=1e-14) == H @ H.T
    assert (np.diag(H[:, 1:]) > 0).all()


def test_unequal_zeros_pass_their_covariances_on(rng):
    """Unequal covariances with arbitrary axes.

    Each difference has the weighted sum of its zeros'.
    """
    C = tilted(rng, 4, 1.0)
    H = linear_map(
        lambda column: repeated_zeros(SETTINGS, placed(np.outer(column, [1, 0, 0]))).delta[:, 0], 4
    )

    said = repeated_zeros(SETTINGS, placed(np.zeros((4, 3)), C)).cov

    for weights, cov in zip(H, said, strict=True):
        assert cov == pytest.approx(sum(w**2 * one for w, one in zip(weights, C, strict=True)))


def test_zeros_are_taken_in_the_order_of_the_clock_each_target_by_itself():
    """Rows in any order; loaded readings, other targets and single zeros give no difference."""
    first = placed([[1, 0, 0], [2, 0, 0], [6, 0, 0]])
    mixed = pd.concat(
        [
            first.iloc[[2, 0, 1]],
            placed([[9, 0, 0], [9, 1, 0]], target="P2"),
            placed([[50, 0, 0], [60, 0, 0]], state="loaded"),
            placed([[70, 0, 0], [80, 0, 0]], target="B1"),
            placed([[7, 7, 7]], pose=5),
        ]
    )

    found = repeated_zeros(SETTINGS, mixed)

    told = sorted(
        zip(found.target.tolist(), found.which.tolist(), found.delta.tolist(), strict=True)
    )
    assert told == [(0, 1, [0, 1, 0]), (1, 1, [1, 0, 0]), (1, 2, [4.5, 0, 0])]
    assert set(found.pose) == {4}
