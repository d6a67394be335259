"""The bound on what changes a spring: no pull may make it yield against its load."""

import numpy as np
import pytest

from pipeline.system.score_tests import by_products
from pipeline.system.yielding import Work


def bound(unloaded):
    """Of a spring, and of what changes it by g, from thirty pulls and some that do not load it."""
    rng = np.random.default_rng(1)
    tau, g = np.append(rng.uniform(0.5, 1, 30), np.zeros(unloaded)), rng.uniform(-1, 1, 30)
    g = np.append(g, np.zeros(unloaded))
    A = np.column_stack([tau, tau * g, 20 * tau + rng.normal(size=30 + unloaded) * (tau > 0)])
    M, base, at = A.T @ A, np.array([0]), np.array([[1]])
    work = Work(np.array([0]), (tau**2)[None, :, None], (tau**2 * g)[None, :, None])
    return work.bound(M, base, at, by_products(M, base, at, 29))


def test_pulls_that_do_not_load_a_spring_do_not_bound_it():
    """A weight does no work at a rail, whatever the size: that is not the closest bound.

    Planted bug: the nearest half-space was that of a pull without a load, 0 >= 0.
    """
    found, other = bound(0), bound(2)

    assert found.offset[0] > 0
    for name in ("offset", "normal", "var"):
        assert getattr(other, name) == pytest.approx(getattr(found, name))


def test_without_any_load_there_is_no_bound():
    """Neither more nor less than nothing is left, whatever the size."""
    work = Work(np.array([0]), np.zeros((1, 3, 1)), np.zeros((1, 3, 1)))
    M, base, at = np.diag([1.0, 1.0, 2.0]), np.array([0]), np.array([[1]])

    found = work.bound(M, base, at, by_products(M, base, at, 5))

    assert found.distance(np.array([[3.0]]), np.eye(1)[None])[0] == np.inf


def test_a_spring_that_the_pulls_do_not_determine_bounds_nothing():
    """Of two springs only the sum is known: either may be all of it, and change by as much.

    Planted bug: each had half of it, for certain, and a change by 0.8 of the sum was refused.
    """
    rng = np.random.default_rng(1)
    tau, g = rng.uniform(0.5, 1, 40), np.append(-1, rng.uniform(-1, 1, 39))
    A = np.column_stack([tau, tau, tau * g, 20 * tau + 16 * tau * g + 0.3 * rng.normal(size=40)])
    M, base, at = A.T @ A, np.array([0, 1]), np.array([[2]])
    springs = np.stack([tau**2, np.zeros(40)], axis=1)
    now = by_products(M, base, at, 39)

    found = Work(np.array([0]), springs[None], (tau**2 * g)[None, :, None]).bound(M, base, at, now)

    left, std = found.distance(now.size, now.cov)
    assert left > -2 * std
