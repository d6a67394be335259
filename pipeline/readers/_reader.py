"""The shape of a reader: pure functions from the text of an export to readings in SI, and back."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Array, Bools, Ints, Locked, sifted
from pipeline.base.errors import InputError
from pipeline.readers import _faces
from pipeline.readers._cells import text_of
from pipeline.readers._coordinates import (
    Angles,
    Meaning,
    cartesian,
    covariance,
    raw,
    second_face,
    settled,
    settled_angle,
    settled_horizontal,
    settled_vertical,
)
from pipeline.readers._faces import Faces
from pipeline.readers._layout import TypedRows
from pipeline.readers._text import Text
from pipeline.readers.said import Hints

TABLE = "table"
"""What `inspect` calls a file of no dialect."""
EXPANDED, STANDARD, A_PRIORI, RMS = "expanded", "standard", "a-priori", "rms"
_PREFERRED = (A_PRIORI, STANDARD, EXPANDED)
"""Which covariance is used where a file has several. A-priori comes first: the scatter within one
reading (standard) leaves out what does not change during it, calibration and slow air, and rms
is a scatter too, of one number for three axes: it is used only when campaign.toml asks for it."""


_FARTHEST_M = 1e6
"""No tracker reads so far [m], whatever unit was mistaken for whatever other."""
_VAGUEST_M2 = 1e6
"""Nor is one so uncertain in an axis [m^2]: a metre, mistaken for a thousand."""
_ROUNDED = 1.05
"""Square of a correlation that rounding in a file may leave."""
_NO_UNCERTAINTY = (
    "its uncertainty is none (a variance below zero or a correlation above one); export it again, "
    'or set covariance = "none" in [tracker]'
)
_STATISTICS = {
    "mean", "mean value", "average", "avg", "median", "min", "max", "minimum", "maximum", "range",
    "count", "rms", "centroid", "std", "std dev", "stddev", "std deviation", "standard deviation",
    "st dev", "stdev", "sigma", "sum", "mittelwert", "mittel", "standardabweichung", "stabw",
    "spannweite", "anzahl", "schwerpunkt", "summe", "moyenne", "écart type", "media",
}  # fmt: skip
"""Names of what programs write below or above the points of a table."""
_STATISTIC = "its name is that of a statistic, and no target; rename it if it is one"
_NINES = re.compile(r"999+(\.9+)?")
"""What programs write for no number."""
_NOTHING = (
    "its three numbers are those that stand for no reading; measure it again or remove the row"
)
_TOO_VAGUE = "its uncertainty is larger than 1 km; measure it again or remove the row"
_TOO_FAR = (
    f"the coordinates are farther than {_FARTHEST_M / 1e3:_.0f} km; ".replace("_", " ")
    + "measure it again or remove the row"
)
USUAL_FACTORS = {STANDARD: 1.0, EXPANDED: 2.0}
"""k of uncertainties where campaign.toml does not say; 2 is 95 % (GUM 6.3.3, Leica's U(95))."""


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
        faces: Of polar readings in two faces, which are averaged; None where there is one face.
        untimed: A column that should hold times and does not, None where there is none.
        settled: What campaign.toml settled that the file leaves open, in sentences.
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
    faces: Faces | None = None
    untimed: str | None = None
    settled: tuple[str, ...] = ()


_OF_EACH = ("group", "target", "position", "covariance", "time", "line", "order")
"""What of an `Export` has one row for each reading."""


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


def export(
    text: Text,
    hints: Hints,
    dialect: str,
    rows: TypedRows,
    meaning: Meaning,
    axes: Sequence[str],
    covariances: Mapping[str, Array] | None = None,
    unused: Sequence[str] = (),
) -> Export:
    """Readings in SI of what a dialect found in a file.

    Args:
        text: The file.
        hints: What campaign.toml adds.
        dialect: Its name.
        rows: The typed rows; of the columns `group`, `target` (or `reflector`) and `time` those
            that the file has.
        meaning: Of the three numbers.
        axes: Names of the columns with the three numbers.
        covariances: Six numbers in the units of the file by kind, each shape (n, 6).
        unused: Columns that were not looked at.
    """
    columns, n = rows.columns, len(rows.line)
    numbers = [np.asarray(columns[axis]) for axis in axes]
    kind = _chosen(covariances or {}, hints)
    C = (
        covariance(covariances[kind], np.array(numbers).T, meaning)
        if covariances and kind
        else None
    )
    everything = Export(
        file=text.name,
        dialect=dialect,
        encoding=text.encoding,
        meaning=meaning,
        group=columns.get("group"),
        target=columns.get("target", columns.get("reflector")),
        position=cartesian(numbers, meaning),
        covariance=C,
        covariance_kind=kind,
        time=columns.get("time", pa.nulls(n, pa.timestamp("us"))),
        line=rows.line,
        order=rows.order,
        rows=n + len(rows.rejected),
        unused=tuple(unused),
        rejected=rows.rejected,
    )
    statistic = _statistics(everything.target)
    if statistic.any():
        everything = kept(everything, ~statistic, _STATISTIC)
        numbers = [column[~statistic] for column in numbers]
    nothing = _nothing(numbers)
    if nothing.any():
        everything = kept(everything, ~nothing, _NOTHING)
        numbers = [column[~nothing] for column in numbers]
    if meaning.kind == "spherical":
        everything = _one_face(everything, second_face(numbers[2], meaning))
    return _possible(everything)


def _statistics(target: pa.DictionaryArray | None) -> Bools:
    """Rows whose target is a mean, a deviation or the like of the others, shape (n,)."""
    if target is None:
        return np.zeros(1, dtype=bool)
    words = (re.findall(r"[^\W_]+", str(name).lower()) for name in target.dictionary.to_pylist())
    found = np.array([" ".join(word) in _STATISTICS for word in words], dtype=bool)
    return np.asarray(found[np.asarray(target.indices)])


def _nothing(numbers: Sequence[Array]) -> Bools:
    """Rows of which three times -9999 or so says that there is no reading, shape (n,).

    0, 0, 0 may be a place; where it is none, the campaign's other readings show it.
    """
    x, y, z = numbers
    alike = (x == y) & (y == z)
    nines = [v for v in np.unique(np.abs(x[alike])) if _NINES.fullmatch(f"{v:.12g}")]
    return np.asarray(alike & np.isin(np.abs(x), nines))


def _one_face(readings: Export, second: Bools) -> Export:
    """Targets read in both faces as one reading each, their mean in the place of the first."""
    if not second.any() or readings.target is None:
        return readings
    columns = [c.to_pylist() for c in (readings.group, readings.target) if c is not None]
    found = _faces.pairs(list(zip(*columns, strict=True)), second, readings.position)
    told = _faces.summary(readings.position, found, second)
    position, C = _faces.mean(readings.position, readings.covariance, found)
    keep = np.ones(len(second), dtype=bool)
    keep[found[:, 1]] = False
    averaged = replace(readings, position=position, covariance=C, faces=told)
    of_each = sifted({name: getattr(averaged, name) for name in _OF_EACH}, keep)
    return replace(averaged, **of_each)


def _possible(everything: Export) -> Export:
    """The readings that can be: no farther off, and no vaguer, than anything in a hall."""
    C = everything.covariance
    if C is not None:
        vague = ~(np.nanmax(np.abs(C), axis=1, initial=0) <= _VAGUEST_M2)
        everything = kept(everything, ~vague, _TOO_VAGUE) if vague.any() else everything
        odd = _is_none(everything.covariance)
        everything = kept(everything, ~odd, _NO_UNCERTAINTY) if odd.any() else everything
    xyz = everything.position.T
    if all(x.min(initial=0) >= -_FARTHEST_M and x.max(initial=0) <= _FARTHEST_M for x in xyz):
        return everything
    near = np.logical_and.reduce([np.abs(x) <= _FARTHEST_M for x in xyz])
    return kept(everything, near, _TOO_FAR)


def _is_none(C: Array | None) -> Bools:
    """Where six numbers are no covariance: a variance below zero, a correlation above one."""
    assert C is not None
    xx, xy, xz, yy, yz, zz = C.T
    with np.errstate(invalid="ignore"):  # NaN where the file has none
        negative = np.minimum(np.minimum(xx, yy), zz) < 0
        pairs = ((xy, xx, yy), (xz, xx, zz), (yz, yy, zz))
        tied = [c**2 > _ROUNDED * a * b for c, a, b in pairs]
    return np.asarray(np.logical_or.reduce([negative, *tied]))


def kept(readings: Export, keep: Bools, why_not: str) -> Export:
    """The readings to keep; the others are rejected for one reason."""
    of_each = sifted({name: getattr(readings, name) for name in _OF_EACH}, keep)
    left_out = tuple((int(line), why_not) for line in readings.line[~keep])
    return replace(readings, **of_each, rejected=(*readings.rejected, *left_out))


def _chosen(kinds: Collection[str], hints: Hints) -> str | None:
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
        )
    return hints.covariance if kinds else None


