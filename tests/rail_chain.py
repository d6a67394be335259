"""The chain of the KR500 on its rail, multiplied by hand, with some DH errors."""

import numpy as np

from pipeline.machine.robot import load
from pipeline.machine.robot.dh_parameters import dh_parameters

LETTERS = dh_parameters(load("kr500_rail"))
POINTS = np.array([[0.20, 0.05, 0.12], [-0.12, 0.19, 0.10], [-0.10, -0.18, 0.22]])
ALPHA = np.deg2rad([-90, 90, 90, 0, 90, -90, 90])
D = [0, 0, 0.5, 1.3, 0.055, 0, 0]
R = [0, 1.048, 0, 0, 1.525, 0, 0.29]
AT = {"link_twist": 0, "link_length": 1, "axis_tilt": 2, "joint_offset": 3, "link_offset": 4}


def step(kind, axis, size):
    """Rotation or translation about or along x, y, z."""
    T = np.eye(4)
    if kind == "T":
        T[axis, 3] = size
        return T
    a, b = (axis + 1) % 3, (axis + 2) % 3
    T[a, a] = T[b, b] = np.cos(size)
    T[b, a], T[a, b] = np.sin(size), -np.sin(size)
    return T


def stands(q, wrong=None, points=POINTS):
    """Positions of three reflectors for a robot with some DH errors, shape (p, 3, 3)."""
    out = []
    entries = np.zeros((7, 5))
    for label, size in (wrong or {}).items():
        name, _, joint = label.partition(":")
        entries[int(joint) - 1, 3 if name == "link_turn" else AT[name]] += size
    for row in q:
        T = np.eye(4)
        for j in range(7):
            alpha, d, beta, theta, r = entries[j] + [ALPHA[j], D[j], 0, 0, R[j]]
            theta, r = (theta, r + row[j]) if j == 0 else (theta + row[j], r)
            T = T @ step("R", 0, alpha) @ step("T", 0, d) @ step("R", 1, beta)
            T = T @ step("R", 2, theta) @ step("T", 2, r)
        out.append(points @ T[:3, :3].T + T[:3, 3])
    return np.array(out)
