"""Tables of robots: letters against differences, axes, wrong readings, and what a robot bears."""

import tomllib
from dataclasses import replace
from types import SimpleNamespace as Some

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.machine.law import Law
from pipeline.machine.robot import axes, configure, load, mdh, rating, variants
from pipeline.machine.robot.dh_parameters import changed, dh_parameters, nominal, twists
from pipeline.machine.robot.weight import link_moments, weighs
from pipeline.machine.surroundings import Surrounded, turns

RAIL, UR, FANUC = load("kr500_rail"), load("ur10"), load("fanuc_r2000ic")
POINT = np.array([[0.3, -0.2, 0.4]])


@pytest.mark.parametrize("robot", [RAIL, UR, FANUC], ids=lambda one: one.name)
def test_letters_move_a_point_as_their_twists_say(robot):
    """By differences of the robot with that entry changed, in its own unit."""
    rng = np.random.default_rng(5)
    q = rng.uniform(-1.0, 1.0, (2, robot.n))
    letters = dh_parameters(robot)
    here = configure(robot, q)
    p = here.points(POINT)[:, 0]
    found = twists(here, letters)
    before = nominal(robot, letters)
    for k, letter in enumerate(letters):
        h = 1e-6
        ahead = changed(robot, (letter,), np.array([h]))
        moved = (configure(ahead, q).points(POINT) - p[:, None]) / h
        w, v = found[:, k, :3], found[:, k, 3:]
        np.testing.assert_allclose(moved[:, 0], v + np.cross(w, p), atol=1e-5)
        assert bool(np.abs(w).any()) == letter.turns == (letter.unit == "rad")
        np.testing.assert_allclose(nominal(ahead, letters) - before, h * np.eye(len(letters))[k],
                                   atol=1e-12)  # fmt: skip
    tilted = robot.under(np.array([0.0, 9.0, 0.0]))
    assert changed(tilted, letters[:1], np.array([1e-3])).gravity.tolist() == [0, 9, 0]


@pytest.mark.parametrize("robot", [RAIL, UR, FANUC], ids=lambda one: one.name)
def test_letters_are_those_of_every_row_but_what_defines_the_base(robot):
    """Length and twist, a tilt where axes are parallel; offset and zero along z."""
    file = mdh.RobotFile.model_validate(tomllib.loads(robot.text))
    labels = [letter.label for letter in dh_parameters(robot)]
    expected = []
    for number, row in enumerate(file.joint, 1):
        parallel = abs(np.sin(np.deg2rad(row.alpha_deg))) < 0.2
        x = ["link_length", "link_twist", *(["axis_tilt"] if parallel else [])]
        z = ["joint_offset", "link_turn"] if row.prismatic else ["link_offset", "joint_offset"]
        if number == 1:
            x, z = (x if file.convention == "standard" else []), []
        expected += [f"{name}:{number}" for name in (*x, *z)]
    assert labels == expected
    keys = {letter.label: letter.key for letter in dh_parameters(robot)}
    x, z = ("d_m", "r_m") if file.convention == "khalil" else ("a_m", "d_m")
    assert (keys["link_length:2"], keys["link_offset:3"]) == (x, z)
    assert (keys["link_twist:2"], keys["joint_offset:3"]) == ("alpha_deg", "theta_deg")


def test_axes_are_linear_in_the_joints_and_back():
    """Q = matrix @ axes + offset; by itself an axis moves one joint, perhaps geared."""
    matrix = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0.5, 2.0]])
    one = axes.Axes(("E1", "A1", "A2"), np.array([True, False, False]), matrix,
                    np.array([0.1, 0.2, 0.3]))  # fmt: skip
    values = np.array([[1.0, 2.0, 3.0], [-1.0, 0.5, 0.0]])
    q = one.joints(values)
    np.testing.assert_allclose(q, [[1.1, -1.8, 7.3], [-0.9, -0.3, 0.55]])
    np.testing.assert_allclose(one.values(q), values, atol=1e-12)
    np.testing.assert_allclose(one.moved(q), one.values(q + one.offset))
    assert [one.alone(k) for k in range(3)] == [(0, 1.0), None, None]

    def robot(matrix, names=("E1", "A1")):
        joints = tuple(Some(name=name) for name in ("r1", "theta2"))
        return Some(
            controller=names, slides=np.array([True, False]), n=2, joints=joints,
            controller_matrix=np.array(matrix), controller_offset=np.zeros(2),
            prismatic=np.array([True, False]),
        )  # fmt: skip

    for m, names, senses in (
        ([[1.0, 0], [0, -1.0]], ("E1", "A1"), [1, -1]),
        ([[1.0, 0], [0, 0.5]], ("E1", None), [1, 0]),
        ([[1.0, 1.0], [0, 1.0]], (None, None), [0, 0]),
    ):
        assert axes.alone(robot(m)) == names
        assert [axes.sense(robot(m), k) for k in (0, 1)] == senses
    bare = robot([[1.0, 0], [0, 1.0]], ())
    assert axes.of(bare).names == ("r1", "theta2")
    assert axes.alone(bare) == (None, None)  # their numbers are those of the joints
    bare.joints = (Some(name="r1"), Some(name="theta7"))
    assert axes.alone(bare) == (None, "theta7")
    shown = axes.displayed(robot([[1.0, 0], [0, -1.0]]), np.array([0.25, np.pi / 6]))
    np.testing.assert_allclose(shown, [250.0, -30.0])
    logged = axes.in_log_units(bare, np.array([0.1234567890123456, np.deg2rad(30.0)]))
    assert logged.tolist() == [0.123456789012, 30.0]
    np.testing.assert_allclose(axes.from_log_units(bare, logged), [logged[0], np.pi / 6])
    near = axes.rounded(bare, np.array([0.12345678, np.deg2rad(30.00000049)]))
    assert near.tolist() == [0.123457, np.deg2rad(30.0)]


