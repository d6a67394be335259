"""Laws of single effects, each against numbers worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.machine.cell import Tool, load, paper_cell
from pipeline.machine.effect import Pulls
from pipeline.machine.effects import (
    base_moved,
    base_rotation,
    chain_offset,
    chain_weight,
    compensator,
    joint_hardening,
    joint_lost_motion,
    joint_offset,
    load_point_offset,
    rail_backlash,
    rail_stiffness_varies,
    scale,
    scale_hysteresis,
    target_moved,
    tool_flex,
)
from pipeline.machine.robot import configure
from pipeline.machine.robot import load as robot_of

ROBOT = robot_of("kr500_rail")
MIDDLE_M = (ROBOT.lower[0] + ROBOT.upper[0]) / 2
TOOL = Tool(
    load_point=np.array([0.1, 0.05, 0.4]),
    targets=np.array(["P1", "P2"], dtype=object),
    points=np.array([[0.2, 0.0, 0.1], [0.0, 0.2, 0.15]]),
)
Q = np.array([[3.0, 0.2, -1.1, 1.4, 0.6, -0.7, 0.3], [6.0, -0.8, -0.7, 1.1, -1.2, 0.9, 2.1]])
FORCE = np.array([[300.0, 0.0, -400.0], [0.0, 1200.0, 500.0]])  # of 500 N and 1300 N


def loaded(**changes):
    """Both pulls on the arm."""
    pulls = Pulls.at(Q, FORCE)
    fields = {name: getattr(pulls, name) for name in pulls.__dataclass_fields__}
    pulls = Pulls(**(fields | {"pose": np.array([4, 9])} | changes))
    return load(paper_cell(ROBOT, TOOL), pulls, np.zeros(ROBOT.n))


def only(effects, **names):
    """The one effect of this form, or at this joint."""
    (found,) = [one for one in effects if all(getattr(one, k) == v for k, v in names.items())]
    return found


@pytest.mark.parametrize(
    ("name", "value", "factors"),
    [
        ("scale_gain", 0.02, (1.02, 1.02)),
        ("scale_zero", 13.0, (513 / 500, 1313 / 1300)),
        ("scale_curvature", 0.1, (1.05, 1.13)),
    ],
)
def test_a_wrong_scale_lengthens_the_force(name, value, factors):
    """By 2 %; by 13 N; by a tenth per kilonewton."""
    effect = only(scale.effects(ROBOT), name=name)
    point, force = effect.wrench(loaded(), np.array([value]))

    assert force == pytest.approx(FORCE * np.array(factors)[:, None], rel=1e-12)
    assert point == pytest.approx(loaded().load_point)


@pytest.mark.parametrize(
    ("form", "factors"),
    [("by branch", (1.01, 0.99)), ("slackening", (1.0, 1.01)), ("by step", (1.0, 1.02))],
)
def test_a_load_cell_reads_otherwise_on_the_way_down(form, factors):
    """The first pull is tightened, the second, third of its pose, is slackened."""
    effect = only(scale_hysteresis.effects(ROBOT), form=form)
    here = loaded(branch=np.array([1.0, -1.0]), repeat=np.array([1, 3]))

    assert effect.wrench(here, np.array([0.01]))[1] == pytest.approx(
        FORCE * np.array(factors)[:, None], rel=1e-12
    )


def test_the_loop_closes_at_the_peak_of_its_pose():
    """Of two pulls of one pose the smaller, on the way down, lacks 800 N to the peak."""
    effect = only(scale_hysteresis.effects(ROBOT), form="loop")
    here = loaded(pose=np.array([1, 1]), branch=np.array([-1.0, -1.0]))
    found = effect.wrench(here, np.array([0.05]))[1]

    assert np.linalg.norm(found, axis=1) == pytest.approx([540.0, 1300.0], rel=1e-12)


def test_half_of_a_chain_hangs_on_the_robot():
    """60 N: 30 N downwards; with the scale at the robot the force has the size that is read."""
    amid, near = (
        only(chain_weight.effects(ROBOT), form=form).wrench(loaded(), np.array([60.0]))[1] - FORCE
        for form in ("scale amid the chain", "scale at the robot")
    )

    assert amid == pytest.approx(np.tile([0.0, 0.0, -30.0], (2, 1)), abs=1e-9)
    assert np.linalg.norm(FORCE + near, axis=1) == pytest.approx([500.0, 1300.0], rel=1e-12)
    # across the first pull, which falls by 4 in 5: 30 N times 3 in 5
    assert np.linalg.norm(np.cross(near[0], FORCE[0])) / 500.0 == pytest.approx(18.0, rel=1e-12)


def test_a_reflector_beside_the_chain_turns_the_force_and_keeps_its_size():
    """By the angle of an offset across it, to first order."""
    effect = chain_offset.effects(ROBOT)[0]
    across = np.cross(FORCE[0], [0.0, 1.0, 0.0])
    flange = configure(ROBOT, Q).flange_axes
    values = flange[0].T @ across / np.linalg.norm(across) * 1e-4
    found = effect.wrench(loaded(), values)[1][0]

    assert np.linalg.norm(found) == pytest.approx(500.0, rel=1e-12)
    cosine = np.linalg.norm(np.cross(found, FORCE[0])) / 500.0**2
    assert np.arcsin(cosine) == pytest.approx(1e-4, rel=1e-6)


def test_a_wrong_point_is_one_of_a_longer_tool():
    """Load point and targets, as the robot carries points that are stated elsewhere."""
    d = np.array([0.004, -0.003, 0.002])
    alone, followed, _ = load_point_offset.effects(ROBOT)
    at = configure(ROBOT, Q)

    assert alone.wrench(loaded(), d)[0] == pytest.approx(
        at.points((TOOL.load_point + d)[None])[:, 0], abs=1e-12
    )
    assert followed.points(loaded(), d) == pytest.approx(at.points(TOOL.points + d), abs=1e-12)
    largest = np.ptp(np.vstack([TOOL.load_point, TOOL.points]), axis=0).max()
    for one in load_point_offset.effects(ROBOT):  # coordinates of the tool may be exchanged
        assert all(parameter.upper > largest for parameter in one.parameters)


def test_a_turned_base_turns_readings_and_not_lengths():
    """To first order, as a rotation matrix of scipy."""
    e, points, time = np.array([2e-6, -1e-6, 3e-6]), loaded().points, np.zeros(2)
    observation = base_rotation.effects(ROBOT)[0].acts[1]
    turned = points.reshape(-1, 3) @ Rotation.from_rotvec(e).as_matrix().T

    assert observation.observe(loaded(), points, time, e).reshape(-1, 3) == pytest.approx(
        turned, abs=1e-9
    )


def test_what_moves_in_mid_campaign_moves_from_its_pose_on():
    """Pose 4 as before, pose 9 elsewhere: the whole robot, or one nest by a vector of the tool."""
    points, time = loaded().points, np.zeros(2)
    bumped = base_moved.since((4,), 9).observe(loaded(), points, time, np.r_[1e-3, 0, 0, 0, 0, 0])
    slipped = target_moved.since("P2", 1, (4,), 9)
    found = slipped.observe(loaded(), points, time, np.array([0.0, 0.0, 2e-3])) - points

    assert bumped - points == pytest.approx(
        np.stack([np.zeros((2, 3)), np.tile([1e-3, 0, 0], (2, 1))]), abs=1e-12
    )
    assert np.linalg.norm(found, axis=2) == pytest.approx(np.array([[0, 0], [0, 2e-3]]), abs=1e-12)


@pytest.mark.parametrize("joint", [1, 4])
def test_a_zero_that_changes_turns_its_joint_by_the_change(joint):
    """By the same number of the log the arm stands elsewhere from then on, as by a wrong zero."""
    q, change = np.tile(Q[0], (2, 1)), np.array([2e-3])
    pulls = replace(Pulls.at(q, FORCE), pose=np.array([4, 9]))
    always = only(joint_offset.effects(ROBOT), where=joint).geometry(ROBOT, pulls, change)
    late = joint_offset.since(ROBOT, joint, (4,), 9).geometry(ROBOT, pulls, change)

    assert (late[1] - late[0])[joint - 1] == pytest.approx(2e-3, rel=1e-9)
    assert late[1] == pytest.approx(q[1], abs=1e-15)
    assert late[1] - late[0] == pytest.approx(always[0] - q[0], abs=1e-15)


def test_a_gear_beyond_its_knee_gives_way_by_the_rest():
    """Rated torque is that of 1 mrad: none below a fifth of it, and odd in the torque."""
    c = 1.0 / ROBOT.joints[2].stiffness
    rated = 1e-3 / c
    tau = rated * np.array([[0.1], [1.2], [-1.2]])
    low = only(joint_hardening.effects(ROBOT), where=3, form="low knee").response(loaded(), tau)
    cubic = only(joint_hardening.effects(ROBOT), where=3, form="cubic").response(loaded(), 2 * tau)

    assert low[:, 0] == pytest.approx([0.0, rated, -rated], rel=1e-9)
    assert cubic[1:, 0] == pytest.approx([2.4**3 * rated, -(2.4**3) * rated], rel=1e-9)


def test_lost_motion_is_all_there_at_the_rated_torque():
    """And half of it the other way at once."""
    rated = 1e-3 * ROBOT.joints[2].stiffness
    one = only(joint_lost_motion.effects(ROBOT), where=3, form="narrow")

    assert one.response(loaded(), np.array([[rated], [-rated]]))[:, 0] == pytest.approx([1, -1])


def test_the_play_of_a_rail_is_run_through_from_the_side_where_it_rests():
    """After travel along +y friction leaves the carriage where a pull along +y has all of it."""
    ways = loaded(approach=np.array([1.0, 1.0]))
    hard = np.array([[1e5], [-1e5]])
    friction, brake, over = (
        only(rail_backlash.effects(ROBOT), form=form).response(ways, hard)[:, 0]
        for form in ("held by friction", "held by the brake", "held by friction until pulled over")
    )

    assert friction == pytest.approx([1.0, 0.0])
    assert brake == pytest.approx([0.0, -1.0])
    assert over == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize(
    ("form", "carriage_m", "times"),
    [
        ("steady", [MIDDLE_M, ROBOT.upper[0]], [[0.0], [1.0]]),
        ("supports every 6 m", [6.0, 9.0], [[1.0, 0.0], [-1.0, 0.0]]),
    ],
)
def test_a_drive_varies_along_its_rail_as_its_parameter_says(form, carriage_m, times):
    """By the slope from mid-rail to its end; by twice the amplitude within half a pitch."""
    one = only(rail_stiffness_varies.effects(ROBOT), form=form)

    pulls = loaded(q=np.column_stack([carriage_m, Q[:, 1:]]))
    moved = one.response(pulls, np.full((2, 1), 500.0))

    np.testing.assert_allclose(moved, 500.0 * np.array(times), atol=1e-9)


def test_a_strut_acts_by_the_angle_of_the_shoulder():
    """At a right angle all of the sine and nothing of the cosine."""
    one = only(compensator.effects(ROBOT), form="one harmonic")
    q = Q.copy()
    q[:, one.carrier[0] - 1] = np.pi / 2
    found = one.response(loaded(q=q), np.full((2, 1), 700.0))

    assert found == pytest.approx(np.tile([0.0, 700.0], (2, 1)), abs=1e-9)


def test_a_tool_turns_about_axes_through_its_flange():
    """A point of them stays where it is, one beside them moves by its distance."""
    screws = tool_flex.effects(ROBOT)[0].twists(loaded())
    at = configure(ROBOT, Q)
    for k, axis in enumerate(np.eye(3)[:2]):
        on, beside = (at.points(p[None])[:, 0] for p in (0.3 * axis, np.array([0.0, 0.0, 0.25])))
        turn, shift = screws[:, k, :3], screws[:, k, 3:]
        assert shift + np.cross(turn, on) == pytest.approx(np.zeros((2, 3)), abs=1e-12)
        moved = np.linalg.norm(shift + np.cross(turn, beside), axis=1)
        assert moved == pytest.approx([0.25, 0.25])
