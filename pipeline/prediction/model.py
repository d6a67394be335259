"""The identified model: what it predicts of deflections, with their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.diagnosis.average import average
from pipeline.machine import sides
from pipeline.machine.cell import Cell, Prediction, Tool, jacobian, paper_cell
from pipeline.machine.cell import load as loaded
from pipeline.machine.cell import predict as forward
from pipeline.machine.effect import Effect, Noise, Observation, Pulls, Reflectors, Wrench
from pipeline.machine.effects import unlisted
from pipeline.machine.robot import Robot
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import whitener


@dataclass(frozen=True, eq=False)
class _PointDeflection(Locked):
    """Deflections of points of the tool.

    Attributes:
        displacement: Loaded minus unloaded [m], F_b, shape (m, 3).
        cov: Its covariance [m^2], shape (m, 3, 3); infinite on the diagonal where a spring that
            acts there is not determined.
    """

    displacement: Array
    cov: Array

    @property
    def std(self) -> Array:
        """Standard uncertainty per axis [m], shape (m, 3)."""
        return np.sqrt(np.diagonal(self.cov, axis1=1, axis2=2))


@dataclass(frozen=True, eq=False)
class ModelHypothesis(Locked):
    """One set of causes that may be true, with the springs estimated together with them.

    Attributes:
        weight: Its probability.
        cell: Robot, tool and effects.
        value: Parameters of the cell, SI, shape (k,).
        cov: Their covariance, shape (k, k); infinite on the diagonal where undetermined.
        free: Undetermined directions in parameter space, scaled to typical magnitudes, (k, q); if
            None, each undetermined parameter by itself.
        within: Variance of each parameter apart from these directions, (k,); if None, undetermined
            parameters contribute none.
    """

    weight: float
    cell: Cell
    value: Array
    cov: Array
    free: Array | None = None
    within: Array | None = None

    @property
    def std(self) -> Array:
        """Standard uncertainty of `value`, shape (k,)."""
        return np.sqrt(np.diag(self.cov))

    @property
    def beside_springs(self) -> tuple[Effect, ...]:
        """Its causes, in addition to the joint springs."""
        return tuple(one for one in self.more if one.law is None or not one.law.beyond)

    @property
    def more(self) -> tuple[Effect, ...]:
        """Its causes, and the uncertainty of unlisted laws outside the range of the data."""
        return self.cell.effects[len(paper_cell(self.cell.robot, self.cell.tool).effects) :]

    def at(self, points: Array | None = None) -> Cell:
        """Its cell with points (t, 3) as tool, force at the first; the load point if None."""
        seen = self.cell.tool.load_point[None] if points is None else points
        names = np.array([str(k) for k in range(len(seen))], dtype=object)
        return replace(self.cell, tool=Tool(seen[0], names, seen))

    def moved(self, cell: Cell, pulls: Pulls) -> _PointDeflection:
        """Deflection of every target of a cell under every pull, m t of them.

        The cell has the hypothesis's parameters, but may have another tool.
        """
        displacement = forward(cell, pulls, self.value).displacement.reshape(-1, 3)
        A = jacobian(replace(cell, equilibrium="undeformed"), pulls, self.value)
        return _PointDeflection(displacement, self.through(A.reshape(-1, 3, len(self.value))))

    def through(self, A: Array) -> Array:
        """Covariance A C A' of displacements A x [m], A (m, j, k), shape (m, j, j).

        Determined combinations of parameters contribute even if the parameters themselves are not
        determined: variances are infinite only where `free` moves a displacement by more than
        `NOTHING_M`.
        """
        known = np.isfinite(self.std)
        cov = self.cov.copy()
        np.fill_diagonal(cov, np.where(known, np.diag(cov), 0.0))
        if self.free is not None and self.within is not None:
            np.fill_diagonal(cov, self.within)
            free = self.free
        else:
            typical = np.array([p.typical for p in self.cell.parameters])
            cov[~known], cov[:, ~known] = 0.0, 0.0
            free = np.diag(typical)[:, ~known]
        found = A @ cov @ np.swapaxes(A, 1, 2)
        m, axis = np.nonzero(np.abs(A @ free).max(axis=-1, initial=0.0) > NOTHING_M)
        found[m, axis, axis] = np.inf
        return np.asarray(found)


@dataclass(frozen=True, eq=False)
class IdentifiedModel(Locked):
    """An identified robot: effects in the machine, with values and covariance.

    If it is uncertain which causes are true, every prediction is the average over the hypotheses by
    their weights, and their spread is part of its covariance.

    Effects of the measurement alone (scale, tracker, noise) are not part of it; having been
    estimated together with the springs, they contribute to their covariance.

    Attributes:
        campaign: Campaign from which it was identified.
        verdict: Verdict of the diagnosis, as in result.json.
        recommended: Basis of these values: model, data and reason, as in result.json.
        hypotheses: Possible sets of causes, weights sum to one; a single one if nothing is open.
        stated: Joints whose stiffness result.json states, shape (n,); all if None.
        held_out_m: Rms error per coordinate of poses left out with all their pulls [m], noise of
            the readings included; None if they cannot be predicted.
        pulled_n: Smallest and largest pull of the campaign [N]; None if unknown.
        at_pose: Joint values (n,) and force (3,) of the test pose, which selects the compliance of
            joints that have one for each sign of the torque; None: the mean of both.
    """

    campaign: str
    verdict: str
    recommended: Mapping[str, str]
    hypotheses: tuple[ModelHypothesis, ...]
    stated: Bools | None = None
    held_out_m: float | None = None
    pulled_n: tuple[float, float] | None = None
    at_pose: tuple[Array, Array] | None = None

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.hypotheses[0].cell.robot

    @property
    def tool(self) -> Tool:
        """The effector of the campaign."""
        return self.hypotheses[0].cell.tool

    def stiffness(self, joint: int) -> tuple[float, float, str] | None:
        """Stiffness of a joint, its standard uncertainty and unit [N/m] or [N m/rad].

        None if it is not stated: not determined, or not positive.
        """
        x, std = float(self.value[joint]), float(self.std[joint])
        known = self.stated is None or bool(self.stated[joint])
        if not (known and np.isfinite(std) and x > 0):
            return None
        return 1 / x, std / x**2, self.robot.joints[joint].stiffness_unit

    @cached_property
    def springs(self) -> tuple[Array, Array]:
        """Compliances of the joints (n,) and their covariance (n, n), over all hypotheses.

        For a joint with one compliance per sign of its torque, that at the test pose.
        """
        each = zip(*map(self._springs, self.hypotheses), strict=True)
        return average([one.weight for one in self.hypotheses], *map(np.stack, each))

    def _springs(self, one: ModelHypothesis) -> tuple[Array, Array]:
        """Compliances and covariance of one hypothesis."""
        T = np.eye(len(one.value))[: self.robot.n]
        if self.at_pose is not None:
            both = sides.columns(self.robot.n, one.more)
            for joint, sign in sides.at_pose(one.cell, one.value, *self.at_pose).items():
                T[joint, both[joint]] = sign
        return sides.taken(one.value, one.cov, T)

    @property
    def value(self) -> Array:
        """Compliances of the joints [m/N] or [rad/(N m)], shape (n,)."""
        return self.springs[0]

    @property
    def cov(self) -> Array:
        """Covariance of `value`, shape (n, n); infinite on the diagonal where undetermined."""
        return self.springs[1]

    @property
    def std(self) -> Array:
        """Standard uncertainty of `value`, shape (n,)."""
        return np.sqrt(np.diag(self.cov))

    def predict(self, q: Array, force: Array, point: Array | None = None) -> _PointDeflection:
        """Deflection of the point of the tool at which a force acts.

        Args:
            q: Joint values [m] or [rad], shape (m, n) or (n,).
            force: Force on the robot [N], F_b, shape (m, 3) or (3,).
            point: Point of the tool in the flange frame [m], shape (3,); the campaign's load point
                if not given.
        """
        pulls = Pulls.at(q, force)
        points = None if point is None else np.atleast_2d(np.asarray(point, float))
        return self._mixed([one.moved(one.at(points), pulls) for one in self.hypotheses])

    def _mixed(self, moved: Sequence[_PointDeflection]) -> _PointDeflection:
        """Mean and covariance of the mixture of the hypotheses."""
        mean = self._mean([each.displacement for each in moved])
        cov = np.zeros_like(moved[0].cov)
        for one, each in zip(self.hypotheses, moved, strict=True):
            off = each.displacement - mean
            if one.weight > 0:  # zero times an infinite covariance would be NaN
                cov += one.weight * (each.cov + off[:, :, None] * off[:, None, :])
        return _PointDeflection(mean, cov)

    def _mean(self, arrays: Sequence[Array]) -> Array:
        weights = [one.weight for one in self.hypotheses]
        return np.asarray(np.einsum("h,h...->...", weights, np.stack(arrays)))

    def deflection(self, q: Array, force: Array) -> tuple[Array, Array]:
        """Displacements of the campaign's targets under one pull, and their uncertainty.

        For a model with undeformed geometry the uncertainty includes the neglected second-order
        terms.

        Args:
            q: Joint values [m] or [rad], shape (n,).
            force: Force on the robot [N], F_b, shape (3,).

        Returns:
            Displacements [m], F_b, and standard uncertainties per axis [m], both shape (t, 3).
        """
        found = self._with_left_out([one.cell for one in self.hypotheses], Pulls.at(q, force))
        return found.displacement, found.std

    def at_load_point(self, q: Array, force: Array) -> _PointDeflection:
        """Deflection of the load point under many pulls, with uncertainty as in `deflection`.

        Args:
            q: Joint values [m] or [rad], shape (m, n) or (n,).
            force: Force on the robot [N], F_b, shape (m, 3) or (3,).
        """
        return self._with_left_out([one.at() for one in self.hypotheses], Pulls.at(q, force))

    def _with_left_out(self, cells: Sequence[Cell], pulls: Pulls) -> _PointDeflection:
        """Deflections of the targets of cells; neglected second-order terms count as an error."""
        moved = []
        for one, cell in zip(self.hypotheses, cells, strict=True):
            flat = one.moved(cell, pulls)
            bent = forward(replace(cell, equilibrium="deformed"), pulls, one.value).displacement
            more = bent.reshape(-1, 3) - flat.displacement
            left_out = more[:, :, None] * np.eye(3) * more[:, None, :]
            moved.append(replace(flat, cov=flat.cov + left_out))
        return self._mixed(moved)

    def positions(self, q: Array, force: Array, points: Array) -> Prediction:
        """Points of the tool unloaded and loaded, the force acting at the first of them.

        Args:
            q: Joint values [m] or [rad], shape (m, n).
            force: Force on the robot [N], F_b, shape (m, 3).
            points: Points in the flange frame [m], shape (t, 3).
        """
        pulls = Pulls.at(q, force)
        each = [forward(one.at(points), pulls, one.value) for one in self.hypotheses]
        names = [field.name for field in fields(Prediction)]
        return Prediction(*(self._mean([getattr(one, name) for one in each]) for name in names))


NOTHING_M = 1e-9
"""Displacement [m] at typical magnitude below which a parameter does not act at a point."""


def part(
    weight: float,
    cell: Cell,
    estimate: Estimate,
    system: System | None = None,
    ratio: float = 1.0,
) -> ModelHypothesis:
    """The exchangeable part of an estimate: the machine without the measurement.

    Args:
        weight: Its probability.
        cell: Joint springs and causes, in the order of the estimate's parameters.
        estimate: Their values with covariance.
        system: System it was estimated from, to resolve determined combinations of undetermined
            parameters.
        ratio: Ratio of its uncertainties to those of the system [1].
    """
    mine = of_machine(cell)
    effects = tuple(effect for effect in cell.effects if not _measurement(effect))
    tool = replace(_found(cell, estimate.value), six=False)  # how it was measured is left out
    return _with_beyond(
        ModelHypothesis(
            weight,
            replace(cell, tool=tool, effects=effects),
            estimate.value[mine],
            estimate.cov[np.ix_(mine, mine)],
            *_apart(estimate, mine, system, ratio),
        )
    )


def _with_beyond(one: ModelHypothesis) -> ModelHypothesis:
    """Add the uncertainty of unlisted laws outside the range of the data, with value zero."""
    for effect, values in one.cell.split(one.value):
        if effect.law is not None:
            more, cov = unlisted.beyond(one.cell.robot, effect, values)
            k = len(cov)
            one = replace(
                one,
                cell=one.cell.with_effects(more),
                value=np.append(one.value, np.zeros(k)),
                cov=np.block(
                    [[one.cov, np.zeros((len(one.cov), k))], [np.zeros((k, len(one.cov))), cov]]
                ),
                free=None if one.free is None else np.pad(one.free, ((0, k), (0, 0))),
                within=None if one.within is None else np.append(one.within, np.diag(cov)),
            )
    return one


def _apart(
    estimate: Estimate, mine: Bools, system: System | None, ratio: float
) -> tuple[Array, Array] | tuple[None, None]:
    """`free` and `within` of a hypothesis; None if all parameters are determined."""
    if system is None or np.isfinite(estimate.std).all():
        return None, None
    A = whitener(system.errors, system.rows.pose)(system.B * system.typical)
    inverse = linear.pseudoinverse(A)
    variance = np.einsum("kr,kr->k", inverse.half, inverse.half) * (ratio * system.typical) ** 2
    return system.typical[mine, None] * inverse.free[mine], variance[mine]


def of_machine(cell: Cell) -> Bools:
    """Mask of the parameters of a cell that describe the machine and are exported, shape (k,)."""
    keep = [not _measurement(effect) for effect in cell.effects]
    return np.repeat(keep, [len(effect.parameters) for effect in cell.effects])


def _measurement(effect: Effect) -> bool:
    kinds = Wrench | Reflectors | Observation | Noise
    return any(isinstance(facet, kinds) for facet in effect.facets)


def _found(cell: Cell, values: Array) -> Tool:
    """The tool with its points where the effects put them, rather than as in campaign.toml.

    An effect that moves points of the tool without changing the force states their true place, and
    users who ask for the load point or a target mean the true one. The shift must be constant in
    the flange frame, tested at two poses.
    """
    pulls = Pulls.at(np.outer(_TWO_POSES, np.ones(cell.robot.n)), _TWO_FORCES)
    tool, begin = cell.tool, 0
    for effect in cell.effects:
        mine, begin = values[begin : begin + len(effect.parameters)], begin + len(effect.parameters)
        if not all(isinstance(facet, Wrench | Reflectors) for facet in effect.facets):
            continue
        here = loaded(Cell(cell.robot, tool, (effect,)), pulls, mine)
        ends = np.concatenate([here.load_point[:, None], here.points], axis=1)
        at = (ends - here.configuration.flange_origin[:, None]) @ here.configuration.flange_axes
        if np.allclose(here.force, pulls.force) and np.ptp(at, axis=0).max() < NOTHING_M:
            tool = replace(tool, load_point=at[0, 0], points=at[0, 1:])
    return tool


_TWO_POSES = np.array([0.0, 0.7])
"""Value of every joint in two poses that turn the flange [m or rad]."""

_TWO_FORCES = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Force in each, in two directions [N]."""
