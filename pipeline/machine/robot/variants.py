"""Robots that result from a wrong sign or a wrong DH convention in a table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

from pipeline.base import toml
from pipeline.machine.robot.dh_parameters import file_of
from pipeline.machine.robot.mdh import Robot, RobotFile, placements

_LENGTHS = {"a_m": "a", "d_m": "d", "r_m": "r"}
_VISIBLE_M = 0.01
"""Length below which a wrong sign would go unnoticed [m]."""


@lru_cache(maxsize=4)  # a screening asks for those of one robot several times
def variants(robot: Robot) -> tuple[tuple[str, Robot], ...]:
    """The robot with one sign of its table reversed, or its table read in the other convention.

    Returns:
        `d_5`, `alpha_3`, `standard_dh` or `modified_dh`, and the robot, of each.
    """
    return tuple(_variants(robot))


def _variants(robot: Robot) -> Iterator[tuple[str, Robot]]:
    file = file_of(robot)
    for j, row in enumerate(file.joint):
        for key, letter in _LENGTHS.items():
            if abs(getattr(row, key) or 0.0) > _VISIBLE_M:
                yield f"{letter}_{j + 1}", with_row(robot, file, j, {key: -getattr(row, key)})
        if row.alpha_deg % 180:
            yield f"alpha_{j + 1}", with_row(robot, file, j, {"alpha_deg": -row.alpha_deg})
    other, name = other_convention(file)
    yield name, as_written(robot, other)


def with_row(robot: Robot, file: RobotFile, j: int, change: dict[str, float]) -> Robot:
    """The robot of a file with other entries in row j, from 0."""
    rows = [*file.joint[:j], file.joint[j].model_copy(update=change), *file.joint[j + 1 :]]
    return as_written(robot, file.model_copy(update={"joint": rows}))


def as_written(robot: Robot, file: RobotFile) -> Robot:
    """The robot with the geometry, and the text, of another file."""
    placement, flange = placements(file)
    entries: dict[str, object] = {"convention": file.convention}
    ends = {"base": file.base, "flange": file.flange}
    entries |= {name: end.model_dump() for name, end in ends.items() if end is not None}
    rows = {"joint": [row.model_dump(exclude_none=True) for row in file.joint]}
    text = toml.dumps(toml.loads(robot.text, robot.name) | entries | rows)
    return replace(robot, placement=placement, flange=flange, text=text)


def other_convention(file: RobotFile) -> tuple[RobotFile, str]:
    """The same letters under the other convention; Khalil's d and r are Craig's a and d."""
    if file.convention == "standard":
        return file.model_copy(update={"convention": "craig"}), "modified_dh"
    rows = file.joint
    if file.convention == "khalil":
        rows = [
            row.model_copy(update={"a_m": row.d_m, "d_m": row.r_m or 0.0, "r_m": None})
            for row in rows
        ]
    return file.model_copy(update={"joint": rows, "convention": "standard"}), "standard_dh"


def alike(robot: Robot, other: Robot) -> bool:
    """Whether two robots have the same joints by name and type, so that they are exchangeable."""
    rows = [[(joint.name, joint.prismatic) for joint in one.joints] for one in (robot, other)]
    return rows[0] == rows[1]


def differing(robot: Robot, other: Robot) -> str | None:
    """The one length, `d_5`, by which two tables with the same joints differ visibly.

    None if there are none or several, or if their conventions differ.
    """
    one, two = file_of(robot), file_of(other)
    if one.convention != two.convention:
        return None
    apart = [
        f"{letter}_{j}"
        for j, (a, b) in enumerate(zip(one.joint, two.joint, strict=True), 1)
        for key, letter in _LENGTHS.items()
        if abs((getattr(a, key) or 0.0) - (getattr(b, key) or 0.0)) > _VISIBLE_M
    ]
    return apart[0] if len(apart) == 1 else None
