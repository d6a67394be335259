"""Hypotheses, each with its own springs: dense fits, weights and stated causes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_case import asked, small

from pipeline.diagnosis import hypotheses as module
from pipeline.diagnosis import unlisted
from pipeline.diagnosis.cause_search import (
    NamelessReplacement,
    Replacement,
    _beside,
    remainder,
    search,
)
from pipeline.diagnosis.diagnose import search_task
from pipeline.diagnosis.hypotheses import _scales, _solved, hypotheses, too_small
from pipeline.machine.cell import predict
from pipeline.machine.effects import catalogue


@pytest.fixture(scope="module")
def tilted():
    """A campaign with a third joint that tilts, and a carriage that rolls by too little to name."""
    hidden = {"effects": ["joint_tilt:3=2x", "rail_roll=0.25x"]}
    at = asked(small(3, poses={"count": 7}, hidden=hidden))
    case, _ = search_task(at.cell, at.reduced.data, at.estimate)
    wanted = ("joint_tilt:3", "joint_tilt:4", "joint_tilt:6", "rail_roll")
    few = tuple(one for one in case.suspects if one.label in wanted)
    case = replace(case, suspects=few, nameless=case.nameless[:1])
    return case, search(case, at.estimate.value, np.random.default_rng(1)), at


def placed(case, found, probabilities, strange=()):
    """The same search with other odds in its one place."""
    mine = found.accepted[0]
    rivals = tuple(
        Replacement(case.suspects[i].label, i, p, ((i, 1.0),)) for i, p in probabilities.items()
    )
    assert mine in probabilities
    return replace(found, rivals=(rivals,), strange=strange)


def other(case, label):
    return next(i for i, one in enumerate(case.suspects) if one.label == label)


def test_the_campaign_calls_for_the_tilt(tilted):
    """Precondition of the other tests."""
    case, found, _ = tilted

    assert [case.suspects[i].label for i in found.accepted] == ["joint_tilt:3"]


def test_a_gain_of_the_scale_is_not_what_the_cause_does_in_whose_place_it_is(tilted):
    """Linearised where the tilt acts, a scale that reads half the force is that tilt."""
    case, found, _ = tilted
    gain = next(one for one in catalogue(case.cell.robot) if one.label == "scale_gain")
    wider = replace(case, suspects=(*case.suspects, gain))
    view, (tilt,) = wider.whitened(wider.linearised(found.seen.model)), found.accepted

    there = view.beside(np.arange(view.first)).drop
    assert there[-1] == pytest.approx(there[tilt], rel=0.05)
    assert _beside(wider, wider.without(view, {tilt}), ()).drop[-1] < 0.05 * there[tilt]


def test_without_causes_or_worth_there_is_nothing_to_choose_from(tilted):
    """Unless the robot was moved or the scale scatters: then the springs are re-estimated."""
    case, found, _ = tilted

    assert hypotheses(case, found, moved=False, helps=False) == ()
    for changed, moved in ((case, True), (replace(case, force_noise=2.0), False)):
        (one,) = hypotheses(changed, found, moved=moved, helps=False)
        assert one.weight == 1.0
        assert one.effects == ()
        assert len(one.estimate.value) == 7
    none = replace(found, seen=replace(found.seen, model=replace(found.seen.model)), accepted=())
    assert hypotheses(case, none, moved=False, helps=True) == ()


def test_each_set_has_its_own_fit_and_says_what_it_has_instead(tilted):
    """The accepted cause first, then a rival of a quarter, and an unnamed one."""
    case, found, _ = tilted
    mine, rival = found.accepted[0], other(case, "joint_tilt:4")
    odds = placed(
        case, found, {mine: 0.7, rival: 0.3}, (NamelessReplacement(0.2, len(case.suspects), (0,)),)
    )

    first, second, third = hypotheses(case, odds, moved=False, helps=True)

    weights = [one.weight for one in (first, second, third)]
    assert weights == pytest.approx([0.56, 0.24, 0.2])
    assert [one.effects[0].label for one in (first, second)] == ["joint_tilt:3", "joint_tilt:4"]
    assert third.effects == case.nameless
    assert first.instead == ()
    assert second.instead == ((case.suspects[mine].called, case.suspects[rival].called),)
    assert third.instead[0][1].startswith("something outside the catalogue like ")
    assert all(len(one.estimate.value) == 7 + len(one.effects[0].parameters) for one in
               (first, second, third))  # fmt: skip
    assert abs(second.estimate.value[7]) > 0


@pytest.fixture(scope="module")
def unnoticed():
    """A campaign whose third joint tilts by less than is detected."""
    at = asked(small(3, poses={"count": 7}, hidden={"effects": ["joint_tilt:3=0.06x"]}))
    case, _ = search_task(at.cell, at.reduced.data, at.estimate)
    wanted = ("joint_tilt:3", "joint_tilt:4", "rail_roll")
    few = tuple(one for one in case.suspects if one.label in wanted and not one.form)
    case = replace(case, suspects=few)
    return case, search(case, at.estimate.value, np.random.default_rng(1)), at


def test_a_cause_too_small_to_name_is_averaged_over(unnoticed):
    """With the probability of its evidence; value and covariance from rows of typical size."""
    case, found, _ = unnoticed
    assert not found.detected
    odds = np.exp(found.scores.log_evidence) / len(case.suspects)
    share = odds / (1 + odds.sum())

    small_ones = too_small(case, found, helps=True)

    likely = {one.label: w for one, w in zip(case.suspects, share, strict=True) if w > 0.05}
    assert {one.effects[0].label: one.weight for one in small_ones} == pytest.approx(likely)
    assert "joint_tilt:3" in likely
    for one in small_ones:
        with_prior_of_its_last(one)


def with_prior_of_its_last(one):
    """A hypothesis agrees with numpy's where its last cause has rows of the prior."""
    k, typical = len(one.effects[-1].parameters), [p.typical for p in one.effects[-1].parameters]
    own, cov = dense(one.system)
    rows = np.linalg.inv(np.linalg.cholesky(cov)) / one.ratio
    prior = np.eye(len(own))[-k:] / (2.5 * np.array(typical))[:, None]
    scale = np.array([p.typical for p in one.system.parameters])
    X, y = np.vstack([rows, prior]) * scale, np.append(rows @ own, np.zeros(k))
    x = np.linalg.lstsq(X, y, rcond=None)[0] * scale
    std = np.sqrt(np.diag(np.linalg.inv(X.T @ X))) * scale
    np.testing.assert_allclose(one.estimate.value, x, rtol=1e-4, atol=1e-4 * np.abs(x).max())
    np.testing.assert_allclose(one.estimate.std, std, rtol=1e-3)


