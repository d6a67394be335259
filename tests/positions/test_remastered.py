"""A zero that changed during a campaign: planted in the joint log only."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_case import asked, small

from pipeline.answer.contract import Which
from pipeline.diagnosis.causes import of_base, of_motion
from pipeline.diagnosis.facts import Drift
from pipeline.diagnosis.unloaded_geometry import corrected, from_unloaded
from pipeline.machine.effects import catalogue, tracker_drift
from pipeline.machine.robot import configure
from pipeline.machine.robot.dh_parameters import changed, dh_parameters
from pipeline.positions.table_entries import estimated
from pipeline.reduction.course import Course
from pipeline.reduction.register import register
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory


@cache
def clean(seed, count=12, hidden=()):
    return small(seed, poses={"count": count}, hidden={"effects": list(hidden)})


def relogged(case, joint, pose, size):
    """Before a pose the log reads `size` too much; from then on it is right."""
    column = case.joint_columns[joint - 1]
    off = np.where(case.joints["pose"] < pose, size, 0.0)
    return replace(case, joints=case.joints.assign(**{column: case.joints[column] + off}))


def stood(case):
    made = asked(case)
    return made, from_unloaded(made.cell, made.reduced.data, 1.0, catalogue(case.robot))


@pytest.mark.whole
@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("seed", "joint", "pose", "size"),
    [(3, 3, 7, 1.5e-3), (4, 4, 5, -1e-3), (5, 2, 9, 2e-3), (6, 6, 6, -3e-3), (3, 5, 4, 1e-3)],
)
def test_a_changed_zero_is_named_with_joint_pose_and_size(seed, joint, pose, size):
    """Alone; left-out poses are predicted with it, and the log of earlier poses is corrected."""
    made, found = stood(relogged(clean(seed), joint, pose, size))

    (one,) = found.causes
    assert (one.effect.name, one.effect.where) == ("joint_offset", joint)
    assert one.effect.form == f"since pose {pose}"
    assert one.value[0] == pytest.approx(size, abs=4 * one.std[0])
    assert one.std[0] < abs(size) / 5
    assert found.believed
    assert found.gain.ci95[0] > 0
    data = made.reduced.data
    moved = corrected(made.cell, data, found)[1].pulls.q - data.pulls.q
    before = data.pulls.pose < pose
    assert moved[before, joint - 1] == pytest.approx(-one.value[0])
    moved[before, joint - 1] = 0.0
    assert np.abs(moved).max() < 1e-9


def bumped(case, pose, shift_m, turn_rad):
    """From a pose on the effector is read displaced, as by a foot or tripod that gave way."""
    rows, axis = case.readings, np.array([2.0, -1.0, 2.0]) / 3
    later = (rows["pose"] >= pose).to_numpy()
    xyz = rows[["x_m", "y_m", "z_m"]].to_numpy(float)
    turned = Rotation.from_rotvec(turn_rad * axis).apply(xyz[later])
    xyz[later] = turned + shift_m * np.array([1.0, 2.0, -2.0]) / 3
    moved = dict(zip(["x_m", "y_m", "z_m"], xyz.T, strict=True))
    return replace(case, readings=rows.assign(**moved))


@pytest.mark.whole
@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("seed", "pose", "shift_m", "turn_rad"),
    [
        (3, 7, 2e-3, 5e-4),
        (4, 3, 2e-3, -1e-3),
        (4, 5, 5e-4, -1e-3),
        (5, 9, 2e-2, 4e-3),
        (6, 6, 3e-3, 0.0),
        (5, 11, 3e-3, 1e-3),
    ],
)
def test_a_robot_that_was_bumped_is_named_with_its_pose(seed, pose, shift_m, turn_rad):
    """Under its own name, neither as a joint zero nor as a rotation of the base frame."""
    _, found = stood(bumped(clean(seed), pose, shift_m, turn_rad))

    (one,) = found.causes
    assert (one.effect.name, one.effect.form) == ("base_moved", f"since pose {pose}")
    assert np.linalg.norm(one.value[3:]) == pytest.approx(abs(turn_rad), abs=5e-5)
    assert found.believed
    assert found.left_m < 0.2 * found.miss_m


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(("seed", "rate_m"), [(3, 2.5e-5), (4, 1e-4), (5, 5e-5)])
def test_a_tracker_that_creeps_did_not_change_once(seed, rate_m):
    """All readings of the effector are displaced in proportion to the number of the pose."""
    case = clean(seed)
    rows = case.readings.copy()
    far = rate_m * rows["pose"].fillna(0).to_numpy(float)[:, None]
    rows[["x_m", "y_m", "z_m"]] += far * np.array([3.0, -2.0, 1.0]) / 14**0.5
    _, found = stood(replace(case, readings=rows))

    assert not any(one.effect.since for one in found.causes)


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(("seed", "pose", "size_m"), [(3, 7, 1.5e-3), (4, 5, 2e-3)])
def test_a_reflector_that_slipped_is_named_with_its_pose(seed, pose, size_m):
    """By its own name, and not as the zero of the last joint, which moves the others, too."""
    case = clean(seed)
    rows, name = case.readings.copy(), case.settings.measured[1]
    here = case.joints["pose"].to_numpy(int)
    turned = configure(case.robot, case.q(here)).flange_axes @ (size_m * np.array([2, -1, 2]) / 3)
    R = register(case.settings, case.readings).R
    moved = dict(zip(here.tolist(), turned @ R, strict=True))
    for k in rows.index[(rows["target"] == name) & (rows["pose"] >= pose)]:
        rows.loc[k, ["x_m", "y_m", "z_m"]] += moved[int(rows.loc[k, "pose"])]
    _, found = stood(replace(case, readings=rows))

    (one,) = found.causes
    said = one.effect.name, one.effect.where, one.effect.form
    assert said == ("target_moved", name, f"since pose {pose}")
    assert one.value == pytest.approx(size_m * np.array([2, -1, 2]) / 3, abs=2e-4)


@pytest.mark.whole
def test_what_positions_leave_unsure_is_no_change():
    """A bed that may be bent behind some place moves all poses there alike: neighbours, not time.

    Planted bug: without the columns of what positions leave unsure, the robot was moved.
    """
    made = asked(clean(3))
    data = made.reduced.data
    late = data.pulls.q[data.pulls.pose >= 7, 0]  # no other pose stands at these places

    def unsure(q, names):
        behind = np.isin(q[:, :1], late)
        lever = configure(made.case.robot, q).flange_origin
        return (5e-4 * behind * np.cross([1.0, 0.0, 0.0], lever))[:, :, None]

    bent = unsure(data.pulls.q[data.pull], None)[:, :, 0]
    read = replace(data, unloaded=data.unloaded + 1.3 * bent)
    known = replace(read, stance=SimpleNamespace(errors=unsure))
    silent, found = (
        from_unloaded(made.cell, one, 1.0, catalogue(made.case.robot)) for one in (read, known)
    )

    assert silent.causes
    assert all("since pose 7" in one.effect.form for one in silent.causes)
    assert not found.causes
    assert found.left_m < 0.3 * silent.miss_m


@pytest.mark.whole
def test_a_tracker_that_was_bumped_is_one_cause_and_a_drift_another():
    """A shift of both base and effector is reported once: rounds distinguish drift from knock."""
    case = bumped(clean(3), 7, 2e-3, 5e-4)
    found, law = stood(case)[1], tracker_drift.effects(case.robot)[0]
    size = np.zeros(3), np.ones(3), np.zeros(3), np.ones(3)
    knock = Drift(law, *size, 2e-3, 4.0, 1e-9, named=False, undecided=False, visible=1.0)
    undecided, drifts = (replace(knock, named=True, undecided=one) for one in (True, False))

    assert [one.effect.name for one in of_motion(found, undecided)[0]] == ["base_moved"]
    assert not of_base(of_motion(found, undecided)[1], ())
    assert of_motion(found, replace(knock, knocked=("a", "b")))[1].knocked is None
    assert not of_motion(found, drifts)[0]
    assert of_base(of_motion(found, drifts)[1], ())


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(12))
def test_no_zero_changed_in_a_clean_campaign(seed):
    """Nor in one with a wrong zero from the beginning."""
    hidden = () if seed % 2 else ("joint_offset:3=2x",)
    _, found = stood(clean(seed, hidden=hidden))
    assert [one.effect.label for one in found.causes] == [one.split("=")[0] for one in hidden]
    assert all(not one.effect.form for one in found.causes)


@pytest.mark.whole
def test_a_changed_zero_is_found_beside_one_that_was_wrong_from_the_beginning():
    """Both by name: the DH parameter, and the change."""
    case = relogged(clean(3, hidden=("joint_offset:3=4x",)), 5, 6, 2e-3)
    _, found = stood(case)
    said = {(one.effect.where, one.effect.form) for one in found.causes}
    assert said == {(3, ""), (5, "since pose 6")}


@pytest.mark.whole
def test_what_is_visible_holds_for_a_cause_that_was_found_beside_a_change():
    """Beside a change, a DH parameter is determined as its standard uncertainty states."""
    case = bumped(clean(3), 6, 2e-3, 5e-4)
    entry = next(one for one in dh_parameters(case.robot) if one.label == "link_length:4")
    longer = changed(case.robot, (entry,), np.array([8e-3]))
    _, found = stood(replace(case, robot=longer))
    (one,) = [one for one in found.causes if one.effect.name != "base_moved"]
    visible = found.visible[one.effect.label] * one.effect.parameters[0].typical

    assert len(found.causes) == 2
    assert one.effect.name.startswith("link")
    assert one.std[0] < visible < abs(one.value[0])


@pytest.mark.whole
def test_a_joint_that_slipped_is_one_cause_and_another_zero_of_the_robot_as_it_is_now():
    """The zero in the table is wrong for the robot as it is now, and was right before."""
    before = relogged(clean(3), 3, 7, 2e-3)
    column = before.joint_columns[2]
    case = replace(before, joints=before.joints.assign(**{column: before.joints[column] - 2e-3}))
    made, found = stood(case)
    (one,) = found.causes
    assert (one.effect.where, one.effect.form) == (3, "since pose 7")
    assert one.value[0] == pytest.approx(-2e-3, abs=4 * one.std[0])

    cell, data = corrected(made.cell, made.reduced.data, found)
    given, since = made.reduced.data.pulls.q, data.pulls.pose >= 7
    q = np.zeros((1, made.cell.robot.n))
    other = q + 2e-3 * np.eye(made.cell.robot.n)[2]
    assert configure(cell.robot, q).flange_origin == pytest.approx(
        configure(made.cell.robot, other).flange_origin, abs=2e-4
    )
    stated = {(one.name, one.where): one for one in estimated(found)[0]}[("joint_offset", 3)]
    assert stated.value - stated.nominal == pytest.approx(2e-3, abs=2e-4)
    assert data.pulls.q[since] == pytest.approx(given[since], abs=1e-9)
    assert (given - data.pulls.q)[~since, 2] == pytest.approx(-one.value[0], abs=1e-9)


@pytest.mark.whole
@pytest.mark.parametrize("joint", [1, 4])
def test_the_first_joint_that_slipped_is_no_robot_that_was_moved(joint):
    """A turn of the first axis moves the robot as its foot might, by one number in place of six."""
    case = clean(4)
    column = case.joint_columns[joint]
    off = np.where(case.joints["pose"] >= 6, 2e-3, 0.0)
    _, found = stood(
        replace(case, joints=case.joints.assign(**{column: case.joints[column] + off}))
    )
    assert [(one.effect.name, one.effect.where) for one in found.causes] == [
        ("joint_offset", joint + 1)
    ]


@pytest.mark.whole
def test_the_order_of_time_counts_and_not_that_of_numbers():
    """Poses numbered in reverse: what counts is which were read later."""
    case = clean(4)
    late = relogged(case, 3, 7, 2e-3)  # as read: the log is right from its seventh pose on

    def turned(table):
        return table.assign(pose=13 - table["pose"])

    renumbered = replace(
        late,
        readings=turned(late.readings),
        joints=turned(late.joints).sort_values("pose", ignore_index=True),
        loads=turned(late.loads),
    )
    (one,) = stood(renumbered)[1].causes
    assert one.effect.form == "since pose 6"
    assert one.value[0] == pytest.approx(2e-3, abs=4 * one.std[0])


@pytest.mark.whole
def test_a_campaign_in_which_a_joint_was_mastered_anew_is_explained():
    """From its files: the joint log has another zero up to pose 7."""
    plan = Plan(name="anew", seed=11, poses={"count": 12}, pulls={"steps_n": [1500.0, 3000.0]})
    files = dict(simulate(plan).files)
    head, *rows = files["joints.csv"].decode().splitlines()
    column = head.split(",").index(next(one for one in head.split(",") if "theta4" in one))
    out = [head]
    for row in rows:
        cells = row.split(",")
        if int(cells[0]) < 8:
            cells[column] = f"{float(cells[column]) + np.degrees(1.5e-3):.6f}"
        out.append(",".join(cells))
    files["joints.csv"] = ("\n".join(out) + "\n").encode()

    said = campaign_answer("anew", in_memory(files)).answer

    assert str(said.diagnosis.verdict) == "explained"
    (one,) = [cause for cause in said.diagnosis.causes if cause.name == "joint_offset"]
    assert (one.where, one.form) == (4, "since pose 8")
    assert "changed at pose 8" in " ".join(said.verdict_sentence)
    assert said.recommended.model in {Which.EXTENDED, Which.JOINT_SPRINGS}


def grown_by(data, growth):
    """A course of growth from the first zero to the last, of a base frame 10 m long."""
    ends = np.array([0.0, 1.0])
    return Course(
        groups=("begin", "end"),
        begun=ends * data.pulls.time_zero.max(),
        centre=np.array([0.0, 4.0, 0.0]),
        shift=np.zeros((2, 3)),
        gradient=ends[:, None, None] * growth * np.eye(3),
        growth=ends * growth,
        std=np.zeros(2),
        length_m=10.0,
        p_value=0.0,
        std_m=0.0,
        unknowns=1,
    )


def test_a_robot_that_stays_while_its_base_grows_about_any_point_is_one_of_the_ways():
    """It moves by -g a (p - p_A) in the corrected frame, p_A what of the base stayed in place."""
    data = asked(clean(3)).reduced.data
    course, late = grown_by(data, 8e-5), data.pulls.time_zero.max()
    points, stays = np.array([[1.0, 2.0, 3.0], [-2.0, 9.0, 0.5]]), np.array([0.3, -3.0, 0.1])

    ways = course.parting(points, np.array([0.25, 1.0]) * late)

    size = np.array([-1.0, *(stays - course.centre) / course.length_m])
    share = np.array([[0.25], [1.0]])
    np.testing.assert_allclose(ways @ size, -8e-5 * share * (points - stays), atol=1e-18)


@pytest.mark.whole
def test_a_robot_that_did_not_grow_with_its_base_changed_nothing():
    """The correction by 80 ppm moves it along the rail as a zero that changed would, too."""
    made = asked(clean(3))
    data = made.reduced.data
    course = grown_by(data, 8e-5)
    share = data.pulls.time_zero[data.pull] / data.pulls.time_zero.max()
    moved = data.unloaded - 8e-5 * share[:, None] * (data.unloaded - course.centre)
    still = replace(data, unloaded=moved)
    every = catalogue(made.case.robot)

    named, none = (
        from_unloaded(made.cell, still, 1.0, every, 0.0, one).causes for one in (None, course)
    )

    assert [one.effect.since for one in named] == [True]
    assert none == ()


@pytest.mark.whole
def test_a_zero_that_changed_is_named_beside_a_base_that_grew():
    """A joint of the arm, by 2 mrad, with its pose."""
    made = asked(relogged(clean(3), 3, 7, 2e-3))
    data = made.reduced.data

    (one,) = from_unloaded(
        made.cell, data, 1.0, catalogue(made.case.robot), 0.0, grown_by(data, 8e-5)
    ).causes

    assert (one.effect.label, one.effect.form) == ("joint_offset:3", "since pose 7")
