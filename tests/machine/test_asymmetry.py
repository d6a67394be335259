"""A gear whose stiffness depends on the sign of its torque: law, name, and what is reported.

The truth comes from a planar chain by sine and cosine, and from the league's machine of 4 x 4
matrices; neither shares a formula with the effect.
"""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

from bench.league.hidden import SECRETS
from bench.league.hidden_effect import NOMINAL, Secret, setup
from bench.league.machine import Machine, Spring
from bench.league.play import Rules, drawn, play
from pipeline.annex.sections.stiffness import stiffness as section
from pipeline.answer.contract import Stiffness
from pipeline.answer.remarks import both_stiffnesses
from pipeline.fleet.history import changes
from pipeline.library.compensate import Compensation, compensate
from pipeline.library.compliance import cartesian_stiffness
from pipeline.library.model_file import dumps
from pipeline.library.model_file import parse as parse_model
from pipeline.machine import cell as forward
from pipeline.machine import sides
from pipeline.machine.cell import Tool, paper_cell, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.machine.robot.axes import sense
from pipeline.machine.robot.mdh import parse
from pipeline.prediction.path import Path
from pipeline.report.record import ReportTable
from pipeline.run import campaign_answer
from pipeline.store.campaign import in_memory

KR500 = load("kr500_rail")

PLANAR = """
format = 1
name = "planar"
description = "two links in the plane of x and z"
convention = "khalil"
source = "made up"
"""
LINK = """
[[joint]]
name = "{name}"
type = "revolute"
alpha_deg = {alpha}
d_m = {length}
stiffness_nm_per_rad = 1.0e6
"""
MASS = """mass_kg = {mass}
centre_of_mass_m = [{at}, 0.0, 0.0]
"""
LENGTHS, REACH, MASSES = (0.9, 0.7), 0.2, (80.0, 60.0)
"""Lengths of both links and from the second to the load point [m]; masses at the centres of the
links [kg]."""


def planar(masses):
    """Joints about y: a link rotated by q points along (cos q, -sin q) in x and z."""
    text = PLANAR
    for k, (alpha, length) in enumerate(((-90, 0.0), (0, LENGTHS[0]))):
        text += LINK.format(name=f"a{k + 1}", alpha=alpha, length=length)
        if masses:
            text += MASS.format(mass=masses[k], at=LENGTHS[k] / 2)
    return parse(text, "planar.toml")


def along(angle):
    """Direction of a link in the plane of x and z."""
    return np.array([np.cos(angle), -np.sin(angle)])


def planar_torques(q, force):
    """Torques about y on each joint from a force (x, z) at the load point and both weights."""
    elbow = LENGTHS[0] * along(q[0])
    tip = elbow + (LENGTHS[1] + REACH) * along(q[0] + q[1])
    middles = LENGTHS[0] / 2 * along(q[0]), elbow + LENGTHS[1] / 2 * along(q[0] + q[1])
    pull, weight = np.zeros(2), np.zeros(2)
    for j, origin in enumerate((np.zeros(2), elbow)):
        x, z = tip - origin
        pull[j] = z * force[0] - x * force[1]
        for k in range(j, 2):
            weight[j] += (middles[k] - origin)[0] * MASSES[k] * 9.80665
    return pull, weight, tip, elbow


def turned(c_positive, c_negative, torque):
    """Rotation of a two-sided spring: c tau, with the c of the sign of tau."""
    return (c_positive if torque > 0 else c_negative) * torque


@pytest.mark.parametrize("form", ["pull", "total"])
def test_two_links_turn_as_far_as_springs_with_two_sides(form):
    """A planar chain by hand; pulls in both senses, some of which reverse the torque."""
    rng = np.random.default_rng(3)
    robot = planar(MASSES)
    c, (up, down) = np.array([8e-7, 1.1e-6]), (1.5e-6, 0.7e-6)
    tool = Tool.of({"load_point": (LENGTHS[1] + REACH, 0, 0), "P": (LENGTHS[1] + REACH, 0, 0)})
    effect = next(e for e in catalogue(robot) if (e.label, e.form) == ("joint_asymmetry:2", form))
    cell = paper_cell(robot, tool).with_effects(effect)
    values = np.array([c[0], (up + down) / 2, (up - down) / 2])
    across = 0
    for _ in range(40):
        q, force = rng.uniform(-1.5, 1.5, 2), rng.uniform(-900, 900, 2)
        pull, weight, tip, elbow = planar_torques(q, force)
        before = weight[1] if form == "total" else 0.0
        across += np.sign(before) * np.sign(before + pull[1]) < 0
        second = turned(up, down, pull[1] + before) - turned(up, down, before)
        by_first, by_second = ((v[1], -v[0]) for v in (tip, tip - elbow))
        true = c[0] * pull[0] * np.array(by_first) + second * np.array(by_second)

        moved = predict(cell, Pulls.at(q, [force[0], 0.0, force[1]]), values).displacement[0, 0]

        np.testing.assert_allclose(moved[[0, 2]], true, atol=1e-12)
    assert across > 5 or form == "pull"


