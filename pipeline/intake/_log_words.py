"""Column titles of foreign logs: our name for each title, with the unit it states."""

from __future__ import annotations

import itertools
import re
import tomllib
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from operator import itemgetter
from unicodedata import combining, normalize

from pipeline.dialects._cells import IN_BRACKETS, from_above, is_number
from pipeline.dialects._titles import titled, triples
from pipeline.intake._contents import is_count
from pipeline.readers.logs import SI, pose_and_repeat

SampledCells = Callable[[], Mapping[str, Sequence[str]]]
"""Returns the cells of each column by title, of the rows that have one cell per title."""

_WORDS = re.compile(r"[^\W\d_]+|[0-9]+|°")
_LETTERS = re.compile(r"[^\W\d_]+")
_NUMBER_SIGN = re.compile(r"\bn[°º]|№|#", re.IGNORECASE)
_MOVED = re.compile(r"(axis|achse|joint|gelenk|ax|a|j|theta)[ _]?0*([1-9])(?![0-9])")
_OF_A_POINT = 3
"""Number of coordinates of a point."""


@dataclass(frozen=True)
class _Known:
    """The words of `titles.toml`."""

    called: dict[str, frozenset[str]]
    numbered: re.Pattern[str]
    named: tuple[tuple[str, ...], ...]
    number: frozenset[str]
    beside: frozenset[str]
    between: frozenset[str]
    unit: dict[str, str]
    unloaded: tuple[str, ...]
    scales: frozenset[str]


@cache
def _known() -> _Known:
    content = tomllib.loads((resources.files(__package__) / "titles.toml").read_text("utf-8"))
    axes = content["axes"]
    return _Known(
        called={role: _with_plain(words) for role, words in content["words"].items()},
        numbered=re.compile(f"(?:{'|'.join(axes['numbered'])}) ?0*([1-9])"),
        named=tuple(tuple(one["of"]) for one in axes["named"]),
        number=frozenset(content["number"]),
        beside=frozenset(content["beside"]),
        between=frozenset(content["between"]),
        unit=content["unit"],
        unloaded=tuple(content["states"]["unloaded"]),
        scales=_with_plain(content["scales"]),
    )


def _with_plain(words: Sequence[str]) -> frozenset[str]:
    """Words with and without their accents, as people type them."""
    parted = (normalize("NFKD", word.translate(_NO_PARTS)) for word in words)
    return frozenset(words) | {"".join(c for c in one if not combining(c)) for one in parted}


_NO_PARTS = str.maketrans("łøđı", "lodi")
"""Letters whose accent is no sign of its own."""


def is_unloaded(word: str) -> bool:
    """Whether a word in the name of a group says that nothing pulls, in some language."""
    letters = " ".join(_LETTERS.findall(word.lower()))
    return letters in _known().unloaded


def may_be_log(titles: Sequence[str], cells: SampledCells, units: Sequence[str]) -> bool:
    """Whether the titles may be those of a log.

    A column numbers poses or is a force, and none are coordinates; or there are many axes.

    Args:
        titles: As written.
        cells: Cells below them.
        units: Those of forces.
    """
    if called_axes(titles, dict):
        return True
    found = _first(titles, {"pose": (), "force": units})
    forces = _by_unit(titles, units) or _of_pulls(titles, units)
    if _coordinates(titles):
        return False
    return bool(found or forces or _by_unit_column({}, cells, units, by_scale=True))


def names_a_force(titles: Sequence[str], units: Sequence[str]) -> bool:
    """Whether a title is a force, or has a unit that only forces have, or several are of pulls."""
    named = "force" in _first(titles, {"force": units})
    return bool(named or _by_unit(titles, units) or _of_pulls(titles, units))


def called_axes(titles: Sequence[str], _: SampledCells) -> dict[str, str] | None:
    """The titles of axes, if they are more than the coordinates of a point; else None."""
    axes = _axes(titles)
    found = [title for title in titles if {title.lower(), *_bare([title])} & axes.keys()]
    return {one: one for one in found} if len(found) > _OF_A_POINT else None


