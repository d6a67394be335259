"""Mistakes between cell and folder: a beam break, swapped names, wrong units, a wrong sign.

Each blunder changes the operator's notebook, never the cell; the truth records what was done where.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.base import linear, toml
from pipeline.base.arrays import Array, Bools, Locked, Parameter
from pipeline.base.errors import UsageError, listed
from pipeline.machine.robot import Robot
from pipeline.machine.robot.dh_parameters import file_of
from pipeline.machine.robot.mdh import parse
from pipeline.machine.robot.variants import other_convention
from pipeline.readers import OutgoingReadings

KGF_N, _LBF_N, INCH_M = 9.80665, 4.4482216152605, 0.0254
"""Newtons in a kilogram-force and in a pound-force, metres in an inch; all exact by definition."""

_METRES = {"inch": INCH_M, "m": 1.0}
_NEWTONS = {"kgf": KGF_N, "lbf": _LBF_N}
_SISTER = {"kr500_rail": "kr500_rail_kuka", "kr500_rail_kuka": "kr500_rail"}


@dataclass(frozen=True, eq=False)
class Notebook(Locked):
    """The data that the operator is about to write down.

    Attributes:
        robot: Name of the robot in campaign.toml.
        robot_text: Its file, for a robot that does not ship with the pipeline.
        targets: Names of the measured targets.
        tool: Points of the effector in campaign.toml, flange frame [m].
        readings: Readings of the tracker.
        reading_n: Readings of the scale [N], shape (m,).
        prismatic: True for sliding joints, shape (n,).
        joints: Joint values in the units of the log (m, degrees), shape (p, n).
        controller: The same poses as values of the controller's axes (m, degrees), or no columns.
    """

    robot: str
    robot_text: str
    targets: tuple[str, ...]
    tool: Mapping[str, Sequence[float]]
    readings: OutgoingReadings
    reading_n: Array
    prismatic: Bools
    joints: Array
    controller: Array

    def reread(self, **changes: Any) -> Notebook:
        """The notebook with some columns of its readings changed."""
        return replace(self, readings=replace(self.readings, **changes))


_Act = Callable[[Notebook, str, Array, np.random.Generator], tuple[Notebook, str]]


@dataclass(frozen=True)
class _Blunder:
    """One kind of mistake.

    Attributes:
        name: As it is requested.
        places: Possible values of `where`; empty when it is a group or group/target of the
            campaign.
        size: Its size as a parameter, or none.
        act: From notebook, where (empty: drawn), size, rng: the wrong notebook and the place.
        called: Name in result.json, if different, such as `outlier`.
    """

    name: str
    places: tuple[str, ...]
    size: tuple[Parameter, ...]
    act: _Act
    called: str = ""


@dataclass(frozen=True, eq=False)
class PlantedBlunder(Locked):
    """A blunder with its place and size.

    Attributes:
        blunder: The kind of mistake.
        where: Its place, empty to have it drawn.
        size: Its size, SI, shape (1,) or (0,).
    """

    blunder: _Blunder
    where: str
    size: Array


def commit(text: str) -> PlantedBlunder:
    """Parse the blunder that `text` names, such as `outlier:pose03_rep1_loaded/P2=3e-4`.

    Raises:
        UsageError: It has no such place, or the size is not a number.
    """
    words, size = parts(text)
    name, _, where = words.partition(":")
    blunder = BLUNDERS[name]
    if where and blunder.places:
        _known(where, blunder.places)
    return PlantedBlunder(blunder, where, amounts(size, blunder.size, text))


def _outlier(
    notes: Notebook, where: str, size: Array, rng: np.random.Generator
) -> tuple[Notebook, str]:
    """Shift one reading of a target by `size` in a random direction."""
    hit, name = _one(notes, where, rng)
    direction = rng.standard_normal(3)
    off = size * direction / np.linalg.norm(direction)
    return _read(notes, hit, notes.readings.position[hit] + off), name


def _failed_lock(
    notes: Notebook, where: str, size: Array, rng: np.random.Generator
) -> tuple[Notebook, str]:
    """Replace a reading by the tracker's own position, as after a lost target."""
    hit, name = _one(notes, where, rng)
    return _read(notes, hit, np.zeros(3)), name


def _stale(
    notes: Notebook, where: str, size: Array, rng: np.random.Generator
) -> tuple[Notebook, str]:
    """Write the previous reading once more.

    Raises:
        UsageError: There is none before it.
    """
    hit, name = _one(notes, where, rng)
    if hit == 0:
        raise UsageError(f'nothing was read before "{name}"; choose a later reading.')
    return _read(notes, hit, notes.readings.position[hit - 1]), name


def _one(notes: Notebook, where: str, rng: np.random.Generator) -> tuple[int, str]:
    """Number and name of the requested reading, else of a random one of a measured target."""
    names = [f"{g}/{t}" for g, t in zip(notes.readings.group, notes.readings.target, strict=True)]
    of_pose = [i for i, target in enumerate(notes.readings.target) if target in notes.targets]
    hit = names.index(_known(where, names)) if where else int(rng.choice(of_pose))
    return hit, names[hit]


def _read(notes: Notebook, hit: int, at: Array) -> Notebook:
    """The notebook with one reading at another position [m]."""
    position = notes.readings.position.copy()
    position[hit] = at
    return notes.reread(position=position)


def _label_swap(
    notes: Notebook, where: str, size: Array, rng: np.random.Generator
) -> tuple[Notebook, str]:
    """Swap the names of two targets in one group."""
    groups = notes.readings.group
    of_pose = sorted({g for g in groups if g.endswith(("loaded", "unloaded"))})
    group = _known(where, of_pose) if where else str(rng.choice(of_pose))
    one, two = rng.choice(notes.targets, 2, replace=False)
    other = {str(one): str(two), str(two): str(one)}
    target = [
        other.get(t, t) if g == group else t
        for g, t in zip(groups, notes.readings.target, strict=True)
    ]
    return notes.reread(target=target), group


