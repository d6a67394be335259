"""Pulls, weights, laws in words, and poses of six coordinates, each by another way."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.design.pull import branches
from pipeline.design.room import together
from pipeline.machine import six
from pipeline.machine.cell import Tool, columns, jacobian, paper_cell, predict
from pipeline.machine.cell import load as loaded
from pipeline.machine.effect import HUNG, PULLED, Pulls, in_place
from pipeline.machine.effects import catalogue
from pipeline.machine.law import Law, parse
from pipeline.machine.robot import configure, load
from pipeline.machine.robot.capsules import Capsules
from pipeline.machine.robot.configuration import cross, rotation_about, translation_along
from pipeline.machine.robot.weight import (
    by_moments,
    carried,
    gravity_torque,
    link_moments,
    weighs,
    work,
)
from pipeline.positions.positions_estimate import stiffening

RAIL = load("kr500_rail")
RNG = np.random.default_rng(71)
Q = RNG.uniform(np.maximum(RAIL.lower, -2.0), np.minimum(RAIL.upper, 2.0), (5, 7))
FORCE = RNG.normal(0, 800, (5, 3))
GRAVITY = np.array([0.3, -0.2, -9.8])
TOOL = Tool.of(
    {
        "load_point": (0.1, 0, 0.2),
        "P1": (0.2, 0.1, 0.1),
        "P2": (-0.1, 0.2, 0.1),
        "P3": (0, -0.2, 0.2),
    }
)


@pytest.mark.parametrize(
    ("steps", "senses"),
    [
        ([100, 200, 300], [1, 1, 1]),
        ([100, 300, 200, 100], [1, 1, -1, -1]),
        ([100, 300, 300, 200, 200], [1, 1, 1, -1, -1]),
        ([-300, 200, 250], [-1, -1, 1]),
        ([-100, 200], [-1, 1]),
    ],
)
def test_the_turnbuckle_was_last_turned_towards_the_step(
    steps: list[float], senses: list[int]
) -> None:
    """Up to a larger force, down to a smaller one, and as before for the same."""
    assert branches(np.array(steps, float)).tolist() == senses


def test_pulls_outside_of_a_campaign_are_one_for_each_pose_or_force() -> None:
    """One force at many poses, many at one; by a chain at the load point, time zero."""
    for q, force, m in ((Q, FORCE[0], 5), (Q[0], FORCE, 5), (Q, FORCE, 5), (Q[0], FORCE[0], 1)):
        pulls = Pulls.at(q, force, branch=-1.0)
        assert len(pulls) == m
        assert pulls.pose.tolist() == [*range(1, m + 1)]
        assert pulls.repeat.tolist() == [1] * m
        np.testing.assert_array_equal(pulls.q, np.broadcast_to(q, (m, 7)))
        np.testing.assert_array_equal(pulls.force, np.broadcast_to(force, (m, 3)))
        assert pulls.branch.tolist() == [-1.0] * m
        assert not pulls.time.any()
        assert not pulls.approach.any()
        assert pulls.by.tolist() == [PULLED] * m
        assert np.isnan(pulls.acts_at).all()
        assert pulls.pulled.tolist() == [[1.0]] * m
    size = np.linalg.norm(FORCE, axis=1)
    assert Pulls.at(Q, FORCE).range_n == (size.min(), size.max())


def test_pulls_are_selected_joined_and_repeated() -> None:
    """Every column with them; under other forces each set has poses of its own."""
    pulls = replace(
        Pulls.at(Q, FORCE),
        pose=np.array([3, 3, 5, 8, 9]),
        by=np.array([PULLED, HUNG, PULLED, HUNG, PULLED]),
        body=np.array(["", "a", "", "b", ""], object),
        time=np.arange(5.0),
    )
    both = pulls.part(np.array([0, 3])).and_then(pulls.part(slice(1, 2)))
    assert both.pose.tolist() == [3, 8, 3]
    assert both.body.tolist() == ["", "b", "a"]
    assert both.pulled[:, 0].tolist() == [1, 0, 0]
    np.testing.assert_array_equal(both.q, Q[[0, 3, 1]])
    forces = np.stack([FORCE, 2 * FORCE, -FORCE])
    more = pulls.under(forces)
    np.testing.assert_array_equal(more.force, forces.reshape(-1, 3))
    np.testing.assert_array_equal(more.q, np.tile(Q, (3, 1)))
    poses = more.pose.reshape(3, 5)
    assert (poses - poses[:, :1] == pulls.pose - 3).all()
    assert len({*poses.ravel().tolist()}) == 3 * 4


@pytest.mark.parametrize(
    ("where", "name", "axis", "words"),
    [
        (None, "", None, ""),
        (3, "", None, " in joint 3"),
        (3, "", "A2", " in joint 3 (A2)"),
        ("forearm", "", None, " in the forearm"),
        ("scale", "", None, " at the scale"),
        ("P2", "target_moved", None, " at P2"),
        ("ballast", "payload_mass", None, " of ballast"),
    ],
)
def test_a_place_is_said_in_words(where: object, name: str, axis: str | None, words: str) -> None:
    """A joint by number and axis, a part of the robot, a point, or a thing."""
    assert in_place(where, name, axis) == words


HEAVY = load("fanuc_r2000ic")
LINKS = RNG.uniform(10, 200, (6, 1)) * np.column_stack([np.ones(6), RNG.normal(0, 0.3, (6, 3))])
QH = RNG.uniform(-1, 1, (4, 6))


def potential(q: np.ndarray, links: np.ndarray, mass: float, centre: np.ndarray) -> np.ndarray:
    """Energy of the weight of links and payload [J] by its masses one by one, shape (m,)."""
    here = configure(HEAVY, q)
    energy = np.zeros(len(q))
    for k, (m, *moment) in enumerate(links):
        R, o = here.frame(k + 1)
        energy -= (m * o + R @ np.array(moment)) @ GRAVITY
    return energy - mass * (here.points(centre[None])[:, 0] @ GRAVITY)


def slope(of: object, q: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """Derivative by each joint, last axis."""
    ends = [(of(q + step * e) - of(q - step * e)) / (2 * step) for e in np.eye(q.shape[1])]
    return np.stack(ends, axis=-1)


def test_weight_turns_joints_by_the_slope_of_its_energy() -> None:
    """The torque is -dE/dq, of links and payload together and each by itself."""
    here, centre = configure(HEAVY, QH), np.array([0.1, -0.2, 0.3])
    for links, mass in ((LINKS, 0.0), (0 * LINKS, 150.0), (LINKS, 150.0), (0 * LINKS, 0.0)):
        wrench = carried(here, GRAVITY, links, np.full(4, mass), np.tile(centre, (4, 1)))
        expected = -slope(lambda q, links=links, m=mass: potential(q, links, m, centre), QH)
        np.testing.assert_allclose(work(here.twists, wrench), expected, rtol=1e-6, atol=1e-5)


def test_a_wrench_of_weight_is_linear_in_mass_and_first_moment() -> None:
    """The sum over the four columns of each link is what the last joint before it carries."""
    here = configure(HEAVY, QH)
    by = np.einsum("mnki,nk->mni", by_moments(here, GRAVITY), LINKS)
    whole = carried(here, GRAVITY, LINKS, np.zeros(4), np.zeros((4, 3)))
    own = whole - np.concatenate([whole[:, 1:], np.zeros((4, 1, 6))], axis=1)
    np.testing.assert_allclose(by, own, rtol=1e-9, atol=1e-6)


def test_weight_stiffens_by_the_curvature_of_its_energy() -> None:
    """G = d tau / dq by differences of the torques."""

    def torques(q: np.ndarray) -> np.ndarray:
        here = configure(HEAVY, q)
        nothing = np.zeros(len(q)), np.zeros((len(q), 3))
        return work(here.twists, carried(here, GRAVITY, LINKS, *nothing))

    found = stiffening(configure(HEAVY, QH), GRAVITY, LINKS)
    np.testing.assert_allclose(found, slope(torques, QH), rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(found, np.swapaxes(found, 1, 2))


def _weighing(joint, mass):
    """A joint of the file whose link has this mass."""
    return joint.model_copy(update={"mass_kg": mass, "centre_of_mass_m": (0.1, 0.2, -0.3)})


def test_the_links_of_a_file_weigh_as_it_states() -> None:
    """Those without a mass weigh nothing; a payload by hand at its lever."""
    light = replace(HEAVY, joints=tuple(_weighing(one, None) for one in HEAVY.joints))
    assert not weighs(light)
    assert not link_moments(light).any()
    some = _weighing(HEAVY.joints[2], 50.0)
    heavy = replace(light, joints=(*light.joints[:2], some, *light.joints[3:]))
    assert weighs(heavy)
    assert link_moments(heavy)[2] == pytest.approx([50, 5, 10, -15])
    assert not link_moments(heavy)[[0, 1, 3, 4, 5]].any()
    here, centre = configure(light, QH), np.array([0.1, -0.2, 0.3])
    found = gravity_torque(light, here, GRAVITY, np.full(4, 80.0), np.tile(centre, (4, 1)))
    r = here.points(centre[None])[:, 0]
    for k in range(6):
        axis, o = here.frame(k + 1)[0][:, :, 2], here.frame(k + 1)[1]
        by_hand = np.einsum("mi,mi->m", axis, np.cross(r - o, 80.0 * GRAVITY))
        np.testing.assert_allclose(found[:, k], by_hand, rtol=1e-9, atol=1e-9)


def test_capsules_move_with_their_link_and_those_of_the_base_stay() -> None:
    """Both ends by the frame of the joint, the m poses side by side."""
    here = configure(RAIL, Q)
    ends = RNG.normal(size=(2, 3, 3))
    bodies = Capsules(np.array([0, 2, 7]), ends, np.array([0.1, 0.2, 0.3]), "own")
    found = here.placed(bodies)
    assert found.shape == (2, 3, 3, 5)
    for end in (0, 1):
        np.testing.assert_allclose(found[end, :, 0], np.tile(ends[end, 0][:, None], 5))
        for c, joint in ((1, 2), (2, 7)):
            R, o = here.frame(joint)
            np.testing.assert_allclose(found[end, :, c].T, o + R @ ends[end, c], atol=1e-12)
    assert bodies.half == pytest.approx(np.linalg.norm(ends[1] - ends[0], axis=1) / 2)
    both = together(bodies, Capsules(np.array([1]), ends[:, :1], np.array([0.4])))
    assert (len(both), both.source) == (4, "own")
    assert both.carrier.tolist() == [0, 2, 7, 1]
    assert both.radius.tolist() == [0.1, 0.2, 0.3, 0.4]
    np.testing.assert_array_equal(both.ends[:, 3], ends[:, 0])


def test_screws_move_points_as_rotations_and_translations_do() -> None:
    """About an axis through a point, and along one; products as numpy's."""
    a, b = RNG.normal(size=(2, 6, 2, 3))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b))
    axis = np.array([[0.0, 0.6, 0.8]])
    origin, point = np.array([[1.0, 2.0, 3.0]]), np.array([0.3, -0.4, 0.5])
    turn = rotation_about(origin, axis)[0]
    by_hand = (
        Rotation.from_rotvec(1e-6 * axis[0]).apply(point - origin[0]) - point + origin[0]
    ) / 1e-6
    np.testing.assert_allclose(np.cross(turn[:3], point) + turn[3:], by_hand, atol=1e-5)
    assert translation_along(axis)[0].tolist() == [0, 0, 0, 0, 0.6, 0.8]


