"""Joint values in encoder pulses: known by their size; a file may say how many are a degree."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from pipeline.base.errors import InputError
from pipeline.dialects._cells import is_number
from pipeline.machine.robot import Robot
from pipeline.readers import logs
from pipeline.readers._text import text as decoded
from pipeline.readers.export_settings import JointForm, LogForm

_TURNS = 720.0
"""Largest angle that a controller shows [deg]: axes turn twice."""
_LARGEST = 200_000
"""Maximum size of a file in which pulses per degree are looked for [byte]."""
_BETWEEN = (";", "\t", r"\|", r"\s{2,}", ",", r"\s+")
"""What separates the cells of a table in a text: the first that a line has."""
_WORD = re.compile(r"pul[sz]|パルス", re.IGNORECASE)


def in_pulses(name: str, data: bytes, robot: Robot, form: LogForm) -> LogForm | None:
    """The form of a joint log with its axes in pulses, if its numbers can only be these; else None.

    They are whole, and most axes exceed all turns.
    """
    stems = {t: ours.partition("|")[0] for t, ours in form.columns.items() if logs.PULSES in ours}
    axes = {title: ours.rpartition("_")[0] for title, ours in stems.items()}
    columns = form.columns | {title: f"{axis}_{logs.PULSES}" for title, axis in axes.items()}
    tried = JointForm(columns=columns, pulses=dict.fromkeys(axes.values(), 1.0))
    with contextlib.suppress(InputError):
        log = logs.joints(name, data, robot, tried)
        counts = np.array([np.rad2deg(log.number[axis]) for axis in axes.values()])
        whole = counts.size and (np.abs(counts - counts.round()) < 1e-6 * np.abs(counts) + 1e-6)
        if np.all(whole) and 2 * np.sum(np.abs(counts).max(axis=1) > _TURNS) > len(axes):
            return form.model_copy(update={"columns": columns})
    return None


def per_degree(files: Mapping[str, bytes], axes: Sequence[str]) -> dict[str, float]:
    """Pulses per degree of all axes from a list that speaks of pulses; empty if none has them all.

    A number follows the name of each axis, in a line of its own or one after the other, or is in a
    column whose title speaks of pulses.
    """
    for name, data in files.items() if axes else ():
        text = _as_text(name, data)
        if listed := _in_a_column(text, axes):
            return listed
        ways = (re.findall(rf"(?<!\w){re.escape(a)}(?!\w)[^\n\w.+-]*([0-9]+[.,]?[0-9]*)", text)
                for a in axes)  # fmt: skip
        found = dict(zip(axes, ways, strict=True))
        if _WORD.search(text) and all(len({*some}) == 1 for some in found.values()):
            return {axis: float(some[0].replace(",", ".")) for axis, some in found.items()}
    return {}


def _as_text(name: str, data: bytes) -> str:
    """A small file in its encoding; empty if it is none."""
    with contextlib.suppress(InputError):
        return decoded(name, data).data.decode() if len(data) <= _LARGEST else ""
    return ""


def _in_a_column(text: str, axes: Sequence[str]) -> dict[str, float]:
    """Pulses per degree of all axes from a table with a row for each; empty if there is none.

    Its titles are as many as the cells of each row that begins with the name of an axis.
    """
    rows = [_cells(line.strip(" |\t")) for line in text.splitlines()]
    found = {axis: {*_counts(rows, axis)} for axis in axes}
    whole = all(len(one) == 1 for one in found.values())
    return {k: float(one.pop().replace(",", ".")) for k, one in found.items()} if whole else {}


def _counts(rows: Sequence[Sequence[str]], axis: str) -> Iterator[str]:
    """Numbers below a title of pulses in rows of an axis, the nearest of as many cells."""
    for k, row in enumerate(rows):
        titled = (
            one for one in rows[k::-1] if len(one) == len(row) and any(map(_WORD.search, one))
        )
        titles = next(titled, ()) if row[0] == axis else ()
        for title, cell in zip(titles, row, strict=False):
            if _WORD.search(title) and is_number(cell):
                yield cell


def _cells(line: str) -> list[str]:
    mark = next((one for one in _BETWEEN if re.search(one, line)), ",")
    return [one.strip() for one in re.split(mark, line)]
