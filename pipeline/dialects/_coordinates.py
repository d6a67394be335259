"""Convert readings with angles to Cartesian coordinates, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base.arrays import Array, Bools
from pipeline.base.covariance import flat, symmetric
from pipeline.base.errors import InputError
from pipeline.dialects._unit_words import UNIT_WORDS
from pipeline.readers._reader import Meaning
from pipeline.readers._units import in_unit, metres
from pipeline.readers.export_settings import ExportSettings

PACKED = "dms"
"""Name of the unit of degrees with minutes and seconds after the point: 123.4512 is 123 degrees, 45
minutes, 12 seconds, as total stations and surveyors' calculators write."""
_ANGLES = {"deg": np.pi / 180.0, "rad": 1.0, "gon": np.pi / 200.0, PACKED: np.pi / 180.0}
"""Units of angles [rad]."""
_TICKS, _SIXTY = 1e6, 60.0
"""Resolution to which seconds are rounded, 1e-6 of a second of arc or 5e-12 rad; and the number of
minutes in a degree and of seconds in a minute [1]."""
AXES = {
    "cartesian": ("x", "y", "z"),
    "spherical": ("range", "azimuth", "vertical"),
    "cylindrical": ("range", "azimuth", "z"),
}
"""Roles of the three numbers by kind of coordinates."""
KIND_WORDS = {kind: kind for kind in AXES} | {"polar": "spherical", "kartesisch": "cartesian"}

ZEROS = ("zenith", "elevation")
"""Directions in which vertical angles may be zero: straight up, or horizontal."""
VERTICALS = ("vertical", *ZEROS)
"""Roles of a vertical angle; the first leaves open in which direction it is zero."""
ANGULAR = {"cartesian": [], "spherical": [1, 2], "cylindrical": [1]}
"""Indices of the numbers that are angles, by kind of coordinates."""


SENSES = {"counter-clockwise": 1.0, "clockwise": -1.0}
"""Sense of positive azimuths, seen from above, and the sign of a rotation from x towards y."""


@dataclass(frozen=True)
class Angles:
    """Stated properties of angles, each None if not stated.

    Attributes:
        unit: As `Meaning.angle`.
        vertical: As `Meaning.vertical`.
        horizontal: As `Meaning.horizontal`.
    """

    unit: str | None = None
    vertical: str | None = None
    horizontal: str | None = None


def angular(meaning: Meaning) -> list[int]:
    """Indices of the numbers that are angles."""
    return ANGULAR[meaning.kind]


def angles(meaning: Meaning) -> Angles:
    """Unit, zero and sense of the angles, each None if the kind of coordinates has none."""
    if not angular(meaning):
        return Angles()
    zero = meaning.vertical if meaning.kind == "spherical" else None
    return Angles(meaning.angle, zero, meaning.horizontal)


def uncertainties(values: Array, stated: str | None, unit: str) -> Array:
    """Convert uncertainties to the unit of the coordinates if their column states another one."""
    same = stated == unit or stated not in UNIT_WORDS.values()
    return values if same else in_unit(metres(values, str(stated)), unit)


def cartesian(numbers: Sequence[Array], meaning: Meaning) -> Array:
    """Cartesian coordinates [m] of three columns of numbers in a file, shape (n, 3).

    In Fortran order, because they are later used column by column.
    """
    out = np.empty((len(numbers[0]), 3), order="F")
    if meaning.kind == "cartesian":
        for k, column in enumerate(numbers):
            out[:, k] = metres(column, meaning.unit)
        return out
    si = _si(np.column_stack(numbers), meaning)
    radius, azimuth = si[:, 0], si[:, 1]
    reach, out[:, 2] = radius, si[:, 2]
    if meaning.kind == "spherical":
        level, up = _flat_and_up(si[:, 2], meaning)
        reach, out[:, 2] = radius * level, radius * up
    out[:, 0], out[:, 1] = reach * np.cos(azimuth), reach * np.sin(azimuth)
    return out


def raw(position: Array, meaning: Meaning) -> Array:
    """Convert Cartesian coordinates [m] to the numbers of a file, both shape (n, 3)."""
    if meaning.kind == "cartesian":
        return in_unit(position, meaning.unit)
    x, y, z = position.T
    reach, azimuth = np.hypot(x, y), np.arctan2(y, x)
    if meaning.kind == "cylindrical":
        return _from_si(np.column_stack([reach, azimuth, z]), meaning)
    vertical = np.arctan2(reach, z) if meaning.vertical == "zenith" else np.arctan2(z, reach)
    return _from_si(np.column_stack([np.hypot(reach, z), azimuth, vertical]), meaning)