def test_a_cause_too_small_to_name_is_averaged_over_beside_an_identified_one(tilted):
    """It stands beside that one, which keeps the probability that is left and its first place."""
    case, found, _ = tilted
    assert found.explains
    mine = found.accepted[0]
    now, labels = found.view.beside(found.view.base), [one.label for one in case.suspects]
    forms = {label: [i for i, one in enumerate(labels) if one == label] for label in labels}
    del forms[case.suspects[mine].label]
    odds = {
        label: np.exp(now.log_evidence[every]).mean() / len(forms) for label, every in forms.items()
    }
    total = 1 + sum(odds.values())
    likely = {label: each / total for label, each in odds.items() if each / total > 0.05}
    assert "rail_roll" in likely

    small_ones = too_small(case, found, helps=True)
    first, *others = hypotheses(case, placed(case, found, {mine: 1.0}), moved=False, helps=True)

    assert {one.effects[-1].label: one.weight for one in small_ones} == pytest.approx(likely)
    assert first.weight == pytest.approx(1 - sum(likely.values()))
    assert [one.effects[0] for one in (first, *others)] == [case.suspects[mine]] * (1 + len(likely))
    for one in small_ones:
        with_prior_of_its_last(one)


def test_beside_what_no_cause_explains_none_is_too_small(tilted):
    """What is left, and what the causes do not predict, is not what a small cause does."""
    case, found, _ = tilted

    assert found.detected
    assert too_small(case, found, helps=False) == ()
    assert too_small(case, replace(found, left=0.0), helps=True) == ()
    mine, rival = found.accepted[0], other(case, "joint_tilt:4")
    assert too_small(case, placed(case, found, {mine: 0.94, rival: 0.06}), helps=True) == ()
    assert too_small(case, placed(case, found, {mine: 0.96, rival: 0.04}), helps=True)


@pytest.mark.parametrize("copies", [1.0, 1e-4, 0.0])
def test_a_law_stands_out_from_scatter_and_from_copies_of_other_signs(tilted, monkeypatch, copies):
    """The less of both counts: what every second copy shows is none, however large."""
    case, found, _ = tilted
    every = unlisted._every(case, found)[::25]
    monkeypatch.setattr(
        unlisted, "_by_structure", lambda view, *_: np.full(len(view.suspects), copies)
    )

    likely, beyond = unlisted._likely(case, found, (), every, np.random.default_rng(3))

    assert bool(likely) == (copies < 1)
    assert all(p >= copies for p in likely.values())
    assert all(p < 1e-3 for p in likely.values())
    assert beyond < 1e-3  # whatever copies show


