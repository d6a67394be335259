"""What the catalogue says of positions: laws that it lists, and which of all causes are there.

A cause is a group of parameters b of the estimate. Where the readings say N of it and what they say
of it is b, the rest estimated beside,

    T = b' N b,    N = C_b^-1 - P_b,

with C_b the covariance after and P_b the precision before the readings. T is held against the
largest of any cause in copies whose residuals have flipped signs (`search.flips`), and a cause is
there if it then predicts poses that were left out better.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.geometry import search
from pipeline.geometry.estimate import precision
from pipeline.geometry.identify import Identified
from pipeline.geometry.laws import JointLaw
from pipeline.geometry.mechanism import Mechanism, layout
from pipeline.geometry.worth import NO_GAIN, Judge, LeftOutGain
from pipeline.geometry.yielding import LOADED, balanced, carried_by
from pipeline.machine.effects._anatomy import rail, turning
from pipeline.machine.robot import Robot, configure
from pipeline.machine.robot.weight import by_moments
from pipeline.system import alarms


class Amount(NamedTuple):
    """One parameter of a cause, SI, with its standard uncertainty and what it is."""

    name: str
    unit: str
    value: float
    std: float
    meaning: str


@dataclass(frozen=True)
class TableLaw:
    """What the catalogue knows and the readings call for.

    Attributes:
        name: A word of the list of causes.
        where: Joint from 1, `upper_arm`, `forearm`, or None where it can act in one place only.
        form: Which mathematical form.
        amounts: Its parameters.
        p: Chance of so much of any cause in readings without one.
        gain: At left-out neighbours in time.
        carried: At left-out series, stations or parts of joint space.
    """

    name: str
    where: int | str | None
    form: str
    amounts: tuple[Amount, ...]
    p: float = 1.0
    gain: LeftOutGain = NO_GAIN
    carried: LeftOutGain = NO_GAIN


class Listed(NamedTuple):
    """A law of a joint that the catalogue has; without a name one that any gear may have."""

    name: str
    law: JointLaw


_WAVES = (1.0, 2.0, 3.0)
"""Periods per turn of a joint: an eccentric wheel, an oval one, three bolts. Of less than a period
a wave is any curve, and says nothing of angles beyond."""


def listed(robot: Robot, q: Array, tau: Array) -> tuple[Listed, ...]:
    """Laws that are estimated in any case, each as large as the readings call for.

    Args:
        robot: The robot.
        q: Joint values that were taken [m] or [rad], shape (m, n).
        tau: Torque of its weight on each joint [N m], shape (m, n); zero where it is not known.
    """
    return tuple(_listed(robot, q, tau))


def _listed(robot: Robot, q: Array, tau: Array) -> Iterator[Listed]:
    if rail(robot) and np.ptp(q[:, 0]) > 0:
        middle, half = float(q[:, 0].max() + q[:, 0].min()) / 2, float(np.ptp(q[:, 0])) / 2
        yield Listed("rail_scale", JointLaw(1, "smooth", "angle", 1, 1.0, middle, half))
    shoulder = balanced(robot) if tau.any() else None
    for joint in turning(robot):
        yield from _waves(joint, joint == shoulder, np.ptp(q[:, joint - 1]))


def _waves(joint: int, shoulder: bool, span: float) -> Iterator[Listed]:
    """Waves over the angle of a joint; those of a balanced shoulder are its compensator's."""
    for order in _WAVES:
        name = "compensator" if shoulder and order < _WAVES[-1] else ""
        if name or order * span > np.pi:
            yield Listed(name, JointLaw(joint, "periodic", "angle", joint, order))


# --- groups of parameters -------------------------------------------------------------------------


class _Group(NamedTuple):
    cause: TableLaw
    at: Ints


def _groups(found: Identified, names: tuple[Listed, ...]) -> Iterator[_Group]:
    """Every cause of the catalogue in the model, with the places of its parameters."""
    mechanism, where = found.mechanism, layout(found.mechanism)
    x, std = found.solution.x, np.sqrt(np.diag(found.solution.cov))
    first = where.yields.start
    for effect in mechanism.elements:
        at = np.arange(first, first + len(effect.parameters))
        first = int(at[-1]) + 1
        amounts = tuple(
            Amount(one.name, one.unit, float(x[k]), float(std[k]), one.meaning)
            for one, k in zip(effect.parameters, at, strict=True)
        )
        yield _Group(TableLaw(effect.name, effect.where, effect.form, amounts), at)
    yield from _of_laws(mechanism, names, where.laws.start, x, std)
    yield from _of_bed(found)


def _of_laws(
    mechanism: Mechanism, names: tuple[Listed, ...], first: int, x: Array, std: Array
) -> Iterator[_Group]:
    """Laws of one name and joint together."""
    parts: dict[tuple[str, int], list[int]] = {}
    said: dict[tuple[str, int], list[Amount]] = {}
    for name, law in names:
        at = list(range(first, first + law.amplitudes))
        first += law.amplitudes
        if name:
            key = name, law.joint
            parts.setdefault(key, []).extend(at)
            said.setdefault(key, []).extend(_amounts(name, law, x[at], std[at]))
    for (name, joint), at in parts.items():
        form = "two harmonics" if name == "compensator" else ""
        yield _Group(TableLaw(name, None, form, tuple(said[name, joint])), np.array(at))


def _amounts(name: str, law: JointLaw, x: Array, std: Array) -> Iterator[Amount]:
    if name == "rail_scale":
        value, spread = float(x[0]) / law.scale, float(std[0]) / law.scale
        yield Amount("scale", "1", value, spread, "error of the pitch of the rack")
    else:
        for part, a, s in zip(("cos", "sin"), x, std, strict=True):
            said = f"{part} part of order {law.order:g} of the shoulder's deflection"
            yield Amount(f"turn_{part}{law.order:g}", "rad", float(a), float(s), said)


