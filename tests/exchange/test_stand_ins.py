"""What simulators need and no campaign identifies: frames, inertia, damping."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.exchange._xml import Spring, body, row, rpy, shift
from pipeline.machine.robot import load

JOINT = load("kr500_rail").joints[2]


@pytest.mark.parametrize("seed", range(5))
def test_roll_pitch_and_yaw_turn_back(seed):
    """As scipy composes them: R = Rz(yaw) Ry(pitch) Rx(roll), about fixed axes."""
    R = Rotation.random(random_state=seed).as_matrix()

    assert Rotation.from_euler("xyz", rpy(R)).as_matrix() == pytest.approx(R, abs=1e-12)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_an_upright_frame_turns_back_though_roll_and_yaw_are_one(pitch):
    """At 90 degrees of pitch only their sum or difference is determined."""
    R = Rotation.from_euler("xyz", [0.3, pitch, -0.4]).as_matrix()

    assert Rotation.from_euler("xyz", rpy(R)).as_matrix() == pytest.approx(R, abs=1e-9)


def test_a_spring_swings_thirty_times_a_second_critically_damped():
    """omega^2 = k / I, and d^2 = 4 k I at the limit between swinging and creeping."""
    spring = Spring(JOINT, 2.0e6, 1.0e4)

    assert np.sqrt(spring.stiffness / spring.inertia) == pytest.approx(2 * np.pi * 30)
    assert spring.damping**2 == pytest.approx(4 * spring.stiffness * spring.inertia)
    assert body(spring).inertia == spring.inertia


def test_numbers_keep_all_their_digits():
    """And a translation moves a point by itself."""
    assert [float(word) for word in row([1 / 3, -2e-17]).split()] == [1 / 3, -2e-17]
    assert shift(np.array([1.0, 2.0, 3.0])) @ [0, 0, 0, 1] == pytest.approx([1, 2, 3, 1])
