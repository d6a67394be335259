"""Pulls and positions together, against one least squares of all readings, with Pinocchio."""

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import pytest

from bench.as_pinocchio import model as pin_model
from pipeline.annex.seen_laws import laws
from pipeline.diagnosis.average import Hypothesis
from pipeline.diagnosis.average import springs as springs_of
from pipeline.machine.cell import Tool, paper_cell
from pipeline.machine.effect import Pulls
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.machine.robot.dh_parameters import dh_parameters
from pipeline.positions.both import yielding
from pipeline.positions.combined import combined, spring_agreement
from pipeline.positions.positions_estimate import PositionsEstimate
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Scale
from pipeline.system import alarms
from pipeline.system.assemble import assemble
from pipeline.system.estimate import solve

TIP = np.array([0.1, 0.02, 0.2])
POINTS = np.array([[0.25, 0.1, 0.12], [-0.15, 0.24, 0.2], [-0.1, -0.22, 0.05]])
ELBOW = np.array([0, -1.2, 0.6, 0, 0, 0])
NOISE, POSES, EACH = 2e-5, 5, 2


@dataclass
class World:
    """An arm, its springs, zeros and tool as estimated from positions, and its displacements.

    Unknowns in the order springs (6), zeros of joints 2 to 6, points of the tool (9).
    """

    robot: object
    truth: np.ndarray
    X: np.ndarray
    y: np.ndarray
    q: np.ndarray
    force: np.ndarray
    delta: np.ndarray

    def moved(self, u):
        """Displacements (m, t, 3) by Pinocchio: sum over the springs of all joints, undeformed."""
        model = pin_model(self.robot)
        data, out = model.createData(), []
        frame = model.getFrameId("flange")
        for q, force in zip(self.q, self.force, strict=True):
            true = q + np.append(0.0, u[6:11])
            J = pin.computeFrameJacobian(model, data, true, frame, pin.LOCAL_WORLD_ALIGNED)
            pin.framesForwardKinematics(model, data, true)
            R = data.oMf[frame].rotation

            def of(point, J=J, R=R):
                return J[:3] - pin.skew(R @ point) @ J[3:]

            turn = u[:6] * (of(TIP).T @ force)
            out.append([of(point) @ turn for point in u[11:].reshape(3, 3)])
        return np.array(out)

    def columns(self, u):
        """Derivatives of the displacements about some values, (3 m t, 20)."""
        steps = np.r_[1e-3 * u[:6], np.full(14, 1e-6)]
        ends = [
            [self.moved(u + s * h * e) for s in (1, -1)]
            for h, e in zip(steps, np.eye(20), strict=True)
        ]
        return np.stack(
            [(a - b).ravel() / (2 * h) for (a, b), h in zip(ends, steps, strict=True)], axis=1
        )

    @property
    def covariance(self):
        """Covariance of all unknowns from the positions."""
        return np.linalg.inv(self.X.T @ self.X)

    @property
    def estimate(self):
        """Estimate of all unknowns from the positions."""
        return self.covariance @ self.X.T @ self.y


def world(seed, off=1.0, stated=True):
    """A world whose scale shows `off` times the force."""
    rng = np.random.default_rng(seed)
    robot = load("kr210_r2700_2")
    c = robot.nominal_compliance * rng.uniform(0.6, 1.6, 6)
    truth = np.r_[c, rng.normal(0, 3e-4, 5), POINTS.ravel() + rng.normal(0, 2e-4, 9)]
    usual = np.r_[0.05 * c, np.full(5, 3e-5), np.full(9, 4e-5)]
    X = np.linalg.qr(rng.normal(size=(30, 20)))[0] / usual
    q = np.repeat(rng.uniform(-1.2, 1.2, (POSES, 6)) + ELBOW, EACH, axis=0)
    force = rng.normal(0, 1, (POSES * EACH, 3))
    force = 1500 * force / np.linalg.norm(force, axis=1, keepdims=True)
    one = World(robot, truth, X, X @ truth + rng.normal(size=30), q, force, np.zeros(0))
    zero = np.repeat(rng.normal(size=(POSES, 3, 3)), EACH, axis=0)  # read once for all pulls
    noise = NOISE / np.sqrt(2) * (rng.normal(size=(len(q), 3, 3)) - zero)
    read = replace(one, delta=one.moved(truth) + noise)
    return replace(read, force=force * off)


