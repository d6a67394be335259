"""The robot file of an arm that ships, on a rail.

    F_b -> flange:  T = Tr(p) Tr(s u) Rz(t) T_arm(q),

with p the arm's foot in F_b [m] where the rail shows 0, s the position along the rail [m], u the
direction in which it moves for growing s, and t the angle from F_b to the arm's own base frame. In
Craig's rows (Craig 2005, ch. 3), with Rz(v) y = u and the arm's first row Rx(a) Rz(q + c) Tz(d),

    T = [Tr(p) Rz(v)] [Rx(-90) Tz(s)] [Rx(a + 90) Rz(q + c +- (t - v)) Tz(d)] ...,

+ for a = 0, - for a = 180 degrees. In classical rows (Denavit and Hartenberg 1955), in which a row
begins with its joint,

    T = [Tr(p) Rz(v) Rx(-90)] [Tz(s) Rx(90)] [Rz(q + c + (t - v)) Tz(d) ...] ....
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.base import toml
from pipeline.base.errors import UsageError
from pipeline.machine.robot import Robot

WAYS = {"x": -90.0, "y": 0.0, "-x": 90.0, "-y": 180.0}
"""Angle v [deg] by the direction of the rail in F_b."""
_TRAVEL_M = 30.0
"""Largest position along the rail, of either sign, where nobody states its ends [m]."""


def on_rail(arm: Robot, way: str, turn_deg: float, foot_m: Sequence[float]) -> str:
    """The text of the robot file.

    Args:
        arm: The arm alone.
        way: Direction of the rail, a key of `WAYS`.
        turn_deg: The angle t [deg].
        foot_m: The position p [m].

    Raises:
        UsageError: It has a rail already, or its table does not begin with a vertical axis.
    """
    content = toml.loads(arm.text, arm.name)
    alpha = _first_twist(arm.name, content)
    first, *others = content["joint"]
    base = content.pop("base", {})
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    x, y, z = base.get("xyz_m", (0.0, 0.0, 0.0))
    at = [foot_m[0] + c * x - s * y, foot_m[1] + s * x + c * y, foot_m[2] + z]
    turned = (turn_deg - WAYS[way]) * (1 if alpha == 0 else -1)
    classical = content["convention"] == "standard"
    first |= {"theta_deg": first.get("theta_deg", 0) + turned}
    first |= {} if classical else {"alpha_deg": alpha + 90}
    twist = 90 if classical else -90
    rail = {"name": "rail", "type": "prismatic", "alpha_deg": twist, "lower_m": -_TRAVEL_M,
            "upper_m": _TRAVEL_M, "stiffness_range_n_per_m": [2e7, 5e8]}  # fmt: skip
    names = [one["name"] for one in content["joint"]]
    plain = {"axes": names, "matrix": np.eye(arm.n, dtype=int).tolist()}
    control = content.setdefault("controller", plain)
    control["axes"] = ["E1", *control["axes"]]
    control["matrix"] = [[1, *[0] * arm.n], *([0, *row] for row in control["matrix"])]
    if "offset_deg" in control:
        control["offset_deg"] = [0, *control["offset_deg"]]
    assumed = "the ends of the rail are not stated: correct lower_m and upper_m"
    content |= {
        "name": f"{arm.name}_rail",
        "description": f"{arm.description} on a rail along {way}",
        "assumptions": [*content.get("assumptions", []), assumed],
        "capsules": [one for one in content.get("capsules", []) if one["link"] != "base"],
        "base": {"xyz_m": at, "rpy_deg": [-90.0 * classical, 0.0, WAYS[way]]},
        "joint": [rail, first, *others],
    }
    if not content["capsules"]:
        del content["capsules"]
        content.pop("capsules_source", None)
    return toml.dumps(content)


def _first_twist(name: str, content: Mapping[str, Any]) -> float:
    """Angle from the z axis of F_b to the first joint's axis of an arm: 0 or 180 [deg].

    Raises:
        UsageError: As in `on_rail`.
    """
    first, classical = content["joint"][0], content["convention"] == "standard"
    roll, *others = content.get("base", {}).get("rpy_deg", (0, 0, 0))
    before = {} if classical else first  # a classical row begins with its joint
    alpha: float = (roll + before.get("alpha_deg", 0)) % 360
    apart = [before.get("a_m", 0), before.get("beta_deg", 0), *others, roll * classical]
    known = content["convention"] in ("craig", "standard") and first["type"] == "revolute"
    if not known or any(apart) or alpha not in (0, 180):
        raise UsageError(
            f"{name} is no arm whose first axis is vertical: write its rail by hand, as "
            "docs/add-a-robot.md says"
        )
    return alpha
