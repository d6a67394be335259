"""Make a robot file from a table: rows of Denavit and Hartenberg, or axes by point and direction.

A DH table has the columns theta, d, a, alpha, by title, with a row for each joint; the convention
is that of the order in which they stand: alpha and a before theta and d are the modified one,
Rx(alpha) Tx(a) Rz(theta) Tz(d) (Craig 2005, ch. 3), else it is the classical one, Rz(theta) Tz(d)
Tx(a) Rx(alpha) (Denavit and Hartenberg 1955). Theta, or d of an axis that slides, may be a number,
or the axis with its sense and zero: `-A1`, `A2 - 90`, `90 - q3`, `θ4 + π/2`. What the file says
of its convention precedes the order of the columns. A list of axes has rows `JT2  0 450 750  -X`:
a point on the axis with all joints at zero, in F_b, and the direction about which it turns, also as
a unit vector; a row of the flange has a point only, a row of a rail a direction only.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import dropwhile, pairwise, takewhile
from typing import Any, NamedTuple

import numpy as np

from pipeline.base import linear, toml
from pipeline.base.arrays import Array
from pipeline.base.doors import opened as behind
from pipeline.base.errors import InputError
from pipeline.base.errors import at as locate
from pipeline.exchange.rows import fixed, frames, row
from pipeline.readers._text import Text, is_workbook, text

_COLUMNS = {
    "theta": ("theta", "θ", "th", "세타", "offset"),
    "d": ("d", "offset"),
    "a": ("a", "r", "length"),
    "alpha": ("alpha", "alfa", "α", "twist", "알파"),
}
"""Titles of a DH table, without units and indices."""
_SIGNS = ("sign", "sense", "segno", "signe", "sens", "signo", "vorzeichen", "znak")
"""Titles of the sense of each axis, +1 or -1: theta = sign q + offset."""
_FLANGE = re.compile(
    r"flange?\b|flansch|bride|brida|flangia|flanş|flans\b|ko[łl]nierz|p[řr][íi]ruba|фланец|플랜지|法兰|フランジ",
    re.IGNORECASE,
)
_UNITS = {"mm": 1e-3, "m": 1.0, "in": 0.0254, "rad": 180 / np.pi}
"""Factors to metres and degrees; other angles are in degrees."""
_NUMBER = r"[-+]?\d+(?:[.,]\d+)?"
_POINT_ONLY = r"[-+]?\d+(?:\.\d+)?"
"""A number where commas separate the cells."""
_TERM = re.compile(
    r"(?P<sign>[-+]?)(?:(?P<turn>\d*\.?\d*)(?:π|pi\b)(?:/(?P<over>\d+))?|(?P<number>\d+\.?\d*|\.\d+)"
    r"|(?P<joint>[^\W\d]\w*))"
)
"""A term of a cell of a DH table: a number, a part of π, or an axis."""
_WRITTEN = str.maketrans({"−": "-", "–": "-", ",": "."} | dict.fromkeys("°º*", ""))
"""Characters of a cell as people write them."""
_AXIS = re.compile(
    rf"^\s*(?P<name>[^\W\d]\w*)\b(?:: *[^\W\d]\w*)?(?P<point>(?:[;,\s]+{_NUMBER}){{3}})?"
    r"(?P<rest>.*)$",
    re.MULTILINE,
)
_WAY = re.compile(r"(?<!\w)(?P<sign>[-+]?)(?P<axis>[XYZ])(?!\w)")
_UNIT = re.compile(r"[\[(](?:mm|m|in|deg|rad|°|grad)[^\])]*[\])]?.*")
_INDEX = re.compile(r"[_ ({]*(?:\b|(?<=_)|(?<=[θα]))[ijn]?\s*(?:-\s*1)?[)} ]*$")
"""What is behind the letter of a title: its unit, an index as in a_i-1."""
_MARKS = (";", r"\t", r"\|", ",", r"\s{2,}|\t", r"\s+")
"""What separates the cells of a table, as expressions."""
_LARGE = 20.0
"""Length from which a table without units is in millimetres [1]: no link is longer in metres."""
_SLIDES_M = 30.0
"""Largest position along a rail, of either sign, where nobody states its ends [m]."""
_MOST = 20_000
"""Size from which a file is taken for something else [byte]; a robot has a dozen rows."""
_RADIANS = 1e-3
"""Largest difference of all twists from right angles in radians for them to be in radians [1]."""
_LEAST = 4
"""Minimum number of joints of a table [1]."""


def robot_file(data: bytes, file: str, payload_kg: float | None = None) -> str:
    """The text of a robot file.

    Args:
        data: Content of the table.
        file: Its name.
        payload_kg: Rated payload [kg].

    Raises:
        InputError: It is neither table.
    """
    found = next(filter(None, map(_table, _texts(file, data))), None)
    if found is None:
        raise InputError(
            "there is no table of a robot in it",
            "give columns theta, d, a, alpha with a row for each joint, or rows with the name of "
            "an axis, a point on it and its direction: JT2 0 450 750 -X",
            file=file,
        )
    content, assumed = found
    names = [one["name"] for one in content["joint"]]
    for k, one in enumerate(content["joint"], 1):
        one["name"] = f"{'theta' if one['type'] == 'revolute' else 'r'}{k}"
    limits = "the limits of the joints are not stated: correct lower_deg and upper_deg"
    head = {
        "format": 1,
        "name": _plain(file),
        "description": f"robot of {file}",
        "source": file,
        "assumptions": ["the stiffnesses of the joints are not known", limits, *assumed],
        **({} if payload_kg is None else {"payload_kg": payload_kg}),
    }
    signs = content.pop("signs", [1] * len(names))
    controller = {"axes": names, "matrix": np.diag(signs).tolist()}
    return toml.dumps({**head, **content, "controller": controller})


def _plain(file: str) -> str:
    """A name for the robot of a file."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "", file.rpartition(".")[0])[:100].strip("_.-")
    return plain or "robot"


