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


def col(name: str, kind: pa.DataType, unit: str, meaning: str, nullable: bool = False) -> pa.Field:
    """One column of a promise."""
    return pa.field(name, kind, nullable, {"unit": unit, "meaning": meaning})


def promise(table: str, key: str, columns: Iterable[pa.Field]) -> pa.Schema:
    """A table's promise: its name, the columns that identify a row, and all columns."""
    return pa.schema(list(columns), metadata={"table": table, "key": key})


I32, I64, F64, STR = pa.int32(), pa.int64(), pa.float64(), pa.string()
WORD = pa.dictionary(I32, STR)
"""Text that is the same in many rows: each word once, and its number in every row."""

POSE = col("pose", I32, "1", "pose number of the campaign")
REPEAT = col("repeat", I32, "1", "pull within the pose")
TARGET = col("target", STR, "1", "name of the reflector")
SOURCE_LINE = [
    col("file", STR, "1", "raw file, relative to the campaign folder"),
    col("line", I64, "1", "line in that file, counted from 1"),
]
COVARIANCE = [
    col(f"c{ab}_m2", F64, "m^2", f"covariance of {ab[0]} and {ab[1]}, NaN where the file has none")
    for ab in PAIRS
]

READINGS = promise(
    "readings",
    "file,line",
    [
        SOURCE_LINE[0].with_type(WORD),
        SOURCE_LINE[1],
        col("group", STR, "1", "group as the instrument named it"),
        TARGET.with_type(WORD),
        col("pose", I32, "1", "pose number, null for base reflectors", nullable=True),
        col("repeat", I32, "1", "pull within the pose, null for base reflectors", nullable=True),
        col("state", WORD, "1", "unloaded or loaded, null for base reflectors", nullable=True),
        col("x_m", F64, "m", "tracker frame"),
        col("y_m", F64, "m", "tracker frame"),
        col("z_m", F64, "m", "tracker frame"),
        *COVARIANCE,
        col("covariance_from", WORD, "1", "file | instrument | stated | paper | none"),
        col(
            "time",
            pa.timestamp("us"),
            "UTC or local, as exported",
            "time of reading",
            nullable=True,
        ),
    ],
)
"""Readings in the frame of the tracker, in the order of the files; covariance of the reading."""

LOADS = promise(
    "loads",
    "pose,repeat",
    [
        POSE,
        REPEAT,
        col("force_n", F64, "N", "reading of the spring scale"),
        col(
            "branch",
            WORD,
            "1",
            "up or down: which way the turnbuckle was last turned",
            nullable=True,
        ),
        *SOURCE_LINE,
    ],
)

REJECTED = promise(
    "rejected",
    "file,line,reason",
    [
        col("file", STR, "1", "raw file, relative to the campaign folder"),
        col("line", I64, "1", "line in that file, null for the whole file", nullable=True),
        col("reason", STR, "1", "why it was left out, and the way out"),
    ],
)

REGISTRATION = promise(
    "registration",
    "file,line",
    [
        *SOURCE_LINE,
        col("group", STR, "1", "group of the reading"),
        TARGET,
        col("x_m", F64, "m", "reading moved into F_b"),
        col("y_m", F64, "m", "reading moved into F_b"),
        col("z_m", F64, "m", "reading moved into F_b"),
        col("dx_m", F64, "m", "reading minus nominal, F_b"),
        col("dy_m", F64, "m", "reading minus nominal, F_b"),
        col("dz_m", F64, "m", "reading minus nominal, F_b"),
        col(
            "time",
            pa.timestamp("us"),
            "UTC or local, as exported",
            "time of reading",
            nullable=True,
        ),
    ],
)
"""Readings of the base reflectors after registration, with their residuals."""

PLACED = promise(
    "placed",
    "file,line",
    [
        READINGS.field(name).with_nullable(READINGS.field(name).nullable and name == "time")
        for name in READINGS.names
    ]
    + [col("time_s", F64, "s", "time after the first reading of the campaign, NaN when unknown")],
)
"""Readings of the poses moved into F_b, covariance included; columns of `readings`, seconds."""

FORCES = promise(
    "forces",
    "pose,repeat",
    [
        POSE,
        REPEAT,
        col("fx_n", F64, "N", "force on the robot at the load point, F_b, Eqs. (10), (11)"),
        col("fy_n", F64, "N", "as fx_n"),
        col("fz_n", F64, "N", "as fx_n"),
        col(
            "reading_std_n", F64, "N", "standard uncertainty of the scale reading, along the force"
        ),
        *[
            col(
                f"u{ab}",
                F64,
                "1",
                f"covariance of direction cosines {ab[0]} and {ab[1]}; per m^2 of the tracker's "
                "variance where no noise is stated",
            )
            for ab in PAIRS
        ],
        col("branch", I32, "1", "1 up, -1 down, 0 unknown"),
        col("time_s", F64, "s", "mean time of the loaded targets after the first reading"),
    ],
)

