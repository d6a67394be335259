"""3x3 covariances in table columns, and their factors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, reduce
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools
from pipeline.base.errors import InputError
from pipeline.base.threads import WORTH_A_THREAD, spread

_T = TypeVar("_T")

PAIRS = ("xx", "xy", "xz", "yy", "yz", "zz")
ROW, COLUMN = np.triu_indices(3)
"""Row and column indices of the six numbers of a covariance in its 3x3 matrix."""
PLACES = tuple(zip(ROW.tolist(), COLUMN.tolist(), strict=True))


def columns(before: str = "c", after: str = "_m2") -> list[str]:
    """Names of the six columns that hold a covariance."""
    return [f"{before}{pair}{after}" for pair in PAIRS]


def matrices(table: pd.DataFrame, names: Sequence[str] | None = None) -> Array:
    """Six columns of a table as matrices, shape (rows, 3, 3)."""
    return full(numbers(table, names))


def weighing(table: pd.DataFrame) -> Array:
    """Covariances of a table, shape (rows, 3, 3); unit matrices [m^2] if any of them is unknown."""
    C = matrices(table)
    return C if np.isfinite(C).all() else np.broadcast_to(np.eye(3), C.shape)


def symmetric(upper: Array) -> Array:
    """Matrices (m, 3, 3) from their six numbers (m, 6), in the order of `PAIRS`."""
    return full(list(upper.T))


def full(six: Sequence[Array]) -> Array:
    """Matrices (m, 3, 3) from six columns, in the order of `PAIRS`."""
    out = np.empty((len(six[0]), 3, 3))
    for (i, j), column in zip(PLACES, six, strict=True):
        out[:, i, j] = out[:, j, i] = column
    return out


def flat(matrices: Array) -> Array:
    """Matrices (m, 3, 3) as six numbers (m, 6), in the order of `columns`."""
    return matrices[:, ROW, COLUMN]


def numbers(table: pd.DataFrame, names: Sequence[str] | None = None) -> list[Array]:
    """The six columns of a table, each shape (rows,)."""
    return [table[name].to_numpy(dtype=float) for name in names or columns()]


def alike(C: Array, work: Callable[[Array], Array]) -> Array:
    """Apply `work` to every matrix (m, k, k), once if all of them are equal.

    A million readings with one stated noise have one covariance.
    """
    if len(C) < 2 or not (C[:1] == C).all():
        return work(C)
    one = work(C[:1])
    return np.broadcast_to(one, (len(C), *one.shape[1:]))


def each(columns: Sequence[Any], work: Callable[[Any], _T]) -> list[_T]:
    """Apply `work` to every column, once for columns that share memory.

    Covariances of a stated noise are of this kind: two distinct arrays in six columns.
    """
    where = [column.__array_interface__["data"][0] for column in columns]
    different = dict(zip(where, columns, strict=True))
    much = len(columns[0]) > WORTH_A_THREAD if columns else False
    done = dict(zip(different, spread(work, different.values(), much), strict=True))
    return [done[place] for place in where]


def _alike(six: Sequence[Array]) -> bool:
    """Whether there are rows and all of them have the same covariance."""
    return len(six[0]) > 0 and all(each(six, lambda column: bool((column == column[0]).all())))


def turned(six: Sequence[Array], R: Array) -> list[Array]:
    """Columns of R C R' from those of C; equal covariances are computed once."""
    if _alike(six):
        xx, xy, xz, yy, yz, zz = one = np.array([column[0] for column in six])
        if xx == yy == zz and xy == xz == yz == 0:  # isotropic: invariant under rotation
            return list(six)
        return [np.full(len(six[0]), v) for v in flat(R @ symmetric(one[None]) @ R.T)[0]]
    unit = flat(R @ symmetric(np.eye(6)) @ R.T)
    return list(np.ascontiguousarray((np.column_stack(six) @ unit).T))


_NONE_M2 = 1e-24
"""Variance treated as zero [m^2], that of a picometre, since its square underflows."""


def singular(six: Sequence[Array]) -> Bools:
    """Where a covariance is singular, by Cholesky's pivots, shape (m,)."""
    m = len(six[0])
    xx, xy, xz, yy, yz, zz = (column[:1] for column in six) if _alike(six) else six
    with np.errstate(divide="ignore", invalid="ignore"):
        second = yy - xy * xy / xx
        below = yz - xy * xz / xx
        third = zz - xz * xz / xx - below * below / second
    rounding = np.maximum(1e-13 * (xx + yy + zz), _NONE_M2)
    none = (xx <= rounding) | (second <= rounding) | (third <= rounding)
    return np.broadcast_to(none, m) if m else none


def factors(matrices: Array) -> Array:
    """Lower triangular L with L L' = C for positive semidefinite C, shape (m, 3, 3).

    A direction without scatter gives a zero column: there are as many error terms as independent
    errors, and they do not depend on an order or sign of axes chosen by rounding.
    """
    if len(matrices) > _FEW:
        return _triangular(matrices)
    return _factors(np.asarray(matrices, float).tobytes())


def _triangular(matrices: Array) -> Array:
    left, out = matrices.copy(), np.zeros_like(matrices)
    least = _ROUNDING * np.einsum("mii->m", matrices)
    for k in range(3):
        determined = left[:, k, k] > least
        root = np.sqrt(np.where(determined, left[:, k, k], np.inf))
        out[:, :, k] = left[:, :, k] / root[:, None]
        left = left - out[:, :, k, None] * out[:, None, :, k]
    return np.asarray(out)


_ROUNDING = 1e-12
"""Fraction of the total variance that is treated as zero [1]."""

_FEW = 4096
"""Maximum number of matrices whose factors are cached, at most 5 MB."""


@lru_cache(maxsize=16)
def _factors(matrices: bytes) -> Array:
    """Cached factors; a diagnosis requests those of the same readings 30 times."""
    out = _triangular(np.frombuffer(matrices).reshape(-1, 3, 3))
    out.flags.writeable = False
    return out


def known(six: Sequence[Array]) -> Bools:
    """Where a covariance is known, that is without NaN, shape (m,)."""
    return np.asarray(reduce(np.logical_and, each(six, np.isfinite)))


def stated(known: Bools) -> bool:
    """Whether the measurements have covariances: all of them or none.

    Raises:
        InputError: Only some have one.
    """
    if known.any() and not known.all():
        raise InputError(
            f"{int((~known).sum())} of {len(known)} readings have no uncertainty, the others have",
            "state sigma_m in [tracker] for those without",
        )
    return bool(known.all())