@pytest.mark.parametrize("form", ["narrow", "narrow, total"])
def test_two_links_turn_as_far_as_flanks_that_part(form):
    """The same for lost motion, whose flanks the weight may keep in contact."""
    rng = np.random.default_rng(5)
    robot = planar(MASSES)
    c, b, full = np.array([8e-7, 1.1e-6]), 9e-5, 0.03 * 1e-3 / robot.nominal_compliance[1]
    tool = Tool.of({"load_point": (LENGTHS[1] + REACH, 0, 0), "P": (LENGTHS[1] + REACH, 0, 0)})
    effect = next(e for e in catalogue(robot) if (e.label, e.form) == ("joint_lost_motion:2", form))
    cell = paper_cell(robot, tool).with_effects(effect)
    parted = 0
    for _ in range(40):
        q, force = rng.uniform(-1.5, 1.5, 2), rng.uniform(-900, 900, 2)
        pull, weight, tip, elbow = planar_torques(q, force)
        before = weight[1] if "total" in form else 0.0
        play = b * (np.tanh((pull[1] + before) / full) - np.tanh(before / full))
        parted += abs(play) > b
        by_first, by_second = ((v[1], -v[0]) for v in (tip, tip - elbow))
        true = c[0] * pull[0] * np.array(by_first) + (c[1] * pull[1] + play) * np.array(by_second)

        moved = predict(cell, Pulls.at(q, [force[0], 0.0, force[1]]), np.append(c, b))

        np.testing.assert_allclose(moved.displacement[0, 0, [0, 2]], true, atol=1e-12)
    assert parted > 3 or form == "narrow"


@pytest.mark.parametrize(
    ("name", "pull", "total"),
    [
        ("joint_asymmetry", {"pull"}, {"total"}),
        ("joint_lost_motion", {"narrow", "wide"}, {"narrow, total", "wide, total"}),
    ],
)
def test_of_the_total_torque_only_where_masses_are_known(name, pull, total):
    """A robot file without masses: only the torque of the pull counts."""
    heavy, light = (
        {e.form for e in catalogue(planar(masses)) if e.name == name} for masses in (MASSES, ())
    )

    assert (heavy, light) == (pull | total, pull)


def two_sided(joint, softer, way):
    """A joint of the league's machine that is (1 + `softer`) times as compliant in one sense."""

    def plant(s, size, course):
        c = float(s.compliance[joint - 1])

        def law(own, _):
            return np.where(way * own > 0, softer * c * own, 0.0)

        s.machine.springs.append(Spring(f"two{joint}", joint, (0, 0, 1), False, law))
        return {"positive": c * (1 + softer * (way > 0)), "negative": c * (1 + softer * (way < 0))}

    return Secret(f"joint_asymmetry:{joint}", f"joint {joint}", True, plant)


@lru_cache(maxsize=1)
def soft_one_way():
    """A game whose joint 4 (A3) is 60 % stiffer against negative torques, and its answer.

    Returns:
        Files, true compliances by sign, true stiffnesses, and the answer of the run.
    """
    rng = np.random.default_rng([17, 4])
    plan = drawn(KR500, rng, Rules())
    game = play(KR500, plan, [(two_sided(4, 0.6, 1), 1.0)], rng, Rules())
    true = game.truth["secrets"][0]["amplitudes"]
    return plan, true, game.truth["stiffness"], campaign_answer("game", in_memory(game.files))


def joint_4():
    """Its stiffness in the answer."""
    return soft_one_way()[3].answer.stiffness[3]


