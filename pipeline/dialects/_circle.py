"""Angles in full circles, and rows of which one is beyond the circle of its unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.base.arrays import Array, Ints
from pipeline.base.errors import InputError
from pipeline.dialects._coordinates import PACKED, angular, plain_angles
from pipeline.readers._cells import shown
from pipeline.readers._reader import Meaning

FULL = {"gon": 400.0, "deg": 360.0, "rad": 2.0 * np.pi, PACKED: 360.0}
"""A full circle in each unit of angles."""
FACE = 1e-3
"""How well the faces of an instrument agree, in full circles and of a distance: far worse than any
instrument out of adjustment (a degree would be 3e-3), far better than chance."""
_MINORITY = 0.5
"""Part of the rows: where as many hold no angle at all, the columns are no angles."""


def circles(values: Array, angle: str) -> Array:
    """Angles in full circles."""
    return plain_angles(values, angle) / FULL[angle]


def within_a_circle(
    titles: Sequence[str], numbers: Sequence[Array], line: Ints, meaning: Meaning
) -> dict[int, str]:
    """Rows with an angle that is none in any unit, and why; the others are of the stated unit.

    No instrument counts beyond a full circle; FACE is left for what rounding adds.

    Args:
        titles: Of the three columns.
        numbers: What they hold in its unit, each shape (n,).
        line: Line of each row, shape (n,).
        meaning: Which of them are angles, and their unit.

    Returns:
        Reasons by row from 0, of a minority of the rows.

    Raises:
        InputError: An angle is beyond the circle of its unit, and within that of another one.
    """
    angle, out = str(meaning.angle), {}
    for k in angular(meaning):
        turns = np.abs(circles(numbers[k], angle))
        none = np.abs(numbers[k]) > (1.0 + FACE) * max(FULL.values())
        few = none.mean() < _MINORITY if len(none) else False
        for row in np.flatnonzero(turns > 1.0 + FACE).tolist():
            said = (
                f'column "{shown(titles[k])}" holds {numbers[k][row]:.10g}, more than the '
                f"{FULL[angle]:.4g} {angle} of a full circle"
            )
            if not (none[row] and few):
                raise InputError(
                    said,
                    "correct its unit in the title, or angle in [tracker] of campaign.toml, or "
                    "the row",
                    line=int(line[row]),
                )
            out[row] = f"{said}; correct or remove the row"
    return out
