"""Results of absolute positions of a robot, as prior information for pulls of the same robot.

For the robot's table, points of its tool and compliances under its own weight, positions give

    estimate = truth + e,    e ~ N(0, C),

with the full joint covariance C. Pulls use it in two ways: quantities about which they have no
better information (table and tool) are errors common to all pulls, and quantities they also
determine (springs, elements) become additional rows. Together this is the least-squares estimate
from all readings, as both are linear about the estimate from positions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked, Parameter, Strings
from pipeline.diagnosis.agreement import CommonFactorFit
from pipeline.machine.cell import Cell
from pipeline.machine.effect import Effect, Elastic, Loaded
from pipeline.machine.effects.gravity_sag import described
from pipeline.machine.robot import Robot
from pipeline.machine.robot.configuration import Configuration, cross
from pipeline.machine.robot.dh_parameters import DhParameter, changed
from pipeline.positions.stated_tool import StatedTool

_KNOWN = 1e-9
"""Eigenvalues below this fraction of the largest, of the correlation matrix, are treated as zero
[1]."""

_ROUNDS = 20
"""Maximum number of reweighting iterations; each after the first changes the factor less than the
previous one."""
_LEAST = 0.01
"""Lower bound of the common factor of all springs [1]; an arm a hundred times heavier than usual is
implausible."""


def called_for(elements: Sequence[Elastic], by: Sequence[Effect]) -> tuple[int, ...]:
    """Indices of the elements that are among some effects, matched by label and form."""
    keys = {(one.label, one.form) for one in by}
    return tuple(k for k, one in enumerate(elements) if (one.label, one.form) in keys)


def laws_of_gears(effects: Sequence[Effect], elements: Sequence[Elastic] = ()) -> set[int]:
    """Joints with a law in their gear besides the spring, whose compliance under weight differs.

    Laws among `elements`, which are the same under weight and pull, are excepted.
    """
    known_values = {(one.label, one.form) for one in elements}
    laws = [
        one
        for one in effects
        if one.element == "gear" and (one.label, one.form) not in known_values
    ]
    return {one.where for one in laws if isinstance(one.where, int)}


def soften(effects: Sequence[Effect]) -> Bools:
    """Mask of parameters that are compliances and scale with all springs, (e,)."""
    return np.array(["N" in one.unit for e in effects for one in e.parameters], dtype=bool)


@dataclass(frozen=True, eq=False)
class PositionsEstimate(Locked):
    """Geometry and compliance of a robot as estimated from absolute positions.

    Attributes:
        robot: Robot with its table corrected.
        letters: Uncertain entries of that table, k of them.
        points: Points of the tool [m], flange frame, by name, t of them: those measured, and the
            load point if these carry it, the last.
        compliance: Compliance of each joint [m/N] or [rad/(N m)], shape (n,).
        told: Joints whose compliance the weight determines, shape (n,).
        held: Elastic elements besides the joints that the data call for, with estimated parameters.
        yields: Their parameters, one after the other, shape (e,).
        cov: C, of springs, elements, letters of the table and points, (n + e + k + 3 t) squared.
        unloaded: Controller joint values (m, n) -> deviation of the joints from them (m, n), and of
            the points from where the corrected table puts them [m], F_b, (m, t, 3); of all targets
            if `points` is empty.
        factor: Variance of the common factor by which all springs may be softer with masses lighter
            by the same factor, which leaves positions unchanged; 0 if the robot file states the
            masses [1].
        moments: Mass [kg] and first moment in its frame [kg m] of each link, shape (n, 4).
        gravity: Acceleration in F_b [m/s^2], shape (3,).
        elements: All candidate elastic elements besides the joints; those not in `held` are taken
            as rigid.
        unsure: Controller joint values (m, n), names of points (m,) -> motions of the unloaded
            points, each by one unit of an independent standard error of what is estimated besides
            table and points [m], F_b, up to a rigid motion, (m, 3, r); None if there is none.
        reopened: Re-estimate with the candidates of given indices free; None if they stay rigid.
    """

    robot: Robot
    letters: tuple[DhParameter, ...]
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
    unsure: Callable[[Array, Strings], Array] | None = None
    reopened: Callable[[tuple[int, ...]], PositionsEstimate] | None = None

    def carrying(self, tool: StatedTool, least: float) -> PositionsEstimate:
        """The estimate with the load point as its last point, where the targets carry it.

        Unchanged where no uncertainty of the tool is stated, or where that is refuted at the level
        `least`.
        """
        if not (self.points and tool.std):
            return self
        at = len(self.cov) - 3 * len(self.points)
        where, G, rest, p = tool.carried(self.points, self.cov[at:, at:])
        if p < least:
            return self
        gain = np.vstack([np.eye(len(self.cov)), np.pad(G, ((0, 0), (at, 0)))])
        cov = gain @ self.cov @ gain.T
        cov[-3:, -3:] += rest
        return replace(self, points=self.points | {"load_point": where}, cov=cov)

    def holding(self, called: Sequence[Effect]) -> PositionsEstimate:
        """This stance with the elements estimated that pulls call for, whatever their size."""
        more = called_for(self.elements, called)
        if self.reopened is None or all(self.elements[k] in self.held for k in more):
            return self
        return self.reopened(more)

    @property
    def springs(self) -> int:
        """Number of parameters of springs and elements, n + e."""
        return len(self.compliance) + len(self.yields)

    @property
    def effects(self) -> tuple[tuple[Elastic, Array], ...]:
        """Estimated elements with their values."""
        ends = np.cumsum([len(one.parameters) for one in self.held])[:-1]
        return tuple(zip(self.held, np.split(self.yields, ends), strict=True)) if self.held else ()

    @property
    def _soft(self) -> Bools:
        """Mask of the compliances among springs and elements, (n + e,)."""
        return np.append(np.ones(len(self.compliance), dtype=bool), soften(self.held))

    @property
    def apart(self) -> Array:
        """Covariance of springs and elements without the common factor, (n + e, n + e)."""
        both = np.append(self.compliance, self.yields) * self._soft
        return self.cov[: self.springs, : self.springs] - self.factor * np.outer(both, both)

    def common(self, value: Array, cov: Array, known: Bools) -> CommonFactorFit | None:
        """Common factor by which springs by pulls are softer; None if no joint determines it.

        The s that minimises (c - s c0)' (V + s^2 V0)^-1 (c - s c0), V0 as in `apart`, by iterative
        reweighting.

        Args:
            value: Compliances c estimated from pulls alone, shape (n,).
            cov: Their covariance V, shape (n, n).
            known: Joints that these determine, shape (n,).
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
        return CommonFactorFit(
            s, float(own @ P @ own) ** -0.5, float(left @ P @ left), len(mine) - 1
        )

    @cached_property
    def parts(self) -> tuple[Array, Array, Array]:
        """F, K and W: errors of table and points are F a, those of springs and elements K a + W w.

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
        """Robot and points displaced by each of the errors a, by one standard uncertainty."""
        k = len(self.letters)
        return tuple(
            (changed(self.robot, self.letters, one[:k]), self._moved(one[k:].reshape(-1, 3)))
            for one in self.parts[0].T
        )

    def _moved(self, off: Array) -> dict[str, Array]:
        return {name: at + by for (name, at), by in zip(self.points.items(), off, strict=True)}

    def joints(self, q: Array) -> Array:
        """Joint values of the robot [m] or [rad] where the controller has q, both (m, n)."""
        return q + self.unloaded(q)[0]

    def errors(self, q: Array, names: Strings) -> Array:
        """As `KnownRobot.errors`."""
        return np.zeros((len(q), 3, 0)) if self.unsure is None else self.unsure(q, names)

    def moved(self, q: Array, names: Strings) -> Array:
        """As `KnownRobot.moved`."""
        off = self.unloaded(q)[1]
        out = off.mean(axis=1)
        for k, name in zip(range(off.shape[1]), self.points, strict=False):
            out[names == name] = off[names == name, k]
        return np.asarray(out)

    def on(self, cell: Cell) -> Cell:
        """The cell with these elements at their estimated values, and the weight moved by pulls.

        Positions are those of a deflected robot, and pulls act on that.
        """
        return replace(cell, equilibrium="deformed", held=(*self.effects, *self.weighs))

    @property
    def weighs(self) -> tuple[tuple[Elastic, Array], ...]:
        """Effect of the weight that pulls have displaced; empty if link masses are unknown."""
        if not self.moments.any():
            return ()
        return ((under_pulls(self.compliance, self.moments, self.gravity), np.ones(1)),)


_POSTURES = 64
"""Number of sets of poses of which the stiffening is kept, one for each error of the table."""


def under_pulls(compliance: Array, moments: Array, gravity: Array) -> Elastic:
    """Known links whose weight adds to the deflection under a pull, c G c tau.

    Args:
        compliance: c of each joint [m/N] or [rad/(N m)], shape (n,).
        moments: Mass [kg] and first moment [kg m] of each link, shape (n, 4).
        gravity: Acceleration in F_b [m/s^2], shape (3,).
    """

    @lru_cache(maxsize=_POSTURES)  # the equilibrium asks several times, each force anew
    def stiffened(here: Configuration) -> Array:
        return stiffening(here, gravity, moments)

    def response(loaded: Loaded, tau: Array) -> Array:
        G = stiffened(loaded.configuration)
        return np.asarray(compliance * np.einsum("mjk,k,mk->mj", G, compliance, tau))

    return Elastic(
        **described(1.0) | {"parameters": (Parameter("known", "1", 1.0, 0.0, 2.0),)},
        carrier=tuple(range(1, len(compliance) + 1)),
        response=response,
        shared=(0,) * len(compliance),
    )


def stiffening(here: Configuration, gravity: Array, moments: Array) -> Array:
    """Derivative of the torques of the links' weight by the joint values, G = d tau_g / dq.

    Joint k moves everything it carries, of mass M_k and first moment P_k about the origin of F_b,
    by v_k + w_k x r, and changes the torque of its weight about a preceding joint j by

        G_jk = w_j . ((M_k v_k + w_k x P_k) x g),    j <= k,    G_kj = G_jk,

    as weight has a potential.

    Args:
        here: The robot at m joint vectors.
        gravity: Acceleration in F_b [m/s^2], shape (3,).
        moments: Mass [kg] and first moment [kg m] of each link, shape (n, 4).

    Returns:
        Shape (m, n, n) [N m/rad], [N] or [N/m].
    """
    first = moments[:, :1] * here.origin + np.einsum("mkij,kj->mki", here.axes, moments[:, 1:])
    P = np.cumsum(first[:, ::-1], axis=1)[:, ::-1]
    M = np.cumsum(moments[::-1, 0])[::-1]
    turn, slide = here.twists[..., :3], here.twists[..., 3:]
    moved = M[:, None] * slide + cross(turn, P)
    G = np.triu(np.einsum("mji,mki->mjk", turn, cross(moved, gravity)))
    return np.asarray(G + np.swapaxes(np.triu(G, 1), 1, 2))
