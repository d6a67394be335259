"""The catalogue: complete, without duplicates, and every cause as described."""

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from bench import as_pinocchio as model
from bench.league.machine import Machine, Spring
from pipeline.diagnosis.isolability import rich_pulls, rich_tool, twins
from pipeline.machine import cell as forward
from pipeline.machine.cell import baseline
from pipeline.machine.effect import Compound, Elastic, Geometry, Noise
from pipeline.machine.effects import catalogue, table
from pipeline.machine.effects.joint_hysteresis import slid
from pipeline.machine.effects.nameless import competing, mounting, nameless, remembered
from pipeline.machine.robot import load, mdh
from pipeline.machine.robot.dh_parameters import dh_parameters
from pipeline.positions.positions_estimate import under_pulls

NAMES = [
    "rail_lateral",
    "rail_vertical",
    "rail_roll",
    "rail_pitch",
    "rail_yaw",
    "rail_backlash",
    "rail_stiffness_varies",
    "joint_tilt",
    "link_bending",
    "tool_flex",
    "joint_asymmetry",
    "joint_hardening",
    "joint_lost_motion",
    "joint_hysteresis",
    "compensator",
    "wrist_coupling",
    "scale_gain",
    "scale_zero",
    "scale_curvature",
    "scale_hysteresis",
    "chain_weight",
    "chain_offset",
    "joint_offset",
    "base_rotation",
    "tracker_drift",
    "gravity_sag",
    "load_point_offset",
    "tracker_noise",
    "force_noise",
]

KR500, FANUC = load("kr500_rail"), load("fanuc_r2000ic")
EFFECTS = catalogue(KR500)
BASES = [e for e in catalogue(FANUC) if e.name == "pedestal_tilt"]
DEEP = {"at its foot": 0.0, "half a metre deep": 0.5, "a metre deep": 1.0}
IDS = [f"{e.label}-{e.form}" for e in EFFECTS]


@functools.cache
def varied_pulls():
    """A KR500 under pulls as varied as possible."""
    rng = np.random.default_rng(1)
    cell = forward.paper_cell(KR500, rich_tool(rng))
    return forward.load(cell, rich_pulls(KR500, rng), KR500.nominal_compliance)


def is_linear(effect):
    """Whether one matrix turns torques of 1 N m to 1 MN m into the deflection of any pull."""
    if not isinstance(effect, Elastic):
        return False
    rng, loaded = np.random.default_rng(1), varied_pulls()
    shape = len(loaded.pulls), len(effect.carrier)
    tau = rng.choice([-1, 1], shape) * 10.0 ** rng.uniform(0, 6, shape)
    moved = effect.response(loaded, tau)
    constant = np.linalg.lstsq(tau, moved, rcond=None)[0]
    return bool(np.abs(moved - tau @ constant).max() <= 1e-9 * np.abs(moved).max())


LINEAR = [e for e in EFFECTS if is_linear(e)]
"""Linear springs of constant compliance."""


@pytest.fixture(scope="module")
def bench():
    """A KR500 with a tool at a general position, and pulls as varied as possible."""
    rng = np.random.default_rng(7)
    cell = forward.paper_cell(KR500, rich_tool(rng))
    return cell, rich_pulls(KR500, rng), KR500.nominal_compliance


def test_every_word_for_a_cause_has_its_effect():
    """The list of causes and the catalogue are equal, in the same order."""
    assert list(dict.fromkeys(e.name for e in EFFECTS)) == NAMES, (
        "write it into NAMES, and go on at step 3 of docs/add-an-effect.md"
    )


def test_a_robot_without_a_rail_has_no_rail_effects():
    """For a robot on the floor no cause is on a rail, and joints count from 1."""
    effects = catalogue(FANUC)

    assert not [e for e in effects if e.name.startswith("rail_")]
    others = [name for name in NAMES if not name.startswith("rail_")]
    assert ["pedestal_tilt", *others] == list(dict.fromkeys(e.name for e in effects))
    assert sorted({e.where for e in effects if e.name == "joint_tilt"}) == [1, 2, 3, 4, 5, 6]


def test_places_are_joint_numbers_of_the_robot():
    """Gears are at joints 2 to 7: joint 1 is the rail."""
    for name in ("joint_tilt", "joint_hardening", "joint_lost_motion", "joint_hysteresis"):
        assert sorted({e.where for e in EFFECTS if e.name == name}) == [2, 3, 4, 5, 6, 7]


def test_only_the_axis_in_the_base_has_its_bearing_elsewhere():
    """The frame of the shoulder does not define the bearing below it; other forms only cost."""
    tilts = [e for e in EFFECTS if e.name == "joint_tilt"]

    assert {e.where for e in tilts if e.form not in ("", "oblique")} == {2}
    assert len([e for e in tilts if e.where == 2]) == 6


