"""Absolute positions as an instrument read them, pose by pose."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings


@dataclass(frozen=True, eq=False)
class PositionReadings(Locked):
    """Targets on the effector, read at m poses in the frame of the instrument.

    The frame is set anew for each series. A target is a point, or a 6D target whose orientation is
    read too.

    Attributes:
        series: Series of each pose, 0..s-1, shape (m,).
        names: Names of the series, shape (s,).
        pose: Number of each pose in its series, shape (m,).
        file: Name of the file that has it, shape (m,).
        line: Its line there, shape (m,).
        q: Joint values of the controller [m] or [rad], shape (m, n).
        targets: Names of the targets, shape (t,).
        six: Targets whose orientation is read, shape (t,).
        at: Positions [m], NaN where a target was not read, shape (m, t, 3).
        turn: Orientations, columns x, y, z; the identity for a point, shape (m, t, 3, 3).
        payload: Payload of each pose, 0 for none, k + 1 for `payloads[k]`, shape (m,).
        payloads: Names of the payloads.
        temperature: Of the air [degC], NaN unknown, shape (m,).
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
        """Coordinates that were read, x, y, z and then rotations of each target, (m, 6 t)."""
        seen = np.isfinite(self.at).all(axis=2)
        both = np.stack([seen, seen & self.six], axis=2)
        return np.repeat(both, 3, axis=2).reshape(len(self), -1)

    def apart(self, pose: int) -> PositionReadings:
        """The same with another series from a pose of one on, behind that of the poses before."""
        old = int(self.series[pose])
        later = (self.series == old) & (np.arange(len(self)) >= pose)
        name = f"{self.names[old]} from pose {self.pose[pose]}".strip()
        return replace(
            self,
            series=self.series + ((self.series > old) | later),
            names=np.insert(self.names, old + 1, name),
        )

    def part(self, which: Ints | Bools) -> PositionReadings:
        """Some of the poses."""
        per_pose = ("series", "pose", "file", "line", "q", "at", "turn", "payload", "temperature")
        kept = {f.name: getattr(self, f.name)[which] for f in fields(self) if f.name in per_pose}
        return replace(self, **kept)
