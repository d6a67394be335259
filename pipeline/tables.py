"""Schemas of all tables: columns, types, units, meaning; units are kept in the Parquet file."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv

from pipeline.base.arrays import Parameter
from pipeline.base.covariance import PAIRS
from pipeline.base.errors import TableMismatch, listed
from pipeline.machine.robot import Robot

pd.set_option("mode.string_storage", "python")  # Arrow strings take twice the time

XYZ = ["x_m", "y_m", "z_m"]
"""Columns of a place."""


def _col(name: str, kind: pa.DataType, unit: str, meaning: str, nullable: bool = False) -> pa.Field:
    """One column of a schema."""
    return pa.field(name, kind, nullable, {"unit": unit, "meaning": meaning})


def _number(name: str, unit: str, meaning: str) -> pa.Field:
    return _col(name, F64, unit, meaning)


def _count(name: str, meaning: str, nullable: bool = False) -> pa.Field:
    return _col(name, _I32, "1", meaning, nullable)


def _text(name: str, meaning: str, nullable: bool = False) -> pa.Field:
    return _col(name, STR, "1", meaning, nullable)


def _word(name: str, meaning: str, nullable: bool = False) -> pa.Field:
    """Repetitive text, dictionary-encoded."""
    return _col(name, _WORD, "1", meaning, nullable)


def _axes(name: str, unit: str, meaning: str) -> list[pa.Field]:
    """Columns of a vector, one per axis, which replaces `{}` in the name."""
    return [_number(name.format(axis), unit, meaning) for axis in "xyz"]


def _six(name: str, unit: str, meaning: str) -> list[pa.Field]:
    """Columns of a covariance; `{}` in the name is a pair of axes, in the meaning the two axes."""
    return [_number(name.format(pair), unit, meaning.format(*pair)) for pair in PAIRS]


def _joint_values(robot: Robot, meaning: str) -> list[pa.Field]:
    """One column per joint in SI; `{}` in the meaning is its name."""
    return [
        _number(
            joint_column(j.name, j.prismatic), "m" if j.prismatic else "rad", meaning.format(j.name)
        )
        for j in robot.joints
    ]


def _promise(table: str, key: str, *columns: pa.Field) -> pa.Schema:
    """Schema of a table: its name, the columns that identify a row, and all columns."""
    return pa.schema(columns, metadata={"table": table, "key": key})


_I32, _I64, F64, STR = pa.int32(), pa.int64(), pa.float64(), pa.string()
_WORD = pa.dictionary(_I32, STR)

_POSE = _count("pose", "pose number of the campaign")
_TARGET = _text("target", "name of the reflector")
_FILE = _text("file", "raw file, relative to the campaign folder")
_LINE = _col("line", _I64, "1", "line in that file, counted from 1")
_TIME = _col("time", pa.timestamp("us"), "UTC or local, as exported", "time of reading", True)
_PULL = (_POSE, _count("repeat", "pull within the pose"))
_SOURCE = (_FILE, _LINE)
_ROW = (_count("row", "row of the system"), *_PULL, _TARGET, _text("axis", "x, y or z of F_b"))
"""Columns that identify a row of c = B x: one coordinate of one displacement."""

READINGS = _promise(
    "readings",
    "file,line",
    _FILE.with_type(_WORD),
    _LINE,
    _text("group", "group as the instrument named it"),
    _TARGET.with_type(_WORD),
    _count("pose", "pose number, null for base reflectors", nullable=True),
    _count("repeat", "pull within the pose, null for base reflectors", nullable=True),
    _word("state", "unloaded or loaded, null for base reflectors", nullable=True),
    *_axes("{}_m", "m", "tracker frame"),
    *_six("c{}_m2", "m^2", "covariance of {} and {}, NaN where the file has none"),
    _word("covariance_from", "file | instrument | sheet | stated | paper | none"),
    _TIME,
)
"""Readings in the frame of the tracker, in the order of the files, with their covariance."""

LOADS = _promise(
    "loads",
    "pose,repeat",
    *_PULL,
    _number("force_n", "N", "reading of the spring scale, NaN for weights and payloads"),
    _number("unit_n", "N", "unit in which the log states it, NaN where it states none"),
    _number("mass_kg", "kg", "weight at the load point, NaN for other loads"),
    _number("mass_sigma_kg", "kg", "its standard uncertainty, 0 where none is stated"),
    _word("payload", "name of the payload on the flange, null for other loads", nullable=True),
    _word("branch", "up or down: which way the turnbuckle was last turned", nullable=True),
    *_SOURCE,
)

CURVES = _promise(
    "curves",
    "joint,q",
    _count("joint", "number of the joint, from 1"),
    _number("q", "m or rad", "joint value"),
    _number("error", "m or rad", "how much more the joint moves than its encoder says"),
    _number("error_std", "m or rad", "its standard uncertainty"),
    _count("poses", "how many poses were measured there"),
)
"""Transmission errors of the joints, from a campaign of positions."""

HELD_OUT = _promise(
    "held_out",
    "model,parting,series,pose,target",
    _word("model", "what the model holds"),
    _word("parting", "which poses were left out at a time"),
    _text("series", "series of the instrument's frame"),
    _count("pose", "number of the pose in its series"),
    _TARGET,
    _number("distance_m", "m", "from where a model without the pose puts the target"),
)
"""Held-out errors of targets, from a campaign of positions."""

REJECTED = _promise(
    "rejected",
    "file,line,reason",
    _FILE,
    _col("line", _I64, "1", "line in that file, null for the whole file", nullable=True),
    _text("reason", "why it was left out, and the way out"),
)

REGISTRATION = _promise(
    "registration",
    "file,line",
    *_SOURCE,
    _text("group", "group of the reading"),
    _TARGET,
    *_axes("{}_m", "m", "reading moved into F_b"),
    *_axes("d{}_m", "m", "reading minus nominal, F_b"),
    _TIME,
)
"""Readings of the base reflectors after registration, with their residuals."""

PLACED = _promise(
    "placed",
    "file,line",
    *(field.with_nullable(field.name == "time") for field in READINGS),
    _number("time_s", "s", "time after the first reading of the campaign, NaN when unknown"),
)
"""Readings of the poses transformed into F_b with their covariance; columns of `readings`, and
seconds."""

FORCES = _promise(
    "forces",
    "pose,repeat",
    *_PULL,
    *_axes("f{}_n", "N", "force on the robot, F_b, Eqs. (10), (11), or a weight"),
    _count("by", "0 pulled by a chain, 1 a weight at the load point, 2 a payload on the flange"),
    _count("body", "number of the weight or payload, equal ones are one; -1 for pulls"),
    *_axes("at_{}_m", "m", "where it acts, flange frame; NaN at the load point"),
    _number("mass_std_n", "N", "standard uncertainty of the weight, one error for each body"),
    _number("center_std_m", "m", "standard uncertainty per axis of its centre, likewise"),
    _number("reading_std_n", "N", "standard uncertainty of the scale reading, along the force"),
    *_six(
        "u{}",
        "1",
        "covariance of direction cosines {} and {}; per m^2 of the tracker's variance where no "
        "noise is stated",
    ),
    _count("branch", "1 up, -1 down, 0 unknown"),
    _number("time_s", "s", "mean time of the loaded targets after the first reading"),
)

DISPLACEMENTS = _promise(
    "displacements",
    "pose,repeat,target",
    *_PULL,
    _TARGET,
    *_axes("d{}_m", "m", "loaded minus unloaded, F_b"),
    *_six(
        "loaded_c{}_m2",
        "m^2",
        "loaded reading: covariance of {} and {}, NaN where the file has none",
    ),
    *_six(
        "zero_c{}_m2",
        "m^2",
        "zero of the pose: covariance of {} and {}, NaN where the file has none",
    ),
    *_axes("zero_{}_m", "m", "unloaded position, F_b, NaN when only displacements are known"),
    _count("zero_count", "unloaded readings in the zero, 0 when only displacements are known"),
    _number("zero_time_s", "s", "mean time of the zero after the first reading"),
)
"""Displacements; all pulls of a pose share its zero, so their errors are correlated."""

ERRORS = _promise(
    "errors",
    "error,row",
    _count("error", "number of the independent unit error"),
    _text("source", "where it comes from"),
    _col("common", pa.bool_(), "1", "moves more than one pose"),
    _count("row", "row of the system"),
    _number("value_m", "m", "what one standard uncertainty of it does to c"),
)
"""Factors of the covariance of c: V = G G', with G[row, error] = value_m."""

