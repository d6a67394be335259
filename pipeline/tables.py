"""What every table promises: columns, types, units, meaning; units travel in the Parquet file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv

from pipeline.base.arrays import Parameter
from pipeline.base.covariance import PAIRS
from pipeline.base.errors import TableMismatch, listed
from pipeline.machine.robot import Robot


def _col(name: str, kind: pa.DataType, unit: str, meaning: str, nullable: bool = False) -> pa.Field:
    """One column of a promise."""
    return pa.field(name, kind, nullable, {"unit": unit, "meaning": meaning})


def _promise(table: str, key: str, columns: Iterable[pa.Field]) -> pa.Schema:
    """A table's promise: its name, the columns that identify a row, and all columns."""
    return pa.schema(list(columns), metadata={"table": table, "key": key})


I32, I64, F64, STR = pa.int32(), pa.int64(), pa.float64(), pa.string()
_WORD = pa.dictionary(I32, STR)
"""Text that is the same in many rows: each word once, and its number in every row."""

_POSE = _col("pose", I32, "1", "pose number of the campaign")
_REPEAT = _col("repeat", I32, "1", "pull within the pose")
_TARGET = _col("target", STR, "1", "name of the reflector")
_SOURCE_LINE = [
    _col("file", STR, "1", "raw file, relative to the campaign folder"),
    _col("line", I64, "1", "line in that file, counted from 1"),
]
_COVARIANCE = [
    _col(f"c{ab}_m2", F64, "m^2", f"covariance of {ab[0]} and {ab[1]}, NaN where the file has none")
    for ab in PAIRS
]

READINGS = _promise(
    "readings",
    "file,line",
    [
        _SOURCE_LINE[0].with_type(_WORD),
        _SOURCE_LINE[1],
        _col("group", STR, "1", "group as the instrument named it"),
        _TARGET.with_type(_WORD),
        _col("pose", I32, "1", "pose number, null for base reflectors", nullable=True),
        _col("repeat", I32, "1", "pull within the pose, null for base reflectors", nullable=True),
        _col("state", _WORD, "1", "unloaded or loaded, null for base reflectors", nullable=True),
        _col("x_m", F64, "m", "tracker frame"),
        _col("y_m", F64, "m", "tracker frame"),
        _col("z_m", F64, "m", "tracker frame"),
        *_COVARIANCE,
        _col("covariance_from", _WORD, "1", "file | instrument | stated | paper | none"),
        _col(
            "time",
            pa.timestamp("us"),
            "UTC or local, as exported",
            "time of reading",
            nullable=True,
        ),
    ],
)
"""Readings in the frame of the tracker, in the order of the files; covariance of the reading."""

LOADS = _promise(
    "loads",
    "pose,repeat",
    [
        _POSE,
        _REPEAT,
        _col("force_n", F64, "N", "reading of the spring scale"),
        _col(
            "branch",
            _WORD,
            "1",
            "up or down: which way the turnbuckle was last turned",
            nullable=True,
        ),
        *_SOURCE_LINE,
    ],
)

REJECTED = _promise(
    "rejected",
    "file,line,reason",
    [
        _col("file", STR, "1", "raw file, relative to the campaign folder"),
        _col("line", I64, "1", "line in that file, null for the whole file", nullable=True),
        _col("reason", STR, "1", "why it was left out, and the way out"),
    ],
)

REGISTRATION = _promise(
    "registration",
    "file,line",
    [
        *_SOURCE_LINE,
        _col("group", STR, "1", "group of the reading"),
        _TARGET,
        _col("x_m", F64, "m", "reading moved into F_b"),
        _col("y_m", F64, "m", "reading moved into F_b"),
        _col("z_m", F64, "m", "reading moved into F_b"),
        _col("dx_m", F64, "m", "reading minus nominal, F_b"),
        _col("dy_m", F64, "m", "reading minus nominal, F_b"),
        _col("dz_m", F64, "m", "reading minus nominal, F_b"),
        _col(
            "time",
            pa.timestamp("us"),
            "UTC or local, as exported",
            "time of reading",
            nullable=True,
        ),
    ],
)
"""Readings of the base reflectors after registration, with their residuals."""