def is_table(file: str, data: bytes) -> bool:
    """Whether a file is such a table, or holds one that only some of its cells stop."""
    try:
        texts = [*_texts(file, data)] if len(data) < _MOST or is_workbook(data) else []
        return any(map(_table, texts))
    except InputError as stopped:
        return stopped.line is not None


def has_rail(file: str, data: bytes) -> bool:
    """Whether a table of a robot has an axis that slides."""
    with contextlib.suppress(InputError):
        tables = [one for one in map(_table, _texts(file, data)) if one]
        return any(joint["type"] == "prismatic" for made, _ in tables for joint in made["joint"])
    return False


def _table(text: Text) -> tuple[dict[str, Any], list[str]] | None:
    return _of_dh(text) or _of_axes("\n".join(line for _, line in text.lines()))


def _texts(file: str, data: bytes) -> Iterator[Text]:
    """The file as text, sheet by sheet of a workbook."""
    if is_workbook(data):
        yield from behind("pipeline.dialects.workbook:sheets")(file, data).values()
    else:
        yield text(file, data)


def _joint(name: str, slides: bool) -> dict[str, Any]:
    ends: dict[str, Any] = {"lower_deg": -360, "upper_deg": 360}
    if slides:
        ends = {"lower_m": -_SLIDES_M, "upper_m": _SLIDES_M}
    return {"name": name, "type": "prismatic" if slides else "revolute", **ends}


# --- Denavit and Hartenberg -----------------------------------------------------------------------


def _of_dh(text: Text) -> tuple[dict[str, Any], list[str]] | None:
    """Content of a robot file by a DH table, and what was assumed; None if there is none.

    Raises:
        InputError: There are its titles, and a cell below them is neither a number nor an axis.
    """
    for mark in _MARKS:
        rows = [_cells(line, mark) for _, line in text.lines()]
        for number, titles in enumerate(rows):
            at = _places(titles)
            if len({*at.values()}) == len(_COLUMNS):
                joints = _rows_below(rows, number)
                if len(joints) >= _LEAST:
                    said = _convention("\n".join(line for _, line in text.lines()))
                    return _of_rows(text.name, titles, at, joints, said)
    return None


def _rows_below(rows: Sequence[list[str]], titles: int) -> list[tuple[int, list[str]]]:
    """Line and cells of the rows below titles, up to a blank one or one of another width."""
    wide, below = len(rows[titles]), enumerate(rows[titles + 1 :], titles + 2)
    filled = dropwhile(lambda one: not any(one[1]), below)
    return [*takewhile(lambda one: len(one[1]) == wide and any(one[1]), filled)]


def _cells(line: str, mark: str) -> list[str]:
    return [cell.strip(' "') for cell in re.split(mark, line.strip(" \r\n"))]


def _places(titles: Sequence[str]) -> dict[str, int]:
    """Index of each column of a DH table."""
    plain = [*map(_plain_title, titles)]
    return {
        role: next(
            k for own in ({*words} - {"offset"}, words) for k, one in enumerate(plain) if one in own
        )
        for role, words in _COLUMNS.items()
        if not {*words}.isdisjoint(plain)
    }


