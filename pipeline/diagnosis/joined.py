"""Springs and causes of a campaign of pulls together with what absolute positions say of them.

Beside the pulls' rows c = B x + G e stand those of the positions, about which the table, the tool
and what yields under the arm's weight were estimated (`machine.stance`):

    c       = B x + B_y y - J F a + G e
    [c0 y0] = [x_s y]     + K a   + W w

with y the elements that the weight shows to yield, x_s the joints' compliances in x, and a what the
positions do not know of table and tool. a, w and e are independent unit errors. Least squares of
these rows is that of all readings of both kinds at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.tails import chi2_beyond
from pipeline.diagnosis.average import Hypothesis
from pipeline.machine.cell import Cell, sensitivity
from pipeline.machine.effect import Effect
from pipeline.machine.stance import CommonSoftness, Stance
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.assemble import POSITIONS, by_stance
from pipeline.system.estimate import solve
from pipeline.system.system import Errors, Rows, System
from pipeline.system.whiten import whitener


@dataclass(frozen=True, eq=False)
class Agreement(Locked):
    """Springs by the arm's weight against those by the pulls.

    Attributes:
        chi2: Squared difference in its uncertainty.
        dof: Springs, or mixes of them, that both tell.
        weight: Compliances by the weight, infinite uncertainty where it tells none, (n, 2).
        pulls: The same by the pulls.
        factor: By how much springs are softer than with an arm of usual weight, where no masses are
            stated; None where they are [1].
        common: The same where masses are stated, if nothing else parts the two; None where it does.
        table_p: Chance that the unloaded readings of the pulls are so far from where the positions
            have the robot.
    """

    chi2: float
    dof: int
    weight: Array
    pulls: Array
    factor: float | None
    common: CommonSoftness | None = None
    table_p: float = 1.0

    @property
    def most(self) -> tuple[int, float]:
        """Joint from 0 of which they differ most, and pulls over weight there."""
        (w, sw), (p, sp) = self.weight.T, self.pulls.T
        k = int(np.argmax(np.abs(p - w) / np.hypot(sp, sw)))
        return k, float(p[k] / w[k])

    @property
    def p(self) -> float:
        """Chance of so much difference."""
        return float(chi2_beyond(self.chi2, self.dof)) if self.dof else 1.0


@dataclass(frozen=True, eq=False)
class Joined(Locked):
    """One set of causes with what positions say beside it.

    Attributes:
        hypothesis: Springs, causes, and elements that yield under the weight.
        value: Springs and elements as a stance has them, and errors of table and points, (s,).
        cov: Their covariance, shape (s, s).
        chi2: By how much more the rows of the springs leave.
        dof: How many of them are told twice.
    """

    hypothesis: Hypothesis
    value: Array
    cov: Array
    chi2: float
    dof: int


def joined(one: Hypothesis, data: Measured, usual: Array | None = None) -> Joined:
    """A hypothesis of the pulls beside the positions.

    Args:
        one: The hypothesis, from the pulls alone.
        data: The measurements, with their stance.
        usual: Standard deviations of the last parameters of it about zero before any reading.
    """
    stance = data.stance
    assert stance is not None
    cell, k = one.cell, len(one.estimate.value)
    system = _beside(one, data, usual)
    start = np.append(one.estimate.value, stance.yields)
    found = solve(system, start)
    told = np.zeros(len(system.rows), dtype=bool)
    told[np.flatnonzero(system.rows.pull < 0)[: len(stance.told)]] = stance.told
    less = solve(system.part(~told), start)
    M = int((system.rows.pull >= 0).sum())
    estimate = replace(
        found,
        residual=found.residual[:M],
        goodness=one.estimate.goodness,
        residual_std_m=one.estimate.residual_std_m,
        quantile=one.estimate.quantile,
        noise_from=one.estimate.noise_from,
    )
    whole = replace(cell, held=stance.weighs, effects=(*cell.effects, *stance.held))
    now = replace(one, cell=whole, system=system, estimate=estimate, ratio=1.0, sized=None)
    value, cov = _of_stance(system, stance, k)
    return Joined(now, value, cov, found.chi2 - less.chi2, found.dof - less.dof)


def agreement(one: Hypothesis, beside: Joined, stance: Stance, lighter: float) -> Agreement:
    """Springs by the weight against those by the pulls alone.

    Args:
        one: The hypothesis from the pulls alone.
        beside: The same beside the positions.
        stance: What these say.
        lighter: Springs over those with an arm of usual weight.
    """
    n = len(stance.told)
    own = np.sqrt(np.diag(stance.cov)[:n])
    weight = np.column_stack([stance.compliance, np.where(stance.told, own, np.inf)])
    pulls = np.column_stack([one.estimate.value[:n], one.estimate.std[:n]])
    shared = int(stance.factor > 0)  # one of them has told the weight
    only, cov = one.estimate.value[:n], one.estimate.cov[:n, :n]
    common = None if shared else stance.common(only, cov, one.estimate.identifiable[:n])
    fits = common is not None and chi2_beyond(common.chi2, common.dof) >= alarms.MISFIT
    return Agreement(
        chi2=max(beside.chi2, 0.0),
        dof=max(beside.dof - shared, 0),
        weight=weight,
        pulls=pulls,
        factor=lighter if shared else None,
        common=common if fits else None,
    )


def _beside(one: Hypothesis, data: Measured, usual: Array | None) -> System:
    """The rows of the pulls, those of springs and elements below them."""
    stance, old = data.stance, one.system
    assert stance is not None
    flat = replace(one.cell, equilibrium="undeformed")
    M, k, s = len(old.rows), old.B.shape[1], stance.springs
    n, e = len(stance.compliance), len(stance.yields)
    held = _held(flat, data, one.estimate.value, stance.held)
    jacobian = by_stance(flat, data, one.estimate.value).reshape(M, -1)
    kept = old.errors.source != POSITIONS
    _, K, W = stance.parts
    known = _known(one, usual)
    below = np.zeros((s + len(known), k + e))
    below[:n, :n], below[n:s, k:] = np.eye(n), np.eye(e)
    below[s:, :k] = known
    blocks = [
        [old.errors.G[:, kept] * one.ratio, jacobian, None, None],
        [None, K, W, None],
    ]
    if len(known):
        assert usual is not None
        blocks.append([None, None, None, np.diag(usual)])
    more = [jacobian.shape[1], s, len(known)]
    parameters = tuple(p for effect in stance.held for p in effect.parameters)
    return replace(
        old,
        parameters=(*old.parameters, *parameters),
        rows=_rows(old.rows, len(below)),
        B=np.vstack([np.column_stack([old.B, held]), below]),
        c=np.concatenate(
            [old.c + held @ stance.yields, stance.compliance, stance.yields, np.zeros(len(known))]
        ),
        errors=Errors(
            scipy.sparse.csr_array(scipy.sparse.block_array(blocks[: 2 + bool(len(known))])),
            np.append(old.errors.source[kept], np.full(sum(more), POSITIONS, dtype=object)),
            np.concatenate([old.errors.common[kept], np.repeat([True, False, False], more)]),
        ),
    )


def _held(cell: Cell, data: Measured, values: Array, effects: Sequence[Effect]) -> Array:
    """What elements move per unit of their parameters, shape (M, e)."""
    if not effects:
        return np.zeros((3 * len(data.pull), 0))
    moved = sensitivity(cell, data.pulls, values, effects)[data.pull, data.target]
    return np.asarray(moved.reshape(3 * len(data.pull), -1))


def _known(one: Hypothesis, usual: Array | None) -> Array:
    """Rows of the last parameters, of which a usual size is known, (j, k)."""
    k = len(one.estimate.value)
    return np.eye(k)[k - (0 if usual is None else len(usual)) :]


def _rows(old: Rows, more: int) -> Rows:
    """Rows of no pull below those of the pulls."""
    none, name = np.full(more, -1, dtype=np.int64), np.full(more, POSITIONS, dtype=object)
    nothing = np.zeros(more, dtype=np.int64)
    return Rows(
        np.append(old.pose, nothing),
        np.append(old.repeat, nothing),
        np.append(old.target, name),
        np.append(old.axis, nothing),
        np.append(old.pull, none),
    )


def _of_stance(system: System, stance: Stance, k: int) -> tuple[Array, Array]:
    """Springs and elements, errors of table and points, and the covariance of all, (s,), (s, s).

    Those of a are columns of the least squares as a ~ N(0, I); table and points err by F a.
    """
    white = whitener(system.errors, system.rows.pose)
    X = np.hstack([white.with_priors(system.B * system.typical), white.columns])
    inverse = linear.pseudoinverse(X)
    x, cov = inverse(white.with_priors(system.c)), inverse.half @ inverse.half.T
    p, n = system.B.shape[1], len(stance.compliance)
    own: Ints = np.flatnonzero(system.errors.source[system.errors.common] == POSITIONS)
    mine = np.r_[np.arange(n), np.arange(k, p), p + own]
    F = stance.parts[0]
    T = np.zeros((stance.springs + len(F), len(mine)))
    s = stance.springs
    T[:s, :s], T[s:, s:] = np.diag(system.typical[mine[:s]]), -F
    return T @ x[mine], T @ cov[np.ix_(mine, mine)] @ T.T
