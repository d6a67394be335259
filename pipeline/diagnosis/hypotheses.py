"""Hypotheses: the accepted causes, and others in their places, each with its own springs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import scipy.sparse

from pipeline.base import linear
from pipeline.base.arrays import Array, compared
from pipeline.diagnosis.average import LEAST_PROBABILITY, POSSIBLE, Hypothesis, weighed
from pipeline.diagnosis.cause_search import (
    SearchResult,
    SearchTask,
    further_odds,
    merged,
    remainder,
)
from pipeline.diagnosis.verdict import CERTAIN
from pipeline.machine.cell import predict
from pipeline.machine.effect import Effect
from pipeline.system.assemble import TRACKED, assemble
from pipeline.system.estimate import identifiable, solve
from pipeline.system.linearised import CurrentModel, Linearised
from pipeline.system.noise_shape import goodness
from pipeline.system.system import Errors, Estimate, System
from pipeline.system.whitened import with_laws

_SEED = 20261122
"""Seed of the draws; another one changes numbers within their stated scatter."""

_USUAL = 2.5
"""Standard deviation of an undetected cause in typical magnitudes [1]: the second largest of the
widths over which the evidence is averaged (`system.evidence.WIDTHS`)."""


def hypotheses(
    task: SearchTask, found: SearchResult, moved: bool, helps: bool
) -> tuple[Hypothesis, ...]:
    """The accepted causes, then sets with likely rivals in their places or one more beside.

    Empty without causes. A scale that scatters more than stated, or a moved robot, requires the
    same springs with new weights.

    Args:
        task: What stays the same during the search.
        found: Result of the search in the displacements.
        moved: The robot is not where its log says; the task already includes that.
        helps: The causes predict left-out poses better than the joint springs alone do.
    """
    small = too_small(task, found, helps)
    if not (found.accepted and helps):
        if not moved and task.force_noise == 1:
            return ()
        only = _hypothesis(task, found.first.model, found.first.seen, 1.0)
        return weighed(beside_small([_tested(task, only, found.first.seen)], small))
    first, *others = _likely(task, found)
    own = _hypothesis(task, found.view.model, found.seen, first.weight)
    own = _tested(task, own, found.seen)
    return weighed(beside_small([own, *(_other(task, found, one) for one in others)], small))


def beside_small(sets: Sequence[Hypothesis], small: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The sets, which have the probability that those with a cause too small to name leave."""
    rest = 1.0 - sum(one.weight for one in small)
    return (*(replace(one, weight=rest * one.weight) for one in sets), *small)


def too_small(task: SearchTask, found: SearchResult, helps: bool) -> tuple[Hypothesis, ...]:
    """The accepted causes with one that may be present undetected, each above `POSSIBLE`.

    Empty where something is detected that no cause certainly explains and predicts (`helps`): what
    a rival leaves is no small cause. The weights are relative to the accepted causes alone, or
    none, which have the remaining probability. Each magnitude combines the readings with a normal
    prior about zero of `_USUAL` typical magnitudes.
    """
    if found.detected and not (found.explains and helps and _certain(task, found)):
        return ()
    odds = further_odds(task, found)
    total = 1.0 + sum(each for _, each in odds)
    likely = [
        _Set((*found.accepted, i), each / total) for i, each in odds if each / total > POSSIBLE
    ]
    every = [
        _other(task, found, one) for one in sorted(likely, key=lambda one: -compared(one.weight))
    ]
    return tuple(_as_usual(one) for one in every if np.isfinite(one.estimate.std).all())


def _certain(task: SearchTask, found: SearchResult) -> bool:
    """Whether each accepted cause is identified against its rivals and what has no name."""
    strange = found.stranger.probability if found.stranger else 0.0
    places = zip(found.accepted, found.rivals, strict=True)
    mine = [
        sum(one.probability for one in rivals if one.label == task.suspects[accepted].label)
        for accepted, rivals in places
    ]
    return min((*mine, 1.0 - strange)) >= CERTAIN


def _as_usual(one: Hypothesis) -> Hypothesis:
    """The hypothesis whose last cause is as large as undetected ones usually are."""
    last = one.effects[-1]
    sized = None if one.sized is None else _usual(one.sized, last)
    return replace(one, estimate=_usual(one.estimate, last), sized=sized)


