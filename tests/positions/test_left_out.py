"""Left-out poses are predicted as by an estimate repeated from all others."""

import numpy as np
import pytest
from made_positions import made, weightless

from pipeline.machine.robot import load
from pipeline.positions import calibrate as estimates
from pipeline.positions.calibrate import ModelStructure, calibrate, tried
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


OTHERS = ModelStructure(springs=False, laws=(WAVES[1], JointLaw(6, "periodic", "angle", 6, 1.0)))


def test_a_trial_needs_no_new_linearisation_for_other_laws_and_curves(found, monkeypatch):
    """Without the curve and one wave, and with another: as about a new linearisation."""
    here = tried(found, OTHERS)
    monkeypatch.setattr(estimates, "_beside", lambda *_: None)
    anew = tried(found, OTHERS)

    part = layout(here.mechanism).laws
    assert here.likely == pytest.approx(anew.likely, abs=0.05)
    assert here.solution.x[part] == pytest.approx(anew.solution.x[part], abs=1e-7)


def test_scales_stay_with_their_laws_where_as_many_others_take_their_places(found, monkeypatch):
    """A scale that has vanished is no start for another wave, which it would keep from growing."""
    begun = []
    monkeypatch.setattr(
        estimates._LinearFit, "hopeless", lambda fit, *_: begun.append(fit.known) or True
    )

    trial = tried(found, OTHERS)

    (known,) = begun
    kept, new = OTHERS.laws
    assert trial.known.groups.keys() == {*OTHERS.laws}
    assert known.std[known.groups[kept]] == pytest.approx(found.known.std[found.known.groups[kept]])
    assert known.std[known.groups[new]] == pytest.approx(known.most[known.groups[new]])


def test_updates_that_still_gain_are_not_the_last_ones(found, monkeypatch):
    """Where any gain is more than nothing."""
    monkeypatch.setattr(estimates, "_FLAT", 0.0)
    own = found.mechanism, found.known, found.scatter, found.linear

    _, flat = estimates._LinearFit(*own).rescaled(found.wanted, 2)

    assert not flat


def test_a_trial_ends_before_its_end_only_where_it_is_hopeless(found):
    """With an evidence to beat that it does beat it ends as without one."""
    best = tried(found, OTHERS).likely

    assert tried(found, OTHERS, best - 1e-3).likely == best
    assert tried(found, OTHERS, best + 1e3).likely < best + 1e3