@pytest.mark.whole
def test_a_gear_that_is_stiffer_one_way_is_named_with_both_stiffnesses():
    """The cause, its place and both compliances, whose intervals hold the true ones."""
    _, true, _, run = soft_one_way()

    assert run.answer.diagnosis.verdict == "explained"
    (cause,) = [c for c in run.answer.diagnosis.causes if c.name != "tracker_noise"]
    assert (cause.name, cause.where, cause.form) == ("joint_asymmetry", 4, "pull")
    assert [p.name for p in cause.parameters] == ["c_joint4_positive", "c_joint4_negative"]
    for parameter, sign in zip(cause.parameters, ("positive", "negative"), strict=True):
        assert parameter.value == pytest.approx(true[sign], abs=3 * parameter.std)
        assert parameter.std < 0.03 * true[sign]
        mine = getattr(joint_4().by_sign, sign)
        assert mine.compliance == pytest.approx(parameter.value)
        assert mine.ci95 == pytest.approx([1 / end for end in parameter.ci95[::-1]])
    assert abs(joint_4().by_sign.correlation) < 1


def test_a_weight_turns_no_vertical_axis_either_way():
    """A robot on the floor: joint 1 has the same side in all poses, joint 2 has both."""
    robot = load("kr240_r2900_2")
    cell = paper_cell(robot, Tool.of({"load_point": (0.1, 0.0, 0.3), "P1": (0.1, 0.0, 0.3)}))
    cell = cell.with_effects(*(one for one in catalogue(robot) if one.name == "joint_asymmetry"))
    q = np.random.default_rng(62).uniform(robot.lower, robot.upper, (100, 6))
    weight = np.tile([0.0, 0.0, -800.0], (100, 1))
    held = sides.along(cell, np.zeros(len(cell.parameters)), q, weight)

    assert (held[0] == 1).all()
    assert set(held[1]) == {-1, 1}


@pytest.mark.whole
def test_the_stiffness_is_that_of_the_test_poses_side():
    """Value, compliance and interval are those of one sign; budget and model.toml agree."""
    *_, run = soft_one_way()
    joint = joint_4()
    mine = getattr(joint.by_sign, joint.by_sign.value_of)

    assert (joint.value, joint.ci95) == (pytest.approx(mine.value), pytest.approx(mine.ci95))
    assert joint.compliance_std == pytest.approx(mine.compliance_std)
    assert sum(part.share for part in joint.budget) == pytest.approx(1, abs=2e-3)
    again = parse_model(dumps(run.model))
    for model in (run.model, again):
        assert model.stiffness(3)[:2] == (pytest.approx(mine.value), pytest.approx(mine.std))


@pytest.mark.whole
def test_a_joint_is_pulled_by_the_sign_that_is_told():
    """The sign at the test pose, by moments: lever of the load point times the force."""
    *_, run = soft_one_way()
    q, force = run.model.at_pose
    tool = run.model.tool
    here = forward.load(paper_cell(KR500, tool), Pulls.at(q, force), np.zeros(7))
    axis, at = here.configuration.axes[0, 3, :, 2], here.configuration.origin[0, 3]
    moment = np.cross(here.load_point[0] - at, force) @ axis

    assert joint_4().by_sign.value_of == ("positive" if moment > 0 else "negative")


@pytest.mark.whole
def test_a_prediction_has_the_stiffness_of_its_torque():
    """Pulled in both senses at further poses: compared with the machine's own deflections."""
    plan, _, stiffness, run = soft_one_way()
    tool, rng = plan.tool, np.random.default_rng(5)
    machine = setup(KR500, np.array(stiffness))
    two_sided(4, 0.6, 1).plant(machine, 1.0, None)
    q = plan.q[:6] + rng.uniform(-0.1, 0.1, (6, 7))
    force = 2500.0 * np.array([[0.3, 0.8, -0.5]] * 6)
    ends = {}
    for way in (1.0, -1.0):
        rest, loaded = (
            machine.machine.settle(q, tool[:1], tool[0], f)[0] for f in (0 * force, way * force)
        )
        ends[way] = (loaded - rest)[:, 0]
        foretold = run.model.at_load_point(q, way * force)
        off = np.abs(foretold.displacement - ends[way])
        assert (off < 4 * foretold.std + 2e-5).all()
    there, back = (np.linalg.norm(ends[way], axis=1) for way in (1.0, -1.0))
    assert np.max(np.abs(there / back - 1)) > 0.02


