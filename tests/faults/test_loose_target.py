"""A target that gives way with the pull, as with a nest that rocks."""

from functools import cache

import numpy as np
import pytest
from small_case import asked, moved, small

from pipeline.faults.loose_target import loose_target
from pipeline.reduction.register import XYZ


@cache
def case():
    """Six poses, each pulled twice."""
    return small(3)


def pulls():
    """Force of each reading's pull, tracker's frame, over the largest, zero in zeros, (n, 3)."""
    rows, loads = case().readings, case().loads
    size = loads.set_index(["pose", "repeat"])["force_n"] / loads["force_n"].max()
    ends = {}
    for name in ("Pl1", "Pl2"):
        own = rows[(rows["target"] == name) & (rows["state"] == "loaded")]
        ends[name] = own.groupby(["pose", "repeat"])[XYZ].mean()
    way = ends["Pl2"] - ends["Pl1"]
    way = way.div(np.linalg.norm(way.to_numpy(float), axis=1), axis=0).mul(size, axis=0)
    keys = list(zip(rows["pose"], rows["repeat"], strict=True))
    out = way.reindex(keys).fillna(0.0).to_numpy(float)
    return out * (rows["state"] == "loaded").to_numpy()[:, None]


def yielding(**size_m):
    """The case with targets that yield by so much under the largest pull, along it."""
    rows, each = case().readings, case()
    for name, size in size_m.items():
        mine = (rows["target"] == name).to_numpy()
        each = moved(each, mine, size * pulls()[mine])
    return each


@pytest.mark.sampled(3)
@pytest.mark.parametrize("size", [5e-4, 2e-3, -2e-2])
@pytest.mark.parametrize("name", ["P1", "P3"])
def test_one_target_that_yields_is_one_mistake(name, size):
    """Its name and size; the corrected campaign has no reading of it in any pose."""
    given = yielding(**{name: size})

    (one,) = loose_target(asked(given))

    assert (one.name, one.where) == ("loose_target", name)
    assert one.size == pytest.approx(abs(size), rel=0.3)
    left = one.correct(given).readings
    assert name not in set(left["target"])
    assert len(left) == (given.readings["target"] != name).sum()


def test_a_soft_effector_is_no_single_target():
    """All targets yield, each by another amount."""
    assert loose_target(asked(yielding(P1=2e-3, P2=-1e-3, P3=-4e-3))) == []


@pytest.mark.parametrize("since", [7, 4])
def test_a_reading_that_is_off_or_a_target_that_moved_does_not_yield(since):
    """Nothing, one reading 2 mm off, and a target 2 mm elsewhere since a pose."""
    rows = case().readings
    mine = ((rows["target"] == "P2") & (rows["pose"] >= since)).to_numpy()
    one = ((rows["target"] == "P2") & (rows["pose"] == 3) & (rows["repeat"] == 2)).to_numpy()

    assert loose_target(asked(moved(case(), mine, np.array([2e-3, 0, 0])))) == []
    assert loose_target(asked(moved(case(), one, np.array([0, 2e-3, 0])))) == []


@pytest.mark.parametrize("names", [("P1", "P3", "P2"), ("P2", "P1", "P3")])
def test_which_of_two_targets_yields_is_told_by_the_springs(names):
    """Only the distance of two changes, since the one that yields keeps its own to the third."""
    rows, keys = case().readings, ["pose", "state", "repeat"]
    mine, at = (rows["target"] == names[0]).to_numpy(), rows.groupby([*keys, "target"])[XYZ].mean()
    states = [*rows.loc[mine, keys].itertuples(index=False, name=None)]
    own, other, third = (np.array([at.loc[(*one, name)] for one in states]) for name in names)
    keeps = (third - own) / np.linalg.norm(third - own, axis=1, keepdims=True)
    way = other - own - np.sum((other - own) * keeps, axis=1, keepdims=True) * keeps
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    share = np.linalg.norm(pulls(), axis=1)[mine, None]

    (one,) = loose_target(asked(moved(case(), mine, 2e-3 * share * way)))

    assert (one.name, one.where) == ("loose_target", names[0])
