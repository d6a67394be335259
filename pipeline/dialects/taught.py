"""Points in joint coordinates from controller programs and position logs, as a joint log.

KUKA (.dat, .src: `E6AXIS`, `AXIS`), ABB (.mod: `jointtarget`), FANUC (.ls: `/POS` in joints; the
listing of the current position, CURPOS, one file a pose), Yaskawa (.jbi: positions in pulses),
Kawasaki (.as: `.JOINTS`), Hyundai (.JOB: steps with axis values), Comau (.lsv: `JNTP`), Sinumerik
(.mpf: blocks `N100 X=.. A1=..`), Nachi (motions with `M1J`), Estun (.erd: `APOS`), joint states
of ROS with names and positions in each row, and rows
`POS 3 A1= 12.5 A2= ...` that a program wrote at each pose. A file is converted to a table with the
columns `pose` and one for each axis, each row in the line of its point, so that messages name the
line of the file.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from posixpath import basename, dirname, join, splitext
from typing import NamedTuple

from pipeline.base.patterns import natural
from pipeline.readers._text import text as decoded
from pipeline.readers.logs import SI

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
    r'^P\[(?P<number>\d{1,9})(?:[ \t]*:[ \t]*"(?P<name>[^"\n]*)")?\][ \t]*\{(?P<body>[^}]*)\}',
    re.MULTILINE,
)
_TP_AXIS = re.compile(rf"\b([JE])([1-9])[ \t]*=[ \t]*({_NUMBER})[ \t]*(deg|mm)")
_JBI = re.compile(
    r"^(?P<of>B?)C(?P<number>\d{1,9})[ \t]*=[ \t]*(?P<axes>[-+\d., \t]+)$", re.MULTILINE
)
_JBI_AXES = ("SLURBTE", ("E1", "E2", "E3"))
"""Axes of the arm, and of the base that moves it."""
_AS = re.compile(
    rf"^[ \t]*(?:POINT[ \t]+)?\#(?P<name>\w+)[ \t]*(?:=[ \t]*\#PPOINT[ \t]*\()?"
    rf"(?P<axes>(?:[ \t,]*{_NUMBER}){{6,9}})[ \t)]*$",
    re.MULTILINE | re.IGNORECASE,
)
_JOB = re.compile(
    r"^[ \t]*(?:'[ \t]*(?P<name>[^\n]*?)[ \t]*$|(?P<step>S\d+)[ \t]+MOVE\b[^(\n]*"
    rf"\((?P<axes>[ \t]*{_NUMBER}(?:[ \t]*,[ \t]*{_NUMBER}){{5,8}})[ \t]*\)[ \t]*A\b)",
    re.MULTILINE,
)
_CURPOS = re.compile(
    rf"^[ \t]*Joint[ \t]*(\d)[ \t]*:[ \t]*({_NUMBER})[ \t]*(deg|mm)\b", re.MULTILINE | re.IGNORECASE
)
_FILE = re.compile(r"(?:\x1c(?P<name>[^\n]*)\n|\A)(?P<text>[^\x1c]+)")
"""One of several files, each a point, that `gathered` puts behind each other."""
_ROW = re.compile(
    r"^(?P<before>[^=\n]*?)"
    rf"(?P<axes>(?:[;, \t]*\b(?:JT|[AJE])[1-9][ \t]*[=:][ \t]*{_NUMBER}){{4,}})",
    re.MULTILINE | re.IGNORECASE,
)
_ROW_AXIS = re.compile(rf"\b(JT|[AJE])([1-9])[ \t]*[=:][ \t]*({_NUMBER})", re.IGNORECASE)
_JNTP = re.compile(
    rf"^[ \t]*(?P<name>\w+)[ \t]+JNTP\b[^\n]*\n"
    rf"(?P<axes>(?:\s*\b[1-9][0-9]?[ \t]*:[ \t]*{_NUMBER})+)",
    re.MULTILINE | re.IGNORECASE,
)
_JNTP_AXIS = re.compile(rf"\b([1-9][0-9]?)[ \t]*:[ \t]*({_NUMBER})")
_WORD = re.compile(
    rf"(?<![\w$])(?:([A-Z]+)([1-9]?)[ \t]*=[ \t]*|([UVWXYZ])(?=[-+.\d]))({_NUMBER})(?![\w.(])"
)
"""A word of a block that may be an axis: `X=12.5`, `X12.5` or `A1=3`."""
_NO_AXES = {*"DFGHIKLMNPRST", "CR", "AR", "RND", "CHF", "CHR", "ACC"}
"""Other addresses of a block: number, feed, tool, parameter, radius."""
_INCREMENTS, _INCHES = re.compile(r"\bG91\b"), re.compile(r"\bG70?0\b")
_NACHI = re.compile(
    r"^[^'\n]*?\bM1J,[^(\n]*(?P<axes>\([^)\n]*\)(?:,M\dJ,[^(\n]*\([^)\n]*\))*)", re.MULTILINE
)
_APOS = re.compile(
    r'^[ \t]*(?P<name>\w+)[ \t]*=[ \t]*\{[^}\n]*"APOS"(?P<axes>[^}\n]*)\}', re.MULTILINE
)
_APOS_AXIS = re.compile(rf"\ba([1-9][0-9]?)[ \t]*=[ \t]*({_NUMBER})")
_STATE = re.compile(rf"(?P<names>(?:[A-Z_][\w/]*,){{4,}})(?P<values>{_NUMBER}(?:,{_NUMBER})*)",
                    re.IGNORECASE)  # fmt: skip
"""Names of joints in a row, each followed by a comma, and as many positions or more."""
_REMARK = re.compile(
    r"(?:^|(?<=[\s;]))(?:['!;]|--|//|MSG\(\"|REM[ \t]+\")[ \t]*(?P<stem>[^\W\d_][^\d\n]*?)[ _.:#-]*"
    r"(?P<number>\d{1,4})(?![.,]?\d)(?P<rest>[^\n]*)",
    re.MULTILINE,
)
"""A remark that begins with words and a number: `; POLOHA 3`."""
_OF_ROW = re.compile(r"[^\W\d_]+[ _-]*\d+(?=[\s;,:]*$)")
"""The name of the point before the axes of a row: `POS 3`."""
_NONE = 1e9
"""Limit from which a RAPID value means an axis that does not exist: 9E9."""
_NAMED = re.compile(r"(?P<stem>[^\W\d]*?)[ _-]*(?P<number>\d{1,9})")
_BLOCK = re.compile(r"[NG]\d+")
"""The number of a block, and what it does, are no names."""
_POSES = ("pose", "p", "pos", "point", "pt", "jpos", "j", "jnt", "pnt")
"""Name stems of points that are poses, if there are numbered points with other stems."""
_ARM = 6
"""Number of arm axes in a `jointtarget` [1]; the six others are external."""


class _Point(NamedTuple):
    """A point in joint coordinates.

    Attributes:
        line: Its line number.
        name: Its name.
        axes: Values by title, [deg] or [mm].
        called: How instructions of the program call it; empty if it is an instruction itself.
    """

    line: int
    name: str
    axes: dict[str, float]
    called: str = ""


@functools.lru_cache(maxsize=4)  # it is asked once for each candidate robot
def table(data: bytes) -> bytes | None:
    """Convert the points of a file to a tab-separated table; None if it has none.

    The number in its name is the pose of a point if all points to be used have a unique one (XP1,
    pose_02, P[3]), and that of a remark above the instruction that goes to it, if as many have one;
    otherwise all points are numbered by their order in the file. Points without a number (XHOME),
    and numbered points of another name if some are called p, pose or the like, are then not poses.
    """
    found = _points(data)
    return _written(found) if found else None


def unnumbered(data: bytes) -> dict[str, dict[str, float]]:
    """Points that are no poses, by name, as a home: axis values [deg] or [mm] by title."""
    found = _points(data)
    poses = {id(one) for _, one in _numbered(found)}
    others = [one for one in found if id(one) not in poses]
    return {one.name or f"line {one.line}": one.axes for k, one in enumerate(others)
            if one.name or one.axes not in [other.axes for other in others[:k]]}  # fmt: skip


def gathered(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """The files, those of one folder and suffix that hold one point each as one, by their glob.

    A listing of the current position is one pose, which the name of the file numbers.
    """
    alike: dict[str, list[str]] = {}
    for name, data in files.items():
        if len(data) <= _LARGEST and len(_CURPOS.findall(data.decode("latin-1"))) >= _ARM - 1:
            alike.setdefault(join(dirname(name), f"*{splitext(name)[1]}"), []).append(name)
    several = {kind: some for kind, some in alike.items() if len(some) > 1}
    left = {name: data for name, data in files.items() if name not in {*chain(*several.values())}}
    return left | {k: joined({one: files[one] for one in some}) for k, some in several.items()}


def joined(files: Mapping[str, bytes]) -> bytes:
    """Several files behind each other, in natural order, each below its name."""
    names = sorted(files, key=natural)
    stems = {name: splitext(basename(name))[0].encode() for name in names}
    return b"".join(b"\x1c" + stems[one] + b"\n" + files[one].strip() + b"\n" for one in names)


def _points(data: bytes) -> list[_Point]:
    """All points of a file."""
    ways = [way for way, mark in _FORMS if len(data) <= _LARGEST and mark.search(data)]
    text = decoded("", data).data.decode().replace("\r\n", "\n") if ways else ""
    return _as_remarked(text, [one for way in ways for one in way(text) if one.axes])


def _as_remarked(text: str, points: list[_Point]) -> list[_Point]:
    """Points under the numbers of remarks, if they number most, and as many as names do.

    Remarks that repeat the numbers of the names behind the motions say nothing else.
    """
    visits = [*_visits(text, points)] if points else []
    said = _by_remarks(visits)
    named = {id(one): number for number, one in _by_names(points)}
    if not said or 2 * len(said) < len(points) or len(said) < len(named):
        return points
    if _repeat_names({id(points[k]): n for k, n in _by_remarks(visits[::-1]).items()}, named):
        return points
    called = {k: f"pose{number}" for k, number in said.items()}
    return [one._replace(name=called.get(k, "")) for k, one in enumerate(points)]


def _repeat_names(behind: Mapping[int, int], named: Mapping[int, int]) -> bool:
    """Whether the numbers of remarks behind the motions are those of the names of their points."""
    return bool(behind) and behind.items() <= named.items()


def _by_remarks(
    visits: Sequence[tuple[int | None, re.Match[str] | None]],
) -> dict[int, int]:
    """Numbers of points, by their index, from remarks above or behind the instructions to go there.

    Each of the remarks that begin with the same words has a number of its own, and one point before
    the next of them.
    """
    families: dict[str, dict[int, list[int]]] = {}
    now: dict[str, int] = {}
    for at, remark in visits:
        if remark:
            now[" ".join(remark["stem"].lower().split())] = int(remark["number"])
        for stem, number in now.items() if at is not None else ():
            families.setdefault(stem, {}).setdefault(number, []).append(at or 0)
    kept = sorted(map(_one_to_one, families.values()), key=len, reverse=True)
    rivals = [one for one in kept[1:] if len(one) == len(kept[0])]
    return {} if not kept or any(one != kept[0] for one in rivals) else kept[0]


def _one_to_one(points: Mapping[int, Sequence[int]]) -> dict[int, int]:
    """The number of each point, if each number has one; that of the last is its first."""
    *most, _ = points.values()
    found = {some[0]: number for number, some in points.items()}
    alone = all(len({*some}) == 1 for some in most)
    return found if most and alone and len(found) == len(points) else {}


def _visits(
    text: str, points: Sequence[_Point]
) -> Iterator[tuple[int | None, re.Match[str] | None]]:
    """The index of the point to which each line goes, None if to none; and its remark."""
    lines = {one.line: k for k, one in enumerate(points) if not one.called}
    called = {one.called.lower(): k for k, one in enumerate(points) if one.called}
    for number, line in enumerate(text.split("\n"), 1):
        remark = _REMARK.search(line)
        words = re.findall(r"\w+(?:\[\d+\])?", line[: remark.start() if remark else None].lower())
        yield lines.get(number, next((called[w] for w in words if w in called), None)), remark


def _written(found: Sequence[_Point]) -> bytes:
    """Write points as a table, each in its own line, and a header in the first."""
    used = dict.fromkeys(
        title for one in found for title, value in one.axes.items() if title[0] != "E" or value
    )
    titles = sorted(used, key=lambda title: title[0] == "E")
    lines = [""] * max(2, *(one.line for one in found))
    for pose, one in sorted(_numbered(found), key=lambda both: both[1].line):
        cells = (repr(one.axes[title]) if title in one.axes else "" for title in titles)
        lines[one.line - 1] = "\t".join([str(pose), *cells])
    if lines[0]:
        lines.insert(0, "")
    return "\n".join(["\t".join(["pose", *titles]), *lines[1:], ""]).encode()


_LARGEST = 4_000_000
"""Maximum size of a file [byte]; programs are smaller."""


def _krl(text: str) -> Iterator[_Point]:
    units = {"A": "deg", "E": "mm"}
    for one in (*_KRL.finditer(text), *_KRL_ARM.finditer(text)):
        values = _KRL_AXIS.findall(one["axes"].upper())
        axes = {f"{a}{k} [{units[a]}]": float(x) for a, k, x in values}
        yield _Point(_line(text, one), one["name"].lstrip("xX$") or one["name"], axes, one["name"])


def _rapid(text: str) -> Iterator[_Point]:
    for one in _RAPID.finditer(text):
        arm, more = ([float(x) for x in re.findall(_NUMBER, one[part])] for part in ("arm", "more"))
        axes = {f"A{k} [deg]": x for k, x in enumerate(arm, 1)}
        axes |= {f"E{k} [mm]": x for k, x in enumerate(more, 1) if abs(x) < _NONE}
        yield _Point(_line(text, one), one["name"], axes if len(arm) == _ARM else {}, one["name"])


def _tp(text: str) -> Iterator[_Point]:
    own = {"J": "A", "E": "E"}
    for one in _TP.finditer(text):
        values = _TP_AXIS.findall(one["body"])
        axes = {f"{own[a]}{k} [{unit}]": float(x) for a, k, x, unit in values}
        called = f"p[{one['number']}]"
        yield _Point(_line(text, one), one["name"] or f"p{one['number']}", axes, called)


def _jbi(text: str) -> Iterator[_Point]:
    """Positions of a job in pulses; their names only count them."""
    found: dict[str, _Point] = {}
    for one in _JBI.finditer(text):
        axes = zip(_JBI_AXES[bool(one["of"])], re.findall(_NUMBER, one["axes"]), strict=False)
        new = {f"{axis} [pulses]": float(x) for axis, x in axes}
        point = found.get(one["number"], _Point(_line(text, one), "", {}, f"C{one['number']}"))
        found[one["number"]] = point._replace(axes=point.axes | new)
    yield from found.values()


def _in_order(values: str, arm: int = _ARM) -> dict[str, float]:
    """Axes of the arm, then those that move it."""
    axes = map(float, re.findall(_NUMBER, values))
    return {f"A{k} [deg]" if k <= arm else f"E{k - arm} [mm]": x for k, x in enumerate(axes, 1)}


def _as(text: str) -> Iterator[_Point]:
    for one in _AS.finditer(text):
        yield _Point(_line(text, one), one["name"], _in_order(one["axes"]), one["name"])


def _job(text: str) -> Iterator[_Point]:
    """Steps of a job, each called as the remark above it."""
    said = ""
    for one in _JOB.finditer(text):
        if one["step"]:
            yield _Point(_line(text, one), said or one["step"], _in_order(one["axes"]))
        said = one["name"] or ""


def _nachi(text: str) -> Iterator[_Point]:
    """Motions of a Nachi to points in joints, those of further mechanisms behind the arm's."""
    for one in _NACHI.finditer(text):
        values = re.sub(r"M\dJ", "", one["axes"])
        yield _Point(_line(text, one), "", _in_order(values))


