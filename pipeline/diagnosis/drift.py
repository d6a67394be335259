"""Base reflectors read repeatedly: whether a common rigid motion in time explains their changes.

They are fixed to the floor; where their readings rotate and shift as one rigid body between two
times, the tracker moved. Their coordinates are free parameters, so a wrong nominal one raises no
alarm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.tails import chi2_beyond
from pipeline.diagnosis.blindspots import needed
from pipeline.diagnosis.facts import Drift
from pipeline.machine.effect import Effect, Observation
from pipeline.machine.effects.tracker_drift import HOUR_S, LAWS, PER_GROUP, amount, by_order
from pipeline.reduction.expected import expected
from pipeline.reduction.register import XYZ, Registration, seconds, timed
from pipeline.system import alarms, odds
from pipeline.system.family import FAR_OFF
from pipeline.system.fit import Fitted
from pipeline.system.scatter import TOLERATED_FACTOR
from pipeline.system.score_tests import Base, ScoreTests
from pipeline.system.wander import Wander

_ROUNDS = 100
"""Maximum number of rounds of readings that are tested for separate motions; of more, only a motion
in time is."""

_MANY = 1000
"""Number of readings above which they are averaged in rounds: all pairs of a thousand are 8 MB."""
_SPANS = 100
"""Number of time spans, hence rounds, into which the readings are averaged."""
_OFF = ["dx_m", "dy_m", "dz_m"]

_LEVER_M = 10.0
"""Lever at which rotations are expressed as translations [m], for the conditioning."""


def motion(of: Fitted) -> tuple[tuple[Effect, ...], Drift | None]:
    """The catalogue of a campaign, and the motion of its tracker that the base reflectors show."""
    effects, readings = expected(of.case, of.data), of.reduced.registration
    if not timed(of.case.readings):
        effects = by_order(effects)
    scale = float(of.noise.scale[0])
    found = drift(readings, scale, of.data.unloaded, effects, of.shape.wander)
    if found is None or (grown := readings.course) is None or grown.p_value >= alarms.GREW:
        return effects, found
    R, t, scale = readings.R, readings.t, 1 + readings.growth.value
    grown = grown.seen_from(R.T, -t @ R / scale, 1 / scale)
    return effects, replace(found, deformed_m=grown.std_m, grown=grown)


def drift(
    registration: Registration,
    scale: float,
    unloaded: Array,
    effects: Sequence[Effect],
    wander: Wander | None = None,
) -> Drift | None:
    """Test the base reflectors for a motion of the tracker.

    y_k = p_t(k) + a(t_k) (v + w x (p_k - p_0)) + e_k,    e_k ~ N(0, scale^2 R C_k R'),

    read in F_b [m]; p_t free for each reflector t, a a law of `LAWS`, v and w velocity and angular
    velocity about p_0. With chi2 the residual sum of squares, s^2 = max(`TOLERATED_FACTOR`^2, chi2
    / dof) and p = P[chi2(6) > (chi2 without v and w - chi2) / s^2].

    Args:
        registration: The base readings in F_b with their times.
        scale: Scatter of the tracker over its stated one; where none is stated, [m].
        unloaded: Positions of the effector [m], F_b, NaN where unknown, shape (d, 3): the velocity
            is stated at their centre, else at that of the base reflectors.
        effects: The catalogue.
        wander: Wander of the instrument found in the displacements, which moves all reflectors
            alike from one round to the next.

    Returns:
        None without times, unless the laws are by the order of rows; with too few reflectors; or
            with one round of readings.
    """
    forms = [e for e in effects if isinstance(e, Observation) and e.form in LAWS]
    by_order = any(e.parameters[0].unit == PER_GROUP for e in forms)
    table = in_rounds(_repeated(registration.table, by_order))
    since = table["since"].to_numpy(float)
    if not forms or table["target"].nunique() < 3 or since.max() <= 0:
        return None
    known = unloaded[np.isfinite(unloaded).all(axis=1)]
    at = known.mean(axis=0) if len(known) else registration.centre
    base, white, rigid = _base(registration, table, at, scale, since, wander)
    if base.dof < 7:
        return None
    amounts = [amount(effect, since) for effect in forms]
    laws = _moved(base, white @ rigid, amounts)
    # the steady law, which is the first, unless another one fits better by `odds.DECIDES`
    best = int(np.argmax(laws.drop - odds.DECIDES * (np.arange(len(forms)) > 0)))
    knocks = _moved(base, white @ rigid, [after.astype(float) for after in _rounds(table)])
    better = max(knocks.drop, default=-np.inf) - float(laws.drop[best])
    parts = rigid @ laws.size[best] * np.ptp(amounts[best])
    moved_m = float(np.sqrt(np.mean(np.sum(parts**2, axis=1))))
    hours = float(np.ptp(since)) / HOUR_S
    found = _stated(forms[best], laws, best, float(better), moved_m, hours)
    each = _each_round(base, table, white, rigid)
    found = replace(found, deformed_m=_deformed(each, white))
    if not found.named:
        return _knocked(found, each, table, white, rigid)
    return replace(found, effect=_undecided(found.effect, table)) if found.undecided else found


def _each_round(base: Base, table: pd.DataFrame, white: Array, rigid: Array) -> ScoreTests | None:
    """One rigid motion of each round, y_k = p_t(k) + v_r(k) + w_r(k) x (p_k - p_0) + e_k.

    None where there are too many rounds.
    """
    after = _rounds(table)
    if not 0 < len(after) < _ROUNDS:
        return None
    columns = (white @ rigid)[:, :, None, :] * np.array(after).T[:, None, :, None]
    return base.beside(columns.reshape(1, 3 * len(table), 1, -1)).of_block(0)


def _beyond(each: ScoreTests) -> tuple[float, int]:
    """Residual sum of squares beside a motion of each round, and its degrees of freedom."""
    return float(each.rest - each.drop[0]), each.dof - int(each.rank[0])


def _unit_m(white: Array) -> float:
    """Standard uncertainty of a base reading per axis [m]."""
    return float(np.sqrt(3 / np.mean(np.sum(white**2, axis=(1, 2)))))


def _deformed(each: ScoreTests | None, white: Array) -> float:
    """`Drift.deformed_m`, as for a base frame that grows with the hall."""
    left, dof = (0.0, 0) if each is None else _beyond(each)
    if dof < 1 or chi2_beyond(left / TOLERATED_FACTOR**2, dof) > odds.FITS:
        return 0.0
    return _unit_m(white) * float(np.sqrt(left / dof))


def _knocked(
    law: Drift, each: ScoreTests | None, table: pd.DataFrame, white: Array, rigid: Array
) -> Drift:
    """The result, with the rounds between which the tracker moved significantly, if there are any.

    P[chi2 > drop] < alarms.MOVED of a motion of each round, where this explains all differences
    between the rounds, and the largest step moves the reflectors by more than `FAR_OFF` standard
    uncertainties, rms.
    """
    if each is None or law.deformed_m > 0 or _beyond(each)[1] < 1:
        return law
    size = each.size[0].reshape(-1, 6)
    steps = np.sqrt(np.mean(np.sum((rigid @ size.T) ** 2, axis=1), axis=0))
    most = int(np.argmax(steps))
    chance = each.p(TOLERATED_FACTOR**2, np.inf)[0]
    if chance >= alarms.MOVED or steps[most] <= FAR_OFF * _unit_m(white):
        return law
    begun = table.groupby(table["group"].astype(str))["since"].mean().sort_values()
    return replace(law, knocked=tuple(begun.index[most : most + 2]), moved_m=float(steps[most]))


def _repeated(table: pd.DataFrame, by_order: bool) -> pd.DataFrame:
    """Readings with a time, `since` the first [s], of reflectors that were read in several groups.

    Args:
        table: Table REGISTRATION.
        by_order: Whether no reading of the campaign has a time, so that the order of rows replaces
            it.
    """
    if not by_order:
        table = table[table["time"].notna()]
        table = table.assign(time_s=seconds(table))
    table = table.assign(since=table["time_s"] - table["time_s"].min())
    return table[table.groupby("target")["group"].transform("nunique") > 1]


def _moved(base: Base, motions: Array, amounts: Sequence[Array]) -> ScoreTests:
    """Whitened rigid motions, scaled by each of several amounts per reading, given the base."""
    columns = np.array(amounts).reshape(-1, len(motions), 1, 1) * motions
    shape = 1, 3 * len(motions), len(amounts), 6
    return base.beside(np.moveaxis(columns, 0, 2).reshape(shape)).of_block(0)


def _stated(
    effect: Observation,
    laws: ScoreTests,
    best: int,
    knocked: float,
    moved_m: float,
    hours: float,
) -> Drift:
    """Result for the best law; `knocked` is the margin by which a single knock fits better."""
    left, dof, motion = float(laws.rest - laws.drop[best]), laws.dof - 6, laws.size[best]
    variance = max(TOLERATED_FACTOR**2, left / dof)
    p = float(laws.p(variance, np.inf)[best])
    # what remains is a reflector that moved or was read badly
    rigid = bool(chi2_beyond(left / TOLERATED_FACTOR**2, dof) > odds.FITS)
    typical = np.concatenate([[q.typical for q in effect.parameters], np.zeros(3)])
    shown = typical @ laws.N[best] @ typical / variance
    std = np.sqrt(np.diag(laws.cov[best]) * max(1.0, left / dof))
    named = bool(p < alarms.DRIFT and rigid and knocked < odds.DECIDES)
    visible = float(np.sqrt(needed(6, alarms.DRIFT) / shown)) if rigid and shown > 0 else np.inf
    undecided = bool(knocked >= -odds.DECIDES)
    return Drift(
        effect=effect,
        velocity=motion[:3],
        std=std[:3],
        turn=motion[3:] / _LEVER_M,
        turn_std=std[3:] / _LEVER_M,
        moved_m=moved_m,
        hours=hours,
        p_value=p,
        named=named,
        undecided=undecided,
        visible=min(visible, 1.0) if named else visible,
    )


def _base(
    registration: Registration,
    table: pd.DataFrame,
    at: Array,
    scale: float,
    since: Array,
    wander: Wander | None,
) -> tuple[Base, Array, Array]:
    """The base with the reflectors' positions, the whitening, and rigid motions of the readings.

    Whitening (k, 3, 3); motions (k, 3, 6): translations, and rotations about `at` at `_LEVER_M`.
    """
    C = covariance.weighing(table)
    R = registration.R
    white = linear.whitening(R @ C @ R.T * scale**2)
    points = table[XYZ].to_numpy(float)
    which = np.eye(table["target"].nunique())[pd.factorize(table["target"])[0]]
    fixed = np.einsum("kij,kt->kitj", white, which).reshape(3 * len(table), -1)
    rigid = linear.motions((points - at) / _LEVER_M)
    off = table[_OFF].to_numpy(float)  # small numbers keep digits in the fit
    y = (white @ off[..., None]).ravel()
    if wander is not None and wander.process.any():
        F = wander.of_readings(since, points - registration.tracker)
        common = (white @ F).reshape(len(y), -1)
        known = np.eye(common.shape[1], fixed.shape[1] + common.shape[1], fixed.shape[1])
        fixed = np.vstack([np.hstack([fixed, common]), known])
        y = np.append(y, np.zeros(common.shape[1]))
    return Base.of(fixed, y), white, rigid


def _rounds(table: pd.DataFrame) -> list[Bools]:
    """Masks of the readings after each interval between two rounds (groups of readings)."""
    begun = table.groupby("group")["since"].transform("mean")
    return [(begun >= start).to_numpy() for start in sorted(begun.unique())[1:]]


def _undecided(effect: Observation, table: pd.DataFrame) -> Observation:
    """The effect, with a note that a tracker that was knocked once would look the same."""
    groups = table.sort_values("since")["group"].unique()
    needs = (
        f"the base reflectors read again between {groups[0]} and {groups[-1]}: as they were read, "
        "nobody can tell a drift from a tracker that was knocked once"
    )
    return replace(effect, needs=needs)


def in_rounds(table: pd.DataFrame) -> pd.DataFrame:
    """Average many readings, by reflector and span of time.

    p = C sum C_k^-1 p_k, C = (sum C_k^-1)^-1 (m and m^2, F_b), at the mean of their times: a motion
    that is linear within a hundredth of the campaign has the same effect on the means. Up to
    `_MANY` readings are returned unchanged.

    Args:
        table: Table REGISTRATION with `since`, seconds after the first reading.
    """
    if len(table) <= _MANY:
        return table
    since = table["since"].to_numpy(float)
    whole_s = since.max() or 1.0  # without times a group is read at once
    span = np.minimum((since / whole_s * _SPANS).astype(np.int64), _SPANS - 1)
    target, names = pd.factorize(table["target"])
    _, first, which = np.unique(span * len(names) + target, return_index=True, return_inverse=True)
    W = covariance.alike(covariance.weighing(table), linear.inverse)
    whole = linear.inverse(_sums(W.reshape(-1, 9), which).reshape(-1, 3, 3))
    values = table[[*XYZ, *_OFF]].to_numpy(float)
    sums = _sums(np.einsum("kij,kaj->kai", W, values.reshape(-1, 2, 3)).reshape(-1, 6), which)
    means = np.einsum("kij,kaj->kai", whole, sums.reshape(-1, 2, 3)).reshape(-1, 6)
    count = np.bincount(which)
    out = table.iloc[first].copy()
    out[[*XYZ, *_OFF]] = means
    out[covariance.columns()] = covariance.flat(whole)
    out["since"] = np.bincount(which, since) / count
    begins = table["group"].astype(str).to_numpy()[first]
    out["group"] = [f"{name} ({k})" for name, k in zip(begins, span[first], strict=True)]
    return out


def _sums(rows: Array, which: Ints) -> Array:
    """Sums of the rows with the same number in `which`, shape (numbers, columns)."""
    return np.column_stack([np.bincount(which, column) for column in rows.T])
