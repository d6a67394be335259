"""Heavy arms of unknown mass on crooked rails, against machines computed with Pinocchio only."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from heavy_robot import (
    CENTRE,
    MASS,
    TOOL,
    HeavyRobot,
    Truth,
    errors_of_table,
    poses,
    read,
    waves,
)

from pipeline.geometry.arm_weight import usual
from pipeline.library.kinematic_model import dumps, kinematic_model
from pipeline.library.target_model import loads, predict
from pipeline.machine.robot import configure, load
from pipeline.machine.robot.weight import carried, work
from pipeline.positions import study as of_study
from pipeline.positions.calibrate import ModelStructure, calibrate
from pipeline.positions.catalogue_causes import _evidence
from pipeline.positions.cross_validation import Partition
from pipeline.positions.estimate import (
    FIXED_SIGMA,
    Posterior,
    Prior,
    prior,
    rougher,
    softer,
    solved,
)
from pipeline.positions.gross_errors import corrected, counted_back, turned
from pipeline.positions.initial import begin
from pipeline.positions.joint_laws import LawSearchData, _of_shafts, _share
from pipeline.positions.laws import JointLaw
from pipeline.positions.mechanism import ArmWeights, Payloads, layout, linearised
from pipeline.positions.scatter import start
from pipeline.positions.study import ModelStage, study
from pipeline.positions.yielding import sizes, yielding

RAIL = "kr500_rail_kuka"
RAIL_LAW = JointLaw(1, "smooth", "angle", 1, 1.0, 3.0, 3.0)
GRAVITY = np.array([0.0, 0.0, -9.80665])
NOTHING = Payloads((), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4)))


def under_weight(m):
    return ArmWeights(GRAVITY, NOTHING, np.zeros(m, dtype=np.int64))


def stated(rng):
    """Tool points according to a drawing."""
    return {f"P{k}": point + rng.normal(0, 1e-3, 3) for k, point in enumerate(TOOL, 1)}


class Crooked:
    """An arm with springs, a balancer, tilting bearings and ripples on a crooked rail."""

    def __init__(self, seed, stations=12, each=20):
        rng = np.random.default_rng(seed)
        self.robot = load("kr500_rail_kuka")
        c = self.robot.nominal_compliance * rng.uniform(0.7, 1.6, 7)
        c[0] = 0.0
        phase = rng.uniform(0, 6, 7)
        high = rng.uniform(0.2, 1.0, 7) * [0, 1, 1, 1, 1, 1, 1] * 1.2e-4
        truth = Truth(
            c,
            tilt={k: rng.uniform(1e-8, 7e-8, 2) for k in (2, 3, 4)},
            carriage={"rx": 3e-8, "ry": 2e-8},
            rail=waves(rng, 6.0, [2e-4, 1e-4, 3e-4, 1e-4, 1e-4, 1.5e-4]),
            balancer=lambda a: -4500.0 * np.sin(a + 0.3) / np.sqrt(1 + 0.3 * np.cos(a + 0.3)),
            turned=lambda q, tau: high * np.sin(2 * q + phase),
        )
        self.machine = HeavyRobot(self.robot, errors_of_table(8, rng), truth)
        q = poses(rng, stations, each, self.robot)
        self.readings = read(self.machine, q, rng)
        self.tool = stated(rng)
        self.out = np.arange(len(q)) % 5 == 0
        self.found = study(
            self.robot, self.readings.part(~self.out), under_weight(int((~self.out).sum())),
            self.tool, None, (np.nan, np.nan), np.random.default_rng(0),
        )  # fmt: skip


@pytest.fixture(scope="module")
def crooked():
    return Crooked(5)


@pytest.mark.whole
def test_poses_left_out_are_predicted_to_their_noise(crooked):
    """0.01 mm of the tracker and 0.01 mrad of each joint give about 0.04 mm at the tool."""
    model = loads(dumps(kinematic_model("made", crooked.found.final)), "positions.npz")
    there = crooked.readings.part(crooked.out)
    told = predict(model, there.q, np.zeros((len(there), 3)), there.payload, there.temperature)
    frame = model.mechanism.frames[0]
    off = told.at - (there.at - frame[:3, 3]) @ frame[:3, :3]

    assert np.linalg.norm(off, axis=2).mean() < 0.08e-3
    inside = np.abs(off) < 1.96 * np.hypot(told.std[..., :3], crooked.found.final.scatter.position)
    assert 0.88 < inside.mean() < 0.99


@pytest.mark.whole
def test_weight_and_rail_are_named_before_laws_nobody_listed(crooked):
    found = crooked.found

    assert {"gravity_sag", "rail_shape"} <= {cause.name for cause in found.causes}
    assert all(law.joint != 1 for law in found.laws)
    bed = next(cause for cause in found.causes if cause.name == "rail_shape")
    along = np.unique(crooked.readings.q[:, 0])
    truth = np.stack([crooked.machine.truth.rail(one) for one in along])
    size = {one.name: one.value for one in bed.amounts}
    for name, axis in (("s_x", 0), ("s_z", 1)):  # y of the rail's frame is -z of F_b
        straight = np.polynomial.Polynomial.fit(along, truth[:, axis], 1)(along)
        assert size[name] == pytest.approx(np.std(truth[:, axis] - straight), rel=0.2)
    for name, axis in (("s_rx", 3), ("s_rz", 4)):
        assert size[name] == pytest.approx(np.std(truth[:, axis]), rel=0.2)


@pytest.mark.whole
def test_a_crooked_rail_is_no_instrument_that_moved(crooked):
    assert crooked.found.moved == ()
    assert crooked.found.bad == ()
    steps = {stage.step: stage.mean(Partition.BETWEEN) for stage in crooked.found.stages}
    assert steps[ModelStage.CATALOGUE] < steps[ModelStage.SPRINGS] / 2


@pytest.mark.whole
def test_a_moment_without_masses_is_a_product(crooked):
    """Mass and stiffness cannot be separated without a known load."""
    (sag,) = (cause for cause in crooked.found.causes if cause.name == "gravity_sag")

    names = [joint.name for joint in crooked.robot.joints]
    most = crooked.machine.truth.joints * torques(crooked.machine, crooked.readings.q[~crooked.out])
    assert sag.form == "moments"
    assert len(sag.amounts) >= 3
    for one in sag.amounts:
        assert one.unit == "rad"
        assert one.value == pytest.approx(most[names.index(one.name[2:])], abs=4 * one.std)


def torques(machine, q):
    """Largest torque of the links' weight about each joint, by Pinocchio, shape (n,) [N m]."""
    own, x = [k for k, _ in machine.own], np.zeros((len(q), machine.model.nv))
    x[:, own] = q
    every = [pin.computeGeneralizedGravity(machine.model, machine.data, one) for one in x]
    return np.abs(every).max(axis=0)[own]


