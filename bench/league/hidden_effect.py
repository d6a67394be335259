"""The type of a secret, and everything of a machine that it can change."""

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
    """Course of the measurement, one row per pull.

    Attributes:
        pose: Index of the pose from 0, shape (m,).
        repeat: Pull within the pose from 0, shape (m,).
        time: Hours since the first reading, shape (m,).
        branch: 1 tightening, -1 slackening, shape (m,).
        approach: Direction from which the carriage came, shape (m,).
        q: Joint values of the log, shape (m, n).
        rng: For random secrets.
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
    """A machine and everything around it that a secret can change.

    Attributes:
        machine: The machine.
        compliance: True compliance of each joint, shape (n,).
        tension: Functions from scale reading [N] to true tension [N].
        force: Functions from true force vectors to those that act [N].
        load_shift: Offset of the point where the chain pulls, flange frame [m].
        target_shift: Offset of all reflectors, flange frame [m].
        chain_shift: Offset of Pl1 from the chain's line, flange frame [m].
        joint_shift: True joint values minus those of the log.
        base_turn: Rotation vector of the base reflectors' nominal coordinates [rad].
        drift: Function from hours to the displacement of all readings [m], shape (3,).
        loose: Target index -> displacement of that reflector under load [m], shape (3,).
        tracker_scale: True over stated noise of the tracker.
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
"""True parameters under the catalogue's names, for causes whose parameters mean the same there."""


@dataclass(frozen=True)
class Hidden:
    """A law that is in no catalogue, described by its right answers.

    Attributes:
        where: Right places: joint number, `rail`, `scale`, `tracker`.
        what: Right pairs of kind and variable.
        order: Periods per turn; None if any order is right.
    """

    where: tuple[int | str, ...]
    what: tuple[tuple[str, str], ...]
    order: float | None = None


Plant = Callable[[Setup, float, Course], Amplitudes | None]
"""Adds a secret of a size (in typical sizes of the catalogue) to a set-up."""


@dataclass(frozen=True)
class Secret:
    """One secret.

    Attributes:
        label: `rail_roll`, `joint_tilt:3` of the catalogue, or a name of its own.
        place: Part of the cell, as worded by the diagnosis; `a | b` if it connects parts.
        known: Whether the catalogue contains it, perhaps in another form.
        plant: Function that adds it.
        law: Its law; None if the catalogue contains it, or if it depends on nothing that a pull
            varies.
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
"""Nominal compliances of the KR500, Table III, to which typical sizes refer."""


def setup(robot: Robot, stiffness: Array) -> Setup:
    """A machine without hidden causes, with these joint stiffnesses."""
    springs = [
        Spring(f"j{j}", j, (0, 0, 1), bool(robot.prismatic[j - 1]), straight(1 / float(k)))
        for j, k in enumerate(stiffness, 1)
    ]
    return Setup(Machine(robot, springs), 1 / stiffness, joint_shift=np.zeros(robot.n))
