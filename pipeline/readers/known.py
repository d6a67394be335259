"""Reflectors whose places campaign.toml has, by which readings are judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

GROSS_M = 0.03
"""So far [m] from where its reflector should be nothing is a reading of that reflector; taste: no
robot in use is this far off its own table, and no reflector off its place."""
BETTER = 3.0
"""How many times nearer an answer, or a correction, must bring the reflectors than any other."""


@dataclass(frozen=True)
class ReflectorSet:
    """Reflectors that keep their places to each other.

    Attributes:
        table: Where campaign.toml has them: `[tool]` or `[base_frame]`.
        places: Their places [m].
    """

    table: str
    places: Mapping[str, tuple[float, float, float]]
