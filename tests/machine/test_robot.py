"""Robots: from DH parameters to frames, by three independent ways."""

import tomllib
from dataclasses import replace
from importlib import resources

import numpy as np
import pinocchio as pin
import pytest

from bench.as_pinocchio import model
from pipeline.base.errors import InputError
from pipeline.machine import robot as robots
from pipeline.machine.robot import SHIPPED, axes, configure, load
from pipeline.machine.robot.configuration import torque, velocity
from pipeline.machine.robot.mdh import parse
from pipeline.machine.robot.variants import alike, differing
from pipeline.machine.robot.weight import gravity_torque
from pipeline.simulate.blunders import misread

POINT = np.array([0.11, -0.07, 0.23])
RNG = np.random.default_rng(7)


def inside(robot, m, rng=RNG):
    """Joint values within the limits, +-pi if there are none."""
    lower = np.where(np.isfinite(robot.lower), robot.lower, -np.pi)
    upper = np.where(np.isfinite(robot.upper), robot.upper, np.pi)
    return rng.uniform(lower, upper, (m, robot.n))


def step(table):
    """The constant transform of `[base]` or `[flange]`, by Pinocchio's roll, pitch and yaw."""
    table = table or {"xyz_m": [0.0] * 3, "rpy_deg": [0.0] * 3}
    R = pin.rpy.rpyToMatrix(*np.deg2rad(table["rpy_deg"]))
    return pin.SE3(R, np.array(table["xyz_m"])).homogeneous


def product(content, q):
    """The product of one transform per row, directly from the TOML of a modified table."""
    T = step(content.get("base"))
    rows = content["joint"]
    for row, value in zip(rows, q, strict=True):
        alpha = np.deg2rad(row.get("alpha_deg", 0))
        theta = np.deg2rad(row.get("theta_deg", 0))
        x = row.get("a_m", 0.0) if "a_m" in row else row.get("d_m", 0.0)
        z = row.get("d_m", 0.0) if "a_m" in row else row.get("r_m", 0.0)
        if row["type"] == "prismatic":
            z = z + value
        else:
            theta = theta + value
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
        T = T @ np.array(
            [
                [ct, -st, 0, x],
                [ca * st, ca * ct, -sa, -z * sa],
                [sa * st, sa * ct, ca, z * ca],
                [0, 0, 0, 1],
            ]
        )
    return T @ step(content.get("flange"))


@pytest.fixture(params=SHIPPED)
def robot(request):
    return load(request.param)


def test_flange_is_the_product_of_the_rows_and_what_pinocchio_says(robot):
    """Numpy product, batched frames and Pinocchio agree to 1e-12 m."""
    content = tomllib.loads((resources.files(robots) / f"{robot.name}.toml").read_text())
    q = inside(robot, 50)
    batched = configure(robot, q).points(POINT[None])[:, 0]
    built = model(robot, {"tool": POINT})
    data = built.createData()

    for here, there in zip(q, batched, strict=True):
        pin.framesForwardKinematics(built, data, here)
        by_pin = data.oMf[built.getFrameId("tool")].translation
        by_hand = (product(content, here) @ np.append(POINT, 1))[:3]
        assert np.abs(by_pin - by_hand).max() < 1e-12
        assert np.abs(there - by_hand).max() < 1e-12


