"""What a secret is, and everything of a machine that it can reach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bench.league.machine import Law, Machine, Spring
from pipeline.base.arrays import Array, Ints
from pipeline.machine.robot import Robot

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


@dataclass(frozen=True)
class Hidden:
    """A law that no catalogue has, as its right answers word it.

    Attributes:
        where: Places that are right: joint number, `rail`, `scale`, `tracker`.
        what: Pairs of kind and variable that are right.
        order: Periods per turn; None where any order is right.
    """

    where: tuple[int | str, ...]
    what: tuple[tuple[str, str], ...]
    order: float | None = None


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
        law: What it is a law of; None where the catalogue has it, or where it follows nothing that
            a pull varies.
    """

    label: str
    place: str
    known: bool
    plant: Plant
    law: Hidden | None = None


def straight(c: float) -> Law:
    """A linear spring of compliance c."""
    return lambda own, _: c * own


NOMINAL = 1 / np.array([8.0e7, 3.8e6, 6.6e6, 3.9e6, 5.6e5, 6.6e5, 4.7e5])
"""Nominal compliances of the KR500, Table III; typical sizes are stated in them."""


def setup(robot: Robot, stiffness: Array) -> Setup:
    """A machine without hidden causes, with these joint stiffnesses."""
    springs = [
        Spring(f"j{j}", j, (0, 0, 1), bool(robot.prismatic[j - 1]), straight(1 / float(k)))
        for j, k in enumerate(stiffness, 1)
    ]
    return Setup(Machine(robot, springs), 1 / stiffness, joint_shift=np.zeros(robot.n))
