"""Weights of causes that are too small to name, beside the joint springs."""

from dataclasses import replace

import numpy as np
import pytest
from small_case import small

from pipeline.answer.recommended import _unseen_averaged, joint_springs
from pipeline.machine.effects import catalogue
from pipeline.reduction.bring import bring
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.system.fit import fit


def test_joint_springs_have_the_weight_that_the_causes_leave():
    """A fifth and a tenth of the probability are those of causes."""
    case = small(3)
    alone = joint_springs(fit(case, bring(case)))
    some = [
        replace(alone.first, weight=weight, effects=(effect,))
        for weight, effect in zip((0.2, 0.1), catalogue(case.robot), strict=False)
    ]
    where = PoseOfInterest(np.zeros(case.robot.n), np.array([0.0, 0.0, -1000.0]), stated=True)

    found = _unseen_averaged(alone, some, where)
    weights = {one.effects: one.weight for one in found.hypotheses}
    assert weights.pop(()) == pytest.approx(0.7)
    assert sorted(weights.values()) == pytest.approx([0.1, 0.2])
    assert found.first.effects == ()
