"""Causes of the catalogue, in other mathematical forms than there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.league.hidden_effect import NOMINAL, Amplitudes, Course, Secret, Setup, straight
from bench.league.machine import Spring
from pipeline.base.arrays import Array


def _rail(label: str, axis: tuple[float, float, float], slides: bool, typical: float) -> Secret:
    def plant(s: Setup, size: float, course: Course) -> Amplitudes:
        below = -0.12 * float(course.rng.uniform(0.5, 1.0)) if not slides else 0.0
        # the guides are below the origin of the carriage's frame, in which y points down
        s.machine.springs.append(
            Spring(label, 1, axis, slides, straight(size * typical), (0, -below, 0), fixed=True)
        )
        return {label.replace("rail", "c"): size * typical}

    return Secret(label, "rail", True, plant)


def _backlash(s: Setup, size: float, course: Course) -> Amplitudes:
    width = 2e-4 * size

    def law(own: Array, _: dict[str, Array]) -> Array:
        pushed = np.clip(own / 250.0, -1, 1)  # carriage friction takes the first part
        return width / 2 * np.where(np.abs(own) < 1e-6, -course.approach, pushed)

    s.machine.springs.append(Spring("backlash", 1, (0, 0, 1), True, law))
    return {"b_rail": width}


def _rail_varies(s: Setup, size: float, course: Course) -> None:
    pitch = float(course.rng.uniform(1.8, 5.0))
    phase = float(course.rng.uniform(0, 1))
    c = float(s.compliance[0])

    def law(own: Array, _: dict[str, Array]) -> Array:
        saw = 2 * np.abs(2 * ((course.q[:, 0] / pitch + phase) % 1) - 1) - 1
        return np.asarray(own * c * 0.55 * size * saw)  # a triangle instead of a sine

    s.machine.springs.append(Spring("varies", 1, (0, 0, 1), True, law))


def _tilt(joint: int) -> Secret:
    def plant(s: Setup, size: float, course: Course) -> Amplitudes:
        c = float(NOMINAL[joint - 1]) / 6 * size
        x, y = (c * course.rng.uniform(0.5, 1.3, 2)).tolist()
        s.machine.springs += [
            Spring(f"tilt{joint}x", joint, (1, 0, 0), False, straight(x)),
            Spring(f"tilt{joint}y", joint, (0, 1, 0), False, straight(y)),
        ]
        return {f"c_tilt{joint}_x": x, f"c_tilt{joint}_y": y}

    return Secret(f"joint_tilt:{joint}", f"joint {joint}", True, plant)


def _beam(where: str, joint: int, along: tuple[float, float, float], c: float) -> Secret:
    """A cantilever: its middle rotates by L / EI, and deflects by L^2 / 12 of that."""
    length = float(np.linalg.norm(along))
    unit = np.array(along) / length

    def plant(s: Setup, size: float, course: Course) -> Amplitudes:
        turns = (c * size * course.rng.uniform(0.7, 1.3, 2)).tolist()
        axes = ((0.0, 0.0, 1.0), tuple(np.cross(unit, [0, 0, 1.0])))
        for k, (axis, turn) in enumerate(zip(axes, turns, strict=True)):
            at = tuple(np.array(along) / 2)
            side = tuple(np.cross(unit, axis))
            s.machine.springs += [
                Spring(f"{where}{k}", joint, axis, False, straight(turn), at),
                Spring(f"{where}{k}s", joint, side, True, straight(turn * length**2 / 12), at),
            ]
        short = where.removesuffix("_arm").removesuffix("arm")
        names = (f"c_{short}_in_plane", f"c_{short}_out_of_plane")
        return dict(zip(names, turns, strict=True))

    return Secret(f"link_bending:{where}", where, True, plant)


def _tool_flex(s: Setup, size: float, course: Course) -> None:
    c = float(NOMINAL[6]) / 6 * size
    for k, axis in enumerate(((1.0, 0, 0), (0, 1.0, 0))):
        u = float(course.rng.uniform(0.6, 1.3))
        s.machine.springs.append(Spring(f"tool{k}", 8, axis, False, straight(c * u), (0, 0, 0.01)))


def _gear(joint: int) -> Secret:
    """Three linear segments, each stiffer than the previous one."""

    def plant(s: Setup, size: float, course: Course) -> None:
        c, rated = float(NOMINAL[joint - 1]), 1e-3 / float(NOMINAL[joint - 1])
        knee = np.array([0.2, 0.6]) * rated

        def law(own: Array, _: dict[str, Array]) -> Array:
            t = np.abs(own)
            over = np.maximum(t - knee[0], 0) + np.maximum(t - knee[1], 0)
            return np.asarray(-np.sign(own) * over * c * 0.15 * size * 0.9)

        s.machine.springs.append(Spring(f"gear{joint}", joint, (0, 0, 1), False, law))

    return Secret(f"joint_hardening:{joint}", f"joint {joint}", True, plant)


def _lost(joint: int) -> Secret:
    """A dead zone: linear up to the flank, then constant."""

    def plant(s: Setup, size: float, course: Course) -> Amplitudes:
        full = float(course.rng.uniform(0.02, 0.08)) * 1e-3 / float(NOMINAL[joint - 1])

        def law(own: Array, _: dict[str, Array]) -> Array:
            return 6e-5 * size * np.clip(own / full, -1, 1)

        s.machine.springs.append(Spring(f"lost{joint}", joint, (0, 0, 1), False, law))
        return {f"b_{joint}": 6e-5 * size}

    return Secret(f"joint_lost_motion:{joint}", f"joint {joint}", True, plant)


def _two_flanks(joint: int) -> Secret:
    """A second flank yields in one direction of torque only, smoothed over 1 % of the rated."""

    def plant(s: Setup, size: float, course: Course) -> Amplitudes:
        more, sense = 0.3 * float(NOMINAL[joint - 1]) * size, int(course.rng.choice([-1, 1]))
        soft = 1e-5 / float(NOMINAL[joint - 1])

        def law(own: Array, _: dict[str, Array]) -> Array:
            way = sense * own
            return np.asarray(sense * more * (way + np.hypot(way, soft) - soft) / 2)

        s.machine.springs.append(Spring(f"flank{joint}", joint, (0, 0, 1), False, law))
        c = float(s.compliance[joint - 1])
        both = (c + more, c)[::sense]
        names = (f"c_joint{joint}_{sign}" for sign in ("positive", "negative"))
        return dict(zip(names, both, strict=True))

    return Secret(f"joint_asymmetry:{joint}", f"joint {joint}", True, plant)


def _bouc_wen(joint: int) -> Secret:
    """Hysteresis of Bouc and Wen, integrated along the loads of each pose."""

    def plant(s: Setup, size: float, course: Course) -> None:
        width = 5e-5 * size
        scale = 0.15e-3 / float(NOMINAL[joint - 1])

        def law(own: Array, _: dict[str, Array]) -> Array:
            order = np.lexsort((course.repeat, course.pose))
            out, z, last, pose = np.zeros_like(own), 0.0, 0.0, -1
            for i in order:
                if course.pose[i] != pose:
                    z, last, pose = 0.0, 0.0, course.pose[i]
                for step in np.full(24, (own[i] - last) / 24):
                    z += step / scale * (1 - abs(z) * (0.5 * np.sign(step * z) + 0.5))
                last = own[i]
                out[i] = -width * z
            return out

        s.machine.springs.append(Spring(f"bouc{joint}", joint, (0, 0, 1), False, law))

    return Secret(f"joint_hysteresis:{joint}", f"joint {joint}", True, plant)


def _compensator(s: Setup, size: float, course: Course) -> None:
    """A preloaded strut between two pins: its stiffness about the shoulder adds to the gear's."""
    k = 1 / float(s.compliance[2])
    angle = course.q[:, 2] + float(course.rng.uniform(-0.4, 0.4))
    a, b, free = 0.35, 0.9, 0.5

    def energy(t: Array) -> Array:
        length = np.sqrt(a * a + b * b - 2 * a * b * np.cos(t))
        return 0.5 * (length - free) ** 2

    h = 1e-3
    bend = (energy(angle + h) - 2 * energy(angle) + energy(angle - h)) / h**2
    share = 0.085 * size * bend / np.std(bend)

    def law(own: Array, _: dict[str, Array]) -> Array:
        return own * (1 / (k * (1 + share)) - 1 / k)

    s.machine.springs.append(Spring("strut", 3, (0, 0, 1), False, law))


