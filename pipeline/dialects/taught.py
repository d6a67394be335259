"""Points in joint coordinates from controller programs, as a joint log.

KUKA (.dat, .src: `E6AXIS`, `AXIS`), ABB (.mod: `jointtarget`), FANUC (.ls: `/POS` in joints),
Yaskawa (.jbi: positions in pulses). A file is converted to a table with the columns `pose` and one
for each axis, each row in the line of its point, so that messages name the line of the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_KRL = re.compile(
    r"^[ \t]*(?:(?:GLOBAL|CONST)[ \t]+)*(?:DECL[ \t]+)?(?:(?:GLOBAL|CONST)[ \t]+)*E6AXIS[ \t]+"
    r"(?P<name>\$?\w+)[ \t]*=[ \t]*\{(?:E6AXIS:[ \t]*)?(?P<axes>[^{}\n]*)\}",
    re.MULTILINE | re.IGNORECASE,
)
_KRL_ARM = re.compile(_KRL.pattern.replace("E6AXIS", "AXIS"), re.MULTILINE | re.IGNORECASE)
_KRL_AXIS = re.compile(rf"\b([AE])([1-6])[ \t]+({_NUMBER})", re.IGNORECASE)
_RAPID = re.compile(
    r"^[^!\n]*?\bjointtarget[ \t]+(?P<name>\w+)[ \t]*:=[ \t]*\[[ \t]*\[(?P<arm>[^\[\]]*)\][ \t]*,"
    r"\s*\[(?P<more>[^\[\]]*)\]",
    re.MULTILINE | re.IGNORECASE,
)
_TP = re.compile(
    r'^P\[(?P<number>\d+)(?:[ \t]*:[ \t]*"(?P<name>[^"\n]*)")?\][ \t]*\{(?P<body>[^}]*)\}',
    re.MULTILINE,
)
_TP_AXIS = re.compile(rf"\b([JE])([1-9])[ \t]*=[ \t]*({_NUMBER})[ \t]*(deg|mm)")
_JBI = re.compile(r"^(?P<of>B?)C(?P<number>\d+)[ \t]*=[ \t]*(?P<axes>[-+\d., \t]+)$", re.MULTILINE)
_JBI_AXES = ("SLURBTE", ("E1", "E2", "E3"))
"""Axes of the arm, and of the base that moves it."""
_NONE = 1e9
"""Limit from which a RAPID value means an axis that does not exist: 9E9."""
_NAMED = re.compile(r"(?P<stem>[A-Za-z_]*?)_*(?P<number>\d+)")
_POSES = ("pose", "p", "pos", "point", "pt", "jpos", "j")
"""Name stems of points that are poses, if there are numbered points with other stems."""
_ARM = 6
"""Number of arm axes in a `jointtarget` [1]; the six others are external."""


class _Point(NamedTuple):
    """A point in joint coordinates.

    Attributes:
        line: Its line number.
        name: Its name.
        axes: Values by title, [deg] or [mm].
    """

    line: int
    name: str
    axes: dict[str, float]


def table(data: bytes) -> bytes | None:
    """Convert the points of a file to a tab-separated table; None if it has none.

    The number in its name is the pose of a point if all points to be used have a unique one (XP1,
    pose_02, P[3]); otherwise all points are numbered by their order in the file. Points without a
    number (XHOME), and numbered points of another name if some are called p, pose or the like, are
    then not poses.
    """
    if len(data) > _LARGEST or not any(word in data.upper() for word in _MARKS):
        return None
    text = data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    found = [one for points in (_krl, _rapid, _tp, _jbi) for one in points(text) if one.axes]
    return _written(found, text.count("\n") + 1) if found else None


def _written(found: Sequence[_Point], count: int) -> bytes:
    """Write points as a table, each in its own of `count` lines, and a header in the first."""
    used = dict.fromkeys(
        title for one in found for title, value in one.axes.items() if title[0] != "E" or value
    )
    titles = sorted(used, key=lambda title: title[0] == "E")
    lines = [""] * max(count, 2)
    for pose, one in sorted(_numbered(found), key=lambda both: both[1].line):
        cells = (repr(one.axes[title]) if title in one.axes else "" for title in titles)
        lines[one.line - 1] = "\t".join([str(pose), *cells])
    if lines[0]:
        lines.insert(0, "")
    return "\n".join(["\t".join(["pose", *titles]), *lines[1:], ""]).encode()


_MARKS = (b"AXIS", b"JOINTTARGET", b"/POS")
"""Keywords, one of which is in every such file."""
_LARGEST = 4_000_000
"""Maximum size of a file [byte]; programs are smaller."""


def _krl(text: str) -> Iterator[_Point]:
    units = {"A": "deg", "E": "mm"}
    for one in (*_KRL.finditer(text), *_KRL_ARM.finditer(text)):
        values = _KRL_AXIS.findall(one["axes"].upper())
        axes = {f"{a}{k} [{units[a]}]": float(x) for a, k, x in values}
        yield _Point(_line(text, one), one["name"].lstrip("xX$") or one["name"], axes)


def _rapid(text: str) -> Iterator[_Point]:
    for one in _RAPID.finditer(text):
        arm, more = ([float(x) for x in re.findall(_NUMBER, one[part])] for part in ("arm", "more"))
        axes = {f"A{k} [deg]": x for k, x in enumerate(arm, 1)}
        axes |= {f"E{k} [mm]": x for k, x in enumerate(more, 1) if abs(x) < _NONE}
        yield _Point(_line(text, one), one["name"], axes if len(arm) == _ARM else {})


def _tp(text: str) -> Iterator[_Point]:
    own = {"J": "A", "E": "E"}
    for one in _TP.finditer(text):
        values = _TP_AXIS.findall(one["body"])
        axes = {f"{own[a]}{k} [{unit}]": float(x) for a, k, x, unit in values}
        yield _Point(_line(text, one), one["name"] or f"p{one['number']}", axes)


def _jbi(text: str) -> Iterator[_Point]:
    """Positions of a job in pulses; they count from 0, poses from 1."""
    found: dict[str, _Point] = {}
    for one in _JBI.finditer(text) if "///PULSE" in text else ():
        axes = zip(_JBI_AXES[bool(one["of"])], re.findall(_NUMBER, one["axes"]), strict=False)
        new = {f"{axis} [pulses]": float(x) for axis, x in axes}
        point = found.get(one["number"], _Point(_line(text, one), f"p{int(one['number']) + 1}", {}))
        found[one["number"]] = point._replace(axes=point.axes | new)
    yield from found.values()


def _line(text: str, found: re.Match[str]) -> int:
    return text.count("\n", 0, found.start()) + 1


def _numbered(points: Sequence[_Point]) -> list[tuple[int, _Point]]:
    """Points that are poses, with their numbers."""
    by_stem = _by_stem(points)
    known = [stem for stem in _POSES if stem in by_stem]
    chosen = known[:1] or ([*by_stem] if len(by_stem) == 1 else [])
    own = [both for stem in chosen for both in by_stem[stem]]
    if own and len({pose for pose, _ in own}) == len(own):
        return own
    return list(enumerate(sorted(points), 1))


def _by_stem(points: Sequence[_Point]) -> dict[str, list[tuple[int, _Point]]]:
    """Numbered points by name stem, with their numbers."""
    found: dict[str, list[tuple[int, _Point]]] = {}
    for one in points:
        if match := _NAMED.fullmatch(one.name):
            found.setdefault(match["stem"].lower(), []).append((int(match["number"]), one))
    return found
