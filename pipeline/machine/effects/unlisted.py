"""Generated laws for what no catalogue lists: every place of a cell, every variable of a pull.

The catalogue is a finite list. Here suspects are generated systematically:

    WHERE  each joint, the guides of the rail, the scale, the tracker
    OF     its angle, its torque, another joint's angle or torque, position on the rail, magnitude
           and direction of the force, time
    WHAT   waves of 1 to 20 periods per turn, polynomials, steps, one joint moving another

A spring of compliance c(v) = c + sum_k b_k g_k(v) deflects by sum_k b_k g_k(v) tau in addition to
c tau, so that each law is a block of columns of the one linear system, like a cause of the
catalogue. None has a name of its own: all are `unlisted_law`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from itertools import combinations, product

import numpy as np

from pipeline.base.arrays import Array, Parameter, compared
from pipeline.base.quantities import plain
from pipeline.machine.effect import Effect, Elastic, Loaded, Observation, Pulls, Wrench, in_place
from pipeline.machine.effects._anatomy import compliance, direction, rail, rated_torque, turning
from pipeline.machine.effects.carriage import ACROSS, ALONG, LARGE, UP, rotation, translation
from pipeline.machine.effects.tracker_drift import HOUR_S
from pipeline.machine.law import Law, parse
from pipeline.machine.robot import Robot, axes
from pipeline.machine.robot.configuration import rotation_about, torque, translation_along

NAME = "unlisted_law"

AMPLITUDE = "amplitude of the law"
"""What each parameter of a law is called."""

_ORDERS = tuple(range(1, 21))
"""Periods per turn: eccentric wheels have one, cycloidal and strain-wave gears some more; the poses
of one campaign do not resolve finer waves."""

_COUPLED = (1, 2, 3)
"""Periods per turn of another joint: what rotates with it loads this joint once, twice or three
times."""

_PER_RAIL = (1, 2, 3, 4, 5, 6)
"""Periods over the length of rail that the poses span: supports, joints between rail segments."""

_STEPS = 12
"""Maximum number of step positions that are tried."""

_FORCES = 60
"""Maximum number of positions of a step in the force, which differs in every pull."""

_SIDES = 3
"""Minimum number of poses on either side of a step."""

_KNEES = (0.15, 0.3, 0.45, 0.6, 0.75)
"""Torques at which the slope of a gear changes, as fractions of the largest torque [1]."""

_PART = 0.15
"""Typical fraction of a joint's compliance that follows a law [1], as of a hardening gear."""

_TIPS_NM = 60.0
"""Moment that tips a bearing through its play [N m], an estimate."""

_GUIDES = {
    "lateral": (partial(translation, axis=ACROSS), 5e-9, "m/N"),
    "vertical": (partial(translation, axis=UP), 5e-9, "m/N"),
    "roll": (partial(rotation, axis=ALONG), 1e-8, "rad/(N m)"),
    "pitch": (partial(rotation, axis=ACROSS), 1e-8, "rad/(N m)"),
}
"""Guides of the carriage: screw, typical compliance as in the catalogue, unit."""

_ZERO_N = 20.0
"""Typical jump of a scale's zero [N], as of `scale_zero`."""


@lru_cache(maxsize=2)
def effects(robot: Robot, loaded: Loaded, odds: float = 1.0) -> tuple[Effect, ...]:
    """Every law that these pulls could show, each with its share of the odds that there is one.

    All families of laws have equal odds, and so have the members of a family. Most of these
    hundreds are never reported: `worded` adds the words to those that are.
    """
    laws = list(_laws(robot, loaded))
    members = Counter(law.family for law in laws)
    of_family = odds / len(members)
    return tuple(replace(_effect(robot, law), odds=of_family / members[law.family]) for law in laws)


def extensions(robot: Robot, loaded: Loaded, one: Effect) -> tuple[Effect, ...]:
    """The law extended by one further shape each, among those tried for the same part and variable.

    An imperfect gear has harmonics, and a part may follow several functions of one variable: the
    residual of a law is attributed to the same law first. Its odds are shared among the extensions,
    one half by its harmonics, which are integer multiples of its frequency.
    """
    law = one.law
    assert law is not None
    if not (follows(law) or law.part == "spring"):
        return ()
    others = [other for other in _laws(robot, loaded) if other.of == law.of and _adds(law, other)]
    kinds = [_harmonic(law, other) for other in others]
    counts = Counter(kinds)
    return tuple(
        replace(_effect(robot, _with(law, other)), odds=one.odds / len(counts) / counts[kind])
        for other, kind in zip(others, kinds, strict=True)
    )


