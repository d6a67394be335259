"""The robot as a certificate draws it, and how load and causes move it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from bench.as_pinocchio import model
from pipeline.annex.posture import posture
from pipeline.machine.cell import Tool, paper_cell
from pipeline.machine.robot import load
from pipeline.prediction.model import ModelHypothesis as Handed
from pipeline.reduction.pose_of_interest import PoseOfInterest


@pytest.mark.parametrize("name", ["kr500_rail", "ur10e"])
def test_the_drawn_arm_moves_as_its_springs_let_it(name):
    """Each body moves as another program's Jacobian of it says, joints yielding by c J_tip' f."""
    robot = load(name)
    q = np.clip(np.linspace(0.4, -1.1, robot.n), robot.lower, robot.upper)
    force = np.array([300.0, -450.0, -200.0])
    points = {"load_point": np.array([0.1, 0.02, 0.2]), "P1": np.array([0.0, 0.1, 0.1])}
    cell = paper_cell(robot, Tool.of(points))
    compliance = 1e-7 * np.arange(1, robot.n + 1)

    table = posture(
        Handed(1.0, cell, compliance, np.eye(robot.n)), PoseOfInterest(q, force, stated=True)
    ).set_index(["part", "name"])

    other = model(robot)
    data = other.createData()
    pin.computeJointJacobians(other, data, q)
    pin.framesForwardKinematics(other, data, q)

    def by(at, joint):
        """How a point carried by a joint moves with each joint, (3, n)."""
        J = pin.getJointJacobian(other, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        lever = at - data.oMi[joint].translation
        return J[:3] - np.array([np.cross(lever, w) for w in J[3:].T]).T

    tip = data.oMf[other.nframes - 1].act(points["load_point"])
    yields = compliance * (by(tip, robot.n).T @ force)
    drawn = table.drop(index=[("place", x) for x in ("upper_arm", "forearm")], errors="ignore")
    for row in drawn.to_dict("records"):
        for end in ("from", "to"):
            at = np.array([row[f"{end}_{a}_m"] for a in "xyz"])
            moved = [row[f"{end}_moved_{a}_m"] for a in "xyz"]
            wanted = by(at, row["joint"]) @ yields if row["joint"] else np.zeros(3)
            assert moved == pytest.approx(wanted, abs=1e-12)
            assert row[f"{end}_caused_x_m"] == 0.0
    assert np.linalg.norm(by(tip, robot.n) @ yields) > 1e-5
