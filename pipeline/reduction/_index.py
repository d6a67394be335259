"""Which pull, pose or target the rows of a table belong to, as numbers instead of names.

A million rows are grouped by whole numbers that occur in runs, as an operator reads them, never by
comparing text.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.covariance import each
from pipeline.readers._log_table import NUMBER_LIMIT


def places(column: pd.Series[str], words: Sequence[str]) -> Ints:
    """Index of every cell among some distinct words, -1 where it is none of them, shape (n,)."""
    codes, different = coded(column)
    place = {word: n for n, word in enumerate(words)}
    of_code = np.array([*(place.get(word, -1) for word in different), -1])
    return np.asarray(of_code[codes], dtype=np.int64)  # index -1, an empty cell, takes the last


def coded(column: pd.Series[str]) -> tuple[Ints, Sequence[str]]:
    """Number of every cell among the distinct words in order, -1 where empty, and the words."""
    if isinstance(column.dtype, pd.CategoricalDtype):
        return np.asarray(column.cat.codes, dtype=np.int64), list(column.cat.categories)
    codes, different = pd.factorize(column, sort=True)
    return np.asarray(codes, dtype=np.int64), list(different)


def pull_numbers(table: pd.DataFrame) -> Ints:
    """One ordered number per row for pose and repeat, both below BEYOND, shape (n,)."""
    return pull_number(table["pose"].to_numpy(), table["repeat"].to_numpy())


def pull_number(pose: Ints, repeat: Ints) -> Ints:
    """The same from pose and repeat themselves."""
    return pose.astype(np.int64, copy=False) * NUMBER_LIMIT + repeat


def taken(table: pd.DataFrame, names: Sequence[str], rows: Ints | slice) -> dict[str, Array]:
    """Some columns at some rows; columns that share one array in memory still do."""
    columns = [table[name].to_numpy() for name in names]
    return dict(zip(names, each(columns, lambda column: column[rows]), strict=True))


def run(rows: Ints) -> Ints | slice:
    """Sorted rows, as a slice where none between them is missing: this avoids a copy."""
    if len(rows) and rows[-1] - rows[0] == len(rows) - 1:
        return slice(int(rows[0]), int(rows[-1]) + 1)
    return rows


def numbered(keys: Ints) -> tuple[Ints, Ints]:
    """The distinct keys in order, and the index of every row's key among them, shape (n,)."""
    if not len(keys):
        return keys, np.zeros(0, dtype=np.int64)
    begins = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
    different, of_run = keys[begins], np.arange(len(begins))
    if not (different[1:] > different[:-1]).all():
        different, of_run = np.unique(different, return_inverse=True)
    return different, np.repeat(of_run, np.diff(np.append(begins, len(keys))))


def found(known: Ints, wanted: Ints) -> Ints:
    """Index of each wanted number among known ones, the last of equals; else -1."""
    if not len(known):
        return np.full(len(wanted), -1)
    if np.array_equal(known, wanted) and (known[1:] > known[:-1]).all():
        return np.arange(len(known))
    begins = np.flatnonzero(np.append(True, wanted[1:] != wanted[:-1]))
    if 2 * len(begins) < len(wanted):  # in runs: one search per run
        return np.repeat(found(known, wanted[begins]), np.diff(np.append(begins, len(wanted))))
    order = None if (known[1:] >= known[:-1]).all() else np.argsort(known, kind="stable")
    at = np.maximum(np.searchsorted(known, wanted, side="right", sorter=order) - 1, 0)
    row = at if order is None else order[at]
    return np.where(known[row] == wanted, row, -1)


def means(values: Array, group: Ints, groups: int) -> Array:
    """Mean of the known values of each group, NaN where there is none, shape (groups,)."""
    known: Bools = ~np.isnan(values)
    if not known.all():
        values, group = values[known], group[known]
    count = np.bincount(group, minlength=groups)
    total = np.bincount(group, values, minlength=groups)
    return np.divide(total, count, out=np.full(groups, np.nan), where=count > 0)
