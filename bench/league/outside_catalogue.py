"""Causes that are in no catalogue."""

from __future__ import annotations

import numpy as np

from bench.league.hidden_effect import NOMINAL, Course, Hidden, Secret, Setup, straight
from bench.league.machine import Spring
from pipeline.base.arrays import Array


def _rail_joint(s: Setup, size: float, course: Course) -> None:
    """The carriage rocks beyond the rail's joint at 9 m, but not before it."""
    beyond = course.q[:, 0] > 9.0
    s.machine.springs.append(
        Spring("gap", 1, (0, 1, 0), False, lambda own, _: 2.5e-8 * size * own * beyond, fixed=True)
    )


def _hertz(s: Setup, size: float, course: Course) -> None:
    """Rollers in Hertzian contact: rocking grows with the moment to the power of 2/3."""

    def law(own: Array, _: dict[str, Array]) -> Array:
        return 2.2e-7 * size * np.sign(own) * np.abs(own) ** (2 / 3)

    s.machine.springs.append(Spring("hertz", 1, (0, 1, 0), False, law, fixed=True))


def _loose(s: Setup, size: float, course: Course) -> None:
    """The nest of P2 slips when the tool is loaded."""
    d = course.rng.standard_normal(3)
    s.loose[1] = d / np.linalg.norm(d) * 6e-5 * size


def _creep(s: Setup, size: float, course: Course) -> None:
    """The scale's reading creeps during the day."""
    s.tension.append(lambda f, c: f * (1 + 0.02 * size * np.sqrt(np.maximum(c.time, 0) / 5)))


def _softens(s: Setup, size: float, course: Course) -> None:
    """Joint 3 warms up and softens during the day."""
    c = float(s.compliance[2])
    s.machine.springs.append(
        Spring("warm", 3, (0, 0, 1), False, lambda own, _: own * c * 0.12 * size * course.time / 5)
    )


def _shoulder_elbow(s: Setup, size: float, course: Course) -> None:
    """Torque at the elbow rotates the shoulder, and vice versa."""
    c = 0.12 * size * float(np.sqrt(NOMINAL[2] * NOMINAL[3]))
    s.machine.springs += [
        Spring("c34", 3, (0, 0, 1), False, lambda own, every: c * every["j4"]),
        Spring("c43", 4, (0, 0, 1), False, lambda own, every: c * every["j3"]),
    ]


def _bilinear(s: Setup, size: float, course: Course) -> None:
    """Joint 4 is softer in one direction than in the other."""
    c = float(NOMINAL[3]) * 0.15 * size
    s.machine.springs.append(
        Spring("bilinear", 4, (0, 0, 1), False, lambda own, _: c * np.abs(own) * 0.5)
    )


def _teeth(s: Setup, size: float, course: Course) -> None:
    """The stiffness of joint 2 varies with the teeth, six times per turn."""
    c = float(NOMINAL[1]) * 0.2 * size
    wave = np.cos(6 * course.q[:, 1])
    s.machine.springs.append(Spring("teeth", 2, (0, 0, 1), False, lambda own, _: c * own * wave))


def _bearing(s: Setup, size: float, course: Course) -> None:
    """The bearing of joint 3 yields along its own axis, across the arm like that of joint 4."""
    s.machine.springs.append(Spring("bearing", 3, (0, 0, 1), True, straight(3.0e-8 * size)))


def _rubs(s: Setup, size: float, course: Course) -> None:
    """The chain rubs against something that differs from pose to pose."""
    push = course.rng.standard_normal((int(course.pose.max()) + 1, 3))

    def acts(F: Array, c: Course) -> Array:
        size_n = np.linalg.norm(F, axis=1)[:, None]
        return np.asarray(F + size_n * 0.008 * size * push[c.pose])

    s.force.append(acts)


def _walks(s: Setup, size: float, course: Course) -> None:
    """The carriage slips permanently under the largest pull of a pose."""

    def law(own: Array, _: dict[str, Array]) -> Array:
        late = course.repeat >= 2
        return 9e-5 * size * np.sign(own) * late * (np.abs(own) > 150)

    s.machine.springs.append(Spring("walk", 1, (0, 0, 1), True, law))


def _tripod(s: Setup, size: float, course: Course) -> None:
    """The tripod settles in one step in the middle of the campaign, between zero and pulls."""
    d = course.rng.standard_normal(3)
    d = d / np.linalg.norm(d) * 9e-5 * size
    middle = float(np.median(course.time))
    s.drift = lambda hours: d * (np.asarray(hours)[..., None] > middle)


