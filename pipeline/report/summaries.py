"""Functions that captions and drawings share, so that texts and figures agree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pipeline.answer.contract import Stiffness
from pipeline.base.arrays import Array

Tables = Mapping[str, pd.DataFrame]
"""Tables by their lower-case names, in SI units."""


def has(tables: Tables, *names: str) -> bool:
    """Whether all these tables exist and are not empty."""
    return all(name in tables and len(tables[name]) > 0 for name in names)


def each_row(table: pd.DataFrame) -> Iterator[Any]:
    """Rows of a table, with the columns as attributes."""
    return table.itertuples()


def interval(joints: Sequence[Stiffness], unit: Array | float) -> Array:
    """Values, lower and upper 95 % limits over `unit`, shape (3, n).

    The upper limit is infinite where the interval of the compliance includes zero.
    """
    limits = np.array([(joint.value, *joint.ci95) for joint in joints], dtype=float).reshape(-1, 3)
    value, low, high = limits.T / unit
    return np.array([value, low, np.where(np.isnan(high), np.inf, high)])
