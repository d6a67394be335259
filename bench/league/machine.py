"""A robot as a chain of 4 x 4 matrices with springs in it, in equilibrium with what pulls on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.base.arrays import Array
from pipeline.machine.robot import Robot

AT_REST = 1e-12
"""A machine whose springs move less than this [m] or [rad] from one round to the next rests."""

Law = Callable[[Array, dict[str, Array]], Array]
"""Own generalised force (m,), those of all named springs -> deflection (m,)."""


@dataclass(frozen=True)
class Spring:
    """One place where the machine gives way.

    Attributes:
        name: For laws that look at another spring's force.
        after: It sits in the frame of this joint, counted from 1, behind its motion; n + 1 is the
            flange.
        axis: In that frame.
        slides: Translation along the axis instead of rotation about it.
        law: Force to deflection.
        at: Its origin in that frame [m].
        fixed: The axis is given in the frame of the base instead.
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
        robot: For the constant placements of its joints only.
        springs: What gives way, from base to flange.
        masses: Hanging masses: joint, place in its frame [m], mass [kg].
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

        Returns:
            Points of interest (m, t, 3) and load point (m, 3) [m].
        """
        bent = self.rest(q, load_point, force, rounds)
        flange, *_ = self._chain(q, self._sorted(), bent)
        points = np.einsum("mij,tj->mti", flange[:, :3, :3], tool) + flange[:, None, :3, 3]
        return points, _placed(flange, load_point)

    def rest(self, q: Array, load_point: Array, force: Array, rounds: int = 8) -> Array:
        """How far each spring gives way until all is at rest, from base to flange, shape (m, s).

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
        """A point that a joint, or the flange, carries while the springs stay as they are.

        Args:
            q: True joint values, shape (m, n).
            bent: How far each spring has given way, shape (m, s).
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
    """Points of the flange's frame, shape (3,) or (m, 3), in the base's, shape (m, 3)."""
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
    """Points (m, 3) turned about the origin by a rotation vector [rad], lengths unchanged."""
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