def stance_of(one):
    """Results of the positions in the form the pipeline uses."""
    u = one.estimate
    names = [f"P{k}" for k in (1, 2, 3)]
    return PositionsEstimate(
        robot=one.robot,
        letters=tuple(x for x in dh_parameters(one.robot) if x.name == "joint_offset"),
        points=dict(zip(names, u[11:].reshape(3, 3), strict=True)),
        compliance=u[:6],
        told=np.ones(6, dtype=bool),
        held=(),
        yields=np.zeros(0),
        cov=one.covariance,
        unloaded=lambda q: (np.zeros_like(q), np.zeros((len(q), 3, 3))),
    )


def hypothesis(one):
    """Joint springs from the pulls alone, about DH parameters and tool of the positions."""
    stance, m = stance_of(one), len(one.q)
    q = one.q + np.append(0.0, one.estimate[6:11])
    pose = np.repeat(np.arange(1, POSES + 1), EACH)
    pulls = replace(
        Pulls.at(q, one.force), pose=pose, repeat=np.tile(np.arange(1, EACH + 1), POSES)
    )
    tool = Tool(
        TIP, np.array(list(stance.points), dtype=object), np.array(list(stance.points.values()))
    )
    pull, target = np.repeat(np.arange(m), 3), np.tile(np.arange(3), m)
    half = 0.5 * NOISE**2 * np.tile(np.eye(3), (3 * m, 1, 1))
    data = Measured(
        pulls=pulls,
        pull=pull,
        target=target,
        name=tool.targets[target],
        delta=one.delta.reshape(-1, 3),
        unloaded=np.full((3 * m, 3), np.nan),
        loaded_cov=half,
        zero_cov=half,
        zero=3 * (pose[pull] - 1) + target,
        reading_std=np.zeros(m),
        direction_cov=np.zeros((m, 3, 3)),
        rotation_cov=np.zeros((3, 3)),
        scale=Scale(),
        noise_stated=True,
        joint_std=np.zeros(6),
        stance=stance,
    )
    cell = paper_cell(one.robot, tool)
    system = assemble(cell, data, one.estimate[:6])
    estimate = solve(system, one.estimate[:6])
    return Hypothesis(1.0, (), cell, system, estimate), data


def with_tilt(one):
    """The same hypothesis with a tilting bearing, and positions with another one."""
    springs, data = hypothesis(one)
    tilts = {e.where: e for e in catalogue(one.robot) if e.name == "joint_tilt"}
    held = tilts[3], data.stance
    k = len(held[0].parameters)
    cov = np.zeros((20 + k, 20 + k))
    cov[np.ix_(kept(k), kept(k))] = held[1].cov
    cov[6 : 6 + k, 6 : 6 + k] = 1e-16 * np.eye(k)
    stance = replace(held[1], held=(held[0],), yields=np.full(k, 2e-8), cov=cov)
    data = replace(data, stance=stance)
    cell = stance.on(springs.cell).with_effects(tilts[2])
    start = np.append(one.estimate[:6], np.zeros(len(tilts[2].parameters)))
    system = assemble(cell, data, start)
    return Hypothesis(1.0, (tilts[2],), cell, system, solve(system, start)), data


def kept(k):
    """Indices of springs, DH parameters and points before k parameters of elements."""
    return np.r_[np.arange(6), np.arange(6 + k, 20 + k)]