def _harmonic(law: Law, other: Law) -> bool:
    """Whether a wave has an integer multiple of the law's number of periods."""
    waves = law.kind == other.kind == "periodic" or law.kind == other.kind == "coupling"
    times = other.order / law.order if waves else 0.0
    return waves and times > 1 and bool(np.isclose(times, round(times)))


def _adds(law: Law, other: Law) -> bool:
    """Whether a shape is not yet part of the law; a polynomial contains those of lower degree."""
    smooth = any(one.kind == "smooth" for one in law.shapes) and other.kind == "smooth"
    polynomials = smooth and law.variable in ("angle", "position")
    return not polynomials and _shaped(other) not in map(_shaped, law.shapes)


def _shaped(law: Law) -> tuple[object, ...]:
    return law.kind, law.order, law.at


def _with(law: Law, other: Law) -> Law:
    return replace(law, more=other if law.more is None else _with(law.more, other))


def named(robot: Robot, label: str, form: str) -> Effect | None:
    """The effect of a label and a form; None if they describe no law of this file."""
    name, _, where = label.partition(":")
    try:
        return effect(robot, parse(where, form)) if name == NAME else None
    except (ValueError, IndexError, KeyError):
        return None


def effect(robot: Robot, law: Law) -> Effect:
    """The law as an effect in words; its parameters are amplitudes, all zero if it is absent."""
    return worded(robot, _effect(robot, law))


def worded(robot: Robot, made: Effect) -> Effect:
    """Add noun and signature to the effect of a law, with the controller's names of the joints."""
    assert made.law is not None
    names = axes.alone(robot)
    noun = _noun(made.law, names)
    axis = names[made.where - 1] if isinstance(made.where, int) else None
    return replace(made, noun=noun, signature=noun, axis=axis)


def _effect(robot: Robot, law: Law) -> Effect:
    """The law as an effect without words."""
    if law.beyond:
        return _beyond(robot, law)
    if law.where == "scale":
        return _of_scale(law)
    if law.where == "tracker":
        return _of_tracker(law)
    if law.where == "rail":
        return _of_guide(robot, law) if law.part in _GUIDES else _spring(robot, law, 1)
    return _PARTS.get(law.part, _spring)(robot, law, int(law.where))


# laws that are tried


def _laws(robot: Robot, loaded: Loaded) -> Iterator[Law]:
    pulls, tau = loaded.pulls, torque(loaded.configuration.twists, loaded.load_point, loaded.force)
    for joint in turning(robot):
        yield from _of_angles(robot, pulls, joint)
        yield from _of_torques(pulls, tau[:, joint - 1], joint)
        yield from _of_time(pulls, joint, "spring")
        yield from _since_zero(pulls, joint)
        if rail(robot):
            yield from _of_position(pulls, joint, "spring")
    for one, other in combinations(turning(robot), 2):
        low, high = _ends(tau[:, other - 1])
        yield Law(one, "pair", "coupling", "torque", other, 1.0, low, high)
    if rail(robot):
        for part in ("drive", *_GUIDES):
            yield from _of_position(pulls, "rail", part)
            yield from _of_time(pulls, "rail", part)
            if part != "drive":
                yield from _of_force(pulls, "rail", part)
    yield from _of_time(pulls, "scale", "reading")
    yield from _of_time(pulls, "scale", "zero")
    yield from _of_force(pulls, "scale", "reading")
    yield from _jumps(pulls, "reading", _ABOVE)
    yield from _jumps(pulls, "zero", _BELOW)
    yield from (Law("scale", "reading", "smooth", "direction", 0, k, -1.0, 1.0) for k in (1.0, 2.0))
    if _varies(pulls.time) and np.isfinite(pulls.time_zero).all():
        for power in (0.5, 2.0):
            yield Law("tracker", "place", "smooth", "time", 0, power, *_ends(pulls.time))


def _of_angles(robot: Robot, pulls: Pulls, joint: int) -> Iterator[Law]:
    q = pulls.q[:, joint - 1]
    if not _varies(q):
        return
    yield from _of_own_angle(pulls, joint)
    turned = (i for i in turning(robot) if i != joint and _varies(pulls.q[:, i - 1]))
    for other, order in product(turned, _COUPLED):
        ends = _ends(pulls.q[:, other - 1])
        yield Law(joint, "spring", "coupling", "angle", other, float(order), *ends)


