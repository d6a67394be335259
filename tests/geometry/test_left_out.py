"""Left-out poses are predicted as by an estimate repeated from all others."""

import numpy as np
import pytest
from made_positions import made, weightless

from pipeline.machine.robot import load
from pipeline.positions.calibrate import ModelStructure, calibrate
from pipeline.positions.estimate import precision
from pipeline.positions.initial import begin
from pipeline.positions.laws import JointLaw
from pipeline.positions.left_out import LeftOut, by_turns, errors
from pipeline.positions.mechanism import layout
from pipeline.positions.scatter import start

WAVES = (JointLaw(2, "periodic", "angle", 2, 3.0), JointLaw(4, "periodic", "angle", 4, 2.0))


@pytest.fixture(scope="module")
def found():
    """Forty poses of an arm with two laws; DH parameters and amplitudes estimated."""
    robot = load("ur10")
    readings, weights = made(40, np.random.default_rng(3)), weightless(40)
    wanted = ModelStructure(springs=False, laws=WAVES, curves=((5, 0.7),))
    begun = begin(robot, readings, {})
    return calibrate(begun, readings, weights, wanted, start(robot, None))


def anew(found, mine, held):
    """Whitened errors of some poses from ordinary least squares of all others and the prior."""
    rows, (P, _) = found.rows, precision(found.mechanism, found.known)
    size, dense = len(P), rows.D.shape[2]
    X = np.zeros((*rows.y.shape, size))
    X[..., :dense] = rows.D
    for pose, knots in enumerate(rows.at):
        X[pose][:, dense + knots] += rows.K[pose]
    root, mean = np.linalg.cholesky(P).T, np.zeros(size)
    mean[: len(found.known.mean)] = found.known.mean
    free = np.setdiff1d(np.arange(size), np.arange(size)[held])
    A = np.vstack([X[~mine].reshape(-1, size), root])
    b = np.concatenate([rows.y[~mine].ravel(), root @ mean]) - A @ mean
    length = np.linalg.norm(A[:, free], axis=0)
    step = np.linalg.lstsq(A[:, free] / length, b, rcond=None)[0] / length
    x = mean.copy()
    x[free] += step
    return rows.y[mine] - X[mine] @ x


@pytest.mark.parametrize("which", ["none", "law", "knots"])
def test_left_out_errors_are_those_of_an_estimate_from_the_others(found, which):
    """Also with a law or a curve held at zero: parts are solved once, and conditioned."""
    where = layout(found.mechanism)
    held = {"none": slice(0, 0), "law": where.laws, "knots": where.knots}[which]
    part = by_turns(found.readings, 4)

    said = LeftOut(found, part).errors(None if which == "none" else held)

    for k in range(4):
        mine = part == k
        W = found.rows.W[mine]
        there = said[mine][:, found.linear.used]
        assert np.einsum("mij,mj->mi", W, there) == pytest.approx(
            anew(found, mine, held), rel=1e-6, abs=1e-6
        )


def test_what_is_asked_once_is_asked_the_same(found):
    """An estimate for several questions at once gives the same errors as one for each."""
    part = by_turns(found.readings)

    assert np.array_equal(errors(found, part), LeftOut(found, part).errors())