def stacked(one, springs):
    """One least squares of both, about the springs of the pulls: all unknowns, covariance."""
    m = len(one.q)
    zero = np.repeat(np.arange(POSES), EACH)[:, None] * 9 + np.arange(9)
    Z = np.eye(9 * POSES)[zero.ravel()] * NOISE / np.sqrt(2)  # a zero has half of the variance
    u = np.r_[springs, one.estimate[6:]]
    J = one.columns(u)
    pulls = np.hstack([J, Z]) / (NOISE / np.sqrt(2))
    y = (one.delta.ravel() - one.moved(u).ravel() + J @ u) / (NOISE / np.sqrt(2))
    top = np.hstack([one.X, np.zeros((len(one.X), Z.shape[1]))])
    prior = np.hstack([np.zeros((Z.shape[1], 20)), np.eye(Z.shape[1])])
    A = np.vstack([top, pulls, prior])
    assert len(pulls) == 9 * m
    size = np.sqrt(np.sum(A**2, axis=0))
    x, *_ = np.linalg.lstsq(A / size, np.r_[one.y, y, np.zeros(Z.shape[1])], rcond=None)
    cov = np.linalg.inv((A / size).T @ (A / size)) / size / size[:, None]
    return (x / size)[:20], cov[:20, :20]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_both_together_are_one_least_squares_of_all_readings(seed):
    """Springs, DH parameters and tool with full covariance, to the accuracy of differences."""
    one = world(seed)
    springs, data = hypothesis(one)
    found = combined(springs, data)
    x, cov = stacked(one, springs.estimate.value)

    std = np.sqrt(np.diag(cov))
    value = found.value + np.r_[np.zeros(6), one.estimate[6:]]
    assert np.abs((value - x) / std).max() < 1e-3
    assert np.abs((found.cov - cov) / np.outer(std, std)).max() < 1e-4
    assert np.allclose(found.hypothesis.estimate.value, found.value[:6])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_neither_kind_of_readings_alone_knows_a_spring_better(seed):
    """Information adds up: no variance of any combination increases."""
    one = world(seed)
    springs, data = hypothesis(one)
    both = combined(springs, data).hypothesis.estimate.cov

    for alone in (springs.estimate.cov, one.covariance[:6, :6]):
        scale = np.sqrt(np.diag(alone))
        assert np.linalg.eigvalsh((alone - both) / scale / scale[:, None]).min() > -1e-9


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_element_of_the_positions_takes_nothing_from_the_pulls(seed):
    """Held by either as the positions know it: no variance of the springs increases."""
    springs, data = with_causes(world(seed))
    both = combined(springs, data).hypothesis.estimate.cov[:6, :6]

    scale = np.sqrt(np.diag(springs.estimate.cov))
    less = (springs.estimate.cov - both) / scale / scale[:, None]
    assert np.linalg.eigvalsh(less).min() > -1e-9


@pytest.fixture(scope="module")
def many():
    """Forty worlds: hypothesis of the pulls, the same with the positions, truth, chi-square."""
    out = []
    for seed in range(40):
        one = world(seed)
        springs, data = hypothesis(one)
        both = combined(springs, data)
        held = spring_agreement(springs, both, 1.0)
        out.append((springs.estimate, both.hypothesis.estimate, one.truth[:6], held))
    return out


@pytest.mark.whole
def test_springs_that_agree_have_the_chi_square_of_chance(many):
    """Over many worlds its mean equals its degrees of freedom."""
    found = [held for *_, held in many]

    assert {one.dof for one in found} == {6}
    assert np.mean([one.chi2 for one in found]) == pytest.approx(6, abs=3.5 * np.sqrt(12 / 40))


@pytest.mark.whole
def test_intervals_of_both_together_hold_and_are_the_nearest(many):
    """They hold 95 % of the springs; the errors of the pulls alone are larger."""
    off = np.array([(both.value - truth) / both.std for _, both, truth, _ in many])
    alone = np.array([(pulls.value - truth) / both.std for pulls, both, truth, _ in many])

    assert np.mean(np.abs(off) < 1.96) == pytest.approx(0.95, abs=3.5 * np.sqrt(0.05 * 0.95 / 240))
    assert np.mean(off**2) < np.mean(alone**2)