def _wrist(s: Setup, size: float, course: Course) -> Amplitudes:
    names = {5: "j5", 6: "j6", 7: "j7"}
    true = {}
    for a, b in ((5, 6), (6, 7), (5, 7)):
        mean = float(np.sqrt(NOMINAL[a - 1] * NOMINAL[b - 1]))
        c = 0.05 * size * mean * float(course.rng.choice([-1, 1]) * course.rng.uniform(0.6, 1.3))
        true[f"c_{a}{b}"] = c
        for one, other in ((a, b), (b, a)):

            def law(
                own: Array, all_: dict[str, Array], c: float = c, o: str = names[other]
            ) -> Array:
                return c * all_[o]

            s.machine.springs.append(Spring(f"cross{one}{other}", one, (0, 0, 1), False, law))
    return true


def _gain(s: Setup, size: float, course: Course) -> None:
    s.tension.append(lambda f, _: f / (1 - 0.01 * size))


def _zero(s: Setup, size: float, course: Course) -> Amplitudes:
    zero = 20.0 * size * float(course.rng.choice([-1, 1]))
    s.tension.append(lambda f, _: f + zero)
    return {"f_zero": zero}


def _curved(s: Setup, size: float, course: Course) -> None:
    sign = float(course.rng.choice([-1, 1]))
    s.tension.append(lambda f, _: f * (1 + sign * 0.005 * size * (f / 1000.0) ** 0.9))


