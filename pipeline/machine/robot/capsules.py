"""The bodies of a robot: capsules, each fixed to a link and as thick as it is round.

A capsule is everything within its radius of a straight line. Two of them touch where their lines
come nearer than both radii.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from pydantic import AliasChoices, ConfigDict, Field

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.errors import InputError, listed
from pipeline.base.strict import Length, Name, Numbers, Positive

BASE: Literal["base"] = "base"
"""The link that stands still: F_b."""

_End = tuple[Length, Length, Length]


class Capsule(Numbers):
    """One `[[capsules]]` of a robot file [m], in the frame of its link.

    `link` is the name of the joint that carries it, and its frame that of the joint's row, which
    turns or slides with the joint; in a standard table it lies behind the row, at the far end of
    the link. `base` stands still.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    link: Name
    start: _End = Field(validation_alias=AliasChoices("from", "from_m"), serialization_alias="from")
    end: _End = Field(validation_alias=AliasChoices("to", "to_m"), serialization_alias="to")
    radius: Positive = Field(validation_alias=AliasChoices("radius", "radius_m"))


@dataclass(frozen=True, eq=False)
class Capsules(Locked):
    """Capsules of a robot, c of them.

    Attributes:
        carrier: Number of the joint that carries each, 1..n; 0 stands still in F_b. Shape (c,).
        ends: Both ends of its line in the frame of that joint [m], shape (2, c, 3).
        radius: [m], shape (c,).
        source: Where they come from and how good they are, as the file says.
    """

    carrier: Ints
    ends: Array
    radius: Array
    source: str = ""

    def __len__(self) -> int:
        return len(self.carrier)

    @cached_property
    def half(self) -> Array:
        """Half the length of the line of each [m], shape (c,)."""
        return np.asarray(np.linalg.norm(self.ends[1] - self.ends[0], axis=-1) / 2)

    def beside(self, other: Capsules) -> Capsules:
        """These and others."""
        return Capsules(
            np.concatenate([self.carrier, other.carrier]),
            np.concatenate([self.ends, other.ends], axis=1),
            np.concatenate([self.radius, other.radius]),
            self.source,
        )


def capsules(
    rows: Sequence[Capsule], frames: Mapping[str, tuple[int, Array]], source: str, file: str
) -> Capsules:
    """The capsules of a robot file, in the frames of its joints.

    Args:
        rows: As the file has them.
        frames: Number of each link, and the frame of its row in that of its joint (4, 4).
        source: Where they come from.
        file: Name of the file, for messages.

    Raises:
        InputError: A capsule is of no link of the robot.
    """
    if unknown := [row.link for row in rows if row.link not in frames]:
        raise InputError(
            f'[[capsules]] has the link "{unknown[0]}", and there is no such joint',
            f"name one of {listed(frames)}",
            file=file,
        )
    placed = [frames[row.link] for row in rows]
    ends = [
        [
            T[:3, :3] @ (row.start, row.end)[k] + T[:3, 3]
            for row, (_, T) in zip(rows, placed, strict=True)
        ]
        for k in range(2)
    ]
    return Capsules(
        np.array([number for number, _ in placed], dtype=np.int64),
        np.array(ends, dtype=float).reshape(2, -1, 3),
        np.array([row.radius for row in rows], dtype=float),
        source,
    )
