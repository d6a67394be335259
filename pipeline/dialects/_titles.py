"""Interpret the titles of a table together: names, times, and triples of coordinates."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from pipeline.base.errors import InputError
from pipeline.dialects._cells import IN_BRACKETS
from pipeline.dialects._coordinates import AXES, VERTICALS
from pipeline.dialects._named import DEVIATION, FOREIGN, Named, in_context, named
from pipeline.dialects._unit_words import ANGLE_WORDS, UNIT_WORDS
from pipeline.readers._text import shortened

_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_WORDS = re.compile(r"[^\W\d_]+|[0-9]+")
_ROLES = {
    "target": (
        "messpunkt", "punktnummer", "punkt nr", "punktnr", "punkt no", "point no", "point number",
        "pt", "pkt", "ziel", "zielpunkt", "label", "marker", "id", "nr", "no", "nummer", "number",
        "punkt name", "punktbezeichnung", "bezeichnung", "pointno", "target id", "smr",
        *FOREIGN["titles"]["target"],
    ),
    "group": (
        "serie", "series", "gruppenname", "punktgruppe", "set", "round", "runde", "satz", "pose",
        "messung", "epoch", "epoche", "durchgang", *FOREIGN["titles"]["group"],
    ),
    "collection": ("sammlung",),
    "instrument": ("instrument", "station", "instrument name", "station name", "standpunkt"),
    "time": ("zeit", "datum zeit", "zeitstempel", "messzeit", "date time", "measured at",
             "horodatage", "date heure", "data ora", "fecha hora", *FOREIGN["titles"]["time"]),
    "clock": ("uhrzeit", "clock", "time of day", "heure", "ora", "hora"),
    "date": ("datum", "day", "data", "fecha", "jour"),
    "active": ("active", "aktiv", "use", "used", "valid", "gültig", "enabled"),
    "azimuth": (
        "hz", "hz angle", "horizontal angle", "horizontal", "azimut", "hz winkel",
        "horizontalwinkel", "richtung", "hr", "ha", "hl", "hor", "hor angle",
        *FOREIGN["titles"]["azimuth"],
    ),
    "vertical": ("v", "vz", "vertical angle", "vertical", "v angle", "v winkel", "va",
                 "vertikalwinkel", "vert", "vert angle"),
    "zenith": ("zenit", "zenith angle", "zenitwinkel", "zenitdistanz", "zenith distance", "za",
               "vz zenith", *FOREIGN["titles"]["zenith"]),
    "elevation": ("elevation angle", "elev", "höhenwinkel"),
    "range": ("slope distance", "sd", "dist", "strecke", "schrägstrecke", "s", "entfernung",
              *FOREIGN["titles"]["range"]),
    "x": ("easting", "east", "rechtswert", "ost", "e"),
    "y": ("northing", "north", "hochwert", "nord", "n"),
    "height": ("height", "up", "höhe", "hoehe", "h"),
}  # fmt: skip
_ROLE_OF = {title: role for role, titles in _ROLES.items() for title in titles}
_LETTERS = ("x", "y", "z")
_SHORT_OF_A_DISTANCE = {"hd", "horizontaldistanz", "horizontalstrecke", "horizontalentfernung"}
"""Names of horizontal distances, which are not slope ranges."""
_LEVEL = {"horizontal", "horizontale", "horiz", "hor", "h", "level", "reduced", "reduziert"}
_DISTANCE = {"distance", "dist", "distanz", "strecke", "entfernung", "abstand"}
_PLAIN = {
    "coordinate", "coord", "koordinate", "pos", "position", "value", "actual", "act", "measured",
    "measurement", "meas", "ist", "gemessen", "messwert", "point", "punkt", "cartesian", "xyz",
    "global", "observed", *FOREIGN["measured"]["words"],
}  # fmt: skip
"""Words that may accompany x, y, z of measured coordinates."""
_OTHERS = {
    "d", "delta", "dev", "deviation", "diff", "difference", "error", "err", "residual", "res", "v",
    "abweichung", "offset", "correction", "n", "normal", "r", "rot", "rotation", "q", "quat", "f",
    "force", "a", "u", "std", "stddev", "sigma", "uncertainty", "sd", "unc", "standard", "s", "i",
    "c", "cov", "vel", "velocity", "speed", "w", "omega", "m", "moment", "torque", "t",
}  # fmt: skip
"""Words that make x, y, z something other than coordinates."""
_NOMINAL = {
    "nominal", "nom", "goal", "soll", "cmd", "command", "commanded", "setpoint", "ref", "reference",
    "desired", "expected", "cad", "design", "theoretical", "planned", "target",
}  # fmt: skip
"""Words for coordinates that are nominal, not measured."""
_STD = {"std", "stddev", "sigma", "uncertainty", "unc", "standard", "deviation", "sd", "dev"}


@dataclass(frozen=True)
class Triple:
    """Three columns that may be the coordinates of a point.

    Attributes:
        kind: As in `AXES`.
        columns: Column indices, counted from 0, in the order of `AXES`.
        roles: Role of each; of a vertical angle `vertical`, `zenith` or `elevation`.
        plain: Whether nothing in their titles suggests that they are anything else.
        nominal: Whether their titles mark them as nominal.
    """

    kind: str
    columns: tuple[int, int, int]
    roles: tuple[str, str, str]
    plain: bool
    nominal: bool = False


def titled(titles: Sequence[str]) -> tuple[Named, ...]:
    """Interpret every column by its title, including the common words of other programs."""
    found = _turned([_known(named(title)) for title in titles])
    return _heights(in_context(found))


def _known(one: Named) -> Named:
    words = _words(one.title)
    other = _ROLE_OF.get(" ".join(words), "")
    if _is_level_distance(one.title):
        return replace(one, role="")
    return one if one.role and not other else replace(one, role=other or one.role)


def _turned(columns: Sequence[Named]) -> list[Named]:
    """Rename the axes of a surveying system whose x points north to right-handed ones.

    A letter beside `north`, as in `X (North)`, is the convention of the file, not ours; this
    applies only if one column is the northing and one the easting, since `X (N)` alone is a force.
    """
    selected = [_direction(column.title) for column in columns]
    if sorted(one for one in selected if one in ("x", "y")) != ["x", "y"]:
        return list(columns)
    pairs = zip(columns, selected, strict=True)
    return [replace(column, role=one) if one else column for column, one in pairs]


def _direction(title: str) -> str:
    """Axis that a title names by direction, with or without a letter; empty if there is none."""
    words = [one for one in _WORDS.findall(_CAMEL.sub(" ", title).lower()) if one not in _LETTERS]
    while len(words) > 1 and words[-1] in UNIT_WORDS:
        words.pop()
    role = _ROLE_OF.get(" ".join(words), "")
    return {"x": "x", "y": "y", "height": "z"}.get(role, "")


def _is_level_distance(title: str) -> bool:
    """Whether a title is that of a horizontal distance, which is not a slope range."""
    words = _words(title)
    flat = {*words} & _LEVEL or {"2", "d"} <= {*words}
    return bool(flat and {*words} & _DISTANCE) or " ".join(words) in _SHORT_OF_A_DISTANCE


def no_level_range(titles: Iterable[str]) -> None:
    """Check that no horizontal distance is used as the range of spherical coordinates.

    Raises:
        InputError: One is.
    """
    level = next(filter(_is_level_distance, titles), None)
    if level is not None:
        raise InputError(
            f'column "{shortened(level)}" is a horizontal distance, and no range',
            "export the slope distance beside the angles, or x, y and z",
        )


def _heights(columns: Sequence[Named]) -> tuple[Named, ...]:
    """Treat a height or an elevation as z if there are x and y."""
    roles = [column.role for column in columns]
    level = {"x", "y"} <= {*roles} and "z" not in roles and "azimuth" not in roles
    as_z = ("height", "elevation") if level else ()
    return tuple(
        replace(c, role="z" if c.role in as_z else "") if c.role in ("height", *as_z) else c
        for c in columns
    )


def _words(title: str) -> list[str]:
    """Words of a title in lower case, without units."""
    words = _WORDS.findall(IN_BRACKETS.sub(" ", _CAMEL.sub(" ", title)).lower())
    while len(words) > 1 and words[-1] in {*UNIT_WORDS, *ANGLE_WORDS, "dms"}:
        words.pop()
    return words


_RIGHT = {"hz", "horizontal", "horizontalwinkel", "richtung", "hr", "ha"}
"""Words for a surveyor's horizontal angle, which increases clockwise like the circle of a total
station: HR means clockwise (right), HL counter-clockwise (left)."""
_LEFT = {"theta", "phi", "left", "links", "hl"}
"""Words for an angle from x towards y, as in spherical coordinates according to ISO 80000-2."""


def horizontal(columns: Sequence[Named], place: int | None = None) -> str | None:
    """Sense of azimuths according to the titles of a table, None if they leave it open.

    An azimuth alone may be that of a tracker or of a compass; in files of SpatialAnalyzer, the only
    program that writes collections, it is that of a tracker.

    Args:
        columns: All columns of the table.
        place: Index of the azimuth column, None for the column with that role.
    """
    roles = [column.role for column in columns]
    if place is None:
        place = roles.index("azimuth") if "azimuth" in roles else None
    words = set() if place is None else {*_words(columns[place].title)}
    collected = any("collection" in (c.role, c.title.lower()) for c in columns)
    left = bool(words & _LEFT) or collected
    right = bool(words & _RIGHT) and not words & _LEFT  # horizontal, left
    if left == right:
        return None
    return "counter-clockwise" if left else "clockwise"


def triples(columns: Sequence[Named]) -> list[Triple]:
    """Triples of columns that may be coordinates of a point, those plainly called so first."""
    found = [*_polar(columns), *_cartesian(columns)]
    called = [one for one in found if one.plain]
    rest = [one for one in found if not one.plain and not (called and one.nominal)]
    return [*called, *rest]


def name_a_place(cells: Sequence[str] | None) -> bool:
    """Whether the cells of a line are titles that include three coordinates."""
    return cells is not None and sum(map(bool, cells)) > 2 and _place(tuple(cells))


@lru_cache(maxsize=1024)  # a corrupt file may repeat a few lines a million times
def _place(titles: tuple[str, ...]) -> bool:
    return bool(triples(titled(titles)))


def _cartesian(columns: Sequence[Named]) -> Iterator[Triple]:
    """Columns of x, y and z whose titles otherwise agree, from left to right."""
    sets: dict[tuple[str, ...], dict[str, list[int]]] = {}
    surveyed = _surveyed(columns)
    for place, column in enumerate(columns):
        axis, stem = (column.role, ()) if place in surveyed else _axis(column)
        if axis:
            sets.setdefault(stem, {}).setdefault(axis, []).append(place)
    for stem, axes in sets.items():
        if {*axes} != {"x", "y", "z"} or {*stem} & _OTHERS:
            continue
        plain, nominal = {*stem} <= _PLAIN, bool({*stem} & _NOMINAL)
        for x, y, z in zip(*(axes[axis] for axis in "xyz"), strict=False):
            yield Triple("cartesian", (x, y, z), AXES["cartesian"], plain, nominal)


def _surveyed(columns: Sequence[Named]) -> list[int]:
    """Columns of easting, northing and height, if the first two are the only x and y.

    N alone may mean a normal, and beside other x and y it is not a northing.
    """
    level = [place for place, column in enumerate(columns) if column.role in ("x", "y")]
    if sorted(_direction(columns[place].title) for place in level) != ["x", "y"]:
        return []
    height = [place for place, column in enumerate(columns) if column.role == "z"]
    return [*level, *(place for place in height if _direction(columns[place].title))]


def _polar(columns: Sequence[Named]) -> list[Triple]:
    """Triples of spherical and of cylindrical coordinates.

    Theta and phi mean azimuth and zenith angle in some conventions, the reverse in others.
    """
    roles = [column.role for column in columns]
    at = {role: place for place, role in reversed([*enumerate(roles)])}
    if not {"range", "azimuth"} <= at.keys():
        return []
    vertical = next((role for role in VERTICALS if role in at), None)
    if vertical:
        three = ("range", "azimuth", vertical)
        far, across, up = _three(at, three)
        either = vertical == "vertical" and {*_words(columns[across].title)} == {"theta"}
        places = [(far, across, up), (far, up, across)][: 1 + either]
        return [Triple("spherical", one, three, True) for one in places]
    level = ("range", "azimuth", "z")
    flat = "z" in at and "x" not in at
    return [Triple("cylindrical", _three(at, level), level, True)] if flat else []


def _three(at: dict[str, int], roles: tuple[str, str, str]) -> tuple[int, int, int]:
    first, second, third = (at[role] for role in roles)
    return first, second, third


def _axis(column: Named) -> tuple[str, tuple[str, ...]]:
    """Axis in a title and its other words; empty if absent or if the column has another role."""
    if column.role and column.role not in "xyz":
        return "", ()
    words = _words(column.title)
    if column.role:
        return column.role, tuple(word for word in words if word in _OTHERS)
    axes = [word for word in words if word in ("x", "y", "z")]
    if len(axes) != 1:
        return "", ()
    return axes[0], tuple(word for word in words if word != axes[0])


def numbered(columns: Sequence[Named]) -> list[str]:
    """Words that distinguish the titles of triples if these differ only in a number; else empty."""
    stems = [_axis(column)[1] for column in columns]
    same = {tuple(word for word in stem if not word.isdecimal()) for stem in stems}
    alike = len(same) == 1 and () not in same
    return ["".join(stem) for stem in stems] if alike else [""] * len(stems)


def is_quantity(title: str) -> bool:
    """Whether a title above x, y, z names a quantity rather than a point."""
    return {*_words(title)} <= _PLAIN | _NOMINAL | _OTHERS | {"orientation", "translation"}


def uncertainties(columns: Sequence[Named], triple: Triple) -> dict[int, str]:
    """Roles of the columns with uncertainties of a Cartesian triple, by column index.

    Of several sets, the one with the same words as the coordinates is used: `measurement_std_x` for
    `measurement_x`.
    """
    stem = {*_axis(columns[triple.columns[0]])[1]}
    found: dict[int, str] = {}
    for place, column in enumerate(columns):
        words = _words(column.title)
        axes = [word for word in words if word in ("x", "y", "z")]
        others = {*words} - {*axes}
        if column.role.startswith(("std ", "u95 ")) and others - stem <= {*"ux"} | _STD | {"95"}:
            found[place] = column.role
        elif len(axes) == 1 and others & _STD - DEVIATION and others - _STD == stem:
            found[place] = f"std {axes[0]}"
    return _of_space(found) if _all(found, "std") or _all(found, "u95") else {}


def _of_space(found: dict[int, str]) -> dict[int, str]:
    return {place: role for place, role in found.items() if role.split(" ")[1] in "xyz"}


def _all(found: dict[int, str], kind: str) -> bool:
    """Whether each axis has exactly one uncertainty of a kind."""
    return sorted(r for r in found.values() if r.startswith(kind)) == [f"{kind} {a}" for a in "xyz"]
