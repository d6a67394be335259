"""Schemas of the tables behind the figures and sections after the first page."""

from __future__ import annotations

import pyarrow as pa

from pipeline.machine.robot import Robot
from pipeline.tables import (
    I64,
    PULL,
    ROW,
    TARGET,
    axes,
    column,
    count,
    joint_values,
    number,
    promise,
    six,
    text,
    word,
)

CURVES = promise(
    "curves",
    "joint,q",
    count("joint", "number of the joint, from 1"),
    number("q", "m or rad", "joint value"),
    number("error", "m or rad", "how much more the joint moves than its encoder says"),
    number("error_std", "m or rad", "its standard uncertainty"),
    count("poses", "how many poses were measured there"),
)
"""Transmission errors of the joints, from a campaign of positions."""


HELD_OUT = promise(
    "held_out",
    "model,parting,series,pose,target",
    word("model", "what the model holds"),
    word("parting", "which poses were left out at a time"),
    text("series", "series of the instrument's frame"),
    count("pose", "number of the pose in its series"),
    TARGET,
    number("distance_m", "m", "from where a model without the pose puts the target"),
)
"""Held-out errors of targets, from a campaign of positions."""


INFLUENCE = promise(
    "influence",
    "pose,repeat,what",
    *PULL,
    word("what", "parameter of the model: compliance of a joint, or size of a cause"),
    number("moves_sigmas", "1", "how far it moves without this pull, in std; NaN: lost"),
)
"""Influence of each pull on the estimates; undetermined parameters are left out."""


VALIDATION = promise(
    "validation",
    "set,draw,index,target",
    text("set", "test_pose or global"),
    text("draw", "covariance: from the full covariance; independent: as in Eq. (23)"),
    count("index", "number of the validation pose, 1..1000"),
    TARGET,
    number("mu", "1", "relative deflection error, Eq. (22)"),
)


WORKSPACE = promise(
    "workspace",
    "row,column",
    count("row", "step of the shoulder joint, -1 for the test pose itself"),
    count("column", "step of the elbow joint, -1 for the test pose itself"),
    number("reach_m", "m", "load point in the arm's plane, from the shoulder axis outwards"),
    number("height_m", "m", "load point in the arm's plane, height in F_b"),
    number("worst_m_per_n", "m/N", "deflection of the load point per newton, worst direction"),
    number("std_m_per_n", "m/N", "its standard uncertainty"),
    *axes("direction_{}", "1", "direction in which it moves, F_b"),
)
"""Compliance of the robot over the plane that its arm sweeps."""


SCENE = promise(
    "scene",
    "pose,part,name",
    count("pose", "pose as in `poses`, 0 for what stands still"),
    word("part", "base, carriage, arm, tool, tracker or reflector"),
    text("name", "joint that carries it, or name of the point"),
    *axes("from_{}_m", "m", "one end, F_b"),
    *axes("to_{}_m", "m", "other end, F_b; the same for a point"),
    number("radius_m", "m", "how thick it is, 0 for a point"),
)
"""Bodies in the cell as capsules (line segments with a radius), at the poses that are drawn."""


POSTURE = promise(
    "posture",
    "part,name",
    word("part", "base, carriage, arm, tool; joint or place for a point"),
    text("name", "joint that carries it, or name of the point"),
    count("joint", "number of the joint that carries it, 0 for what stands still"),
    *axes("from_{}_m", "m", "one end, F_b"),
    *axes("to_{}_m", "m", "other end, F_b; the same for a point"),
    number("radius_m", "m", "how thick it is, 0 for a point"),
    *axes("from_moved_{}_m", "m", "how far the one end moves at the test pose under its force"),
    *axes("to_moved_{}_m", "m", "how far the other end does"),
    *axes("from_caused_{}_m", "m", "how far the one end moves by the identified causes alone"),
    *axes("to_caused_{}_m", "m", "how far the other end does"),
)
"""The robot at the test pose, and the displacements of its parts by load and causes."""


POSES = promise(
    "poses",
    "pose",
    count("pose", "number in the picture; that of the pose where these are unique"),
    text("label", "what the pose is called"),
    text("file", "export that holds its readings, or table of displacements"),
    column("first_line", I64, "1", "its first line there, null when unknown", nullable=True),
    column("last_line", I64, "1", "its last line there, null when unknown", nullable=True),
    text("joints_file", "log that holds its joint values"),
    column("joints_line", I64, "1", "line there", nullable=True),
    count("pulls", "loads that it was measured under"),
    number("force_n", "N", "the largest of them, NaN for the arm's own weight alone"),
)
"""Poses of `scene`, and the source of their numbers."""