def dense(system):
    """Springs and causes by numpy, with the whole covariance."""
    G = system.errors.G.toarray()
    W = np.linalg.inv(np.linalg.cholesky(G @ G.T))
    typical = np.array([p.typical for p in system.parameters])
    X = W @ (system.B * typical)
    x = np.linalg.lstsq(X, W @ system.c, rcond=None)[0] * typical
    return x, np.linalg.inv(X.T @ X) * np.outer(typical, typical)


def test_the_system_of_a_model_leaves_what_the_model_leaves(tilted):
    """C - B x at its own values is measured minus predicted, with the deflected robot."""
    case, found, _ = tilted
    for equilibrium in ("undeformed", "deformed"):
        cell = replace(found.view.model.cell, equilibrium=equilibrium)
        model = replace(found.view.model, cell=cell)
        system, estimate = _solved(case, model, found.seen)
        moved = predict(cell, case.data.pulls, model.values).displacement
        left = case.data.delta - moved[case.data.pull, case.data.target]

        np.testing.assert_allclose(system.c - system.B @ model.values, left.ravel(), atol=1e-12)
        x, cov = dense(system)
        np.testing.assert_allclose(estimate.value, x, atol=1e-5 * np.abs(x).max())
        np.testing.assert_allclose(np.sqrt(np.diag(estimate.cov)), np.sqrt(np.diag(cov)), rtol=1e-4)


def test_what_a_model_leaves_over_the_scatter_widens_its_uncertainties(tilted, monkeypatch):
    """Residuals of 1.5 times the scatter scale all uncertainties; they are never reduced."""
    case, found, _ = tilted
    odds = replace(placed(case, found, {found.accepted[0]: 1.0}), left=0.0)
    _, plain = _solved(case, found.view.model, found.seen)
    for left, factor in ((1.5, 1.5), (0.5, 1.0), (None, 1.0)):
        monkeypatch.setattr(module, "remainder", lambda _, left=left: left)
        (one,) = hypotheses(case, odds, moved=False, helps=True)
        assert one.ratio == factor
        np.testing.assert_allclose(one.estimate.std, factor * plain.std, rtol=1e-9)
        np.testing.assert_allclose(one.estimate.value, plain.value)
        (bare,) = hypotheses(case, odds, moved=True, helps=False)
        assert bare.ratio == 1.0
    monkeypatch.setattr(module, "remainder", lambda _: 1e4)
    (vague,) = hypotheses(case, odds, moved=False, helps=True)
    assert not vague.estimate.identifiable.any()
    assert plain.identifiable[1:4].all()


def test_what_is_left_is_counted_by_degrees_of_freedom(tilted):
    """Root mean squares: the model's residuals by numpy, over those of no rigid motion."""
    _, found, _ = tilted
    view = found.plain
    X, y = view.A[:, view.base], view.A[:, -1]
    X = X / np.linalg.norm(X, axis=0)
    rest = np.sum((y - X @ np.linalg.lstsq(X, y, rcond=None)[0]) ** 2)
    own = len(view.base) - view.first
    scatter = view.scatter / view.scatter_dof

    expected = np.sqrt(rest / (len(view.rows) - 7 - own) / scatter)
    assert remainder(view) == pytest.approx(expected, rel=1e-6)


def test_each_source_is_scaled_by_what_was_found_of_it(tilted):
    """The tracker's own by its found factor, the scale's by both factors, all else as stated."""
    case, _, at = tilted
    wide = replace(case, noise=1.3, certain_noise=1.7, force_noise=2.0)
    plain = replace(case, noise=1.3, certain_noise=1.7, force_noise=1.0)
    source = np.array(["tracker", "zero", "direction", "force_reading", "registration",
                       "force_gain"], dtype=object)  # fmt: skip
    system = SimpleNamespace(errors=SimpleNamespace(source=source))

    assert _scales(wide, system).tolist() == [1.7, 1.7, 1.7, 2.6, 1.0, 1.0]
    assert _scales(plain, system).tolist() == [1.7, 1.7, 1.7, 1.0, 1.0, 1.0]
    assert set(at.system.errors.source) >= {"tracker", "zero", "force_reading"}
