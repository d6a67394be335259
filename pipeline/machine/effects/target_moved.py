"""A reflector's nest moved on the effector in mid-campaign: it slipped, or was glued on again.

Before that the target was where [tool] has it; since then it is measured at p + R v.
"""

import numpy as np

from pipeline.base.arrays import Array, vector
from pipeline.machine.effect import Loaded, Observation


def since(name: str, target: int, before: tuple[int, ...], pose: int) -> Observation:
    """The motion of one target between two poses, flange frame.

    Args:
        name: What the target is called.
        target: Its index among the measured ones.
        before: Numbers of the poses before.
        pose: Number of the first pose after it.
    """

    def observe(loaded: Loaded, points: Array, time: Array, values: Array) -> Array:
        out = points.copy()
        moved = ~np.isin(loaded.pulls.pose, before)[:, None]
        out[:, target] += moved * (loaded.configuration.flange_axes @ values)
        return out

    return Observation(
        name="target_moved",
        where=name,
        noun=f"reflector that was moved at pose {pose}",
        place="metrology",
        shows_unloaded=True,
        form=f"since pose {pose}",
        parameters=vector("v_{}", "m", 1e-3, -0.1, 0.1, meaning="motion of the target along {}"),
        signature=f"since pose {pose} one target stands off by one vector of the flange frame, "
        "before that it does not; the displacements do not show it",
        needs="the distances between the targets measured again",
        source="error of a point of [tool] from a pose on; 1 mm: a nest that was bumped",
        observe=observe,
    )
