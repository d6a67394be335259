"""The shape of a reader: pure functions from the text of an export to readings in SI, and back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.errors import InputError
from pipeline.readers._cells import text_of
from pipeline.readers._coordinates import (
    Meaning,
    cartesian,
    covariance,
    raw,
    settled,
    settled_vertical,
)
from pipeline.readers._layout import Rows
from pipeline.readers._text import Text

EXPANDED, STANDARD, A_PRIORI, RMS = "expanded", "standard", "a-priori", "rms"
_PREFERRED = (A_PRIORI, STANDARD, EXPANDED)
"""Which covariance is used where a file has several. A-priori comes first: the scatter within one
reading (standard) leaves out what does not change during it, calibration and slow air, and rms
is a scatter too, of one number for three axes: it is used only when campaign.toml asks for it."""


_FARTHEST_M = 1e7
"""No tracker reads so far [m], whatever unit was mistaken for whatever other."""
_TOO_FAR = (
    f"the coordinates are farther than {_FARTHEST_M / 1e3:_.0f} km; ".replace("_", " ")
    + "measure it again or remove the row"
)
USUAL_FACTORS = {STANDARD: 1.0, EXPANDED: 2.0}
"""k of uncertainties where campaign.toml does not say; 2 is 95 % (GUM 6.3.3, Leica's U(95))."""


@dataclass(frozen=True)
class Columns:
    """[tracker.mapping]: columns of any delimited table, by header name or by number from 1.

    Attributes:
        columns: Name or number of the column by role: group, target, name, x, y, z, time,
            and sx, sy, sz, or cxx ... czz for uncertainties.
        delimiter: One character, or None to find it.
        header: Line of the header, 0 for none, or None to find it.
        comment: Start of lines that are no rows.
        time_format: A `strptime` form, or None for the forms we know.
    """

    columns: Mapping[str, str | int]
    delimiter: str | None = None
    header: int | None = None
    comment: str | None = None
    time_format: str | None = None


@dataclass(frozen=True)
class Hints:
    """What campaign.toml says in [tracker] about exports that do not say it themselves.

    Attributes:
        unit: `mm`, `m` or `in`.
        decimal: The decimal mark, `.` or `,`.
        coordinates: `cartesian`, `spherical` or `cylindrical`.
        angle: `deg`, `rad` or `gon`.
        vertical: `zenith` or `elevation`.
        coverage_factor: k of stated uncertainties.
        covariance: Which of several covariances to use, or `none`.
        names: Expression with the parts group and target, for names that hold both.
        mapping: Columns of a table in no dialect of its own.
    """

    unit: str | None = None
    decimal: str | None = None
    coordinates: str | None = None
    angle: str | None = None
    vertical: str | None = None
    coverage_factor: float | None = None
    covariance: str | None = None
    names: str | None = None
    mapping: Columns | None = None


@dataclass(frozen=True, eq=False)
class Export(Locked):
    """Readings of one file, in the frame of the export.

    Attributes:
        file: Name of the file.
        dialect: Name of the reader.
        encoding: What the file is written in.
        meaning: Unit and kind of coordinates in the file.
        group: Group of each reading, dictionary of strings, or None where the file has none.
        target: Target of each reading, dictionary of strings, or None where the file has none.
        position: Cartesian coordinates [m], shape (n, 3).
        covariance: xx, xy, xz, yy, yz, zz [m^2], shape (n, 6), or None where none is used.
        covariance_kind: `a-priori`, `standard`, `expanded` or `rms`; None without covariance.
        time: Time of each reading, timestamps without zone, null where unknown, length n.
        line: Line of each reading, counted from 1, shape (n,).
        order: Number of each reading among all rows of the file, from 1, shape (n,).
        rows: How many rows the file has, those left out included.
        unused: Columns that were not looked at.
        rejected: Line and reason of what was left out.
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


@dataclass(frozen=True, eq=False)
class Readings(Locked):
    """Readings to be written.

    Attributes:
        group: Group of each, n of them.
        target: Target of each, n of them.
        position: In the tracker's frame [m], shape (n, 3).
        time: Time of each, n of them.
        covariance: Six numbers [m^2] for dialects that carry one, shape (n, 6), or None.
    """

    group: Sequence[str]
    target: Sequence[str]
    position: Array
    time: Sequence[datetime]
    covariance: Array | None = None


_Write = Callable[[Readings, str, int | None], bytes]
"""Readings, unit of length, decimals (None: all that matter) -> content of a file."""


@dataclass(frozen=True)
class Reader:
    """One dialect.

    Attributes:
        name: What `inspect` calls it.
        recognise: Whether the first lines of a file are of this dialect.
        read: The readings of a file of this dialect.
        write: A file of this dialect.
        suffix: Usual ending of its files.
        says_unit: Whether its files state their unit; else campaign.toml must.
        says_names: Whether its files have groups and targets; else an assignment must.
        general: Whether any table with the usual titles fits, so that a dialect with a mark of
            its own comes first.
    """

    name: str
    recognise: Callable[[Sequence[str]], bool]
    read: Callable[[Text, Hints], Export]
    write: _Write | None = None
    suffix: str = ".csv"
    says_unit: bool = True
    says_names: bool = True
    general: bool = False


@dataclass(frozen=True, eq=False)
class Found(Locked):
    """What a dialect found in a file, to be turned into readings.

    Attributes:
        dialect: Its name.
        rows: The typed rows.
        meaning: Of the three numbers.
        axes: Names of the columns with the three numbers.
        group: Column with the group, or None.
        target: Column with the target, or None.
        covariance: Six numbers in the units of the file by kind, each shape (n, 6).
        keep: Rows to keep, shape (n,), or None for all.
        why_not: Why the others are not kept.
        unused: Columns that were not looked at.
    """

    dialect: str
    rows: Rows
    meaning: Meaning
    axes: tuple[str, str, str]
    group: str | None = None
    target: str | None = None
    covariance: Mapping[str, Array] = field(default_factory=dict)
    keep: Bools | None = None
    why_not: str = ""
    unused: tuple[str, ...] = ()


def export(text: Text, hints: Hints, found: Found) -> Export:
    """Readings in SI of what a dialect found."""
    rows = found.rows
    numbers = [np.asarray(rows.columns[axis]) for axis in found.axes]
    kind = _chosen(list(found.covariance), hints, text.name)
    C = covariance(found.covariance[kind], np.array(numbers).T, found.meaning) if kind else None
    n = len(rows.line)
    time = rows.columns.get("time", pa.nulls(n, pa.timestamp("us")))
    group, target = (rows.columns[name] if name else None for name in (found.group, found.target))
    everything = Export(
        file=text.name,
        dialect=found.dialect,
        encoding=text.encoding,
        meaning=found.meaning,
        group=group,
        target=target,
        position=cartesian(numbers, found.meaning),
        covariance=C,
        covariance_kind=kind,
        time=time,
        line=rows.line,
        order=rows.order,
        rows=n + len(rows.rejected),
        unused=found.unused,
        rejected=rows.rejected,
    )
    if found.keep is not None:
        everything = kept(everything, found.keep, found.why_not)
    columns = everything.position.T
    if all(x.min(initial=0) >= -_FARTHEST_M and x.max(initial=0) <= _FARTHEST_M for x in columns):
        return everything
    near = np.logical_and.reduce([np.abs(axis) <= _FARTHEST_M for axis in columns])
    return kept(everything, near, _TOO_FAR)


def kept(readings: Export, keep: Bools, why_not: str) -> Export:
    """The readings to keep; the others are rejected for one reason."""
    mask = pa.array(keep)
    group, target = (
        names if names is None else names.filter(mask)
        for names in (readings.group, readings.target)
    )
    left_out = tuple((int(line), why_not) for line in readings.line[~keep])
    return replace(
        readings,
        group=group,
        target=target,
        position=readings.position[keep],
        covariance=None if readings.covariance is None else readings.covariance[keep],
        time=readings.time.filter(mask),
        line=readings.line[keep],
        order=readings.order[keep],
        rejected=(*readings.rejected, *left_out),
    )


def _chosen(kinds: Sequence[str], hints: Hints, file: str) -> str | None:
    """Which of the covariances of a file is used.

    Raises:
        InputError: campaign.toml asks for one that the file does not have.
    """
    if hints.covariance == "none":
        return None
    if hints.covariance is None:
        return next((kind for kind in _PREFERRED if kind in kinds), None)
    if kinds and hints.covariance not in kinds:
        raise InputError(
            f"the export has no {hints.covariance} covariance, only {', '.join(kinds)}",
            "correct covariance in [tracker] of campaign.toml",
            file=file,
        )
    return hints.covariance if kinds else None


def settled_unit(stated: str | None, hints: Hints, file: str, line: int | None = None) -> str:
    """The unit of length of an export: what it says itself, else what campaign.toml says.

    Raises:
        InputError: Nobody says, or the two contradict each other.
    """
    return settled(stated, hints.unit, "unit of length", 'unit = "mm" (or "m", "in")', file, line)


def settled_angles(
    meaning: Meaning,
    stated: tuple[str | None, str | None],
    third: Array,
    hints: Hints,
    file: str,
    line: int | None,
) -> Meaning:
    """The same with unit and zero of angles, where coordinates of its kind have some.

    Args:
        meaning: Unit and kind of coordinates.
        stated: Unit of angles and zero of the vertical one by the export, None where it does not.
        third: The third column of numbers, which may say where vertical angles begin.
        hints: What campaign.toml says.

    Raises:
        InputError: Nobody says, or the two contradict each other.
    """
    if meaning.kind == "cartesian":
        return meaning
    example = 'angle = "deg" (or "rad", "gon")'
    angle = settled(stated[0], hints.angle, "unit of angles", example, file, line)
    if meaning.kind == "cylindrical":
        return replace(meaning, angle=angle)
    vertical = settled_vertical(stated[1], hints.vertical, third, angle, file, line)
    return replace(meaning, angle=angle, vertical=vertical)


def written(
    readings: Readings, unit: str, digits: int | None
) -> Iterator[tuple[str, str, list[str], datetime]]:
    """Group, target, Cartesian coordinates as text and time of each reading, for the writers."""
    numbers = text_of(raw(readings.position, Meaning(unit)), digits)
    return zip(readings.group, readings.target, numbers, readings.time, strict=True)


def diagonal(std: Sequence[Array], factor: float = 1.0) -> Array:
    """Six numbers of uncorrelated standard uncertainties, each shape (n,), divided by a factor."""
    x, y, z = ((s / factor) ** 2 for s in std)
    none = np.zeros_like(x)
    return np.column_stack([x, none, none, y, none, z])
