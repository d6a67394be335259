"""A header line into fields: which column is what, and in which unit."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.base.errors import InputError, listed
from pipeline.readers._layout import DELIMITERS


def delimiter_of(line: str) -> str:
    """The delimiter that cuts a header line into the most cells."""
    return max(DELIMITERS, key=line.count)


def names(line: str, delimiter: str) -> list[str]:
    """Column names in lower case, without quotes and blanks."""
    return [cell.strip().strip('"').strip().lower() for cell in line.split(delimiter)]


def unique(found: Sequence[str], file: str, line: int) -> None:
    """No two columns may have the same name.

    Raises:
        InputError: Two have.
    """
    twice = sorted({name for name in found if name and found.count(name) > 1})
    if twice:
        raise InputError(
            f"there are two columns {listed(twice)}", "remove or rename one", file=file, line=line
        )


def suffixed(
    found: Sequence[str], stem: str, units: Sequence[str]
) -> tuple[str, str | None] | None:
    """The column of a quantity and the unit in its name: `x_mm`, `mm`; None where it has none."""
    of_unit = {f"{stem}_{unit}".lower(): unit for unit in units} | {stem.lower(): None}
    return next(((name, of_unit[name]) for name in found if name in of_unit), None)
