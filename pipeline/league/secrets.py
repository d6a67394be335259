"""What a machine of the league may hide: causes of the catalogue in other forms, and others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.league.machine import Law, Machine, Spring
from pipeline.results import Array, Ints
from pipeline.robot import Robot

Hook = Callable[[Array, "Course"], Array]


@dataclass(frozen=True, eq=False)
class Course:
    """How the measurement goes, one row per pull.

    Attributes:
        pose: Index of the pose from 0, shape (m,).
        repeat: Pull within the pose from 0, shape (m,).
        time: Hours since the first reading, shape (m,).
        branch: 1 tightening, -1 slackening, shape (m,).
        approach: How the carriage came, shape (m,).
        q: Joint values of the log, shape (m, n).
        rng: For secrets that are random.
    """

    pose: Ints
    repeat: Ints
    time: Array
    branch: Array
    approach: Array
    q: Array
    rng: np.random.Generator


@dataclass
class Setup:
    """A machine and everything around it that a secret can reach.

    Attributes:
        machine: The machine.
        compliance: True compliance of each joint, shape (n,).
        tension: Scale reading [N] -> true tension [N].
        force: True force vectors -> those that act [N].
        load_shift: The chain pulls so far off the nominal point, flange frame [m].
        target_shift: All reflectors sit so far off, flange frame [m].
        chain_shift: Pl1 sits so far off the chain's line, flange frame [m].
        joint_shift: True joint values minus log.
        base_turn: Base reflectors' nominal coordinates are turned by this vector [rad].
        drift: Hours -> displacement of all readings [m], (3,).
        loose: Target index -> displacement of that reflector under load [m], (3,).
        tracker_scale: Scatter of the tracker over stated.
    """

    machine: Machine
    compliance: Array
    tension: list[Hook] = field(default_factory=list)
    force: list[Hook] = field(default_factory=list)
    load_shift: Array = field(default_factory=lambda: np.zeros(3))
    target_shift: Array = field(default_factory=lambda: np.zeros(3))
    chain_shift: Array = field(default_factory=lambda: np.zeros(3))
    joint_shift: Array = field(default_factory=lambda: np.zeros(7))
    base_turn: Array = field(default_factory=lambda: np.zeros(3))
    drift: Callable[[Array], Array] | None = None
    loose: dict[int, Array] = field(default_factory=dict)
    tracker_scale: float = 1.0


Amplitudes = dict[str, float]
"""True parameters under the catalogue's names; for causes whose parameters mean the same there."""

Plant = Callable[[Setup, float, Course], Amplitudes | None]
"""Puts a secret of a size (in typical sizes of the catalogue) into a set-up."""


@dataclass(frozen=True)
class Secret:
    """One secret.

    Attributes:
        label: `rail_roll`, `joint_tilt:3` of the catalogue, or a name of its own.
        place: Where in the cell it sits, as the diagnosis words it; `a | b` where it joins parts.
        known: True when the catalogue has it (perhaps in another form).
        plant: Puts it in.
    """

    label: str
    place: str
    known: bool
    plant: Plant


def straight(c: float) -> Law:
    """A linear spring of compliance c."""
    return lambda own, _: c * own


def _rail(label: str, axis: tuple[float, float, float], slides: bool, typical: float) -> Secret:
    def plant(s: Setup, size: float, course: Course) -> Amplitudes:
        below = -0.12 * float(course.rng.uniform(0.5, 1.0)) if not slides else 0.0
        # the guides lie below the origin of the carriage's frame, in which y points down
        s.machine.springs.append(
            Spring(label, 1, axis, slides, straight(size * typical), (0, -below, 0), fixed=True)
        )
        return {label.replace("rail", "c"): size * typical}

    return Secret(label, "rail", True, plant)


def _backlash(s: Setup, size: float, course: Course) -> Amplitudes:
    width = 2e-4 * size

    def law(own: Array, _: dict[str, Array]) -> Array:
        pushed = np.clip(own / 250.0, -1, 1)  # the friction of the carriage takes the first part
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
    """A cantilever: its middle turns by L / EI, and gives way by L^2 / 12 of that."""
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
    """Three straight pieces, each stiffer than the one before."""

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
    """A dead zone: straight to the flank, then nothing."""

    def plant(s: Setup, size: float, course: Course) -> Amplitudes:
        full = float(course.rng.uniform(0.02, 0.08)) * 1e-3 / float(NOMINAL[joint - 1])

        def law(own: Array, _: dict[str, Array]) -> Array:
            return 6e-5 * size * np.clip(own / full, -1, 1)

        s.machine.springs.append(Spring(f"lost{joint}", joint, (0, 0, 1), False, law))
        return {f"b_{joint}": 6e-5 * size}

    return Secret(f"joint_lost_motion:{joint}", f"joint {joint}", True, plant)


def _bouc_wen(joint: int) -> Secret:
    """Bouc and Wen's hysteresis, integrated along the loads of each pose."""

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
    """A preloaded strut between two pins: its stiffness about the shoulder, beside the gear's."""
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


def _chain_weight(s: Setup, size: float, course: Course) -> Amplitudes:
    """Half the weight hangs on the robot; the scale in the middle shows the tension there."""

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
    s.chain_shift = s.chain_shift + aslant * 0.4  # its reflectors are so far from each other
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


NOMINAL = 1 / np.array([8.0e7, 3.8e6, 6.6e6, 3.9e6, 5.6e5, 6.6e5, 4.7e5])
"""Nominal compliances of the KR500, Table III; typical sizes are told in them."""

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
)


def _rail_joint(s: Setup, size: float, course: Course) -> None:
    """Beyond the rail's joint at 9 m the carriage rocks, before it does not."""
    beyond = course.q[:, 0] > 9.0
    s.machine.springs.append(
        Spring("gap", 1, (0, 1, 0), False, lambda own, _: 2.5e-8 * size * own * beyond, fixed=True)
    )