def test_a_scale_that_reads_too_much_contradicts_the_weight():
    """A quarter more force makes springs stiffer than the weight of the arm implies."""
    one = world(1, off=1.25)
    springs, data = hypothesis(one)
    held = spring_agreement(springs, combined(springs, data), 1.0)

    assert held.p < alarms.MISFIT
    assert (np.abs(held.pulls[:, 0] - one.truth[:6] / 1.25) < 4 * held.pulls[:, 1]).all()


def test_springs_up_to_a_factor_add_to_those_of_the_pulls():
    """An arm of which nobody states masses: its weight tells how springs compare."""
    one = world(2)
    known = stance_of(one)
    C = known.cov.copy()
    C[:6, :6] += 1.1**2 * np.outer(known.compliance, known.compliance)
    springs, data = hypothesis(one)
    pulls = springs.estimate
    found = combined(springs, replace(data, stance=replace(known, cov=C, factor=1.1**2)))

    std = np.sqrt(np.diag(found.cov))[:6]
    assert (np.abs(found.value[:6] - one.truth[:6]) < 4 * std).all()
    assert (std < pulls.std * (1 + 1e-9)).all()


def test_causes_of_the_pulls_keep_their_place_beside_elements_of_the_positions():
    """Springs, then causes, then elements; the partial residuals are those of the cause."""
    one = world(4)
    alone, data = with_tilt(one)
    both = combined(alone, data).hypothesis
    k = len(alone.effects[0].parameters)
    names = [p.name for p in both.estimate.parameters]

    assert names[6 : 6 + k] == [p.name for p in alone.effects[0].parameters]
    assert names[6 + k :] == [p.name for p in data.stance.held[0].parameters]
    assert both.effects == (*alone.effects, *data.stance.held)
    called = [(one.effect.label, [a.value for a in one.amplitudes]) for one in yielding([both])]
    assert dict(called)[data.stance.held[0].label] == both.estimate.value[6 + k :].tolist()
    assert both.estimate.value[6 + k :] == pytest.approx(2e-8, abs=4e-8)
    seen = laws(both, data)
    assert set(seen["cause"]) == {"joint_tilt:2", "joint_tilt:3"}
    seen = seen[seen["cause"] == "joint_tilt:2"]
    moved = np.abs(seen["law"]).max() / np.abs(laws(alone, data)["law"]).max()
    assert moved == pytest.approx(
        np.abs(both.estimate.value[6 : 6 + k]).max()
        / np.abs(alone.estimate.value[6 : 6 + k]).max(),
        rel=0.5,
    )


def with_causes(one, *effects):
    """Springs and causes of the pulls; the positions include the tilt of joint 3's bearing."""
    springs, data = with_tilt(one)
    cell = replace(springs.cell, effects=springs.cell.effects[:1]).with_effects(*effects)
    start = np.append(one.estimate[:6], np.zeros(len(cell.parameters) - 6))
    system = assemble(cell, data, start)
    return Hypothesis(0.5, effects, cell, system, solve(system, start)), data


@pytest.mark.whole
def test_a_cause_that_positions_hold_is_one_parameter():
    """The estimate of the pulls is added to the held value, and both give one number."""
    one = world(4)
    tilt = {e.where: e for e in catalogue(one.robot) if e.name == "joint_tilt"}[3]
    alone, data = with_causes(one, tilt)
    found = combined(alone, data)
    names = [p.name for p in found.hypothesis.estimate.parameters]

    assert len(set(names)) == len(names) == 6 + len(tilt.parameters)
    assert found.hypothesis.estimate.value[6:] == pytest.approx(2e-8, abs=4e-8)
    assert found.elements.dof == len(tilt.parameters)
    more = alone.estimate.value[6:] / alone.estimate.std[6:]  # in addition to what is held
    assert found.elements.chi2 == pytest.approx(float(more @ more), rel=0.6, abs=2.0)