def _remembers(s: Setup, size: float, course: Course) -> None:
    """A load cell with hysteresis: unloading follows an arc that closes at zero and peak."""
    sign = float(course.rng.choice([-1, 1]))

    def acts(f: Array, own: Course) -> Array:
        most = np.array([f[own.pose == pose].max() for pose in own.pose])
        return np.asarray(f + sign * 0.03 * size * f * (1 - f / most) * (own.branch < 0))

    s.tension.append(acts)


def _chain_weight(s: Setup, size: float, course: Course) -> Amplitudes:
    """Half the weight acts on the robot; the scale in the middle shows the tension there."""

    def acts(F: Array, _: Course) -> Array:
        out = F.copy()
        tension = np.linalg.norm(F, axis=1)
        out[:, 2] -= 25.0 * size
        along = np.sum(out * F, axis=1) / tension
        return np.asarray(out - F * ((along - tension) / tension)[:, None])

    s.force.append(acts)
    return {"w_chain": 50.0 * size}


def _along(names: Sequence[str], vector: Array) -> Amplitudes:
    return dict(zip(names, vector.tolist(), strict=True))


def _chain_offset(s: Setup, size: float, course: Course) -> Amplitudes:
    d = course.rng.standard_normal(3)
    aslant = d / np.linalg.norm(d) * np.sqrt(3) * 8e-3 * size
    s.chain_shift = s.chain_shift + aslant * 0.4  # the distance of its reflectors
    return _along([f"d_{axis}_over_L" for axis in "xyz"], aslant)


def _load_point(s: Setup, size: float, course: Course) -> Amplitudes:
    d = course.rng.standard_normal(3)
    off = d / np.linalg.norm(d) * np.sqrt(3) * 5e-3 * size
    s.load_shift = s.load_shift + off
    return _along([f"dl_{axis}" for axis in "xyz"], off)


def _joint_offset(joint: int) -> Secret:
    def plant(s: Setup, size: float, course: Course) -> Amplitudes:
        off = 1e-3 * size * float(course.rng.choice([-1, 1]))
        s.joint_shift = s.joint_shift + off * (np.arange(len(s.joint_shift)) == joint - 1)
        return {f"d_{joint}": off}

    return Secret(f"joint_offset:{joint}", "metrology", True, plant)


def _base(s: Setup, size: float, course: Course) -> Amplitudes:
    d = course.rng.standard_normal(3)
    turn = d / np.linalg.norm(d) * np.sqrt(3) * 2e-3 * size
    s.base_turn = s.base_turn + turn
    return _along([f"e_{axis}" for axis in "xyz"], turn)


def _drift(s: Setup, size: float, course: Course) -> None:
    d = course.rng.standard_normal(3)
    d = d / np.linalg.norm(d) * np.sqrt(3) * 6e-5 * size
    s.drift = lambda hours: d * (1 - np.exp(-np.asarray(hours)[..., None] / 1.4))


def _sag(s: Setup, size: float, course: Course) -> None:
    s.machine.masses += [(3, (0.6, 0.0, 0.0), 500.0 * size), (5, (0.0, 0.0, -0.7), 400.0 * size)]


KNOWN: tuple[Secret, ...] = (
    _rail("rail_lateral", (1, 0, 0), True, 5e-9),
    _rail("rail_vertical", (0, 0, 1), True, 2.5e-9),
    _rail("rail_roll", (0, 1, 0), False, 1e-8),
    _rail("rail_pitch", (1, 0, 0), False, 5e-9),
    _rail("rail_yaw", (0, 0, 1), False, 7e-9),
    Secret("rail_backlash", "rail", True, _backlash),
    Secret("rail_stiffness_varies", "rail", True, _rail_varies),
    *(_tilt(j) for j in range(2, 8)),
    _beam("upper_arm", 3, (1.3, 0, 0), float(NOMINAL[2]) / 5),
    _beam("forearm", 4, (0.055, -1.525, 0), float(NOMINAL[3]) / 5),
    Secret("tool_flex", "tool", True, _tool_flex),
    *(_gear(j) for j in range(2, 8)),
    *(_lost(j) for j in range(2, 8)),
    *(_bouc_wen(j) for j in range(2, 8)),
    Secret("compensator", "shoulder", True, _compensator),
    Secret("wrist_coupling", "wrist", True, _wrist),
    Secret("scale_gain", "force", True, _gain),
    Secret("scale_zero", "force", True, _zero),
    Secret("scale_curvature", "force", True, _curved),
    Secret("chain_weight", "force", True, _chain_weight),
    Secret("chain_offset", "force", True, _chain_offset),
    Secret("load_point_offset", "force", True, _load_point),
    *(_joint_offset(j) for j in range(2, 8)),
    Secret("base_rotation", "metrology", True, _base),
    Secret("tracker_drift", "metrology", True, _drift),
    Secret("gravity_sag", "metrology", True, _sag),
    *(_two_flanks(j) for j in range(2, 8)),
)

LATER = (Secret("scale_hysteresis", "force", True, _remembers),)
"""Causes of the catalogue that no game draws, so that the league's games stay unchanged."""
