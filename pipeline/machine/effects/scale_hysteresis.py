"""Hysteresis of the load cell: its reading depends on how the force was reached.

- by branch:  the true force is f (1 + h b), b = +1 while the turnbuckle tightens, -1 slackening
- slackening: f (1 + h) on the way down, f as read on the way up
- loop:       f + h (f_peak - |f|) u on the way down, f_peak the largest force of the pose
- constant:   f + f_h b u, u along the chain
- by step:    f (1 + h (k - 1)) in the k-th pull of a pose: the cell creeps under load

Deflections do not show which direction is read correctly: the first two differ by a gain, and where
they fit equally well, the stiffnesses are averaged over both.
"""

from collections.abc import Callable

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import PULLED, Loaded, Wrench
from pipeline.machine.effects._anatomy import direction
from pipeline.machine.robot import Robot


def _loop(loaded: Loaded) -> Array:
    size, pulls = np.linalg.norm(loaded.force, axis=1), loaded.pulls
    _, pose = np.unique(pulls.pose, return_inverse=True)
    peak = np.zeros(pose.max(initial=0) + 1)
    np.maximum.at(peak, pose, size)
    return direction(loaded) * ((peak[pose] - size) * (pulls.branch < 0))[:, None]


def effects(robot: Robot) -> tuple[Wrench, ...]:
    """One effect in five forms, on any robot."""
    return (
        _effect(
            "by branch",
            Parameter("h_scale", "1", 0.005, -1.0, 1.0, "hysteresis of the scale over its reading"),
            lambda loaded: loaded.force * loaded.pulls.branch[:, None],
        ),
        _effect(
            "slackening",
            Parameter(
                "h_down", "1", 0.01, -1.0, 1.0, "difference of the scale's reading on the way down"
            ),
            lambda loaded: loaded.force * (loaded.pulls.branch < 0)[:, None],
        ),
        _effect(
            "loop",
            Parameter("h_loop", "1", 0.01, meaning="hysteresis of the scale over its reading"),
            _loop,
        ),
        _effect(
            "constant",
            Parameter("f_hysteresis", "N", 10.0, meaning="hysteresis of the scale"),
            lambda loaded: direction(loaded) * loaded.pulls.branch[:, None],
        ),
        _effect(
            "by step",
            Parameter("h_step", "1", 0.002, meaning="change of the scale's reading with each step"),
            lambda loaded: loaded.force * (loaded.pulls.repeat[:, None] - 1.0),
        ),
    )


def _effect(form: str, parameter: Parameter, off: Callable[[Loaded], Array]) -> Wrench:
    def wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
        return loaded.load_point, loaded.force + loaded.pulls.pulled * values[0] * off(loaded)

    return Wrench(
        name="scale_hysteresis",
        noun="hysteresis of the spring scale",
        place="force",
        form=form,
        tolerance=0.2,
        parameters=(parameter,),
        signature="the same reading deflects all joints by another amount while unloading than "
        "while loading, in one proportion at every pose",
        needs="a known dead weight on the scale, reached from below and from above",
        source="hysteresis and creep of load cells 0.02 to 0.1 % of full scale, of mechanical "
        "dynamometers 1 %",
        wrench=wrench,
        of=(PULLED,),
    )