@pytest.mark.whole
def test_springs_are_averaged_where_each_hypothesis_lacks_another_element():
    """The first six parameters, whatever follows them."""
    one = world(4)
    tilts = {e.where: e for e in catalogue(one.robot) if e.name == "joint_tilt"}
    several = [
        combined(*with_causes(one, *causes)).hypothesis for causes in ((tilts[3],), (tilts[2],))
    ]
    assert len({len(each.estimate.value) for each in several}) == 2
    both = springs_of(several)

    middle = (several[0].estimate.value[:6] + several[1].estimate.value[:6]) / 2
    assert both.value == pytest.approx(middle)


@pytest.mark.whole
def test_the_spring_of_a_gear_with_a_second_law_is_not_joined():
    """Under the weight it is another number; the others are as certain as with it."""
    one = world(4)
    effect = next(
        e for e in catalogue(one.robot) if (e.label, e.form) == ("joint_asymmetry:2", "pull")
    )
    alone, data = with_causes(one, effect)
    off = data.stance.cov[1, 1] ** 0.5 * np.eye(len(data.stance.cov))[1]
    far = replace(data.stance, compliance=data.stance.compliance + 50 * off[:6])
    moved = combined(alone, replace(data, stance=far))
    here = combined(alone, data)

    assert moved.springs.chi2 == pytest.approx(here.springs.chi2, abs=1e-6)
    assert here.springs.dof == 5
    assert moved.hypothesis.estimate.value == pytest.approx(here.hypothesis.estimate.value)
    assert np.isinf(spring_agreement(alone, here, 1.0).weight[1, 1])
    # positions keep their own value of it, with the joint values of the others
    back = moved.value[:6] - here.value[:6]
    assert back[[0, 2, 3, 4, 5]] == pytest.approx(0.0, abs=1e-12)
    assert back[1] == pytest.approx(50 * off[1], rel=1e-6)
    assert np.linalg.eigvalsh(far.cov[:6, :6] - moved.cov[:6, :6]).min() > -1e-18


def test_what_positions_say_anew_of_an_element_is_what_is_joined():
    """DH and tool errors are those of the new estimate, whatever basis the old one had."""
    one = world(4)
    springs, data = hypothesis(one)
    tilts = {e.where: e for e in catalogue(one.robot) if e.name == "joint_tilt"}
    k, old = len(tilts[3].parameters), data.stance
    rng = np.random.default_rng(3)
    mix = 0.3 * rng.normal(size=(20 + k, 20 + k)) + np.eye(20 + k)
    size = np.r_[np.sqrt(np.diag(old.cov)[:6]), np.full(k, 1e-8), np.sqrt(np.diag(old.cov)[6:])]
    cov = mix @ mix.T * size * size[:, None]
    cov[-1, :], cov[:, -1] = 0.0, 0.0  # an exactly known coordinate of the tool
    cov[-1, -1] = 1e-30
    new = replace(old, held=(tilts[3], tilts[4]), yields=np.zeros(2 * k), cov=wider(cov, k))
    before = replace(old, elements=(tilts[3], tilts[4]), reopened=lambda free: new)
    cell = springs.cell.with_effects(tilts[3])
    start = np.append(one.estimate[:6], np.zeros(k))
    system = assemble(cell, data, start)
    alone = Hypothesis(1.0, (tilts[3],), cell, system, solve(system, start))

    now = combined(alone, replace(data, stance=before))
    same = combined(alone, replace(data, stance=new))
    assert now.value == pytest.approx(same.value, rel=1e-9)
    assert now.hypothesis.estimate.cov == pytest.approx(same.hypothesis.estimate.cov, rel=1e-9)
    assert len(now.hypothesis.estimate.value) == 6 + 2 * k


def wider(cov, k):
    """A covariance with one more element after the first, independent of it."""
    at = np.r_[np.arange(6 + k), np.arange(6 + 2 * k, len(cov) + k)]
    out = np.zeros((len(cov) + k, len(cov) + k))
    out[np.ix_(at, at)] = cov
    out[6 + k : 6 + 2 * k, 6 + k : 6 + 2 * k] = 1e-16 * np.eye(k)
    return out
