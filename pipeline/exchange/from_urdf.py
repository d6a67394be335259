"""Make a robot file from a URDF: the chain between two links as modified DH parameters.

Joints keep their sense and zero: joint values are the same in both files. Everything that belongs
to a serial chain is converted.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.base.errors import listed
from pipeline.exchange.rows import DEGREES, METRES, fixed, frames, rounded_text, row
from pipeline.exchange.urdf import TYPES, Chain, Limit, LinkMass, Tree, UrdfJoint, chain, moving

_TWIST_RAD = (1e-3, 1e-2)
"""Range of the twist of a gear under the largest torque of its drive [rad]. Catalogues give about 1
mrad for RV reducers at rated torque and several for strain wave gears at peak torque."""


def robot_file(
    tree: Tree, base: str, flange: str, file: str, payload_kg: float | None = None
) -> dict[str, Any]:
    """Content of a robot file for the chain between two links, the first being F_b.

    Args:
        tree: The URDF.
        base: Link that is F_b.
        flange: Link that is the flange.
        file: Name of the URDF, for `source` and messages.
        payload_kg: Rated payload [kg], which a URDF does not state.

    Raises:
        InputError: There is no such chain, or a robot file cannot represent it.
    """
    whole = chain(tree, base, flange, file)
    axes = moving(whole.joints)
    at = _places(whole)
    on_axes = frames([_line(at, joint) for joint in axes], at[flange])
    steps = [row(before, after) for before, after in pairwise(on_axes)]
    rows = [
        _limited(number, joint) | step | _weighing(tree, joint, at, frame)
        for number, (joint, step, frame) in enumerate(zip(axes, steps, on_axes[1:], strict=True), 1)
    ]
    return {
        "format": 1,
        "name": re.sub(r"[^A-Za-z0-9_.-]", "_", tree.name)[:100],
        "description": f"{tree.name}, from link {base} to link {flange}",
        "convention": "craig",
        "source": file,
        "assumptions": list(_assumed(tree, whole, rows)),
        **({} if payload_kg is None else {"payload_kg": payload_kg}),
        **fixed("base", on_axes[0]),
        **fixed("flange", linear.solve(on_axes[-1], at[flange])),
        "joint": rows,
        "controller": {
            "axes": [joint.name for joint in axes],
            "matrix": np.eye(len(axes), dtype=int).tolist(),
        },
    }


def _places(whole: Chain) -> dict[str, Array]:
    """Frames of the links of a chain relative to its base, all joints at zero, each (4, 4)."""
    at = {whole.joints[0].parent: whole.start}
    for joint in whole.joints:
        at[joint.child] = at[joint.parent] @ joint.origin
    return at


def _line(at: Mapping[str, Array], joint: UrdfJoint) -> tuple[Array, Array]:
    """Point on a joint's axis [m] and direction of the axis, both (3,)."""
    frame = at[joint.child]
    return frame[:3, 3], frame[:3, :3] @ joint.axis


def _limited(number: int, joint: UrdfJoint) -> dict[str, Any]:
    """Name, type, limits and effort of a joint, and the plausible range of its stiffness."""
    slides, effort = joint.type == "prismatic", joint.limit.effort
    name = f"{'r' if slides else 'theta'}{number}"
    found = {"name": name, "type": TYPES[joint.type], **_range(joint.limit, slides)}
    if effort is None:
        return found
    if slides:
        return found | {"effort_n": effort}
    stiff, soft = _TWIST_RAD
    stiffness = [float(f"{effort / twist:.3g}") for twist in (soft, stiff)]
    return found | {"effort_nm": effort, "stiffness_range_nm_per_rad": stiffness}


def _range(limit: Limit, slides: bool) -> dict[str, float]:
    """The limits of a joint that are stated."""
    found = {}
    for end, value in (("lower", limit.lower), ("upper", limit.upper)):
        if value is not None and slides:
            found[f"{end}_m"] = rounded_text(value, METRES)
        elif value is not None:
            found[f"{end}_deg"] = rounded_text(np.rad2deg(value), DEGREES)
    return found


def _weighing(
    tree: Tree, joint: UrdfJoint, at: Mapping[str, Array], frame: Array
) -> dict[str, Any]:
    """Mass and centre of mass of the links between a joint and the next, in its DH frame."""
    bodies = [
        LinkMass(tree.bodies[name].mass, (T @ np.append(tree.bodies[name].centre, 1.0))[:3])
        for name, T in _rigid(tree, joint.child, at[joint.child])
        if name in tree.bodies
    ]
    if not bodies:
        return {}
    mass = sum(body.mass for body in bodies)
    centre = sum((body.mass * body.centre for body in bodies), np.zeros(3)) / mass
    own = linear.solve(frame, np.append(centre, 1.0))[:3]
    return {"mass_kg": mass, "centre_of_mass_m": [rounded_text(x, METRES) for x in own]}


def _rigid(tree: Tree, link: str, at: Array) -> Iterator[tuple[str, Array]]:
    """A link and all links fixed to it, with their frames (4, 4)."""
    left = [(link, at)]
    while left:
        here, frame = left.pop()
        yield here, frame
        behind = (j for j in tree.joints.values() if j.parent == here and j.type == "fixed")
        left += [(joint.child, frame @ joint.origin) for joint in behind]


def _assumed(tree: Tree, whole: Chain, rows: list[dict[str, Any]]) -> Iterator[str]:
    """Assumptions: what is unknown or omitted."""
    yield "the stiffnesses of the joints are not known: a URDF has none"
    if any("stiffness_range_nm_per_rad" in one for one in rows):
        stiff, soft = (f"{1e3 * twist:g}" for twist in _TWIST_RAD)
        yield (
            f"a gear twists by {stiff} to {soft} mrad under the largest torque of its drive, which "
            "gives the ranges of the stiffnesses"
        )
    turning = [one["name"] for one in rows if not {"lower_deg", "lower_m"} & set(one)]
    if turning:
        yield f"the URDF gives no range for {listed(turning)}"
    if beside := _beside(tree, whole):
        yield f"the links attached to {listed(beside)}, outside the chain, are left out"


def _beside(tree: Tree, whole: Chain) -> list[str]:
    """Joints that branch off the moved links of a chain."""
    chained = {joint.name for joint in whole.joints}
    moved = {joint.child for joint in whole.joints}
    return [
        joint.name
        for joint in moving(tree.joints.values())
        if joint.name not in chained and joint.parent in moved
    ]
