"""What an identified model predicts: equations of its docstrings, by differences and by draws."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.base.arrays import Array
from pipeline.diagnosis.isolability import rich_pulls, rich_tool
from pipeline.machine.cell import load as loaded
from pipeline.machine.cell import paper_cell, predict
from pipeline.machine.effect import Elastic, Pulls
from pipeline.machine.effects import catalogue, unlisted
from pipeline.machine.robot import configure, load
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis, of_machine, part
from pipeline.system.estimate import solve
from tests.made_system import any_system, dense

RAIL, ARM = load("kr500_rail"), load("fanuc_r2000ic")
TOOL = rich_tool(np.random.default_rng(36))
CELL = paper_cell(RAIL, TOOL)
Q = np.array([[8.5, -0.2, 0.6, 0.7, 1.4, 0.4, -0.2], [2.0, 0.5, -0.3, 0.9, -1.0, 0.8, 0.6]])
FORCE = np.array([[300.0, -800.0, -1500.0], [-900.0, 200.0, -600.0]])
POINT = np.array([0.1, 0.05, 0.3])


EVERY = catalogue(RAIL)


def hypothesis(seed: int, weight: float = 1.0) -> ModelHypothesis:
    """Compliances near nominal, with a full covariance matrix."""
    rng, x = np.random.default_rng(seed), RAIL.nominal_compliance
    root = 0.1 * rng.normal(size=(7, 7)) * x[:, None]
    return ModelHypothesis(weight, CELL, x * rng.uniform(0.7, 1.5, 7), root @ root.T)


def model(*hypotheses: ModelHypothesis, **more: object) -> IdentifiedModel:
    """An identified model with these hypotheses."""
    return IdentifiedModel("c", "explained", {}, hypotheses, **more)


def moved(value: Array, cell: object = CELL) -> Array:
    """Deflection of POINT by compliances alone, shape (m, 3)."""
    zero = np.zeros((7, 7))
    return model(ModelHypothesis(1.0, cell, value, zero)).predict(Q, FORCE, POINT).displacement


def slopes(of: object, at: Array) -> Array:
    """Derivative of a function by differences, last axis that of the argument."""
    steps = np.diag(1e-3 * at)
    return np.stack([(of(at + s) - of(at - s)) / (2 * s.max()) for s in steps], axis=-1)


def test_the_uncertainty_is_that_of_the_compliances_carried_forward() -> None:
    """J C J' with J by differences, of a point that is not the campaign's load point."""
    one = hypothesis(1)
    found = model(one).predict(Q, FORCE, POINT)
    J = slopes(moved, one.value)
    expected = J @ one.cov @ J.swapaxes(1, 2)

    np.testing.assert_allclose(found.displacement, J @ one.value, rtol=1e-9)
    np.testing.assert_allclose(found.cov, expected, rtol=1e-6)
    np.testing.assert_allclose(found.std**2, np.einsum("mii->mi", expected), rtol=1e-6)


def test_several_hypotheses_are_a_mixture() -> None:
    """Second moments of what is drawn: hypothesis by weight, then compliances; springs, too.

    Cov(d) = E(d d') - E(d) E(d)', each from the moments of the hypotheses by themselves.
    """
    every = [hypothesis(seed, weight) for seed, weight in ((1, 0.5), (2, 0.3), (3, 0.2))]
    both = model(*every)
    found = both.predict(Q, FORCE, POINT)
    alone = [model(replace(one, weight=1.0)).predict(Q, FORCE, POINT) for one in every]
    w = [one.weight for one in every]

    def moments(mean: list[Array], cov: list[Array]) -> tuple[Array, Array]:
        first = sum(k * m for k, m in zip(w, mean, strict=True))
        second = sum(
            k * (V + m[..., :, None] * m[..., None, :])
            for k, m, V in zip(w, mean, cov, strict=True)
        )
        return first, second - first[..., :, None] * first[..., None, :]

    mean, cov = moments([one.displacement for one in alone], [one.cov for one in alone])
    np.testing.assert_allclose(found.displacement, mean, rtol=1e-9)
    np.testing.assert_allclose(found.cov, cov, rtol=1e-6, atol=1e-6 * cov.max())
    value, V = moments([one.value for one in every], [one.cov for one in every])
    np.testing.assert_allclose(both.value, value, rtol=1e-9)
    np.testing.assert_allclose(
        both.cov / np.outer(value, value), V / np.outer(value, value), atol=1e-9
    )
    np.testing.assert_allclose(both.std, np.sqrt(np.diag(V)), rtol=1e-6)


def test_an_impossible_hypothesis_takes_no_part() -> None:
    """Its weight is zero, and its covariance infinite."""
    one, none = hypothesis(1), hypothesis(2, 0.0)
    unknown = replace(none, cov=np.diag(np.full(7, np.inf)))
    found = model(one, unknown).predict(Q, FORCE)

    assert np.array_equal(found.cov, model(one).predict(Q, FORCE).cov)


def test_what_bending_leaves_out_is_an_uncertainty_at_load_point_and_targets() -> None:
    """u^2 = (J C J')_ii + (deformed - undeformed)_i^2, for every target and the load point."""
    one = hypothesis(4)
    soft = replace(one, value=20 * one.value)
    bent = predict(replace(CELL, equilibrium="deformed"), Pulls.at(Q, FORCE), soft.value)
    flat = predict(CELL, Pulls.at(Q, FORCE), soft.value)
    more = bent.load_point - flat.load_point
    assert np.abs(more).min() > 1e-6

    tip, mine = model(soft).at_load_point(Q, FORCE), model(soft).predict(Q, FORCE)
    np.testing.assert_allclose(tip.displacement, mine.displacement)
    np.testing.assert_allclose(tip.std**2, mine.std**2 + more**2, rtol=1e-6)
    here, std = model(soft).deflection(Q[0], FORCE[0])
    np.testing.assert_allclose(here, flat.displacement[0])
    A = slopes(lambda x: predict(CELL, Pulls.at(Q, FORCE), x).displacement[0], soft.value)
    carried = np.einsum("tik,kl,til->ti", A, soft.cov, A)
    off = (bent.displacement - flat.displacement)[0]
    np.testing.assert_allclose(std**2, carried + off**2, rtol=1e-6)


def test_positions_are_those_of_the_robot_and_its_deflection() -> None:
    """Unloaded by forward kinematics; the force acts at the first of the points."""
    both = model(hypothesis(1, 0.6), hypothesis(2, 0.4))
    points = np.array([POINT, [0.0, 0.2, 0.1]])
    found = both.positions(Q, FORCE, points)

    np.testing.assert_allclose(found.unloaded, configure(RAIL, Q).points(points), atol=1e-12)
    np.testing.assert_allclose(found.loaded - found.unloaded, found.displacement, atol=1e-12)
    np.testing.assert_allclose(found.displacement[:, 0], both.predict(Q, FORCE, POINT).displacement)
    tips = found.unloaded[:, 0] + found.displacement[:, 0]
    np.testing.assert_allclose(found.load_point, tips, atol=1e-12)


def test_a_stiffness_is_one_over_the_compliance_with_its_uncertainty() -> None:
    """u(1/x) = |d(1/x)/dx| u(x) by differences, in the joint's unit; None where it is no value."""
    one = hypothesis(5)
    mine = model(one, stated=np.arange(7) != 4)
    for joint in (0, 1, 6):
        k, std, unit = mine.stiffness(joint)
        x, u, h = one.value[joint], one.std[joint], 1e-4 * one.value[joint]
        assert k == pytest.approx(1 / x)
        assert std == pytest.approx((1 / (x - h) - 1 / (x + h)) / (2 * h) * u, rel=1e-6)
        assert unit == ("N/m" if joint == 0 else "N m/rad")
    assert one.std == pytest.approx(np.sqrt(np.diag(one.cov)))
    assert mine.stiffness(4) is None
    assert model(one).stiffness(4) is not None
    lost, negative = one.cov.copy(), one.value.copy()
    lost[2, 2], negative[3], negative[5] = np.inf, -1e-9, 0.0
    gone = model(replace(one, value=negative, cov=lost))
    assert [k for k in range(7) if gone.stiffness(k) is None] == [2, 3, 5]


def test_an_unknown_stiffness_matters_only_where_it_acts() -> None:
    """Along the rail a force loads its spring, and moves every point along it; across, none."""
    one = hypothesis(6)
    cov = one.cov.copy()
    cov[0, 0] = np.inf
    mine = model(replace(one, cov=cov))
    along = predict(CELL, Pulls.at(Q[:1], FORCE[:1]), np.eye(7)[0]).displacement[0, 0]
    along = along / np.linalg.norm(along)
    acts = np.abs(along) > 0.5
    across = np.cross(along, [0.0, 0.0, 1.0])

    assert acts.tolist() == [False, True, False]
    assert np.isinf(mine.predict(Q[0], 1e3 * along).std[0]).tolist() == acts.tolist()
    rest, x = model(replace(one, cov=_without(one.cov, 0))), 1e3 * across
    np.testing.assert_allclose(mine.predict(Q[0], x).cov, rest.predict(Q[0], x).cov)


def _without(cov: Array, k: int) -> Array:
    """A covariance in which parameter k has none."""
    own = cov.copy()
    own[k], own[:, k] = 0.0, 0.0
    return own


def test_what_is_smaller_than_a_nanometre_is_no_displacement() -> None:
    """Half and twice that, of a parameter of its typical magnitude."""
    cov = _without(hypothesis(6).cov, 2)
    cov[2, 2] = np.inf
    one = replace(hypothesis(6), cov=cov)
    A = np.zeros((2, 1, 7))
    A[:, 0, 2] = np.array([0.5e-9, 2e-9]) / CELL.parameters[2].typical

    assert np.isinf(one.through(A)[:, 0, 0]).tolist() == [False, True]


def test_an_unknown_that_does_not_act_adds_nothing_to_what_does() -> None:
    """Whatever its covariance with the others: 1e-3 of a compliance moves by its own variance."""
    cov = hypothesis(6).cov.copy()
    cov[2, 2] = np.inf
    A = np.zeros((1, 1, 7))
    A[0, 0, 1], A[0, 0, 2] = 1e-3, 0.5e-9 / CELL.parameters[2].typical
    found = replace(hypothesis(6), cov=cov).through(A)

    np.testing.assert_allclose(found, 1e-6 * cov[1, 1], rtol=1e-9)


def test_only_what_the_machine_does_is_handed_over() -> None:
    """Scale, tracker and noise are left out with their rows and columns; the rest in its order."""
    by = {one.name: one for one in EVERY}
    names = ("tracker_drift", "rail_roll", "scale_zero", "tracker_noise")
    cell = CELL.with_effects(*(by[name] for name in names))
    count = [7, *(len(by[name].parameters) for name in names)]
    owner = np.repeat(["springs", *names], count)
    mine = np.isin(owner, ["springs", "rail_roll"])
    estimate = solve(any_system(np.random.default_rng(8), 7, 7), np.ones(7))
    rng, k = np.random.default_rng(2), len(owner)
    value = rng.normal(size=k) * 1e-3
    root = rng.normal(size=(k, k))
    wide = replace(estimate, value=value, cov=root @ root.T)

    one = part(0.4, cell, wide)

    assert np.array_equal(of_machine(cell), mine)
    assert [effect.name for effect in one.cell.effects] == ["joint_compliance", "rail_roll"]
    assert [effect.name for effect in one.beside_springs] == ["rail_roll"]
    assert np.array_equal(one.value, value[mine])
    assert np.array_equal(one.cov, wide.cov[mine][:, mine])
    assert one.weight == 0.4


def smooth_line() -> tuple[Elastic, Pulls]:
    """A spring of joint 3 that varies with its angle, and the pulls that could show it."""
    pulls = rich_pulls(RAIL, np.random.default_rng(36), 40)
    made = unlisted.effects(RAIL, loaded(CELL, pulls, np.zeros(7)))
    family = (3, "spring", "smooth", "angle", 3)
    (line,) = [
        one
        for one in made
        if isinstance(one, Elastic) and one.law.family == family and one.law.order == 1.0
    ]
    return line, pulls


def test_a_law_beside_springs_that_are_not_determined_keeps_what_the_rows_determine() -> None:
    """Every row that was measured by the pseudoinverse; the law outside its range by its size."""
    line, _ = smooth_line()
    cell = CELL.with_effects(line)
    system = any_system(np.random.default_rng(8), 8, 5)
    estimate = solve(system, system.typical)
    assert np.isinf(estimate.std).any()
    W = np.linalg.inv(np.linalg.cholesky(dense(system)))
    A = W @ system.B * system.typical
    cov = np.linalg.pinv(A.T @ A, rcond=1e-12) * np.outer(system.typical, system.typical)

    one = part(1.0, cell, estimate, system)

    rows = np.pad(system.B[:, None], ((0, 0), (0, 0), (0, 1)))
    expected = np.einsum("mjk,kl,mil->mji", rows[..., :8], cov, rows[..., :8])
    np.testing.assert_allclose(one.through(rows), expected, rtol=1e-6)
    own = np.zeros((1, 1, 9))
    own[..., 8] = 1e-2
    np.testing.assert_allclose(one.through(own), (1e-2 * estimate.value[7]) ** 2, rtol=1e-9)


def test_a_law_that_is_handed_over_is_uncertain_where_nobody_pulled() -> None:
    """Within the range of the campaign the uncertainty is the estimate's own, outside it is more.

    Outside, the law may be off by its own size: the deflection of a spring of that compliance.
    """
    line, pulls = smooth_line()
    cell = CELL.with_effects(line)
    value = np.append(RAIL.nominal_compliance, 3e-9)
    base = solve(any_system(np.random.default_rng(8), 7, 7), np.ones(7))
    estimate = replace(base, value=value, cov=np.diag((0.01 * value) ** 2))

    one = part(1.0, cell, estimate)
    known = replace(one, cell=cell, value=value, cov=estimate.cov)

    assert np.array_equal(one.value, np.append(value, 0.0))
    assert [effect.label for effect in one.beside_springs] == [line.label]
    assert len(one.more) == 2
    at, force = pulls.q[:3], pulls.force[:3]
    inside = model(one).predict(at, force).cov, model(known).predict(at, force).cov
    np.testing.assert_allclose(*inside, rtol=1e-6)
    far = at.copy()
    far[:, 2] = pulls.q[:, 2].max() + 0.5
    spring = predict(one.at(), Pulls.at(far, force), 3e-9 * np.eye(9)[2]).displacement[:, 0]
    less = model(known).predict(far, force).cov
    outer = spring[:, :, None] * spring[:, None, :]
    np.testing.assert_allclose(model(one).predict(far, force).cov - less, outer, rtol=1e-6)


def test_two_sided_springs_have_the_side_of_the_test_pose() -> None:
    """Mean c, and c + s dc with s the sign of the torque there, whose lever is by differences."""
    (two,) = [one for one in EVERY if one.label == "joint_asymmetry:4" and one.form in ("", "pull")]
    cell = CELL.with_effects(two)
    value = np.append(RAIL.nominal_compliance, 0.3 * RAIL.nominal_compliance[3])
    root = np.random.default_rng(3).normal(size=(8, 8)) * 0.1 * value[:, None]
    one = ModelHypothesis(1.0, cell, value, root @ root.T)
    step = 1e-6 * np.eye(7)[3]
    ends = [configure(RAIL, (Q[0] + s * step)[None]).points(TOOL.load_point[None]) for s in (1, -1)]
    torque = float((ends[0] - ends[1])[0, 0] @ FORCE[0])
    for sign in (1, -1):
        s = np.sign(sign * torque)
        T = np.eye(8)[:7]
        T[3, 7] = s
        mine = model(one, at_pose=(Q[0], sign * FORCE[0]))
        assert mine.value == pytest.approx(T @ value)
        np.testing.assert_allclose(mine.cov, T @ one.cov @ T.T)
    assert model(one).value == pytest.approx(value[:7])