RESIDUALS = _promise(
    "residuals",
    "row",
    *_ROW,
    _number("residual_m", "m", "c - B x"),
    _number("whitened", "1", "residual in standard deviations, uncorrelated within its pose"),
    _number("left_out_m", "m", "pose left out of the estimate, NaN where it stays open"),
)

RELIABILITY = _promise(
    "reliability",
    "source,reading,axis",
    _word("source", "source of the error, as in `errors`; base: a reading of a base reflector"),
    _text(
        "reading", "group/target, or line of the load log; null for an error of no reading", True
    ),
    _FILE.with_type(_WORD).with_nullable(True),
    _LINE.with_nullable(True),
    _word("axis", "axis of F_b nearest to the error, null where it has no direction", True),
    _number("r", "1", "redundancy: the part of the error that the residuals show, 0 to 1"),
    _number("w", "1", "standardised residual, normal with variance 1; NaN where r is zero"),
    _number(
        "smallest_visible", "see unit", "size that w shows in 80 % of the cases; infinite: none"
    ),
    _text("unit", "of smallest_visible; 1: standard uncertainties"),
    _number("moves_sigmas", "1", "what that size moves most, in its std; infinite: no limit"),
    _text("moves_most", "what it moves most: a stiffness, or a target's deflection at test pose"),
)
"""Redundancy of the readings: one row for each column of G, then the base readings. The r of all
columns of G add up to rows minus parameters, those of the base readings, which have an adjustment
of their own, to their number times three minus six."""

