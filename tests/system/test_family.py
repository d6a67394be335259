"""Tails of single readings: drawn by numpy, the family must be found, and each reading weighted."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import stats

from pipeline.system.family import (
    _GRID,
    BURSTS,
    FAILED_LOCKS,
    FAR_OFF,
    FREEDOM,
    SPELLS,
    Family,
    family,
    likelihood,
)
from pipeline.system.spells import States

KEYS = np.column_stack([np.arange(300) // 15, np.arange(300) // 3 % 5 - 1])
"""Pose, and pull or -1 for zeros, of each of 300 readings: twenty poses of five states of three."""

STATES = States.each(KEYS)


def errors(nu, n, rng):
    """Vectors of three with one Student scale each, unit variance per axis; inf: normal."""
    e = rng.standard_normal((n, 3))
    if np.isinf(nu):
        return e
    return e * np.sqrt((nu - 2) / rng.chisquare(nu, n))[:, None]


def seen(e, others, rng):
    """What other readings say of errors, with their own variance, in the form of `likelihood`."""
    x = e + np.sqrt(others) * rng.standard_normal(e.shape)
    return likelihood(x**2, np.full(e.shape, 1.0 + others), np.ones(len(e)))


def test_the_likelihood_is_the_normal_density():
    """At each lambda, up to a factor that is constant for the reading."""
    rng = np.random.default_rng(1)
    x, others = rng.standard_normal((4, 3)), rng.uniform(0.3, 2.0, (4, 3))
    got = likelihood(x**2, others + 1.0, np.ones(4))
    at = [0, 25, 60, 200]

    for i in range(4):
        direct = [
            stats.multivariate_normal(np.zeros(3), np.diag(others[i] + np.exp(_GRID[k]))).pdf(x[i])
            for k in at
        ]
        assert got[i, at] / got[i, at[0]] == pytest.approx(np.array(direct) / direct[0], rel=1e-9)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("nu", [3.0, 5.0])
def test_students_tails_are_seen(nu):
    """300 readings, as 16 poses have; the degrees of freedom are found within a factor of two."""
    found = [
        family(seen(errors(nu, 300, rng), 0.6, rng), STATES, False)[0]
        for rng in map(np.random.default_rng, range(10))
    ]

    assert sum(one.p_value < 0.003 for one in found) >= 9
    assert np.median([one.freedom for one in found]) == pytest.approx(nu, rel=0.6)


def test_normal_readings_keep_the_stated_family():
    """Twelve campaigns: none is called heavy-tailed, and variances do not change."""
    rngs = [np.random.default_rng(100 + k) for k in range(12)]
    found = [family(seen(errors(np.inf, 300, rng), 0.6, rng), STATES, False) for rng in rngs]

    assert sum(one.p_value < 0.003 for one, _ in found) <= 1
    assert np.median([np.median(variance) for _, variance in found]) == pytest.approx(1.0, abs=0.03)


def test_one_gross_reading_is_a_blunder_and_not_a_tail():
    """A hundred standard uncertainties among normal readings, and the same among Student's."""
    rng = np.random.default_rng(5)
    normal = errors(np.inf, 300, rng)
    normal[7] = [100.0, 0.0, 0.0]
    told, variance = family(seen(normal, 0.6, rng), STATES, False)

    assert told.heavy < 0.3
    assert told.mistaken(100.0**2) > 0.95
    assert variance[7] > 1e3
    wild, _ = family(seen(errors(3.0, 300, rng), 0.6, rng), STATES, False)
    assert wild.mistaken(8.0**2) < 0.5
    assert told.mistaken(12.0**2) > 0.9
    assert told.mistaken(2.0**2) < 1e-3


def in_spells(width, rng):
    """All readings of pose 3 and the last three states of pose 11 are wider."""
    wide = (KEYS[:, 0] == 3) | ((KEYS[:, 0] == 11) & (KEYS[:, 1] > 0))
    return np.where(wide, width, 1.0)[:, None] * rng.standard_normal((300, 3))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("width", [3.0, 4.0, 6.0])
def test_a_reading_is_judged_by_the_others_of_its_pose(width):
    """In a spell none is a mistake that its width explains; elsewhere one as far off is."""
    for rng in map(np.random.default_rng, range(300, 303)):
        told, variance = family(seen(in_spells(width, rng), 0.6, rng), STATES, False)

        assert told.in_spells
        assert told.mistaken((2.5 * width) ** 2, 3, (3, 2)) < 0.1
        assert told.mistaken(200.0**2, 3, (3, 2)) > 0.9
        assert told.mistaken(8.5**2, 3, (7, 2)) > 0.9
        assert told.mistaken(8.5**2) > 0.9  # of the base
        assert told.mistaken(8.5**2, near=[(2.0, 3), (3.0, 3), (1.0, 2)]) > 0.9
        nothing = told.mistaken(8.5**2)
        assert told.mistaken(8.5**2, near=[(0.0, 0.0)] * 3) == pytest.approx(nothing, rel=0.2)
        assert told.mistaken((2.5 * width) ** 2, near=[(3 * width**2, 3)] * 3) < 0.1
        assert np.median(variance[KEYS[:, 0] == 3]) == pytest.approx(width**2, rel=0.8)
        assert np.median(variance[KEYS[:, 0] == 7]) == pytest.approx(1.0, abs=0.2)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("off", [8.5, 12.0, 30.0])
