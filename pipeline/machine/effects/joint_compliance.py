"""The paper's model: one linear spring per joint, Eqs. (3), (5)."""

from pipeline.base.arrays import Parameter
from pipeline.machine.effects._effect import Elastic, linear
from pipeline.machine.robot import Robot


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """The springs of all joints as one effect; x of Eq. (6) are its parameters."""
    return (
        Elastic(
            name="joint_compliance",
            noun="stiffness of the joint",
            place="joint",
            where=None,
            parameters=tuple(
                Parameter(
                    f"c_{joint.name}", joint.compliance_unit, 1 / joint.typical_stiffness, 0.0
                )
                for joint in robot.joints
            ),
            signature="every joint gives way about its own axis in proportion to its torque",
            needs="poses whose pull turns every joint",
            source="Eqs. (3) to (7)",
            carrier=tuple(range(1, robot.n + 1)),
            twists=lambda loaded: loaded.configuration.twists,
            response=linear,
        ),
    )
