"""What captions and drawings share, so that words and pictures agree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pipeline.answer.contract import Stiffness
from pipeline.base.arrays import Array

Tables = Mapping[str, pd.DataFrame]
"""Tables by the lower-case name of their promise, SI."""


def has(tables: Tables, *names: str) -> bool:
    """Whether all these tables are there and not empty."""
    return all(name in tables and len(tables[name]) > 0 for name in names)


def each_row(table: pd.DataFrame) -> Iterator[Any]:
    """Rows with their columns as attributes."""
    return table.itertuples()


def interval(joints: Sequence[Stiffness], unit: Array | float) -> Array:
    """Values and 95 % limits in a unit, shape (3, n); a compliance may be zero: no upper limit."""
    told = np.array([(joint.value, *joint.ci95) for joint in joints], dtype=float).reshape(-1, 3)
    value, low, high = told.T / unit
    return np.array([value, low, np.where(np.isnan(high), np.inf, high)])
