"""What a cell leaves free, against coal, a ray and Pinocchio."""

import coal
import numpy as np
import pytest
from cell_check import CELL, TOOL, Checked, hit

from pipeline.base.errors import InputError
from pipeline.design.feasible import check_reachable
from pipeline.design.gaps import free
from pipeline.design.library import problem_of
from pipeline.design.limits import kept, narrow, penalty
from pipeline.design.room import _pairs, closest, length, unchecked
from pipeline.design.search import Effort, rounded, search
from pipeline.design.space import PlanCoordinates
from pipeline.design.unpulled import unpulled
from pipeline.machine.robot import configure, load
from pipeline.machine.robot.mdh import parse

BODIED = ("kr500_rail", "kr500_rail_kuka", "ur10", "kr210_r2700_2", "fanuc_r2000ic")
QUICK = Effort(first=0, rounds=1, poses=96, settled=8, exchanged=2)


def in_cell(cell=CELL, tool=TOOL, **more):
    """The paper's problem in a cell."""
    return problem_of("paper_reference", {"cell": cell, "tool": tool, **more})


@pytest.fixture(scope="module")
def problem():
    return in_cell()


def ends_of(rng, count):
    """Segments at random: skew, parallel, in line, crossing, and of no length."""
    a, b, c, d = rng.normal(size=(4, 3, count))
    d[:, ::5] = c[:, ::5] + (b - a)[:, ::5] * rng.uniform(-2, 2, count)[::5]  # parallel
    b[:, 1::7] = a[:, 1::7]
    d[:, 2::11] = c[:, 2::11]
    c[:, 3::13] = (a + b)[:, 3::13] / 2 - (d - c)[:, 3::13] / 3  # nearly crossing
    return a, b, c, d


def test_segments_are_as_far_apart_as_coal_says():
    """To 1e-9 m, for capsules without thickness."""
    a, b, c, d = ends_of(np.random.default_rng(1), 2000)
    s, t = closest(a, b, c, d)
    ours = length(a + s * (b - a) - c - t * (d - c))

    def capsule(p, q):
        along = np.linalg.norm(q - p)
        z = (q - p) / along if along else np.array([0.0, 0.0, 1.0])
        x = np.cross(z, [1.0, 0, 0] if abs(z[0]) < 0.9 else [0, 1.0, 0])
        x /= np.linalg.norm(x)
        R = np.stack([x, np.cross(z, x), z], axis=1)
        return coal.Capsule(0.01, along), coal.Transform3s(R, (p + q) / 2)

    theirs = [
        coal.distance(
            *capsule(a[:, k], b[:, k]),
            *capsule(c[:, k], d[:, k]),
            coal.DistanceRequest(),
            coal.DistanceResult(),
        )
        + 0.02
        for k in range(2000)
    ]
    assert np.abs(ours - theirs).max() < 1e-9


@pytest.mark.parametrize("name", BODIED)
def test_capsules_move_with_their_links(name):
    """Ends in F_b are those of Pinocchio's joint frames."""
    robot = load(name)
    checked = Checked(robot, {}, {})
    lower, upper = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
    q = np.random.default_rng(2).uniform(lower, upper, (5, robot.n))
    ends = configure(robot, q).placed(robot.capsules)

    assert robot.capsules.source
    for k in range(5):
        checked.set(q[k])
        expected = np.array([checked.ends(c) for c in range(len(robot.capsules))])
        assert np.abs(ends[..., k].transpose(2, 0, 1) - expected).max() < 1e-12


STANDARD = """
format = 1
name = "two"
description = "two links in a plane"
convention = "standard"
source = "made up"

[[joint]]
name = "one"
type = "revolute"
a_m = 1.0
d_m = 0.5

[[joint]]
name = "two"
type = "revolute"
a_m = 0.7

[[capsule]]
link = "one"
from_m = [-1.0, 0.0, 0.0]
to_m = [0.0, 0.0, 0.0]
radius_m = 0.1

[[capsule]]
link = "two"
from_m = [-0.7, 0.0, 0.0]
to_m = [0.0, 0.0, 0.0]
radius_m = 0.1
"""


def test_capsules_of_a_standard_table_stand_in_the_frame_behind_their_row():
    """Two links in a plane: from joint to joint, whatever the angles."""
    robot = parse(STANDARD, "two.toml")
    a, b = 0.4, -1.1
    ends = configure(robot, np.array([[a, b]])).placed(robot.capsules)[..., 0]
    elbow = np.array([np.cos(a), np.sin(a), 0.5])
    tip = elbow + 0.7 * np.array([np.cos(a + b), np.sin(a + b), 0.0])

    assert ends[:, :, 0] == pytest.approx(np.array([[0.0, 0.0, 0.5], elbow]))
    assert ends[:, :, 1] == pytest.approx(np.array([elbow, tip]))