def _of_own_angle(pulls: Pulls, joint: int) -> Iterator[Law]:
    q = pulls.q[:, joint - 1]
    low, high = _ends(q)
    for order in _ORDERS:
        yield Law(joint, "spring", "periodic", "angle", joint, float(order), low, high)
    for degree in (1, 2, 3):
        yield Law(joint, "spring", "smooth", "angle", joint, float(degree), low, high)
    for at in _cuts(q, pulls):
        yield Law(joint, "spring", "step", "angle", joint, 0.0, low, high, at)
    for part, order in product(("friction", "play") if pulls.branch.any() else ("play",), _COUPLED):
        yield Law(joint, part, "periodic", "angle", joint, float(order), low, high)


def _of_torques(pulls: Pulls, tau: Array, joint: int) -> Iterator[Law]:
    low, high = _ends(tau)
    most = max(-low, high)
    if most <= 0:
        return
    for power in (1, 2, 3):
        yield Law(joint, "spring", "smooth", "torque", joint, float(power), low, high)
    for knee in _KNEES:
        yield Law(joint, "knee", "smooth", "torque", joint, 1.0, low, high, knee * most)
    for knee in _KNEES[:-1]:
        yield Law(joint, "knees", "smooth", "torque", joint, 2.0, low, high, knee * most)
    yield Law(joint, "jump", "step", "torque", joint, 0.0, low, high)
    if pulls.zeros_after.any() or len(np.unique(pulls.pose)) < len(pulls):
        for order, knee in product((0.0, 1.0), _KNEES):
            yield Law(joint, "slips", "step", "torque", joint, order, low, high, knee * most)
    yield Law(joint, "tips", "step", "torque", joint, 0.0, low, high, _TIPS_NM)
    for part in ("bearing_x", "bearing_y", "bearing_z"):
        force = _ends(np.linalg.norm(pulls.force, axis=1))
        yield Law(joint, part, "smooth", "force", 0, 1.0, *force)


def _of_time(pulls: Pulls, where: int | str, part: str) -> Iterator[Law]:
    if not _varies(pulls.time):
        return
    low, high = _ends(pulls.time)
    for power in (0.5, 1.0, 2.0):
        yield Law(where, part, "smooth", "time", 0, power, low, high)
    for at in _cuts(pulls.time, pulls):
        yield Law(where, part, "step", "time", 0, 0.0, low, high, at)


def _since_zero(pulls: Pulls, joint: int) -> Iterator[Law]:
    """Creep under load, sinking arm, growing link: functions of the time since the pose's zero."""
    since = pulls.time - pulls.time_zero
    if _varies(since):
        for part in ("creep", "sinks", "grows"):
            yield Law(joint, part, "smooth", "time", 0, 1.0, *_ends(since))


def _of_position(pulls: Pulls, where: int | str, part: str) -> Iterator[Law]:
    s = pulls.q[:, 0]
    if not _varies(s):
        return
    low, high = _ends(s)
    for degree in (1, 2, 3):
        yield Law(where, part, "smooth", "position", 1, float(degree), low, high)
    for at in _cuts(s, pulls):
        yield Law(where, part, "step", "position", 1, 0.0, low, high, at)
    for count in _PER_RAIL:
        yield Law(where, part, "periodic", "position", 1, count / (high - low), low, high)


def _of_force(pulls: Pulls, where: str, part: str) -> Iterator[Law]:
    low, high = _ends(np.linalg.norm(pulls.force, axis=1))
    for power in (0.5, 2 / 3, 2.0, 3.0):
        yield Law(where, part, "smooth", "force", 0, power, low, high)


_ABOVE, _BELOW = 0.0, 1.0
"""Order of a step in the force: whether it acts above or below its position; sticking or a dead
band falsifies small forces."""


def _jumps(pulls: Pulls, part: str, order: float) -> Iterator[Law]:
    """A scale error above or below some force; steps lie between the forces of the pulls."""
    size = np.linalg.norm(pulls.force, axis=1)
    for at in _between(np.sort(size), _FORCES):
        yield Law("scale", part, "step", "force", 0, order, *_ends(size), at)


def _ends(v: Array) -> tuple[float, float]:
    return float(np.nanmin(v)), float(np.nanmax(v))


def _varies(v: Array) -> bool:
    return bool(np.isfinite(v).all() and np.ptp(v) > 1e-9)


def _cuts(v: Array, pulls: Pulls) -> list[float]:
    """Step positions in v (m,), evenly spread, with at least `_SIDES` poses on either side."""
    _, first = np.unique(pulls.pose, return_index=True)
    return _between(np.sort(v[first]))