def _tilts_with_play(s: Setup, size: float, course: Course) -> None:
    """The bearing of joint 4 has play: it tilts at a small moment, and no further."""
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):

        def law(own: Array, _: dict[str, Array]) -> Array:
            return 8e-5 * size * np.clip(own / 60.0, -1, 1)

        s.machine.springs.append(Spring(f"play{axis}", 4, axis, False, law))


def _clamp(s: Setup, size: float, course: Course) -> None:
    """The effector rotates in its clamp under the first pull, and remains there."""

    def law(own: Array, _: dict[str, Array]) -> Array:
        first = np.zeros_like(own)
        first[course.repeat == 0] = own[course.repeat == 0]
        torn = first[np.searchsorted(course.pose, course.pose)]
        return 1.2e-4 * size * np.sign(torn) * (np.abs(own) > 0)

    s.machine.springs.append(Spring("clamp", 8, (0, 0, 1), False, law))


def _cable(s: Setup, size: float, course: Course) -> None:
    """A cable tightens as the robot yields and pulls back along one direction of the hall."""
    d = course.rng.standard_normal(3)
    d = d / np.linalg.norm(d)

    def acts(F: Array, _: Course) -> Array:
        along = np.maximum(np.sum(F * d, axis=1), 0.0)
        return np.asarray(F - 0.02 * size * along[:, None] * d)

    s.force.append(acts)


def _oil(s: Setup, size: float, course: Course) -> None:
    """Joint 5 creeps under load: each pull of a pose finds it further."""
    c = float(NOMINAL[4])
    s.machine.springs.append(
        Spring("oil", 5, (0, 0, 1), False, lambda own, _: 0.05 * size * c * own * course.repeat)
    )


def _ripple(s: Setup, size: float, course: Course) -> None:
    """The pins of the cycloidal gear of joint 3 cause a stiffness ripple, 14 times per turn."""
    c = float(NOMINAL[2]) * 0.15 * size
    wave = np.sin(14 * course.q[:, 2] + 0.7)
    s.machine.springs.append(Spring("pins", 3, (0, 0, 1), False, lambda own, _: c * own * wave))


def _eccentric(s: Setup, size: float, course: Course) -> None:
    """The wheel of joint 5 is eccentric: three teeth are in mesh here and four there."""
    c = float(NOMINAL[4]) * 0.2 * size
    wave = np.abs(np.sin(1.5 * course.q[:, 4])) - 0.64
    s.machine.springs.append(Spring("wheel", 5, (0, 0, 1), False, lambda own, _: c * own * wave))


def _cables(s: Setup, size: float, course: Course) -> None:
    """The hose package pulls at the elbow as the wrist turns: stiffer on one side of joint 5."""
    c = float(NOMINAL[3]) * 0.15 * size
    side = np.cos(course.q[:, 4] - 0.4)
    s.machine.springs.append(Spring("hose", 4, (0, 0, 1), False, lambda own, _: c * own * side))


def _floor(s: Setup, size: float, course: Course) -> None:
    """The floor below the rail yields: joint 2 leans more the farther out the carriage is."""
    c = float(NOMINAL[1]) * 0.25 * size
    out = (course.q[:, 0] / 18.0) ** 2
    s.machine.springs.append(Spring("floor", 2, (0, 0, 1), False, lambda own, _: c * own * out))


def _three_slopes(s: Setup, size: float, course: Course) -> None:
    """The gear of joint 3 is soft at first, stiff in the middle, and soft again."""
    c = float(NOMINAL[2]) * 0.35 * size

    def law(own: Array, _: dict[str, Array]) -> Array:
        size_nm = np.abs(own)
        middle = np.minimum(np.maximum(size_nm - 900.0, 0.0), 2600.0)
        return np.asarray(-c * np.sign(own) * middle)

    s.machine.springs.append(Spring("slopes", 3, (0, 0, 1), False, law))


def _rubs_here(s: Setup, size: float, course: Course) -> None:
    """The seal of joint 2 rubs on one side of its turn, and resists in both directions."""
    hold = 5e-5 * size * (1 + np.cos(course.q[:, 1] - 1.0))

    def law(own: Array, _: dict[str, Array]) -> Array:
        return np.asarray(-hold * course.branch * np.sign(own) * (np.abs(own) > 50))

    s.machine.springs.append(Spring("seal", 2, (0, 0, 1), False, law))