def _hertz(s: Setup, size: float, course: Course) -> None:
    """Rollers in Hertzian contact: the rocking grows with the power 2/3 of the moment."""

    def law(own: Array, _: dict[str, Array]) -> Array:
        return 2.2e-7 * size * np.sign(own) * np.abs(own) ** (2 / 3)

    s.machine.springs.append(Spring("hertz", 1, (0, 1, 0), False, law, fixed=True))


def _loose(s: Setup, size: float, course: Course) -> None:
    """The nest of P2 slips when the tool is loaded."""
    d = course.rng.standard_normal(3)
    s.loose[1] = d / np.linalg.norm(d) * 6e-5 * size


def _creep(s: Setup, size: float, course: Course) -> None:
    """The scale's reading creeps through the day."""
    s.tension.append(lambda f, c: f * (1 + 0.02 * size * np.sqrt(np.maximum(c.time, 0) / 5)))


def _softens(s: Setup, size: float, course: Course) -> None:
    """Joint 3 warms up and softens through the day."""
    c = float(s.compliance[2])
    s.machine.springs.append(
        Spring("warm", 3, (0, 0, 1), False, lambda own, _: own * c * 0.12 * size * course.time / 5)
    )


def _shoulder_elbow(s: Setup, size: float, course: Course) -> None:
    """Torque at the elbow turns the shoulder, and the other way round."""
    c = 0.12 * size * float(np.sqrt(NOMINAL[2] * NOMINAL[3]))
    s.machine.springs += [
        Spring("c34", 3, (0, 0, 1), False, lambda own, every: c * every["j4"]),
        Spring("c43", 4, (0, 0, 1), False, lambda own, every: c * every["j3"]),
    ]


def _bilinear(s: Setup, size: float, course: Course) -> None:
    """Joint 4 is softer one way than the other."""
    c = float(NOMINAL[3]) * 0.15 * size
    s.machine.springs.append(
        Spring("bilinear", 4, (0, 0, 1), False, lambda own, _: c * np.abs(own) * 0.5)
    )


def _teeth(s: Setup, size: float, course: Course) -> None:
    """The stiffness of joint 2 repeats with the teeth, six times a turn."""
    c = float(NOMINAL[1]) * 0.2 * size
    wave = np.cos(6 * course.q[:, 1])
    s.machine.springs.append(Spring("teeth", 2, (0, 0, 1), False, lambda own, _: c * own * wave))


def _bearing(s: Setup, size: float, course: Course) -> None:
    """The bearing of joint 3 gives way along its own axis."""
    s.machine.springs.append(Spring("bearing", 3, (0, 0, 1), True, straight(3.0e-8 * size)))


def _rubs(s: Setup, size: float, course: Course) -> None:
    """The chain rubs against something that differs from pose to pose."""
    push = course.rng.standard_normal((int(course.pose.max()) + 1, 3))

    def acts(F: Array, c: Course) -> Array:
        size_n = np.linalg.norm(F, axis=1)[:, None]
        return np.asarray(F + size_n * 0.008 * size * push[c.pose])

    s.force.append(acts)


def _walks(s: Setup, size: float, course: Course) -> None:
    """The carriage slips for good under the largest pull of a pose."""

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
    """The bearing of joint 4 has play: it tips over at a small moment, and no further."""
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):

        def law(own: Array, _: dict[str, Array]) -> Array:
            return 8e-5 * size * np.clip(own / 60.0, -1, 1)

        s.machine.springs.append(Spring(f"play{axis}", 4, axis, False, law))


def _clamp(s: Setup, size: float, course: Course) -> None:
    """The effector turns in its clamp under the first pull, and stays turned."""

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
    """Joint 5 goes on giving way while it is held: each pull of a pose finds it further."""
    c = float(NOMINAL[4])
    s.machine.springs.append(
        Spring("oil", 5, (0, 0, 1), False, lambda own, _: 0.05 * size * c * own * course.repeat)
    )


STRANGE: tuple[Secret, ...] = (
    Secret("rail_joint_rocks", "rail", False, _rail_joint),
    Secret("hertzian_rollers", "rail", False, _hertz),
    Secret("loose_nest", "metrology", False, _loose),
    Secret("scale_creep", "force", False, _creep),
    Secret("joint_softens", "joint 3", False, _softens),
    Secret("shoulder_elbow_coupling", "joint 3 | joint 4 | upper_arm", False, _shoulder_elbow),
    Secret("bilinear_gear", "joint 4", False, _bilinear),
    Secret("tooth_stiffness", "joint 2", False, _teeth),
    Secret("axial_bearing", "joint 3", False, _bearing),
    Secret("chain_rubs", "force", False, _rubs),
    Secret("carriage_walks", "rail", False, _walks),
    Secret("tripod_step", "metrology", False, _tripod),
    Secret("bearing_with_play", "joint 4", False, _tilts_with_play),
    Secret("clamp_turns", "tool", False, _clamp),
    Secret("cable_pulls_back", "force", False, _cable),
    Secret("gear_creeps", "joint 5", False, _oil),
)


SECRETS = {secret.label: secret for secret in (*KNOWN, *STRANGE)}


def setup(robot: Robot, stiffness: Array) -> Setup:
    """An innocent machine with these joint stiffnesses."""
    springs = [
        Spring(f"j{j}", j, (0, 0, 1), bool(robot.prismatic[j - 1]), straight(1 / float(k)))
        for j, k in enumerate(stiffness, 1)
    ]
    return Setup(Machine(robot, springs), 1 / stiffness, joint_shift=np.zeros(robot.n))
