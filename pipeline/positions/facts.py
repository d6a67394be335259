"""Facts of absolute positions, from which the common table of verdicts is read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.base.linear import least_squares, rms
from pipeline.base.quantities import plain
from pipeline.diagnosis.bounds import UNSTATED_M, Bounds
from pipeline.diagnosis.facts import (
    CrossValidation,
    EffectSize,
    Facts,
    FoundCause,
    TableCause,
    UnloadedFacts,
)
from pipeline.faults.mistake import Mistake
from pipeline.geometry.unloaded import START
from pipeline.machine.effect import Effect
from pipeline.machine.effects import base_moved, catalogue, joint_offset, table, target_moved
from pipeline.machine.effects.unlisted import NAME
from pipeline.machine.law import Law
from pipeline.machine.robot import Robot
from pipeline.machine.robot.axes import alone
from pipeline.positions.catalogue_causes import CatalogueCause as Listed
from pipeline.positions.cross_validation import LeftOutGain as Worth
from pipeline.positions.cross_validation import Partition
from pipeline.positions.joint_laws import NamedLaw
from pipeline.positions.mechanism import placed
from pipeline.positions.outstanding import confirmed, same_robot
from pipeline.positions.pose_errors import unusual
from pipeline.positions.study import MovedSince, Study


def facts_of(found: Study, robot: Robot, mistakes: tuple[Mistake, ...] = ()) -> Facts:
    """All that the verdict depends on.

    Args:
        found: Result for the data without mistakes.
        robot: Robot as delivered.
        mistakes: Mistakes in the data.
    """
    first, last = (found.stages[k].mean(Partition.BETWEEN) for k in (0, -1))
    causes = (
        *(_listed(one, robot) for one in found.causes),
        *(_cause(law, robot) for law in found.laws),
        *map(_since, found.moved),
    )
    moved = tuple(_entries(found, robot))
    table_m = float(np.sqrt(max(first**2 - last**2, 0.0)))
    errs = unusual(found) is not None
    return Facts(
        detected=bool(causes) or errs,
        explains=not errs,
        causes=causes,
        unloaded=UnloadedFacts(table_m, last, {}, causes=tuple(map(_off, moved))),
        moved=moved,
        mistakes=mistakes,
        bounds=bounds_of(found),
    )


# --- entries of the table ------------------------------------------------------------------------


def _entries(found: Study, robot: Robot) -> Iterator[FoundCause]:
    """DH parameters that are off by far more than the rest of the table."""
    final = found.final
    std = np.sqrt(np.diag(final.solution.cov))
    known = {one.label: one for one in (*catalogue(robot), *table.effects(robot))}
    effects = [known[letter.label] for letter in final.mechanism.letters]
    for k in np.flatnonzero(confirmed(final.known, final.solution)).tolist():
        effect, off = effects[k], float(final.mechanism.values[k])
        size = EffectSize.symmetric(effect.parameters[0], off, float(std[k]))
        twins = tuple(effects[other] for other in same_robot(final.known, final.solution, k))
        yield FoundCause(effect, 1.0, (size,), 0.0, same_robot=twins)


def _off(one: FoundCause) -> TableCause:
    """The cause as one of the unloaded positions, which it then explains."""
    size = one.amplitudes[0]
    values = np.array([size.value]), np.array([size.std])
    return TableCause(one.effect, *values, one.p_value, one.probability, (), one.same_robot)


# --- causes of the catalogue ----------------------------------------------------------------------


def _in_catalogue(one: Listed, robot: Robot) -> Effect | None:
    """The effect of this name, place and form; if there is no such form, the first one."""
    if one.form in _NOUNS:
        return None
    named = [e for e in catalogue(robot) if (e.name, e.where) == _key(one)[:2]]
    return next((e for e in named if e.form == one.form), next(iter(named), None))


def _listed(one: Listed, robot: Robot) -> FoundCause:
    """A cause of the catalogue, with its parameters as estimated from positions."""
    noun = _NOUNS.get(one.form) or _NOUNS.get(one.name) or one.name.replace("_", " ")
    effect = _in_catalogue(one, robot) or Effect(
        name=one.name,
        where=one.where,
        noun=noun,
        place="joint" if isinstance(one.where, int) else one.name.split("_")[0],
        parameters=(),
        signature=noun,
        needs="pulls of known force in the same poses",
        source="",
        form=one.form,
    )
    typical = {p.name: p.typical for p in effect.parameters}
    amplitudes = tuple(
        EffectSize.symmetric(
            Parameter(
                p.name,
                p.unit,
                typical.get(p.name, max(abs(p.value), p.std)),
                meaning=p.meaning,
            ),
            p.value,
            p.std,
        )
        for p in one.amounts
    )
    return FoundCause(effect, 1.0, amplitudes, one.p, gain=_gain(one.gain))


def _key(one: Listed) -> tuple[str, int | str | None, str]:
    return one.name, one.where, one.form


_NOUNS = {
    "rail_shape": "a rail that is not straight",
    "rail_scale": "a rack whose pitch is not as stated",
    "compensator": "balancer of the arm",
    "gravity_sag": "sag under the arm's own weight",
    "other masses": "links that weigh other than the robot file states",
}
"""Nouns for causes that only positions show, by form or name."""


def _gain(one: Worth) -> CrossValidation:
    before, after = np.array([one.before]), np.array([one.after])
    return CrossValidation(before, after, one.reduction, one.ci95, (), "positions")


# --- laws -----------------------------------------------------------------------------------------


def _cause(law: NamedLaw, robot: Robot) -> FoundCause:
    """A changed zero, or a joint law as a cause outside the catalogue."""
    if law.since is not None:
        zero = _changed_zero(law.joint, *law.since, robot)
        size = EffectSize.symmetric(zero.parameters[0], law.amplitude, law.std)
        return FoundCause(zero, 1.0, (size,), law.p, gain=_gain(law.gain))
    slides = bool(robot.prismatic[law.joint - 1])
    unit = "m" if slides else "rad"
    meaning = f"amplitude of the {_noun(law, robot)} in {{joint}}"
    parameter = Parameter("amplitude", unit, START[slides], meaning=meaning)
    height = EffectSize.symmetric(parameter, law.amplitude, law.std)
    effect = _effect(law, robot, parameter)
    return FoundCause(effect, 1.0, (height,), law.p, gain=_gain(law.gain), height=height)


def _changed_zero(joint: int, series: str, pose: int, robot: Robot) -> Effect:
    """The zero of a joint that changed before a pose of a series."""
    effect = replace(joint_offset.since(robot, joint, (), pose), axis=alone(robot)[joint - 1])
    return _in_series(effect, series)


def _in_series(effect: Effect, series: str) -> Effect:
    """What happened at a pose of a series, with its name."""
    of = f" of series {series}" if series else ""
    return replace(effect, noun=effect.noun + of, form=effect.form + of)


def _since(one: MovedSince) -> FoundCause:
    """The robot's base, or a target on the effector, that was moved before a pose."""
    moved = target_moved.since(one.target, 0, (), one.pose) if one.target else None
    effect = _in_series(moved or base_moved.since((), one.pose), one.series)
    each = zip(effect.parameters, one.motion.tolist(), one.std.tolist(), strict=False)
    return FoundCause(effect, 1.0, tuple(EffectSize.symmetric(*size) for size in each), one.p)