def _plain_title(title: str) -> str:
    return _INDEX.sub("", _UNIT.sub("", title.lower()).strip()).strip()


_MODIFIED = re.compile(r"modif|craig|proximal|zmodyf|修正|khalil", re.IGNORECASE)
_CLASSICAL = re.compile(r"standard|classi|klassi|distal|標準|标准|estándar|padrão", re.IGNORECASE)
_STEPS = re.compile(r"\bR(?:ot)?[ _(]*([xz])\b", re.IGNORECASE)


def _convention(text: str) -> bool | None:
    """Whether a file calls its table modified; None if it does not say, or contradicts itself."""
    steps = [*map(str.lower, _STEPS.findall(text)[:2])]
    said = {steps == ["x", "z"]} if len({*steps}) > 1 else set()
    said |= {True} if _MODIFIED.search(text) else set()
    said |= {False} if _CLASSICAL.search(text) else set()
    return said.pop() if len(said) == 1 else None


class _Entry(NamedTuple):
    """A cell of a DH table: the axis, empty for a number; its sense, and its zero or the number."""

    joint: str
    sign: int
    value: float


class _Row(NamedTuple):
    """A row of a DH table: the axis, whether it slides, its sense, and its numbers by role."""

    name: str
    slides: bool
    sign: int
    values: dict[str, float]


def _of_rows(
    file: str,
    titles: Sequence[str],
    at: Mapping[str, int],
    rows: Sequence[tuple[int, list[str]]],
    said: bool | None,
) -> tuple[dict[str, Any], list[str]]:
    """Content of a robot file, and what was assumed; `said` as for `_convention`."""
    joints = []
    for number, (line, cells) in enumerate(rows, 1):
        with locate(file, line=line):
            joints.append(_row(number, titles, cells, at))
    factor = _factors(titles, at, joints)
    made = [
        _joint(one.name, one.slides)
        | {_KEYS[r]: round(factor[r] * x, 10) for r, x in one.values.items() if x}
        for one in joints
    ]
    ordered = max(at["alpha"], at["a"]) < min(at["theta"], at["d"])
    convention, order = _CONVENTIONS[ordered if said is None else said]
    by = "the order of its columns" if said is None else "what the file says"
    why = f"by {by} the table is {order}; if not, correct convention"
    content = {"convention": convention, "joint": made, "signs": [one.sign for one in joints]}
    return content, [why]


def _factors(
    titles: Sequence[str], at: Mapping[str, int], joints: Sequence[_Row]
) -> dict[str, float]:
    """Factor to metres or degrees of each role; angles are in radians if all twists show it."""
    longest = max(abs(one.values[role]) for one in joints for role in ("a", "d"))
    factor = {role: _factor(titles[k], role, longest) for role, k in at.items()}
    twists = np.array([one.values["alpha"] for one in joints]) / (np.pi / 2)
    if factor["alpha"] == 1.0 and twists.any() and np.abs(twists - twists.round()).max() < _RADIANS:
        factor |= {"alpha": _UNITS["rad"], "theta": _UNITS["rad"]}
    return factor


_KEYS = {"theta": "theta_deg", "d": "d_m", "a": "a_m", "alpha": "alpha_deg"}
_CONVENTIONS = (
    ("standard", "Rz(theta) Tz(d) Tx(a) Rx(alpha)"),
    ("craig", "Rx(alpha) Tx(a) Rz(theta) Tz(d)"),
)


def _row(number: int, titles: Sequence[str], cells: Sequence[str], at: Mapping[str, int]) -> _Row:
    """A row of a DH table.

    Raises:
        InputError: A cell is neither a number nor one axis, or sense or zero are stated twice.
    """
    entries = {role: _entry(cells[k], titles[k]) for role, k in at.items()}
    role = "d" if entries["d"].joint else "theta"
    moving = entries.pop(role)
    if still := next((cells[at[one]] for one in entries if entries[one].joint), ""):
        raise _stated_again(still)
    sign, zero = _with_beside(moving, cells[at[role]], _beside(titles, cells, at))
    values = {one: own.value for one, own in entries.items()} | {role: zero}
    name = _called([moving.joint] if 0 in at.values() else [cells[0], moving.joint], number)
    return _Row(name, role == "d", sign, values)


