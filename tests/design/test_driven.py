"""Plans that a robot can drive: within its limits, free of self-collision, from pose to pose.

Collisions are judged by Pinocchio and Coal on the capsules of the robot file, not by our gaps.
"""

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from cell_check import Checked

from pipeline.design import spec
from pipeline.design.arm import bodied, hulls
from pipeline.design.driven import legs, pose_violations, unwound
from pipeline.design.library import problem_of
from pipeline.design.problem import build
from pipeline.design.search import Effort, search
from pipeline.machine.robot import configure, load

PROBLEM = """
format = 1
name = "hall7"
robot = "{robot}"
[plan]
poses = 6
readings = 12
[pull]
steps_n = [{steps}]
[anchor]
x_m = 2.5
y_m = {y}
z_m = {z}
[criterion]
kind = "D"
[tool]
load_point = [0.15, 0.0, 0.25]
P1 = [0.20, 0.05, 0.12]
P2 = [-0.12, 0.19, 0.10]
P3 = [-0.10, -0.18, 0.22]
"""
ROBOTS = {
    "kr500_rail": ("1200, 3000", 6.0, -0.891),
    "ur10": ("100, 200", 0.3, 0.0),
    "kr210_r2700_2": ("1000, 1500", 1.0, 0.0),
}
QUICK = Effort(first=0, rounds=1, poses=48, settled=6, exchanged=2)


def asked(name):
    """A problem."""
    steps, y, z = ROBOTS[name]
    return build(spec.parse(PROBLEM.format(robot=name, steps=steps, y=y, z=z)), load(name))


@lru_cache(maxsize=8)
def planned(name, seed):
    """A problem and the poses of a quick plan."""
    problem = asked(name)
    *_, last = search(problem, np.random.default_rng(seed), QUICK)
    return problem, last.best.q


def driven(q, via):
    """Points of a way every 2 degrees, all joints moving from start to end together."""
    rows = []
    for a, b in pairwise([q[0], *via, q[1]]):
        count = int(np.ceil(np.abs(b - a).max() / np.deg2rad(2.0))) + 1
        rows.append(a + np.linspace(0, 1, count)[:, None] * (b - a))
    return np.vstack(rows)


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ROBOTS)
def test_no_pose_and_no_way_between_poses_meets_the_arm(name):
    """Coal finds no collision along the ways that are called free."""
    problem, q = planned(name, 1)
    checked = Checked(problem.robot, {}, {})
    found = legs(problem, q, problem.anchor_lower)

    assert not pose_violations(problem, q)
    for (a, b), leg in zip(pairwise(q), found, strict=True):
        if leg.blocked is None:
            for at in driven((a, b), leg.via):
                checked.set(at)
                assert all(checked.between(one) > -5e-3 for one in checked.near(checked.watched))


@pytest.mark.whole
@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ROBOTS)
def test_poses_keep_away_from_limits_and_windings(name):
    """5 degrees, 20 mm, and half a turn of the wrist, from the numbers of the robot file."""
    problem, q = planned(name, 1)
    robot = problem.robot
    margin = np.where(robot.prismatic, 0.02, np.deg2rad(5.0))
    shown = np.linalg.solve(robot.controller_matrix, (q - robot.controller_offset).T).T

    assert (q > robot.lower + margin - 1e-9).all()
    assert (q < robot.upper - margin + 1e-9).all()
    assert (np.abs(shown[:, -3:]) < np.pi + 1e-9).all()


