"""What pipeline.toml states of all robots together."""

from __future__ import annotations

from pathlib import Path

from pipeline.base import doors

_PREFERENCES = "pipeline.library.preferences:load"
"""Door: pipeline.toml."""


def expected_scatter(root: Path) -> float | None:
    """Relative standard deviation of a stiffness from day to day; None if it is not stated."""
    load = doors.found(_PREFERENCES)
    scatter: float | None = load(root).fleet.scatter if load else None
    return scatter