def covariance(six: Array, values: Array, meaning: Meaning) -> Array:
    """Covariance of Cartesian coordinates [m^2] from that of the numbers in a file.

    C = J S C_file S J', where S converts to SI and J is the Jacobian of `cartesian`.

    Args:
        six: xx, xy, xz, yy, yz, zz in the units of the file, shape (n, 6).
        values: The numbers themselves, shape (n, 3).
        meaning: Their units and kind of coordinates.

    Returns:
        xx, xy, xz, yy, yz, zz [m^2], shape (n, 6).
    """
    if meaning.kind == "cartesian":
        return metres(metres(six, meaning.unit), meaning.unit)
    J = _jacobian(_si(values, meaning), meaning)
    scale = _from_si(np.ones((1, 3)), meaning)[0]
    C = symmetric(six) / np.multiply.outer(scale, scale)
    return flat(J @ C @ J.transpose(0, 2, 1))


def _si(values: Array, meaning: Meaning) -> Array:
    out = metres(values, meaning.unit)
    out[:, angular(meaning)] = plain_angles(values[:, angular(meaning)], meaning.angle) * _radians(
        meaning
    )
    return out


def _from_si(values: Array, meaning: Meaning) -> Array:
    out = in_unit(values, meaning.unit)
    out[:, angular(meaning)] = values[:, angular(meaning)] / _radians(meaning)
    return out


def of_angles(angle: str | None) -> dict[str, float]:
    """Factor from degrees, with minutes and seconds, to the unit of a column of angles.

    Packed degrees, minutes and seconds have none: no factor makes them of other degrees. Where the
    unit is not known, degrees stay degrees.
    """
    if angle is None:
        return {"deg": 1.0}
    return {"deg": _ANGLES["deg"] / _ANGLES[angle]} if angle in {*_ANGLES} - {PACKED} else {}


def plain_angles(values: Array, angle: str | None) -> Array:
    """Convert packed degrees, minutes and seconds to decimal degrees; keep other angles.

    Raises:
        InputError: One has 60 or more minutes or seconds.
    """
    if angle != PACKED:
        return values
    whole, minutes, seconds = _parts(values)
    beyond = (minutes >= _SIXTY) | (seconds >= _SIXTY)
    if beyond.any():
        raise InputError(
            f"the angle {values[beyond][0]:.10g} has more than 59 minutes or seconds behind the "
            "point",
            'write angle = "deg" (or "gon", "rad") into [tracker] of campaign.toml',
        )
    return np.sign(values) * (whole + (minutes + seconds / _SIXTY) / _SIXTY)


def _parts(values: Array) -> tuple[Array, Array, Array]:
    """Degrees, minutes and seconds of D.MMSS, without sign."""
    whole, rest = np.divmod(np.rint(np.abs(values) * _TICKS * 1e4), _TICKS * 1e4)
    minutes, seconds = np.divmod(rest, _TICKS * 1e2)
    return whole, minutes, seconds / _TICKS


def may_be_packed(values: Array) -> bool:
    """Whether all angles can be packed: none has 60 or more minutes or seconds after the point."""
    _, minutes, seconds = _parts(values)
    return bool(np.all((minutes < _SIXTY) & (seconds < _SIXTY)))


def seem_packed(values: Array) -> bool:
    """Whether angles are very probably packed degrees, minutes and seconds.

    By chance, any two decimals are valid minutes with probability 0.6, and the next two valid
    seconds with 0.6. Angles without decimals, and repeated decimals, carry no information.
    """
    fractions = np.unique(np.round(np.abs(values) % 1.0, 10))
    told = np.count_nonzero(fractions)
    return may_be_packed(values) and bool(_MAY_BE_BOTH**told < _BY_CHANCE)


_MAY_BE_BOTH, _BY_CHANCE = 0.6 * 0.6, 1e-3


def _radians(meaning: Meaning) -> Array:
    """Factor from the unit of each angle to rad, negative for azimuths that increase clockwise."""
    signs = [SENSES[meaning.horizontal], 1.0][: len(angular(meaning))]
    return _ANGLES[meaning.angle or "rad"] * np.array(signs)


def _flat_and_up(vertical: Array, meaning: Meaning) -> tuple[Array, Array]:
    """Horizontal and vertical component of a unit range."""
    sine, cosine = np.sin(vertical), np.cos(vertical)
    return (sine, cosine) if meaning.vertical == "zenith" else (cosine, sine)


def _jacobian(si: Array, meaning: Meaning) -> Array:
    """Jacobian of x, y, z with respect to the three numbers in SI, shape (n, 3, 3)."""
    radius, azimuth, third = si.T
    c, s, none = np.cos(azimuth), np.sin(azimuth), np.zeros(len(si))
    if meaning.kind == "cylindrical":
        rows = [[c, -radius * s, none], [s, radius * c, none], [none, none, none + 1.0]]
    else:
        level, up = _flat_and_up(third, meaning)
        turn = 1.0 if meaning.vertical == "zenith" else -1.0
        rows = [
            [level * c, -radius * level * s, turn * radius * up * c],
            [level * s, radius * level * c, turn * radius * up * s],
            [up, none, -turn * radius * level],
        ]
    return np.moveaxis(np.array(rows), 2, 0)


