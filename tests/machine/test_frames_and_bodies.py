"""Fixed steps between frames, capsules in the frames of joints, and the cell's limits."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.base.errors import InputError
from pipeline.design.room import together
from pipeline.machine.robot import load
from pipeline.machine.robot.capsules import Capsule, capsules
from pipeline.machine.robot.steps import Fixed, screw_x, screw_z
from pipeline.machine.surroundings import Surrounded, tooled, turns


def test_a_fixed_step_is_yaw_after_pitch_after_roll():
    """As scipy has extrinsic angles about x, y and z."""
    step = Fixed(xyz_m=(1.0, 2.0, 3.0), rpy_deg=(20.0, -35.0, 110.0)).step
    turned = Rotation.from_euler("xyz", [20.0, -35.0, 110.0], degrees=True).as_matrix()

    assert step[:3, :3] == pytest.approx(turned, abs=1e-14)
    assert step[:, 3].tolist() == [1.0, 2.0, 3.0, 1.0]


def test_a_row_of_a_table_is_two_screws():
    """Each turns about its axis and shifts along it; the second begins where the first ends."""
    T = screw_x(np.pi / 2, 0.3) @ screw_z(np.pi / 2, 0.7)

    assert T[:3, 3] == pytest.approx([0.3, -0.7, 0.0], abs=1e-15)  # z after the first is -y
    assert T[:3, 0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)


def test_a_capsule_lies_in_the_frame_of_its_row():
    """Its frame is turned by 90 degrees about z and a metre ahead of that of the joint."""
    rows = [Capsule.model_validate({"link": "a2", "from": (0.5, 0, 0), "to": (0, 0.5, 0),
                                    "radius": 0.1})]  # fmt: skip
    made = capsules(rows, {"a2": (2, screw_z(np.pi / 2, 0.0) + np.eye(4, k=3))}, "drawn", "r.toml")

    assert made.carrier.tolist() == [2]
    assert made.ends[:, 0] == pytest.approx(np.array([[1.0, 0.5, 0.0], [0.5, 0.0, 0.0]]))
    assert made.half == pytest.approx([np.sqrt(0.5) / 2])
    assert len(together(made, made)) == 2
    with pytest.raises(InputError, match="a9"):
        capsules([rows[0].model_copy(update={"link": "a9"})], {"a2": (2, np.eye(4))}, "", "r.toml")


def test_cables_narrow_the_limits_of_their_joint_alone():
    """Of a joint that may turn further; and a rail does not turn."""
    robot = load("kr500_rail")
    name = robot.joints[6].name
    lower, upper = turns(robot, Surrounded.model_validate({"cell": {"max_turn_deg": {name: 90}}}))

    assert (lower[6], upper[6]) == pytest.approx((-np.pi / 2, np.pi / 2))
    assert lower[:6] == pytest.approx(robot.lower[:6])
    assert robot.upper[6] > np.pi / 2, "the robot's own are not narrowed"
    for wrong in (robot.joints[0].name, "elbow"):
        stated = Surrounded.model_validate({"cell": {"max_turn_deg": {wrong: 90}}})
        with pytest.raises(InputError, match=wrong):
            turns(robot, stated)


def test_a_cell_is_handed_on_as_it_was_stated():
    """The tables of the tool below it, its points beside them."""
    cone = {"P1": {"direction": [0, 0, 1], "half_angle_deg": 50}}
    stated = Surrounded.model_validate({"cell": {"floor_z_m": 0.0}, "tool.acceptance": cone})
    again = tooled({"load_point": [0, 0, 0.1]}, stated)

    assert again["tool"]["acceptance"]["P1"]["half_angle_deg"] == 50
    assert again["tool"]["load_point"] == [0, 0, 0.1]
    assert again["cell"] == {"floor_z_m": 0.0}
