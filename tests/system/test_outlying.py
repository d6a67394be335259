"""Readings far off: found where they were moved, and no likelier than their distribution says."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from small_case import asked, moved, small, where

from pipeline.system.family import FAR_OFF, FREEDOM, Family
from pipeline.system.linearised import CurrentModel, linearise
from pipeline.system.outlying import _chance, far

NOWHERE = np.full((4, 2), -1)
"""Keys of four readings of no pose."""


def student(nu):
    """Student's family with nu degrees of freedom."""
    weight = np.zeros(len(Family.stated().weight))
    weight[1 + FREEDOM.index(nu)] = 1.0
    return replace(Family.stated(), weight=weight)


def seen(case):
    """The campaign at its springs, all readings weighted alike."""
    got = asked(case)
    model = CurrentModel(case.cell, got.estimate.value, 7)
    return linearise(model, got.reduced.data, ())


def test_two_readings_far_off_are_found_where_they_are():
    """The farther first, at the distance by which they were moved; a clean campaign has none."""
    case = small()
    spoilt = moved(case, where(case, "pose04_rep1_loaded", "P2"), [3e-3, 0, 0])
    spoilt = moved(spoilt, where(case, "pose02_rep2_loaded", "P3"), [0, 0, 2e-3])
    got, names = far(seen(spoilt), Family.stated()), case.settings.measured

    assert [(p, names[t]) for p, t in zip(got.pose, got.target, strict=True)] == [
        (4, "P2"), (2, "P3"),
    ]  # fmt: skip
    assert (got.count, got.base) == (2, 0)
    assert got.p_value < 1e-9
    clean = seen(case)
    none = far(clean, Family.stated())
    assert (none.count, none.p_value) == (0, 1.0)
    both = far(clean, Family.stated(), (2, 8))
    assert (both.count, both.base) == (2, 2)
    assert both.p_value < 1e-6
    wide = replace(Family.stated(), log_scale=np.full(len(Family.stated().weight), 10.0))
    assert far(seen(spoilt), wide).count == 0  # cores 150 times as wide
    tails = far(clean, student(3.0), (1, 8))
    n = 8 + len(clean.data.pull) + len(np.unique(clean.data.zero))
    assert tails.p_value == pytest.approx(_chance(1, n, stats.f.sf(100 / 3, 3, 3)), rel=0.5)


@pytest.mark.parametrize("nu", [3.0, 5.0])
def test_the_chance_of_a_far_reading_is_that_of_the_family(nu):
    """|t|^2 / 3 of a Student vector with nu degrees of freedom is F(3, nu), by scipy."""
    (p,) = student(nu).away(FAR_OFF, np.zeros((4, 3)), NOWHERE)

    assert p == pytest.approx(stats.f.sf(FAR_OFF**2 / 3, 3, nu), rel=0.03)


def test_what_the_others_do_not_know_of_a_reading_has_a_part_in_its_chance():
    """Student's errors and a normal error of the others, drawn: mean over unequal readings."""
    rng, others = np.random.default_rng(4), np.array([0.0, 0.5, 1.0, 4.0])
    n = 200_000
    t = rng.standard_normal((n, 4, 3)) * np.sqrt(3 / rng.chisquare(3, (n, 4, 1)))
    x = t + np.sqrt(others)[:, None] * rng.standard_normal((n, 4, 3))
    far_off = np.sum(x**2, axis=2) / np.maximum(others, 1) > FAR_OFF**2

    (p,) = student(3.0).away(FAR_OFF, np.tile(others[:, None], 3), NOWHERE)

    assert p == pytest.approx(far_off.mean(), rel=0.05)


def test_heavy_tails_explain_some_far_readings_and_not_a_dozen():
    """Of 1000 readings, Student's with 3 degrees of freedom throws eight so far, never thirty."""
    p = student(3.0).away(FAR_OFF, np.zeros((1, 3)), NOWHERE[:1])

    assert _chance(10, 1000, p) > 0.1
    assert _chance(30, 1000, p) < 1e-4
    assert _chance(0, 1000, p) == 1.0


def test_a_reading_is_as_far_off_as_it_was_moved_whatever_the_others_know():
    """Six readings moved by eleven standard uncertainties each: most appear beyond ten.

    The uncertainty of the others adds half to the scatter of that, and brings none nearer.
    """
    given = small(3)
    rows, rng, names = given.readings, np.random.default_rng(3), given.settings.measured
    loaded = rows.index[(rows["state"] == "loaded") & rows["target"].isin(names)]
    model, found = seen(given).model, 0
    for k in rng.permutation(loaded)[:6]:
        way = rng.standard_normal(3)
        off = 11 * given.settings.tracker.sigma_m * way / np.linalg.norm(way)
        spoilt = moved(given, rows.index == k, off)
        data = asked(spoilt).reduced.data
        found += far(linearise(model, data, ()), Family.stated()).count

    assert found >= 4
