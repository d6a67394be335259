"""Grouping of base reflector readings that were read without pause into rounds."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Ints
from pipeline.reduction.register import XYZ

_MANY = 1000
"""Number of readings above which they are averaged in rounds: all pairs of a thousand are 8 MB."""
_ROUNDS = 100
"""Number of time spans, hence rounds, into which the readings are averaged."""
_OFF = ["dx_m", "dy_m", "dz_m"]


def in_rounds(table: pd.DataFrame) -> pd.DataFrame:
    """Average many readings, by reflector and span of time.

    p = C sum C_k^-1 p_k, C = (sum C_k^-1)^-1 (m and m^2, F_b), at the mean of their times: a motion
    that is linear within a hundredth of the campaign has the same effect on the means. Up to
    `_MANY` readings are returned unchanged.

    Args:
        table: Table REGISTRATION with `since`, seconds after the first reading.
    """
    if len(table) <= _MANY:
        return table
    since = table["since"].to_numpy(float)
    whole_s = since.max() or 1.0  # without times a group is read at once
    span = np.minimum((since / whole_s * _ROUNDS).astype(np.int64), _ROUNDS - 1)
    target, names = pd.factorize(table["target"])
    _, first, which = np.unique(span * len(names) + target, return_index=True, return_inverse=True)
    C = covariance.weighing(table)
    W = covariance.alike(C, linear.inverse)
    whole = linear.inverse(_sums(W.reshape(-1, 9), which).reshape(-1, 3, 3))
    values = table[[*XYZ, *_OFF]].to_numpy(float)
    sums = _sums(np.einsum("kij,kaj->kai", W, values.reshape(-1, 2, 3)).reshape(-1, 6), which)
    means = np.einsum("kij,kaj->kai", whole, sums.reshape(-1, 2, 3)).reshape(-1, 6)
    count = np.bincount(which)
    out = table.iloc[first].copy()
    out[[*XYZ, *_OFF]] = means
    out[covariance.columns()] = covariance.flat(whole)
    out["since"] = np.bincount(which, since) / count
    begins = table["group"].astype(str).to_numpy()[first]
    out["group"] = [f"{name} ({k})" for name, k in zip(begins, span[first], strict=True)]
    return out


def _sums(rows: Array, which: Ints) -> Array:
    """Sums of the rows with the same number in `which`, shape (numbers, columns)."""
    return np.column_stack([np.bincount(which, column) for column in rows.T])
