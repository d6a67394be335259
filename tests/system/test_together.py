"""Simultaneous suspects, against fits of all subsets and of dense columns."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import special

from pipeline.system import alarms
from pipeline.system.blocks import Blocks
from pipeline.system.score_tests import Base
from pipeline.system.simultaneous import ActiveSuspects, Suspects, _end, active_suspects, cost

BLOCKS, EACH = 8, 7
"""Blocks, and suspects of each: six with three rows each, one that acts on all."""

ROWS = 3 * (EACH - 1)


def bench(rng):
    """Rows of blocks, three columns common to all, and suspects of three columns in each block."""
    key = np.repeat(np.arange(BLOCKS), ROWS)
    X = rng.standard_normal((len(key), 3))
    one = np.zeros((ROWS, EACH, 3))
    for k in range(EACH - 1):
        one[3 * k : 3 * k + 3, k] = np.eye(3)
        one[3 * k : 3 * k + 3, -1] = -np.eye(3)
    D = np.tile(one, (BLOCKS, 1, 1, 1)) @ rng.standard_normal((BLOCKS, 1, 3, 3))
    return key, X, Suspects(D, Blocks.of(np.repeat(np.arange(BLOCKS), EACH)))


def dense(suspects, one):
    """The columns of a suspect over all rows."""
    out = np.zeros((BLOCKS * ROWS, 3))
    block, place = divmod(one, EACH)
    out[block * ROWS : (block + 1) * ROWS] = suspects.D[block, :, place]
    return out


def left(X, y):
    """Residual sum of squares of numpy."""
    return float(np.sum((y - X @ np.linalg.lstsq(X, y, rcond=None)[0]) ** 2))


@pytest.mark.sampled(15)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("count", "own"),
    [(0, False), (1, False), (4, False), (14, False), (0, True), (1, True), (4, True), (9, True)],
)
def test_all_that_are_at_work_are_held_and_no_other(seed, count, own):
    """One in four suspects, or one in six in independent blocks: forty standard deviations off."""
    rng = np.random.default_rng([seed, count])
    key, X, suspects = bench(rng)
    true = np.sort(rng.choice(BLOCKS * EACH, count, replace=False))
    y = X @ rng.standard_normal(3) + rng.standard_normal(len(key))
    for one in true:
        off = dense(suspects, one) @ rng.standard_normal(3)
        y += 40 * off / np.linalg.norm(off)
    base = Base.of(X, y, key, own)

    held = active_suspects(base, suspects, 1.0)

    assert held.which.tolist() == true.tolist()
    assert held.variance < 3
    assert (held.p() < 1e-4).all()


def test_sizes_and_drops_are_those_of_dense_fits():
    """All held together; each drop is the increase of the residuals of the fit without it."""
    rng = np.random.default_rng(4)
    key, X, suspects = bench(rng)
    y = X @ rng.standard_normal(3) + rng.standard_normal(len(key))
    for one in (2, 6, 17):
        y += dense(suspects, one) @ [19.0, -14.0, 30.0]

    held = active_suspects(Base.of(X, y, key), suspects, 1.0)

    assert held.which.tolist() == [2, 6, 17]
    columns = [dense(suspects, one) for one in held.which]
    whole = np.hstack([X, *columns])
    assert held.size.ravel() == pytest.approx(np.linalg.lstsq(whole, y, rcond=None)[0][3:])
    assert held.base.rest == pytest.approx(left(whole, y))
    assert held.base.dof == len(key) - 3 - 9
    for place, others in enumerate(combinations(columns[::-1], 2)):
        without = left(np.hstack([X, *others]), y)
        assert held.drop[place] == pytest.approx(without - left(whole, y))


@pytest.mark.parametrize("own", [False, True])
def test_products_of_blocks_are_those_of_whole_columns(own):
    """Suspects of any blocks as one, and the rest of them after the first have joined."""
    rng = np.random.default_rng(14)
    key, X, suspects = bench(rng)
    y = X @ rng.standard_normal(3) + rng.standard_normal(len(key))
    base, chosen = Base.of(X, y, key, own), np.array([9, 2, 10, 33])
    columns = np.hstack([dense(suspects, one) for one in chosen])
    wide = np.hstack([X * (key == one)[:, None] for one in np.unique(key)]) if own else X

    found = suspects.as_one(base, chosen)

    left_of = columns - wide @ np.linalg.lstsq(wide, columns, rcond=None)[0]
    assert pytest.approx(left_of.T @ left_of, abs=1e-9) == found.N
    assert found.g == pytest.approx(left_of.T @ y, abs=1e-9)
    assert found.drop == pytest.approx(left(wide, y) - left(np.hstack([wide, columns]), y))
    after, wider = found.without(6), np.hstack([wide, columns[:, :6]])
    assert after.rest == pytest.approx(left(wider, y))
    assert after.drop == pytest.approx(left(wider, y) - left(np.hstack([wide, columns]), y))


def test_who_joined_in_the_shadow_of_others_goes_again():
    """Four that move their own rows alike resemble the one that acts on all, which is absent."""
    rng = np.random.default_rng(11)
    key, X, suspects = bench(rng)
    y = X @ rng.standard_normal(3) + rng.standard_normal(len(key))
    for one in range(4):
        y += dense(suspects, one) @ np.add([30.0, 20.0, -10.0], rng.normal(0, 6, 3))
    base = Base.of(X, y, key)
    first = suspects.beside(base, np.zeros(0, int))[1]
    assert int(np.argmax(first.drop)) == EACH - 1

    assert active_suspects(base, suspects, 1.0).which.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("unit", [1e-5, 1e4])
@pytest.mark.parametrize("seed", range(4))
def test_units_of_the_rows_change_no_set(seed, unit):
    """Suspects that hide each other, marginal ones too: drops in the square of the unit."""
    rng = np.random.default_rng([seed, 77])
    key, X, suspects = bench(rng)
    y = X @ rng.standard_normal(3) + rng.standard_normal(len(key))
    for one in range(3):  # some of those that the last of their block resembles
        y += dense(suspects, one + EACH) @ np.add([9.0, 6.0, -3.0], rng.normal(0, 2, 3))
    for one in rng.choice(BLOCKS * EACH, 3, replace=False):
        off = dense(suspects, one) @ rng.standard_normal(3)
        y += rng.uniform(5, 9) * off / np.linalg.norm(off)

    plain = active_suspects(Base.of(X, y, key), suspects, 1.0)
    other = active_suspects(Base.of(X, unit * y, key), suspects, unit**2)

    assert other.which.tolist() == plain.which.tolist()
    assert other.size == pytest.approx(unit * plain.size)
    assert other.drop == pytest.approx(unit**2 * plain.drop)
    assert other.variance == pytest.approx(unit**2 * plain.variance)
    assert other.p() == pytest.approx(plain.p(), rel=1e-6)


def test_noise_is_judged_by_its_middle():
    """Noise of ten times the stated size produces no suspect, and hides a small one."""
    rng = np.random.default_rng(6)
    key, X, suspects = bench(rng)
    y = 10 * rng.standard_normal(len(key)) + dense(suspects, 5) @ [19.0, -14.0, 30.0]

    assert active_suspects(Base.of(X, y, key), suspects, 1.0).which.tolist() == []
    assert active_suspects(Base.of(X, y / 10, key), suspects, 1.0).which.tolist() == []


@pytest.mark.whole
def test_clean_rows_hold_somebody_as_rarely_as_stated():
    """2000 draws of noise: at a rate of 2.5e-4, more than four would be very improbable."""
    rng = np.random.default_rng(9)
    key, X, suspects = bench(rng)
    base = Base.of(X, np.zeros(len(key)), key)
    noise = rng.standard_normal((2000, len(key)))

    assert sum(len(active_suspects(base.against(e), suspects, 1.0).which) > 0 for e in noise) <= 4


def test_suspects_found_in_the_stated_scatter_stand_out_of_the_others_too():
    """Rows that scatter three times as stated: no suspect is held by chance."""
    rng = np.random.default_rng(21)
    key, X, suspects = bench(rng)
    for _ in range(12):
        base = Base.of(X, 3 * rng.standard_normal(len(key)), key)
        for least in (1.0, 4.0):
            assert (_end(base, suspects, least, least).p() < alarms.READING).all()


@pytest.mark.parametrize("k", [1, 2, 3, 6])
def test_the_cost_of_a_suspect_is_that_of_its_prior(k):
    """Prior probability 0.01, any direction, ten e-folds of size: integrated over the size.

    The likelihood ratio of x ~ N(s, I) averaged over directions of s is exp(-r^2 / 2) 0F1(k / 2;
    r^2 x^2 / 4) with r = |s|.
    """
    x, r = 14.0, np.exp(np.linspace(0, 10, 400_001))
    near = r[np.abs(r - x) < 9]
    ratio = special.hyp0f1(k / 2, near**2 * x**2 / 4) * np.exp(-(near**2) / 2)
    whole = 0.01 * np.trapezoid(ratio, np.log(near)) / 10

    assert float(cost(x**2, k)) == pytest.approx(x**2 - 2 * np.log(whole), abs=0.1)


@pytest.mark.parametrize("seed", range(8))
def test_a_set_gives_way_to_a_smaller_one_that_says_the_same(seed):
    """Three of six that move alike are held, not the one that acts on all plus the others."""
    rng = np.random.default_rng(seed)
    key, X, suspects = bench(rng)
    y = X @ rng.standard_normal(3) + rng.standard_normal(len(key))
    for one in range(3):
        y += dense(suspects, one) @ [30.0, 20.0, -10.0]

    assert active_suspects(Base.of(X, y, key), suspects, 1.0).which.tolist() == [0, 1, 2]


@pytest.mark.parametrize("seed", range(3))
def test_where_nobody_states_a_noise_the_middle_of_the_others_is_it(seed):
    """One in six is forty standard deviations off: the mean of all would hide every one of them."""
    rng = np.random.default_rng(seed)
    key, X, suspects = bench(rng)
    true = np.sort(rng.choice(BLOCKS * EACH, 9, replace=False))
    y = X @ rng.standard_normal(3) + 1e-5 * rng.standard_normal(len(key))
    for one in true:
        off = dense(suspects, one) @ rng.standard_normal(3)
        y += 4e-4 * off / np.linalg.norm(off)

    held = active_suspects(Base.of(X, y, key), suspects, 1e-30)

    assert held.which.tolist() == true.tolist()
    assert _end(Base.of(X, y, key), suspects, 1e-30, np.inf).which.tolist() == true.tolist()
    assert held.variance == pytest.approx(1e-10, rel=0.8)


@pytest.mark.parametrize(("drop", "worth"), [(18.0, False), (60.0, True)])
def test_a_suspect_must_be_worth_what_it_is_unlikely_beforehand(drop, worth):
    """With three coordinates: the likelihood alone would hold any, the prior of 0.01 few."""
    none = held_with(np.zeros(0), 100.0 + drop, 100)
    one = held_with(np.array([drop]), 100.0, 97)

    assert (one.loss(100.0 / 97) < none.loss(100.0 / 97)) is worth


def held_with(drop, rest, dof):
    """A result with suspects of three coordinates and this drop."""
    n, base = len(drop), SimpleNamespace(rest=rest, dof=dof)
    return ActiveSuspects(
        np.arange(n), np.zeros((n, 3)), drop, np.full(n, 3), 1.0, base, base, 10, None
    )


def test_a_rival_does_as_well_in_a_suspects_place_and_nothing_beside_it():
    """A copy of the one at work; another one that is at work, too, is none."""
    rng = np.random.default_rng(3)
    key, X, suspects = bench(rng)
    D = suspects.D.copy()
    D[2, :, 4] = D[2, :, 1] @ rng.standard_normal((3, 3))  # spans the same
    suspects = Suspects(D, suspects.blocks)
    y = X @ rng.standard_normal(3) + rng.standard_normal(len(key))
    true = [2 * EACH + 1, 5 * EACH + 3]
    for one in true:
        off = dense(suspects, one) @ rng.standard_normal(3)
        y += 60 * off / np.linalg.norm(off)
    held = active_suspects(Base.of(X, y, key), suspects, 1e-30)
    copy = 2 * EACH + 4

    assert len(held.which) == 2
    assert held.which[1] == true[1]
    assert held.which[0] in (true[0], copy)
    first, second = suspects.rivals(held)
    assert first.tolist() == [copy if held.which[0] == true[0] else true[0]]
    assert second.tolist() == []
