"""The worlds of the exam, each a small class or an instance of one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from bench.league.hidden import SECRETS
from bench.league.hidden_effect import Course, Secret, Setup, straight
from bench.league.machine import Spring
from bench.league.play import Plan
from bench.worlds import blunders
from bench.worlds.blunders import Spoil, nothing, tracker_moves
from bench.worlds.cell import Cell, Manner, random_plan
from bench.worlds.noise import Bursts, Noise, Polar, Spells, Student, Turn, Wander, White
from bench.worlds.payloads import Carrying
from bench.worlds.sixd import SIGMA_RAD, Poses
from bench.worlds.tables import Table
from pipeline.base.arrays import Array
from pipeline.machine.robot import Robot

PULLED = Manner()
"""16 poses, 4 load steps, both branches, up to 3 kN."""

STATED = "sigma_m = 3e-5"
"""Noise of a reading, or of the position of a pose, as stated in campaign.toml."""

HUNG = Manner(hang=True, scale_n=0.05)
"""The same with weights, known to 5 g."""


DRIFT = ("tracker_drift",)
"""Cause by which slow motion may rightly be named."""

FORCE = ("unit_mixup", "scale_gain", "sign_or_convention")
"""Causes by which forces that are too large by a factor may rightly be named."""

PAYLOAD = ("payload_mass", "payload_center")
"""Causes by which a wrongly stated payload may rightly be named."""


@dataclass(frozen=True)
class World:
    """A kind of campaign as it occurs in practice.

    Attributes:
        name: Name for the command's option.
        exam: noise, blunders, loads, payloads, instruments or tables.
        says: Description in a line.
        robot: Robot that is measured.
        rules: How it is measured.
        noise: Noise of the tracker.
        family: Names of noise that are right here; empty if none is.
        allowed: Names of causes that are right here in addition to those of noise.
        spoil: Blunders in the record.
        drifts: Whether the tracker also moves, by 0.2 to 1 mm.
        factors: Range of the factor from force to the log of the scale, log-uniform.
        stated: Line on the noise in `[tracker]`.
        instrument: Lines of `[instrument]`.
        reads: Poses instead of points, with their noise; None for points.
        timed: Whether the export states the time of each reading.
        secrets: Hidden causes, with sizes in typical ones.
    """

    name: str
    exam: str
    says: str
    robot: str = "kr500_rail"
    rules: Manner = PULLED
    noise: Noise = field(default_factory=White)
    family: tuple[str, ...] = ()
    allowed: tuple[str, ...] = ()
    spoil: Spoil = nothing
    drifts: bool = False
    factors: tuple[float, float] = (1.0, 1.0)
    stated: str = STATED
    instrument: tuple[str, ...] = ()
    reads: Poses | None = None
    timed: bool = True
    secrets: tuple[tuple[Secret, float], ...] = ()

    @property
    def compared(self) -> bool:
        """Whether the same campaign is also played without its errors."""
        return self.exam == "blunders"

    def plan(self, robot: Robot, seed: int) -> Plan:
        """Where it is measured."""
        return random_plan(robot, self.rules, seed)

    def hides(self, robot: Robot, seed: int) -> tuple[tuple[Secret, float], ...]:
        """Secrets of one game."""
        return self.secrets

    def errors(self, cell: Cell, rng: np.random.Generator) -> Array:
        """Errors that the tracker adds to the points, its own frame, shape (r, 3) [m]."""
        for_noise, for_drift = rng.spawn(2)
        noise = self._scatter(cell, self.noise, for_noise)
        return noise + tracker_moves(cell.hours, cell.local, for_drift) if self.drifts else noise

    def as_stated(self, cell: Cell, rng: np.random.Generator) -> Array:
        """The same for a tracker with the stated noise."""
        return self._scatter(cell, White(), rng)

    def _scatter(self, cell: Cell, points: Noise, rng: np.random.Generator) -> Array:
        if self.reads is None:
            return points(cell.hours, cell.local, rng)
        return self.reads(cell.slots, cell.hours, cell.local, rng)


@dataclass(frozen=True)
class TwoJoints(World):
    """Many poses in which only two joints move."""

    moving: tuple[int, int] = (2, 4)
    within_rad: float = 0.5

    def plan(self, robot: Robot, seed: int) -> Plan:
        """One random pose, and all others near it in two joints."""
        first = random_plan(robot, replace(self.rules, poses=1), seed)
        rng, p = np.random.default_rng([seed, 2]), self.rules.poses
        q = np.repeat(first.q, p, axis=0)
        for joint in self.moving:
            q[:, joint] += rng.uniform(-self.within_rad, self.within_rad, p)
            limits = robot.lower[joint], robot.upper[joint]
            q[:, joint] = np.clip(q[:, joint], *limits)
        q = np.where(robot.prismatic, q, np.deg2rad(np.round(np.rad2deg(q), 6)))
        approach = np.where(np.arange(p) % 2 == 0, 1.0, -1.0)
        return replace(first, q=q, anchor=np.repeat(first.anchor, p, axis=0), approach=approach)


@dataclass(frozen=True)
class OffTable(World):
    """The robot differs from its DH parameters."""

    table: Table = field(default_factory=Table)

    def hides(self, robot: Robot, seed: int) -> tuple[tuple[Secret, float], ...]:
        """The errors of the DH parameters in one game, and the other secrets."""
        return (*self.secrets, *self.table.secrets(robot, seed))


def tilting(joint: int, compliance: float) -> Secret:
    """A bearing of a floor robot that yields about both cross axes [rad/(N m)]."""

    def plant(one: Setup, size: float, course: object) -> None:
        one.machine.springs += [
            Spring(f"tilt{joint}x", joint, (1, 0, 0), False, straight(size * compliance)),
            Spring(f"tilt{joint}y", joint, (0, 1, 0), False, straight(0.6 * size * compliance)),
        ]

    return Secret(f"joint_tilt:{joint}", f"joint {joint}", True, plant)


MEMORY_MIN = (2.0, 40.0)
"""Time constant with which a joint forgets [min], log-uniform for each: from a load step to some
poses."""


def _remembers(one: Setup, size: float, course: Course) -> None:
    """Each joint is softer after loads, c (1 + size m), T m' = |tau| / tau_max - m, T its own."""
    steps = np.diff(60 * course.time, prepend=60 * course.time[0])
    for j, c in enumerate(one.compliance, 1):
        forgets = float(np.exp(course.rng.uniform(*np.log(MEMORY_MIN))))
        keeps = np.exp(-steps / forgets)

        def law(own: Array, _: object, c: float = c, keeps: Array = keeps) -> Array:
            held, now = np.zeros(len(own)), 0.0
            share = np.abs(own) / max(np.abs(own).max(), 1e-300)
            for i in range(1, len(own)):
                held[i] = now = keeps[i] * now + (1 - keeps[i]) * share[i - 1]
            return np.asarray(size * c * own * held)

        slides = bool(one.machine.robot.prismatic[j - 1])
        one.machine.springs.append(Spring(f"past{j}", j, (0, 0, 1), slides, law))


