"""Weight acts on the arm deflected by weight and pull, against machines computed with Pinocchio."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from heavy_robot import TOOL, HeavyRobot, Truth, errors_of_table, read
from mixed_campaign import HIGH, LOAD_POINT, LOW

from pipeline.geometry.arm_weight import usual
from pipeline.machine.cell import Cell, Tool, baseline, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import configure, load
from pipeline.machine.robot.dh_parameters import dh_parameters
from pipeline.machine.robot.weight import by_moments, carried, link_moments
from pipeline.positions import positions_estimate
from pipeline.positions.calibrate import ModelStructure, calibrate, tried
from pipeline.positions.initial import begin
from pipeline.positions.mechanism import ArmWeights, Mechanism, Payloads, layout, linearised
from pipeline.positions.positions_estimate import stiffening, under_pulls
from pipeline.positions.scatter import start
from pipeline.positions.stated_tool import StatedTool
from pipeline.positions.with_pulls import stance, unloaded_p_value
from pipeline.positions.yielding import Virtual, carried_on, yielding

GRAVITY = np.array([0.0, 0.0, -9.80665])
NOTHING = Payloads((), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4)))
FAR = np.array([2e3, -1e3, -3e3])  # an anchor so far away that a pull keeps its direction


@pytest.fixture(scope="module")
def arm():
    """A KR 210 as in its file but with soft joints, the same in Pinocchio, and poses."""
    robot = load("kr210_r2700_2")
    c = 2 * robot.nominal_compliance
    body = np.array([joint.mass_kg for joint in robot.joints])
    centre = np.array([joint.centre_of_mass_m for joint in robot.joints])
    off = 0 * errors_of_table(robot.n + 1, np.random.default_rng(0))
    machine = HeavyRobot(robot, off, Truth(c, mass=body, centre=centre))
    return robot, c, machine, np.random.default_rng(3).uniform(LOW, HIGH, (8, robot.n))


def points(machine, q, pull=None):
    """Targets of the machine [m], (m, t, 3)."""
    flange = np.array([machine.flange(one, pull) for one in q])
    return np.einsum("mij,tj->mti", flange[:, :3, :3], TOOL) + flange[:, None, :3, 3]


def mechanism(robot, c):
    """The robot with its masses, springs and tool, and without errors."""
    tool = np.tile(np.eye(4), (len(TOOL), 1, 1))
    tool[:, :3, 3] = TOOL
    none = np.zeros(len(dh_parameters(robot)))
    return Mechanism(robot, none, tool, np.eye(4)[None], c, np.zeros((0, 4)), link_moments(robot))


@pytest.mark.parametrize("size", [0.0, 2000.0])
def test_a_robot_stands_where_weight_and_pull_have_turned_it(arm, size):
    """To 1/3000 of the deflection; ten times that with the commanded joints."""
    robot, c, machine, q = arm
    m, never = len(q), np.full(len(q), np.nan)
    weights = ArmWeights(GRAVITY, NOTHING, np.zeros(m, dtype=np.int64))
    one = mechanism(robot, c)
    pull = (size, LOAD_POINT, FAR) if size else None
    force = np.tile(size * FAR / np.linalg.norm(FAR), (m, 1))
    stand = one.stand(q, weights, never, never, never, force, LOAD_POINT)

    truth = points(machine, q, pull)
    turned = np.abs(truth - configure(robot, q).points(TOOL)).max()
    assert turned > 2e-3
    assert np.abs(stand.at - truth).max() < 3e-4 * turned


def test_torques_of_weight_change_with_the_joints_as_pinocchio_has_them(arm):
    """The derivatives of all torques by all joints, to rounding."""
    robot, _, machine, q = arm
    own, x = [k for k, _ in machine.own], np.zeros((len(q), machine.model.nv))
    x[:, own] = q
    by = pin.computeGeneralizedGravityDerivatives
    truth = [-by(machine.model, machine.data, one)[np.ix_(own, own)] for one in x]

    assert stiffening(configure(robot, q), GRAVITY, link_moments(robot)) == pytest.approx(
        np.array(truth), abs=1e-6
    )


def test_weight_turns_the_joints_further_under_a_pull(arm):
    """Displacements of a heavy arm to 1/3000; without its weight seven times that."""
    robot, c, machine, q = arm
    size = 150.0  # so little that the second order in the pull is smaller
    force = np.tile(size * FAR / np.linalg.norm(FAR), (len(q), 1))
    truth = points(machine, q, (size, LOAD_POINT, FAR)) - points(machine, q)
    names = np.array([f"P{k}" for k in range(len(TOOL))], dtype=object)
    cell = Cell(robot, Tool(LOAD_POINT, names, TOOL), baseline(robot))
    heavy = replace(cell, held=((under_pulls(c, link_moments(robot), GRAVITY), np.ones(1)),))
    there = np.array([sagged(machine, one) for one in q])
    with_it, without = (
        predict(one, Pulls.at(there, force), c).displacement - truth for one in (heavy, cell)
    )

    most = np.abs(truth).max()
    assert np.abs(with_it).max() < 3e-4 * most
    assert np.abs(without).max() > 2e-3 * most


def test_the_stiffening_of_a_posture_is_computed_once(arm, monkeypatch):
    """However many times its equilibrium, and that of other forces, asks for it."""
    robot, c, _, q = arm
    asked = []

    def counted(*given):
        asked.append(given[0])
        return stiffening(*given)

    monkeypatch.setattr(positions_estimate, "stiffening", counted)
    names = np.array([f"P{k}" for k in range(len(TOOL))], dtype=object)
    held = ((under_pulls(c, link_moments(robot), GRAVITY), np.ones(1)),)
    heavy = replace(
        Cell(robot, Tool(LOAD_POINT, names, TOOL), baseline(robot)),
        held=held,
        equilibrium="deformed",
    )
    for size in (100.0, 200.0):
        predict(heavy, Pulls.at(q, np.tile([0.0, 0.0, size], (len(q), 1))), c)

    assert len(asked) == 1


def sagged(machine, q):
    """Joint values of the machine unloaded, shape (n,)."""
    own, x = [k for k, _ in machine.own], np.zeros(machine.model.nv)
    for _ in range(20):
        weight = pin.computeGeneralizedGravity(machine.model, machine.data, x)
        x[own] = q - machine.truth.joints * weight[own]
    return x[own]


@pytest.fixture(scope="module")
def heavier(arm):
    """Estimate of an arm whose links are all 5 % heavier than in its file."""
    robot, _, machine, _ = arm
    off = 0 * errors_of_table(robot.n + 1, np.random.default_rng(0))
    there = HeavyRobot(robot, off, replace(machine.truth, mass=1.05 * machine.truth.mass))
    rng = np.random.default_rng(5)
    q = rng.uniform(LOW, HIGH, (60, robot.n))
    readings = read(there, q, rng)
    weights = ArmWeights(GRAVITY, NOTHING, np.zeros(len(q), dtype=np.int64))
    begun = begin(robot, readings, {f"P{k}": at for k, at in enumerate(TOOL, 1)})
    return calibrate(begun, readings, weights, ModelStructure(), start(robot, 1e-5))


def test_springs_are_no_better_known_than_the_stated_masses(arm, heavier):
    """They come out softer, within their uncertainty."""
    c, part = arm[1], slice(1, 3)  # what the weight loads most
    std = np.sqrt(np.diag(heavier.solution.cov)[layout(heavier.mechanism).compliance])

    softer = (heavier.mechanism.compliance - c)[part]
    assert (softer > 0.02 * c[part]).all()
    assert (softer < 2.0 * std[part]).all()


def test_masses_are_tried_with_the_prior_of_those_that_nobody_states(arm, heavier):
    """Not with that of stated ones, which the estimate before had."""
    one = tried(heavier, ModelStructure(moments=True))

    own = one.known.std[layout(one.mechanism).moments]
    assert own == pytest.approx(usual(arm[0])[1].ravel())


def bent(robot, machine, q, where, c):
    """Sag of the targets due to a link that bends [m], (t, 3): its curvature, integrated.

    Every weight bends the link between its proximal end and where it hangs, by c / L times its
    moment there; both ends and all weights are those of the straight arm in Pinocchio.
    """
    near, far = {"upper_arm": (2, 3), "forearm": (3, 5)}[where]
    flange = machine.flange(q)
    there = {k: machine.data.oMi[one + 1] for k, (one, _) in enumerate(machine.own, 1)}
    axis = there[near].rotation[:, 2]
    start, along = there[near].translation, there[far].translation - there[near].translation
    along = along - (along @ axis) * axis
    out, steps = np.zeros_like(TOOL), 400
    for s in (np.arange(steps) + 0.5) / steps:
        moment = np.zeros(3)
        for k in range(near, robot.n + 1):
            at = there[k].act(machine.truth.centre[k - 1])
            if k >= far or (at - start) @ along / (along @ along) > s:
                moment += machine.truth.mass[k - 1] * np.cross(at - start - s * along, GRAVITY)
        moment -= (moment @ along) * along / (along @ along)
        arms = TOOL @ flange[:3, :3].T + flange[:3, 3] - start - s * along
        out += np.cross(c / steps * moment, arms)
    return out


@pytest.mark.sampled(1)
@pytest.mark.parametrize("where", ["upper_arm", "forearm"])
def test_a_link_is_bent_by_the_weights_beyond(arm, where):
    """To a tenth of the largest sag; a motor at its proximal end does not bend it."""
    robot, c, machine, q = arm
    stiff = HeavyRobot(
        robot,
        0 * errors_of_table(robot.n + 1, np.random.default_rng(0)),
        Truth(0 * c, mass=machine.truth.mass, centre=machine.truth.centre),
    )
    here, never = configure(robot, q), np.tile(np.eye(3), (len(q), len(TOOL), 1, 1))
    element = next(e for e in yielding(robot) if e.label == f"link_bending:{where}")
    virtual, size = Virtual([element], here), 3e-7
    weight = carried(here, GRAVITY, link_moments(robot), np.zeros(len(q)), np.zeros((len(q), 3)))
    tau = virtual.torques(weight, weight, np.zeros_like(q))
    at, _ = carried_on(
        virtual.screws,
        virtual.carrier,
        size * virtual.answers(tau),
        points(stiff, q),
        never,
    )
    sag = np.array([bent(robot, stiff, one, where, size) for one in q])

    assert np.abs(at - points(stiff, q) - sag).max() < 0.1 * np.abs(sag).max()
    by = virtual.by_moments(by_moments(here, GRAVITY)) @ link_moments(robot).ravel()
    np.testing.assert_allclose(by, tau, rtol=1e-9, atol=1e-9)


def test_laws_of_gears_follow_another_weight_as_differences_do(arm):
    """To a thousandth, wherever the torque is on the law; for either sense."""
    robot, q = arm[0], arm[3]
    here, none = configure(robot, q), np.zeros(len(q))
    laws = [e for e in yielding(robot, np.array([[-1.0], [1.0]]) * np.ones(6)) if e.side is None]
    laws = [e for e in laws if e.element == "gear"]
    virtual, moments = Virtual(laws, here), link_moments(robot)

    def answers(at):
        weight = carried(here, GRAVITY, at, none, np.zeros((len(q), 3)))
        return virtual.answers(virtual.torques(weight, weight, np.zeros_like(q)))

    weight = carried(here, GRAVITY, moments, none, np.zeros((len(q), 3)))
    tau = virtual.torques(weight, weight, np.zeros_like(q))
    slope = virtual.slopes(tau)[:, :, None] * virtual.by_moments(by_moments(here, GRAVITY))
    for k, one in enumerate(np.eye(24).reshape(24, 6, 4)):
        by = (answers(moments + 1e-3 * one) - answers(moments - 1e-3 * one)) / 2e-3
        np.testing.assert_allclose(slope[..., k], by, rtol=2e-3, atol=1e-9)
    assert np.abs(slope).max() > 1e-3


@pytest.mark.whole
def test_lost_motion_that_the_weight_shows_is_handed_to_pulls(arm):
    """The flanks of joint 3 separate by Pinocchio's torque.

    Half of it in place, with weight and pull.
    """
    robot, _, still, _ = arm
    b, full = 1.5e-4, 0.03 * 1e-3 / robot.nominal_compliance[2]
    rng, third = np.random.default_rng(8), np.eye(6)[2]
    truth = replace(still.truth, turned=lambda q, tau: third * b * np.tanh(tau / full))
    machine = HeavyRobot(robot, 0 * errors_of_table(robot.n + 1, rng), truth)
    readings = read(machine, rng.uniform(LOW, HIGH, (60, robot.n)), rng)
    weights = ArmWeights(GRAVITY, NOTHING, np.zeros(60, dtype=np.int64))
    begun = begin(robot, readings, {f"P{k}": at for k, at in enumerate(TOOL, 1)})
    tau = linearised(readings, begun, weights).inputs.tau
    wanted = ModelStructure(yields=yielding(robot, tau))
    found = calibrate(begun, readings, weights, wanted, start(robot, None))
    said = stance(found, StatedTool({}, 0.0, 0.0))

    ((law, (value,)),) = said.effects
    assert (law.label, law.form) == ("joint_lost_motion:3", "narrow, total")
    at = len(said.compliance)
    assert abs(value - b) < 3 * np.sqrt(said.cov[at, at]) < 0.3 * b
    assert_unloaded_readings_are_judged(found, said, machine, rng)


def assert_unloaded_readings_are_judged(found, said, machine, rng):
    """Readings of ten other poses, wherever their tracker stood; half a millimetre is too much."""
    q = rng.uniform(LOW, HIGH, (10, 6))
    names = np.tile([str(one) for one in found.readings.targets], 10).astype(object)
    tool = Tool(LOAD_POINT, names[: len(TOOL)], TOOL)
    turned = q + said.unloaded(q)[0]
    pulls = replace(Pulls.at(turned, np.zeros((10, 3))), pose=np.arange(10))
    pull, sigma = np.repeat(np.arange(10), len(TOOL)), 1e-5
    true = points(machine, q).reshape(-1, 3) + sigma * rng.standard_normal((len(pull), 3))

    def p(at):
        data = SimpleNamespace(
            zero=np.arange(len(pull)), pull=pull, pulls=pulls, name=names, poses=False,
            unloaded=at - said.moved(turned[pull], names),
            zero_cov=np.tile(sigma**2 * np.eye(3), (len(pull), 1, 1)),
        )  # fmt: skip
        return unloaded_p_value(found, said, data, tool)

    turn = pin.exp3(np.array([1e-5, -2e-5, 3e-5]))
    assert p(true) > 1e-3
    assert p(true @ turn.T + [3e-4, -2e-4, 1e-4]) == pytest.approx(p(true), rel=0.05)
    off = true.copy()
    off[7] += [3e-4, 0, -4e-4]
    assert p(off) < 1e-6
