"""Mixes of parameters against whole matrices of numpy, and the joint values that part them."""

import numpy as np
import pytest

from pipeline.base.arrays import Parameter
from pipeline.machine.robot import load
from pipeline.system.combinations import _values, mixes

TYPICAL = np.array([2e-8, 5e-9, 3e-7, 4e-6, 1e-7])
"""Sizes that differ by three decades, as those of a wrist and a shoulder."""


@pytest.mark.parametrize("seed", range(3))
def test_a_mix_is_as_uncertain_as_the_rows_leave_it(seed):
    """Four rows in natural units: value, weights and uncertainty by the pseudoinverse of all."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((4, 5)) / TYPICAL * 30.0  # known to a thirtieth of the sizes
    value = TYPICAL * rng.uniform(1, 2, 5)
    kinds = [Parameter(f"c{k}", "rad/(N m)", t) for k, t in enumerate(TYPICAL)]
    scaled = rows * TYPICAL

    found = mixes(scaled.T @ scaled, kinds, value, np.zeros(5, dtype=bool))

    covariance = np.linalg.pinv(rows.T @ rows, rcond=1e-12, hermitian=True)
    blind = np.linalg.svd(scaled)[2][-1] * TYPICAL  # moves no row
    assert len(found) == 4
    for one in found:
        w = np.zeros(5)
        w[one.of] = one.weights
        assert np.abs(w).max() == w.max() == 1.0
        assert one.value == pytest.approx(w @ value, rel=1e-12)
        np.testing.assert_allclose(w @ blind, 0.0, atol=1e-6 * TYPICAL.max())
        assert one.std == pytest.approx(np.sqrt(w @ covariance @ w), rel=1e-6)


@pytest.mark.parametrize("name", ["kr500_rail", "fanuc_r2000ic"])
def test_every_step_within_the_limits_is_tried(name):
    """Ten degrees or half a metre apart; one more either way would leave the limits."""
    robot = load(name)
    for joint in range(robot.n):
        tried, by = _values(robot, joint), 0.5 if robot.prismatic[joint] else np.deg2rad(10.0)
        low, high = robot.lower[joint], robot.upper[joint]
        low, high = (low if np.isfinite(low) else -np.pi), (high if np.isfinite(high) else np.pi)

        np.testing.assert_allclose(np.diff(tried), by, rtol=1e-9)
        assert low <= tried[0] < low + by + 1e-12
        assert high - by - 1e-12 < tried[-1] <= high