def test_a_lone_bad_reading_makes_no_spell(off):
    """The other readings of its pose are quiet."""
    for rng in map(np.random.default_rng, range(320, 324)):
        e = errors(np.inf, 300, rng)
        e[100] = off * np.sqrt(1.6) * np.array([0.6, 0.0, 0.8])
        told, _ = family(seen(e, 0.6, rng), STATES, False)

        assert not told.in_spells
        assert told.rather.mistaken(off**2, 3, tuple(KEYS[100])) > 0.9


def test_the_farthest_reading_of_a_pose_spoils_no_other():
    """Only it, beyond 6 standard uncertainties, and gross errors get other weights among spells."""
    told, away, mean = replace(Family.stated(), states=STATES), np.ones(300), np.full(300, 25.0)
    away[[45, 46, 47]], away[100], mean[200] = (62.0, 99.0, 34.0), 35.0, 1e4  # 45 to 59: pose 3

    now = told.among_spells(mean, np.ones(300), away)

    assert {k: now[k] for k in np.flatnonzero(now != 1.0)} == {46: 99.0, 200: 1e4}


def test_what_is_drawn_has_spells_where_they_were():
    """In other states lambda is one."""
    rng = np.random.default_rng(9)
    told, _ = family(seen(in_spells(5.0, rng), 0.6, rng), STATES, False)
    mean = told.drawn(KEYS, 200, rng).mean(axis=1) / np.exp(told.log_scale[told.weight.argmax()])

    assert mean[KEYS[:, 0] == 3].mean() > 8
    assert mean[KEYS[:, 0] == 7].mean() == pytest.approx(1.0, abs=0.1)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("axes", [1, 2, 3])
def test_a_mistake_is_judged_along_the_axes_that_show_it(axes):
    """Among draws of errors of one width and of arbitrarily large mistakes, the true fraction."""
    rng, part, at = np.random.default_rng(7), 1e-2, 5.0
    told = replace(Family.stated(), mistakes=np.full(len(Family.stated().weight), part))
    n = 4_000_000
    wide = np.exp(rng.uniform(np.log(36.0), 25.0, n))
    near = np.abs(np.sqrt(wide * rng.chisquare(axes, n)) - at) < 0.25
    normal = stats.chi(axes)
    odd = part * near.mean()
    own = (1 - part) * (normal.sf(at - 0.25) - normal.sf(at + 0.25))

    assert told.mistaken(at**2, axes) == pytest.approx(odd / (odd + own), abs=0.06)
    assert told.mistaken(at**2, 1) > told.mistaken(at**2, 2) > told.mistaken(at**2, 3)


def test_drawn_variances_are_those_of_the_family():
    """Inverse gamma for Student; for Eq. (18), 3 Beta(1/2, 1), whose kurtosis per axis is 5.4."""
    weight = np.zeros(len(Family.stated().weight))
    weight[1 + FREEDOM.index(5.0)] = 1.0
    told = replace(Family.stated(), weight=weight)
    drawn = told.drawn(KEYS[:100], 2000, np.random.default_rng(2)).ravel()

    assert stats.kstest(5.0 / drawn, stats.chi2(5).cdf).pvalue > 1e-3
    paper = Family.stated(True).drawn(KEYS[:100], 4000, np.random.default_rng(3))
    assert paper.mean() == pytest.approx(1.0, rel=0.01)
    assert 3 * (paper**2).mean() / paper.mean() ** 2 == pytest.approx(5.4, rel=0.01)


