"""Detect what the model lacks, name it, extend the model, propose poses."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import special

from pipeline.base import doors
from pipeline.base.arrays import Array
from pipeline.base.linear import rms
from pipeline.diagnosis.blindspots import unnoticed
from pipeline.diagnosis.cause_search import SearchResult, SearchTask, search
from pipeline.diagnosis.causes import (
    missing,
    of_base,
    of_displacements,
    of_growth,
    of_motion,
    of_scatter,
)
from pipeline.diagnosis.facts import (
    CrossValidation,
    Diagnosed,
    Drift,
    Facts,
    FoundCause,
    PossibleCause,
    SoleCause,
    UnloadedFacts,
    Unnoticed,
)
from pipeline.diagnosis.gain import alone, gain
from pipeline.diagnosis.hypotheses import hypotheses, too_small
from pipeline.diagnosis.isolability import Twins, twins
from pipeline.diagnosis.suspect_statistics import misfits, suspect_statistics
from pipeline.diagnosis.unlisted import with_unlisted_laws
from pipeline.diagnosis.unloaded_geometry import as_stiff, beside_springs, corrected, from_unloaded
from pipeline.machine.cell import Cell
from pipeline.machine.effect import Effect, Noise
from pipeline.machine.effects import catalogue, table
from pipeline.machine.effects.nameless import competing
from pipeline.machine.surroundings import Surrounded
from pipeline.reduction.measured import Measured
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.system import alarms
from pipeline.system.contrasts import Zeros, pure_error
from pipeline.system.elimination import eliminate
from pipeline.system.estimate import is_plausible
from pipeline.system.linearised import CurrentModel, Linearised
from pipeline.system.noise_shape import NoiseShape
from pipeline.system.scatter import scatter
from pipeline.system.system import Estimate, ScatterRatio, System
from pipeline.system.variance import Components, variance_components

_EQUILIBRIA = ("deformed", "undeformed")

LEAST_OF_RIVALS = 0.02
"""Probability below which rivals are ignored [1]."""

_SHOWN = 5
"""Maximum number of causes listed as possible sole cause."""

_FURTHER = "pipeline.design.undecided:to_measure"
"""Proposes the poses to measure next: those that would separate causes, and those that determine
joints."""

_APART = "pipeline.design.separability:told_apart"
"""Says how far causes are from each other: `Diagnosed.apart` and what belongs to it."""

_POINTS_M = 3e-4
"""Standard uncertainty per axis of the tool's points [m] where the campaign states none."""


def _offered(door: str, nothing: Any, *of: Any) -> Any:
    """What an outbuilding says of a search, or nothing without it."""
    found = doors.found(door)
    return found(*of) if found else nothing


