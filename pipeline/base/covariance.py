"""3x3 covariances in table columns, and factors of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, reduce
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools
from pipeline.base.errors import InputError
from pipeline.base.threads import MUCH, spread

T = TypeVar("T")

PAIRS = ("xx", "xy", "xz", "yy", "yz", "zz")
ROW, COLUMN = np.triu_indices(3)
"""Place of each of the six numbers of a covariance in its 3x3 matrix."""
PLACES = tuple(zip(ROW.tolist(), COLUMN.tolist(), strict=True))


def columns(before: str = "c", after: str = "_m2") -> list[str]:
    """Names of the six columns that hold a covariance."""
    return [f"{before}{pair}{after}" for pair in PAIRS]


def matrices(table: pd.DataFrame, names: Sequence[str] | None = None) -> Array:
    """Six columns of a table as matrices, shape (rows, 3, 3)."""
    return full(numbers(table, names))


def weighing(table: pd.DataFrame) -> Array:
    """The covariances of a table, shape (rows, 3, 3); all alike [1 m^2] where one is not known."""
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
    """Matrices (m, 3, 3) as six columns (m, 6), in the order of `columns`."""
    return matrices[:, ROW, COLUMN]


def numbers(table: pd.DataFrame, names: Sequence[str] | None = None) -> list[Array]:
    """The six columns of a table, each shape (rows,)."""
    return [table[name].to_numpy(dtype=float) for name in names or columns()]


def alike(C: Array, work: Callable[[Array], Array]) -> Array:
    """Work done on every matrix (m, k, k), once where all of them are equal.

    A million readings of one stated noise have one covariance.
    """
    if len(C) < 2 or not (C[:1] == C).all():
        return work(C)
    one = work(C[:1])
    return np.broadcast_to(one, (len(C), *one.shape[1:]))


def each(columns: Sequence[Any], work: Callable[[Any], T]) -> list[T]:
    """Work done on every column, once for those that are one array in memory.

    The covariances of a stated noise are such: two different arrays in six columns.
    """
    where = [column.__array_interface__["data"][0] for column in columns]
    different = dict(zip(where, columns, strict=True))
    much = len(columns[0]) > MUCH if columns else False
    done = dict(zip(different, spread(work, different.values(), much), strict=True))
    return [done[place] for place in where]


def _alike(six: Sequence[Array]) -> bool:
    """Whether all rows of six columns have the same covariance, and there is one."""
    return len(six[0]) > 0 and all(each(six, lambda column: bool((column == column[0]).all())))


def turned(six: Sequence[Array], R: Array) -> list[Array]:
    """Columns of R C R' from those of C; a million equal ones cost as much as one."""
    if _alike(six):
        xx, xy, xz, yy, yz, zz = one = np.array([column[0] for column in six])
        if xx == yy == zz and xy == xz == yz == 0:  # which no rotation changes
            return list(six)
        one = flat(R @ symmetric(one[None]) @ R.T)[0]
        return [np.full(len(six[0]), value) for value in one]
    unit = flat(R @ symmetric(np.eye(6)) @ R.T)
    return list(np.ascontiguousarray((np.column_stack(six) @ unit).T))


_NONE_M2 = 1e-24
"""Scatter of a picometre is none: squares of it are no numbers any more."""


def singular(six: Sequence[Array]) -> Bools:
    """Where a covariance has no scatter in some direction, by Cholesky's pivots, shape (m,)."""
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
    """The lower triangular L with L L' = C for positive semidefinite C, shape (m, 3, 3).

    A direction without scatter costs a column: errors are as many as they are independent, and
    follow no order or sign of axes that rounding chose.
    """
    if len(matrices) > _FEW:
        return _triangular(matrices)
    return _factors(np.asarray(matrices, float).tobytes())


def _triangular(matrices: Array) -> Array:
    left, out = matrices.copy(), np.zeros_like(matrices)
    least = _ROUNDING * np.einsum("mii->m", matrices)
    for k in range(3):
        told = left[:, k, k] > least
        root = np.sqrt(np.where(told, left[:, k, k], np.inf))
        out[:, :, k] = left[:, :, k] / root[:, None]
        left = left - out[:, :, k, None] * out[:, None, :, k]
    return np.asarray(out)


_ROUNDING = 1e-12
"""Part of all scatter that is none [1]."""

_FEW = 4096
"""Matrices up to which factors are kept, in 5 MB at most [1]."""


@lru_cache(maxsize=16)
def _factors(matrices: bytes) -> Array:
    """The same, kept: a diagnosis asks for those of the same readings 30 times."""
    out = _triangular(np.frombuffer(matrices).reshape(-1, 3, 3))
    out.flags.writeable = False
    return out


def known(six: Sequence[Array]) -> Bools:
    """Where a covariance is known, NaN standing for one that is not, shape (m,)."""
    return np.asarray(reduce(np.logical_and, each(six, np.isfinite)))


def stated(known: Bools) -> bool:
    """Whether measurements have covariances: all of them or none.

    Raises:
        InputError: Only some have.
    """
    if known.any() and not known.all():
        raise InputError(
            f"{int((~known).sum())} of {len(known)} readings have no uncertainty, the others have",
            "state sigma_m in [tracker] for those without",
        )
    return bool(known.all())
