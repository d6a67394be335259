"""How often `check` names the wrong line of campaign.toml, and how often it names a right one.

Campaigns are drawn at random: robot, poses, reflectors, form of the export, and errors of the robot
itself. One entry of campaign.toml is then made wrong: a measured tool point by 5 mm or more, a base
point by 20 mm or more, the unit, the decimal mark, the unit of angles or their sense. In as many
others nothing is wrong. `python -m bench check`.
"""

from __future__ import annotations

import csv
import io
import tomllib
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from pipeline.base import toml
from pipeline.check.wrong_lines import wrong_lines
from pipeline.machine.robot import SHIPPED
from pipeline.simulate import Plan, simulate
from pipeline.simulate.plan import BASE, TOOL
from pipeline.store.campaign import in_memory

SEED = 17
DRAWS = 200
KINDS = ("tool", "base_frame", "unit", "decimal", "angle", "horizontal")
UNITS = {"mm": 1e3, "m": 1.0, "in": 1 / 0.0254}
SENSES = ("counter-clockwise", "clockwise")
ANGLES = {"deg": 180 / np.pi, "rad": 1.0, "gon": 200 / np.pi}
EFFECTS = ("", "joint_offset:3=1e-3", "joint_offset:6=2e-3", "gravity_sag", "rail_roll")


def plan(rng: np.random.Generator) -> Plan:
    """A campaign: three or four targets, three to six base reflectors, five to fourteen poses."""
    robot = str(rng.choice(SHIPPED))
    rail = robot.startswith("kr500")
    tool = {name: tuple(np.add(at, rng.normal(0, 0.02, 3))) for name, at in TOOL.items()}
    tool |= {f"P{k}": tuple(rng.uniform(-0.25, 0.25, 3)) for k in range(4, 4 + rng.integers(0, 2))}
    length = 19.0 if rail else 3.0
    corners = list(BASE.values())
    base = {
        f"B{k + 1}": tuple(np.multiply(corners[k % 4], (1, length / 19, 1)) + rng.normal(0, 0.2, 3))
        for k in range(rng.integers(3, 7))
    }
    effect = str(rng.choice(EFFECTS))
    effects = [effect] if effect and (rail or effect != "rail_roll") else []
    return Plan(
        name="drawn",
        robot=robot,
        seed=int(rng.integers(1 << 31)),
        poses={"count": int(rng.integers(5, 15))},
        tool={name: [float(x) for x in at] for name, at in tool.items()},
        base_frame={name: [float(x) for x in at] for name, at in base.items()},
        hidden={"effects": effects},
    )


def table(plain: bytes, unit: str, decimal: str, angle: str | None) -> bytes:
    """Readings of a plain export as a table with semicolons and without units."""
    rows = list(csv.DictReader(io.StringIO(plain.decode())))
    xyz = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows]) * 1e-3
    if angle is None:
        numbers = xyz * UNITS[unit]
    else:
        x, y, z = xyz.T
        distance = np.linalg.norm(xyz, axis=1)
        turn = ANGLES[angle]
        around, down = np.arctan2(y, x) * turn, np.arccos(z / distance) * turn
        numbers = np.column_stack([around, down, distance * UNITS[unit]])
    lines = ["Serie;Punkt;a;b;c"]
    for row, values in zip(rows, numbers, strict=True):
        cells = [f"{value:.7f}".replace(".", decimal) for value in values]
        lines.append(";".join([row["group"], row["target"], *cells]))
    return "\n".join([*lines, ""]).encode()


def spoilt(kind: str, said: dict[str, Any], rng: np.random.Generator) -> list[str]:
    """Make one entry wrong in place; return its path."""
    tracker = said["tracker"]
    if kind in ("tool", "base_frame"):
        names = [name for name in said[kind] if name != "load_point"]
        name = str(rng.choice(names))
        low, high = (0.005, 0.3) if kind == "tool" else (0.02, 2.0)
        off = rng.normal(size=3)
        off *= np.exp(rng.uniform(np.log(low), np.log(high))) / np.linalg.norm(off)
        said[kind][name] = [float(x) for x in np.add(said[kind][name], off)]
        return [kind, name]
    others = {"unit": UNITS, "decimal": ".,", "angle": ANGLES, "horizontal": SENSES}[kind]
    tracker[kind] = str(rng.choice([one for one in others if one != tracker[kind]]))
    return ["tracker", kind]


def drawn(seed: int, kind: str | None) -> tuple[dict[str, bytes], int | None]:
    """Files of a campaign with one wrong entry, and its line; None if nothing is wrong."""
    rng = np.random.default_rng([SEED, seed])
    made = simulate(plan(rng))
    files, said = dict(made.files), tomllib.loads(made.files["campaign.toml"].decode())
    unit, decimal = str(rng.choice(list(UNITS))), str(rng.choice([".", ","]))
    polar = kind in ("angle", "horizontal") or (kind is not None and rng.random() < 0.2)
    angle = str(rng.choice(list(ANGLES))) if polar else None
    axes = ("azimuth", "vertical", "range") if polar else ("x", "y", "z")
    files["tracker.csv"] = table(files["tracker.csv"], unit, decimal, angle)
    mapping = {
        "columns": {"group": "Serie", "target": "Punkt", **dict(zip(axes, "abc", strict=True))}
    }
    said["tracker"] |= {"unit": unit, "decimal": decimal, "mapping": mapping}
    if angle is not None:
        said["tracker"] |= {"coordinates": "spherical", "angle": angle, "vertical": "zenith"}
        said["tracker"]["horizontal"] = "counter-clockwise"
    path = [] if kind is None else spoilt(kind, said, rng)
    text = toml.dumps(said)
    files["campaign.toml"] = text.encode()
    return files, line_of(text, path) if path else None


def line_of(text: str, path: list[str]) -> int:
    """Line of a key in its table, in text written by `toml.dumps`."""
    table = ""
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("["):
            table = line.strip("[]")
        elif table == path[0] and line.startswith(f"{path[1]} ="):
            return number
    raise KeyError(path)


def named(seed: int, kind: str | None) -> str:
    """`right`, `among` (named with others), `silent` or `wrong`."""
    files, line = drawn(seed, kind)
    found = [one.line for one in wrong_lines(in_memory(files))]
    if line is None or not found:
        return "wrong" if found else "silent"
    if found[0] != line:
        return "among" if line in found else "wrong"
    return "right" if len(found) == 1 else "among"


def run(draws: int = DRAWS) -> Iterator[tuple[str, float, str]]:
    """Fraction of wrong entries named, by kind, and of good campaigns without finding."""
    count = draws // len(KINDS)
    for kind in (*KINDS, None):
        said = Counter(named(seed, kind) for seed in range(count))
        good = said["silent" if kind is None else "right"] / count
        yield f"check: {kind or 'nothing wrong'}", good, f"{count} campaigns, {dict(said)}"
