"""Mass and centre of a payload from the controller's joint torques, to check those stated.

A payload of mass m with its centre at c in the flange frame loads joint j by

    tau_j = z_j . ((p m + R m c) x g)    (sliding: m z_j . g),

linear in m and m c: p, R origin and axes of the flange, g gravity, F_b (Atkeson, An and Hollerbach,
Int. J. Robotics Research 5, 1986). Each joint's torque has an offset in addition.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import special

from pipeline.answer.contract import Body, Payload
from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.machine.robot import configure
from pipeline.machine.robot.configuration import torque
from pipeline.reduction.case import Case
from pipeline.reduction.settings import PayloadSettings

_FEWEST = 3
"""Minimum number of poses to separate a payload from an offset, and minimum degrees of freedom."""

_ROUNDS = 10
"""Iterations of weighting each joint by its residuals over its degrees of freedom (restricted
likelihood)."""

_SPARE = 1.0
"""Minimum degrees of freedom of a joint to estimate its scatter."""

_CHAINS, _SETTLE, _KEPT = 200, 20, 10
"""Number of parallel chains, and of steps of each that are discarded, and kept. 2000 draws give a
95 % interval to three parts in a hundred."""

_DARK = 1e-12
"""Fraction of the largest information below which a direction is rounding [1]."""

_SEED = 20261122
"""Seed of the random draws; another one changes results within their stated scatter."""

_WEIGHT = 2.0
"""Maximum weight, in readings, of the prior that the other joints give for the scatter of one
[1]."""

_ALIKE = 1e-3
"""Variance of the joints' log variances beyond chance below which all scatter alike [1]."""


def weighed(case: Case, stated: Sequence[Payload]) -> tuple[Payload, ...]:
    """The stated payloads, with what the logged torques determine of them."""
    return tuple(one.model_copy(update=_told(case, one)) for one in stated)


def _told(case: Case, stated: Payload) -> dict[str, Any]:
    """What torques determine of one payload; empty for nothing."""
    if case.torques is None or not len(case.torques):
        return {}
    pose, tau = _of(case, stated.name)
    if len(np.unique(pose)) < _FEWEST:
        return {}
    return _fit(case, case.settings.payload[stated.name], pose, tau)


def _of(case: Case, name: str) -> tuple[Ints, Array]:
    """Poses (m,) and torques (m, n) of one payload; NaN where a joint has none.

    Torques of its pull minus those of the same pose without load; in a log with one row per pose
    those of the row, of poses with one load only.
    """
    loads, log = case.loads, case.torques
    assert log is not None
    loads = loads[loads["payload"].astype(object) == name]
    tau = [f"tau{j}" for j in range(1, case.robot.n + 1)]
    if log["repeat"].isna().all():
        alone = case.loads.groupby("pose")["repeat"].transform("size") == 1
        loads = loads[alone.loc[loads.index]]
        both = loads.merge(log.drop(columns="repeat"), on="pose")
        return both["pose"].to_numpy(np.int64), both[tau].to_numpy(float)
    both = loads.merge(log, on=["pose", "repeat"])
    bare = log[log["repeat"] == 0].set_index("pose")[tau]
    pose = both["pose"].to_numpy(np.int64)
    return pose, both[tau].to_numpy(float) - bare.reindex(pose).to_numpy(float)


def _fit(case: Case, payload: PayloadSettings, pose: Ints, tau: Array) -> dict[str, Any]:
    """Estimate (m, m c) and offsets, integrating over the unknown scatter of each joint."""
    X, y, joint = _rows(case, payload, pose, tau)
    inverse = linear.pseudoinverse(X)
    dof = len(y) - inverse.rank
    if dof < _FEWEST:
        return {}
    n, size = case.robot.n, np.ones(case.robot.n)
    for _ in range(_ROUNDS):
        inverse = linear.pseudoinverse(X / size[joint, None])
        rest = y - X @ inverse(y / size[joint])
        spare = np.bincount(joint, 1 - np.sum(inverse.U**2, axis=1), n).astype(float)
        square = np.bincount(joint, rest**2, n).astype(float)
        weight, usual = _usual(square, spare)
        left = (weight * usual + square) / (weight + np.maximum(spare, 0.0))
        size = np.maximum(np.sqrt(left), _LEAST * np.abs(y).max())
    if not np.isfinite(np.diag(inverse.cov)[:4]).all():
        return {}
    drawn = _drawn(X, y, joint, size, (weight, usual))[:, :4]
    drawn *= np.sign(np.median(drawn[:, 0]))
    return _weighed(payload, drawn, dof, len(np.unique(pose)))


def _rows(
    case: Case, payload: PayloadSettings, pose: Ints, tau: Array
) -> tuple[Array, Array, Ints]:
    """Columns of (m, m c) and the offsets (k, 4 + n), torques (k,), joint of each (k,).

    The arm is bent by the stated payload.
    """
    q, body = case.q(pose), payload.mass_kg * np.array([1.0, *payload.center_m])
    straight = _by_payload(case, q)
    A = _by_payload(case, q + (straight @ body) * case.robot.nominal_compliance)
    n, known = case.robot.n, np.isfinite(tau)
    X = np.concatenate([A, np.broadcast_to(np.eye(n), (len(pose), n, n))], axis=-1)[known]
    return X, tau[known], np.broadcast_to(np.arange(n), tau.shape)[known]


def _by_payload(case: Case, q: Array) -> Array:
    """Torques [N m] or [N] per kg and kg m of (m, m c) at joint values (m, n), shape (m, n, 4)."""
    here, g = configure(case.robot, q), case.settings.gravity.vector
    force = np.broadcast_to(g, (len(q), 3))
    slid = here.twists[..., 3:] @ g  # effect of the force alone, not of a moment
    at = [torque(here.twists, here.flange_origin, force)]
    at += [torque(here.twists, here.flange_axes[:, :, k], force) - slid for k in range(3)]
    return np.stack(at, axis=-1)