def test_a_capsule_of_no_link_is_refused():
    """With the links that there are."""
    with pytest.raises(InputError, match=r'the link "elbow".*name one of base, one, two'):
        parse(STANDARD.replace('link = "two"', 'link = "elbow"'), "two.toml")


@pytest.mark.parametrize("name", BODIED)
def test_neighbours_and_what_touches_at_zero_may_touch(name):
    """All other pairs may not."""
    robot = load(name)
    checked = Checked(robot, {}, {})
    pairs, left = _pairs(robot, robot.capsules)

    found = {tuple(sorted(pair)) for pair in pairs.T.tolist()}
    assert found == set(checked.pairs) - checked.touching_at_zero
    names = {tuple(checked.rows[k][0] for k in pair) for pair in checked.touching_at_zero}
    assert names == set(left)


def differences(function, x, h=1e-6):
    """Central differences of a function (k, d) -> (k,), shape (k, d)."""
    steps = h * np.eye(x.shape[1])
    return np.stack([(function(x + s) - function(x - s)) / (2 * h) for s in steps], axis=1)


def test_slopes_of_every_gap_are_finite_differences(problem):
    """By joints and anchor, rule by rule; each is broken somewhere."""
    box, rng = PlanCoordinates(problem, 1), np.random.default_rng(3)
    x = rng.uniform(0.01, 0.99, (400, box.size))
    for rule in problem.room.rules:
        room = problem.room.only(rule)

        def value(x, room=room):
            return penalty(problem.limits, box.stations(x), room)[0]

        none = penalty(problem.limits, box.stations(x))[0]
        broken, by_q, by_anchor = penalty(problem.limits, box.stations(x), room)
        expected, got = differences(value, x), box.slopes(by_q, by_anchor)

        assert (broken > none).sum() >= 3, rule
        assert np.abs(got - expected).max() < 1e-6 * np.abs(expected).max(), rule


RULES = {
    "the beams clear of the arm": lambda said: said.startswith("line from P"),
    "the chain clear of the arm": lambda said: said.startswith("line from load_point"),
    "the arm clear of itself": lambda said: " in " in said and "floor" not in said,
    "arm and effector above the floor": lambda said: said.endswith("in the floor"),
    **{
        f"the beam within the acceptance of {name}": lambda said, name=name: f"{name} bey" in said
        for name in ("P1", "P2", "P3")
    },
}
"""What the check says of poses that break each rule."""


@pytest.mark.whole
def test_a_rule_is_broken_where_coal_and_a_ray_say_so(problem):
    """Rule by rule, and nowhere else, but for what is within 5 mm or 0.005 of a cosine."""
    box, rng = PlanCoordinates(problem, 1), np.random.default_rng(4)
    at = box.stations(rng.uniform(size=(300, box.size)))
    q, anchor = at.configuration.q, (at.load_point + at.chain_m * at.direction).T
    checked = Checked(problem.robot, CELL, TOOL)
    theirs = [checked.complaints(*one, 950.0) for one in zip(q, anchor, strict=True)]

    assert set(RULES) == set(problem.room.rules)
    for rule, says in RULES.items():
        gaps = narrow(problem.room.only(rule), at, 5e-3)
        narrower = set(np.concatenate([gap.pose for gap in gaps]).tolist())
        broken = set(np.concatenate([gap.pose[gap.value < -5e-3] for gap in gaps]).tolist())
        found = {k for k, said in enumerate(theirs) if any(map(says, said))}
        assert len(found) >= 3, rule
        assert broken <= found <= narrower, rule
    kept_ones = kept(problem.limits.model_copy(update={"flange_above_m": None}), at, problem.room)
    assert not any(theirs[k] for k in np.flatnonzero(kept_ones))


def test_of_no_poses_none_is_free(problem):
    """Where a first look has left none over."""
    tool = np.array(list(problem.tool.named.values()))
    at = configure(problem.robot, np.empty((0, problem.robot.n)))

    assert free(problem.room, at, tool, np.empty((0, 3))).shape == (0,)


