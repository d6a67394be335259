"""Entries of [scale] and [joints] for a foreign log: our names for its titles."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial

import pyarrow as pa
from pydantic import ValidationError

from pipeline.base.errors import InputError, at
from pipeline.dialects._cells import cells_or_none, is_number
from pipeline.dialects._delimited import rows
from pipeline.dialects._log_form import LogHeader, as_text, headers, opened
from pipeline.intake import _log_words
from pipeline.machine.robot import Robot
from pipeline.readers._layout import Field, Layout
from pipeline.readers._log_table import Quantity, Titled, names_of
from pipeline.readers._text import Text, refuse_other_programs
from pipeline.readers.export_settings import LogForm
from pipeline.readers.logs import (
    ANGLE,
    LENGTH,
    MASS,
    POSE,
    POSE_REPEAT,
    PULSES,
    REPEAT,
    SCALE,
    controller_axes,
    has_load,
    loads,
    of_loads,
    own_joints,
)

_HEADING = 1000
"""Number of bytes that may name the instrument of a log."""
_UNITS = {"force": tuple(SCALE), "mass": tuple(MASS)}
_Meaning = Callable[[Sequence[str], _log_words.SampledCells], dict[str, str] | None]


def _understood(name: str, data: bytes, table: str, meaning: _Meaning) -> LogForm | None:
    """Entries of [scale] or [joints] for a log by its titles, None if they mean nothing.

    Args:
        name: Name of the file, for messages.
        data: Its content.
        table: `scale` or `joints`.
        meaning: From the titles of a line and the cells below them: our names; None if it is not a
            header of such a log.
    """

    def meant(file: Text) -> dict[str, str] | None:
        found = (meaning(one.written, cache(partial(_below, file, one))) for one in headers(file))
        return next((columns for columns in found if columns is not None), None)

    with at(name):
        refuse_other_programs(name, data)
        columns = meant(as_text(name, data, None, None, table, lambda one: meant(one) is not None))
    try:
        return None if columns is None else LogForm(columns=columns)
    except ValidationError:  # titles of letters that cannot be seen: of another encoding
        return None


def _below(file: Text, head: LogHeader) -> dict[str, list[str]]:
    """The cells of each column by its title, of the rows that have one cell per title."""
    cut = str.split if head.delimiter == " " else partial(_cells, delimiter=head.delimiter)
    rows = [row for _, line in file.lines(head.first) if len(row := cut(line)) == len(head.written)]
    return dict(zip(head.written, map(list, zip(*rows, strict=True)), strict=False))


def _cells(line: str, delimiter: str) -> list[str]:
    return cells_or_none(line, delimiter) or []


def may_be_log(name: str, data: bytes) -> bool:
    """Whether a file has a line with titles of a log; one pass over all sheets.

    Raises:
        InputError: It is not text, or several sheets have one.
    """

    def log(titles: Sequence[str], cells: _log_words.SampledCells) -> dict[str, str] | None:
        return {} if _log_words.may_be_log(titles, cells, tuple(SCALE)) else None

    return _understood(name, data, "scale", log) is not None


def titles_of_axes(name: str, data: bytes) -> list[str]:
    """The titles of more axes than a point has coordinates in a file; empty if it has not."""
    with contextlib.suppress(InputError):  # a workbook in which no sheet has such titles
        meant = _understood(name, data, "joints", _log_words.called_axes)
        return [*meant.columns] if meant else []
    return []


def refuse_without_poses(name: str, data: bytes) -> None:
    """Refuse a joint log whose rows do not name their poses.

    Raises:
        InputError: It is one.
    """

    def axes(titles: Sequence[str], _: _log_words.SampledCells) -> dict[str, str] | None:
        return {one: one for one in _log_words.axes_without_pose(titles)} or None

    form = _understood(name, data, "joints", axes)
    if form is not None:
        first, *_, last = form.columns
        raise InputError(
            f"seems to be a joint log ({first} to {last}), but no column numbers the poses",
            "add a column pose with the numbers that the tracker's groups and the load log use",
            file=name,
        )


def understood_loads(name: str, data: bytes) -> LogForm | None:
    """Entries of [scale] for a log of loads with foreign titles; None if it is not one."""
    heading = f"{name} {data[:_HEADING].decode('utf-8', 'replace')}"
    meant = partial(_log_words.of_loads, units=_UNITS, by_scale=_log_words.names_a_scale(heading))
    form = _understood(name, data, "scale", meant)
    if form is None or "branch" not in form.columns.values():
        return form
    left = {title: ours for title, ours in form.columns.items() if ours != "branch"}
    try:
        both = (form.columns, left)
        lost = [len(loads(name, data, settled(one)).rejected) for one in both]
    except InputError:  # e.g. an open decimal mark: rows cannot be compared yet
        return form
    return form if lost[0] == lost[1] else LogForm(columns=left)


def settled(columns: Mapping[str, str]) -> LogForm:
    """A form that can be read: of several names for a title, which differ by unit, the first."""
    return LogForm(columns={title: ours.partition("|")[0] for title, ours in columns.items()})


Axes = tuple[tuple[str, ...], tuple[bool, ...]]
"""Names of a robot's axes without units, and which of them slide; many robots have the same."""


