"""The gravity compensator stiffens the shoulder depending on where it stands.

The compliance of the shoulder joint is c + c_cos cos(theta) + c_sin sin(theta): the first harmonic
of a spring or gas strut beside the gear.
"""

import numpy as np

from pipeline.effects._anatomy import arm, compliance, joint_screw
from pipeline.effects._effect import Elastic, Loaded
from pipeline.results import Array, Parameter
from pipeline.robot import Robot


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """One effect at the shoulder of a six-axis arm."""
    joints = arm(robot)
    if joints is None:
        return ()
    shoulder = joints[0]
    c = compliance(robot, shoulder)

    def response(loaded: Loaded, torque: Array) -> Array:
        angle = loaded.configuration.q[:, shoulder - 1]
        return np.asarray(torque * np.stack([np.cos(angle), np.sin(angle)], axis=1))

    return (
        Elastic(
            name="compensator",
            where=None,
            tolerance=0.1,
            parameters=tuple(
                Parameter(f"c_comp_{part}", "rad/(N m)", 0.05 * c, -c, c) for part in ("cos", "sin")
            ),
            signature=f"the compliance of joint {shoulder} changes with its angle, not with the "
            "load",
            needs=f"one pull repeated at four angles of joint {shoulder}",
            source="equivalent spring beside the gear: Klimchik et al., compensator models "
            "(arXiv 1311.6810); some percent of the joint's compliance",
            carrier=(shoulder, shoulder),
            twists=lambda loaded: joint_screw(loaded, shoulder).repeat(2, axis=1),
            response=response,
        ),
    )