def test_weight_at_the_joints_is_that_of_pinocchio():
    robot = load("kr500_rail_kuka")
    machine = HeavyRobot(robot, np.zeros((8, 6)), Truth(np.zeros(7)))
    q = poses(np.random.default_rng(2), 3, 4, robot)
    moments = np.column_stack([MASS, MASS[:, None] * CENTRE])
    here, none = configure(robot, q), np.zeros(len(q))
    tau = work(here.twists, carried(here, GRAVITY, moments, none, np.zeros((len(q), 3))))

    for one, row in zip(q, tau, strict=True):
        x, own = np.zeros(machine.model.nv), [k for k, _ in machine.own]
        x[own] = one
        held = -pin.computeGeneralizedGravity(machine.model, machine.data, x)[own]
        assert row == pytest.approx(held, abs=1e-8 * np.abs(held).max())


BALANCER = np.array([[9000.0, 1500.0], [900.0, 500.0]])  # cos, sin of one and two waves [N m]
PLAY = 2e-4  # [rad]


def balanced_torque(a):
    return sum(part @ [np.cos(k * a), np.sin(k * a)] for k, part in enumerate(BALANCER, 1))


def with_play(there, tau, balancer=BALANCER):
    """The mechanism with a balancer, and with lost motion of A2 by the weight's torques `tau`."""
    c = there.compliance[2]
    elements = tuple(e for e in yielding(there.table, tau) if e.name != "joint_asymmetry")
    yields = [
        PLAY * (e.label == "joint_lost_motion:3") if e.element == "gear" else one.typical
        for e in elements for one in e.parameters
    ]  # fmt: skip
    laws = tuple(JointLaw(3, "periodic", "angle", 3, k) for k in (1.0, 2.0))
    return replace(
        there, elements=elements, yields=np.array(yields), laws=laws,
        amplitudes=c * np.ravel(balancer),
    )  # fmt: skip


