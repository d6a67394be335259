"""Robots made from makers' packages: position, reach, and how they are found.

Flanges are from Pinocchio with the URDF of the package that the robot file names; reaches are as
published by the makers. Neither uses our DH parameters or our kinematics.
"""

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.machine.robot import SHIPPED, axes, configure, load

Q_DEG = [20, -30, 50, 30, 50, -70]
FLANGES = [
    ("kr120_r2700_2", [2.408241, -0.964159, 0.72951], [0.22338, -0.48891, -0.84325]),
    ("kr150_r3100_2", [2.747603, -1.087681, 0.761097], [0.22338, -0.48891, -0.84325]),
    ("kr210_r3100_2", [2.753188, -1.099903, 0.740016], [0.22338, -0.48891, -0.84325]),
    ("kr240_r2900_2", [2.576583, -1.035625, 0.80842], [0.22338, -0.48891, -0.84325]),
    ("kr300_r2700_2", [2.413824, -0.976385, 0.70842], [0.22338, -0.48891, -0.84325]),
    ("kr240_r3330", [2.921495, -1.181542, 0.877193], [0.22338, -0.48891, -0.84325]),
    ("kr360_r2830", [2.479984, -1.020845, 1.048203], [0.22338, -0.48891, -0.84325]),
    ("kr500_r2800_2", [2.51709, -1.032721, 0.969254], [0.22338, -0.48891, -0.84325]),
    ("kr560_r3100_2", [2.7707, -1.132772, 1.193133], [0.22338, -0.48891, -0.84325]),
    ("kr800_r2800_2", [2.526561, -1.043912, 1.043133], [0.22338, -0.48891, -0.84325]),
    ("irb4600_20_250", [0.811754, 0.330101, 1.115212], [0.22338, 0.48891, -0.84325]),
    ("irb4600_40_255", [0.857803, 0.367241, 1.059539], [0.22338, 0.48891, -0.84325]),
    ("irb4600_60_205", [0.675686, 0.300956, 0.996691], [0.22338, 0.48891, -0.84325]),
    ("irb6700_200_260", [0.889932, 0.405429, 1.382809], [0.22338, 0.48891, -0.84325]),
    ("irb6700_235_265", [0.920554, 0.416575, 1.377788], [0.22338, 0.48891, -0.84325]),
    ("irb7600_150_350", [1.765704, 0.744565, 0.967069], [0.22338, 0.48891, -0.84325]),
    ("fanuc_m20ia", [-0.389332, -0.100945, 2.149709], [-0.64005, 0.17465, 0.74822]),
    ("fanuc_m20ia_10l", [-0.355881, -0.08877, 2.351594], [-0.64005, 0.17465, 0.74822]),
    ("fanuc_m20ib_25", [-0.388642, -0.100694, 2.381272], [-0.64005, 0.17465, 0.74822]),
    ("fanuc_m900ia_260l", [-0.225334, 0.028038, 3.775174], [-0.64005, 0.17465, 0.74822]),
    ("fanuc_r2000ib_210f", [-0.361666, -0.035849, 3.076434], [-0.64005, 0.17465, 0.74822]),
    ("fanuc_r2000ic_125l", [-0.275435, -0.012615, 3.504633], [-0.64005, 0.17465, 0.74822]),
    ("fanuc_r2000ic_165f", [-0.348865, -0.039342, 3.06147], [-0.64005, 0.17465, 0.74822]),
    ("fanuc_r2000ic_210l", [-0.291437, -0.008249, 3.523339], [-0.64005, 0.17465, 0.74822]),
    ("fanuc_r2000ic_270f", [-0.364866, -0.034975, 3.080176], [-0.64005, 0.17465, 0.74822]),
    ("gp12", [-0.287489, -0.063877, 1.721568], [-0.64005, 0.17465, 0.74822]),
    ("gp25", [-0.335493, -0.081349, 2.055653], [-0.64005, 0.17465, 0.74822]),
    ("gp35l", [-0.510523, -0.114485, 2.909724], [-0.64005, 0.17465, 0.74822]),
    ("gp50", [-0.411601, -0.07848, 2.470275], [-0.64005, 0.17465, 0.74822]),
    ("gp88", [-0.247155, -0.018626, 2.470275], [-0.64005, 0.17465, 0.74822]),
    ("gp110", [-0.287108, -0.022978, 2.488398], [-0.64005, 0.17465, 0.74822]),
    ("gp180", [-0.456668, -0.074503, 3.072763], [-0.64005, 0.17465, 0.74822]),
    ("gp180_120", [-0.397109, -0.052825, 3.432218], [-0.64005, 0.17465, 0.74822]),
    ("ur3e", [-0.302568, -0.312586, 0.091798], [-0.24286, -0.77243, -0.58682]),
    ("ur5e", [-0.599014, -0.428009, 0.118326], [-0.24286, -0.77243, -0.58682]),
    ("ur16e", [-0.589678, -0.479677, 0.15134], [-0.24286, -0.77243, -0.58682]),
    ("ur20", [-1.199008, -0.75585, 0.225127], [-0.24286, -0.77243, -0.58682]),
    ("ur30", [-0.817223, -0.616892, 0.189581], [-0.24286, -0.77243, -0.58682]),
]
"""Robot, flange origin [m] and its z at `Q_DEG` of the URDF."""
REACH_M = {
    # KUKA: R of the type code, in mm
    "kr120_r2700_2": 2.70,
    "kr150_r3100_2": 3.10,
    "kr210_r3100_2": 3.10,
    "kr240_r2900_2": 2.90,
    "kr300_r2700_2": 2.70,
    "kr240_r3330": 3.33,
    "kr360_r2830": 2.83,
    "kr500_r2800_2": 2.80,
    "kr560_r3100_2": 3.10,
    "kr800_r2800_2": 2.80,
    # ABB: after the stroke of the type code, in m
    "irb4600_20_250": 2.51,
    "irb4600_40_255": 2.55,
    "irb4600_60_205": 2.05,
    "irb6700_200_260": 2.60,
    "irb6700_235_265": 2.65,
    "irb7600_150_350": 3.50,
    # FANUC and Yaskawa: data sheets, in mm
    "fanuc_m20ia": 1.811,
    "fanuc_m20ia_10l": 2.009,
    "fanuc_m20ib_25": 1.853,
    "fanuc_m900ia_260l": 3.10,
    "fanuc_r2000ib_210f": 2.655,
    "fanuc_r2000ic_125l": 3.10,
    "fanuc_r2000ic_165f": 2.655,
    "fanuc_r2000ic_210l": 3.10,
    "fanuc_r2000ic_270f": 2.655,
    "gp12": 1.44,
    "gp25": 1.73,
    "gp35l": 2.538,
    "gp50": 2.061,
    "gp88": 2.236,
    "gp110": 2.236,
    "gp180": 2.702,
    "gp180_120": 3.058,
}
"""Largest distance of the wrist centre from the first axis, as published [m]."""
UR_REACH_M = {"ur3e": 0.5, "ur5e": 0.85, "ur16e": 0.9, "ur20": 1.75, "ur30": 1.3}
"""Reach of the UR [m], whose maker refers to different points of the wrist."""


