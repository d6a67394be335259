"""Gross error in a geometric parameter of the robot's table, far larger than in the others.

It displaces the unloaded reflectors by millimetres, and changes the displacements only through B.
"""

from __future__ import annotations

from pipeline.base.arrays import Parameter
from pipeline.machine.effect import Table
from pipeline.machine.robot import Robot, axes
from pipeline.machine.robot.dh_parameters import DhParameter, dh_parameters, nominal

NOUNS = {
    "link_length": "wrong link length",
    "link_offset": "wrong link offset",
    "link_twist": "wrong link twist",
    "axis_tilt": "wrong tilt of the axis",
    "link_turn": "wrong turn of the link",
}

NEEDS = "the unloaded absolute positions, in F_b, with the tool's coordinates known"
FURTHER = "a campaign of positions, or more unloaded poses that turn each joint far"
"""What would settle an error of the geometry, and what would where those are in the files."""

_TYPICAL = 1e-3
"""Typical error of a table that was never calibrated: a millimetre, a milliradian."""

_MOST = 0.5
"""Bound on an error: half a metre, half a radian; beyond that it is another robot."""


def effects(robot: Robot) -> tuple[Table, ...]:
    """Every geometric parameter that unloaded reflectors can show, except the joints' zeros."""
    every, names = dh_parameters(robot), axes.alone(robot)
    return tuple(
        _effect(letter, float(value), names[letter.joint - 1])
        for letter, value in zip(every, nominal(robot, every), strict=True)
        if letter.name in NOUNS
    )


def _effect(letter: DhParameter, value: float, axis: str | None) -> Table:
    symbol = letter.key.rsplit("_", 1)[0]
    return Table(
        name=letter.name,
        noun=NOUNS[letter.name],
        place="metrology",
        where=letter.joint,
        shows_unloaded=True,
        parameters=(
            Parameter(
                *(f"{symbol}_{letter.joint}", letter.unit, _TYPICAL, -_MOST, _MOST),
                letter.meaning,
            ),
        ),
        signature=f"the unloaded reflectors are off by as much as the DH parameter {symbol} of "
        f"joint {letter.joint} would move them; the displacements hardly show it",
        needs=NEEDS,
        source="derivative of Eqs. (2), (4) by the entry; Hayati and Mirmirani, J. Robotic Systems "
        "2 (1985), for parallel axes",
        letter=letter,
        nominal=value,
        axis=axis,
    )