@pytest.mark.parametrize("joint", [2, 4])
def test_a_bearing_that_is_soft_obliquely_moves_as_a_hinge_between_its_axes(bench, joint):
    """One hinge c at an angle w to x_j, of a machine of 4 x 4 matrices: c_x = c cos^2 w, ..."""
    cell, pulls, _ = bench
    w, c = np.deg2rad(65.0), 1e-9
    hinge = Spring("tilt", joint, (np.cos(w), np.sin(w), 0.0), False, lambda own, _: c * own)
    points, at = cell.tool.points, cell.tool.load_point
    moved, still = (
        Machine(KR500, springs).settle(pulls.q, points, at, pulls.force)[0]
        for springs in ([hinge], [replace(hinge, law=lambda own, _: 0 * own)])
    )
    form = "at its origin, oblique" if joint == 2 else "oblique"
    (effect,) = (e for e in EFFECTS if e.label == f"joint_tilt:{joint}" and e.form == form)
    values = c * np.array([np.cos(w) ** 2, np.sin(w) ** 2, np.cos(w) * np.sin(w)])

    made = forward.sensitivity(cell, pulls, np.zeros(7), [effect]) @ values

    largest = np.abs(made).max()
    np.testing.assert_allclose(moved - still, made, atol=1e-3 * largest)
    assert largest > 1e-7


@pytest.mark.parametrize(("one", "deep"), [*zip(BASES, DEEP.values(), strict=True)], ids=DEEP)
def test_a_base_tilts_as_hinges_below_the_foot_of_the_first_joint(one, deep):
    """Two hinges in a machine of 4 x 4 matrices, whose axes stay while joint 1 turns."""
    robot, soft = FANUC, {"x": 2e-9, "y": 3e-9}
    rng = np.random.default_rng(3)
    cell, pulls = forward.paper_cell(robot, rich_tool(rng)), rich_pulls(robot, rng)
    first, below = robot.placement[0], deep + robot.placement[0][2, 3]
    np.testing.assert_array_equal(first[:, 2], [0, 0, 1, 0])
    axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}
    moved, still = (
        Machine(
            robot,
            [
                Spring(a, 1, axes[a], False, lambda own, _, c=c: c * own, (0, 0, -below), True)
                for a, c in springs.items()
            ],
        ).settle(pulls.q, cell.tool.points, cell.tool.load_point, pulls.force)[0]
        for springs in (soft, dict.fromkeys(soft, 0.0))
    )
    columns = forward.sensitivity(cell, pulls, robot.nominal_compliance, [one])
    made = columns @ np.array([*soft.values()])

    largest = np.abs(made).max()
    np.testing.assert_allclose(moved - still, made, atol=1e-3 * largest)
    assert largest > 1e-5


def test_play_about_the_last_axis_may_be_the_clamp():
    """Only there the reader is told that the clamp of the effector moves in the same way."""
    told = {(e.name, e.where) for e in EFFECTS if "clamp" in e.needs}

    assert told == {("joint_lost_motion", 7), ("joint_hysteresis", 7)}


def test_labels_with_forms_are_unique():
    """No cause is in the catalogue twice in the same form."""
    assert len(set(IDS)) == len(IDS)


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_zero_means_absent(bench, effect):
    """With all parameters zero the cell behaves as without the effect."""
    cell, pulls, x = bench
    more = np.concatenate([x, np.zeros(len(effect.parameters))])

    with_it = forward.predict(cell.with_effects(effect), pulls, more)

    without = forward.predict(cell, pulls, x)
    np.testing.assert_allclose(with_it.displacement, without.displacement, atol=1e-15)


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_columns_are_the_derivative_of_the_simulator(bench, effect):
    """The column that tests for an effect is the derivative of its simulation (five points)."""
    cell, pulls, x = bench
    whole = cell.with_effects(effect)
    Z = forward.sensitivity(cell, pulls, x, [effect])

    for k, parameter in enumerate(effect.parameters):
        h = 0.02 * parameter.typical

        def at(step, k=k, h=h):
            values = np.concatenate([x, np.zeros(len(effect.parameters))])
            values[len(x) + k] = step * h
            return forward.predict(whole, pulls, values).displacement

        slope = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h)
        rounding = 4 * np.spacing(np.abs(pulls.q[:, 0]).max()) / (1e-3 * parameter.typical)
        atol = 1e-7 * np.abs(slope).max() + rounding
        np.testing.assert_allclose(Z[..., k], slope, rtol=0, atol=atol)


