"""Absolute positions as read by an instrument, pose by pose."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings


@dataclass(frozen=True, eq=False)
class PositionReadings(Locked):
    """Targets on the effector, read at m poses in the frame of the instrument.

    Each series has its own instrument frame. A target is a point, or a 6D target whose orientation
    is read too.

    Attributes:
        series: Series of each pose, 0..s-1, shape (m,).
        names: Names of the series, shape (s,).
        pose: Number of each pose in its series, shape (m,).
        file: File of each pose, shape (m,).
        line: Its line in that file, shape (m,).
        q: Joint values of the controller [m] or [rad], shape (m, n).
        targets: Names of the targets, shape (t,).
        six: Targets whose orientation is read, shape (t,).
        at: Positions [m], NaN where a target was not read, shape (m, t, 3).
        turn: Orientations, columns x, y, z; the identity for a point, shape (m, t, 3, 3).
        payload: Payload of each pose, 0 for none, k + 1 for `payloads[k]`, shape (m,).
        payloads: Names of the payloads.
        temperature: Air temperature [degC], NaN where unknown, shape (m,).
    """

    series: Ints
    names: Strings
    pose: Ints
    file: Strings
    line: Ints
    q: Array
    targets: Strings
    six: Bools
    at: Array
    turn: Array
    payload: Ints
    payloads: Strings
    temperature: Array

    def __len__(self) -> int:
        """Number of poses m."""
        return len(self.q)

    @cached_property
    def read(self) -> Bools:
        """Coordinates that were read: x, y, z, then rotations of each target, (m, 6 t)."""
        seen = np.isfinite(self.at).all(axis=2)
        both = np.stack([seen, seen & self.six], axis=2)
        return np.repeat(both, 3, axis=2).reshape(len(self), -1)

    def apart(self, pose: int) -> PositionReadings:
        """The readings with the poses of a series from `pose` on as a series of their own."""
        old = int(self.series[pose])
        later = (self.series == old) & (np.arange(len(self)) >= pose)
        name = f"{self.names[old]} from pose {self.pose[pose]}".strip()
        return replace(
            self,
            series=self.series + ((self.series > old) | later),
            names=np.insert(self.names, old + 1, name),
        )

    def part(self, which: Ints | Bools) -> PositionReadings:
        """The readings of the selected poses."""
        per_pose = ("series", "pose", "file", "line", "q", "at", "turn", "payload", "temperature")
        kept = {f.name: getattr(self, f.name)[which] for f in fields(self) if f.name in per_pose}
        return replace(self, **kept)
