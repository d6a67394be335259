"""Model of a real robot: corrected DH parameters, tool, instrument frames, compliances and laws.

To first order in all small quantities, a reading in F_b differs from the mechanism by

    D x + Z (C tau + f(q)) + Z C T_k d_k + Z e + noise

with x the DH parameters, tool and frames, Z the derivatives by the joint values, C the joint
compliances under the torques tau of the weight, f the laws and curves of the joints, d_k the
deviation of mass and centre of that pose's payload k from their stated values and T_k the torques
it causes, and e an unmodelled error of each joint at each pose (repeatability, transmission),
common to all readings of the pose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.geometry.arm_weight import carried_by
from pipeline.geometry.unloaded import reach
from pipeline.machine.effect import Elastic
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.configuration import rotation_about, torque, translation_along
from pipeline.machine.robot.dh_parameters import DhParameter, changed, dh_parameters, moved, twists
from pipeline.machine.robot.weight import by_moments, carried, work
from pipeline.positions.laws import Inputs, JointLaw
from pipeline.positions.random_curve import Curve
from pipeline.positions.readings import PositionReadings
from pipeline.positions.yielding import Virtual, balanced, carried_on


@dataclass(frozen=True, eq=False)
class Payloads(Locked):
    """Payloads as stated in campaign.toml.

    Attributes:
        names: Shape (p,).
        mass: Masses [kg], shape (p,).
        centre: Centres of mass, flange frame [m], shape (p, 3).
        std: Standard uncertainties of the mass [kg] and of the centre along x, y, z [m],
            shape (p, 4).
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
    """Loads on the arm: gravity, and a payload at each pose.

    Attributes:
        gravity: Acceleration in F_b [m/s^2], shape (3,).
        payloads: All payloads.
        carried: Payload of each pose, 0 for none, k + 1 for `payloads.names[k]`, shape (m,).
    """

    gravity: Array
    payloads: Payloads
    carried: Ints

    @property
    def any(self) -> bool:
        """Whether any pose carries a payload."""
        return bool(self.carried.any())

    def part(self, which: Array | Ints) -> ArmWeights:
        """The loads of the selected poses."""
        return replace(self, carried=self.carried[which])

    def at_poses(self, off: Array) -> tuple[Array, Array]:
        """Mass (m,) [kg] and centre (m, 3) [m] of the payload at each pose; 0 without one.

        Args:
            off: Deviation of mass [kg] and centre [m] of each payload from the stated one,
                shape (p, 4).
        """
        mass = np.append(0.0, self.payloads.mass + off[:, 0])
        centre = np.vstack([np.zeros(3), self.payloads.centre + off[:, 1:]])
        return mass[self.carried], centre[self.carried]

    def by_payload(self, torques: Array) -> Array:
        """Derivatives (m, n, 4) by each pose's own payload, for all payloads, (m, n, 4 p)."""
        of = self.carried[:, None] == 1 + np.arange(len(self.payloads))
        each = torques[:, :, None, :] * of[:, None, :, None]
        return np.asarray(each.reshape(*torques.shape[:2], 4 * len(self.payloads)))


