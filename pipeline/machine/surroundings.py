"""Description of the cell in campaign.toml, a plan or a design problem: constraints on poses."""

from __future__ import annotations

from collections.abc import Mapping
from operator import not_ as _nothing
from typing import Annotated, Any

import numpy as np
from pydantic import AliasChoices, ConfigDict, Field, field_validator, model_validator

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError, listed
from pipeline.base.strict import Length, Misplaced, Name, Positive, Strict
from pipeline.machine.robot import Robot

_Point = tuple[Length, Length, Length]

_NO_DIRECTION = 1e-9
"""Length below which a vector gives no direction; longer ones are normalised."""


class _Acceptance(Strict):
    """Acceptance cone of a reflector about a direction, flange frame."""

    direction: _Point
    half_angle_deg: Annotated[float, Field(gt=0, le=180)]

    @field_validator("direction")
    @classmethod
    def points_somewhere(cls, direction: _Point) -> _Point:
        """Reject a zero vector; otherwise its length is irrelevant."""
        if np.linalg.norm(direction) < _NO_DIRECTION:
            raise ValueError("the direction is zero; give the one that the reflector faces")
        return direction


class Surroundings(Strict):
    """`[cell]`: surroundings of the robot, F_b; entries that are missing are not checked.

    Attributes:
        tracker_m: Origin of the tracker's beam [m].
        floor_z_m: Height of the floor [m]: arm, effector and reflectors stay above it.
        max_turn_deg: Maximum angle of a joint from its zero in either direction, because of cables
            and hoses along it; joint limits apply in addition [deg].
    """

    tracker_m: _Point | None = None
    floor_z_m: Length | None = None
    max_turn_deg: dict[Name, Annotated[float, Field(gt=0, le=1e5)]] = Field(default_factory=dict)


class _EffectorCapsule(Strict):
    """One `[[tool.capsules]]`: a body of the effector, flange frame [m]."""

    model_config = ConfigDict(serialize_by_alias=True)

    start: _Point = Field(
        validation_alias=AliasChoices("from", "from_m"), serialization_alias="from"
    )
    end: _Point = Field(validation_alias=AliasChoices("to", "to_m"), serialization_alias="to")
    radius: Positive = Field(validation_alias=AliasChoices("radius", "radius_m"))


def _is_table(value: object) -> bool:
    """Whether it is a table or a list of tables, unlike a point."""
    return isinstance(next(iter(value), None) if isinstance(value, list) else value, Mapping)


class Surrounded(Strict):
    """A file with a tool in a cell.

    Attributes:
        cell: The cell; None if the file has none, and then nothing of it is checked.
        tool_acceptance: Acceptance cone of each reflector, by name.
        tool_capsules: Bodies of the effector.
    """

    model_config = ConfigDict(serialize_by_alias=True)

    cell: Surroundings | None = Field(default=None, exclude_if=_nothing)
    tool_acceptance: dict[Name, _Acceptance] = Field(
        default_factory=dict, alias="tool.acceptance", exclude_if=_nothing
    )
    tool_capsules: list[_EffectorCapsule] = Field(
        default=[], alias="tool.capsules", exclude_if=_nothing
    )

    @model_validator(mode="before")
    @classmethod
    def points_and_bodies_apart(cls, content: Any) -> Any:
        """Separate the points of `[tool]` from its other tables, which become top-level keys."""
        tool = content.get("tool") if isinstance(content, Mapping) else None
        if not isinstance(tool, Mapping):
            return content
        inner = {f"tool.{key}": value for key, value in tool.items() if _is_table(value)}
        points = {key: value for key, value in tool.items() if f"tool.{key}" not in inner}
        return {**content, **inner, "tool": points}

    @property
    def around(self) -> dict[str, Any]:
        """`[cell]` and the tables of `[tool]` other than points, ready for another file."""
        content = self.model_dump(
            include={"cell", "tool_acceptance", "tool_capsules"}, exclude_none=True
        )
        if content.get("cell", {}).get("max_turn_deg") == {}:
            del content["cell"]["max_turn_deg"]
        return content

    def accepts_only(self, targets: list[str]) -> None:
        """Check that only reflectors have an acceptance.

        Raises:
            ValueError: Another name has one.
        """
        if unknown := sorted(set(self.tool_acceptance) - set(targets)):
            raise Misplaced(
                f"tool.acceptance has {listed(unknown)}, the reflectors are {listed(targets)}",
                ["tool", "acceptance", unknown[0]],
            )


def turns(robot: Robot, stated: Surrounded) -> tuple[Array, Array]:
    """Joint limits [m] or [rad], shape (n,) each, within those of cables and hoses.

    Raises:
        InputError: `[cell] max_turn_deg` names a joint that is not revolute or does not exist, or
            leaves no range.
    """
    lower, upper = robot.lower.copy(), robot.upper.copy()
    names = [joint.name for joint in robot.joints if not joint.prismatic]
    for name, most in (stated.cell.max_turn_deg if stated.cell else {}).items():
        if name not in names:
            raise InputError(
                f'[cell] max_turn_deg has "{name}", and {robot.name} has no such joint that turns',
                f"its joints that turn are {listed(names)}",
                key=["cell", "max_turn_deg", name],
            )
        k = [joint.name for joint in robot.joints].index(name)
        most_rad = float(np.deg2rad(most))
        if lower[k] >= most_rad or upper[k] <= -most_rad:
            raise InputError(
                f"[cell] max_turn_deg.{name} = {most:g} leaves nothing of the limits "
                f"{np.rad2deg(lower[k]):g} to {np.rad2deg(upper[k]):g} deg of that joint",
                "allow a larger turn, or correct the robot file",
                key=["cell", "max_turn_deg", name],
            )
        lower[k], upper[k] = max(lower[k], -most_rad), min(upper[k], most_rad)
    return lower, upper


def tooled(points: Mapping[str, Any], stated: Surrounded) -> dict[str, Any]:
    """`[tool]` with its points and other tables, and `[cell]`, as written in a file."""
    around = stated.around
    inner = {key.removeprefix("tool."): around.pop(key) for key in list(around) if key != "cell"}
    return {"tool": {**points, **inner}, **around}
