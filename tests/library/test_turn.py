"""The rotation of a tool from the motion of its tip and of three points around it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.library.compensate import _turned
from pipeline.prediction.path import ARM_M


def test_a_tool_that_turns_is_turned_by_as_much():
    """Twenty tools of any attitude, turned by up to a milliradian about any point and shifted."""
    rng = np.random.default_rng(3)
    turn, attitude = 1e-4 * rng.standard_normal((20, 3)), Rotation.random(20, random_state=3)
    arms = ARM_M * np.vstack([np.zeros(3), np.eye(3)])
    at = rng.standard_normal((20, 1, 3)) + np.einsum("mij,tj->mti", attitude.as_matrix(), arms)
    after = np.einsum("mij,mtj->mti", Rotation.from_rotvec(turn).as_matrix(), at)

    found = _turned(at, after + rng.standard_normal((20, 1, 3)) - at)

    assert found == pytest.approx(turn, abs=1e-7)