@pytest.mark.parametrize("effect", LINEAR, ids=lambda e: e.label)
def test_springs_keep_maxwells_reciprocity(bench, effect):
    """The effect of pull 1 along pull 2 equals the reverse: springs store energy."""
    cell, pulls, _ = bench
    rng = np.random.default_rng(3)
    more = rng.uniform(0.5, 2, len(effect.parameters)) * [p.typical for p in effect.parameters]
    if effect.form.endswith("oblique"):
        more[2] = 0.9 * np.sqrt(more[0] * more[1])  # more than the square root: no spring
    alone = replace(cell, effects=(effect,))
    other = replace(pulls, force=pulls.force[::-1])

    def moved(given):
        now = forward.predict(alone, given, more)
        return now.load_point - forward.load(alone, given, more).load_point

    there, back = moved(pulls), moved(other)
    work, work_back = np.sum(there * other.force, 1), np.sum(back * pulls.force, 1)
    rounding = 1e4 * np.spacing(20.0)  # [N m]: the load point is metres away from F_b
    np.testing.assert_allclose(work, work_back, rtol=1e-9, atol=rounding)
    if effect.name != "wrist_coupling":
        assert (np.sum(there * pulls.force, axis=1) > -1e-12).all()


SCREWS = {
    "rail_roll": lambda r, q: (np.array([0, q[0], 0]), [[0, 1, 0]]),
    "rail_pitch": lambda r, q: (np.array([0, q[0], 0]), [[1, 0, 0]]),
    "rail_yaw": lambda r, q: (np.array([0, q[0], 0]), [[0, 0, 1]]),
}

SEATS = {  # from Table I, as seen from the frames in front of the joint
    (2, "amid its offset"): lambda frames: frames[0].translation + np.array([0, 0, 0.524]),
    (2, "at the foot of its axis"): lambda frames: frames[0].translation,
}


def _frames(robot, q):
    """Joint frames by Pinocchio."""
    built = model.model(robot)
    data = built.createData()
    pin.forwardKinematics(built, data, q)
    return [data.oMi[j + 1] for j in range(robot.n)]


def _screw(effect, q):
    """Point and axes of a rotational effect, by hand from Pinocchio's frames."""
    if effect.name in SCREWS:
        return SCREWS[effect.name](KR500, q)
    frames = _frames(KR500, q)
    if effect.name == "joint_tilt":
        at = frames[effect.where - 1]
        return SEATS.get((effect.where, effect.form), lambda _: at.translation)(frames), (
            at.rotation.T[:2]
        )
    if effect.name == "tool_flex":
        return frames[-1].translation, frames[-1].rotation.T[:2]
    near, far = (2, 3) if effect.where == "upper_arm" else (3, 5)
    hinge = frames[near].rotation[:, 2]
    link = frames[far].translation - frames[near].translation
    side = np.cross(hinge, link)
    middle = frames[near].translation + link / 2
    return middle, [hinge, side / np.linalg.norm(side)]


@pytest.mark.parametrize(
    "effect",
    [
        e
        for e in LINEAR
        if (e.name in (*SCREWS, "joint_tilt", "tool_flex") and "oblique" not in e.form)
        or e.form == "hinge"
    ],
    ids=lambda e: e.label,
)
def test_rotations_turn_where_and_how_they_say(bench, effect):
    """It moves the reflectors as a rotation of the rest of the robot, by hand, does."""
    cell, pulls, _ = bench
    alone = replace(cell, effects=(effect,))
    for k, parameter in enumerate(effect.parameters):
        values = np.zeros(len(effect.parameters))
        values[k] = parameter.typical / 10  # so small that a rotation is nearly linear
        now = forward.predict(alone, pulls, values)
        before = forward.load(alone, pulls, values)
        for i in (0, 17, 53):
            at, axes = _screw(effect, pulls.q[i])
            axis = np.asarray(axes[k], float)
            moment = np.cross(before.load_point[i] - at, pulls.force[i]) @ axis
            turn = Rotation.from_rotvec(axis * values[k] * moment)
            moved = turn.apply(before.points[i] - at) + at - before.points[i]

            np.testing.assert_allclose(now.displacement[i], moved, atol=2e-7, rtol=5e-3)


@pytest.mark.parametrize(("where", "near", "far"), [("upper_arm", 2, 3), ("forearm", 3, 5)])
def test_a_bending_link_is_a_clamped_beam(bench, where, near, far):
    """A transverse end force F deflects it by F L^3 / 3 EI and turns it by F L^2 / 2 EI."""
    beam = next(e for e in EFFECTS if (e.where, e.form) == (where, "beam"))
    cell, pulls, x = bench
    loaded = forward.load(cell, pulls, x)
    start, end = (loaded.configuration.frame(j + 1)[1] for j in (near, far))
    hinge = loaded.configuration.frame(near + 1)[0][:, :, 2]
    link = end - start
    length = np.linalg.norm(link, axis=1)
    across = np.cross(hinge, link / length[:, None])
    loaded = replace(loaded, load_point=end, force=1000.0 * across, points=end[:, None])

    moved = forward.columns(beam, loaded)[:, 0, :, 0]
    turned = np.sum(beam.screws(loaded)[:, 0, :3] * hinge, axis=1)

    c = 1.0  # L / EI
    np.testing.assert_allclose(moved, 1000 * c * length[:, None] ** 2 / 3 * across, atol=1e-6)
    tau = np.sum(np.cross(end - (start + end) / 2, loaded.force) * hinge, axis=1)
    np.testing.assert_allclose(turned * tau, 1000 * c * length / 2, rtol=1e-9)


