"""Bodies of the links against another program's kinematics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from bench.as_pinocchio import model
from pipeline.annex import bodies
from pipeline.machine.robot import configure, load


@pytest.mark.parametrize("name", ["kr500_rail", "ur10e"])
def test_links_are_where_pinocchio_has_them(name):
    """With capsules and without: both ends of each link against another program's kinematics."""
    robot = load(name)
    low, high = np.maximum(robot.lower, -2.0), np.minimum(robot.upper, 2.0)
    q = np.random.default_rng(4).uniform(low, high, (3, robot.n))
    other = model(robot)
    data = other.createData()
    base, carriage, arm = bodies.links(robot, configure(robot, q))
    for m in range(3):
        pin.forwardKinematics(other, data, q[m])
        frames = dict(zip(list(other.names)[1:], list(data.oMi)[1:], strict=True))
        for part in (carriage, arm):
            for ends, joint in zip(part.ends[m], part.names, strict=True):
                if len(robot.capsules):
                    at = [one.name for one in robot.joints].index(joint) + 1
                    own = robot.capsules.ends[:, robot.capsules.carrier == at][:, 0]
                    wanted = [frames[joint].act(end) for end in own]
                    assert ends == pytest.approx(np.array(wanted), abs=1e-12)
                elif joint != "flange":
                    assert ends[1] == pytest.approx(frames[joint].translation, abs=1e-12)
    assert (len(carriage.names) == 1) == robot.joints[0].prismatic
    assert len(base.names) == (1 if len(robot.capsules) else 0)