def _known(where: str, names: Sequence[str]) -> str:
    if where not in names:
        raise UsageError(f'there is no "{where}" here; choose from {listed(names)}.')
    return where


def _unit_mixup(
    notes: Notebook, where: str, size: Array, rng: np.random.Generator
) -> tuple[Notebook, str]:
    """Label numbers in one unit with another."""
    where = where or str(rng.choice(UNITS))
    if where in _METRES:
        return notes.reread(position=notes.readings.position * (1e-3 / _METRES[where])), where
    if where in _NEWTONS:
        return replace(notes, reading_n=notes.reading_n / _NEWTONS[where]), where
    joints = np.where(notes.prismatic, notes.joints, np.deg2rad(notes.joints))
    return replace(notes, joints=joints), where


def _sign_or_convention(
    notes: Notebook, where: str, size: Array, rng: np.random.Generator
) -> tuple[Notebook, str]:
    """Use another sign or convention than the stated one."""
    misread_robot, misread_as = misread(parse(notes.robot_text, "robot.toml"))
    other = {"Pl1": "Pl2", "Pl2": "Pl1"}
    wrong = {
        "controller_axes": replace(notes, joints=notes.controller),
        "left_handed": notes.reread(position=notes.readings.position * [1.0, -1.0, 1.0]),
        "pull_reversed": notes.reread(target=[other.get(t, t) for t in notes.readings.target]),
        "d_5": replace(notes, robot=_SISTER.get(notes.robot, notes.robot)),
        misread_as: replace(notes, robot="robot.toml", robot_text=misread_robot),
    }
    if notes.controller.shape != notes.joints.shape:
        del wrong["controller_axes"]
    if notes.robot not in _SISTER:
        del wrong["d_5"]
    possible = list(wrong)
    where = _known(where, possible) if where else str(rng.choice(possible))
    return wrong[where], where


def _tool_point(
    notes: Notebook, where: str, size: Array, rng: np.random.Generator
) -> tuple[Notebook, str]:
    """Shift a target's coordinates in [tool] by `size` in a random direction."""
    name = _known(where, notes.targets) if where else str(rng.choice(notes.targets))
    direction = rng.standard_normal(3)
    at = notes.tool[name] + size * direction / np.linalg.norm(direction)
    return replace(notes, tool={**notes.tool, name: at.round(6).tolist()}), name


UNITS = (*_METRES, *_NEWTONS, "rad")
_SIGNS = ("controller_axes", "left_handed", "pull_reversed", "d_5")
_CONVENTIONS = (*_SIGNS, "modified_dh", "standard_dh")
BLUNDERS: Mapping[str, _Blunder] = {
    blunder.name: blunder
    for blunder in (
        _Blunder("outlier", (), (Parameter("size", "m", 3e-4),), _outlier),
        _Blunder("failed_lock", (), (), _failed_lock, "outlier"),
        _Blunder("stale", (), (), _stale, "outlier"),
        _Blunder("label_swap", (), (), _label_swap),
        _Blunder("tool_point", (), (Parameter("size", "m", 0.01),), _tool_point),
        _Blunder("unit_mixup", UNITS, (), _unit_mixup),
        _Blunder(
            "sign_or_convention",
            _CONVENTIONS,
            (),
            _sign_or_convention,
        ),
    )
}
"""Every blunder, by its name."""


def controller_axes(robot: Robot, q: Array) -> Array:
    """Values of the controller's axes (m, degrees) at joint values q [m] or [rad], shape (p, n).

    No columns where the robot file does not map its controller.
    """
    if robot.controller_matrix.shape[1] != robot.n:
        return np.empty((len(q), 0))
    axes = linear.solve(robot.controller_matrix, (q - robot.controller_offset).T).T
    return np.where(robot.prismatic, axes, np.rad2deg(axes))


def parts(text: str) -> tuple[str, str]:
    """Name (with its place), and size as typed."""
    named, _, size = text.partition("=")
    return named.strip(), size.strip()


def amounts(size: str, parameters: tuple[Parameter, ...], text: str) -> Array:
    """A size in SI, shape (k,).

    Args:
        size: Empty for the typical size, `2x` for twice that, or one number per parameter in SI.
        parameters: Parameters that have the size.
        text: The whole input, for the message.

    Raises:
        UsageError: It is none of these.
    """
    typical = np.array([parameter.typical for parameter in parameters])
    times = re.fullmatch(r"(.+?)\s*x", size)
    try:
        if not size:
            return typical
        if times:
            return float(times[1]) * typical
        values = np.array([float(number) for number in size.split(",")])
    except ValueError as problem:
        raise UsageError(
            f'"{text}": {size} is no size; write a number in SI, or 2x for twice the typical size.'
        ) from problem
    if len(values) != len(typical) or not np.isfinite(values).all():
        wanted = ", ".join(f"{p.name} [{p.unit}]" for p in parameters) or "no size"
        raise UsageError(f'"{text}": it has {wanted}; give one number for each.')
    return values


def misread(robot: Robot) -> tuple[str, str]:
    """The robot's file with its letters under the other convention, and the true convention."""
    file = file_of(robot)
    wrong, _ = other_convention(file)
    text = toml.dumps(wrong.model_dump(exclude_none=True, exclude={"capsules", "capsules_source"}))
    return text, "standard_dh" if file.convention == "standard" else "modified_dh"