def farthest(robot, behind):
    """Largest distance of a joint's origin (or the flange) from the first axis, within limits."""
    lower = np.maximum(robot.lower, -np.pi)
    upper = np.minimum(robot.upper, np.pi)
    q = np.zeros((121 * 121, robot.n))
    grid = np.meshgrid(*(np.linspace(lower[k], upper[k], 121) for k in (1, 2)))
    q[:, 1], q[:, 2] = (one.ravel() for one in grid)
    if behind is None:  # with the wrist turned, too
        q[:, 3:5] = np.random.default_rng(2).uniform(-np.pi, np.pi, (len(q), 2))
    here = configure(robot, q)
    points = here.flange_origin if behind is None else here.origin[:, behind]
    return np.linalg.norm(points[:, :2], axis=1).max()


@pytest.mark.parametrize(("name", "at", "z"), FLANGES, ids=[row[0] for row in FLANGES])
def test_a_robot_stands_where_the_urdf_of_its_package_stands(name, at, z):
    """To 20 micrometres: some packages round pi to four digits, our DH parameters do not."""
    here = configure(load(name), np.deg2rad(Q_DEG)[None])

    assert here.flange_origin[0] == pytest.approx(at, abs=2e-5)
    assert here.flange_axes[0, :, 2] == pytest.approx(z, abs=2e-5)


@pytest.mark.sampled(12)
@pytest.mark.parametrize("name", REACH_M)
def test_the_wrist_reaches_as_far_as_published(name):
    """To 0.5 %: type codes are rounded to 10 mm, and limits reduce the reach slightly."""
    assert farthest(load(name), 4) == pytest.approx(REACH_M[name], rel=5e-3)


@pytest.mark.parametrize("name", UR_REACH_M)
def test_a_ur_reaches_between_its_wrist_and_its_flange(name):
    """Upper and lower arm are shorter than the published reach, the whole arm is longer."""
    robot = load(name)

    assert farthest(robot, 3) < UR_REACH_M[name] < farthest(robot, None)


def test_every_robot_states_payload_source_and_axes_of_its_controller():
    """What is needed to find a robot; FANUC counts J3 from the horizontal."""
    for name in [row[0] for row in FLANGES]:
        robot = load(name)
        assert robot.payload_kg
        assert "commit" in robot.text
        assert len(axes.of(robot).names) == 6

    fanuc = load("fanuc_m20ia").controller_matrix @ np.array([0, 10, 5, 0, 0, 0])

    assert fanuc[2] == 15


@pytest.mark.parametrize("name", SHIPPED)
def test_axes_of_the_controller_become_joints(name):
    """The matrix in the file, mm and degrees; the inverse is `axes.displayed`."""
    robot = load(name)
    q = np.random.default_rng(4).uniform(-1, 1, (3, robot.n))

    assert robot.from_controller(axes.displayed(robot, q)) == pytest.approx(q, abs=1e-12)
    assert robot.from_controller(axes.displayed(robot, q)[0]).shape == (robot.n,)


def test_no_two_robots_that_ship_have_one_geometry():
    """Otherwise they could not be distinguished, and a wrong choice would be named by chance."""
    q = np.random.default_rng(1).uniform(-1, 1, (4, 7))
    seen = {}
    for name in SHIPPED:
        robot = load(name)
        at = configure(robot, q[:, : robot.n]).flange_origin.round(4).tobytes()
        assert seen.setdefault((robot.n, at), name) == name


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("kr210", "kr210_l150, kr210_r2700_2, kr210_r3100_2"),
        ("KR 210 R2700", "kr210_r2700_2"),
        ("ur10_e", "ur10e"),
        ("IRB6700", "irb6700_200_260"),
        ("R-2000iC/165F", "fanuc_r2000ic_165f"),
        ("KUKA", "kr500_rail"),
        ("KR 600 R2830", "kr360_r2830"),
    ],
)
def test_a_brand_name_finds_its_robots(typed, meant):
    """Users type what is on the type plate, not the name of our file."""
    with pytest.raises(InputError) as refused:
        load(typed)

    assert meant in str(refused.value)
    assert "pipeline robot --list" in str(refused.value)
