"""Positions under a force, by positions and pulls of one robot, against drawn machines."""

from dataclasses import replace

import numpy as np
import pytest
from heavy_robot import TOOL

from pipeline.library.kinematic_model import ByPulls, KinematicModel, dumps
from pipeline.library.target_model import loads, nominal, predict
from pipeline.machine.cell import Tool, paper_cell
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.machine.robot.dh_parameters import dh_parameters
from pipeline.machine.robot.weight import link_moments
from pipeline.positions.mechanism import ArmWeights, Mechanism, Payloads, layout
from pipeline.positions.yielding import other_forms, yielding
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis

GRAVITY = np.array([0.0, 0.0, -9.80665])
NOBODY = Payloads((), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4)))
TIP = np.array([0.1, 0.0, 0.2])
Q = np.array([[0.3, -1.2, 0.6, 0.5, -0.7, 0.2], [-0.8, -0.9, 0.3, -0.6, 0.9, 1.0]])
FORCE = np.array([[900.0, -400.0, -1200.0], [0.0, 0.0, 1500.0]])
ROBOT = load("kr210_r2700_2")
HALF = 2e-7  # half of the difference of two springs [rad/(N m)]
SOFT = ROBOT.nominal_compliance * np.array([1.1, 0.9, 1.2, 0.8, 1.0, 1.3])
NAMES = np.array(["P1", "P2", "P3"], dtype=object)
BOTH_WAYS = next(e for e in catalogue(ROBOT) if (e.label, e.form) == ("joint_asymmetry:2", "pull"))


def standing(by_pulls=None):
    """A robot whose springs are known from positions to 3 % each, and all else exactly."""
    tool = np.tile(np.eye(4), (len(TOOL), 1, 1))
    tool[:, :3, 3] = TOOL
    elements = yielding(ROBOT)
    one = Mechanism(
        ROBOT, np.zeros(len(dh_parameters(ROBOT))), tool, np.eye(4)[None], SOFT, np.zeros((0, 4)),
        link_moments(ROBOT), elements=elements,
        yields=np.zeros(sum(len(e.parameters) for e in elements)),
    )  # fmt: skip
    where = layout(one)
    cov, part = np.zeros((where.size, where.size)), where.compliance
    cov[part, part] = np.diag((0.03 * SOFT) ** 2)
    return KinematicModel(
        "made", one, np.zeros(3, dtype=bool), NAMES, cov,
        np.zeros(6), NOBODY, GRAVITY, 0, TIP, by_pulls,
    )  # fmt: skip


def pulled(effects=(), more=(), joined=True, mixed=0.0):
    """Results of pulls: springs to 3 %, effects to 10 %, `mixed` with the spring of A3."""
    cell = paper_cell(ROBOT, Tool(TIP, NAMES, TOOL)).with_effects(*effects)
    value = np.append(SOFT, np.asarray(more, float))
    size = np.append(0.03 * SOFT, 0.1 * np.abs(np.asarray(more, float)))
    C = np.eye(len(value))
    C[2, 6:] = C[6:, 2] = mixed
    one = ModelHypothesis(1.0, cell, value, C * size * size[:, None])
    return ByPulls(IdentifiedModel("made", "explained", {}, (one,)), joined)


def at(model, force=FORCE):
    """What it predicts."""
    never = np.full(len(Q), np.nan)
    return predict(model, Q, force, np.zeros(len(Q), dtype=np.int64), never)


def test_pulls_that_say_the_same_change_nothing():
    """Springs estimated jointly have one value."""
    alone, beside = at(standing()), at(standing(pulled()))

    np.testing.assert_allclose(beside.at, alone.at, atol=1e-12)
    np.testing.assert_allclose(beside.cov, alone.cov, atol=1e-18)


def test_unloaded_the_pulls_have_no_say():
    """Whatever they say about a force."""
    without = np.zeros_like(FORCE)
    alone, beside = standing(), standing(pulled([BOTH_WAYS], [4e-7], joined=False))

    np.testing.assert_array_equal(at(beside, without).at, at(alone, without).at)
    np.testing.assert_array_equal(at(beside, without).cov, at(alone, without).cov)


