"""What each cause is called in front of a production engineer."""

from __future__ import annotations

CAUSES = {
    "rail_lateral": "the carriage gives way sideways on the rail",
    "rail_vertical": "the carriage gives way vertically on the rail",
    "rail_roll": "the carriage rolls about the rail",
    "rail_pitch": "the carriage pitches across the rail",
    "rail_yaw": "the carriage yaws on the rail",
    "rail_backlash": "the drive of the rail has backlash",
    "rail_stiffness_varies": "the rail drive is not equally stiff along the rail",
    "joint_tilt": "the bearing of a joint tilts",
    "link_bending": "a link bends",
    "tool_flex": "the tool or its flange gives way",
    "joint_hardening": "a joint becomes stiffer or softer under load",
    "joint_lost_motion": "a joint has lost motion",
    "joint_hysteresis": "a joint comes back on another path than it went",
    "compensator": "the gravity compensator acts on the stiffness",
    "wrist_coupling": "the wrist joints turn each other",
    "scale_gain": "the spring scale reads a constant factor off",
    "scale_zero": "the spring scale has a wrong zero",
    "scale_curvature": "the spring scale is not linear",
    "chain_weight": "the weight of the chain bends the pull",
    "chain_offset": "the chain reflectors do not lie on the line of pull",
    "joint_offset": "a joint's zero is off",
    "base_rotation": "the base frame is rotated against the robot",
    "tracker_drift": "the tracker drifted between readings",
    "gravity_sag": "the arm sags under its own weight",
    "load_point_offset": "the load point is not where the drawing says",
    "tracker_noise": "the tracker scatters more than stated",
    "force_noise": "the force readings scatter more than stated",
    "outlier": "a reading is an outlier",
    "label_swap": "names of targets are swapped",
    "unit_mixup": "a unit is mixed up",
    "sign_or_convention": "a sign or an axis convention is mixed up",
}

SOURCES = {
    "tracker": "tracker readings",
    "zero": "zero of each pose",
    "force_reading": "scale readings",
    "force reading": "scale readings",
    "force_gain": "gain of the scale",
    "force gain": "gain of the scale",
    "direction": "direction of the chain",
    "registration": "registration into the base frame",
    "geometry": "geometry of robot and tool",
}

VERDICTS = {
    "adequate": ("The model fits", "good"),
    "explained": ("A cause is named", "attention"),
    "ambiguous": ("Causes cannot be told apart yet", "attention"),
    "unexplained": ("Something unknown is missing", "bad"),
    "bad_data": ("The data need attention", "bad"),
}

EXPLAINED = {
    "adequate": "The residuals are what the stated noise makes of a right model.",
    "explained": "The joint springs alone do not explain the readings; the cause below does.",
    "ambiguous": "The joint springs alone do not explain the readings; the causes below fit "
    "equally well, and these readings cannot tell which of them it is.",
    "unexplained": "The joint springs alone do not explain the readings, and no cause in the "
    "catalogue does either: do not correct for anything on the strength of this campaign.",
    "bad_data": "Some readings contradict the others so strongly that they must be put right.",
}


def place_of_cause(where: object) -> str:
    """` in joint 3`, ` in the forearm`, ` at P2`, or nothing."""
    if where is None:
        return ""
    if isinstance(where, int):
        return f" in joint {where}"
    parts = {"upper_arm": " in the upper arm", "forearm": " in the forearm"}
    return parts.get(str(where), f" at {where}")


def cause(name: str, where: object) -> str:
    """A cause in plain words with its place."""
    return CAUSES.get(name, name.replace("_", " ")) + place_of_cause(where)


def label(name: str, where: object) -> str:
    """The machine-readable name, `joint_tilt 2`."""
    return name if where is None else f"{name} {where}"
