"""Robots that differ from their DH parameters: one with a large error, or all with small ones.

The chain of matrices is changed, entry by entry of modified Denavit-Hartenberg parameters, which
the KR500 has: Rot(x, alpha) Trans(x, d) Rot(z, theta) Trans(z, r).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bench.league.hidden_effect import Course, Secret, Setup
from pipeline.base.arrays import Array
from pipeline.machine.robot import Robot

ENTRIES = {
    "link_length": ("before", "shift", 0, (3, 4, 5, 6, 7)),
    "link_offset": ("after", "shift", 2, (3, 4, 5, 6)),
    "link_twist": ("before", "turn", 0, (3, 4, 5, 6, 7)),
    "joint_offset": ("after", "turn", 2, (2, 3, 4, 5, 6)),
}
"""Side of the placement, kind, axis, and joints for which an entry moves reflectors in its own way:
the offsets of foot and rail only determine F_b, those of the flange the tool."""


@dataclass(frozen=True)
class Placed:
    """Placements of a robot's joints, as required by the chain of matrices."""

    placement: tuple[Array, ...]
    flange: Array
    prismatic: Array

    @classmethod
    def of(cls, robot: Robot) -> Placed:
        """Placements according to the robot file."""
        return cls(tuple(np.array(one) for one in robot.placement), robot.flange, robot.prismatic)

    def off(self, name: str, joint: int, size: float) -> Placed:
        """Placements with an error in one entry [m] or [rad]."""
        side, kind, axis, _ = ENTRIES[name]
        step = _motion(kind, axis, size)
        places = list(self.placement)
        one = places[joint - 1]
        places[joint - 1] = step @ one if side == "before" else one @ step
        return replace(self, placement=tuple(places))


def _motion(kind: str, axis: int, size: float) -> Array:
    out = np.eye(4)
    if kind == "shift":
        out[axis, 3] = size
        return out
    a, b = (axis + 1) % 3, (axis + 2) % 3
    out[a, a] = out[b, b] = np.cos(size)
    out[b, a], out[a, b] = np.sin(size), -np.sin(size)
    return out


@dataclass(frozen=True)
class Table:
    """How a robot differs from its DH parameters.

    Attributes:
        name: Entry that is wrong, one of ENTRIES; empty for none.
        size: Size of the error [m] or [rad], with random sign; NaN for an entry with the wrong
            sign.
        rough: Standard deviation of the errors of all entries, log-uniform between these [mm],
            [mrad].
        joints: The same for an error of each joint at each pose [mrad], half as much in mm on the
            rail.
    """

    name: str = ""
    size: float = 0.0
    rough: tuple[float, float] = (0.0, 0.0)
    joints: tuple[float, float] = (0.0, 0.0)

    def secrets(self, robot: Robot, seed: int) -> tuple[tuple[Secret, float], ...]:
        """The secrets of one game."""
        rng = np.random.default_rng([seed, 7])
        every = tuple(self._every(rng))
        wrong = self._wrong(robot, rng)
        label = f"{wrong[0]}:{wrong[1]}" if wrong else ""
        if np.isnan(self.size):  # a wrong sign is a typing error, and is named so
            label = f"sign_or_convention:d_{label[-1]}"

        def plant(one: Setup, size: float, course: Course) -> None:
            stands = Placed.of(robot)
            for name, joint, off in (*every, *([wrong] if wrong else [])):
                stands = stands.off(name, joint, off)
            one.machine.robot = stands  # type: ignore[assignment]
            usual = 1e-3 * _between(self.joints, rng) * np.where(robot.prismatic, 0.5, 1.0)
            poses = int(course.pose.max()) + 1
            one.joint_shift = (usual * rng.standard_normal((poses, robot.n)))[course.pose]

        return ((Secret(label or "table", "metrology", bool(label), plant), 1.0),)

    def _every(self, rng: np.random.Generator) -> list[tuple[str, int, float]]:
        size = 1e-3 * _between(self.rough, rng)
        return [
            (name, joint, size * float(rng.standard_normal()))
            for name, (_, _, _, joints) in ENTRIES.items()
            for joint in joints
        ]

    def _wrong(self, robot: Robot, rng: np.random.Generator) -> tuple[str, int, float] | None:
        if not self.name:
            return None
        joints = ENTRIES[self.name][3]
        if not np.isnan(self.size):
            return self.name, int(rng.choice(joints)), float(rng.choice([-1, 1]) * self.size)
        lengths = {j: robot.placement[j - 1][0, 3] for j in joints}
        joint = int(rng.choice([j for j in joints if abs(lengths[j]) > 0.03]))
        return self.name, joint, -2.0 * float(lengths[joint])


def _between(ends: tuple[float, float], rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(*np.log(ends)))) if ends[0] > 0 else 0.0
