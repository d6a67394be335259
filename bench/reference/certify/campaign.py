"""The files of a reference campaign, with every number exactly as written."""

from __future__ import annotations

import csv
import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpmath import mpf

from bench.reference.certify.kinematics import Robot, Vector, degrees, read

ROBOTS = Path(__file__).parents[3] / "pipeline" / "machine" / "robot"
"""Folder of the robot files, which are data; a case may have its own."""

GROUP = re.compile(r"pose(\d+)_rep(\d+)_(unloaded|loaded)")
GRAVITY = mpf("9.80665")
NOTHING = mpf(0)

Key = tuple[int, int]
"""Pose and repeat."""


@dataclass
class Pull:
    """One pull, with the uncertainty of its force.

    Attributes:
        force: F_b [N].
        along: Standard uncertainty along it [N].
        across: Standard uncertainty of its direction, per axis across it [rad].
        weight: Number of the weight, None for a chain.
        mass_n: Standard uncertainty of that weight [N].
    """

    force: Vector
    along: Any = NOTHING
    across: Any = NOTHING
    weight: int | None = None
    mass_n: Any = NOTHING


@dataclass
class Campaign:
    """A campaign as numbers.

    Attributes:
        robot: DH parameters of its robot.
        q: Joint values of each pose [m] or [rad].
        tool: Points in the flange frame [m], including `load_point`.
        targets: Names of the other points.
        pulls: By pose and repeat.
        moved: Displacement of each target in each pull, F_b [m].
        zeros: Number of unloaded readings of each pose; 0 if displacements are given.
        sigma_m: Standard uncertainty per axis of a reading, or of a displacement; None if it is to
            be estimated from the residuals.
        gain: Relative standard uncertainty of the scale.
        zero_n: Standard uncertainty of the scale's zero [N].
        deformed: Whether equilibrium is that of the deflected robot.
        sigma_rad: Standard uncertainty of a pose's rotation; None if targets are measured.
        readings: Group, target and point [m], in the tracker's frame.
        base: Nominal positions of the base reflectors, F_b [m].
        said: campaign.toml.
    """

    robot: Robot
    q: dict[int, Vector]
    tool: dict[str, Vector]
    targets: list[str]
    pulls: dict[Key, Pull] = field(default_factory=dict)
    moved: dict[Key, dict[str, Vector]] = field(default_factory=dict)
    zeros: dict[int, int] = field(default_factory=dict)
    sigma_m: Any = None
    gain: Any = NOTHING
    zero_n: Any = NOTHING
    deformed: bool = False
    sigma_rad: Any = None
    readings: list[tuple[str, str, Vector]] = field(default_factory=list)
    base: dict[str, Vector] = field(default_factory=dict)
    said: dict[str, Any] = field(default_factory=dict)


def load(folder: Path) -> Campaign:
    """Read a campaign."""
    said = tomllib.loads((folder / "campaign.toml").read_text("utf-8"), parse_float=mpf)
    own = folder / said["robot"]
    robot = read(own if own.is_file() else ROBOTS / f"{said['robot']}.toml")
    tool = {name: [mpf(v) for v in point] for name, point in said["tool"].items()}
    one = Campaign(
        robot,
        _joints(folder, robot),
        tool,
        [name for name in tool if name != "load_point"],
        deformed=said.get("model", {}).get("equilibrium") == "deformed",
        sigma_rad=said.get("instrument", {}).get("sigma_rad"),
        base={n: [mpf(v) for v in p] for n, p in said.get("base_frame", {}).items()},
        said=said,
    )
    if "displacements" in said:
        _reduced(folder, one)
    else:
        _raw(folder, one)
    return one


def rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file by title."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _key(row: dict[str, str]) -> Key:
    return int(row["pose"]), int(row["repeat"])


def _three(row: dict[str, str], names: tuple[str, str, str]) -> Vector:
    return [mpf(row[name]) for name in names]