def test_a_small_motion_of_a_body_has_six_coordinates() -> None:
    """Shift of the centroid and L times the rotation, L by hand; for columns as for vectors."""
    points = RNG.normal(size=(4, 3))
    levers = points - points.mean(axis=0)
    L = np.sqrt((levers**2).sum() / 4)
    s, w = RNG.normal(size=(2, 5, 3)) * 1e-4
    many = np.tile(levers, (5, 1, 1))
    moved = s[:, None] + np.cross(w[:, None], many)

    assert six.radius(points) == pytest.approx(L)
    found = six.coordinates(many, moved, six.radius(points))
    np.testing.assert_allclose(found, np.stack([s, L * w], axis=1), atol=1e-12)
    columns_ = six.coordinates(many, np.stack([moved, 2 * moved], axis=-1), L)
    np.testing.assert_allclose(columns_, np.stack([found, 2 * found], axis=-1), atol=1e-12)


def test_a_tool_measured_as_one_pose_has_two_vectors_for_every_pull() -> None:
    """Of the targets' own displacements, in predictions and columns alike."""
    whole = replace(TOOL, six=True)
    cell, each = (paper_cell(RAIL, tool) for tool in (whole, TOOL))
    pulls, x = Pulls.at(Q, FORCE), RAIL.nominal_compliance
    here = configure(RAIL, Q)
    middle = TOOL.points - TOOL.points.mean(axis=0)
    levers = np.einsum("mij,tj->mti", here.flange_axes, middle)
    expected = six.coordinates(
        levers, predict(each, pulls, x).displacement, six.radius(TOOL.points)
    )

    assert whole.read.tolist() == ["position", "rotation"]
    assert TOOL.read.tolist() == ["P1", "P2", "P3"]
    assert [*TOOL.named] == ["load_point", "P1", "P2", "P3"]
    np.testing.assert_allclose(predict(cell, pulls, x).displacement, expected, atol=1e-15)
    np.testing.assert_allclose(jacobian(cell, pulls, x) @ x, expected, atol=1e-12)


