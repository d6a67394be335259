"""The whitener: against the dense covariance, however rows are distributed over poses."""

import numpy as np
import pytest
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.system.system import Errors
from pipeline.system.whiten import whitener


def made(seed, sizes, common):
    """Errors and pose numbers of shuffled rows: own, one shared by each pose, some by all."""
    rng = np.random.default_rng(seed)
    names = rng.permutation(np.arange(5, 5 + 3 * len(sizes), 3))
    pose = rng.permutation(np.repeat(names, sizes))
    own = np.diag(rng.uniform(0.5, 2.0, len(pose)))
    shared = (pose[:, None] == names) * rng.uniform(-2, 2, (len(pose), 1))
    everywhere = rng.standard_normal((len(pose), common)) * rng.uniform(0.1, 30, common)
    G = np.hstack([own, shared, everywhere])
    one_for_all = np.arange(G.shape[1]) >= G.shape[1] - common
    order = rng.permutation(G.shape[1])
    source = np.array(["any"] * len(order), object)
    return Errors(scipy.sparse.csr_array(G[:, order]), source, one_for_all[order]), pose


def dense(errors):
    """The dense covariance."""
    G = errors.G.toarray()
    return G @ G.T


CAMPAIGNS = given(
    seed=st.integers(0, 10**6),
    sizes=st.lists(st.integers(1, 7), min_size=1, max_size=5),
    common=st.integers(0, 4),
)
FEW = settings(derandomize=True, max_examples=30, deadline=None)


@FEW
@CAMPAIGNS
def test_whitened_rows_are_uncorrelated_with_unit_variance(seed, sizes, common):
    """W V W' = 1 for poses of any sizes in any order, also with more common errors than rows."""
    errors, pose = made(seed, sizes, common)
    white = whitener(errors, pose)
    W = white(np.eye(len(pose)))

    assert pytest.approx(np.eye(len(pose)), abs=1e-9) == W @ dense(errors) @ W.T


@FEW
@CAMPAIGNS
def test_whitening_and_back_is_the_inverse_of_the_covariance(seed, sizes, common):
    """W' W y = V^-1 y, and `back` is the transpose: (W a)'b = a'(W' b)."""
    errors, pose = made(seed, sizes, common)
    white = whitener(errors, pose)
    a, b = np.random.default_rng(seed).standard_normal((2, len(pose), 2))
    weighed = np.linalg.solve(dense(errors), a)

    assert white.back(white(a)) == pytest.approx(weighed, rel=1e-8, abs=1e-9)
    assert white(a).T @ b == pytest.approx(a.T @ white.back(b), rel=1e-9, abs=1e-9)


@FEW
@CAMPAIGNS
def test_within_poses_the_common_errors_are_left(seed, sizes, common):
    """By pose, W V W' = 1 + A A' with A the whitened common errors, and poses are not mixed."""
    errors, pose = made(seed, sizes, common)
    white = whitener(errors, pose)
    W = white.by_pose(np.eye(len(pose)))
    left = W @ dense(errors) @ W.T - np.eye(len(pose))

    assert left == pytest.approx(white.common @ white.common.T, rel=1e-8, abs=1e-8)
    assert white.common.shape == (len(pose), common)
    assert not W[pose[:, None] != pose].any()


def test_one_vector_is_whitened_as_a_column():
    """Shape (M,) and (M, 1) give the same numbers."""
    errors, pose = made(3, [4, 2, 5], 2)
    y, white = np.random.default_rng(3).standard_normal(11), whitener(errors, pose)

    assert white(y).shape == white.by_pose(y).shape == (11,)
    assert white(y) == pytest.approx(white(y[:, None])[:, 0], rel=1e-14)
    assert white.by_pose(y) == pytest.approx(white.by_pose(y[:, None])[:, 0], rel=1e-14)
    assert white(y) @ white(y) == pytest.approx(y @ np.linalg.solve(dense(errors), y))


def test_rows_of_one_pose_only_answer_to_each_other():
    """Readings of pose 8 do not enter the whitened rows of pose 5 if nothing is common."""
    errors, pose = made(6, [3, 4], 0)
    white, y = whitener(errors, pose), np.ones(7)
    other = np.where(pose == pose[0], y, 100.0)

    assert white(other)[pose == pose[0]] == pytest.approx(white(y)[pose == pose[0]])
    assert white(other)[pose != pose[0]] == pytest.approx(100 * white(y)[pose != pose[0]])


def test_a_reading_without_scatter_is_refused():
    """A singular covariance has no inverse root, and is refused."""
    errors, pose = made(1, [2, 3], 0)
    G = errors.G.toarray()
    G[1] = 0.0

    with pytest.raises(np.linalg.LinAlgError):
        whitener(Errors(scipy.sparse.csr_array(G), errors.source, errors.common), pose)