def test_flanks_of_a_balanced_gear_part_where_weight_and_balancer_are_equal():
    """Positions are those of Pinocchio, to a hundredth of what the play moves."""
    robot, q = load(RAIL), poses(np.random.default_rng(3), 2, 6, load(RAIL))
    full = 0.03 * 1e-3 / robot.nominal_compliance[2]
    truth = Truth(
        robot.nominal_compliance * (np.arange(7) > 0),
        balancer=balanced_torque,
        turned=lambda q, tau: PLAY * np.tanh(tau[2] / full) * (np.arange(7) == 2),
    )
    machine = HeavyRobot(robot, np.zeros((8, 6)), truth)
    flange = np.stack([machine.flange(one) for one in q])
    right = np.einsum("mij,tj->mti", flange[:, :3, :3], TOOL) + flange[:, None, :3, 3]
    there = begin(robot, read(machine, q, np.random.default_rng(0)), {})
    tool = np.tile(np.eye(4), (3, 1, 1))
    tool[:, :3, 3] = TOOL
    moments = np.column_stack([MASS, MASS[:, None] * CENTRE])
    there = replace(there, tool=tool, compliance=truth.joints, moments=moments)
    never = np.full(len(q), np.nan)
    tau = there.stand(q, under_weight(len(q)), never, never, never).tau
    there = with_play(there, tau)
    there = replace(there, yields=np.where(there.yields == PLAY, PLAY, 0.0))  # no tilts

    at = there.stand(q, under_weight(len(q)), never, never, never).at
    total = tau[:, 2] + [balanced_torque(one[2]) for one in q]

    assert (tau[:, 2] * total < 0).any()  # the balancer turns some round
    assert np.abs(at - right).max() < 0.03 * PLAY


def one_estimate(y, var):
    """Of one parameter, with its variance."""
    return Posterior(np.array([var * y]), np.array([[var**0.5]]), np.zeros((0, 0)), 0.0)


@pytest.mark.parametrize(("y", "size"), [(10.0, np.sqrt(99.0)), (0.5, 0.01)])
def test_a_scale_that_has_vanished_returns_where_readings_call_for_it(y, size):
    """Of b, read as y with unit variance, the likeliest variance is y^2 - 1; or none."""
    none = np.zeros(0, dtype=bool)
    known = Prior(
        np.zeros(1), np.array([0.01]), none, none, np.array([1e3]), {"": slice(0, 1)},
        (np.nan, np.nan), returning=True,
    )  # fmt: skip
    for _ in range(30):
        var = 1 / (1 + known.std[0] ** -2)
        known = rougher(known, one_estimate(y, var))

    assert known.std[0] == pytest.approx(size, rel=1e-6)


@pytest.mark.parametrize(("y", "vanishes"), [(-10.0, True), (10.0, False)])
def test_play_that_takes_back_what_the_weight_does_vanishes(y, vanishes):
    """Of b >= 0, read as y with unit variance: its scale falls to what the readings do not see."""
    none = np.zeros(0, dtype=bool)
    known = Prior(
        np.zeros(1), np.ones(1), none, none, np.array([1e3]), {"": slice(0, 1)}, (np.nan, np.nan),
        signed=np.ones(1, dtype=bool),
    )  # fmt: skip
    for _ in range(10):
        var = 1 / (1 + known.std[0] ** -2)
        known = rougher(known, one_estimate(y, var))

    assert (known.std[0] < 0.05) == vanishes


def test_compliances_and_play_cannot_be_negative():
    """As the catalogue bounds them; couplings and differences of stiffness can."""
    robot, rng = load(RAIL), np.random.default_rng(0)
    machine = HeavyRobot(robot, np.zeros((8, 6)), Truth(np.zeros(7)))
    there = begin(robot, read(machine, poses(rng, 1, 2, robot), rng), {})
    elements = yielding(robot, np.array([[-1.0], [1.0]]) * np.ones(robot.n))
    there = replace(there, elements=elements, yields=np.zeros(len(sizes(elements))))
    signed = prior(there, (np.nan, np.nan), NOTHING).signed[layout(there).yields]
    names = [p.name for one in elements for p in one.parameters]

    assert [name for name, one in zip(names, signed, strict=True) if not one] == [
        name for name in names if name.startswith("dc_") or name.endswith("_xy")
    ]


