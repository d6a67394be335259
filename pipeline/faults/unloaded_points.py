"""The unloaded readings of a campaign as arrays, and what a supposed mistake does to them.

A search among hundreds of mistakes corrects these instead of the tables of the campaign; each
correction here moves the points as its namesake in `conventions` does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings
from pipeline.base.linear import rigid
from pipeline.machine.robot import Robot, configure
from pipeline.reduction.register import agreeing
from pipeline.reduction.settings import Point

_BASE = 3
"""Minimum number of base reflectors that determine a frame."""


@dataclass(frozen=True, eq=False)
class UnloadedPoints(Locked):
    """The unloaded readings of a campaign, and everything that places them by the robot's table.

    Attributes:
        seen: Readings of the measured targets [m], tracker's frame, shape (n, 3).
        state: Index of their group, shape (n,).
        target: Index of their target in `measured`, shape (n,).
        at: Row of `q` of their pose, shape (n,).
        q: Joint values of the poses [m] or [rad], shape (p, joints).
        robot: The robot.
        measured: Names of the targets.
        tool: Their places in the flange frame [m], shape (t, 3).
        base: Readings without a pose [m], tracker's frame, shape (b, 3).
        names: Their targets, shape (b,).
        nominal: [base_frame], the base reflectors in F_b [m].
    """

    seen: Array
    state: Ints
    target: Ints
    at: Ints
    q: Array
    robot: Robot
    measured: tuple[str, ...]
    tool: Array
    base: Array
    names: Strings
    nominal: Mapping[str, Point]

    @property
    def expected(self) -> Array:
        """Places of the readings by the table [m], F_b, shape (n, 3)."""
        return configure(self.robot, self.q).points(self.tool)[self.at, self.target]

    @property
    def frame(self) -> tuple[Array, Array] | None:
        """R, t that transform readings into F_b by the base reflectors."""
        return by_base(self.base, self.names, self.nominal)


def by_base(
    seen: Array, names: Strings, nominal: Mapping[str, Point]
) -> tuple[Array, Array] | None:
    """R, t that transform readings into F_b by the base reflectors, None with fewer than three.

    Without [base_frame] the readings are taken to be in F_b.

    Args:
        seen: Readings without a pose [m], tracker's frame, shape (b, 3).
        names: Their targets, shape (b,).
        nominal: The base reflectors in F_b [m].
    """
    if not nominal:
        return np.eye(3), np.zeros(3)
    base = np.array([name in nominal for name in names], bool)
    reflector, known = pd.factorize(names[base])
    if len(known) < _BASE:
        return None
    points, seen = np.array([nominal[name] for name in known])[reflector], seen[base]
    kept = _not_alone(agreeing(seen, points), reflector)
    return rigid(seen[kept], points[kept])


def _not_alone(agree: Bools, reflector: Ints) -> Bools:
    """Mask without readings that disagree while another one of the same reflector agrees.

    One that is metres off would rotate the frame by degrees. A reflector of which all readings
    disagree has the wrong name or position, which is tested elsewhere.
    """
    return np.asarray(agree | ~(np.bincount(reflector, agree) > 0)[reflector])


# --- corrections ----------------------------------------------------------------------------------


def mapped(A: Array, points: UnloadedPoints) -> UnloadedPoints:
    """Coordinates A p of the tracker."""
    return replace(points, seen=points.seen @ A.T, base=points.base @ A.T)


def logged(M: Array, q0: Array | float, points: UnloadedPoints) -> UnloadedPoints:
    """Joint values M q + q0."""
    return replace(points, q=points.q @ M.T + q0)


def with_places(table: str, places: Mapping[str, Point], points: UnloadedPoints) -> UnloadedPoints:
    """Other places in [tool] or [base_frame]."""
    if table == "base_frame":
        return replace(points, nominal={**points.nominal, **places})
    there = zip(points.measured, points.tool, strict=True)
    return replace(points, tool=np.array([places.get(name, at) for name, at in there]))


def renamed(names: Sequence[str], points: UnloadedPoints) -> UnloadedPoints:
    """Permuted names of the targets."""
    true = dict(zip(points.measured, names, strict=True))
    order = np.array([points.measured.index(name) for name in names])
    base = np.array([true.get(name, name) for name in points.names], object)
    return replace(points, target=order[points.target], names=base)
