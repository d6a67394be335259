"""The catalogue in a table: sizes at which causes are expected, and what a law does, by hand.

Sizes are entered a second time: a detection limit, a simulated fault and a prior all rest on them,
so that none may change unnoticed. The robot's springs are those of its file.
"""

from dataclasses import replace
from types import SimpleNamespace as Some

import numpy as np
import pytest
from scipy.linalg import expm

from pipeline.machine.cell import Cell, Tool, _exponential, _Same, baseline, paper_cell, predict
from pipeline.machine.cell import load as loaded
from pipeline.machine.effect import HUNG, MOUNTED, PULLED, Elastic, Pulls
from pipeline.machine.effects import (
    _anatomy,
    base_growth,
    base_moved,
    catalogue,
    joint_asymmetry,
    joint_hysteresis,
    joint_lost_motion,
    nameless,
    payload,
    rail_backlash,
    scale_hysteresis,
    target_moved,
)
from pipeline.machine.effects.tracker_drift import by_order
from pipeline.machine.robot import configure, load
from pipeline.machine.robot.weight import gravity_torque

RAIL, UR = load("kr500_rail"), load("ur10")
K = np.array([8.0e7, 3.8e6, 6.6e6, 3.9e6, 5.6e5, 6.6e5, 4.7e5])
"""Stiffnesses of the joints by the robot's file [N/m] and [N m/rad]."""
INF = np.inf
Q = np.array([[3.0, 0.2, -1.1, 1.4, 0.6, -0.7, 0.3], [6.0, -0.8, -0.7, 1.1, -1.2, 0.9, 2.1]])
FORCE = np.array([[300.0, 0.0, -400.0], [0.0, 1200.0, 500.0]])  # of 500 N and 1300 N
TOOL = Tool(
    load_point=np.array([0.1, 0.05, 0.4]),
    targets=np.array(["P1", "P2"], dtype=object),
    points=np.array([[0.2, 0.0, 0.1], [0.0, 0.2, 0.15]]),
)

EVERY = catalogue(RAIL)


def test_causes_act_where_their_loads_are():
    """Errors of scale and chain on pulls alone; of the load point on hung weights too."""
    for one in EVERY:
        pulled = one.name.startswith(("scale_", "chain_", "force_"))
        hung = one.name == "load_point_offset" and one.form != "measuring point"
        kinds = (PULLED,) if pulled else (PULLED, HUNG) if hung else (PULLED, HUNG, MOUNTED)
        assert one.of == kinds, one.label
        unloaded = one.name in ("joint_offset", "base_rotation", "gravity_sag")
        assert one.shows_unloaded == unloaded, one.label
        gear = one.name in ("joint_asymmetry", "joint_hardening", "joint_lost_motion")
        assert one.element == ("gear" if gear else ""), one.label


@pytest.mark.parametrize(
    ("where", "place", "location"),
    [
        (None, "rail", "rail"), (3, "joint", "joint 3"), ("P2", "metrology", "metrology"),
        ("forearm", "link", "forearm"), ("scale", "force", "force"), ("rail", "rail", "rail"),
        ("P1", "tool", "P1"), (3, "wrist", "3"),
    ],
)  # fmt: skip
def test_a_cause_is_located_in_the_cell(where, place, location):
    """By its joint, its link or the part of the cell that is affected as a whole."""
    assert replace(EVERY[0], where=where, place=place).location == location


def test_what_moves_in_mid_campaign_is_expected_in_millimetres():
    """A robot by a decimetre at most, either way."""
    moved = base_moved.since((1,), 2)
    slipped = target_moved.since("P2", 1, (4,), 9)
    for one in (moved, slipped):
        for p in one.parameters:
            assert p.lower == -p.upper
            assert p.typical == 1e-3
    assert {(p.unit, p.upper) for p in moved.parameters} == {("m", 0.1), ("rad", 0.1)}