def drawn(joined, mixed, count=20000):
    """Motions of the targets of machines drawn from both results, (count, m, t, 3) [m].

    Weight acts on one spring of a joint and a force on another; they are the same for joints
    without a second law, if positions and pulls were estimated together.
    """
    rng, never = np.random.default_rng(4), np.full(len(Q), np.nan)
    weights = ArmWeights(GRAVITY, NOBODY, np.zeros(len(Q), dtype=np.int64))
    by_weight, by_force = 1 + 0.03 * rng.normal(size=(2, count, 6))
    if joined:
        same = [0, 2, 3, 4, 5]
        by_weight[:, same] = by_force[:, same]
    further = mixed * (by_force[:, 2] - 1) / 0.03 + np.sqrt(1 - mixed**2) * rng.normal(size=count)
    stand = standing().mechanism.stand(Q, weights, never, never, never)
    lever = np.einsum("mij,j->mi", stand.here.flange_axes, TIP) + stand.here.flange_origin
    turn, shift = stand.here.twists[..., :3], stand.here.twists[..., 3:]
    pull = np.einsum("mkj,mj->mk", turn, np.cross(lever, FORCE))
    pull += np.einsum("mkj,mj->mk", shift, FORCE)
    angle = (by_weight * SOFT)[:, None] * stand.tau + (by_force * SOFT)[:, None] * pull
    angle[..., 1] += (HALF * (1 + 0.1 * further))[:, None] * np.abs(pull[:, 1])
    moves = shift[:, :, None] + np.cross(turn[:, :, None], stand.at[:, None])
    return np.einsum("dmk,mkti->dmti", angle, moves), np.einsum(
        "mk,mkti->mti", SOFT * (stand.tau + pull), moves
    )


@pytest.mark.parametrize("joined", [True, False])
@pytest.mark.parametrize("mixed", [0.0, 0.8])
def test_a_gear_with_two_springs_moves_targets_as_drawn_machines(joined, mixed):
    """Mean and standard uncertainty, to the accuracy of 20 000 machines and of second order."""
    told = at(standing(pulled([BOTH_WAYS], [HALF], joined, mixed)))
    moved, without = drawn(joined, mixed)

    std = moved.std(axis=0)
    np.testing.assert_allclose(told.std[..., :3], std, rtol=0.04, atol=0.01 * std.max())
    more = moved.mean(axis=0) - without
    np.testing.assert_allclose(told.at - at(standing()).at, more, atol=0.02 * np.abs(more).max())


def test_hypotheses_are_mixed_with_what_they_differ_by():
    """Half of the weight on a second spring: half of its displacement, and as much uncertainty."""
    one, two = pulled().model.hypotheses[0], pulled([BOTH_WAYS], [HALF]).model.hypotheses[0]
    both = (replace(one, weight=0.5), replace(two, weight=0.5))
    mixed = at(standing(ByPulls(IdentifiedModel("made", "ambiguous", {}, both), True)))
    first, second = at(standing(pulled())), at(standing(pulled([BOTH_WAYS], [HALF])))

    half = (second.at - first.at) / 2
    np.testing.assert_allclose(mixed.at, first.at + half, atol=1e-12)
    axis = np.arange(3)
    of = [one.cov[..., axis, axis] for one in (mixed, first, second)]
    np.testing.assert_allclose(of[0], (of[1] + of[2]) / 2 + half**2, rtol=1e-9)


def test_what_pulls_do_not_determine_is_unknown_only_where_it_acts():
    """An undetermined second spring of joint 2: all motions under a force that loads joint 2."""
    said = pulled([BOTH_WAYS], [HALF]).model.hypotheses[0]
    cov = said.cov.copy()
    cov[6, :], cov[:, 6], cov[6, 6] = 0.0, 0.0, np.inf
    open_ = IdentifiedModel("made", "explained", {}, (replace(said, cov=cov),))
    std = at(standing(ByPulls(open_, True)), np.array([[0.0] * 3, FORCE[1]])).std

    assert np.isfinite(std[0]).all()
    assert np.isinf(std[1, :, :3]).any()


