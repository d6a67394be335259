"""Sizes of causes: springs by numpy's fit and Student, others by the profile likelihood."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear_campaign import FREE, View, made, suspect, task_of
from scipy import optimize, stats
from small_case import asked, small

from pipeline.diagnosis import amplitude
from pipeline.diagnosis.amplitude import amplitudes, averaged
from pipeline.diagnosis.diagnose import search_task
from pipeline.diagnosis.hypotheses import accepted
from pipeline.machine.cell import predict
from pipeline.machine.effect import Elastic

SUSPECTS = (suspect("a", FREE, typical=3e-7), suspect("b", FREE, FREE), suspect("c", FREE))


@pytest.mark.parametrize("accepted", [(1,), (2, 1), (0, 1, 2)])
def test_sizes_and_intervals_are_numpys_and_students(monkeypatch, accepted):
    """Estimated together, scatter from the residuals, each in the unit of its parameter."""
    monkeypatch.setattr(amplitude, "Elastic", object)  # all linear in their parameters
    truth = made(np.random.default_rng(2), SUSPECTS, {0: [2.0], 1: [1.0, -2.0], 2: [0.5]})
    view = truth.view(accepted)

    found = amplitudes(task_of(truth), view)

    X, y = truth.columns(*accepted), truth.y
    x, rest, *_ = np.linalg.lstsq(X, y, rcond=None)
    own = X.shape[1] - 4
    dof = 72 - 3 - own
    cov = np.linalg.inv(X.T @ X) * rest[0] / dof
    at = 4
    for effect, sizes in zip(accepted, found, strict=True):
        for one, parameter in zip(sizes, SUSPECTS[effect].parameters, strict=True):
            typical = parameter.typical
            std = np.sqrt(cov[at, at]) * typical
            assert one.parameter is parameter
            assert one.value == pytest.approx(x[at] * typical, rel=1e-8)
            assert one.std == pytest.approx(std, rel=1e-8)
            low, high = stats.t.interval(0.95, dof, loc=x[at] * typical, scale=std)
            assert one.ci95 == pytest.approx((low, high), rel=1e-7)
            at += 1


def test_what_the_data_do_not_determine_has_no_finite_interval(monkeypatch):
    """Two identical columns."""
    monkeypatch.setattr(amplitude, "Elastic", object)
    truth = made(np.random.default_rng(2), SUSPECTS, {0: [2.0]}, alike={2: (0, 0.0)})

    one, other = (sizes[0] for sizes in amplitudes(task_of(truth), truth.view((0, 2))))

    assert one.std == other.std == np.inf
    assert one.ci95 == (-np.inf, np.inf)


def test_a_joint_that_no_pull_loads_takes_up_no_degree_of_freedom(monkeypatch):
    """Its column is zero: the scatter has the degrees of freedom of numpy's rank."""
    monkeypatch.setattr(amplitude, "Elastic", object)
    truth = made(np.random.default_rng(2), SUSPECTS, {0: [2.0]})
    truth = replace(truth, B=truth.B * [1.0, 0.0, 1.0])
    view = truth.view((0,))

    ((one,),) = amplitudes(task_of(truth), view)

    X, y = truth.columns(0), truth.y
    x, _, rank, _ = np.linalg.lstsq(X, y, rcond=1e-12)
    dof = len(y) - rank
    scatter = np.sum((y - X @ x) ** 2) / dof
    std = np.sqrt(np.linalg.pinv(X.T @ X, rcond=1e-14)[4, 4] * scatter)
    assert view.dof(view.base) == dof == 69
    assert one.std == pytest.approx(std * one.parameter.typical, rel=1e-6)


def test_residuals_that_are_none_give_a_number_and_none_left_give_no_limit(monkeypatch):
    """Exact data: known to a hundredth of the noise. Without a redundant row: unknown."""
    monkeypatch.setattr(amplitude, "Elastic", object)
    truth = made(np.random.default_rng(2), SUSPECTS, {0: [2.0]})
    exact = truth.B @ np.full(3, 3e-8) + truth.Z[0][:, 0] * 2 * SUSPECTS[0].parameters[0].typical
    view = replace(truth, c=exact).view((0,))

    ((one,),) = amplitudes(task_of(truth), view)
    monkeypatch.setattr(View, "dof", lambda *_: 0)
    ((open_,),) = amplitudes(task_of(truth), view)

    X = truth.columns(0)
    least = 1e-2 * np.sqrt(np.linalg.inv(X.T @ X)[4, 4]) * one.parameter.typical
    assert one.std == pytest.approx(least, rel=1e-6)
    assert open_.std == np.inf
    assert open_.ci95 == (-np.inf, np.inf)