def test_an_effect_that_is_held_acts_without_a_parameter() -> None:
    """The same displacement as with the effect and its value, one unknown less."""
    (roll,) = [one for one in catalogue(RAIL) if one.name == "rail_roll"]
    pulls, x = Pulls.at(Q, FORCE), RAIL.nominal_compliance
    free = paper_cell(RAIL, TOOL).with_effects(roll)
    held = replace(paper_cell(RAIL, TOOL), held=((roll, np.array([2e-8])),))

    assert len(held.parameters) == 7
    assert [p.name for p in free.parameters][7:] == [p.name for p in roll.parameters]
    one, other = predict(free, pulls, np.append(x, 2e-8)), predict(held, pulls, x)
    np.testing.assert_allclose(one.displacement, other.displacement, atol=1e-16)
    np.testing.assert_allclose(one.loaded, other.loaded)
    alone = columns(roll, loaded(free, pulls, np.append(x, 2e-8)))[..., 0]
    plain = predict(paper_cell(RAIL, TOOL), pulls, x).displacement
    np.testing.assert_allclose(other.displacement - plain, 2e-8 * alone, atol=1e-12)


def test_a_weight_acts_at_its_own_point_of_the_flange() -> None:
    """As on a tool with that load point; others act where the tool says."""
    own = np.array([0.3, 0.2, -0.1])
    acts = np.full((5, 3), np.nan)
    acts[2] = own
    pulls, x = replace(Pulls.at(Q, FORCE), acts_at=acts), RAIL.nominal_compliance
    mixed = predict(paper_cell(RAIL, TOOL), pulls, x).displacement
    for load_point, rows in ((own, [2]), (TOOL.load_point, [0, 1, 3, 4])):
        cell = paper_cell(RAIL, replace(TOOL, load_point=load_point))
        alike = predict(cell, Pulls.at(Q, FORCE), x).displacement
        np.testing.assert_allclose(mixed[rows], alike[rows], atol=1e-15)


