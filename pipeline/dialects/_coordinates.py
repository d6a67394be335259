"""What the angles of a reading mean, in Cartesian coordinates, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base.arrays import Array, Bools
from pipeline.base.covariance import flat, symmetric
from pipeline.base.errors import InputError
from pipeline.readers._reader import Meaning
from pipeline.readers._units import UNIT_WORDS, in_unit, metres
from pipeline.readers.said import Hints

PACKED = "dms"
"""Degrees with minutes and seconds behind the point: 123.4512 is 123 degrees, 45 minutes, 12
seconds, as total stations and surveyors' calculators write."""
_ANGLES = {"deg": np.pi / 180.0, "rad": 1.0, "gon": np.pi / 200.0, PACKED: np.pi / 180.0}
"""Units of angles [rad]."""
_TICKS, _SIXTY = 1e6, 60.0
"""Parts of a second that are kept, 5e-12 rad; minutes and seconds."""
AXES = {
    "cartesian": ("x", "y", "z"),
    "spherical": ("range", "azimuth", "vertical"),
    "cylindrical": ("range", "azimuth", "z"),
}
"""What the three numbers are, by kind of coordinates."""
KIND_WORDS = {kind: kind for kind in AXES} | {"polar": "spherical", "kartesisch": "cartesian"}

ZEROS = ("zenith", "elevation")
"""Where vertical angles may be zero: straight up, or level."""
VERTICALS = ("vertical", *ZEROS)
"""What titles call a vertical angle; the first leaves open where it is zero."""
ANGULAR = {"cartesian": [], "spherical": [1, 2], "cylindrical": [1]}
"""Which of the three numbers are angles, by kind of coordinates."""


SENSES = {"counter-clockwise": 1.0, "clockwise": -1.0}
"""Ways in which azimuths grow, seen from above, and the sign of a turn from x towards y."""


@dataclass(frozen=True)
class Angles:
    """What is said of angles, each None where nothing is.

    Attributes:
        unit: As `Meaning.angle`.
        vertical: As `Meaning.vertical`.
        horizontal: As `Meaning.horizontal`.
    """

    unit: str | None = None
    vertical: str | None = None
    horizontal: str | None = None


def angular(meaning: Meaning) -> list[int]:
    """Which of the three numbers are angles."""
    return ANGULAR[meaning.kind]


def angles(meaning: Meaning) -> Angles:
    """Unit, zero and sense of its angles, each None where coordinates of its kind have none."""
    if not angular(meaning):
        return Angles()
    zero = meaning.vertical if meaning.kind == "spherical" else None
    return Angles(meaning.angle, zero, meaning.horizontal)


def uncertainties(values: Array, stated: str | None, unit: str) -> Array:
    """Uncertainties of a column that may state another unit, in the unit of the coordinates."""
    same = stated == unit or stated not in UNIT_WORDS.values()
    return values if same else in_unit(metres(values, str(stated)), unit)


def cartesian(numbers: Sequence[Array], meaning: Meaning) -> Array:
    """Cartesian coordinates [m] of three columns of numbers in a file, shape (n, 3).

    In Fortran order: whole columns are what is wanted later.
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
    """The numbers that a file would have for Cartesian coordinates [m], both shape (n, 3)."""
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

    C = J S C_file S J', with S to SI and J the derivative of `cartesian`.

    Args:
        six: xx, xy, xz, yy, yz, zz in the units of the file, shape (n, 6).
        values: The numbers themselves, shape (n, 3).

    Returns:
        Shape (n, 6).
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


def plain_angles(values: Array, angle: str | None) -> Array:
    """Angles in their unit, those with minutes and seconds behind the point in degrees.

    Raises:
        InputError: One has more minutes or seconds than there are.
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
    """Degrees, minutes and seconds of D.MMSS without their signs."""
    whole, rest = np.divmod(np.rint(np.abs(values) * _TICKS * 1e4), _TICKS * 1e4)
    minutes, seconds = np.divmod(rest, _TICKS * 1e2)
    return whole, minutes, seconds / _TICKS


