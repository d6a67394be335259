"""Detection alone: F tests against numpy's fits, and the false-alarm rate against draws."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from pipeline.base.arrays import Parameter
from pipeline.system import alarms
from pipeline.system.beside import by_products
from pipeline.system.detect import threshold

ROWS, BASE = 80, 6
OWNER = np.array([0, 1, 1, 2, 3, 4, 4, 5])
"""Which of six suspects each of eight columns belongs to."""

RNG = np.random.default_rng(11)
X = RNG.standard_normal((ROWS, BASE + len(OWNER)))
X[:, BASE + 3] = X[:, BASE] + 0.3 * RNG.standard_normal(ROWS)  # nearly alike
X[:, -1] = X[:, :BASE] @ RNG.standard_normal(BASE)  # a mix of the base: nothing is left of it
DOF = ROWS - BASE


def view(y, order=slice(None), scale=1.0):
    """What a threshold reads of a whitened campaign."""
    A = np.column_stack([X[:, :BASE], X[:, BASE:] * scale, y])[order]
    parameters = [tuple(Parameter("z", "1", 1.0) for _ in range(n)) for n in np.bincount(OWNER)]
    return SimpleNamespace(
        M=A.T @ A, first=BASE, owner=OWNER,
        suspects=[SimpleNamespace(parameters=some) for some in parameters],
    )  # fmt: skip


AT = np.array([[6, -1], [7, 8], [9, -1], [10, -1], [11, 12], [13, -1]])
"""Columns of each suspect."""


def beside(y, order=slice(None), scale=1.0):
    """Every suspect beside the base, by products."""
    return by_products(view(y, order, scale).M, np.arange(BASE), AT, DOF)


def left(columns, y):
    """Sums of squares that numpy's least squares leaves of each column of y."""
    Q = np.linalg.qr(columns)[0]
    return np.sum(y**2, axis=0) - np.sum((Q.T @ y) ** 2, axis=0)


def by_fits(y):
    """P of the F test of each suspect but the last, from two fits each, shape (5, draws)."""
    rest = left(X[:, :BASE], y)
    out = []
    for suspect in range(5):
        more = X[:, BASE:][:, suspect == OWNER]
        k = more.shape[1]
        less = left(np.column_stack([X[:, :BASE], more]), y)
        out.append(stats.f.sf((rest - less) / k / (less / (DOF - k)), k, DOF - k))
    return np.array(out)


def test_the_p_values_are_those_of_two_fits():
    """Suspects of one and two parameters, alike or not; what the base explains tells nothing."""
    y = RNG.standard_normal(ROWS) + 0.5 * X[:, BASE + 1]
    found = beside(y)

    assert np.allclose(found.p()[:5], by_fits(y[:, None])[:, 0], rtol=1e-8)
    assert found.rank.tolist() == [1, 2, 1, 1, 2, 0]
    assert found.p()[5] == 1.0


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_scores_know_no_units_and_no_order(scale):
    """P values follow neither the size of the suspects' columns nor the order of the rows."""
    y = RNG.standard_normal(ROWS)
    plain, other = beside(y), beside(y, RNG.permutation(ROWS), scale)

    assert np.allclose(plain.p(), other.p(), rtol=1e-7)
    assert np.array_equal(plain.rank, other.rank)


def test_of_clean_campaigns_so_many_are_accused():
    """40 000 draws of scatter: the share below the threshold is the rate, as far as it is known.

    The threshold rests on 3000 draws, which know its tail to 13 %; the count to 11 %.
    """
    limit = threshold(view(np.zeros(ROWS)), np.arange(BASE), DOF, np.random.default_rng(3))
    smallest = by_fits(np.random.default_rng(5).standard_normal((ROWS, 40_000))).min(axis=0)

    assert np.mean(smallest < limit.p) == pytest.approx(alarms.SUSPECT, rel=0.5)
    assert 3.0 < limit.independent < 5.5  # of five that differ, two nearly alike