def _link_grows(s: Setup, size: float, course: Course) -> None:
    """The upper arm warms during the readings: it grows in length after the zero of each pose."""
    first = np.array([float(course.time[course.pose == p].min()) for p in course.pose])
    since = course.time - first + 0.02

    def law(own: Array, _: dict[str, Array]) -> Array:
        return np.asarray(9e-4 * size * since)

    s.machine.springs.append(Spring("warm_arm", 3, (1, 0, 0), True, law))


def _sags(s: Setup, size: float, course: Course) -> None:
    """The rail sags between its two feet: the carriage rolls most in the middle of its travel."""
    sag = 3e-8 * size * np.sin(np.pi * np.clip(course.q[:, 0] / 18.0, 0, 1)) ** 2
    s.machine.springs.append(
        Spring("sag", 1, (0, 1, 0), False, lambda own, _: own * sag, fixed=True)
    )


def _bolts(s: Setup, size: float, course: Course) -> None:
    """A bolt at joint 4 comes loose in the middle of the day."""
    c = float(NOMINAL[3]) * 0.2 * size
    late = course.time > np.median(course.time)
    s.machine.springs.append(Spring("bolt", 4, (0, 0, 1), False, lambda own, _: c * own * late))


def _scale_warms(s: Setup, size: float, course: Course) -> None:
    """The load cell warms up: its gain drifts linearly during the day."""
    s.tension.append(lambda f, c: f * (1 + 0.03 * size * np.maximum(c.time, 0) / 2.1))


STRANGE: tuple[Secret, ...] = (
    Secret(
        "rail_joint_rocks", "rail", False, _rail_joint, Hidden(("rail",), (("step", "position"),))
    ),
    Secret("hertzian_rollers", "rail", False, _hertz, Hidden(("rail",), (("smooth", "force"),))),
    Secret("loose_nest", "metrology", False, _loose),
    Secret("scale_creep", "force", False, _creep, Hidden(("scale",), (("smooth", "time"),))),
    Secret("joint_softens", "joint 3", False, _softens, Hidden((3,), (("smooth", "time"),))),
    Secret(
        "shoulder_elbow_coupling",
        "joint 3 | joint 4 | upper_arm",
        False,
        _shoulder_elbow,
        Hidden((3, 4), (("coupling", "torque"),)),
    ),
    Secret("bilinear_gear", "joint 4", False, _bilinear, Hidden((4,), (("smooth", "torque"),))),
    Secret("tooth_stiffness", "joint 2", False, _teeth, Hidden((2,), (("periodic", "angle"),), 6)),
    Secret("axial_bearing", "joint 3", False, _bearing, Hidden((2, 3, 4), (("smooth", "force"),))),
    Secret("chain_rubs", "force", False, _rubs),
    Secret("carriage_walks", "rail", False, _walks),
    Secret("tripod_step", "metrology", False, _tripod),
    Secret(
        "bearing_with_play", "joint 4", False, _tilts_with_play, Hidden((4,), (("step", "torque"),))
    ),
    Secret("clamp_turns", "tool", False, _clamp),
    Secret("cable_pulls_back", "force", False, _cable),
    Secret("gear_creeps", "joint 5", False, _oil, Hidden((5,), (("smooth", "time"),))),
    Secret("pin_ripple", "joint 3", False, _ripple, Hidden((3,), (("periodic", "angle"),), 14)),
    Secret(
        "eccentric_wheel",
        "joint 5",
        False,
        _eccentric,
        Hidden((5,), (("periodic", "angle"), ("smooth", "angle"))),
    ),
    Secret("hose_pulls", "joint 4", False, _cables, Hidden((4,), (("coupling", "angle"),), 1)),
    Secret("floor_yields", "joint 2", False, _floor, Hidden((2,), (("smooth", "position"),))),
    Secret("three_slopes", "joint 3", False, _three_slopes, Hidden((3,), (("smooth", "torque"),))),
    Secret("seal_rubs", "joint 2", False, _rubs_here, Hidden((2,), (("periodic", "angle"),), 1)),
    Secret(
        "link_grows", "joint 3 | upper_arm", False, _link_grows, Hidden((3,), (("smooth", "time"),))
    ),
    Secret(
        "rail_sags",
        "rail",
        False,
        _sags,
        Hidden(("rail",), (("smooth", "position"), ("periodic", "position"))),
    ),
    Secret("bolt_loosens", "joint 4", False, _bolts, Hidden((4,), (("step", "time"),))),
    Secret("scale_warms", "force", False, _scale_warms, Hidden(("scale",), (("smooth", "time"),))),
)