def settled_unit(stated: str | None, hints: Hints) -> str:
    """The unit of length of an export: what it says itself, else what campaign.toml says.

    Raises:
        InputError: Nobody says, or the two contradict each other.
    """
    return settled(stated, hints.unit, "unit of length", 'unit = "mm" (or "m", "in")')


def settled_angles(
    meaning: Meaning,
    stated: Angles,
    third: Array,
    hints: Hints,
) -> Meaning:
    """The same with unit, zero and sense of angles, where coordinates of its kind have some.

    Args:
        meaning: Unit and kind of coordinates.
        stated: What the export says of its angles.
        third: The third column of numbers, which may say where vertical angles begin.
        hints: What campaign.toml says.

    Raises:
        InputError: Nobody says, or the two contradict each other.
    """
    if meaning.kind == "cartesian":
        return meaning
    angle = settled_angle(stated.unit, hints.angle)
    meaning = replace(meaning, angle=angle)
    if meaning.kind == "spherical":
        vertical = settled_vertical(stated.vertical, hints.vertical, third, angle)
        meaning = replace(meaning, vertical=vertical)
    return replace(meaning, horizontal=settled_horizontal(stated.horizontal, hints.horizontal))


def written(
    readings: Readings, unit: str, digits: int | None
) -> Iterator[tuple[str, str, list[str], datetime]]:
    """Group, target, Cartesian coordinates as text and time of each reading, for the writers."""
    numbers = text_of(raw(readings.position, Meaning(unit)), digits)
    return zip(readings.group, readings.target, numbers, readings.time, strict=True)


def diagonal(std: Sequence[Array], factor: float = 1.0) -> Array:
    """Six numbers of uncorrelated standard uncertainties, each shape (n,), divided by a factor."""
    x, y, z = (s / factor * np.abs(s / factor) for s in std)  # one below zero stays one
    none = np.zeros_like(x)
    return np.column_stack([x, none, none, y, none, z])
