"""Compliance of what carries the arm: of a carriage on its rail, or of a base without a rail.

The carriage has a spring about or along each of the rail's three axes. A base tilts about the axes
of F_b across that of joint 1, which stay where they are while the arm turns; its yaw is that of
joint 1. What yields determines how deep below the foot they are: anchors under the robot, a column
of height H that bends (H/2; its shear adds H^2/12 to squares of levers of metres), or one that
rocks (H).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from pipeline.base.arrays import Array, Parameter, vector
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import carriage, compliance, rail, rail_axes
from pipeline.machine.robot import Robot, configure
from pipeline.machine.robot.configuration import rotation_about, translation_along

ALONG, ACROSS, UP = range(3)
"""Indices of the rail's axes in `rail_axes`."""

LARGE = {"m/N": 1000.0, "rad/(N m)": 3000.0}
"""Load on the guides of a rail at which a law of it has its typical deflection [N] or [N m], by the
unit of the compliance."""


def rotation(loaded: Loaded, axis: int) -> Array:
    """Screw of a rotation of the carriage about an axis of the rail, shape (m, 1, 6)."""
    return rotation_about(carriage(loaded), rail_axes(loaded)[axis])[:, None]


def translation(loaded: Loaded, axis: int) -> Array:
    """Screw of a translation of the carriage along an axis of the rail, shape (m, 1, 6)."""
    return translation_along(rail_axes(loaded)[axis])[:, None]


def _shift(name: str, typical: float, meaning: str) -> Parameter:
    return Parameter(name, "m/N", typical, 0.0, np.inf, meaning)


def _turn(name: str, typical: float, meaning: str) -> Parameter:
    return Parameter(name, "rad/(N m)", typical, 0.0, np.inf, meaning)


_SOURCE = {
    "m/N": "translation column a (a . f); size of loaded guide rollers, an estimate",
    "rad/(N m)": "rotation column (a x (p - o)) (a . ((l - o) x f)); size an estimate for "
    "roller carriages",
}
"""Source of the formula, by the unit of the compliance."""


def _spring(
    name: str,
    noun: str,
    parameter: Parameter,
    screw: Callable[[Loaded], Array],
    signature: str,
    needs: str = "three reflectors on the carriage",
) -> Elastic:
    """A linear spring at the carriage."""
    return Elastic(
        name=name,
        noun=noun,
        place="rail",
        parameters=(parameter,),
        signature=signature,
        needs=needs,
        source=_SOURCE[parameter.unit],
        carrier=(1,),
        twists=screw,
    )


_SPRINGS = (
    _spring(
        "rail_lateral",
        "lateral compliance of the carriage",
        _shift("c_lateral", 5e-09, "lateral compliance of the carriage"),
        partial(translation, axis=ACROSS),
        signature="all reflectors move alike across the rail in proportion to the lateral "
        "force, with no lever arm; rail_roll grows with the height of the load",
    ),
    _spring(
        "rail_vertical",
        "vertical compliance of the carriage",
        _shift("c_vertical", 2.5e-09, "vertical compliance of the carriage"),
        partial(translation, axis=UP),
        signature="all reflectors move alike up or down in proportion to the vertical "
        "force, with no lever arm",
    ),
    _spring(
        "rail_roll",
        "roll of the carriage about the rail",
        _turn("c_roll", 1e-08, "roll compliance of the carriage about the rail"),
        partial(rotation, axis=ALONG),
        signature="all reflectors turn together about the rail, whatever the arm does; tilt "
        "of joint 2 turns with the arm",
        needs="one arm pose pulled across the rail at several heights, or three reflectors "
        "on the carriage",
    ),
    _spring(
        "rail_pitch",
        "pitch of the carriage",
        _turn("c_pitch", 5e-09, "pitch compliance of the carriage about the axis across the rail"),
        partial(rotation, axis=ACROSS),
        signature="all reflectors turn together about the axis across the rail, whatever the arm "
        "does",
        needs="pulls along the rail at several heights, or three reflectors on the carriage",
    ),
    _spring(
        "rail_yaw",
        "yaw of the carriage",
        _turn("c_yaw", 7e-09, "yaw compliance of the carriage about the vertical"),
        partial(rotation, axis=UP),
        signature="cannot be distinguished from the compliance of joint 2, whose axis it shares",
    ),
)
"""Springs that Eq. (3) omits; the yaw shares the axis of joint 2."""


_DEEP_M = {"at its foot": 0.0, "half a metre deep": 0.5, "a metre deep": 1.0}
"""Depth of the axes of a tilt below the robot's foot [m]: pedestals are 0.5 to 1 m high."""

_BETWEEN = 0.1
"""Relative error of levers of 2.5 m if the axes are a quarter of a metre from those of a form
[1]."""


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """All springs of the carriage, or all forms of a base that yields."""
    if rail(robot):
        return _SPRINGS
    return tuple(_tilting(robot, form, deep) for form, deep in _DEEP_M.items())


def _tilting(robot: Robot, form: str, deep_m: float) -> Elastic:
    """A base of some ten times the stiffness of joint 1, in front of it."""
    c, here = compliance(robot, 1) / 10, configure(robot, np.zeros((1, robot.n)))
    first, up = here.origin[0, 0], here.axes[0, 0, :, 2]
    up = up * np.copysign(1.0, here.origin[0, -1] @ up)  # tables count z up or down
    foot = first - (first @ up) * up  # of the axis of joint 1
    across = np.delete(np.eye(3), np.argmax(np.abs(up)), axis=0)
    screws = rotation_about(np.broadcast_to(foot - deep_m * up, (2, 3)), across)
    return Elastic(
        name="pedestal_tilt",
        noun="tilt of the pedestal or its foundation",
        place="base",
        form=form,
        tolerance=_BETWEEN,
        parameters=vector(
            *("c_pedestal_{}", "rad/(N m)", c, 0.0, np.inf),
            meaning="tilt compliance of the pedestal about {}",
            axes=("xyz"[int(unit.argmax())] for unit in across),
        ),
        signature="everything turns about axes fixed in the base, whatever the arm does; where "
        "joint 1 hardly turns, the same as a tilt of its bearing",
        needs="poses that differ in the first axis alone, or reflectors on the pedestal",
        source=_SOURCE["rad/(N m)"].replace("roller carriages", "pedestals"),
        carrier=(0, 0),
        twists=lambda loaded: np.broadcast_to(screws, (len(loaded.force), 2, 6)),
    )
