"""Read a log as columns in SI, found by title and unit, with the rows that were rejected."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.base import doors
from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings, sifted
from pipeline.base.errors import InputError, at, listed
from pipeline.readers._layout import Field, Kind, Layout, TypedRows
from pipeline.readers._plain_rows import is_plain, plain_rows
from pipeline.readers._text import Text, is_workbook, text
from pipeline.readers.export_settings import OWN_LOG, LogForm

_Rejection = tuple[str, int | None, str]
"""File, line and reason of a rejection."""

NUMBER_LIMIT = 2**31
"""Upper limit of pose and pull numbers [1]: tables hold them in 32 bits."""
_LARGEST = 1e7
"""Largest magnitude accepted for lengths, angles and forces [SI], however units were confused."""


class GroupState(NamedTuple):
    """State of a pose in which a group was read, and the line of the log that says so."""

    pose: int
    repeat: int
    loaded: bool
    line: int


@dataclass(frozen=True, eq=False)
class Log(Locked):
    """Rows of a log.

    Attributes:
        file: File name.
        number: Numeric columns in SI by name, each shape (n,); NaN where a cell is empty.
        word: Text columns by name, each shape (n,).
        line: Line number of each row, shape (n,).
        rejected: Rows that could not be read.
        states: State of each group of readings, by the group name used in the log.
        notes: What was taken to be meant, where cells were left empty.
        pose_of: Poses of rejected rows by their line, where they can be read.
    """

    file: str
    number: dict[str, Array]
    word: dict[str, Strings]
    line: Ints
    rejected: tuple[_Rejection, ...]
    states: dict[str, GroupState] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    pose_of: dict[int, float] = field(default_factory=dict)

    def only(self, good: Bools, reason: str) -> Log:
        """Keep the good rows; reject the others, all for the same reason."""
        return self.without(dict.fromkeys(np.flatnonzero(~good).tolist(), reason))

    def where(self, name: str, good: Callable[[Any], Bools], reason: str) -> Log:
        """Keep the rows whose cell in a column is good; all rows if there is no such column."""
        column = (self.number | self.word).get(name)
        return self if column is None else self.only(good(column), reason)

    def without(self, why: Mapping[int, str]) -> Log:
        """Reject some rows, each for its own reason."""
        if not why:
            return self
        good = np.ones(len(self.line), dtype=bool)
        good[list(why)] = False
        left_out = tuple((self.file, int(self.line[k]), why[k]) for k in sorted(why))
        pose = self.number.get("pose", np.full(len(self.line), np.nan))
        of = self.pose_of | {int(self.line[k]): float(pose[k]) for k in why}
        return replace(self.kept(good), rejected=self.rejected + left_out, pose_of=of)

    def kept(self, good: Bools) -> Log:
        """Keep some of the rows; the others are dropped without being reported."""
        number, word = sifted(self.number, good), sifted(self.word, good)
        return replace(self, number=number, word=word, line=self.line[good])


@dataclass(frozen=True)
class Quantity:
    """A column to look for.

    Attributes:
        stem: Its name without unit.
        units: Factor to SI by unit suffix; empty for a dimensionless number.
        kind: `number` or `name`.
        needed: Whether the table must have it.
        filled: Whether, in a table that must have it, every row must have a value.
        carried: Whether an empty cell may mean the value of the row above.
    """

    stem: str
    units: Mapping[str, float]
    kind: Kind = "number"
    needed: bool = True
    filled: bool = True
    carried: bool = False


@dataclass(frozen=True)
class Titled:
    """A log with its header.

    Attributes:
        text: The file, with runs of blanks squeezed to one if blanks separate its cells.
        line: Line number of the header.
        first: Line number of the first row.
        delimiter: Separator of the cells.
        titles: Our names of its columns in lower case; for unknown columns their titles.
        written: Its titles as written in the file, with the unit given below them or in the first
            row.
        behind: Unit after the numbers of each column; empty if there is none.
        above: Line and reason of rows above the header.
    """

    text: Text
    line: int
    first: int
    delimiter: str
    titles: tuple[str, ...]
    written: tuple[str, ...]
    behind: tuple[str, ...]
    above: tuple[tuple[int, str], ...]


_OPENED, _TYPED = "pipeline.dialects._log_form:opened", "pipeline.dialects._log_rows:typed"
"""Doors of the dialects: logs that are no plain tables."""


def table(name: str, data: bytes, wanted: Sequence[Quantity]) -> Log:
    """Read the wanted columns of a delimited table with a header, in SI.

    The header is found by the first wanted column.

    Raises:
        InputError: The table is empty, or a needed column or its unit is missing.
    """
    return typed(opened(name, data, OWN_LOG, None, wanted[0].stem), wanted, OWN_LOG, None)


def opened(
    name: str,
    data: bytes,
    stated: LogForm,
    where: str | None,
    key: str,
    holds: Callable[[Sequence[str]], bool] = bool,
) -> Titled:
    """Find the header of a log.

    It is the first line of a plain table with the column `key`; the dialects find that of others.

    Args:
        name: Name of the file, for messages.
        data: Its content.
        stated: Description of its columns in campaign.toml.
        where: Table of campaign.toml that holds it; None if there is none.
        key: A column that every log of this kind has.
        holds: Whether our names of all columns are those of this kind, to select a sheet.

    Raises:
        InputError: The file is empty or not text; a title in campaign.toml is not in the file, or a
            column occurs twice.
    """
    own = (stated.columns, stated.sheet, stated.decimal) == (OWN_LOG.columns, None, None)
    found = _plainly(name, data, key) if own and not is_workbook(data) else None
    return found or doors.opened(_OPENED)(name, data, stated, where, key, holds)


_TITLES = re.compile(r"[A-Za-z0-9_]+(,[A-Za-z0-9_]+)+")
_CLOCK = re.compile(r"t(ime.*|_.*)?|zeit.*")
_UNITS = re.compile(r"(^|,)[0-9.eE+-]+[A-Za-z]+(,|$)")
_NUMBERS = re.compile(r"(^|,)-?[0-9]*[.0-9][0-9]+(,|$)")
"""Titles of a plain table; one of times, which a recording of the controller has; a unit behind a
number; a number that no line of units has."""


def _plainly(name: str, data: bytes, key: str) -> Titled | None:
    """The header of a plain table; None if the file may be something else."""
    with at(name):
        file = text(name, data)
    if len(file) < 2 or not is_plain(file) or not _TITLES.fullmatch(file.line(1)):
        return None
    written, row = tuple(file.line(1).split(",")), file.line(2)
    titles = tuple(title.lower() for title in written)
    if len({*titles}) < len(titles) or key not in titles or not _of_numbers(row):
        return None
    if "pose" not in titles and any(map(_CLOCK.fullmatch, titles)):
        return None
    return Titled(file, 1, 2, ",", titles, written, ("",) * len(titles), ())


def _of_numbers(row: str) -> bool:
    """Whether a row has a number that no line of units has, and no unit behind one."""
    return bool(_NUMBERS.search(row)) and not _UNITS.search(row)


def typed(file: Titled, wanted: Sequence[Quantity], stated: LogForm, where: str | None) -> Log:
    """Read the wanted columns as in `table`, from a log whose header was found.

    Args:
        file: The log.
        wanted: Columns to look for.
        stated: Description of the log in campaign.toml.
        where: Table of campaign.toml that may hold it; None if there is none.
    """
    log = _of_plain(file, wanted) or doors.opened(_TYPED)(file, wanted, stated, where)
    return _possible(log, [q.stem for q in wanted if q.units])


def _of_plain(file: Titled, wanted: Sequence[Quantity]) -> Log | None:
    """The columns of a plain table; None unless all are there and every row is as it should be."""
    if file.above or file.delimiter != "," or not is_plain(file.text):
        return None
    try:
        there = [(q, *found) for q in wanted if (found := column(file.titles, q, None))]
    except InputError:
        return None
    read = plain_rows(file.text, Layout(_fields(file, there), file.delimiter, file.first))
    if read is None or not len(read.line):
        return None
    log = of_rows(file.text.name, read, there)
    return None if np.isnan([*log.number.values()]).all(axis=0).any() else log


def _fields(file: Titled, columns: Sequence[tuple[Quantity, str, float]]) -> tuple[Field, ...]:
    """Fields of all columns of a plain log, given the wanted ones as in `of_rows`."""
    fields = {
        title: Field(title, q.kind, (q.needed and q.filled) or q.carried) for q, title, _ in columns
    }
    return tuple(fields.get(title, Field(title, "any", False)) for title in file.titles)


def known_columns(stated: LogForm, where: str, quantities: Sequence[Quantity]) -> None:
    """Check that every column name assigned in campaign.toml is one of ours.

    Raises:
        InputError: One is not.
    """
    names = [name for q in quantities for name in names_of(q)]
    for title, ours in stated.columns.items():
        if ours.lower() not in {name.lower() for name in names}:
            raise InputError(
                f'[{where}.columns] calls "{title}" {ours}, which is no known column',
                f"did you mean {near[0]}?"
                if (near := get_close_matches(ours, names, 1))
                else f"there are {listed(names, most=40)}",
                file="campaign.toml",
                key=[where, "columns", title],
            )


def of_rows(file: str, read: TypedRows, columns: Sequence[tuple[Quantity, str, float]]) -> Log:
    """Convert a table to SI.

    Args:
        file: File name.
        read: Typed rows of the table.
        columns: Each quantity with the title of its column and the factor to SI.
    """
    number = {q.stem: read.floats(title) * si for q, title, si in columns if q.kind == "number"}
    words = {q.stem: read.columns[title] for q, title, _ in columns if q.kind == "name"}
    word = {k: w.cast(pa.string()).to_numpy(zero_copy_only=False) for k, w in words.items()}
    rejected = tuple((file, line, reason) for line, reason in read.rejected)
    return Log(file, number, word, read.line, rejected)


def _possible(log: Log, names: Sequence[str]) -> Log:
    """Keep only rows with values that an instrument can show."""
    for name in names:
        reason = f"{name} is larger than any instrument shows; correct or remove the row"
        log = log.where(name, lambda values: ~(np.abs(values) > _LARGEST), reason)
    return log


def names_of(q: Quantity) -> list[str]:
    """Accepted column names of a quantity."""
    return [f"{q.stem}_{unit}" for unit in q.units] or [q.stem]


def suffixed(titles: Sequence[str], q: Quantity) -> tuple[str, str | None] | None:
    """Column of a quantity and the unit in its name, such as `x_mm` and `mm`; None if absent."""
    of_unit = {f"{q.stem}_{unit}".lower(): unit for unit in q.units} | {q.stem.lower(): None}
    return next(((name, of_unit[name]) for name in titles if name in of_unit), None)


def column(titles: Sequence[str], q: Quantity, where: str | None) -> tuple[str, float] | None:
    """The column of a quantity and its factor to SI, or None if it is absent and not needed."""
    found = suffixed(titles, q)
    mapped = (
        f", or say what it is in [{where}.columns] of campaign.toml, as `pipeline inspect` proposes"
        if where
        else ""
    )
    if found is None and q.needed:
        raise InputError(
            f"there is no column {names_of(q)[0]} among {listed(titles)}",
            f"add it to the header and to every row{mapped}",
        )
    if found and q.units and found[1] is None:
        raise InputError(
            f"column {found[0]} does not say its unit",
            f"call it {' or '.join(names_of(q))}{mapped}",
        )
    return (found[0], q.units[found[1]] if found[1] else 1.0) if found else None


def whole_numbers(log: Log) -> Log:
    """Keep only rows whose pose and repeat are non-negative integers."""

    def whole(values: Array) -> Bools:
        return (values >= 0) & (values == np.round(values)) & (values < NUMBER_LIMIT)

    for name in ("pose", "repeat"):
        log = log.where(name, whole, f"{name} is not a whole number; correct or remove the row")
    return log


def once(log: Log, key: Sequence[str], still: float = 0.0) -> Log:
    """Remove duplicate keys: of equal rows one is kept, of contradicting ones none.

    Numbers that differ by no more than `still` [SI] are equal.
    """
    rows = {**log.number, **log.word}
    repeats = pd.DataFrame({name: rows[name] for name in key}).duplicated(keep=False)
    if not repeats.any():
        return log
    twice = pd.DataFrame(rows)[repeats]
    why: dict[int, str] = {}
    for _, same in twice.groupby(list(key), sort=False):
        number = same[[*log.number]].to_numpy(float)
        spread = np.nan_to_num(np.ptp(number, axis=0))
        alike = (np.isnan(number) == np.isnan(number[0])).all() and (spread <= still).all()
        agree = bool(alike) and all(same[name].nunique() == 1 for name in log.word)
        line = log.line[same.index]
        reason = (
            f"repeats line {line[0]}; remove it"
            if agree
            else f"lines {listed(map(str, line))} contradict each other; keep the right one"
        )
        why |= dict.fromkeys(same.index[agree:].tolist(), reason)
    return log.without(why)