@dataclass(frozen=True, eq=False)
class Mechanism(Locked):
    """Complete model of a robot, its tool and the frames of the instrument.

    Attributes:
        table: The robot with its DH parameters as in its file.
        values: Deviation of each DH parameter from the table [m] or [rad], shape (k,).
        tool: Frame of each target in the flange frame, shape (t, 4, 4).
        frames: F_b in the frame of the instrument, for each series, shape (s, 4, 4).
        compliance: Compliance of each joint [m/N] or [rad/(N m)], 0 where not estimated,
            shape (n,).
        payload: Deviation of mass [kg] and centre [m] of each payload from the stated one, (p, 4).
        moments: Mass [kg] and first moment in its frame [kg m] of each link, shape (n, 4).
        loose: Whether the moments are estimated; stated ones are known to some per cent only.
        unknown: Whether nobody states them, so that not even their common factor is known.
        elements: Elastic elements other than the joint springs.
        yields: Parameters of the elements, concatenated.
        laws: Laws of the joints.
        amplitudes: Amplitudes of the laws, concatenated.
        curves: Curves of the joints and of the rail's bed.
        knots: Values of the curves at their knots, concatenated.
    """

    table: Robot
    values: Array
    tool: Array
    frames: Array
    compliance: Array
    payload: Array
    moments: Array
    loose: bool = False
    unknown: bool = False
    elements: tuple[Elastic, ...] = ()
    yields: Array = field(default_factory=lambda: np.zeros(0))
    laws: tuple[JointLaw, ...] = ()
    amplitudes: Array = field(default_factory=lambda: np.zeros(0))
    curves: tuple[Curve, ...] = ()
    knots: Array = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def letters(self) -> tuple[DhParameter, ...]:
        """DH parameters of the table that may be off."""
        return dh_parameters(self.table)

    @cached_property
    def robot(self) -> Robot:
        """The robot with corrected DH parameters."""
        return changed(self.table, self.letters, self.values)

    @cached_property
    def springs(self) -> Array:
        """Compliances by which deflections become torques: at least `_STIFFEST`, shape (n,)."""
        return np.maximum(self.compliance, _STIFFEST * self.table.nominal_compliance)

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
        """The robot at m poses, deflected by its weight and a force.

        Args:
            q: Joint values of the controller [m] or [rad], shape (m, n).
            weights: Gravity and payloads on the arm.
            temperature: Air temperature [degC], shape (m,).
            time: Position of each pose in its series, 0 to 1, shape (m,).
            series: Number of each pose's series, shape (m,).
            force: Force at `tip` [N], F_b, shape (m, 3).
            tip: Point of the flange frame [m], shape (3,); the first target if not given.
        """
        robot = moved(self.table, self.letters, self.values)
        tip = self.tool[0, :3, 3] if tip is None else tip
        mass, centre = weights.at_poses(self.payload)
        here = configure(robot, q)
        still = Inputs(q, np.zeros(q.shape), temperature, time, series)
        bases = [law.basis(still) for law in self.laws]
        for _ in range(_TURNED):
            bent = here
            held = weight = carried(bent, weights.gravity, self.moments, mass, centre)
            inputs = replace(still, tau=work(bent.twists, held))
            bases = [
                law.basis(inputs) if law.variable == "torque" else one
                for law, one in zip(self.laws, bases, strict=True)
            ]
            if force is not None and force.any():
                at = bent.points(tip[None])[:, 0]
                held = held + np.concatenate([np.cross(at, force), force], axis=1)[:, None]
            tau = work(bent.twists, held)
            here = configure(robot, q + self._turned(q, tau, bases))
        yields = Virtual(self.elements, here)
        bed = _bed_screws(here) if any(curve.screw >= robot.n for curve in self.curves) else None
        screws, carrier = yields.screws, yields.carrier
        balancer = self._balancer(q.shape, bases)
        borne = yields.torques(held, weight, balancer)
        amounts = yields.answers(borne) * self.yields[yields.parameter]
        if bed is not None:
            screws = np.concatenate([screws, bed], axis=1)
            carrier = np.append(carrier, np.ones(6, dtype=np.int64))
            amounts = np.concatenate([amounts, self._bed(q)], axis=1)
        at = here.points(self.tool[:, :3, 3])
        turn = here.flange_axes[:, None] @ self.tool[:, :3, :3]
        at, turn = carried_on(screws, carrier, amounts, at, turn)
        return PlacedRobot(inputs, bases, tau, balancer, borne, bent, here, yields, bed, at, turn)

    def _turned(self, q: Array, tau: Array, bases: Sequence[Array]) -> Array:
        """Deviation of each joint from its encoder value [m] or [rad], shape (m, n).

        Args:
            q: Joint values of the controller [m] or [rad], shape (m, n).
            tau: Torques of weight and force, which act on the springs, shape (m, n).
            bases: Functions of each law under the torques of the weight, (m, amplitudes) each.
        """
        out = tau * self.compliance
        for law, basis, part in self._lawful(bases):
            out[:, law.joint - 1] += basis @ part
        for curve, knots in self.curved():
            if curve.screw < out.shape[1]:
                out[:, curve.screw] += curve.value(q[:, curve.joint], knots)
        return np.asarray(out)

    def _balancer(self, shape: tuple[int, ...], bases: Sequence[Array]) -> Array:
        """Torque of a balancer on each joint [N m], shape (m, n).

        T = f / c, with f the first two waves by which the joint turns over its own angle.
        """
        out = np.zeros(shape)
        for law, basis, part in self._lawful(bases):
            if balances(self.table, law):
                at = law.joint - 1
                out[:, at] += basis @ part / self.springs[at]
        return out

    def _bed(self, q: Array) -> Array:
        """Motion of the bed at the carriage from its straight shape [m], [rad], shape (m, 6)."""
        out = np.zeros((len(q), 6))
        for curve, knots in self.curved():
            if curve.screw >= self.table.n:
                out[:, curve.screw - self.table.n] += curve.value(q[:, curve.joint], knots)
        return out

    def _lawful(self, bases: Sequence[Array]) -> Iterator[tuple[JointLaw, Array, Array]]:
        """Each law with its functions at the poses and its amplitudes."""
        ends = np.cumsum([law.amplitudes for law in self.laws])
        return zip(self.laws, bases, np.split(self.amplitudes, ends), strict=False)

    def curved(self) -> Iterator[tuple[Curve, Array]]:
        """Each curve with its values at its knots."""
        ends = np.cumsum([curve.count for curve in self.curves])
        return zip(self.curves, np.split(self.knots, ends), strict=False)

    def moved(self, step: Array, layout: _ParameterLayout) -> Mechanism:
        """The mechanism with new parameters.

        Args:
            step: Values of all parameters except tool and frames; for these, motions from their
                present poses.
            layout: Layout of `step`.
        """
        return replace(
            self,
            values=step[layout.letters],
            tool=_moved(self.tool, step[layout.tool]),
            frames=_moved(self.frames, step[layout.frames]),
            compliance=step[layout.compliance],
            payload=step[layout.payload].reshape(-1, 4),
            yields=step[layout.yields],
            moments=step[layout.moments].reshape(-1, 4) if self.loose else self.moments,
            amplitudes=step[layout.laws],
            knots=step[layout.knots],
        )

    def at(self, layout: _ParameterLayout) -> Array:
        """Present parameter vector, the linearisation point; zero for tool and frames."""
        out = np.zeros(layout.size)
        out[layout.letters], out[layout.compliance] = self.values, self.compliance
        out[layout.payload], out[layout.yields] = self.payload.ravel(), self.yields
        if self.loose:
            out[layout.moments] = self.moments.ravel()
        out[layout.laws], out[layout.knots] = self.amplitudes, self.knots
        return out