def test_the_file_holds_what_pulls_say():
    """Written and read, it predicts the same to the seven digits of its covariance."""
    one = standing(pulled([BOTH_WAYS], [HALF], mixed=0.5))
    again = loads(dumps(one), "positions.npz")

    np.testing.assert_allclose(at(again).at, at(one).at, atol=1e-9)
    np.testing.assert_allclose(at(again).std, at(one).std, rtol=1e-5, atol=1e-12)
    assert nominal(again).by_pulls is None


def played(force):
    """Lost motion of joint 3 under weight and a force, and of joint 2, which may have a balancer.

    Displacement of each target [m] if both have the same lost motion, (m, t, 3), by torques of
    weight and force from screws alone.
    """
    never = np.full(len(Q), np.nan)
    weights = ArmWeights(GRAVITY, NOBODY, np.zeros(len(Q), dtype=np.int64))
    stand = standing().mechanism.stand(Q, weights, never, never, never)
    lever = np.einsum("mij,j->mi", stand.here.flange_axes, TIP) + stand.here.flange_origin
    turn, shift = stand.here.twists[..., :3], stand.here.twists[..., 3:]
    pull = np.einsum("mkj,mj->mk", turn, np.cross(lever, force))
    pull += np.einsum("mkj,mj->mk", shift, force)
    full = 0.03 * 1e-3 / ROBOT.nominal_compliance
    pull[:, 1] = 0.0
    angle = PLAY * np.tanh((stand.tau + pull) / full)[:, [1, 2]]
    moves = shift[:, :, None] + np.cross(turn[:, :, None], stand.at[:, None])
    return np.einsum("mk,mkti->mti", angle, moves[:, [1, 2]])


PLAY = 3e-4  # [rad]


def with_play(by_pulls=None):
    """`standing` with lost motion of joints 2 and 3."""
    one = standing(by_pulls)
    elements = yielding(ROBOT, np.array([[-1.0], [1.0]]) * np.ones(6))
    yields = [
        PLAY * (e.label in {"joint_lost_motion:2", "joint_lost_motion:3"})
        for e in elements for _ in e.parameters
    ]  # fmt: skip
    there = replace(one.mechanism, elements=elements, yields=np.array(yields, dtype=float))
    where, old = layout(there), layout(one.mechanism)
    cov = np.zeros((where.size, where.size))
    cov[where.compliance, where.compliance] = one.cov[old.compliance, old.compliance]
    return replace(one, mechanism=there, cov=cov)


def test_a_force_parts_flanks_that_the_weight_holds():
    """The law of a gear is of its total torque; of the weight's if a balancer is possible.

    To a hundredth: springs rotate by 4 mrad.
    """
    for force in (FORCE, np.array([[0.0, 0.0, 6000.0]] * 2)):
        gap = at(with_play(), force).at - at(standing(), force).at
        play = played(force)

        np.testing.assert_allclose(gap, play, atol=1e-2 * np.abs(play).max())


def test_pulls_that_show_another_law_of_a_gear_stand_in_its_place():
    """Motions under a force are theirs, and those under weight stay."""
    law = next(e for e in catalogue(ROBOT) if (e.label, e.form) == ("joint_asymmetry:3", "pull"))
    force = np.array([[0.0, 0.0, 6000.0]] * 2)
    with_, without = (one(pulled([law], [HALF], False)) for one in (with_play, standing))
    gap = at(with_, force).at - at(without, force).at
    play = played(np.zeros_like(force))

    assert np.abs(played(force) - play).max() > 0.2 * np.abs(play).max()
    np.testing.assert_allclose(gap, play, atol=1e-2 * np.abs(play).max())


def with_tilt():
    """`standing` with bearings that give way under its weight, by what no pull has shown."""
    one = standing(pulled())
    there = one.mechanism
    yields = [2e-7 * (e.name == "joint_tilt") for e in there.elements for _ in e.parameters]
    return replace(one, mechanism=replace(there, yields=np.array(yields)))