def test_lengths_grow_with_the_base_from_round_to_round():
    """By what the largest round has; points at the origin stay."""
    one = base_growth.over(np.array([0.0, 100.0, 300.0]), np.array([0.0, 2e-5, -4e-5]))
    points = np.arange(18.0).reshape(3, 2, 3)
    found = one.observe(None, points, np.array([50.0, 300.0, 200.0]), np.array([1e-3]))
    share = np.array([-0.25, 1.0, 0.25])
    np.testing.assert_allclose(found, points * (1 + 1e-3 * share[:, None, None]))
    (p,) = one.parameters
    assert (p.typical, p.lower, p.upper) == (1e-5, -1e-2, 1e-2)
    assert one.instrument


def pulls(**more):
    """Two pulls, of two poses."""
    one = Pulls.at(Q, FORCE)
    fields = {name: getattr(one, name) for name in one.__dataclass_fields__}
    return Pulls(**fields | {"pose": np.array([4, 9])} | more)


def here(robot=RAIL, q=Q, **more):
    """A robot under both pulls."""
    one = pulls(**more)
    if q is not Q:
        one = pulls(**{"q": q} | more)
    return loaded(paper_cell(robot, TOOL), one, np.zeros(robot.n))


def only(effects, **names):
    """The one effect of this form, or at this joint."""
    (found,) = [one for one in effects if all(getattr(one, k) == v for k, v in names.items())]
    return found


def own_weight(q, joint):
    """Torque of the arm's own weight on a joint before the pull."""
    now = configure(UR, q)
    torque = gravity_torque(UR, now, UR.gravity, np.zeros(len(q)), np.zeros((len(q), 3)))
    return torque[:, joint - 1 : joint]


@pytest.mark.parametrize("joint", [2, 3])
def test_a_gear_with_two_sides_turns_by_what_the_pull_adds(joint):
    """|tau + w| - |w| of the torque w of the weight; its side is that of both together."""
    q = np.tile(np.array([[0.3, -1.1, 0.8, -0.4, 0.5, 0.2]]), (4, 1))
    w = own_weight(q, joint)
    assert abs(w[0, 0]) > 1
    tau = w * np.array([[-0.5], [-2.0], [0.7], [-1.0 - 1e-12]])
    at = here(UR, q, force=np.ones((4, 3)), pose=np.arange(4), **{
        name: np.zeros(4) for name in ("branch", "approach", "time", "time_zero")
    }, repeat=np.ones(4, int), by=np.zeros(4, int), acts_at=np.full((4, 3), np.nan),
        body=np.full(4, "", object), zeros_after=np.zeros(4))  # fmt: skip
    total = only(joint_asymmetry.effects(UR), where=joint, form="total")
    pull = only(joint_asymmetry.effects(UR), where=joint, form="pull")
    np.testing.assert_allclose(total.response(at, tau), np.abs(tau + w) - np.abs(w))
    np.testing.assert_allclose(pull.response(at, tau), np.abs(tau))
    sign = np.sign(w[0, 0])
    assert total.side(at, tau)[:3, 0].tolist() == [sign, -sign, sign]
    assert total.side(at, tau)[3, 0] == 1.0  # no torque
    assert pull.side(at, np.array([[2.0], [-2.0], [0.0], [-1e-9]]))[:, 0].tolist() == [1, -1, 1, 1]

    rated = 1e-3 * UR.joints[joint - 1].typical_stiffness
    for form, width in (("narrow", 0.03), ("wide", 0.08)):
        b = width * rated
        one = only(joint_lost_motion.effects(UR), where=joint, form=form)
        both = only(joint_lost_motion.effects(UR), where=joint, form=f"{form}, total")
        np.testing.assert_allclose(one.response(at, tau), np.tanh(tau / b))
        np.testing.assert_allclose(
            both.response(at, tau), np.tanh((tau + w) / b) - np.tanh(w / b), atol=1e-12
        )


