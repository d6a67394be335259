"""Compliances and errors outside the catalogue that compete with its causes, unnamed.

A list of causes is never complete. If something of this file explains the data as well as a cause
of the catalogue, that cause is not certain, and only the place can be reported. None of it is in
the catalogue: no campaign is ever reported to suffer from one of these.

- bearing_translation:   a joint's bearing (or the flange) is compliant along the axes of its frame;
                         on a rail the translation of the column is covered by the rail's own causes
- cross_talk:            torque at a joint turns the next one; the catalogue covers the wrist
- compliance_by_angle:   of a joint, two harmonics; the catalogue covers the shoulder (compensator)
- compliance_by_time:    of a joint, linear in time
- compliance_by_history: of a joint, or of all in proportion, depending on its earlier loads
- guide_along_the_rail:  compliance of a guide of the carriage varies along the rail, two harmonics
- guide_contact:         deflection of a guide grows less than its load, as of rolling contacts
- tilt_by_moment:        tilt of a bearing, or of what carries it, grows faster than its moment, as
                         of a flange that opens; beside a linear tilt also slower
- effector_play:         the effector turns in its clamp, about the axis of the last joint

Mounting errors compete only in their predictions, never for a name: they have no typical magnitude
that could be weighed against a cause.

- effector_turned:       the effector is mounted on the flange rotated by some angle
- load_on_the_forearm:   the force acts elsewhere, by a vector fixed to the link before the wrist
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.base.arrays import Array, Parameter, vector
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
from pipeline.machine.effects import carriage, joint_lost_motion, joint_tilt
from pipeline.machine.effects._anatomy import (
    arm,
    compliance,
    harmonics,
    rail,
    rail_ends,
    turning,
)
from pipeline.machine.effects.carriage import LARGE
from pipeline.machine.effects.tracker_drift import HOUR_S
from pipeline.machine.robot import Robot
from pipeline.machine.robot.configuration import translation_along

NAMELESS = 0.25
"""Prior odds of one unnamed effect against one cause of the catalogue [1]: about one fault in five
is not in the catalogue."""

_BEARING = 5e-9
"""Typical compliance of a bearing along an axis [m/N], that of preloaded guide rollers."""

_TURN_RAD = 0.05
"""Typical angular error when an effector is mounted by hand [rad]."""

_OFFSET_M = 5e-3
"""Typical error of a point measured on a tool [m], as in the catalogue."""

_FADES_MIN = (5, 20)
"""Time constants of the load memory of a joint [min]: some load steps of a pose, or some poses; a
memory of hours is `compliance_by_time`."""

_STEP_S = 60.0
"""Assumed time from pull to pull if no times are known [s], as long as a turnbuckle takes."""

_SEAT = "at its origin"
"""Where the bearing of the first joint sits."""

_GUIDES = ("rail_lateral", "rail_vertical", "rail_roll", "rail_pitch")
"""Effects of the catalogue that describe guides of the carriage."""

_Screws = Callable[[Loaded], Array]
_Response = Callable[[Loaded, Array], Array]


def nameless(robot: Robot) -> tuple[Effect, ...]:
    """What the robot can have, and beside which the noise is estimated."""
    numbers = turning(robot)
    shoulder = (arm(robot) or (None,))[0]
    guides = [one for one in carriage.effects(robot) if one.name in _GUIDES]
    return (
        *(_bearing(robot, joint) for joint in (*numbers[rail(robot) :], robot.n + 1)),
        *(_cross_talk(robot, *pair) for pair in _coupled(numbers)),
        *(_angle(robot, joint) for joint in numbers if joint != shoulder),
        *(_warming(robot, joint) for joint in range(1, robot.n + 1)),
        *(_along_the_rail(robot, guide) for guide in guides),
        *(_contact(guide) for guide in guides),
        *(_play(effect) for effect in joint_lost_motion.effects(robot) if effect.where == robot.n),
    )


def competing(robot: Robot) -> tuple[Effect, ...]:
    """Everything of this file that competes for the place of a cause: all but mounting errors."""
    tilts = (tilt for tilt in joint_tilt.effects(robot) if tilt.form in ("", _SEAT))
    return (*nameless(robot), *histories(robot), *map(_by_moment, tilts))


def histories(robot: Robot) -> tuple[Effect, ...]:
    """Joints with load memory, each by itself and all together, for each time constant.

    They compete with causes that depend on the order of loads; against a wander of the instrument,
    joints that are `restless` compete.
    """
    every = tuple(range(1, robot.n + 1))
    each = [_history(robot, joint, (joint,), fades) for joint in every for fades in _FADES_MIN]
    return (*each, *(_history(robot, "all", every, fades) for fades in _FADES_MIN))


def mounting(robot: Robot) -> tuple[Effect, ...]:
    """Mounting errors that this robot can have."""
    places = arm(robot)
    return (_turned(), *((_on_the_forearm(places[2] - 1),) if places else ()))


def _coupled(numbers: Sequence[int]) -> list[tuple[int, int]]:
    """Neighbouring revolute joints, except pairs within a wrist."""
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
    """An effect with one parameter per virtual joint, or shared ones, all of one magnitude."""
    words = name.replace("_", " ")
    return Elastic(
        name=name,
        where=where,
        noun=words,
        place="joint",
        parameters=tuple(  # unit 1, relative to typical values: it is never reported
            Parameter(f"{name}_{where}_{k}", "1", size, -20 * size if signed else 0.0, 20 * size)
            for k in sorted({*shared} or range(len(carrier)))
        ),
        signature=f"{words} {where}",
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
        return torque * (np.nan_to_num(loaded.pulls.time) / HOUR_S)[:, None]

    size = 0.05 * compliance(robot, joint)
    return _effect("compliance_by_time", joint, size, (joint,), response)


def _history(robot: Robot, where: int | str, joints: tuple[int, ...], minutes: int) -> Effect:
    """The compliance of each joint grows with its load memory, by one common fraction."""
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
    """Load memory m of each joint before each pull, between 0 and 1, shape (m, k).

    T dm/dt = |tau| / max |tau| - m, where tau is the torque of the previous pull, held until the
    next one; zero between two poses. The first pull has no memory.

    Args:
        pulls: The pulls.
        torque: Torque about each joint [N m], force along a prismatic one [N], shape (m, k).
        fades_s: Time constant T [s].
    """
    order = np.lexsort((pulls.repeat, pulls.time, pulls.pose))
    if np.isfinite(pulls.time).all():
        order = np.argsort(pulls.time, kind="stable")
        step_s = np.diff(pulls.time[order])
    else:
        step_s = np.full(max(len(order) - 1, 0), _STEP_S)
    keeps = np.exp(-step_s / fades_s)
    same_pose = np.diff(pulls.pose[order]) == 0
    share = np.abs(torque) / np.maximum(np.abs(torque).max(axis=0, initial=0.0), 1e-300)
    gains = ((1 - keeps) * same_pose)[:, None] * share[order[:-1]]
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
        return np.sign(load) * np.sqrt(np.abs(load) * LARGE[spring.unit])

    return _effect("guide_contact", _short(guide), spring.typical, (1,), response, guide.twists)


def _by_moment(tilt: Elastic) -> Effect:
    size, large = tilt.parameters[0].typical, LARGE["rad/(N m)"]

    def response(loaded: Loaded, load: Array) -> Array:
        return np.asarray(load * np.sqrt(np.abs(load) / large))

    return _effect("tilt_by_moment", str(tilt.where), size, tilt.carrier, response, tilt.twists)


def _short(guide: Elastic) -> str:
    return guide.name.removeprefix("rail_")


def _play(gear: Elastic) -> Effect:
    """Same motion as the last joint's gear; only reflectors on the flange separate the two."""
    size = gear.parameters[0].typical
    where = f"{gear.where} {gear.form}"
    play = _effect("effector_play", where, size, gear.carrier, gear.response, signed=False)
    return replace(play, signature="the effector turning in its clamp")