def test_a_force_moves_only_what_the_pulls_have_shown_to_yield():
    """Elements of the positions that the pulls do not call for stay as they are.

    To a hundredth of the motion by screws: the weight adds to it, and springs turn by milliradians.
    """
    one, none = with_tilt(), np.zeros_like(FORCE)
    told = at(one).at - at(one, none).at
    alone = replace(one, by_pulls=None)
    moved = drawn(True, 0.0, count=1)[1] - of_weight()

    assert np.abs(at(alone).at - at(alone, none).at - moved).max() > 0.1 * np.abs(moved).max()
    np.testing.assert_allclose(told, moved, atol=1e-2 * np.abs(moved).max())


def of_weight():
    """How far the weight alone turns the targets by springs, as in `drawn`."""
    never = np.full(len(Q), np.nan)
    weights = ArmWeights(GRAVITY, NOBODY, np.zeros(len(Q), dtype=np.int64))
    stand = standing().mechanism.stand(Q, weights, never, never, never)
    turn, shift = stand.here.twists[..., :3], stand.here.twists[..., 3:]
    moves = shift[:, :, None] + np.cross(turn[:, :, None], stand.at[:, None])
    return np.einsum("mk,mkti->mti", SOFT * stand.tau, moves)


@pytest.mark.parametrize("joined", [True, False])
def test_what_a_force_moves_has_an_uncertainty_of_its_own(joined):
    """Of drawn machines, by the springs alone that the force turns; no row without one moves."""
    told = at(standing(pulled([BOTH_WAYS], [HALF], joined)))
    rest = at(standing(pulled([BOTH_WAYS], [HALF], joined)), np.zeros_like(FORCE))
    with_, without = drawn(joined, 0.0), drawn_unloaded(joined)
    std = (with_[0] - without).std(axis=0)

    np.testing.assert_allclose(told.moved_std, std, rtol=0.04, atol=0.01 * std.max())
    np.testing.assert_allclose(told.moved, told.at - rest.at, atol=1e-12)
    assert not rest.moved.any()
    assert not rest.moved_std.any()
    assert not np.signbit(rest.moved_std).any()


def drawn_unloaded(joined, count=20000):
    """Where the same machines as those of `drawn` have the targets under their weight alone."""
    by_weight, by_force = 1 + 0.03 * np.random.default_rng(4).normal(size=(2, count, 6))
    if joined:
        same = [0, 2, 3, 4, 5]
        by_weight[:, same] = by_force[:, same]
    never = np.full(len(Q), np.nan)
    weights = ArmWeights(GRAVITY, NOBODY, np.zeros(len(Q), dtype=np.int64))
    stand = standing().mechanism.stand(Q, weights, never, never, never)
    turn, shift = stand.here.twists[..., :3], stand.here.twists[..., 3:]
    moves = shift[:, :, None] + np.cross(turn[:, :, None], stand.at[:, None])
    return np.einsum("dmk,mkti->dmti", (by_weight * SOFT)[:, None] * stand.tau, moves)


@pytest.mark.parametrize("width", ["narrow", "wide"])
def test_the_file_holds_laws_of_gears(width):
    """Label and form of each element, also if not the first form of its label."""
    one = with_play()
    tau = np.array([[-1.0], [1.0]]) * np.ones(6)
    elements = [
        next((o for o in other_forms(ROBOT, tau, e) if width in o.form), e)
        for e in one.mechanism.elements
    ]
    one = replace(one, mechanism=replace(one.mechanism, elements=tuple(elements)))
    forms = {e.form for e in elements if e.name == "joint_lost_motion"}

    assert forms == {f"{width}, total", f"{width}, weight"}
    assert [e.form for e in loads(dumps(one), "p.npz").mechanism.elements] == [
        e.form for e in elements
    ]
    np.testing.assert_allclose(at(loads(dumps(one), "positions.npz")).at, at(one).at, atol=1e-9)