@pytest.mark.parametrize("robot", [RAIL, UR, FANUC], ids=lambda one: one.name)
def test_a_table_is_misread_by_one_sign_or_by_the_other_convention(robot):
    """Each length of more than a centimetre, each twist that is not flat."""
    file = mdh.RobotFile.model_validate(tomllib.loads(robot.text))
    found = dict(variants.variants(robot))
    expected = []
    for number, row in enumerate(file.joint, 1):
        lengths = (("a", row.a_m), ("d", row.d_m), ("r", row.r_m))
        expected += [f"{letter}_{number}" for letter, x in lengths if abs(x or 0) > 0.01]
        expected += [f"alpha_{number}"] * (row.alpha_deg not in (0, 180, -180))
    other = "modified_dh" if file.convention == "standard" else "standard_dh"
    assert list(found) == [*expected, other]
    keys = {"a": "a_m", "d": "d_m", "r": "r_m", "alpha": "alpha_deg"}
    for name in expected:
        letter, _, number = name.rpartition("_")
        k = int(number) - 1
        rows = [*file.joint]
        key = keys[letter]
        rows[k] = rows[k].model_copy(update={key: -getattr(rows[k], key)})
        placement, flange = mdh.placements(file.model_copy(update={"joint": rows}))
        np.testing.assert_allclose(found[name].placement, placement, atol=1e-15)
        np.testing.assert_allclose(found[name].flange, flange, atol=1e-15)
        again = mdh.parse(found[name].text, "r.toml")
        np.testing.assert_allclose(again.placement, placement, atol=1e-12)
        if letter != "alpha":
            assert variants.differing(robot, found[name]) == name
    assert variants.differing(robot, robot) is None
    assert variants.differing(robot, found[other]) is None
    assert variants.alike(robot, found[other])
    assert not variants.alike(RAIL, UR)


def test_khalils_letters_are_craigs_under_other_names():
    """Read as a standard table: d and r become a and d."""
    khalil = next(one for one in (RAIL, UR, FANUC) if 'convention = "khalil"' in one.text)
    file = mdh.RobotFile.model_validate(tomllib.loads(khalil.text))
    other, name = variants.other_convention(file)
    assert (other.convention, name) == ("standard", "standard_dh")
    for row, own in zip(other.joint, file.joint, strict=True):
        assert (row.a_m, row.d_m, row.r_m) == (own.d_m, own.r_m or 0.0, None)


def test_a_robot_bears_pulls_by_its_payload():
    """In newtons, as a multiple, and relative to 480 kg."""
    heavy, unknown = replace(RAIL, payload_kg=240.0), replace(RAIL, payload_kg=None)
    assert rating.weight_n(heavy) == pytest.approx(240 * 9.80665)
    assert rating.payloads(heavy, 4707.192) == pytest.approx(2.0)
    assert rating.relative(heavy) == 0.5
    assert (rating.weight_n(unknown), rating.payloads(unknown, 1.0)) == (None, None)
    assert rating.relative(unknown) == 1.0


def test_links_without_a_centre_have_it_at_their_origin():
    """Masses and first moments, as stated; zero where not."""
    joints = (
        Some(mass_kg=2.0, centre_of_mass_m=(0.1, 0.2, 0.3)),
        Some(mass_kg=3.0, centre_of_mass_m=None),
        Some(mass_kg=None, centre_of_mass_m=(1.0, 1.0, 1.0)),
    )
    np.testing.assert_allclose(
        link_moments(Some(joints=joints)), [[2, 0.2, 0.4, 0.6], [3, 0, 0, 0], [0, 0, 0, 0]]
    )
    assert weighs(Some(joints=joints))
    assert not weighs(Some(joints=joints[2:]))


