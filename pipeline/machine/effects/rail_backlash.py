"""Backlash of the rack and pinion: a step of constant width along the rail, missing from Eq. (3).

The available travel depends on where the carriage came to rest within the play:

    travel along the rail = b (tanh(f_y / f_0) - rest) / 2,

with rest = +1 at the end of the play that a positive pull runs into, -1 at the other one. This
holds if only the tooth flanks hold the carriage. If friction holds it, a pull across the rail
leaves it in place, and only a pull towards the free play moves it over:

    travel along the rail = -rest b tanh(max(-rest f_y, 0) / f_r).
"""

from collections.abc import Callable

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import rail
from pipeline.machine.robot import Robot

_FULL_PLAY_FORCE_N = 150.0
"""f_0: scale of the force that closes the play if only the two flanks hold the carriage [N]."""

_FRICTION_N = 300.0
"""f_r: scale of the pull along the rail that moves the carriage against friction [N]."""


def _between_flanks(force: Array, start: Array) -> Array:
    return np.asarray((np.tanh(force / _FULL_PLAY_FORCE_N) - start) / 2)


def _against_friction(force: Array, start: Array) -> Array:
    return np.asarray(-start * np.tanh(np.maximum(-start * force, 0.0) / _FRICTION_N))


_FORMS: dict[str, tuple[float, Callable[[Array, Array], Array]]] = {
    "held by friction": (-1.0, _between_flanks),
    "held by the brake": (1.0, _between_flanks),
    "centred": (0.0, _between_flanks),
    "held by friction until pulled over": (-1.0, _against_friction),
    "held by the brake until pulled over": (1.0, _against_friction),
}
"""Rest position after coming along +y, and law of travel: friction stops the carriage with the
driving flank in contact, a braking drive with the other one; centred if unknown."""


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """Backlash of the rail's drive, in one form per rest position and law."""
    return tuple(_effect(form, *law) for form, law in _FORMS.items()) if rail(robot) else ()


def _effect(form: str, rest: float, law: Callable[[Array, Array], Array]) -> Elastic:
    def travel(loaded: Loaded, force: Array) -> Array:
        return law(force, rest * loaded.pulls.approach[:, None])

    return Elastic(
        name="rail_backlash",
        noun="backlash of the rail drive",
        place="rail",
        form=form,
        tolerance=0.1,
        parameters=(Parameter("b_rail", "m", 2e-4, 0.0, np.inf, "backlash of the rail's drive"),),
        signature="a step along the rail, the same for all reflectors and all forces, "
        "that depends on the sign of the pull and on the way the carriage came",
        needs="pulls both ways along the rail at poses approached both ways, recorded in "
        "joints.csv",
        source="play of 0.20 to 0.24 mm set with +-400 N: operating manual of a rack-driven "
        "linear unit of this class (KUKA KL 1500-3)",
        carrier=(1,),
        response=travel,
    )
