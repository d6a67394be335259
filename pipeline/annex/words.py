"""Names of sources of uncertainty and of suspects, and sizes of errors, in words."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.answer.contract import Answer, Data, Placed, Values, Which
from pipeline.base.quantities import known, plain
from pipeline.machine.robot import Robot
from pipeline.machine.robot.axes import alone
from pipeline.report.words import cause

_SOURCES = {
    "tracker": "tracker readings",
    "zero": "unloaded readings of each pose",
    "force_reading": "scale readings",
    "force_gain": "calibration of the scale (ISO 376)",
    "force_zero": "zero of the scale",
    "payload_mass": "mass of weights and payloads",
    "payload_center": "centre of mass of the payloads",
    "law": "laws of the identified causes",
    "seat": "seats of the identified causes",
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


def label(one: Placed) -> str:
    """The machine-readable name, `joint_tilt 2`."""
    return one.name if one.where is None else f"{one.name} {one.where}"


Axes = Mapping[int, str]
"""Axis of the controller by number of the joint; empty if the robot file maps none."""


def from_label(text: str, axes: Axes) -> str:
    """A cause in words from its label, `joint_tilt:2` or `joint_tilt`."""
    name, _, where = text.partition(":")
    return at(name, int(where) if where.isdigit() else where or None, axes)


def at(name: str, where: int | str | None, axes: Axes) -> str:
    """A cause in words with its place, under the controller's name of the axis if there is one."""
    return cause(name, where, axes.get(where) if isinstance(where, int) else None)


def axes_of(robot: Robot) -> Axes:
    """Axes of the controller by number of the joint, for a robot without an answer."""
    return {joint: axis for joint, axis in enumerate(alone(robot), 1) if axis}


def from_twins(text: str, axes: Axes) -> str:
    """Twins, `joint_tilt:7 = tool_flex`, in words."""
    return " = ".join(from_label(label, axes) for label in text.split(" = "))


def springs_alone(answer: Answer) -> tuple[str, Values] | None:
    """Name and values of the joint springs estimated from the data as given.

    None if these are the answer's own values.
    """
    recommended = answer.recommended
    names = ["joint springs alone"] if recommended.model != Which.JOINT_SPRINGS else []
    names += ["data as given"] if recommended.data == Data.CORRECTED else []
    return (", ".join(names), answer.joint_springs) if names else None
