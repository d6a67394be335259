"""Left-out poses are predicted as by an estimate repeated from all others."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_positions import made, weightless

from pipeline.machine.robot import load
from pipeline.positions import calibrate as estimates
from pipeline.positions import cross_validation
from pipeline.positions.calibrate import ModelStructure, calibrate, tried
from pipeline.positions.cross_validation import LeftOutPoses, Partition
from pipeline.positions.estimate import FIXED_SIGMA, precision
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


def columns(found):
    """Whitened derivatives by all parameters, (m, r, size)."""
    rows, dense = found.rows, found.rows.D.shape[2]
    X = np.zeros((*rows.y.shape, dense + rows.knots))
    X[..., :dense] = rows.D
    for pose, knots in enumerate(rows.at):
        X[pose][:, dense + knots] += rows.K[pose]
    return X


def anew(found, mine, held):
    """Whitened errors of some poses from ordinary least squares of all others and the prior."""
    rows, X, (P, _) = found.rows, columns(found), precision(found.mechanism, found.known)
    size = len(P)
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


def test_left_out_readings_are_as_uncertain_as_by_the_others(found):
    """Noise of the reading, and of an estimate from the others, by the inverse of all at once."""
    part, X, W = by_turns(found.readings, 4), columns(found), found.rows.W
    P = precision(found.mechanism, found.known)[0]

    said = LeftOut(found, part).std[:, found.linear.used]

    for k in range(4):
        mine = part == k
        A = np.einsum("mri,mrj->ij", X[~mine], X[~mine]) + P
        size = np.sqrt(np.diag(A))
        C = np.linalg.inv(A / np.outer(size, size)) / np.outer(size, size)
        V = np.eye(X.shape[1]) + X[mine] @ C @ np.swapaxes(X[mine], 1, 2)
        L = np.linalg.inv(W[mine])
        V = L @ V @ np.swapaxes(L, 1, 2)
        assert said[mine] ** 2 == pytest.approx(np.einsum("mii->mi", V), rel=1e-5)


def test_what_is_predicted_is_as_uncertain_as_all_columns_of_the_root_say(found):
    """With one more than there are dense parameters, as of an unknown factor of all masses."""
    rng = np.random.default_rng(6)
    root = found.solution.root
    more = 1e-4 * rng.standard_normal(len(root))
    known = replace(found.solution, root=np.column_stack([root, more]))
    dense, X = found.rows.D.shape[2], columns(found)
    C = known.root @ known.root.T
    C[dense:, dense:] += known.knots

    assert found.rows.variance(known) == pytest.approx(X @ C @ np.swapaxes(X, 1, 2), rel=1e-6)


def test_a_law_adds_its_part_to_the_uncertainty_of_left_out_readings(found):
    """Where the law is known, its part is gone: by an estimate with it held at zero."""
    part, law = by_turns(found.readings, 4), layout(found.mechanism).laws

    def priors(rad):
        std = found.known.std.copy()
        std[law] = rad
        return LeftOut(replace(found, known=replace(found.known, std=std)), part)

    wide, held = priors(1e-3), priors(FIXED_SIGMA)

    added = wide.var_by(law)
    assert added.max() > 0.1 * (held.std**2).mean()
    assert added == pytest.approx(wide.std**2 - held.std**2, rel=1e-6, abs=1e-15)


class Predicted:
    """Left-out errors that fall by a tenth, but grow at the six poses that are hardly known."""

    far = np.arange(60) % 10 == 9

    def __init__(self, found, part):
        self.better = found.better
        self.std = np.where(self.far, 3e-3, 1e-5)[:, None] * np.ones(6)

    def var_by(self, held):
        """Of a law that is known."""
        return np.zeros((60, 6))

    def errors(self, without=None):
        """Errors with a law, or without it (m, 6)."""
        after = without is None and self.better
        near = np.random.default_rng(5).normal(0.0, 1e-5, (60, 6)) * (0.9 if after else 1.0)
        far = np.random.default_rng(6).normal(0.0, 3e-3, (60, 6)) * (1.01 if after else 1.0)
        return np.where(self.far[:, None], far, near)


def test_poses_that_are_hardly_known_do_not_decide_on_a_law(monkeypatch):
    """Errors count over their standard uncertainty: a law that is there carries, and stays."""
    monkeypatch.setattr(cross_validation, "LeftOut", Predicted)
    readings = made(60, np.random.default_rng(3))
    with_it, without = (SimpleNamespace(readings=readings, better=one) for one in (True, False))
    parts = dict.fromkeys((Partition.BETWEEN, Partition.SPACE), by_turns(readings))
    judge = LeftOutPoses(parts, np.random.default_rng(4))

    assert judge.carries(with_it, slice(0, 2), without)
    assert not judge.carries(without, slice(0, 2), without)
    assert judge.as_good(with_it, without)
    assert not judge.as_good(without, with_it)


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
