"""All waves of what turns with the joints, in place of a few of them that the search found."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.positions import joint_laws
from pipeline.positions.calibrate import ModelStructure, _amplitudes
from pipeline.positions.laws import JointLaw

RAIL = JointLaw(1, "smooth", "angle", 1, 1.0)
FOUND = tuple(JointLaw(2, "periodic", "angle", 2, order) for order in (2.0, 7.94, 40.0))
COUPLED = JointLaw(3, "coupling", "angle", 2, 1.0)


@dataclass(frozen=True)
class Fit:
    """An estimate by its evidence."""

    wanted: ModelStructure
    likely: float = 10.0
    known: SimpleNamespace = field(default_factory=lambda: Known())
    readings: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(q=np.array([[0.0, -3.0, -1.0], [5.0, 3.0, 1.0]]))
    )

    @property
    def mechanism(self):
        """With the laws that are wanted."""
        table = SimpleNamespace(n=3, prismatic=np.array([True, False, False]))
        return SimpleNamespace(table=table, laws=self.wanted.laws)


@dataclass(frozen=True)
class Known:
    """Scales."""

    groups: tuple = (slice(0, 1),)


def searched(monkeypatch, once=20.0, ends=(20.0, 30.0), good=True):
    """The end of the search, and whether it is what all waves together gave."""
    begun = Fit(ModelStructure(laws=(RAIL, *FOUND, COUPLED), curves=((0, 0.1), (2, 0.2))))
    monkeypatch.setattr(joint_laws, "tried", lambda f, wanted, least: replace(f, likely=once))

    def identify(mechanism, wanted, earlier):
        return replace(earlier, wanted=wanted, likely=ends[not earlier.known.groups])

    data = SimpleNamespace(identify=identify)
    judge = SimpleNamespace(as_good=lambda one, other: good)
    return begun, joint_laws._of_outputs(data, begun, judge)


@pytest.mark.parametrize("ends", [(20.0, 30.0), (30.0, 20.0)])
def test_all_whole_orders_take_the_place_of_others_and_of_curves(monkeypatch, ends):
    """From both starts, the likelier one; not those of shafts, nor over less than half a wave."""
    _, end = searched(monkeypatch, ends=ends)
    orders = {
        joint: sorted(law.order for law in end.wanted.laws if law.joint == joint)
        for joint in (2, 3)
    }

    assert end.likely == 30.0
    assert orders[2] == [*map(float, range(1, 13)), 40.0]
    assert orders[3] == sorted([COUPLED.order, *map(float, range(2, 13))])
    assert end.wanted.laws[0] == RAIL
    assert end.wanted.curves == ((0, 0.1),)


@pytest.mark.parametrize(
    "worse", [{"once": 5.0}, {"ends": (5.0, 6.0)}, {"good": False}], ids=lambda one: next(iter(one))
)
def test_they_are_left_out_where_they_gain_nothing(monkeypatch, worse):
    """By one linearisation, at the end, or at held-out poses."""
    begun, end = searched(monkeypatch, **worse)

    assert end is begun


def test_laws_begin_with_the_amplitudes_that_they_have():
    """Whichever come before them."""
    begun = SimpleNamespace(laws=FOUND, amplitudes=np.arange(1.0, 7.0))
    none = SimpleNamespace(laws=(), amplitudes=np.zeros(0))
    wanted = ModelStructure(laws=(RAIL, FOUND[2], FOUND[0]))

    assert _amplitudes(begun, wanted).tolist() == [0.0, 5.0, 6.0, 1.0, 2.0]
    assert _amplitudes(none, wanted).tolist() == [0.0] * 5
