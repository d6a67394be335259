"""Suspects in addition to a base: against numpy's joint fits of base and suspect, row by row."""

import numpy as np
import pytest
from made_system import rss
from scipy import linalg, stats

from pipeline.system.score_tests import Base, by_products, left_out, padded

RNG = np.random.default_rng(23)
KEY = RNG.permutation(np.repeat([30, 10, 20], [14, 11, 9]))
"""Three blocks of rows that are not adjacent."""

M = len(KEY)
X = RNG.standard_normal((M, 4))
Y = RNG.standard_normal(M) + X @ np.array([1.0, -2.0, 0.5, 3.0])
D = RNG.standard_normal((M, 2)) + 0.8 * X[:, :2]
"""A suspect of two columns, nonzero in all rows and correlated with the base."""


def fit(base, more, y):
    """Size of further columns, its covariance, and drop of the sum of squares, from two fits."""
    both, k = np.column_stack([base, more]), more.shape[1]
    cov = np.linalg.inv(both.T @ both)[-k:, -k:]
    return np.linalg.lstsq(both, y, rcond=None)[0][-k:], cov, rss(base, y) - rss(both, y)


def each_its_own(X, key):
    """Columns of X separately for each block, as a dense matrix."""
    return np.column_stack([X * (key == k)[:, None] for k in np.unique(key)])


def only(columns, block):
    """Columns restricted to one block, 0 to 2 in the order of the keys."""
    return columns * (np.unique(KEY)[block] == KEY)[:, None]


def in_blocks(rows, key=KEY):
    """Rows by block with zeros below the shorter ones, (p, s, ...), written out."""
    parts = [rows[key == k] for k in np.unique(key)]
    out = np.zeros((len(parts), max(map(len, parts)), *rows.shape[1:]))
    for block, part in zip(out, parts, strict=True):
        block[: len(part)] = part
    return out


def test_a_suspect_of_all_rows_is_the_difference_of_two_fits():
    """Size, covariance, drop, rank, residual and both degrees of freedom agree."""
    found = Base.of(X, Y).beside_all(D)
    size, cov, drop = fit(X, D, Y)

    assert found.size == pytest.approx(size)
    assert found.cov == pytest.approx(cov)
    assert float(found.drop) == pytest.approx(drop)
    assert int(found.rank) == 2
    assert (found.rest, found.dof) == (pytest.approx(rss(X, Y)), M - 4)
    assert found.whole == pytest.approx(np.sum(D**2, axis=0))
    left = rss(np.column_stack([X, D]), Y)
    assert float(found.variance()) == pytest.approx(left / (M - 6))
    ratio = drop / 2 / (left / (M - 6))
    assert float(found.p()) == pytest.approx(stats.f.sf(ratio, 2, M - 6))


def test_some_columns_of_a_suspect_are_suspects_of_their_own():
    """One or two of four columns, two nearly parallel to a third, as fits of these alone."""
    four = np.column_stack([D, RNG.standard_normal(M), D[:, 0]])
    every = Base.of(X, Y).beside_all(four)
    for at in ([[0], [1], [2], [3]], [[0, 1], [2, 1], [1, 3]], [[0, 1, 3]]):
        found = every.parts(np.array(at))
        want = [rss(X, Y) - rss(np.column_stack([X, four[:, one]]), Y) for one in at]
        assert found.drop == pytest.approx(want)
        assert found.rank.tolist() == [len({one % 3 for one in few}) for few in at]


@pytest.mark.parametrize("own", [False, True])
def test_suspects_of_one_block_each_are_fits_of_all_rows(own):
    """A base of all rows, or separate in each block; three suspects in each block."""
    base = Base.of(X, Y, KEY, own)
    columns = each_its_own(X, KEY) if own else X
    three = RNG.standard_normal((M, 3, 2)) + X[:, None, :2]
    found = base.beside(in_blocks(three))

    assert base.dof == M - np.linalg.matrix_rank(columns)
    assert base.rest == pytest.approx(rss(columns, Y))
    for block in range(3):
        for one in range(3):
            size, cov, drop = fit(columns, only(three[:, one], block), Y)
            assert found.size[block, one] == pytest.approx(size)
            assert found.cov[block, one] == pytest.approx(cov)
            assert found.drop[block, one] == pytest.approx(drop)
            assert found.of_block(block).drop[one] == pytest.approx(drop)


@pytest.mark.parametrize("own", [False, True])
def test_a_suspect_of_all_rows_stands_beside_blocks_too(own):
    """Residual of columns of all rows after a base by block."""
    columns = each_its_own(X, KEY) if own else X
    base = Base.of(X, Y, KEY, own)
    found = base.beside_all(D)
    size, cov, drop = fit(columns, D, Y)

    assert found.size == pytest.approx(size)
    assert found.cov == pytest.approx(cov)
    assert float(found.drop) == pytest.approx(drop)
    beyond = D - columns @ np.linalg.lstsq(columns, D, rcond=None)[0]
    assert base.beyond(D) == pytest.approx(beyond, abs=1e-12)