def test_friction_of_a_gear_is_that_of_each_form():
    """Rated 6.6 kN m at joint 3: 1 % of it has turned by tanh(1/3) of all."""
    tau = np.array([[66.0], [-33.0]])
    sense = np.tanh(tau / (0.03 * 6600.0))
    for branch in ([1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]):
        at = here(branch=np.array(branch), pose=np.array([4, 4]))
        way = np.array(branch)[:, None]
        of = {form: only(joint_hysteresis.effects(RAIL), where=3, form=form).response(at, tau)
              for form in ("held", "left over", "bow")}  # fmt: skip
        np.testing.assert_allclose(of["held"], -sense * way)
        np.testing.assert_allclose(of["left over"], sense * (way < 0))
        part = np.abs(tau) / 66.0
        np.testing.assert_allclose(of["bow"], 4 * part * (1 - part) * sense * (way < 0))
    for form, width in (("sliding, tight", 0.05), ("sliding", 0.15), ("sliding, wide", 0.4)):
        one = only(joint_hysteresis.effects(RAIL), where=3, form=form)
        s = width * 6600.0
        z1 = 1 - np.exp(-66.0 / s)
        z2 = -1 + (z1 + 1) * np.exp(-99.0 / s)
        at = here(pose=np.array([4, 4]), repeat=np.array([1, 2]))
        np.testing.assert_allclose(one.response(at, tau)[:, 0], [-z1, -z2])
        at = here(pose=np.array([4, 5]))
        apart = [-(1 - np.exp(-66.0 / s)), 1 - np.exp(-33.0 / s)]
        np.testing.assert_allclose(one.response(at, tau)[:, 0], apart)


def test_a_carriage_moves_within_its_play():
    """Through the flanks by 150 N, against friction by 300 N; either way it came."""
    force, came = np.array([[120.0], [-60.0]]), np.array([1.0, -1.0])
    at = here(approach=came)
    for form, rest, free in (
        ("held by friction", -1.0, False), ("held by the brake", 1.0, False),
        ("centred", 0.0, False), ("held by friction until pulled over", -1.0, True),
        ("held by the brake until pulled over", 1.0, True),
    ):  # fmt: skip
        start = rest * came[:, None]
        expected = (np.tanh(force / 150.0) - start) / 2
        if free:
            expected = -start * np.tanh(np.maximum(-start * force, 0.0) / 300.0)
        found = only(rail_backlash.effects(RAIL), form=form).response(at, force)
        np.testing.assert_allclose(found, expected)


def test_the_scale_reads_weights_as_they_are():
    """Its errors are of pulls alone: by a constant along the chain, on the way down."""
    one = only(scale_hysteresis.effects(RAIL), form="constant")
    at = here(branch=np.array([1.0, -1.0]))
    found = one.wrench(at, np.array([13.0]))[1]
    np.testing.assert_allclose(found, FORCE * np.array([[513 / 500], [1287 / 1300]]))
    hung = here(branch=np.array([1.0, -1.0]), by=np.array([HUNG, PULLED]))
    np.testing.assert_allclose(one.wrench(hung, np.array([13.0]))[1][0], FORCE[0])


def test_the_ends_of_a_rail_are_stated_or_ten_metres_apart():
    """Both or neither."""
    for ends in ((-INF, INF), (0.0, INF), (-INF, 18.0)):
        of = Some(lower=np.array([ends[0]]), upper=np.array([ends[1]]))
        assert _anatomy.rail_ends(of) == (0.0, 10.0)
    assert _anatomy.rail_ends(Some(lower=np.array([1.0]), upper=np.array([18.0]))) == (1.0, 18.0)


def test_a_tool_has_its_load_point_and_its_targets_apart():
    """In their order."""
    one = Tool.of({"P2": (1, 2, 3), "load_point": (4, 5, 6), "P1": (7, 8, 9)})
    assert one.targets.tolist() == ["P2", "P1"]
    assert one.points.tolist() == [[1, 2, 3], [7, 8, 9]]
    assert one.load_point.tolist() == [4, 5, 6]
    assert list(one.named) == ["load_point", "P2", "P1"]


