"""How controllers write poses: numbers to frames, and back to the nearest equivalent numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.base.arrays import Array
from pipeline.prediction.path import ARM_M

Form = Literal["abc", "wpr", "quaternion", "vector"]
"""Notation of orientations: A, B, C about z, y', x'' (KUKA); W, P, R about the fixed x, y, z
(FANUC), the same rotation in reverse order; quaternion, scalar first (ABB); rotation vector
(UR)."""

_LEVEL = 1e-9
"""Cosine of the angle about y below which the two other rotations are about one axis [1]."""
_REACH_M = 1.0
"""Distance of the tip from a joint's axis, order of magnitude [m]."""


@dataclass(frozen=True)
class Notation:
    """Units and notation of a program.

    Attributes:
        form: Notation of orientations.
        length: Unit of length [m].
        angle: Unit of angle [rad].
    """

    form: Form
    length: float = 1e-3
    angle: float = np.pi / 180.0

    @property
    def count(self) -> int:
        """Number of numbers of a pose."""
        return 7 if self.form == "quaternion" else 6

    @property
    def letters(self) -> str:
        """Names of the numbers of a pose."""
        return f"X,Y,Z,{_LETTERS[self.form]}"

    def frame(self, values: Sequence[float]) -> Array:
        """A pose as matrix [m], shape (4, 4), from its numbers.

        Raises:
            ValueError: A quaternion has zero length.
        """
        frame = np.eye(4)
        frame[:3, :3] = self._rotation(np.array(values[3:], float)).as_matrix()
        frame[:3, 3] = self.length * np.array(values[:3], float)
        return frame

    def _rotation(self, turn: Array) -> Rotation:
        if self.form == "quaternion":
            return Rotation.from_quat(turn[[1, 2, 3, 0]])
        if self.form == "vector":
            return Rotation.from_rotvec(self.angle * turn)
        return Rotation.from_euler("ZYX", self.angle * self._zyx(turn))

    def values(self, frame: Array, near: Sequence[float]) -> Array:
        """Numbers of a pose (4, 4); of all equivalent ones, those nearest to `near`."""
        turn, before = Rotation.from_matrix(frame[:3, :3]), np.array(near[3:], float)
        if self.form == "quaternion":
            found = turn.as_quat()[[3, 0, 1, 2]] * np.linalg.norm(before)
            found = found if found @ before >= 0 else -found
        elif self.form == "vector":
            found = _vector(turn.as_rotvec(), self.angle * before) / self.angle
        else:
            zyx = _angles(turn.as_matrix(), self.angle * self._zyx(before))
            found = self._zyx(zyx) / self.angle
        return np.concatenate([frame[:3, 3] / self.length, found])

    def _zyx(self, turn: Array) -> Array:
        return turn[::-1] if self.form == "wpr" else turn

    @property
    def worth_of_pose(self) -> Array:
        """Displacement of the tool per unit of each number of a pose [m], shape (6,) or (7,)."""
        turn = 2 * ARM_M if self.form == "quaternion" else self.angle * ARM_M
        return np.array([self.length] * 3 + [turn] * (self.count - 3))

    @property
    def worth_of_joint(self) -> float:
        """Displacement of the tip per unit of a joint's angle [m]."""
        return self.angle * _REACH_M


_LETTERS = {"abc": "A,B,C", "wpr": "W,P,R", "quaternion": "Q1,Q2,Q3,Q4", "vector": "RX,RY,RZ"}

KUKA = Notation("abc")
FANUC = Notation("wpr")
ABB = Notation("quaternion")
UR = Notation("vector", 1.0, 1.0)


def _angles(R: Array, near: Array) -> Array:
    """Angles about z, y', x'' [rad], nearest to others, shape (3,)."""
    level = float(np.hypot(R[0, 0], R[1, 0]))
    b = float(np.arctan2(-R[2, 0], level))
    if level < _LEVEL:  # a and c are about one axis: c is kept
        c = near[2]
        a = np.arctan2(-R[0, 1], R[1, 1]) + np.sign(b) * c
        return _whole_turns(np.array([a, b, c]), near)
    first = np.array([np.arctan2(R[1, 0], R[0, 0]), b, np.arctan2(R[2, 1], R[2, 2])])
    both = [first, np.array([first[0] + np.pi, np.pi - b, first[2] + np.pi])]
    return min((_whole_turns(one, near) for one in both), key=lambda x: float(abs(x - near).max()))


def _whole_turns(found: Array, near: Array) -> Array:
    return found - 2 * np.pi * np.round((found - near) / (2 * np.pi))


def _vector(found: Array, near: Array) -> Array:
    """Rotation vector of the same rotation that is nearest to another [rad], shape (3,)."""
    size = float(np.linalg.norm(found))
    if size < _LEVEL:
        return found
    axis = found / size
    turns = np.round((axis @ near - size) / (2 * np.pi))
    return np.asarray(axis * (size + 2 * np.pi * turns))