def _usual(square: Array, spare: Array) -> tuple[float, float]:
    """Prior of the joints' scatter: its weight in readings, and a variance s_0^2.

    From the mean and the variance of log(square_j / d_j) (Smyth, Stat. Appl. Genet. Mol. Biol. 3,
    2004); the weight is at most `_WEIGHT`, since a few joints may agree by chance.
    """
    told = (spare > _SPARE) & (square > 0)
    if not told.any():
        return 0.0, 0.0
    d = spare[told]
    logs = np.log(square[told] / d) - special.digamma(d / 2) + np.log(d / 2)
    more = float(np.var(logs, ddof=1) - np.mean(special.polygamma(1, d / 2))) if len(d) > 1 else 0.0
    if more < _ALIKE:
        return _WEIGHT, float(np.exp(np.mean(logs)))
    half = _trigamma_inverse(more)
    usual = float(np.exp(np.mean(logs) + special.digamma(half) - np.log(half)))
    return min(2 * half, _WEIGHT), usual


def _drawn(X: Array, y: Array, joint: Ints, size: Array, usual: tuple[float, float]) -> Array:
    """Posterior draws of all parameters, shape (d, k), from the torques, with the scatters unknown.

    Gibbs sampler, `_CHAINS` in parallel: b given the scatters is N(N^-1 g, N^-1), N = X' S^-2 X,
    and s_j^2 given b is (d_0 s_0^2 + sum r_j^2) / chi2(d_0 + n_j) (Gelfand et al., J. Am. Stat.
    Assoc. 85, 1990). Treating scatters from a few readings as known would make the weights too
    certain.
    """
    rng, n = np.random.default_rng(_SEED), len(size)
    unit = np.linalg.norm(X, axis=0)
    unit = np.where(unit > 0, unit, 1.0)
    own = [np.where((joint == j)[:, None], X / unit, 0.0) for j in range(n)]
    XX, Xy = np.stack([x.T @ x for x in own]), np.stack([x.T @ y for x in own])
    readings = np.bincount(joint, minlength=n)
    least = (_LEAST * np.abs(y).max()) ** 2
    variance, out = np.tile(size**2, (_CHAINS, 1)), []
    for turn in range(_SETTLE + _KEPT):
        N = np.einsum("cj,jab->cab", 1 / variance, XX)
        values, R = linear.directions(N)
        half = R / np.sqrt(np.maximum(values, _DARK * values[:, -1:]))[:, None, :]
        g = np.einsum("cj,ja->ca", 1 / variance, Xy)
        turned = np.einsum("cai,ca->ci", half, g) + rng.standard_normal(g.shape)
        b = np.einsum("cai,ci->ca", half, turned) / unit
        rest = (y - b @ X.T) ** 2
        square = np.stack([rest[:, joint == j].sum(axis=1) for j in range(n)], axis=1)
        drawn = rng.chisquare(np.maximum(usual[0] + readings, 1.0), square.shape)
        variance = np.maximum((usual[0] * usual[1] + square) / drawn, least)
        out += [b] if turn >= _SETTLE else []
    return np.concatenate(out)


def _trigamma_inverse(value: float) -> float:
    """The x of trigamma(x) = value, by Newton's method on 1 / trigamma, which is nearly linear."""
    x = 0.5 + 1 / value
    for _ in range(20):
        now = special.polygamma(1, x)
        x += now * (1 - now / value) / special.polygamma(2, x)
    return float(x)


_LOST = 0.025
"""Probability of a mass of zero or less above which no payload is reported [1]."""

_LEAST = 1e-9
"""Fraction of the largest torque below which it is rounding [1]."""


def _weighed(payload: PayloadSettings, drawn: Array, dof: int, poses: int) -> dict[str, Any]:
    """Mass and centre from draws of (m, m c), and their p-value against the stated ones.

    Uncertainties are scaled so that the 95 % interval of Student's tails is 1.96 of them to either
    side.

    F = (t - t0)' (C + C0)^-1 (t - t0) / 4 with 4 and `dof` degrees of freedom, t0 and C0 those
    stated; the sign convention of the controller's torques is not judged.
    """
    theta, cov = drawn.mean(axis=0), np.cov(drawn.T)
    if theta[0] <= 0 or (drawn[:, 0] <= 0).mean() > _LOST:
        return {}
    m, center = theta[0], theta[1:] / theta[0]
    stated = np.array(payload.center_m)
    off = theta - payload.mass_kg * np.array([1.0, *stated])
    E = np.zeros((4, 4))
    E[:, 0] = [1.0, *stated]
    E[1:, 1:] = payload.mass_kg * np.eye(3)
    sigma = np.array([payload.mass_sigma_kg, *[payload.center_sigma_m] * 3])
    both = cov + (E * sigma**2) @ E.T
    F = float(off @ linear.solve(both, off)) / 4
    # d(c) = (d(m c) - c dm) / m
    centers = center + (drawn[:, 1:] - theta[1:] - np.outer(drawn[:, 0] - m, center)) / m
    (x, y, z), (a, b, c) = center.tolist(), _std(centers).tolist()
    found = Body(
        mass_kg=float(m),
        mass_std_kg=float(_std(drawn[:, 0])),
        center_m=(x, y, z),
        center_std_m=(a, b, c),
    )
    return {"found": found, "poses": poses, "p_value": float(special.fdtrc(4, dof, F))}


def _std(drawn: Array) -> Array:
    """Half of the 95 % interval over 1.96: draws have Student's tails."""
    low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
    return np.asarray((high - low) / (2 * special.ndtri(0.975)))