def settled(stated: str | None, said: str | None, what: str, example: str) -> str:
    """Reconcile what an export states with what campaign.toml says in [tracker].

    Args:
        stated: Value stated by the export, None if it does not.
        said: Value in campaign.toml, None if absent.
        what: Name of the quantity, for messages.
        example: The line to write into [tracker].

    Raises:
        InputError: Neither states it, or the two contradict each other.
    """
    if stated is None and said is None:
        raise InputError(
            f"the export does not say its {what}",
            f"write {example} into [tracker] of campaign.toml",
        )
    if stated and said and stated != said:
        raise InputError(
            f"the export says {stated} for its {what} but campaign.toml says {said}",
            f"remove {example.split(' =')[0]} from [tracker], it is for exports that do not say",
        )
    return stated or said or ""


def settled_unit(stated: str | None, hints: ExportSettings) -> str:
    """The unit of length stated by an export, otherwise by campaign.toml.

    Raises:
        InputError: Neither states it, or the two contradict each other.
    """
    return settled(stated, hints.unit, "unit of length", 'unit = "mm" (or "m", "in")')


def settled_angles(
    meaning: Meaning,
    stated: Angles,
    third: Array,
    hints: ExportSettings,
) -> Meaning:
    """Complete the meaning with unit, zero and sense of the angles, if there are any.

    Args:
        meaning: Unit and kind of coordinates.
        stated: What the export states about its angles.
        third: The third column of numbers, which may show where vertical angles are zero.
        hints: What campaign.toml says.

    Raises:
        InputError: Neither states it, or the two contradict each other.
    """
    if meaning.kind == "cartesian":
        return meaning
    angle = settled_angle(stated.unit, hints.angle)
    meaning = replace(meaning, angle=angle)
    if meaning.kind == "spherical":
        vertical = settled_vertical(stated.vertical, hints.vertical, third, angle)
        meaning = replace(meaning, vertical=vertical)
    return replace(meaning, horizontal=settled_horizontal(stated.horizontal, hints.horizontal))


def settled_angle(stated: str | None, said: str | None) -> str:
    """The unit of angles; if called degrees, it may have minutes and seconds after the point.

    Raises:
        InputError: Neither the export nor campaign.toml states it, or they contradict each other.
    """
    own = None if {stated, said} == {"deg", PACKED} else stated
    example = f'angle = "deg" (or "rad", "gon", "{PACKED}")'
    return settled(own, said, "unit of angles", example)


def settled_vertical(stated: str | None, said: str | None, values: Array, angle: str) -> str:
    """Whether vertical angles are measured from the zenith or from the horizon.

    If neither the export nor campaign.toml states it, the values may: zenith angles are never
    negative, elevations never above 90 degrees. Some programs call zenith angles elevations; if
    angles called elevations would point steeply upwards, campaign.toml must confirm it.

    Raises:
        InputError: It is not stated and the angles leave it open.
    """
    if stated == "elevation" and steeper_than_not(values, angle):
        stated = None
    elif stated is None and said is None and len(values):
        degrees = _degrees(values, angle)
        if degrees.min() < 0 and degrees.max() <= 90:
            return "elevation"
        if degrees.min() >= 0 and 90 < degrees.max() <= 180:
            return "zenith"
    what = 'vertical = "zenith" (or "elevation")'
    return settled(stated, said, "vertical angle's zero", what)


def settled_horizontal(stated: str | None, said: str | None) -> str:
    """Whether horizontal angles increase clockwise, as on a total station, or counter-clockwise.

    Titles follow conventions that a program may violate: campaign.toml takes precedence.

    Raises:
        InputError: Neither states it.
    """
    example = 'horizontal = "clockwise" (or "counter-clockwise")'
    return settled(None if said else stated, said, "sense of horizontal angles", example)


def _degrees(values: Array, angle: str) -> Array:
    return np.rad2deg(plain_angles(values, angle) * _ANGLES[angle])


def second_face(vertical: Array, meaning: Meaning) -> Bools:
    """Which vertical angles occur only in the second face (telescope plunged), shape (n,)."""
    circle = 2 * np.pi
    zenith = np.deg2rad(_degrees(vertical, meaning.angle or "rad"))
    if meaning.vertical == "elevation":
        zenith = circle / 4 - zenith
    return np.asarray(zenith % circle > circle / 2)


def steeper_than_not(values: Array, angle: str) -> bool:
    """Whether angles read as elevations would mostly be steeper than read as zenith angles."""
    degrees = _degrees(values, angle)
    if not len(degrees) or degrees.min() < 0:
        return False
    return bool(np.median(np.abs(degrees)) > np.median(np.abs(90.0 - degrees)))