def _effect(law: NamedLaw, robot: Robot, parameter: Parameter) -> Effect:
    noun = _noun(law, robot)
    slides = bool(robot.prismatic[law.joint - 1])
    variable = "position" if law.variable == "angle" and slides else law.variable
    return Effect(
        name=NAME,
        where=law.joint,
        noun=noun,
        place="joint",
        parameters=(parameter,),
        signature=f"a {noun}",
        needs="poses that differ in that joint alone",
        source="found in the readings",
        axis=alone(robot)[law.joint - 1],
        law=Law(
            where=law.joint,
            part="",
            kind=law.kind,
            variable=variable,
            source=law.source or 0,
            order=law.order,
            low=law.range[0],
            high=law.range[1],
        ),
    )


def _noun(law: NamedLaw, robot: Robot) -> str:
    """The law as a noun, without its place and magnitude."""
    slides = bool(robot.prismatic[law.joint - 1])
    turn = "per metre" if slides else "per turn"
    if law.kind == "periodic":
        return f"ripple of {plain(law.order, 3)} {turn}"
    if law.kind == "coupling":
        return f"motion {plain(law.order, 2)} {turn} of joint {law.source}"
    if law.variable == "angle":
        return f"smooth error over its {'place' if slides else 'angle'}"
    if law.kind == "step":
        return "step where its torque changes sign, half of it to each side,"
    return f"error that grows with {_OF[law.variable]}"