@pytest.mark.parametrize("own", [False, True])
def test_the_same_columns_stand_beside_other_rows(own):
    """A second measurement with the same plan needs no second decomposition."""
    base = Base.of(X, Y, KEY, own)
    other = RNG.standard_normal(M)
    again, anew = base.against(other), Base.of(X, other, KEY, own)

    assert again.rest == pytest.approx(anew.rest)
    assert again.left == pytest.approx(anew.left)
    assert again.dof == base.dof
    assert float(again.beside_all(D).drop) == pytest.approx(float(anew.beside_all(D).drop))


def test_blocks_and_rows_that_are_missing_at_the_end_are_zero():
    """Trailing rows that are zero may be omitted."""
    base, whole = Base.of(X, Y, KEY), in_blocks(D[:, None])
    short = whole[:2, :7]
    full = np.zeros_like(whole)
    full[:2, :7] = short
    found, same = base.beside(short), base.beside(full)

    assert found.drop.shape == (2, 1)
    assert found.drop == pytest.approx(same.drop[:2])
    assert found.size == pytest.approx(same.size[:2])


def test_rows_of_suspects_go_back_to_their_own_order():
    """One suspect per row, an error of that row: the drop is that of the fit without the row."""
    base = Base.of(X, Y, KEY)
    by_block = in_blocks(np.arange(M)).astype(int)
    D = np.zeros((3, by_block.shape[1], by_block.shape[1], 1))
    for block, count in enumerate(np.unique(KEY, return_counts=True)[1]):
        D[block, np.arange(count), np.arange(count), 0] = 1.0
    found = base.beside(D).rows(base.blocks)

    for row in range(M):
        stays = np.arange(M) != row
        assert found.drop[row] == pytest.approx(rss(X, Y) - rss(X[stays], Y[stays]))
        alone = np.linalg.lstsq(X[stays], Y[stays], rcond=None)[0]
        assert found.size[row, 0] == pytest.approx(Y[row] - X[row] @ alone)


def test_products_of_columns_say_what_the_rows_say():
    """Suspects of one to three columns, the base not in front: as fits and as rows."""
    A = np.column_stack([D[:, 0], X, RNG.standard_normal((M, 5)), Y])
    base, members = np.array([1, 2, 3, 4]), [np.array([0]), np.array([7, 5]), np.array([9, 6, 8])]
    found = by_products(A.T @ A, base, padded(members), M - 4)

    assert (found.rest, found.dof) == (pytest.approx(rss(X, Y)), M - 4)
    assert found.rank.tolist() == [1, 2, 3]
    for one, mine in enumerate(members):
        size, cov, drop = fit(X, A[:, mine], Y)
        k = len(mine)
        assert found.size[one, :k] == pytest.approx(size)
        assert found.size[one, k:] == pytest.approx(0)
        assert found.cov[one, :k, :k] == pytest.approx(cov)
        assert found.drop[one] == pytest.approx(drop)


def test_residuals_of_rounding_are_held_to_the_least_mean_square():
    """Exact data leave `least` per degree of freedom; noisy data their own mean square."""
    A = np.column_stack([X, D, X @ np.ones(4)])
    exact = by_products(A.T @ A, np.arange(4), np.array([[4, 5]]), M - 4, 1e-4)
    A[:, -1] = Y
    noisy = by_products(A.T @ A, np.arange(4), np.array([[4, 5]]), M - 4, 1e-4)

    assert exact.rest == pytest.approx(1e-4 * (M - 4))
    assert exact.p()[0] > 0.5
    assert noisy.rest == pytest.approx(rss(X, Y))


def test_columns_of_each_suspect_are_filled_up():
    """-1 stands for no column; no suspects means no columns."""
    assert padded([np.array([4]), np.array([2, 7]), np.array([], int)]).tolist() == [
        [4, -1], [2, 7], [-1, -1]
    ]  # fmt: skip
    assert padded([]).shape == (0, 0)


def test_what_the_base_explains_of_a_suspect_is_left_out():
    """Two of three columns are new, and none of two: rank, drop, size and p."""
    half = np.column_stack([D, X @ np.array([1.0, 2.0, 0.0, -1.0])])
    none = X[:, :2] @ np.array([[1.0, 2.0], [3.0, -1.0]])
    base = Base.of(X, Y)
    some, nothing = base.beside_all(half), base.beside_all(none)

    assert int(some.rank) == 2
    assert float(some.drop) == pytest.approx(rss(X, Y) - rss(np.column_stack([X, D]), Y))
    assert float(some.p()) == pytest.approx(float(base.beside_all(D).p()))
    assert int(nothing.rank) == 0
    assert float(nothing.drop) == pytest.approx(0.0, abs=1e-12)
    assert float(nothing.p()) == 1.0
    assert float(nothing.p(1.0, np.inf)) == 1.0