def _acting(name: str, unit: str, size: float) -> dict[str, Any]:
    """Description of an effect with three parameters x, y, z that moves no virtual joint."""
    words = name.replace("_", " ")
    return {
        "name": name,
        "noun": words,
        "place": "force",
        "parameters": vector(f"{name}_{{}}", unit, size, -20 * size, 20 * size),
        "signature": words,
        "needs": "",
        "source": "",
        "of": (PULLED, HUNG),
    }


def _turned() -> Effect:
    """Load point and targets rotated together about the flange's origin."""
    described = _acting("effector_turned", "rad", _TURN_RAD)

    def turned(loaded: Loaded, points: Array, values: Array) -> Array:
        here = loaded.configuration
        axes, origin = here.flange_axes, here.flange_origin[:, None]
        R = axes @ Rotation.from_rotvec(values).as_matrix() @ np.swapaxes(axes, 1, 2)
        return np.asarray(origin + np.einsum("mij,mtj->mti", R, points - origin))

    def wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
        return turned(loaded, loaded.load_point[:, None], values)[:, 0], loaded.force

    def points(loaded: Loaded, values: Array) -> Array:
        return turned(loaded, loaded.points, values)

    return Compound(
        **described,
        acts=(Wrench(**described, wrench=wrench), Reflectors(**described, points=points)),
    )


def _on_the_forearm(joint: int) -> Effect:
    def wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
        return loaded.load_point + loaded.configuration.frame(joint)[0] @ values, loaded.force

    return Wrench(**_acting("load_on_the_forearm", "m", _OFFSET_M), wrench=wrench)
