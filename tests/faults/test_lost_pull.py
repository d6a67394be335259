"""Bad readings in a pull without direction: planted beside a bad chain reading, named by shape."""

import numpy as np
import pytest
from small_case import moved, small, where

from pipeline.faults.screen import screen
from pipeline.reduction.bring import bring

GROUP = "pose04_rep2_loaded"
CHAIN_OFF = np.array([0.0, 0.3, 0.2])
"""Turns the pull by more than any spring explains [m]."""


@pytest.fixture(scope="module")
def case():
    """Six poses, each pulled twice, nothing wrong."""
    return small(3)


def named(case):
    """What is said to be wrong, and where."""
    return [(one.name, one.where) for one in screen(case, bring(case)).findings]


def in_plane(case, way):
    """A direction in the plane of the targets of the pull, tracker's frame."""
    a, b, c = (
        case.readings.loc[where(case, GROUP, name), ["x_m", "y_m", "z_m"]].to_numpy(float)[0]
        for name in case.settings.measured[:3]
    )
    out = way[0] * (b - a) + way[1] * (c - a)
    return out / np.linalg.norm(out)


def off(case, target, shift):
    """The case with one reading of the pull shifted."""
    return moved(case, where(case, GROUP, target), shift)


def test_a_bad_reading_beside_a_bad_chain_reading_is_named_too(case):
    """One millimetre that changes two sides of the triangle; the pull is gone either way."""
    chain, first = case.settings.naming.chain[1], case.settings.measured[0]
    alone = off(case, chain, CHAIN_OFF)
    both = off(alone, first, 1e-3 * in_plane(case, (1.0, 1.0)))

    assert [place.startswith(GROUP) for _, place in named(alone)] == [True]
    assert sorted(place for _, place in named(both)) == sorted(
        [named(alone)[0][1], f"{GROUP}/{first}"]
    )
    found = screen(both, bring(both))
    (one,) = (one for one in found.findings if one.where.endswith(first))
    assert one.size == pytest.approx(1e-3, rel=0.3)
    assert GROUP not in set(found.case.readings["group"])


def test_which_of_two_targets_moved_is_not_guessed(case):
    """Both ends of one side move apart along it: nothing says which one is wrong, so none is."""
    chain, (first, second, *_) = case.settings.naming.chain[1], case.settings.measured
    along = in_plane(case, (1.0, 0.0))
    bad = off(off(case, chain, CHAIN_OFF), first, -5e-4 * along)
    bad = off(bad, second, 5e-4 * along)

    assert not {place for _, place in named(bad)} & {f"{GROUP}/{first}", f"{GROUP}/{second}"}


@pytest.mark.slow
def test_good_readings_of_a_lost_pull_are_left_alone():
    """Ten draws of the noise with a bad chain reading each: nothing else is accused."""
    for seed in range(20, 30):
        drawn = small(seed)
        bad = off(drawn, drawn.settings.naming.chain[1], CHAIN_OFF)

        assert len(named(bad)) == 1
