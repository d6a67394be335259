"""Copies of residuals without a law must be as large as the noise from which residuals arise."""

import numpy as np
import pytest
from heavy_robot import TOOL, HeavyRobot, Truth, errors_of_table, poses, read

from pipeline.geometry.calibrate import ModelStructure, calibrate
from pipeline.geometry.initial import begin
from pipeline.geometry.law_tests import _as_noise, flips, searched
from pipeline.geometry.laws import JointLaw
from pipeline.geometry.mechanism import ArmWeights, Payloads
from pipeline.geometry.scatter import start
from pipeline.machine.robot import load
from pipeline.system import alarms

POSES, ROWS, KNOWN, DRAWS = 30, 9, 60, 300


def test_residuals_of_few_poses_are_made_as_large_as_noise():
    """With 270 readings, 60 parameters take a fifth of the noise, which is restored by pose.

    Otherwise a law found in noise exceeds copies that are all a fifth too small.
    """
    rng = np.random.default_rng(4)
    X = rng.normal(size=(POSES * ROWS, KNOWN)) * rng.uniform(0.2, 3.0, (POSES * ROWS, 1))
    hat = X @ np.linalg.pinv(X)
    blocks = np.stack([hat[k : k + ROWS, k : k + ROWS] for k in range(0, len(hat), ROWS)])
    noise = rng.normal(size=(DRAWS, len(hat)))
    left = (noise - noise @ hat).reshape(DRAWS, POSES, ROWS)
    copied = np.array([_as_noise(blocks, one) for one in left])

    assert np.mean(left**2) == pytest.approx(1 - KNOWN / len(hat), abs=0.02)
    assert np.mean(copied**2, axis=(0, 2)) == pytest.approx(1.0, abs=0.15)
    assert np.mean(copied**2) == pytest.approx(1.0, abs=0.02)


def test_a_wave_is_found_where_a_rail_has_few_stations():
    """Of eight stations most share a sign in some copies, which would contain the wave as well."""
    rng = np.random.default_rng(2)
    robot = load("kr500_rail_kuka")
    truth = Truth(np.zeros(7), turned=lambda q, tau: 2e-4 * np.sin(8 * q) * [0, 1, 0, 0, 0, 0, 0])
    machine = HeavyRobot(robot, errors_of_table(8, rng), truth)
    readings = read(machine, poses(rng, 8, 9, robot), rng)
    tool = {f"P{k}": point for k, point in enumerate(TOOL, 1)}
    none = Payloads((), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4)))
    weights = ArmWeights(np.zeros(3), none, np.zeros(len(readings), dtype=np.int64))
    table = ModelStructure(springs=False)
    begun = begin(robot, readings, tool)
    found = calibrate(begun, readings, weights, table, start(robot, None))
    laws = [JointLaw(j, "periodic", "angle", j, k) for j in (2, 3, 4) for k in np.arange(1.0, 20)]

    _, tests = searched(found, flips(readings, rng, rail=True), laws)

    assert (tests[0].law.joint, tests[0].law.order) == (2, 8.0)
    assert tests[0].p < alarms.LAW