VECTORS = promise(
    "vectors",
    "pose,target",
    count("pose", "pose as in `poses`"),
    TARGET,
    *axes("{}_m", "m", "unloaded position, F_b; measured, or nominal where only moves are known"),
    *axes("moved_{}_m", "m", "displacement under the largest pull; of positions: off nominal"),
    *axes("left_{}_m", "m", "what the recommended model leaves of it"),
    *six("c{}_m2", "m^2", "covariance of {} and {} of the displacement, NaN when unknown"),
)
"""Displacements of the reflectors of `scene`."""


MODELS = promise(
    "models",
    "row",
    *ROW,
    number("measured_m", "m", "displacement as measured, F_b"),
    number("nominal_m", "m", "with the stiffnesses of the robot file, NaN where it states none"),
    number("joint_springs_m", "m", "with the joint springs as identified"),
    number("recommended_m", "m", "with the model that the answer stands for"),
)
"""Every displacement as measured and according to each model."""


ENOUGH = promise(
    "enough",
    "poses,parameter",
    count("poses", "how many, in the order of measuring; beyond those measured: all once more"),
    text("parameter", "name of the stiffness"),
    number("relative_std", "1", "its relative standard uncertainty; infinite: not determined"),
)
"""Uncertainty of each stiffness had fewer poses been measured, or all of them twice."""


LAWS = promise(
    "laws",
    "cause,part,pose,repeat",
    text("cause", "identified cause, name:where"),
    count("part", "which of its motions or parameters, from 1"),
    *PULL,
    text("of", "what `x` is: torque, force, load, time, angle, position, temperature or order"),
    text("x_unit", "unit of x"),
    number("x", "see x_unit", "what the law is of"),
    text("is", "what `y` is: turn, shift, compliance, or the name of a parameter"),
    text("y_unit", "unit of y"),
    number("y", "see y_unit", "as this pull or pose alone gives it, all else as identified"),
    number("y_std", "see y_unit", "its standard uncertainty from the scatter of the residuals"),
    number("law", "see y_unit", "as the law has it"),
)
"""Laws of identified causes, with the estimate of each pull by itself."""


ARM = promise(
    "arm",
    "joint",
    count("joint", "joint that carries this part"),
    *[
        number(f"{end}_{what}_m", "m", f"{what} of one end in the arm's plane, test pose")
        for end in ("from", "to")
        for what in ("reach", "height")
    ],
    number("radius_m", "m", "how thick it is"),
)
"""The arm at the test pose in the plane of `workspace`."""


CURVE_READINGS = promise(
    "curve_readings",
    "joint,q",
    count("joint", "number of the joint, from 1"),
    number("q", "m or rad", "joint value, mean of the poses together"),
    number("error", "m or rad", "how much more the joint moves than its encoder says, their mean"),
    number("error_std", "m or rad", "standard uncertainty of the mean, from their scatter"),
    count("poses", "how many poses"),
)
"""Estimates of the joints' curves by single poses, all else as identified."""


DIAGNOSIS = promise(
    "diagnosis",
    "name,where",
    text("name", "cause, as in the list of causes"),
    text("where", "joint number or part, empty when the cause has one place only"),
    text("location", "part of the cell: rail, joint 3, tool, force, metrology ..."),
    text("form", "mathematical form that fits best, empty for the only one"),
    number("p_value", "1", "F test beside the joint springs"),
    number("threshold_p", "1", "below it one suspect is a detection"),
    number("log_evidence", "1", "natural log of the evidence over the joint springs alone"),
    number("absorbed", "1", "fraction of its signature that the joint springs hide"),
    number("smallest_visible", "typical sizes", "found in 80 % of the cases; inf: never"),
    column("named", pa.bool_(), "1", "stands among the causes of the diagnosis"),
)
"""Evidence for every suspect: the evidence bars and their threshold."""


SEPARABILITY = promise(
    "separability",
    "cause,rival",
    text("cause", "cause at its typical size, name:where"),
    text("rival", "cause fitted in its place; itself: the joint springs alone"),
    number("sigmas", "1", "what is left of the cause then, in standard deviations"),
    number("sigmas_found", "1", "the same of an identified cause as large as it was found"),
)
"""Separability of causes in this campaign."""


def examined(robot: Robot) -> pa.Schema:
    """Schema of the rows behind the pictures of a diagnosis, one per row of the system."""
    work = "work of the pull, J_l' f"
    return promise(
        "examined",
        "row",
        *ROW,
        *axes("{}_m", "m", "nominal unloaded position of the target, F_b"),
        number("force_n", "N", "size of the pull"),
        number("time_s", "s", "time of the loaded readings after the first reading"),
        number("residual_m", "m", "with the joint springs alone"),
        number("residual_extended_m", "m", "with the named causes"),
        number("left_out_m", "m", "springs alone, pose left out, NaN where it stays open"),
        number("left_out_extended_m", "m", "causes found without the pose, NaN where open"),
        *joint_values(robot, "joint value"),
        *[number(f"tau_{j.name}", "N" if j.prismatic else "N m", work) for j in robot.joints],
    )
