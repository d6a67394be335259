"""Which readings of positions are outliers, by readings that are not."""

from dataclasses import replace

import numpy as np
import pytest
from made_positions import read, weightless

from pipeline.machine.robot import load
from pipeline.positions.calibrate import ModelStructure, calibrate
from pipeline.positions.estimate import precision, rows
from pipeline.positions.initial import begin
from pipeline.positions.mechanism import linearised
from pipeline.positions.outliers import _Asked, find_outliers
from pipeline.positions.scatter import start

POSES, WEIGHTS = 40, weightless(40)
GROSS = np.isin(np.arange(POSES), [4, 11, 19, 30])
BACK = np.isin(np.arange(POSES), [7, 25])


def some(readings, which):
    """The readings without some of their first targets."""
    at = readings.at.copy()
    at[which, 0] = np.nan
    return replace(readings, at=at)


@pytest.fixture(scope="module")
def readings():
    """Two targets in forty poses; those of the first are up to 9 mm off in four of them."""
    made = read(POSES, seed=5, targets=2)
    at = made.at.copy()
    at[GROSS, 0] += np.array([[9e-3, 0, 0], [0, 2e-3, 0], [0, -4e-3, 0], [3e-3, 0, 3e-3]])
    return replace(made, at=at)


@pytest.fixture(scope="module")
def found(readings):
    """The mechanism estimated without these four, and without two that are right."""
    robot, kept = load("ur10"), some(readings, GROSS | BACK)
    wanted = ModelStructure(springs=False)
    return calibrate(begin(robot, kept, {}), kept, WEIGHTS, wanted, start(robot, None))


def rest(found, readings):
    """Least sum of squares of readings and prior, by ordinary least squares."""
    white = rows(linearised(readings, found.mechanism, WEIGHTS), found.mechanism, found.scatter)
    P, mean = precision(found.mechanism, found.known)[0], found.known.mean
    root = np.linalg.cholesky(P).T
    A = np.vstack([white.D.reshape(-1, white.D.shape[2]), root])
    b = np.concatenate([white.y.ravel(), root @ mean])
    size = np.linalg.norm(A, axis=0)
    x = np.linalg.lstsq(A / size, b, rcond=None)[0]
    return float(np.sum((b - A / size @ x) ** 2))


def test_a_reading_left_out_is_tested_by_what_it_would_add(readings, found):
    """Its statistic is the sum of squares with it, less that without, beside errors of its pose."""
    left_out = GROSS | BACK
    mask = np.zeros((POSES, 2), dtype=bool)
    mask[:, 0] = left_out
    by = _Asked.of(found, readings, WEIGHTS, mask).estimate

    asked = _Asked.of(found, readings, WEIGHTS, np.zeros_like(mask), by)

    without = rest(found, some(readings, left_out))
    for pose in np.flatnonzero(left_out):
        more = left_out & (np.arange(POSES) != pose)
        added = rest(found, some(readings, more)) - without
        assert asked.drop[pose, 0] == pytest.approx(added, rel=1e-4, abs=1e-3)


def test_right_readings_return_while_gross_ones_stay_out(readings, found):
    """However far off the others are: none of them has a part in the prediction."""
    held = np.zeros((POSES, 2), dtype=bool)
    held[:, 0] = GROSS | BACK

    off = find_outliers(found, readings, WEIGHTS, held)

    assert np.array_equal(off.which[:, 0], GROSS)
    assert not off.which[:, 1].any()
    assert (off.p[BACK, 0] > 0.01).all()
