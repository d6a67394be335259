"""[test_pose] in the controller's axes or the joints of the robot file, with suggestions."""

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.base.errors import InputError
from pipeline.machine.robot import configure, load
from pipeline.machine.robot.mdh import parse
from pipeline.reduction.settings import AskedPose

KR210 = load("kr210_r2700_2")
FORCE = (0.0, 0.0, -1000.0)


def refused(robot, **said):
    """The message with which a pose is refused."""
    with pytest.raises(InputError) as stopped:
        AskedPose(force_n=FORCE, **said).within_limits(robot)
    return str(stopped.value)


def test_axes_are_those_of_the_controller_in_mm_and_degrees():
    """E1 = 8500 and the axes of a KUKA give the joints of the robot file."""
    rail = load("kr500_rail")
    q = np.array([8.5, *np.deg2rad([-10, 35, 39, 81, 22, -10])])
    # by hand from [controller] of the file, not by the code under test
    axes = np.linalg.solve(rail.controller_matrix, q - rail.controller_offset)
    said = [1e3 * axes[0], *np.rad2deg(axes[1:])]

    found = AskedPose(axes=said, force_n=FORCE).joint_values(rail)

    assert found == pytest.approx(q, abs=1e-12)
    assert configure(rail, found[None]).flange_origin[0] == pytest.approx(
        configure(rail, q[None]).flange_origin[0]
    )


@pytest.mark.parametrize("said", [{}, {"q": [0.0] * 6, "axes": [0.0] * 6}])
def test_a_pose_is_given_once(said):
    """Neither none nor both."""
    with pytest.raises(ValidationError, match="either axes"):
        AskedPose(force_n=FORCE, **said)


def test_a_wrong_sign_is_offered_with_the_right_one():
    """A2 = 100 is beyond a KUKA's limits, A2 = -100 is not."""
    said = refused(KR210, axes=[10.0, 100.0, 60.0, 0.0, 20.0, 0.0])

    assert "is A2 = -100 meant, with the other sign?" in said


def test_axes_under_the_key_of_the_joints_are_offered_as_axes():
    """Joints of a robot file may differ from its axes: values that fit the axes are offered so."""
    rail = load("kr500_rail")
    said = refused(rail, q=[8.5, 20.0, -100.0, 120.0, 10.0, 40.0, 0.0])

    assert "axes = [8500, 20, -100, 120, 10, 40, 0]" in said


def test_an_axis_beyond_its_limit_is_called_as_the_controller_does():
    """With the joint of the robot file, and its limits in the axis."""
    robot = load("kr210_r2700_2")
    with pytest.raises(InputError, match=r"axes has A3, which is theta3 = 200 deg, outside"):
        AskedPose(axes=[5, -70, 200, 0, 30, 0], force_n=[0, 0, -800]).within_limits(robot)


def test_too_few_axes_are_counted():
    """With the names of the expected ones."""
    assert "one value for each of A1, A2, A3, A4, A5, A6" in refused(KR210, axes=[1.0, 2.0])


NAMED = """
[controller]
axes = ["A1", "A2", "A3", "A4", "A5", "A6"]
matrix = [
    [-1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0],
    [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1],
]
"""


def called_as_axes(controller):
    """The KR 210's file with its joints called A1 to A6."""
    text = KR210.text[: KR210.text.index("[controller]")] + controller
    for k, joint in enumerate(KR210.joints, 1):
        text = text.replace(f'name = "{joint.name}"', f'name = "A{k}"')
        text = text.replace(f'link = "{joint.name}"', f'link = "A{k}"')
    return text


def test_joints_called_like_axes_that_they_are_not_are_refused():
    """A column A1 of a log could be either; equal names with equal meaning are accepted."""
    text = called_as_axes(NAMED)
    line = 1 + text[: text.index("axes = [")].count("\n")

    with pytest.raises(InputError) as stopped:
        parse(text, "own.toml")
    assert "joint A1 = -1 A1" in str(stopped.value)
    assert f"own.toml:{line}" in str(stopped.value)
    same = parse(called_as_axes(NAMED.replace("[-1,", "[1,")), "own.toml")
    assert same.controller == tuple(joint.name for joint in same.joints)
