"""Whether a predicted deflection stays within a tolerance: at a pose, and along a path.

The prediction is that of the model which the answer stands for; its uncertainty is never below what
left-out poses were missed by (docs/decisions/0030).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools, Locked, Strings
from pipeline.base.doors import opened
from pipeline.machine.cell import Tool, paper_cell
from pipeline.machine.robot import Robot
from pipeline.prediction.decision import Decision, decide
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis
from pipeline.prediction.path import Path
from pipeline.reduction.settings import ToleranceSettings


@dataclass(frozen=True, eq=False)
class Shown:
    """What left-out poses showed of a model.

    Attributes:
        held_out_m: By how much they were missed, rms per axis [m], noise of the readings included;
            None where nothing predicts them.
        hardest_n: The hardest pull among them [N].
    """

    held_out_m: float | None
    hardest_n: float

    def floor(self, force: Array) -> Array:
        """Standard uncertainty that no prediction falls below [m], shape (m,), of forces (m, 3).

        Beyond the hardest pull it grows with the force, as an error of the model does.
        """
        size = np.linalg.norm(force, axis=1)
        return (self.held_out_m or 0.0) * np.maximum(1.0, size / self.hardest_n)


@dataclass(frozen=True, eq=False)
class TipDeflection(Locked):
    """Deflection of the load point, pull by pull.

    Attributes:
        moved: Loaded minus unloaded [m], F_b, shape (m, 3).
        size: Its length d [m], shape (m,).
        std: Standard uncertainty u of that [m]; infinite where a stiffness that acts there is not
            determined, shape (m,).
    """

    moved: Array
    size: Array
    std: Array

    def decisions(self, tolerance_m: float) -> list[Decision]:
        """What is decided of each pull."""
        both = zip(self.size.tolist(), self.std.tolist(), strict=True)
        return [decide(size, std, tolerance_m) for size, std in both]


def tip(model: IdentifiedModel, q: Array, force: Array, shown: Shown) -> TipDeflection:
    """How far the load point deflects, and how well that is known.

    u is the larger of what the model states along the deflection, (n' C n)^1/2 with n = d/|d|, and
    of what left-out poses were missed by.

    Args:
        model: The identified model.
        q: Joint values [m] or [rad], shape (m, n).
        force: Force at the load point [N], F_b, shape (m, 3).
        shown: What left-out poses showed.
    """
    found = model.at_load_point(q, force)
    size = np.linalg.norm(found.displacement, axis=1)
    along = found.displacement / np.maximum(size, np.finfo(float).tiny)[:, None]
    lost: Bools = np.asarray(~np.isfinite(found.std).all(axis=1))
    cov = np.where(lost[:, None, None], 0.0, found.cov)
    stated = np.sqrt(np.einsum("mi,mij,mj->m", along, cov, along))
    std = np.where(lost, np.inf, np.maximum(stated, shown.floor(np.atleast_2d(force))))
    return TipDeflection(found.displacement, size, std)


def table(
    model: IdentifiedModel, path: Path, found: TipDeflection, tolerance_m: float
) -> pd.DataFrame:
    """Table PATH: each point of a path with its deflection and what is decided of it."""
    at = model.positions(path.q, path.force, model.tool.load_point[None]).unloaded[:, 0]
    return pd.DataFrame(
        {
            "point": np.arange(1, len(path.pose) + 1),
            "pose": path.pose,
            **dict(zip(("x_m", "y_m", "z_m"), at.T, strict=True)),
            **dict(zip(("fx_n", "fy_n", "fz_n"), path.force.T, strict=True)),
            **dict(zip(("dx_m", "dy_m", "dz_m"), found.moved.T, strict=True)),
            "deflection_m": found.size,
            "std_m": found.std,
            "decision": [str(one) for one in found.decisions(tolerance_m)],
        }
    )


@dataclass(frozen=True)
class PathStretch:
    """Points of a path, one after the other, of which the same is decided: rows of table PATH."""

    decision: Decision
    first: int
    last: int


def stretches(decision: Strings) -> Iterator[PathStretch]:
    """The stretches of a path in their order, from the decision of each of its points."""
    starts = [k for k in range(len(decision)) if not k or decision[k] != decision[k - 1]]
    for first, after in zip(starts, [*starts[1:], len(decision)], strict=True):
        yield PathStretch(Decision(decision[first]), first, after - 1)


@dataclass(frozen=True, eq=False)
class JudgedTolerance:
    """What is predicted where the user asked for it.

    Attributes:
        at: At the test pose.
        path: Table PATH; None without a path.
    """

    at: TipDeflection
    path: pd.DataFrame | None


def judge(
    model: IdentifiedModel,
    q: Array,
    force: Array,
    shown: Shown,
    path: Path | None,
    tolerance_m: float,
) -> JudgedTolerance:
    """Deflections of the load point at a pose and along a path, held against a tolerance.

    Args:
        model: The identified model.
        q: Joint values of the pose [m] or [rad], shape (n,).
        force: Force there [N], F_b, shape (3,).
        shown: What left-out poses showed of the model.
        path: A path, where one is asked for.
        tolerance_m: The tolerance [m].
    """
    here = tip(model, q[None], force[None], shown)
    if path is None:
        return JudgedTolerance(here, None)
    along = tip(model, path.q, path.force, shown)
    return JudgedTolerance(here, table(model, path, along, tolerance_m))


def nominal(robot: Robot, tool: Tool) -> IdentifiedModel:
    """The robot with the stiffnesses of its file: enough to know where it stands."""
    cell, compliance = paper_cell(robot, tool), robot.nominal_compliance
    own = ModelHypothesis(1.0, cell, compliance, np.zeros((robot.n, robot.n)))
    return IdentifiedModel("", "", {}, (own,))


def asked(
    tolerance: ToleranceSettings | None, files: Mapping[str, bytes], robot: Robot, tool: Tool
) -> Path | None:
    """The path that campaign.toml names, None without one.

    Raises:
        InputError: It cannot be read, or the robot cannot follow it.
    """
    if tolerance is None or tolerance.path is None:
        return None
    path: Path = opened(_READ)(tolerance.path, files[tolerance.path], nominal(robot, tool))
    return path


_READ = "pipeline.programs.judged:read"
"""A path is read as `pipeline compensate` reads it."""
