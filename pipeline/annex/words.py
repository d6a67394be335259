"""Names of sources of uncertainty and of suspects, and sizes of errors, in words."""

from __future__ import annotations

from pipeline.answer.contract import Answer
from pipeline.base.quantities import known, plain
from pipeline.machine.robot import Robot
from pipeline.machine.robot.axes import alone
from pipeline.report.words import Axes, from_label

_SOURCES = {
    "tracker": "tracker readings",
    "zero": "unloaded readings of each pose",
    "force_reading": "scale readings",
    "force_gain": "calibration of the scale (ISO 376)",
    "force_zero": "zero of the scale",
    "payload_mass": "mass of weights and payloads",
    "payload_center": "centre of mass of the payloads",
    "law": "laws of the identified causes",
    "second_order": "deflected geometry, which c = B x leaves out",
    "tracker_scale": "calibration of the tracker (ISO 10360-10)",
    "day": "day-to-day scatter",
    "wander": "slow drift common to all targets",
    "which_cause": "which cause is true",
    "along_beam": "tracker readings along the beam",
    "across_beam": "tracker readings across the beam",
    "direction": "direction of the chain",
    "registration": "registration into the base frame",
    "geometry": "geometry of robot and tool",
    "base": "reading of a base reflector",
    "held_out": "cross-validation error beyond the other lines",
}

_SHOWN_IN = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "N": (1.0, "N"), "1": (1.0, "σ")}
"""Factor and unit in which the size of an error is printed, by SI unit."""


def parameter(answer: Answer, name: str) -> str:
    """`A1 (k_theta2)` for `k_theta2`, `A1 (c_theta2)` for `c_theta2`; others as they are."""
    _, _, joint = name.partition("_")
    axis = next((one.axis for one in answer.stiffness if one.joint_name == joint), None)
    return f"{axis} ({name})" if axis else name


def source(name: str) -> str:
    """A source of uncertainty in words."""
    return _SOURCES.get(name, name.replace("_", " "))


def size(value: float, unit: str) -> str:
    """The size of an error in its usual unit; `none` if it is not finite."""
    factor, shown = _SHOWN_IN[unit]
    return f"{plain(factor * value)} {shown}" if known(value) else "none"


def axes_of(robot: Robot) -> Axes:
    """Axes of the controller by number of the joint, for a robot without an answer."""
    return {joint: axis for joint, axis in enumerate(alone(robot), 1) if axis}


def from_twins(text: str, axes: Axes) -> str:
    """Twins, `joint_tilt:7 = tool_flex`, in words."""
    return " = ".join(from_label(label, axes) for label in text.split(" = "))