WAVE = Law(3, "spring", "periodic", "angle", 3, 1.0, -1.25, 0.5)
"""A wave in the spring of joint 3 over its angle."""


def law(**own: object) -> Law:
    """The wave with changes."""
    return replace(WAVE, **own)


@pytest.mark.parametrize(
    "one",
    [
        law(),
        law(where="rail", part="roll", kind="step", variable="position", source=0, at=1 / 3),
        law(beyond=True),
        law(more=law(order=2.0, more=law(order=3.0))),
    ],
)
def test_a_law_is_read_back_as_it_was_written(one: Law) -> None:
    """To the last digit, with all its shapes."""
    assert parse(str(one.where), one.form) == one


def test_shapes_of_a_law_are_laws_of_one_family() -> None:
    """One more shape extends; another place does not."""
    one, two = law(), law(more=law(order=2.0))
    three = law(more=law(order=2.0, more=law(order=3.0)))

    assert [s.order for s in three.shapes] == [1, 2, 3]
    assert all(s.more is None for s in three.shapes)
    assert two.extends(one)
    assert three.extends(two)
    assert not three.extends(one)
    assert not one.extends(one)
    assert not law(source=2, more=law(order=2.0)).extends(one)
    assert one.of == two.of == law(kind="smooth").of != law(part="friction").of
    assert one.family == law(order=4.0, low=0.0).family != law(kind="smooth").family
    for wrong in ("spring odd angle 3 1 0 1 0 False", "spring smooth colour 3 1 0 1 0 False"):
        with pytest.raises(ValueError, match=wrong):
            parse("3", wrong)