def _between(each: Array, most: int = _STEPS) -> list[float]:
    """Step positions between ascending values, at most `most` of them, none between equal ones."""
    far = slice(_SIDES - 1, len(each) - _SIDES)
    cuts = ((each[1:] + each[:-1]) / 2)[far][np.diff(compared(each))[far] > 0]
    if not len(cuts):
        return []
    chosen = np.unique(np.linspace(0, len(cuts) - 1, most).round().astype(int))
    return [float(cut) for cut in cuts[chosen]]


# effect of each law


def _said(law: Law, place: str, names: int, unit: str, typical: float) -> dict[str, object]:
    """Description common to all laws; words are added later."""
    return {
        "name": NAME,
        "where": law.where,
        "noun": "",
        "place": place,
        "form": law.form,
        "parameters": tuple(
            Parameter(f"b_{law.where}_{k}", unit, typical, -np.inf, np.inf, AMPLITUDE)
            for k in range(names)
        ),
        "signature": "",
        "needs": "pulls at more values of what it depends on, also beyond those that were taken",
        "source": "made from place, variable and shape; 15 % of a compliance is an estimate",
        "tolerance": 0.1,
        "law": law,
    }


def undecided(robot: Robot, one: Effect, others: Sequence[Law]) -> Effect:
    """The effect of a law, with words that also name the laws that readings do not exclude.

    Args:
        robot: The robot.
        one: The effect of the law.
        others: The other laws of its place, most probable first.
    """
    assert one.law is not None
    first, names = one.law, axes.alone(robot)
    alike = [law for law in others if _but_for_order(law, first)]
    orders = [law.shapes[-1].order for law in (first, *alike)]
    nouns = [
        _noun(first, names, orders),
        *(_noun(law, names) for law in others if law not in alike),
    ]
    text = ", or ".join(dict.fromkeys(nouns))
    return replace(one, noun=text, signature=text)


def _but_for_order(law: Law, other: Law) -> bool:
    """Whether two periodic laws differ only in the number of periods of their last shape."""
    *same, last = law.shapes
    *alike, end = other.shapes
    return same == alike and last.kind in _WAVES and replace(last, order=end.order) == end


_WAVES = ("periodic", "coupling")
"""Periodic kinds of law."""


def _noun(law: Law, names: Sequence[str | None], orders: Sequence[float] = ()) -> str:
    """Description of the law without its place.

    Args:
        law: The law.
        names: Name of the controller axis that moves each joint, if there is one.
        orders: Possible numbers of periods of its last shape, if that is undecided.
    """
    source = in_place(law.source, axis=names[law.source - 1]).removeprefix(" in ")
    if law.part in _NOUNS:
        return _NOUNS[law.part].format(axis=law.part[-1], source=source)
    thing = _THINGS.get(law.part, "stiffness")
    *shapes, last = law.shapes
    does = [*(_does(one, source, [one.order]) for one in shapes), _does(last, source, orders)]
    return f"{thing} that {' and '.join(does)}"


def _does(law: Law, source: str, orders: Sequence[float]) -> str:
    """One shape as a verb phrase; a wave with any of these orders."""
    often = _or([f"{float(f'{order:.2g}'):g}" for order in orders or [law.order]])
    if law.kind == "coupling":
        return f"follows the angle of {source}, {often} per turn"
    if law.kind == "periodic":
        per = "turn" if law.variable == "angle" else "metre of the rail"
        return f"varies {often} times per {per}"
    if law.kind == "step":
        return f"jumps at {_at(law)}"
    return _SMOOTH[law.variable]


def _or(words: Sequence[str]) -> str:
    """Join words: a, b or c."""
    return " or ".join([", ".join(words[:-1]), words[-1]] if words[1:] else words)


def _at(law: Law) -> str:
    """Position of a step in the unit used in text."""
    if law.variable == "angle":
        return f"{np.rad2deg(law.at):.0f}° of the joint"
    if law.variable == "time":
        return f"{plain(law.at / HOUR_S, 2)} h of the campaign"
    return (
        f"{plain(law.at, 2)} m of the rail"
        if law.variable == "position"
        else f"{plain(law.at, 2)} N"
    )