PLACED = _promise(
    "placed",
    "file,line",
    [
        READINGS.field(name).with_nullable(READINGS.field(name).nullable and name == "time")
        for name in READINGS.names
    ]
    + [_col("time_s", F64, "s", "time after the first reading of the campaign, NaN when unknown")],
)
"""Readings of the poses moved into F_b, covariance included; columns of `readings`, seconds."""

FORCES = _promise(
    "forces",
    "pose,repeat",
    [
        _POSE,
        _REPEAT,
        _col("fx_n", F64, "N", "force on the robot at the load point, F_b, Eqs. (10), (11)"),
        _col("fy_n", F64, "N", "as fx_n"),
        _col("fz_n", F64, "N", "as fx_n"),
        _col(
            "reading_std_n", F64, "N", "standard uncertainty of the scale reading, along the force"
        ),
        *[
            _col(
                f"u{ab}",
                F64,
                "1",
                f"covariance of direction cosines {ab[0]} and {ab[1]}; per m^2 of the tracker's "
                "variance where no noise is stated",
            )
            for ab in PAIRS
        ],
        _col("branch", I32, "1", "1 up, -1 down, 0 unknown"),
        _col("time_s", F64, "s", "mean time of the loaded targets after the first reading"),
    ],
)

DISPLACEMENTS = _promise(
    "displacements",
    "pose,repeat,target",
    [
        _POSE,
        _REPEAT,
        _TARGET,
        _col("dx_m", F64, "m", "loaded minus unloaded, F_b"),
        _col("dy_m", F64, "m", "loaded minus unloaded, F_b"),
        _col("dz_m", F64, "m", "loaded minus unloaded, F_b"),
        *[
            _col(
                f"loaded_{f.name}", F64, "m^2", f"loaded reading: {f.metadata[b'meaning'].decode()}"
            )
            for f in _COVARIANCE
        ],
        *[
            _col(
                f"zero_{f.name}", F64, "m^2", f"zero of the pose: {f.metadata[b'meaning'].decode()}"
            )
            for f in _COVARIANCE
        ],
        _col("zero_x_m", F64, "m", "unloaded position, F_b, NaN when only displacements are known"),
        _col("zero_y_m", F64, "m", "as zero_x_m"),
        _col("zero_z_m", F64, "m", "as zero_x_m"),
        _col(
            "zero_count",
            I32,
            "1",
            "unloaded readings in the zero, 0 when only displacements are known",
        ),
        _col("zero_time_s", F64, "s", "mean time of the zero after the first reading"),
    ],
)
"""Displacements; all pulls of a pose share its zero, so their errors are correlated."""

ERRORS = _promise(
    "errors",
    "error,row",
    [
        _col("error", I32, "1", "number of the independent unit error"),
        _col("source", STR, "1", "where it comes from"),
        _col("common", pa.bool_(), "1", "moves more than one pose"),
        _col("row", I32, "1", "row of the system"),
        _col("value_m", F64, "m", "what one standard uncertainty of it does to c"),
    ],
)
"""The covariance of c in factors: V = G G', with G[row, error] = value_m."""

RESIDUALS = _promise(
    "residuals",
    "row",
    [
        _col("row", I32, "1", "row of the system"),
        _POSE,
        _REPEAT,
        _TARGET,
        _col("axis", STR, "1", "x, y or z of F_b"),
        _col("residual_m", F64, "m", "c - B x"),
        _col("whitened", F64, "1", "residual in standard deviations, uncorrelated within its pose"),
        _col("left_out_m", F64, "m", "residual when the whole pose is left out of the estimate"),
    ],
)

ESTIMATE = _promise(
    "estimate",
    "parameter",
    [
        _col("parameter", STR, "1", "name of the compliance or effect parameter"),
        _col("unit", STR, "1", "its unit"),
        _col("value", F64, "see unit", "best estimate"),
        _col("std", F64, "see unit", "standard uncertainty"),
        _col("identifiable", pa.bool_(), "1", "the poses determine it"),
    ],
)