@pytest.mark.whole
def test_a_corrected_path_says_both_stiffnesses_and_where_each_holds():
    """Signs by moments about the axis.

    Theta4 is opposite to A3, so minus is its positive torque.
    """
    _, true, _, run = soft_one_way()
    q, force = run.model.at_pose
    rng = np.random.default_rng(8)
    q, force = q + rng.uniform(-0.2, 0.2, (7, 7)), force * rng.choice([-1.0, 1.0], (7, 1))
    here = forward.load(paper_cell(KR500, run.model.tool), Pulls.at(q, force), np.zeros(7))
    axis, at = here.configuration.axes[:, 3, :, 2], here.configuration.origin[:, 3]
    positive = np.einsum("mi,mi->m", np.cross(here.load_point - at, force), axis) > 0
    path = Path(np.arange(7), q, force, controller=False)

    found = compensate(run.model, path)
    (ways,) = found.each_way
    both = Compensation.joined([found, found])

    assert ways.called == "A3"
    assert (ways.towards_minus, ways.towards_plus) == (positive.sum(), (~positive).sum())
    assert ways.minus[0] == pytest.approx(1 / true["positive"], abs=3 * ways.minus[1])
    assert ways.plus[0] == pytest.approx(1 / true["negative"], abs=3 * ways.plus[1])
    assert ways.sentence in found.remarks
    assert both.each_way[0].towards_plus == 2 * ways.towards_plus


@pytest.mark.whole
def test_the_tangent_at_zero_torque_is_between_both():
    """Without load no sign applies: the Cartesian compliance is finite and that of the mean."""
    *_, run = soft_one_way()
    q, force = run.model.at_pose
    sides = [cartesian_stiffness(run.model, q[None], s * force[None]) for s in (1e-3, -1e-3)]
    none = cartesian_stiffness(run.model, q[None], 0 * force[None])

    mean = (sides[0].compliance + sides[1].compliance) / 2
    assert np.abs(sides[0].compliance - sides[1].compliance).max() > 1e-9
    np.testing.assert_allclose(none.compliance, mean, rtol=1e-6, atol=1e-12)


@pytest.mark.whole
def test_the_first_screen_and_the_table_say_which_way_the_axis_turns():
    """theta4 is opposite to A3: the stiffness against positive torques is that towards minus."""
    *_, run = soft_one_way()
    joint = joint_4()

    assert sense(KR500, 3) == -1
    assert joint.by_sign.positive.axis_turns == "minus"
    said = both_stiffnesses(joint)
    assert said in " ".join(line.text for line in run.answer.first_screen)
    plus, minus = said.split(", and ")
    shown = f"{joint.by_sign.negative.value / 1e6:.2f}"[:3]
    assert "A3 towards plus" in plus
    assert f" {shown}" in plus
    assert f"{joint.by_sign.positive.value / 1e6:.2f}"[:3] in minus
    tables = [part for part in section(run.answer, None).blocks if isinstance(part, ReportTable)]
    table = next(one for one in tables if one.name == "stiffness")
    titles = [column.title for column in table.columns]
    row = table.rows[3]
    assert row[titles.index("Turned towards plus")].text.startswith(shown)


@pytest.mark.whole
def test_pulls_that_turn_a_joint_one_way_leave_the_other_in_the_dark():
    """Only one side of the spring is seen: no cause, but a blind spot."""
    rules = Rules(poses=12)
    rng = np.random.default_rng([741, 3])
    plan = drawn(KR500, rng, Rules(poses=60))
    u = plan.anchor - forward.load(
        paper_cell(KR500, Tool.of({"load_point": plan.tool[0], "P": plan.tool[1]})),
        Pulls.at(plan.q, np.zeros((60, 3))),
        np.zeros(7),
    ).load_point  # fmt: skip
    cell = paper_cell(KR500, Tool.of({"load_point": plan.tool[0], "P": plan.tool[1]}))
    moved = predict(cell, Pulls.at(plan.q, u), np.eye(7)[2] * 1e-9).displacement
    turn = np.einsum("mi,mi->m", u, moved[:, 0])  # work: positive for either sign
    assert (turn > 0).all()
    here = forward.load(cell, Pulls.at(plan.q, u), np.zeros(7))
    axis, at = here.configuration.axes[:, 2, :, 2], here.configuration.origin[:, 2]
    moment = np.einsum("mi,mi->m", np.cross(here.load_point - at, u), axis)
    one_way = np.flatnonzero(moment < 0)[:12]
    assert len(one_way) == 12
    kept = replace(
        plan, q=plan.q[one_way], anchor=plan.anchor[one_way], approach=plan.approach[one_way]
    )
    files = play(KR500, kept, [(two_sided(3, 0.5, 1), 1.0)], rng, rules).files

    answer = campaign_answer("game", in_memory(files)).answer

    assert "joint_asymmetry" not in {cause.name for cause in answer.diagnosis.causes}
    assert answer.stiffness[2].by_sign is None
    spots = {(one.name, one.where): one for one in answer.diagnosis.blind_spots}
    assert "both ways" in spots["joint_asymmetry", 3].needs