def test_tails_of_the_paper_are_not_heavier_than_stated():
    """Radius normal, direction uniform: heavy for a normal law, and just what is stated."""
    rng = np.random.default_rng(6)
    direction = rng.standard_normal((300, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    e = np.sqrt(3) * rng.standard_normal((300, 1)) * direction
    told = seen(e, 0.6, rng)

    assert family(told, STATES, True)[0].p_value > 0.01
    assert family(told, STATES, False)[0].p_value < 1e-3


def student(nu, core, rng):
    """Student's noise of which `core` is the width of the centre, not the variance."""
    return core * np.sqrt(nu / (nu - 2)) * errors(nu, 300, rng)


def bursts(core, rng):
    """One reading in twenty is four times wider."""
    return core * np.where(rng.random((300, 1)) < 0.05, 4.0, 1.0) * rng.standard_normal((300, 3))


WIDTHS = [
    (lambda rng: 1.4 * rng.standard_normal((300, 3)), 1.4, True),
    (lambda rng: student(3.0, 0.85, rng), 0.85, False),
    (lambda rng: student(3.0, 1.0, rng), 1.0, False),
    (lambda rng: bursts(1.0, rng), 1.0, False),
    (lambda rng: student(3.0, 1.7, rng), 1.7, True),
    (lambda rng: bursts(1.7, rng), 1.7, True),
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("drawn", "core", "wider"), WIDTHS)
def test_what_the_tails_explain_is_no_wider_core(drawn, core, wider):
    """The variance in use is that of core and tails; the core is also stated separately."""
    found = []
    for rng in map(np.random.default_rng, range(40, 50)):
        e = drawn(rng)
        used = np.sqrt(np.mean(e**2))
        found.append(family(seen(e / used, 0.6, rng), STATES, False)[0].core(used))

    told = sum(one.p_value < 0.003 for one in found)
    assert told >= 9 if wider else told == 0
    assert np.median([one.scale for one in found]) == pytest.approx(core, rel=0.1)
    spread = np.std([np.log(one.scale) for one in found])
    assert 0.4 * spread < np.median([one.std for one in found]) < 2.5 * spread


def test_no_law_throws_more_than_an_instrument_in_order():
    """Probability beyond ten widths of the core, by scipy: noise is bounded, whatever was found."""
    student = [stats.f.sf(FAR_OFF**2 / 3, 3, nu) for nu in FREEDOM]
    bursts = [part * stats.chi2.sf((FAR_OFF / width) ** 2, 3) for part, width in BURSTS]

    spells = [share * stats.chi2.sf((FAR_OFF / width) ** 2, 3) for share, width in SPELLS]

    assert max(*student, *bursts, *spells) < FAILED_LOCKS


@pytest.mark.sampled(2)
@pytest.mark.parametrize("many", [20, 40])
@pytest.mark.parametrize("used", [1.0, 2.5])
def test_many_readings_alike_far_off_are_mistakes_and_no_tails(many, used):
    """Some of 300 normal readings, in any poses, off by 12 standard uncertainties of any noise."""
    rng = np.random.default_rng(many)
    e = errors(np.inf, 300, rng)
    direction = rng.standard_normal((many, 3))
    direction *= 12 / np.linalg.norm(direction, axis=1, keepdims=True)
    e[rng.choice(300, many, replace=False)] += direction
    found = family(seen(e / used, 0.6 / used**2, rng), STATES, False)[0].of(used)

    assert not found.likely_heavy
    assert found.width == pytest.approx(1.0, rel=0.1)
    assert found.rather.mistaken(10.0**2) > 0.95
    assert found.rather.mistaken(3.0**2) < 0.1


@pytest.mark.whole
def test_tails_stay_tails_beside_a_bound():
    """Student's with 3 degrees of freedom, and bursts.

    The deviations they cause are no mistakes.
    """
    found = [
        family(seen(drawn(rng), 0.6, rng), STATES, False)[0].rather
        for rng in map(np.random.default_rng, range(70, 75))
        for drawn in (partial(errors, 3.0, 300), partial(bursts, 1.0))
    ]

    assert sum(one.heavy > 0.5 and one.mistaken(8.0**2) < 0.9 for one in found) >= 9


@pytest.mark.parametrize("width", [3.0, 6.0])
def test_one_target_that_scatters_more_is_no_tail(width):
    """Of three targets the second is looser: it is named, and no law of all readings.

    Planted bug: without targets among the laws, these were tails of all three.
    """
    rng, targets = np.random.default_rng(7), np.arange(300) % 3
    e = errors(np.inf, 300, rng) * np.where(targets == 1, width, 1.0)[:, None]
    found = family(seen(e, 0.6, rng), STATES, False, targets)[0].loosest

    assert found.target == 1
    assert found.probability > 0.99
    assert found.p_value < 1e-6
    assert found.width == pytest.approx(width, rel=0.4)


@pytest.mark.parametrize("nu", [3.0, np.inf])
def test_no_target_stands_for_noise_of_all(nu):
    """Student's tails, or none, in the readings of three targets alike."""
    rng, targets = np.random.default_rng(8), np.arange(300) % 3
    found = family(seen(errors(nu, 300, rng), 0.6, rng), STATES, False, targets)[0].loosest

    assert found.probability < 0.05


def test_where_no_reading_is_left_the_stated_family_stays():
    """As of a campaign whose pulls determine every reading: no target is looser than another."""
    none = np.zeros(0, dtype=np.int64)
    laws = seen(np.zeros((0, 3)), 0.6, np.random.default_rng(0))

    told, _ = family(laws, States.each(none.reshape(0, 2)), False, none)

    assert told.loosest is None


def test_a_reading_beyond_every_law_weighs_next_to_nothing():
    """Metres off, as where the log has ten times the force: no law reaches so far."""
    x = np.random.default_rng(4).standard_normal((len(KEYS), 3))
    x[7] = 1e7

    _, lam = family(likelihood(x**2, np.full(x.shape, 2.0), np.ones(len(x))), STATES, paper=False)

    assert np.isfinite(lam).all()
    assert lam[7] > 1e3 * np.median(lam)
