"""The shape of a reader: pure functions from the text of an export to readings in SI."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pyarrow as pa

from pipeline.errors import InputError
from pipeline.readers._text import Text
from pipeline.results import Array, Ints, Locked

UNITS = ("mm", "m", "in")


def metres(values: Array, unit: str) -> Array:
    """Lengths in metres; mm are divided by 1000, which rounds once, 0.001 would round twice."""
    if unit == "mm":
        return values / 1000.0
    return values * 0.0254 if unit == "in" else values


@dataclass(frozen=True)
class Hints:
    """What campaign.toml says about exports that do not say it themselves.

    Attributes:
        unit: `mm`, `m` or `in`, or None.
        decimal: The decimal mark, `.` or `,`, or None.
    """

    unit: str | None = None
    decimal: str | None = None


@dataclass(frozen=True, eq=False)
class Export(Locked):
    """Readings of one file, in the frame of the export.

    Attributes:
        dialect: Name of the reader.
        unit: Unit of length in the file.
        coordinates: `cartesian`, `spherical` or `cylindrical` in the file.
        group: Group of each reading, dictionary of strings, length n.
        target: Target of each reading, dictionary of strings, length n.
        position: Cartesian coordinates [m], shape (n, 3).
        covariance: xx, xy, xz, yy, yz, zz [m^2], shape (n, 6), or None where the file has none.
        covariance_kind: `standard`, `expanded`, `a-priori` or `rms`; None without covariance.
        time: Time of each reading, timestamps without zone, null where unknown, length n.
        line: Line of each reading, counted from 1, shape (n,).
        rejected: Line and reason of what was left out.
    """

    dialect: str
    unit: str
    coordinates: str
    group: pa.DictionaryArray
    target: pa.DictionaryArray
    position: Array
    covariance: Array | None
    covariance_kind: str | None
    time: pa.TimestampArray
    line: Ints
    rejected: tuple[tuple[int, str], ...]


@dataclass(frozen=True)
class Reader:
    """One dialect.

    Attributes:
        name: What `inspect` calls it.
        recognise: Whether the first lines of a file are of this dialect.
        read: The readings of a file of this dialect.
    """

    name: str
    recognise: Callable[[Sequence[str]], bool]
    read: Callable[[Text, Hints], Export]


def settled_unit(stated: str | None, hints: Hints, file: str, line: int | None = None) -> str:
    """The unit of length of an export: what it says itself, else what campaign.toml says.

    Raises:
        InputError: Nobody says, or the two contradict each other.
    """
    if stated is None and hints.unit is None:
        raise InputError(
            "the export does not say its unit of length",
            'write unit = "mm" (or "m", "in") into [tracker] of campaign.toml',
            file=file,
            line=line,
        )
    if stated and hints.unit and stated != hints.unit:
        raise InputError(
            f"the export is in {stated} but campaign.toml says {hints.unit}",
            "remove unit from [tracker], it is for exports that do not say",
            file=file,
            line=line,
        )
    return stated or hints.unit or ""
