"""The logs beside the tracker exports: scale, joints, and tables of already reduced campaigns.

All are delimited tables with a header whose column names carry the units.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings
from pipeline.base.errors import InputError, listed
from pipeline.machine.robot import Robot
from pipeline.readers import _header
from pipeline.readers._delimited import rows
from pipeline.readers._layout import Field, Kind, Layout
from pipeline.readers._text import text

_Rejection = tuple[str, int | None, str]
"""File, line and reason of what was left out."""

FORCE = {"n": 1.0, "kn": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605}
_LENGTH = {"m": 1.0, "mm": 1e-3}
_ANGLE = {"deg": np.pi / 180.0, "rad": 1.0}
_LARGEST = 1e8
"""Of lengths, angles and forces [SI], whatever unit was mistaken for whatever other."""
_BRANCHES = ("up", "down")


@dataclass(frozen=True, eq=False)
class Log(Locked):
    """Rows of a log.

    Attributes:
        file: Its name.
        number: Numeric columns in SI by name, each shape (n,); NaN where a cell is empty.
        word: Columns of words by name, each shape (n,).
        line: Line of each row, shape (n,).
        rejected: What could not be read.
    """

    file: str
    number: dict[str, Array]
    word: dict[str, Strings]
    line: Ints
    rejected: tuple[_Rejection, ...]

    def only(self, good: Bools, reason: str | Sequence[str]) -> Log:
        """The rows that are good; the others are rejected, for one reason or each for its own."""
        if good.all():
            return self
        bad = np.flatnonzero(~good).tolist()
        reasons = [reason] * len(good) if isinstance(reason, str) else reason
        left_out = tuple((self.file, int(self.line[k]), reasons[k]) for k in bad)
        return Log(
            self.file,
            {name: values[good] for name, values in self.number.items()},
            {name: values[good] for name, values in self.word.items()},
            self.line[good],
            self.rejected + left_out,
        )


@dataclass(frozen=True)
class Quantity:
    """A column to look for.

    Attributes:
        stem: Its name without unit.
        units: Factor to SI by unit suffix; empty for a number without unit.
        kind: `number` or `name`.
        needed: Whether the table must have it.
    """

    stem: str
    units: Mapping[str, float]
    kind: Kind = "number"
    needed: bool = True


POSE = Quantity("pose", {})
_REPEAT = Quantity("repeat", {})


def loads(name: str, data: bytes) -> Log:
    """Readings of the spring scale: pose, repeat, force [N] and, where known, branch.

    Raises:
        InputError: The file cannot be read or trusted as a whole.
    """
    branch = Quantity("branch", {}, "name", needed=False)
    log = _whole_numbers(table(name, data, [POSE, _REPEAT, Quantity("force", FORCE), branch]))
    log = log.only(
        log.number["force"] > 0, "the force is not above zero; correct or remove the row"
    )
    if "branch" in log.word:
        known = np.isin(log.word["branch"], [*_BRANCHES, ""])
        log = log.only(known, "branch is neither up nor down; correct it or leave it empty")
    return once(log, ["pose", "repeat"])


def joints(name: str, data: bytes, robot: Robot) -> tuple[Log, Array]:
    """The controller's joint log, by the names of the robot's joints or of its controller's axes.

    Returns:
        The log with its poses, and the joint values [m] or [rad], shape (n, joints).

    Raises:
        InputError: A joint is missing; the file cannot be read.
    """
    approach = Quantity("approach", {}, needed=False)
    header = set(columns(name, data))
    own = [Quantity(j.name, _LENGTH if j.prismatic else _ANGLE) for j in robot.joints]
    axes = [Quantity(axis, _LENGTH if slides else _ANGLE) for axis, slides in _controller(robot)]
    from_controller = bool(axes) and not _has(header, own) and _has(header, axes)
    wanted = axes if from_controller else own
    log = _whole_numbers(table(name, data, [POSE, *wanted, approach]))
    if "approach" in log.number:
        known = np.isin(log.number["approach"], [1, -1, 0]) | np.isnan(log.number["approach"])
        log = log.only(known, "approach is neither 1 nor -1; correct it or leave it empty")
    log = once(log, ["pose"])
    q = np.column_stack([log.number[quantity.stem] for quantity in wanted])
    if from_controller:
        q = q @ robot.controller_matrix.T + robot.controller_offset
    return log, q


def _controller(robot: Robot) -> list[tuple[str, bool]]:
    """The controller's axes, and whether each slides."""
    slides = robot.prismatic.astype(float) @ np.abs(robot.controller_matrix) > 0
    return list(zip(robot.controller, (bool(s) for s in slides), strict=True))


def _has(header: set[str], wanted: Sequence[Quantity]) -> bool:
    return all(_header.suffixed(sorted(header), q.stem, list(q.units)) for q in wanted)


def within_limits(log: Log, q: Array, robot: Robot) -> None:
    """Joint values [m] or [rad], shape (n, joints), lie within the robot's limits.

    Raises:
        InputError: One of them does not.
    """
    slack = 1e-9
    outside = (q < robot.lower - slack) | (q > robot.upper + slack)
    if not outside.any():
        return
    row, j = (int(k) for k in np.argwhere(outside)[0])
    joint, value = robot.joints[j], q[row, j]
    unit, scale = ("m", 1.0) if joint.prismatic else ("deg", 180.0 / np.pi)
    raise InputError(
        f"joint {joint.name} is at {value * scale:.6g} {unit}, outside its limits "
        f"{joint.lower * scale:.6g} to {joint.upper * scale:.6g} {unit}",
        "correct the value or the unit in the column name, or the limits in the robot file",
        file=log.file,
        line=int(log.line[row]),
    )


