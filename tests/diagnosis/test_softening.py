"""A drifting scale and joints that all soften alike are one to every pull."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.diagnosis.causes import _of_all_springs

PULL = np.repeat(np.arange(5), 6)
HOURS = np.array([0.0, 1.0, 2.5, 3.0, 4.0])


def seen(column, variable="time", springs=2):
    """Two joint springs and one law with this column."""
    law = SimpleNamespace(variable=variable)
    B = np.random.default_rng(1).standard_normal((len(PULL), springs))
    return SimpleNamespace(
        suspects=(SimpleNamespace(law=law, parameters=(None,)),),
        model=SimpleNamespace(springs=springs, values=np.array([3.0, -2.0])),
        rows=SimpleNamespace(pull=PULL),
        B=B,
        Z=column(B)[:, None],
    )


def together(B):
    """Both joints soften in proportion to time."""
    return HOURS[PULL] * (3.0 * B[:, 0] - 2.0 * B[:, 1])


def first(B):
    """Only the first does."""
    return HOURS[PULL] * 3.0 * B[:, 0]


@pytest.mark.parametrize(
    ("column", "variable", "twins"),
    [(together, "time", ("joint_springs",)), (first, "time", ()), (together, "force", ())],
)
def test_all_springs_in_one_course_are_the_twin(column, variable, twins):
    """One joint by itself is none, nor is a law in the force."""
    assert _of_all_springs(seen(column, variable), 0) == twins
