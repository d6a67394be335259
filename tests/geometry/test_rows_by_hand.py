"""The effector's shape, its distances, grids and weight: each against arithmetic of its own."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.geometry.arm_weight import usual
from pipeline.geometry.roughness import _finer, _widths, products, straight
from pipeline.geometry.slipped import ShapeRows
from pipeline.geometry.unloaded import FIXED_STD, Unloaded, _distances, _Shape
from pipeline.machine.cell import Tool
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import configure, load

KR500 = load("kr500_rail")
POINTS = np.array([[0.20, 0.05, 0.12], [-0.12, 0.19, 0.10], [-0.10, -0.18, 0.22]])
NOISE_M = 2e-5


def read(poses: int, targets: int, weighs: bool = False, rail: bool = True) -> Unloaded:
    """Positions of the targets at drawn poses, with noise of arbitrary axes."""
    rng = np.random.default_rng(31)
    q = rng.uniform(KR500.lower, KR500.upper, (poses, 7))
    half = NOISE_M * (rng.normal(size=(poses * targets, 3, 3)) + 2 * np.eye(3))
    at = configure(KR500, q).points(POINTS[:targets]).reshape(-1, 3)
    at = at + np.einsum("zij,zj->zi", half, rng.normal(size=at.shape))
    pulls, pose = Pulls.at(q, np.zeros((poses, 3))), np.repeat(np.arange(poses), targets)
    names = np.array(["P1", "P2", "P3"][:targets], object)
    return Unloaded(
        robot=KR500, tool=Tool(np.zeros(3), names, POINTS[:targets]), sag=None,
        pulls=pulls.part(pose), pose=pose, target=np.tile(np.arange(targets), poses), at=at,
        cov=half @ half.swapaxes(1, 2), rotation=1e-5 * np.eye(3), joint_std=np.zeros(7),
        weighs=weighs,
    )  # fmt: skip


@pytest.mark.parametrize(("poses", "targets"), [(2, 2), (5, 2), (2, 3), (4, 3)])
def test_the_shape_is_what_a_rigid_motion_of_each_pose_leaves(poses: int, targets: int) -> None:
    """Residuals of numpy with six columns for every pose, and the points of the tool."""
    zeros = read(poses, targets)
    rows = zeros.about(np.zeros(zeros.columns.count))
    found = ShapeRows.of(zeros, rows)

    size, where = rows.y.shape[1], zeros.columns
    columns, y = [], []
    for i, N in enumerate(rows.N):
        W = np.linalg.cholesky(np.linalg.inv(N)).T
        rigid = np.zeros((size, 6 * poses))
        rigid[:, 6 * i : 6 * i + 3] = rows.D[i][:, where.shift]
        rigid[:, 6 * i + 3 : 6 * i + 6] = rows.D[i][:, where.loose]
        columns.append(W @ np.hstack([rigid, rows.D[i][:, where.tool]]))
        y.append(W @ rows.y[i])
    X, y = np.vstack(columns), np.concatenate(y)
    X = X / np.linalg.norm(X, axis=0)
    left = y - X @ np.linalg.lstsq(X, y, rcond=1e-9)[0]
    distances = targets * (targets - 1) // 2
    assert found.dof == distances * (poses - 1)
    assert found.square == pytest.approx(left @ left, rel=1e-5)
    assert found.t.shape == (poses, size, 3 * targets)


def test_no_shape_is_read_in_one_pose_nor_of_one_target_nor_of_a_6d_pose() -> None:
    """A distance that is read once is the shape itself."""
    for zeros in (read(1, 3), read(1, 2), read(6, 1)):
        assert ShapeRows.of(zeros, zeros.about(np.zeros(zeros.columns.count))) is None
    one = SimpleNamespace(columns=None, turned=np.eye(3), tool=SimpleNamespace(points=POINTS))
    assert ShapeRows.of(one, None) is None


def test_distances_between_targets_are_means_over_the_poses_that_read_them() -> None:
    """Targets in any order; equal noise s gives each mean of n a variance of 2 s^2 / n."""
    rng = np.random.default_rng(6)
    at = rng.normal(size=(8, 3))
    pose, target = np.array([3, 3, 3, 8, 8, 5, 5, 5]), np.array([2, 0, 1, 1, 0, 0, 1, 3])
    found = _Shape.of(pose, target, at, np.tile(4e-10 * np.eye(3), (8, 1, 1)))

    def apart(i: int, j: int) -> float:
        return float(np.sqrt(sum((at[i] - at[j]) ** 2)))

    three = [apart(1, 2), apart(4, 3), apart(5, 6)]
    assert found.mean[0, 1] == pytest.approx(np.mean(three))
    assert found.variance[0, 1] == pytest.approx(8e-10 / 3)
    for pair, (i, j) in {(0, 2): (1, 0), (1, 2): (2, 0), (0, 3): (5, 7), (1, 3): (6, 7)}.items():
        assert found.mean[pair] == pytest.approx(apart(i, j))
        assert found.variance[pair] == pytest.approx(8e-10)
    assert np.isnan(found.mean[2, 3])
    assert np.isnan(found.mean[1, 0])


def test_derivatives_of_distances_are_those_of_differences() -> None:
    """By each coordinate of each target; noise of any axes then has the variance of a distance."""
    rng = np.random.default_rng(7)
    at, target, h = rng.normal(size=(3, 3)), np.array([4, 0, 2]), 1e-6
    a, b, D, J = _distances(target, at)

    assert (a.tolist(), b.tolist()) == ([0, 0, 2], [2, 4, 4])
    for k in range(9):
        step = h * np.eye(9)[k].reshape(3, 3)
        ahead, behind = (_distances(target, at + s * step)[2] for s in (1, -1))
        np.testing.assert_allclose(J[:, k], (ahead - behind) / (2 * h), atol=1e-8)
    half = rng.normal(size=(3, 3, 3))
    C = half @ half.swapaxes(1, 2)
    found = _Shape.of(np.zeros(3, int), target, at, C)
    line = (at[1] - at[2]) / D[0]
    assert found.variance[0, 2] == pytest.approx(line @ (C[1] + C[2]) @ line)


def test_each_axis_of_a_grid_is_refined_by_its_own_density() -> None:
    """A product of three densities: flat, falling off, and steep at one end."""
    nodes = tuple(10.0 ** np.arange(float(n)) for n in (3, 4, 5))
    each = [np.zeros(3), np.array([0, 0, -20.0, -20]), np.array([-30.0, -30, -30, -0.8, 0])]
    density = [np.exp(log) * _widths(axis) for log, axis in zip(each, nodes, strict=True)]
    weight = np.einsum("i,j,k->ijk", *density)
    flat, off, steep = _finer(SimpleNamespace(weight=weight.ravel() / weight.sum()), nodes)

    ten = np.sqrt(10)
    assert flat == pytest.approx(nodes[0])
    assert off == pytest.approx([1, ten, 10, 10 * ten, 100])
    assert steep == pytest.approx([100, 100 * ten, 1e3, 1e3 * ten, 1e4])


def test_the_table_as_it_is_has_one_cell_without_roughness() -> None:
    """Place, stated rotation and tool by regression of numpy; the table is held."""
    zeros = read(6, 3)
    rows = zeros.about(np.zeros(zeros.columns.count))
    found, where = straight(zeros, products(rows, np.zeros(1))), zeros.columns

    assert found.rough.tolist() == [[0.0, 0.0]]
    assert found.roughness.tolist() == [0.0, 0.0]
    assert found.transmission.tolist() == [0.0]
    assert found.weight.tolist() == [1.0]
    std = np.r_[[10.0] * 3, [1.0] * 3, [5e-3] * 9]
    X, y = [], []
    for i, N in enumerate(rows.N):
        W = np.linalg.cholesky(np.linalg.inv(N)).T
        D = np.hstack([rows.D[i][:, at] for at in (where.shift, where.turn, where.tool)])
        X.append(W @ D * std)
        y.append(W @ rows.y[i])
    x = std * np.linalg.lstsq(np.vstack([*X, np.eye(15)]), np.r_[*y, np.zeros(15)], rcond=None)[0]
    own = np.concatenate([found.mean[at] for at in (where.shift, where.turn, where.tool)])
    np.testing.assert_allclose(own, x, rtol=1e-3, atol=1e-8)
    assert np.abs(found.mean[where.table]).max() < 100 * FIXED_STD


def test_an_arm_hangs_where_its_deflection_lowers_its_centres_of_mass() -> None:
    """By the potential energy of the usual masses at the deflected joints."""
    zeros = read(5, 3, weighs=True)
    moments, g = usual(KR500)[0], KR500.gravity
    rng = np.random.default_rng(2)
    names = zeros.columns.links
    answers = []
    for _ in range(6):
        x = np.zeros(zeros.columns.count)
        x[names] = rng.normal(size=names.stop - names.start)
        q = zeros.pulls.q
        h = 1e-4 / np.abs(zeros._bent(q) @ x[names]).max()

        def energy(q: np.ndarray) -> float:
            here = configure(KR500, q)
            at = moments[:, :1] * here.origin + np.einsum("mkij,kj->mki", here.axes, moments[:, 1:])
            return -float(np.sum(at @ g))

        bent = h * (zeros._bent(q) @ x[names])
        answers.append(energy(q + bent) < energy(q - bent))
        assert zeros.hangs(x) == zeros.hangs(1e-9 * x) == answers[-1]
        assert zeros.hangs(-x) != answers[-1]
    assert {True, False} == set(answers) | {not one for one in answers}
