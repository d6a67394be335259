"""What each parameter of a cause is called, and its size in the unit that people read it in.

The one table for page, PDF, workbook and terminal; result.json keeps the short names.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from pipeline.answer.contract import Amplitude, Cause
from pipeline.base.quantities import MISSING, common_prefix, known, prefixed, scaled, with_std

_NOUNS: Mapping[str, Mapping[str, str]] = {
    "rail_lateral": {"c_lateral": "lateral compliance of the carriage"},
    "rail_vertical": {"c_vertical": "vertical compliance of the carriage"},
    "rail_roll": {"c_roll": "roll compliance of the carriage about the rail"},
    "rail_pitch": {"c_pitch": "pitch compliance of the carriage about the axis across the rail"},
    "rail_yaw": {"c_yaw": "yaw compliance of the carriage about the vertical"},
    "rail_backlash": {"b_rail": "backlash of the rail's drive"},
    "rail_stiffness_varies": {
        "c_rail_slope": "change of the drive's compliance along the whole rail",
        "c_rail_(cos|sin)": "change of the drive's compliance between supports, {0} part",
    },
    "joint_tilt": {
        r"c_tilt\d+_(x|y)": "tilt compliance of the bearing of {joint} about {0}",
        r"c_tilt\d+_xy": "coupling of both tilt compliances of the bearing of {joint}",
    },
    "link_bending": {
        "c_(upper|fore)_in_plane": "bending compliance of the {0} arm in the arm's plane",
        "c_(upper|fore)_out_of_plane": "bending compliance of the {0} arm across the arm's plane",
    },
    "tool_flex": {"c_tool_(x|y)": "tilt compliance of the tool on its flange about {0}"},
    "joint_asymmetry": {r"dc_\d+": "half of the difference of both compliances of {joint}"},
    "joint_hardening": {r"h_\d+": "change of the compliance of {joint} with the load"},
    "joint_lost_motion": {r"b_\d+": "half of the lost motion of {joint}"},
    "joint_hysteresis": {r"f_\d+": "hysteresis of {joint}, each way"},
    "joint_offset": {r"d_\d+": "error of the zero of {joint}"},
    "compensator": {
        "c_comp_(cos|sin)2?": "change of the shoulder's compliance with its angle, {0} part"
    },
    "wrist_coupling": {r"c_(\d)(\d)": "compliance that couples joints {0} and {1}"},
    "scale_gain": {"g_scale": "error of the scale's gain"},
    "scale_zero": {"f_zero": "error of the scale's zero"},
    "scale_curvature": {"e_scale": "curvature of the scale at full load"},
    "scale_hysteresis": {
        "h_scale|h_loop": "hysteresis of the scale over its reading",
        "h_down": "difference of the scale's reading on the way down",
        "h_step": "change of the scale's reading with each step",
        "f_hysteresis": "hysteresis of the scale",
    },
    "chain_weight": {"w_chain": "weight of chain and scale"},
    "chain_offset": {"d_(x|y|z)_over_L": "offset of the chain along {0} over its length"},
    "load_point_offset": {"dl_(x|y|z)": "error of the stated point along {0}"},
    "payload_mass": {"g_mass": "error of the stated mass"},
    "payload_center": {"dc_(x|y|z)": "error of the stated centre of mass along {0}"},
    "base_rotation": {"e_(x|y|z)": "rotation of the base frame about {0}"},
    "base_moved": {
        "v_(x|y|z)": "motion of the robot in F_b along {0}",
        "w_(x|y|z)": "turn of the robot in F_b about {0}",
    },
    "tracker_drift": {
        "v_(x|y|z)": "drift of the tracker along {0}",
        "a_(x|y|z)": "drift of the tracker along {0} until it is warm",
    },
    "tracker_noise": {"s_tracker": "noise of the tracker beyond that stated"},
    "force_noise": {"s_force": "noise of the scale beyond that stated"},
    "heavy_tails": {"degrees_of_freedom": "degrees of freedom of the readings' distribution"},
    "tracker_wander": {
        "s_wander": "wander of the instrument",
        "correlation_time": "time over which it wanders",
    },
    "gravity_sag": {
        "m_(upper_arm|forearm)": "mass that sags the {0}",
        "M_(.+)": "moment of the arm's weight on {0}",
    },
    "link_length": {r"\w+": "error of the length of link {number}"},
    "link_offset": {r"\w+": "error of the offset of link {number}"},
    "link_twist": {r"\w+": "error of the twist of link {number}"},
    "link_turn": {r"\w+": "error of the turn of link {number}"},
    "axis_tilt": {r"\w+": "error of the tilt of the axis of {joint}"},
    "unlisted_law": {r"\w+": "amplitude of the law"},
}
"""By cause and pattern of the parameter's name: what it is called. `{joint}` is the axis of the
controller, `{0}` the first group of the pattern."""

_UNITS = {"m/s": (1e-6 / 3600, "µm/h"), "rad/s": (1e-6 / 3600, "µrad/h"), "1": (0.01, "%")}
"""Units that people do not read as they are computed: size of the one shown, and its name."""

_BARE = ("degrees_of_freedom", "size")
"""Parameters that are no shares where they have no unit."""

_WHOLE = ("kg", "s")
"""Units that take no prefix."""


def noun(cause: Cause, parameter: str) -> str:
    """`tilt compliance of the bearing of A2 about x`; what is not listed is the cause's size."""
    number = cause.where if isinstance(cause.where, int) else ""
    own = {"joint": cause.axis or f"joint {number}", "number": number}
    for pattern, said in _NOUNS.get(cause.name, {}).items():
        found = re.fullmatch(pattern, parameter)
        if found:
            return said.format(*(one.replace("_", " ") for one in found.groups()), **own)
    return "size"


def amount(one: Amplitude) -> str:
    """`51.5 ± 3.8 nrad/(N·m)`."""
    if not known(one.value):
        return MISSING
    factor, unit = _shown_in(one)
    return f"{with_std(one.value / factor, scaled(one.std, factor))} {unit}".rstrip()


def _shown_in(one: Amplitude) -> tuple[float, str]:
    """The size of the unit shown, and its name."""
    if one.unit in _WHOLE or (one.unit == "1" and one.name in _BARE):
        return 1.0, one.unit.removeprefix("1")
    if one.unit in _UNITS:
        return _UNITS[one.unit]
    factor, letter = common_prefix([one.value])
    return factor, prefixed(one.unit, letter)


def sizes(cause: Cause) -> Iterator[str]:
    """Each parameter of a cause: `roll compliance of the carriage about the rail: 15 ± 1 ...`."""
    for one in cause.parameters:
        yield f"{noun(cause, one.name)}: {amount(one)}"