INFLUENCE = _promise(
    "influence",
    "pose,repeat,what",
    *_PULL,
    _word("what", "parameter of the model: compliance of a joint, or size of a cause"),
    _number("moves_sigmas", "1", "how far it moves without this pull, in std; NaN: lost"),
)
"""Influence of each pull on the estimates; undetermined parameters are left out."""

ESTIMATE = _promise(
    "estimate",
    "parameter",
    _text("parameter", "name of the compliance or effect parameter"),
    _text("unit", "its unit"),
    _number("value", "see unit", "best estimate"),
    _number("std", "see unit", "standard uncertainty"),
    _col("identifiable", pa.bool_(), "1", "the poses determine it"),
)

VALIDATION = _promise(
    "validation",
    "set,draw,index,target",
    _text("set", "test_pose or global"),
    _text("draw", "covariance: from the full covariance; independent: as in Eq. (23)"),
    _count("index", "number of the validation pose, 1..1000"),
    _TARGET,
    _number("mu", "1", "relative deflection error, Eq. (22)"),
)

WORKSPACE = _promise(
    "workspace",
    "row,column",
    _count("row", "step of the shoulder joint, -1 for the test pose itself"),
    _count("column", "step of the elbow joint, -1 for the test pose itself"),
    _number("reach_m", "m", "load point in the arm's plane, from the shoulder axis outwards"),
    _number("height_m", "m", "load point in the arm's plane, height in F_b"),
    _number("worst_m_per_n", "m/N", "deflection of the load point per newton, worst direction"),
    _number("std_m_per_n", "m/N", "its standard uncertainty"),
    *_axes("direction_{}", "1", "direction in which it moves, F_b"),
)
"""Compliance of the robot over the plane that its arm sweeps."""

SCENE = _promise(
    "scene",
    "pose,part,name",
    _count("pose", "pose as in `poses`, 0 for what stands still"),
    _word("part", "base, carriage, arm, tool, tracker or reflector"),
    _text("name", "joint that carries it, or name of the point"),
    *_axes("from_{}_m", "m", "one end, F_b"),
    *_axes("to_{}_m", "m", "other end, F_b; the same for a point"),
    _number("radius_m", "m", "how thick it is, 0 for a point"),
)
"""Bodies in the cell as capsules (line segments with a radius), at the poses that are drawn."""