def _apos(text: str) -> Iterator[_Point]:
    """Variables of an Estun; external axes are a7 and the following."""
    for one in _APOS.finditer(text):
        axes = _by_number_of_axis(_APOS_AXIS.findall(one["axes"]))
        yield _Point(_line(text, one), one["name"], axes, one["name"])


def _by_number_of_axis(values: Sequence[tuple[str, str]]) -> dict[str, float]:
    """Axes by their numbers, those of the arm first."""
    return {f"A{k} [deg]" if int(k) <= _ARM else f"E{int(k) - _ARM} [mm]": float(x)
            for k, x in values}  # fmt: skip


def _curpos(text: str) -> Iterator[_Point]:
    """The position in each of several files, in the line of its number among them."""
    for number, one in enumerate(_FILE.finditer(text), 1):
        axes = {f"{'A' if unit == 'deg' else 'E'}{k} [{unit}]": float(x)
                for k, x, unit in _CURPOS.findall(one["text"].lower())}  # fmt: skip
        slides = [title for title in axes if title[0] == "E"]
        called = {title: f"E{k} [mm]" for k, title in enumerate(slides, 1)}
        yield _Point(number + 1, one["name"] or "", {called.get(t, t): x for t, x in axes.items()})


def _row(text: str) -> Iterator[_Point]:
    """Rows that name a point and each of its axes."""
    for one in _ROW.finditer(text):
        name = _OF_ROW.search(one["before"])
        if name and not _BLOCK.fullmatch(name[0]):
            values = _ROW_AXIS.findall(one["axes"].upper())
            axes = {f"{'E' if a == 'E' else 'A'}{k} [{'mm' if a == 'E' else 'deg'}]": float(x)
                    for a, k, x in values}  # fmt: skip
            yield _Point(_line(text, one), name[0], axes)