@pytest.fixture(scope="module")
def bent():
    """A load point off by centimetres, whose effect is nonlinear."""
    case = small(3, hidden={"effects": ["load_point_offset=6x"]})
    at = asked(case)
    real, _ = search_task(at.cell, at.reduced.data, at.estimate)
    which = next(i for i, e in enumerate(real.suspects) if e.label == "load_point_offset")
    assert not isinstance(real.suspects[which], Elastic)
    seen = real.fitted((which,), at.estimate.value)
    return real, real.whitened(seen), which


def test_an_interval_ends_where_chi_square_has_risen_by_384(bent):
    """All else refitted by scipy, with the whole model and the whole covariance."""
    real, view, which = bent
    ((first, *_),) = amplitudes(real, view)
    model, data = view.model, real.data
    G = view.seen.errors.G.toarray() * view.noise
    W = np.linalg.inv(np.linalg.cholesky(G @ G.T))
    typical = np.array([p.typical for p in model.cell.parameters])
    held = view.springs

    def left(x):
        moved = predict(model.cell, data.pulls, x * typical).displacement[data.pull, data.target]
        return W @ (data.delta - moved).ravel()

    start = model.values / typical
    free = np.arange(len(start)) != held

    def rest(z):
        def of(x):
            whole = np.empty(len(start))
            whole[free], whole[held] = x, z / first.parameter.typical
            return left(whole)

        return 2 * optimize.least_squares(of, start[free], method="lm", xtol=1e-12).cost

    best = optimize.least_squares(left, start, method="lm", xtol=1e-12)
    variance = 2 * best.cost / (len(view.rows) - len(start))

    assert first.value == pytest.approx(best.x[held] * first.parameter.typical, rel=2e-2)
    for end in first.ci95:
        rise = (rest(end) - 2 * best.cost) / variance
        assert rise == pytest.approx(3.84, rel=0.1)
    low, high = first.ci95
    assert low < first.value < high
    assert which in view.model.accepted


def test_a_flat_likelihood_is_bounded(bent, monkeypatch):
    """A rise below one counts as one: an end is at most 1.96 roots of 3.84 away."""
    _, view, which = bent
    parameter = view.suspects[which].parameters[0]
    for rise, reach in ((0.1, np.sqrt(3.84)), (3.84, 1.0), (4 * 3.84, 0.5)):
        monkeypatch.setattr(amplitude, "_rise", lambda *_, rise=rise: 2.5 * rise)
        low, high = amplitude._profile(view, which, parameter, 10.0, 2.0, 2.5)
        assert (low, high) == pytest.approx((10 - 3.92 * reach, 10 + 3.92 * reach))


def test_the_laws_tolerance_reaches_the_interval(bent):
    """By numpy: V includes the tolerance of the law per pull; the ends curve as before."""
    real, view, which = bent
    found = SimpleNamespace(view=view, seen=view.seen)
    own = accepted(real, found)
    ((first, *_),) = averaged(real, view, (own,))
    ((plain, *_),) = amplitudes(real, view)
    system, k = own.system, view.springs
    law, common = system.errors.source == "law", system.errors.common
    G = system.errors.G.toarray()[:, ~(law & common)]
    typical = np.array([p.typical for p in system.parameters])
    B, W = system.B * typical, np.linalg.inv(G @ G.T)
    cov = np.linalg.inv(B.T @ W @ B)
    x = cov @ B.T @ W @ system.c
    without = system.errors.G.toarray()[:, ~law]
    W = np.linalg.inv(without @ without.T)

    assert first.value == pytest.approx(x[k] * typical[k], rel=1e-6)
    assert first.std == pytest.approx(own.ratio * np.sqrt(cov[k, k]) * typical[k], rel=1e-6)
    assert law.sum() > (law & common).sum() > 0, "deviations pull by pull, and other laws"
    bare = own.ratio * np.sqrt(np.linalg.inv(B.T @ W @ B)[k, k]) * typical[k]
    assert first.std > 1.003 * bare
    for end, alone in zip(first.ci95, plain.ci95, strict=True):
        bends = abs(alone - plain.value) / plain.std
        assert abs(end - first.value) / first.std == pytest.approx(bends, rel=1e-4)
    assert which in view.model.accepted