def _joints(folder: Path, robot: Robot) -> dict[int, Vector]:
    return {
        int(row["pose"]): [
            mpf(row[f"{one.name}_m"]) if one.slides else degrees(row[f"{one.name}_deg"])
            for one in robot.rows
        ]
        for row in rows(folder / "joints.csv")
    }


def _reduced(folder: Path, one: Campaign) -> None:
    one.sigma_m = one.said["displacements"].get("sigma_m")
    for row in rows(folder / "displacements.csv"):
        moved = _three(row, ("dx_m", "dy_m", "dz_m"))
        one.moved.setdefault(_key(row), {})[row["target"]] = moved
    for row in rows(folder / "forces.csv"):
        one.pulls[_key(row)] = Pull(_three(row, ("fx_n", "fy_n", "fz_n")))


def _raw(folder: Path, one: Campaign) -> None:
    """Readings already in F_b: loaded minus the mean of the zeros, chain and scale."""
    one.sigma_m = one.said["tracker"].get("sigma_m")
    for row in rows(folder / "tracker.csv"):
        point = [v / 1000 for v in _three(row, ("x_mm", "y_mm", "z_mm"))]
        one.readings.append((row["group"], row["target"], point))
    if one.base:
        return
    unloaded: dict[tuple[int, str], list[Vector]] = {}
    loaded: dict[Key, dict[str, Vector]] = {}
    for group, target, point in one.readings:
        pose, repeat, state = _parsed(group)
        if state == "unloaded":
            unloaded.setdefault((pose, target), []).append(point)
        else:
            loaded.setdefault((pose, repeat), {})[target] = point
    for (pose, _), points in unloaded.items():
        one.zeros[pose] = len(points)
    for key, points_ in loaded.items():
        one.moved[key] = {}
        for target in one.targets:
            zero = unloaded[key[0], target]
            mean = [sum(v) / len(zero) for v in zip(*zero, strict=True)]
            pairs = zip(points_[target], mean, strict=True)
            one.moved[key][target] = [a - b for a, b in pairs]
    _loads(folder, one, loaded)


def _parsed(group: str) -> tuple[int, int, str]:
    found = GROUP.fullmatch(group)
    if found is None:
        raise ValueError(f"{group} is no state of a pose")
    return int(found[1]), int(found[2]), found[3]


def _loads(folder: Path, one: Campaign, loaded: dict[Key, dict[str, Vector]]) -> None:
    scale = one.said.get("scale", {})
    constant, part = mpf(scale.get("sigma_n", 0)), mpf(scale.get("sigma_rel", 0))
    one.gain = mpf(scale.get("gain_sigma", 0))
    one.zero_n = mpf(scale.get("zero_sigma_n", 0))
    weights: dict[tuple[str, str], int] = {}
    for row in rows(folder / "loads.csv"):
        if row.get("mass_kg"):
            body = (row["mass_kg"], row["mass_sigma_kg"])
            number = weights.setdefault(body, len(weights))
            force = [mpf(0), mpf(0), -mpf(body[0]) * GRAVITY]
            pull = Pull(force, weight=number, mass_n=mpf(body[1]) * GRAVITY)
        else:
            pull = _chain(mpf(row["force_n"]), loaded[_key(row)], one, constant, part)
        one.pulls[_key(row)] = pull


def _chain(
    reading: Any, points: dict[str, Vector], one: Campaign, constant: Any, part: Any
) -> Pull:
    """F = F u with u along the chain; each of its ends is read with sigma_m per axis."""
    chain = [b - a for a, b in zip(points["Pl1"], points["Pl2"], strict=True)]
    length = sum(v * v for v in chain) ** mpf("0.5")
    along = (constant**2 + (part * reading) ** 2) ** mpf("0.5")
    across = mpf(2) ** mpf("0.5") * one.sigma_m / length
    return Pull([reading * v / length for v in chain], along, across)
