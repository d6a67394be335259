"""The arm hangs under its own weight, where the joint log does not see it.

Before the pull joint j stands off by c_j tau_g,j; under the pull the torque of gravity changes with
the deflection, which adds c_j sum_k G_jk c_k tau_k with G = d tau_g / dq.
"""

from typing import Any

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effects._anatomy import arm, turning
from pipeline.machine.effects._effect import Compound, Elastic, Geometry, Loaded, Pulls
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.configuration import torque

_WEIGHT_OF_1_KG = np.array([0.0, 0.0, -9.80665])


def effects(robot: Robot) -> tuple[Compound, ...]:
    """Two point masses, in the middles of upper arm and forearm, of a six-axis arm."""
    joints = arm(robot)
    if joints is None:
        return ()
    shoulder, elbow, wrist = joints
    first = turning(robot)[0]
    ends = ((shoulder, elbow), (elbow, wrist))
    chains = tuple(tuple(range(first, near + 1)) for near, _ in ends)
    said: dict[str, Any] = {
        "name": "gravity_sag",
        "noun": "sag under the arm's own weight",
        "place": "metrology",
        "shows_unloaded": True,
        "where": None,
        "parameters": (
            Parameter("m_upper_arm", "kg", 500.0, 0.0, 2000.0),
            Parameter("m_forearm", "kg", 400.0, 0.0, 2000.0),
        ),
        "signature": "the unloaded reflectors hang millimetres lower the further the arm reaches; "
        "the displacements hardly show it",
        "needs": "the unloaded absolute positions, in F_b, with the tool's coordinates known",
        "source": "stiffness of a loaded chain, K_C = d tau_g / dq; masses of the links are "
        "estimates",
    }

    def middle(configuration: Configuration, link: int) -> Array:
        near, far = ends[link]
        return np.asarray((configuration.frame(near)[1] + configuration.frame(far)[1]) / 2)

    def geometry(robot: Robot, pulls: Pulls, values: Array) -> Array:
        now = configure(robot, pulls.q)
        sag = np.zeros_like(pulls.q)
        for link, chain in enumerate(chains):
            at = [joint - 1 for joint in chain]
            weight = np.broadcast_to(values[link] * _WEIGHT_OF_1_KG, (len(sag), 3))
            sag[:, at] += torque(now.twists[:, at], middle(now, link), weight)
        return np.asarray(pulls.q + robot.nominal_compliance * sag)

    def screws(loaded: Loaded) -> Array:
        return loaded.configuration.twists[:, [j - 1 for chain in chains for j in chain]]

    def response(loaded: Loaded, tau: Array) -> Array:
        out, start = np.empty_like(tau), 0
        for link, chain in enumerate(chains):
            here = slice(start, start + len(chain))
            c = robot.nominal_compliance[[joint - 1 for joint in chain]]
            G = _stiffening(loaded.configuration, chain, middle(loaded.configuration, link))
            out[:, here] = c * np.einsum("mjk,k,mk->mj", G, c, tau[:, here])
            start += len(chain)
        return out

    elastic = Elastic(
        **said,
        carrier=tuple(joint for chain in chains for joint in chain),
        twists=screws,
        response=response,
        shared=tuple(link for link, chain in enumerate(chains) for _ in chain),
    )
    return (Compound(**said, acts=(Geometry(**said, geometry=geometry), elastic)),)


def _stiffening(configuration: Configuration, chain: tuple[int, ...], mass: Array) -> Array:
    """G = d tau_g / dq of 1 kg at r: F . (z_j x (z_k x (r - o_k))) for j <= k, (m, k, k)."""
    at = [joint - 1 for joint in chain]
    z, o = configuration.axes[..., 2][:, at], configuration.origin[:, at]
    inner = np.cross(z, mass[:, None] - o)
    full = np.cross(z[:, :, None], inner[:, None]) @ _WEIGHT_OF_1_KG
    upper = np.triu(full)
    return np.asarray(upper + np.swapaxes(np.triu(full, 1), 1, 2))
