"""Covariances in six columns: order, rotations and factors against plain 3x3 matrices."""

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from pipeline.base import covariance
from pipeline.base.errors import InputError

TURN = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()


@pytest.fixture
def matrices():
    """Nine arbitrary covariances."""
    half = np.random.default_rng(4).standard_normal((9, 3, 3))
    return half @ half.swapaxes(1, 2)


def six(matrices):
    """Their six columns, each by its own name: xy is row 0, column 1."""
    place = {"x": 0, "y": 1, "z": 2}
    return [matrices[:, place[pair[0]], place[pair[1]]].copy() for pair in covariance.PAIRS]


def test_every_number_has_its_place(matrices):
    """From columns to matrices and back, by every way, nothing is exchanged."""
    columns = six(matrices)
    table = pd.DataFrame(dict(zip(covariance.columns(), columns, strict=True)))
    named = table.set_axis([f"u{pair}" for pair in covariance.PAIRS], axis=1)[::1]

    for found in (
        covariance.full(columns),
        covariance.symmetric(np.column_stack(columns)),
        covariance.matrices(table[sorted(table, reverse=True)]),
        covariance.matrices(named, covariance.columns("u", "")),
    ):
        np.testing.assert_array_equal(found, matrices)
    np.testing.assert_array_equal(covariance.flat(matrices), np.column_stack(columns))
    assert covariance.columns() == ["cxx_m2", "cxy_m2", "cxz_m2", "cyy_m2", "cyz_m2", "czz_m2"]


def test_a_turned_covariance_is_that_of_turned_draws(matrices):
    """R C R', for different covariances and for one common to all readings."""
    alike = np.repeat(matrices[:1], 5, axis=0)
    half = matrices.copy()
    half[:, 0, 0] = half[:, 0, 0].max()  # one of six columns is constant

    for given in (matrices, alike, half):
        found = covariance.full(covariance.turned(six(given), TURN))
        for C, turned in zip(given, found, strict=True):
            draws = TURN @ np.linalg.cholesky(C)  # columns that span it, each rotated
            assert turned == pytest.approx(draws @ draws.T, rel=1e-12)


def test_a_turn_leaves_what_has_no_direction_and_only_that():
    """An isotropic one is unchanged to the last bit.

    One of equal variances with correlation is not.
    """
    ball = [np.full(4, value) for value in (2.0, 0.0, 0.0, 2.0, 0.0, 2.0)]
    np.testing.assert_array_equal(covariance.turned(ball, TURN), ball)

    for slanted in ([2.0, 0.5, 0, 2, 0, 2], [2, 0, 0, 2, 0, 3.0], [2, 0, 0, 2, -0.3, 2]):
        columns = [np.full(4, float(value)) for value in slanted]
        found = covariance.full(covariance.turned(columns, TURN))
        expected = TURN @ covariance.full(columns) @ TURN.T
        assert found == pytest.approx(expected, rel=1e-12)


AXES = [*np.eye(3), [1, 2, -2], [0, 3, 4], *np.random.default_rng(1).standard_normal((15, 3))]


@pytest.mark.parametrize("axis", AXES, ids=range(len(AXES)))
def test_what_has_no_scatter_along_any_one_axis_is_singular(matrices, axis):
    """Other readings are not, even if their scatter is 100 000 times smaller in one direction."""
    axis = np.array(axis) / np.linalg.norm(axis)
    away = np.eye(3) - np.outer(axis, axis)
    flat = matrices.copy() * 1e-10
    flat[4] = away @ flat[4] @ away
    flat[6] = (away + 1e-10 * np.outer(axis, axis)) * 1e-10
    assert np.flatnonzero(covariance.singular(six(flat))).tolist() == [4]

    everywhere = np.repeat(flat[4:5], 3, axis=0)
    assert covariance.singular(six(everywhere)).tolist() == [True] * 3
    assert covariance.singular(six(flat[:0])).shape == (0,)


def test_a_factor_gives_the_covariance_back(matrices):
    """L L' = C, also for one that scatters along one axis only."""
    line = np.outer([1.0, -2.0, 0.5], [1.0, -2.0, 0.5])
    C = np.concatenate([matrices, line[None]])
    L = covariance.factors(C)

    assert pytest.approx(C, rel=1e-12, abs=1e-12) == L @ L.swapaxes(1, 2)