VALIDATION = _promise(
    "validation",
    "set,draw,index,target",
    [
        _col("set", STR, "1", "test_pose or global"),
        _col("draw", STR, "1", "covariance: from the full covariance; independent: as in Eq. (23)"),
        _col("index", I32, "1", "number of the validation pose, 1..1000"),
        _TARGET,
        _col("mu", F64, "1", "relative deflection error, Eq. (22)"),
    ],
)


WORKSPACE = _promise(
    "workspace",
    "row,column",
    [
        _col("row", I32, "1", "step of the shoulder joint, -1 for the test pose itself"),
        _col("column", I32, "1", "step of the elbow joint, -1 for the test pose itself"),
        _col("reach_m", F64, "m", "load point in the arm's plane, from the shoulder axis outwards"),
        _col("height_m", F64, "m", "load point in the arm's plane, height in F_b"),
        _col(
            "worst_m_per_n", F64, "m/N", "deflection of the load point per newton, worst direction"
        ),
        _col("std_m_per_n", F64, "m/N", "its standard uncertainty"),
        _col("direction_x", F64, "1", "direction in which it moves, F_b"),
        _col("direction_y", F64, "1", "as direction_x"),
        _col("direction_z", F64, "1", "as direction_x"),
    ],
)
"""How soft the robot is over the plane that its arm sweeps."""


def joints(robot: Robot) -> pa.Schema:
    """Promise of the table of joint values of a robot: pose, r1_m, theta2_rad, ..., approach."""
    values = [
        _col(
            joint_column(j.name, j.prismatic), F64, "m" if j.prismatic else "rad", f"joint {j.name}"
        )
        for j in robot.joints
    ]
    approach = _col(
        "approach", I32, "1", "1 or -1: how the carriage came along the rail, 0 unknown"
    )
    return _promise("joints", "pose", [_POSE, *values, approach, *_SOURCE_LINE])


def joint_column(name: str, prismatic: bool) -> str:
    """Column of a joint in SI: `r1_m`, `theta2_rad`."""
    return f"{name}_m" if prismatic else f"{name}_rad"


DIAGNOSIS = _promise(
    "diagnosis",
    "name,where",
    [
        _col("name", STR, "1", "cause, as in the list of causes"),
        _col("where", STR, "1", "joint number or part, empty when the cause has one place only"),
        _col("location", STR, "1", "part of the cell: rail, joint 3, tool, force, metrology ..."),
        _col("form", STR, "1", "mathematical form that fits best, empty for the only one"),
        _col("p_value", F64, "1", "F test beside the joint springs"),
        _col("threshold_p", F64, "1", "below it one suspect is a detection"),
        _col("log_evidence", F64, "1", "natural log of the evidence over the joint springs alone"),
        _col("absorbed", F64, "1", "fraction of its signature that the joint springs hide"),
        _col("smallest_visible", F64, "typical sizes", "found in 80 % of the cases; inf: never"),
        _col("named", pa.bool_(), "1", "stands among the causes of the diagnosis"),
    ],
)
"""What the data say of every suspect: the evidence bars and their threshold."""

SEPARABILITY = _promise(
    "separability",
    "cause,rival",
    [
        _col("cause", STR, "1", "cause at its typical size, name:where"),
        _col("rival", STR, "1", "cause fitted in its place; itself: the joint springs alone"),
        _col("sigmas", F64, "1", "what is left of the cause then, in standard deviations"),
    ],
)
"""Which causes this campaign can tell apart."""


