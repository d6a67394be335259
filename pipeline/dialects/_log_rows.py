"""Rows of a log that is no plain table: what is wrong with them, or what an empty cell means."""

from __future__ import annotations

import re
from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from pipeline.base.errors import InputError, at, listed
from pipeline.dialects._cells import cells_or_none
from pipeline.dialects._delimited import rows
from pipeline.readers._layout import Field, Layout
from pipeline.readers._log_table import Log, Quantity, Titled, column, of_rows
from pipeline.readers.export_settings import LogForm
from pipeline.readers.pose_names import coded


def typed(file: Titled, wanted: Sequence[Quantity], stated: LogForm, where: str | None) -> Log:
    """Read the wanted columns as `readers._log_table.typed` does, whatever the rows are.

    Args:
        file: The log.
        wanted: Columns to look for.
        stated: Description of the log in campaign.toml.
        where: Table of campaign.toml that may hold it; None if there is none.
    """
    name, titles = file.text.name, file.titles
    with at(name):
        with at(line=file.line):
            there = [(q, *found) for q in wanted if (found := column(titles, q, where))]
        fields = _fields(file, there)
        layout = Layout(fields, file.delimiter, file.first, stated.decimal, table=where)
        log = _without_remarks(of_rows(name, rows(file.text, layout), there), file, there)
        for q, title, _ in there:
            log = _carried_down(log, q.stem, titles.index(title), file) if q.carried else log
        early = tuple((name, line, reason) for line, reason in file.above)
        poses = [titles.index(title) for q, title, _ in there if q.stem == "pose"]
        log = replace(log, rejected=early + log.rejected, pose_of=_poses_of(log, file, poses))
        if not len(log.line) + len(log.rejected):
            raise InputError("there is no row in it, only a header", "export it again")
    return log


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