def test_a_factor_has_as_many_columns_as_the_scatter_has_directions():
    """Transverse to a chain only two angles, all alike: the same two columns despite rounding."""
    rng = np.random.default_rng(6)
    along = rng.standard_normal((50, 3))
    along[0] = [1.0, 0.0, 0.0]
    along /= np.linalg.norm(along, axis=1)[:, None]
    C = 4 * (np.eye(3) - along[:, :, None] * along[:, None, :])
    noise = 1e-13 * rng.standard_normal(C.shape)
    one, other = covariance.factors(C), covariance.factors(C + noise + noise.swapaxes(1, 2))

    assert one @ one.swapaxes(1, 2) == pytest.approx(C, abs=1e-9)
    assert ((np.linalg.norm(one, axis=1) > 1e-5).sum(axis=1) == 2).all()
    there = np.linalg.norm(one, axis=1)[:, None, :] > 1e-5
    assert (np.abs(one - other) * there).max() < 1e-9
    assert np.abs(other * ~there).max() < 1e-4  # rounding of a zero variance has a square root


def test_columns_that_are_one_array_are_worked_on_once():
    """Two arrays in six columns: two calls, and each column gets the result of its own array."""
    two, asked = [np.arange(4.0), np.arange(4.0) + 1], []

    def total(column):
        asked.append(column)
        return float(column.sum())

    done = covariance.each([two[0], two[1], two[1], two[0], two[1], two[0]], total)

    assert done == [6.0, 10.0, 10.0, 6.0, 10.0, 6.0]
    assert len(asked) == 2


def test_all_readings_have_an_uncertainty_or_none(matrices):
    """One missing number makes the whole covariance of a reading unknown, which is refused."""
    columns = six(matrices)
    assert covariance.stated(covariance.known(columns))
    columns[4][[2, 7]] = np.nan

    known = covariance.known(columns)

    assert np.flatnonzero(~known).tolist() == [2, 7]
    with pytest.raises(InputError, match="2 of 9 readings have no uncertainty"):
        covariance.stated(known)
    assert not covariance.stated(np.zeros(5, dtype=bool))


def test_what_is_the_same_for_all_is_worked_on_once(matrices):
    """One call with one matrix for equal ones, one with all for different ones; same shape."""
    asked = []

    def trace(C):
        asked.append(len(C))
        return np.einsum("mii->m", C)

    equal = np.repeat(matrices[:1], 5, axis=0)
    nearly = equal.copy()
    nearly[4, 2, 2] *= 2
    for C, calls in ((equal, 1), (nearly, 5), (matrices[:1], 1), (matrices[:0], 0)):
        asked.clear()
        np.testing.assert_array_equal(covariance.alike(C, trace), np.einsum("mii->m", C))
        assert asked == [calls]


def test_readings_are_weighed_alike_where_one_covariance_is_unknown(matrices):
    """Unit matrices for all of them, or their own."""
    table = pd.DataFrame(dict(zip(covariance.columns(), six(matrices), strict=True)))
    np.testing.assert_array_equal(covariance.weighing(table), matrices)

    table.loc[3, "cyz_m2"] = np.nan
    np.testing.assert_array_equal(covariance.weighing(table), np.tile(np.eye(3), (9, 1, 1)))
    assert covariance.known(six(covariance.matrices(table))).tolist() == [k != 3 for k in range(9)]


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("size", [1e-6, 1e3])
def test_singular_is_a_matter_of_proportion_alike_along_each_axis(axis, size):
    """Beside 1 and 1 a variance of 1e-13 is rounding, one of 4e-13 is not, in any unit."""
    C = np.tile(np.eye(3), (2, 1, 1))
    C[:, axis, axis] = [1e-13, 4e-13]

    assert covariance.singular(six(C * size)).tolist() == [True, False]


def test_the_scatter_of_half_a_picometre_is_none():
    """In absolute terms, where all variances are that small."""
    tiny = np.array([0.5e-24, 2e-24])[:, None, None] * np.eye(3)
    assert covariance.singular(six(tiny)).tolist() == [True, False]


def test_columns_that_share_memory_are_worked_on_once():
    """Also one alone, and none."""
    one, other, worked = np.arange(3.0), np.arange(3.0), []

    def work(column):
        worked.append(column)
        return float(column.sum())

    assert covariance.each([one, other, one], work) == [3.0, 3.0, 3.0]
    assert len(worked) == 2
    assert covariance.each([one], work) == [3.0]
    assert covariance.each([], work) == []