@pytest.mark.parametrize("own", [False, True])
def test_dependent_columns_of_the_base_count_once(own):
    """A twin and a column of zeros change neither the residual nor its degrees of freedom."""
    wide = np.column_stack([X, X[:, 0] - 2 * X[:, 3], np.zeros(M)])
    plain, twice = Base.of(X, Y, KEY, own), Base.of(wide, Y, KEY, own)

    assert twice.dof == plain.dof == M - 4 * (3 if own else 1)
    assert twice.rest == pytest.approx(plain.rest)
    assert twice.beside_all(D).size == pytest.approx(plain.beside_all(D).size)


def test_a_block_that_its_own_columns_fill_has_nothing_left():
    """Nine rows of one block under eleven columns are used up, the others are not."""
    wide = RNG.standard_normal((M, 11))
    wide[KEY == 10, 3:] = 0.0  # only three there
    base = Base.of(wide, Y, KEY, own=True)
    columns = each_its_own(wide, KEY)

    assert base.dof == M - 9 - 3 - 11
    assert base.rest == pytest.approx(rss(columns, Y))
    assert base.beyond(D)[KEY == 20] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_no_unit_of_a_column_changes_an_answer(scale):
    """Scaling columns rescales their sizes, and leaves drop, rank and p unchanged."""
    units = np.array([1.0, scale])
    plain = Base.of(X, Y, KEY).beside(in_blocks(D[:, None]))
    base = Base.of(X * np.array([scale, 1.0, 1.0, 1 / scale]), Y, KEY)
    other = base.beside(in_blocks((D * units)[:, None]))

    assert base.dof == M - 4
    assert other.drop == pytest.approx(plain.drop)
    assert other.size * units == pytest.approx(plain.size)
    assert other.cov * np.outer(units, units) == pytest.approx(plain.cov)
    assert np.array_equal(other.rank, plain.rank)
    assert other.p() == pytest.approx(plain.p())


def test_louder_rows_have_the_same_p_and_a_size_as_much_larger():
    """Without a known variance only ratios count; with one, the scale squared does."""
    plain, louder = (Base.of(X, times * Y).beside_all(D) for times in (1.0, 7.0))

    assert float(louder.p()) == pytest.approx(float(plain.p()))
    assert louder.size == pytest.approx(7 * plain.size)
    assert float(louder.variance()) == pytest.approx(49 * plain.variance())
    assert float(louder.p(49.0, 30)) == pytest.approx(float(plain.p(1.0, 30)))


@pytest.mark.parametrize("own", [False, True])
def test_the_order_of_the_rows_says_nothing(own):
    """Shuffled rows and renamed blocks give the same sizes."""
    order = RNG.permutation(M)
    plain = Base.of(X, Y, KEY, own).beside_all(D)
    other = Base.of(X[order], Y[order], 5 - KEY[order], own).beside_all(D[order])

    assert other.size == pytest.approx(plain.size)
    assert float(other.drop) == pytest.approx(float(plain.drop))


def test_a_known_variance_makes_chi_square_and_one_from_elsewhere_f():
    """p-value of the drop over the variance: from the residuals, from nu others, or known."""
    found = Base.of(X, Y).beside_all(D)
    T = float(found.drop)

    assert float(found.p(2.0, np.inf)) == pytest.approx(stats.chi2.sf(T / 2.0, 2))
    assert float(found.p(2.0, 17)) == pytest.approx(stats.f.sf(T / 2 / 2.0, 2, 17))
    assert float(found.p(2.0)) == pytest.approx(stats.f.sf(T / 2 / 2.0, 2, M - 6))


def test_a_stated_noise_is_the_least_that_a_variance_may_be():
    """A certificate may be too cautious, without turning chance into outliers."""
    quiet = Base.of(X, 0.01 * Y).beside_all(D)
    loud = Base.of(X, 100 * Y).beside_all(D)

    assert float(quiet.variance(1.0)) == 1.0
    assert float(quiet.variance()) < 1e-2
    assert float(loud.variance(1.0)) == float(loud.variance()) > 100


def test_p_values_of_pure_scatter_are_uniform():
    """600 draws of two columns in addition to the base; p-values as uniform as sampling allows."""
    rng = np.random.default_rng(4)
    base = Base.of(X, Y, KEY)
    p = [float(base.against(y).beside_all(D).p()) for y in rng.standard_normal((600, M))]
    known = [
        float(base.against(y).beside_all(D).p(1.0, np.inf)) for y in rng.standard_normal((600, M))
    ]

    assert stats.kstest(p, "uniform").pvalue > 0.01
    assert stats.kstest(known, "uniform").pvalue > 0.01


