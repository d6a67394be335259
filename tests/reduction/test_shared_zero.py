"""Pulls of a pose share one zero: to pull more often says no more about it."""

from dataclasses import replace

import numpy as np
import pytest
from test_days import measured

from bench.reduced import reduce
from pipeline.reduction.bring import conformed
from pipeline.reduction.days import days
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory


def p_value(pulls):
    """Two days that differ by half a per cent, of readings that are exact except for the zeros."""
    plan = Plan(name="days", seed=7, poses={"count": 4}, pulls={"steps_n": [2000.0] * pulls})
    data = reduce(in_memory(simulate(plan.without_noise()).files), conformed).data
    exact, noise = (np.tile(s**2 * np.eye(3), (len(data.delta), 1, 1)) for s in (1e-9, 3e-5))
    none = np.zeros(len(data.pulls))
    data = replace(data, loaded_cov=exact, zero_cov=noise, noise_stated=True, reading_std=none)
    both = measured(data, 0.0, np.random.default_rng(1), 2)
    return days(replace(both, delta=np.vstack([data.delta, 1.005 * data.delta]))).p_value


def test_equal_pulls_from_one_zero_are_no_more_certain_than_one():
    """The same displacement six times: the same probability by chance."""
    assert p_value(6) == pytest.approx(p_value(1), rel=0.02)
