"""Conformity of a predicted deflection with a tolerance: at a pose, and along a path.

The prediction is that of the recommended model; its uncertainty is never below the held-out error
(docs/decisions/0030). Nothing is decided by a model that does not explain the readings, nor where
possible hypotheses decide differently.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools, Locked, Strings
from pipeline.base.doors import opened
from pipeline.diagnosis.average import POSSIBLE
from pipeline.machine.cell import Tool, paper_cell
from pipeline.machine.robot import Robot
from pipeline.prediction.decision import Decision, decide
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis
from pipeline.prediction.path import Path
from pipeline.reduction.settings import ToleranceSettings


@dataclass(frozen=True, eq=False)
class HeldOutError:
    """Held-out error of a model.

    Attributes:
        held_out_m: Rms error of held-out poses per axis [m], noise of the readings included; None
            if they cannot be predicted.
        hardest_n: Largest pull among them [N].
        holds: Whether the model explains the readings, so that this error bounds any prediction.
    """

    held_out_m: float | None
    hardest_n: float
    holds: bool = True

    def floor(self, force: Array) -> Array:
        """Lower bound of the standard uncertainty of predictions [m], (m,), for forces (m, 3).

        Above the largest pull it grows in proportion to the force, as a model error does.
        """
        size = np.linalg.norm(force, axis=1)
        return (self.held_out_m or 0.0) * np.maximum(1.0, size / self.hardest_n)


@dataclass(frozen=True, eq=False)
class TipDeflection(Locked):
    """Deflection of the load point under each pull.

    Attributes:
        moved: Loaded minus unloaded [m], F_b, shape (m, 3).
        size: Its magnitude d [m], shape (m,).
        std: Standard uncertainty u of d [m]; infinite if a stiffness that acts there is not
            determined, shape (m,).
        holds: Whether the model explains the readings; nothing is decided otherwise.
        each: The same by each possible hypothesis; empty for a single one.
    """

    moved: Array
    size: Array
    std: Array
    holds: bool = True
    each: tuple[TipDeflection, ...] = ()

    def decisions(self, tolerance_m: float) -> list[Decision]:
        """Decision about each pull, undecided unless all possible hypotheses decide alike."""
        if not self.holds:
            return [Decision.UNDECIDED] * len(self.size)
        both = zip(self.size.tolist(), self.std.tolist(), strict=True)
        mine = [decide(size, std, tolerance_m) for size, std in both]
        every = zip(mine, *(one.decisions(tolerance_m) for one in self.each), strict=True)
        return [all_[0] if len(set(all_)) == 1 else Decision.UNDECIDED for all_ in every]


def tip(model: IdentifiedModel, q: Array, force: Array, shown: HeldOutError) -> TipDeflection:
    """Deflection of the load point and its standard uncertainty.

    u is the larger of the model's uncertainty along the deflection, (n' C n)^1/2 with n = d/|d|,
    and of the held-out error.

    Args:
        model: The identified model.
        q: Joint values [m] or [rad], shape (m, n).
        force: Force at the load point [N], F_b, shape (m, 3).
        shown: Held-out error of the model.
    """
    possible = [one for one in model.hypotheses if one.weight > POSSIBLE]
    alone = [replace(model, hypotheses=(replace(one, weight=1.0),)) for one in possible]
    each = [tip(one, q, force, shown) for one in alone] if len(model.hypotheses) > 1 else []
    found = model.at_load_point(q, force)
    size = np.linalg.norm(found.displacement, axis=1)
    along = found.displacement / np.maximum(size, np.finfo(float).tiny)[:, None]
    lost: Bools = np.asarray(~np.isfinite(found.std).all(axis=1))
    cov = np.where(lost[:, None, None], 0.0, found.cov)
    stated = np.sqrt(np.einsum("mi,mij,mj->m", along, cov, along))
    std = np.where(lost, np.inf, np.maximum(stated, shown.floor(np.atleast_2d(force))))
    return TipDeflection(found.displacement, size, std, shown.holds, tuple(each))


def table(
    model: IdentifiedModel, path: Path, found: TipDeflection, tolerance_m: float
) -> pd.DataFrame:
    """Table PATH: each point of a path with its deflection and the decision."""
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
class _PathStretch:
    """Consecutive points of a path with the same decision: rows of table PATH, inclusive."""

    decision: Decision
    first: int
    last: int


def stretches(decision: Strings) -> Iterator[_PathStretch]:
    """Stretches of a path in order, from the decision of each of its points."""
    starts = [k for k in range(len(decision)) if not k or decision[k] != decision[k - 1]]
    for first, after in zip(starts, [*starts[1:], len(decision)], strict=True):
        yield _PathStretch(Decision(decision[first]), first, after - 1)


@dataclass(frozen=True, eq=False)
class JudgedTolerance:
    """Predictions requested by the user.

    Attributes:
        at: Deflection at the test pose.
        path: Table PATH; None without a path.
    """

    at: TipDeflection
    path: pd.DataFrame | None


def judge(
    model: IdentifiedModel,
    q: Array,
    force: Array,
    shown: HeldOutError,
    path: Path | None,
    tolerance_m: float,
) -> JudgedTolerance:
    """Compare deflections of the load point at a pose and along a path with a tolerance.

    Args:
        model: The identified model.
        q: Joint values of the pose [m] or [rad], shape (n,).
        force: Force there [N], F_b, shape (3,).
        shown: Held-out error of the model.
        path: A path, or None.
        tolerance_m: The tolerance [m].
    """
    here = tip(model, q[None], force[None], shown)
    if path is None:
        return JudgedTolerance(here, None)
    along = tip(model, path.q, path.force, shown)
    return JudgedTolerance(here, table(model, path, along, tolerance_m))


def nominal(robot: Robot, tool: Tool) -> IdentifiedModel:
    """The robot with the stiffnesses of its file, sufficient for its kinematics."""
    cell, compliance = paper_cell(robot, tool), robot.nominal_compliance
    own = ModelHypothesis(1.0, cell, compliance, np.zeros((robot.n, robot.n)))
    return IdentifiedModel("", "", {}, (own,))


def path_of(
    tolerance: ToleranceSettings | None, files: Mapping[str, bytes], robot: Robot, tool: Tool
) -> Path | None:
    """The path named in campaign.toml, None without one.

    Raises:
        InputError: It cannot be read, or the robot cannot follow it.
    """
    if tolerance is None or tolerance.path is None:
        return None
    path: Path = opened(_READ)(tolerance.path, files[tolerance.path], nominal(robot, tool))
    return path


_READ = "pipeline.programs.path_file:read"
"""Reader of a path, the same as in `pipeline compensate`."""
