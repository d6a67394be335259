"""Poses at which reflectors are read without a pull: chosen for the DH parameters of the robot.

With x the errors of the table's entries in units of their spread as delivered, r all else that
moves an unloaded reflector (position and rotation of the robot, tool), M_p the information of the
unloaded readings of pose p on both, including joint errors at each pose, and M = 1 + sum of M_p
over all poses that are read,

    Phi = log det M - log det M_rr

is twice the gain of information about the table. It is concave in weights w of the poses on offer,
0 <= w_p <= 1, so that for any such weights no choice of n poses is above

    Phi(w) + sum of the n largest g_p - sum of w_p g_p,   g_p = tr M^-1 M_p - tr M_rr^-1 M_p,rr

(Kiefer and Wolfowitz, Canadian Journal of Mathematics 12, 1960). The bound is lowered by steps of
the weights towards the n largest g (Frank and Wolfe, Naval Research Logistics Quarterly 3, 1956).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.errors import InputError
from pipeline.design.descent import descend
from pipeline.design.limits import kept, penalty
from pipeline.design.problem import Problem
from pipeline.design.space import PlanCoordinates
from pipeline.design.spec import Limits
from pipeline.geometry.unloaded import USUAL, Unloaded
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import configure

_OFFERED = 600
"""Number of random poses from which some are chosen."""

_ROUNDS = 200
"""Maximum number of steps that lead a random pose inside the limits."""

_PASSES = 10
"""Maximum number of exchange passes over the chosen poses; two or three suffice."""

_STEPS = 50
"""Number of steps of the weights; more lower the bound by little."""

_FAR = np.geomspace(1e-4, 1.0, 24)
"""Trial fractions of the way in each step [1]."""

_ANY_M = (0.0, 1e5)
"""Limits of the length of a chain that is not there [m]."""


@dataclass(frozen=True, eq=False)
class Unpulled(Locked):
    """Poses without a pull and their value.

    Attributes:
        q: Joint values [m] or [rad], shape (u, n).
        without: Standard uncertainty of the table's entries over their spread as delivered,
            geometric mean, from the pulled poses alone.
        figure: The same with these poses.
        bound: Lower bound for any choice among the poses on offer.
        offered: Number of these poses.
    """

    q: Array
    without: float
    figure: float
    bound: float
    offered: int


def unpulled(problem: Problem, pulled: Array, rng: np.random.Generator) -> Unpulled:
    """Choose poses without a pull, in addition to those with one, by exchange.

    Args:
        problem: Its `plan.unloaded` is the number of poses.
        pulled: Joint values of the poses with a pull [m] or [rad], shape (m, n).
        rng: Draws the poses on offer.

    Raises:
        InputError: Too few poses keep the limits.
    """
    count = problem.spec.plan.unloaded
    offer = _offer(problem, rng)
    if len(offer) < count:
        raise InputError(
            f"of {_OFFERED} poses tried only {len(offer)} keep the limits, and {count} without a "
            "pull are asked for",
            "ask for fewer, or relax the limits",
        )
    zeros = _read(problem, np.concatenate([pulled, offer]))
    M, table = _information(zeros)
    start = np.eye(M.shape[1]) + M[: len(pulled)].sum(axis=0)
    told = _Told(M[len(pulled) :], start, table)
    chosen = told.exchanged(told.greedy(count))
    best = told.phi(told.sum(chosen))

    def relative(phi: float) -> float:
        return float(np.exp(-phi / 2 / (table.stop - table.start)))

    return Unpulled(
        q=offer[chosen],
        without=relative(told.phi(start)),
        figure=relative(best),
        bound=relative(told.bound(chosen)),
        offered=len(offer),
    )


def _offer(problem: Problem, rng: np.random.Generator) -> Array:
    """Poses that keep every limit except those of a chain, as they are printed, shape (o, n)."""
    box, said = PlanCoordinates(problem, 1), problem.limits
    limits = Limits(
        joints=said.joints,
        flange_above_m=said.flange_above_m,
        effector_above_m=said.effector_above_m,
        chain_m=_ANY_M,
    )

    def outside(x: Array) -> tuple[Array, Array]:
        broken, by_q, by_anchor = penalty(limits, box.stations(x), problem.room)
        return broken, box.slopes(by_q, by_anchor)

    x = descend(outside, rng.uniform(size=(_OFFERED, box.size)), rounds=_ROUNDS).x
    q, anchor = box.opened(x)
    q = problem.as_printed(q[:, 0])
    return q[kept(limits, box.stations(box.closed(q[:, None], anchor)), problem.room)]


def _read(problem: Problem, q: Array) -> Unloaded:
    """Unloaded readings of all reflectors at some poses, with the plan's instrument noise."""
    tool, t = problem.tool, len(problem.tool.points)
    here = configure(problem.robot, q)
    points = here.flange_origin[:, None] + np.einsum("mij,tj->mti", here.flange_axes, tool.points)
    scatter = problem.experiment.scatter
    C = scatter.reading(np.moveaxis(points, 0, -1)).reshape(len(q), t, 3, t, 3)
    each = np.arange(t)
    cov = np.swapaxes(C[:, each, :, each], 0, 1).reshape(-1, 3, 3) * (scatter.zero or 1.0)
    pose = np.repeat(np.arange(len(q)), t)
    return Unloaded(
        robot=problem.robot,
        tool=tool,
        sag=None,
        pulls=Pulls.at(q[pose], np.zeros(3)),
        pose=pose,
        target=np.tile(each, len(q)),
        at=points.reshape(-1, 3),
        cov=cov,
        rotation=np.zeros((3, 3)),
        joint_std=np.zeros(problem.robot.n),
    )


