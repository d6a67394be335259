"""Average readings in two faces: a target read in both is one reading, free of axis errors.

Collimation error and tilt of the axes displace the two readings in opposite directions and leave
their mean unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.base.arrays import Array, Bools, Ints
from pipeline.readers._reader import Faces
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M


def pairs(names: Sequence[Any], second: Bools, position: Array) -> Ints:
    """Pair each reading of a target with its previous one in the other face, shape (pairs, 2).

    Pairs farther apart than any maladjustment explains are not of the same place and are dropped.

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
    return both[apart <= GROSS_DISTANCE_M]


def summary(position: Array, found: Ints, second: Bools) -> Faces:
    """Summary of the pairs `found`; position [m] has shape (n, 3)."""
    apart = np.linalg.norm(position[found[:, 0]] - position[found[:, 1]], axis=1)
    return Faces(len(found), float(apart.max(initial=0.0)), int(second.sum()) - len(found))


def mean(position: Array, covariance: Array | None, found: Ints) -> tuple[Array, Array | None]:
    """Positions and covariances, with the first reading of each pair replaced by their mean."""
    one, other = found.T
    position = position.copy(order="F")
    position[one] = (position[one] + position[other]) / 2
    if covariance is not None:
        covariance = covariance.copy()
        covariance[one] = (covariance[one] + covariance[other]) / 4
    return position, covariance