POSTURE = _promise(
    "posture",
    "part,name",
    _word("part", "base, carriage, arm, tool; joint or place for a point"),
    _text("name", "joint that carries it, or name of the point"),
    _count("joint", "number of the joint that carries it, 0 for what stands still"),
    *_axes("from_{}_m", "m", "one end, F_b"),
    *_axes("to_{}_m", "m", "other end, F_b; the same for a point"),
    _number("radius_m", "m", "how thick it is, 0 for a point"),
    *_axes("from_moved_{}_m", "m", "how far the one end moves at the test pose under its force"),
    *_axes("to_moved_{}_m", "m", "how far the other end does"),
    *_axes("from_caused_{}_m", "m", "how far the one end moves by the identified causes alone"),
    *_axes("to_caused_{}_m", "m", "how far the other end does"),
)
"""The robot at the test pose, and the displacements of its parts by load and causes."""

POSES = _promise(
    "poses",
    "pose",
    _count("pose", "number in the picture; that of the pose where these are unique"),
    _text("label", "what the pose is called"),
    _text("file", "export that holds its readings, or table of displacements"),
    _col("first_line", _I64, "1", "its first line there, null when unknown", nullable=True),
    _col("last_line", _I64, "1", "its last line there, null when unknown", nullable=True),
    _text("joints_file", "log that holds its joint values"),
    _col("joints_line", _I64, "1", "line there", nullable=True),
    _count("pulls", "loads that it was measured under"),
    _number("force_n", "N", "the largest of them, NaN for the arm's own weight alone"),
)
"""Poses of `scene`, and the source of their numbers."""

VECTORS = _promise(
    "vectors",
    "pose,target",
    _count("pose", "pose as in `poses`"),
    _TARGET,
    *_axes("{}_m", "m", "unloaded position, F_b; measured, or nominal where only moves are known"),
    *_axes("moved_{}_m", "m", "displacement under the largest pull; of positions: off nominal"),
    *_axes("left_{}_m", "m", "what the recommended model leaves of it"),
    *_six("c{}_m2", "m^2", "covariance of {} and {} of the displacement, NaN when unknown"),
)
"""Displacements of the reflectors of `scene`."""

MODELS = _promise(
    "models",
    "row",
    *_ROW,
    _number("measured_m", "m", "displacement as measured, F_b"),
    _number("nominal_m", "m", "with the stiffnesses of the robot file, NaN where it states none"),
    _number("joint_springs_m", "m", "with the joint springs as identified"),
    _number("recommended_m", "m", "with the model that the answer stands for"),
)
"""Every displacement as measured and according to each model."""

ENOUGH = _promise(
    "enough",
    "poses,parameter",
    _count("poses", "how many, in the order of measuring; beyond those measured: all once more"),
    _text("parameter", "name of the stiffness"),
    _number("relative_std", "1", "its relative standard uncertainty; infinite: not determined"),
)
"""Uncertainty of each stiffness had fewer poses been measured, or all of them twice."""

LAWS = _promise(
    "laws",
    "cause,part,pose,repeat",
    _text("cause", "identified cause, name:where"),
    _count("part", "which of its motions or parameters, from 1"),
    *_PULL,
    _text("of", "what `x` is: torque, force, load, time, angle, position, temperature or order"),
    _text("x_unit", "unit of x"),
    _number("x", "see x_unit", "what the law is of"),
    _text("is", "what `y` is: turn, shift, compliance, or the name of a parameter"),
    _text("y_unit", "unit of y"),
    _number("y", "see y_unit", "as this pull or pose alone gives it, all else as identified"),
    _number("y_std", "see y_unit", "its standard uncertainty from the scatter of the residuals"),
    _number("law", "see y_unit", "as the law has it"),
)
"""Laws of identified causes, with the estimate of each pull by itself."""

ARM = _promise(
    "arm",
    "joint",
    _count("joint", "joint that carries this part"),
    *[
        _number(f"{end}_{what}_m", "m", f"{what} of one end in the arm's plane, test pose")
        for end in ("from", "to")
        for what in ("reach", "height")
    ],
    _number("radius_m", "m", "how thick it is"),
)
"""The arm at the test pose in the plane of `workspace`."""

