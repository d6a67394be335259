"""A robot as it stands: its table corrected, its tool, the instrument's frames, what bends it.

To first order in everything small, a reading in F_b is where the mechanism is, moved by

    D x + Z (C tau + f(q)) + Z C T_k d_k + Z e + noise

with x the letters of the table, tool and frames, Z the joints' own motions, C their compliances
under the weight tau, f their laws and curves, d_k how far mass and centre of the payload k of that
pose are from what is stated and T_k the torque of that, and e an error of each joint at each pose
that no model holds (repeatability, transmission), alike for all readings of the pose.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.geometry.curves import Curve
from pipeline.geometry.laws import Inputs, Law
from pipeline.geometry.readings import Readings
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.letters import Letter, changed, letters, twists
from pipeline.machine.robot.weight import gravity_torque, payload_torques


@dataclass(frozen=True, eq=False)
class Payloads(Locked):
    """Payloads as campaign.toml states them.

    Attributes:
        names: Shape (p,).
        mass: [kg], shape (p,).
        centre: Centres of mass, flange frame [m], shape (p, 3).
        std: Standard uncertainties of the mass and of the centre along x, y, z, shape (p, 4).
    """

    names: tuple[str, ...]
    mass: Array
    centre: Array
    std: Array

    def __len__(self) -> int:
        """Number of payloads p."""
        return len(self.mass)


@dataclass(frozen=True, eq=False)
class Weights(Locked):
    """What pulls at the arm: gravity, and a payload at each pose.

    Attributes:
        gravity: Acceleration in F_b [m/s^2], shape (3,).
        payloads: All that are known.
        carried: Payload of each pose, 0 for none, k + 1 for `payloads.names[k]`, shape (m,).
    """

    gravity: Array
    payloads: Payloads
    carried: Ints

    @property
    def any(self) -> bool:
        """Whether a payload is carried anywhere."""
        return bool(self.carried.any())

    def part(self, which: Array | Ints) -> Weights:
        """Those of some poses."""
        return replace(self, carried=self.carried[which])

    def at_poses(self, off: Array) -> tuple[Array, Array]:
        """Mass (m,) [kg] and centre (m, 3) [m] of the payload at each pose; 0 without one.

        Args:
            off: How far mass and centre of each payload are from what is stated, shape (p, 4).
        """
        mass = np.append(0.0, self.payloads.mass + off[:, 0])
        centre = np.vstack([np.zeros(3), self.payloads.centre + off[:, 1:]])
        return mass[self.carried], centre[self.carried]

    def by_payload(self, torques: Array) -> Array:
        """Derivatives (m, n, 4) by the payload of each pose, for all payloads, (m, n, 4 p)."""
        of = self.carried[:, None] == 1 + np.arange(len(self.payloads))
        each = torques[:, :, None, :] * of[:, None, :, None]
        return np.asarray(each.reshape(*torques.shape[:2], 4 * len(self.payloads)))


@dataclass(frozen=True, eq=False)
class Mechanism(Locked):
    """What is known of a robot.

    Attributes:
        table: The robot as its file has it.
        values: How far each letter is off [m] or [rad], shape (k,).
        tool: Frame of each target in the flange frame, shape (t, 4, 4).
        frames: F_b in the frame of the instrument, for each series, shape (s, 4, 4).
        compliance: Of each joint [m/N] or [rad/(N m)], 0 where none is estimated, shape (n,).
        payload: How far mass [kg] and centre [m] of each payload are from what is stated, (p, 4).
        laws: Laws of the joints.
        amplitudes: Of all laws, one after the other.
        curves: Curves of the joints.
        knots: Of all curves, one after the other.
    """

    table: Robot
    values: Array
    tool: Array
    frames: Array
    compliance: Array
    payload: Array = field(default_factory=lambda: np.zeros((0, 4)))
    laws: tuple[Law, ...] = ()
    amplitudes: Array = field(default_factory=lambda: np.zeros(0))
    curves: tuple[Curve, ...] = ()
    knots: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def letters(self) -> tuple[Letter, ...]:
        """Letters of the table that may be off."""
        return letters(self.table)

    @property
    def robot(self) -> Robot:
        """The robot with its table corrected."""
        return changed(self.table, self.letters, self.values)

    def inputs(
        self, q: Array, weights: Weights, temperature: Array, time: Array, series: Array
    ) -> Inputs:
        """What laws may be of, on the corrected robot."""
        robot = self.robot
        mass, centre = weights.at_poses(self.payload)
        tau = gravity_torque(robot, configure(robot, q), weights.gravity, mass, centre)
        return Inputs(q, tau, temperature, time, series)

    def hung(self, here: Configuration, weights: Weights) -> Array:
        """How far the joints turn by a unit of each payload's mass and centre, (m, n, 4 p)."""
        mass, centre = weights.at_poses(self.payload)
        torques = payload_torques(here, weights.gravity, mass, centre)
        return weights.by_payload(self.compliance[:, None] * torques)

    def turned(self, inputs: Inputs) -> Array:
        """How far each joint stands from its encoder [m] or [rad], shape (m, n)."""
        out = inputs.tau * self.compliance
        for law, part in zip(self.laws, self._parts(), strict=True):
            out[:, law.joint - 1] += law.basis(inputs) @ part
        for curve, knots in zip(self.curves, self._knots(), strict=True):
            out[:, curve.joint] += curve.value(inputs.q[:, curve.joint], knots)
        return np.asarray(out)

    def _parts(self) -> list[Array]:
        ends = np.cumsum([law.amplitudes for law in self.laws])[:-1]
        return np.split(self.amplitudes, ends) if self.laws else []

    def _knots(self) -> list[Array]:
        ends = np.cumsum([curve.count for curve in self.curves])[:-1]
        return np.split(self.knots, ends) if self.curves else []

    def stands(self, inputs: Inputs, robot: Robot | None = None) -> Configuration:
        """The robot where it really is at m poses."""
        return configure(robot or self.robot, inputs.q + self.turned(inputs))

    def targets(self, here: Configuration) -> tuple[Array, Array]:
        """Places (m, t, 3) [m] and orientations (m, t, 3, 3) of the targets, F_b."""
        at = here.points(self.tool[:, :3, 3])
        turn = np.einsum("mij,tjk->mtik", here.flange_axes, self.tool[:, :3, :3])
        return at, turn

    def moved(self, step: Array, layout: Layout) -> Mechanism:
        """The mechanism with parameters at `step`: table, springs and laws anew, frames moved on.

        Args:
            step: Values of letters, compliances, laws and knots; motions of tool and frames.
            layout: Where they stand.
        """
        tool = np.stack([
            frame @ _motion(one)
            for frame, one in zip(self.tool, step[layout.tool].reshape(-1, 6), strict=True)
        ])  # fmt: skip
        frames = np.stack([
            frame @ _motion(one)
            for frame, one in zip(self.frames, step[layout.frames].reshape(-1, 6), strict=True)
        ])  # fmt: skip
        return replace(
            self,
            values=step[layout.letters],
            tool=tool,
            frames=frames,
            compliance=step[layout.compliance],
            payload=step[layout.payload].reshape(-1, 4),
            amplitudes=step[layout.laws],
            knots=step[layout.knots],
        )

    def at(self, layout: Layout) -> Array:
        """Parameters about which it is linear: those of tool and frames are zero."""
        out = np.zeros(layout.size)
        out[layout.letters], out[layout.compliance] = self.values, self.compliance
        out[layout.payload] = self.payload.ravel()
        out[layout.laws], out[layout.knots] = self.amplitudes, self.knots
        return out


