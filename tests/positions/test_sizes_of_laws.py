"""A law counts where the readings are certainly likelier with it, and its size is certain."""

from types import SimpleNamespace

import numpy as np
import pytest
from moved_reflector import moved

from pipeline.machine.robot import load
from pipeline.positions import joint_laws
from pipeline.positions.calibrate import ModelStructure
from pipeline.positions.cross_validation import LeftOutPoses, partings
from pipeline.positions.initial import begin
from pipeline.positions.joint_laws import LawSearchData, NamedLaw
from pipeline.positions.laws import JointLaw
from pipeline.positions.scatter import start

SINCE = JointLaw(6, "step", "time", None, 0.0, 69.5 / 159)


def with_a_changed_zero(**reflector):
    """The estimate before and after a zero of joint 6 that changed at pose 70 is asked for."""
    readings, weights = moved(**reflector)
    robot, rng = load("ur10"), np.random.default_rng(0)
    data = LawSearchData(readings, weights, (np.nan, np.nan), start(robot, None))
    found = data.identify(begin(robot, readings, {}), ModelStructure(springs=False))
    judge = LeftOutPoses(partings(readings, rng, False), rng)
    return found, joint_laws._carried(data, found, SINCE, judge)


def test_a_zero_of_a_joint_that_moves_no_target_did_not_change():
    """A reflector 0.3 mm beside the axis that moved by 80 um: 270 mrad, and no zero is so far off.

    All left-out poses are predicted better by a little, and the readings are no likelier.
    """
    before, after = with_a_changed_zero(at=[3e-4, 0, 0.12], by=[0, 8e-5, 0])

    assert after is before


def test_a_zero_that_changed_is_found():
    """The same motion of a reflector 80 mm beside the axis is one of 1 mrad."""
    before, after = with_a_changed_zero(at=[0.08, 0, 0.12], by=[0, 8e-5, 0])

    assert after is not before
    assert after.mechanism.amplitudes[-1] == pytest.approx(1e-3, rel=0.3)


@pytest.mark.parametrize(("size", "named"), [(1.9, 0), (-1.9, 0), (2.1, 1), (-2.1, 1)])
def test_what_is_named_has_a_size(monkeypatch, size, named):
    """An interval that contains zero beside "probability over 99.9 %" helps nobody."""
    law = NamedLaw(3, "step", "time", None, 0.0, size * 1e-5, 1e-5, (0.0, 1.0), since=("", 9))
    monkeypatch.setattr(joint_laws, "_slices", lambda found: [(law, "key", slice(0, 1))])
    sure = SimpleNamespace(sure=True, reduction=0.1)
    judge = SimpleNamespace(gains=lambda *_: (sure, sure))

    assert len(joint_laws._named(None, {"key": 1e-9}, judge)) == named