CURVE_READINGS = _promise(
    "curve_readings",
    "joint,q",
    _count("joint", "number of the joint, from 1"),
    _number("q", "m or rad", "joint value, mean of the poses together"),
    _number("error", "m or rad", "how much more the joint moves than its encoder says, their mean"),
    _number("error_std", "m or rad", "standard uncertainty of the mean, from their scatter"),
    _count("poses", "how many poses"),
)
"""Estimates of the joints' curves by single poses, all else as identified."""
PATH = _promise(
    "path",
    "point",
    _count("point", "place in the path, from 1"),
    _count("pose", "number of the point in the file"),
    *_axes("{}_m", "m", "load point without load, F_b"),
    *_axes("f{}_n", "N", "force at the load point, F_b"),
    *_axes("d{}_m", "m", "predicted deflection of the load point, F_b"),
    _number("deflection_m", "m", "its length d"),
    _number("std_m", "m", "its standard uncertainty u; infinite: a spring is not determined"),
    _text("decision", "pass, fail or undecided by ISO 14253-1"),
)
"""Machining path of [tolerance], point by point."""


def positions(robot: Robot) -> pa.Schema:
    """Schema of absolute positions as read, in the frame of the instrument."""
    return _promise(
        "positions",
        "series,pose,target",
        _text("series", "series of the instrument's frame"),
        _number("pose", "1", "number of the pose in its series"),
        _TARGET,
        _text("payload", "name of the payload on the flange, empty for none"),
        _number("temperature", "degC", "of the air, NaN unknown"),
        *_SOURCE,
        *(_number(axis, "m", "reading") for axis in "xyz"),
        *(_number(f"r{axis}", "rad", "reading of a 6D target, NaN for a point") for axis in "xyz"),
        *(_number(j.name, "m" if j.prismatic else "rad", "joint value") for j in robot.joints),
    )


def joints(robot: Robot) -> pa.Schema:
    """Schema of the joint values of a robot: pose, r1_m, theta2_rad, ..., approach."""
    approach = _count("approach", "1 or -1: how the carriage came along the rail, 0 unknown")
    return _promise("joints", "pose", _POSE, *_joint_values(robot, "joint {}"), approach, *_SOURCE)


def joint_column(name: str, prismatic: bool) -> str:
    """Column of a joint in SI: `r1_m`, `theta2_rad`."""
    return f"{name}_m" if prismatic else f"{name}_rad"


DIAGNOSIS = _promise(
    "diagnosis",
    "name,where",
    _text("name", "cause, as in the list of causes"),
    _text("where", "joint number or part, empty when the cause has one place only"),
    _text("location", "part of the cell: rail, joint 3, tool, force, metrology ..."),
    _text("form", "mathematical form that fits best, empty for the only one"),
    _number("p_value", "1", "F test beside the joint springs"),
    _number("threshold_p", "1", "below it one suspect is a detection"),
    _number("log_evidence", "1", "natural log of the evidence over the joint springs alone"),
    _number("absorbed", "1", "fraction of its signature that the joint springs hide"),
    _number("smallest_visible", "typical sizes", "found in 80 % of the cases; inf: never"),
    _col("named", pa.bool_(), "1", "stands among the causes of the diagnosis"),
)
"""Evidence for every suspect: the evidence bars and their threshold."""

SEPARABILITY = _promise(
    "separability",
    "cause,rival",
    _text("cause", "cause at its typical size, name:where"),
    _text("rival", "cause fitted in its place; itself: the joint springs alone"),
    _number("sigmas", "1", "what is left of the cause then, in standard deviations"),
    _number("sigmas_found", "1", "the same of an identified cause as large as it was found"),
)
"""Separability of causes in this campaign."""