def balances(robot: Robot, law: JointLaw) -> bool:
    """Whether a law is what a balancer turns the shoulder by."""
    return law.by_balancer and law.joint == balanced(robot)


_TURNED = 2
"""Number of evaluations of torques and deflections, the first at the joint values of the
controller: the error after the second is the square of the relative change of a torque by the
deflection, some 1e-5 of the deflection."""


_STIFFEST = 0.1
"""Least compliance that turns deflections into torques, over the nominal one [1]."""


def _moved(frames: Array, twists: Array) -> Array:
    """Frames (k, 4, 4), each after a motion in itself, twists as of `_motion` (6 k,)."""
    every = zip(frames, twists.reshape(-1, 6), strict=True)
    return np.stack([frame @ _motion(one) for frame, one in every])


def _motion(twist: Array) -> Array:
    """Rigid motion of a small rotation (first three) and translation, shape (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(np.array(twist[:3])).as_matrix()
    out[:3, 3] = twist[3:]
    return out


@dataclass(frozen=True)
class _ParameterLayout:
    """Slices of the parameter vector.

    Attributes:
        letters: DH parameters.
        tool: Six of each target: rotation and translation in its own frame.
        frames: Six of each series: rotation and translation in F_b.
        compliance: One of each joint.
        payload: Four of each payload: mass and centre.
        yields: Parameters of the elastic elements.
        moments: Four of each link: mass and first moment; empty where no weight acts.
        laws: Amplitudes of the laws.
        knots: Values of the curves at their knots.
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
        """Number of parameters other than knots."""
        return int(self.knots.start)


