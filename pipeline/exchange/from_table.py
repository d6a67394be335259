"""Make a robot file from a table: rows of Denavit and Hartenberg, or axes by point and direction.

A DH table has the columns theta, d, a, alpha, by title, with a row for each joint; the convention
is that of the order in which they stand: alpha and a before theta and d are the modified one,
Rx(alpha) Tx(a) Rz(theta) Tz(d) (Craig 2005, ch. 3), else it is the classical one, Rz(theta) Tz(d)
Tx(a) Rx(alpha) (Denavit and Hartenberg 1955). A list of axes has rows `JT2  0 450 750  -X`: a point
on the axis with all joints at zero, in F_b, and the direction about which it turns; a row of the
flange has a point only, a row of a rail a direction only.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from pipeline.base import linear, toml
from pipeline.base.arrays import Array
from pipeline.base.errors import InputError
from pipeline.exchange.rows import fixed, frames, row

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
    r"flange?\b|flansch|bride|brida|flangia|flanş|flans\b|kołnierz|příruba|фланец|플랜지|法兰|フランジ",
    re.IGNORECASE,
)
_UNITS = {"mm": 1e-3, "m": 1.0, "in": 0.0254, "rad": 180 / np.pi}
"""Factors to metres and degrees; other angles are in degrees."""
_NUMBER = r"[-+]?\d+(?:[.,]\d+)?"
_ENTRY = re.compile(
    r"(?P<joint>[^\W\d_]\w*)?\s*\*?\s*(?P<plus>[-+]\s*\d+(?:[.,]\d+)?)?"
    rf"|(?P<fixed>{_NUMBER})"
)
"""A cell of a DH table: `q2`, `J1 - 90`, or a number."""
_AXIS = re.compile(
    rf"^\s*(?P<name>[^\W\d]\w*)\b(?P<point>(?:[;,\s]+{_NUMBER}){{3}})?(?P<rest>.*)$", re.MULTILINE
)
_WAY = re.compile(r"(?<!\w)(?P<sign>[-+]?)(?P<axis>[XYZ])(?!\w)")
_UNIT = re.compile(r"[\[(](?:mm|m|in|deg|rad|°|grad)[^\])]*[\])]?.*")
_INDEX = re.compile(r"[_ ({]*(?:\b|(?<=_)|(?<=[θα]))[ijn]?\s*(?:-\s*1)?[)} ]*$")
"""What is behind the letter of a title: its unit, an index as in a_i-1."""
_MARKS = (";", "\t", "|", ",")
_LARGE = 20.0
"""Length from which a table without units is in millimetres [1]: no link is longer in metres."""
_SLIDES_M = 30.0
"""Largest position along a rail, of either sign, where nobody states its ends [m]."""
_MOST = 20_000
"""Size from which a file is taken for something else [byte]; a robot has a dozen rows."""
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
    text = _decoded(data)
    found = _of_dh(text) or _of_axes(text)
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


def is_table(data: bytes) -> bool:
    """Whether a file is such a table."""
    text = _decoded(data) if len(data) < _MOST else ""
    return (_of_dh(text) or _of_axes(text)) is not None


def _decoded(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def _joint(name: str, slides: bool) -> dict[str, Any]:
    ends: dict[str, Any] = {"lower_deg": -360, "upper_deg": 360}
    if slides:
        ends = {"lower_m": -_SLIDES_M, "upper_m": _SLIDES_M}
    return {"name": name, "type": "prismatic" if slides else "revolute", **ends}


# --- Denavit and Hartenberg -----------------------------------------------------------------------


def _of_dh(text: str) -> tuple[dict[str, Any], list[str]] | None:
    """Content of a robot file by a DH table, and what was assumed; None if there is none."""
    for mark in _MARKS:
        rows = [[cell.strip(' "') for cell in line.split(mark)] for line in text.splitlines()]
        for number, titles in enumerate(rows):
            at = _places(titles)
            if len({*at.values()}) == len(_COLUMNS):
                below = [one for one in rows[number + 1 :] if len(one) == len(titles) and any(one)]
                return _of_rows(titles, at, below) if len(below) >= _LEAST else None
    return None


def _places(titles: Sequence[str]) -> dict[str, int]:
    """Index of each column of a DH table."""
    plain = [_INDEX.sub("", _UNIT.sub("", one.lower()).strip()).strip() for one in titles]
    return {
        role: next(k for k, one in enumerate(plain) if one in words)
        for role, words in _COLUMNS.items()
        if not {*words}.isdisjoint(plain)
    }


class _Row(NamedTuple):
    """A row of a DH table: the axis, whether it slides, and its numbers by role as written."""

    name: str
    slides: bool
    values: dict[str, float]


def _of_rows(
    titles: Sequence[str], at: Mapping[str, int], rows: Sequence[Sequence[str]]
) -> tuple[dict[str, Any], list[str]] | None:
    found = [_row(number, cells, at) for number, cells in enumerate(rows, 1)]
    joints = [one for one in found if one is not None]
    if len(joints) < len(found):
        return None
    longest = max(abs(one.values[role]) for one in joints for role in ("a", "d"))
    factor = {role: _factor(titles[k], role, longest) for role, k in at.items()}
    made = [
        _joint(one.name, one.slides)
        | {_KEYS[r]: round(factor[r] * x, 10) for r, x in one.values.items() if x}
        for one in joints
    ]
    modified = max(at["alpha"], at["a"]) < min(at["theta"], at["d"])
    convention, order = _CONVENTIONS[modified]
    why = f"by the order of its columns the table is {order}; if not, correct convention"
    content = {"convention": convention, "joint": made, "signs": _signs(titles, rows)}
    return content, [why]


_KEYS = {"theta": "theta_deg", "d": "d_m", "a": "a_m", "alpha": "alpha_deg"}
_CONVENTIONS = (
    ("standard", "Rz(theta) Tz(d) Tx(a) Rx(alpha)"),
    ("craig", "Rx(alpha) Tx(a) Rz(theta) Tz(d)"),
)


def _row(number: int, cells: Sequence[str], at: Mapping[str, int]) -> _Row | None:
    """A row of a DH table; None if a cell is neither a number nor names a joint."""
    entries = {role: _ENTRY.fullmatch(cells[k]) for role, k in at.items()}
    if not all(entries.values()):
        return None
    slides = bool(entries["d"] and entries["d"]["joint"])
    moving = entries["d" if slides else "theta"]
    name = cells[0] if 0 not in at.values() else moving and moving["joint"]
    return _Row(name or f"J{number}", slides, {r: _value(one) for r, one in entries.items()})


def _signs(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> list[int]:
    """The sense of each axis."""
    place = next((k for k, one in enumerate(titles) if one.lower() in _SIGNS), None)
    return [-1 if place is not None and "-" in cells[place] else 1 for cells in rows]


def _value(entry: re.Match[str] | None) -> float:
    text = entry and (entry["fixed"] or entry["plus"])
    return float(text.replace(",", ".").replace(" ", "")) if text else 0.0


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
    if len(turning) < _LEAST or len(rails) > 1 or len(ends) != 1:
        return None
    points = np.array([*(at for _, at, _ in turning), *ends])
    points = points * (1e-3 if np.abs(points).max() > _LARGE else 1.0)
    flange = np.eye(4)
    flange[:3, 3] = points[-1]
    ways = [*(way for _, way in rails), *(way for *_, way in turning)]
    along = [*[points[0]] * len(rails), *points[:-1]]
    on_axes = frames(list(zip(along, ways, strict=True)), flange)
    steps = [row(before, after) for before, after in pairwise(on_axes)]
    heads = [*(_joint(name, True) for name, _ in rails),
             *(_joint(name, False) for name, *_ in turning)]  # fmt: skip
    joints = [head | step for head, step in zip(heads, steps, strict=True)]
    content = {"convention": "craig", **fixed("base", on_axes[0]), "joint": joints}
    content |= fixed("flange", linear.solve(on_axes[-1], flange))
    why = "with all axes at 0 the flange frame is parallel to F_b; if not, correct [flange]"
    return content, [why]


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
    return np.array([float(one.replace(",", ".")) for one in numbers]) if numbers else None


def _way(text: str) -> Array | None:
    """The first direction in a text, a unit vector (3,)."""
    if (found := _WAY.search(text)) is None:
        return None
    return (-1.0 if found["sign"] == "-" else 1.0) * np.eye(3)["XYZ".index(found["axis"])]
