"""Input of a solver: c = B x + Z z + e of one campaign, and the same columns at its test pose."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.linalg

from pipeline.base.arrays import Array, Ints
from pipeline.machine.cell import Cell, sensitivity
from pipeline.machine.effect import Effect, Elastic, Noise, Pulls
from pipeline.machine.effects import catalogue
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.store.campaign import in_memory
from pipeline.system.assemble import assemble
from pipeline.system.linearised import CurrentModel, linearise


@dataclass(frozen=True, eq=False)
class Suspect:
    """A cause of the catalogue in one of its forms.

    Attributes:
        name: As in the list of causes.
        where: Its place, as there.
        parameters: Names of its parameters.
        columns: Their columns in Z, shape (k,).
        moves: Whether the machine deflects, so that predictions include it; otherwise it is an
            error of measurement.
    """

    name: str
    where: int | str | None
    parameters: tuple[str, ...]
    columns: Ints
    moves: bool

    @property
    def label(self) -> str:
        """`joint_tilt:3`."""
        return self.name if self.where is None else f"{self.name}:{self.where}"


@dataclass(frozen=True, eq=False)
class Problem:
    """One campaign as a linear problem, SI, F_b.

    Attributes:
        springs: Names of the stiffnesses (`k_theta2`).
        targets: Names of the targets.
        c: Displacements, shape (M,) [m].
        B: Derivative with respect to the compliances, shape (M, n).
        Z: Derivative with respect to the catalogue's parameters, shape (M, K).
        pose: Pose of each row, shape (M,).
        root: L^-1 with L L' the stated covariance of c, shape (M, M) [1/m].
        suspects: Causes with columns in Z.
        B_there: B at the test pose, shape (3 t, n).
        Z_there: Z at the test pose, zero for errors of measurement, shape (3 t, K).
    """

    springs: tuple[str, ...]
    targets: tuple[str, ...]
    c: Array
    B: Array
    Z: Array
    pose: Ints
    root: Array
    suspects: tuple[Suspect, ...]
    B_there: Array
    Z_there: Array


def problem(folder: Path) -> Problem:
    """The problem of a campaign, linearised about the springs of plain least squares."""
    case = ingested(in_memory(content(folder)))
    data, cell, robot = bring(case).data, case.cell, case.robot
    first = assemble(cell, data, robot.nominal_compliance)
    x = np.linalg.lstsq(first.B * first.typical, first.c, rcond=None)[0] * first.typical
    effects = tuple(e for e in catalogue(robot, data.pulls) if not isinstance(e, Noise))
    seen = linearise(CurrentModel(cell, x, robot.n), data, effects)
    V = (seen.errors.G @ seen.errors.G.T).toarray()
    L = np.linalg.cholesky(V)
    suspects = _suspects(effects)
    there = _there(case.settings.test_pose, cell, x, effects)
    B_there, Z_there = np.split(there, [robot.n], axis=1)
    moves = np.concatenate([np.full(len(one.columns), one.moves) for one in suspects])
    return Problem(
        springs=tuple(f"k_{joint.name}" for joint in robot.joints),
        targets=tuple(cell.tool.targets),
        c=seen.y,
        B=seen.B,
        Z=seen.Z,
        pose=seen.rows.pose,
        root=scipy.linalg.solve_triangular(L, np.eye(len(L)), lower=True),
        suspects=suspects,
        B_there=B_there,
        Z_there=np.where(moves, Z_there, 0.0),
    )


def content(folder: Path) -> dict[str, bytes]:
    """The files of a campaign's folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def _suspects(effects: tuple[Effect, ...]) -> tuple[Suspect, ...]:
    ends = np.cumsum([0, *(len(e.parameters) for e in effects)])
    return tuple(
        Suspect(
            e.name,
            e.where,
            tuple(p.name for p in e.parameters),
            np.arange(first, last),
            any(isinstance(part, Elastic) for part in e.facets),
        )
        for e, first, last in zip(effects, ends[:-1], ends[1:], strict=True)
    )


def _there(stated: object, cell: Cell, x: Array, effects: tuple[Effect, ...]) -> Array:
    """B and Z at the stated test pose, tightening; no rows if campaign.toml states none."""
    width = len(x) + sum(len(e.parameters) for e in effects)
    if stated is None:
        return np.zeros((0, width))
    q, force = stated.joint_values(cell.robot), stated.force_n  # type: ignore[attr-defined]
    pulls = Pulls.at(q, np.array(force), branch=1.0)
    both = cell.effects + effects
    bare = Cell(cell.robot, cell.tool, ())
    return sensitivity(bare, pulls, np.zeros(0), both)[0].reshape(-1, width)
