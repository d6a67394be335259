"""Absolute positions as read by an instrument, pose by pose."""

from __future__ import annotations

from collections.abc import Sequence
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

    def apart(self, pose: int, targets: Sequence[int] = ()) -> PositionReadings:
        """The readings with targets, or else a series, from `pose` on as ones of their own."""
        since = np.arange(len(self)) >= pose
        from_pose = f" from pose {self.pose[pose]}"
        if targets:
            every = np.arange(len(self.targets))
            twice = np.repeat(every, 1 + np.isin(every, targets))
            new = np.flatnonzero(np.diff(twice, prepend=-1) == 0)
            at, names = self.at[:, twice], self.targets[twice]
            at[np.ix_(since, new - 1)] = at[np.ix_(~since, new)] = np.nan
            names[new] += from_pose
            turn = self.turn[:, twice]
            return replace(self, targets=names, six=self.six[twice], at=at, turn=turn)
        old = int(self.series[pose])
        later = (self.series == old) & since
        name = f"{self.names[old]}{from_pose}".strip()
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
