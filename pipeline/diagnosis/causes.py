"""Causes with magnitudes and probabilities: from displacements, unloaded positions, and scatter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.base.arrays import Array, compared
from pipeline.base.linear import TINY
from pipeline.base.tails import NORMAL_95, at_most
from pipeline.diagnosis.amplitude import averaged, both_ways
from pipeline.diagnosis.average import Hypothesis
from pipeline.diagnosis.cause_search import SearchResult, SearchTask
from pipeline.diagnosis.facts import (
    ALL_SPRINGS,
    CrossValidation,
    Drift,
    EffectSize,
    FoundCause,
    NamelessEqual,
    PossibleCause,
    UnloadedFacts,
)
from pipeline.diagnosis.gain import as_good, beside
from pipeline.diagnosis.hypotheses import accepted
from pipeline.diagnosis.isolability import Twins
from pipeline.machine.cell import predict
from pipeline.machine.effect import Effect, Noise, Pulls
from pipeline.machine.effects.base_growth import over
from pipeline.machine.effects.nameless import NAMELESS, mounting
from pipeline.machine.effects.unlisted import height, undecided
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.system import alarms
from pipeline.system.evidence import LEAST_EVIDENCE
from pipeline.system.linearised import Linearised, owners
from pipeline.system.system import ScatterRatio


def of_displacements(
    task: SearchTask,
    found: SearchResult,
    worth: CrossValidation | None,
    where: PoseOfInterest,
    known: Twins,
    sets: Sequence[Hypothesis],
    rng: np.random.Generator,
) -> tuple[FoundCause, ...]:
    """The causes accepted by the search, with their cross-validation gain.

    Args:
        task: What stays the same during the search.
        found: Result of the search.
        worth: The gain.
        where: The test pose.
        known: Twins.
        sets: Hypotheses; without causes where these do not improve predictions.
        rng: Source of the bootstrap.
    """
    if not found.accepted:
        return ()
    held = sets if sets and sets[0].effects else (accepted(task, found),)
    sizes, own = averaged(task, found.plain, held), rng.spawn(1)[0]
    alike = _alike(task, found, worth, rng)
    out = []
    for place, suspect in enumerate(found.accepted):
        effect = task.suspects[suspect]
        probability, rivals = _possible(task, found, place, effect)
        either = _either(task, found, place)
        others = tuple(one for one in found.accepted if one != suspect)
        out.append(
            FoundCause(
                effect=_worded(task, effect, either),
                probability=probability,
                amplitudes=sizes[place],
                p_value=found.p_values[place],
                rivals=rivals,
                unnamed=_unnamed(found, place),
                as_good=alike[place],
                twins=(*known.of(effect.label), *_of_all_springs(found.seen, suspect)),
                gain=beside(found.plain, others, own) if worth and others else worth,
                test_pose_change_m=_change(task, found, others, where),
                height=_height(effect, held[0]),
                each_way=both_ways(effect, held),
                either=either,
                unproven=_unproven(found, others, rng) if worth and not effect.law else 0.0,
            )
        )
    return tuple(out)


def _unproven(found: SearchResult, others: Sequence[int], rng: np.random.Generator) -> float:
    """Probability that the model with the others alone predicts left-out poses as well."""
    return found.plain.unproven(found.plain.columns(others), rng)


def _possible(
    task: SearchTask, found: SearchResult, place: int, effect: Effect
) -> tuple[float, tuple[PossibleCause, ...]]:
    """Probability of the cause identified at a place of the search, and its rivals."""
    each = (
        PossibleCause(task.suspects[one.suspect], one.probability) for one in found.rivals[place]
    )
    odds = {one.effect.label: one for one in each}
    mine = odds.pop(effect.label, None)
    return mine.probability if mine else 0.0, tuple(odds.values())


def _of_all_springs(seen: Linearised, suspect: int) -> tuple[str, ...]:
    """`joint_springs` if all of them changing alike in time move targets as a law in time does.

    Then the law's columns in each pull are multiples of the deflection by the springs alone: gears
    that soften as they warm, and a scale whose gain drifts, are one and the same to every pull.
    """
    law, springs = seen.suspects[suspect].law, seen.model.springs
    if law is None or law.variable != "time":
        return ()
    Z = seen.Z[:, owners(seen.suspects) == suspect]
    bent = seen.B[:, :springs] @ seen.model.values[:springs]
    same = seen.rows.pull == np.arange(seen.rows.pull.max() + 1)[:, None]
    share = (same @ (bent[:, None] * Z)) / np.maximum(same @ bent**2, TINY)[:, None]
    left = Z - share[seen.rows.pull] * bent[:, None]
    return (ALL_SPRINGS,) if np.linalg.norm(left) < _SAME * np.linalg.norm(Z) else ()


_SAME = 0.01
"""Relative difference below which two directions count as the same [1]: the springs deflect in
proportion to the load only to first order."""


def _worded(task: SearchTask, effect: Effect, either: Sequence[PossibleCause]) -> Effect:
    """The effect; where its law is undecided, described by all possible laws."""
    laws = [other.effect.law for other in either[1:] if other.effect.law is not None]
    return undecided(task.cell.robot, effect, laws) if laws else effect


def _either(task: SearchTask, found: SearchResult, place: int) -> tuple[PossibleCause, ...]:
    """Laws of a place within exp(`LEAST_EVIDENCE`) of the likeliest, accepted first, if several."""
    effect = task.suspects[found.accepted[place]]
    own = next((one for one in found.rivals[place] if one.label == effect.label), None)
    if effect.law is None or own is None:
        return ()
    every = {task.suspects[i]: share for i, share in own.forms}
    least = max(every.values()) * np.exp(-LEAST_EVIDENCE)
    near = [one for one, share in every.items() if share > least and one is not effect]
    ranked = sorted(near, key=lambda one: -compared(every[one]))
    return tuple(PossibleCause(one, every[one]) for one in (effect, *ranked)) if ranked else ()


def _height(effect: Effect, first: Hypothesis) -> EffectSize | None:
    """Amplitude of a law outside the catalogue, from the accepted set of causes."""
    if effect.law is None or effect not in first.effects:
        return None
    found, names = first.sized or first.estimate, [p.name for p in effect.parameters]
    at = [k for k, p in enumerate(found.parameters) if p.name in names]
    parameter = replace(effect.parameters[0], name="amplitude", lower=0.0)
    value, std = height(effect.law, found.value[at], found.cov[np.ix_(at, at)])
    return EffectSize.symmetric(parameter, value, std)


def _alike(
    task: SearchTask,
    found: SearchResult,
    worth: CrossValidation | None,
    rng: np.random.Generator,
) -> list[tuple[NamelessEqual, ...]]:
    """Effects, named or nameless, that predict as well in the place of each cause.

    Empty where poses are not left out, and where nothing nameless was called for.
    """
    if not (worth and found.strange):
        return [()] * len(found.accepted)
    more = (*task.nameless, *mounting(task.cell.robot))
    wide = task.whitened(found.seen.beside(more))
    return [as_good(wide, k, len(task.suspects), rng) for k in range(len(found.accepted))]


def _change(
    task: SearchTask, found: SearchResult, others: tuple[int, ...], where: PoseOfInterest
) -> float:
    """Change of the deflection at the test pose by a cause beside others, mean over targets [m]."""
    pulls, first = Pulls.at(where.q, where.force, branch=1.0), found.first.model
    before = task.estimated(others, first.values) if others else first
    old, new = (
        predict(one.cell, pulls, one.values).displacement for one in (before, found.view.model)
    )
    return float(np.mean(np.linalg.norm(new - old, axis=-1)))


def _unnamed(found: SearchResult, place: int) -> PossibleCause | None:
    if not found.strange:
        return None
    one = found.strange[place]
    return PossibleCause(found.wide.suspects[one.suspect], one.probability)


def missing(found: SearchResult, misfit_p: float) -> float:
    """Probability that something is present which the model with the causes lacks.

    P = o / (o - e p ln p), with o the prior odds of the nameless (`NAMELESS`) and p the smallest
    p-value of the residuals: by free motions, by a further cause, by chi-square. It is 0 where
    nothing rejects the model; the nameless then competes by its evidence alone.

    Args:
        found: Result of the search.
        misfit_p: P-value of the residuals by chi-square.
    """
    if found.explains and misfit_p >= alarms.MISFIT:
        return 0.0
    further = -np.expm1(found.threshold.independent * np.log1p(-min(found.left, 1 - 1e-15)))
    return at_most(min(found.lack.p_poses, found.lack.p_pulls, further, misfit_p), NAMELESS)


def of_unloaded(stood: UnloadedFacts) -> tuple[FoundCause, ...]:
    """Causes that the unloaded positions call for."""
    if not stood.believed:
        return ()
    return tuple(
        FoundCause(
            effect=one.effect,
            probability=one.probability,
            amplitudes=_sizes(one.effect, one.value, one.std),
            p_value=one.p_value,
            rivals=one.rivals,
            twins=tuple(twin.label for twin in one.twins),
            same_robot=one.twins,
            gain=stood.gain,
        )
        for one in stood.causes
    )


def of_motion(
    stood: UnloadedFacts, drift: Drift | None
) -> tuple[tuple[FoundCause, ...], Drift | None]:
    """Causes that the unloaded positions call for, and what the base shows beyond them.

    A motion of the tracker that both show is one cause: a drift where the rounds of the base tell
    it from a knock, else the knock, whose pose only the unloaded positions know.
    """
    moved = of_unloaded(stood)
    others = tuple(one for one in moved if one.effect.name != "base_moved")
    if drift is None or len(others) == len(moved):
        return moved, drift
    if drift.named and not drift.undecided:
        return others, drift
    return moved, replace(drift, named=False, undecided=False, knocked=None)


def _sizes(
    effect: Effect, value: Array, std: Array, quantile: float = NORMAL_95
) -> tuple[EffectSize, ...]:
    parts = zip(effect.parameters, value, std, strict=True)
    return tuple(EffectSize.symmetric(p, float(v), float(s), quantile) for p, v, s in parts)


def of_growth(drift: Drift | None) -> tuple[FoundCause, ...]:
    """The growth that the base reflectors show, by its largest value."""
    if drift is None or (grown := drift.grown) is None:
        return ()
    most, effect = int(np.argmax(np.abs(grown.growth))), over(grown.begun, grown.growth)
    sizes = _sizes(effect, grown.growth[[most]], grown.std[[most]])
    return (FoundCause(effect, at_most(grown.p_value), sizes, grown.p_value),)


def of_base(drift: Drift | None, causes: Sequence[FoundCause]) -> tuple[FoundCause, ...]:
    """The drift that the base reflectors show, unless the displacements already show it."""
    if drift is None or not drift.named or drift.effect.name in {c.effect.name for c in causes}:
        return ()
    sizes = _sizes(drift.effect, drift.velocity, drift.std)
    odds = at_most(drift.p_value) / (1 + NAMELESS * drift.undecided)
    return (FoundCause(drift.effect, odds, sizes, drift.p_value),)


def of_scatter(whole: tuple[Effect, ...], spread: ScatterRatio) -> tuple[FoundCause, ...]:
    """Causes of scatter: readings that scatter significantly more than the stated noise."""
    sizes = {
        "tracker_noise": (spread.tracker - 1, spread.tracker_std, spread.tracker_p),
        "force_noise": (
            spread.force * spread.tracker - 1,
            spread.force_std * spread.tracker,
            spread.force_p,
        ),
    }
    out = []
    for effect in whole:
        value, std, p = sizes.get(effect.name, (0.0, 0.0, 1.0))
        if isinstance(effect, Noise) and p < alarms.SCATTER and spread.known_from == "contrasts":
            size = EffectSize.symmetric(effect.parameters[0], value, std)
            out.append(FoundCause(effect, at_most(p), (size,), p))
    return tuple(out)
