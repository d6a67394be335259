"""A robot as a chain of 4 x 4 matrices with springs, in equilibrium with the loads on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.robot import Robot

AT_REST = 1e-12
"""Change of deflections between iterations below which the machine is at rest [m or rad]."""

Law = Callable[[Array, dict[str, Array]], Array]
"""Function of the own generalised force (m,) and those of all named springs; returns deflection
(m,)."""


@dataclass(frozen=True)
class Spring:
    """One elastic element of the machine.

    Attributes:
        name: For laws that depend on another spring's force.
        after: Number of the joint, from 1, in whose frame it is, behind its motion; n + 1 is the
            flange.
        axis: Axis in that frame.
        slides: Whether it translates along the axis instead of rotating about it.
        law: Force to deflection.
        at: Its origin in that frame [m].
        fixed: Whether the axis is given in the base frame instead.
    """

    name: str
    after: int
    axis: tuple[float, float, float]
    slides: bool
    law: Law
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fixed: bool = False


@dataclass
class Machine:
    """A robot with its springs and masses.

    Attributes:
        robot: Only for the constant placements of its joints.
        springs: Elastic elements, from base to flange.
        masses: Masses: joint, place in its frame [m], mass [kg].
    """

    robot: Robot
    springs: list[Spring]
    masses: list[tuple[int, tuple[float, float, float], float]] = field(default_factory=list)

    def settle(
        self, q: Array, tool: Array, load_point: Array, force: Array, rounds: int = 8
    ) -> tuple[Array, Array]:
        """Let the machine come to rest under a force.

        Args:
            q: True joint values, shape (m, n).
            tool: Points of interest in the flange frame, shape (t, 3) [m].
            load_point: Where the force acts in the flange frame, shape (3,) or (m, 3) [m].
            force: [N], base frame, shape (m, 3).
            rounds: Maximum number of iterations.

        Returns:
            Points of interest (m, t, 3) and load point (m, 3) [m].
        """
        bent = self.rest(q, load_point, force, rounds)
        flange, *_ = self._chain(q, self._sorted(), bent)
        points = np.einsum("mij,tj->mti", flange[:, :3, :3], tool) + flange[:, None, :3, 3]
        return points, _placed(flange, load_point)

    def rest(self, q: Array, load_point: Array, force: Array, rounds: int = 8) -> Array:
        """Deflection of each spring at rest, from base to flange, shape (m, s).

        The arguments are those of `settle`.
        """
        springs = self._sorted()
        bent = np.zeros((len(q), len(springs)))
        for _ in range(rounds):
            flange, axes, at, hung = self._chain(q, springs, bent)
            acts = _placed(flange, load_point)
            before, bent = bent, _deflections(springs, axes, at, [(acts, force, 99), *hung])
            if np.abs(bent - before).max() < AT_REST:
                break
        return bent

    def carried(self, q: Array, bent: Array, place: Array, joint: int | None = None) -> Array:
        """Position of a point fixed to a joint or the flange, for given spring deflections.

        Args:
            q: True joint values, shape (m, n).
            bent: Deflection of each spring, shape (m, s).
            place: In the frame of the joint or of the flange, shape (3,) or (m, 3) [m].
            joint: From 1; None is the flange.

        Returns:
            Shape (m, 3) [m].
        """
        if joint is None:
            flange, *_ = self._chain(q, self._sorted(), bent)
            return _placed(flange, place)
        marked = replace(self, masses=[(joint, tuple(place.tolist()), 0.0)])
        (here, _, _), *_ = marked._chain(q, self._sorted(), bent)[3]
        return here

    def _sorted(self) -> list[Spring]:
        return sorted(self.springs, key=lambda s: s.after)

    def _chain(
        self, q: Array, springs: list[Spring], bent: Array
    ) -> tuple[Array, list[Array], list[Array], list[tuple[Array, Array, int]]]:
        m, n = q.shape
        T = np.tile(np.eye(4), (m, 1, 1))
        axes, at, hung = [], [], []
        placements = [*self.robot.placement, self.robot.flange]
        for j in range(1, n + 2):
            T = T @ placements[j - 1]
            if j <= n:
                T = T @ _screw(np.array([0, 0, 1.0]), q[:, j - 1], self.robot.prismatic[j - 1])
            for k, spring in enumerate(springs):
                if spring.after != j:
                    continue
                axis = np.tile(np.array(spring.axis), (m, 1))
                if spring.fixed:
                    axis = np.einsum("mji,mj->mi", T[:, :3, :3], axis)
                origin = np.array(spring.at)
                axes.append(np.einsum("mij,mj->mi", T[:, :3, :3], axis))
                at.append(T[:, :3, :3] @ origin + T[:, :3, 3])
                T = T @ _about(origin, _screw(axis, bent[:, k], spring.slides))
            for joint, place, mass in self.masses:
                if joint == j:
                    here = T[:, :3, :3] @ np.array(place) + T[:, :3, 3]
                    weight = np.tile([0, 0, -9.81 * mass], (m, 1))
                    hung.append((here, weight, j))
        return T, axes, at, hung


def _placed(flange: Array, place: Array) -> Array:
    """Points of the flange frame, shape (3,) or (m, 3), in the base frame, shape (m, 3)."""
    return np.asarray((flange[:, :3, :3] @ place[..., None])[..., 0] + flange[:, :3, 3])


def _deflections(
    springs: list[Spring],
    axes: list[Array],
    at: list[Array],
    loads: list[tuple[Array, Array, int]],
) -> Array:
    own: dict[str, Array] = {}
    for spring, axis, origin in zip(springs, axes, at, strict=True):
        total = np.zeros(len(axis))
        for place, force, joint in loads:
            if spring.after > joint:
                continue
            work = force if spring.slides else np.cross(place - origin, force)
            total = total + np.sum(axis * work, axis=1)
        own[spring.name] = total
    return np.stack([spring.law(own[spring.name], own) for spring in springs], axis=1)


def turned(points: Array, e: Array) -> Array:
    """Points (m, 3) rotated about the origin by a rotation vector [rad], lengths unchanged."""
    size = float(np.linalg.norm(e))
    if not size:
        return points
    return np.asarray(points @ _screw(e / size, np.array([size]), False)[0, :3, :3].T)


def _screw(axis: Array, amount: Array, slides: bool) -> Array:
    """Translation along or rotation about a unit axis (Rodrigues), shape (m, 4, 4)."""
    axis = np.broadcast_to(axis, (len(amount), 3))
    T = np.tile(np.eye(4), (len(amount), 1, 1))
    if slides:
        T[:, :3, 3] = axis * amount[:, None]
        return T
    K = np.zeros((len(amount), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    K = K - np.swapaxes(K, 1, 2)
    s, c = np.sin(amount)[:, None, None], np.cos(amount)[:, None, None]
    T[:, :3, :3] = np.eye(3) + s * K + (1 - c) * (K @ K)
    return T


def _about(origin: Array, motion: Array) -> Array:
    """The motion about another origin."""
    out = motion.copy()
    out[:, :3, 3] += origin - motion[:, :3, :3] @ origin
    return out
