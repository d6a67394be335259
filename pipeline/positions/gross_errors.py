"""Gross errors of the DH table: a turned mount, a wrong sign, a joint zero, another variant.

A real robot deviates from its table by millimetres; a mount turned by 90 deg shifts it by metres,
beyond the reach of a linear estimate. Each of a few candidate corrections is tried with tool and
frames fitted anew (`begin`). The best one is adopted if it reduces the median deviation to a third
or less, and the search continues from there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.effects._anatomy import rail, turning
from pipeline.machine.robot import SHIPPED, Robot, load
from pipeline.machine.robot.dh_parameters import DhParameter, dh_letters, file_of, nominal
from pipeline.machine.robot.steps import Fixed
from pipeline.machine.robot.variants import alike, as_written, differing, variants, with_row
from pipeline.positions import left_out
from pipeline.positions.initial import begin
from pipeline.positions.mechanism import ArmWeights, linearised
from pipeline.positions.readings import PositionReadings

_GROSS_ERROR_M = 0.01
"""Median deviation of the targets from the nominal robot [m] below which no gross error is sought:
a table as delivered is off by 1 mm and 1 mrad, three metres of reach and the sag by some
millimetres."""

_BETTER = 3.0
"""Minimum factor by which a correction must reduce the median deviation [1]."""

_ALIKE = 1.1
"""Ratio of median deviations up to which corrections count as twins [1], such as an arm turned by
180 deg and a rail counted backwards."""

_ENOUGH = 80
"""Approximate number of poses used; more would not change the decision."""

_MOST = 3
"""Maximum number of gross errors in one table."""


@dataclass(frozen=True)
class TableMistake:
    """A gross error in the robot file.

    Attributes:
        name: `mounted_turned`, `joint_offset`, `sign_or_convention`, `link_length`, `link_offset`.
        where: `carriage`, `arm`, `flange`, a joint from 1, or which sign, `d_5`, `standard_dh`.
        entry: Key in the robot file, `theta_deg`, in the row of `joint`; empty for a convention.
        joint: Row of the table, from 1; None for a convention.
        said: Value in the file [m] or [deg]; None for a sign or convention.
        value: Corrected value [m] or [deg]; None likewise.
        before: Median deviation of the targets from the nominal robot [m].
        after: The same with the entry corrected.
    """

    name: str
    where: str | int
    entry: str
    joint: int | None
    said: float | None
    value: float | None
    before: float
    after: float


class _Step(NamedTuple):
    name: str
    where: str | int
    robot: Robot


def _quarters(robot: Robot) -> Iterator[_Step]:
    """The robot with one joint or mount turned by 90, 180 or -90 deg."""
    joints, quarters = turning(robot), (90.0, 180.0, -90.0)
    mounts = {joints[-1]: "flange"} | ({joints[0]: "arm"} if rail(robot) else {})
    for joint in sorted(joints, key=lambda one: one not in mounts):
        name = "mounted_turned" if joint in mounts else "joint_offset"
        for degrees in quarters:
            yield _Step(name, mounts.get(joint, joint), turned(robot, joint, degrees))
    for degrees in quarters if rail(robot) else ():
        there = turned(robot, joints[0], degrees, "alpha_deg")
        yield _Step("mounted_turned", "carriage", there)


def _of_others(robot: Robot) -> Iterator[_Step]:
    """Shipped robots that differ from this one in a single DH parameter."""
    for name in SHIPPED:
        other = load(name)
        if name != robot.name and alike(robot, other) and differing(robot, other):
            letter = _apart(robot, other)
            if letter is not None:
                yield _Step(letter[0].name, letter[0].joint, other)


def _steps(robot: Robot) -> Iterator[_Step]:
    """Every robot that differs by a single wrong entry, the likelier of twins first."""
    yield from _quarters(robot)
    for joint in range(1, robot.n + 1):
        yield _Step("sign_or_convention", joint, counted_back(robot, joint))
    yield from _of_others(robot)
    for where, there in variants(robot):
        yield _Step("sign_or_convention", where, there)


def _apart(robot: Robot, other: Robot) -> tuple[DhParameter, float, float] | None:
    """The single DH parameter in which two tables differ, and both values [m] or [deg], if any."""
    every = tuple(dh_letters(file_of(robot)))
    one, two = nominal(robot, every), nominal(other, every)
    differ = np.flatnonzero(np.abs(two - one) > 1e-9)
    if len(differ) != 1:
        return None
    letter = every[int(differ[0])]
    said, value = (float(v[differ[0]]) for v in (one, two))
    if letter.turns:
        said, value = (180.0 - (180.0 - float(np.rad2deg(v))) % 360.0 for v in (said, value))
    return letter, said, value


def corrected(
    robot: Robot, readings: PositionReadings, weights: ArmWeights, tool: dict[str, Array]
) -> tuple[Robot, tuple[TableMistake, ...]]:
    """The robot with gross errors of its table corrected, and what they are.

    Args:
        robot: The robot as in its file.
        readings: All series.
        weights: Gravity and payloads on the arm.
        tool: Nominal points of targets, flange frame [m], where known.
    """
    some = np.arange(0, len(readings), max(len(readings) // _ENOUGH, 1))
    few, part = readings.part(some), weights.part(some)
    found: list[TableMistake] = []
    left = _off(robot, few, part, tool)
    while left > _GROSS_ERROR_M and len(found) < _MOST:
        tried = list(_steps(robot))
        after = [_off(one.robot, few, part, tool) for one in tried]
        best = int(np.argmax(np.array(after) <= _ALIKE * min(after)))
        if _BETTER * after[best] > left:
            break
        found.append(_mistake(robot, tried[best], left, after[best]))
        robot, left = tried[best].robot, after[best]
    return robot, tuple(found)


def _mistake(robot: Robot, step: _Step, before: float, after: float) -> TableMistake:
    apart = _apart(robot, step.robot)
    if apart is None:
        return TableMistake(step.name, step.where, "", None, None, None, before, after)
    letter, said, value = apart
    return TableMistake(step.name, step.where, letter.key, letter.joint, said, value, before, after)


def _off(
    robot: Robot, readings: PositionReadings, weights: ArmWeights, tool: dict[str, Array]
) -> float:
    """Median deviation of the targets from a nominal robot with tool and frames fitted [m]."""
    rows = linearised(readings, begin(robot, readings, tool), weights)
    return float(np.nanmedian(left_out.distances(rows.y, rows.read)))


def turned(robot: Robot, joint: int, degrees: float, key: str = "theta_deg") -> Robot:
    """The robot with some degrees added to an angle of one row: zero (theta) or twist (alpha)."""
    file, j = file_of(robot), joint - 1
    return with_row(robot, file, j, {key: getattr(file.joint[j], key) + degrees})


def counted_back(robot: Robot, joint: int) -> Robot:
    """The robot with one joint's sense reversed, Rz(-q) Tz(-r) = Rx(pi) Rz(q) Tz(r) Rx(-pi)."""
    file, j = file_of(robot), joint - 1
    rows, row = list(file.joint), file.joint[j]
    changes: dict[str, object] = {"theta_deg": -row.theta_deg, "alpha_deg": row.alpha_deg + 180.0}
    key = "r_m" if file.convention == "khalil" else "d_m"
    changes[key] = -(getattr(row, key) or 0.0)
    rows[j] = row.model_copy(update=changes)
    base, flange = file.base or Fixed(), file.flange or Fixed()
    if file.convention == "standard" and j:
        before = rows[j - 1]
        rows[j - 1] = before.model_copy(update={"alpha_deg": before.alpha_deg + 180.0})
    elif file.convention == "standard":
        roll, pitch, yaw = base.rpy_deg
        base = base.model_copy(update={"rpy_deg": (roll + 180.0, pitch, yaw)})
    elif joint < len(rows):
        behind = rows[j + 1]
        rows[j + 1] = behind.model_copy(update={"alpha_deg": behind.alpha_deg - 180.0})
    else:
        (x, y, z), (roll, pitch, yaw) = flange.xyz_m, flange.rpy_deg
        flange = Fixed(xyz_m=(x, -y, -z), rpy_deg=(roll + 180.0, -pitch, -yaw))
    return as_written(
        robot, file.model_copy(update={"joint": rows, "base": base, "flange": flange})
    )
