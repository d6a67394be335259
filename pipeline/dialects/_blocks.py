"""Fill in empty names below the first row of a block, as people leave them blank."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pyarrow as pa

from pipeline.base.arrays import Bools, Ints, Strings
from pipeline.readers._layout import TypedRows


def filled_down(table: TypedRows, roles: Sequence[str]) -> TypedRows:
    """The rows with empty cells of their groups filled from above; unchanged if they are no blocks.

    They are if the first row is filled, half as many cells are empty as filled, or more, and no
    target comes twice in a block. What follows a row that cannot be read belongs nowhere.

    Args:
        table: The rows.
        roles: The columns that form a group, the first of which leads the others.
    """
    there = [*filter(table.columns.__contains__, roles)]
    cells = [np.array(table.columns[role].to_pylist(), dtype=object) for role in there]
    if not cells or not len(table.line) or not cells[0][0]:
        return table
    if 3 * int((cells[0] == "").sum()) < len(cells[0]):
        return table
    sources = _sources(np.array(cells) != "")
    lost = np.array(sorted(number for number, _ in table.rejected), dtype=np.int64)
    whole = np.searchsorted(lost, table.line[sources[-1]]) == np.searchsorted(lost, table.line)
    names = table.columns.get("target", table.columns.get("reflector"))
    if names is None or _twice(sources[-1][whole], np.array(names.to_pylist(), object)[whole]):
        return table
    new = {
        role: pa.array(own[source], pa.string()).dictionary_encode()
        for role, own, source in zip(there, cells, sources, strict=True)
    }
    reason = f"its {there[0]} is that of a row above which cannot be read; fill it in"
    return replace(table, columns=table.columns | new).only(np.asarray(whole), reason)


def _sources(filled: Bools) -> list[Ints]:
    """The row from which each cell takes its content, for each column of marks of filled cells.

    A block begins where its own column or one that leads it is filled.
    """
    begun = np.logical_or.accumulate(filled, axis=0)
    row = np.arange(filled.shape[1])
    return [np.maximum.accumulate(np.where(one, row, 0)) for one in begun]


def _twice(source: Ints, names: Strings) -> bool:
    """Whether a target comes twice in a block."""
    return len({*zip(source.tolist(), names.tolist(), strict=True)}) < len(names)