def may_be_packed(values: Array) -> bool:
    """Whether no angle has more minutes or seconds behind the point than there are."""
    _, minutes, seconds = _parts(values)
    return bool(np.all((minutes < _SIXTY) & (seconds < _SIXTY)))


def seem_packed(values: Array) -> bool:
    """Whether so many angles have minutes and seconds behind the point as no chance leaves.

    Of any two decimals six in ten may be minutes, of the next two six in ten seconds. Angles with
    nothing behind the point, or with the same as another, say nothing.
    """
    fractions = np.unique(np.round(np.abs(values) % 1.0, 10))
    told = np.count_nonzero(fractions)
    return may_be_packed(values) and bool(_MAY_BE_BOTH**told < _BY_CHANCE)


_MAY_BE_BOTH, _BY_CHANCE = 0.6 * 0.6, 1e-3


def _radians(meaning: Meaning) -> Array:
    """Of one unit of each angle [rad], azimuths that grow clockwise with a minus."""
    signs = [SENSES[meaning.horizontal], 1.0][: len(angular(meaning))]
    return _ANGLES[meaning.angle or "rad"] * np.array(signs)


def _flat_and_up(vertical: Array, meaning: Meaning) -> tuple[Array, Array]:
    """Horizontal and vertical share of the range."""
    sine, cosine = np.sin(vertical), np.cos(vertical)
    return (sine, cosine) if meaning.vertical == "zenith" else (cosine, sine)


def _jacobian(si: Array, meaning: Meaning) -> Array:
    """Derivative of x, y, z by the three numbers in SI, shape (n, 3, 3)."""
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
    """What an export states itself, else what campaign.toml says in [tracker].

    Args:
        stated: By the export, None where it does not.
        said: By campaign.toml, None where it does not.
        what: What it is, for messages.
        example: The line to write into [tracker].

    Raises:
        InputError: Nobody says, or the two contradict each other.
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


def settled_angle(stated: str | None, said: str | None) -> str:
    """The unit of angles; one that is called degrees may have minutes behind the point.

    Raises:
        InputError: Nobody says, or the two contradict each other.
    """
    own = None if {stated, said} == {"deg", PACKED} else stated
    example = f'angle = "deg" (or "rad", "gon", "{PACKED}")'
    return settled(own, said, "unit of angles", example)


def settled_vertical(stated: str | None, said: str | None, values: Array, angle: str) -> str:
    """Whether vertical angles count from the zenith or from the horizon.

    Where nobody says it, the angles may: below 0 there is no zenith angle, above 90 degrees no
    elevation. Programs call zenith angles elevations; what is called one and would look steeply
    upwards is believed only where somebody confirms it.

    Raises:
        InputError: Nobody says and the angles leave it open.
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
    """Whether horizontal angles grow clockwise, as a total station's, or counter-clockwise.

    Titles follow a habit of the trade that a program may break: campaign.toml goes before it.

    Raises:
        InputError: Nobody says.
    """
    example = 'horizontal = "clockwise" (or "counter-clockwise")'
    return settled(None if said else stated, said, "sense of horizontal angles", example)


def _degrees(values: Array, angle: str) -> Array:
    return np.rad2deg(plain_angles(values, angle) * _ANGLES[angle])


def second_face(vertical: Array, meaning: Meaning) -> Bools:
    """Which vertical angles only a plunged telescope has, shape (n,)."""
    circle = 2 * np.pi
    zenith = np.deg2rad(_degrees(vertical, meaning.angle or "rad"))
    if meaning.vertical == "elevation":
        zenith = circle / 4 - zenith
    return np.asarray(zenith % circle > circle / 2)


def steeper_than_not(values: Array, angle: str) -> bool:
    """Whether angles, read as elevations, lie farther from the horizon than as zenith angles."""
    degrees = _degrees(values, angle)
    if not len(degrees) or degrees.min() < 0:
        return False
    return bool(np.median(np.abs(degrees)) > np.median(np.abs(90.0 - degrees)))