def _jntp(text: str) -> Iterator[_Point]:
    """Variables of a Comau; their names end in J for a position in joints."""
    for one in _JNTP.finditer(text):
        name = re.sub(r"(?<=\d)J$", "", one["name"], flags=re.IGNORECASE)
        axes = _by_number_of_axis(_JNTP_AXIS.findall(one["axes"]))
        yield _Point(_line(text, one), name, axes, one["name"])


def _blocks(text: str) -> Iterator[_Point]:
    """Blocks of a Sinumerik; an axis that a block does not name stays where it is.

    Of the axes whose names end in 1, 2, 3 and 4 at least, those turn; other words are lengths.
    """
    if _INCREMENTS.search(text):
        return
    rows = [_words(line.partition(";")[0].upper()) for line in text.split("\n")]
    title = _titles_of_words(rows, "in" if _INCHES.search(text) else "mm")
    now: dict[str, float] = {}
    for line, row in enumerate(rows, 1):
        here = {title[word]: value for word, value in row.items() if word in title}
        now |= here
        if here and len(now) == len(title):
            yield _Point(line, "", {one: now[one] for one in title.values()})


def _words(block: str) -> dict[tuple[str, str], float]:
    """Values by name and number of the words of a block that may be axes."""
    found = ((one[1] or one[3], one[2] or "", float(one[4])) for one in _WORD.finditer(block))
    return {(stem, k): value for stem, k, value in found if stem not in _NO_AXES}


