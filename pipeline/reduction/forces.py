"""Force vectors from chain reflectors and spring-scale readings, Eqs. (10), (11).

Rows of the loads that are weights or payloads need neither.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.base import covariance
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.reduction._index import found, means, places, pull_numbers, run
from pipeline.reduction.digits import division
from pipeline.reduction.settings import Scale, Settings
from pipeline.reduction.weights import PULL, Weights
from pipeline.tables import XYZ

_COUNTS = 1e-3
"""Fraction of a variance below which a contribution is neglected [1]."""

_BRANCH = np.array([1, -1, 0])
"""Values for up, down and unknown."""


def forces(settings: Settings, placed: pd.DataFrame, loads: pd.DataFrame) -> pd.DataFrame:
    """Apply each scale reading along its chain, u = (Pl2 - Pl1) / |Pl2 - Pl1|.

    The covariance of the direction is that of the two reflectors across the chain,
    (I - u u') (C1 + C2) (I - u u') / L^2; where no noise is stated it is relative to the tracker's
    variance, in 1/m^2. The variance of a reading is the stated one plus that of its rounding,
    h^2 / 12 with h the division of the scale.

    Args:
        settings: Names of the chain reflectors and the scale's uncertainty.
        placed: Table PLACED, F_b.
        loads: Table LOADS.

    Returns:
        Table FORCES, one row per pull with both chain reflectors, and per weight or payload.
    """
    loads, pulls = _in_order(loads)
    target = places(placed["target"], [*settings.naming.chain, *settings.measured])
    loaded = places(placed["state"], ["loaded"]) == 0
    pull = pull_numbers(placed)
    ends = [_rows(pull, loaded & (target == end), pulls) for end in (0, 1)]
    hung = Weights.of(settings.payload, loads)
    both = (hung.body != PULL) | ((ends[0] >= 0) & (ends[1] >= 0))
    loads, pulls, (near, far) = loads[both], pulls[both], (end[both] for end in ends)
    hung = hung.only(both)

    chain = hung.body == PULL
    reading = np.where(chain, loads["force_n"].to_numpy(), 0.0)
    u, direction = _of_chains(placed, near, far, chain)
    weight = hung.force(settings.gravity.vector)
    force = [np.where(chain, reading * part, weight[:, k]) for k, part in enumerate(u)]
    stated = reading_std(settings.scale or Scale(), reading)
    variance = division(reading[chain], loads["pose"].to_numpy()[chain]) ** 2 / 12
    rounded = np.where(variance > _COUNTS * stated**2, variance, 0.0)
    measured = np.flatnonzero(loaded & (target >= 2))
    return pd.DataFrame(
        {
            **{name: loads[name].to_numpy() for name in ("pose", "repeat")},
            **dict(zip(["fx_n", "fy_n", "fz_n"], force, strict=True)),
            **hung.columns(settings),
            "reading_std_n": np.where(chain, np.sqrt(stated**2 + rounded), 0.0),
            **dict(zip(covariance.columns("u", ""), direction, strict=True)),
            "branch": _BRANCH[places(loads["branch"], ["up", "down"])],
            "time_s": _mean_by_pull(placed["time_s"].to_numpy()[measured], pull[measured], pulls),
        }
    )


def _in_order(loads: pd.DataFrame) -> tuple[pd.DataFrame, Ints]:
    """The loads sorted by pose and repeat, and the number of each pull."""
    pulls = pull_numbers(loads)
    if (pulls[1:] >= pulls[:-1]).all():
        return loads, pulls
    order = np.argsort(pulls, kind="stable")
    return loads.iloc[order], pulls[order]


def _of_chains(
    placed: pd.DataFrame, near: Ints, far: Ints, chain: Bools
) -> tuple[list[Array], list[Array]]:
    """As `_directions`, zero in rows without a chain."""
    if chain.all():
        return _directions(placed, near, far)
    here = np.flatnonzero(chain)
    found = _directions(placed, near[here], far[here])
    u, C = ([_spread(column, here, len(chain)) for column in columns] for columns in found)
    return u, C


def _spread(column: Array, rows: Ints, size: int) -> Array:
    """A column of the given size with these values at `rows`, else zero."""
    out = np.zeros(size)
    out[rows] = column
    return out


def _directions(placed: pd.DataFrame, near: Ints, far: Ints) -> tuple[list[Array], list[Array]]:
    """Directions of chains between two rows each, and their covariance in six columns."""
    at = [placed[axis].to_numpy() for axis in XYZ]
    chain = covariance.each(at, lambda points: points[far] - points[near])
    square = chain[0] ** 2 + chain[1] ** 2 + chain[2] ** 2
    u = [part / np.sqrt(square) for part in chain]
    six = covariance.numbers(placed)
    if covariance.stated(covariance.known(six)):
        C = covariance.each(six, lambda column: column[near] + column[far])
    else:
        C = [np.full(len(square), 2.0 * (i == j)) for i, j in covariance.PLACES]
    return u, [column / square for column in _across(u, C)]


def reading_std(scale: Scale, reading: np.ndarray) -> np.ndarray:
    """Standard uncertainty of scale readings [N]: constant and relative parts, independent."""
    return np.hypot(scale.sigma_n, scale.sigma_rel * reading)


def _rows(pull: Ints, which: np.ndarray, pulls: Ints) -> Ints:
    """Row of one end of the chain in each of some pulls, -1 where it is missing, shape (m,)."""
    rows = np.flatnonzero(which)
    at = found(pull[rows], pulls)
    return np.where(at >= 0, np.append(rows, -1)[at], -1)


def _across(u: list[Array], C: list[Array]) -> list[Array]:
    """(I - u u') C (I - u u') for directions in three columns, in six columns."""
    xx, xy, xz, yy, yz, zz = C
    rows = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    v = [sum(c * along for c, along in zip(row, u, strict=True)) for row in rows]
    s = sum(along * across for along, across in zip(u, v, strict=True))
    return [
        C[k] - u[i] * v[j] - v[i] * u[j] + s * u[i] * u[j]
        for k, (i, j) in enumerate(covariance.PLACES)
    ]


def _mean_by_pull(values: Array, pull: Ints, pulls: Ints) -> Array:
    """Mean of the values in each of some pulls, NaN where there is none, shape (m,)."""
    at = found(pulls, pull)
    known = run(np.flatnonzero(at >= 0))
    return means(values[known], at[known], len(pulls))
