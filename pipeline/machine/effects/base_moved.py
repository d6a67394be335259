"""The robot was moved against the base reflectors in mid-campaign: its foot, or the tracker.

Before that the effector stood where F_b puts it; since then it is read at p + v + w x p.
"""

import numpy as np

from pipeline.base.arrays import Array, vector
from pipeline.machine.effect import Loaded, Observation


def since(before: tuple[int, ...], pose: int) -> Observation:
    """The motion between two poses.

    Args:
        before: Numbers of the poses before.
        pose: Number of the first pose after it.
    """

    def observe(loaded: Loaded, points: Array, time: Array, values: Array) -> Array:
        moved = ~np.isin(loaded.pulls.pose, before)[:, None, None]
        return np.asarray(points + moved * (values[:3] + np.cross(values[3:], points)))

    return Observation(
        name="base_moved",
        noun=f"robot or tracker that was moved at pose {pose}",
        place="metrology",
        shows_unloaded=True,
        form=f"since pose {pose}",
        parameters=(
            *vector("v_{}", "m", 1e-3, -0.1, 0.1, meaning="motion of the robot along {}"),
            *vector("w_{}", "rad", 1e-3, -0.1, 0.1, meaning="turn of the robot about {}"),
        ),
        signature=f"since pose {pose} all unloaded reflectors stand off as one rigid motion would "
        "move them, before that they do not; the displacements hardly show it",
        needs="the base reflectors read again, and what holds robot and tracker looked at",
        source="rigid motion of F_b, p + v + w x p; 1 mm, 1 mrad: a foot or tripod that was bumped",
        observe=observe,
    )