def test_a_balancer_turns_the_shoulder_as_far_as_the_weight_does():
    """Amplitudes of a thousandth are hardly drawn to zero, and those of gears are."""
    robot, rng = load(RAIL), np.random.default_rng(0)
    machine = HeavyRobot(robot, np.zeros((8, 6)), Truth(np.zeros(7)))
    there = begin(robot, read(machine, poses(rng, 1, 2, robot), rng), {})
    laws = tuple(
        JointLaw(j, "periodic", "angle", j, k) for j, k in ((3, 1), (3, 2), (3, 3), (4, 1))
    )
    there = replace(there, laws=laws, amplitudes=np.zeros(8))
    std = prior(there, (np.nan, np.nan), NOTHING).std[layout(there).laws]

    assert (std[:4] >= 1e-3).all()
    assert std[4:] == pytest.approx(1.5e-4)


def with_elements():
    """The mechanism of a robot on a rail with everything that yields."""
    robot, rng = load(RAIL), np.random.default_rng(0)
    machine = HeavyRobot(robot, np.zeros((8, 6)), Truth(np.zeros(7)))
    there = begin(robot, read(machine, poses(rng, 1, 2, robot), rng), {})
    elements = yielding(robot, np.array([[-1.0], [1.0]]) * np.ones(robot.n))
    return replace(there, elements=elements, yields=np.zeros(len(sizes(elements))))


def test_bearings_links_and_rails_may_be_as_soft_as_gears():
    """Typical rails are a hundred times stiffer; gears and translations stay as usual."""
    there = with_elements()
    usually = prior(there, (np.nan, np.nan), NOTHING)
    at, gears = layout(there).yields, there.table.nominal_compliance[1:].max()
    names = [p.name for one in there.elements for p in one.parameters]
    grown = dict(zip(names, softer(usually, there).most[at] / usually.most[at], strict=True))

    assert dict(zip(names, softer(usually, there).most[at], strict=True))["c_roll"] >= gears
    kinds = ("c_roll", "c_pitch", "c_yaw", "c_tilt", "c_upper", "c_fore")
    assert {name for name, factor in grown.items() if factor > 1} == {
        name for name in names if name.startswith(kinds)
    }


def test_a_rail_may_be_longer_by_a_part_of_its_length():
    there = with_elements()
    law = JointLaw(1, "smooth", "angle", 1, 1.0, 3.0, 5.0)
    there = replace(there, laws=(law,), amplitudes=np.zeros(1))
    usually, at = prior(there, (np.nan, np.nan), NOTHING), layout(there).laws

    assert softer(usually, there).most[at] == pytest.approx(5e-4)
    assert usually.most[at] < 5e-4


def test_a_tool_that_nobody_states_is_as_usual():
    """Half the payload, a quarter of a metre beside the flange's axis or before it."""
    robot = load(RAIL)
    mean, std = (one[-1] for one in usual(robot))
    tool = 0.5 * robot.payload_kg * np.array([1.0, 0.25, 0.0, 0.25])

    assert (np.abs(tool) < 1.2 * std).all()
    assert mean[0] < std[0]
    assert (std < 1.2 * robot.payload_kg).all()


def test_a_wave_is_looked_for_in_what_waves_of_the_model_leave():
    q = np.linspace(-2.0, 2.0, 50)
    f = 1e-4 * np.cos(2 * q) + 3e-5 * np.sin(9 * q)
    constant = np.ones((50, 1))

    assert _share(f, constant, 9 * q[:, None]) < 0.2
    beside = np.column_stack([constant, np.cos(2 * q), np.sin(2 * q)])
    assert _share(f, beside, 9 * q[:, None]) == pytest.approx(1.0)


@pytest.mark.whole
def test_an_order_is_sharpened_beside_all_that_the_search_has_found():
    """Of a wave of 40 periods per turn, found as 39.7 while others were missing."""
    robot, rng = load(RAIL), np.random.default_rng(2)
    wave = Truth(np.zeros(7), turned=lambda q, tau: 2e-4 * np.sin(40 * q) * (np.arange(7) == 4))
    readings = read(HeavyRobot(robot, np.zeros((8, 6)), wave), poses(rng, 1, 12, robot), rng)
    law = JointLaw(5, "periodic", "angle", 5, 39.7)
    data = LawSearchData(
        readings, under_weight(len(readings)), (np.nan, np.nan), start(robot, 1e-5)
    )
    found = data.identify(
        begin(robot, readings, stated(rng)), ModelStructure(False, False, laws=(RAIL_LAW, law))
    )

    better, was = _of_shafts(data, found)

    assert better.mechanism.laws[0] == RAIL_LAW
    assert better.mechanism.laws[1].order == pytest.approx(40.0, abs=0.1)
    assert better.likely > found.likely
    assert len(was) == 2