def test_a_drive_has_the_effort_of_its_kind():
    """In newtons or newton metres; the stiffness that is stated, or the middle of its range."""
    slide = {"name": "r1", "type": "prismatic"}
    turn = {"name": "t2", "type": "revolute"}
    assert mdh.Joint(**slide, effort_n=70.0).effort == 70.0
    assert mdh.Joint(**turn, effort_nm=80.0).effort == 80.0
    assert mdh.Joint(**turn).effort is None
    assert mdh.Joint(**turn).typical_stiffness == 1e6
    assert mdh.Joint(**slide).typical_stiffness == 5e7
    ranged = mdh.Joint(**turn, stiffness_range_nm_per_rad=(1e5, 4e5))
    assert ranged.typical_stiffness == pytest.approx(2e5)
    assert ranged.stiffness is None
    assert mdh.Joint(**turn, stiffness_nm_per_rad=7e5).typical_stiffness == 7e5
    assert mdh.Joint(**slide).with_stiffness(9e7).stiffness == 9e7
    assert mdh.Joint(**turn).with_stiffness(9e5).stiffness == 9e5
    assert (mdh.Joint(**turn).lower, mdh.Joint(**turn).upper) == (-np.inf, np.inf)
    assert mdh.Joint(**turn, lower_deg=-90, upper_deg=45).upper == pytest.approx(np.pi / 4)


def test_a_law_is_driven_by_its_variable_or_by_an_overload():
    """Of what slips for good the torque is an overload."""
    one = Law(3, "spring", "smooth", "torque", 3, 1.0, -1.0, 1.0)
    assert one.driver == "torque"
    assert replace(one, part="slips").driver == "overload"
    other = replace(one, more=replace(one, kind="step"))
    assert other.extends(one)
    assert not one.extends(other)
    assert not replace(other, part="knee").extends(one)


@pytest.mark.parametrize(
    ("lower", "upper", "most", "ends"),
    [(-180, 180, 90, (-90, 90)), (-45, 180, 90, (-45, 90)), (-180, 30, 90, (-90, 30)),
     (100, 180, 90, None), (90, 180, 90, None), (-180, -100, 90, None), (-180, -90, 90, None),
     (-180, -45, 90, (-90, -45)), (45, 100, 90, (45, 90))],
)  # fmt: skip
def test_cables_leave_a_range_or_are_refused(lower, upper, most, ends):
    """What is left of a joint's limits, either side of its zero."""
    joints = list(RAIL.joints)
    joints[2] = joints[2].model_copy(update={"lower_deg": lower, "upper_deg": upper})
    robot = replace(RAIL, joints=tuple(joints))
    cell = {"cell": {"max_turn_deg": {joints[2].name: most}}}
    if ends is None:
        with pytest.raises(InputError, match="leaves nothing"):
            turns(robot, Surrounded.model_validate(cell))
        return
    low, high = turns(robot, Surrounded.model_validate(cell))
    assert (low[2], high[2]) == pytest.approx(tuple(np.deg2rad(ends)))


def test_axes_and_joints_of_a_user_are_read_by_their_number():
    """Of the controller in mm and degrees; of a robot that maps none its joints."""
    mapped = RAIL.from_controller([8500.0, 10, 20, 30, 40, 50, 60])
    axes_si = np.array([8.5, *np.deg2rad([10, 20, 30, 40, 50, 60])])
    expected = RAIL.controller_matrix @ axes_si + RAIL.controller_offset
    np.testing.assert_allclose(mapped, expected)
    bare = replace(RAIL, controller=(), controller_matrix=np.zeros((7, 0)))
    np.testing.assert_allclose(bare.from_controller([8500.0, 10, 20, 30, 40, 50, 60]), axes_si)
    np.testing.assert_allclose(bare.from_degrees([8.5, 10, 20, 30, 40, 50, 60]), axes_si)
    twice = RAIL.from_controller([[8500.0, 10, 20, 30, 40, 50, 60]] * 2)
    np.testing.assert_allclose(twice, [expected, expected])
    for robot, first in ((RAIL, RAIL.controller[0]), (bare, RAIL.joints[0].name)):
        for wrong in ([1.0] * 6, [[[1.0] * 7]], 1.0):
            with pytest.raises(InputError, match="axes has shape") as told:
                robot.from_controller(wrong)
            assert first in told.value.way_out
        with pytest.raises(InputError, match="axes is no array of numbers"):
            robot.from_controller(["x"] * 7)
    assert UR.slides.tolist() == [False] * 6
    assert RAIL.slides.tolist() == [True] + [False] * 6
    np.testing.assert_allclose(RAIL.down, [0, 0, -1])
    assert RAIL.under(RAIL.gravity.copy()) is RAIL


