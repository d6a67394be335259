"""Stiffness of the rail drive along its axis varies with the position of the carriage.

The compliance is c_r1 + c_cos cos(2 pi r_1 / L) + c_sin sin(2 pi r_1 / L) between supports at
pitch L, or c_r1 + c_slope (r_1 - middle) / half length.
"""

from collections.abc import Callable

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import (
    compliance,
    harmonics,
    rail,
    rail_ends,
)
from pipeline.machine.robot import Robot

_Response = Callable[[Loaded, Array], Array]

_PITCH_M = (1.5, 2.0, 3.0, 4.0, 6.0, 9.0)
"""Support pitches that are tried [m]; the true one is rarely documented."""

_SIGNATURE = "the excess along the rail depends on where the carriage stands, not on the arm"
_NEEDS = "one arm pose, pulled along the rail at six or more stations over two support pitches"
_SOURCE = "A_1 phi(r_1); +-40 % between supports is an estimate"


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """Variation with the pitch of the supports, or linear from end to end."""
    if not rail(robot):
        return ()
    return (_steady(robot), *(_waves(robot, pitch) for pitch in _PITCH_M))


def _waves(robot: Robot, pitch: float) -> Elastic:
    def response(loaded: Loaded, force: Array) -> Array:
        return force * harmonics(2 * np.pi * loaded.configuration.q[:, 0] / pitch, (1,))

    return _effect(robot, f"supports every {pitch:g} m", ("c_rail_cos", "c_rail_sin"), response)


def _steady(robot: Robot) -> Elastic:
    low, high = rail_ends(robot)

    def response(loaded: Loaded, force: Array) -> Array:
        return force * ((loaded.configuration.q[:, :1] - (low + high) / 2) / ((high - low) / 2))

    return _effect(robot, "steady", ("c_rail_slope",), response)


def _effect(robot: Robot, form: str, names: tuple[str, ...], response: _Response) -> Elastic:
    c = compliance(robot, 1)
    return Elastic(
        name="rail_stiffness_varies",
        noun="stiffness of the rail drive that varies along the rail",
        place="rail",
        form=form,
        tolerance=0.15,
        parameters=tuple(
            Parameter(
                *(name, "m/N", 0.4 * c),
                meaning=(
                    "change of the drive's compliance from the middle of the rail to its end"
                    if names[1:] == ()
                    else f"amplitude of the drive's compliance between supports, {name[-3:]} part"
                ),
            )
            for name in names
        ),
        signature=_SIGNATURE,
        needs=_NEEDS,
        source=_SOURCE,
        carrier=(1,) * len(names),
        response=response,
    )
