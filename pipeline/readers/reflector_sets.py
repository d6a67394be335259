"""Reflectors with nominal coordinates in campaign.toml, against which readings are judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

GROSS_DISTANCE_M = 0.03
"""Distance from the nominal place of a reflector beyond which a reading is not of that reflector
[m]; a choice: no robot in use deviates this much from its DH parameters, and no reflector from its
nominal place."""
CLEARLY_NEARER = 3.0
"""Factor by which an answer, or a correction, must bring the reflectors nearer than any other
[1]."""


@dataclass(frozen=True)
class ReflectorSet:
    """Reflectors that form a rigid set.

    Attributes:
        table: Table of campaign.toml that holds them: `[tool]` or `[base_frame]`.
        places: Nominal coordinates by name [m].
    """

    table: str
    places: Mapping[str, tuple[float, float, float]]