def heavy(robot):
    """The KR500 with masses of links, as a separate robot file."""
    text, masses = robot.text, {"theta3": (500.0, 0.6), "theta5": (400.0, 0.0)}
    for name, (mass, at) in masses.items():
        head = f'name = "{name}"\n'
        text = text.replace(head, f"{head}mass_kg = {mass}\ncentre_of_mass_m = [{at}, 0.0, 0.0]\n")
    return text.replace('name = "kr500_rail"', 'name = "heavy"')


@pytest.mark.whole
def test_a_heavy_arm_has_its_kink_where_the_total_torque_is_zero():
    """The weights of the links keep joint 3 on one side: the form `total`, with both values."""

    def plant(s, size, course):
        s.machine.masses += [(3, (0.6, 0.0, 0.0), 500.0), (5, (0.0, 0.0, 0.0), 400.0)]
        return two_sided(3, 0.6, 1).plant(s, size, course)

    rng = np.random.default_rng([23, 3])
    plan = drawn(KR500, rng, Rules())
    secret = replace(SECRETS["gravity_sag"], label="joint_asymmetry:3", plant=plant)
    game = play(KR500, plan, [(secret, 1.0)], rng, Rules(scatter=(1.0, 1.0)))
    content = game.files["campaign.toml"].decode().replace('"kr500_rail"', '"heavy.toml"')
    files = game.files | {"campaign.toml": content.encode(), "heavy.toml": heavy(KR500).encode()}

    answer = campaign_answer("game", in_memory(files)).answer

    (cause,) = [c for c in answer.diagnosis.causes if c.name == "joint_asymmetry"]
    assert (cause.where, cause.form) == (3, "total")
    true = game.truth["secrets"][0]["amplitudes"]
    for parameter, sign in zip(cause.parameters, ("positive", "negative"), strict=True):
        assert parameter.value == pytest.approx(true[sign], abs=3 * parameter.std)
    assert "load with the arm's own weight" in both_stiffnesses(answer.stiffness[2])


@pytest.mark.whole
def test_two_campaigns_are_compared_on_one_side():
    """Test poses with torques of opposite sign on a joint do not mean wear of its gear."""
    before = joint_4()
    other = {"positive": "negative", "negative": "positive"}[before.by_sign.value_of]
    one = getattr(before.by_sign, other)
    after = Stiffness.model_validate(
        before.model_dump()
        | {
            "value": one.value,
            "std": one.std,
            "ci95": one.ci95,
            "compliance": one.compliance,
            "compliance_std": one.compliance_std,
            "by_sign": before.by_sign.model_dump() | {"value_of": other},
        }
    )

    (change,) = changes([before], [after])

    assert not change.sure
    assert change.percent == pytest.approx(0.0, abs=1e-9)


def test_the_leagues_flank_has_the_compliances_that_it_tells():
    """Far from zero the hidden law is two straight lines; at zero the deflection is zero."""
    one = setup(KR500, 1 / NOMINAL)
    one.machine = Machine(KR500, [])
    course = SimpleNamespace(rng=np.random.default_rng(1))

    true = SECRETS["joint_asymmetry:4"].plant(one, 1.0, course)

    (spring,) = one.machine.springs
    far = np.array([-5000.0, 5000.0])
    slope = (spring.law(far * 1.001, {}) - spring.law(far, {})) / (far * 0.001)
    told_of = [true[f"c_joint4_{sign}"] for sign in ("negative", "positive")]
    assert slope + NOMINAL[3] == pytest.approx(told_of, rel=1e-3)
    assert spring.law(np.zeros(1), {}) == 0
