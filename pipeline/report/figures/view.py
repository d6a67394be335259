"""Perspective view of capsules from an oblique direction above, and their outlines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array

PITCH = np.deg2rad(22.0)
"""Elevation of the viewing direction [rad]."""

_FAR = 3.0
"""Distance of the eye over the size of the cell [1]."""

FROM, TO = ([f"{end}_{a}_m" for a in "xyz"] for end in ("from", "to"))


@dataclass(frozen=True, eq=False)
class View:
    """A perspective view of the cell; the eye circles about its middle and z stays upright.

    Attributes:
        middle: Centre of the circle in F_b [m], shape (3,).
        size: Radius of the region to be shown [m].
        yaw: Direction of the eye, about z from x of F_b [rad].
    """

    middle: Array
    size: float
    yaw: float

    def __call__(self, points: Array) -> tuple[Array, Array, Array]:
        """Project points in F_b [m], shape (..., 3).

        Returns:
            Coordinates to the right and upwards [m], and the scale of the perspective [1], each of
            shape (...); the nearer a point, the larger its scale.
        """
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        d = points - self.middle
        right = c * d[..., 1] - s * d[..., 0]
        ahead = -(c * d[..., 0] + s * d[..., 1])
        up = np.cos(PITCH) * d[..., 2] + np.sin(PITCH) * ahead
        depth = np.cos(PITCH) * ahead - np.sin(PITCH) * d[..., 2]
        scale = 1 / (1 + depth / (_FAR * self.size))
        return scale * right, scale * up, scale


def outlines(view: View, rows: pd.DataFrame, radius: Array) -> tuple[Array, list[Array]]:
    """Outlines of projected capsules: two circular arcs and their common tangents.

    Args:
        view: The view.
        rows: Ends of the capsules' axes, one capsule per row.
        radius: Their radii [m], shape (c,).

    Returns:
        Mean scale of the perspective of each capsule, by which they are sorted, shape (c,), and
        its outline [m], shape (14, 2).
    """
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