def test_effects_are_the_same_only_if_they_are_identical():
    """In number and order."""
    a, b = EVERY[:2]
    assert _Same((a, b)) == _Same((a, b))
    assert hash(_Same((a, b))) == hash(_Same((a, b)))
    for other in (_Same((b, a)), _Same((a,)), (a, b)):
        assert not _Same((a, b)) == other  # noqa: SIM201 - what a cache asks


def test_screws_of_more_than_half_a_radian_move_as_matrix_exponentials():
    """Rotation and translation; each series is short of it by its next term."""
    rng = np.random.default_rng(7)
    w, v = rng.normal(size=(2, 3, 4, 5))
    w *= 0.7 / np.linalg.norm(w, axis=0)
    R, t = _exponential(w, v)
    for n, m in np.ndindex(4, 5):
        T = np.zeros((4, 4))
        x, y, z = w[:, n, m]
        T[:3, :3], T[:3, 3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]], v[:, n, m]
        E = expm(T)
        skew, exact = (A - A.T for A in (R[:, :, n, m], E[:3, :3]))
        np.testing.assert_allclose(skew, exact, atol=5e-9)  # c: 1/11!
        np.testing.assert_allclose(R[:, :, n, m], E[:3, :3], atol=3e-8)  # b: 1/10!
        np.testing.assert_allclose(t[:, n, m], E[:3, 3], atol=6e-8)


def test_the_order_of_springs_does_not_matter():
    """But for the second order of what one carrier has: joints, a soft base, a tilting bearing."""
    springs, tilt, roll = baseline(RAIL)[0], only(EVERY, label="joint_tilt:3", form=""), only(
        EVERY, name="rail_roll"
    )  # fmt: skip
    values = {"joint_compliance": 20 / K, "joint_tilt": [3e-7, 5e-7], "rail_roll": [4e-7]}
    found = []
    for effects in ((springs, tilt, roll), (roll, springs, tilt), (tilt, roll, springs)):
        cell = Cell(RAIL, TOOL, effects, "deformed")
        x = np.concatenate([values[one.name] for one in effects])
        found.append(predict(cell, pulls(), x).displacement)
        flat = Cell(RAIL, TOOL, effects)
        small = pulls(force=1e-3 * FORCE)
        bent, straight = (predict(one, small, x).displacement for one in (cell, flat))
        np.testing.assert_allclose(bent, straight, atol=2e-5 * np.abs(straight).max())
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], atol=1e-3 * np.abs(found[0]).max())


def test_nameless_effects_have_sizes_of_the_springs_that_they_stand_beside():
    """Bearings as guide rollers; compliances that vary by a twentieth; either way up to twenty."""
    every = {}
    for one in (*nameless.competing(RAIL), *nameless.mounting(RAIL)):
        every.setdefault(one.name, []).append(one)
        for p in one.parameters:
            assert p.upper == pytest.approx(20 * p.typical)
            one_way = one.name in ("bearing_translation", "effector_play")
            assert p.lower == pytest.approx(0.0 if one_way else -p.upper)
    sizes = {
        "bearing_translation": lambda one: 5e-9,
        "compliance_by_angle": lambda one: 0.05 / K[one.where - 1],
        "compliance_by_time": lambda one: 0.05 / K[one.where - 1],
        "compliance_by_history": lambda one: 0.05 / K[one.carrier[0] - 1],
        "cross_talk": lambda one: 0.05 / np.sqrt(K[one.carrier[0] - 1] * K[one.carrier[1] - 1]),
        "effector_play": lambda one: 6e-5,
        "tilt_by_moment": lambda one: 1 / 6 / K[one.carrier[0] - 1],
        "effector_turned": lambda one: 0.05,
        "load_on_the_forearm": lambda one: 5e-3,
    }
    for name, size in sizes.items():
        for one in every.pop(name):
            assert [p.typical for p in one.parameters] == pytest.approx(
                [size(one)] * len(one.parameters)
            ), one.label
    rail = {"lateral": 5e-9, "vertical": 2.5e-9, "roll": 1e-8, "pitch": 5e-9}
    for name in ("guide_along_the_rail", "guide_contact"):
        mine = every.pop(name)
        assert {one.where: one.parameters[0].typical for one in mine} == pytest.approx(rail)
    assert every == {}
    couples = [one.carrier for one in nameless.nameless(RAIL) if one.name == "cross_talk"]
    assert couples == [(2, 3), (3, 4), (4, 5)]
    joints = [one.where for one in nameless.nameless(RAIL) if one.name == "compliance_by_angle"]
    assert joints == [2, 4, 5, 6, 7]
    bearings = [one.where for one in nameless.nameless(RAIL) if one.name == "bearing_translation"]
    assert bearings == [3, 4, 5, 6, 7, 8]
    arm = [one.where for one in nameless.nameless(UR) if one.name == "bearing_translation"]
    assert arm == [1, 2, 3, 4, 5, 6, 7]