def _usual(estimate: Estimate, effect: Effect) -> Estimate:
    """The estimate updated by the prior of the last parameters, those of the effect."""
    k, std = len(effect.parameters), usual(effect)
    C = estimate.cov
    gain = linear.solve((C[-k:, -k:] + np.diag(std**2)) / np.outer(std, std), C[-k:] / std[:, None])
    gain = gain / std[:, None]
    value = estimate.value - gain.T @ estimate.value[-k:]
    return replace(estimate, value=value, cov=C - C[:, -k:] @ gain)


def usual(effect: Effect) -> Array:
    """Standard deviations of the parameters of an undetected cause, shape (k,)."""
    return _USUAL * effect.size * np.array([p.typical for p in effect.parameters])


def accepted(task: SearchTask, found: SearchResult) -> Hypothesis:
    """The accepted causes alone, whether or not they improve predictions."""
    return _hypothesis(task, found.view.model, found.seen, 1.0)


@dataclass(frozen=True)
class _Set:
    """Causes that may be present together.

    Attributes:
        suspects: Their indices; those beyond the task's own suspects are nameless.
        weight: Their probability.
        instead: Accepted causes that are not among them, each with its replacement.
    """

    suspects: tuple[int, ...]
    weight: float
    instead: tuple[tuple[int, int], ...] = ()


def _likely(task: SearchTask, found: SearchResult) -> list[_Set]:
    """Sets of causes with their probability: the accepted ones, then others, likeliest first.

    Causes in different places are independent; something outside the catalogue may replace one or
    several of the accepted causes at once.
    """
    strangers = {one.places: one for one in found.strange if one.probability > 0}
    known = math.prod(1.0 - one.probability for one in strangers.values())
    every = sum(one.probability for one in strangers.values())
    sets = list(_of_catalogue(task, found, known))
    for places, one in strangers.items():
        kept = tuple(a for place, a in enumerate(found.accepted) if place not in places)
        instead = tuple((found.accepted[place], one.suspect) for place in places)
        weight = (1.0 - known) * one.probability / every
        sets.append(_Set((*kept, one.suspect), weight, instead))
    own = next((one for one in sets if one.suspects == found.accepted), _Set(found.accepted, 0.0))
    others = [
        one for one in sets if one.suspects != found.accepted and one.weight > LEAST_PROBABILITY
    ]
    return [own, *sorted(others, key=lambda one: -compared(one.weight))]


def _of_catalogue(task: SearchTask, found: SearchResult, known: float) -> Iterator[_Set]:
    """Sets of causes of the catalogue in all their forms; `known` is their total probability."""
    for rivals in product(*found.rivals):
        odds = known * math.prod(rival.probability for rival in rivals)
        if odds > LEAST_PROBABILITY:
            for forms in product(*(rival.forms for rival in rivals)):
                chosen = tuple(suspect for suspect, _ in forms)
                weight = odds * math.prod(share for _, share in forms)
                yield from _at_once(task, found, chosen, weight)


def _at_once(
    task: SearchTask, found: SearchResult, chosen: tuple[int, ...], weight: float
) -> Iterator[_Set]:
    """One suspect for each place as a set, unless one cause occupies two places."""
    suspects = task.suspects
    kept = merged(suspects, chosen)
    if len({suspects[i].label for i in kept}) == len(kept):
        pairs = zip(found.accepted, chosen, strict=True)
        instead = tuple((a, b) for a, b in pairs if suspects[a].label != suspects[b].label)
        yield _Set(kept, weight, instead)


def _other(task: SearchTask, found: SearchResult, one: _Set) -> Hypothesis:
    """Other causes in the places of the accepted ones, estimated together with the springs."""
    known = len(task.suspects)
    if max(one.suspects) >= known:
        task = replace(task, suspects=task.suspects + task.nameless)
    start = found.view.model.values[: task.cell.robot.n]
    seen = task.fitted(one.suspects, start, found.seen)
    instead = tuple(
        (task.suspects[mine].called, _called(task.suspects[other], other < known))
        for mine, other in one.instead
    )
    return _hypothesis(task, seen.model, seen, one.weight, instead)


