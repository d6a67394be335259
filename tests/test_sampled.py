"""Which variants of a test marked `sampled(n)` are run in the fast suite."""

import pytest


def sampled(request):
    """Values of the parameters of this test's variants that are not slow."""
    name = request.node.originalname
    mine = [one for one in request.session.items if getattr(one, "originalname", "") == name]
    return [
        tuple(one.callspec.params.values())
        for one in mine
        if one.get_closest_marker("slow") is None
    ]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", ["a", "b", "c", "d"])
def test_every_kind_is_played_before_a_second_seed_of_one(request, kind, seed):
    """Four variants of four kinds with five seeds: each kind once, each with another seed."""
    assert sampled(request) in ([("a", 0), ("b", 1), ("c", 2), ("d", 3)], [])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(5))
def test_of_one_parameter_the_first_are_played(request, seed):
    """In the order in which they are written."""
    assert sampled(request) in ([(0,), (1,)], [])
