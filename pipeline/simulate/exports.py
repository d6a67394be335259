"""Tracker exports: readings as the instrument's software would have written them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from pipeline.errors import UsageError
from pipeline.results import Array, Locked


@dataclass(frozen=True, eq=False)
class Readings(Locked):
    """Readings in the order in which they were taken.

    Attributes:
        group: Group of each reading, N of them.
        target: Target of each reading.
        xyz: Coordinates in the tracker's frame [m], shape (N, 3).
        time: After the first reading [s], shape (N,).
        start: Time of the first reading.
    """

    group: Sequence[str]
    target: Sequence[str]
    xyz: Array
    time: Array
    start: datetime

    def stamps(self, form: str) -> list[str]:
        """Times in a `strftime` form, to the second."""
        return [(self.start + timedelta(seconds=float(t))).strftime(form) for t in self.time]


@dataclass(frozen=True)
class Dialect:
    """One form of export.

    Attributes:
        file: Name of the file.
        unit: What campaign.toml must say because the export does not, or None.
        write: readings, texts of the coordinates in mm (N rows of three) -> the file's bytes.
    """

    file: str
    unit: str | None
    write: Callable[[Readings, list[list[str]]], bytes]


def _plain(readings: Readings, mm: list[list[str]]) -> bytes:
    rows = zip(
        readings.group, readings.target, mm, readings.stamps("%Y-%m-%dT%H:%M:%S"), strict=True
    )
    lines = [f"{group},{target},{','.join(xyz)},{time}\n" for group, target, xyz, time in rows]
    return "".join(["group,target,x_mm,y_mm,z_mm,time\n", *lines]).encode()


def _spatial_analyzer(readings: Readings, mm: list[list[str]]) -> bytes:
    """Cartesian ASCII export with its comment header, without times."""
    head = [
        "// SpatialAnalyzer ASCII point export",
        "// Units: millimeters",
        "// Collection::Group::Target, X, Y, Z",
    ]
    rows = zip(readings.group, readings.target, mm, strict=True)
    body = [f"A::{group}::{target}, {', '.join(xyz)}" for group, target, xyz in rows]
    return "\r\n".join([*head, *body, ""]).encode()


DIALECTS: dict[str, Dialect] = {
    "plain": Dialect("tracker.csv", None, _plain),
    "spatialanalyzer": Dialect("tracker.txt", None, _spatial_analyzer),
}
"""Every form that the simulator can write, by name."""


def export(dialect: str, readings: Readings, digits: int | str) -> tuple[Dialect, bytes]:
    """The readings in a dialect.

    Args:
        dialect: A key of `DIALECTS`.
        readings: What was read.
        digits: Decimals of a coordinate in mm, or `full` for the shortest text of the same number.

    Raises:
        UsageError: No such dialect; lists those there are.
    """
    if dialect not in DIALECTS:
        raise UsageError(f'there is no dialect "{dialect}"; choose from {", ".join(DIALECTS)}.')
    chosen = DIALECTS[dialect]
    return chosen, chosen.write(readings, numbers(1e3 * readings.xyz, digits))


def numbers(values: Array, digits: int | str) -> list[list[str]]:
    """Texts of a table of numbers with a fixed number of decimals, or all that matter."""
    if digits == "full":
        return [[repr(value) for value in row] for row in np.asarray(values).tolist()]
    return [[f"{value:.{digits}f}" for value in row] for row in np.asarray(values).tolist()]