def _with_beside(own: _Entry, cell: str, beside: tuple[int, float]) -> tuple[int, float]:
    """Sense and zero of an axis, by its cell or the columns beside it.

    Raises:
        InputError: Both state the same.
    """
    sign, zero = beside
    if (own.sign < 0 and sign) or (own.value and zero):
        raise _stated_again(cell)
    return own.sign * (sign or 1), own.value + zero


def _called(names: Sequence[str], number: int) -> str:
    """The first name with a letter at its begin, else by the number of the row."""
    return next((one for one in names if re.match(r"[A-Za-z]", one)), f"J{number}")


def _stated_again(cell: str) -> InputError:
    return InputError(
        f'the cell "{cell}" states what another column states, too, or a second axis',
        "state sense and zero of an axis once, and all other cells as numbers",
    )


def _beside(
    titles: Sequence[str], cells: Sequence[str], at: Mapping[str, int]
) -> tuple[int, float]:
    """Sense of an axis, 0 without a column for it, and its zero by columns of their own."""
    signs = [cells[k] for k, one in enumerate(titles) if one.lower() in _SIGNS]
    zeros = [_entry(cells[k], one).value for k, one in enumerate(titles)
             if _plain_title(one) == "offset" and k not in at.values()]  # fmt: skip
    sense = {"-": -1}.get(signs[0].translate(_WRITTEN)[:1], 1) if signs else 0
    return sense, sum(zeros)


def _entry(cell: str, title: str) -> _Entry:
    """A cell of a DH table.

    Raises:
        InputError: It is neither a number nor one axis with its sense and zero.
    """
    plain = re.sub(r"\s*([-+/()])\s*", r"\1", cell.translate(_WRITTEN)).strip()
    inside = re.fullmatch(r"-\((.*)\)", plain)
    terms = _terms(inside[1] if inside else plain)
    joints = [one for one in terms or () if one["joint"]]
    if terms is None or len(joints) > 1:
        raise InputError(
            f'the cell "{cell}" below "{title}" is neither a number nor one axis with its zero',
            "write it as A2, -A2 or A2 - 90",
        )
    half = np.pi if "rad" in title.lower() else 180.0
    outer = -1 if inside else 1
    value = outer * sum(_number(one, half) for one in terms)
    if not joints:
        return _Entry("", 1, value)
    return _Entry(joints[0]["joint"], outer * {"-": -1}.get(joints[0]["sign"], 1), value)


def _terms(text: str) -> list[re.Match[str]] | None:
    """The terms of a sum, none of an empty cell; None if it is no sum of them."""
    terms, end = list[re.Match[str]](), 0
    while (one := _TERM.match(text, end)) and (end == 0 or one["sign"]):
        terms.append(one)
        end = one.end()
    return terms if end == len(text) else None


def _number(term: re.Match[str], half: float) -> float:
    """The value of a term, 0 for an axis; `half` is half a turn in the unit of its column."""
    sign = -1.0 if term["sign"] == "-" else 1.0
    if term["number"]:
        return sign * float(term["number"])
    turn = 0.0 if term["joint"] else half * float(term["turn"] or 1)
    return sign * turn / float(term["over"] or 1)


def _factor(title: str, role: str, longest: float) -> float:
    """To metres or degrees, by the unit of a title, else by the longest length."""
    words = re.findall(r"[^\W\d_]+", title.lower())
    stated = next((_UNITS[one] for one in reversed(words[1:]) if one in _UNITS), None)
    if stated is not None or role in ("theta", "alpha"):
        return stated or 1.0
    return 1e-3 if longest > _LARGE else 1.0


# --- axes by point and direction ------------------------------------------------------------------


def _of_axes(text: str) -> tuple[dict[str, Any], list[str]] | None:
    """Content of a robot file by a list of axes, and what was assumed; None if it is none."""
    turning, rails, ends = _listed(text)
    turning = turning or _by_vectors(text)
    ends = ends or [at for one in _ORIGIN.findall(text) if (at := _point(one)) is not None]
    if len(turning) < _LEAST or len(rails) > 1 or len(ends) != 1:
        return None
    points = np.array([*(at for _, at, _ in turning), *ends])
    points = points * (1e-3 if np.abs(points).max() > _LARGE else 1.0)
    flange, way = np.eye(4), "parallel to F_b"
    flange[:3, 3] = points[-1]
    if (said := _orientation(text)) is not None:
        flange[:3, :3], way = said, "turned as the file says"
    why = f"with all axes at 0 the flange frame is {way}; if not, correct [flange]"
    return _along(turning, rails, points, flange), [why]


