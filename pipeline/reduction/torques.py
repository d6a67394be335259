"""What the controller's joint torques say of a payload: its mass and centre, beside those stated.

A payload of mass m with its centre at c in the flange frame turns joint j by

    tau_j = z_j . ((p m + R m c) x g)    (sliding: m z_j . g),

linear in m and m c: p, R origin and axes of the flange, g gravity, F_b (Atkeson, An and Hollerbach,
Int. J. Robotics Research 5, 1986). A torque has besides an offset, one for each joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.machine.robot import configure
from pipeline.machine.robot.configuration import torque
from pipeline.reduction.case import Case
from pipeline.reduction.settings import Payload

CONTRADICTS = 0.001
"""Mass and centre so unlike the stated ones that chance makes them rarer contradict these [1]."""

_FEWEST = 3
"""Fewer poses tell no payload from an offset."""

_ROUNDS = 10
"""Of weighing each joint by what it leaves over its degrees of freedom (restricted likelihood)."""

_SPARE = 1.0
"""Fewer degrees of freedom of a joint tell no scatter."""

_ALIKE = 1e-3
"""Joints whose log variances differ by less beyond chance scatter alike."""


@dataclass(frozen=True, eq=False)
class Weighed(Locked):
    """A payload as the joint torques have it.

    Attributes:
        mass: [kg].
        mass_std: Its standard uncertainty, that of the torques' own scatter.
        center: Flange frame [m], shape (3,).
        center_std: Its standard uncertainties, infinite where no pose tells, shape (3,).
        poses: How many it rests on.
        p_value: Probability of being so unlike the stated payload, whose uncertainties count.
    """

    mass: float
    mass_std: float
    center: Array
    center_std: Array
    poses: int
    p_value: float


def weighed(case: Case) -> dict[str, Weighed]:
    """Each payload that the log's torques determine, by name."""
    if case.torques is None or not len(case.torques):
        return {}
    out: dict[str, Weighed] = {}
    for name, payload in case.settings.payload.items():
        pose, tau = _of(case, name)
        if len(np.unique(pose)) >= _FEWEST:
            found = _fit(case, payload, pose, tau)
            out |= {name: found} if found else {}
    return out


def _of(case: Case, name: str) -> tuple[Ints, Array]:
    """Poses (m,) and torques (m, n) of one payload; NaN where a joint has none.

    Those of its pull less those of the same pose without load, where the log has both; in a log
    with one row for a pose those of the row, which then are of the load alone.
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


def _fit(case: Case, payload: Payload, pose: Ints, tau: Array) -> Weighed | None:
    """Least squares of (m, m c) and offsets, each joint weighed by what it leaves."""
    here, g = configure(case.robot, case.q(pose)), case.settings.gravity.vector
    n, force = case.robot.n, np.broadcast_to(g, (len(pose), 3))
    slid = here.twists[..., 3:] @ g  # what a force does and a pure moment does not
    at = [torque(here.twists, here.flange_origin, force)]
    at += [torque(here.twists, here.flange_axes[:, :, k], force) - slid for k in range(3)]
    A = np.stack(at, axis=-1)  # (m, n, 4)
    known = np.isfinite(tau)
    X = np.concatenate([A, np.broadcast_to(np.eye(n), (len(pose), n, n))], axis=-1)[known]
    y, joint = tau[known], np.broadcast_to(np.arange(n), tau.shape)[known]
    dof = len(y) - linear.pseudoinverse(X).rank
    if dof < _FEWEST:
        return None
    size, theta, cov = np.ones(n), np.zeros(4), np.eye(4)
    for _ in range(_ROUNDS):
        inverse = linear.pseudoinverse(X / size[joint, None])
        value = inverse(y / size[joint])
        rest = y - X @ value
        spare = np.bincount(joint, 1 - np.sum(inverse.U**2, axis=1), n).astype(float)
        left = _scatter(np.bincount(joint, rest**2, n).astype(float), spare)
        theta, cov = value[:4], inverse.cov[:4, :4]
        size = np.maximum(left, _LEAST * np.abs(y).max())
    return _weighed(payload, np.sign(theta[0]) * theta, cov, dof, len(np.unique(pose)))


def _scatter(square: Array, spare: Array) -> Array:
    """Standard uncertainty of each joint's torque from sums of squares and degrees of freedom.

    s_j^2 = (d_0 s_0^2 + square_j) / (d_0 + d_j), s_0 and d_0 from the mean and the variance of
    log(square_j / d_j): joints that differ no more than by chance share one scatter, for a few
    readings of each would weigh themselves (Smyth, Stat. Appl. Genet. Mol. Biol. 3, 2004).
    """
    told = (spare > _SPARE) & (square > 0)
    if not told.any():
        return np.zeros(len(square))
    d = spare[told]
    logs = np.log(square[told] / d) - special.digamma(d / 2) + np.log(d / 2)
    more = float(np.var(logs, ddof=1) - np.mean(special.polygamma(1, d / 2))) if len(d) > 1 else 0.0
    if more < _ALIKE:
        return np.full(len(square), np.sqrt(square.sum() / spare.sum()))
    half = _trigamma_inverse(more)
    s0 = np.exp(np.mean(logs) + special.digamma(half) - np.log(half))
    return np.sqrt((2 * half * s0 + square) / (2 * half + np.maximum(spare, 0.0)))


def _trigamma_inverse(value: float) -> float:
    """The x of trigamma(x) = value, by Newton's method on 1 / trigamma, nearly a straight line."""
    x = 0.5 + 1 / value
    for _ in range(20):
        now = special.polygamma(1, x)
        x += now * (1 - now / value) / special.polygamma(2, x)
    return float(x)


_LEAST = 1e-9
"""Part of the largest torque that is rounding."""


def _weighed(payload: Payload, theta: Array, cov: Array, dof: int, poses: int) -> Weighed | None:
    """Mass and centre from (m, m c), and how likely they are the stated ones.

    F = (t - t0)' (C + C0)^-1 (t - t0) / 4 with 4 and `dof` degrees of freedom, t0 and C0 those
    stated; the sense in which a controller counts torques is not judged.
    """
    if not np.isfinite(np.diag(cov)).all() or theta[0] <= 0:
        return None
    m, center = theta[0], theta[1:] / theta[0]
    # d(c) = (d(m c) - c dm) / m
    D = np.column_stack([-center, np.eye(3)]) / m
    stated = np.array(payload.center_m)
    off = theta - payload.mass_kg * np.array([1.0, *stated])
    E = np.zeros((4, 4))
    E[:, 0] = [1.0, *stated]
    E[1:, 1:] = payload.mass_kg * np.eye(3)
    sigma = np.array([payload.mass_sigma_kg, *[payload.center_sigma_m] * 3])
    both = cov + (E * sigma**2) @ E.T
    F = float(off @ linear.solve(both, off)) / 4
    return Weighed(
        mass=float(m),
        mass_std=float(np.sqrt(cov[0, 0])),
        center=center,
        center_std=np.sqrt(np.diag(D @ cov @ D.T)),
        poses=poses,
        p_value=float(special.fdtrc(4, dof, F)),
    )
