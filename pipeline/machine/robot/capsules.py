"""Bodies of a robot as capsules, each fixed to a link.

A capsule is the set of points within its radius of a line segment. Two capsules touch if the
distance of their segments is less than the sum of their radii.
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
"""Name of the link that is fixed in F_b."""

SHORT_M = 1e-3
"""Distance [m] between origins of joint frames below which no link body is drawn between them."""

_End = tuple[Length, Length, Length]


class Capsule(Numbers):
    """One `[[capsules]]` of a robot file [m], in the frame of its link.

    `link` is the name of the joint that carries it, and its frame that of the joint's row, which
    moves with the joint; in a standard table it lies after the row, at the far end of the link.
    `base` is fixed in F_b.
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
        carrier: Number of the joint that carries each, 1..n; 0 if fixed in F_b. Shape (c,).
        ends: Both ends of its segment in the frame of that joint [m], shape (2, c, 3).
        radius: Radius of each capsule [m], shape (c,).
        source: Their origin and quality, as stated in the file.
    """

    carrier: Ints
    ends: Array
    radius: Array
    source: str = ""

    def __len__(self) -> int:
        return len(self.carrier)

    @cached_property
    def half(self) -> Array:
        """Half the segment length of each capsule [m], shape (c,)."""
        return np.asarray(np.linalg.norm(self.ends[1] - self.ends[0], axis=-1) / 2)


def capsules(
    rows: Sequence[Capsule], frames: Mapping[str, tuple[int, Array]], source: str, file: str
) -> Capsules:
    """Capsules of a robot file, in the frames of its joints.

    Args:
        rows: Rows of the file.
        frames: Joint number of each link, and the frame of its row in that of its joint (4, 4).
        source: Their origin and quality.
        file: Name of the file, for messages.

    Raises:
        InputError: A capsule belongs to no link of the robot.
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