_MOTIONS = {
    **{axis: f"rms deviation of the rail along {axis}" for axis in "xyz"},
    **{f"r{axis}": f"rms rotation of the rail about {axis}" for axis in "xyz"},
}
"""Motions of a carriage along its bed: the letters of each, and what its size is called."""


def _of_bed(found: Identified) -> Iterator[_Group]:
    """The six curves of a bed, by their rms over the poses about straight lines and means."""
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
        free = plain if axis < 3 else plain[:, :1]  # a tilted line is a turned frame
        rows = rows - free @ linear.least_squares(free, rows)
        f, cov = rows @ found.solution.x[part], found.solution.cov[np.ix_(part, part)]
        rms = linear.rms(f)
        slope = rows.T @ f / len(f) / max(rms, 1e-300)
        unit, spread = "m" if axis < 3 else "rad", float(np.sqrt(slope @ cov @ slope))
        letters, meaning = list(_MOTIONS.items())[axis]
        amounts.append(Amount(f"s_{letters}", unit, rms, spread, meaning))
        places.append(part)
    if places:
        yield _Group(TableLaw("rail_shape", None, "", tuple(amounts)), np.concatenate(places))


def weight(found: Identified) -> TableLaw:
    """The weight of an arm of which nobody states masses: what of it the readings show.

    A joint sags by its compliance times the moment of what it carries. Their product is known, M
    the largest difference of that moment between two poses if the joint is as stiff as its file
    says. Mass and stiffness are told apart (form `masses`) where payloads have told the
    compliances, else form is `moments`.
    """
    mechanism, where = found.mechanism, layout(found.mechanism)
    cov, x = found.solution.cov, found.solution.x
    at = np.r_[where.compliance, where.moments]
    c, std = x[where.compliance], np.sqrt(np.diag(cov)[where.compliance])
    tau, amounts, apart = found.linear.inputs.tau, [], []
    here = configure(mechanism.robot, found.readings.q)
    joints = np.arange(1, mechanism.table.n + 1)
    slopes = carried_by(here.twists, joints, by_moments(here, found.weights.gravity))
    most = np.ptp(tau, axis=0)
    for j, joint in enumerate(mechanism.table.joints):
        row = slopes[:, j]
        if most[j] < LOADED * most.max() or joint.prismatic:
            continue
        low, high = int(tau[:, j].argmin()), int(tau[:, j].argmax())
        slope = np.zeros(len(at))
        slope[j] = most[j]
        slope[mechanism.table.n :] = c[j] * (row[high] - row[low])
        nominal = mechanism.table.nominal_compliance[j]
        value, spread = c[j] * most[j], float(np.sqrt(slope @ cov[np.ix_(at, at)] @ slope))
        if spread < abs(value):
            size = value / nominal, spread / nominal
            meaning = f"moment of the arm's weight on {joint.name}"
            amounts.append(Amount(f"M_{joint.name}", "N m", *size, meaning))
            apart.append(std[j] < _APART * abs(c[j]))
    form = "masses" if apart and all(apart) else "moments"
    return TableLaw("gravity_sag", None, form, tuple(amounts))


OTHER_MASSES = "other masses"
"""Form of a sag by which links weigh other than their file states."""

_APART = 0.2
"""Relative uncertainty of a compliance below which mass and stiffness are told apart."""


# --- which are there ------------------------------------------------------------------------------


def causes(
    found: Identified, names: tuple[Listed, ...], signs: Array, judge: Judge
) -> tuple[TableLaw, ...]:
    """What of the catalogue the readings call for, the largest gain first.

    Args:
        found: The estimate.
        names: What its first laws are.
        signs: Of copies whose residuals have other signs, shape (copies, m).
        judge: Of what was left out.
    """
    groups = list(_groups(found, names))
    out = []
    for group, p in zip(groups, chances(found, [one.at for one in groups], signs), strict=True):
        if p < alarms.SUSPECT and _physical(group.cause):
            near, far = judge.gains(found, group.at)
            if near.sure:
                out.append(replace(group.cause, p=p, gain=near, carried=far))
    return tuple(sorted(out, key=lambda one: -one.gain.reduction))


def renewed(every: Sequence[TableLaw], found: Identified) -> tuple[TableLaw, ...]:
    """Causes with the sizes that another estimate of the same model has."""
    now = {(one.cause.name, one.cause.where): one.cause for one in _groups(found, ())}
    if found.mechanism.unknown:
        now["gravity_sag", None] = weight(found)
    out = []
    for one in every:
        new = now.get((one.name, one.where), one)
        form = one.form if one.form == OTHER_MASSES else new.form
        out.append(replace(one, form=form, amounts=new.amounts))
    return tuple(out)


def chances(found: Identified, groups: Sequence[Ints | slice], signs: Array) -> list[float]:
    """Chance of as much of any of some groups of parameters in the copies, of each group."""
    if not groups:
        return []
    copies, every = search.score(found, signs).x, np.arange(len(found.solution.x))
    P = precision(found.mechanism, found.known)[0]
    T = np.stack([_explained(found, P, every[one], copies) for one in groups])
    return list(search.beyond_copies(T).tolist())


def _physical(cause: TableLaw) -> bool:
    """Springs that are negative for certain are none."""
    springs = [one for one in cause.amounts if one.name.startswith("c_")]
    return not springs or any(one.value > 0 for one in springs)


def _explained(found: Identified, P: Array, at: Ints, copies: Array) -> Array:
    """T of the readings and of copies, shape (1 + copies,)."""
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
"""Part of a cause's variance that the readings have to take away to say anything."""
