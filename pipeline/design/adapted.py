"""Adapt a shipped problem to another robot: tool, anchor, pull and criterion to its size.

A tool of 0.15 m on an arm of 1.3 m, a chain to 6 m and the test pose of a KR500 are of no use for
another robot. They are scaled with the length of the arm, forces with the payload, and the
criterion is the whole workspace, which every robot has; the user's own values go into the problem
that is written next to the plan.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.design.pull import REFERENCE_PULL_N, round_pull, share
from pipeline.design.singular import arm_m
from pipeline.design.spec import ProblemFile
from pipeline.machine.robot import Robot, configure, load

_STEP_M = 0.005
"""Rounding of the lengths of a tool [m], as people make them."""
_NEAR, _FAR = 0.4, 1.2
"""Limits of the anchor's position on the floor over the length of the arm [1]."""


def suited(spec: ProblemFile, robot: Robot) -> dict[str, Any]:
    """Changes of the problem file that adapt what is specific to its own robot to another one.

    Args:
        spec: The problem.
        robot: The requested robot.
    """
    arm = _arm_m(robot)
    size = arm / _arm_m(load(spec.robot))
    tool = {name: _to_size(size, at) for name, at in spec.tool.items()}
    pull = share(robot, np.array(tool["load_point"]))
    return {
        "name": robot.name,
        "assumptions": [
            f"tool, anchor, pull and criterion are not yours: those of {spec.name}, to the size "
            f"and payload of {robot.name}; change them in the problem beside the plan and design "
            "again",
            *spec.assumptions[-1:],
        ],
        "tool": tool,
        "pull": {"steps_n": [round_pull(REFERENCE_PULL_N * pull)]},
        "anchor": {
            "x_m": [round(_NEAR * arm, 2), round(_FAR * arm, 2)],
            "y_m": round(_NEAR * arm, 2),
            "z_m": 0.0,
        },
        "criterion": {
            "kind": "workspace",
            "force_n": round_pull(min(pull, 1.0) * spec.criterion.force_n),
        },
        "test_pose": [],
    }


def _arm_m(robot: Robot) -> float:
    """Length of its arm [m]."""
    return arm_m(configure(robot, np.zeros((1, robot.n))), int(np.argmin(robot.prismatic)))


def _to_size(size: float, at: tuple[float, float, float]) -> list[float]:
    return [round(_STEP_M * round(size * x / _STEP_M), 6) for x in at]
