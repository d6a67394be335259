"""Positions of a UR10 one of whose reflectors moved on the effector, by distal DH."""

from dataclasses import replace

import numpy as np
from made_positions import TOOL, TURN, made, stands, weightless

BESIDE = [[0.0, 0.0, 0.0], [0.15, 0.0, 0.0], [0.0, 0.12, 0.02]]


def moved(at, by, targets=1, which=0, pose=70, poses=160, noise=1e-5, seed=3):
    """Readings and weights; a target at `at` [m], others beside it, moved `by` [m] from a pose on.

    Joints err by 10 urad from pose to pose.
    """
    rng = np.random.default_rng(seed)
    readings = made(poses, rng, noise=0.0)
    places, turns = stands(readings.q, 1e-5 * rng.standard_normal(readings.q.shape))
    axes = turns @ TURN.T
    points = np.tile(np.add(at, BESIDE[:targets]) - TOOL, (poses, 1, 1))
    points[pose:, which] += by
    read = places[:, None] + np.einsum("mij,mtj->mti", axes, points)
    read += noise * rng.standard_normal(read.shape)
    return replace(
        readings,
        targets=np.array(list("ABC")[:targets], dtype=object),
        six=np.zeros(targets, dtype=bool),
        at=read,
        turn=np.tile(np.eye(3), (poses, targets, 1, 1)),
    ), weightless(poses)