def _titles_of_words(
    rows: Sequence[Mapping[tuple[str, str], float]], unit: str
) -> dict[tuple[str, str], str]:
    """Our titles for words: axes that turn, and what moves in the same blocks."""
    every = [*chain(*rows)]
    stems = sorted({stem for stem, k in every if k == "4"} - {"E"})
    turn = "A" if "A" in stems else "".join(stems[:1])
    arm = sorted({(stem, k) for stem, k in every if k and stem == turn})
    slides = dict.fromkeys(chain(*(row for row in rows if not row.keys().isdisjoint(arm))))
    called = (word for word in slides if word not in arm)
    titles = {word: f"A{word[1]} [deg]" for word in arm}
    return titles | {word: f"E{k} [{unit}]" for k, word in enumerate(called, 1)}


def _states(text: str) -> Iterator[_Point]:
    """Joint states of ROS, each row with the names of the joints and their positions in SI."""
    rows = [(n, one) for n, line in enumerate(text.split("\n"), 1) if (one := _STATE.search(line))]
    if len({one["names"] for _, one in rows}) != 1 or len(rows) > _SNAPSHOTS:
        return
    words = rows[0][1]["names"].split(",")[:-1]
    for line, one in rows:
        values = [*map(float, one["values"].split(","))]
        names = words[len(words) - _joints(len(words), len(values)) :]
        if names and len({*names}) == len(names):
            axes = zip(names, values, strict=False)
            yield _Point(line, "", {f"{name} [{SI}]": x for name, x in axes})