_NOUNS = {
    "knee": "stiffness that changes at a torque",
    "knees": "stiffness with three slopes over the torque",
    "jump": "turn that sets in with the torque",
    "slips": "slip under load",
    "tips": "play of the bearing",
    "creep": "creep under load",
    "sinks": "sinking after the unloaded reading",
    "grows": "growth of the link after the unloaded reading",
    "pair": "compliance shared with {source}",
    "bearing_x": "compliance of the bearing along its {axis} axis",
    "bearing_y": "compliance of the bearing along its {axis} axis",
    "bearing_z": "compliance of the bearing along its {axis} axis",
    "place": "drift that is not steady",
}
"""Noun of those parts whose law needs no further description."""

_THINGS = {
    "drive": "stiffness of the drive",
    "lateral": "lateral compliance of the carriage",
    "vertical": "vertical compliance of the carriage",
    "roll": "roll of the carriage",
    "pitch": "pitch of the carriage",
    "friction": "friction",
    "play": "lost motion",
    "reading": "factor of the force",
    "zero": "zero",
}
"""Subject of the law if it is not the stiffness of a joint."""

_SMOOTH = {
    "angle": "varies smoothly with the angle",
    "torque": "changes with the torque",
    "position": "varies smoothly along the rail",
    "direction": "depends on the direction of the force",
    "time": "changes with time",
    "force": "changes with the force",
}


def _spring(robot: Robot, law: Law, joint: int) -> Effect:
    """Compliance that follows the law: deflection tau g(v)."""
    place = "rail" if law.where == "rail" else "joint"
    unit = robot.joints[joint - 1].compliance_unit
    k = _width(law, False)

    def response(loaded: Loaded, tau: Array) -> Array:
        if law.variable == "torque":
            each = [_of_own_torque(one, tau[:, i]) for i, one in enumerate(law.shapes)]
            return np.stack(each, axis=1)
        return np.asarray(tau * _basis(law, variable(law, loaded)))

    described = _said(law, place, k, unit, _PART * compliance(robot, joint))
    return Elastic(**described, carrier=(joint,) * k, response=response)  # type: ignore[arg-type]


def _of_own_torque(law: Law, tau: Array) -> Array:
    """Deflection per unit of compliance, for a slope that changes with the torque."""
    most = max(-law.low, law.high)
    if law.order == 1.0:
        return np.abs(tau)  # softer in one direction than in the other
    return np.asarray(tau * (np.abs(tau) / most) ** (law.order - 1))


def _knee(robot: Robot, law: Law, joint: int) -> Effect:
    """A slope that changes at one torque, or again half way from there to the largest."""
    most = max(-law.low, law.high)
    knees = np.array([law.at] if law.part == "knee" else [law.at, (law.at + most) / 2])

    def response(loaded: Loaded, tau: Array) -> Array:
        return np.asarray(np.sign(tau) * np.maximum(np.abs(tau) - knees, 0.0))

    unit = robot.joints[joint - 1].compliance_unit
    described = _said(law, "joint", len(knees), unit, 2 * _PART * compliance(robot, joint))
    return Elastic(**described, carrier=(joint,) * len(knees), response=response)  # type: ignore[arg-type]


def _turns(robot: Robot, law: Law, joint: int) -> Effect:
    """Friction and play: an angle in the sense of the torque, perhaps varying with the joint."""
    width = 0.03 * rated_torque(robot, joint)

    def response(loaded: Loaded, tau: Array) -> Array:
        sense = np.tanh(tau / width)
        if law.part == "friction":
            sense = -sense * loaded.pulls.branch[:, None]
        if law.kind == "step":
            return sense
        return np.asarray(sense * np.insert(_basis(law, variable(law, loaded)), 0, 1.0, axis=1))

    k = 1 if law.kind == "step" else 1 + _width(law, False)
    described = _said(law, "joint", k, "rad", 5e-5)
    return Elastic(**described, carrier=(joint,) * k, response=response)  # type: ignore[arg-type]


def _creeps(robot: Robot, law: Law, joint: int) -> Effect:
    """Creep while the load is held, or sinking independently of the load."""

    def response(loaded: Loaded, tau: Array) -> Array:
        return _since(loaded)[:, None] * (tau if law.part == "creep" else np.ones_like(tau))

    typical = 2.0 * compliance(robot, joint) if law.part == "creep" else 2e-4
    unit = robot.joints[joint - 1].compliance_unit if law.part == "creep" else "rad"
    described = _said(law, "joint", 1, f"{unit}/h", typical)
    return Elastic(**described, carrier=(joint,), response=response)  # type: ignore[arg-type]


