"""An instrument that reads poses: the targets of a state belong to one body and share its error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from bench.worlds.cell import Slot
from bench.worlds.noise import SIGMA_M, White
from pipeline.base.arrays import Array, Ints

SIGMA_RAD = 8.7e-5
"""Standard uncertainty of a rotation per axis [rad], as stated by the world: 0.01 deg at k = 2."""


@dataclass(frozen=True)
class Poses:
    """One 6D pose per state of the tool, points elsewhere (base, chain).

    The errors of the targets of a pose are e + R(w) (p - o) - (p - o), e ~ N(0, sigma^2 I), w ~
    N(0, sigma_rad^2 I). The probe's origin o is the mean of the targets, or offset from it along
    the normal of their plane.

    Attributes:
        aside_m: The offset [m].
    """

    aside_m: float = 0.0

    def __call__(
        self, slots: Sequence[Slot], hours: Array, local: Array, rng: np.random.Generator
    ) -> Array:
        """Errors of the readings, tracker's frame, shape (r, 3) [m]."""
        error = White()(hours, local, rng)
        for rows in bodies(slots):
            body = local[rows]
            origin = body.mean(axis=0)
            if self.aside_m:
                normal = np.cross(body[1] - body[0], body[2] - body[0])
                origin = origin + self.aside_m * normal / np.linalg.norm(normal)
            turned = Rotation.from_rotvec(rng.normal(0, SIGMA_RAD, 3)).apply(body - origin)
            error[rows] = rng.normal(0, SIGMA_M, 3) + turned - (body - origin)
        return error


def bodies(slots: Sequence[Slot]) -> list[Ints]:
    """Readings that come from one pose, state by state."""
    groups: dict[str, list[int]] = {}
    for k, slot in enumerate(slots):
        if slot.state in ("loaded", "unloaded"):
            groups.setdefault(slot.group, []).append(k)
    return [np.array(rows) for rows in groups.values()]
