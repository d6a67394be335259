"""Torques of a payload's weight, from its potential alone."""

import numpy as np
import pytest

from pipeline.machine.robot import configure, load
from pipeline.positions.mechanism import payload_torques

Q = np.array([[2.0, 0.3, -1.2, 1.9, 0.7, -0.8, 1.1], [5.0, -0.9, -0.6, 1.2, -1.4, 0.5, 2.3]])
MASS, CENTRE = np.array([180.0, 60.0]), np.array([[0.11, -0.07, 0.32], [-0.2, 0.15, 0.1]])
GRAVITY = np.array([0.4, -0.9, -9.75])


def fallen(robot, q, mass, centre):
    """Work of the weight from the origin of F_b to where the payload is [J]."""
    return mass * GRAVITY @ configure(robot, q[None]).points(centre[None])[0, 0]


@pytest.mark.parametrize("pose", [0, 1])
def test_torques_change_with_mass_and_centre_as_the_potential_does(pose):
    """d(dW/dq)/dm and d(dW/dq)/dc by mixed differences, in a cell whose floor is not level."""
    robot, (q, mass, centre) = load("kr500_rail"), (Q[pose], MASS[pose], CENTRE[pose])
    found = payload_torques(configure(robot, Q), GRAVITY, MASS, CENTRE)[pose]

    h = 1e-5
    for j, step in enumerate(h * np.eye(len(q))):

        def torque(m, c, step=step):
            return (fallen(robot, q + step, m, c) - fallen(robot, q - step, m, c)) / (2 * h)

        by_centre = [torque(mass, centre + e) - torque(mass, centre) for e in np.eye(3)]
        by_mass = torque(mass + 1, centre) - torque(mass, centre)
        assert found[j] == pytest.approx([by_mass, *by_centre], rel=1e-6, abs=1e-4)
