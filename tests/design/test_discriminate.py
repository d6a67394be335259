"""Causes visible with a plan: differences of the forward model, numpy's fits, scipy's powers."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import optimize, stats

from pipeline.design.discriminate import (
    CauseTests,
    _classes,
    _first,
    _sizes,
    cause_tests,
    detectabilities,
    named_from,
    rows,
)
from pipeline.design.library import problem_of
from pipeline.design.problem import with_steps
from pipeline.design.schedule import pulls_at
from pipeline.diagnosis.isolability import Twins, twins
from pipeline.machine.cell import predict
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.system import alarms

ROBOT = load("kr500_rail")
LABELS = ("a", "b", "b", "c", "twin of c", "alone")
OWNER = (1, 2, 1, 1, 1, 1)
"""Columns of each."""


def made_lens():
    ends = 7 + np.cumsum((0, *OWNER))
    at = np.full((6, 2), -1)
    for row, start, count in zip(at, ends, OWNER, strict=False):
        row[:count] = np.arange(start, start + count)
    return CauseTests(
        problem=SimpleNamespace(robot=ROBOT),
        cell=None,
        suspects=tuple(SimpleNamespace(label=one, needs=f"needs of {one}") for one in LABELS),
        at=at,
        typical=np.ones(7),
        group=np.array([0, 1, 1, 2, 2, 3]),
        main=np.array([True, True, False, True, True, True]),
        names=("a", "b", "c = twin of c", "alone"),
        twins=Twins(("rail_yaw",), (("c", "twin of c"),), ()),
    )


@pytest.fixture(scope="module")
def columns():
    """Whitened columns of seven springs and six causes; c resembles the second form of b."""
    rng = np.random.default_rng(1)
    X = rng.normal(size=(90, 14))
    X[:, 11] = X[:, 10] + 0.3 * X[:, 11]  # c, near the second form of b
    X[:, 12] = X[:, 11] + 0.05 * X[:, 12]  # its twin
    # orthogonal to all others
    others = np.delete(X, 13, axis=1)
    X[:, 13] -= others @ np.linalg.lstsq(others, X[:, 13], rcond=None)[0]
    return X


def of(view, X, i):
    return X[:, view.at[i][view.at[i] >= 0]]


def left(X, base, *more):
    """Residuals of the columns X after springs and further columns."""
    B = np.hstack([base, *more])
    return X - B @ np.linalg.lstsq(B, X, rcond=None)[0]


def least(k, p):
    """Noncentrality detected in four cases of five, by scipy's root finding."""
    limit = stats.chi2.isf(p, k)
    return optimize.brentq(lambda x: stats.ncx2.sf(limit, k, x) - 0.8, 1e-3, 1e3)


def expected(view, X):
    """Sizes of each suspect: detected, named, and the number of the closest rival."""
    base, out = X[:, :7], []
    for i in range(6):
        mine = left(of(view, X, i), base)
        detected = np.sqrt(least(mine.shape[1], alarms.PLANNED) / np.mean(np.sum(mine**2, axis=0)))
        own = np.linalg.norm(mine.sum(axis=1))
        rivals = {
            j: np.linalg.norm(left(of(view, X, i).sum(axis=1), base, of(view, X, j)))
            for j in range(6)
            if view.group[j] != view.group[i]
        }
        j = min(rivals, key=rivals.get)
        named = max(detected, 4.6 / min(own, rivals[j]))
        out.append((detected, named, j if rivals[j] < 0.999 * own else i))
    return out


def test_sizes_are_those_of_fits_one_by_one(columns):
    """For one plan and for several: detected, named, and what hides each best."""
    view, X = made_lens(), columns
    truth = expected(view, X)

    for M in (X.T @ X, np.stack([X.T @ X, 0.25 * X.T @ X])):
        detected, named, rival = _sizes(view, M)
        first = (..., slice(None)) if M.ndim == 2 else (0,)
        assert detected[first] == pytest.approx([one[0] for one in truth], rel=1e-6)
        assert named[first] == pytest.approx([one[1] for one in truth], rel=1e-6)
        assert rival[first].tolist() == [one[2] for one in truth]
    assert detected[1] == pytest.approx(2 * detected[0], rel=1e-6)
    assert named[1] == pytest.approx(2 * named[0], rel=1e-6)
    assert rival[0, 5] == 5  # nothing hides an orthogonal one
    assert rival[0, 3] == 2


def test_a_cause_is_told_by_its_main_form_and_twins_as_one(columns):
    """Of twins the one harder to name; what pulls never show is at the end."""
    view, X = made_lens(), columns
    truth = expected(view, X)

    said = {one.name: one for one in detectabilities(view, X.T @ X)}

    assert list(said) == ["a", "b", "c = twin of c", "alone", "rail_yaw"]
    b, c = said["b"], said["c = twin of c"]
    assert (b.detected_from, b.named_from) == pytest.approx(truth[1][:2], rel=1e-6)
    worst = max((3, 4), key=lambda i: truth[i][1])
    assert c.named_from == pytest.approx(truth[worst][1], rel=1e-6)
    assert c.detected_from == pytest.approx(max(truth[3][0], truth[4][0]), rel=1e-6)
    assert c.rival == "b"
    assert c.needs == f"needs of {LABELS[worst]}"
    assert said["alone"].rival == ""
    yaw = said["rail_yaw"]
    assert (yaw.detected_from, yaw.named_from, yaw.rival) == (np.inf, np.inf, "the joint springs")
    assert yaw.needs == next(one.needs for one in catalogue(ROBOT) if one.label == "rail_yaw")
    many = named_from(view, np.stack([X.T @ X, 4 * X.T @ X]))
    assert many.shape == (2, 4)
    assert many[0] == pytest.approx([said[name].named_from for name in view.names], rel=1e-6)
    assert many[1] == pytest.approx(many[0] / 2, rel=1e-6)