def diagnose(
    cell: Cell,
    data: Measured,
    estimate: Estimate,
    where: PoseOfInterest,
    rng: np.random.Generator,
    effects: tuple[Effect, ...] | None = None,
    drift: Drift | None = None,
    noise: Components | None = None,
    shape: NoiseShape | None = None,
    surroundings: Surrounded | None = None,
) -> Diagnosed:
    """Find what the joint springs model lacks in one campaign.

    Args:
        cell: The joint springs model.
        data: The measurements.
        estimate: Its joint springs.
        where: The test pose, for the change of the predicted deflection.
        rng: Source of all draws (threshold, bootstrap, candidate poses).
        effects: The catalogue to search; by default that of robot and loads.
        drift: Motion of the tracker that the base reflectors show, if any.
        noise: Noise found in the campaign; by default estimated from its pulls.
        shape: Tails and wander of the noise; none by default.
        surroundings: What a proposed pose must avoid.
    """
    whole = catalogue(cell.robot, data.pulls) if effects is None else effects
    known = twins(cell.robot, data.pulls.weighed)
    cell, data, stood, task, spread = _to_search(
        (cell, data, estimate, whole, known, noise), shape, drift, surroundings
    )
    task, spread, found, stated = _searched(task, spread, estimate.value, rng)
    worth = _gain(task, found, rng)
    noisy = noise is not None and bool(noise.larger[noise.name == "tracker"].any())
    facts = replace(_facts(task, found, spread), gain=worth, noisy=noisy and bool(found.accepted))
    sets = hypotheses(task, found, stood.believed, facts.helps)
    causes = of_displacements(task, found, worth, where, known, sets, rng.spawn(1)[0])
    stated_p, misfit = _misfit(sets[0].estimate if sets else estimate, spread)
    lacking = missing(found, misfit)
    causes = tuple(replace(one, missing=lacking) for one in causes)
    moved, drift = of_motion(stood, drift)
    facts = replace(
        facts,
        causes=causes,
        scatter=of_scatter(whole, spread),
        beyond_a_tracker=estimate.p_value is None and not is_plausible(estimate, data.tracked),
        moved=moved,
        base=drift,
        stated_p=stated_p,
        misfit_p=misfit,
    )
    held = _held(facts)
    stood = beside_springs(stood, cell, [one.effect for one in held])
    drifts = of_base(drift, held)
    facts = replace(facts, unloaded=stood, drift=drift if drifts else None)
    single = _alone(found, worth, rng)
    blind, absent = _unnoticed(whole, found, facts, known)
    proposed, joints = _offered(_FURTHER, ((), ()), task, found, causes, worth, known, rng)
    return Diagnosed(
        facts=facts,
        causes=facts.moved + of_growth(facts.base) + drifts + held,
        alone=single,
        blind_spots=blind,
        not_found=absent,
        next_poses=proposed,
        determining=joints,
        scatter=spread,
        equilibrium=task.cell.equilibrium,
        hypotheses=sets,
        **_of_search(found, facts.helps),
        **_offered(_APART, {}, task, found, facts.helps),
        **_left_out(found, worth, facts.helps),
        stood_off_m=(stood.miss_m, stood.left_m),
        too_small=() if sets else too_small(task, found, facts.helps),
        as_stated=stated,
    )


def _to_search(
    given: tuple[Cell, Measured, Estimate, tuple[Effect, ...], Twins, Components | None],
    shape: NoiseShape | None,
    drift: Drift | None,
    surroundings: Surrounded | None,
) -> tuple[Cell, Measured, UnloadedFacts, SearchTask, ScatterRatio]:
    """The search in displacements, on the robot that the unloaded reflectors show."""
    cell, data, estimate, whole = given[:4]
    task, spread = search_task(*given)
    wander, stiff = between_poses(shape, drift), as_stiff(cell, estimate)
    grown = drift.grown if drift is not None else None
    stood = from_unloaded(stiff, data, task.certain_noise, whole, wander, grown)
    if stood.corrects:
        cell, data = corrected(cell, data, stood)
        task, spread = search_task(cell, data, estimate, whole, *given[4:])
    task = replace(task, refuted=_refuted(stood, drift), shape=shape, surroundings=surroundings)
    return cell, data, stood, task, spread


def _refuted(stood: UnloadedFacts, drift: Drift | None) -> dict[str, float]:
    """Multiples of the typical magnitude that unloaded and base reflectors rule out, by cause."""
    if drift is None or drift.named or drift.knocked is not None:
        return dict(stood.visible)
    return {**stood.visible, drift.effect.label: drift.visible}


def _held(facts: Facts) -> tuple[FoundCause, ...]:
    """Causes from displacements that improve predictions, and those of the scatter."""
    return (facts.causes if facts.helps else ()) + facts.scatter


def between_poses(shape: NoiseShape | None, drift: Drift | None) -> float:
    """Standard deviation of what moves from pose to pose beside the robot [m].

    The tracker wanders; a base frame that grows with the hall takes the robot with it.
    """
    wander = shape.wander.between_poses if shape is not None and shape.wanders else 0.0
    return float(np.hypot(wander, drift.deformed_m if drift is not None else 0.0))


def _of_search(found: SearchResult, helps: bool) -> dict[str, Any]:
    """What the search itself has to say."""
    return {
        "refused": found.refused,
        "clues": suspect_statistics(found),
        "threshold": found.threshold.p,
        "lack_of_fit": (found.lack_first.p_poses, found.lack_first.p_pulls),
        "remainder": (found.lack.p_poses, found.lack.p_pulls, found.left),
        "rough": found.rough if helps else None,
        "misfits": misfits(found.first),
        "noise_floor_m": rms(found.first.spread),
        "seen": found.seen,
        "settled": found.explains or not found.detected,
    }


