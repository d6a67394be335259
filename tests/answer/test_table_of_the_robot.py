"""Entries of a robot's table in the answer, against the robot that has them."""

import numpy as np
import pytest

from pipeline.answer.geometry import table_entries
from pipeline.machine.robot import load
from pipeline.machine.robot.dh_parameters import changed, dh_parameters, nominal


@pytest.mark.parametrize("name", ["kr500_rail", "ur10", "fanuc_r2000ic"])
def test_values_are_those_of_the_robot_that_was_found(name):
    """Nominal plus what each is off by; known where its variance is half that of the prior."""
    robot = load(name)
    every = dh_parameters(robot)
    k = np.arange(len(every))
    off, prior = 1e-4 * (k + 1) * (-1) ** k, 1e-3 * (1 + k)
    found = np.sqrt(np.where(k % 2, 0.4, 0.6)) * prior

    entries = table_entries(robot, off, found**2, 2 * prior, prior)

    true = nominal(changed(robot, every, off), every)
    assert [one.value for one in entries] == pytest.approx(true, abs=1e-12)
    assert [one.nominal for one in entries] == pytest.approx(nominal(robot, every), abs=1e-12)
    assert [(one.name, one.where) for one in entries] == [(x.name, x.joint) for x in every]
    assert [one.std for one in entries] == pytest.approx(found)
    assert [one.prior_std for one in entries] == pytest.approx(2 * prior)
    assert [one.identifiable for one in entries] == (k % 2 == 1).tolist()
    assert all((one.unit == "rad") == (one.name in TURNING) for one in entries)


TURNING = {"joint_offset", "link_twist", "axis_tilt", "link_turn"}
