"""A law counts where the readings are certainly likelier with it, and its size is certain."""

from dataclasses import replace

import numpy as np
import pytest
from made_positions import TOOL, TURN, made, stands, weightless

from pipeline.machine.robot import load
from pipeline.positions.study import study

ON_AXIS = np.array([3e-4, 0.0, 0.12])
"""A reflector 0.3 mm beside the axis of joint 6, flange frame [m]."""


@pytest.fixture(scope="module")
def shifted():
    """A reflector on the last axis, moved sideways in its nest by 80 um at pose 70 of 160."""
    rng = np.random.default_rng(3)
    readings = made(160, rng, noise=0.0)
    at, turn = stands(readings.q, 1e-5 * rng.standard_normal(readings.q.shape))
    axes = turn @ TURN.T
    point = ON_AXIS - TOOL + np.outer(np.arange(160) >= 70, [0.0, 8e-5, 0.0])
    at = at + np.einsum("mij,mj->mi", axes, point) + 1e-5 * rng.standard_normal(at.shape)
    readings = replace(
        readings, six=np.array([False]), at=at[:, None], turn=np.tile(np.eye(3), (160, 1, 1, 1))
    )
    return study(
        load("ur10"), readings, weightless(160), {}, None, (np.nan, np.nan),
        np.random.default_rng(0),
    )  # fmt: skip


@pytest.mark.whole
def test_a_joint_that_moves_no_target_has_no_zero_that_changed(shifted):
    """Its zero would have to change by 270 mrad, and no zero does: the readings are no likelier."""
    assert 6 not in [law.joint for law in shifted.final.mechanism.laws if law.once]
    assert 6 not in [law.joint for law in shifted.laws]


@pytest.mark.whole
def test_what_is_named_has_a_size(shifted):
    for law in shifted.laws:
        assert abs(law.amplitude) > 1.96 * law.std, law