def complaints(problem, plan, tool=TOOL, cell=CELL):
    """What the poses of a plan break, by the independent check."""
    checked = Checked(problem.robot, cell, tool)
    hardest = max(problem.spec.pull.steps_n)
    return [checked.complaints(q, plan.anchor, hardest) for q in plan.q]


def test_an_acceptance_is_narrower_by_what_a_pull_turns_the_beam(problem):
    """By no less than Pinocchio's bent robot shows in other poses, and not by much more."""
    checked, rng = Checked(problem.robot, CELL, TOOL), np.random.default_rng(6)
    q = rng.uniform(problem.lower, problem.upper, (1500, problem.robot.n))
    stated = np.deg2rad([TOOL["acceptance"][name]["half_angle_deg"] for name in ("P1", "P2", "P3")])
    given = [cone.half_angle for cone in problem.room.cones if "acceptance" in cone.rule]
    tracker = np.array(CELL["tracker_m"])

    def beams(q):
        checked.set(q)
        frame = checked.frame("flange")
        lines = [frame.rotation.T @ (tracker - checked.point(n)) for n in ("P1", "P2", "P3")]
        return np.array([line / np.linalg.norm(line) for line in lines])

    turned = []
    for one in q:
        checked.set(one)
        pull = rng.normal(size=3)
        bent = checked.loaded(one, 950.0 * pull / np.linalg.norm(pull))
        turned.append(np.linalg.norm(beams(bent) - beams(one), axis=1).max())

    narrower = stated - given
    assert np.ptp(narrower) < 1e-12
    assert np.mean(np.array(turned) <= narrower[0]) > 0.998
    assert narrower[0] < 2 * max(turned)


FLOORED = {"tracker_m": [3.0, 1.5, 1.0], "floor_z_m": 0.0}
SMALL = {
    "load_point": [0.05, 0.0, 0.08],
    "P1": [0.06, 0.0, 0.05],
    "P2": [-0.04, 0.05, 0.05],
    "P3": [-0.04, -0.05, 0.05],
    "acceptance": {n: {"direction": [0, 0, 1], "half_angle_deg": 60.0} for n in ("P1", "P2", "P3")},
}


def on_the_floor(robot, seed):
    """A problem for a robot that stands on the floor."""
    reach = 1.2 if robot == "ur10" else 2.5
    anchor = {"x_m": reach, "y_m": 0.3, "z_m": 0.0}
    tool = SMALL if robot == "ur10" else TOOL
    lower = {} if robot != "fanuc_r2000ic" else {"theta2": [-60, 75], "theta3": [-130, 90]}
    joints = {f"theta{k}": [-170 + seed, 170] for k in (4, 6)} | lower
    changes = {"robot": robot, "anchor": anchor, "pull": {"steps_n": [80.0]}}
    changes |= {"criterion": {"kind": "D"}, "limits": {"joints": joints, "max_relative_std": 1e4}}
    return in_cell(FLOORED, tool, **changes), tool


def designed(robot, seed):
    """The plan of a quick search, as it is printed, and what its check needs."""
    if robot.startswith("kr500"):
        problem, tool, cell = in_cell(robot=robot), TOOL, CELL
    else:
        (problem, tool), cell = on_the_floor(robot, seed), FLOORED
    *_, last = search(problem, np.random.default_rng(seed), QUICK)
    assert last.best is not None
    return problem, rounded(problem, last.best), tool, cell


DESIGNS = [(robot, seed) for seed in range(1, 5) for robot in BODIED]
FEW = {("kr500_rail", 1)}


@pytest.mark.whole
@pytest.mark.parametrize(
    ("robot", "seed"),
    [pytest.param(*one, marks=[pytest.mark.slow] * (one not in FEW)) for one in DESIGNS],
)
def test_every_pose_of_a_design_can_be_shot(robot, seed):
    """Twenty designs: nothing touches, every beam arrives within the acceptance, loaded too."""
    problem, plan, tool, cell = designed(robot, seed)

    assert plan.kept
    assert complaints(problem, plan, tool, cell) == [[]] * len(plan.q)


@pytest.mark.whole
def test_every_pose_without_a_pull_can_be_shot():
    """The same check of poses in which reflectors are read only."""
    problem = in_cell(plan={"unloaded": 6})
    found = unpulled(problem, np.zeros((0, problem.robot.n)), np.random.default_rng(8))
    checked = Checked(problem.robot, CELL, TOOL)

    assert len(found.q) == 6
    said = [one for q in found.q for one in checked.complaints(q, problem.anchor_lower, 0.0)]
    assert [one for one in said if "line from load_point" not in one] == []  # there is no chain