def test_known_links_add_the_same_work_in_either_order(bench):
    """Betti: torques work on the deflection of others as those do on theirs; of second order in c.

    Compliances of the joints differ by a factor of two hundred, so that none may stand for another.
    """
    cell, pulls, x = bench
    loaded, c = forward.load(cell, pulls, x), KR500.nominal_compliance
    rng = np.random.default_rng(1)
    moments, (one, other) = rng.uniform(10, 200, (7, 4)), rng.standard_normal((2, len(pulls), 7))
    known, soft = (under_pulls(k * c, moments, KR500.gravity) for k in (1, 2))
    there, back = known.response(loaded, one), known.response(loaded, other)

    work, same = np.sum(other * there, axis=1), np.sum(one * back, axis=1)
    np.testing.assert_allclose(work, same, rtol=1e-9, atol=1e-12 * np.abs(work).max())
    np.testing.assert_allclose(soft.response(loaded, one), 4 * there)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 0, -1), (0.6, 0, 0.8)])
def test_gravity_stiffens_as_the_potential_energy_says(bench, up):
    """Sag and its change under load are derivatives of the energy of two hanging masses.

    On a floor, on a ceiling and on a slope.
    """
    robot = KR500.under(-9.80665 * np.array(up, float))
    sag = next(e for e in catalogue(robot) if e.name == "gravity_sag")
    cell, pulls, x = bench
    masses = np.array([420.0, 310.0])
    geometry = next(f for f in sag.facets if isinstance(f, Geometry))
    elastic = next(f for f in sag.facets if isinstance(f, Elastic))

    def energy(q):
        frames = _frames(KR500, q)
        heights = [
            (frames[a].translation + frames[b].translation) @ up / 2 for a, b in ((2, 3), (3, 5))
        ]
        return 9.80665 * masses @ heights

    loaded = forward.load(cell, pulls, x)
    i, h = 11, 1e-4
    steps = np.eye(7) * h
    q = pulls.q[i]
    torque = np.array([-(energy(q + s) - energy(q - s)) / (2 * h) for s in steps])
    shift = geometry.geometry(KR500, pulls, masses)[i] - q
    np.testing.assert_allclose(shift, KR500.nominal_compliance * torque, rtol=1e-5, atol=1e-9)

    stiffening = np.array(
        [
            [
                -(energy(q + a + b) - energy(q + a - b) - energy(q - a + b) + energy(q - a - b))
                / (4 * h * h)
                for b in steps
            ]
            for a in steps
        ]
    )
    tau = np.einsum("ki,i->k", loaded.configuration.twists[i, :, 3:], pulls.force[i]) + np.einsum(
        "ki,i->k",
        loaded.configuration.twists[i, :, :3],
        np.cross(loaded.load_point[i], pulls.force[i]),
    )
    c = KR500.nominal_compliance
    joints = [j - 1 for j in elastic.carrier]
    response = elastic.response(loaded, np.tile(tau[joints], (len(pulls), 1)))[i]
    total = np.zeros(7)
    np.add.at(total, joints, response * masses[list(elastic.parameter_of)])
    expected = c * (stiffening[:, 1:4] @ (c * tau)[1:4])
    np.testing.assert_allclose(total[1:4], expected[1:4], rtol=2e-4, atol=1e-9)


def test_backlash_depends_on_where_the_carriage_came_from(bench):
    """Pulled onward after arriving along +y, the carriage takes up its play; pulled back, not."""
    cell, pulls, _ = bench
    held = next(e for e in EFFECTS if e.name == "rail_backlash" and e.form == "held by friction")
    force = np.array([[0, 2000.0, 0], [0, -2000.0, 0], [0, 2000.0, 0], [0, -2000.0, 0]])
    four = replace(
        pulls,
        **{
            f: getattr(pulls, f)[:4] for f in ("pose", "repeat", "q", "branch", "time", "time_zero")
        },
        force=force,
        approach=np.array([1.0, 1, -1, -1]),
    )

    moved = forward.predict(replace(cell, effects=(held,)), four, np.array([2e-4])).displacement

    np.testing.assert_allclose(
        moved[:, 0], [[0, 2e-4, 0], [0] * 3, [0] * 3, [0, -2e-4, 0]], atol=1e-9
    )


