"""A robot that bends, from Pinocchio alone: commanded joint values, and resulting tool poses.

Every joint spring deflects until it carries the force on the deflected robot.
"""

import numpy as np
import pinocchio as pin

from bench.as_pinocchio import model as pin_model


class BendingRobot:
    """A robot with springs in its joints.

    Attributes:
        stiffness: Of its joints [N/m] or [N m/rad], shape (n,).
    """

    def __init__(self, robot, stiffness):
        self.model = pin_model(robot)
        self.data = self.model.createData()
        self.frame = self.model.getFrameId("flange")
        self.held = robot.prismatic
        self.robot = robot
        self.stiffness = np.asarray(stiffness, float)

    def flange(self, q):
        """Flange of the unloaded robot in F_b."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.frame].copy()

    def loaded(self, q, force, tip):
        """Flange under a force [N], F_b, at a point of the flange frame [m]."""
        bent = q
        for _ in range(40):
            J = pin.computeFrameJacobian(
                self.model, self.data, bent, self.frame, pin.LOCAL_WORLD_ALIGNED
            )
            arm = self.flange(bent).rotation @ tip
            bent = q + (J[:3].T @ force + J[3:].T @ np.cross(arm, force)) / self.stiffness
        return self.flange(bent)

    def commanded(self, flange, q):
        """Joint values for a pose of the flange, starting from `q`; the carriage is fixed."""
        free = ~self.held
        for _ in range(50):
            here = self.flange(q)
            J = pin.computeFrameJacobian(self.model, self.data, q, self.frame, pin.LOCAL)[:, free]
            step = np.zeros(len(q))
            step[free] = np.linalg.lstsq(J, pin.log6(here.actInv(flange)).vector, rcond=None)[0]
            q = q + step
        assert np.linalg.norm(pin.log6(self.flange(q).actInv(flange)).vector) < 1e-9
        return q
