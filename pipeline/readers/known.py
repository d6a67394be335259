"""Reflectors whose places campaign.toml has, by which readings are judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pipeline.readers._faces import GROSS_M as GROSS_M

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
