"""Schemas of tables: columns, types, units, meaning; units are kept in the Parquet file.

Those of tables that only one outbuilding makes are there (`annex/promises.py`, `fleet/tables.py`).
"""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
import pyarrow as pa

from pipeline.base.arrays import Parameter
from pipeline.base.covariance import PAIRS
from pipeline.base.errors import TableMismatch, listed
from pipeline.machine.robot import Robot

pd.set_option("mode.string_storage", "python")  # Arrow strings take twice the time

XYZ = ["x_m", "y_m", "z_m"]
"""Columns of a place."""


def column(
    name: str, kind: pa.DataType, unit: str, meaning: str, nullable: bool = False
) -> pa.Field:
    """One column of a schema."""
    return pa.field(name, kind, nullable, {"unit": unit, "meaning": meaning})


def number(name: str, unit: str, meaning: str) -> pa.Field:
    """A column of numbers."""
    return column(name, F64, unit, meaning)


def count(name: str, meaning: str, nullable: bool = False) -> pa.Field:
    """A column of whole numbers."""
    return column(name, _I32, "1", meaning, nullable)


def text(name: str, meaning: str, nullable: bool = False) -> pa.Field:
    """A column of text."""
    return column(name, STR, "1", meaning, nullable)


def word(name: str, meaning: str, nullable: bool = False) -> pa.Field:
    """Repetitive text, dictionary-encoded."""
    return column(name, _WORD, "1", meaning, nullable)


def axes(name: str, unit: str, meaning: str) -> list[pa.Field]:
    """Columns of a vector, one per axis, which replaces `{}` in the name."""
    return [number(name.format(axis), unit, meaning) for axis in "xyz"]


def six(name: str, unit: str, meaning: str) -> list[pa.Field]:
    """Columns of a covariance; `{}` in the name is a pair of axes, in the meaning the two axes."""
    return [number(name.format(pair), unit, meaning.format(*pair)) for pair in PAIRS]


def joint_values(robot: Robot, meaning: str) -> list[pa.Field]:
    """One column per joint in SI; `{}` in the meaning is its name."""
    return [
        number(
            joint_column(j.name, j.prismatic), "m" if j.prismatic else "rad", meaning.format(j.name)
        )
        for j in robot.joints
    ]


def promise(table: str, key: str, *columns: pa.Field) -> pa.Schema:
    """Schema of a table: its name, the columns that identify a row, and all columns."""
    return pa.schema(columns, metadata={"table": table, "key": key})


_I32, I64, F64, STR = pa.int32(), pa.int64(), pa.float64(), pa.string()
_WORD = pa.dictionary(_I32, STR)

_POSE = count("pose", "pose number of the campaign")
TARGET = text("target", "name of the reflector")
_FILE = text("file", "raw file, relative to the campaign folder")
_LINE = column("line", I64, "1", "line in that file, counted from 1")
_TIME = column("time", pa.timestamp("us"), "UTC or local, as exported", "time of reading", True)
PULL = (_POSE, count("repeat", "pull within the pose"))
SOURCE = (_FILE, _LINE)
ROW = (count("row", "row of the system"), *PULL, TARGET, text("axis", "x, y or z of F_b"))
"""Columns that identify a row of c = B x: one coordinate of one displacement."""

READINGS = promise(
    "readings",
    "file,line",
    _FILE.with_type(_WORD),
    _LINE,
    text("group", "group as the instrument named it"),
    TARGET.with_type(_WORD),
    count("pose", "pose number, null for base reflectors", nullable=True),
    count("repeat", "pull within the pose, null for base reflectors", nullable=True),
    word("state", "unloaded or loaded, null for base reflectors", nullable=True),
    *axes("{}_m", "m", "tracker frame"),
    *six("c{}_m2", "m^2", "covariance of {} and {}, NaN where the file has none"),
    word("covariance_from", "file | instrument | sheet | stated | paper | none"),
    _TIME,
)
"""Readings in the frame of the tracker, in the order of the files, with their covariance."""

LOADS = promise(
    "loads",
    "pose,repeat",
    *PULL,
    number("force_n", "N", "reading of the spring scale, NaN for weights and payloads"),
    number("unit_n", "N", "unit in which the log states it, NaN where it states none"),
    number("mass_kg", "kg", "weight at the load point, NaN for other loads"),
    number("mass_sigma_kg", "kg", "its standard uncertainty, 0 where none is stated"),
    word("payload", "name of the payload on the flange, null for other loads", nullable=True),
    word("branch", "up or down: which way the turnbuckle was last turned", nullable=True),
    *SOURCE,
)

REJECTED = promise(
    "rejected",
    "file,line,reason",
    _FILE,
    column("line", I64, "1", "line in that file, null for the whole file", nullable=True),
    text("reason", "why it was left out, and the way out"),
)

REGISTRATION = promise(
    "registration",
    "file,line",
    *SOURCE,
    text("group", "group of the reading"),
    TARGET,
    *axes("{}_m", "m", "reading moved into F_b"),
    *axes("d{}_m", "m", "reading minus nominal, F_b"),
    _TIME,
)
"""Readings of the base reflectors after registration, with their residuals."""

PLACED = promise(
    "placed",
    "file,line",
    *(field.with_nullable(field.name == "time") for field in READINGS),
    number("time_s", "s", "time after the first reading of the campaign, NaN when unknown"),
)
"""Readings of the poses transformed into F_b with their covariance; columns of `readings`, and
seconds."""