def test_a_joint_remembers_its_loads_by_the_clock_or_pull_by_pull():
    """A step of T ln 2 keeps a half and adds half of the load, within a pose only."""
    fades = 300.0
    half = fades * np.log(2)
    torque = np.array([[-4.0], [2.0], [1.0], [3.0]])
    timed = Some(
        pose=np.array([1, 1, 1, 2]), repeat=np.array([1, 2, 3, 1]),
        time=np.array([0.0, half, 2 * half, 3 * half]),
    )  # fmt: skip
    found = nameless.remembered(timed, torque, fades)[:, 0]
    np.testing.assert_allclose(found, [0.0, 0.5, 0.5, 0.25])
    back = [2, 0, 3, 1]
    turned = Some(**{name: value[back] for name, value in vars(timed).items()})
    np.testing.assert_allclose(nameless.remembered(turned, torque[back], fades)[:, 0], found[back])
    untimed = Some(pose=timed.pose, repeat=timed.repeat, time=np.full(4, np.nan))
    keeps = np.exp(-60.0 / fades)
    m1 = 1 - keeps
    m2 = keeps * m1 + (1 - keeps) * 0.5
    found = nameless.remembered(untimed, torque, fades)[:, 0]
    np.testing.assert_allclose(found, [0.0, m1, m2, keeps * m2])
    assert not nameless.remembered(timed, 0 * torque, fades).any()


def test_nameless_laws_by_hand():
    """Angle, clock, rail and load, each by its own formula."""
    every = {(one.name, one.where): one for one in nameless.nameless(RAIL)}
    at = here(time=np.array([1800.0, np.nan]))
    tau = np.array([[2.0] * 5, [-3.0] * 5])
    q = Q[:, 3]
    waves = np.stack([np.cos(q), np.sin(q), np.cos(2 * q), np.sin(2 * q)], axis=1)
    by_angle = every["compliance_by_angle", 4].response(at, tau[:, :4])
    np.testing.assert_allclose(by_angle, tau[:, :4] * waves)
    warm = every["compliance_by_time", 4].response(at, tau[:, :1])
    np.testing.assert_allclose(warm, [[1.0], [0.0]])
    phase = np.pi * (Q[:, 0] - RAIL.lower[0]) / (RAIL.upper[0] - RAIL.lower[0])
    along = np.stack([np.ones(2), np.cos(phase), np.sin(phase), np.cos(2 * phase),
                      np.sin(2 * phase)], axis=1)  # fmt: skip
    guide = every["guide_along_the_rail", "roll"]
    np.testing.assert_allclose(guide.response(at, tau), tau * along)
    np.testing.assert_allclose(guide.screws(at), np.repeat(guide.screws(at)[:, :1], 5, axis=1))
    contact = every["guide_contact", "lateral"]
    large = nameless.LARGE["m/N"]
    root = contact.response(at, np.array([[4.0], [-9.0]]))
    np.testing.assert_allclose(root, np.sqrt(large) * np.array([[2.0], [-3.0]]))
    tilts = [one for one in nameless.competing(RAIL) if one.name == "tilt_by_moment"]
    moment = nameless.LARGE["rad/(N m)"]
    grown = tilts[0].response(at, np.array([[4.0 * moment] * 2, [-moment] * 2]))
    np.testing.assert_allclose(grown, [[8.0 * moment] * 2, [-moment] * 2])
    memory = next(one for one in nameless.histories(RAIL) if one.where == "all 5 min")
    assert memory.shared == (0,) * 7
    assert isinstance(memory, Elastic)
    one = here(pose=np.array([4, 4]), repeat=np.array([1, 2]), time=np.array([0.0, 300.0]))
    tau = np.array([[2.0, -1.0, 1, 1, 1, 1, 1], [1.0, 4.0, 1, 1, 1, 1, 1]])
    keeps = np.exp(-1.0)
    share = np.abs(tau[0]) / np.abs(tau).max(axis=0)
    own = K[0] / K
    expected = np.stack([0 * own, own * tau[1] * (1 - keeps) * share])
    np.testing.assert_allclose(memory.response(one, tau), expected)


