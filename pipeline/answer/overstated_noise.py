"""Sentences on stated noise that is larger than the scatter of the readings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.base.quantities import plain
from pipeline.reduction.settings import Settings
from pipeline.system.beam import BeamNoise
from pipeline.system.variance import Components


def overstated(settings: Settings, found: Components) -> list[str]:
    """A sentence on each noise component that is stated much larger than the scatter found."""
    return [
        _TOLD[found.name[i]](settings, float(found.scale[i]))
        for i in np.flatnonzero(found.smaller).tolist()
    ]


def _tracker(settings: Settings, scale: float) -> str:
    tables = {"tracker": settings.tracker, "displacements": settings.displacements}
    said = next(((name, one.sigma_m) for name, one in tables.items() if one and one.sigma_m), None)
    if said is None:
        return (
            f"The readings scatter {plain(1 / scale, 2)} times less than their stated noise: every "
            "interval rests on the scatter that was found. Correct the stated one; is it in "
            "another unit?"
        )
    name, sigma_m = said
    return (
        f"[{name}] sigma_m states {plain(1e3 * sigma_m)} mm, and repeated readings scatter by "
        f"{plain(1e3 * scale * sigma_m, 2)} mm: every interval rests on the latter. Correct "
        "sigma_m, which is in metres."
    )


def _force(settings: Settings, scale: float) -> str:
    setting = settings.loads_log
    parts = {
        f"{plain(setting.sigma_n)} N": setting.sigma_n,
        f"{setting.sigma_rel:.3%}": setting.sigma_rel,
    }
    stated = " and ".join(part for part, size in parts.items() if size)
    return (
        f"[scale] states {stated} for a reading, and its readings scatter at least "
        f"{plain(1 / scale, 2)} times less: every interval rests on that. Correct sigma_n, which "
        "is in newtons, or sigma_rel, which is relative."
    )


_TOLD: dict[str, Callable[[Settings, float], str]] = {"tracker": _tracker, "force_reading": _force}


def beside_the_beam(found: BeamNoise) -> list[str]:
    """A sentence if the scatter along the beam is less than the one value stated for all axes."""
    if not found.better:
        return []
    across = found.across.mean()
    angles = f"{plain(across, 2)} times as much" if abs(across - 1) >= _SOME else "as stated"
    return [
        f"Along the beam the tracker scatters {plain(1 / found.along, 2)} times less than stated, "
        f"across it {angles}: every reading is weighed by both. To state them yourself, give its "
        "type as [instrument] model, or both parts as [tracker] noise."
    ]


_SOME = 0.05
"""Relative difference of two standard uncertainties from which on they are reported as different
[1]; none is stated more accurately."""
