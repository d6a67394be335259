"""A base reflector whose place is free, while the others agree or not."""

import numpy as np
import pytest
from small_case import small

from pipeline.faults import base_reflector
from pipeline.faults.base_reflector import base_target
from pipeline.reduction.register import register


@pytest.mark.parametrize(("rest", "named"), [(15.0, 1), (33.0, 0)])
def test_a_free_place_takes_three_degrees_of_freedom(monkeypatch, rest, named):
    """Eight readings of four reflectors, 15 left: 33 is improbable (p = 0.005); for 18 it is not.

    Chi2 of 15 degrees of freedom exceeds 30.58 in one case of a hundred, of 18 34.81.
    """
    corners = {"B1": [1, -0.5, -0.3], "B2": [1, 15, -0.3], "B3": [-1, 15, 0.2], "B4": [-1, -0.5, 0]}
    case = small(4, base_frame=corners)
    wrong = {**case.settings.base_frame, "B1": (1.002, -0.5, -0.3)}
    case.settings.base_frame.update(wrong)
    registration = register(case.settings, case.readings)
    shift = np.array([-0.002, 0.0, 0.0])
    monkeypatch.setattr(base_reflector, "_freed", lambda *_: (rest, shift))

    assert registration.dof == 18
    assert len(base_target(case, registration, 1.0)) == named
