"""What can give way and has no name in the catalogue: it competes with the causes, unnamed.

A list of causes is never complete. Where something of this file explains the data as well as a
cause of the catalogue does, the cause is not certain, and only the place can be told. None is in
the catalogue: no campaign is ever said to suffer from one of them.

- bearing_translation:   a joint's bearing (or the flange) gives way along the axes of its frame;
                         on a rail the column's is what the rail's own causes say
- cross_talk:            torque at a joint turns the next one; the catalogue has the wrist's
- compliance_by_angle:   of a joint, two harmonics; the catalogue has the shoulder's (compensator)
- compliance_by_time:    of a joint, steadily
- compliance_by_history: of a joint, or of all alike, after the loads that it bore before
- guide_along_the_rail:  a guide of the carriage is softer here than there, two harmonics
- guide_contact:         a guide yields less than in proportion to its load, as rollers do
- effector_play:         the effector turns in its clamp, about the axis of the last joint

Mistakes of mounting only compete in what they predict, never for a name: their sizes have no usual
one that could weigh against a cause.

- effector_turned:       the effector is mounted on the flange turned by some angle
- load_on_the_forearm:   the force acts elsewhere, by a vector fixed to the link before the wrist
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import (
    HUNG,
    PULLED,
    Compound,
    Effect,
    Elastic,
    Loaded,
    Pulls,
    Reflectors,
    Wrench,
    linear,
)
from pipeline.machine.effects import carriage, joint_lost_motion
from pipeline.machine.effects._anatomy import (
    arm,
    compliance,
    harmonics,
    rail,
    rail_ends,
    turning,
)
from pipeline.machine.effects.tracker_drift import HOUR_S
from pipeline.machine.robot import Robot
from pipeline.machine.robot.configuration import translation_along

NAMELESS = 0.25
"""Odds of one thing without a name against one cause of the catalogue, before the data speak: about
one fault in five is none of the catalogue."""

_BEARING = 5e-9
"""Typical compliance of a bearing along an axis [m/N], that of loaded guide rollers."""

_TURN_RAD = 0.05
"""Typical error of mounting an effector by hand [rad]."""

_OFFSET_M = 5e-3
"""Typical error of a point measured on a tool [m], as in the catalogue."""

_LARGE = {"m/N": 1000.0, "rad/(N m)": 3000.0}
"""A load on the guides of a rail that counts as large [N] or [N m], by the unit of compliance."""

_FADES_MIN = (5, 20)
"""How long a joint remembers its loads [min]: some load steps of a pose, or some poses. A memory of
hours is `compliance_by_time`."""

_STEP_S = 60.0
"""From pull to pull where no time is known [s], as long as a turnbuckle takes."""

_GUIDES = ("rail_lateral", "rail_vertical", "rail_roll", "rail_pitch")
"""The guides of the carriage."""

_Screws = Callable[[Loaded], Array]
_Response = Callable[[Loaded, Array], Array]


def nameless(robot: Robot) -> tuple[Effect, ...]:
    """Everything of this file that the robot can have."""
    numbers = turning(robot)
    shoulder = (arm(robot) or (None,))[0]
    guides = [one for one in carriage.effects(robot) if one.name in _GUIDES]
    return (
        *(_bearing(robot, joint) for joint in _own_bearings(robot, numbers)),
        *(_cross_talk(robot, *pair) for pair in _coupled(numbers)),
        *(_angle(robot, joint) for joint in numbers if joint != shoulder),
        *(_warming(robot, joint) for joint in range(1, robot.n + 1)),
        *(_along_the_rail(robot, guide) for guide in guides),
        *(_contact(guide) for guide in guides),
        *(_play(effect) for effect in joint_lost_motion.effects(robot) if effect.where == robot.n),
    )


def histories(robot: Robot) -> tuple[Effect, ...]:
    """Joints that remember, each by itself and all alike: what competes in the order of loads.

    They compete with causes; with a wander of the instrument, joints that are `restless` do.
    """
    every = tuple(range(1, robot.n + 1))
    each = [_history(robot, joint, (joint,), fades) for joint in every for fades in _FADES_MIN]
    return (*each, *(_history(robot, "all", every, fades) for fades in _FADES_MIN))


def mounting(robot: Robot) -> tuple[Effect, ...]:
    """Mistakes of mounting that this robot can have."""
    places = arm(robot)
    return (_turned(), *((_on_the_forearm(places[2] - 1),) if places else ()))


def _own_bearings(robot: Robot, numbers: Sequence[int]) -> list[int]:
    """Turning joints and the flange, without the column that stands on the guides of a rail."""
    return [*(numbers[1:] if rail(robot) else numbers), robot.n + 1]


def _coupled(numbers: Sequence[int]) -> list[tuple[int, int]]:
    """Neighbours, without those that are both of a wrist."""
    wrist = set(numbers[-3:]) if len(numbers) == 6 else set()
    return [pair for pair in itertools.pairwise(numbers) if not set(pair) <= wrist]


def _effect(
    name: str,
    where: int | str,
    size: float,
    carrier: tuple[int, ...],
    response: _Response = linear,
    screws: _Screws | None = None,
    signed: bool = True,
    shared: tuple[int, ...] = (),
) -> Elastic:
    """An effect whose parameters, one for each virtual joint or one shared, are all of one size."""
    said = name.replace("_", " ")
    return Elastic(
        name=name,
        where=where,
        noun=said,
        place="joint",
        parameters=tuple(  # of unit 1, relative to what is typical: nobody is told it
            Parameter(f"{name}_{where}_{k}", "1", size, -20 * size if signed else 0.0, 20 * size)
            for k in sorted({*shared} or range(len(carrier)))
        ),
        signature=f"{said} {where}",
        needs="",
        source="",
        carrier=carrier,
        twists=screws,
        response=response,
        shared=shared,
    )


def _bearing(robot: Robot, joint: int) -> Effect:
    def screws(loaded: Loaded) -> Array:
        here = loaded.configuration
        axes = here.flange_axes if joint > robot.n else here.frame(joint)[0]
        return np.stack([translation_along(axes[:, :, axis]) for axis in range(3)], axis=1)

    carrier = (min(joint, robot.n),) * 3
    return _effect("bearing_translation", joint, _BEARING, carrier, screws=screws, signed=False)


def _cross_talk(robot: Robot, one: int, other: int) -> Effect:
    size = 0.05 * float(np.sqrt(compliance(robot, one) * compliance(robot, other)))
    return _effect(
        "cross_talk",
        f"{one}-{other}",
        size,
        (one, other),
        lambda loaded, torque: torque[:, ::-1],
        shared=(0, 0),
    )


def _angle(robot: Robot, joint: int) -> Effect:
    def response(loaded: Loaded, torque: Array) -> Array:
        return torque * harmonics(loaded.configuration.q[:, joint - 1], (1, 2))

    size = 0.05 * compliance(robot, joint)
    return _effect("compliance_by_angle", joint, size, (joint,) * 4, response)


def _warming(robot: Robot, joint: int) -> Effect:
    def response(loaded: Loaded, torque: Array) -> Array:
        hours = np.nan_to_num(loaded.pulls.time) / HOUR_S
        return torque * hours[:, None]

    size = 0.05 * compliance(robot, joint)
    return _effect("compliance_by_time", joint, size, (joint,), response)


def _history(robot: Robot, where: int | str, joints: tuple[int, ...], minutes: int) -> Effect:
    """The compliance of each joint grows by a like part of itself with what it remembers."""
    own = np.array([compliance(robot, joint) for joint in joints])

    def response(loaded: Loaded, torque: Array) -> Array:
        return own / own[0] * torque * remembered(loaded.pulls, torque, 60.0 * minutes)

    return _effect(
        "compliance_by_history",
        f"{where} {minutes} min",
        0.05 * float(own[0]),
        joints,
        response,
        shared=(0,) * len(joints),
    )


def remembered(pulls: Pulls, torque: Array, fades_s: float) -> Array:
    """What joints remember of earlier loads, between 0 and 1, shape (m, k).

    T dm/dt = |tau| / max |tau| - m, tau the torque that is held since the pull before; between two
    poses none is. The first pull remembers nothing.

    Args:
        pulls: The pulls.
        torque: About each joint [N m], along a sliding one [N], shape (m, k).
        fades_s: T [s].
    """
    order = np.lexsort((pulls.repeat, pulls.time, pulls.pose))
    if np.isfinite(pulls.time).all():
        order = np.argsort(pulls.time, kind="stable")
        step_s = np.diff(pulls.time[order])
    else:
        step_s = np.full(max(len(order) - 1, 0), _STEP_S)
    keeps = np.exp(-step_s / fades_s)
    held = np.diff(pulls.pose[order]) == 0
    share = np.abs(torque) / np.maximum(np.abs(torque).max(axis=0, initial=0.0), 1e-300)
    gains = ((1 - keeps) * held)[:, None] * share[order[:-1]]
    out, now = np.zeros_like(torque), np.zeros(torque.shape[1])
    for row, keep, gain in zip(order[1:], keeps.tolist(), gains, strict=True):
        out[row] = now = keep * now + gain
    return out


def _along_the_rail(robot: Robot, guide: Elastic) -> Effect:
    low, high = rail_ends(robot)

    def response(loaded: Loaded, load: Array) -> Array:
        phase = np.pi * (loaded.configuration.q[:, 0] - low) / (high - low)
        return load * np.insert(harmonics(phase, (1, 2)), 0, 1.0, axis=1)

    def screws(loaded: Loaded) -> Array:
        return guide.screws(loaded).repeat(5, axis=1)

    size = guide.parameters[0].typical
    return _effect("guide_along_the_rail", _short(guide), size, (1,) * 5, response, screws)


def _contact(guide: Elastic) -> Effect:
    (spring,) = guide.parameters

    def response(loaded: Loaded, load: Array) -> Array:
        return np.sign(load) * np.sqrt(np.abs(load) * _LARGE[spring.unit])

    return _effect("guide_contact", _short(guide), spring.typical, (1,), response, guide.twists)


def _short(guide: Elastic) -> str:
    return guide.name.removeprefix("rail_")


def _play(gear: Elastic) -> Effect:
    """Moves what the gear of the last joint moves: only reflectors on the flange tell the two."""
    size = gear.parameters[0].typical
    where = f"{gear.where} {gear.form}"
    play = _effect("effector_play", where, size, gear.carrier, gear.response, signed=False)
    return replace(play, signature="the effector turning in its clamp")


def _acting(name: str, unit: str, size: float) -> dict[str, Any]:
    """What an effect of three parameters that moves no virtual joint says of itself."""
    said = name.replace("_", " ")
    return {
        "name": name,
        "noun": said,
        "place": "force",
        "parameters": tuple(
            Parameter(f"{name}_{axis}", unit, size, -20 * size, 20 * size) for axis in "xyz"
        ),
        "signature": said,
        "needs": "",
        "source": "",
        "of": (PULLED, HUNG),
    }


def _turned() -> Effect:
    """Load point and targets, turned together about the flange's origin."""
    said = _acting("effector_turned", "rad", _TURN_RAD)

    def turned(loaded: Loaded, points: Array, values: Array) -> Array:
        here = loaded.configuration
        axes, origin = here.flange_axes, here.flange_origin[:, None]
        R = axes @ Rotation.from_rotvec(values).as_matrix() @ np.swapaxes(axes, 1, 2)
        return np.asarray(origin + np.einsum("mij,mtj->mti", R, points - origin))

    def wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
        return turned(loaded, loaded.load_point[:, None], values)[:, 0], loaded.force

    def points(loaded: Loaded, values: Array) -> Array:
        return turned(loaded, loaded.points, values)

    return Compound(**said, acts=(Wrench(**said, wrench=wrench), Reflectors(**said, points=points)))


def _on_the_forearm(joint: int) -> Effect:
    def wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
        return loaded.load_point + loaded.configuration.frame(joint)[0] @ values, loaded.force

    return Wrench(**_acting("load_on_the_forearm", "m", _OFFSET_M), wrench=wrench)
