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
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.geometry.curves import Curve
from pipeline.geometry.laws import Inputs, JointLaw
from pipeline.geometry.readings import PositionReadings
from pipeline.geometry.yielding import Virtual, carried_by, carried_on
from pipeline.machine.effect import Elastic
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.configuration import rotation_about, translation_along
from pipeline.machine.robot.letters import Letter, changed, letters, twists
from pipeline.machine.robot.weight import by_moments, carried, payload_torques, work


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
class ArmWeights(Locked):
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

    def part(self, which: Array | Ints) -> ArmWeights:
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
        moments: Mass [kg] and first moment in its frame [kg m] of each link, shape (n, 4).
        unknown: The moments are estimated.
        elements: What yields beside the joints.
        yields: Parameters of the elements, one after the other.
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
    payload: Array
    moments: Array
    unknown: bool = False
    elements: tuple[Elastic, ...] = ()
    yields: Array = field(default_factory=lambda: np.zeros(0))
    laws: tuple[JointLaw, ...] = ()
    amplitudes: Array = field(default_factory=lambda: np.zeros(0))
    curves: tuple[Curve, ...] = ()
    knots: Array = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def letters(self) -> tuple[Letter, ...]:
        """Letters of the table that may be off."""
        return letters(self.table)

    @cached_property
    def robot(self) -> Robot:
        """The robot with its table corrected."""
        return changed(self.table, self.letters, self.values)

    def stand(
        self,
        q: Array,
        weights: ArmWeights,
        temperature: Array,
        time: Array,
        series: Array,
        force: Array | None = None,
        tip: Array | None = None,
    ) -> PlacedRobot:
        """The robot where it really is at m poses, under its weight and a force.

        Args:
            q: Joint values of the controller [m] or [rad], shape (m, n).
            weights: What pulls at the arm.
            temperature: Of the air [degC], shape (m,).
            time: Place of each pose in its series, shape (m,).
            series: Number of its series, shape (m,).
            force: At `tip` [N], F_b, shape (m, 3).
            tip: A point of the flange frame [m], shape (3,); the first target when not given.
        """
        robot = self.robot
        tip = self.tool[0, :3, 3] if tip is None else tip
        mass, centre = weights.at_poses(self.payload)
        here = configure(robot, q)
        for _ in range(_TURNED):
            bent = here
            held = weight = carried(bent, weights.gravity, self.moments, mass, centre)
            inputs = Inputs(q, work(bent.twists, held), temperature, time, series)
            if force is not None and force.any():
                at = bent.points(tip[None])[:, 0]
                held = held + np.concatenate([np.cross(at, force), force], axis=1)[:, None]
            tau = work(bent.twists, held)
            here = configure(robot, q + self.turned(replace(inputs, tau=tau), inputs))
        yields = Virtual(self.elements, here)
        bed = bed_screws(here) if any(curve.screw >= robot.n for curve in self.curves) else None
        screws, carrier = yields.screws, yields.carrier
        borne = yields.torques(held, weight)
        amounts = yields.answers(borne) * self.yields[yields.parameter]
        if bed is not None:
            screws = np.concatenate([screws, bed], axis=1)
            carrier = np.append(carrier, np.ones(6, dtype=np.int64))
            amounts = np.concatenate([amounts, self._bed(q)], axis=1)
        at = here.points(self.tool[:, :3, 3])
        turn = np.einsum("mij,tjk->mtik", here.flange_axes, self.tool[:, :3, :3])
        at, turn = carried_on(screws, carrier, amounts, at, turn)
        return PlacedRobot(inputs, tau, borne, bent, here, yields, bed, at, turn)

    def turned(self, loaded: Inputs, inputs: Inputs) -> Array:
        """How far each joint stands from its encoder [m] or [rad], shape (m, n).

        Args:
            loaded: With all torques, of which springs are.
            inputs: With those of weight, of which laws are.
        """
        out = loaded.tau * self.compliance
        for law, part in zip(self.laws, self._parts(), strict=True):
            out[:, law.joint - 1] += law.basis(inputs) @ part
        for curve, knots in zip(self.curves, self._knots(), strict=True):
            if curve.screw < out.shape[1]:
                out[:, curve.screw] += curve.value(inputs.q[:, curve.joint], knots)
        return np.asarray(out)

    def _bed(self, q: Array) -> Array:
        """How far the bed is from straight at the carriage, shape (m, 6)."""
        out = np.zeros((len(q), 6))
        for curve, knots in zip(self.curves, self._knots(), strict=True):
            if curve.screw >= self.table.n:
                out[:, curve.screw - self.table.n] += curve.value(q[:, curve.joint], knots)
        return out

    def _parts(self) -> list[Array]:
        ends = np.cumsum([law.amplitudes for law in self.laws])[:-1]
        return np.split(self.amplitudes, ends) if self.laws else []

    def _knots(self) -> list[Array]:
        ends = np.cumsum([curve.count for curve in self.curves])[:-1]
        return np.split(self.knots, ends) if self.curves else []

    def moved(self, step: Array, layout: ParameterLayout) -> Mechanism:
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
            yields=step[layout.yields],
            moments=step[layout.moments].reshape(-1, 4) if self.unknown else self.moments,
            amplitudes=step[layout.laws],
            knots=step[layout.knots],
        )

    def at(self, layout: ParameterLayout) -> Array:
        """Parameters about which it is linear: those of tool and frames are zero."""
        out = np.zeros(layout.size)
        out[layout.letters], out[layout.compliance] = self.values, self.compliance
        out[layout.payload], out[layout.yields] = self.payload.ravel(), self.yields
        if self.unknown:
            out[layout.moments] = self.moments.ravel()
        out[layout.laws], out[layout.knots] = self.amplitudes, self.knots
        return out


