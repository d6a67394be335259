"""Tilt of a joint bearing: compliance about the two axes across its own, missing in Eq. (3).

c_tilt_x and c_tilt_y turn about x_j and y_j of the joint's frame, after its own motion, through the
seat of the bearing on the joint's axis. The kinematic table does not give this seat: it puts the
frame of the first revolute joint at the height of the shoulder, but the bearing may sit there, in
the base at the other end of the link's offset, or in between.

Nor does the table give the directions in which a housing is softest. The oblique form allows any
direction across the joint's axis,

    (phi_x, phi_y)' = [[c_x, c_xy], [c_xy, c_y]] (tau_x, tau_y)',

where c_xy = c_yx as the strain energy of the bearing is one function of both moments (Maxwell and
Betti).
"""

from dataclasses import replace

import numpy as np

from pipeline.base.arrays import Array, Parameter, vector
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import compliance, turning
from pipeline.machine.robot import Robot
from pipeline.machine.robot.configuration import rotation_about

_SEAT = {"at its origin": 0.0, "amid its offset": 0.5, "at the foot of its axis": 1.0}
"""Position of the bearing on the way from O_j to the foot of the perpendicular from O_j-1 on the
axis, as a fraction [1]."""

_SHORT_M = 0.3
"""Offset [m] below which the seat makes little difference, as the bearing is about as wide."""

_OBLIQUE = "oblique"

_BETWEEN = 0.1
"""Relative error of the levers if the bearing sits a quarter of the offset from the seat of a form
[1]."""


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """Two forms for each revolute joint, aligned with its frame or oblique, in each seat."""
    seated = (
        (joint, _effect(robot, joint, form, _offset(robot, joint) * seat))
        for joint in turning(robot)
        for form, seat in _seats(robot, joint).items()
    )
    return tuple(
        one for joint, along in seated for one in (along, _oblique(along, compliance(robot, joint)))
    )


def _offset(robot: Robot, joint: int) -> float:
    """Signed distance along the joint's axis from the foot of O_j-1 to O_j [m]."""
    placement = robot.placement[joint - 1]
    return float(placement[:3, 3] @ placement[:3, 2])


def _seats(robot: Robot, joint: int) -> dict[str, float]:
    in_the_base = joint == turning(robot)[0] and abs(_offset(robot, joint)) > _SHORT_M
    return _SEAT if in_the_base else {"": 0.0}


_AT_THE_WRIST = (
    "reflectors on the links before and behind the joint; pulls at the effector do not distinguish "
    "it from the next joint of the wrist"
)


_AT_THE_FLANGE = (
    "reflectors on the flange and on the tool; pulls at the effector do not distinguish it from a "
    "tool that yields"
)


def _needs(robot: Robot, joint: int) -> str:
    """What would tell the tilt from its rivals."""
    if joint == robot.n:
        return _AT_THE_FLANGE
    return _AT_THE_WRIST if joint > robot.n - 3 else "poses that differ in this joint alone"


def _effect(robot: Robot, joint: int, form: str, below: float) -> Elastic:
    c = compliance(robot, joint)

    def screws(loaded: Loaded) -> Array:
        axes, origin = loaded.configuration.frame(joint)
        seat = origin - below * axes[:, :, 2]
        return np.stack([rotation_about(seat, axes[:, :, axis]) for axis in (0, 1)], axis=1)

    return Elastic(
        name="joint_tilt",
        noun="tilt of the bearing",
        place="joint",
        where=joint,
        form=form,
        tolerance=_BETWEEN if form else 0.03,
        parameters=vector(
            *(f"c_tilt{joint}_{{}}", "rad/(N m)", c / 6, 0.0, np.inf),
            meaning="tilt compliance of the bearing of {joint} about {}",
            axes="xy",
        ),
        signature=f"everything behind joint {joint} turns about axes across it, "
        "that turn with the joint",
        needs=_needs(robot, joint),
        source="moment rigidity of RV reducers is five to seven times their torsional stiffness; "
        "full joint compliance after Klimchik et al., Complete stiffness model (2014)",
        carrier=(joint, joint),
        twists=screws,
    )


def _oblique(along: Elastic, c: float) -> Elastic:
    """The same effect with a cross-compliance: a moment about one axis also tilts the other."""
    assert along.twists is not None
    axes = along.twists
    return replace(
        along,
        form=f"{along.form}, {_OBLIQUE}".removeprefix(", "),
        parameters=(
            *along.parameters,
            Parameter(
                *(f"c_tilt{along.where}_xy", "rad/(N m)", c / 6, -np.inf, np.inf),
                "coupling of both tilt compliances of the bearing of {joint}",
            ),
        ),
        carrier=along.carrier * 2,
        twists=lambda loaded: axes(loaded)[:, [0, 1, 0, 1]],
        response=lambda loaded, tau: tau[:, [0, 1, 1, 0]],
        shared=(0, 1, 2, 2),
    )