def _information(zeros: Unloaded) -> tuple[Array, slice]:
    """Information of each pose on all unknowns in prior units, (p, K, K); slice of the table's."""
    where, std = zeros.columns, zeros.held()
    std[where.table], std[where.loose] = zeros.usual(), USUAL[1]
    rows = zeros.about(np.zeros(where.count))
    X = linear.whitening(rows.cov(1.0)) @ (rows.D * std)
    return np.swapaxes(X, 1, 2) @ X, where.table


@dataclass(frozen=True, eq=False)
class _Told(Locked):
    """Information of the poses on offer.

    Attributes:
        M: Information of each, shape (o, K, K).
        start: Information of all other readings and the prior, shape (K, K).
        table: The unknowns of the table.
    """

    M: Array
    start: Array
    table: slice

    @property
    def rest(self) -> Ints:
        """The other unknowns."""
        return np.setdiff1d(
            np.arange(len(self.start)), np.arange(self.table.start, self.table.stop)
        )

    def sum(self, chosen: Ints) -> Array:
        """Total information with some of those on offer, shape (K, K)."""
        return np.asarray(self.start + self.M[chosen].sum(axis=0))

    def phi(self, M: Array) -> float:
        """Phi of an information matrix, shape (K, K)."""
        return float(self.phis(M[None])[0])

    def phis(self, M: Array) -> Array:
        """Phi of several, (o,) from (o, K, K)."""
        rest = np.ix_(np.arange(len(M)), self.rest, self.rest)
        return np.asarray(linear.log_det(M) - linear.log_det(M[rest]))

    def next(self, M: Array, taken: Ints) -> int:
        """The pose on offer that adds most and is not yet taken."""
        phis = self.phis(M + self.M)
        phis[taken] = -np.inf
        return int(np.argmax(phis))

    def greedy(self, count: int) -> Ints:
        """Poses chosen one after the other."""
        chosen = np.zeros(0, dtype=np.int64)
        for _ in range(count):
            chosen = np.append(chosen, self.next(self.sum(chosen), chosen))
        return chosen

    def exchanged(self, chosen: Ints) -> Ints:
        """The same with each replaced by a better one as long as there is any."""
        for _ in range(_PASSES):
            before = chosen.copy()
            for k in range(len(chosen)):
                others = np.delete(chosen, k)
                chosen[k] = self.next(self.sum(others), others)
            if np.array_equal(np.sort(before), np.sort(chosen)):
                break
        return chosen

    def bound(self, chosen: Ints) -> float:
        """Upper bound of Phi for any choice of as many poses."""
        M, w, lowest = self.sum(chosen), np.zeros(len(self.M)), np.inf
        w[chosen] = 1.0
        for _ in range(_STEPS):
            g = self.slope(M)
            most = np.argpartition(-g, len(chosen) - 1)[: len(chosen)]
            lowest = min(lowest, self.phi(M) + float(g[most].sum() - w @ g))
            towards = self.sum(most) - M
            part = _FAR[np.argmax(self.phis(M + _FAR[:, None, None] * towards))]
            M, w = M + part * towards, (1 - part) * w
            w[most] += part
        return lowest

    def slope(self, M: Array) -> Array:
        """The g of every pose on offer, shape (o,)."""
        rest = np.ix_(self.rest, self.rest)
        inverse = linear.inverse(M)
        inverse[rest] -= linear.inverse(M[rest])
        return np.asarray(np.tensordot(self.M, inverse, 2))