def _joints(words: int, values: int) -> int:
    """Number of joints: all have a position, and all or none a velocity and an effort.

    Words before their names, as of a frame, are none.
    """
    fitting = (k for k in range(words, 3, -1) if values in (k, 2 * k, 3 * k))
    return next(fitting, 0)


_SNAPSHOTS = 500
"""Maximum number of rows that were written one at a pose [1]; more are a recording."""


_FORMS: Sequence[tuple[Callable[[str], Iterator[_Point]], re.Pattern[bytes]]] = tuple(
    (way, re.compile(mark, re.IGNORECASE))
    for way, mark in (
        (_krl, rb"AXIS"),
        (_rapid, rb"JOINTTARGET"),
        (_tp, rb"/POS"),
        (_jbi, rb"///PULSE"),
        (_as, rb"\.JOINTS|#PPOINT"),
        (_job, rb"MECHTYPE"),
        (_curpos, rb"\n[ \t]*Joint[ \t]*4[ \t]*:"),
        (_nachi, rb"\bM1J,"),
        (_apos, rb'"APOS"'),
        (_jntp, rb"\bJNTP\b"),
        (_blocks, rb"\n[ \t]*N\d+[ \t][^;\n]*\b[A-Z]+4[ \t]*="),
        (_states, rb"(?:[,\n][A-Z_][\w/]*){4},[-+]?[\d.]"),
        (_row, rb"\b(?:JT|[AJ])4[ \t]*[=:][ \t]*[-+.\d]"),
    )
)
"""How points are written, and what is in every such file."""


def _line(text: str, found: re.Match[str]) -> int:
    return text.count("\n", 0, found.start()) + 1


def _numbered(points: Sequence[_Point]) -> list[tuple[int, _Point]]:
    """Points that are poses, with their numbers."""
    return _by_names(points) or list(enumerate(sorted(points, key=lambda one: one.line), 1))


def _by_names(points: Sequence[_Point]) -> list[tuple[int, _Point]]:
    """Points whose names number them; none if numbers occur twice."""
    by_stem = _by_stem(points)
    known = [stem for stem in _POSES if stem in by_stem]
    chosen = known[:1] or ([*by_stem] if len(by_stem) == 1 else [])
    own = [both for stem in chosen for both in by_stem[stem]]
    several = len({pose for pose, _ in own}) != len({one.name for _, one in own})
    return [] if several else own


def _by_stem(points: Sequence[_Point]) -> dict[str, list[tuple[int, _Point]]]:
    """Numbered points by name stem, with their numbers."""
    found: dict[str, list[tuple[int, _Point]]] = {}
    for one in points:
        if match := _NAMED.fullmatch(one.name):
            found.setdefault(match["stem"].lower(), []).append((int(match["number"]), one))
    return found