def test_payloads_are_heavier_or_elsewhere_by_their_own_share():
    """Of two bodies only the one; its mass only if something else loads the robot, too."""
    body = np.array(["gun", "box"], object)
    both = pulls(by=np.array([MOUNTED, MOUNTED]), body=body)
    alone = pulls(by=np.array([MOUNTED, MOUNTED]), body=np.array(["gun", "gun"], object))
    mixed = pulls(by=np.array([MOUNTED, PULLED]), body=np.array(["gun", ""], object))
    labels = [[one.label for one in payload.effects(each)] for each in (both, alone, mixed)]
    assert labels == [
        ["payload_mass:box", "payload_mass:gun", "payload_center:box", "payload_center:gun"],
        ["payload_center:gun"],
        ["payload_mass:gun", "payload_center:gun"],
    ]  # fmt: skip
    assert payload.effects(pulls()) == ()
    _, mass, _, centre = payload.effects(both)
    at = here(by=np.array([MOUNTED, MOUNTED]), body=body)
    point, force = mass.wrench(at, np.array([0.04]))
    np.testing.assert_allclose(force, FORCE * [[1.04], [1.0]])
    np.testing.assert_allclose(point, at.load_point)
    d = np.array([0.01, -0.02, 0.03])
    point, force = centre.wrench(at, d)
    np.testing.assert_allclose(force, FORCE)
    moved = configure(RAIL, Q).flange_axes[0] @ d
    np.testing.assert_allclose(point - at.load_point, [moved, np.zeros(3)], atol=1e-12)
    assert [(p.typical, p.lower, p.upper) for p in mass.parameters] == [(0.01, -1.0, INF)]
    assert {(p.typical, p.lower, p.upper) for p in centre.parameters} == {(5e-3, -0.5, 0.5)}
    assert mass.of == centre.of == (MOUNTED,)


def test_every_element_has_as_many_screws_as_parameters_need():
    """Each parameter is that of some virtual joint, each response as wide as the screws."""
    rng = np.random.default_rng(3)
    at = here(time=np.array([0.0, 600.0]), branch=np.array([1.0, -1.0]))
    every = (*EVERY, *nameless.competing(RAIL))
    for one in (part for whole in every for part in whole.facets):
        if not isinstance(one, Elastic):
            continue
        v = len(one.carrier)
        assert one.screws(at).shape == (2, v, 6), one.label
        tau = 100 * rng.normal(size=(2, v))
        assert one.response(at, tau).shape == (2, v), one.label
        assert sorted({*one.parameter_of}) == [*range(len(one.parameters))], one.label
        assert all(0 <= carrier <= 7 for carrier in one.carrier)
    beam = only(EVERY, label="link_bending:forearm", form="beam")
    assert (beam.carrier, beam.shared, beam.bears) == ((4,) * 4, (0, 1, 0, 1), 6)
    hinge = only(EVERY, label="link_bending:upper_arm", form="hinge")
    assert (hinge.carrier, hinge.shared, hinge.bears) == ((3,) * 2, (), 4)
    tilt = only(EVERY, label="joint_tilt:5", form="oblique")
    assert tilt.shared == (0, 1, 2, 2)
    np.testing.assert_array_equal(
        tilt.response(at, np.arange(8.0).reshape(2, 4)), [[0, 1, 1, 0], [4, 5, 5, 4]]
    )
    talk = next(one for one in nameless.nameless(RAIL) if one.name == "cross_talk")
    assert talk.shared == (0, 0)