def refits(A, y, key, rows, c):
    """Residuals of each block of c from numpy's fits of the other blocks."""
    out = np.empty(len(c))
    for block in np.unique(key):
        x = np.linalg.lstsq(A[key != block], y[key != block], rcond=None)[0]
        here = key[: len(c)] == block
        out[here] = c[here] - rows[here] @ x
    return out


def test_what_is_left_out_is_predicted_by_refits_of_the_rest():
    """Whitened rows and rows in metres differ.

    The last columns and priors do not enter predictions.
    """
    sigma = RNG.uniform(0.5, 2.0, M)
    c = Y * sigma
    A = np.vstack([np.column_stack([X, D]), np.column_stack([np.zeros((2, 4)), np.eye(2)])])
    y, key = np.append(Y, np.zeros(2)), np.append(KEY, [99, 99])
    rows = np.column_stack([X * sigma[:, None], np.zeros((M, 2))])
    left, lost = left_out(A, y, key, rows, c)

    assert left == pytest.approx(refits(A, y, key, rows, c))
    assert not lost.any()


def test_blocks_of_one_row_are_left_out_one_by_one():
    """The residual over one minus its leverage: Stone's formula of the textbook."""
    left, _ = left_out(X, Y, np.arange(M), X, Y)
    H = X @ np.linalg.inv(X.T @ X) @ X.T

    assert left == pytest.approx((Y - H @ Y) / (1 - np.diag(H)))


@pytest.mark.parametrize("unit", [1e-8, 1.0, 1e5])
def test_what_one_block_alone_determines_is_lost_there_and_nowhere_else(unit):
    """A column that is zero in all other blocks: the others are predicted as usual.

    Of the solutions that the other blocks leave open, the shortest is used, as in numpy.
    """
    wide = np.column_stack([X, unit * (KEY == 20) * D[:, 0]])
    left, lost = left_out(wide, Y, KEY, wide, Y)
    truth = refits(wide, Y, KEY, wide, Y)

    assert np.array_equal(lost, KEY == 20)
    assert np.array_equal(left_out(wide, Y, KEY, 1e-6 * wide, 1e-6 * Y)[1], lost)
    assert left == pytest.approx(truth)


def test_rows_that_do_not_ask_for_what_is_lost_are_predicted():
    """In the block that alone determines a column, rows where it is zero are still predicted."""
    mine = KEY == 20
    asks = mine & (np.cumsum(mine) <= 4)
    wide = np.column_stack([X, asks * D[:, 0]])
    _, lost = left_out(wide, Y, KEY, wide, Y)

    assert np.array_equal(lost, asks)


def test_what_no_block_determines_is_lost_wherever_it_is_asked_for():
    """Twins share their effect, and a prediction that needs one of them alone is undetermined."""
    twins = np.column_stack([X, X[:, 0]])
    rows = twins.copy()
    rows[:5, 4] = 0.0
    rows[5:, 4], rows[5:, 0] = 0.0, 0.0
    left, lost = left_out(twins, Y, KEY, rows, Y)

    assert lost[:5].all()
    assert not lost[5:].any()
    x = [np.linalg.lstsq(X[k != KEY], Y[k != KEY], rcond=None)[0] for k in KEY[5:]]
    alone = [y - row[1:] @ b[1:] for y, row, b in zip(Y[5:], X[5:], x, strict=True)]
    assert left[5:] == pytest.approx(alone)


def test_leaving_blocks_out_of_own_columns_is_predicting_nothing():
    """Columns separate for each block say nothing about other blocks: every row is lost."""
    columns = linalg.block_diag(*(X[k == KEY] for k in np.unique(KEY)))
    key = np.sort(KEY)
    y = np.concatenate([Y[k == KEY] for k in np.unique(KEY)])
    left, lost = left_out(columns, y, key, columns, y)

    assert lost.all()
    assert left == pytest.approx(y)


def test_no_suspects_are_no_error():
    """As of a campaign with one round of the base: nothing can have moved between rounds."""
    base = Base.of(np.ones((4, 1)), np.arange(4.0))

    assert base.beside(np.zeros((1, 4, 0, 6))).N.shape == (1, 0, 6, 6)


def test_rows_that_are_freed_are_rows_that_are_left_out():
    """The drop is what numpy's fit without them leaves less; one block only."""
    one = np.sort(RNG.permutation(M)[:5])
    rows = np.isin(np.arange(M), one)
    found = Base.of(X, Y).free(rows)

    assert found.drop == pytest.approx(rss(X, Y) - rss(X[~rows], Y[~rows]))
    assert (found.rest, found.dof) == (pytest.approx(rss(X, Y)), M - 4)
    assert found.rank == 5