def test_a_way_through_the_arm_is_refused_with_pose_and_reason():
    """There is no way to a pose with self-collision by Coal, and the pose itself is refused."""
    problem = asked("kr210_r2700_2")
    checked, rng = Checked(problem.robot, {}, {}), np.random.default_rng(5)
    pairs = checked.watched
    drawn = (rng.uniform(problem.lower, problem.upper) for _ in range(1000))
    q = next(one for one in drawn if min(checked.apart(one, p) for p in pairs) < -0.02)
    there = next(one for one in drawn if min(checked.apart(one, p) for p in pairs) > 0.02)
    (found,) = legs(problem, np.stack([there, q]), problem.anchor_lower)

    assert "from pose 1 to pose 2 the arm does not keep the arm clear of itself" in found.sentence
    assert pose_violations(problem, q[None]) == ["pose 1 does not keep the arm clear of itself"]
    assert pose_violations(problem, there[None]) == []


def test_joints_that_turn_twice_stand_in_one_turn():
    """The same poses, without a turn of the shoulder that would pass through the floor."""
    problem = asked("ur10")
    q = np.deg2rad([[10, 337, -78, 20, 30, 40], [10, -119, -107, 20, 30, 40],
                    [-340, 247, 100, 20, 30, 40]])  # fmt: skip
    found = np.rad2deg(unwound(problem, q))

    assert found[:, 1] == pytest.approx([-23, -119, -113], abs=1e-5)
    assert found[:, 0] == pytest.approx([10, 10, 20], abs=1e-5)
    assert np.cos(np.deg2rad(found) - q) == pytest.approx(1.0, abs=1e-9)


def test_a_joint_may_have_to_go_two_turns():
    """Of one that turns 460 deg each way, -450 deg is 270 deg beside others at 100 deg."""
    problem = asked("ur10")
    free = np.deg2rad(np.full(6, 460.0))
    q = np.deg2rad(np.repeat([[100.0], [100], [100], [100], [-450]], 6, axis=1))
    found = np.rad2deg(unwound(replace(problem, lower=-free, upper=free), q))

    assert found[:, 5] == pytest.approx([100, 100, 100, 100, 270], abs=1e-5)
    back = np.rad2deg(unwound(replace(problem, lower=-free, upper=free), -q))
    assert back[:, 5] == pytest.approx([-100, -100, -100, -100, -270], abs=1e-5)


def test_a_robot_without_hulls_gets_rough_ones_from_its_table():
    """They follow the links: each begins and ends at its joints, in any pose."""
    robot = load("irb6640")
    assert not len(robot.capsules)
    made = hulls(robot)
    rng = np.random.default_rng(3)
    here = configure(robot, rng.uniform(robot.lower, robot.upper, (1, robot.n)))
    at = np.vstack([here.origin[0], here.flange_origin[0]])
    ends = here.placed(made)[..., 0]

    for k, carrier in enumerate(made.carrier):
        assert ends[0][:, k] == pytest.approx(at[carrier - 1], abs=1e-9)
        assert ends[1][:, k] == pytest.approx(at[carrier], abs=1e-9)
    assert (np.diff(made.radius) < 0).all()
    shipped = load("kr210_r2700_2")
    assert bodied(shipped) is shipped
    assert bodied(replace(robot)).capsules.source.startswith("made from the lengths")


def test_another_robot_in_the_papers_problem_gets_the_margins():
    """The paper uses the full limits of its own robot, which nobody would drive."""
    paper = problem_of("paper_reference", {})
    other = problem_of("paper_reference", {"robot": "kr500_rail_kuka"})

    assert paper.lower == pytest.approx(paper.robot.lower)
    assert paper.room is None
    assert other.lower[1] == pytest.approx(other.robot.lower[1] + np.deg2rad(5.0))
    assert other.room is not None
    assert other.room.tracker is None


def test_a_limit_of_the_problem_counts_inside_the_margins():
    """Stated limits are kept in addition."""
    text = PROBLEM.format(robot="kr210_r2700_2", steps="1000, 1500", y=1.0, z=0.0)
    tight = spec.parse(text + "[limits]\njoints = { theta2 = [-90, -80] }\n")

    problem = build(tight, load("kr210_r2700_2"))

    assert np.rad2deg([problem.lower[1], problem.upper[1]]) == pytest.approx([-90, -80])
