"""Base reflectors read repeatedly: whether all of them share one rigid motion in time.

They are fixed to the floor; where their readings rotate and shift as one rigid body between two
times, the tracker moved. Their coordinates are free, so a wrong nominal one raises no alarm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import stats

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.diagnosis.blindspots import needed
from pipeline.diagnosis.facts import Drift
from pipeline.machine.effect import Effect, Observation
from pipeline.machine.effects.tracker_drift import HOUR_S, LAWS
from pipeline.reduction.register import XYZ, Registration
from pipeline.system import alarms
from pipeline.system.noise import TOLERATED

_FITS = 1e-3
"""Where a rigid motion leaves something this improbable, a reflector moved or was read badly."""

_DECIDES = 9.2
"""Drop of chi-square that separates one course of the motion from another: odds of 100."""

_LEVER_M = 10.0
"""Turns are estimated in shifts at this distance, for the conditioning."""


@dataclass(frozen=True, eq=False)
class _Base(Locked):
    """Base readings that have times: whitened columns that are free, and what was read.

    Attributes:
        white: Inverse Cholesky factors of the covariances, shape (k, 3, 3).
        fixed: Where each reflector stands, whitened, shape (3 k, 3 t).
        y: What was read, whitened, shape (3 k,).
        rigid: Shifts and turns about where the velocity is stated, the latter at LEVER_M,
            shape (k, 3, 6).
    """

    white: Array
    fixed: Array
    y: Array
    rigid: Array

    def columns(self, amount: Array) -> Array:
        """The rigid motion in proportion to some amount of each reading, whitened, (3 k, 6)."""
        return (self.white @ (amount[:, None, None] * self.rigid)).reshape(-1, 6)

    def fit(self, amount: Array) -> tuple[Array, Array, float]:
        """The motion, its covariance, and what is left of chi-square."""
        X = np.hstack([self.fixed, self.columns(amount)])
        inverse = linear.pseudoinverse(X).X
        x = inverse @ self.y
        left = self.y - X @ x
        return x[-6:], (inverse @ inverse.T)[-6:, -6:], float(left @ left)

    def beside(self, vector: Array) -> float:
        """Square of what the coordinates of the reflectors leave of a vector."""
        left = vector - self.fixed @ linear.least_squares(self.fixed, vector)
        return float(left @ left)


def drift(
    registration: Registration, scale: float, unloaded: Array, effects: Sequence[Effect]
) -> Drift | None:
    """Test the base reflectors for a motion of the tracker.

    y_k = p_t(k) + a(t_k) (v + w x (p_k - p_0)) + e_k,    e_k ~ N(0, scale^2 R C_k R'),

    read in F_b [m]; p_t free for each reflector t, a a law of `LAWS`, v and w velocity and turn
    about p_0. With chi2 the sum of squares left, s^2 = max(`TOLERATED`^2, chi2 / dof) and
    p = P[chi2(6) > (chi2 without v and w - chi2) / s^2].

    Args:
        registration: The base readings in F_b with their times.
        scale: Scatter of the tracker over its stated one; where none is stated, [m].
        unloaded: Where the effector was read [m], F_b, NaN unknown, shape (d, 3): the velocity is
            stated at their centre, else at that of the base reflectors.
        effects: The catalogue.

    Returns:
        None without times, with too few reflectors, or with one round of readings.
    """
    forms = [e for e in effects if isinstance(e, Observation) and e.form in LAWS]
    table = _repeated(registration.table)
    since = (table["time"] - table["time"].min()).dt.total_seconds().to_numpy()
    if not forms or table["target"].nunique() < 3 or since.max() <= 0:
        return None
    base = _base(registration, table, _stated_at(unloaded, registration), scale)
    dof = len(base.y) - base.fixed.shape[1] - 6
    if dof < 1:
        return None
    course = _course(base, forms, since)
    knocked = min((base.fit(after.astype(float))[2] for after in _rounds(table)), default=np.inf)
    return _stated(base, course, dof, knocked, table, float(np.ptp(since)))


@dataclass(frozen=True, eq=False)
class _Course(Locked):
    """The law of the tracker's motion that fits best.

    Attributes:
        effect: The law.
        amount: What of the motion each reading has felt, shape (k,).
        motion: Velocity and turn, the latter at LEVER_M, shape (6,).
        cov: Its covariance in units of the readings' variance, shape (6, 6).
        left: What is left of chi-square.
    """

    effect: Observation
    amount: Array
    motion: Array
    cov: Array
    left: float


def _repeated(table: pd.DataFrame) -> pd.DataFrame:
    """Readings with a time of reflectors that were read in several groups."""
    table = table[table["time"].notna()]
    return table[table.groupby("target")["group"].transform("nunique") > 1]


def _stated_at(unloaded: Array, registration: Registration) -> Array:
    """Where the velocity is stated [m], F_b, shape (3,)."""
    known = unloaded[np.isfinite(unloaded).all(axis=1)]
    return np.asarray(known.mean(axis=0) if len(known) else registration.centre)


def _course(base: _Base, forms: Sequence[Observation], since: Array) -> _Course:
    """The steady law, the first, unless another one fits better by `_DECIDES`."""
    amounts = [LAWS[effect.form](since) for effect in forms]
    steady, *others = (
        _Course(effect, amount, *base.fit(amount))
        for effect, amount in zip(forms, amounts, strict=True)
    )
    best = min(others, key=lambda one: one.left, default=steady)
    return best if best.left < steady.left - _DECIDES else steady


def _stated(
    base: _Base, course: _Course, dof: int, knocked: float, table: pd.DataFrame, seconds: float
) -> Drift:
    """What is stated of the motion; `knocked` is what one knock at the best time would leave."""
    left, motion = course.left, course.motion
    variance = max(TOLERATED**2, left / dof)
    p = float(stats.chi2.sf((base.beside(base.y) - left) / variance, 6))
    rigid = bool(stats.chi2.sf(left / TOLERATED**2, dof) > _FITS)
    typical = np.concatenate([[q.typical for q in course.effect.parameters], np.zeros(3)])
    shown = base.beside(base.columns(course.amount) @ typical) / variance
    parts = base.rigid @ motion * np.ptp(course.amount)
    std = np.sqrt(np.diag(course.cov) * max(1.0, left / dof))
    named = bool(p < alarms.DRIFT and rigid and knocked > left - _DECIDES)
    visible = float(np.sqrt(needed(6, alarms.DRIFT) / shown)) if rigid and shown > 0 else np.inf
    undecided = bool(knocked <= left + _DECIDES)
    return Drift(
        effect=_undecided(course.effect, table) if undecided else course.effect,
        velocity=motion[:3],
        std=std[:3],
        turn=motion[3:] / _LEVER_M,
        turn_std=std[3:] / _LEVER_M,
        moved_m=float(np.sqrt(np.mean(np.sum(parts**2, axis=1)))),
        hours=seconds / HOUR_S,
        p_value=p,
        named=named,
        undecided=undecided,
        visible=min(visible, 1.0) if named else visible,
    )


def _base(registration: Registration, table: pd.DataFrame, at: Array, scale: float) -> _Base:
    C = covariance.matrices(table)
    C = C if np.isfinite(C).all() else np.broadcast_to(np.eye(3), C.shape)
    R = registration.R
    white = linear.whitening(R @ C @ R.T * scale**2)
    points = table[XYZ].to_numpy(float)
    number = pd.factorize(table["target"])[0]
    which = np.eye(number.max() + 1)[number]
    fixed = np.einsum("kij,kt->kitj", white, which).reshape(3 * len(table), -1)
    turns = np.stack([np.cross(axis, points - at) for axis in np.eye(3)], axis=2) / _LEVER_M
    rigid = np.concatenate([np.tile(np.eye(3), (len(table), 1, 1)), turns], axis=2)
    off = table[["dx_m", "dy_m", "dz_m"]].to_numpy(float)  # small numbers keep digits for the fit
    return _Base(white, fixed, (white @ off[..., None]).ravel(), rigid)


def _rounds(table: pd.DataFrame) -> list[Bools]:
    """Which readings come after each pause between two rounds of readings, by their groups."""
    begun = table.groupby("group")["time"].transform("mean")
    return [(begun >= start).to_numpy() for start in sorted(begun.unique())[1:]]


def _undecided(effect: Observation, table: pd.DataFrame) -> Observation:
    """The effect, saying that a tracker that was knocked once would look the same."""
    groups = table.sort_values("time")["group"].unique()
    needs = (
        f"the base reflectors read again between {groups[0]} and {groups[-1]}: as they were read, "
        "nobody can tell a drift from a tracker that was knocked once"
    )
    return replace(effect, needs=needs)
