"""What others call the columns of a log: our name for each title, with the unit it states."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence

_WORDS = re.compile(r"[^\W\d_]+|[0-9]+|°")
_CALLED = {
    "pose": {
        "pose", "stellung", "messpose", "posenummer", "configuration", "konfiguration", "position",
        "pos", "messposition",
    },
    "repeat": {
        "repeat", "zug", "wiederholung", "wdh", "pull", "step", "load step", "laststufe",
        "répétition", "palier",
    },
    "force": {
        "f", "force", "kraft", "istkraft", "messkraft", "zugkraft", "last", "load", "federwaage",
        "waage", "dynamometer",
    },
    "branch": {
        "branch", "ast", "richtung", "direction", "lastrichtung", "belastungsrichtung",
        "load direction", "direction of load", "verlauf", "sens",
    },
    "remark": {
        "remark", "remarks", "bemerkung", "bemerkungen", "kommentar", "anmerkung", "notiz",
        "comment", "comments", "note", "notes", "remarque", "remarques",
    },
    "mass": {"mass", "masse", "gewicht", "weight"},
    "rail": {
        "rail", "track", "linear axis", "linear unit", "lineareinheit", "linearachse", "schiene",
        "fahrachse", "verfahrachse",
    },
}  # fmt: skip
_AXIS = re.compile(r"(?:axis|achse|joint|gelenk|ax|a|j) ?0*([1-9])|e ?1")
_MOVED = re.compile(r"(axis|achse|joint|gelenk|ax|a|j|theta)[ _]?0*([1-9])(?![0-9])")
_OF_A_POINT = 3
"""Coordinates."""
_NUMBERED = {"nr", "no", "number", "nummer"}
"""Words beside a name that say no more than that it is a number."""
_UNIT = {"°": "deg", "grad": "deg", "degree": "deg", "degrees": "deg", "kp": "kgf"}
"""Units that our columns call otherwise."""


def has_poses(titles: Sequence[str]) -> bool:
    """Whether a column numbers poses, as one of every log does, and none are coordinates."""
    axes = {word for title in titles for word in _WORDS.findall(title.lower())[:1]}
    return not {"x", "y", "z"} <= axes and bool(_first(titles, {"pose": ()}))


def axes_without_pose(titles: Sequence[str]) -> list[str]:
    """The titles of a robot's axes, A1, A2, A3, A4 ..., where no column numbers poses; else none.

    They are more than the three coordinates of a point, of one word and numbered from 1 on.
    """
    if _first(titles, {"pose": ()}):
        return []
    found: dict[str, list[tuple[int, str]]] = {}
    for title in titles:
        if one := _MOVED.match(title.lower()):
            found.setdefault(one[1], []).append((int(one[2]), title))
    for axes in found.values():
        first = axes[0][0]
        in_turn = [number for number, _ in axes] == [*range(first, first + len(axes))]
        if in_turn and first <= 2 and len(axes) > _OF_A_POINT:  # theta1 is the rail to some
            return [title for _, title in axes]
    return []


def of_loads(titles: Sequence[str], units: Mapping[str, Sequence[str]]) -> dict[str, str] | None:
    """Our names for the titles of a log of loads, None where it is none.

    Args:
        titles: As written.
        units: Those that `force` and `mass` may have.

    Returns:
        Of a title that does not state its unit all our names for it, with bars between them.
    """
    roles = ("pose", "repeat", "branch", "remark", *units)
    found = _first(titles, {role: units.get(role, ()) for role in roles})
    return _ours(found) if "pose" in found and found.keys() & units.keys() else None


def pose_alone(titles: Sequence[str]) -> dict[str, str] | None:
    """Our name for the title that numbers poses, None where there is none."""
    return _ours(_first(titles, {"pose": ()})) if has_poses(titles) else None


def in_order(titles: Sequence[str]) -> bool:
    """Whether the numbers in titles, where all have one, do not run against their order."""
    found = [re.findall("[0-9]+", title) for title in titles]
    return not all(found) or len(titles) == 1 or _rises([int(one[-1]) for one in found])


def stated_unit(title: str, units: Sequence[str]) -> Sequence[str]:
    """The one of some units in which a title ends, all of them where it ends in none."""
    last = _WORDS.findall(title.lower())[-1:]
    own = [unit for unit in units if [unit] == [_UNIT.get(word, word) for word in last]]
    return own or units


def _rises(numbers: Sequence[int]) -> bool:
    return len({*numbers}) == 1 or all(a < b for a, b in itertools.pairwise(numbers))


def of_joints(
    titles: Sequence[str],
    axes: Sequence[str],
    lengths: Sequence[bool],
    units: tuple[Sequence[str], Sequence[str]],
) -> dict[str, str] | None:
    """Our names for the titles of a joint log, None where one of the axes is not among them.

    Args:
        titles: As written.
        axes: Our names of the axes without units; those that turn are numbered from 1.
        lengths: Which of them slide.
        units: Those of lengths, and those of angles.

    Returns:
        As of loads.
    """
    turn = [name for name, length in zip(axes, lengths, strict=True) if not length]
    called = {f"axis {k}": name for k, name in enumerate(turn, 1)}
    called |= dict(zip(["rail"], (name for name in axes if name not in turn), strict=False))
    others = ("rail", f"axis {len(turn) + 1}")  # of another robot, where this one has none
    wanted = {role: units[role != "rail"] for role in (*called, *others)}
    found = _first(titles, {"pose": (), **wanted})
    if found.keys() != {"pose", *called} or len(called) < len(axes):
        return None
    return _ours({called.get(role, role): said for role, said in found.items()})


def _first(
    titles: Sequence[str], wanted: Mapping[str, Sequence[str]]
) -> dict[str, tuple[str, Sequence[str]]]:
    """The first title of each role and its unit; all its units where no title of it states one.

    Args:
        titles: As written.
        wanted: The units of each role, empty where it has none.
    """
    found: dict[str, tuple[str, Sequence[str]]] = {}
    for title in titles:
        words = [word for word in _WORDS.findall(title.lower()) if word not in _NUMBERED]
        unit = _UNIT.get(words[-1], words[-1]) if words else ""
        for role, units in wanted.items():
            if unit in units and _is(" ".join(words[:-1]), role):
                if len(found.get(role, ("", ()))[1]) != 1:
                    found[role] = title, (unit,)
            elif _is(" ".join(words), role):
                found.setdefault(role, (title, units))
    return found


def _is(stem: str, role: str) -> bool:
    axis = _AXIS.fullmatch(stem)
    if axis:
        return role == (f"axis {axis[1]}" if axis[1] else "rail")
    return stem in _CALLED.get(role, ())


def _ours(found: Mapping[str, tuple[str, Sequence[str]]]) -> dict[str, str]:
    """Our names by title, of those that need one."""
    ours = {title: "|".join(f"{name}_{unit}" for unit in units) or name
            for name, (title, units) in found.items()}  # fmt: skip
    return {title: name for title, name in ours.items() if title.lower() != name.lower()}