def test_a_carriage_held_by_friction_stays_unless_it_is_pulled_over(bench):
    """Pulled across the rail it stays; along it, it moves through the play in the free sense."""
    cell, pulls, _ = bench
    held = next(
        e
        for e in EFFECTS
        if e.name == "rail_backlash" and e.form == "held by friction until pulled over"
    )
    names = ("pose", "repeat", "q", "branch", "time", "time_zero")
    three = replace(
        pulls,
        **{name: getattr(pulls, name)[:3] for name in names},
        force=np.array([[2500.0, 0, 100], [0, 2500.0, 0], [0, -2500.0, 0]]),
        approach=np.ones(3),
    )

    moved = forward.predict(replace(cell, effects=(held,)), three, np.array([2e-4])).displacement

    np.testing.assert_allclose(moved[:, 0], [[0] * 3, [0, 2e-4, 0], [0] * 3], atol=1e-9)


def test_sliding_friction_follows_its_differential_equation(bench):
    """Dahl friction: the closed form with exponentials equals integration in small steps."""
    torque = np.array([1.2, 0.4, -0.9, 2.0, 0.3, 0.8])
    pose, repeat = np.array([1, 1, 1, 1, 2, 2]), np.array([3, 1, 2, 4, 1, 2])

    z = slid(pose, repeat, torque)[:, 0]

    expected = np.zeros(6)
    for run in ([1, 2, 0, 3], [4, 5]):
        state, last = 0.0, 0.0
        for i in run:
            for step in np.full(20_000, (torque[i] - last) / 20_000):
                state += (1 - state * np.sign(step)) * step
            expected[i], last = state, torque[i]
    np.testing.assert_allclose(z, expected, atol=2e-4)


@pytest.mark.parametrize("robot", [KR500, FANUC], ids=["rail", "base"])
def test_nothing_that_yields_or_is_loose_is_too_large_to_be_named(robot):
    """What cannot be negative has no upper bound, except masses that a robot of its size has."""
    yields = [
        p for e in catalogue(robot) if e.name != "gravity_sag" for p in e.parameters if p.lower == 0
    ]

    assert len(yields) > 30
    assert {p.name for p in yields if np.isfinite(p.upper)} == {"s_tracker", "s_force"}


@pytest.mark.parametrize("k", range(6))
def test_an_element_that_sits_elsewhere_is_one_with_screws_of_that_place(bench, k):
    """A bending link turned by 20 urad about an axis of its joint, or shifted by 20 um along it."""
    cell, pulls, x = bench
    link = next(e for e in EFFECTS if (e.label, e.form) == ("link_bending:forearm", "hinge"))
    part, by = np.array([1e-7, 5e-8]), 2e-5
    here = forward.load(cell, pulls, x)
    axes, origin = here.configuration.frame(4)
    at, own = link.screws(here), forward.columns(link, here) @ part
    lever = np.sqrt(np.mean(np.sum(forward.velocity(at, here.points) ** 2, axis=-1)))
    turn = Rotation.from_rotvec(by * (k < 3) * axes[:, :, k % 3])
    shift = by * lever * (k >= 3) * axes[:, :, k % 3]

    def there(loaded):
        omega = np.stack([turn.apply(at[:, v, :3]) for v in range(2)], axis=1)
        feet = [np.cross(at[:, v, :3], at[:, v, 3:]) for v in range(2)]  # nearest to the origin
        feet = np.stack([turn.apply(foot - origin) + origin + shift for foot in feet], axis=1)
        return np.concatenate([omega, np.cross(feet, omega)], axis=2)

    expected = forward.columns(replace(link, twists=there), here) @ part - own
    got = forward.seated_elsewhere(cell, pulls, x, link, part, by)[..., k]

    assert np.abs(got).max() > 1e-10
    np.testing.assert_allclose(got, expected, atol=1e-3 * np.abs(got).max())


def test_twins_are_found_by_rank():
    """Inseparable effects follow from ranks, not from a list."""
    found = twins(KR500)

    assert set(found.of_stiffness) == {"rail_yaw", "scale_gain"}
    assert set(found.pairs) == {("joint_tilt:5", "joint_tilt:6"), ("joint_tilt:7", "tool_flex")}
    assert set(found.unmoved) == {"joint_offset:1", "tracker_noise", "force_noise"}


