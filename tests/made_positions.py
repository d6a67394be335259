"""Positions of a UR10 read by a tracker: a machine with wrong DH parameters, by distal DH."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.machine.robot import load
from pipeline.positions.mechanism import ArmWeights, Payloads
from pipeline.positions.readings import PositionReadings

ROBOT = load("ur10")
# UR10 from its maker's table (distal DH), and the weights of its links
D = [0.1273, 0.0, 0.0, 0.163941, 0.1157, 0.0922]
A = [0.0, -0.612, -0.5723, 0.0, 0.0, 0.0]
ALPHA = [np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0]
OFF_D = [0.0, 0.0, 0.0, 0.6e-3, -0.4e-3, 0.0]
OFF_A = [0.3e-3, 0.8e-3, -0.5e-3, 0.2e-3, 0.0, 0.0]
ZEROS = [0.0, 0.7e-3, -0.9e-3, 0.5e-3, 0.4e-3, 0.0]
TOOL = np.array([0.05, -0.02, 0.12])
TURN = Rotation.from_euler("xyz", [0.3, -0.2, 1.0]).as_matrix()
STATION = Rotation.from_euler("xyz", [0.1, 0.05, -2.0]).as_matrix(), np.array([2.0, -1.0, 0.4])


def stands(q, error):
    """Position and orientation of the target in the frame of the instrument, by distal DH."""
    places, turns = [], []
    for row in q + error + np.array(ZEROS):
        T = np.eye(4)
        for theta, d, a, alpha in zip(row, np.add(D, OFF_D), np.add(A, OFF_A), ALPHA, strict=True):
            c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
            T = T @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s],
                              [0, sa, ca, d], [0, 0, 0, 1]])  # fmt: skip
        R, t = STATION
        places.append(R @ (T[:3, :3] @ TOOL + T[:3, 3]) + t)
        turns.append(R @ T[:3, :3] @ TURN)
    return np.array(places), np.array(turns)


def made(m, rng, law=lambda q: 0.0 * q, joint=1e-5, noise=1e-5):
    """Readings of m poses of a machine with wrong DH parameters and a law of its joints."""
    q = rng.uniform([-3, -2.4, -2.2, -3, -2.5, -2.5], [3, 0.1, 2.2, 3, 2.5, 2.5], (m, 6))
    at, turn = stands(q, law(q) + joint * rng.standard_normal(q.shape))
    at = at + noise * rng.standard_normal(at.shape)
    turn = Rotation.from_rotvec(noise * rng.standard_normal(at.shape)).as_matrix() @ turn
    number = np.arange(m)
    return PositionReadings(
        series=np.zeros(m, dtype=np.int64),
        names=np.array([""], dtype=object),
        pose=number,
        file=np.full(m, "poses.csv", dtype=object),
        line=number + 2,
        q=q,
        targets=np.array(["T"], dtype=object),
        six=np.array([True]),
        at=at[:, None],
        turn=turn[:, None],
        payload=np.zeros(m, dtype=np.int64),
        payloads=np.array(["tool"], dtype=object),
        temperature=np.full(m, np.nan),
    )


def weightless(m):
    tool = Payloads(("tool",), np.array([2.5]), np.array([[0.0, 0.0, 0.03]]), np.zeros((1, 4)))
    return ArmWeights(np.zeros(3), tool, np.zeros(m, dtype=np.int64))


def read(m=60, seed=1, noise=2e-5, targets=1, joint=1e-5):
    """Points on the effector of a machine computed by other formulas."""
    rng = np.random.default_rng(seed)
    readings = made(m, rng, noise=0.0)
    at, turn = stands(readings.q, joint * rng.standard_normal(readings.q.shape))
    axes = turn @ TURN.T
    points = np.array([TOOL, TOOL + np.array([0.1, 0, 0]), TOOL + np.array([0, 0.15, 0.05])])[
        :targets
    ]
    every = at[:, None] + np.einsum("mij,tj->mti", axes, points - TOOL)
    every += noise * rng.standard_normal(every.shape)
    return replace(
        readings,
        targets=np.array(list("ABC")[:targets], dtype=object),
        six=np.zeros(targets, dtype=bool),
        at=every,
        turn=np.tile(np.eye(3), (m, targets, 1, 1)),
    )
