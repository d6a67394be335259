"""What absolute positions say of a robot, for pulls of the same robot.

Of the robot's table, of points of its tool and of what yields under its own weight they know

    estimate = truth + e,    e ~ N(0, C),

with the full covariance C of all of these together. Pulls take it as it is: what they know no
better (table and tool) are errors common to all pulls, and what they know, too (springs, elements),
are rows beside theirs. Both together are then the least squares of all readings at once, as both
are linear where the positions ended.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked, Strings
from pipeline.machine.cell import Cell
from pipeline.machine.effect import Effect, Elastic
from pipeline.machine.effects.gravity_sag import under_pulls
from pipeline.machine.robot import Robot
from pipeline.machine.robot.letters import Letter, changed

_KNOWN = 1e-9
"""Part of the largest variance, each error in its own standard uncertainty, that is rounding."""

_ROUNDS = 20
"""Of weighing anew, at most; each but the first changes the factor less than the last."""
_LEAST = 0.01
"""An arm that is a hundred times lighter or heavier than usual is none."""


class CommonSoftness(NamedTuple):
    """A factor between springs by pulls and by weight, what it leaves, and of how many."""

    factor: float
    std: float
    chi2: float
    dof: int


def called_for(elements: Sequence[Elastic], by: Sequence[Effect]) -> tuple[int, ...]:
    """Which elements are among some effects, of this or of another robot's table."""
    keys = {(one.label, one.form) for one in by}
    return tuple(k for k, one in enumerate(elements) if (one.label, one.form) in keys)


def laws_of_gears(effects: Sequence[Effect], elements: Sequence[Elastic] = ()) -> set[int]:
    """Joints with a law in their gear beside the spring, of which weight shows something else.

    That is none of some elements, which are the same law under weight and pull.
    """
    told = {(one.label, one.form) for one in elements}
    laws = [one for one in effects if one.element == "gear" and (one.label, one.form) not in told]
    return {one.where for one in laws if isinstance(one.where, int)}


def soften(effects: Sequence[Effect]) -> Bools:
    """Parameters that are compliances, larger as all springs are under a lighter arm, (e,)."""
    return np.array(["N" in one.unit for e in effects for one in e.parameters], dtype=bool)


