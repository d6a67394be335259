"""Two hundred plans of eight robots, driven along their ways by Pinocchio and Coal.

`driven_plans` is what `python tests/design/test_driven_plans.py FIRST LAST` plays, a line for each.
"""

import itertools
import re
import sys
import time
from functools import lru_cache

import numpy as np
import pytest
from cell_check import Checked

from pipeline.design import spec
from pipeline.design.arm import bodied
from pipeline.design.driven import in_order, legs, pose_violations, unwound
from pipeline.design.problem import build
from pipeline.design.search import Effort, search
from pipeline.design.trade import feasible_poses
from pipeline.machine.robot import load

PLACES = {
    "kr500_rail": ("1200, 3000", (2.5, 6.0, -0.891), (5.0, 7.5, 1.2), -0.891),
    "kr500_rail_kuka": ("1200, 3000", (2.5, 6.0, -0.891), (5.0, 7.5, 1.2), -0.891),
    "fanuc_r2000ic": ("800, 1500", (2.2, 1.0, -0.67), (4.0, 3.0, 0.7), -0.67),
    "ur10": ("60, 100", (0.9, 0.5, 0.0), (2.5, 2.0, 0.9), 0.0),
    "ur10e": ("60, 120", (0.9, 0.5, 0.0), (2.5, 2.0, 0.9), 0.0),
    "kr210_l150": ("800, 1500", (2.5, 1.0, 0.0), (4.5, 3.0, 1.2), 0.0),
    "kr210_r2700_2": ("1000, 1500", (2.5, 1.0, 0.0), (4.5, 3.0, 1.2), 0.0),
    "irb6640": ("1000, 1500", (2.5, 1.0, 0.0), (4.5, 3.0, 1.2), 0.0),
}
"""Load steps [N], anchor, tracker, height of the floor [m]."""
SEEDS = range(20261125, 20261150)
SEARCHED = SEEDS[:2]
PLANS = [(name, seed) for seed in SEEDS for name in PLACES]
"""Two hundred plans. In every second one the tracker is stated, and its beams must be free."""
FEW = [("kr500_rail", SEEDS[2]), ("fanuc_r2000ic", SEEDS[3])]
"""In every run of the tests: one with promised beams, one with ways that are not straight. None is
searched; `test_driven` has a searched one."""
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
x_m = {anchor[0]}
y_m = {anchor[1]}
z_m = {anchor[2]}
[criterion]
kind = "D"
[cell]
floor_z_m = {floor}
{tracker}
[tool]
load_point = [0.15, 0.0, 0.30]
P1 = [0.20, 0.05, 0.27]
P2 = [-0.12, 0.19, 0.25]
P3 = [-0.10, -0.18, 0.32]
"""
QUICK = Effort(first=0, rounds=1, poses=48, settled=6, exchanged=2)


@lru_cache(maxsize=4)
def planned(name, seed):
    """A problem, poses in the order of driving, their ways.

    The poses are those of a quick search, or with most seeds any that keep the limits: these are
    found in a second, and lie farther apart than those of a good plan.
    """
    steps, anchor, tracker, floor = PLACES[name]
    beams = f"tracker_m = {list(tracker)}" if seed % 2 else ""
    text = PROBLEM.format(robot=name, steps=steps, anchor=anchor, floor=floor, tracker=beams)
    problem = build(spec.parse(text), load(name))
    rng, anchor = np.random.default_rng(seed), problem.anchor_lower
    if seed in SEARCHED:
        *_, last = search(problem, rng, QUICK)
        q = last.best.q
    else:
        q = feasible_poses(problem, anchor, rng, 6)
    q = unwound(problem, q)
    q = q[in_order(problem, q, anchor)]
    return problem, q, legs(problem, q, anchor)


def path(q, via, robot):
    """Joint values from pose to pose, half a degree or 20 mm apart for the slowest joint."""
    step = np.where(robot.prismatic, 0.02, np.deg2rad(0.5))
    rows = []
    for a, b in itertools.pairwise([q[0], *via, q[1]]):
        count = int(np.ceil((np.abs(b - a) / step).max()))
        rows.append(a + np.linspace(0, 1, count + 1)[:, None] * (b - a))
    return np.vstack(rows)


def complaints(name, seed):
    """Collisions, violated limits and lines along a plan by Pinocchio and Coal; and our report."""
    problem, q, ways = planned(name, seed)
    robot, (_, anchor, tracker, floor) = problem.robot, PLACES[name]
    hulls = None if len(robot.capsules) else bodied(robot).capsules
    tool = {one: list(at) for one, at in problem.spec.tool.items()}
    if not seed % 2:  # free beams were not requested
        tool = {"load_point": tool["load_point"]}
    checked = Checked(robot, {"tracker_m": tracker, "floor_z_m": floor}, tool, hulls)
    lever = 1e-6
    out, told = [], list(pose_violations(problem, q))
    for (a, b), leg in zip(itertools.pairwise(q), ways, strict=True):
        if leg.blocked:
            told.append(leg.sentence)
            continue
        for at in path((a, b), leg.via, robot):
            if (at < robot.lower - lever).any() or (at > robot.upper + lever).any():
                out.append(f"limit on the way to pose {leg.pose}")
            checked.set(at)
            for i, j in checked.near(checked.watched):
                if checked.between((i, j)) < -lever:
                    out.append(f"{checked.rows[i][0]} in {checked.rows[j][0]} to pose {leg.pose}")
            out += [f"{one} to pose {leg.pose}" for one in low(checked, floor)]
            if leg.crossed is None:
                out += [f"{one} to pose {leg.pose}" for one in checked._lines(anchor)]
    return sorted({*out}), told, sum(one.crossed is not None for one in ways)


def low(checked, floor):
    """Moving bodies below the floor: what the first two turning joints do not lift stands."""
    turning = [k for k, joint in enumerate(checked.robot.joints, 1) if not joint.prismatic]
    for k in np.flatnonzero(checked.at[..., 2].min(axis=1) - checked.radius < floor - 1e-6):
        link = checked.rows[k][0]
        if checked.order[link] > turning[0]:
            yield f"{link} in the floor"


@pytest.mark.whole
@pytest.mark.parametrize(
    ("name", "seed"),
    [pytest.param(*one, marks=[pytest.mark.slow] * (one not in FEW)) for one in PLANS],
)
def test_a_plan_is_driven_without_touching_anything(name, seed):
    """No collision, no violated limit, no requested line blocked, on any accepted way."""
    found, told, _ = complaints(name, seed)

    assert found == []
    assert all(re.search(r"pose \d.* does not keep", one) for one in told)


def driven_plans(first, last):
    """Play plans and print a line for each."""
    for name, seed in PLANS[first:last]:
        start = time.monotonic()
        planned(name, seed)
        took = time.monotonic() - start
        found, told, crossed = complaints(name, seed)
        line = f"{name} {seed} {took:.1f} s, crossed {crossed}, found {found}, told {told}"
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    driven_plans(*map(int, sys.argv[1:3]))
