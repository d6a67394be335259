"""Rivals of the likeliest model, as new poses change it."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.live.last_search import LastSearch
from pipeline.prediction.model import ModelHypothesis


def test_the_uncertainty_of_a_rival_falls_as_that_of_the_leading_model():
    """Half of the standard uncertainty in the first spring, none less in the second."""
    was = ModelHypothesis(0.9, None, np.array([1.0, 2.0]), np.diag([4.0, 9.0]))
    rival = ModelHypothesis(0.1, None, np.array([1.5, 2.5, 7.0]), np.array(
        [[8.0, 1.0, 0.5], [1.0, 6.0, 0.0], [0.5, 0.0, 3.0]]))  # fmt: skip
    case = SimpleNamespace(robot=SimpleNamespace(n=2))
    search = LastSearch(None, case, was, np.array([True, True]))
    found = search._followed(
        rival, SimpleNamespace(value=np.array([1.1, 2.0]), std=np.array([1.0, 3.0]))
    )

    assert found.value == pytest.approx([1.6, 2.5, 7.0])
    assert found.cov == pytest.approx(
        np.array([[2.0, 0.5, 0.25], [0.5, 6.0, 0.0], [0.25, 0.0, 3.0]])
    )
    assert (found.cov == found.cov.T).all()
