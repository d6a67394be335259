"""Points in axes, as controllers keep them: a joint log that is no table.

KUKA (.dat, .src: `E6AXIS`, `AXIS`), ABB (.mod: `jointtarget`), FANUC (.ls: `/POS` in joints).
A file becomes a table with the columns `pose` and one for each axis, each row in the line in which
its point stands, so that a message still names the line of the file.
"""

from __future__ import annotations

import re
from collections import Counter
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
_NONE = 1e9
"""What RAPID writes for an axis that there is not: 9E9."""
_NAMED = re.compile(r"(?P<stem>[A-Za-z_]*?)_*(?P<number>\d+)")
_POSES = ("pose", "p", "pos", "point", "pt", "jpos", "j")
"""How points are called that are poses, where others are numbered, too."""
_ARM = 6


class _Point(NamedTuple):
    """A point in axes.

    Attributes:
        line: Where it stands.
        name: What it is called.
        axes: Values by title, [deg] or [mm].
    """

    line: int
    name: str
    axes: dict[str, float]


def table(data: bytes) -> bytes | None:
    """The points of a file as a table between tabs; None where it holds none.

    A point is a pose by the number in its name where all poses have one (XP1, pose_02, P[3]), else
    by its place in the file. Points without a number beside such (XHOME), and numbered ones of
    another name where some are called p, pose or the like, are no poses.
    """
    if len(data) > _LARGEST or not any(
        word in data.upper() for word in (b"AXIS", b"JOINTTARGET", b"/POS")
    ):
        return None
    text = data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    found = [one for one in _points(text) if one.axes]
    if not found:
        return None
    moved = {title for one in found for title, value in one.axes.items()
             if title[0] != "E" or value}  # fmt: skip
    titles = sorted(moved, key=lambda title: (title[0] == "E", title))
    lines = [""] * max(text.count("\n") + 1, 2)
    for pose, one in sorted(_numbered(found), key=lambda both: both[1].line):
        cells = (repr(one.axes[title]) if title in one.axes else "" for title in titles)
        lines[one.line - 1] = "\t".join([str(pose), *cells])
    head = "\t".join(["pose", *titles])
    if lines[0]:
        lines.insert(0, "")
    return "\n".join([head, *lines[1:], ""]).encode()


_LARGEST = 4_000_000
"""Bytes; programs are smaller."""


def _points(text: str) -> Iterator[_Point]:
    for one in (*_KRL.finditer(text), *_KRL_ARM.finditer(text)):
        units = {"A": "deg", "E": "mm"}
        axes = {f"{a.upper()}{k} [{units[a.upper()]}]": float(x)
                for a, k, x in _KRL_AXIS.findall(one["axes"])}  # fmt: skip
        yield _Point(_line(text, one), one["name"].lstrip("xX$") or one["name"], axes)
    for one in _RAPID.finditer(text):
        arm, more = ([float(x) for x in re.findall(_NUMBER, one[part])] for part in ("arm", "more"))
        axes = {f"A{k} [deg]": x for k, x in enumerate(arm, 1)}
        axes |= {f"E{k} [mm]": x for k, x in enumerate(more, 1) if abs(x) < _NONE}
        yield _Point(_line(text, one), one["name"], axes if len(arm) == _ARM else {})
    for one in _TP.finditer(text):
        axes = {f"{'A' if a == 'J' else 'E'}{k} [{unit}]": float(x)
                for a, k, x, unit in _TP_AXIS.findall(one["body"])}  # fmt: skip
        yield _Point(_line(text, one), one["name"] or f"p{one['number']}", axes)


def _line(text: str, found: re.Match[str]) -> int:
    return text.count("\n", 0, found.start()) + 1


def _numbered(points: Sequence[_Point]) -> list[tuple[int, _Point]]:
    """The poses with their numbers."""
    named = [(one, _NAMED.fullmatch(one.name)) for one in points]
    stems = Counter(match["stem"].lower() for _, match in named if match)
    known = [stem for stem in _POSES if stem in stems]
    chosen = known[0] if known else max(stems, key=lambda stem: stems[stem], default=None)
    own = [(int(match["number"]), one) for one, match in named
           if match and match["stem"].lower() == chosen]  # fmt: skip
    if own and len({pose for pose, _ in own}) == len(own) and (known or len(stems) == 1):
        return own
    return list(enumerate(sorted(points), 1))
