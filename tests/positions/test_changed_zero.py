"""What a law of a joint's positions is called: a zero that changed, a wave, a curve."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.machine.robot import load
from pipeline.positions.answer import _instrument, _named
from pipeline.positions.facts import _cause, _since
from pipeline.positions.joint_laws import NamedLaw
from pipeline.positions.laws import Inputs, JointLaw
from pipeline.positions.study import MovedSince

STEP = JointLaw(4, "step", "time", None, 0.0, middle=1.5)


def slipped(series: str) -> NamedLaw:
    """1.5 mrad since pose 83."""
    last = (series, 83)
    return NamedLaw(4, "step", "time", None, 0.0, -1.5e-3, 2e-5, (0.0, 2.0), since=last, number=0)


@pytest.mark.parametrize(("series", "form"), [("", "83"), ("noon", "83 of series noon")])
def test_a_step_in_time_is_a_zero_that_changed(series, form):
    found = _cause(slipped(series), load("ur5e"))

    assert (found.effect.name, found.effect.where) == ("joint_offset", 4)
    assert found.effect.form == f"since pose {form}"
    assert found.effect.law is None  # no law outside the catalogue
    assert found.amplitudes[0].value == -1.5e-3
    (said,) = _named([found])
    assert said.startswith(f"Zero that changed at pose {form} in joint 4 (wrist_1_joint), -1.5")


def test_what_moved_is_told_once():
    """By the sentence that says from which pose on and how far, not among what acts."""
    one = MovedSince("", 71, "B", 1e-12, np.array([0.0, 3e-4, 2e-4, 0, 0, 0]), np.full(6, 2e-6))

    assert not [*_named([_since(one)])]
    (said,) = _instrument(SimpleNamespace(moved=(one,)))
    assert said.startswith("From pose 71 on target B stands 0.36 mm from where it was")


@pytest.mark.parametrize(
    ("kind", "source", "order", "said"),
    [
        ("periodic", 3, 2.0, "ripple of 2.00 per turn"),
        ("smooth", 3, 4.0, "smooth error over its angle"),
        ("coupling", 5, 1.0, "motion 1.0 per turn of joint 5"),
    ],
)
def test_each_amplitude_has_the_name_of_its_law_and_joint(kind, source, order, said):
    """A list of amplitudes of laws tells nobody which of them is which."""
    law = NamedLaw(3, kind, "angle", source, order, 4e-4, 2e-5, (-2.0, 2.0), number=0)
    (one,) = _cause(law, load("ur5e")).amplitudes
    meaning = one.parameter.meaning.format(joint="elbow_joint")
    assert meaning == f"amplitude of the {said} in elbow_joint"


def test_the_table_is_that_of_the_robot_since():
    """Where the time is unknown, as in predictions, too: the step moves nothing there."""
    series, time = np.array([0.0, 1.0, 1.0, np.nan]), np.array([0.9, 0.4, 0.6, np.nan])
    inputs = Inputs(np.zeros((4, 6)), np.zeros((4, 6)), np.full(4, 20.0), time, series)

    assert STEP.basis(inputs).ravel().tolist() == [-1.0, -1.0, 0.0, 0.0]
