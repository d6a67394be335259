"""Which variants of a test marked `sampled(n)` are run in the fast suite."""

from itertools import product
from types import SimpleNamespace

import pytest
from conftest import _unlike


def variants(few, **counts):
    """Items of one test with so many values of each parameter, and its mark."""
    for values in product(*map(range, counts.values())):
        call = SimpleNamespace(indices=dict(zip(counts, values, strict=True)))
        yield SimpleNamespace(callspec=call, iter_markers=lambda _: iter([mark(few)]))


def mark(few):
    return pytest.mark.sampled(few).mark


def played(few, **counts):
    """The values of each variant that is run."""
    taken, left = _unlike(list(variants(few, **counts)))
    assert len(taken) + len(left) == len(list(variants(few, **counts)))
    return [tuple(one.callspec.indices.values()) for one in taken]


def test_of_one_parameter_the_first_are_played():
    """And all of them where there are no more."""
    assert played(2, seed=5) == [(0,), (1,)]
    assert played(9, seed=3) == [(0,), (1,), (2,)]


def test_every_kind_is_played_before_a_second_seed_of_one():
    """Four variants of four kinds with ten seeds: each kind once, each with another seed."""
    assert played(4, kind=4, seed=10) == [(0, 0), (1, 1), (2, 2), (3, 3)]
    assert played(3, kind=2, seed=2) == [(0, 0), (1, 1), (0, 1)]
