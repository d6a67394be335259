"""Whitening against the whole covariance, inverted directly."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from made_system import TYPICAL, dense, generalised, made
from scipy import stats

from pipeline.system.whiten import whitener

RNG = np.random.default_rng(29)
SYSTEM = made(RNG)
POSE = SYSTEM.rows.pose
M = len(POSE)
V = dense(SYSTEM)
OWN = dense(SYSTEM, common=False)
WHITE = whitener(SYSTEM.errors, POSE)
B = SYSTEM.B * TYPICAL
D = np.random.default_rng(1).standard_normal((M, 2)) * 1e-4
"""A suspect of two columns."""


def test_rows_of_a_pose_have_unit_covariance_by_themselves():
    """W V W' = I for the errors of each pose, without the common ones."""
    W = WHITE.by_pose(np.eye(M))

    assert pytest.approx(np.eye(M), abs=1e-11) == W @ OWN @ W.T
    assert not W[POSE[:, None] != POSE].any()
    assert WHITE.by_pose(SYSTEM.c) == pytest.approx(W @ SYSTEM.c)


def test_whitening_there_and_back_is_the_inverse_covariance():
    """The object, then `back`: V^-1 times one vector or several."""
    inverse = np.linalg.inv(V)

    assert WHITE.back(WHITE(np.eye(M))) * 1e-8 == pytest.approx(inverse * 1e-8, rel=1e-7, abs=1e-9)
    assert WHITE.back(WHITE(SYSTEM.c)) == pytest.approx(inverse @ SYSTEM.c, rel=1e-7)
    assert WHITE(SYSTEM.c) == pytest.approx(WHITE(np.eye(M)) @ SYSTEM.c)


def test_priors_below_the_rows_weigh_with_the_whole_covariance():
    """Common errors estimated as columns.

    B of the textbook, and the best estimate of each error.
    """
    rows = np.hstack([WHITE.with_priors(B), WHITE.columns])
    found = np.linalg.lstsq(rows, WHITE.with_priors(SYSTEM.c), rcond=None)[0]
    b, cov, chi2 = generalised(B, SYSTEM.c, V)
    A = SYSTEM.errors.G.toarray()[:, SYSTEM.errors.common]
    left = WHITE.with_priors(SYSTEM.c) - rows @ found

    assert found[:3] == pytest.approx(b)
    assert np.linalg.inv(rows.T @ rows)[:3, :3] == pytest.approx(cov)
    assert left @ left == pytest.approx(chi2)
    assert found[3:] == pytest.approx(A.T @ np.linalg.solve(V, SYSTEM.c - B @ b), rel=1e-6)


def test_priors_belong_to_no_pose():
    """Each row has the number of its pose, and each prior the number after the last."""
    assert WHITE.key.tolist() == [*((POSE - 1) // 3).tolist(), 4, 4]


def test_suspects_stand_beside_base_and_common_errors():
    """Size, covariance, drop and p are those of generalised least squares with the whole V."""
    base = WHITE.base(B, SYSTEM.c)
    found = base.beside_all(WHITE.with_priors(D))
    _, _, before = generalised(B, SYSTEM.c, V)
    b, cov, after = generalised(np.hstack([B, D]), SYSTEM.c, V)

    assert base.rest == pytest.approx(before)
    assert base.dof == M - 3
    assert found.size == pytest.approx(b[3:])
    assert found.cov == pytest.approx(cov[3:, 3:])
    assert float(found.drop) == pytest.approx(before - after)
    F = (before - after) / 2 / (after / (M - 5))
    assert float(found.p()) == pytest.approx(stats.f.sf(F, 2, M - 5))


def test_a_suspect_may_touch_one_pose():
    """Rows of one pose off by an amount: the same fit with columns that are zero elsewhere."""
    base = WHITE.base(B, SYSTEM.c)
    columns = WHITE.blocks.padded(WHITE.by_pose(D))[:, :, None]
    found = base.beside(columns)

    for pose in range(4):
        one = np.unique(POSE)[pose]
        b, cov, _ = generalised(np.hstack([B, D * (one == POSE)[:, None]]), SYSTEM.c, V)
        assert found.size[pose, 0] == pytest.approx(b[3:])
        assert found.cov[pose, 0] == pytest.approx(cov[3:, 3:])


def test_what_each_pose_has_to_itself_is_weighed_with_its_own_errors():
    """A base for each pose: fits with its part of V, one after the other."""
    base = WHITE.own_base(B, SYSTEM.c)
    total = sum(
        generalised(B[one == POSE], SYSTEM.c[one == POSE], OWN[one == POSE][:, one == POSE])[2]
        for one in np.unique(POSE)
    )

    assert base.rest == pytest.approx(total)
    assert base.dof == M - 4 * 3


def test_without_common_errors_a_pose_is_all_there_is():
    """No further columns are estimated, and whitening by pose is complete."""
    alone = made(np.random.default_rng(2), common=False)
    white = whitener(alone.errors, alone.rows.pose)

    assert white(alone.c) == pytest.approx(white.by_pose(alone.c))
    assert white.back(white(alone.c)) == pytest.approx(
        np.linalg.solve(dense(alone), alone.c), rel=1e-7
    )
    assert white.base(alone.B * TYPICAL, alone.c).rest == pytest.approx(
        generalised(alone.B * TYPICAL, alone.c, dense(alone))[2]
    )


@pytest.mark.parametrize("share", [1e-3, 1.0, 1e3])
def test_common_errors_small_and_large_are_taken_out(share):
    """W V W' = 1, whatever part of the errors is common."""
    G = SYSTEM.errors.G.toarray() * np.where(SYSTEM.errors.common, share, 1.0)
    errors = replace(SYSTEM.errors, G=scipy.sparse.csr_array(G))
    W = whitener(errors, POSE)(np.eye(M))

    assert np.abs(W @ (G @ G.T) @ W.T - np.eye(M)).max() < 1e-6
