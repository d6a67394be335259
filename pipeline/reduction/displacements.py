"""Displacements, loaded minus unloaded; the pulls of a pose share its zero."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.base import covariance
from pipeline.base.arrays import Array, Ints
from pipeline.reduction._index import means, numbered, places, pull_number, taken
from pipeline.reduction.settings import Settings
from pipeline.tables import XYZ


def displacements(settings: Settings, placed: pd.DataFrame) -> pd.DataFrame:
    """Subtract from every loaded reading the mean of its pose's unloaded readings.

    Zeros before and after the pulls have equal weight, so that a drift linear in time cancels at
    mid-time; the zero's covariance is that of the mean.

    Args:
        settings: Names of the measured targets.
        placed: Table PLACED, F_b.

    Returns:
        Table DISPLACEMENTS, sorted by pose, repeat and order of the targets.
    """
    names = settings.measured
    target = places(placed["target"], names)
    state = places(placed["state"], ["unloaded", "loaded"])
    pose, repeat = (placed[name].to_numpy() for name in ("pose", "repeat"))
    poses, of_pose = numbered(pose)
    member = of_pose * len(names) + target  # number of the zero: one per pose and target
    zeros = np.flatnonzero((state == 0) & (target >= 0))
    zero = _zero(placed, zeros, member[zeros], len(poses) * len(names))

    loaded = np.flatnonzero((state == 1) & (target >= 0))
    loaded = loaded[zero["zero_count"][member[loaded]] > 0]
    loaded = loaded[_order(pose[loaded], repeat[loaded], target[loaded])]
    own = member[loaded]
    read = taken(placed, ["pose", "repeat", *XYZ, *covariance.columns()], loaded)
    shared = dict(
        zip(zero, covariance.each(list(zero.values()), lambda mean: mean[own]), strict=True)
    )
    columns = {
        "pose": read["pose"],
        "repeat": read["repeat"],
        "target": pd.Categorical.from_codes(target[loaded], pd.Index(names)),
        **{f"d{axis}": read[axis] - shared[f"zero_{axis}"] for axis in XYZ},
        **{f"loaded_{name}": read[name] for name in covariance.columns()},
        **shared,
    }
    return pd.DataFrame(columns, copy=False)


def zeros(settings: Settings, placed: pd.DataFrame) -> pd.DataFrame:
    """Mean unloaded reading of each target in each pose that has any.

    Columns pose, target (index in the measured targets), zero_x_m.., zero_cxx_m2.., zero_count,
    zero_time_s; sorted by pose and target.

    Args:
        settings: Names of the measured targets.
        placed: Table PLACED, F_b.
    """
    names = settings.measured
    target = places(placed["target"], names)
    rows = np.flatnonzero((places(placed["state"], ["unloaded"]) == 0) & (target >= 0))
    poses, of_pose = numbered(placed["pose"].to_numpy()[rows])
    zero = _zero(placed, rows, of_pose * len(names) + target[rows], len(poses) * len(names))
    pose, index = np.repeat(poses, len(names)), np.tile(np.arange(len(names)), len(poses))
    found = pd.DataFrame({"pose": pose, "target": index, **zero}, copy=False)
    return found[found["zero_count"] > 0]


def _order(pose: Ints, repeat: Ints, target: Ints) -> Ints | slice:
    """Indices that sort rows by pose, repeat and target; most exports are already in order."""
    pull = pull_number(pose, repeat)
    later = pull[1:] > pull[:-1]
    if (later | ((pull[1:] == pull[:-1]) & (target[1:] > target[:-1]))).all():
        return slice(None)
    return np.lexsort((target, pull))


def _zero(placed: pd.DataFrame, rows: Ints, member: Ints, groups: int) -> dict[str, Array | Ints]:
    """Mean, covariance, number and time of the zeros by pose and target, each shape (groups,).

    Args:
        placed: Table PLACED.
        rows: Its rows that are zeros, shape (n,).
        member: Group of each of them, shape (n,).
        groups: Number of groups.
    """
    count = np.bincount(member, minlength=groups)
    some = np.maximum(count, 1)

    def mean(name: str) -> Array:
        return np.bincount(member, placed[name].to_numpy()[rows], groups) / some

    def covariance_of_mean(of_reading: Array) -> Array:
        return np.bincount(member, of_reading[rows], groups) / some**2

    C = covariance.each(covariance.numbers(placed), covariance_of_mean)
    return {
        **dict(zip(covariance.columns("zero_c"), C, strict=True)),
        **{f"zero_{name}": mean(name) for name in XYZ},
        "zero_count": count,
        "zero_time_s": means(placed["time_s"].to_numpy()[rows], member, groups),
    }
