"""Convert the findings of a dialect to readings in SI.

Covariances are converted, readings in two faces averaged, and rows that are not readings rejected.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.base.arrays import Array, Bools, Ints, sifted
from pipeline.base.errors import InputError
from pipeline.dialects import time_of_file
from pipeline.dialects._coordinates import cartesian, covariance, second_face
from pipeline.readers import _reader
from pipeline.readers._layout import TypedRows
from pipeline.readers._reader import OF_EACH, Export, Faces, Meaning, in_a_hall, kept, of_targets
from pipeline.readers._text import Text
from pipeline.readers.export_settings import ExportSettings
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M

EXPANDED, STANDARD, A_PRIORI, RMS = "expanded", "standard", "a-priori", "rms"
_PREFERRED = (A_PRIORI, STANDARD, EXPANDED)
"""Order of preference if a file has several covariances. A-priori comes first: the scatter within
one reading (standard) misses errors that are constant during it, such as calibration and slow
changes of the air. rms is also a scatter, one number for three axes: it is used only if
campaign.toml asks for it."""
_VAGUEST_M2 = 1e6
"""Largest variance accepted in an axis [m^2]: a standard uncertainty of 1 km."""
_OF_FILES = ("files", "folders/files", "files::groups")
"""`groups` of [tracker] by which a file is one group or pose, dated by a moment above its rows."""
_ROUNDED = 1.05
"""Largest squared correlation accepted [1]; rounding in a file may bring it above 1."""
_NO_UNCERTAINTY = (
    "its uncertainty is none (a variance below zero or a correlation above one); export it again, "
    'or set covariance = "none" in [tracker]'
)
_TOO_VAGUE = "its uncertainty is larger than 1 km; measure it again or remove the row"
USUAL_FACTORS = {STANDARD: 1.0, EXPANDED: 2.0}
"""Coverage factor k of uncertainties unless campaign.toml states it; 2 is 95 % (GUM 6.3.3, Leica's
U(95))."""


def export(
    text: Text,
    hints: ExportSettings,
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
        dialect: Name of the dialect.
        rows: The typed rows, with those of the columns `group`, `target` (or `reflector`) and
            `time` that the file has.
        meaning: Interpretation of the three numbers.
        axes: Names of the columns with the three numbers.
        covariances: Six numbers in the units of the file by kind, each shape (n, 6).
        unused: Columns that were not read.
    """
    numbers = [np.asarray(rows.columns[axis]) for axis in axes]
    kind = _chosen(covariances or {}, hints)
    everything = _reader.export(text, dialect, rows, meaning, cartesian(numbers, meaning), unused)
    if covariances and kind:
        C = covariance(covariances[kind], np.array(numbers).T, meaning)
        everything = replace(everything, covariance=C, covariance_kind=kind)
    readings = of_targets(everything, numbers)
    if meaning.kind == "spherical":
        second = second_face(numbers[2], meaning)[np.isin(everything.line, readings.line)]
        readings = _one_face(readings, second)
    if hints.groups in _OF_FILES:
        readings = time_of_file.dated(readings, text)
    return in_a_hall(_certain(readings))


def _one_face(readings: Export, second: Bools) -> Export:
    """Average the two readings of each target in two faces, in the place of the first.

    Collimation error and tilt of the axes displace the two in opposite directions and leave their
    mean unchanged.
    """
    if not second.any() or readings.target is None:
        return readings
    columns = [c.to_pylist() for c in (readings.group, readings.target) if c is not None]
    found = _face_pairs(list(zip(*columns, strict=True)), second, readings.position)
    summary = _face_summary(readings.position, found, second)
    position, C = _face_mean(readings.position, readings.covariance, found)
    keep = np.ones(len(second), dtype=bool)
    keep[found[:, 1]] = False
    averaged = replace(readings, position=position, covariance=C, faces=summary)
    of_each = sifted({name: getattr(averaged, name) for name in OF_EACH}, keep)
    return replace(averaged, **of_each)


def _certain(readings: Export) -> Export:
    """Reject readings with a variance above `_VAGUEST_M2` or with an invalid covariance."""
    if readings.covariance is None:
        return readings
    vague = ~(np.nanmax(np.abs(readings.covariance), axis=1, initial=0) <= _VAGUEST_M2)
    readings = kept(readings, ~vague, _TOO_VAGUE) if vague.any() else readings
    odd = _is_none(readings.covariance)
    return kept(readings, ~odd, _NO_UNCERTAINTY) if odd.any() else readings


def _is_none(C: Array | None) -> Bools:
    """Whether six numbers are not a covariance: a negative variance, or a correlation above one."""
    assert C is not None
    xx, xy, xz, yy, yz, zz = C.T
    with np.errstate(invalid="ignore"):  # NaN if the file has none
        negative = np.minimum(np.minimum(xx, yy), zz) < 0
        pairs = ((xy, xx, yy), (xz, xx, zz), (yz, yy, zz))
        tied = [c**2 > _ROUNDED * a * b for c, a, b in pairs]
    return np.asarray(np.logical_or.reduce([negative, *tied]))


def _chosen(kinds: Collection[str], hints: ExportSettings) -> str | None:
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


def diagonal(std: Sequence[Array], factor: float = 1.0) -> Array:
    """Covariances (n, 6) of uncorrelated uncertainties (n,), divided by a coverage factor."""
    x, y, z = (s / factor * np.abs(s / factor) for s in std)  # a negative one stays negative
    none = np.zeros_like(x)
    return np.column_stack([x, none, none, y, none, z])


def _face_pairs(names: Sequence[Any], second: Bools, position: Array) -> Ints:
    """Pair each reading of a target with its previous one in the other face, shape (pairs, 2).

    Pairs farther apart than any maladjustment explains are not of the same place and are dropped.

    Args:
        names: Group and target of each reading.
        second: Which are in the second face, shape (n,).
        position: Coordinates [m], shape (n, 3).
    """
    waiting: dict[Any, int] = {}
    found = []
    for k, name in enumerate(names):
        before = waiting.pop(name, None)
        if before is not None and second[before] != second[k]:
            found.append((before, k))
        else:
            waiting[name] = k
    both = np.array(found, dtype=np.int64).reshape(-1, 2)
    apart = np.linalg.norm(position[both[:, 0]] - position[both[:, 1]], axis=1)
    return both[apart <= GROSS_DISTANCE_M]


def _face_summary(position: Array, found: Ints, second: Bools) -> Faces:
    """Summary of the pairs `found`; position [m] has shape (n, 3)."""
    apart = np.linalg.norm(position[found[:, 0]] - position[found[:, 1]], axis=1)
    return Faces(len(found), float(apart.max(initial=0.0)), int(second.sum()) - len(found))


def _face_mean(
    position: Array, covariance: Array | None, found: Ints
) -> tuple[Array, Array | None]:
    """Positions and covariances, with the first reading of each pair replaced by their mean."""
    one, other = found.T
    position = position.copy(order="F")
    position[one] = (position[one] + position[other]) / 2
    if covariance is not None:
        covariance = covariance.copy()
        covariance[one] = (covariance[one] + covariance[other]) / 4
    return position, covariance