def _slips(robot: Robot, law: Law, joint: int) -> Effect:
    """A joint that slips for good in every pull beyond a torque, by one angle or by the excess.

    What slipped in earlier pulls of the pose stays, and moves the zeros that were read since.
    """

    def response(loaded: Loaded, tau: Array) -> Array:
        beyond = np.maximum(np.abs(tau) - law.at, 0.0)
        slip = np.asarray(np.sign(tau) * (beyond if law.order else beyond > 0))
        return _stays(loaded.pulls, slip[:, 0])[:, None]

    unit, typical = "rad", 5e-5
    if law.order:
        unit, typical = (
            robot.joints[joint - 1].compliance_unit,
            2 * _PART * compliance(robot, joint),
        )
    return Elastic(**_said(law, "joint", 1, unit, typical), carrier=(joint,), response=response)  # type: ignore[arg-type]


def _stays(pulls: Pulls, slip: Array) -> Array:
    """What slips so far in a pose make a joint deviate by from its zero, shape (m,).

    s_1 + ... + s_l - sum_k a_k s_k over the pulls k of the pose in the order of time, with a_k the
    fraction of its zeros read after pull k.
    """
    order = np.lexsort((pulls.repeat, np.nan_to_num(pulls.time), pulls.pose))
    pose = pulls.pose[order]
    first = np.flatnonzero(np.diff(pose, prepend=pose[:1] - 1))
    of = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(pose))))
    total = np.cumsum(slip[order])
    out = np.empty(len(slip))
    zero = np.bincount(of, (pulls.zeros_after * slip)[order])
    out[order] = total - (total - slip[order])[first][of] - zero[of]
    return out


def _grows(robot: Robot, law: Law, joint: int) -> Effect:
    """Growth of a joint's link since the zero, along the axes of its frame."""
    described = _said(law, "joint", 3, "m/h", 1e-4)
    return Elastic(
        **described,  # type: ignore[arg-type]
        carrier=(joint,) * 3,
        twists=lambda loaded: _shifts(loaded, joint, (0, 1, 2)),
        response=lambda loaded, tau: np.repeat(_since(loaded)[:, None], 3, axis=1),
    )


def _bearing(robot: Robot, law: Law, joint: int) -> Effect:
    """Compliance of a joint's bearing along one axis of its frame."""
    axis = "xyz".index(law.part[-1])
    return Elastic(
        **_said(law, "joint", 1, "m/N", 5e-9),  # type: ignore[arg-type]
        carrier=(joint,),
        twists=lambda loaded: _shifts(loaded, joint, (axis,)),
    )


def _tips(robot: Robot, law: Law, joint: int) -> Effect:
    """A bearing tips through its play about both axes across the joint, and no further."""

    def screws(loaded: Loaded) -> Array:
        axes, origin = loaded.configuration.frame(joint)
        return np.stack([rotation_about(origin, axes[:, :, axis]) for axis in (0, 1)], axis=1)

    return Elastic(
        **_said(law, "joint", 2, "rad", 5e-5),  # type: ignore[arg-type]
        carrier=(joint,) * 2,
        twists=screws,
        response=lambda loaded, tau: np.tanh(tau / law.at),
    )


def _pair(robot: Robot, law: Law, joint: int) -> Effect:
    """Torque at one joint turns another and vice versa (Maxwell and Betti)."""
    other = law.source
    size = _PART * float(np.sqrt(compliance(robot, joint) * compliance(robot, other)))
    return Elastic(
        **_said(law, "joint", 1, "rad/(N m)", size),  # type: ignore[arg-type]
        carrier=(joint, other),
        response=lambda loaded, tau: tau[:, ::-1],
        shared=(0, 0),
    )


_PARTS: dict[str, Callable[[Robot, Law, int], Effect]] = {
    "knee": _knee,
    "knees": _knee,
    "friction": _turns,
    "play": _turns,
    "jump": _turns,
    "creep": _creeps,
    "sinks": _creeps,
    "grows": _grows,
    "slips": _slips,
    "tips": _tips,
    "pair": _pair,
    "bearing_x": _bearing,
    "bearing_y": _bearing,
    "bearing_z": _bearing,
}
"""Constructor of the effect for each part, if it is not a joint's compliance."""


def _of_guide(robot: Robot, law: Law) -> Effect:
    """A guide of the carriage, including its constant compliance, which joint springs omit."""
    screw, typical, unit = _GUIDES[law.part]
    k = _width(law, True)

    def response(loaded: Loaded, load: Array) -> Array:
        if law.variable == "force":
            return np.asarray(
                np.sign(load) * np.abs(load) ** law.order * LARGE[unit] ** (1 - law.order)
            )
        g = _basis(law, variable(law, loaded))
        return np.asarray(load * (g if k == g.shape[1] else np.insert(g, 0, 1.0, axis=1)))

    return Elastic(
        **_said(law, "rail", k, unit, typical),  # type: ignore[arg-type]
        carrier=(1,) * k,
        twists=lambda loaded: screw(loaded).repeat(k, axis=1),
        response=response,
    )


