"""Robots identified from absolute positions, against machines computed by other formulas."""

import json
from dataclasses import replace

import numpy as np
import pytest
from made_positions import made, weightless
from scipy.spatial.transform import Rotation

from pipeline.library.kinematic_model import dumps, kinematic_model
from pipeline.library.target_model import loads, predict
from pipeline.machine.robot import load
from pipeline.positions.cross_validation import Partition
from pipeline.positions.laws import Inputs, JointLaw
from pipeline.positions.mechanism import layout, linearised
from pipeline.positions.random_curve import matern, over
from pipeline.positions.study import ModelStage, study


def studied(readings, seed=0):
    return study(
        load("ur10"), readings, weightless(len(readings)), {}, None, (np.nan, np.nan),
        np.random.default_rng(seed),
    )  # fmt: skip


@pytest.fixture(scope="module")
def rippled():
    """Only a ripple of 0.3 mrad in joint 2, 18.2 periods per turn."""

    def ripple(q):
        out = np.zeros_like(q)
        out[:, 1] = 3e-4 * np.sin(18.2 * q[:, 1] + 0.4)
        return out

    readings = made(420, np.random.default_rng(4), ripple)
    return readings, studied(readings), ripple


@pytest.mark.whole
def test_a_ripple_is_named_with_joint_kind_and_order(rippled):
    _, found, _ = rippled

    law = found.laws[0]
    assert (law.joint, law.kind, law.variable) == (2, "periodic", "angle")
    assert abs(law.order - 18.2) < 0.15
    assert abs(law.amplitude - 3e-4) < 5 * law.std
    assert law.p < 1e-3
    assert law.gain.reduction > 0.5


@pytest.mark.whole
def test_a_wrong_table_is_corrected_and_poses_left_out_are_predicted(rippled):
    _, found, _ = rippled

    before, after = found.stages[0], found.stages[-1]
    assert before.step is ModelStage.TABLE
    assert after.mean(Partition.BETWEEN) < 0.05e-3 < before.mean(Partition.BETWEEN) / 10
    assert after.mean(Partition.SPACE) < 0.06e-3


@pytest.mark.whole
def test_predictions_of_poses_never_measured_hold_the_truth(rippled):
    readings, found, ripple = rippled
    model = kinematic_model("made", found.final)
    rng = np.random.default_rng(9)
    fresh = made(300, rng, ripple, noise=0.0)
    told = predict(
        model, fresh.q, np.zeros((300, 3)), np.zeros(300, dtype=np.int64), np.full(300, np.nan)
    )
    R, t = found.final.mechanism.frames[0, :3, :3], found.final.mechanism.frames[0, :3, 3]
    truth = (fresh.at[:, 0] - t) @ R

    z = (told.at[:, 0] - truth) / told.std[:, 0, :3]
    inside = np.mean(np.abs(z) < 1.96)
    assert 0.90 < inside < 0.985
    assert len(readings) == 420


@pytest.mark.whole
def test_nothing_is_named_where_there_is_nothing():
    found = studied(made(300, np.random.default_rng(8)))

    assert found.laws == ()
    assert found.bad == ()
    assert found.stages[-1].mean(Partition.BETWEEN) < 0.04e-3


@pytest.mark.whole
def test_a_reading_metres_off_is_left_out_and_moves_nothing():
    readings = made(300, np.random.default_rng(8))
    at = readings.at.copy()
    at[17, 0] += [0.4, -2.0, 1.0]

    found = studied(replace(readings, at=at))

    assert [(one.file, one.line) for one in found.bad] == [("poses.csv", 19)]
    assert found.stages[-1].mean(Partition.BETWEEN) < 0.04e-3


@pytest.mark.whole
def test_a_model_comes_back_from_its_file(rippled):
    _, found, _ = rippled
    model = kinematic_model("made", found.final)
    again = loads(dumps(model), "positions.npz")
    q = np.random.default_rng(1).uniform(-1, 1, (50, 6))
    asked = (q, np.zeros((50, 3)), np.ones(50, dtype=np.int64), np.full(50, np.nan))

    one, two = predict(model, *asked), predict(again, *asked)

    assert np.allclose(one.at, two.at, atol=1e-12)
    assert np.allclose(one.std, two.std, rtol=1e-3)
    assert json.dumps(again.payloads) == '["tool"]'


@pytest.mark.whole
def test_derivatives_are_those_of_differences():
    """The linearised estimate, against finite differences of the nonlinear model."""
    readings = made(12, np.random.default_rng(3))
    found = studied(made(120, np.random.default_rng(8))).stages[1].found.mechanism
    law = JointLaw(3, "coupling", "angle", 5, 2.0)
    there = replace(found, laws=(law,), amplitudes=np.array([1e-4, -2e-4]))
    weights = replace(weightless(12), gravity=np.array([0, 0, -9.80665]))
    here = linearised(readings, there, weights)
    size = len(there.values)

    for k in range(size):
        off = there.values.copy()
        off[k] += 1e-6
        moved = linearised(readings, replace(there, values=off), weights)
        assert np.allclose((here.y - moved.y) / 1e-6, here.D[..., k], atol=2e-3)