MEMORY = Secret("memory", "all joints", False, _remembers)


def _noise(
    name: str, noise: Noise, says: str, *family: str, allowed: tuple[str, ...] = ()
) -> World:
    return World(name, "noise", says, noise=noise, family=family, allowed=allowed)


def _blunder(name: str, spoil: Spoil, says: str, drifts: bool = False) -> World:
    return World(
        name,
        "blunders",
        says,
        spoil=spoil,
        drifts=drifts,
        allowed=DRIFT if drifts else (),
    )


NOISE = (
    _noise("normal", White(), "normal, as stated"),
    _noise("student5", Student(5), "Student t, 5 degrees of freedom, same variance", "heavy_tails"),
    _noise("student3", Student(3), "Student t, 3 degrees of freedom, same variance", "heavy_tails"),
    _noise("student5_axes", Student(5, True), "Student t 5, each axis by itself", "heavy_tails"),
    _noise("student3_axes", Student(3, True), "Student t 3, each axis by itself", "heavy_tails"),
    _noise("bursts", Bursts(), "5 % of the readings four times wider", "heavy_tails"),
    _noise("spells", Spells(), "three to six times wider for 8 min, every 60 min", "heavy_tails"),
    _noise("wander10", Wander(1, 10), "wander of 1 sigma over 10 min", "tracker_wander"),
    _noise(
        "wander60", Wander(1, 60), "wander of 1 sigma over 60 min", "tracker_wander", allowed=DRIFT
    ),
    _noise(
        "wander60x2",
        Wander(2, 60),
        "wander of 2 sigma over 60 min",
        "tracker_wander",
        allowed=DRIFT,
    ),
    _noise("turn10", Turn(1, 10), "turn of 1 sigma at mean range over 10 min", "tracker_wander"),
    _noise(
        "turn60x2",
        Turn(2, 60),
        "turn of 2 sigma at mean range over 60 min",
        "tracker_wander",
        allowed=DRIFT,
    ),
)

