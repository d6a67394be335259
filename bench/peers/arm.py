"""The DH table of an arm from its robot file, read with tomllib alone, and its frames."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Arm:
    """A modified DH table: Rx(alpha) Tx(a) Rz(theta) Tz(d), with a joint value added to theta or d.

    Attributes:
        name: Name of the robot.
        table: alpha [rad], a [m], theta [rad], d [m], shape (n, 4).
        slides: Which joints are prismatic, shape (n,).
        axes: Names of the controller's axes.
        by_axis: Joint values per axis, shape (n, k).
        offset: Joint values where all axes are 0 [m] or [rad], shape (n,).
        rows: The joints of the robot file, with masses and limits.
    """

    name: str
    table: np.ndarray
    slides: np.ndarray
    axes: tuple[str, ...]
    by_axis: np.ndarray
    offset: np.ndarray
    rows: tuple[dict, ...]


def read(path: Path) -> Arm:
    """Read an arm from a robot file in Craig's letters (a, d) or Khalil's (d, r)."""
    said = tomllib.loads(path.read_text("utf-8"))
    x, z = {"craig": ("a_m", "d_m"), "khalil": ("d_m", "r_m")}[said["convention"]]
    table = [
        [np.deg2rad(row["alpha_deg"]), row.get(x, 0), np.deg2rad(row.get("theta_deg", 0)),
         row.get(z, 0)]
        for row in said["joint"]
    ]  # fmt: skip
    return Arm(
        said["name"],
        np.array(table, dtype=float),
        np.array([row["type"] == "prismatic" for row in said["joint"]]),
        tuple(said["controller"]["axes"]),
        np.array(said["controller"]["matrix"], dtype=float),
        np.deg2rad(said["controller"].get("offset_deg", np.zeros(len(table)))),
        tuple(said["joint"]),
    )


def frames(table: np.ndarray, slides: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Frame of every joint in the base frame, shape (m, n, 4, 4); the last is the flange.

    Args:
        table: As in `Arm`.
        slides: As in `Arm`.
        q: Joint values [m] or [rad], shape (m, n).
    """
    T = np.tile(np.eye(4), (len(q), 1, 1))
    out = np.empty((len(q), len(table), 4, 4))
    for j, (alpha, a, theta, d) in enumerate(table):
        turn = theta + (0 if slides[j] else q[:, j])
        shift = d + (q[:, j] if slides[j] else np.zeros(len(q)))
        step = np.zeros((len(q), 4, 4))
        c, s, ca, sa = np.cos(turn), np.sin(turn), np.cos(alpha), np.sin(alpha)
        step[:, 0, 0], step[:, 0, 1], step[:, 0, 3] = c, -s, a
        step[:, 1, 0], step[:, 1, 1], step[:, 1, 2], step[:, 1, 3] = (
            s * ca,
            c * ca,
            -sa,
            -shift * sa,
        )
        step[:, 2, 0], step[:, 2, 1], step[:, 2, 2], step[:, 2, 3] = s * sa, c * sa, ca, shift * ca
        step[:, 3, 3] = 1
        T = T @ step
        out[:, j] = T
    return out