def test_structural_twins_hold_to_rounding(bench):
    """The twins are equal to 1e-10 of their size on a rich design, for any stiffnesses."""
    cell, pulls, x = bench
    by = {e.label: e for e in reversed(EFFECTS)}  # in their first forms

    def left(effect, *rivals):
        B = [
            forward.jacobian(cell, pulls, x),
            *[forward.sensitivity(cell, pulls, x, [r]) for r in rivals],
        ]
        B = np.concatenate(B, axis=-1).reshape(-1, sum(b.shape[-1] for b in B))
        Z = forward.sensitivity(cell, pulls, x, [effect]).reshape(len(B), -1)
        Q = np.linalg.qr(B / np.linalg.norm(B, axis=0))[0]
        rest = Z - Q @ (Q.T @ Z)
        return np.linalg.norm(rest - Q @ (Q.T @ rest)) / np.linalg.norm(Z)

    assert left(by["rail_yaw"]) < 1e-10
    assert left(by["scale_gain"]) < 1e-10
    assert left(by["joint_tilt:5"], by["joint_tilt:6"]) < 1e-10
    assert left(by["joint_tilt:7"], by["tool_flex"]) < 1e-10
    assert left(by["joint_tilt:5"]) > 1e-3


@pytest.mark.parametrize("effect", [*EFFECTS, *BASES], ids=[*IDS, *DEEP])
def test_every_effect_tells_what_it_is(effect):
    """Each has a signature, what settles it, a source, bounds around zero, described parameters."""
    assert effect.signature
    assert effect.needs
    assert effect.source
    for parameter in effect.parameters:
        assert parameter.upper > 0
        # a compliance, a fraction of a force, or either sign alike
        assert parameter.lower in (0, -1, -parameter.upper)
        assert parameter.typical < parameter.upper
        said = parameter.meaning.format(joint="A2")
        assert said
        assert parameter.name not in said
    assert isinstance(effect, Noise) or effect.facets
    assert not isinstance(effect, Compound) or len(effect.facets) > 1


def moved(robot, effects):
    """Columns of effects under pulls as varied as possible, shape (rows, parameters)."""
    rng = np.random.default_rng(5)
    cell, pulls = forward.paper_cell(robot, rich_tool(rng)), rich_pulls(robot, rng)
    Z = forward.sensitivity(cell, pulls, robot.nominal_compliance, effects)
    return Z.reshape(-1, Z.shape[-1])


def beyond(columns, base):
    """Residual of each column after a fit of the base, relative to the column."""
    Q = np.linalg.qr(base / np.linalg.norm(base, axis=0))[0]
    return np.linalg.norm(columns - Q @ (Q.T @ columns), axis=0) / np.linalg.norm(columns, axis=0)


@pytest.mark.parametrize("robot", [KR500, FANUC], ids=["kr500_rail", "fanuc_r2000ic"])
def test_what_competes_without_a_name_is_no_stiffness_and_no_cause(robot):
    """Every parameter has an effect outside the span of joint springs, under its own label."""
    springs = moved(robot, baseline(robot))

    every = competing(robot)
    for strange in every:
        assert (beyond(moved(robot, [strange]), springs) > 1e-3).all(), strange.label
    labels = [effect.label for effect in (*every, *catalogue(robot))]
    assert len(set(labels)) == len(every) + len({e.label for e in catalogue(robot)})


@pytest.mark.parametrize("joint", [3, 4])
@pytest.mark.parametrize("power", [1.3, 1.7])
def test_a_tilt_that_grows_faster_than_its_moment_is_no_gear(joint, power):
    """A linear tilt and its rival leave little of it, tilt and all nonlinear gears much."""
    tilt = next(e for e in EFFECTS if e.label == f"joint_tilt:{joint}" and not e.form)

    def response(loaded, tau):
        return np.sign(tau) * np.abs(tau) ** power

    columns = moved(KR500, [replace(tilt, response=response)])
    known = np.hstack([moved(KR500, baseline(KR500)), moved(KR500, [tilt])])
    gears = moved(KR500, [e for e in EFFECTS if e.name == "joint_hardening"])
    rival = moved(KR500, [e for e in competing(KR500) if e.label == f"tilt_by_moment:{joint}"])

    left = beyond(columns, np.hstack([known, rival]))
    assert (left < 0.3 * beyond(columns, np.hstack([known, gears]))).all()


