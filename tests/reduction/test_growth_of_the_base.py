"""Growth of the base frame as the coefficient of a regression."""

import numpy as np
import pytest

from pipeline.reduction.growth import by_temperature, with_reflectors


def test_its_uncertainty_is_that_of_a_regression_with_seven_parameters():
    """Noise from the residuals: numpy's least squares on six motions and the growth together."""
    rng = np.random.default_rng(5)
    at = np.array([[1, -0.5, -0.3], [1, 15, -0.3], [-1, 15, 0.2], [-1, -0.5, 0.0]])
    turns = [np.cross(e, at).ravel() for e in np.eye(3)]
    rigid = np.column_stack([*turns, *(np.tile(e, len(at)) for e in np.eye(3))])
    residual = 3e-5 * rng.standard_normal(at.size) - 6e-5 * at.ravel()

    found = with_reflectors(by_temperature(26.0), False, residual, at.ravel(), rigid)

    X = np.column_stack([rigid, -at.ravel()])
    value, (square,), rank, _ = np.linalg.lstsq(X, residual, rcond=None)
    cov = square / (len(residual) - rank) * np.linalg.inv(X.T @ X)
    assert rank == 7
    assert found.seen == pytest.approx(value[-1], rel=1e-9)
    assert found.seen_std == pytest.approx(np.sqrt(cov[-1, -1]), rel=1e-9)
