"""Remarks on campaign.toml beside positions: what is not used, and points that are not so."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from pipeline.base.errors import listed
from pipeline.base.quantities import plain
from pipeline.positions.readings import PositionReadings
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction.settings import Settings

_OF_PULLS = (
    "naming",
    "base_frame",
    "base_frame_uncertainty",
    "anchors",
    "joints",
    "tool_uncertainty",
    "test_pose",
    "model",
    "priors",
)
"""Tables of campaign.toml that serve pulls alone; those that contradict positions are refused."""


def remarks(settings: Settings, readings: PositionReadings) -> Iterator[str]:
    """Sentences on what campaign.toml states without effect, or otherwise than the readings.

    Args:
        settings: campaign.toml.
        readings: All series.
    """
    yield from _unused(settings)
    yield from _otherwise(settings, readings)


def _unused(settings: Settings) -> Iterator[str]:
    """Remark on entries that nothing depends on where nothing was pulled."""
    stated = settings.model_fields_set if settings.of_positions else set()
    names = [f"[{one}]" for one in _OF_PULLS if one in stated]
    if names:
        of = "is not used: it serves" if len(names) == 1 else "are not used: they serve"
        yield (
            f"{listed(names)} of campaign.toml {of} pulls, and this campaign has positions alone; "
            "add [tracker] if something was pulled"
        )


def _otherwise(settings: Settings, readings: PositionReadings) -> Iterator[str]:
    """Remark on targets of [tool] whose distances are not those of their readings.

    The distance of two targets is the median over all poses in which both were read.
    """
    known = {k: name for k, name in enumerate(readings.targets) if name in settings.tool}
    worst, far = ("", "", 0.0, 0.0), 0
    for a, b in combinations(known, 2):
        each = np.linalg.norm(readings.at[:, a] - readings.at[:, b], axis=1)
        if not np.isfinite(each).any():
            continue
        first, second = known[a], known[b]
        read = float(np.nanmedian(each))
        apart = np.subtract(settings.tool[first], settings.tool[second])
        stated = float(np.linalg.norm(apart))
        off = abs(read - stated)
        far += off > GROSS_DISTANCE_M
        worst = max(worst, (first, second, stated, read), key=lambda one: abs(one[3] - one[2]))
    if far:
        first, second, stated, read = worst
        others = f", and {far - 1} other distances differ, too" if far > 1 else ""
        yield (
            f"[tool] of campaign.toml has {first} and {second} {plain(1e3 * stated, 3)} mm apart, "
            f"and their readings {plain(1e3 * read, 3)} mm{others}: correct their coordinates; "
            "the points of the targets are estimated from the readings"
        )
