"""Which causes cannot be separated: by any campaign (twins), or by this one (overlap)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.machine.cell import Cell, Tool, paper_cell, sensitivity
from pipeline.machine.effect import HUNG, PULLED, Effect, Pulls
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import Robot

_SAME = 1e-8
"""Relative difference below which two directions count as the same [1]."""

_NOTHING_M = 1e-12
"""Motion of the reflectors below which an effect of typical magnitude counts as none [m]."""


@dataclass(frozen=True)
class Twins:
    """Effects that such loads at the tip can never separate, whatever the poses.

    Attributes:
        of_stiffness: Effects whose signatures are all within those of the joint springs.
        pairs: Pairs of effects with the same signature given the joint springs.
        unmoved: Effects that move nothing when the robot is pulled.
    """

    of_stiffness: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    unmoved: tuple[str, ...]

    def of(self, label: str) -> tuple[str, ...]:
        """The twins of one effect."""
        return tuple(b if a == label else a for a, b in self.pairs if label in (a, b))


def rich_pulls(robot: Robot, rng: np.random.Generator, pulls: int = 80) -> Pulls:
    """Random pulls as varied as possible: joints, directions, forces, branches, approaches, times.

    Args:
        robot: The robot; joints without limits turn by up to 180 degrees.
        rng: Source of the draws.
        pulls: Number of pulls, four to a pose.
    """
    far = np.where(robot.prismatic, 1.0, np.pi)
    lower = np.where(np.isfinite(robot.lower), np.maximum(robot.lower, -far * 20), -far)
    upper = np.where(np.isfinite(robot.upper), np.minimum(robot.upper, far * 20), far)
    pose = np.arange(pulls) // 4
    u = rng.standard_normal((pulls, 3))
    force = u / np.linalg.norm(u, axis=1, keepdims=True) * rng.uniform(300, 4000, (pulls, 1))
    return Pulls(
        pose=pose,
        repeat=np.arange(pulls) % 4,
        q=rng.uniform(lower, upper, (pose.max() + 1, robot.n))[pose],
        force=force,
        branch=rng.choice([-1.0, 1.0], pulls),
        approach=rng.choice([-1.0, 1.0], pose.max() + 1)[pose],
        time=np.sort(rng.uniform(0, 2e4, pulls)),
        time_zero=rng.uniform(0, 2e4, pose.max() + 1)[pose],
    )


def rich_tool(rng: np.random.Generator) -> Tool:
    """Load point and three reflectors in general position."""
    points = rng.uniform([-0.4, -0.4, -0.2], [0.4, 0.4, 0.6], (4, 3))
    return Tool(points[0], np.array(["P1", "P2", "P3"], dtype=object), points[1:])


@lru_cache(maxsize=8)
def twins(robot: Robot, weighed: bool = False) -> Twins:
    """Twins among the causes of a robot, from the ranks of a rich random design.

    Args:
        robot: The robot.
        weighed: Whether weights hang beside the pulls: they tell the scale's gain from the springs.
    """
    rng = np.random.default_rng(20)
    cell, pulls = paper_cell(robot, rich_tool(rng)), rich_pulls(robot, rng)
    if weighed:
        pulls = replace(pulls, by=np.where(np.arange(len(pulls)) % 2, PULLED, HUNG))
    x = robot.nominal_compliance * rng.uniform(0.7, 1.4, robot.n)
    effects = catalogue(robot)
    baseline = _matrix(cell, pulls, x, cell.effects)
    signature = {i: _matrix(cell, pulls, x, [effect]) for i, effect in enumerate(effects)}
    return _compare(effects, baseline, signature)


def _matrix(cell: Cell, pulls: Pulls, x: Array, effects: Sequence[Effect]) -> Array:
    """Columns [m] at typical magnitude, shape (rows, parameters)."""
    Z = sensitivity(cell, pulls, x, effects)
    typical = [p.typical for effect in effects for p in effect.parameters]
    return np.asarray(Z.reshape(-1, Z.shape[-1]) * np.array(typical))


def _compare(effects: Sequence[Effect], B: Array, signature: dict[int, Array]) -> Twins:
    Q = linear.orthonormal(B)
    own, unmoved, hidden = {}, [], []
    for i, Z in signature.items():
        left = Z - Q @ (Q.T @ Z)
        left = left - Q @ (Q.T @ left)
        if np.abs(Z).max() < _NOTHING_M:
            unmoved.append(effects[i].label)
        elif np.linalg.norm(left) < _SAME * np.linalg.norm(Z):
            hidden.append(effects[i].label)
        else:
            own[i] = linear.span(left, _SAME * float(np.linalg.norm(Z)))
    pairs = [
        (effects[a].label, effects[b].label)
        for a, b in combinations(own, 2)
        if effects[a].label != effects[b].label and _same_span(own[a], own[b])
    ]
    return Twins(_once(hidden), tuple(dict.fromkeys(pairs)), _once(unmoved))


def _once(names: list[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))


def _same_span(a: Array, b: Array) -> bool:
    """Whether two orthonormal bases span the same space."""
    if a.shape[1] != b.shape[1]:
        return False
    return bool(np.linalg.norm(a - b @ (b.T @ a)) < 1e3 * _SAME)