def test_a_joint_that_remembers_is_what_a_relaxing_element_does():
    """Small steps of T dm/dt = share - m, load held until the next pull, none between poses."""
    rng = np.random.default_rng(8)
    pulls = rich_pulls(KR500, rng)
    m, fades = len(pulls), 300.0
    pulls = replace(
        pulls,
        pose=np.arange(m) // 3,
        repeat=np.arange(m) % 3 + 1,
        time=np.cumsum(rng.uniform(30.0, 200.0, m)),
    )
    shuffled = rng.permutation(m)
    torque = rng.uniform(-900.0, 900.0, (m, 2))
    share = np.abs(torque) / np.abs(torque).max(axis=0)
    now, expected = np.zeros(2), [np.zeros(2)]
    for i in range(1, m):
        dt = (pulls.time[i] - pulls.time[i - 1]) / 2000
        drive = share[i - 1] * (pulls.pose[i] == pulls.pose[i - 1])
        for _ in range(2000):
            now = now + dt / fades * (drive - now)
        expected.append(now)

    assert remembered(pulls, torque, fades) == pytest.approx(np.array(expected), abs=1e-3)
    mixed = remembered(pulls.part(shuffled), torque[shuffled], fades)
    assert mixed == pytest.approx(np.array(expected)[shuffled], abs=1e-3)
    untimed = replace(pulls, time=np.full(m, np.nan))
    every_minute = replace(pulls, time=60.0 * np.arange(m))
    assert remembered(untimed, torque, fades) == pytest.approx(
        remembered(every_minute, torque, fades)
    )


def test_an_effector_turned_on_its_flange_is_a_tool_with_turned_points(bench):
    """About an oblique axis, by a large angle: equal to a cell with the rotated tool."""
    cell, pulls, x = bench
    turn = np.array([0.3, -0.2, 0.4])
    points = (
        np.vstack([cell.tool.load_point, cell.tool.points])
        @ Rotation.from_rotvec(turn).as_matrix().T
    )
    other = replace(cell, tool=replace(cell.tool, load_point=points[0], points=points[1:]))
    effect = next(e for e in mounting(KR500) if e.name == "effector_turned")

    seen = forward.predict(cell.with_effects(effect), pulls, np.append(x, turn)).displacement

    assert seen == pytest.approx(forward.predict(other, pulls, x).displacement, abs=1e-12)


def test_a_load_on_the_forearm_does_not_turn_with_the_wrist(bench):
    """The lever is fixed in the frame of joint 5 while joints 6 and 7 rotate."""
    cell, pulls, x = bench
    effect = next(e for e in mounting(KR500) if e.name == "load_on_the_forearm")
    loaded = forward.load(cell, pulls, x)
    frame = pin_frame(KR500, pulls.q, 5)
    shift = np.array([0.1, 0.2, -0.3])

    acts, force = effect.wrench(loaded, shift)

    assert acts - loaded.load_point == pytest.approx(frame @ shift, abs=1e-12)
    assert force is loaded.force


def pin_frame(robot, q, joint):
    """Rotation of a joint's frame by Pinocchio, shape (m, 3, 3)."""
    own = model.model(robot)
    data, out = own.createData(), []
    for one in q:
        pin.forwardKinematics(own, data, one)
        out.append(data.oMi[joint].rotation.copy())
    return np.array(out)


def test_a_hinge_between_parallel_joints_moves_as_their_cross_talk():
    """(s3 + s4)(t3 + t4) / 4 contains s3 t4 + s4 t3: in its plane such a link has no signature."""
    springs = moved(KR500, baseline(KR500))
    hinge = next(e for e in EFFECTS if (e.where, e.form) == ("upper_arm", "hinge"))
    talk = [e for e in nameless(KR500) if e.label == "cross_talk:3-4"]
    in_plane, out_of_plane = moved(KR500, [hinge]).T

    assert beyond(in_plane[:, None], np.hstack([springs, moved(KR500, talk)])) < 1e-9
    assert beyond(out_of_plane[:, None], np.hstack([springs, moved(KR500, talk)])) > 0.1


@pytest.mark.parametrize(
    ("form", "at", "shown"),
    [
        ("scale at the robot", 0.0, slice(None)),
        ("scale amid the chain", 0.5, slice(None)),
        ("scale at the anchor", 1.0, slice(None)),
        ("scale at the anchor, reflectors near the robot", 1.0, slice(100, 300)),
    ],
)
@pytest.mark.parametrize("up", [(0, 0, 1), (0, -1, 0)])
@pytest.mark.parametrize(("weight", "pull", "off"), [(60.0, 3000.0, 0.05), (450.0, 1500.0, 10.0)])
def test_a_hanging_chain_pulls_as_statics_says(bench, form, at, shown, up, weight, pull, off):
    """A rope of many heavy links hangs in equilibrium, with a scale somewhere along it.

    Its direction is that from end to end of the links between two reflectors.
    """
    robot = KR500.under(-9.80665 * np.array(up, float))
    heavy = next(e for e in catalogue(robot) if (e.name, e.form) == ("chain_weight", form))
    cell, pulls, x = bench
    loaded = forward.load(cell, pulls, x)
    size = np.linalg.norm(loaded.force, axis=1)
    strong = loaded.force[:, None] * (pull / size)[:, None, None]  # at the robot, shape (m, 1, 3)

    links = np.arange(0.5, 1000) / 1000
    tension = (strong + weight * links[:, None] * up)[:, shown]
    chord = np.mean(tension / np.linalg.norm(tension, axis=2, keepdims=True), axis=1)
    read = np.linalg.norm(strong[:, 0] + weight * at * np.array(up), axis=1)
    u = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    _, acts = heavy.wrench(replace(loaded, force=read[:, None] * u), np.array([weight]))

    np.testing.assert_allclose(acts, strong[:, 0], atol=off)