_OF = {
    "torque": "the square or cube of its torque",
    "temperature": "the temperature of the air",
    "time": "the time since the series began",
}


# --- what green means -----------------------------------------------------------------------------


def bounds_of(found: Study) -> Bounds:
    """Noise and misfit of a campaign of positions against their bounds.

    The held-out errors are compared with the stated noise combined with the usual error of each
    joint at a pose; where the targets of single poses show more noise than joints can cause, that
    is compared with the stated noise alone.
    """
    last, final = found.stages[-1], found.final
    off = last.errors[Partition.BETWEEN]
    usual_m = _usual(found)
    tracker, stated, unit_m = rms(off[np.isfinite(off)]) / np.sqrt(3) / usual_m, False, usual_m
    own = _own_noise(found) / final.scatter.position if final.scatter.stated else 0.0
    if own > tracker:
        tracker, stated, unit_m = own, True, UNSTATED_M
    pose, target = np.unravel_index(int(np.nanargmax(off)), off.shape)
    readings = final.readings
    return Bounds(
        tracker=float(tracker),
        stated=stated,
        left=_left(off, readings.at),
        worst_pose=int(readings.pose[pose]),
        worst_target=str(readings.targets[target]),
        worst_m=float(off[pose, target]),
        unit_m=unit_m,
    )


def _usual(found: Study) -> float:
    """Expected rms of a coordinate from the stated noise and the usual errors of the joints [m]."""
    final = found.final
    joints = np.where(final.mechanism.table.prismatic, START[True], START[False])
    n = len(joints)
    Z = final.linear.Z[..., :n].reshape(len(final.readings), -1, 6, n)[:, :, :3]
    noise = final.scatter.position if final.scatter.stated else UNSTATED_M
    return float(np.sqrt(noise**2 + np.mean(np.sum((Z * joints) ** 2, axis=3))))


def _own_noise(found: Study) -> float:
    """Noise of a coordinate from the targets of each pose relative to each other [m].

    The residuals of 3 t coordinates after six motions of the effector; 0 where too few are read.
    """
    final = found.final
    shifts = np.tile([True] * 3 + [False] * 3, len(final.readings.targets))
    read, left = final.linear.read[:, shifts], final.left[:, shifts]
    square, dof = 0.0, 0
    for e, D, seen in zip(left, _motions(found), read, strict=True):
        if seen.sum() > D.shape[1]:
            own = e[seen] - D[seen] @ least_squares(D[seen], e[seen])
            square, dof = square + float(own @ own), dof + int(seen.sum()) - D.shape[1]
    return float(np.sqrt(square / dof)) if dof else 0.0


def _motions(found: Study) -> Array:
    """Derivatives of the targets of each pose by six motions of the effector, F_b, (m, 3 t, 6)."""
    at = placed(found.final.readings, found.final.mechanism, found.final.weights)[0]
    lever = at - at.mean(axis=1, keepdims=True)
    turn = np.stack([np.cross(e, lever) for e in np.eye(3)], axis=3)
    shift = np.broadcast_to(np.eye(3), (*lever.shape[:2], 3, 3))
    return np.concatenate([turn, shift], axis=3).reshape(len(lever), -1, 6)


def _left(off: Array, at: Array) -> float:
    """Residual fraction of the squared motions of the targets between poses."""
    spread = at - np.nanmean(at, axis=0)
    return float(np.nansum(off**2) / max(float(np.nansum(spread**2)), np.finfo(float).tiny))