def controlled(**more):
    """A robot file of a slide and a turn, with axes of a controller."""
    of = {
        "format": 1, "name": "r", "description": "d", "convention": "craig", "source": "s",
        "joint": [{"name": "r1", "type": "prismatic"}, {"name": "t2", "type": "revolute"}],
        "controller": {"axes": ["E1", "A1"], "matrix": [[1, 0], [0, -1]]},
    }  # fmt: skip
    return mdh.of_table(of | more, "", "r.toml")


@pytest.mark.parametrize(
    ("controller", "said"),
    [
        ({"axes": ["E1"], "matrix": [[1, 0], [0, 1]]}, "has shape \\(2, 2\\), not 2 joints x 1"),
        ({"axes": ["E1", "A1"], "matrix": []}, "has shape \\(0, 0\\), not 2 joints x 2"),
        ({"axes": ["E1", "A1"], "matrix": [[1, 0], [0, 1]], "offset_deg": [0]},
         "offset_deg has 1 values, not 2"),
        ({"axes": ["E1", "A1"], "matrix": [[1, 0], [0, 1]], "offset_deg": [5, 0]},
         "has 5 for r1, which is prismatic"),
        ({"axes": ["E1", "T2"], "matrix": [[1, 0], [0, -1]]}, "joint t2 = -1 T2, so"),
        ({"axes": ["E1", "T2"], "matrix": [[1, 1], [0, 1]]}, "t2 is a joint, and T2 an axis"),
        ({"axes": ["E1", "T2"], "matrix": [[1, 0], [0, 1]], "offset_deg": [0, 90]},
         r"joint t2 = \+1 T2 \+90 deg, so"),
    ],
)  # fmt: skip
def test_a_controller_that_does_not_fit_is_refused(controller, said):
    """Its size, an offset of a slide, and a name that means two things."""
    with pytest.raises(InputError, match=said):
        controlled(controller=controller)


def test_a_controller_that_fits_is_taken():
    """Offsets in degrees; a name that means the same twice is fine; none is none."""
    one = controlled()
    assert one.controller == ("E1", "A1")
    assert one.controller_offset.tolist() == [0.0, 0.0]
    same = {"axes": ["R1", "T2"], "matrix": [[1, 0], [0, 1]]}
    assert controlled(controller=same).controller == ("R1", "T2")
    turned = {"axes": ["E1", "A1"], "matrix": [[1, 0], [0, 1]], "offset_deg": [0, 90]}
    np.testing.assert_allclose(controlled(controller=turned).controller_offset, [0, np.pi / 2])
    bare = controlled(controller=None)
    assert (bare.controller, bare.controller_matrix.shape) == ((), (2, 0))
    twice = [{"name": "t", "type": "revolute"}, {"name": "t", "type": "revolute"}]
    with pytest.raises(InputError, match="joint names t, t are not unique"):
        controlled(controller=None, joint=twice)
    rough = controlled(length_sigma_m=1e-3, angle_sigma_deg=0.1)
    assert rough.roughness == pytest.approx((1e-3, np.deg2rad(0.1)))
    assert np.isnan(controlled().roughness).all()


@pytest.mark.parametrize(
    ("joint", "said"),
    [
        ({"type": "prismatic", "lower_deg": 1.0}, "the other unit"),
        ({"type": "revolute", "stiffness_n_per_m": 1e6}, "the other unit"),
        ({"type": "revolute", "stiffness_range_nm_per_rad": (2e5, 2e5)}, "does not go upwards"),
        ({"type": "revolute", "lower_deg": 10.0, "upper_deg": 10.0}, "is not below upper"),
        ({"type": "prismatic", "lower_m": 2.0, "upper_m": 1.0}, "is not below upper"),
    ],
)
def test_a_row_that_contradicts_itself_is_refused(joint, said):
    """Units of the other kind, ranges and limits that are none."""
    with pytest.raises(ValueError, match=said):
        mdh.Joint(name="j1", **joint)


def test_letters_of_another_convention_are_refused():
    """Khalil has d and r, the others a and d."""
    for convention, letter in (("khalil", "a_m"), ("craig", "r_m"), ("standard", "r_m")):
        rows = [{"name": "t1", "type": "revolute", letter: 0.1}]
        with pytest.raises(InputError, match=f"convention {convention} has"):
            controlled(controller=None, convention=convention, joint=rows)
    khalil = mdh.Joint(name="t1", type="revolute", d_m=0.1, r_m=0.2)
    craig = mdh.Joint(name="t1", type="revolute", a_m=0.1, d_m=0.2)
    for row, convention in ((khalil, "khalil"), (craig, "craig"), (craig, "standard")):
        assert mdh.along_x(row, convention)[0, 3] == 0.1
        assert mdh.along_z(row, convention)[2, 3] == 0.2
