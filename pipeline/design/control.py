"""Readings of a plan that are not controlled by others, before anything is measured.

The plan's readings as c = B x + G e with the scatter that it states; redundancy and minimal
detectable biases need no c (`annex.redundancy`). Chain and base reflectors are not part of a
plan's scatter and are not included.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse

from pipeline.annex.redundancy import reliability, solution
from pipeline.base import linear
from pipeline.base.arrays import Array, Strings
from pipeline.design.information import station
from pipeline.design.measurement import Measurement
from pipeline.design.problem import Problem, with_steps
from pipeline.design.schedule import pulls_at
from pipeline.machine.cell import jacobian, paper_cell
from pipeline.system.system import Errors, RowIndex, System


@dataclass(frozen=True)
class Control:
    """One reading of a plan, along the axis in which the others control it least.

    Attributes:
        source: `tracker`, `zero` or `force_reading`.
        pose: Number of its pose, from 1.
        pull: Number of its pull in the pose, from 1; 0 for a zero.
        target: Its reflector; empty for the scale.
        r: Redundancy number.
        visible: Minimal detectable bias [m] or [N]; infinite where uncontrolled.
        moves: Largest effect of that error on a stiffness, in standard uncertainties.
        most: Number of the joint of that stiffness, from 1.
    """

    source: str
    pose: int
    pull: int
    target: str
    r: float
    visible: float
    moves: float
    most: int


def controls(problem: Problem, measurement: Measurement) -> tuple[Control, ...]:
    """Every reading of a plan, the least controlled first."""
    parts = [_pose(problem, measurement, pose) for pose in range(len(measurement.q))]
    cell = paper_cell(problem.robot, problem.tool)
    G = scipy.sparse.csr_array(scipy.sparse.block_diag([part.G for part in parts], format="csr"))
    readings = [one for part in parts for one in part.readings]
    source = np.array([one[0] for one in readings], dtype=object)
    errors = Errors(G, source, np.zeros(len(source), dtype=bool))
    rows, B = _rows(measurement, cell.tool.targets), np.concatenate([part.B for part in parts])
    system = System(cell.parameters, rows, B, np.zeros(len(B)), errors, noise_stated=True)
    found = reliability(system, solution(system, np.eye(problem.robot.n)))
    size = np.concatenate([part.size for part in parts])
    most = np.argmax(found.moves, axis=1)
    least: dict[tuple[str, int, int, str], Control] = {}
    for j in np.argsort(found.r, kind="stable").tolist():
        columns = found.r[j], found.visible[j] * size[j], found.moves[j, most[j]], most[j] + 1
        least.setdefault(readings[j], Control(*readings[j], *(one.item() for one in columns)))
    return tuple(least.values())


@dataclass(frozen=True, eq=False)
class _Part:
    """One pose: its rows of B and G, the reading of each column of G, and its size."""

    B: Array
    G: Array
    readings: list[tuple[str, int, int, str]]
    size: Array


def _pose(problem: Problem, measurement: Measurement, pose: int) -> _Part:
    """Errors of one pose: readings of pulls, the zero they share, and readings of the scale."""
    cell, steps, q = paper_cell(problem.robot, problem.tool), measurement.steps[pose], measurement.q
    made, x = with_steps(problem, steps), problem.experiment.scale
    way = measurement.approach[[pose]]
    pulls = pulls_at(made, q[[pose]], measurement.anchor, way, steps, np.zeros(1))
    B = jacobian(cell, pulls, x).reshape(-1, len(x))
    points = station(made, q[[pose]], measurement.anchor).points
    own = linear.factor(made.scatter.reading(points))[0]  # for one reading of all targets
    s, size = len(steps), np.linalg.norm(own, axis=0)
    newtons = np.linalg.norm(pulls.force, axis=1)
    per_n = (B @ x).reshape(s, -1) / newtons[:, None]
    zero, std = np.sqrt(made.scatter.zero), made.scatter.force_std
    G = [np.kron(np.eye(s), own), np.tile(zero * own, (s, 1)), _blocks(per_n * std[:, None])]
    target = [cell.tool.targets[k // 3] for k in np.argmax(np.abs(own), axis=0)]
    readings = [("tracker", pose + 1, k, name) for k in range(1, s + 1) for name in target]
    readings += [("zero", pose + 1, 0, name) for name in target]
    readings += [("force_reading", pose + 1, k, "") for k in range(1, s + 1)]
    sizes = np.concatenate([np.tile(size, s), zero * size, std])
    there = sizes > 0
    kept = [one for one, is_there in zip(readings, there, strict=True) if is_there]
    return _Part(B, np.concatenate(G, axis=1)[:, there], kept, sizes[there])


def _blocks(rows: Array) -> Array:
    """Rows (s, R) as a block-diagonal matrix of columns, shape (s R, s)."""
    s, R = rows.shape
    out = np.zeros((s, R, s))
    out[np.arange(s), :, np.arange(s)] = rows
    return out.reshape(s * R, s)


def _rows(measurement: Measurement, targets: Strings) -> RowIndex:
    """Identity of each row: pose, pull in it, target, axis and number of the pull."""
    count = np.array([len(steps) for steps in measurement.steps])
    pose = np.repeat(np.arange(len(count)), count)
    repeat = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + 1
    of_pull = (
        np.repeat(part, 3 * len(targets)) for part in (pose + 1, repeat, np.arange(len(pose)))
    )
    first, second, pull = of_pull
    target = np.tile(np.repeat(targets, 3), len(pose))
    return RowIndex(first, second, target, np.tile(np.arange(3), len(pose) * len(targets)), pull)
