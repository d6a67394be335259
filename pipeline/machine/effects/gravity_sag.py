"""The arm sags under its own weight, unseen by the joint log.

Before the pull joint j is displaced by c_j tau_g,j; under the pull the torque of gravity changes
with the deflection, which adds c_j sum_k G_jk c_k tau_k with G = d tau_g / dq.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Compound, Elastic, Geometry, Loaded, Pulls
from pipeline.machine.effects._anatomy import arm, turning
from pipeline.machine.effects.table import NEEDS
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.configuration import torque
from pipeline.machine.robot.rating import relative


def effects(robot: Robot) -> tuple[Compound, ...]:
    """Two point masses, at the middle of upper arm and forearm, of a six-axis arm."""
    joints = arm(robot)
    if joints is None:
        return ()
    shoulder, elbow, wrist = joints
    first = turning(robot)[0]
    upper = _Link(robot, shoulder, elbow, tuple(range(first, shoulder + 1)))
    masses = _Masses((upper, _Link(robot, elbow, wrist, tuple(range(first, elbow + 1)))))
    common = described(relative(robot))
    elastic = Elastic(
        **common,
        carrier=tuple(joint for link in masses.links for joint in link.chain),
        response=masses.response,
        shared=tuple(k for k, link in enumerate(masses.links) for _ in link.chain),
    )
    return (Compound(**common, acts=(Geometry(**common, geometry=masses.geometry), elastic)),)


def described(size: float) -> dict[str, Any]:
    """Description with link masses of the KR500, scaled by `size` for robots of another payload."""
    return {
        "name": "gravity_sag",
        "noun": "sag under the arm's own weight",
        "place": "metrology",
        "shows_unloaded": True,
        "parameters": (
            Parameter(
                *("m_upper_arm", "kg", 500.0 * size, 0.0, 2000.0 * size),
                "mass that sags the upper arm",
            ),
            Parameter(
                *("m_forearm", "kg", 400.0 * size, 0.0, 2000.0 * size), "mass that sags the forearm"
            ),
        ),
        "signature": "the unloaded reflectors hang millimetres lower the further the arm reaches; "
        "the displacements hardly show it",
        "needs": NEEDS,
        "source": "stiffness of a loaded chain, K_C = d tau_g / dq; masses of the links are "
        "estimates",
    }


@dataclass(frozen=True)
class _Link:
    """A point mass at the middle of a link.

    Attributes:
        robot: Robot that it is part of.
        near: Joint at which the link begins, counted from 1.
        far: Joint at which it ends.
        chain: Joints that carry it.
    """

    robot: Robot
    near: int
    far: int
    chain: tuple[int, ...]

    @property
    def at(self) -> list[int]:
        """Array indices of the joints of the chain."""
        return [joint - 1 for joint in self.chain]

    @property
    def c(self) -> Array:
        """Nominal compliances of the chain, shape (k,)."""
        return self.robot.nominal_compliance[self.at]

    def middle(self, configuration: Configuration) -> Array:
        """Position of the mass in F_b [m], shape (m, 3)."""
        ends = (configuration.frame(joint)[1] for joint in (self.near, self.far))
        return np.asarray(sum(ends) / 2)

    def torque(self, configuration: Configuration, mass: float) -> Array:
        """Torques of the weight about the joints of the chain [N m], shape (m, k)."""
        weight = np.broadcast_to(mass * self.robot.gravity, (len(configuration.twists), 3))
        return torque(configuration.twists[:, self.at], self.middle(configuration), weight)

    def stiffening(self, configuration: Configuration) -> Array:
        """G = d tau_g / dq of 1 kg at r: F . (z_j x (z_k x (r - o_k))) for j <= k, (m, k, k)."""
        z, o = configuration.axes[..., 2][:, self.at], configuration.origin[:, self.at]
        inner = np.cross(z, self.middle(configuration)[:, None] - o)
        full = np.cross(z[:, :, None], inner[:, None]) @ self.robot.gravity
        return np.asarray(np.triu(full) + np.swapaxes(np.triu(full, 1), 1, 2))


@dataclass(frozen=True)
class _Masses:
    """Combined effect of all point masses; joints are ordered link by link."""

    links: tuple[_Link, ...]

    def geometry(self, robot: Robot, pulls: Pulls, values: Array) -> Array:
        """Joint values under the weights, before any pull [m] or [rad], shape (m, n)."""
        now = configure(robot, pulls.q)
        sag = np.zeros_like(pulls.q)
        for link, mass in zip(self.links, values, strict=True):
            sag[:, link.at] += link.torque(now, mass)
        return np.asarray(pulls.q + robot.nominal_compliance * sag)

    def response(self, loaded: Loaded, tau: Array) -> Array:
        """Additional rotation of each joint per 1 kg, as the pull deflects the others."""
        ends = np.cumsum([len(link.chain) for link in self.links])[:-1]
        parts = zip(self.links, np.split(tau, ends, axis=1), strict=True)
        turned = [
            link.c * np.einsum("mjk,k,mk->mj", link.stiffening(loaded.configuration), link.c, own)
            for link, own in parts
        ]
        return np.concatenate(turned, axis=1)