def layout(mechanism: Mechanism) -> _ParameterLayout:
    """Layout of a mechanism's parameter vector."""
    sizes = (
        len(mechanism.values),
        6 * len(mechanism.tool),
        6 * len(mechanism.frames),
        len(mechanism.compliance),
        mechanism.payload.size,
        len(mechanism.yields),
        mechanism.moments.size if mechanism.loose else 0,
        len(mechanism.amplitudes),
        sum(curve.count for curve in mechanism.curves),
    )
    ends = np.cumsum([0, *sizes]).tolist()
    return _ParameterLayout(*(slice(a, b) for a, b in pairwise(ends)))


@dataclass(frozen=True, eq=False)
class Linear(Locked):
    """Linearised readings y = D x + Z e, six rows (x, y, z, rotations) of each target, F_b.

    Attributes:
        y: Reading minus mechanism [m], [rad], shape (m, 6 t); zero where not read.
        slopes: Computes some rows of D and Z, which a step that ends an iteration does not need.
        read: Mask of the rows that were read, shape (m, 6 t).
        inputs: Variables that the laws depend on.
        at: Positions of the targets according to the mechanism [m], F_b, shape (m, t, 3).
    """

    y: Array
    slopes: Callable[[Ints], tuple[Array, Array]]
    read: Bools
    inputs: Inputs
    at: Array

    @property
    def D(self) -> Array:
        """Derivatives by all parameters except the knots, shape (m, 6 t, dense)."""
        return self.spread(self._by_all[0])

    @cached_property
    def Z(self) -> Array:
        """Derivatives by the joint values and by motions of a bed that is not straight.

        Shape (m, 6 t, n or n + 6).
        """
        return self.spread(self._by_all[1])

    @cached_property
    def _by_all(self) -> tuple[Array, Array]:
        return self.slopes(self.used)

    @cached_property
    def used(self) -> Ints:
        """Indices of the rows that were read at any pose, shape (r,)."""
        return np.flatnonzero(self.read.any(axis=0))

    @cached_property
    def seen(self) -> tuple[Array, Array, Array, Bools]:
        """These rows of y (m, r), D (m, r, dense) and Z, and which were read (m, r)."""
        (D, Z), read = self._by_all, self.read[:, self.used]
        return self.y[:, self.used], D, Z, np.asarray(read, dtype=bool)

    @cached_property
    def pairs(self) -> Array:
        """Products of Z by pairs of these rows, a lower triangle each, (n, r (r + 1) / 2, m)."""
        Z = np.ascontiguousarray(np.moveaxis(self.seen[2], 0, 2).swapaxes(0, 1))
        i, j = np.tril_indices(Z.shape[1])
        return np.asarray(Z[:, i] * Z[:, j])

    def spread(self, left: Array) -> Array:
        """Values of these rows (m, r, ...), and zeros for all others, shape (m, 6 t, ...)."""
        out = np.zeros((len(left), self.read.shape[1], *left.shape[2:]))
        out[:, self.used] = left
        return out


class PlacedRobot(NamedTuple):
    """A deflected robot at m poses.

    Attributes:
        inputs: Variables that the laws depend on.
        bases: Functions of each law, (m, amplitudes) each.
        tau: Torque or force of weight and applied force on the joints, shape (m, n).
        balancer: Torque of a balancer on the joints [N m], shape (m, n).
        borne: Torque on each virtual joint, shape (m, v).
        bent: Configuration at which the torques are evaluated, deflected by the joints.
        here: Final configuration, without the elastic elements other than joints.
        yields: Virtual joints of the elastic elements.
        bed: Screws of a bed that is not straight, shape (m, 6, 6); None for a straight one.
        at: Positions of the targets [m], F_b, shape (m, t, 3).
        turn: Their orientations, shape (m, t, 3, 3).
    """

    inputs: Inputs
    bases: Sequence[Array]
    tau: Array
    balancer: Array
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
    """Positions of the targets by the mechanism and by the readings [m], F_b, both (m, t, 3)."""
    return _stand(readings, mechanism, weights).at, _seen(readings, mechanism)


