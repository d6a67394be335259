"""Interface of a reader: pure functions from the text of an export to readings in SI, and back."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from posixpath import basename, splitext
from posixpath import split as parted

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.base import patterns
from pipeline.base.arrays import Array, Bools, Ints, Locked, sifted
from pipeline.readers._layout import JOINT, TypedRows
from pipeline.readers._text import Text
from pipeline.readers._units import in_unit
from pipeline.readers.export_settings import ExportSettings, GroupNames

TABLE = "table"
"""Name that `inspect` gives to a file of no known dialect."""
_FARTHEST_M = 1e6
"""Largest coordinate accepted [m]: no tracker reaches this far, however units were confused."""
_STATISTICS = {
    "mean", "mean value", "average", "avg", "median", "min", "max", "minimum", "maximum", "range",
    "count", "rms", "centroid", "std", "std dev", "stddev", "std deviation", "standard deviation",
    "st dev", "stdev", "sigma", "sum", "mittelwert", "mittel", "standardabweichung", "stabw",
    "spannweite", "anzahl", "schwerpunkt", "summe", "moyenne", "écart type", "media",
}  # fmt: skip
"""Names that programs give to statistics written below or above the points of a table."""
_STATISTIC = "its name is that of a statistic, and no target; rename it if it is one"
_NINES = re.compile(r"999+(\.9+)?")
"""Numbers that programs write for a missing value."""
_NOTHING = (
    "its three numbers are those that stand for no reading; measure it again or remove the row"
)
_TOO_FAR = (
    f"the coordinates are farther than {_FARTHEST_M / 1e3:_.0f} km; ".replace("_", " ")
    + "measure it again or remove the row"
)


@dataclass(frozen=True)
class Meaning:
    """How the three numbers of a reading are to be interpreted.

    Attributes:
        unit: Unit of length, `mm`, `m`, `in`, `um`, `cm`, `ft` or `ftUS`.
        kind: `cartesian` x, y, z; `spherical` range, azimuth, vertical angle; `cylindrical` radius,
            azimuth, z.
        angle: Unit of angles, `deg`, `rad`, `gon` or `dms`; None for Cartesian coordinates.
        vertical: Vertical angle from `zenith` (z up is 0) or as `elevation` (horizontal is 0).
        horizontal: Sense of positive azimuths, `counter-clockwise`, from x towards y, or
            `clockwise`.
    """

    unit: str
    kind: str = "cartesian"
    angle: str | None = None
    vertical: str = "zenith"
    horizontal: str = "counter-clockwise"


@dataclass(frozen=True)
class Faces:
    """Summary of readings in two faces of an instrument.

    Attributes:
        pairs: Number of targets read in both faces, each now averaged to one reading.
        largest_m: Largest distance between the two readings of a pair [m].
        single: Number of readings in the second face without one in the first.
    """

    pairs: int
    largest_m: float
    single: int


@dataclass(frozen=True, eq=False)
class Export(Locked):
    """Readings of one file, in the frame of the export.

    Attributes:
        file: File name.
        dialect: Name of the reader.
        encoding: Character encoding of the file.
        meaning: Unit and kind of coordinates in the file.
        group: Group of each reading, dictionary of strings, or None if the file has none.
        target: Target of each reading, dictionary of strings, or None if the file has none.
        position: Cartesian coordinates [m], shape (n, 3).
        covariance: xx, xy, xz, yy, yz, zz [m^2], shape (n, 6), or None if none is used.
        covariance_kind: `a-priori`, `standard`, `expanded` or `rms`; None without covariance.
        time: Time of each reading, timestamps without time zone, null if unknown, length n.
        line: Line number of each reading, counted from 1, shape (n,).
        order: Number of each reading among all rows of the file, from 1, shape (n,).
        rows: Number of rows in the file, including rejected ones.
        unused: Columns that were not read.
        rejected: Line and reason of rejected rows.
        faces: Summary of polar readings in two faces, which are averaged; None if there is one
            face.
        untimed: A column that should hold times but does not, None if there is none.
        settled: Sentences on what the file leaves open and campaign.toml settles.
    """

    file: str
    dialect: str
    encoding: str
    meaning: Meaning
    group: pa.DictionaryArray | None
    target: pa.DictionaryArray | None
    position: Array
    covariance: Array | None
    covariance_kind: str | None
    time: pa.TimestampArray
    line: Ints
    order: Ints
    rows: int
    unused: tuple[str, ...]
    rejected: tuple[tuple[int, str], ...]
    faces: Faces | None = None
    untimed: str | None = None
    settled: tuple[str, ...] = ()


OF_EACH = ("group", "target", "position", "covariance", "time", "line", "order")
"""Attributes of an `Export` with one row for each reading."""


@dataclass(frozen=True, eq=False)
class OutgoingReadings(Locked):
    """Readings to be written.

    Attributes:
        group: Group of each reading, length n.
        target: Target of each reading, length n.
        position: Coordinates in the tracker's frame [m], shape (n, 3).
        time: Time of each reading, length n.
        covariance: Six numbers [m^2] for dialects that carry them, shape (n, 6), or None.
    """

    group: Sequence[str]
    target: Sequence[str]
    position: Array
    time: Sequence[datetime]
    covariance: Array | None = None


_Write = Callable[[OutgoingReadings, str, int | None], bytes]
"""Function of readings, unit of length and number of decimals (None: all significant digits) that
returns the content of a file."""


@dataclass(frozen=True)
class Reader:
    """One dialect.

    Attributes:
        name: Name shown by `inspect`.
        recognise: Whether the first lines of a file are of this dialect.
        read: Reads a file of this dialect.
        write: Writes a file of this dialect, or None.
        suffix: Usual extension of its files.
        says_unit: Whether its files state their unit; otherwise campaign.toml must.
        says_names: Whether its files have groups and targets; otherwise an assignment must.
        general: Whether it accepts any table with the usual titles, so that a dialect with a
            distinctive mark takes precedence.
    """

    name: str
    recognise: Callable[[Sequence[str]], bool]
    read: Callable[[Text, ExportSettings], Export]
    write: _Write | None = None
    suffix: str = ".csv"
    says_unit: bool = True
    says_names: bool = True
    general: bool = False


def export(
    text: Text,
    dialect: str,
    rows: TypedRows,
    meaning: Meaning,
    position: Array,
    unused: Sequence[str] = (),
) -> Export:
    """All readings that a dialect found in a file, in SI.

    Args:
        text: The file.
        dialect: Name of the dialect.
        rows: The typed rows, with those of the columns `group`, `target` (or `reflector`) and
            `time` that the file has.
        meaning: Interpretation of the three numbers.
        position: Cartesian coordinates [m], shape (n, 3).
        unused: Columns that were not read.
    """
    columns, n = rows.columns, len(rows.line)
    return Export(
        file=text.name,
        dialect=dialect,
        encoding=text.encoding,
        meaning=meaning,
        group=columns.get("group"),
        target=columns.get("target", columns.get("reflector")),
        position=position,
        covariance=None,
        covariance_kind=None,
        time=columns.get("time", pa.nulls(n, pa.timestamp("us"))),
        line=rows.line,
        order=rows.order,
        rows=n + len(rows.rejected),
        unused=tuple(unused),
        rejected=rows.rejected,
    )


def of_targets(readings: Export, numbers: Sequence[Array]) -> Export:
    """Reject statistics and placeholders for missing readings.

    Args:
        readings: All readings of a file.
        numbers: Their three numbers in the units of the file, three arrays of shape (n,).
    """
    statistic = _statistics(readings.target)
    if statistic.any():
        readings = kept(readings, ~statistic, _STATISTIC)
        numbers = [column[~statistic] for column in numbers]
    nothing = _nothing(numbers)
    return kept(readings, ~nothing, _NOTHING) if nothing.any() else readings


def _statistics(target: pa.DictionaryArray | None) -> Bools:
    """Rows whose target is named after a statistic such as a mean or a deviation, shape (n,)."""
    if target is None:
        return np.zeros(1, dtype=bool)
    words = (re.findall(r"[^\W_]+", str(name).lower()) for name in target.dictionary.to_pylist())
    found = np.array([" ".join(word) in _STATISTICS for word in words], dtype=bool)
    return np.asarray(found[np.asarray(target.indices)])


def _nothing(numbers: Sequence[Array]) -> Bools:
    """Rows with one number such as -9999 three times, which means no reading, shape (n,).

    0, 0, 0 may be a valid place; if not, the other readings of the campaign reveal it.
    """
    x, y, z = numbers
    alike = (x == y) & (y == z)
    nines = [v for v in np.unique(np.abs(x[alike])) if _NINES.fullmatch(f"{v:.12g}")]
    return np.asarray(alike & np.isin(np.abs(x), nines))


def in_a_hall(readings: Export) -> Export:
    """Reject readings farther away than anything in a factory hall."""
    near: Bools = np.asarray((np.abs(readings.position) <= _FARTHEST_M).all(axis=1))
    return readings if near.all() else kept(readings, near, _TOO_FAR)


def kept(readings: Export, keep: Bools, why_not: str) -> Export:
    """Keep some readings; reject the others, all for the same reason."""
    of_each = sifted({name: getattr(readings, name) for name in OF_EACH}, keep)
    left_out = tuple((int(line), why_not) for line in readings.line[~keep])
    return replace(readings, **of_each, rejected=(*readings.rejected, *left_out))


def written(
    readings: OutgoingReadings, unit: str, digits: int | None
) -> Iterator[tuple[str, str, list[str], datetime]]:
    """Iterate over group, target, Cartesian coordinates as text, and time, for the writers."""
    numbers = text_of(in_unit(readings.position, unit), digits)
    return zip(readings.group, readings.target, numbers, readings.time, strict=True)


def text_of(values: Array, digits: int | None) -> list[list[str]]:
    """Format numbers row by row, with `digits` decimals, or (None) with all significant digits."""
    if digits is None:
        return [[repr(value) for value in row] for row in values.tolist()]
    return [[f"{value:.{digits}f}" for value in row] for row in values.tolist()]


_JOINED = r"(?:.+?::)?(?P<group>[^:]+(?::[^:]+)*)::(?P<target>[^:]+(?::[^:]+)*)"
"""Names as SpatialAnalyzer writes them; a collection in front is ignored."""


def split(export: Export, pattern: str | None) -> Export:
    """Split the group off the target names of an export that has no other groups.

    Args:
        export: Readings with targets but without groups; others are returned unchanged.
        pattern: Regular expression with the parts group and target, None for `Group::Target`.
    """
    if export.group is not None or export.target is None:
        return export
    found = patterns.parts(export.target.dictionary, pattern or _JOINED)
    matched = np.asarray(found.is_valid())
    if not matched.any() or (pattern is None and not matched.all()):
        return export
    at = export.target.indices
    group, target = (part(found, name).take(at) for name in ("group", "target"))
    split_up = replace(export, group=group.dictionary_encode(), target=target.dictionary_encode())
    fits = matched[np.asarray(at)]
    return kept(
        split_up,
        fits,
        "the name has no group and target by names in [tracker]; correct the name or names",
    )


def named_by_file(export: Export, by: GroupNames) -> Export:
    """Name the groups of an export by its file without suffix, as far as the statement asks for it.

    Args:
        export: Readings; those that have groups keep them, with the file before them if stated.
        by: What names groups.
    """
    joined = by == "files::groups"
    if export.target is None or (export.group is not None) != joined:
        return export
    folder, file = parted(splitext(export.file)[0])
    if export.group is not None:
        names = [f"{file}{JOINT}{one}" for one in export.group.dictionary.to_pylist()]
        group = pa.DictionaryArray.from_arrays(export.group.indices, names)
    else:
        every = np.zeros(len(export.line), dtype=np.int32)
        name = f"{basename(folder)}/{file}" if by == "folders/files" else file
        group = pa.DictionaryArray.from_arrays(every, [name])
    return replace(export, group=group)


def part(found: pa.StructArray, name: str) -> pa.StringArray:
    """One part of the names matched by an expression, empty where it does not match."""
    return pc.fill_null(pc.struct_field(found, name), "")
