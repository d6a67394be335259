"""Blunders of the measurement, in what the instrument records."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from bench.worlds.cell import Slot, indices
from pipeline.base.arrays import Array

SIZES_M = (3e-4, 5.0)
"""Smallest and largest blunder [m]; log-uniform between."""

DRIFT_M = (2e-4, 1e-3)
"""Displacement of the tracker over a campaign [m]."""

Spoil = Callable[[Sequence[Slot], Array, np.random.Generator], dict[int, Array]]
"""Function of the timetable and the record, tracker's frame (r, 3) [m]; returns spoilt readings."""


def displaced(record: Array, at: int, rng: np.random.Generator) -> Array:
    """A reading with an error of random direction and size."""
    way = rng.normal(size=3)
    size = np.exp(rng.uniform(*np.log(SIZES_M)))
    return np.asarray(record[at] + size * way / np.linalg.norm(way))


def off(state: str) -> Spoil:
    """One reading of a state is wrong."""

    def spoil(slots: Sequence[Slot], record: Array, rng: np.random.Generator) -> dict[int, Array]:
        at = int(rng.choice(indices(slots, state)))
        return {at: displaced(record, at, rng)}

    return spoil


def stale(slots: Sequence[Slot], record: Array, rng: np.random.Generator) -> dict[int, Array]:
    """The instrument repeats the previous reading."""
    at = int(rng.integers(1, len(slots)))
    return {at: record[at - 1].copy()}


def failed_lock(slots: Sequence[Slot], record: Array, rng: np.random.Generator) -> dict[int, Array]:
    """The instrument records (0, 0, 0) in its own frame."""
    return {int(rng.integers(len(slots))): np.zeros(3)}


def _any(at: int, record: Array, rng: np.random.Generator) -> Array:
    """Half of the blunders are displaced, a quarter stale, a quarter failed locks."""
    kind = rng.random()
    if kind < 0.5 or at == 0:
        return displaced(record, at, rng)
    return record[at - 1].copy() if kind < 0.75 else np.zeros(3)


def pair(same_pose: bool) -> Spoil:
    """Two blunders, in one pose or in two."""

    def spoil(slots: Sequence[Slot], record: Array, rng: np.random.Generator) -> dict[int, Array]:
        pose = np.array([slot.group.split("_")[0] if slot.pull >= 0 else "" for slot in slots])
        first = int(rng.choice(np.flatnonzero(pose != "")))
        same = pose == pose[first]
        others = same if same_pose else ~same & (pose != "")
        others[first] = False
        second = int(rng.choice(np.flatnonzero(others)))
        return {at: _any(at, record, rng) for at in (first, second)}

    return spoil


def either(slots: Sequence[Slot], record: Array, rng: np.random.Generator) -> dict[int, Array]:
    """One blunder of any kind, anywhere."""
    at = int(rng.integers(len(slots)))
    return {at: _any(at, record, rng)}


def nothing(slots: Sequence[Slot], record: Array, rng: np.random.Generator) -> dict[int, Array]:
    """No blunder."""
    return {}


def tracker_moves(hours: Array, local: Array, rng: np.random.Generator) -> Array:
    """Errors of a tracker that moves as a whole at constant speed, shape (r, 3) [m].

    d(t) = (t / t_end) (v + w x p), with v of a size in `DRIFT_M`, and w such that it has the same
    effect at 10 m.
    """
    size = rng.uniform(*DRIFT_M)
    v, w = rng.normal(size=(2, 3))
    v, w = size * v / np.linalg.norm(v), size / 10 * w / np.linalg.norm(w)
    return np.asarray((hours / hours[-1])[:, None] * (v + np.cross(w, local)))
