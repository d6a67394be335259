"""A machine tool's arm on a rail, heavy and crooked, from Pinocchio alone.

A tree of joints: after the rail six small motions by which the bed is crooked and six by which the
carriage yields, after each of the first three revolute joints two by which its bearing tilts.
Everything that carries weight deflects until equilibrium.
"""

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from pipeline.positions.readings import PositionReadings

MASS = np.array([900.0, 700.0, 480.0, 420.0, 90.0, 60.0, 25.0])
CENTRE = np.array([
    [0.05, -0.2, 0.02], [0.12, 0.05, -0.25], [0.55, 0.03, 0.06], [-0.1, 0.25, 0.05],
    [0.0, 0.02, -0.35], [0.0, -0.05, 0.02], [0.0, 0.0, -0.1]])  # fmt: skip
SMALL = {"rx": pin.JointModelRX, "ry": pin.JointModelRY, "rz": pin.JointModelRZ,
         "x": pin.JointModelPX, "y": pin.JointModelPY, "z": pin.JointModelPZ}  # fmt: skip


@dataclass
class Truth:
    """True errors of a machine; compliances [rad/(N m)], [m/N]."""

    joints: np.ndarray
    tilt: dict = field(default_factory=dict)  # joint 2..4 -> about x, y of its frame
    carriage: dict = field(default_factory=dict)  # of SMALL, in axes of the rail's frame -> number
    rail: object = None  # q1 -> six motions x y z rx ry rz of the carriage, (m, 6)
    balancer: object = None  # angle of joint 3 -> torque on it [N m]
    turned: object = None  # q, weight's torque (m, 7) -> joint errors (m, 7)
    mass: np.ndarray = field(default_factory=lambda: MASS)
    centre: np.ndarray = field(default_factory=lambda: CENTRE)


def errors_of_table(n, rng, length=4e-4, angle=4e-4):
    """A small motion of each link, (n, 6)."""
    return rng.standard_normal((n, 6)) * ([length] * 3 + [angle] * 3)


class HeavyRobot:
    """The machine: its nominal robot, the error of each link, and its true errors."""

    def __init__(self, robot, off, truth):
        self.robot, self.truth = robot, truth
        self.model, self.own, self.small = pin.Model(), [], []
        self.model.gravity.linear = np.array([0.0, 0.0, -9.80665])
        parent = 0
        for j, joint in enumerate(robot.joints):
            placed = pin.SE3(robot.placement[j]) * pin.exp6(off[j])
            kind = pin.JointModelPZ() if joint.prismatic else pin.JointModelRZ()
            parent = self._joint(parent, kind, placed, self.own)
            if j == 0:
                for which in ("bed", "carriage"):
                    for name in ("x", "y", "z", "rx", "ry", "rz"):
                        parent = self._joint(parent, SMALL[name](), pin.SE3.Identity(), self.small,
                                             (which, name))  # fmt: skip
            elif j + 1 in truth.tilt:
                for name in ("rx", "ry"):
                    parent = self._joint(parent, SMALL[name](), pin.SE3.Identity(), self.small,
                                         ("tilt", j + 1, name))  # fmt: skip
            body = pin.Inertia(truth.mass[j], truth.centre[j], np.eye(3))
            self.model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        end = pin.SE3(robot.flange) * pin.exp6(off[-1])
        self.end = self.model.addFrame(pin.Frame("flange", parent, 0, end, pin.FrameType.OP_FRAME))
        self.data = self.model.createData()

    def _joint(self, parent, kind, placed, kept, name=None):
        joint = self.model.addJoint(parent, kind, placed, f"{len(self.model.names)}")
        kept.append((joint - 1, name))
        return joint

    def flange(self, q, pull=None):
        """Where the flange is at commanded joint values (n,), 4 x 4.

        Under a pull of some size [N] at a point of the flange frame [m] to an anchor in F_b [m].
        """
        t, x = self.truth, np.zeros(self.model.nv)
        own = [k for k, _ in self.own]
        bed = np.zeros(6) if t.rail is None else t.rail(q[0])
        for _ in range(12):
            weight = -pin.computeGeneralizedGravity(self.model, self.data, x)
            if pull is not None:
                weight = weight + self._pulled(x, *pull)
            tau = weight[own]
            if t.balancer is not None:
                tau = tau.copy()
                tau[2] += t.balancer(q[2])
            new = np.zeros_like(x)
            new[own] = q + t.joints * tau
            if t.turned is not None:
                new[own] += t.turned(q, tau)
            for k, name in self.small:
                if name[0] == "bed":
                    new[k] = bed[("x", "y", "z", "rx", "ry", "rz").index(name[1])]
                elif name[0] == "carriage":
                    new[k] = t.carriage.get(name[1], 0.0) * weight[k]
                else:
                    new[k] = t.tilt[name[1]][int(name[2] == "ry")] * weight[k]
            x = new
        pin.framesForwardKinematics(self.model, self.data, x)
        return self.data.oMf[self.end].homogeneous

    def _pulled(self, x, size, tip, anchor):
        """Torques of a chain from a point of the flange to its anchor, (nv,)."""
        J = pin.computeFrameJacobian(self.model, self.data, x, self.end, pin.LOCAL_WORLD_ALIGNED)
        pin.updateFramePlacements(self.model, self.data)
        flange = self.data.oMf[self.end]
        along = anchor - flange.act(tip)
        force = size * along / np.linalg.norm(along)
        return J[:3].T @ force + J[3:].T @ np.cross(flange.rotation @ tip, force)