def _along(
    turning: Sequence[tuple[str, Array, Array]],
    rails: Sequence[tuple[str, Array]],
    points: Array,
    flange: Array,
) -> dict[str, Any]:
    """Content of a robot file by its axes, points on them [m] and the flange in F_b, (4, 4)."""
    ways = [*(way for _, way in rails), *(way for *_, way in turning)]
    along = [*[points[0]] * len(rails), *points[:-1]]
    on_axes = frames(list(zip(along, ways, strict=True)), flange)
    steps = [row(before, after) for before, after in pairwise(on_axes)]
    heads = [*(_joint(name, True) for name, _ in rails),
             *(_joint(name, False) for name, *_ in turning)]  # fmt: skip
    joints = [head | step for head, step in zip(heads, steps, strict=True)]
    content = {"convention": "craig", **fixed("base", on_axes[0]), "joint": joints}
    return content | fixed("flange", linear.solve(on_axes[-1], flange))


_ORIGIN = re.compile(
    rf"\b(?:tool ?0|{_FLANGE.pattern})\b[^\n]*?\borigin\b\D*?((?:{_NUMBER}[;,\s]+){{2}}{_NUMBER})",
    re.IGNORECASE,
)
_TURNED = re.compile(r"(?<!\w)([xyz])\b(?:(?!(?<!\w)[xyz]\b)[^;,\n])*?([-+][XYZ])\b")
"""An axis of the flange and the direction of F_b in which it points: `z forward (base +X)`."""


def _orientation(text: str) -> Array | None:
    """Axes of the flange in F_b with all axes at 0, (3, 3); None if not two or three are stated."""
    stated = [(axis, _way(way)) for axis, way in _TURNED.findall(text)]
    found = {"xyz".index(axis): way for axis, way in stated if way is not None}
    if len(found) < 2:
        return None
    R = np.zeros((3, 3))
    for k in range(3):
        one, two = found.get((k + 1) % 3), found.get((k + 2) % 3)
        R[:, k] = found[k] if k in found else np.cross(one, two)  # type: ignore[arg-type]
    return R if np.allclose(np.cross(R[:, 0], R[:, 1]), R[:, 2]) and np.any(R) else None


def _by_vectors(text: str) -> list[tuple[str, Array, Array]]:
    """Axes by name, point and a unit vector as direction, whichever of the two comes first."""
    found = [(one["name"], re.findall(_POINT_ONLY if one["six"][0] == "," else _NUMBER, one["six"]))
             for one in _SIX.finditer(text)]  # fmt: skip
    halves = np.array([[*map(_decimal, six)] for _, six in found]).reshape(-1, 2, 3)
    unit = [k for k in (0, 1) if np.allclose(np.linalg.norm(halves[:, k], axis=1), 1.0, atol=1e-6)]
    if len(unit) != 1 or len({name for name, _ in found}) < len(found):
        return []
    (k,) = unit
    return [(name, six[1 - k], six[k]) for (name, _), six in zip(found, halves, strict=True)]


_SIX = re.compile(
    rf"^\s*(?P<name>[^\W\d]\w*)"
    rf"(?P<six>(?:[; \t]+{_NUMBER}){{6}}|(?:, *{_POINT_ONLY}){{6}})[;, \t]*$",
    re.MULTILINE,
)


def _listed(
    text: str,
) -> tuple[list[tuple[str, Array, Array]], list[tuple[str, Array]], list[Array]]:
    """Axes that turn by name, point and direction, rails by name and direction, flanges."""
    turning, rails, ends = [], [], []
    for one in _AXIS.finditer(text):
        name, at, way = one["name"], _point(one["point"]), _way(one["rest"])
        if at is not None and _FLANGE.match(name):
            ends.append(at)
        elif way is not None and re.search(r"\d", name):
            if at is None:
                rails.append((name, way))
            else:
                turning.append((name, at, way))
    return turning, rails, ends


def _point(text: str | None) -> Array | None:
    numbers = re.findall(_NUMBER, text or "")
    return np.array([*map(_decimal, numbers)]) if numbers else None


def _decimal(text: str) -> float:
    return float(text.replace(",", "."))


def _way(text: str) -> Array | None:
    """The only direction in a text, a unit vector (3,)."""
    every = [*_WAY.finditer(text)]
    if len(every) != 1:
        return None
    (found,) = every
    return (-1.0 if found["sign"] == "-" else 1.0) * np.eye(3)["XYZ".index(found["axis"])]