PUBLISHED = [
    (
        "ur10",
        [20, -60, 80, 30, 50, -70],
        [-0.6759340914, -0.4835507722, 0.3330937116],
        [-0.2428619789, -0.7724348179, -0.5868240889],
        [0.8988366212, 0.0483324003, -0.4356107293],
    ),
    (
        "ur10",
        [-100, -40, -30, -120, -80, 140],
        [-0.0497795192, 0.7539849107, 1.1881814896],
        [-0.0025980273, 0.9852658553, 0.1710100715],
        [-0.7463110983, 0.1119133594, -0.6561212879],
    ),
    (
        "ur10e",
        [20, -60, 80, 30, 50, -70],
        [-0.6750353605, -0.5107442328, 0.3703997094],
        [-0.2428619789, -0.7724348179, -0.5868240889],
        [0.8988366212, 0.0483324003, -0.4356107293],
    ),
    (
        "ur10e",
        [-100, -40, -30, -120, -80, 140],
        [-0.0599732492, 0.7793146832, 1.2495777189],
        [-0.0025980273, 0.9852658553, 0.1710100715],
        [-0.7463110983, 0.1119133594, -0.6561212879],
    ),
    (
        "kr210_l150",
        [20, -60, 80, 30, 50, -70],
        [0.6701190006, 0.338363851, 0.6162282245],
        [0.2028115384, 0.8228649885, 0.5308113513],
        [0.223377295, 0.4889064209, -0.843251502],
    ),
    (
        "kr210_l150",
        [-100, -40, -30, -120, -80, 140],
        [0.1488837181, -0.263538269, 3.0968414032],
        [0.2599437661, 0.2867951462, 0.9220508568],
        [0.7492499221, -0.6622666662, -0.0052361333],
    ),
    (
        "kr210_r2700_2",
        [20, -60, 80, 30, 50, -70],
        [2.0126953381, -0.8201959966, 1.150430218],
        [0.223377295, -0.4889064209, -0.843251502],
        [-0.2028115384, 0.8228649885, -0.5308113513],
    ),
    (
        "kr210_r2700_2",
        [-100, -40, -30, -120, -80, 140],
        [-0.1028827234, 1.6394438563, 2.5688372963],
        [0.7492499221, 0.6622666662, -0.0052361333],
        [-0.2599437661, 0.2867951462, -0.9220508568],
    ),
    (
        "irb6640",
        [20, -60, 80, 30, 50, -70],
        [0.7639902836, 0.3595904694, 0.8606961842],
        [0.223377295, 0.4889064209, -0.843251502],
        [-0.2028115384, -0.8228649885, -0.5308113513],
    ),
    (
        "irb6640",
        [-100, -40, -30, -120, -80, 140],
        [0.1642355491, -0.050868742, 2.9789067065],
        [0.7492499221, -0.6622666662, -0.0052361332],
        [-0.2599437661, -0.2867951462, -0.9220508568],
    ),
]
"""Robot, joint values [deg], flange [m], its z and its x, by Pinocchio from the URDF of the package
that the robot file names."""


@pytest.mark.parametrize(("name", "q", "at", "z", "x"), PUBLISHED)
def test_a_table_from_a_package_stands_where_its_urdf_stands(name, q, at, z, x):
    """Origin and axes of the flange, to a nanometre and to the rounding of pi in the package."""
    here = configure(load(name), np.deg2rad(q)[None])

    assert here.flange_origin[0] == pytest.approx(at, abs=1e-9)
    assert here.flange_axes[0, :, 2] == pytest.approx(z, abs=1e-9)
    assert here.flange_axes[0, :, 0] == pytest.approx(x, abs=1e-9)


def test_jacobians_are_finite_differences(robot):
    """velocity() is the derivative of the points by the joints."""
    q = inside(robot, 20)
    J = velocity(configure(robot, q).twists, configure(robot, q).points(POINT[None]))[:, 0]
    h = 1e-6

    for k in range(robot.n):
        ahead, behind = q.copy(), q.copy()
        ahead[:, k] += h
        behind[:, k] -= h
        moved = configure(robot, ahead).points(POINT[None]) - configure(robot, behind).points(
            POINT[None]
        )
        assert np.abs(moved[:, 0] / (2 * h) - J[:, k]).max() < 1e-8


def test_torque_is_the_work_of_the_force(robot):
    """J' f from screws equals J' f from Pinocchio's Jacobian."""
    q, force = inside(robot, 20), RNG.normal(size=(20, 3))
    here = configure(robot, q)
    ours = torque(here.twists, here.points(POINT[None])[:, 0], force)
    built = model(robot, {"tool": POINT})
    data = built.createData()

    for i in range(20):
        J = pin.computeFrameJacobian(
            built, data, q[i], built.getFrameId("tool"), pin.LOCAL_WORLD_ALIGNED
        )
        assert np.abs(J[:3].T @ force[i] - ours[i]).max() < 1e-12