DISPLACEMENTS = promise(
    "displacements",
    "pose,repeat,target",
    [
        POSE,
        REPEAT,
        TARGET,
        col("dx_m", F64, "m", "loaded minus unloaded, F_b"),
        col("dy_m", F64, "m", "loaded minus unloaded, F_b"),
        col("dz_m", F64, "m", "loaded minus unloaded, F_b"),
        *[
            col(
                f"loaded_{f.name}", F64, "m^2", f"loaded reading: {f.metadata[b'meaning'].decode()}"
            )
            for f in COVARIANCE
        ],
        *[
            col(
                f"zero_{f.name}", F64, "m^2", f"zero of the pose: {f.metadata[b'meaning'].decode()}"
            )
            for f in COVARIANCE
        ],
        col("zero_x_m", F64, "m", "unloaded position, F_b, NaN when only displacements are known"),
        col("zero_y_m", F64, "m", "as zero_x_m"),
        col("zero_z_m", F64, "m", "as zero_x_m"),
        col(
            "zero_count",
            I32,
            "1",
            "unloaded readings in the zero, 0 when only displacements are known",
        ),
        col("zero_time_s", F64, "s", "mean time of the zero after the first reading"),
    ],
)
"""Displacements; all pulls of a pose share its zero, so their errors are correlated."""

ERRORS = promise(
    "errors",
    "error,row",
    [
        col("error", I32, "1", "number of the independent unit error"),
        col("source", STR, "1", "where it comes from"),
        col("common", pa.bool_(), "1", "moves more than one pose"),
        col("row", I32, "1", "row of the system"),
        col("value_m", F64, "m", "what one standard uncertainty of it does to c"),
    ],
)
"""The covariance of c in factors: V = G G', with G[row, error] = value_m."""

RESIDUALS = promise(
    "residuals",
    "row",
    [
        col("row", I32, "1", "row of the system"),
        POSE,
        REPEAT,
        TARGET,
        col("axis", STR, "1", "x, y or z of F_b"),
        col("residual_m", F64, "m", "c - B x"),
        col("whitened", F64, "1", "residual in standard deviations, uncorrelated within its pose"),
        col("left_out_m", F64, "m", "residual when the whole pose is left out of the estimate"),
    ],
)

ESTIMATE = promise(
    "estimate",
    "parameter",
    [
        col("parameter", STR, "1", "name of the compliance or effect parameter"),
        col("unit", STR, "1", "its unit"),
        col("value", F64, "see unit", "best estimate"),
        col("std", F64, "see unit", "standard uncertainty"),
        col("identifiable", pa.bool_(), "1", "the poses determine it"),
    ],
)

VALIDATION = promise(
    "validation",
    "set,draw,index,target",
    [
        col("set", STR, "1", "test_pose or global"),
        col("draw", STR, "1", "covariance: from the full covariance; independent: as in Eq. (23)"),
        col("index", I32, "1", "number of the validation pose, 1..1000"),
        TARGET,
        col("mu", F64, "1", "relative deflection error, Eq. (22)"),
    ],
)


WORKSPACE = promise(
    "workspace",
    "row,column",
    [
        col("row", I32, "1", "step of the shoulder joint, -1 for the test pose itself"),
        col("column", I32, "1", "step of the elbow joint, -1 for the test pose itself"),
        col("reach_m", F64, "m", "load point in the arm's plane, from the shoulder axis outwards"),
        col("height_m", F64, "m", "load point in the arm's plane, height in F_b"),
        col(
            "worst_m_per_n", F64, "m/N", "deflection of the load point per newton, worst direction"
        ),
        col("std_m_per_n", F64, "m/N", "its standard uncertainty"),
        col("direction_x", F64, "1", "direction in which it moves, F_b"),
        col("direction_y", F64, "1", "as direction_x"),
        col("direction_z", F64, "1", "as direction_x"),
    ],
)
"""How soft the robot is over the plane that its arm sweeps."""


def joints(robot: Robot) -> pa.Schema:
    """Promise of the table of joint values of a robot: pose, r1_m, theta2_rad, ..., approach."""
    values = [
        col(
            joint_column(j.name, j.prismatic), F64, "m" if j.prismatic else "rad", f"joint {j.name}"
        )
        for j in robot.joints
    ]
    approach = col("approach", I32, "1", "1 or -1: how the carriage came along the rail, 0 unknown")
    return promise("joints", "pose", [POSE, *values, approach, *SOURCE_LINE])