@pytest.mark.whole
def test_the_free_design_would_not_be_shot():
    """The check does find fault: with poses that were chosen without a cell."""
    roomless = problem_of("paper_reference", {})
    *_, last = search(roomless, np.random.default_rng(1), QUICK)

    assert sum(map(bool, complaints(roomless, last.best))) >= 1


def test_what_is_not_given_is_said(problem):
    """One sentence each; all of it without a cell."""
    targets, robot = ["P1", "P2", "P3"], problem.robot
    bare = load("irb6640")
    without = problem_of("paper_reference", {})
    no_tracker = in_cell({"floor_z_m": 0.0}, {})
    half = in_cell({"tracker_m": [5, 7, 1]}, {"acceptance": {"P1": TOOL["acceptance"]["P1"]}})

    assert unchecked(robot, targets, problem.spec) == (
        "theta5 against theta7: at the zero of all joints they touch",
    )
    assert unchecked(robot, targets, without.spec) == (
        "beams, collisions, floor and cables: there is no [cell]",
    )
    assert any("tracker_m" in one for one in unchecked(robot, targets, no_tracker.spec))
    assert any("P2, P3" in one for one in unchecked(robot, targets, half.spec))
    assert any("no [[capsules]]" in one for one in unchecked(bare, targets, problem.spec))


@pytest.mark.parametrize(
    ("cell", "tool", "said"),
    [
        ({"max_turn_deg": {"theta9": 90.0}}, {}, "theta9"),
        ({"max_turn_deg": {"r1": 90.0}}, {}, "r1"),
        ({}, {"acceptance": {"P9": {"direction": [0, 0, 1], "half_angle_deg": 30}}}, "P9"),
        ({}, {"acceptance": {"P1": {"direction": [0, 0, 0], "half_angle_deg": 30}}}, "is zero"),
        ({}, {"acceptance": {"P1": {"direction": [0, 0, 1], "half_angle_deg": 300}}}, "half_angle"),
    ],
)
def test_a_wrong_cell_is_refused(cell, tool, said):
    """The sentence has the word that is wrong."""
    with pytest.raises(InputError, match=said):
        in_cell(cell, tool)


def test_one_tracker_stands_in_one_place():
    """The readings scatter as from where the beams come."""
    position = {"noise": {"displacement_sigma_m": 3e-5, "tracker_position_m": [0, 0, 0]}}

    assert in_cell().spec.noise.tracker_position_m == tuple(CELL["tracker_m"])
    with pytest.raises(InputError, match=r"\[noise\] tracker_position_m"):
        in_cell(**position)


def test_a_cell_in_which_no_pose_can_be_shot_is_refused():
    """An arm that points up, over a tracker in the cellar."""
    shut = {"acceptance": {"P1": {"direction": [0, 0, 1], "half_angle_deg": 60.0}}}

    up = {"theta3": [75, 80], "theta4": [88, 92], "theta5": [-1, 1], "theta6": [-5, 5]}
    problem = in_cell({"tracker_m": [0.0, 9.0, -500.0]}, shut, limits={"joints": up})
    with pytest.raises(InputError, match="acceptance of P1"):
        check_reachable(problem, np.random.default_rng(1))


def test_cables_narrow_the_joints_and_nothing_else(problem):
    """Limits of the joints that cables are led along, in the middle of the robot's own."""
    without = problem_of("paper_reference", {})
    changed = np.flatnonzero(problem.upper != without.upper)

    assert [problem.robot.joints[k].name for k in changed] == ["theta5", "theta7"]
    assert np.rad2deg(problem.upper[changed]) == pytest.approx([200.0, 270.0])
    assert np.rad2deg(problem.lower[changed]) == pytest.approx([-200.0, -270.0])


def test_a_ray_hits_what_a_walk_along_it_enters():
    """The ray of the check itself, against many points along the line."""
    rng = np.random.default_rng(5)
    share = np.linspace(0, 1, 3001)[:, None]
    agree = 0
    for p, e, a, b in rng.normal(size=(300, 4, 3)):
        walk = p + share * (e - p)
        u = np.clip((walk - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)[:, None]
        near = np.linalg.norm(walk - a - u * (b - a), axis=1)
        if near[0] < 0.4 or abs(near.min() - 0.4) < 1e-3:
            continue
        agree += 1
        assert hit(p, e, a, b, 0.4) == (near.min() < 0.4)
    assert agree > 100