def test_the_letters_of_khalil_and_craig_name_the_same_arm():
    """A Khalil table with d renamed a and r renamed d is a Craig table."""
    khalil = (resources.files(robots) / "kr500_rail.toml").read_text()
    craig = (
        khalil.replace('"khalil"', '"craig"').replace("\nd_m", "\na_m").replace("\nr_m", "\nd_m")
    )
    q = inside(load("kr500_rail"), 5)

    a, b = (configure(parse(text, "x.toml"), q).flange_origin for text in (khalil, craig))

    assert np.abs(a - b).max() == 0.0


def test_a_standard_table_is_read_by_its_own_rule():
    """A distal table of two revolute joints: Rz Tz Tx Rx, joint by joint."""
    text = """
format = 1
name = "two"
description = "two joints"
convention = "standard"
source = "test"
[[joint]]
name = "a1"
type = "revolute"
alpha_deg = 90
a_m = 0.3
d_m = 0.5
[[joint]]
name = "a2"
type = "revolute"
a_m = 0.7
"""
    q = np.array([[0.4, -1.1]])
    one, two = q[0]
    reach = 0.3 + 0.7 * np.cos(two)
    expected = [np.cos(one) * reach, np.sin(one) * reach, 0.5 + 0.7 * np.sin(two)]

    assert np.abs(configure(parse(text, "two.toml"), q).flange_origin[0] - expected).max() < 1e-15

    ends = """
[base]
xyz_m = [1.0, 2.0, 3.0]
rpy_deg = [0, 0, 90]
[flange]
xyz_m = [0.1, 0, 0]
rpy_deg = [0, 0, 90]
"""
    longer = expected + 0.1 * np.array(
        [np.cos(one) * np.cos(two), np.sin(one) * np.cos(two), np.sin(two)]
    )
    turned = [1 - longer[1], 2 + longer[0], 3 + longer[2]]

    assert (
        np.abs(configure(parse(text + ends, "two.toml"), q).flange_origin[0] - turned).max() < 1e-14
    )


@pytest.mark.parametrize(
    ("convention", "rows", "centres"),
    [
        ("standard", ("a_m = 0.7\nd_m = 0.3", "a_m = 0.5"), (-0.35, -0.2)),
        ("craig", ("d_m = 0.3", "a_m = 0.7"), (0.35, 0.3)),
        ("khalil", ("r_m = 0.3", "d_m = 0.7"), (0.35, 0.3)),
    ],
)
def test_a_link_weighs_where_the_frame_of_its_row_has_it(convention, rows, centres):
    """A planar arm of two links, 0.7 m long and 0.5 m, centred at 0.35 m and 0.3 m."""
    head = 'format = 1\nname = "planar"\ndescription = "-"\nsource = "-"\n'
    head += f'convention = "{convention}"\n'
    links = [
        f'[[joint]]\nname = "theta{k}"\ntype = "revolute"\n{row}\nmass_kg = {mass}\n'
        f"centre_of_mass_m = [{x}, 0.0, 0.01]\n"
        for k, row, mass, x in zip((1, 2), rows, (30.0, 20.0), centres, strict=True)
    ]
    robot, q, down = (
        parse(head + "".join(links), "x.toml"),
        np.array([[0.4, 0.9]]),
        [0.0, -9.8, 0.0],
    )
    first, second = np.cos(0.4), np.cos(1.3)

    got = gravity_torque(robot, configure(robot, q), np.array(down), np.zeros(1), np.zeros((1, 3)))
    outer = -9.8 * 20.0 * 0.3 * second
    inner = -9.8 * (30.0 * 0.35 + 20.0 * 0.7) * first
    assert got[0] == pytest.approx([inner + outer, outer])


def test_the_real_kr500_is_the_published_arm():
    """kr500_rail_kuka reaches as KUKA's dimensions 500, 1045, 1300, 55, 1525, 290 imply.

    At A1 = 0, A2 = -90, A3 = 90 the arm is upright with the forearm horizontal.
    """
    robot = load("kr500_rail_kuka")
    axes = np.deg2rad([0, 0, -90, 90, 0, 0, 0])
    q = robot.controller_matrix @ axes + robot.controller_offset

    flange = configure(robot, q[None]).flange_origin[0]

    assert np.linalg.norm(flange[:2]) == pytest.approx(0.5 + 1.525 + 0.290, abs=1e-12)
    assert flange[2] == pytest.approx(1.045 + 1.3 - 0.055, abs=1e-12)


