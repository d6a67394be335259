"""Laws by which a joint moves more than its encoder says, over angle, torque, temperature or time.

A law moves one joint by f = sum_k b_k g_k(v), with functions g_k of a variable v and estimated
amplitudes b_k. A transmission error of arbitrary shape over the joint's own angle is
`curves.Curve`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from pipeline.base.arrays import Array, Locked

LawKind = Literal["periodic", "smooth", "step", "coupling"]
LawVariable = Literal["angle", "torque", "temperature", "time"]


@dataclass(frozen=True, eq=False)
class Inputs(Locked):
    """Variables that laws may depend on, at m poses.

    Attributes:
        q: Joint values of the controller [m] or [rad], shape (m, n).
        tau: Torque or force of the weight on each joint [N m] or [N], shape (m, n).
        temperature: Air temperature [degC], NaN where unknown, shape (m,).
        time: Position of the pose in its series, from 0 to 1 [1]; NaN outside of any, shape (m,).
        series: Number of its series, in the order of measurement; NaN outside of any, shape (m,).
    """

    q: Array
    tau: Array
    temperature: Array
    time: Array
    series: Array

    def part(self, which: Array) -> Inputs:
        """The inputs of the selected poses."""
        return Inputs(*(getattr(self, one.name)[which] for one in fields(self)))


@dataclass(frozen=True)
class JointLaw:
    """One law of one joint.

    Attributes:
        joint: Joint that it moves, from 1.
        kind: `periodic`, `smooth`, `step` or `coupling`.
        variable: `angle`, `torque`, `temperature` or `time`.
        source: Joint whose angle or torque is the variable, from 1; None for temperature and time.
        order: Angular frequency of a wave [1/rad] (periods per turn) or [1/m], or degree of a
            polynomial.
        middle: Zero of a polynomial or position of a step, in units of the variable; for a step in
            time, series since the first.
        scale: Half-width of a polynomial's range, in units of the variable: it is fitted from -1 to
            1.
    """

    joint: int
    kind: LawKind
    variable: LawVariable
    source: int | None
    order: float
    middle: float = 0.0
    scale: float = 1.0

    @property
    def amplitudes(self) -> int:
        """Number of its amplitudes."""
        return 2 if self.periodic else 1

    @property
    def periodic(self) -> bool:
        """Whether it is a wave over an angle, with a free phase."""
        return self.kind == "periodic" or (self.kind == "coupling" and self.variable == "angle")

    @property
    def by_balancer(self) -> bool:
        """Whether a balancer turns its joint so: one or two waves per turn over its own angle."""
        own = self.kind == "periodic" and self.variable == "angle" and self.source == self.joint
        return own and self.order in (1.0, 2.0)

    @property
    def once(self) -> bool:
        """Whether it is a step in time, which happens once and lasts from then on."""
        return self.kind == "step" and self.variable == "time"

    def of(self, inputs: Inputs) -> Array:
        """Its variable at m poses, (m,)."""
        if self.variable == "temperature":
            return inputs.temperature
        if self.variable == "time":
            return inputs.series + inputs.time if self.once else inputs.time
        table = inputs.tau if self.variable == "torque" else inputs.q
        return np.asarray(table[:, (self.source or 1) - 1])

    def basis(self, inputs: Inputs) -> Array:
        """g_k at m poses, shape (m, amplitudes); zero where the variable is unknown.

        A polynomial stays constant beyond its range. A step in time is -1 before and 0 since, so
        that table and predictions are those of the robot as it is now.
        """
        v = (self.of(inputs) - self.middle) / self.scale
        if self.once:
            return -(v < 0).astype(float)[:, None]
        if self.kind == "step":
            return np.sign(np.nan_to_num(v, nan=1.0))[:, None]
        v = np.nan_to_num(v)
        if self.periodic:
            out, phase = np.empty((len(v), 2)), self.order * v
            np.cos(phase, out=out[:, 0])
            np.sin(phase, out=out[:, 1])
            return out
        return np.asarray(v[:, None].clip(-1.0, 1.0) ** self.order)
