"""Rows along and across directions, against the textbook's likelihood on the whole matrix."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from made_system import dense, restricted

from pipeline.base import linear
from pipeline.base.arrays import Parameter
from pipeline.system.parted import PartedRows
from pipeline.system.restricted import lowest
from pipeline.system.system import Errors, RowIndex, System

POSE = np.repeat([4, 1, 9, 2], [6, 9, 3, 6])
D = len(POSE)
RNG = np.random.default_rng(12)
U = RNG.standard_normal((D, 3))
U /= np.linalg.norm(U, axis=1)[:, None]
SIZE = RNG.uniform(0.5, 2.0, D)


def made(few=True, more=0):
    """Three rows to a displacement: correlated readings, a shared zero, a force, one common.

    One pose has `more` other errors.
    """
    rows, M = np.repeat(POSE, 3), 3 * D
    own = np.kron(np.eye(D), np.ones((3, 3))) * RNG.normal(0, 2e-5, (M, M)) + 2e-5 * np.eye(M)
    zero = np.kron(POSE[:, None] == np.unique(POSE), np.eye(3)) * 1.5e-5
    here = (rows[:, None] == np.unique(POSE)[:3]) * few
    force, common = here * RNG.normal(0, 3e-5, (M, 3)), RNG.normal(0, 2e-5, (M, 1))
    many = (rows[:, None] == POSE[0]) * RNG.normal(0, 3e-5, (M, more))
    G = np.hstack([own, zero, force, common, many])
    source = ["tracker"] * M + ["zero"] * 12 + ["force_reading"] * 3 + ["registration"]
    source += ["direction"] * more
    X = RNG.standard_normal((M, 4))
    return System(
        parameters=tuple(Parameter(f"c{k}", "m/N", 1.0) for k in range(4)),
        rows=RowIndex(rows, rows, np.full(M, "P", object), rows * 0, rows),
        B=X,
        c=1e-3 * X @ np.ones(4) + G @ RNG.standard_normal(G.shape[1]),
        errors=Errors(
            scipy.sparse.csr_array(G), np.array(source, object), np.arange(len(source)) == M + 15
        ),
        noise_stated=True,
    )


def textbook(system, log_scale, size):
    """The same with V as one matrix, from projectors instead of turned rows."""
    P = np.zeros((3 * D, 3 * D))
    for d, u in enumerate(U):
        P[3 * d : 3 * d + 3, 3 * d : 3 * d + 3] = np.outer(u, u)
    T = np.diag(np.repeat(size, 3)) @ (np.eye(3 * D) - P)
    rest = dense(system, {"tracker": 0.0, "zero": 0.0})
    V = dense(system) - rest
    a, b = np.exp(2 * log_scale)
    return restricted(system.B, system.c, a * P @ V @ P + b * T @ V @ T.T + rest)


def parted(system):
    own = np.isin(system.errors.source.astype(str), ["tracker", "zero"])
    return PartedRows.of(system, linear.orthonormal(system.B), U, own)


@pytest.mark.parametrize(("few", "more"), [(True, 0), (False, 0), (True, 70)])
def test_the_loss_is_that_of_the_whole_matrix(few, more):
    """Up to one constant for all scales and all growths, also without other errors of a pose.

    A pose with many of them costs no padding to the others.
    """
    system = made(few, more)
    rows, zero = parted(system), np.zeros(2)
    assert sum(FF.size for FF in rows.parts[0].FF) == ((more + 1) ** 2 + 2 if more else 4 * few)
    start = rows.whole(zero) - textbook(system, zero, np.ones(D))
    grown = rows.grown(SIZE)

    for log_scale in RNG.uniform(-1.5, 1.5, (5, 2)):
        for blocks, size in ((rows, np.ones(D)), (grown, SIZE)):
            expected = textbook(system, log_scale, size)
            assert blocks.whole(log_scale) - start == pytest.approx(expected, abs=1e-7)


def test_one_scale_for_both_is_no_better_than_two():
    rows = parted(made())
    both = lowest(rows.loss, np.full(2, rows.rough))

    assert rows.alike() > rows.whole(both)
    grid = [rows.whole(np.full(2, t)) for t in np.linspace(-1.0, 1.0, 401)]
    assert rows.alike() == pytest.approx(min(grid), abs=0.01)
    assert rows.alike() <= min(grid) + 1e-9


def test_readings_without_noise_have_no_parts():
    system = made()
    G = system.errors.G.toarray()
    G[7, :-4] = 0.0

    with pytest.raises(np.linalg.LinAlgError):
        parted(replace(system, errors=replace(system.errors, G=scipy.sparse.csr_array(G * 0))))


def test_the_rough_scale_is_half_the_log_of_residuals_over_noise():
    """By numpy's least squares and the squares of the readings' errors alone, in any unit."""
    system = made()
    own = np.isin(system.errors.source.astype(str), ["tracker", "zero"])
    G, B, c = system.errors.G.toarray(), system.B, system.c
    left = c - B @ np.linalg.lstsq(B, c, rcond=None)[0]
    expected = 0.5 * np.log(left @ left / np.sum(G[:, own] ** 2))
    assert parted(system).rough == pytest.approx(expected)
    assert parted(replace(system, c=3 * c)).rough == pytest.approx(expected + np.log(3))
