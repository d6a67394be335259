"""Linear combinations of parameters that the data determine.

Parameters z are in their typical sizes; N is their information: the inverse of their covariance,
singular where the data cannot separate some of them. With P the members of a mix and Q all other
parameters,

    N_P = N_PP - N_PQ N_QQ^+ N_QP

is the information on the members whatever the others are; of all mixes w'z over P with w_j = 1 the
best determined has w = N_P e_j / (e_j' N_P e_j) and the variance 1 / (e_j' N_P e_j).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, Parameter
from pipeline.system.elimination import eliminate
from pipeline.system.estimate import identifiable
from pipeline.system.system import System
from pipeline.system.whiten import whitener

_KEPT = 0.1
"""Fraction of its information, per square of its size, that a mix must keep when members are
dropped [1]: half a digit of its value is a fair price for a mix of fewer joints."""


@dataclass(frozen=True, eq=False)
class Mix(Locked):
    """A combination that the data determine, of parameters that they do not determine singly.

    Attributes:
        of: Indices of its members, ascending, at least two, shape (m,).
        weights: Weight of each member; the largest is 1, shape (m,).
        value: Sum of weight times parameter, in the members' unit.
        std: Its standard uncertainty, in the same unit.
    """

    of: Ints
    weights: Array
    value: float
    std: float


def information(system: System, n: int, ratio: float = 1.0) -> Array:
    """Information N on the first n parameters in typical sizes, with the others free, (n, n).

    D B' V^-1 B D / `ratio`^2 with D the typical sizes, the other columns eliminated.

    Args:
        system: The system, its noise in metres.
        n: Number of parameters.
        ratio: Factor on the standard uncertainties of the system.
    """
    A = whitener(system.errors, system.rows.pose)(system.B * system.typical) / ratio
    N = A.T @ A
    return eliminate(N, np.arange(n, len(N)))[:n, :n]


def mixes(N: Array, parameters: Sequence[Parameter], value: Array, alone: Bools) -> tuple[Mix, ...]:
    """Every combination that the data determine of parameters that they do not determine singly.

    The best determined comes first. Each has a member that no later one has, so they are
    independent; as many members as possible are dropped (`_KEPT`). A mix counts as determined by
    the same rule as a parameter (`estimate.identifiable`), its typical size being the root of the
    sum of (weight times typical size)^2. Only parameters of one unit are mixed.

    Args:
        N: Information on the parameters in typical sizes, shape (n, n).
        parameters: Name, unit and typical size of each.
        value: Their estimates, SI; arbitrary where undetermined, shape (n,).
        alone: Parameters that are reported by themselves, shape (n,).
    """
    typical = np.array([p.typical for p in parameters])
    known = _Known.of(N, value / typical)
    units = [p.unit for p in parameters]
    mine = [np.array([unit == one for one in units]) & ~alone for unit in dict.fromkeys(units)]
    lines = [line for part in mine for line in known.lines(np.flatnonzero(part))]
    return tuple(_mix(line, typical, value) for line in lines if np.sum(line.w != 0) > 1)


def _mix(line: _Line, typical: Array, value: Array) -> Mix:
    """The mix in the parameters' own unit."""
    w = line.w / typical
    scale = w[np.argmax(np.abs(w))]
    of = np.flatnonzero(w)
    weights = w[of] / scale
    std = np.sqrt(line.variance) / abs(scale)
    return Mix(of, weights, float(weights @ value[of]), float(std))


@dataclass(frozen=True, eq=False)
class _Line(Locked):
    """A mix w'z of parameters in typical sizes, (n,), and its variance."""

    w: Array
    variance: float

    @property
    def loose(self) -> float:
        """Its variance over the square of its typical size."""
        return float(self.variance / (self.w @ self.w))


@dataclass(frozen=True, eq=False)
class _Known(Locked):
    """What is known of parameters z in typical sizes.

    Attributes:
        W: Their information, scaled to a unit diagonal, shape (n, n).
        size: Root of its diagonal; 0 where nothing is known, shape (n,).
        z: Estimates, shape (n,).
    """

    W: Array
    size: Array
    z: Array

    @classmethod
    def of(cls, N: Array, z: Array) -> _Known:
        """From information on z, shape (n, n)."""
        W, size = linear.unit(N)
        return cls(W, np.where(np.isfinite(size), size, 0.0), z)

    def lines(self, left: Ints) -> Iterator[_Line]:
        """Independent determined mixes of some parameters, the best determined first."""
        while True:
            first = [self.line(pivot, left) for pivot in left.tolist()]
            selected = [(line.loose, k) for k, line in enumerate(first) if self.tells(line)]
            if not selected:
                return
            _, k = min(selected)
            yield self.fewest(int(left[k]), left)
            left = np.delete(left, k)

    def line(self, pivot: int, members: Ints) -> _Line:
        """The best determined mix of some members in which the pivot has weight one."""
        rest = eliminate(self.W, np.setdiff1d(np.arange(len(self.W)), members))
        w, kept = np.zeros(len(self.W)), float(rest[pivot, pivot])
        if kept <= linear.ROUNDING_LEFT:
            w[pivot] = 1.0
            return _Line(w, np.inf)
        w[members] = rest[members, pivot] * self.size[members] / (kept * self.size[pivot])
        return _Line(w, 1 / (kept * self.size[pivot] ** 2))

    def tells(self, line: _Line) -> bool:
        """Whether the data determine a mix."""
        size = np.array([np.linalg.norm(line.w)])
        value, std = np.array([line.w @ self.z]), np.array([np.sqrt(line.variance)])
        return bool(identifiable(size, value, std)[0])

    def fewest(self, pivot: int, members: Ints) -> _Line:
        """The same mix with dispensable members dropped one after the other."""
        line = self.line(pivot, members)
        most = line.loose / _KEPT
        while True:
            gone = [np.delete(members, k) for k in np.flatnonzero(members != pivot)]
            tried = [(self.line(pivot, fewer), fewer) for fewer in gone]
            kept = [one for one in tried if one[0].loose <= most and self.tells(one[0])]
            if not kept:
                return line
            line, members = min(kept, key=lambda one: one[0].loose)