def displacements(name: str, data: bytes) -> Log:
    """Displacements of an already reduced campaign: pose, repeat, target, dx, dy, dz [m]."""
    target = Quantity("target", {}, "name")
    axes = [Quantity(axis, _LENGTH) for axis in ("dx", "dy", "dz")]
    return once(
        _whole_numbers(table(name, data, [POSE, _REPEAT, target, *axes])),
        ["pose", "repeat", "target"],
    )


def forces(name: str, data: bytes) -> Log:
    """Forces of an already reduced campaign: pose, repeat, fx, fy, fz [N] in the base frame."""
    axes = [Quantity(axis, FORCE) for axis in ("fx", "fy", "fz")]
    return once(_whole_numbers(table(name, data, [POSE, _REPEAT, *axes])), ["pose", "repeat"])


def table(name: str, data: bytes, wanted: Sequence[Quantity]) -> Log:
    """The wanted columns of a delimited table with a header, in SI.

    Raises:
        InputError: Empty, a needed column is missing, or it has no unit.
    """
    file = text(name, data)
    first, header = next((n, line) for n, line in file.lines() if line.strip())
    delimiter = _header.delimiter_of(header)
    found = _header.names(header, delimiter)
    _header.unique(found, name, first)
    where = {q.stem: _column(found, q, name, first) for q in wanted}
    kinds = {column[0]: (q.kind, q.needed) for q in wanted if (column := where[q.stem])}
    fields = tuple(
        Field(column, *kinds[column])
        if column in kinds
        else Field(column, "any" if column else "blank", False)
        for column in found
    )
    read = rows(file, Layout(fields, delimiter, first + 1))
    number, word = {}, {}
    for q in wanted:
        column = where[q.stem]
        if column and q.kind == "number":
            values = _floats(read.columns[column[0]])
            number[q.stem] = values * q.units[column[1]] if column[1] else values
        elif column:
            names = read.columns[column[0]].cast(pa.string())
            word[q.stem] = names.to_numpy(zero_copy_only=False)
    rejected = tuple((name, line, reason) for line, reason in read.rejected)
    log = Log(name, number, word, read.line, rejected)
    for q in wanted:
        if q.units and q.stem in number:
            possible = ~(np.abs(log.number[q.stem]) > _LARGEST)
            reason = f"{q.stem} is larger than any instrument shows; correct or remove the row"
            log = log.only(possible, reason)
    return log


def _floats(column: pa.Array) -> Array:
    return np.array(column.cast(pa.float64()).fill_null(np.nan), dtype=float)


def columns(name: str, data: bytes) -> list[str]:
    """Names of the columns in the header of a delimited table."""
    header = next(line for _, line in text(name, data).lines() if line.strip())
    return _header.names(header, _header.delimiter_of(header))


def _column(
    found: Sequence[str], q: Quantity, file: str, line: int
) -> tuple[str, str | None] | None:
    column = _header.suffixed(found, q.stem, list(q.units)) if q.units else None
    if column is None and not q.units and q.stem in found:
        column = q.stem, None
    if column is None and q.needed:
        example = f"{q.stem}_{next(iter(q.units))}" if q.units else q.stem
        raise InputError(
            f"there is no column {example} among {listed(found)}",
            "add it to the header and to every row",
            file=file,
            line=line,
        )
    if column and q.units and column[1] is None:
        raise InputError(
            f"column {column[0]} does not say its unit",
            f"call it {listed(f'{q.stem}_{unit}' for unit in q.units)}".replace(", ", " or "),
            file=file,
            line=line,
        )
    return column


def _whole_numbers(log: Log) -> Log:
    """Only rows whose pose and repeat are whole numbers, not negative."""
    for name in ("pose", "repeat"):
        if name in log.number:
            values = log.number[name]
            whole = (values >= 0) & (values == np.round(values)) & (values < 2**31)
            log = log.only(whole, f"{name} is not a whole number; correct or remove the row")
    return log


def once(log: Log, key: Sequence[str]) -> Log:
    """Rows whose key comes once: equal ones are kept once, contradicting ones not at all."""
    columns = {**log.number, **log.word}
    twice = repeated([np.asarray(columns[name]) for name in key])
    rows_of: dict[tuple[object, ...], list[int]] = {}
    for k in np.flatnonzero(twice).tolist():
        rows_of.setdefault(tuple(columns[name][k] for name in key), []).append(k)
    good = np.ones(len(log.line), dtype=bool)
    reasons = [""] * len(log.line)
    for first, *more in rows_of.values():
        same = [first, *more]
        content = [[str(values[k]) for values in columns.values()] for k in same]
        agree = all(row == content[0] for row in content)
        lines = listed(str(log.line[k]) for k in same)
        for k in more if agree else same:
            good[k] = False
            reasons[k] = (
                f"repeats line {log.line[first]}; remove it"
                if agree
                else f"lines {lines} contradict each other; keep the right one"
            )
    return log.only(good, reasons)


def _coded(column: Any) -> Ints:
    """A number for every different value, shape (n,)."""
    codes = pa.array(column).dictionary_encode().indices
    return np.asarray(codes.fill_null(-1), dtype=np.int64) + 1


def repeated(columns: Sequence[Any]) -> Bools:
    """Rows that are there more than once, shape (n,)."""
    label = np.zeros(len(columns[0]), dtype=np.int64)
    for column in columns:
        numbers = _coded(column)
        label = _coded(label * (numbers.max(initial=0) + 1) + numbers)
    return np.asarray(np.bincount(label, minlength=1)[label] > 1) if len(label) else label > 0
