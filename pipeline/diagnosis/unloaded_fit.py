"""Unloaded positions of the reflectors, and how causes are estimated from them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.linear import rms
from pipeline.diagnosis.facts import Fit, Line
from pipeline.machine.cell import Cell, predict
from pipeline.machine.effect import Effect, Pulls
from pipeline.reduction.measured import Measured

_TOOL_M = 5e-3
"""Points of the effector are estimated along, this far from their nominals at most."""

_STEP = 1e-3
"""Of a typical size, for differences; [m] for points of the tool."""


@dataclass(frozen=True, eq=False)
class Unloaded(Locked):
    """Unloaded positions as the tracker read them.

    Attributes:
        cell: The robot and its tool, nothing that yields.
        pulls: One pull for each zero, as if nothing pulled.
        pose: Pose of each zero, 0..p-1, shape (z,).
        target: Its target in the tool, shape (z,).
        at: Where it stands [m], F_b, shape (z, 3).
        white: Inverse Cholesky factors of the covariances of `at`, shape (z, 3, 3).
        known: Columns that are always estimated along, whitened, shape (3 z + priors, n): points of
            the tool, where the base stands, and what is stated of its rotation and the joints.
        free: How many of them, the first, no prior holds.
        joints: How many of them, the last, are errors of the joints' zeros as they are stated.
    """

    cell: Cell
    pulls: Pulls
    pose: Ints
    target: Ints
    at: Array
    white: Array
    known: Array
    free: int
    joints: int = 0

    @property
    def exact(self) -> Unloaded:
        """The same with the joints exactly where the log says: how far off is the table?"""
        rows, columns = (n - self.joints for n in self.known.shape)
        return replace(self, known=self.known[:rows, :columns], joints=0)

    def stands(self, effects: Sequence[Effect], values: Array) -> Array:
        """Where the table and some effects put the reflectors [m], shape (z, 3)."""
        cell = replace(self.cell, effects=tuple(effects))
        points = predict(cell, self.pulls, values).unloaded
        return np.asarray(points[np.arange(len(self.target)), self.target])

    def whitened(self, rows: Array) -> Array:
        """Rows of shape (z, 3) or (z, 3, k), whitened, with the priors below."""
        wide = rows[..., None] if rows.ndim == 2 else rows
        white = (self.white @ wide).reshape(3 * len(wide), wide.shape[2])
        padded = np.vstack([white, np.zeros((len(self.known) - len(white), wide.shape[2]))])
        return padded.reshape(len(padded), *rows.shape[2:])

    def short(self, fit: Fit) -> Array:
        """Positions minus those of a fit, to these or other poses [m], shape (z, 3)."""
        along = (self.known[: 3 * len(self.at)] @ fit.known).reshape(-1, 3, 1)
        moved = linear.solve(self.white, along)[..., 0]
        return np.asarray(self.at - self.stands(fit.effects, fit.values) - moved)

    def without(self, pose: int) -> Unloaded:
        """The same without one pose."""
        kept = self.pose != pose
        rows = np.concatenate([np.repeat(kept, 3), np.ones(len(self.known) - 3 * len(kept), bool)])
        return replace(
            self,
            pulls=self.pulls.part(np.flatnonzero(kept)),
            pose=self.pose[kept],
            target=self.target[kept],
            at=self.at[kept],
            white=self.white[kept],
            known=self.known[rows],
        )


class Fits:
    """Fits of sets of causes to the unloaded positions, each made once.

    Attributes:
        zeros: Where they stand.
    """

    def __init__(
        self, zeros: Unloaded, make: Callable[[tuple[Effect, ...]], Fit] | None = None
    ) -> None:
        self.zeros = zeros
        self._make = make or (lambda effects: fitted(zeros, effects))
        self._made: dict[tuple[str, ...], Fit] = {}

    def __call__(self, effects: tuple[Effect, ...]) -> Fit:
        """The fit of some causes."""
        key = tuple(effect.label for effect in effects)
        if key not in self._made:
            self._made[key] = self._make(effects)
        return self._made[key]

    def left(self, effects: tuple[Effect, ...]) -> float:
        """What causes leave of the unloaded positions, rms over coordinates [m]."""
        return rms(self.zeros.short(self(effects)))

    def without(self, pose: int) -> Fits:
        """Fits that leave one pose out: values hardly move, and the lines of all poses serve."""
        kept, rest = self.zeros.pose != pose, self.zeros.without(pose)
        return Fits(rest, lambda effects: _on_line(rest, effects, self(effects).line.only(kept)))


def unloaded(cell: Cell, data: Measured, scale: float) -> Unloaded | None:
    """The unloaded positions; None where too few poses were read unloaded.

    Args:
        cell: The paper's model.
        data: The measurements; `unloaded` may be NaN.
        scale: Scatter of the tracker over its stated standard uncertainty.
    """
    _, first = np.unique(data.zero, return_index=True)
    first = first[np.isfinite(data.unloaded[first]).all(axis=1)]
    poses, pose = np.unique(data.pulls.pose[data.pull[first]], return_inverse=True)
    if len(poses) < 4 or not np.isfinite(scale):
        return None
    still = replace(data.pulls, force=np.zeros_like(data.pulls.force))
    bare = replace(cell, effects=(), equilibrium="undeformed")  # nothing pulls
    cov = data.zero_cov[first] * scale**2
    zeros = Unloaded(
        cell=bare,
        pulls=still.part(data.pull[first]),
        pose=pose,
        target=data.target[first],
        at=data.unloaded[first],
        white=linear.whitening(cov),
        known=np.zeros((3 * len(first), 0)),
        free=3,
    )
    return replace(
        zeros, known=_along(zeros, data), joints=int(np.any(data.joint_std) * cell.robot.n)
    )


def _along(zeros: Unloaded, data: Measured) -> Array:
    """Columns estimated along, each in units of its prior, with a row for each prior below."""
    z, targets = len(zeros.target), len(zeros.cell.tool.targets)
    here = zeros.stands((), np.zeros(0))
    columns = [np.tile(np.eye(3), (z, 1, 1))]  # where the base stands: free
    tool = np.zeros((z, 3, 3 * targets))
    for axis in range(3):
        points = zeros.cell.tool.points + _STEP * np.eye(3)[axis]
        moved = replace(
            zeros, cell=replace(zeros.cell, tool=replace(zeros.cell.tool, points=points))
        )
        slope = (moved.stands((), np.zeros(0)) - here) / _STEP
        tool[np.arange(z), :, 3 * zeros.target + axis] = slope
    columns.append(tool * _TOOL_M)
    turned = np.stack([np.cross(axis, here) for axis in np.eye(3)], axis=2)
    columns.append(turned @ linear.factor(data.rotation_cov))
    if data.joint_std.any():
        columns.append(_by_joint(zeros, here) * data.joint_std)
    K = np.concatenate(columns, axis=2)
    white = (zeros.white @ K).reshape(-1, K.shape[2])
    priors = np.eye(K.shape[2])[zeros.free :]
    return np.vstack([white, priors])


def _by_joint(zeros: Unloaded, here: Array) -> Array:
    """Where the reflectors move with each joint, by differences, shape (z, 3, n)."""
    slopes = []
    for turn in 1e-6 * np.eye(zeros.cell.robot.n):
        moved = replace(zeros, pulls=replace(zeros.pulls, q=zeros.pulls.q + turn))
        slopes.append((moved.stands((), np.zeros(0)) - here) / 1e-6)
    return np.stack(slopes, axis=2)


def fitted(zeros: Unloaded, effects: Sequence[Effect], rounds: int = 4) -> Fit:
    """Estimate causes and nuisance parameters, linearised anew each round (Gauss-Newton).

    sum_i |W_i (at_i - stands_i(z) - K_i k)|^2 + |k_prior|^2 is smallest, W_i' W_i = cov(at_i)^-1, k
    the nuisance parameters in units of their priors: the base's place (free), tool points (5 mm),
    the base's rotation and joint zeros as stated. cov(z) is the block of (X' X)^-1, times chi2/dof
    where that exceeds 1 (Birge, Physical Review 40 (1932) 207). Positions in m, F_b.

    Args:
        zeros: Where the reflectors stand.
        effects: The causes.
        rounds: At most.
    """
    typical = _typical(effects)
    values = np.zeros(len(typical))
    for _ in range(rounds):
        fit = _on_line(zeros, effects, _line(zeros, effects, values))
        step, values = fit.values - values, fit.values
        if np.max(np.abs(step / typical), initial=0.0) < 1e-4:
            break
    return fit


def _typical(effects: Sequence[Effect]) -> Array:
    return np.array([p.typical for effect in effects for p in effect.parameters])


def _line(zeros: Unloaded, effects: Sequence[Effect], values: Array) -> Line:
    typical = _typical(effects)
    slopes = [
        zeros.stands(effects, values + d) - zeros.stands(effects, values - d)
        for d in _STEP * typical * np.eye(len(typical))
    ]
    J = np.stack(slopes, axis=2) / (2 * _STEP) if slopes else np.zeros((*zeros.at.shape, 0))
    return Line(values, zeros.stands(effects, values), J)


def _on_line(zeros: Unloaded, effects: Sequence[Effect], line: Line) -> Fit:
    """Estimate causes and nuisance parameters, to first order."""
    typical, n = _typical(effects), zeros.known.shape[1]
    X = np.hstack([zeros.known, zeros.whitened(line.J)])
    y = zeros.whitened(zeros.at - line.stands)
    inverse = linear.pseudoinverse(X)
    step = inverse(y)
    left = y - X @ step
    chi2 = float(left @ left)
    dof = 3 * len(zeros.at) - zeros.free - 3 * len(zeros.cell.tool.targets) - len(typical)
    half = inverse.half[n:] * typical[:, None]
    cov = half @ half.T
    cov = cov * max(1.0, chi2 / max(dof, 1))
    return Fit(tuple(effects), line.about + step[n:] * typical, cov, step[:n], chi2, dof, line)


def student(fit: Fit) -> float:
    """Quantile of 95 % intervals."""
    return float(special.stdtrit(max(fit.dof, 1), 0.975))