TOOL = np.array([[0.25, 0.1, 0.12], [-0.15, 0.24, 0.2], [-0.1, -0.22, 0.05]])


def poses(rng, stations, each, robot):
    """Commanded joint values, by station along six metres, (m, n)."""
    low = np.array([-60, 0, -30, -120, -100, -170]) * np.pi / 180
    high = np.array([60, 80, 60, 120, 100, 170]) * np.pi / 180
    q = rng.uniform(low, high, (stations * each, 6))
    along = np.repeat(np.linspace(0.5, 6.5, stations), each)
    return np.column_stack([along, q])


def read(machine, q, rng, noise=1e-5, joint=1e-5, station=None):
    """Readings of three reflectors at commanded joint values, by a tracker at some position."""
    turned = q + joint * rng.standard_normal(q.shape) * ~machine.robot.prismatic
    flange = np.stack([machine.flange(one) for one in turned])
    at = np.einsum("mij,tj->mti", flange[:, :3, :3], TOOL) + flange[:, None, :3, 3]
    R, t = station or (pin.exp3(np.array([0.1, -0.05, 2.0])), np.array([3.0, -4.0, 0.6]))
    at = at @ R.T + t + noise * rng.standard_normal(at.shape)
    return of_three(q, at)


def of_three(q, at):
    """Readings of three reflectors in one series, one line for each pose, at (m, 3, 3)."""
    m = len(q)
    return PositionReadings(
        series=np.zeros(m, dtype=np.int64),
        names=np.array([""], dtype=object),
        pose=np.arange(1, m + 1),
        file=np.full(m, "poses.csv", dtype=object),
        line=np.arange(2, m + 2),
        q=q,
        targets=np.array(["P1", "P2", "P3"], dtype=object),
        six=np.zeros(3, dtype=bool),
        at=at,
        turn=np.tile(np.eye(3), (m, 3, 1, 1)),
        payload=np.zeros(m, dtype=np.int64),
        payloads=np.array([], dtype=object),
        temperature=np.full(m, np.nan),
    )


def waves(rng, range_m, sizes):
    """A crooked bed: three smooth waves in each of six motions, with these rms sizes (6,)."""
    period = rng.uniform(0.6, 3.0, (3, 6)) * range_m / 2
    phase, high = rng.uniform(0, 2 * np.pi, (2, 3, 6))
    high = np.sin(high) + 1.2
    scale = np.asarray(sizes) / np.sqrt(np.sum(high**2, axis=0) / 2)

    def rail(along):
        return np.sum(high * np.sin(2 * np.pi * along / period + phase), axis=0) * scale

    return rail