def test_letters_are_compared_within_one_convention():
    """One wrong length is named; between two arms, or two conventions, none is."""
    craig, kr500 = load("ur10e"), load("kr500_rail")
    standard = parse(misread(craig)[0], "x.toml")

    assert differing(kr500, load("kr500_rail_kuka")) == "d_5"
    assert differing(load("kr210_r2700_2"), load("irb6640")) is None
    assert differing(craig, standard) is None
    assert alike(craig, standard)
    assert not alike(craig, kr500)


def test_a_robot_that_does_not_ship_is_refused_by_name():
    """The message names similar ones, and where the others are listed."""
    with pytest.raises(InputError, match=r"kr500_rail, kr500_rail_kuka.*pipeline robot --list"):
        load("kr500")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("lower_deg = -120.0", "lower_m = -1.0"), "theta6"),
        (("d_m = 1.3", "a_m = 1.3"), "khalil"),
        (('name = "theta3"', 'name = "theta2"'), "not unique"),
        (("lower_m = 0.0", "lower_m = 20.0"), "not below"),
        (('convention = "khalil"', 'convention = "denavit"'), "convention"),
        (("d_m = 1.3", "d_m = 1e160"), r"d_m: 1e\+160 should be at most"),
        (("d_m = 1.3", "d_m = nan"), "d_m: nan should be"),
        (("lower_deg = -120.0", "lower_deg = -inf"), "lower_deg: -inf should be"),
        (("lower_deg = -120.0", "effort_n = 5"), "theta6 is revolute"),
        (("lower_deg = -120.0", "stiffness_range_nm_per_rad = [2e5, 1e5]"), "theta6: the range"),
        (("payload_kg = 480", "payload_kg = 0"), "payload_kg"),
        (("payload_kg = 480", "flange = { rpy_deg = [0, 0] }"), "flange.rpy_deg"),
        (("offset_deg = [0, 0, 0,", "offset_deg = [5, 0, 0,"), "has 5 for r1, which is prismatic"),
        (("offset_deg = [0, 0, 0,", "offset_deg = [0,"), "5 values, not 7"),
    ],
)
def test_a_wrong_robot_file_is_refused_with_the_place(change, says):
    """Each mistake is named."""
    text = (resources.files(robots) / "kr500_rail.toml").read_text().replace(*change)
    with pytest.raises(InputError, match=says):
        parse(text, "mine.toml")


@pytest.mark.parametrize("kind", ["nm_per_rad", "n_per_m"])
def test_a_range_is_typical_of_stiffness_and_compliance_alike(kind):
    """From 1e5 to 1e7 its middle is 1e6, and so is that of the compliances; a value goes first."""
    joint = next(one for one in robots.load("kr500_rail").joints
                 if one.prismatic == (kind == "n_per_m"))  # fmt: skip
    spread = joint.model_copy(
        update={f"stiffness_{kind}": None, f"stiffness_range_{kind}": (1e5, 1e7)}
    )

    assert spread.typical_stiffness == pytest.approx(1e6, rel=1e-12)
    assert spread.with_stiffness(3e6).typical_stiffness == 3e6
    bare = joint.model_copy(update={f"stiffness_{kind}": None, f"stiffness_range_{kind}": None})
    assert 1e5 < bare.typical_stiffness < 1e9
    assert (bare.typical_stiffness > 1e7) == joint.prismatic


@pytest.mark.parametrize(
    ("own", "said"),
    [
        (["E1", "A1", "A2"], (None, "A1", "A2")),
        (["theta1", "theta2", "theta3"], (None, None, None)),
        (["rail", "shoulder", "3"], ("rail", "shoulder", None)),
    ],
)
def test_a_joint_is_called_by_its_name_where_its_number_is_another(own, said):
    """Behind a rail, A1 is the second joint; `joint 2 (A1)` cannot be taken for A2."""
    robot = load("kr500_rail")
    joints = [j.model_copy(update={"name": n}) for j, n in zip(robot.joints[:3], own, strict=True)]
    some = replace(robot, joints=tuple(joints), controller=())

    assert axes.alone(some) == said