TOLERANCES = {
    "pedestal_tilt": 0.1, "rail_backlash": 0.1, "rail_stiffness_varies": 0.15,
    "joint_asymmetry": 0.005, "joint_hardening": 0.2, "joint_lost_motion": 0.15,
    "joint_hysteresis": 0.2, "compensator": 0.1, "scale_hysteresis": 0.2, "tracker_drift": 0.2,
}  # fmt: skip
"""Relative model error of each cause; 3 % of all others."""

CARRIED = {
    "rail_stiffness_varies": (1,), "compensator": (3,), "tool_flex": (7,), "pedestal_tilt": (0,),
    "wrist_coupling": (5, 6, 7), "gravity_sag": (2, 3, 4),
}  # fmt: skip
"""Joints that carry each cause that is nowhere in particular, on the rail; one less without."""


@pytest.mark.parametrize(("robot", "rail"), [(RAIL, 1), (UR, 0)])
def test_causes_have_their_tolerance_and_their_joints(robot, rail):
    """A bearing whose seat the table leaves open has a larger one; guides carry what is theirs."""
    every = catalogue(robot)
    assert {one.name for one in every} >= set(TOLERANCES) - {
        "pedestal_tilt" if rail else "rail_backlash", "rail_stiffness_varies",
    }  # fmt: skip
    for one in every:
        seat = one.name == "joint_tilt" and one.form not in ("", "oblique")
        assert one.tolerance == (0.1 if seat else TOLERANCES.get(one.name, 0.03)), one.label
        for facet in (part for part in one.facets if isinstance(part, Elastic)):
            link = {"upper_arm": 2 + rail, "forearm": 3 + rail}.get(one.where, one.where)
            known = CARRIED.get(one.name, (1,) if link is None else (link,))
            shift = 0 if link is not None or one.name == "pedestal_tilt" else 1 - rail
            assert {*facet.carrier} == {k - shift for k in known}, one.label
            assert len(facet.shared) in (0, len(facet.carrier))


def test_parameters_are_told_by_the_axis_or_joints_that_they_are_of():
    """About x and y of the base, of a bearing and of a tool; between joints of the wrist."""
    told = {
        one.name: [p.meaning for p in one.parameters]
        for one in (*catalogue(UR), *EVERY)
        if one.form in ("", "at its foot")
    }
    tilt = "tilt compliance of the"
    assert told["pedestal_tilt"] == [f"{tilt} pedestal about {a}" for a in "xy"]
    assert told["joint_tilt"] == [f"{tilt} bearing of {{joint}} about {a}" for a in "xy"]
    assert told["tool_flex"] == [f"{tilt} tool on its flange about {a}" for a in "xy"]
    assert told["wrist_coupling"] == [
        f"compliance that couples joints {a}" for a in ("5 and 6", "6 and 7", "5 and 7")
    ]
    assert told["base_rotation"] == [f"rotation of the base frame about {a}" for a in "xyz"]
    assert told["chain_offset"] == [f"offset of the chain along {a} over its length" for a in "xyz"]