def _misfit(estimate: Estimate, spread: ScatterRatio) -> tuple[float | None, float]:
    """`stated_p` and `misfit_p` of the final model.

    The latter is that of F = (chi2 / dof) / s^2 with dof and nu = (u(s) / s)^-2 / 2 degrees of
    freedom, s the scatter of the tracker in contrasts over the noise in use.
    """
    p, dof = estimate.p_value, estimate.dof
    if p is None:
        return None, 1.0
    if dof < 1 or spread.known_from != "contrasts":
        return p, p
    nu = 0.5 * (spread.tracker / spread.tracker_std) ** 2
    return p, max(p, float(special.fdtrc(dof, nu, estimate.chi2 / dof / spread.tracker**2)))


def _alone(
    found: SearchResult, worth: CrossValidation | None, rng: np.random.Generator
) -> tuple[SoleCause, ...]:
    """Effect of each of the likeliest causes by itself, where it improves predictions."""
    single = [(r.suspect, r.probability) for r in found.single[:_SHOWN]]
    every = alone(found.first, single, rng) if worth else ()
    return tuple(one for one in every if one.reduction > 0)


def _unnoticed(
    whole: tuple[Effect, ...], found: SearchResult, facts: Facts, known: Twins
) -> tuple[tuple[Unnoticed, ...], tuple[Unnoticed, ...]]:
    """Causes that may be present, or would have shown, except those that are found or rivals."""
    visible = dict(facts.unloaded.visible)
    if facts.base is not None:
        visible[facts.base.effect.label] = facts.base.visible
    final = found.view if facts.helps else found.first
    names = _listed(facts)
    asked = tuple(effect for effect in whole if effect.label not in names)
    spots, shown = unnoticed(asked, final, final.base, found.threshold.p, known, visible)
    # the entries of a rough table are estimated
    estimated = (*table.NOUNS, "joint_offset") if facts.unloaded.rough else ()
    return spots, tuple(one for one in shown if one.effect.name not in estimated)


def _listed(facts: Facts) -> set[str]:
    """Labels of causes that are found, or rivals of one that is."""
    held = (*_held(facts), *facts.moved)
    drift = {facts.drift.effect.label} if facts.drift else set()
    sag = {"gravity_sag"} if facts.unloaded.weighs else set()
    rivals = {rival.effect.label for cause in held for rival in cause.rivals}
    return {cause.effect.label for cause in held} | rivals | drift | sag


def _left_out(found: SearchResult, worth: CrossValidation | None, helps: bool) -> dict[str, Any]:
    """Cross-validation residuals of the joint springs and of the extended model."""
    view, springs = found.first, np.arange(found.first.first)
    every = np.ones(len(view.rows), dtype=bool)
    left = view.raw[:, -1] - view.predicted(springs, view.M, every)
    before = worth.before if worth else left
    after = worth.after if worth and helps else before
    return {"left_out_before_m": before, "left_out_after_m": after}


def _facts(task: SearchTask, found: SearchResult, spread: ScatterRatio) -> Facts:
    """Facts from the displacements, without the causes themselves."""
    outside = found.stranger
    return Facts(
        detected=found.detected,
        explains=found.explains,
        outside=PossibleCause(found.wide.suspects[outside.suspect], outside.probability)
        if outside
        else None,
        refused=_refused(task, found),
        remainder=found.rough,
        loose_p=found.first.soft_p,
        scale_ratio=task.force_noise,
        tracker_ratio=task.noise,
        scatter_told=task.data.noise_stated or spread.known_from == "contrasts",
        # with one reflector the certificate alone separates scatter from misfit
        beyond_certificate=task.data.noise_stated
        and spread.known_from == "residuals"
        and spread.tracker_p < alarms.SCATTER,
    )