def examined(robot: Robot) -> pa.Schema:
    """Promise of the rows behind the pictures of a diagnosis, one per row of the system."""
    return _promise(
        "examined",
        "row",
        [
            _col("row", I32, "1", "row of the system"),
            _POSE,
            _REPEAT,
            _TARGET,
            _col("axis", STR, "1", "x, y or z of F_b"),
            _col("x_m", F64, "m", "nominal unloaded position of the target, F_b"),
            _col("y_m", F64, "m", "as x_m"),
            _col("z_m", F64, "m", "as x_m"),
            _col("force_n", F64, "N", "size of the pull"),
            _col("time_s", F64, "s", "time of the loaded readings after the first reading"),
            _col("residual_m", F64, "m", "with the joint springs alone"),
            _col("residual_extended_m", F64, "m", "with the named causes"),
            _col("left_out_m", F64, "m", "joint springs alone, pose left out"),
            _col("left_out_extended_m", F64, "m", "causes chosen and estimated without the pose"),
            *[
                _col(
                    joint_column(j.name, j.prismatic),
                    F64,
                    "m" if j.prismatic else "rad",
                    "joint value",
                )
                for j in robot.joints
            ],
            *[
                _col(
                    f"tau_{j.name}", F64, "N" if j.prismatic else "N m", "work of the pull, J_l' f"
                )
                for j in robot.joints
            ],
        ],
    )


def system(parameters: Sequence[Parameter]) -> pa.Schema:
    """Promise of c = B x: what each row is, c_m, and one column of B per parameter."""
    return _promise(
        "system",
        "row",
        [
            _col("row", I32, "1", "row of the system"),
            _POSE,
            _REPEAT,
            _TARGET,
            _col("axis", STR, "1", "x, y or z of F_b"),
            _col("c_m", F64, "m", "displacement, Eq. (20)"),
            *[
                _col(f"B_{p.name}", F64, f"m/({p.unit})", f"derivative by {p.name}, Eq. (19)")
                for p in parameters
            ],
        ],
    )


def covariance(parameters: Sequence[Parameter]) -> pa.Schema:
    """Promise of the covariance of the estimate: one row and one column per parameter."""
    return _promise(
        "covariance",
        "parameter",
        [
            _col("parameter", STR, "1", "row"),
            *[
                _col(p.name, F64, f"unit of the row times {p.unit}", "covariance")
                for p in parameters
            ],
        ],
    )


def conform(table: pd.DataFrame | pa.Table | None, schema: pa.Schema) -> pa.Table:
    """Order and cast the columns as promised, stamp the units on, drop the rest.

    Raises:
        TableMismatch: A promised column is missing, has another type or holds nulls it must not.
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


def promised(name: str, table: pd.DataFrame | pa.Table | None, schema: pa.Schema) -> pd.DataFrame:
    """A table as a run would keep and give it on, without keeping it.

    Raises:
        TableMismatch: See `conform`.
    """
    return frame(conform(table, schema))


def frame(table: pa.Table) -> pd.DataFrame:
    """A table as pandas has it, its columns not copied where that can be."""
    return table.to_pandas(split_blocks=True)


def _arrow(table: pd.DataFrame, schema: pa.Schema) -> pa.Table:
    """A frame whose NaN stay numbers: nobody stated that covariance is not an empty cell."""
    columns = [
        pa.array(table[field.name].to_numpy(float))
        if pa.types.is_floating(field.type)
        else pa.array(table[field.name], from_pandas=True)
        for field in schema
    ]
    return pa.table(columns, schema.names)


def as_csv(table: pa.Table) -> bytes:
    """A table as CSV for a spreadsheet; no cell of words can pass for a formula there.

    Names come from files, and a spreadsheet carries out a cell that starts with one of = + - @:
    such cells get an apostrophe in front.
    """
    texts = [column.cast(STR) if column.type == _WORD else column for column in table.columns]
    columns = [_harmless(column) if column.type == STR else column for column in texts]
    sink = pa.BufferOutputStream()
    csv.write_csv(pa.table(columns, table.column_names), sink)
    return bytes(sink.getvalue())


def _harmless(words: pa.ChunkedArray) -> pa.ChunkedArray:
    formula = pc.match_substring_regex(words, r"^\s*[=+\-@\t\r]")
    return pc.if_else(formula, pc.binary_join_element_wise("'", words, ""), words)
