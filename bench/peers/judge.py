"""Common judge of all tools: errors at held-out poses, and their intervals."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

RESAMPLES = 4000
SEED = 20260801  # of the resampled clusters: which intervals come out, not which errors


@dataclass(frozen=True)
class Errors:
    """Errors of a tool at held-out targets [m].

    Attributes:
        mean: Mean distance.
        mean_ci: 95 % interval of the mean.
        rms: Root of the mean squared distance.
        rms_ci: Its 95 % interval.
        most: Largest distance; without interval, since resampling is not valid for an extreme.
        n: Number of targets.
        clusters: Number of clusters, which were resampled as a whole.
    """

    mean: float
    mean_ci: tuple[float, float]
    rms: float
    rms_ci: tuple[float, float]
    most: float
    n: int
    clusters: int


def laid(told: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation that fit one set of points to another, R told + t (Kabsch)."""
    U, _, Vt = np.linalg.svd((told - told.mean(0)).T @ (seen - seen.mean(0)))
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))])
    R = Vt.T @ proper @ U.T
    return R, seen.mean(0) - R @ told.mean(0)


def distances(told: np.ndarray, seen: np.ndarray, lay: bool) -> np.ndarray:
    """Distance of each target [m], shape (m,); with `lay`, after a fit of the frames."""
    if lay:
        R, t = laid(told, seen)
        told = told @ R.T + t
    return np.linalg.norm(told - seen, axis=1)


@lru_cache
def _drawn(count: int) -> np.ndarray:
    """How often each of `count` clusters is drawn in each resample, shape (RESAMPLES, count)."""
    draws = np.random.default_rng(SEED).integers(0, count, (RESAMPLES, count))
    return np.stack([np.bincount(one, minlength=count) for one in draws])


def _means(values: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    """Mean of the values in each resample of whole clusters."""
    times = _drawn(int(cluster.max()) + 1)
    return (times @ np.bincount(cluster, values)) / (times @ np.bincount(cluster))


def errors(off: np.ndarray, cluster: np.ndarray) -> Errors:
    """Errors with percentile intervals of a bootstrap of whole clusters.

    Args:
        off: Distance of each target [m], shape (m,).
        cluster: Cluster of each, 0, 1, ..., shape (m,).
    """
    mean, rms = _means(off, cluster), np.sqrt(_means(off**2, cluster))
    ends = [tuple(float(v) for v in np.percentile(one, [2.5, 97.5])) for one in (mean, rms)]
    return Errors(
        float(off.mean()), ends[0], float(np.sqrt((off**2).mean())), ends[1], float(off.max()),
        len(off), int(cluster.max()) + 1,
    )  # fmt: skip


def ratio(off: np.ndarray, ours: np.ndarray, cluster: np.ndarray) -> tuple[float, float, float]:
    """Mean error of a tool over ours, and its 95 % interval, on the same resamples."""
    low, high = np.percentile(_means(off, cluster) / _means(ours, cluster), [2.5, 97.5])
    return float(off.mean() / ours.mean()), float(low), float(high)
