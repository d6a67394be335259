"""3x3 covariances in table columns, and factors of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.errors import InputError
from pipeline.results import Array

PAIRS = ("xx", "xy", "xz", "yy", "yz", "zz")
ROW, COLUMN = np.triu_indices(3)
"""Where each of the six numbers of a covariance stands in its 3x3 matrix."""


def columns(before: str = "c", after: str = "_m2") -> list[str]:
    """Names of the six columns that hold a covariance."""
    return [f"{before}{pair}{after}" for pair in PAIRS]


def matrices(table: pd.DataFrame, names: Sequence[str] | None = None) -> Array:
    """Six columns of a table as matrices, shape (rows, 3, 3)."""
    return symmetric(table[list(names or columns())].to_numpy(dtype=float))


def symmetric(upper: Array) -> Array:
    """Matrices (m, 3, 3) from their six numbers (m, 6), in the order of `PAIRS`."""
    out = np.empty((len(upper), 3, 3))
    out[:, ROW, COLUMN] = upper
    out[:, COLUMN, ROW] = upper
    return out


def flat(matrices: Array) -> Array:
    """Matrices (m, 3, 3) as six columns (m, 6), in the order of `columns`."""
    return matrices[:, ROW, COLUMN]


def factors(matrices: Array) -> Array:
    """L with L L' = C for positive semidefinite C, shape (m, 3, 3); rank may be less than 3."""
    values, vectors = np.linalg.eigh(matrices)
    return vectors * np.sqrt(np.clip(values, 0.0, None))[:, None, :]


def stated(matrices: Array) -> bool:
    """Whether measurements have covariances: all of them or none, (m, 3, 3) with NaN for none.

    Raises:
        InputError: Only some have.
    """
    known = np.asarray(np.isfinite(matrices).all(axis=(1, 2)), dtype=bool)
    if known.any() and not known.all():
        raise InputError(
            f"{int((~known).sum())} of {len(known)} readings have no uncertainty, the others have",
            "state sigma_m in [tracker] for those without",
        )
    return bool(known.all())