def examined(robot: Robot) -> pa.Schema:
    """Schema of the rows behind the pictures of a diagnosis, one per row of the system."""
    work = "work of the pull, J_l' f"
    return _promise(
        "examined",
        "row",
        *_ROW,
        *_axes("{}_m", "m", "nominal unloaded position of the target, F_b"),
        _number("force_n", "N", "size of the pull"),
        _number("time_s", "s", "time of the loaded readings after the first reading"),
        _number("residual_m", "m", "with the joint springs alone"),
        _number("residual_extended_m", "m", "with the named causes"),
        _number("left_out_m", "m", "springs alone, pose left out, NaN where it stays open"),
        _number("left_out_extended_m", "m", "causes found without the pose, NaN where open"),
        *_joint_values(robot, "joint value"),
        *[_number(f"tau_{j.name}", "N" if j.prismatic else "N m", work) for j in robot.joints],
    )


def system(parameters: Sequence[Parameter]) -> pa.Schema:
    """Schema of c = B x: identification of the row, c_m, and one column of B per parameter."""
    return _promise(
        "system",
        "row",
        *_ROW,
        _number("c_m", "m", "displacement, Eq. (20)"),
        *[
            _number(f"B_{p.name}", f"m/({p.unit})", f"derivative by {p.name}, Eq. (19)")
            for p in parameters
        ],
    )


def covariance(parameters: Sequence[Parameter]) -> pa.Schema:
    """Schema of the covariance of the estimate: one row and one column per parameter."""
    return _promise(
        "covariance",
        "parameter",
        _text("parameter", "row"),
        *[_number(p.name, f"unit of the row times {p.unit}", "covariance") for p in parameters],
    )


def conform(table: pd.DataFrame | pa.Table | None, schema: pa.Schema) -> pa.Table:
    """Order and cast the columns according to the schema, add units, drop other columns.

    Raises:
        TableMismatch: A column is missing, has another type or contains nulls where not allowed.
    """
    name = schema.metadata[b"table"].decode()
    if table is None:
        raise TableMismatch(f"table {name} was not made")
    here = table.columns if isinstance(table, pd.DataFrame) else table.column_names
    missing = [column for column in schema.names if column not in here]
    if missing:
        raise TableMismatch(f"table {name} lacks the columns {listed(missing)}")
    try:
        arrow = _arrow(table, schema) if isinstance(table, pd.DataFrame) else table
        cast = arrow.select(schema.names).replace_schema_metadata(None).cast(schema)
    except (pa.ArrowInvalid, pa.ArrowTypeError, ValueError) as problem:
        raise TableMismatch(f"table {name} does not keep its promise: {problem}") from problem
    for field in schema:
        if not field.nullable and cast[field.name].null_count:
            raise TableMismatch(f"table {name}: column {field.name} has empty cells")
    return cast


def frame(table: pa.Table) -> pd.DataFrame:
    """Table as a pandas frame, without copying columns if possible."""
    return table.to_pandas(split_blocks=True)


def _arrow(table: pd.DataFrame, schema: pa.Schema) -> pa.Table:
    """Arrow table of a frame, keeping NaN: an unknown covariance is not an empty cell."""
    columns = [
        pa.array(table[field.name].to_numpy(float))
        if pa.types.is_floating(field.type)
        else pa.array(table[field.name], from_pandas=True)
        for field in schema
    ]
    return pa.table(columns, schema.names)


def as_csv(table: pa.Table) -> bytes:
    """Table as CSV for a spreadsheet, with no text cell that it would take for a formula.

    Names come from files, and a spreadsheet evaluates a cell that starts with one of = + - @, also
    of full width: such cells get a leading apostrophe.
    """
    texts = [column.cast(STR) if column.type == _WORD else column for column in table.columns]
    columns = [harmless(column) if column.type == STR else column for column in texts]
    sink = pa.BufferOutputStream()
    csv.write_csv(pa.table(columns, table.column_names), sink)
    return bytes(sink.getvalue())


def harmless(words: pa.ChunkedArray) -> pa.ChunkedArray:
    """Text with a leading apostrophe where a spreadsheet would evaluate it."""
    formula = pc.match_substring_regex(words, r"^[\s\pZ]*[=+\-@\t\r＝＋－＠]")
    return pc.if_else(formula, pc.binary_join_element_wise("'", words, ""), words)
