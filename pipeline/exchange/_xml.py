"""Common parts of the files for simulators: springs, inertia, frames, and what they omit."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.robot import Joint
from pipeline.prediction.model import IdentifiedModel

_NOT_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")

BASE, FLANGE = "F_b", "F_flange"
"""Names of the base and flange frames in every file."""

_SWING_HZ = 30.0
"""Natural frequency that each spring has by itself with the inertia substituted for the unknown one
[Hz]: typical of the first modes of an arm, and low enough for steps of 1 ms, 33 to a period."""
_STAND_IN = 1.0
"""Substitute for an unknown mass [kg] or rotational inertia [kg m^2] on which no result depends."""


def in_xml(text: str) -> str:
    """Text for an element, an attribute or a comment of XML."""
    return _NOT_XML.sub("\ufffd", text)


@dataclass(frozen=True)
class Spring:
    """Spring of one joint for a simulator, which requires a value for every joint.

    Attributes:
        joint: The joint.
        stiffness: Stiffness [N/m] or [N m/rad]; nominal or typical if the campaign does not state
            it.
        std: Its standard uncertainty, same unit; None if the campaign does not state it.
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
        """Critical damping of the spring with its own inertia [N s/m] or [N m s/rad]."""
        return self.stiffness / (math.pi * _SWING_HZ)

    @property
    def inertia(self) -> float:
        """Inertia that gives the frequency f = `_SWING_HZ`, k = (2 pi f)^2 I [kg] or [kg m^2]."""
        return self.stiffness / (2 * math.pi * _SWING_HZ) ** 2


@dataclass(frozen=True, eq=False)
class _LinkMass:
    """Mass of the link after a joint, with a substitute for its unknown rotational inertia.

    Attributes:
        mass: Mass [kg].
        centre: Centre of mass in the frame of the joint [m], shape (3,).
        inertia: Moment of inertia about any axis through it [kg m^2].
    """

    mass: float
    centre: Array
    inertia: float


def springs(handed: IdentifiedModel) -> list[Spring]:
    """Springs of all joints, from base to flange."""
    found = []
    for j, joint in enumerate(handed.robot.joints):
        stiffness, std, _ = handed.stiffness(j) or (joint.typical_stiffness, None, "")
        found.append(Spring(joint, stiffness, std))
    return found


def body(spring: Spring) -> _LinkMass:
    """The link after a joint, with an inertia that makes its spring slow enough to simulate."""
    joint, own = spring.joint, spring.inertia
    if joint.mass_kg:
        return _LinkMass(joint.mass_kg, np.array(joint.centre_of_mass_m or (0.0, 0.0, 0.0)), own)
    if joint.prismatic:
        return _LinkMass(own, np.zeros(3), _STAND_IN)
    return _LinkMass(_STAND_IN, np.zeros(3), own)


def causes(handed: IdentifiedModel) -> list[str]:
    """Labels of all causes identified in addition to the springs, each once."""
    return list(dict.fromkeys(e.label for h in handed.hypotheses for e in h.beside_springs))


def left_out(handed: IdentifiedModel) -> Iterator[str]:
    """Parts of the identified model that springs at the joints cannot represent, in words."""
    yield "covariance of the stiffnesses"
    yield from causes(handed)
    if len(handed.hypotheses) > 1:
        shares = ", ".join(f"{one.weight:.3g}" for one in handed.hypotheses)
        yield f"hypotheses with the weights {shares}: the springs are their average"


def comment(handed: IdentifiedModel, lines: Sequence[str]) -> str:
    """Comment at the top of a file: origin, use, and what is omitted."""
    texts = [
        f"Robot {handed.robot.name} of campaign {handed.campaign} ({handed.verdict}); m, rad, N.",
        *lines,
        "Deflections are those from the unloaded robot, as they were measured, without its weight.",
        *_inertia_told(springs(handed)),
        "Not in this file, but in model.toml: " + "; ".join(left_out(handed)) + ".",
    ]
    text = in_xml("\n  ".join(texts)).replace("--", "- -").replace("--", "- -")
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
    """Serialise an XML document."""
    ET.indent(root)
    text = ET.tostring(root, "unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'.encode()


def row(values: Any) -> str:
    """Numbers for an XML attribute, with all digits."""
    return " ".join(repr(float(value)) for value in values)


def shift(at: Array) -> Array:
    """Transform (4, 4) of a translation [m]."""
    step = np.eye(4)
    step[:3, 3] = at
    return step


def rpy(R: Array) -> Array:
    """Roll, pitch and yaw [rad] of R = Rz(yaw) Ry(pitch) Rx(roll).

    At a pitch of 90 degrees only a combination of roll and yaw is determined: the roll is what the
    yaw leaves of R.
    """
    yaw = np.arctan2(R[1, 0], R[0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw])
