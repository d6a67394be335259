"""Array types, and frozen records whose arrays are read-only."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Strings = npt.NDArray[np.object_]


def compared(values: npt.ArrayLike) -> Array:
    """Values to six significant digits, by which they are compared and ranked.

    All kinds of processors agree on these: what only rounding tells apart keeps its order.
    """
    x = np.asarray(values, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = 10.0 ** (np.floor(np.log10(np.abs(x))) - 5)
        rounded = np.round(x / unit) * unit
    return np.where(np.isfinite(rounded), rounded, x)


class Locked:
    """Base of frozen dataclasses whose arrays are read-only."""

    def __post_init__(self) -> None:
        """Replace every writeable array by a read-only view of it."""
        own = self.__dict__  # faster than iterating over fields: a run creates thousands of records
        for name, value in own.items():
            if isinstance(value, np.ndarray) and value.flags.writeable:
                view = value.view()
                view.flags.writeable = False
                own[name] = view


def sifted(columns: Mapping[str, Any], good: Bools) -> dict[str, Any]:
    """Selected rows of numpy or Arrow columns; a column that is None stays None."""

    def rows(column: Any) -> Any:
        if column is None:
            return None
        return column[good] if isinstance(column, np.ndarray) else column.filter(good)

    return {name: rows(column) for name, column in columns.items()}


@dataclass(frozen=True)
class Parameter:
    """One unknown parameter of a model.

    Attributes:
        name: Name as in result.json, `c_r1`, `c_roll`.
        unit: Its unit, `m/N`, `rad/(N m)`.
        typical: Typical magnitude, in that unit; scales columns and priors.
        lower: Physical lower bound (0 for a compliance).
        upper: Physical upper bound.
        meaning: What it is, as reports call it; `{joint}` stands for the controller's axis.
    """

    name: str
    unit: str
    typical: float
    lower: float = -np.inf
    upper: float = np.inf
    meaning: str = ""


def vector(
    name: str,
    unit: str,
    typical: float,
    lower: float,
    upper: float,
    meaning: str = "",
    axes: Iterable[str] = "xyz",
) -> tuple[Parameter, ...]:
    """A parameter for each axis, which replaces `{}` in name and meaning."""
    return tuple(
        Parameter(
            *(name.replace("{}", axis), unit, typical, lower, upper), meaning.replace("{}", axis)
        )
        for axis in axes
    )
