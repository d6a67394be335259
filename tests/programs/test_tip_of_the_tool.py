"""The force acts where the program's coordinates are: at the origin of the tool."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.machine.cell import Tool
from pipeline.machine.robot import axes, configure, load
from pipeline.prediction.tolerance import nominal
from pipeline.programs.aim import Setting, aim
from pipeline.programs.forces import tips_of
from pipeline.programs.notation import KUKA
from pipeline.programs.program import Number, Target

ROBOT = load("kr500_rail")
Q = np.array([3.0, *np.deg2rad([-10, 35, 39, 81, 22, -10])])
TOOL = Tool(np.array([0.0, 0.0, 0.1]), np.array(["P1"], object), np.array([[0.1, 0.0, 0.1]]))


def frame(turn, at):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_euler("ZYX", turn, degrees=True).as_matrix(), at
    return out


@pytest.mark.parametrize("turn", [[0, 0, 0], [180, 0, 0], [20, 90, -30]])
def test_the_tip_is_at_the_coordinates_of_the_target(turn):
    """Also where the controller's flange frame is another one than that of the robot file."""
    here = configure(ROBOT, Q[None])
    tool, flange = frame([10, 20, 30], [0.15, -0.05, 0.4]), frame(turn, [0.0, 0.02, 0.03])
    stands = np.eye(4)
    stands[:3, :3], stands[:3, 3] = here.flange_axes[0], here.flange_origin[0]
    wanted = stands @ flange @ tool
    angles = Rotation.from_matrix(wanted[:3, :3]).as_euler("ZYX", degrees=True)
    numbers = tuple(Number(0, 0, float(v)) for v in (*(1e3 * wanted[:3, 3]), *angles))
    target = Target("P1", "p.src", 1, "cartesian", numbers, (1e3 * Q[0],), tool="t", base="b")
    setting = Setting(
        {"t": tool}, {"b": np.eye(4)}, flange=flange, start=axes.of(ROBOT).values(Q[None])[0]
    )

    aimed = aim(nominal(ROBOT, TOOL), KUKA, [target], setting)

    assert tips_of(ROBOT, aimed)[0][0] == pytest.approx(wanted[:3, 3], abs=1e-6)