def _of_scale(law: Law) -> Effect:
    """True force: the measured one times 1 + sum_k b_k g_k(v); plus that sum [N] for its zero.

    Where a gain that changes was 1 is not known: any value of what it depends on is as likely, so
    that the law is zero at the middle of its range, with the standard uncertainty of a uniform
    distribution over it. All springs are known no better than that. A zero that changes may be off
    by a constant in addition, of the size of the change.
    """
    zero, by_direction = law.part == "zero", law.variable == "direction"
    k = (3 if law.order == 1.0 else 5) if by_direction else _width(law, False)
    ends = np.array([law.low, law.high])
    middle = 0.0 if zero or by_direction else _basis(law, ends).mean(axis=0)

    def wrench(loaded: Loaded, values: Array) -> tuple[Array, Array]:
        along = direction(loaded) if zero else loaded.force
        g = _aslant(law, loaded) if by_direction else _basis(law, variable(law, loaded)) - middle
        return loaded.load_point, loaded.force + loaded.pulls.pulled * (g @ values)[:, None] * along

    unit, typical = ("N", _ZERO_N) if zero else ("1", 0.01)
    return Wrench(
        **_said(law, "force", k, unit, typical),  # type: ignore[arg-type]
        wrench=wrench,
        gain_std=lambda values: 0.0 if zero else _uniform(law, values),
        zero_std=lambda values: 2 * _uniform(law, values) if zero else 0.0,
    )


def _aslant(law: Law, loaded: Loaded) -> Array:
    """Harmonics of the direction of the force: of first order odd in it, of second even, (m, k).

    Over all directions they are orthogonal, with mean square 1/3: the size of a law is the same in
    any frame.
    """
    x, y, z = direction(loaded).T
    even = [x * y, y * z, z * x, (x * x - y * y) / 2, np.sqrt(0.75) * (z * z - 1 / 3)]
    return np.stack([x, y, z] if law.order == 1.0 else np.sqrt(5.0) * np.array(even), axis=1)


def _uniform(law: Law, values: Array) -> float:
    """Standard deviation of a uniform distribution over the range of a law [unit of its values]."""
    return abs(height(law, values, np.zeros((len(values),) * 2))[0]) / float(np.sqrt(3.0))


def _of_tracker(law: Law) -> Effect:
    """Readings drift along each axis of F_b with a power of the time."""

    def observe(loaded: Loaded, points: Array, time: Array, values: Array) -> Array:
        g = (np.maximum(np.nan_to_num(time), 0.0) / law.high) ** law.order
        return points + g[:, None, None] * values

    return Observation(**_said(law, "metrology", 3, "m", 5e-5), observe=observe, instrument=True)  # type: ignore[arg-type]


# functions of the variable


def variable(law: Law, loaded: Loaded) -> Array:
    """Variable of the law at each pull, (m,)."""
    if law.variable in ("angle", "position"):
        return loaded.configuration.q[:, law.source - 1]
    if law.variable == "time":
        return _since(loaded) * HOUR_S if law.part in _SINCE else loaded.pulls.time
    if law.variable == "torque":
        here = loaded.configuration
        return torque(here.twists, loaded.load_point, loaded.force)[:, law.source - 1]
    return np.asarray(np.linalg.norm(loaded.force, axis=1))


_SINCE = ("creep", "sinks", "grows")


def _since(loaded: Loaded) -> Array:
    """Time since the zero of the pose [h], (m,); zero where unknown."""
    return np.nan_to_num(loaded.pulls.time - loaded.pulls.time_zero) / HOUR_S


def _basis(law: Law, v: Array) -> Array:
    """Basis functions g_k of a variable (m,), shape (m, k).

    Polynomials are held constant outside the range of the data.
    """
    return np.hstack([_shape(one, v) for one in law.shapes])