def test_what_needs_ten_thousand_typical_sizes_is_never_seen(columns):
    """A size that no machine has does not count."""
    view = made_lens()
    for factor, seen in ((1.1, False), (0.9, True)):
        X = columns.copy()
        alone = expected(view, X)[5]
        X[:, 13] *= alone[1] / (1e4 * factor)
        said = {one.name: one for one in detectabilities(view, X.T @ X)}["alone"]
        assert bool(np.isfinite(said.named_from)) is seen


def test_twins_of_twins_are_one_class():
    """Pairs with a common member are joined, in any order."""
    labels = ["d", "a", "b", "c", "e", "a"]

    found = _classes(labels, [("a", "b"), ("c", "d"), ("b", "c")])

    assert found == {**dict.fromkeys("abcd", "a = b = c = d"), "e": "e"}
    assert _classes(labels, []) == {one: one for one in labels}
    assert _first(labels).tolist() == [True] * 5 + [False]


@pytest.fixture(scope="module")
def real():
    return cause_tests(problem_of("paper_reference", {}))


def test_the_causes_of_a_plan_are_those_that_pulls_can_show(real):
    """All of the catalogue except noise and what is never visible, columns in their order."""
    hidden = twins(real.problem.robot)
    labels = [one.label for one in real.suspects]

    assert not set(labels) & {*hidden.of_stiffness, *hidden.unmoved, "tracker_noise", "force_noise"}
    assert {"joint_tilt:3", "rail_roll", "rail_backlash", "joint_hysteresis:3"} <= set(labels)
    assert real.springs == 7
    flat = real.at[real.at >= 0]
    assert flat.tolist() == list(range(7, 7 + len(real.typical)))
    sizes = [(row >= 0).sum() for row in real.at]
    assert sizes == [len(one.parameters) for one in real.suspects]
    for pair in hidden.pairs:
        if set(pair) <= set(labels):
            one, other = (real.group[labels.index(label)] for label in pair)
            assert one == other
            assert real.names[one].split(" = ") == sorted(real.names[one].split(" = "))
    assert len({label for label, main in zip(labels, real.main, strict=True) if main}) == sum(
        real.main
    )


def test_columns_are_differences_of_the_forward_model(real):
    """Whitened with a covariance built by hand: springs and two causes, two steps, two poses."""
    rng = np.random.default_rng(3)
    robot, made = real.problem.robot, real.problem
    q = np.stack([joint_mid(robot) + 0.2 * rng.normal(size=robot.n) for _ in range(2)])
    anchor, approach, steps = np.array([3.0, 6.0, -0.9]), np.ones(2), np.array([1000.0, -2500.0])
    stated = {"scale_sigma_n": 30.0, "scale_sigma_rel": 0.02, "reading_sigma_m": 3e-5}
    stated |= {"displacement_sigma_m": None, "tracker": None, "zero": "before and after"}
    noise = made.spec.noise.model_copy(update=stated)
    problem = replace(made, spec=made.spec.model_copy(update={"noise": noise}))
    view = replace(real, problem=problem)
    start = np.array([0.0, 600.0])

    X = rows(view, q, anchor, approach, steps, start)

    used = with_steps(problem, steps)
    assert used.scatter.zero == 0.5
    pulls = pulls_at(used, q, anchor, approach, steps, start)
    wanted = [next(i for i, s in enumerate(view.suspects) if s.label == label)
              for label in ("joint_tilt:3", "rail_roll")]  # fmt: skip
    effects = [view.suspects[i] for i in wanted]
    cell = view.cell.with_effects(*effects)
    typical = np.array([p.typical for e in effects for p in e.parameters])
    unit = np.concatenate([problem.experiment.scale, typical])
    about = np.concatenate([problem.experiment.scale, np.zeros(len(typical))])

    def moves(x):
        return predict(cell, pulls, x).displacement

    J = np.stack(
        [(moves(about + d) - moves(about - d)) / 2e-3 for d in 1e-3 * np.diag(unit)], axis=-1
    )
    C = used.scatter.tracker
    chosen = np.concatenate([np.arange(7), *(view.at[i][view.at[i] >= 0] for i in wanted)])
    for k in range(2):
        of_pose = J[2 * k : 2 * k + 2].reshape(2 * 9, -1)
        T = np.kron(np.eye(3), C)
        V = np.kron(np.eye(2) + 0.5, T)
        for s in range(2):
            # all springs nominal, one newton of pull
            d = of_pose[9 * s : 9 * s + 9, :7].sum(axis=1) / np.abs(steps[s])
            V[9 * s : 9 * s + 9, 9 * s : 9 * s + 9] += (900 + (0.02 * steps[s]) ** 2) * np.outer(
                d, d
            )
        products = of_pose.T @ np.linalg.solve(V, of_pose)
        found = X[k][:, chosen].T @ X[k][:, chosen]
        np.testing.assert_allclose(found, products, rtol=1e-4, atol=1e-6 * np.abs(products).max())


def joint_mid(robot):
    lower = np.where(np.isfinite(robot.lower), robot.lower, -1)
    upper = np.where(np.isfinite(robot.upper), robot.upper, 1)
    return (lower + upper) / 2 + 0.3