def axes_of(robot: Robot) -> Axes:
    """The axes as the controller shows them, else the joints."""
    axes = controller_axes(robot) or own_joints(robot)
    return tuple(q.stem for q in axes), tuple(q.units is LENGTH for q in axes)


def understood_joints(name: str, data: bytes, axes: Axes) -> LogForm | None:
    """Entries of [joints] for a joint log with foreign titles; None if it is not one."""
    return _understood(name, data, "joints", _about_axes(_log_words.of_joints, axes))


def cells_of_joints(name: str, data: bytes, axes: Axes) -> dict[str, Sequence[str]]:
    """Cells of a joint log by title."""
    return _cells_of(name, data, "joints", _about_axes(_log_words.of_joints, axes))


def cells_of_loads(name: str, data: bytes) -> dict[str, Sequence[str]]:
    """Cells of a log of loads by title."""
    return _cells_of(name, data, "scale", partial(_log_words.of_loads, units=_UNITS))


def _cells_of(name: str, data: bytes, table: str, meaning: _Meaning) -> dict[str, Sequence[str]]:
    """Cells of a log by title, as `_understood` finds it."""
    found: dict[str, Sequence[str]] = {}

    def kept(titles: Sequence[str], cells: _log_words.SampledCells) -> dict[str, str] | None:
        columns = meaning(titles, cells)
        found.update(cells() if columns is not None else {})
        return columns

    _understood(name, data, table, kept)
    return found


def has_other_axes(name: str, data: bytes, axes: Axes) -> bool:
    """Whether an axis moves in a joint log that a robot does not have, such as a rail."""
    with contextlib.suppress(InputError):  # a workbook in which no sheet has such a title
        meant = _about_axes(_log_words.of_another, axes)
        return _understood(name, data, "joints", meant) is not None
    return False


def _about_axes(words: Callable[..., dict[str, str] | None], axes: Axes) -> _Meaning:
    units = ([*LENGTH, PULSES], [*ANGLE, PULSES])
    return partial(words, axes=axes[0], lengths=axes[1], units=units)


def are_called(form: LogForm, robot: Robot) -> bool:
    """Whether the titles of a joint log are the names of the axes in the robot's controller."""
    axes = controller_axes(robot) or own_joints(robot)
    return _log_words.are_called([*form.columns], [q.stem for q in axes])


def numbered_joints(name: str, data: bytes, robot: Robot) -> list[LogForm]:
    """Entries of [joints] for a log with as many columns of numbers as joints.

    Whatever their titles, the columns are in the order of the joints; a sliding joint may come
    after those that turn. Whether the robot can take the poses is not checked here.

    Raises:
        InputError: The file cannot be read.
    """
    form = _understood(name, data, "joints", _log_words.pose_alone)
    if form is None:
        return []
    titles = _of_numbers(opened(name, data, form, "joints", POSE.stem))
    axes = controller_axes(robot) or own_joints(robot)
    if len(titles) != len(axes) or not _log_words.in_order(titles):
        return []
    behind = sorted(axes, key=lambda q: q.units is LENGTH)
    orders = [axes] if behind == axes else [axes, behind]
    columns = (form.columns | _as_called(titles, one) for one in orders)
    return [form.model_copy(update={"columns": one}) for one in columns]


def _of_numbers(file: Titled) -> list[str]:
    """Titles of columns that contain only numbers, except those of poses and the like."""
    fields = tuple(Field(str(k), "name", False) for k in range(len(file.titles)))
    read = rows(file.text, Layout(fields, file.delimiter, file.first, table="joints"))
    cells = [{*read.columns[one.name].cast(pa.string()).to_pylist()} for one in fields]
    return [
        written
        for written, title, some in zip(file.written, file.titles, cells, strict=True)
        if title not in (POSE.stem, REPEAT.stem, "approach") and some and all(map(is_number, some))
    ]


def _as_called(titles: Sequence[str], axes: Sequence[Quantity]) -> dict[str, str]:
    """Our names for titles, separated by bars where they state no unit."""
    return {
        title: "|".join(f"{q.stem}_{u}" for u in _log_words.stated_unit(title, [*q.units]))
        for title, q in zip(titles, axes, strict=True)
    }


def naming(name: str, data: bytes, names: set[str]) -> dict[str, set[str]]:
    """The columns of a log whose cells are all some of these names, by title; empty if none."""
    found: dict[str, set[str]] = {}

    def column(_: Sequence[str], cells: _log_words.SampledCells) -> dict[str, str] | None:
        own = {title: {*some} - {""} for title, some in cells().items()}
        found.update({k: some for k, some in own.items() if len(some) > 1 and some <= names})
        return {title: title for title in found} or None

    with contextlib.suppress(InputError):  # a workbook in which no sheet has such a column
        _understood(name, data, "scale", column)
    return found


def unknown(name: str, data: bytes, stated: LogForm) -> tuple[str, ...]:
    """Titles of a log of loads that are not ours, as written."""
    every = *of_loads(), POSE_REPEAT
    ours = {one for q in every for one in (*map(str.lower, names_of(q)), q.stem)}
    file = opened(name, data, stated, "scale", POSE.stem, has_load)
    both = zip(file.titles, file.written, strict=True)
    return tuple(written for title, written in both if title and title not in ours)
