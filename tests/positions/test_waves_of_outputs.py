"""All waves of what turns with the joints, in place of a few of them that the search found."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.positions import joint_laws
from pipeline.positions.calibrate import ModelStructure, _amplitudes, _scaled
from pipeline.positions.estimate import Prior
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
        default_factory=lambda: SimpleNamespace(
            q=np.linspace([0.0, -3.0, -1.0], [5.0, 3.0, 1.0], 600)
        )
    )

    @property
    def mechanism(self):
        """With the laws that are wanted."""
        table = SimpleNamespace(n=3, prismatic=np.array([True, False, False]))
        return SimpleNamespace(table=table, laws=self.wanted.laws)


@dataclass(frozen=True)
class Known:
    """Scales."""

    groups: dict = field(default_factory=lambda: {"": slice(0, 1)})


def searched(
    monkeypatch, once=(20.0, 20.0), ends=(20.0, 30.0), good=True, yields=(), poses=slice(None)
):
    """The end of the search, and whether it is what all waves together gave.

    Evidence about one linearisation and at the end, each from the scales of the search and from
    usual ones.
    """
    begun = Fit(
        ModelStructure(laws=(RAIL, *FOUND, COUPLED), curves=((0, 0.1), (2, 0.2)), yields=yields)
    )
    monkeypatch.setattr(
        joint_laws, "tried", lambda f, wanted, *_: replace(f, likely=once[not f.known.groups])
    )

    def identify(mechanism, wanted, earlier):
        return replace(earlier, wanted=wanted, likely=ends[not earlier.known.groups])

    begun.readings.q = begun.readings.q[poses]
    data = SimpleNamespace(identify=identify)
    judge = SimpleNamespace(as_good=lambda one, other: good)
    return begun, joint_laws._of_outputs(data, begun, judge)


@pytest.mark.parametrize(("once", "ends"), [((5.0, 20.0), (0.0, 30.0)), ((20.0, 15.0), (30.0, 0.0)),
                                            ((20.0, 25.0), (30.0, 5.0))])  # fmt: skip
def test_all_whole_orders_take_the_place_of_others_and_of_curves(monkeypatch, once, ends):
    """From either start, the likelier first; not those of shafts, nor over less than half a wave.

    Scales that have vanished in the search make all waves unlikely from where it ended.
    """
    _, end = searched(monkeypatch, once, ends)
    orders = {
        joint: sorted(law.order for law in end.wanted.laws if law.joint == joint)
        for joint in (2, 3)
    }

    assert end.likely == 30.0
    assert orders[2] == [*map(float, range(1, 13)), 40.0]
    assert orders[3] == sorted([COUPLED.order, *map(float, range(2, 13))])
    assert end.wanted.laws[0] == RAIL
    assert end.wanted.curves == ((0, 0.1),)
    assert not end.wanted.soft


@pytest.mark.parametrize(
    "worse",
    [{"once": (5.0, 6.0)}, {"ends": (5.0, 6.0)}, {"good": False}],
    ids=lambda one: next(iter(one)),
)
def test_they_are_left_out_where_they_gain_nothing(monkeypatch, worse):
    """By one linearisation, at the end, or at held-out poses."""
    begun, end = searched(monkeypatch, **worse)

    assert end is begun


def test_few_poses_are_estimated_to_the_end_before_it_is_said_that_waves_gain_nothing(monkeypatch):
    """Four updates of sixty scales are no end: they left the likelier structure 120 behind."""
    _, end = searched(monkeypatch, once=(5.0, 6.0), poses=slice(0, None, 6))

    assert end.likely == 30.0


def test_bearings_and_rails_may_be_as_soft_as_gears_at_the_end(monkeypatch):
    """Once waves and curves are known, which a wide prior would take the signal of."""
    _, end = searched(monkeypatch, yields=("rail_roll",))

    assert end.wanted.soft


@pytest.mark.parametrize(("likely", "order"), [(11.0, 40.0), (9.0, 39.75)])
def test_orders_of_shafts_are_those_of_the_end_if_readings_are_likelier_so(
    monkeypatch, likely, order
):
    """A law keeps the probability that the search found, by its key."""
    begun = Fit(ModelStructure(laws=(RAIL, replace(FOUND[2], order=39.75))))

    def sharp(found, number):
        law = found.mechanism.laws[number]
        return replace(law, order=40.0) if law.order > 12 else law

    monkeypatch.setattr(joint_laws, "_resharpened", sharp)
    data = SimpleNamespace(
        identify=lambda mechanism, wanted, earlier: replace(earlier, wanted=wanted, likely=likely)
    )

    found, was = joint_laws._of_shafts(data, begun)

    assert found.wanted.laws[1].order == order
    assert {now[4]: then[4] for now, then in was.items()} == (
        {1.0: 1.0, 40.0: 39.75} if was else {}
    )
    assert bool(was) == (order == 40.0)


def prior_of(laws):
    """Prior of the two amplitudes of each law, all of size one."""
    none, size = np.zeros(0, dtype=bool), 2 * len(laws)
    groups = {law: slice(2 * k, 2 * k + 2) for k, law in enumerate(laws)}
    return Prior(np.zeros(size), np.ones(size), none, none, np.ones(size), groups, (np.nan, np.nan))


def test_scales_stay_with_their_laws():
    """Whichever laws come before them; new ones begin as usual."""
    other = JointLaw(3, "periodic", "angle", 3, 5.0)
    earlier = replace(prior_of(FOUND), std=np.repeat([1e-5, 2e-5, 3e-5], 2))

    now = _scaled(prior_of((FOUND[2], other, FOUND[0])), slice(0, 0), earlier)

    assert now.std.tolist() == np.repeat([3e-5, 1.0, 1e-5], 2).tolist()


def test_laws_begin_with_the_amplitudes_that_they_have():
    """Whichever come before them."""
    begun = SimpleNamespace(laws=FOUND, amplitudes=np.arange(1.0, 7.0))
    none = SimpleNamespace(laws=(), amplitudes=np.zeros(0))
    wanted = ModelStructure(laws=(RAIL, FOUND[2], FOUND[0]))

    assert _amplitudes(begun, wanted).tolist() == [0.0, 5.0, 6.0, 1.0, 2.0]
    assert _amplitudes(none, wanted).tolist() == [0.0] * 5


def test_waves_are_sought_beside_the_curve_of_their_joint(monkeypatch):
    """A curve between few poses contains none of forty periods per turn, and hid it."""
    sought = []
    waves = [JointLaw(3, "periodic", "angle", 3, 40.0), JointLaw(2, "periodic", "angle", 2, 3.0)]
    curved = Fit(ModelStructure(curves=((2, 0.2),)))

    def of_all_else(data, found, others, *_):
        sought.extend(others)
        return found, {}

    for name, stub in {
        "replace": lambda one, **_: one,
        "rail": lambda _: False,
        "law_tests": SimpleNamespace(flips=lambda *_, **__: None, law_tests=lambda *_: []),
        "_candidates": lambda *_: waves,
        "_of_own_angles": lambda *_: (curved, {}),
        "_of_all_else": of_all_else,
        "_of_outputs": lambda _, found, __: found,
        "_of_shafts": lambda _, found: (found, {}),
        "_by_copies": lambda *_: {},
        "_named": lambda *_: (),
        "causes": lambda *_: (),
    }.items():
        monkeypatch.setattr(joint_laws, name, stub)
    joint_laws.with_laws(SimpleNamespace(readings=None), curved, (), {}, None)

    assert sought == waves