def test_the_guide_shows_a_real_effect():
    """The example in docs/add-an-effect.md is identical to the file of an effect."""
    root = Path(__file__).parents[2]
    shown = (root / "docs" / "add-an-effect.md").read_text("utf-8").split("```python\n")[1]
    file = root / "pipeline" / "machine" / "effects" / "tool_flex.py"

    assert shown.split("```")[0] == file.read_text("utf-8")


def test_the_scale_remembers_how_the_force_was_reached(bench):
    """By hand: rotation of one joint under the true force over that under the reading."""
    cell, pulls, x = bench
    repeat = np.arange(len(pulls)) % 4 + 1
    branch = np.where(repeat == 4, -1.0, 1.0)
    size = np.array([500.0, 1000.0, 2000.0, 800.0])[repeat - 1]
    along = pulls.force / np.linalg.norm(pulls.force, axis=1, keepdims=True)
    pose = np.arange(len(pulls)) // 4
    first = pose * 4  # all pulls of a pose equal except for their size
    four = replace(
        pulls,
        q=pulls.q[first],
        force=size[:, None] * along[first],
        pose=pose,
        repeat=repeat,
        branch=branch,
    )
    true = {
        "by branch": size * (1 + 0.02 * branch),
        "slackening": np.where(branch < 0, 1.02 * size, size),
        "loop": np.where(branch < 0, size + 0.02 * (2000.0 - size), size),
        "constant": size + 0.02 * branch,
        "by step": size * (1 + 0.02 * (repeat - 1)),
    }
    still = forward.predict(cell, four, x).displacement

    for effect in (e for e in EFFECTS if e.name == "scale_hysteresis"):
        values = np.append(x, 0.02)
        now = forward.predict(cell.with_effects(effect), four, values).displacement

        factor = true.pop(effect.form) / size
        np.testing.assert_allclose(now, still * factor[:, None, None], rtol=1e-9, atol=1e-15)
    assert not true


def test_what_is_added_to_a_statement_is_its_correction_and_no_error(bench):
    """VIM 2.16: error = stated minus true, but the parameters p are true = stated + p.

    A scale that reads 30 N too much on a pull of 1000 N reads 1030 N, and f_0 is -30 N.
    """
    robot = load("kr500_rail")
    every = [p.meaning for effect in EFFECTS for p in effect.parameters]
    every += [one.meaning for one in dh_parameters(robot)]
    assert not [one for one in every if one.startswith("error")]
    assert sum(one.startswith("correction") for one in every) > 20

    cell, pulls, x = bench
    size = np.linalg.norm(pulls.force, axis=1, keepdims=True)
    read = replace(pulls, force=pulls.force * (1 + 30.0 / size))
    zero = next(one for one in EFFECTS if one.name == "scale_zero")
    with_it = forward.predict(cell.with_effects(zero), read, np.append(x, -30.0))
    true = forward.predict(cell, pulls, x)
    np.testing.assert_allclose(with_it.displacement, true.displacement, rtol=1e-9)
    assert zero.parameters[0].meaning == "correction of the scale's zero"


@pytest.mark.parametrize("name", ["kr500_rail", "ur10", "fanuc_r2000ic"])
def test_an_entry_of_the_table_may_be_wrong_either_way(name):
    """By as much up as down, whatever its letter and joint."""
    found = table.effects(load(name))

    assert len(found) > 6
    for effect in found:
        (entry,) = effect.parameters
        assert -entry.lower == entry.upper > 100 * abs(entry.typical)


def test_a_link_of_no_length_does_not_bend():
    """Elbow on the shoulder's axis: every column of the catalogue is still a number."""
    text = (Path(mdh.__file__).parent / "kr500_rail.toml").read_text("utf-8")
    robot = mdh.parse(text.replace("d_m = 1.3\n", "d_m = 0\n"), "short.toml")
    few = [one for one in catalogue(robot) if one.name == "link_bending"]
    rng = np.random.default_rng(5)
    short = forward.paper_cell(robot, rich_tool(rng))
    pulls = rich_pulls(robot, rng)

    assert {one.where for one in few} == {"forearm"}
    for one in catalogue(robot):
        assert np.isfinite(forward.sensitivity(short, pulls, robot.nominal_compliance, [one])).all()