def _called(effect: Effect, has_a_name: bool) -> str:
    return effect.called if has_a_name else f"something outside the catalogue like {effect.called}"


def _hypothesis(
    task: SearchTask,
    model: CurrentModel,
    seen: Linearised,
    weight: float,
    instead: tuple[tuple[str, str], ...] = (),
) -> Hypothesis:
    """Springs and causes estimated together, with uncertainties multiplied by the remainder ratio.

    A model whose residuals exceed the scatter of the readings is wrong somewhere; its uncertainties
    are multiplied by that ratio (Birge, Physical Review 40 (1932) 207).
    """
    effects = tuple(task.suspects[i] for i in model.accepted)
    system, estimate = _solved(task, model, seen)
    best = task.whitened(seen, model.accepted, in_each=False)
    ratio = max(remainder(best) or 1.0, 1.0) if effects else 1.0
    cov = estimate.cov * ratio**2
    known = identifiable(
        np.array([p.typical for p in estimate.parameters]), estimate.value, np.sqrt(np.diag(cov))
    )
    estimate = replace(estimate, cov=cov, identifiable=estimate.identifiable & known)
    sized = _sized(system, model, ratio) if effects else None
    return Hypothesis(weight, effects, model.cell, system, estimate, instead, ratio, sized)


def _tested(task: SearchTask, one: Hypothesis, seen: Linearised) -> Hypothesis:
    """The hypothesis, tested with equal noise for all readings, of the size found.

    Weights that follow from the residuals would make these small whatever the model.
    """
    if task.shape is None or one.estimate.p_value is None:
        return one
    data = task.shape.alike(task.data)
    alike = _solved(replace(task, data=data), seen.model, seen)[0]
    left = goodness(alike, task.shape, np.random.default_rng(_SEED))
    return replace(one, estimate=replace(one.estimate, goodness=left))


def _sized(system: System, model: CurrentModel, ratio: float) -> Estimate:
    """Estimate without other laws of the same element: the magnitude is that of the named law.

    Those laws are common to all pulls and would absorb as much of the cause as they resemble it.
    Where the element sits stays uncertain: the size is that of its effect over the lever.
    """
    errors = system.errors
    own = ~((errors.source == "law") & errors.common)
    alone = Errors(errors.G[:, own], errors.source[own], errors.common[own])
    found = solve(replace(system, errors=alone), model.values)
    return replace(found, cov=found.cov * ratio**2)


def _solved(task: SearchTask, model: CurrentModel, seen: Linearised) -> tuple[System, Estimate]:
    """Springs and causes as one linear system about the model's values, and its solution.

    Args:
        task: What stays the same during the search.
        model: Linearisation point.
        seen: The campaign linearised there, for the tolerances of the causes' laws.
    """
    flat = replace(model.cell, equilibrium="undeformed")
    system = assemble(flat, task.data, model.values)
    bent = predict(model.cell, task.data.pulls, model.values).displacement
    bent = bent - predict(flat, task.data.pulls, model.values).displacement
    c = system.c - bent[task.data.pull, task.data.target].ravel()
    G = scipy.sparse.csr_array(system.errors.G @ scipy.sparse.diags_array(_scales(task, system)))
    errors = replace(system.errors, G=G)
    if model.accepted:
        errors = with_laws(seen, errors, task.laws(model.accepted))
    system = replace(system, c=c, errors=errors)
    estimate = solve(system, model.values)
    if not task.data.noise_stated and not task.whitened(seen).tells_scatter and estimate.dof:
        # the noise was that of the residuals without the causes
        G = scipy.sparse.csr_array(errors.G * np.sqrt(estimate.chi2 / estimate.dof))
        system = replace(system, errors=replace(errors, G=G))
        estimate = solve(system, model.values)
    return system, estimate


def _scales(task: SearchTask, system: System) -> Array:
    """Scatter found over stated for each column of G: that of the tracker and of the scale.

    The stated one holds unless the found one is certainly larger.
    """
    source = system.errors.source
    scale = task.force_noise * task.noise if task.force_noise != 1 else 1.0
    tracked = np.isin(source.astype(str), TRACKED)
    return np.where(tracked, task.certain_noise, np.where(source == "force_reading", scale, 1.0))
