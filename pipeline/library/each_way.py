"""Joints whose stiffness depends on the sign of the torque: values, and where each applies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.quantities import common_prefix, prefixed, scaled, with_std
from pipeline.machine import sides
from pipeline.machine.robot import axes
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis


@dataclass(frozen=True)
class BothStiffnesses:
    """One such joint along a path, for the most probable hypothesis that has it.

    Attributes:
        joint: Its index.
        called: Axis of the controller, or joint of the robot file.
        plus: Stiffness and its standard uncertainty where the torque turns it towards plus [N
            m/rad], in the sense of `called`.
        minus: The same towards minus.
        unit: Unit of both.
        weight: Probability of the hypotheses that have it.
        towards_plus: Number of points of the path at which the torque turns it towards plus.
        towards_minus: Number of the other points.
    """

    joint: int
    called: str
    plus: tuple[float, float]
    minus: tuple[float, float]
    unit: str
    weight: float
    towards_plus: int
    towards_minus: int

    @property
    def sentence(self) -> str:
        """Both values with the number of points at which each is used."""
        factor, letter = common_prefix([self.plus[0], self.minus[0]])
        unit = prefixed(self.unit, letter)
        plus, minus = (
            f"{with_std(scaled(value, factor), scaled(std, factor))} {unit}"
            for value, std in (self.plus, self.minus)
        )
        sure = "" if self.weight > _SURE else f" (probability {100 * self.weight:.0f} %)"
        return (
            f"{self.called} has two stiffnesses{sure}: {plus} where the load turns it towards plus "
            f"({_points(self.towards_plus)}), {minus} towards minus "
            f"({_points(self.towards_minus)}); each point is corrected with its own."
        )


_SURE = 0.99
"""Probability above which it is not stated [1]."""


def _points(count: int) -> str:
    return f"{count} point{'' if count == 1 else 's'}"


def each_way(model: IdentifiedModel, q: Array, force: Array) -> tuple[BothStiffnesses, ...]:
    """Joints of a model that have two stiffnesses, at the points of a path.

    Args:
        model: The identified model.
        q: Joint values [m] or [rad], shape (m, n).
        force: Force on the robot [N], F_b, shape (m, 3).
    """
    best: dict[int, ModelHypothesis] = {}
    weight: dict[int, float] = {}
    for one in sorted(model.hypotheses, key=lambda one: one.weight):
        for joint in sides.columns(model.robot.n, one.more):
            best[joint] = one
            weight[joint] = weight.get(joint, 0.0) + one.weight
    return tuple(_ways(model, best[j], j, weight[j], q, force) for j in sorted(best))


def along(parts: Sequence[tuple[BothStiffnesses, ...]]) -> tuple[BothStiffnesses, ...]:
    """Combine several paths of one model."""
    return tuple(
        replace(
            own[0],
            towards_plus=sum(one.towards_plus for one in own),
            towards_minus=sum(one.towards_minus for one in own),
        )
        for own in zip(*parts, strict=True)
    )


def _ways(
    model: IdentifiedModel, one: ModelHypothesis, joint: int, weight: float, q: Array, force: Array
) -> BothStiffnesses:
    """Both stiffnesses 1/(c + dc) and 1/(c - dc) of a joint, and which one applies where."""
    column = sides.columns(model.robot.n, one.more)[joint]
    robot = model.robot
    held = sides.along(one.cell, one.value, q, force)[joint]
    sense = axes.sense(robot, joint) or 1
    found = {}
    for sign in (1.0, -1.0):
        T = np.zeros((1, len(one.value)))
        T[0, [joint, column]] = 1.0, sign
        x, V = sides.taken(one.value, one.cov, T)
        found[sign * sense] = 1 / float(x[0]), float(np.sqrt(V[0, 0]) / x[0] ** 2)
    return BothStiffnesses(
        joint,
        axes.alone(robot)[joint] or f"joint {joint + 1}",
        found[1.0],
        found[-1.0],
        robot.joints[joint].stiffness_unit,
        weight,
        int(np.sum(sense * held > 0)),
        int(np.sum(sense * held < 0)),
    )