@dataclass(frozen=True, eq=False)
class Stance(Locked):
    """Where a robot stands and what bends it, as its absolute positions have it.

    Attributes:
        robot: With its table corrected.
        letters: Entries of that table that may be off, k of them.
        points: Points of the tool that were read [m], flange frame, by name, t of them.
        compliance: Of each joint [m/N] or [rad/(N m)], shape (n,).
        told: Joints of which the weight tells the compliance, shape (n,).
        held: Elements beside the joints of which it tells how they yield.
        yields: Their parameters, one after the other, shape (e,).
        cov: C, of springs, elements, letters of the table and points, (n + e + k + 3 t) squared.
        unloaded: Joint values of the controller (m, n) -> how far the joints are from them (m, n)
            and the points from where the corrected table then has them [m], F_b, (m, t, 3); where
            no pull reads one of the points, all that were read.
        factor: Variance of the factor by which all springs may be softer under masses lighter by
            it, which moves nothing; 0 where the robot file states the masses [1].
        moments: Mass [kg] and first moment in its frame [kg m] of each link, shape (n, 4).
        gravity: Acceleration in F_b [m/s^2], shape (3,).
        elements: All that could yield beside the joints; those that are not held are none.
        reopened: What positions say where some of these, by number, are free; None: they stay none.
        scaled: Springs over those that the positions alone have.
    """

    robot: Robot
    letters: tuple[Letter, ...]
    points: dict[str, Array]
    compliance: Array
    told: Bools
    held: tuple[Elastic, ...]
    yields: Array
    cov: Array
    unloaded: Callable[[Array], tuple[Array, Array]]
    factor: float = 0.0
    moments: Array = field(default_factory=lambda: np.zeros((0, 4)))
    gravity: Array = field(default_factory=lambda: np.zeros(3))
    elements: tuple[Elastic, ...] = ()
    reopened: Callable[[tuple[int, ...]], Stance] | None = None
    scaled: float = 1.0

    def holding(self, called: Sequence[Effect]) -> Stance:
        """The same with elements held that pulls call for, of whatever size readings have them."""
        more = called_for(self.elements, called)
        if self.reopened is None or all(self.elements[k] in self.held for k in more):
            return self
        return self.reopened(more).softer(self.scaled)

    @property
    def springs(self) -> int:
        """How many of the parameters springs and elements are."""
        return len(self.compliance) + len(self.yields)

    @property
    def effects(self) -> tuple[tuple[Elastic, Array], ...]:
        """The elements with their values."""
        ends = np.cumsum([len(one.parameters) for one in self.held])[:-1]
        return tuple(zip(self.held, np.split(self.yields, ends), strict=True)) if self.held else ()

    @property
    def _soft(self) -> Bools:
        """Which of springs and elements are compliances, (n + e,)."""
        return np.append(np.ones(len(self.compliance), dtype=bool), soften(self.held))

    @property
    def apart(self) -> Array:
        """Covariance of springs and elements but for that factor, (n + e, n + e)."""
        both = np.append(self.compliance, self.yields) * self._soft
        return self.cov[: self.springs, : self.springs] - self.factor * np.outer(both, both)

    def lighter(self, value: Array, cov: Array, known: Bools) -> float:
        """The factor that pulls tell; 1 where none has to be told, or no joint tells it.

        Args:
            value: Compliances c by the pulls alone, shape (n,).
            cov: Their covariance V, shape (n, n).
            known: Joints that these determine, shape (n,).
        """
        one = self.common(value, cov, known) if self.factor else None
        return 1.0 if one is None else one.factor

    def common(self, value: Array, cov: Array, known: Bools) -> CommonSoftness | None:
        """By how much all springs by the pulls are softer; None where no joint tells it.

        s for which (c - s c0)' (V + s^2 V0)^-1 (c - s c0) is smallest, V0 as of `apart`. Args as
        of `lighter`.
        """
        mine = np.flatnonzero(known & self.told & (self.compliance > 0) & (value > 0))
        if not len(mine):
            return None
        own, both = self.compliance[mine], np.ix_(mine, mine)
        s = float(np.median(value[mine] / own))
        for _ in range(_ROUNDS):
            P = linear.inverse(cov[both] + s**2 * self.apart[both])
            s = max(float(own @ P @ value[mine]) / float(own @ P @ own), _LEAST)
        left = value[mine] - s * own
        return CommonSoftness(
            s, float(own @ P @ own) ** -0.5, float(left @ P @ left), len(mine) - 1
        )

    def softer(self, factor: float) -> Stance:
        """The same of an arm that is lighter by a factor, which the positions cannot tell."""
        scale = np.ones(len(self.cov))
        scale[: self.springs] = np.where(self._soft, factor, 1.0)
        return replace(
            self,
            compliance=self.compliance * factor,
            yields=self.yields * scale[len(self.compliance) : self.springs],
            moments=self.moments / factor,
            cov=self.cov * scale * scale[:, None],
            scaled=self.scaled * factor,
        )

    @cached_property
    def parts(self) -> tuple[Array, Array, Array]:
        """F, K and W: table and points err by F a, springs and elements by K a + W w.

        a and w are independent unit errors; shapes (k + 3 t, r), (n + e, r), (n + e, n + e).
        """
        C, s = self.cov, self.springs
        size = np.sqrt(np.diag(C)[s:])
        share, along = linear.directions(C[s:, s:] / size / size[:, None])
        seen = share > _KNOWN * share.max(initial=0.0)
        root = np.sqrt(share[seen])
        F = size[:, None] * along[:, seen] * root
        K = C[:s, s:] @ (along[:, seen] / root / size[:, None])
        own = np.sqrt(np.diag(C)[:s])
        W = own[:, None] * linear.factor((C[:s, :s] - K @ K.T) / own / own[:, None])
        return F, K, W

    @cached_property
    def variants(self) -> tuple[tuple[Robot, dict[str, Array]], ...]:
        """Robot and points off by each of the errors a, one standard uncertainty."""
        k = len(self.letters)
        return tuple(
            (changed(self.robot, self.letters, one[:k]), self._moved(one[k:].reshape(-1, 3)))
            for one in self.parts[0].T
        )

    def _moved(self, off: Array) -> dict[str, Array]:
        return {name: at + by for (name, at), by in zip(self.points.items(), off, strict=True)}

    def moved(self, q: Array, names: Strings) -> Array:
        """How far points are from where the corrected table has them [m], F_b, (m, 3).

        Args:
            q: Joint values [m] or [rad], shape (m, n).
            names: Of one point each, shape (m,); one that was not read moves as the others' mean.
        """
        off = self.unloaded(q)[1]
        out = off.mean(axis=1)
        for k, name in enumerate(self.points):
            out[names == name] = off[names == name, k]
        return np.asarray(out)

    def on(self, cell: Cell) -> Cell:
        """A cell in which the elements act as the weight shows them, and it under pulls."""
        return replace(cell, held=(*self.effects, *self.weighs))

    @property
    def weighs(self) -> tuple[tuple[Elastic, Array], ...]:
        """The weight that turns the joints further where pulls have moved it."""
        if not self.moments.any():
            return ()
        return ((under_pulls(self.compliance, self.moments, self.gravity), np.ones(1)),)