FORCES = promise(
    "forces",
    "pose,repeat",
    *PULL,
    *axes("f{}_n", "N", "force on the robot, F_b, Eqs. (10), (11), or a weight"),
    count("by", "0 pulled by a chain, 1 a weight at the load point, 2 a payload on the flange"),
    count("body", "number of the weight or payload, equal ones are one; -1 for pulls"),
    *axes("at_{}_m", "m", "where it acts, flange frame; NaN at the load point"),
    number("mass_std_n", "N", "standard uncertainty of the weight, one error for each body"),
    number("center_std_m", "m", "standard uncertainty per axis of its centre, likewise"),
    number("reading_std_n", "N", "standard uncertainty of the scale reading, along the force"),
    *six(
        "u{}",
        "1",
        "covariance of direction cosines {} and {}; per m^2 of the tracker's variance where no "
        "noise is stated",
    ),
    count("branch", "1 up, -1 down, 0 unknown"),
    number("time_s", "s", "mean time of the loaded targets after the first reading"),
)

DISPLACEMENTS = promise(
    "displacements",
    "pose,repeat,target",
    *PULL,
    TARGET,
    *axes("d{}_m", "m", "loaded minus unloaded, F_b"),
    *six(
        "loaded_c{}_m2",
        "m^2",
        "loaded reading: covariance of {} and {}, NaN where the file has none",
    ),
    *six(
        "zero_c{}_m2",
        "m^2",
        "zero of the pose: covariance of {} and {}, NaN where the file has none",
    ),
    *axes("zero_{}_m", "m", "unloaded position, F_b, NaN when only displacements are known"),
    count("zero_count", "unloaded readings in the zero, 0 when only displacements are known"),
    number("zero_time_s", "s", "mean time of the zero after the first reading"),
)
"""Displacements; all pulls of a pose share its zero, so their errors are correlated."""

ERRORS = promise(
    "errors",
    "error,row",
    count("error", "number of the independent unit error"),
    text("source", "where it comes from"),
    column("common", pa.bool_(), "1", "moves more than one pose"),
    count("row", "row of the system"),
    number("value_m", "m", "what one standard uncertainty of it does to c"),
)
"""Factors of the covariance of c: V = G G', with G[row, error] = value_m."""

RESIDUALS = promise(
    "residuals",
    "row",
    *ROW,
    number("residual_m", "m", "c - B x"),
    number("whitened", "1", "residual in standard deviations, uncorrelated within its pose"),
    number("left_out_m", "m", "pose left out of the estimate, NaN where it stays open"),
)

RELIABILITY = promise(
    "reliability",
    "source,reading,axis",
    word("source", "source of the error, as in `errors`; base: a reading of a base reflector"),
    text("reading", "group/target, or line of the load log; null for an error of no reading", True),
    _FILE.with_type(_WORD).with_nullable(True),
    _LINE.with_nullable(True),
    word("axis", "axis of F_b nearest to the error, null where it has no direction", True),
    number("r", "1", "redundancy: the part of the error that the residuals show, 0 to 1"),
    number("w", "1", "standardised residual, normal with variance 1; NaN where r is zero"),
    number(
        "smallest_visible", "see unit", "size that w shows in 80 % of the cases; infinite: none"
    ),
    text("unit", "of smallest_visible; 1: standard uncertainties"),
    number("moves_sigmas", "1", "what that size moves most, in its std; infinite: no limit"),
    text("moves_most", "what it moves most: a stiffness, or a target's deflection at test pose"),
)
"""Redundancy of the readings: one row for each column of G, then the base readings. The r of all
columns of G add up to rows minus parameters, those of the base readings, which have an adjustment
of their own, to their number times three minus six."""

ESTIMATE = promise(
    "estimate",
    "parameter",
    text("parameter", "name of the compliance or effect parameter"),
    text("unit", "its unit"),
    number("value", "see unit", "best estimate"),
    number("std", "see unit", "standard uncertainty"),
    column("identifiable", pa.bool_(), "1", "the poses determine it"),
)
PATH = promise(
    "path",
    "point",
    count("point", "place in the path, from 1"),
    count("pose", "number of the point in the file"),
    *axes("{}_m", "m", "load point without load, F_b"),
    *axes("f{}_n", "N", "force at the load point, F_b"),
    *axes("d{}_m", "m", "predicted deflection of the load point, F_b"),
    number("deflection_m", "m", "its length d"),
    number("std_m", "m", "its standard uncertainty u; infinite: a spring is not determined"),
    text("decision", "pass, fail or undecided by ISO 14253-1"),
)
"""Machining path of [tolerance], point by point."""


def joints(robot: Robot) -> pa.Schema:
    """Schema of the joint values of a robot: pose, r1_m, theta2_rad, ..., approach."""
    approach = count("approach", "1 or -1: how the carriage came along the rail, 0 unknown")
    return promise("joints", "pose", _POSE, *joint_values(robot, "joint {}"), approach, *SOURCE)


def joint_column(name: str, prismatic: bool) -> str:
    """Column of a joint in SI: `r1_m`, `theta2_rad`."""
    return f"{name}_m" if prismatic else f"{name}_rad"


def system(parameters: Sequence[Parameter]) -> pa.Schema:
    """Schema of c = B x: identification of the row, c_m, and one column of B per parameter."""
    return promise(
        "system",
        "row",
        *ROW,
        number("c_m", "m", "displacement, Eq. (20)"),
        *[
            number(f"B_{p.name}", f"m/({p.unit})", f"derivative by {p.name}, Eq. (19)")
            for p in parameters
        ],
    )


def covariance(parameters: Sequence[Parameter]) -> pa.Schema:
    """Schema of the covariance of the estimate: one row and one column per parameter."""
    return promise(
        "covariance",
        "parameter",
        text("parameter", "row"),
        *[number(p.name, f"unit of the row times {p.unit}", "covariance") for p in parameters],
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
    missing = [one for one in schema.names if one not in here]
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
