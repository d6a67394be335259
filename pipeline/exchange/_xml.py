"""What the files for other programs share: springs, inertia, frames, and what they leave out."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.shown import in_xml
from pipeline.machine.robot import Joint
from pipeline.prediction.model import IdentifiedModel

BASE, FLANGE = "F_b", "F_flange"
"""What base and flange frame are called in every file."""

_SWING_HZ = 30.0
"""How fast each spring swings alone by the inertia put in place of the unknown one [Hz]: as an arm
does in its first modes, and slowly enough for steps of 1 ms, 33 to a period."""
_STAND_IN = 1.0
"""In place of a mass [kg] or rotational inertia [kg m^2] that nobody knows and nothing rests on."""


@dataclass(frozen=True)
class Spring:
    """The spring of one joint, as a simulator needs it: there has to be one.

    Attributes:
        joint: Its joint.
        stiffness: [N/m] or [N m/rad]; nominal or typical where the campaign does not state it.
        std: Its standard uncertainty, same unit; None where the campaign does not state it.
    """

    joint: Joint
    stiffness: float
    std: float | None

    @property
    def said(self) -> str:
        """The spring in words."""
        unit = self.joint.stiffness_unit
        if self.std is None:
            return f"{self.stiffness!r} {unit} of the robot's table, not determined by the campaign"
        return f"{self.stiffness!r} {unit}, standard uncertainty {self.std!r} {unit}"

    @property
    def damping(self) -> float:
        """Critical, of the spring alone with its inertia [N s/m] or [N m s/rad]."""
        return self.stiffness / (math.pi * _SWING_HZ)

    @property
    def inertia(self) -> float:
        """With which it swings at `_SWING_HZ`, k = (2 pi f)^2 I [kg] or [kg m^2]."""
        return self.stiffness / (2 * math.pi * _SWING_HZ) ** 2


@dataclass(frozen=True, eq=False)
class Body:
    """Mass of the link behind a joint; rotational inertia is nowhere known.

    Attributes:
        mass: [kg].
        centre: Centre of mass in the frame of the joint [m], shape (3,).
        inertia: About any axis through it [kg m^2].
    """

    mass: float
    centre: Array
    inertia: float


def springs(handed: IdentifiedModel) -> list[Spring]:
    """One for each joint, from base to flange."""
    found = []
    for j, joint in enumerate(handed.robot.joints):
        stiffness, std, _ = handed.stiffness(j) or (joint.typical_stiffness, None, "")
        found.append(Spring(joint, stiffness, std))
    return found


def body(spring: Spring) -> Body:
    """The link behind a joint, with what makes its spring swing slowly enough to be computed."""
    joint, own = spring.joint, spring.inertia
    if joint.mass_kg:
        return Body(joint.mass_kg, np.array(joint.centre_of_mass_m or (0.0, 0.0, 0.0)), own)
    if joint.prismatic:
        return Body(own, np.zeros(3), _STAND_IN)
    return Body(_STAND_IN, np.zeros(3), own)


def causes(handed: IdentifiedModel) -> list[str]:
    """Labels of everything that was identified beside the springs, each once."""
    return list(dict.fromkeys(e.label for h in handed.hypotheses for e in h.beside_springs))


def left_out(handed: IdentifiedModel) -> Iterator[str]:
    """What of the identified model a spring at each joint cannot carry, in words."""
    yield "covariance of the stiffnesses"
    yield from causes(handed)
    if len(handed.hypotheses) > 1:
        shares = ", ".join(f"{one.weight:.3g}" for one in handed.hypotheses)
        yield f"hypotheses with the weights {shares}: the springs are their average"


def comment(handed: IdentifiedModel, lines: Sequence[str]) -> str:
    """The comment at the top: where it comes from, how it is used, and what it does not hold."""
    told = [
        f"Robot {handed.robot.name} of campaign {handed.campaign} ({handed.verdict}); m, rad, N.",
        *lines,
        "Deflections are those from the unloaded robot, as they were measured, without its weight.",
        *_inertia_told(springs(handed)),
        "Not in this file, but in model.toml: " + "; ".join(left_out(handed)) + ".",
    ]
    text = in_xml("\n  ".join(told)).replace("--", "- -").replace("--", "- -")
    return f"\n  {text}\n"


def _inertia_told(found: Sequence[Spring]) -> Iterator[str]:
    yield (
        f"Rotational inertia and damping are stand-ins: each spring alone swings at {_SWING_HZ:g} "
        "Hz, critically damped. Where it comes to rest does not depend on them."
    )
    missing = [one.joint.name for one in found if not one.joint.mass_kg]
    if missing:
        yield f"The robot's table has no mass for the links behind {', '.join(missing)}: stand-ins."


def document(root: ET.Element) -> bytes:
    """An XML file."""
    ET.indent(root)
    text = ET.tostring(root, "unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'.encode()


def row(values: Any) -> str:
    """Numbers as XML has them, to the last digit."""
    return " ".join(repr(float(value)) for value in values)


def shift(at: Array) -> Array:
    """A frame moved to a point [m], shape (4, 4)."""
    step = np.eye(4)
    step[:3, 3] = at
    return step


def rpy(R: Array) -> Array:
    """Roll, pitch and yaw [rad] of R = Rz(yaw) Ry(pitch) Rx(roll).

    Where the pitch is 90 degrees, only the sum of roll and yaw has a meaning: the roll is what the
    yaw leaves of R.
    """
    yaw = np.arctan2(R[1, 0], R[0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw])
