"""Causes of the catalogue in positions: which laws are estimated, and which causes are present.

A cause is a group of parameters b of the estimate, estimated together with all others. With the
information N of the readings about b,

    T = b' N b,    N = C_b^-1 - P_b,

where C_b is the posterior covariance and P_b the prior precision. T is compared with the largest of
any cause in copies whose residuals have flipped signs (`search.flips`); a cause is present if it
also improves the prediction of left-out poses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.geometry.arm_weight import carried_by
from pipeline.machine.effects._anatomy import rail, turning
from pipeline.machine.robot import Robot, configure
from pipeline.machine.robot.weight import by_moments
from pipeline.positions import law_tests
from pipeline.positions.calibrate import Calibration
from pipeline.positions.cross_validation import NO_GAIN, LeftOutGain, LeftOutPoses
from pipeline.positions.estimate import precision
from pipeline.positions.laws import JointLaw
from pipeline.positions.mechanism import Mechanism, layout
from pipeline.positions.yielding import LOADED, balanced
from pipeline.system import alarms
from pipeline.system.evidence import LEAST_EVIDENCE


class _Amount(NamedTuple):
    """One parameter of a cause in SI units, with its standard uncertainty and its meaning."""

    name: str
    unit: str
    value: float
    std: float
    meaning: str


@dataclass(frozen=True)
class CatalogueCause:
    """A cause of the catalogue that the readings call for.

    Attributes:
        name: Name in the list of causes (docs/causes.md).
        where: Joint from 1, `upper_arm`, `forearm`, or None where there is one place only.
        form: Form of the law.
        amounts: Its parameters.
        p: Probability that any cause appears as large in readings without one.
        gain: Reduction of the error at left-out poses whose neighbours in time are kept.
        carried: Reduction of the error at left-out series or parts of joint space.
    """

    name: str
    where: int | str | None
    form: str
    amounts: tuple[_Amount, ...]
    p: float = 1.0
    gain: LeftOutGain = NO_GAIN
    carried: LeftOutGain = NO_GAIN


class CatalogueLaw(NamedTuple):
    """A joint law and its cause in the catalogue; an empty name where any gear may have it."""

    name: str
    law: JointLaw


_WAVES = (1.0, 2.0, 3.0)
"""Periods per turn of a joint [1]: an eccentric wheel, an oval one, three bolts. A wave over less
than a period cannot be told from any other curve, and does not predict angles beyond."""


def listed(robot: Robot, q: Array, tau: Array) -> tuple[CatalogueLaw, ...]:
    """Laws that are always estimated, with the magnitudes that the readings show.

    Args:
        robot: The robot.
        q: Joint values of the readings [m] or [rad], shape (m, n).
        tau: Torque of the weight on each joint [N m], shape (m, n); zero where unknown.
    """
    return tuple(_listed(robot, q, tau))


def _listed(robot: Robot, q: Array, tau: Array) -> Iterator[CatalogueLaw]:
    if rail(robot) and np.ptp(q[:, 0]) > 0:
        middle, half = float(q[:, 0].max() + q[:, 0].min()) / 2, float(np.ptp(q[:, 0])) / 2
        yield CatalogueLaw("rail_scale", JointLaw(1, "smooth", "angle", 1, 1.0, middle, half))
    shoulder = balanced(robot) if tau.any() else None
    for joint in turning(robot):
        yield from _waves(joint, joint == shoulder, np.ptp(q[:, joint - 1]))


def _waves(joint: int, shoulder: bool, span: float) -> Iterator[CatalogueLaw]:
    """Waves over a joint's angle; for a balanced shoulder the first two are its compensator's."""
    for order in _WAVES:
        law = JointLaw(joint, "periodic", "angle", joint, order)
        name = "compensator" if shoulder and law.by_balancer else ""
        if name or order * span > np.pi:
            yield CatalogueLaw(name, law)


# --- groups of parameters -------------------------------------------------------------------------


class _Group(NamedTuple):
    cause: CatalogueCause
    at: Ints


def _groups(found: Calibration, names: tuple[CatalogueLaw, ...]) -> Iterator[_Group]:
    """Every cause of the catalogue in the model, with the indices of its parameters."""
    mechanism, where = found.mechanism, layout(found.mechanism)
    x, std = found.solution.x, np.sqrt(np.diag(found.cov))
    first = where.yields.start
    for effect in mechanism.elements:
        at = np.arange(first, first + len(effect.parameters))
        first = int(at[-1]) + 1
        amounts = tuple(
            _Amount(one.name, one.unit, float(x[k]), float(std[k]), one.meaning)
            for one, k in zip(effect.parameters, at, strict=True)
        )
        yield _Group(CatalogueCause(effect.name, effect.where, effect.form, amounts), at)
    yield from _of_laws(mechanism, names, where.laws.start, x, std)
    yield from _of_bed(found)


def _of_laws(
    mechanism: Mechanism, names: tuple[CatalogueLaw, ...], first: int, x: Array, std: Array
) -> Iterator[_Group]:
    """One group for all laws of the same name and joint."""
    parts: dict[tuple[str, int], list[int]] = {}
    said: dict[tuple[str, int], list[_Amount]] = {}
    for name, law in names:
        at = list(range(first, first + law.amplitudes))
        first += law.amplitudes
        if name:
            key = name, law.joint
            parts.setdefault(key, []).extend(at)
            said.setdefault(key, []).extend(_amounts(name, law, x[at], std[at]))
    for (name, joint), at in parts.items():
        form = "two harmonics" if name == "compensator" else ""
        yield _Group(CatalogueCause(name, None, form, tuple(said[name, joint])), np.array(at))


def _amounts(name: str, law: JointLaw, x: Array, std: Array) -> Iterator[_Amount]:
    if name == "rail_scale":
        value, spread = float(x[0]) / law.scale, float(std[0]) / law.scale
        yield _Amount("scale", "1", value, spread, "correction of the pitch of the rack")
    else:
        for part, a, s in zip(("cos", "sin"), x, std, strict=True):
            text = f"{part} part of order {law.order:g} of the shoulder's deflection"
            yield _Amount(f"turn_{part}{law.order:g}", "rad", float(a), float(s), text)


_MOTIONS = {
    **{axis: f"rms deviation of the rail along {axis}" for axis in "xyz"},
    **{f"r{axis}": f"rms rotation of the rail about {axis}" for axis in "xyz"},
}
"""Motions of a carriage along its bed: the letters of each, and what its size is called."""


def _of_bed(found: Calibration) -> Iterator[_Group]:
    """The six curves of the bed as one group, each by its rms over the poses.

    A mean, and for translations also a straight line, is removed first.
    """
    mechanism, n = found.mechanism, found.mechanism.table.n
    at, amounts, places = layout(mechanism).knots.start, [], []
    q = found.readings.q[:, 0]
    plain = np.stack([np.ones(len(q)), q], axis=1)
    for curve in mechanism.curves:
        part = np.arange(at, at + curve.count)
        at += curve.count
        if curve.screw < n:
            continue
        axis, rows = curve.screw - n, curve.rows(q).toarray()
        free = plain if axis < 3 else plain[:, :1]  # a tilted line is a rotation of the frame
        rows = rows - free @ linear.least_squares(free, rows)
        f, cov = rows @ found.solution.x[part], found.cov[np.ix_(part, part)]
        rms = linear.rms(f)
        slope = rows.T @ f / len(f) / max(rms, 1e-300)
        unit, spread = "m" if axis < 3 else "rad", float(np.sqrt(slope @ cov @ slope))
        letters, meaning = list(_MOTIONS.items())[axis]
        amounts.append(_Amount(f"s_{letters}", unit, rms, spread, meaning))
        places.append(part)
    if places:
        yield _Group(CatalogueCause("rail_shape", None, "", tuple(amounts)), np.concatenate(places))


def weight(found: Calibration) -> CatalogueCause:
    """Sag of an arm whose masses are not as stated, as far as the readings determine it.

    A joint of compliance c turns by c M under the torque M of the weight of its links. M is given
    where payloads, or masses in the file, separate the two (relative uncertainty of c below
    `_APART`; the form is `masses` if they do in all joints, else `moments`), otherwise c M, which
    is all that the readings determine. Each is the largest magnitude at the measured poses, without
    any payload.
    """
    mechanism, where = found.mechanism, layout(found.mechanism)
    n, cov = mechanism.table.n, found.cov
    at = np.r_[where.compliance, where.moments]
    c, std = mechanism.compliance, np.sqrt(np.diag(cov)[where.compliance])
    here = configure(mechanism.robot, found.readings.q)
    slopes = carried_by(here.twists, np.arange(1, n + 1), by_moments(here, found.weights.gravity))
    tau = slopes @ mechanism.moments.ravel()
    most = np.abs(tau).max(axis=0)
    loaded = ~mechanism.table.prismatic & (most >= LOADED * most.max())
    apart = std < _APART * np.abs(c)
    amounts = []
    for j in np.flatnonzero(loaded):
        pose = int(np.abs(tau[:, j]).argmax())
        by_c, by_tau = (0.0, 1.0) if apart[j] else (tau[pose, j], c[j])
        slope = np.append(by_c * (np.arange(n) == j), by_tau * slopes[pose, j])
        value, spread = most[j] * by_tau, float(np.sqrt(slope @ cov[np.ix_(at, at)] @ slope))
        if spread < value:
            name = mechanism.table.joints[j].name
            symbol, unit, of = ("M", "N m", "torque") if apart[j] else ("e", "rad", "sag")
            meaning = f"{of} of {name} under the weight of its links, largest of all poses"
            amounts.append(_Amount(f"{symbol}_{name}", unit, value, spread, meaning))
    form = "masses" if apart[loaded].all() else "moments"
    return CatalogueCause("gravity_sag", None, form, tuple(amounts))


OTHER_MASSES = "other masses"
"""Form of a sag by links whose masses differ from the robot file."""

_APART = 0.2
"""Relative uncertainty of a compliance below which mass and stiffness count as separated [1]."""


# --- which are there ------------------------------------------------------------------------------


def causes(
    found: Calibration, names: tuple[CatalogueLaw, ...], signs: Array, judge: LeftOutPoses
) -> tuple[CatalogueCause, ...]:
    """Causes of the catalogue that the readings call for, the largest gain first.

    Args:
        found: The estimate.
        names: Causes of its first laws.
        signs: Signs of the residuals in the copies, shape (copies, m).
        judge: Gains at left-out poses.
    """
    groups = list(_groups(found, names))
    out = []
    for group, p in zip(groups, chances(found, [one.at for one in groups], signs), strict=True):
        called = p < alarms.SUSPECT and helps(found, group.at)
        if called and _physical(group.cause):
            near, far = judge.gains(found, group.at)
            if near.sure:
                out.append(replace(group.cause, p=p, gain=near, carried=far))
    return tuple(sorted(out, key=lambda one: -one.gain.reduction))


def renewed(every: Sequence[CatalogueCause], found: Calibration) -> tuple[CatalogueCause, ...]:
    """The same causes with the magnitudes of another estimate of the same model."""
    now = {(one.cause.name, one.cause.where): one.cause for one in _groups(found, ())}
    if found.mechanism.unknown:
        now["gravity_sag", None] = weight(found)
    out = []
    for one in every:
        new = now.get((one.name, one.where), one)
        form = one.form if one.form == OTHER_MASSES else new.form
        out.append(replace(one, form=form, amounts=new.amounts))
    return tuple(out)


def chances(found: Calibration, groups: Sequence[Ints | slice], signs: Array) -> list[float]:
    """Probability, for each group of parameters, that any group has as large a T in the copies.

    It is at least that by chi-square for all groups: scales of those that explain nothing vanish,
    and with them what they would explain in the copies.
    """
    if not groups:
        return []
    copies, every = law_tests.score(found, signs).x, np.arange(len(found.solution.x))
    P = precision(found.mechanism, found.known)[0]
    T = np.stack([_explained(found, P, every[one], copies) for one in groups])
    least = len(T) * special.gammaincc([0.5 * len(every[one]) for one in groups], 0.5 * T[:, 0])
    return list(np.minimum(np.maximum(law_tests.beyond_copies(T), least), 1.0).tolist())


def _physical(cause: CatalogueCause) -> bool:
    """False for springs whose compliances are all estimated negative."""
    springs = [one for one in cause.amounts if one.name.startswith("c_")]
    return not springs or any(one.value > 0 for one in springs)


def helps(found: Calibration, at: Ints | slice) -> bool:
    """Whether parameters with their prior make the readings certainly likelier than zeros do."""
    return _evidence(found, at) > LEAST_EVIDENCE


def _evidence(found: Calibration, at: Ints | slice) -> float:
    """Log of how much likelier parameters with their prior make the readings than zeros do.

    T knows no prior: readings may call for more than an element of its kind can be. What it can be
    then explains little, and its size is not told from zero.
    """
    C, P = found.by_readings.cov, precision(found.mechanism, found.known)[0]
    own, x = linear.cholesky(C[at][:, at]), found.solution.x[at]
    return 0.5 * float(x @ own.solve(x) + own.log_det + linear.log_det(P[at][:, at]))


def _explained(found: Calibration, P: Array, at: Ints, copies: Array) -> Array:
    """T of the readings and of the copies, shape (1 + copies,)."""
    mean = np.zeros(len(P))
    mean[: len(found.known.mean)] = found.known.mean
    x = np.column_stack([found.solution.x - mean, copies])[at]
    C, own = found.solution.cov[np.ix_(at, at)], P[np.ix_(at, at)]
    scale = np.sqrt(np.diag(C))
    inverse = linear.regular_inverse(C / scale / scale[:, None]) / scale / scale[:, None]
    N = inverse - own
    said = inverse @ x
    if np.trace(N * C) < _SEEN * len(at):
        return np.zeros(x.shape[1])
    known, _ = linear.left(N, np.diag(inverse))
    return np.asarray(np.einsum("ks,kl,ls->s", said, known, said))


_SEEN = 1e-3
"""Minimum fraction of the variance of a cause that the readings must remove to be
informative [1]."""