def _shape(law: Law, v: Array) -> Array:
    """Basis functions of one shape, shape (m, k)."""
    if law.kind in ("periodic", "coupling"):
        phase = law.order * v * (2 * np.pi if law.variable == "position" else 1.0)
        return np.stack([np.cos(phase), np.sin(phase)], axis=1)
    if law.kind == "step":
        return ((v > law.at) != (law.order == _BELOW))[:, None].astype(float)
    if law.variable in ("time", "force"):
        return np.asarray((v / law.high).clip(0.0, 1.0)[:, None] ** law.order)
    middle, half = (law.low + law.high) / 2, max((law.high - law.low) / 2, 1e-12)
    u = ((v - middle) / half).clip(-1.0, 1.0)
    return np.stack([u**power for power in range(1, int(law.order) + 1)], axis=1)


def height(law: Law, values: Array, cov: Array) -> tuple[float, float]:
    """Amplitude and its standard uncertainty, by propagation.

    Half the peak-to-peak value of sum_k b_k g_k(v) over the range of the data; the norm of the
    parameters if the law is no function of a variable.

    Args:
        law: The law.
        values: Its parameters b, SI, shape (k,).
        cov: Their covariance, shape (k, k).
    """
    slope = values / max(float(np.linalg.norm(values)), 1e-300)
    if follows(law):
        g = _basis(law, np.linspace(law.low, law.high, _GRID))
        f = g @ values[len(values) - g.shape[1] :]
        slope = np.zeros(len(values))
        slope[len(values) - g.shape[1] :] = (g[np.argmax(f)] - g[np.argmin(f)]) / 2
    return float(slope @ values), float(np.sqrt(slope @ cov @ slope))


def beyond(robot: Robot, one: Effect, values: Array) -> tuple[Effect, Array]:
    """Uncertainty of a law outside the range of the data: effect and covariance about zero.

    Its standard uncertainty there equals the amplitude of the law: deflections of its height, or of
    its own parameters if it is a function of torque or force only.

    Args:
        robot: The robot.
        one: The law.
        values: Its parameters, SI, shape (k,).
    """
    assert one.law is not None
    law = replace(one.law, beyond=True)
    if follows(law):
        values = np.array(height(one.law, values, np.diag(0 * values))[:1])
    return effect(robot, law), np.outer(values, values)


def _beyond(robot: Robot, law: Law) -> Effect:
    """The law outside the range of the data, with a constant in place of its function."""
    own = replace(law, beyond=False)
    if follows(law):
        own = replace(own, kind="step", order=0.0, at=-np.inf, more=None)
    made = effect(robot, own)
    assert isinstance(made, Elastic)

    def response(loaded: Loaded, tau: Array) -> Array:
        beyond = outside(variable(law, loaded), law.low, law.high)
        return np.asarray(made.response(loaded, tau) * beyond[:, None])

    names = tuple(replace(p, name=f"beyond_{p.name}") for p in made.parameters)
    return replace(made, form=law.form, law=law, parameters=names, response=response)


def outside(v: Array, low: float, high: float) -> Array:
    """How far values of a variable are outside the range of the data, from 0 within to 1, (m,).

    A pull of the campaign is within, also at an end, however its variable is rounded. Outside, it
    rises to 1 within one step of the grid; a range of a single value counts as a step wide.
    """
    step = max(high - low, (abs(low) + abs(high)) / _GRID, 1e-99) / _GRID
    return np.fmin(np.fmax(np.maximum(low - v, v - high) / step, 0.0), 1.0)


YIELDING = ("spring", "drive", *_GUIDES)
"""Parts whose compliance follows the law: deflection is compliance times torque or force."""


def follows(law: Law) -> bool:
    """Whether the law multiplies something by a function of its variable."""
    if law.part in _NOUNS or law.variable in ("direction", "torque"):
        return False
    return law.variable != "force" or law.where == "scale"


_GRID = 1001
"""Number of grid points for the height of a law: fifty per wave of the highest order."""


def _width(law: Law, guide: bool) -> int:
    """Number of amplitudes of a law; for a guide including its constant compliance."""
    first, *more = law.shapes
    return _amplitudes(first, guide) + sum(_amplitudes(one, False) for one in more)


def _amplitudes(law: Law, guide: bool) -> int:
    """Number of amplitudes of one shape."""
    if law.kind in ("periodic", "coupling"):
        return 2 + guide
    if law.kind == "step" or law.variable == "torque":
        return 1
    if law.variable == "force":
        return 1
    if law.variable == "time":
        return 1 + guide
    return int(law.order) + guide


def _shifts(loaded: Loaded, joint: int, axes: tuple[int, ...]) -> Array:
    """Screws along axes of a joint's frame, (m, v, 6)."""
    frame = loaded.configuration.frame(joint)[0]
    return np.stack([translation_along(frame[:, :, axis]) for axis in axes], axis=1)
