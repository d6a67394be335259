"""Tables of points as any program might write them, with their meaning; independent of readers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import datetime, timedelta

PER_METRE = {"mm": 1000.0, "m": 1.0, "in": 1 / 0.0254, "cm": 100.0, "ft": 1 / 0.3048}
PER_RADIAN = {"deg": 180 / math.pi, "gon": 200 / math.pi, "rad": 1.0}
LONG = {"mm": "Millimeters", "m": "Meters", "in": "Inches", "cm": "Centimeters", "ft": "Feet"}
TIMES = ["%Y-%m-%dT%H:%M:%S", "%d.%m.%Y %H:%M:%S", "%m/%d/%y %H:%M:%S", "%Y-%m-%d %H:%M:%S"]
NAMES = {
    "target": ["Point", "Name", "Target", "Point Name", "Punkt", "PointID", "Messpunkt", "target"],
    "group": ["Group", "Point Group", "Gruppe", "group", "Serie", "Arm", "Pose"],
}
AXIS = ["{a} [{u}]", "{a}_{u}", "{a} ({u})", "{a}", "Pos {a} [{u}]", "{a}-Koordinate [{u}]",
        "{a} {u}", "Measured {a} ({u})", "Coord{A}"]  # fmt: skip
POLAR = [
    ("Hz [{w}]", "V [{w}]", "D [{u}]"),
    ("Azimuth ({w})", "{vertical} ({w})", "Distance ({u})"),
    ("Az", "{vertical}", "Range"),
    ("Horizontal Angle [{w}]", "Vertical Angle [{w}]", "Slope Distance [{u}]"),
    ("Theta [{w}]", "Phi [{w}]", "R [{u}]"),
]
TRADES = {"Hz [{w}]": "clockwise", "Horizontal Angle [{w}]": "clockwise",
          "Theta [{w}]": "counter-clockwise"}  # fmt: skip
"""Conventional sense of angles by title."""
PREAMBLE = [
    "Export of a measurement", "Job: hall 3", "Instrument: AT960 750123", "Operator;Jane;Doe",
    ";;;;;;", "Reflector radius 19.05 mm", "Date 2026-11-03", "Temperature 20.5 deg C, 1013 hPa",
    "Remark, nothing, to, see, here", "1 of 3", "",
    "Units: temperature degC, radius mm", "Unit of the offsets: inch",
]  # fmt: skip


@dataclass
class Written:
    """A table in a file, and what it means.

    Attributes:
        data: Content of the file.
        points: Group, target and Cartesian coordinates [m] of each row; names None where none.
        times: Time of each row, None where the file has none.
        said: What somebody states of the file: unit and so on.
        kind: Kind of its coordinates.
        plain: Cartesian, its unit known, its columns titled or in the order x, y, z.
        told: How it was made, for the message of a failure.
    """

    data: bytes
    points: list[tuple[str | None, str | None, tuple[float, float, float]]]
    times: list[datetime] | None
    said: dict[str, str]
    kind: str
    plain: bool
    told: dict[str, object] = field(default_factory=dict)


def written(rng) -> Written:
    """One table with everything drawn at random."""

    def one(options):
        return options[int(rng.integers(len(options)))]

    def chance(p):
        return bool(rng.random() < p)

    kind = "cartesian" if chance(0.7) else "spherical"
    unit, angle = one(["mm", "mm", "mm", "m", "m", "in", "cm", "ft"]), one([*PER_RADIAN])
    vertical = one(["zenith", "elevation"])
    titled, separator = chance(0.65), one([";", ",", "\t", "|", " ", "; ", "  "])
    bare = separator.strip() or separator
    blank = separator.isspace() and separator != "\t"
    mark = "," if bare != "," and chance(0.4) else "."
    names = one(["none", "target", "target", "both", "both", "joined", "collection", "numbers"])
    digits = {"mm": one([3, 4, 6]), "m": one([6, 7]), "in": one([4, 5]),
              "cm": one([4, 5]), "ft": one([6, 7])}[unit]  # fmt: skip
    turns = digits if chance(0.3) else one([4, 5, 6])
    scene = _scene(rng, one(["tool", "tool", "strewn"]), names)
    start = datetime(2026, 11, int(rng.integers(13, 28)), int(rng.integers(0, 20)))
    form = one(TIMES) if chance(0.4) and not blank else None

    columns: list[tuple[str, list[str]]] = []
    columns += _names(one, names, scene)
    style = one(AXIS)
    polar, drawn = one(POLAR), one(["clockwise", "counter-clockwise"])
    written_by_sa = names == "joined" or (titled and names == "collection")
    trade = TRADES.get(polar[0]) if titled else None
    sense = trade or ("counter-clockwise" if written_by_sa else drawn)
    numbers, titles, truth = [], [], []
    spelling = "as programs read it" if blank else one([*[""] * 7, "thousands", "gaps", "minus"])
    for _, _, place in scene:
        row = [c * PER_METRE[unit] for c in place]
        if kind == "spherical":
            row = _polar(place, unit, angle, vertical, sense)
        shown = [f"{v:.{turns if kind == 'spherical' and k < 2 else digits}f}"
                 for k, v in enumerate(row)]  # fmt: skip
        numbers.append([_spelt(cell, spelling, mark, bare) for cell in shown])
        truth.append(_place([float(cell) for cell in shown], kind, unit, angle, vertical, sense))
    if kind == "cartesian":
        titles = [style.format(a=one([a, a.upper()]), A=a.upper(), u=unit) for a in "xyz"]
    else:
        words = {"u": unit, "w": angle, "vertical": vertical.title()}
        titles = [title.format(**words) for title in polar]
    measured = list(zip(titles, (list(c) for c in zip(*numbers, strict=True)), strict=True))
    if kind == "spherical" and not titled:
        orders = [(0, 1, 2), (2, 0, 1), (0, 2, 1)]
        measured = [measured[k] for k in one(orders[: 2 if angle == "rad" else 3])]
    columns += measured
    columns += _others(rng, one, chance, titled, blank, mark, len(scene), style, kind)
    times = None
    if form:
        times = [start + timedelta(seconds=20 * k) for k in range(len(scene))]
        columns.append((one(["Time", "Timestamp", "time"]), [t.strftime(form) for t in times]))
    if titled and chance(0.4):
        columns = [columns[k] for k in rng.permutation(len(columns))]
    if titled and chance(0.15):
        columns.insert(0, (one(["", "Index"]), [str(k) for k in range(len(scene))]))
    tail = titled is False and bare in ";," and chance(0.3)

    said, above = {}, []
    in_titles = titled and (unit in titles[-1] if kind == "spherical" else "{u}" in style)
    if not in_titles:
        if chance(0.4):
            ways = [f"Units: {LONG[unit]}", f"# Units: {unit}", f"Unit = {unit}"]
            above.append(one([*ways, f"Coordinates in {unit}", "row"]))
        elif chance(0.8):
            said["unit"] = unit
    below = above == ["row"] and titled
    above = [line for line in above if line != "row"]
    known = in_titles or below or bool(above) or bool(said)
    if kind == "spherical" and chance(0.5):
        said |= {"angle": angle, "vertical": vertical, "horizontal": sense}
    above += [one(PREAMBLE) for _ in range(int(rng.integers(0, 4)) * chance(0.5))]
    above = [above[k] for k in rng.permutation(len(above))]
    above = [f"# {line}" for line in above] if chance(0.3) else above
    if blank and any(" " in title or not title for title, _ in columns):
        columns = [(title.replace(" ", "_") or "n", cells) for title, cells in columns]
    quoted = chance(0.1) and not blank
    lines = _lines(columns, separator, titled, tail, quoted)
    if below:
        row = [f"[{unit}]" if title in titles else "[]" for title, _ in columns]
        row = [{**dict(zip(titles[:2], [f"[{angle}]"] * 2, strict=True))}.get(title, cell)
               if kind == "spherical" else cell
               for (title, _), cell in zip(columns, row, strict=True)]  # fmt: skip
        lines.insert(1, separator.join(row))
    end = one(["\n", "\r\n"])
    text = end.join([*above, *lines]) + end * chance(0.9)
    encodings = ["utf-8", "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252"]
    encoding = one(encodings[: 5 if spelling == "minus" else 6])
    points = [
        (g if names in ("both", "joined", "collection") else None,
         None if names == "none" else t, at)
        for (g, t, _), at in zip(scene, truth, strict=True)
    ]  # fmt: skip
    told = {"kind": kind, "unit": unit, "angle": angle, "vertical": vertical, "titled": titled,
            "sense": sense, "separator": separator, "mark": mark, "names": names, "said": said,
            "spelling": spelling, "encoding": encoding}  # fmt: skip
    plain = kind == "cartesian" and known
    return Written(text.encode(encoding), points, times, said, kind, plain, told)


def _spelt(cell, spelling, mark, separator):
    """A number as people write it: with thousands separators, or a typographic minus."""
    whole, _, rest = cell.partition(".")
    if spelling == "minus":
        whole = whole.replace("-", "\N{MINUS SIGN}")
    if spelling in ("thousands", "gaps"):
        usual = "." if mark == "," else ","
        gap = "\N{NO-BREAK SPACE}" if spelling == "gaps" or usual == separator else usual
        sign = "-" * whole.startswith("-")
        whole = sign + f"{int(whole.lstrip('-')):,}".replace(",", gap)
    return whole + mark + rest if rest else whole


def _scene(rng, what, names):
    """Group, target and position [m] of each reading, in the frame of a tracker."""
    targets = [f"P{k}" for k in range(1, 1 + int(rng.integers(3, 6)))]
    if names == "numbers":
        targets = [str(k + 1) for k in range(len(targets))]
    if rng.random() < 0.1 and names != "numbers":
        targets = [name.replace("P", "Prüf") for name in targets]
    groups = [f"pose{k + 1:02d}_rep0_unloaded" for k in range(int(rng.integers(2, 8)))]
    tool = rng.normal(0, 0.2, (len(targets), 3))
    out = []
    for group in groups:
        centre = rng.uniform(-1, 1, 3) * [6.0, 9.0, 2.0] + [7.0, 0.0, 0.5]
        turn = _turn(rng)
        for name, arm in zip(targets, tool, strict=True):
            place = centre + turn @ arm if what == "tool" else centre + rng.normal(0, 3, 3)
            out.append((group, name, tuple(float(c) for c in place)))
    return out


def _turn(rng):
    """A rotation, from the QR decomposition of a random matrix."""
    import numpy as np

    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def _polar(place, unit, angle, vertical, sense):
    """Azimuth, vertical angle and distance as shown by an instrument."""
    x, y, z = place
    distance = math.sqrt(x * x + y * y + z * z)
    up = math.asin(z / distance)
    first = math.atan2(y, x) if sense == "counter-clockwise" else math.atan2(-y, x)
    second = up if vertical == "elevation" else math.pi / 2 - up
    return [first * PER_RADIAN[angle], second * PER_RADIAN[angle], distance * PER_METRE[unit]]


def _place(row, kind, unit, angle, vertical, sense):
    """Position of a point according to the written numbers [m]."""
    if kind == "cartesian":
        return tuple(value / PER_METRE[unit] for value in row)
    azimuth, second, distance = row
    azimuth, second = azimuth / PER_RADIAN[angle], second / PER_RADIAN[angle]
    azimuth = azimuth if sense == "counter-clockwise" else -azimuth
    up = second if vertical == "elevation" else math.pi / 2 - second
    far = distance / PER_METRE[unit]
    level = far * math.cos(up)
    return (level * math.cos(azimuth), level * math.sin(azimuth), far * math.sin(up))


def _names(one, names, scene):
    group, target = [g for g, _, _ in scene], [t for _, t, _ in scene]
    if names == "none":
        return []
    if names in ("target", "numbers"):
        return [(one(NAMES["target"]), target)]
    if names == "joined":
        joined = [f"A::{g}::{t}" for g, t in zip(group, target, strict=True)]
        return [(one(NAMES["target"]), joined)]
    both = [(one(NAMES["group"]), group), (one(NAMES["target"]), target)]
    return [("Collection", ["A"] * len(scene)), *both] if names == "collection" else both


def _others(rng, one, chance, titled, blank, mark, n, style, kind):
    """Columns other than coordinates: only titles can tell them apart."""
    out: list[tuple[str, list[str]]] = []
    if not titled:
        if chance(0.05):
            out.append(("", [f"{20 + 0.1 * k:.1f}".replace(".", mark) for k in range(n)]))
        return out
    if chance(0.2):
        cells = [f"{20 + 0.1 * k:.1f}".replace(".", mark) for k in range(n)]
        out.append((one(["Temperature", "Temp [C]", "T_air"]), cells))
    if chance(0.2):
        out.append(
            (one(["Remark", "Comment", "Operator"]), [one(["ok", "Jane"]) for _ in range(n)])
        )
    if chance(0.2) and kind == "cartesian":
        cells = [[f"{v:.3f}".replace(".", mark) for v in rng.uniform(0, 0.05, n)] for _ in "xyz"]
        way = one(["d{a}", "R{a}", "Nominal {a}", "Goal {a}"])
        out += [(way.format(a=a.upper()), column) for a, column in zip("xyz", cells, strict=True)]
    if chance(0.1):
        out.append((one(["Weight", "Quality"]), ["1"] * n))
    return out


def _lines(columns, separator, titled, tail, quoted):
    def line(cells):
        cells = [f'"{cell}"' for cell in cells] if quoted else cells
        return separator.join(cells) + (separator.strip() * 3 if tail else "")

    rows = [line(row) for row in zip(*(cells for _, cells in columns), strict=True)]
    return [line([title for title, _ in columns]), *rows] if titled else rows