def _stand(readings: PositionReadings, mechanism: Mechanism, weights: ArmWeights) -> PlacedRobot:
    when = _within(readings), readings.series.astype(float)
    return mechanism.stand(readings.q, weights, readings.temperature, *when)


def _seen(readings: PositionReadings, mechanism: Mechanism) -> Array:
    """Readings of the targets, transformed into F_b [m], (m, t, 3)."""
    own = mechanism.frames[readings.series]
    return np.einsum("mji,mtj->mti", own[:, :3, :3], readings.at - own[:, None, :3, 3])


def linearised(readings: PositionReadings, mechanism: Mechanism, weights: ArmWeights) -> Linear:
    """The readings linearised about a mechanism."""
    stand = _stand(readings, mechanism, weights)
    at, turn = stand.at, stand.turn
    own, seen_at = mechanism.frames[readings.series], _seen(readings, mechanism)
    turned = np.zeros(at.shape)
    if readings.six.any():
        seen_turn = np.swapaxes(own[:, None, :3, :3], 2, 3) @ readings.turn
        off = (seen_turn @ np.swapaxes(turn, 2, 3)).reshape(-1, 3, 3)
        turned = Rotation.from_matrix(off).as_rotvec().reshape(at.shape)
    y = np.concatenate([seen_at - at, turned], axis=2).reshape(len(readings), -1)
    read = readings.read
    y[~read] = 0.0
    return Linear(y, partial(_slopes, readings, mechanism, weights, stand), read, stand.inputs, at)


def _slopes(
    readings: PositionReadings,
    mechanism: Mechanism,
    weights: ArmWeights,
    stand: PlacedRobot,
    used: Ints,
) -> tuple[Array, Array]:
    """D and Z of `Linear`."""
    read = readings.read[:, used]
    D, Z = derivatives(mechanism, stand, weights, used)
    of = by_frame(stand.at)[:, used]
    for series in range(len(readings.names)):
        mine = readings.series == series
        D[mine, :, frame_of(mechanism, series)] = of[mine]
    if not read.all():
        D[~read], Z[~read] = 0.0, 0.0
    return D, Z


def derivatives(
    mechanism: Mechanism, stand: PlacedRobot, weights: ArmWeights, used: Ints | slice = slice(None)
) -> tuple[Array, Array]:
    """Derivatives of the targets by the parameters except frames and knots, and by joints and bed.

    Args:
        mechanism: The mechanism.
        stand: The same at m poses.
        weights: Gravity and payloads on the arm.
        used: Which r rows are wanted, all 6 t if not given.

    Returns:
        Shapes (m, r, dense), zero for frames, and (m, r, n) or, where the bed is not straight,
            (m, r, n + 6).
    """
    where, here, at = layout(mechanism), stand.here, stand.at
    rows = np.arange(6 * at.shape[1])[used]
    D = np.zeros((len(at), len(rows), where.dense))
    D[..., where.letters] = reach(twists(here, mechanism.letters), at)[:, used]
    D[..., where.tool] = _of_tool(at, stand.turn)[:, used]
    Z, yielding = reach(here.twists, at)[:, rows], reach(stand.yields.screws, at)[:, rows]
    turned = np.zeros(stand.tau.shape)  # by laws of gears, per unit of what a balancer turns
    if stand.balancer.any():
        turned = stand.yields.by_balancer(stand.borne, mechanism.yields) / mechanism.springs
        turned *= stand.balancer.any(axis=0)
    stiffer = turned * stand.balancer * (mechanism.compliance == mechanism.springs)
    D[..., where.compliance] = Z * (stand.tau - stiffer)[:, None, :]
    mass, centre = weights.at_poses(mechanism.payload)
    if len(mechanism.payload):
        torques = payload_torques(here, weights.gravity, mass, centre)
        hung = weights.by_payload(mechanism.compliance[:, None] * torques)
        D[..., where.payload] = Z @ hung
    amounts = stand.yields.answers(stand.borne)[:, None]
    of = stand.yields.parameter[:, None] == np.arange(len(mechanism.yields))
    D[..., where.yields] = (yielding * amounts) @ of.astype(float)
    if mechanism.loose:
        unit = by_moments(stand.bent, weights.gravity)
        joints = np.arange(1, mechanism.table.n + 1)
        own = mechanism.compliance[:, None] * carried_by(stand.bent.twists, joints, unit)
        softer = stand.yields.slopes(stand.borne) * mechanism.yields[stand.yields.parameter]
        more = (yielding * softer[:, None]) @ stand.yields.by_moments(unit)
        D[..., where.moments] = Z @ own + more
    if mechanism.laws:
        factor = [1 + law.by_balancer * turned[:, law.joint - 1, None] for law in mechanism.laws]
        g = [one * basis for one, basis in zip(factor, stand.bases, strict=True)]
        joint = np.repeat([law.joint - 1 for law in mechanism.laws], [one.shape[1] for one in g])
        np.multiply(Z[..., joint], np.hstack(g)[:, None], out=D[..., where.laws])
    if stand.bed is not None:
        Z = np.concatenate([Z, reach(stand.bed, at)[:, used]], axis=2)
    return D, Z


