"""Least squares of the DH parameters, positions alone: numpy and scipy, nothing of the package."""

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.peers import arm as arms
from bench.peers.judge import laid

STEPS, WIDTH, UNSEEN = 8, 1e-6, 1e-4
"""Number of steps; half step of a central difference [m or rad]; fraction of the largest singular
value below which one counts as zero."""


def told(arm: arms.Arm, x: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Position of the target in the frame of the instrument [m], shape (m, 3).

    Args:
        arm: Arm with its nominal table.
        x: Rotation vector and position of the base, position of the target in the flange frame, and
            additions to the table, shape (9 + 4 n,).
        q: Joint values [rad], shape (m, n).
    """
    T = arms.frames(arm.table + x[9:].reshape(-1, 4), arm.slides, q)[:, -1]
    at = T[:, :3, :3] @ x[6:9] + T[:, :3, 3]
    return Rotation.from_rotvec(x[:3]).apply(at) + x[3:6]


def calibrated(arm: arms.Arm, q: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Parameters that minimise sum |told - seen|^2, by Gauss-Newton.

    Some combinations of the parameters move no target, others hardly any (base and first joint,
    joints with parallel axes): each step is the shortest one with columns of unit length, without
    combinations below `UNSEEN`.
    """
    x = np.zeros(9 + 4 * len(arm.table))
    turn, shift = laid(told(arm, x, q), seen)
    x[:3], x[3:6] = Rotation.from_matrix(turn).as_rotvec(), shift
    for _ in range(STEPS):
        moved = (told(arm, x + one, q) - told(arm, x - one, q) for one in WIDTH * np.eye(len(x)))
        J = np.stack([one.ravel() for one in moved], axis=1) / (2 * WIDTH)
        size = np.maximum(np.linalg.norm(J, axis=0), WIDTH)  # a target on the last axis stays
        left = (seen - told(arm, x, q)).ravel()
        x = x + np.linalg.lstsq(J / size, left, rcond=UNSEEN)[0] / size
    return x


def columns(path: Path, arm: arms.Arm) -> tuple[np.ndarray, np.ndarray]:
    """Joint values [rad] (m, n) and positions [m] (m, 3) of train.csv or test.csv."""
    rows = np.genfromtxt(path, delimiter=",", names=True)
    q = np.column_stack([rows[name] for name in arm.axes])
    return q, np.column_stack([rows[name] for name in ("x1", "y1", "z1")])


def main(robot: str, folder: str) -> None:
    """Calibrate with train.csv and predict test.csv of a folder."""
    arm, here = arms.read(Path(robot)), Path(folder)
    q, seen = columns(here / "train.csv", arm)
    there, _ = columns(here / "test.csv", arm)
    np.savetxt(here / "dh.csv", told(arm, calibrated(arm, q, seen), there), delimiter=",")


if __name__ == "__main__":
    main(*sys.argv[1:])
