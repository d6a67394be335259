"""A reflector that moved on the effector in mid-campaign of positions, at a pose nobody noted."""

from dataclasses import replace

import numpy as np
import pytest
from made_positions import made
from moved_reflector import moved

from pipeline.machine.robot import load
from pipeline.positions.facts import facts_of
from pipeline.positions.study import study

LARGE, SMALL = [0.0, 3e-4, 2e-4], [0.0, 8e-5, 0.0]


def studied(readings, weights):
    return study(
        load("ur10"), readings, weights, {}, None, (np.nan, np.nan), np.random.default_rng(0)
    )


def test_a_target_since_a_pose_is_a_target_of_its_own():
    readings, _ = moved([0.05, 0, 0.1], LARGE, targets=3)
    parted = readings.apart(70, [1])

    assert parted.targets.tolist() == ["A", "B", "B from pose 70", "C"]
    assert np.isnan(parted.at[70:, 1]).all()
    assert np.isnan(parted.at[:70, 2]).all()
    np.testing.assert_array_equal(parted.at[:70, 1], readings.at[:70, 1])
    np.testing.assert_array_equal(parted.at[70:, 2], readings.at[70:, 1])
    np.testing.assert_array_equal(parted.at[:, [0, 3]], readings.at[:, [0, 2]])
    assert parted.read.sum() == readings.read.sum()


@pytest.mark.whole
@pytest.mark.parametrize("at", [[3e-4, 0.0, 0.12], [0.05, -0.02, 0.12]])
@pytest.mark.parametrize("by", [LARGE, SMALL])
@pytest.mark.parametrize("targets", [1, 3])
def test_a_reflector_that_moved_is_identified(at, by, targets):
    """With pose and motion; not a joint's zero, not the instrument, and no reading is accused.

    Joint errors of 10 urad move it by up to 20 um from pose to pose.
    """
    which = targets - 1
    readings, weights = moved(at, by, targets, which)
    found = studied(readings, weights)

    (one,) = found.moved
    assert (one.target, one.pose, one.series) == ("ABC"[which], 70, "")
    np.testing.assert_allclose(one.motion[:3], by, atol=1e-5)
    assert not found.laws
    assert not found.bad
    assert found.stages[-1].mean("every tenth pose") < 0.03e-3
    (cause,) = facts_of(found, load("ur10")).causes
    assert (cause.effect.name, cause.effect.where) == ("target_moved", "ABC"[which])
    assert cause.effect.form == "since pose 70"
    assert [size.value for size in cause.amplitudes] == one.motion[:3].tolist()


@pytest.mark.whole
def test_two_reflectors_that_moved_at_other_times_are_identified():
    readings, weights = moved([0.05, -0.02, 0.12], LARGE, 3)
    later, _ = moved([0.05, -0.02, 0.12], LARGE, 3, which=2, pose=120)
    at = readings.at.copy()
    at[120:, 2] = later.at[120:, 2]
    found = studied(replace(readings, at=at), weights)

    assert {(one.target, one.pose) for one in found.moved} == {("A", 70), ("C", 120)}


@pytest.mark.whole
def test_a_holder_that_moved_with_all_its_reflectors():
    """All three by the same vector, as if the effector were another since then."""
    each = [moved([0.05, -0.02, 0.12], LARGE, 3, which) for which in range(3)]
    at = np.stack([readings.at[:, which] for which, (readings, _) in enumerate(each)], axis=1)
    readings, weights = each[0]
    found = studied(replace(readings, at=at), weights)

    assert {(one.target, one.pose) for one in found.moved} == {("A", 70), ("B", 70), ("C", 70)}
    assert not found.bad


@pytest.mark.whole
def test_a_target_with_orientation_may_have_turned():
    """Turned by 2 mrad about its z axis, and shifted by 0.1 mm along its x axis."""
    readings = made(160, np.random.default_rng(2))
    turn = np.array([[1, -2e-3, 0], [2e-3, 1, 0], [0, 0, 1.0]])
    turns, at = readings.turn.copy(), readings.at.copy()
    at[90:, 0] += 1e-4 * turns[90:, 0, :, 0]
    turns[90:, 0] = turns[90:, 0] @ turn
    found = studied(replace(readings, turn=turns, at=at), moved([0, 0, 0], [0, 0, 0])[1])

    (one,) = found.moved
    assert (one.target, one.pose) == ("T", 90)
    np.testing.assert_allclose(one.motion[:3], [1e-4, 0, 0], atol=1e-5)
    np.testing.assert_allclose(one.motion[3:], [0, 0, 2e-3], atol=1e-4)
