"""Two faces: a target read with the instrument turned and plunged is one reading, without its tilt.

Collimation and the tilt of its axes move the two readings apart and their mean not at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.base.arrays import Array, Bools, Ints
from pipeline.readers._reader import Faces
from pipeline.readers.known import GROSS_M


def pairs(names: Sequence[Any], second: Bools, position: Array) -> Ints:
    """Readings of one target in both faces, each with the nearest one before, shape (pairs, 2).

    What lies farther apart than any adjustment leaves is not the same place in two faces.

    Args:
        names: Group and target of each reading.
        second: Which are in the second face, shape (n,).
        position: Coordinates [m], shape (n, 3).
    """
    waiting: dict[Any, int] = {}
    found = []
    for k, name in enumerate(names):
        before = waiting.pop(name, None)
        if before is not None and second[before] != second[k]:
            found.append((before, k))
        else:
            waiting[name] = k
    both = np.array(found, dtype=np.int64).reshape(-1, 2)
    apart = np.linalg.norm(position[both[:, 0]] - position[both[:, 1]], axis=1)
    return both[apart <= GROSS_M]


def summary(position: Array, found: Ints, second: Bools) -> Faces:
    """What pairs of readings say [m]; position has shape (n, 3)."""
    apart = np.linalg.norm(position[found[:, 0]] - position[found[:, 1]], axis=1)
    return Faces(len(found), float(apart.max(initial=0.0)), int(second.sum()) - len(found))


def mean(position: Array, covariance: Array | None, found: Ints) -> tuple[Array, Array | None]:
    """Positions and covariances with the mean of each pair in the place of its first reading."""
    one, other = found.T
    position = position.copy(order="F")
    position[one] = (position[one] + position[other]) / 2
    if covariance is not None:
        covariance = covariance.copy()
        covariance[one] = (covariance[one] + covariance[other]) / 4
    return position, covariance
