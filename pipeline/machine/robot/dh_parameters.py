"""Entries ("letters") of a robot's kinematic table: their error twists, and the corrected table.

An error d of letter k is a small motion along or about an axis of a frame that some joint carries,
so that to first order a point p of the flange moves by d (omega_k x p + v_k), with its twist in
F_b. Names of letters do not depend on the convention of the table: lengths and twists lie along and
about x, offsets and zeros along and about z. Between axes that are nearly parallel a second
rotation, about y, keeps lengths and offsets small (Hayati and Mirmirani, J. Robotic Systems 2,
1985).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from pipeline.base import toml
from pipeline.base.arrays import Array, Locked
from pipeline.machine.robot import mdh
from pipeline.machine.robot.configuration import Configuration, rotation_about, translation_along
from pipeline.machine.robot.mdh import Joint, Robot, RobotFile, along_x, along_z, of_table
from pipeline.machine.robot.steps import Fixed

_PARALLEL = 0.2
"""Sine of the angle between axes below which they count as parallel [1]."""

_X, _Y, _Z = range(3)


@dataclass(frozen=True, eq=False)
class DhParameter(Locked):
    """One entry of a robot's table.

    Attributes:
        name: `link_length`, `link_offset`, `link_twist`, `axis_tilt`, `link_turn`, `joint_offset`.
        joint: Its row, from 1.
        key: Key in the robot file, in m or degrees.
        turns: True for an angle [rad], False for a length [m].
        carrier: Joint whose frame is the reference, 0 for F_b.
        step: Transformation from that frame to the one that has the axis, shape (4, 4).
        axis: 0, 1, 2 for x, y, z.
    """

    name: str
    joint: int
    key: str
    turns: bool
    carrier: int
    step: Array
    axis: int

    @property
    def label(self) -> str:
        """`link_length:3`."""
        return f"{self.name}:{self.joint}"

    @property
    def unit(self) -> str:
        """Unit of its value."""
        return "rad" if self.turns else "m"

    @property
    def meaning(self) -> str:
        """`correction of the length of link 3`; `{joint}` stands for the controller's axis."""
        if self.name in ("axis_tilt", "joint_offset"):
            what = "tilt of the axis" if self.name == "axis_tilt" else "zero"
            return f"correction of the {what} of {{joint}}"
        return f"correction of the {self.name.removeprefix('link_')} of link {self.joint}"


def dh_parameters(robot: Robot) -> tuple[DhParameter, ...]:
    """Every letter of a robot's table that moves its flange independently of the choice of F_b.

    Letters before the first joint, and the zero and offset of that joint, only define F_b and are
    left out.
    """
    file = file_of(robot)
    every = (one for one in dh_letters(file) if one.carrier)
    return tuple(one for one in every if one.joint > 1 or one.axis != _Z)


def file_of(robot: Robot) -> RobotFile:
    """The robot's file as it is written."""
    return _parsed(robot.text, robot.name)


@lru_cache(maxsize=64)
def _parsed(text: str, name: str) -> RobotFile:
    """Cached robot file; an estimate requests the letters of one robot a hundred times."""
    return RobotFile.model_validate(_table(text, name))


@lru_cache(maxsize=64)
def _table(text: str, name: str) -> Mapping[str, Any]:
    """Cached TOML content of a robot's text."""
    return MappingProxyType(toml.loads(text, name))


def dh_letters(file: RobotFile) -> Iterator[DhParameter]:
    """Every letter of a robot file's table, including those that only define F_b."""
    base = Fixed() if file.base is None else file.base
    for number, row in enumerate(file.joint, 1):
        if file.convention == "standard":
            yield from _of_x(row, number, file, number, along_z(row, file.convention))
        else:
            first = base.step if number == 1 else np.eye(4)
            yield from _of_x(row, number, file, number - 1, first)
        yield from _of_z(row, number, file)


def _of_x(
    row: Joint, number: int, file: RobotFile, carrier: int, step: Array
) -> Iterator[DhParameter]:
    """Length and twist of a row, and the tilt of an axis nearly parallel to its neighbour."""
    length = "d_m" if file.convention == "khalil" else "a_m"
    yield DhParameter("link_length", number, length, False, carrier, step, _X)
    yield DhParameter("link_twist", number, "alpha_deg", True, carrier, step, _X)
    if abs(np.sin(np.deg2rad(row.alpha_deg))) < _PARALLEL:
        behind = step @ along_x(row.model_copy(update={"beta_deg": 0.0}), file.convention)
        yield DhParameter("axis_tilt", number, "beta_deg", True, carrier, behind, _Y)


def _of_z(row: Joint, number: int, file: RobotFile) -> Iterator[DhParameter]:
    """Offset and zero of a row; the zero of a prismatic joint is a length, its turn an angle."""
    shift = "r_m" if file.convention == "khalil" else "d_m"
    names = ("joint_offset", "link_turn") if row.prismatic else ("link_offset", "joint_offset")
    yield DhParameter(names[0], number, shift, False, number, np.eye(4), _Z)
    yield DhParameter(names[1], number, "theta_deg", True, number, np.eye(4), _Z)


def twists(configuration: Configuration, wanted: Sequence[DhParameter]) -> Array:
    """Unit twist of each letter in F_b, shape (m, k, 6).

    Args:
        configuration: The robot at m joint vectors.
        wanted: k letters of its table.
    """
    m = len(configuration.q)
    out = np.empty((len(wanted), 6, m)).transpose(2, 0, 1)  # poses side by side, as in `configure`
    for k, letter in enumerate(wanted):
        R, o = np.broadcast_to(np.eye(3), (m, 3, 3)), np.zeros((m, 3))
        if letter.carrier:
            R, o = configuration.frame(letter.carrier)
        axis = R @ letter.step[:3, letter.axis]
        origin = o + R @ letter.step[:3, 3]
        out[:, k] = rotation_about(origin, axis) if letter.turns else translation_along(axis)
    return out


def changed(robot: Robot, wanted: Sequence[DhParameter], values: Array) -> Robot:
    """The robot with values [m] or [rad], shape (k,), added to letters of its table (and text)."""
    rows = [row.model_dump(exclude_none=True) for row in _shifted(robot, wanted, values)]
    content = dict(_table(robot.text, robot.name)) | {"joint": rows}
    return of_table(content, toml.dumps(content), robot.name).under(robot.gravity)


def moved(robot: Robot, wanted: Sequence[DhParameter], values: Array) -> Robot:
    """The robot placed as by `changed`, with rows and text as in its file: for an iteration."""
    rows = _shifted(robot, wanted, values)
    placement, flange = mdh.placements(file_of(robot).model_copy(update={"joint": rows}))
    return replace(robot, placement=placement, flange=flange)


def _shifted(robot: Robot, wanted: Sequence[DhParameter], values: Array) -> list[Joint]:
    rows = list(file_of(robot).joint)
    for letter, value in zip(wanted, values, strict=True):
        row, shift = rows[letter.joint - 1], np.rad2deg(value) if letter.turns else value
        now = (getattr(row, letter.key) or 0.0) + float(shift)
        rows[letter.joint - 1] = row.model_copy(update={letter.key: now})
    return rows


def nominal(robot: Robot, wanted: Sequence[DhParameter]) -> Array:
    """Tabulated value of each letter [m] or [rad], shape (k,)."""
    file = file_of(robot)
    items = [getattr(file.joint[one.joint - 1], one.key) or 0.0 for one in wanted]
    each = zip(wanted, items, strict=True)
    return np.array([np.deg2rad(s) if one.turns else s for one, s in each])
