"""Read a log as columns in SI, found by title and unit, with the rows that were rejected."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings, sifted
from pipeline.base.errors import InputError, at, listed
from pipeline.readers._cells import cells_or_none
from pipeline.readers._delimited import rows
from pipeline.readers._layout import Field, Kind, Layout, TypedRows
from pipeline.readers._log_form import Titled, opened
from pipeline.readers.export_settings import OWN_LOG, LogForm
from pipeline.readers.pose_names import coded

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


def table(name: str, data: bytes, wanted: Sequence[Quantity]) -> Log:
    """Read the wanted columns of a delimited table with a header, in SI.

    The header is found by the first wanted column.

    Raises:
        InputError: The table is empty, or a needed column or its unit is missing.
    """
    return typed(opened(name, data, OWN_LOG, None, wanted[0].stem), wanted, OWN_LOG, None)


def typed(file: Titled, wanted: Sequence[Quantity], stated: LogForm, where: str | None) -> Log:
    """Read the wanted columns as in `table`, from a log whose header was found.

    Args:
        file: The log.
        wanted: Columns to look for.
        stated: Description of the log in campaign.toml.
        where: Table of campaign.toml that may hold it; None if there is none.
    """
    name, titles = file.text.name, file.titles
    with at(name):
        with at(line=file.line):
            there = [(q, *column) for q in wanted if (column := _column(titles, q, where))]
        fields = _fields(file, there)
        layout = Layout(fields, file.delimiter, file.first, stated.decimal, table=where)
        log = _without_remarks(_log(name, rows(file.text, layout), there), file, there)
        for q, title, _ in there:
            log = _carried_down(log, q.stem, titles.index(title), file) if q.carried else log
        early = tuple((name, line, reason) for line, reason in file.above)
        poses = [titles.index(title) for q, title, _ in there if q.stem == "pose"]
        log = replace(log, rejected=early + log.rejected, pose_of=_poses_of(log, file, poses))
        if not len(log.line) + len(log.rejected):
            raise InputError("there is no row in it, only a header", "export it again")
    return _possible(log, [q.stem for q in wanted if q.units])


_MOST_REJECTED = 1000
"""Maximum number of rejected rows whose poses are read [1]."""


def _poses_of(log: Log, file: Titled, places: Sequence[int]) -> dict[int, float]:
    """Poses of rejected rows by line, as in `Log.pose_of`; `places` is the index of their cell."""
    lines = [line for _, line, _ in log.rejected[:_MOST_REJECTED] if line]
    cells = {n: "".join(_cells_at(file, n)[at : at + 1]) for n in lines for at in places}
    found = {n: _NUMBERED.fullmatch(cell) for n, cell in cells.items()}
    codes = {n: coded(one["name"]) or float(one["number"]) for n, one in found.items() if one}
    return log.pose_of | codes


_NUMBERED = re.compile(r"(?:[^\W\d_]+[ _-]?)?(?P<name>(?P<number>[0-9]{1,9})[ _-]?[^\W\d_]*)")


def _fields(file: Titled, columns: Sequence[tuple[Quantity, str, float]]) -> tuple[Field, ...]:
    """Fields of all columns of a log, given the wanted ones as in `_log`."""
    behind = dict(zip(file.titles, file.behind, strict=True))
    known = {
        title: Field(
            title,
            q.kind,
            q.needed and q.filled and not q.carried,
            unit=behind[title],
            named=q.stem == "pose",
            units={unit: factor / si for unit, factor in q.units.items()},
        )
        for q, title, si in columns
    }
    other = {title: Field(title, "any" if title else "blank", False) for title in file.titles}
    return tuple((other | known)[title] for title in file.titles)


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


def _log(file: str, read: TypedRows, columns: Sequence[tuple[Quantity, str, float]]) -> Log:
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


def _cells_at(file: Titled, line: int) -> list[str]:
    return cells_or_none(file.text.line(line), file.delimiter) or []


_WORDS = re.compile(r"[^\W\d_]{3,}")


def _without_remarks(log: Log, file: Titled, columns: Sequence[tuple[Quantity, str, float]]) -> Log:
    """Drop lines that hold a remark alone, and note them: `- break -` is no row of data."""
    names = {file.titles.index(title) for q, title, _ in columns
             if q.kind == "name" and q.stem != "remark"}  # fmt: skip
    every = [*log.number.values()]
    empty = log.line[np.isnan(every).all(axis=0)].tolist() if every else []
    unread = sorted([*empty, *(line for _, line, _ in log.rejected if line)])
    found = {n: text for n in unread if (text := _remark(_cells_at(file, n), names))}
    if not found:
        return log
    notes = tuple(f"{log.file}, line {n}: {text}" for n, text in found.items())
    rejected = tuple(one for one in log.rejected if one[1] not in found)
    keep = ~np.isin(log.line, [*found])
    return replace(log.kept(keep), rejected=rejected, notes=(*log.notes, *notes))


def _remark(cells: Sequence[str], names: Container[int]) -> str:
    """The only filled cell of a line, if it consists of words; otherwise empty.

    A name in one of the columns of names is no remark.
    """
    content = [(k, cell) for k, cell in enumerate(cells) if cell]
    if len(content) != 1 or content[0][0] in names or content[0][1][0].isdigit():
        return ""
    return content[0][1] if _WORDS.search(content[0][1]) else ""


def _carried_down(log: Log, stem: str, at: int, file: Titled) -> Log:
    """Fill empty cells of a column with the value above, as forms for several rows are filled in.

    Only where nothing else can be meant: the rows number the pulls on; without such numbers, most
    values have rows below them, and the next value is the next number. No row in between that
    states a value was rejected.

    Args:
        log: The log; NaN in empty cells.
        stem: The column.
        at: Its index among the cells of a row.
        file: The log as text.
    """
    value = log.number[stem]
    empty, count = np.isnan(value), len(value)
    if not empty.any():
        return log
    source = np.maximum.accumulate(np.where(empty, -1, np.arange(count)))
    after = pd.Series(value).bfill().to_numpy()
    lost = [n for _, n, _ in log.rejected if n and "".join(_cells_at(file, n)[at : at + 1])]
    broken = np.array(
        [s < 0 or any(log.line[s] < n < here for n in lost)
         for s, here in zip(source, log.line, strict=True)]
    )  # fmt: skip
    repeat = log.number.get("repeat")
    if repeat is not None:
        on = np.r_[False, np.diff(repeat) == 1]
    else:
        on = (2 * empty.sum() >= count - empty.sum()) & ~(after - value[source] > 1)
    taken = empty & on & ~broken
    if taken.any():
        lines = listed([str(n) for n in log.line[taken]])
        note = f"{log.file}, lines {lines}: an empty {stem} is that of the row above"
        number = log.number | {stem: np.where(taken, value[source], value)}
        log = replace(log, number=number, notes=(*log.notes, note))
    why = f"has nothing in column {file.titles[at]}; fill it in or remove the row"
    return log.only(~empty | taken, why)


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


def _column(titles: Sequence[str], q: Quantity, where: str | None) -> tuple[str, float] | None:
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
    rows = pd.DataFrame({**log.number, **log.word})
    twice = rows[rows.duplicated(list(key), keep=False)]
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