def _coordinates(titles: Sequence[str]) -> bool:
    """Whether titles name the coordinates of a point."""
    axes = {word for title in titles for word in _WORDS.findall(title.lower())[:1]}
    return {"x", "y", "z"} <= axes or bool(triples(titled(titles)))


def axes_without_pose(titles: Sequence[str]) -> list[str]:
    """The titles of a robot's axes, A1, A2, A3, A4 ..., where no column numbers poses; else none.

    They are more than the three coordinates of a point, consist of one word and are numbered from
    1.
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
        if in_turn and first <= 2 and len(axes) > _OF_A_POINT:  # for some, theta1 is the rail
            return [title for _, title in axes]
    return []


def of_loads(
    titles: Sequence[str],
    cells: SampledCells,
    units: Mapping[str, Sequence[str]],
    by_scale: bool = False,
) -> dict[str, str] | None:
    """Our names for the titles of a log of loads, None if it is not one.

    A force may also be the only column with a unit that only forces have, `Load` the number of a
    pull, and the forces of a pose may stand in one row; poses and pulls may be the columns of whole
    numbers, poses in the one that changes less often.

    Args:
        titles: As written.
        cells: Cells below them.
        units: Possible units of `force` and `mass`.
        by_scale: Whether its heading names a scale, so that kg alone are what that shows.

    Returns:
        Our name by title; for a title that does not state its unit all possible names, separated by
        bars.
    """
    roles = ("pose", "repeat", "branch", "remark", *units)
    found = _first(titles, {role: units.get(role, ()) for role in roles})
    each = _of_pulls(titles, units["force"])
    found = {role: one for role, one in found.items() if one[0] not in dict(each.values())}
    found = _without_records(found, cells)
    found |= _by_unit_column(found, cells, units["force"], by_scale)
    found |= {} if found.keys() & {"repeat", *units} else each
    if not found.keys() & {*units, *each}:
        found |= _by_unit(titles, units["force"]) or (_of_a_scale(titles) if by_scale else {})
    if not found.keys() & {*units, *each} or _coordinates(titles):
        return None
    return _with_numbers(found, cells, each)


def _without_records(
    found: dict[str, tuple[str, Sequence[str]]], cells: SampledCells
) -> dict[str, tuple[str, Sequence[str]]]:
    """The roles without a force that numbers records."""
    title, _ = found.get("force", ("", ()))
    records = bool(title) and _counts_on_slowly(cells().get(title, ()))
    return {role: one for role, one in found.items() if role != "force" or not records}


def _counts_on_slowly(own: Sequence[str]) -> bool:
    """Whether numbers are those of records, whole and rising by few: `lectura n` is no force."""
    numbers = [int(one) for one in own if is_count(one)]
    steps = [b - a for a, b in itertools.pairwise(numbers)]
    return len(numbers) == len(own) > _FEW and all(0 < one <= _FEW for one in steps)


_FEW = 3
"""Number of records that may be left out between two pulls [1]."""


def _with_numbers(
    found: dict[str, tuple[str, Sequence[str]]], cells: SampledCells, each: Iterable[str]
) -> dict[str, str] | None:
    """Our names for the roles and for the columns that number poses and pulls."""
    if not found.keys() & {"pose", "repeat"} and (tags := _tags(cells())):
        return _ours({**found, "pose_repeat": (tags, ())})
    found = _numbered(found, cells)
    lacking = ("pose",) if {"repeat", *each} & {*found} else ("pose", "repeat")
    found |= _by_counts(found, cells) if "pose" in found else _counted(lacking, found, cells)
    return _ours(found) if "pose" in found else None


def _by_unit_column(
    found: Mapping[str, tuple[str, Sequence[str]]],
    cells: SampledCells,
    units: Sequence[str],
    by_scale: bool,
) -> dict[str, tuple[str, Sequence[str]]]:
    """The force in the unit that all cells of a column of their own state.

    Without a title of its own it is the column of numbers before that; kg are a force on a scale.
    """
    title, open_units = found.get("force", ("", units))
    columns = cells() if len(open_units) > 1 else {}
    of = _of_one_unit(columns, units)
    if len(of) != 1 or (of[0][1] == "kg" and not by_scale):
        return {}
    before = [*columns][max([*columns].index(of[0][0]) - 1, 0)]
    numbers = [*map(is_number, filter(None, columns[before]))]
    return {"force": (title or before, (of[0][1],))} if title or all(numbers or [False]) else {}


def _of_one_unit(
    columns: Mapping[str, Sequence[str]], units: Sequence[str]
) -> list[tuple[str, str]]:
    """The columns all of whose cells are the same unit, and this."""
    said = {one: {_unit(cell.strip().lower()) for cell in own} for one, own in columns.items()}
    return [(one, min(some)) for one, some in said.items() if len(some) == 1 and some <= {*units}]


def _tags(cells: Mapping[str, Sequence[str]]) -> str | None:
    """The only column whose cells begin with the numbers of pose and pull; None if there is none.

    A cell without a number belongs to no pull.
    """
    number = re.compile(r"\d").search
    found = [title for title, own in cells.items()
             if _count_on([*map(pose_and_repeat, filter(number, own))])]  # fmt: skip
    return found[0] if len(found) == 1 else None


def _count_on(pulls: Sequence[tuple[int, int] | None]) -> bool:
    """Whether pose after pose, each numbers its pulls from 0 or 1 on."""
    own = [one for one in pulls if one]
    runs = [[pull for _, pull in some] for _, some in itertools.groupby(own, itemgetter(0))]
    counted = all(one == [*range(one[0], one[0] + len(one))] and one[0] < 2 for one in runs)
    return counted and len(own) == len(pulls) and 1 < len(runs) == len({pose for pose, _ in own})


def _by_counts(
    found: Mapping[str, tuple[str, Sequence[str]]], cells: SampledCells
) -> dict[str, tuple[str, Sequence[str]]]:
    """The pulls, if one other column that is called a load counts 1, 2, 3 in each pose."""
    if "repeat" in found or any(role.startswith("force_") for role in found) or not cells():
        return {}
    columns = cells()
    left = columns.keys() - {title for title, _ in found.values()}
    poses = from_above(columns[found["pose"][0]])
    loads = [title for title in left if _is(_stem(_words(title)), "force", {})]
    own = [title for title in loads if _counts(poses, columns[title])]
    several = len({*poses}) < len(poses)
    return {"repeat": (own[0], ())} if several and len(own) == 1 else {}


def _counted(
    lacking: Sequence[str], found: Mapping[str, tuple[str, Sequence[str]]], cells: SampledCells
) -> dict[str, tuple[str, Sequence[str]]]:
    """Poses and pulls by columns of whole numbers, none if there are more of these."""
    counting = _counting(cells(), [title for title, _ in found.values()])
    if len(counting) > len(lacking):
        return {}
    return {role: (title, ()) for role, title in zip(lacking, counting, strict=False)}


def _numbered(
    found: dict[str, tuple[str, Sequence[str]]], cells: SampledCells
) -> dict[str, tuple[str, Sequence[str]]]:
    """The roles; a force that counts 1, 2, 3 in each pose is the pull if another can be the force.

    That is the only other column of numbers.
    """
    title, units = found.get("force", ("", ()))
    if len(units) < 2 or "pose" not in found or "repeat" in found or not cells():
        return found
    columns, taken = cells(), [one for one, _ in found.values()]
    left = {one: own for one, own in columns.items() if one not in taken}
    others = [one for one, own in left.items() if all(map(is_number, own))]
    if len(others) != 1 or not _counts(columns[found["pose"][0]], columns[title]):
        return found
    return found | {"repeat": (title, ()), "force": (others[0], stated_unit(others[0], units))}


def _counts(poses: Sequence[str], numbers: Sequence[str]) -> bool:
    """Whether numbers count 1, 2, 3 in each pose."""
    pulls = defaultdict[str, list[str]](list)
    for pose, number in zip(poses, numbers, strict=True):
        pulls[pose].append(number)
    return all(own == [*map(str, range(1, len(own) + 1))] for own in pulls.values())


def _by_unit(titles: Sequence[str], units: Sequence[str]) -> dict[str, tuple[str, Sequence[str]]]:
    """The force, if exactly one title has a unit of forces in brackets, and not kg, or is one.

    `LBS` alone is a force; `N` alone may number something.
    """
    found = []
    for title in titles:
        inside = IN_BRACKETS.findall(title.lower())[-1:]
        unit = _unit(inside[0] if inside else title.lower().strip())
        if unit in units and unit not in ("kg", "" if inside else "n"):
            found.append((title, (unit,)))
    return {"force": found[0]} if len(found) == 1 else {}


def names_a_scale(text: str) -> bool:
    """Whether a text names an instrument that shows forces."""
    return not _known().scales.isdisjoint(_WORDS.findall(text.lower()))


def _of_a_scale(titles: Sequence[str]) -> dict[str, tuple[str, Sequence[str]]]:
    """The force that a scale shows in kg."""
    shown = [title for title in titles if _unit(title.lower().strip()) == "kg"]
    return {"force": (shown[0], ("kg",))} if len(shown) == 1 else {}


def _of_pulls(titles: Sequence[str], units: Sequence[str]) -> dict[str, tuple[str, Sequence[str]]]:
    """`force_1`, `force_2` ... with title and units: columns that differ by a number only.

    A row is a pose then: `Pull 1 (lbf)`, `Pull 2 (lbf)`. Beside a unit of force they may have any
    word in common; without one it must be that of a pull or of a force.
    """
    words = _known().called["repeat"] | _known().called["force"]
    found: dict[str, dict[str, tuple[str, Sequence[str]]]] = defaultdict(dict)
    for title in titles:
        unit, own = force_unit(title, units), stated_unit(title, units)
        parts = _WORDS.findall(title.lower())[: -1 if len(own) == 1 else None]
        numbers = [*filter(is_count, parts)]
        stem = _stem([part for part in parts if part not in numbers])
        if len(numbers) == 1 and (unit or stem in words):
            name = f"force_{int(numbers[0])}"
            found[f"{stem} {own}"].setdefault(name, (title, own))
    several = [one for one in found.values() if len(one) > 1]
    return several[0] if len(several) == 1 else {}


def force_unit(title: str, units: Sequence[str]) -> str:
    """The unit of force at the end of a title, empty without one; kg may be a mass."""
    words = _WORDS.findall(title.lower())
    unit = _unit(words[-1]) if len(words) > 1 else ""
    return unit if unit in units and unit != "kg" else ""


def anchors(columns: Mapping[str, Collection[str]]) -> dict[str, str]:
    """Our names of the columns that name anchors: one, or one for each pull with its number.

    Names that are numbers may be those of anything, unless the title is a word for an anchor.

    Args:
        columns: Cells of each column in which all are names of points, by title.
    """
    left = {
        title: numbers
        for title, own in columns.items()
        for words in [_words(title)]
        for numbers in [[*filter(is_count, words)]]
        if not all(map(str.isdecimal, own)) or not _known().called["anchor"].isdisjoint(words)
    }
    several = {title: f"anchor_{int(own[0])}" for title, own in left.items() if len(own) == 1}
    return several if 1 < len(several) == len(left) else dict.fromkeys([*left][:1], "anchor")


def _counting(cells: Mapping[str, Sequence[str]], taken: Sequence[str]) -> list[str]:
    """The titles of columns of whole numbers, those that change less often first.

    A column that numbers the rows is dropped if there are others. An empty cell has the number
    above it, and a pose that was measured again letters behind its number.
    """
    counted = {title: _whole(column) for title, column in cells.items() if title not in taken}
    whole = {title: numbers for title, numbers in counted.items() if numbers}
    runs = {title: sum(a != b for a, b in itertools.pairwise(one)) for title, one in whole.items()}
    rows = [title for title, one in whole.items() if one == [*range(1, len(one) + 1)]]
    left = [title for title in whole if runs[title] and title not in rows] or rows
    return sorted(left, key=lambda title: runs[title])


def _whole(column: Sequence[str]) -> list[int]:
    """The whole numbers of a column; none if it has anything else, or begins with an empty cell."""
    out: list[int] = []
    for cell in map(str.strip, column):
        one = _COUNT.fullmatch(cell)
        if not one and (cell or not out):
            return []
        out.append(int(one[1]) if one else out[-1])
    return out


_COUNT = re.compile(r"([0-9]{1,9})[^\W\d_]{0,4}")
"""A number of a pose or pull, and letters behind it."""


def pose_alone(titles: Sequence[str], _: SampledCells) -> dict[str, str] | None:
    """Our name for the title that numbers poses, None if there is none."""
    found = _first(titles, {"pose": ()})
    return _ours(found) if found and not _coordinates(titles) else None


def in_order(titles: Sequence[str]) -> bool:
    """Whether the numbers in titles, if all have one, are equal or ascending."""
    found = [re.findall("[0-9]+", title) for title in titles]
    return not all(found) or len(titles) == 1 or _rises([int(one[-1]) for one in found])


def stated_unit(title: str, units: Sequence[str]) -> Sequence[str]:
    """The one of some units in which a title ends, all of them if it ends in none."""
    last = _WORDS.findall(title.lower())[-1:]
    own = [unit for unit in units if [unit] == [_unit(word) for word in last]]
    return own or units


def _rises(numbers: Sequence[int]) -> bool:
    return len({*numbers}) == 1 or all(a < b for a, b in itertools.pairwise(numbers))


def of_joints(
    titles: Sequence[str],
    cells: SampledCells,
    axes: Sequence[str],
    lengths: Sequence[bool],
    units: tuple[Sequence[str], Sequence[str]],
) -> dict[str, str] | None:
    """Our names for the titles of a joint log, None if one of the axes is missing.

    Poses may also be the only column of whole numbers that are all different.

    Args:
        titles: As written.
        cells: Cells below them.
        axes: Our names of the axes without units; those that turn are numbered from 1.
        lengths: Which of them slide.
        units: Those of lengths, and those of angles.

    Returns:
        As for `of_loads`.
    """
    turn = [name for name, length in zip(axes, lengths, strict=True) if not length]
    called = _roles(axes, turn)
    wanted = {role: units[role != "rail"] for role in (*called, *_others(turn))}
    found = _first(titles, {"pose": (), **wanted}, turn)
    if found.keys() - {"pose"} != {*called} or len(called) < len(axes):
        return None
    if "pose" not in found:
        if (counter := _counter(cells(), [title for title, _ in found.values()])) is None:
            return None
        found["pose"] = counter, ()
    return _ours({called.get(role, role): said for role, said in found.items()})


def of_another(
    titles: Sequence[str],
    cells: SampledCells,
    axes: Sequence[str],
    lengths: Sequence[bool],
    units: tuple[Sequence[str], Sequence[str]],
) -> dict[str, str] | None:
    """Titles of axes that move in a joint log and that a robot lacks, None if there are none.

    Args:
        titles: As written.
        cells: Cells below them.
        axes: Our names of the robot's axes without units.
        lengths: Which of them slide.
        units: Those of lengths, and those of angles.
    """
    turn = [name for name, length in zip(axes, lengths, strict=True) if not length]
    has = _roles(axes, turn)
    lacking = {role: units[role != "rail"] for role in _others(turn) if role not in has}
    found = {title: role for role, (title, _) in _first(titles, lacking, turn).items()}
    below = cells() if found else {}
    return {title: role for title, role in found.items() if len({*below[title]}) > 1} or None


def _others(turn: Sequence[str]) -> tuple[str, str]:
    """Axes that other robots have and one with these axes that turn may not have."""
    return "rail", f"axis {len(turn) + 1}"


def _roles(axes: Sequence[str], turn: Sequence[str]) -> dict[str, str]:
    """Our names of the axes by their roles: those that turn are numbered, one slides as a rail."""
    called = {f"axis {k}": name for k, name in enumerate(turn, 1)}
    return called | dict(zip(["rail"], (n for n in axes if n not in turn), strict=False))


def _counter(cells: Mapping[str, Sequence[str]], taken: Sequence[str]) -> str | None:
    """The only other column of whole numbers that are all different."""
    apart = [one for one in _counting(cells, taken) if len({*cells[one]}) == len(cells[one])]
    return apart[0] if len(apart) == 1 else None


def _first(
    titles: Sequence[str], wanted: Mapping[str, Sequence[str]], own: Sequence[str] = ()
) -> dict[str, tuple[str, Sequence[str]]]:
    """The first title of each role and its unit; all its units if no title of it states one.

    Args:
        titles: As written.
        wanted: The units of each role, empty where it has none.
        own: A robot's names of its axes that turn.
    """
    axes = _axes(titles, own)
    found: dict[str, tuple[str, Sequence[str]]] = {}
    for title in titles:
        words = _words(title)
        unit = _unit("".join(words[-1:]))
        counts = len(words) < len(_WORDS.findall(title))  # load no 3 is not a load
        for role, units in wanted.items():
            if role in ("force", "mass") and counts:
                continue
            if units and unit in (*units, SI) and _is(_stem(words[:-1]), role, axes):
                if len(found.get(role, ("", ()))[1]) != 1:
                    found[role] = title, (unit,)
            elif _is(_stem(words), role, axes):
                found.setdefault(role, (title, units))
    return found


def _unit(word: str) -> str:
    """Our name of a unit."""
    return _known().unit.get(word, word)


def _words(title: str) -> list[str]:
    """The words of a title, without those that only say that it is a number."""
    plain = _NUMBER_SIGN.sub(" nr ", title.lower())
    return [word for word in _WORDS.findall(plain) if word not in _known().number]


def _stem(words: Sequence[str]) -> str:
    """The words before a unit, without the connecting word."""
    return " ".join(words[:-1] if words[-1:] and words[-1] in _known().between else words)


def are_called(titles: Sequence[str], names: Sequence[str]) -> bool:
    """Whether all of these names of axes occur in titles."""
    return {*map(_spelt, names)} <= {*_bare(titles).values()}


def _spelt(name: str) -> str:
    return " ".join(_WORDS.findall(name.lower()))


def _bare(titles: Sequence[str]) -> dict[str, str]:
    """Possible names of an axis in titles, each with its form without filler words."""
    stems = [_stem(part) for words in map(_words, titles) for part in (words, words[:-1])]
    return {one: _alone(one) for one in stems}


def _alone(stem: str) -> str:
    """A name without filler words; unchanged if they leave no letter of it."""
    left = " ".join(word for word in stem.split() if word not in _known().beside)
    return left if any(map(str.isalpha, left)) else stem


def _is(stem: str, role: str, axes: Mapping[str, str]) -> bool:
    return axes.get(stem) == role or stem in _known().called.get(role, ())


def _axes(titles: Sequence[str], own: Sequence[str] = ()) -> dict[str, str]:
    """`axis 1` ... by title: a number after a word for axes, or all names of one maker.

    Args:
        titles: As written.
        own: A robot's names of its axes that turn.
    """
    bare = _bare(titles)
    numbers = {one: _known().numbered.fullmatch(name) for one, name in bare.items()}
    names = sorted((*_known().named, tuple(map(_spelt, own))), key=len)
    of = next((one for one in reversed(names) if one and {*one} <= {*bare.values()}), ())
    found = {one: number[1] for one, number in numbers.items() if number}
    found |= {one: str(of.index(name) + 1) for one, name in bare.items() if name in of}
    return {one: f"axis {number}" for one, number in found.items()}


def _ours(found: Mapping[str, tuple[str, Sequence[str]]]) -> dict[str, str]:
    """Our names by title, for those that differ."""
    ours = {title: "|".join(f"{name}_{unit}" for unit in units) or name
            for name, (title, units) in found.items()}  # fmt: skip
    return {title: name for title, name in ours.items() if title.lower() != name.lower()}