def test_evidence_of_an_element_is_that_of_readings_with_it_over_without():
    robot, rng = load(RAIL), np.random.default_rng(1)
    truth = Truth(robot.nominal_compliance * (np.arange(7) > 0), tilt={2: (5e-8, 2e-8)})
    machine = HeavyRobot(robot, np.zeros((8, 6)), truth)
    readings = read(machine, poses(rng, 2, 6, robot), rng)
    elements = tuple(e for e in yielding(robot) if e.name == "joint_tilt")
    found = calibrate(
        begin(robot, readings, stated(rng)), readings, under_weight(len(readings)),
        ModelStructure(yields=elements), start(robot, 1e-5),
    )  # fmt: skip
    first = layout(found.mechanism).yields.start

    for k in range(len(elements)):
        at = np.arange(first + 2 * k, first + 2 * k + 2)
        std = found.known.std.copy()
        std[at] = FIXED_SIGMA
        without = solved(found.rows, found.mechanism, replace(found.known, std=std))
        gain = found.solution.evidence - without.evidence
        assert _evidence(found, at) == pytest.approx(gain, abs=1e-3)


@pytest.mark.parametrize(("play", "shoulder"), [(False, 1.0), (True, 1.0), (True, 0.05)])
def test_derivatives_by_weight_and_bearings_are_those_of_differences(play, shoulder):
    """Also where a shoulder is stiffer than the bound by which a balancer's torque is known."""
    robot = load(RAIL)
    machine = HeavyRobot(robot, np.zeros((8, 6)), Truth(np.zeros(7)))
    rng = np.random.default_rng(4)
    readings = read(machine, poses(rng, 2, 1 if play else 4, robot), rng)
    there = begin(robot, readings, stated(rng))
    elements = yielding(robot)
    there = replace(
        there, elements=elements, yields=sizes(elements), moments=usual(robot)[0], unknown=True,
        compliance=robot.nominal_compliance,
    )  # fmt: skip
    weights = under_weight(len(readings))
    if play:  # about where the flanks part
        tau, a = linearised(readings, there, weights).inputs.tau, readings.q[:, [2]] * [1, 2]
        waves = np.stack([np.cos(a), np.sin(a)], axis=2).reshape(len(a), 4)
        there = replace(there, compliance=robot.nominal_compliance * max(shoulder, 0.1))
        there = with_play(there, tau, np.linalg.lstsq(waves, -tau[:, 2])[0])
        there = replace(there, compliance=robot.nominal_compliance * shoulder)
    where, here = layout(there), linearised(readings, there, weights)

    of_laws = (where.laws, 1e-7) if play else (where.moments, 1.0)
    every = (where.compliance, 1e-10), (where.yields, 1e-10), of_laws
    for part, step in every if shoulder == 1 else every[:1]:
        for k in range(part.start, part.stop):
            x = there.at(where)
            x[k] += step
            moved = linearised(readings, there.moved(x, where), weights)
            slope = (here.y - moved.y) / step
            scale = max(np.abs(here.D[..., k]).max(), np.abs(slope).max(), 1e-300)
            if np.abs(slope).max() * step > 1e-9:  # below is rounding of places in metres
                assert np.abs(slope - here.D[..., k]).max() < 0.02 * scale


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("mistaken", "name", "where"),
    [
        (lambda robot: turned(robot, 2, 90.0, "alpha_deg"), "mounted_turned", "carriage"),
        (lambda robot: turned(robot, 4, 90.0), "joint_offset", 4),
        (lambda robot: counted_back(robot, 3), "sign_or_convention", 3),
        (lambda robot: turned(robot, 2, 90.0), "mounted_turned", "arm"),
        (lambda robot: turned(robot, 7, -90.0), "mounted_turned", "flange"),
        (lambda robot: counted_back(robot, 7), "sign_or_convention", 7),
    ],
)
def test_a_step_in_a_table_is_named_and_put_right(mistaken, name, where):
    robot = load("kr500_rail_kuka")
    rng = np.random.default_rng(7)
    c = robot.nominal_compliance.copy()
    machine = HeavyRobot(robot, errors_of_table(8, rng), Truth(c))
    readings = read(machine, poses(rng, 6, 10, robot), rng)
    file = mistaken(robot)

    right, (one,) = corrected(file, readings, under_weight(len(readings)), stated(rng))

    assert (one.name, one.where) == (name, where)
    assert one.after < 0.01 < one.before
    q = readings.q[:5]
    flanges = (configure(r, q).points(TOOL) for r in (right, robot))
    inside = [np.linalg.norm(at[:, 0] - at[:, 1], axis=1) for at in flanges]
    assert inside[0] == pytest.approx(inside[1], abs=1e-9)