def _refused(task: SearchTask, found: SearchResult) -> tuple[Effect, ...]:
    """Causes refused for their magnitude that are likelier than not in an accepted one's place.

    Where none was accepted, in the place of a sole cause.
    """
    places = found.rivals or (found.single,)
    likely = {one.suspect: one for place in places for one in place if one.probability > 0.5}
    mine = {task.suspects[one].label for one in found.accepted}  # some were refused early on
    refused = {*found.refused} - mine
    return tuple(task.suspects[k] for k, one in likely.items() if one.label in refused)


def _searched(
    task: SearchTask, spread: ScatterRatio, start: Array, rng: np.random.Generator
) -> tuple[SearchTask, ScatterRatio, SearchResult, CurrentModel | None]:
    """Search with the scale's stated scatter; with a larger one only if no cause explains the data.

    A cause not yet identified looks like scatter of the scale from pull to pull; therefore only
    what neither a cause nor a law outside the catalogue explains may be scatter.

    Returns:
        The suspects, the scatter, the result, and `Diagnosed.as_stated`.
    """
    stated = replace(task, force_noise=1.0)
    asked, found = with_unlisted_laws(stated, search(stated, start, rng), start)
    if task.force_noise > 1 and found.detected and not found.explains:
        other = search(task, start, deepcopy(rng))  # what follows keeps its draws
        if other.explains or not other.detected:
            task, other = with_unlisted_laws(task, other, start)
            return task, spread, other, found.seen.model
    return asked, replace(spread, force=1.0, force_std=0.0, force_p=1.0), found, None


def search_task(
    cell: Cell,
    data: Measured,
    estimate: Estimate,
    whole: tuple[Effect, ...] | None = None,
    known: Twins | None = None,
    noise: Components | None = None,
) -> tuple[SearchTask, ScatterRatio]:
    """The suspects, with the scatter and the equilibrium that the data show.

    Args:
        cell: The joint springs model.
        data: The measurements.
        estimate: Its joint springs.
        whole: The catalogue; by default that of robot and loads.
        known: Its twins; computed by default.
        noise: Noise found in the campaign; by default estimated from its pulls.
    """
    whole = catalogue(cell.robot, data.pulls) if whole is None else whole
    known = known or twins(cell.robot, data.pulls.weighed)
    never = {*known.unmoved, *known.of_stiffness, *(effect.label for effect, _ in cell.held)}
    suspects = tuple(e for e in whole if not isinstance(e, Noise) and e.label not in never)
    data = replace(data, tool_std=data.tool_std or _POINTS_M, bends=False)
    plain = SearchTask(replace(cell, equilibrium="undeformed"), data, suspects, 1.0)
    seen = plain.linearised(plain.model((), estimate.value))
    system = seen.system
    tracker = _of_pulls(plain, seen, system) if noise is None else noise.left
    spread = scatter(plain.whitened(seen), system, tracker)
    larger = spread.tracker_p < alarms.SCATTER
    task = replace(
        plain,
        noise=spread.tracker,
        certain_noise=spread.tracker if larger or not data.noise_stated else 1.0,
        force_noise=spread.force,
        nameless=competing(cell.robot),
    )
    return replace(task, cell=replace(task.cell, equilibrium=_bent(task, seen))), spread


def _of_pulls(task: SearchTask, seen: Linearised, system: System) -> tuple[float, float]:
    """`Components.left` from a campaign's pulls, without its repeated zeros."""
    residual = seen.y - seen.B @ seen.model.values
    contrasts = pure_error(system, residual, task.data, Zeros.none(), task.cell)
    found = variance_components(contrasts)
    return float(found.scale[0]) / (task.data.found_m or 1.0), float(found.std[0])


def _bent(task: SearchTask, seen: Linearised) -> str:
    """The equilibrium, on the undeformed or the deformed robot, that fits better.

    That of the positions where there are any: they are of the deformed robot.
    """
    if task.data.stance is not None:
        return "deformed"
    views = [task.whitened(seen.bent(equilibrium)) for equilibrium in _EQUILIBRIA]
    return _EQUILIBRIA[int(np.argmin([eliminate(v.M, v.base)[-1, -1] for v in views]))]


def _gain(
    task: SearchTask, found: SearchResult, rng: np.random.Generator
) -> CrossValidation | None:
    if not found.accepted or found.first.poses < 4:
        return None
    return gain(task, found.first, found.plain, found.threshold.p, rng)
