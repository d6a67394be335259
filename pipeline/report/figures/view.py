"""Capsules as they are seen from aside and above, and their outlines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array

PITCH = np.deg2rad(22.0)
"""From how far above the robot is seen."""

FAR = 3.0
"""Distance of the eye over the size of the cell."""

FROM, TO = ([f"{end}_{a}_m" for a in "xyz"] for end in ("from", "to"))


@dataclass(frozen=True, eq=False)
class View:
    """Where the cell is seen from: the eye circles about its middle and keeps z upright.

    Attributes:
        middle: What it circles about [m], shape (3,).
        size: Radius of what is to be seen [m].
        yaw: Direction of the eye from x of F_b about z [rad].
    """

    middle: Array
    size: float
    yaw: float

    def __call__(self, points: Array) -> tuple[Array, Array, Array]:
        """Points in F_b [m], (..., 3), as seen: to the right, upwards, and scale by nearness."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        d = points - self.middle
        right = c * d[..., 1] - s * d[..., 0]
        ahead = -(c * d[..., 0] + s * d[..., 1])
        up = np.cos(PITCH) * d[..., 2] + np.sin(PITCH) * ahead
        depth = np.cos(PITCH) * ahead - np.sin(PITCH) * d[..., 2]
        scale = 1 / (1 + depth / (FAR * self.size))
        return scale * right, scale * up, scale


def outlines(view: View, rows: pd.DataFrame, radius: Array) -> tuple[Array, list[Array]]:
    """Nearness and outline of capsules: two circles and what lies between them."""
    x, y, scale = view(np.stack([rows[FROM].to_numpy(float), rows[TO].to_numpy(float)]))
    r = scale * radius
    along = np.arctan2(y[1] - y[0], x[1] - x[0])
    apart = np.maximum(np.hypot(x[1] - x[0], y[1] - y[0]), 1e-9)
    half = np.arccos(np.clip((r[0] - r[1]) / apart, -1, 1))
    turn = np.linspace(0, 1, 7)[:, None]
    back = along + half + turn * (2 * np.pi - 2 * half)
    front = along - half + turn * 2 * half
    parts = [
        np.stack([x[k] + r[k] * np.cos(angle), y[k] + r[k] * np.sin(angle)], axis=-1)
        for k, angle in ((0, back), (1, front))
    ]
    outline = np.concatenate(parts).transpose(1, 0, 2)
    return scale.mean(axis=0), list(outline)