SHEETS = {
    "at960": Polar(0.0, 2.9e-7, 8.7e-6, 3.5e-6),
    "at402": Polar(5.8e-6, 0.0, 8.7e-6, 3.5e-6),
    "ltd": Polar(1.25e-5, 0.0, 7.5e-6, 3e-6),
    "radian": Polar(5e-6, 3.5e-7, 5e-6, 2.5e-6),
    "ot2": Polar(7.5e-6, 7.5e-7, 1.0e-5, 3.5e-6),
    "vantage": Polar(8e-6, 4e-7, 1e-5, 2.5e-6),
}
"""Laser trackers by the standard uncertainties of their data sheets."""

_FAR_M = 8.5
"""Distance at which the single figure of campaign.toml equals that of an instrument [m]."""


def _sheet(name: str, sheet: Polar, rms: bool, says: str = "", *family: str) -> World:
    """A tracker of a data sheet with one stated figure: that of its angles, or rms of all axes."""
    along = sheet.range_m + sheet.range_per_m * _FAR_M
    across = sheet.across_m + sheet.across_per_m * _FAR_M
    figure = np.sqrt((along**2 + 2 * across**2) / 3) if rms else across
    of = "rms of three axes" if rms else "angles"
    return World(
        name,
        "noise",
        f"a tracker by its data sheet, one figure stated, that of the {of}{says}",
        noise=sheet,
        family=family,
        stated=f"sigma_m = {figure:.3g}",
    )


BEAMS = (
    *(_sheet(f"{name}_rms", sheet, True) for name, sheet in SHEETS.items()),
    *(_sheet(f"{name}_angles", sheet, False) for name, sheet in SHEETS.items()),
    _sheet(
        "at960_student3",
        replace(SHEETS["at960"], freedom=3.0),
        True,
        ", Student t 3",
        "heavy_tails",
    ),
    _sheet(
        "vantage_bursts",
        replace(SHEETS["vantage"], wide=0.05),
        True,
        ", 5 % of the readings four times wider",
        "heavy_tails",
    ),
)