def joint_column(name: str, prismatic: bool) -> str:
    """Column of a joint in SI: `r1_m`, `theta2_rad`."""
    return f"{name}_m" if prismatic else f"{name}_rad"


DIAGNOSIS = promise(
    "diagnosis",
    "name,where",
    [
        col("name", STR, "1", "cause, as in the list of causes"),
        col("where", STR, "1", "joint number or part, empty when the cause has one place only"),
        col("location", STR, "1", "part of the cell: rail, joint 3, tool, force, metrology ..."),
        col("form", STR, "1", "mathematical form that fits best, empty for the only one"),
        col("p_value", F64, "1", "F test beside the joint springs"),
        col("threshold_p", F64, "1", "below it one suspect is a detection"),
        col("log_evidence", F64, "1", "natural log of the evidence over the joint springs alone"),
        col("absorbed", F64, "1", "fraction of its signature that the joint springs hide"),
        col("smallest_visible", F64, "typical sizes", "found in 80 % of the cases; inf: never"),
        col("named", pa.bool_(), "1", "stands among the causes of the diagnosis"),
    ],
)
"""What the data say of every suspect: the evidence bars and their threshold."""

SEPARABILITY = promise(
    "separability",
    "cause,rival",
    [
        col("cause", STR, "1", "cause at its typical size, name:where"),
        col("rival", STR, "1", "cause fitted in its place; itself: the joint springs alone"),
        col("sigmas", F64, "1", "what is left of the cause then, in standard deviations"),
    ],
)
"""Which causes this campaign can tell apart."""


def examined(robot: Robot) -> pa.Schema:
    """Promise of the rows behind the pictures of a diagnosis, one per row of the system."""
    return promise(
        "examined",
        "row",
        [
            col("row", I32, "1", "row of the system"),
            POSE,
            REPEAT,
            TARGET,
            col("axis", STR, "1", "x, y or z of F_b"),
            col("x_m", F64, "m", "nominal unloaded position of the target, F_b"),
            col("y_m", F64, "m", "as x_m"),
            col("z_m", F64, "m", "as x_m"),
            col("force_n", F64, "N", "size of the pull"),
            col("time_s", F64, "s", "time of the loaded readings after the first reading"),
            col("residual_m", F64, "m", "with the joint springs alone"),
            col("residual_extended_m", F64, "m", "with the named causes"),
            col("left_out_m", F64, "m", "joint springs alone, pose left out"),
            col("left_out_extended_m", F64, "m", "causes chosen and estimated without the pose"),
            *[
                col(
                    joint_column(j.name, j.prismatic),
                    F64,
                    "m" if j.prismatic else "rad",
                    "joint value",
                )
                for j in robot.joints
            ],
            *[
                col(f"tau_{j.name}", F64, "N" if j.prismatic else "N m", "work of the pull, J_l' f")
                for j in robot.joints
            ],
        ],
    )


def system(parameters: Sequence[Parameter]) -> pa.Schema:
    """Promise of c = B x: what each row is, c_m, and one column of B per parameter."""
    return promise(
        "system",
        "row",
        [
            col("row", I32, "1", "row of the system"),
            POSE,
            REPEAT,
            TARGET,
            col("axis", STR, "1", "x, y or z of F_b"),
            col("c_m", F64, "m", "displacement, Eq. (20)"),
            *[
                col(f"B_{p.name}", F64, f"m/({p.unit})", f"derivative by {p.name}, Eq. (19)")
                for p in parameters
            ],
        ],
    )


def covariance(parameters: Sequence[Parameter]) -> pa.Schema:
    """Promise of the covariance of the estimate: one row and one column per parameter."""
    return promise(
        "covariance",
        "parameter",
        [
            col("parameter", STR, "1", "row"),
            *[
                col(p.name, F64, f"unit of the row times {p.unit}", "covariance")
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
    texts = [column.cast(STR) if column.type == WORD else column for column in table.columns]
    columns = [_harmless(column) if column.type == STR else column for column in texts]
    sink = pa.BufferOutputStream()
    csv.write_csv(pa.table(columns, table.column_names), sink)
    return bytes(sink.getvalue())


def _harmless(words: pa.ChunkedArray) -> pa.ChunkedArray:
    formula = pc.match_substring_regex(words, r"^\s*[=+\-@\t\r]")
    return pc.if_else(formula, pc.binary_join_element_wise("'", words, ""), words)
