"""Dump of Leica emScon's results (SingleMeasResultT and 2T): numbers only, in the order taken.

Columns are the members of the structure; every row ends in a comma. There are no names and no
times; unit and coordinate system depend on the settings of the tracker and are not in the file.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError, at, listed
from pipeline.dialects._coordinates import Angles, raw, settled, settled_angles, settled_unit
from pipeline.dialects._delimited import rows
from pipeline.dialects._export import A_PRIORI, STANDARD, export
from pipeline.readers._layout import Field, Layout, TypedRows
from pipeline.readers._reader import Export, Meaning, OutgoingReadings, Reader, text_of
from pipeline.readers._text import Text
from pipeline.readers.export_settings import ExportSettings

_VALUES = ("dVal1", "dVal2", "dVal3")
_KINDS = {STANDARD: "d", A_PRIORI: "dApriori"}
"""Prefix of the columns of each covariance: scatter within the reading, and the tracker's own error
model."""

_POINTING = (
    *("dPointingErrorH", "dPointingErrorV", "dPointingErrorD"),
    *("dPointingError1", "dPointingError2", "dPointingError3"),
)
_WEATHER = ("dTemperature", "dPressure", "dHumidity")


def _names(start: str) -> list[str]:
    return [
        *(f"{start}Std{k}" for k in ("1", "2", "3", "Total")),
        *(f"{start}Covar{k}" for k in (12, 13, 23)),
    ]


_STATISTICS = {name for start in _KINDS.values() for name in _names(start)}
_RELATIVE, _ABSOLUTE = 1e-3, 1e-7
"""Relative and absolute tolerance for the agreement of a total with its parts [1] and [unit of the
file]: six digits are printed."""
_COMPLETE = (0, 8, 14)
"""Possible numbers of these columns [1]: none, those without covariances, all."""


def _recognise(lines: Sequence[str]) -> bool:
    """Whether the first line names dVal1, dVal2 and dVal3."""
    return set(_VALUES) <= set(_titles(next((line for line in lines if line.strip()), "")))


def _titles(line: str) -> list[str]:
    return [title.strip() for title in line.split(",")]


def _read(text: Text, hints: ExportSettings) -> Export:
    """Read an emScon dump; its readings have no names.

    Raises:
        InputError: The unit is not stated in campaign.toml, or the coordinate system is ambiguous.
    """
    first, header = text.first()
    titles = _titles(header)
    with at(line=first):
        _check(titles)
    table = rows(text, Layout(_fields(titles), ",", first + 1, hints.decimal))
    covariances = {
        kind: _six(table, titles, start)
        for kind, start in _KINDS.items()
        if {f"{start}Std{k}" for k in (1, 2, 3)} <= {*titles}
    }
    with at(line=first):
        meaning = _meaning(table, titles, hints)
    unused = [title for title in titles if title in (*_POINTING, *_WEATHER)]
    return export(text, hints, READER.name, table, meaning, _VALUES, covariances, unused)


def _check(titles: Sequence[str]) -> None:
    """Check that the columns are those of the structure, complete and without duplicates."""
    known = {*_VALUES, *_STATISTICS, *_POINTING, *_WEATHER, ""}
    strange = [title for title in titles if title not in known]
    if strange or len({*titles} & _STATISTICS) not in _COMPLETE:
        raise InputError(
            f"the columns are not those of SingleMeasResultT or 2T ({listed(strange or titles)})",
            "export it again, or describe the table in [tracker.mapping] of campaign.toml",
        )
    twice = [title for title in titles if title and titles.count(title) > 1]
    if twice:
        raise InputError(f"there are two columns {twice[0]}", "remove one of them")


def _fields(titles: Sequence[str]) -> tuple[Field, ...]:
    return tuple(
        Field(title, "number")
        if title in _VALUES or title in _STATISTICS
        else Field(f"{title} ({place})", "any" if title else "blank", needed=False)
        for place, title in enumerate(titles, 1)
    )


def _six(table: TypedRows, titles: Sequence[str], start: str) -> Array:
    """xx, xy, xz, yy, yz, zz of one kind, (n, 6); covariances are zero for the older structure."""
    n = len(table.line)

    def column(name: str) -> Array:
        return np.asarray(table.columns[name]) if name in titles else np.zeros(n)

    s1, s2, s3 = (column(f"{start}Std{k}") for k in (1, 2, 3))
    c12, c13, c23 = (column(f"{start}Covar{k}") for k in (12, 13, 23))
    return np.column_stack([s1**2, c12, c13, s2**2, c23, s3**2])


def _meaning(table: TypedRows, titles: Sequence[str], hints: ExportSettings) -> Meaning:
    unit = settled_unit(None, hints)
    stated = "cartesian" if _lengths_only(table, titles) else None
    example = 'coordinates = "cartesian" (or "spherical", "cylindrical")'
    kind = hints.coordinates or settled(stated, None, "coordinate system", example)
    third = np.asarray(table.columns[_VALUES[2]])
    return settled_angles(Meaning(unit, kind), Angles(), third, hints)


def _lengths_only(table: TypedRows, titles: Sequence[str]) -> bool:
    """Whether dStdTotal is the root sum of squares, as it is if all three values are lengths."""
    if not {"dStd1", "dStd2", "dStd3", "dStdTotal"} <= set(titles) or not len(table.line):
        return False
    s1, s2, s3, total = (np.asarray(table.columns[f"dStd{k}"]) for k in ("1", "2", "3", "Total"))
    return bool(np.allclose(np.sqrt(s1**2 + s2**2 + s3**2), total, rtol=_RELATIVE, atol=_ABSOLUTE))


def _write(readings: OutgoingReadings, unit: str, digits: int | None) -> bytes:
    """Write a dump in Cartesian coordinates; names and times are lost.

    An assignment restores the names.
    """
    meaning = Meaning(unit)
    numbers = text_of(raw(readings.position, meaning), digits)
    scale = raw(np.ones((1, 3)), meaning)[0, 0]
    six = np.zeros((len(numbers), 6)) if readings.covariance is None else readings.covariance
    statistics = [_statistics(row * scale**2) for row in six]
    titles = [*_VALUES, *_names("d"), *_POINTING[:3], *_names("dApriori"), *_WEATHER]
    lines = [",".join([*titles, ""])]
    lines += [
        ",".join([*xyz, *s, "0", "0", "0", *s, "20", "1013", "50", ""])
        for xyz, s in zip(numbers, statistics, strict=True)
    ]
    return "\r\n".join([*lines, ""]).encode()


def _statistics(six: Array) -> list[str]:
    xx, xy, xz, yy, yz, zz = six.tolist()
    std = [float(np.sqrt(variance)) for variance in (xx, yy, zz, xx + yy + zz)]
    return [repr(value) for value in (*std, xy, xz, yz)]


READER = Reader("Leica emScon dump", _recognise, _read, _write, says_unit=False, says_names=False)
