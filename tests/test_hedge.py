"""What is stated of a stiffness holds whichever of a cause and its rivals is true."""

import numpy as np
import pytest

from pipeline.diagnosis.hedge import Instead, hedged
from pipeline.effects import baseline
from pipeline.results import Estimate
from pipeline.robot import load

KR500 = load("kr500_rail")


def estimate(relative):
    """Joint springs alone at their nominal size, known to a fraction."""
    x = KR500.nominal_compliance
    parameters = tuple(p for effect in baseline(KR500) for p in effect.parameters)
    return Estimate(
        parameters=parameters,
        value=x,
        cov=np.diag((relative * x) ** 2),
        identifiable=np.ones(len(x), dtype=bool),
        residual=np.zeros(3),
        chi2=1.0,
        dof=1,
        p_value=0.5,
        noise_from="stated",
        residual_std_m=1e-5,
        quantile=1.96,
    )


def test_an_interval_grows_until_it_holds_the_rivals():
    """Joint 5 is 10 % softer beside the rival, joint 6 is lost beside it, the others stay."""
    one = estimate(0.01)
    value, std = one.value.copy(), one.std.copy()
    value[4], std[5] = 1.1 * value[4], np.inf

    said, doubts = hedged(one, [Instead("joint_tilt:5", "joint_tilt:6", value, std)])

    assert [(d.spring, d.lost) for d in doubts] == [(4, False), (5, True)]
    high = said.value[4] + 1.96 * said.std[4]
    assert high == pytest.approx(value[4] + 1.96 * std[4])
    assert np.isinf(said.std[5])
    assert not said.identifiable[5]
    others = [0, 1, 2, 3, 6]
    np.testing.assert_array_equal(said.std[others], one.std[others])
    np.testing.assert_array_equal(said.value, one.value)