def test_a_bent_link_turns_about_its_middle_and_shifts_its_end():
    """By the moment there, and a twelfth of its squared length times the force."""
    at, (axes, start) = here(), here().configuration.frame(3)
    end = here().configuration.frame(4)[1]
    beam = only(EVERY, label="link_bending:upper_arm", form="beam")
    link = end - start
    z = axes[:, :, 2]
    link = link - np.sum(link * z, axis=1, keepdims=True) * z
    length = np.linalg.norm(link, axis=1, keepdims=True)
    side = np.cross(z, link / length)
    middle = (start + end) / 2
    screws = beam.screws(at)
    for k, turn in enumerate((z, side)):
        np.testing.assert_allclose(screws[:, k, :3], turn, atol=1e-12)
        stays = screws[:, k, 3:] + np.cross(turn, middle)
        np.testing.assert_allclose(stays, 0, atol=1e-12)
    for k, shift in ((2, side), (3, z)):
        np.testing.assert_allclose(screws[:, k, 3:], shift, atol=1e-12)
        assert not screws[:, k, :3].any()
    tau = np.arange(1.0, 9.0).reshape(2, 4)
    expected = tau * np.concatenate([np.ones((2, 2)), np.repeat(length**2 / 12, 2, 1)], axis=1)
    np.testing.assert_allclose(beam.response(at, tau), expected)


def test_bodies_on_a_link_bend_it_by_the_square_of_how_far_out_they_are():
    """Half way if nobody states where; no more than at its end, no less than at its root."""
    assert only(EVERY, label="link_bending:upper_arm", form="beam").between == pytest.approx(
        (0.25,)
    )
    assert only(EVERY, label="link_bending:forearm", form="beam").between == pytest.approx(
        (0.25,) * 2
    )
    for where, near, far in (("upper_arm", 2, 3), ("forearm", 3, 5)):
        one = only(catalogue(UR), label=f"link_bending:{where}", form="beam")
        now = configure(UR, np.zeros((1, 6)))
        (_, start), (_, end) = now.frame(near), now.frame(far)
        link, squares = (end - start)[0], []
        for k in range(near, far):
            axes, origin = now.frame(k)
            at = (origin + axes @ np.array(UR.joints[k - 1].centre_of_mass_m) - start)[0]
            squares.append(min(max(at @ link / (link @ link), 0.0), 1.0) ** 2)
        assert one.between == pytest.approx(squares)


def test_a_tracker_drifts_steadily_or_until_it_is_warm():
    """After an hour 3600 v, and a (1 - 1/e) at a time constant of an hour; none without a time."""
    points, time = np.zeros((3, 2, 3)), np.array([3600.0, 0.0, np.nan])
    v = np.array([1e-9, -2e-9, 3e-9])
    drifts = {one.form: one for one in EVERY if one.name == "tracker_drift"}
    steady = drifts["steady"].observe(None, points, time, v)
    np.testing.assert_allclose(steady[0], [3600 * v] * 2)
    for form, hours in (("warm-up", 1.0), ("warm-up in half an hour", 0.5)):
        warm = drifts[form].observe(None, points, time, v)
        np.testing.assert_allclose(warm[0], [(1 - np.exp(-1 / hours)) * v] * 2)
        assert not warm[1:].any()


def test_without_times_a_tracker_drifts_from_group_to_group():
    """As if a group of readings took a hundred seconds; what settles with time is left out."""
    kept = by_order(EVERY)
    (drift,) = [one for one in kept if one.name == "tracker_drift"]
    assert [one for one in kept if one is not drift] == [
        one for one in EVERY if one.name != "tracker_drift"
    ]
    for parameter in drift.parameters:
        assert parameter.unit == "m/group"
        assert parameter.typical == pytest.approx(100 * 4e-5 / 3600)
        assert (parameter.lower, parameter.upper) == pytest.approx((-3e-5, 3e-5))
    v, points = np.array([1e-6, -2e-6, 3e-6]), np.zeros((2, 1, 3))
    moved = drift.observe(None, points, np.array([200.0, np.nan]), v)
    np.testing.assert_allclose(moved, [[2 * v], [0 * v]])