def _bed_screws(here: Configuration) -> Array:
    """Unit screws at the carriage along and about x, y, z of F_b, shape (m, 6, 6)."""
    origin, axes = here.origin[:, 0], np.broadcast_to(np.eye(3), (len(here.q), 3, 3))
    shifts = [translation_along(axes[:, k]) for k in range(3)]
    return np.stack([*shifts, *(rotation_about(origin, axes[:, k]) for k in range(3))], axis=1)


def _within(readings: PositionReadings) -> Array:
    """Position of each pose in its series, from 0 to 1, (m,)."""
    out = np.zeros(len(readings))
    for series in range(len(readings.names)):
        mine = np.flatnonzero(readings.series == series)
        out[mine] = np.linspace(0.0, 1.0, len(mine)) if len(mine) > 1 else 0.0
    return out


def _of_tool(at: Array, turn: Array) -> Array:
    """Derivatives by rotation and translation of each target in its own frame, (m, 6 t, 6 t)."""
    m, t = at.shape[:2]
    out = np.zeros((m, t, 6, t, 6))
    for k in range(t):
        out[:, k, :3, k, 3:] = turn[:, k]
        out[:, k, 3:, k, :3] = turn[:, k]
    return out.reshape(m, 6 * t, 6 * t)


def by_frame(at: Array) -> Array:
    """Derivatives by rotation and translation of the frame of a pose's series, (m, 6 t, 6)."""
    m, t = at.shape[:2]
    out = np.zeros((m, t, 6, 6))
    for axis, e in enumerate(np.eye(3)):
        out[:, :, :3, axis] = np.cross(e, at)
        out[:, :, 3 + axis, axis] = 1.0
        out[:, :, axis, 3 + axis] = 1.0
    return out.reshape(m, 6 * t, 6)


def frame_of(mechanism: Mechanism, series: int) -> slice:
    """Slice of a series' frame in the parameter vector."""
    first = layout(mechanism).frames.start + 6 * series
    return slice(first, first + 6)


def payload_torques(here: Configuration, gravity: Array, mass: Array, centre: Array) -> Array:
    """Derivatives of the torque of a payload's weight with respect to its mass and centre.

    With r = o + F c in F_b, tau_j = J_j(r)' m g: with respect to m it is J_j(r)' g, and to
    coordinate k of the centre w_j . (F e_k x m g), w_j the axis of a revolute joint.

    Args:
        here: The robot at m joint vectors.
        gravity: Acceleration in F_b [m/s^2], shape (3,).
        mass: Mass of the payload at each pose [kg], shape (m,).
        centre: Its centre of mass in the flange frame [m], shape (m, 3).

    Returns:
        By mass [N m/kg] and by the centre along x, y, z [N], shape (m, n, 4).
    """
    at = here.flange_origin + np.einsum("mij,mj->mi", here.flange_axes, centre)
    by_mass = torque(here.twists, at, np.broadcast_to(gravity, at.shape))
    pull = np.cross(np.swapaxes(here.flange_axes, 1, 2), (mass[:, None] * gravity)[:, None, :])
    by_centre = np.einsum("mji,mki->mjk", here.twists[..., :3], pull)
    return np.concatenate([by_mass[..., None], by_centre], axis=2)
