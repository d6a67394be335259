"""Angles as fractions of a circle, and rows in which one exceeds the full circle of its unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.base.arrays import Array, Ints
from pipeline.base.errors import InputError
from pipeline.dialects._coordinates import PACKED, angular, plain_angles
from pipeline.readers._reader import Meaning
from pipeline.readers._text import shortened

FULL = {"gon": 400.0, "deg": 360.0, "rad": 2.0 * np.pi, PACKED: 360.0}
"""Full circle in each unit of angle."""
FACE = 1e-3
"""Largest disagreement of the two faces of an instrument, as a fraction of a circle and of a
distance [1]: far worse than any instrument out of adjustment (a degree would be 3e-3), far better
than chance."""
_MINORITY = 0.5
"""Fraction of the rows [1]: if at least as many hold no possible angle, the columns are not
angles."""


def circles(values: Array, angle: str) -> Array:
    """Angles as fractions of a full circle."""
    return plain_angles(values, angle) / FULL[angle]


def within_a_circle(
    titles: Sequence[str], numbers: Sequence[Array], line: Ints, meaning: Meaning
) -> dict[int, str]:
    """Find rows with an angle that is impossible in any unit.

    No instrument counts beyond a full circle; FACE is a margin for rounding.

    Args:
        titles: Titles of the three columns.
        numbers: Their values in the unit of the file, each shape (n,).
        line: Line number of each row, shape (n,).
        meaning: Which of them are angles, and their unit.

    Returns:
        Reasons by row index from 0, for a minority of the rows.

    Raises:
        InputError: An angle exceeds the full circle of its unit but is possible in another one, or
            half of a column or more is impossible in any.
    """
    angle, out = str(meaning.angle), {}
    for k in angular(meaning):
        turns = np.abs(circles(numbers[k], angle))
        none = np.abs(numbers[k]) > (1.0 + FACE) * max(FULL.values())
        few = none.mean() < _MINORITY if len(none) else False
        for row in np.flatnonzero(turns > 1.0 + FACE).tolist():
            text = (
                f'column "{shortened(titles[k])}" holds {numbers[k][row]:.10g}, more than the '
                f"{FULL[angle]:.4g} {angle} of a full circle"
            )
            if not (none[row] and few):
                raise InputError(
                    text,
                    "correct its unit in the title, or angle in [tracker] of campaign.toml, or "
                    "the row",
                    line=int(line[row]),
                )
            out[row] = f"{text}; correct or remove the row"
    return out