def test_a_curve_is_forgotten_beyond_its_knots():
    curve = over(1, np.linspace(-1.0, 1.0, 50), False, 0.1, 3e-4)
    knots = np.ones(curve.count)

    assert np.allclose(curve.value(np.array([-0.7, 0.0, 0.9]), knots), 1.0)
    assert np.allclose(curve.value(np.array([-5.0, 4.0]), knots), 0.0)
    assert np.allclose(curve.beyond(np.array([0.0, 4.0])), [0.0, 9e-8])
    assert matern(np.array([0.0]), 0.1)[0] == 1.0


def test_a_law_of_temperature_stays_where_it_was_taught():
    law = JointLaw(1, "smooth", "temperature", None, 1.0, 20.0, 2.0)
    none = np.zeros(4)
    air = np.array([20, 21, 30, np.nan])
    inputs = Inputs(np.zeros((4, 6)), np.zeros((4, 6)), air, none, none)

    assert law.basis(inputs)[:, 0].tolist() == [0.0, 0.5, 1.0, 0.0]


@pytest.fixture(scope="module")
def slipped():
    """Joint 3 slips by 0.4 mrad before pose 250 of 420, a third into the second series."""

    def slip(q):
        out = np.zeros_like(q)
        out[250:, 2] = 4e-4
        return out

    readings = made(420, np.random.default_rng(4), slip)
    second = np.arange(420) >= 180
    readings = replace(
        readings, series=second.astype(np.int64), names=np.array(["one", "two"], dtype=object),
        pose=np.where(second, readings.pose - 180, readings.pose),
    )  # fmt: skip
    return readings, studied(readings)


@pytest.mark.whole
def test_a_joint_that_slipped_once_is_named_with_its_pose(slipped):
    """Found without another series: parts of the joint space show it."""
    _, found = slipped

    (law,) = found.laws
    assert (law.joint, law.kind, law.variable) == (3, "step", "time")
    assert law.since == ("two", 70)
    assert law.amplitude == pytest.approx(4e-4, abs=5 * law.std)
    assert found.moved == ()
    assert found.stages[-1].mean(Partition.BETWEEN) < 0.03e-3


@pytest.mark.whole
def test_predictions_are_of_the_robot_after_it_slipped(slipped):
    """A prediction has no time: it is for the robot after all readings."""
    _, found = slipped
    model = loads(dumps(kinematic_model("made", found.final)), "positions.npz")
    rng = np.random.default_rng(9)

    def after(q):
        out = np.zeros_like(q)
        out[:, 2] = 4e-4
        return out

    fresh = made(200, rng, after, joint=0.0, noise=0.0)
    none = np.full(200, np.nan)
    told = predict(model, fresh.q, np.zeros((200, 3)), np.zeros(200, dtype=np.int64), none)
    R, t = found.final.mechanism.frames[0, :3, :3], found.final.mechanism.frames[0, :3, 3]
    off = told.at[:, 0] - (fresh.at[:, 0] - t) @ R

    assert np.linalg.norm(off, axis=1).mean() < 0.03e-3
    assert told.std[:, 0, :3].max() < 0.1e-3


@pytest.mark.whole
def test_a_step_of_torque_makes_no_prediction_uncertain_for_its_torque():
    """It is the same at any torque: only its amplitude is uncertain, as for a joint at rest."""
    found = studied(made(120, np.random.default_rng(8))).final
    step = JointLaw(2, "step", "torque", 2, 0.0)
    plain = replace(kinematic_model("made", found), gravity=np.array([0, 0, -9.80665]))
    where = layout(found.mechanism).laws.start
    cov = np.insert(np.insert(plain.cov, where, 0.0, axis=0), where, 0.0, axis=1)
    cov[where, where] = 1e-12
    there = replace(found.mechanism, laws=(step,), amplitudes=np.array([3e-4]))
    model = replace(plain, mechanism=there, cov=cov)
    q = np.random.default_rng(1).uniform(-1, 1, (50, 6))
    asked = (q, np.zeros((50, 3)), np.ones(50, dtype=np.int64), np.full(50, np.nan))

    assert predict(model, *asked).std.max() < 1.1 * predict(plain, *asked).std.max() + 1e-5


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("size", [2e-4, 0.05])
def test_an_instrument_that_was_knocked_begins_a_series(size):
    """Between two poses; no joint is accused, and a later blunder is listed where it was read."""
    readings = made(420, np.random.default_rng(4))
    at, turn = readings.at.copy(), readings.turn.copy()
    R = Rotation.from_rotvec([0, size / 10, size / 5]).as_matrix()
    at[301:], turn[301:] = at[301:] @ R.T + [size, 0, -size / 2], R @ turn[301:]
    at[310, 0] += [0.004, 0, 0]
    found = studied(replace(readings, at=at, turn=turn))

    (moved,) = found.moved
    assert (moved.series, moved.pose) == ("", 301)
    assert moved.turn_rad == pytest.approx(size * np.sqrt(0.05), rel=0.3)
    assert moved.p < 1e-3
    assert found.laws == ()
    assert [(one.file, one.line) for one in found.bad] == [("poses.csv", 312)]
    assert found.stages[-1].mean(Partition.BETWEEN) < 0.03e-3


@pytest.mark.slow
def test_instruments_and_joints_that_stay_are_not_said_to_move():
    """Thirty robots; joint errors of 0.01 or 0.1 mrad."""
    said = 0
    for seed in range(30):
        found = studied(made(200, np.random.default_rng(seed), joint=(1e-5, 1e-4)[seed % 2]))
        said += len(found.moved) + len(found.laws)
    assert said == 0
