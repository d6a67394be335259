"""Covariance of a chain's direction where no noise is stated."""

import numpy as np
import pandas as pd
import pytest

from pipeline.base import covariance
from pipeline.reduction.forces import _directions
from pipeline.tables import XYZ


def test_both_ends_of_a_chain_scatter():
    """2 m along x, in variances of the tracker: 2 / 2^2 across the chain, nothing along it."""
    at = dict(zip(XYZ, np.array([[1.0, 2.0, 3.0], [3.0, 2.0, 3.0]]).T, strict=True))
    placed = pd.DataFrame(at | dict.fromkeys(covariance.columns(), np.nan))
    u, six = _directions(placed, np.array([0]), np.array([1]))

    assert np.ravel(u) == pytest.approx([1.0, 0.0, 0.0])
    assert np.ravel(six) == pytest.approx([0.0, 0.0, 0.0, 0.5, 0.0, 0.5])
