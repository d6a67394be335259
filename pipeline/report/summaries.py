"""Tables that captions and drawings share, so that words and pictures agree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

Tables = Mapping[str, pd.DataFrame]
"""Tables by the lower-case name of their promise, SI."""


def has(tables: Tables, *names: str) -> bool:
    """Whether all these tables are there and not empty."""
    return all(name in tables and len(tables[name]) > 0 for name in names)


def each_row(table: pd.DataFrame) -> Iterator[Any]:
    """Rows with their columns as attributes."""
    return table.itertuples()