_TURNED = 2
"""Times that weight and joints are taken, the first where the controller has these: the second is
where they stand to the square of how much a deflection changes a torque, some 1e-5 of it."""


def _motion(twist: Array) -> Array:
    """Rigid motion of a small turn (first three) and shift, shape (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(np.array(twist[:3])).as_matrix()
    out[:3, 3] = twist[3:]
    return out


@dataclass(frozen=True)
class ParameterLayout:
    """Where the parameters stand in their vector.

    Attributes:
        letters: Letters of the table.
        tool: Six of each target: turn and shift in its own frame.
        frames: Six of each series: turn and shift in F_b.
        compliance: One of each joint.
        payload: Four of each payload: mass and centre.
        yields: Of the elements.
        moments: Four of each link: mass and first moment, where they are not known.
        laws: Amplitudes.
        knots: Of the curves.
    """

    letters: slice
    tool: slice
    frames: slice
    compliance: slice
    payload: slice
    yields: slice
    moments: slice
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


def layout(mechanism: Mechanism) -> ParameterLayout:
    """Where the parameters of a mechanism stand."""
    sizes = (
        len(mechanism.values),
        6 * len(mechanism.tool),
        6 * len(mechanism.frames),
        len(mechanism.compliance),
        mechanism.payload.size,
        len(mechanism.yields),
        mechanism.moments.size if mechanism.unknown else 0,
        len(mechanism.amplitudes),
        sum(curve.count for curve in mechanism.curves),
    )
    ends = np.cumsum([0, *sizes]).tolist()
    return ParameterLayout(*(slice(a, b) for a, b in pairwise(ends)))


@dataclass(frozen=True, eq=False)
class Linear(Locked):
    """Readings about a mechanism: y = D x + Z e, rows x, y, z and rotations of each target, F_b.

    Attributes:
        y: Reading minus mechanism [m], [rad], shape (m, 6 t); zero where not read.
        D: Derivatives by all parameters but the knots, shape (m, 6 t, dense).
        Z: Derivatives by the joints, and by the bed where it is not straight, (m, 6 t, n or n + 6).
        read: Which rows were read, shape (m, 6 t).
        inputs: What the laws are of.
        at: Places of the targets by the mechanism [m], F_b, shape (m, t, 3).
    """

    y: Array
    D: Array
    Z: Array
    read: Bools
    inputs: Inputs
    at: Array

    @cached_property
    def used(self) -> Ints:
        """Rows that were read at any pose, shape (r,)."""
        return np.flatnonzero(self.read.any(axis=0))

    def spread(self, left: Array) -> Array:
        """Numbers of these rows (m, r) among zeros for all others, shape (m, 6 t)."""
        out = np.zeros((len(left), self.read.shape[1]))
        out[:, self.used] = left
        return out


class PlacedRobot(NamedTuple):
    """A robot where it really is at m poses.

    Attributes:
        inputs: What laws are of.
        tau: Torque of weight and force on the joints, shape (m, n).
        borne: Torque on each virtual joint, shape (m, v).
        bent: Frames where the weight is taken: turned by the joints as far as it does.
        here: Frames, without what yields beside the joints.
        yields: Virtual joints.
        bed: Screws by which the bed is not straight, shape (m, 6, 6); None where it is.
        at: Places of the targets [m], F_b, shape (m, t, 3).
        turn: Their orientations, shape (m, t, 3, 3).
    """

    inputs: Inputs
    tau: Array
    borne: Array
    bent: Configuration
    here: Configuration
    yields: Virtual
    bed: Array | None
    at: Array
    turn: Array


def placed(
    readings: PositionReadings, mechanism: Mechanism, weights: ArmWeights
) -> tuple[Array, Array]:
    """Where a mechanism has the targets and where they were read [m], F_b, both (m, t, 3)."""
    return _stand(readings, mechanism, weights).at, _seen(readings, mechanism)


def _stand(readings: PositionReadings, mechanism: Mechanism, weights: ArmWeights) -> PlacedRobot:
    when = within(readings), readings.series.astype(float)
    return mechanism.stand(readings.q, weights, readings.temperature, *when)


def _seen(readings: PositionReadings, mechanism: Mechanism) -> Array:
    """Readings of targets in F_b [m], (m, t, 3)."""
    own = mechanism.frames[readings.series]
    return np.einsum("mji,mtj->mti", own[:, :3, :3], readings.at - own[:, None, :3, 3])


def linearised(readings: PositionReadings, mechanism: Mechanism, weights: ArmWeights) -> Linear:
    """Readings about a mechanism."""
    stand = _stand(readings, mechanism, weights)
    at, turn = stand.at, stand.turn
    own, seen_at = mechanism.frames[readings.series], _seen(readings, mechanism)
    seen_turn = np.einsum("mji,mtjk->mtik", own[:, :3, :3], readings.turn)
    off = np.einsum("mtij,mtkj->mtik", seen_turn, turn).reshape(-1, 3, 3)
    turned = Rotation.from_matrix(off).as_rotvec().reshape(at.shape)
    y = np.concatenate([seen_at - at, turned], axis=2).reshape(len(readings), -1)
    read = readings.read
    D, Z = derivatives(mechanism, stand, weights)
    of = by_frame(at)
    for series in range(len(readings.names)):
        mine = readings.series == series
        D[mine, :, frame_of(mechanism, series)] = of[mine]
    D[~read], Z[~read], y[~read] = 0.0, 0.0, 0.0
    return Linear(y, D, Z, read, stand.inputs, at)


def derivatives(
    mechanism: Mechanism, stand: PlacedRobot, weights: ArmWeights
) -> tuple[Array, Array]:
    """How targets move by all parameters but frames and knots, and by joints and bed.

    Returns:
        Shapes (m, 6 t, dense), zero for frames, and (m, 6 t, n) or, where the bed is not straight,
        (m, 6 t, n + 6).
    """
    where, here, at = layout(mechanism), stand.here, stand.at
    D = np.zeros((len(at), 6 * at.shape[1], where.dense))
    D[..., where.letters] = reach(twists(here, mechanism.letters), at)
    D[..., where.tool] = _of_tool(at, stand.turn)
    Z, yielding = reach(here.twists, at), reach(stand.yields.screws, at)
    D[..., where.compliance] = Z * stand.tau[:, None, :]
    mass, centre = weights.at_poses(mechanism.payload)
    if len(mechanism.payload):
        torques = payload_torques(here, weights.gravity, mass, centre)
        hung = weights.by_payload(mechanism.compliance[:, None] * torques)
        D[..., where.payload] = Z @ hung
    each = yielding * stand.yields.answers(stand.borne)[:, None]
    D[..., where.yields] = each @ np.eye(len(mechanism.yields))[stand.yields.parameter]
    if mechanism.unknown:
        unit = by_moments(stand.bent, weights.gravity)
        joints = np.arange(1, mechanism.table.n + 1)
        own = mechanism.compliance[:, None] * carried_by(stand.bent.twists, joints, unit)
        more = stand.yields.by_moments(unit, stand.borne)
        more *= mechanism.yields[stand.yields.parameter][:, None]
        D[..., where.moments] = Z @ own + yielding @ more
    if mechanism.laws:
        waves = [
            Z[..., law.joint - 1, None] * law.basis(stand.inputs)[:, None, :]
            for law in mechanism.laws
        ]
        D[..., where.laws] = np.concatenate(waves, axis=2)
    if stand.bed is not None:
        Z = np.concatenate([Z, reach(stand.bed, at)], axis=2)
    return D, Z


def bed_screws(here: Configuration) -> Array:
    """Shifts along and turns about x, y, z of F_b at the carriage, shape (m, 6, 6)."""
    origin, axes = here.origin[:, 0], np.broadcast_to(np.eye(3), (len(here.q), 3, 3))
    shifts = [translation_along(axes[:, k]) for k in range(3)]
    return np.stack([*shifts, *(rotation_about(origin, axes[:, k]) for k in range(3))], axis=1)


def within(readings: PositionReadings) -> Array:
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
    return np.asarray(np.swapaxes(both, 2, 3).reshape(len(at), 6 * at.shape[1], screws.shape[1]))


def _of_tool(at: Array, turn: Array) -> Array:
    """Derivatives by turn and shift of each target in its own frame, (m, 6 t, 6 t)."""
    m, t = at.shape[:2]
    out = np.zeros((m, t, 6, t, 6))
    for k in range(t):
        out[:, k, :3, k, 3:] = turn[:, k]
        out[:, k, 3:, k, :3] = turn[:, k]
    return out.reshape(m, 6 * t, 6 * t)


def by_frame(at: Array) -> Array:
    """Derivatives by turn and shift of the frame of a pose's series, (m, 6 t, 6)."""
    m, t = at.shape[:2]
    out = np.zeros((m, t, 6, 6))
    for axis, e in enumerate(np.eye(3)):
        out[:, :, :3, axis] = np.cross(e, at)
        out[:, :, 3 + axis, axis] = 1.0
        out[:, :, axis, 3 + axis] = 1.0
    return out.reshape(m, 6 * t, 6)


def frame_of(mechanism: Mechanism, series: int) -> slice:
    """Where turn and shift of a series' frame stand among the parameters."""
    first = layout(mechanism).frames.start + 6 * series
    return slice(first, first + 6)