BLUNDERS = (
    _blunder("base_off", blunders.off("base"), "one base reading off by 0.3 mm to 5 m"),
    _blunder("unloaded_off", blunders.off("unloaded"), "one unloaded reading off"),
    _blunder("loaded_off", blunders.off("loaded"), "one loaded reading off"),
    _blunder("chain_off", blunders.off("chain"), "one reading of the chain off"),
    _blunder("stale", blunders.stale, "one reading repeats the one before"),
    _blunder("failed_lock", blunders.failed_lock, "one reading is (0, 0, 0)"),
    _blunder("pair_one_pose", blunders.pair(True), "two blunders in one pose"),
    _blunder("pair_two_poses", blunders.pair(False), "two blunders in two poses"),
    _blunder("with_drift", blunders.either, "one blunder while the tracker drifts", drifts=True),
    World(
        "forces_times",
        "blunders",
        "all forces written 2 to 100 times too large",
        factors=(2.0, 100.0),
        allowed=FORCE,
    ),
    World(
        "drift_untimed",
        "blunders",
        "the tracker drifts, and the export has no times",
        drifts=True,
        allowed=DRIFT,
        timed=False,
    ),
)

FANUC = "fanuc_r2000ic"
LIGHT = replace(HUNG, force_n=1500.0)
ONE_STEP = replace(PULLED, steps=(1.0,))
LOADS = (
    World("weights_rail", "loads", "weights on the robot on its rail", rules=HUNG),
    World("weights_floor", "loads", "weights on a robot on the floor", FANUC, LIGHT),
    World(
        "weights_floor_cause",
        "loads",
        "the same, and joint 3 tilts",
        FANUC,
        LIGHT,
        secrets=((tilting(3, 3e-7), 1.0),),
    ),
    World(
        "weights_rail_cause",
        "loads",
        "weights on the rail, and a compensator",
        rules=HUNG,
        secrets=((SECRETS["compensator"], 2.0),),
    ),
    World(
        "memory",
        "loads",
        "each joint is softer after loads, and forgets them in 2 to 40 min",
        secrets=((MEMORY, 0.2),),
    ),
    World("poses3", "loads", "three poses", rules=replace(PULLED, poses=3)),
    World("pull1", "loads", "one pull", rules=replace(ONE_STEP, poses=1)),
    World(
        "pull1_weights",
        "loads",
        "one weight on a robot on the floor",
        FANUC,
        replace(LIGHT, poses=1, steps=(1.0,)),
    ),
    TwoJoints("two_joints", "loads", "197 poses of two joints", rules=replace(ONE_STEP, poses=197)),
    TwoJoints(
        "two_joints_weights",
        "loads",
        "197 poses of two joints, weights, one reflector, on the floor",
        FANUC,
        replace(LIGHT, poses=197, steps=(1.0,), targets=1),
        moving=(0, 5),
    ),
)


def _mounting(what: Carrying, at_once: bool = False) -> Manner:
    """16 poses with every payload at each, or with one if a row has the torques of the load."""
    most = max(what.masses_kg)
    steps = (1.0,) if what.torques == "load" else tuple(kg / most for kg in what.masses_kg)
    return Manner(steps=steps, at_once=at_once, carries=what)


def _of_payloads(place: str, robot: str, kg: float, hides: tuple[Secret, float]) -> list[World]:
    """Worlds with payloads of once, twice and three times a mass on one robot."""
    two = Carrying((kg, 2 * kg), 3 * kg)
    weighed = replace(two, torques="states")
    kinds = (
        ("payloads", "two payloads, a heavier one foretold", two),
        ("payload_light", "one payload, a heavier one foretold", Carrying((kg,), 3 * kg)),
        ("payload_heavy", "one payload, a lighter one foretold", Carrying((3 * kg,), kg)),
        ("payloads_torques", "two payloads, torques of every state", weighed),
        ("payloads_cause", f"the same, and {hides[0].label}", weighed),
        (
            "payloads_in_turn",
            "one of two payloads at a pose, its torques",
            replace(two, torques="load"),
        ),
        ("wrong_mass", "a mass is stated wrong, torques", replace(weighed, wrong="mass")),
        ("wrong_center", "a centre is stated wrong, torques", replace(weighed, wrong="center")),
        ("wrong_mass_untold", "a mass is stated wrong, no torques", replace(two, wrong="mass")),
        (
            "wrong_center_untold",
            "a centre is stated wrong, no torques",
            replace(two, wrong="center"),
        ),
    )
    return [
        World(
            f"{name}_{place}",
            "payloads",
            f"{place}: {says}",
            robot,
            _mounting(what),
            secrets=(hides,) if name == "payloads_cause" else (),
            allowed=PAYLOAD if name.startswith("wrong") else (),
        )
        for name, says, what in kinds
    ]


