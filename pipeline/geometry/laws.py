"""Laws by which a joint turns more than its encoder says, of angle, torque, temperature, time.

A law moves one joint by f = sum_k b_k g_k(v): functions g of a variable v, amplitudes b estimated.
The transmission error over the joint's own angle of whatever shape is `curves.Curve`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.base.arrays import Array, Locked

Kind = Literal["periodic", "smooth", "step", "coupling"]
Variable = Literal["angle", "torque", "temperature", "time"]


@dataclass(frozen=True, eq=False)
class Inputs(Locked):
    """What laws may be of, at m poses.

    Attributes:
        q: Joint values of the controller [m] or [rad], shape (m, n).
        tau: Torque of weight on each joint [N m] or [N], shape (m, n).
        temperature: Of the air [degC], NaN unknown, shape (m,).
        time: Place of the pose in its series, from 0 to 1; NaN outside of one, shape (m,).
        series: Number of its series, in the order in which they were measured; NaN likewise, (m,).
    """

    q: Array
    tau: Array
    temperature: Array
    time: Array
    series: Array

    def part(self, which: Array) -> Inputs:
        """Some of the poses."""
        return Inputs(
            self.q[which],
            self.tau[which],
            self.temperature[which],
            self.time[which],
            self.series[which],
        )


@dataclass(frozen=True)
class JointLaw:
    """One law of one joint.

    Attributes:
        joint: Which it moves, from 1.
        kind: `periodic`, `smooth`, `step` or `coupling`.
        variable: `angle`, `torque`, `temperature` or `time`.
        source: The joint whose angle or torque it is of, from 1; None for temperature and time.
        order: Periods per turn (per metre of a sliding joint), or degree of a polynomial.
        middle: Where a polynomial is zero and a step is, in units of the variable; for a step in
            time these are series since the first.
        scale: Unit of a polynomial, in units of the variable: it was taught from -1 to 1.
    """

    joint: int
    kind: Kind
    variable: Variable
    source: int | None
    order: float
    middle: float = 0.0
    scale: float = 1.0

    @property
    def amplitudes(self) -> int:
        """How many amplitudes it has."""
        return 2 if self.periodic else 1

    @property
    def periodic(self) -> bool:
        """A wave over an angle, in whatever phase."""
        return self.kind == "periodic" or (self.kind == "coupling" and self.variable == "angle")

    @property
    def once(self) -> bool:
        """It happens at one time and lasts from then on."""
        return self.kind == "step" and self.variable == "time"

    def of(self, inputs: Inputs) -> Array:
        """The variable at m poses, (m,)."""
        if self.variable == "temperature":
            return inputs.temperature
        if self.variable == "time":
            return inputs.series + inputs.time if self.once else inputs.time
        table = inputs.tau if self.variable == "torque" else inputs.q
        return np.asarray(table[:, (self.source or 1) - 1])

    def basis(self, inputs: Inputs) -> Array:
        """g_k at m poses, shape (m, amplitudes); zero where the variable is not known.

        Beyond where it was taught a polynomial stays as it was at the end, and at no known time a
        step in time has happened.
        """
        v = (self.of(inputs) - self.middle) / self.scale
        if self.kind == "step":
            return np.sign(np.nan_to_num(v, nan=1.0))[:, None]
        v = np.nan_to_num(v)
        if self.periodic:
            return np.stack([np.cos(self.order * v), np.sin(self.order * v)], axis=1)
        return np.asarray(v[:, None].clip(-1.0, 1.0) ** self.order)