def test_a_table_as_delivered_has_no_step():
    robot = load("kr500_rail_kuka")
    rng = np.random.default_rng(8)
    machine = HeavyRobot(
        robot, errors_of_table(8, rng, 1e-3, 1e-3), Truth(robot.nominal_compliance)
    )
    readings = read(machine, poses(rng, 6, 10, robot), rng)

    right, mistakes = corrected(robot, readings, under_weight(len(readings)), stated(rng))

    assert right is robot
    assert mistakes == ()


def weighing(robot, mass):
    """The robot with masses in its file, and unchanged centres of mass."""
    joints = tuple(
        joint.model_copy(update={"mass_kg": one, "centre_of_mass_m": tuple(centre.tolist())})
        for joint, one, centre in zip(robot.joints, mass.tolist(), CENTRE, strict=True)
    )
    return replace(robot, joints=joints)


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("wrong", [True, False])
def test_masses_of_the_file_are_believed_only_if_the_readings_agree(wrong):
    robot, rng = load("kr500_rail_kuka"), np.random.default_rng(9)
    truth = Truth(robot.nominal_compliance * [0, 1, 1.3, 0.8, 1.2, 0.9, 1.1])
    machine = HeavyRobot(robot, errors_of_table(8, rng), truth)
    readings = read(machine, poses(rng, 6, 20, robot), rng)
    # wrong by a factor for each link: a common one would be equivalent to other springs
    file = weighing(robot, MASS * ([1, 1, 0.4, 1.9, 1.7, 0.5, 1.5] if wrong else np.ones(7)))

    found = study(
        file, readings, under_weight(len(readings)), stated(rng), None, (np.nan, np.nan),
        np.random.default_rng(0),
    )  # fmt: skip

    causes = [cause for cause in found.causes if cause.name == "gravity_sag"]
    sag, most = [cause.form for cause in causes], torques(machine, readings.q)
    c, std = found.final.mechanism.compliance, np.sqrt(np.diag(found.final.solution.cov))
    pulled = [2, 3, 4, 5]  # A2 to A5; A1 carries no weight, A6 hardly any
    off = (c - truth.joints)[pulled] / std[layout(found.final.mechanism).compliance][pulled]
    assert sag == (["other masses"] if wrong else [])
    for one in (one for cause in causes for one in cause.amounts):
        joint = [joint.name for joint in robot.joints].index(one.name[2:])
        right = most[joint] * (truth.joints[joint] if one.unit == "rad" else 1.0)
        assert one.value == pytest.approx(right, abs=4 * one.std)
    assert np.abs(off).max() < 3.5


@pytest.mark.parametrize("better", [False, True])
def test_masses_that_a_balancer_hid_are_taken_with_a_search_of_their_own(monkeypatch, better):
    """Beside the laws found with masses of the file, other masses are tried once more."""
    plain = SimpleNamespace(wanted=ModelStructure(), mechanism=None)
    heavier = SimpleNamespace(wanted=ModelStructure(moments=True), mechanism=None)
    first, second = SimpleNamespace(found=plain), SimpleNamespace(found=heavier)
    data = SimpleNamespace(identify=lambda begun, wanted, earlier: SimpleNamespace(wanted=wanted))
    monkeypatch.setattr(of_study, "_otherwise", lambda *_: SimpleNamespace(found=heavier))
    monkeypatch.setattr(of_study, "with_laws", lambda *_: second)
    monkeypatch.setattr(of_study, "_weigh", lambda *_: "other" if better else None)

    base, whole, other = of_study._searched_otherwise(data, plain, first, (), {}, None)

    assert whole is (second if better else first)
    assert base.wanted.moments == better
    assert other == ("other" if better else None)