PAYLOADS = (
    *_of_payloads("rail", "kr500_rail", 160.0, (SECRETS["compensator"], 2.0)),
    *_of_payloads("floor", FANUC, 55.0, (tilting(3, 3e-7), 1.0)),
)


def _reading(
    name: str, says: str, aside_m: float = 0.0, said: bool = True, stated: str = STATED
) -> World:
    """An instrument that reads poses, on the rail."""
    return World(
        name,
        "instruments",
        says,
        rules=replace(PULLED, at_once=True),
        reads=Poses(aside_m),
        stated=stated,
        instrument=SAID if said else (),
    )


COARSE = White(2.2e-4)
SAID = ('measures = "poses"', f"sigma_rad = {SIGMA_RAD}")
INSTRUMENTS = (
    *(
        World(
            f"{kind}_022",
            "instruments",
            f"0.22 mm of noise that nobody stated, instrument {kind}",
            noise=COARSE,
            stated="",
            instrument=(f'kind = "{kind}"',),
        )
        for kind in ("unknown", "camera")
    ),
    _reading("poses", "6D poses, said to be such"),
    _reading("poses_aside", "the same, of a probe 0.25 m off the targets", aside_m=0.25),
    _reading("poses_as_points", "6D poses that pass for points of the stated noise", said=False),
    _reading("poses_unsaid", "6D poses of which nobody says anything", said=False, stated=""),
    replace(
        _reading("poses_cause", "6D poses, said to be such, and a compensator"),
        secrets=((SECRETS["compensator"], 2.0),),
    ),
    replace(
        _reading("poses_payloads", "6D poses of a robot on the floor under two payloads"),
        robot=FANUC,
        rules=_mounting(Carrying((55.0, 110.0), 165.0), at_once=True),
    ),
)


def _table(name: str, says: str, table: Table) -> World:
    return OffTable(name, "tables", says, table=table)


TABLES = (
    _table("length5", "a link 5 mm longer or shorter than its table", Table("link_length", 5e-3)),
    _table("length20", "a link off by 20 mm", Table("link_length", 20e-3)),
    _table("length50", "a link off by 50 mm", Table("link_length", 50e-3)),
    _table("offset5", "an offset off by 5 mm", Table("link_offset", 5e-3)),
    _table("twist5", "a twist off by 5 mrad", Table("link_twist", 5e-3)),
    _table("zero3", "a joint's zero off by 3 mrad", Table("joint_offset", 3e-3)),
    _table("sign", "a link length with the wrong sign", Table("link_length", np.nan)),
    _table(
        "rough",
        "every entry off by 0.2 to 1 mm and mrad, joints that err by 0.1 to 0.3 mrad",
        Table(rough=(0.2, 1.0), joints=(0.1, 0.3)),
    ),
    _table("rough_exact", "the same with joints that do not err", Table(rough=(0.2, 1.0))),
    _table(
        "rough_length20",
        "a link off by 20 mm in a table rough by 0.2 to 0.5 mm and mrad, joints err by 0.1 mrad",
        Table("link_length", 20e-3, (0.2, 0.5), (0.1, 0.1)),
    ),
)

WORLDS: Mapping[str, World] = {
    world.name: world
    for world in (*NOISE, *BEAMS, *BLUNDERS, *LOADS, *PAYLOADS, *INSTRUMENTS, *TABLES)
}
EXAMS = tuple(dict.fromkeys(world.exam for world in WORLDS.values()))
