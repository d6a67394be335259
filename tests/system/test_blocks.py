"""Rows by block: to blocks and back, and the covariance of errors confined to one block."""

import numpy as np
import pytest
import scipy.sparse

from pipeline.system.blocks import Blocks

RNG = np.random.default_rng(3)
KEY = np.array([7, 2, 7, 5, 2, 7, 2, 2])
"""Blocks of four, one and three rows that are not adjacent."""

BLOCKS = Blocks.of(KEY)


@pytest.mark.parametrize("shape", [(8,), (8, 3), (8, 2, 3)])
@pytest.mark.parametrize("kind", [float, int, bool])
def test_rows_go_to_their_blocks_and_back(shape, kind):
    """Numbers keep their type, rows of a block their order, and missing ones are zero."""
    rows = (RNG.standard_normal(shape) * 10).astype(kind)
    padded = BLOCKS.padded(rows)

    assert padded.shape == (3, 4, *shape[1:])
    assert padded.dtype == rows.dtype
    for block, key in enumerate([2, 5, 7]):
        mine = rows[key == KEY]
        assert np.array_equal(padded[block, : len(mine)], mine)
        assert not padded[block, len(mine) :].any()
    assert np.array_equal(BLOCKS.rows(padded), rows)


def test_as_many_places_are_there_as_a_block_has_rows():
    """Four, one, three: the remaining places are padding."""
    assert BLOCKS.shape == (3, 4)
    assert BLOCKS.there.sum(axis=1).tolist() == [4, 1, 3]
    assert np.array_equal(BLOCKS.there, BLOCKS.padded(np.ones(8, bool)))


def test_no_rows_are_no_blocks():
    """No rows, as when each target was read only once: no places, and no error."""
    none = Blocks.of(np.array([], dtype=int))

    assert none.shape == (0, 0)
    assert none.padded(np.zeros((0, 3))).shape == (0, 0, 3)


def test_covariances_of_blocks_are_those_of_the_whole_matrix():
    """G G' of errors that each act on one block: its own rows and columns, zeros elsewhere."""
    G = RNG.standard_normal((8, 12)) * (RNG.integers(3, size=12) == Blocks.of(KEY).index[:, None])
    found, V = BLOCKS.covariance(scipy.sparse.csr_array(G)), G @ G.T

    for block, key in enumerate([2, 5, 7]):
        mine = np.flatnonzero(key == KEY)
        n = len(mine)
        assert found[block, :n, :n] == pytest.approx(V[np.ix_(mine, mine)])
        assert not found[block, n:].any()
        assert not found[block, :, n:].any()


def test_one_large_block_costs_no_padding_and_gives_the_same():
    """Processing each block alone equals processing the padded stack, to rounding."""
    rng = np.random.default_rng(5)
    key = np.repeat([0, 1, 2, 3, 4, 5, 6], [100, 3, 3, 3, 3, 3, 3])
    blocks = Blocks.of(rng.permutation(key))
    p, s = blocks.shape
    half = rng.normal(size=(p, s, s)) * blocks.there[:, :, None] * blocks.there[:, None, :]
    V = half @ np.swapaxes(half, 1, 2) + np.eye(s)
    y = blocks.padded(rng.normal(size=(len(key), 2)))

    assert blocks.large
    assert not Blocks.of(np.repeat(np.arange(30), 12)).large
    L = np.linalg.cholesky(V + np.swapaxes(V, 1, 2) + 90 * np.eye(s))
    assert blocks.solve(L, y) == pytest.approx(np.linalg.solve(L, y), rel=1e-9, abs=1e-12)
    expected = np.linalg.inv(V)
    sizes = []

    def inverse(one):
        sizes.append(one.shape[-1])
        return np.linalg.inv(one)

    assert blocks.square(inverse, V) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert sizes == blocks.count.tolist()
    assert [len(own) for own in blocks.members] == blocks.count.tolist()
    assert all((blocks.index[own] == k).all() for k, own in enumerate(blocks.members))


def test_blocks_that_are_computed_together_are_alike():
    """All while none is large, then those of equal size; their rows are all rows, once."""
    rows, whole = BLOCKS.only(*BLOCKS.alike)
    assert (rows == np.arange(8)).all()
    assert (whole.index == BLOCKS.index).all()

    blocks = Blocks.of(np.random.default_rng(5).permutation(np.repeat([0, 1, 2, 3], [3, 90, 3, 6])))
    groups = [blocks.only(some) for some in blocks.alike]
    assert [some.count.tolist() for _, some in groups] == [[3, 3], [6], [90]]
    assert sorted(np.concatenate([rows for rows, _ in groups])) == list(range(102))
    for mine, some in groups:
        assert (blocks.place[mine] == some.place).all()