def _motion(twist: Array) -> Array:
    """Rigid motion of a small turn (first three) and shift, shape (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(np.array(twist[:3])).as_matrix()
    out[:3, 3] = twist[3:]
    return out


@dataclass(frozen=True)
class Layout:
    """Where the parameters stand in their vector.

    Attributes:
        letters: Letters of the table.
        tool: Six of each target: turn and shift in its own frame.
        frames: Six of each series: turn and shift in F_b.
        compliance: One of each joint.
        payload: Four of each payload: mass and centre.
        laws: Amplitudes.
        knots: Of the curves.
    """

    letters: slice
    tool: slice
    frames: slice
    compliance: slice
    payload: slice
    laws: slice
    knots: slice

    @property
    def size(self) -> int:
        """Number of parameters."""
        return int(self.knots.stop)

    @property
    def dense(self) -> int:
        """Number of those before the knots."""
        return int(self.knots.start)


def layout(mechanism: Mechanism) -> Layout:
    """Where the parameters of a mechanism stand."""
    sizes = (
        len(mechanism.values),
        6 * len(mechanism.tool),
        6 * len(mechanism.frames),
        len(mechanism.compliance),
        mechanism.payload.size,
        len(mechanism.amplitudes),
        sum(curve.count for curve in mechanism.curves),
    )
    ends = np.cumsum([0, *sizes]).tolist()
    return Layout(*(slice(a, b) for a, b in pairwise(ends)))


@dataclass(frozen=True, eq=False)
class Linear(Locked):
    """Readings about a mechanism: y = D x + Z e, rows x, y, z and rotations of each target, F_b.

    Attributes:
        y: Reading minus mechanism [m], [rad], shape (m, 6 t); zero where not read.
        D: Derivatives by all parameters but the knots, shape (m, 6 t, dense).
        Z: Derivatives by the joints, shape (m, 6 t, n).
        read: Which rows were read, shape (m, 6 t).
        inputs: What the laws are of.
    """

    y: Array
    D: Array
    Z: Array
    read: Bools
    inputs: Inputs


def placed(readings: Readings, mechanism: Mechanism, weights: Weights) -> tuple[Array, Array]:
    """Where a mechanism has the targets and where they were read [m], F_b, both (m, t, 3)."""
    here = mechanism.stands(_inputs(readings, mechanism, weights))
    return mechanism.targets(here)[0], _seen(readings, mechanism)


def _inputs(readings: Readings, mechanism: Mechanism, weights: Weights) -> Inputs:
    when = within(readings), readings.series.astype(float)
    return mechanism.inputs(readings.q, weights, readings.temperature, *when)


def _seen(readings: Readings, mechanism: Mechanism) -> Array:
    """Readings of targets in F_b [m], (m, t, 3)."""
    own = mechanism.frames[readings.series]
    return np.einsum("mji,mtj->mti", own[:, :3, :3], readings.at - own[:, None, :3, 3])


def linearised(readings: Readings, mechanism: Mechanism, weights: Weights) -> Linear:
    """Readings about a mechanism."""
    robot, where = mechanism.robot, layout(mechanism)
    inputs = _inputs(readings, mechanism, weights)
    here = mechanism.stands(inputs, robot)
    at, turn = mechanism.targets(here)
    own, seen_at = mechanism.frames[readings.series], _seen(readings, mechanism)
    seen_turn = np.einsum("mji,mtjk->mtik", own[:, :3, :3], readings.turn)
    off = np.einsum("mtij,mtkj->mtik", seen_turn, turn).reshape(-1, 3, 3)
    turned = Rotation.from_matrix(off).as_rotvec().reshape(at.shape)
    y = np.concatenate([seen_at - at, turned], axis=2).reshape(len(readings), -1)
    read = readings.read
    D = np.zeros((*read.shape, where.dense))
    D[..., where.letters] = reach(twists(here, mechanism.letters), at)
    D[..., where.tool] = _of_tool(at, turn, readings)
    D[..., where.frames] = _of_frames(at, readings)
    Z = reach(here.twists, at)
    D[..., where.compliance] = Z * inputs.tau[:, None, :]
    D[..., where.payload] = Z @ mechanism.hung(here, weights)
    if mechanism.laws:
        each = [(law.joint - 1, law.basis(inputs)) for law in mechanism.laws]
        waves = [Z[..., j, None] * basis[:, None, :] for j, basis in each]
        D[..., where.laws] = np.concatenate(waves, axis=2)
    D[~read], Z[~read], y[~read] = 0.0, 0.0, 0.0
    return Linear(y, D, Z, read, inputs)


def within(readings: Readings) -> Array:
    """Place of each pose in its series, from 0 to 1, (m,)."""
    out = np.zeros(len(readings))
    for series in range(len(readings.names)):
        mine = np.flatnonzero(readings.series == series)
        out[mine] = np.linspace(0.0, 1.0, len(mine)) if len(mine) > 1 else 0.0
    return out


def reach(screws: Array, at: Array) -> Array:
    """How screws (m, k, 6) move targets (m, t, 3): rows of shift and turn, (m, 6 t, k)."""
    omega, v = screws[:, None, :, :3], screws[:, None, :, 3:]
    shift = np.cross(omega, at[:, :, None, :]) + v
    turn = np.broadcast_to(omega, shift.shape)
    both = np.concatenate([shift, turn], axis=3)  # m, t, k, 6
    return np.asarray(np.swapaxes(both, 2, 3).reshape(len(at), -1, screws.shape[1]))


def _of_tool(at: Array, turn: Array, readings: Readings) -> Array:
    """Derivatives by turn and shift of each target in its own frame, (m, 6 t, 6 t)."""
    m, t = at.shape[:2]
    out = np.zeros((m, t, 6, t, 6))
    for k in range(t):
        out[:, k, :3, k, 3:] = turn[:, k]
        if readings.six[k]:
            out[:, k, 3:, k, :3] = turn[:, k]
    return out.reshape(m, 6 * t, 6 * t)


def _of_frames(at: Array, readings: Readings) -> Array:
    """Derivatives by turn and shift of F_b in each series, (m, 6 t, 6 s)."""
    m, t = at.shape[:2]
    out = np.zeros((m, t, 6, len(readings.names), 6))
    mine = np.arange(m)
    for axis, e in enumerate(np.eye(3)):
        out[mine, :, :3, readings.series, axis] = np.cross(e, at)
        out[mine, :, 3:, readings.series, axis] = e
        out[mine, :, axis, readings.series, 3 + axis] = 1.0
    return out.reshape(m, 6 * t, -1)
