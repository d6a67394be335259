"""Stage 7. What the model gets wrong: detect, name, extend, measure the gain, ask for more."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import scipy.sparse

from pipeline.base.arrays import Array
from pipeline.diagnosis.amplitude import amplitudes
from pipeline.diagnosis.average import LEAST, Hypothesis, weighed
from pipeline.diagnosis.blindspots import blind_spots
from pipeline.diagnosis.drift import Drift
from pipeline.diagnosis.facts import Amplitude, Cause, Diagnosis, Facts, Named
from pipeline.diagnosis.identify import NAMELESS, Case, Found, by_label, remainder, search
from pipeline.diagnosis.improvement import Gain, alone, gain, rms
from pipeline.diagnosis.isolability import Twins, twins
from pipeline.diagnosis.separability import separation
from pipeline.diagnosis.suspect_statistics import clues, misfits
from pipeline.diagnosis.undecided import next_poses
from pipeline.diagnosis.unloaded_fit import student
from pipeline.diagnosis.unloaded_geometry import Standing, as_stiff, corrected, standing
from pipeline.machine.cell import Cell, predict
from pipeline.machine.effects import Effect, Noise, Pulls, catalogue
from pipeline.machine.effects.nameless import nameless
from pipeline.reduction.measured import Measured
from pipeline.reduction.pose_of_interest import Where
from pipeline.system.assemble import TRACKED, assemble
from pipeline.system.elimination import coefficients, eliminate
from pipeline.system.estimate import fits, identifiable, solve
from pipeline.system.linearised import Model, Sight
from pipeline.system.noise import SURE, Scatter, scatter
from pipeline.system.system import Estimate, System
from pipeline.system.variance import at_most
from pipeline.system.whitened import View, with_laws

_EQUILIBRIA = ("deformed", "undeformed")

_SHOWN = 5
"""So many causes are shown that could be the only one."""

_POINTS_M = 3e-4
"""Standard uncertainty per axis of the tool's points [m] where the campaign states none."""


def diagnose(
    cell: Cell,
    data: Measured,
    estimate: Estimate,
    where: Where,
    rng: np.random.Generator,
    effects: tuple[Effect, ...] | None = None,
    drift: Drift | None = None,
) -> Diagnosis:
    """Find what the paper's model misses in one campaign.

    Args:
        cell: The paper's model.
        data: The measurements.
        estimate: Its joint springs.
        where: The test pose, for the change of the predicted deflection.
        rng: Source of all draws (threshold, bootstrap, candidate poses).
        effects: The catalogue to search; that of the robot when not given.
        drift: What the base reflectors say of the tracker, where they say anything.
    """
    whole = catalogue(cell.robot) if effects is None else effects
    known = twins(cell.robot)
    case, spread = case_of(cell, data, estimate, whole, known)
    hung = as_stiff(cell, estimate)
    stood = standing(hung, data, spread.tracker, whole, rng)
    if stood.effects and not stood.useless:
        data = corrected(hung, data, stood)
        case, spread = case_of(cell, data, estimate, whole, known)
    case = replace(case, refuted=stood.visible)
    case, spread, found = _searched(case, spread, estimate.value, rng)
    worth = _gain(case, found, rng)
    considered = _causes(case, found, worth, where, known)
    helps = worth is None or worth.reduction > 0
    scatters = _noise_causes(whole, spread)
    causes = (considered if helps else ()) + scatters
    stands = () if stood.useless else _standing_causes(stood)
    drifts = _drift_causes(drift, causes)
    facts = replace(
        _facts(case, found, spread),
        causes=considered,
        gain=worth,
        scatter=scatters,
        beyond_a_tracker=estimate.p_value is None and not fits(estimate),
        unloaded=stood,
        moved=stands,
        drift=drift if drifts else None,
    )
    elsewhere = {**stood.visible, **({drift.effect.label: drift.visible} if drift else {})}
    hypotheses = _hypotheses(case, found, bool(stood.effects) and not stood.useless, helps)
    single = [(r.suspect, r.probability) for r in found.single[:_SHOWN]]
    singly = alone(found.first, single, rng) if worth else ()
    final = found.view if helps else found.first
    spots = blind_spots(whole, final, final.base, found.threshold.p, known, elsewhere)
    told = {cause.effect.label for cause in causes}
    told |= {rival.effect.label for cause in causes for rival in cause.rivals}
    before = worth.before if worth else _left_by_springs(found.first)
    return Diagnosis(
        facts=facts,
        causes=stands + drifts + causes,
        alone=tuple(one for one in singly if one.reduction > 0),
        blind_spots=tuple(spot for spot in spots if spot.effect.label not in told),
        next_poses=next_poses(case, found, considered, worth, known, rng),
        refused=found.refused,
        clues=clues(found),
        threshold=found.threshold.p,
        lack_of_fit=(found.lack_first.p_poses, found.lack_first.p_pulls),
        remainder=(found.lack.p_poses, found.lack.p_pulls, found.left),
        rough=found.rough if helps else None,
        misfits=misfits(found.first),
        scatter=spread,
        equilibrium=case.cell.equilibrium,
        apart=separation(found.first, [f[0] for f in by_label(case.suspects).values()]),
        apart_labels=tuple(by_label(case.suspects)),
        hypotheses=hypotheses,
        left_out_before_m=before,
        left_out_after_m=worth.after if worth and helps else before,
        noise_floor_m=rms(found.first.spread),
        stood_off_m=(stood.miss_m, stood.left_m),
    )


def _facts(case: Case, found: Found, spread: Scatter) -> Facts:
    """What the displacements say, but for the causes themselves."""
    outside = found.stranger
    return Facts(
        detected=found.detected,
        explains=found.explains,
        outside=Named(found.wide.suspects[outside.suspect], outside.probability)
        if outside
        else None,
        remainder=found.rough,
        loose_p=found.first.soft_p,
        scale_ratio=case.force_noise,
        tracker_ratio=case.noise,
        beyond_certificate=_beyond_certificate(spread, case.data.noise_stated),
    )


def _beyond_certificate(spread: Scatter, stated: bool) -> bool:
    """With one reflector nothing tells scatter from misfit but the certificate."""
    return stated and spread.known_from == "residuals" and spread.tracker_p < SURE


def _searched(
    case: Case, spread: Scatter, start: Array, rng: np.random.Generator
) -> tuple[Case, Scatter, Found]:
    """Seek causes with the scale as good as stated; with a worse one only if that leaves nothing.

    A cause that nobody has named yet looks like a scatter of the scale, pull by pull: only what
    no cause takes may be scatter.
    """
    stated = replace(case, force_noise=1.0)
    found = search(stated, start, rng)
    if case.force_noise > 1 and found.detected and not found.explains:
        other = search(case, start, rng)
        if other.explains or not other.detected:
            return case, spread, other
    return stated, replace(spread, force=1.0, force_std=0.0, force_p=1.0), found


def case_of(
    cell: Cell,
    data: Measured,
    estimate: Estimate,
    whole: tuple[Effect, ...] | None = None,
    known: Twins | None = None,
) -> tuple[Case, Scatter]:
    """What is asked about, at the scatter and the equilibrium that the data show.

    Args:
        cell: The paper's model.
        data: The measurements.
        estimate: Its joint springs.
        whole: The catalogue; that of the robot when not given.
        known: Its twins; found when not given.
    """
    whole = catalogue(cell.robot) if whole is None else whole
    known = known or twins(cell.robot)
    never = {*known.unmoved, *known.of_stiffness}
    suspects = tuple(e for e in whole if not isinstance(e, Noise) and e.label not in never)
    data = replace(data, tool_std=data.tool_std or _POINTS_M, bends=False)
    plain = Case(replace(cell, equilibrium="undeformed"), data, suspects, 1.0)
    start = plain.model((), estimate.value)
    seen = plain.sight(start)
    spread = scatter(plain.look(seen), seen.errors, data.noise_stated)
    case = replace(
        plain,
        noise=spread.tracker,
        certain_noise=spread.tracker if spread.tracker_p < SURE or not data.noise_stated else 1.0,
        force_noise=spread.force,
        nameless=nameless(cell.robot),
    )
    return replace(case, cell=replace(case.cell, equilibrium=_bent(case, seen))), spread


def _bent(case: Case, seen: Sight) -> str:
    """The equilibrium, on the straight or the deflected robot, that fits better."""
    views = [case.look(seen.bent(equilibrium)) for equilibrium in _EQUILIBRIA]
    return _EQUILIBRIA[int(np.argmin([eliminate(v.M, v.base)[-1, -1] for v in views]))]


def _gain(case: Case, found: Found, rng: np.random.Generator) -> Gain | None:
    if not found.accepted or found.first.poses < 4:
        return None
    return gain(case, found.first, found.plain, found.threshold.p, rng)


def _left_by_springs(view: View) -> Array:
    """Residuals of the joint springs [m]."""
    base = np.arange(view.first)
    x = coefficients(view.M, base)[: view.springs] * view.typical[: view.springs]
    return view.raw[:, -1] - view.raw[:, : view.springs] @ x


def _scales(case: Case, system: System) -> Array:
    """Scatter found over stated, for each column of G: that of the tracker and of the scale.

    What is stated holds unless it is certainly larger.
    """
    source = system.errors.source
    scale = case.force_noise * case.noise if case.force_noise != 1 else 1.0
    tracked = np.isin(source.astype(str), TRACKED)
    return np.where(tracked, case.certain_noise, np.where(source == "force_reading", scale, 1.0))


def _causes(
    case: Case, found: Found, worth: Gain | None, where: Where, known: Twins
) -> tuple[Cause, ...]:
    if not found.accepted:
        return ()
    change = _change(found, where)
    sizes = amplitudes(case, found.plain)
    out = []
    for place, suspect in enumerate(found.accepted):
        effect = case.suspects[suspect]
        mine = [r for r in found.rivals[place] if r.label == effect.label]
        rivals = [r for r in found.rivals[place] if r.label != effect.label]
        out.append(
            Cause(
                effect=effect,
                probability=mine[0].probability if mine else 0.0,
                amplitudes=sizes[place],
                p_value=found.p_values[place],
                rivals=tuple(Named(case.suspects[r.suspect], r.probability) for r in rivals),
                unnamed=_unnamed(found, place),
                twins=known.of(effect.label),
                gain=worth,
                test_pose_change_m=change,
            )
        )
    return tuple(out)


def _unnamed(found: Found, place: int) -> Named | None:
    if not found.strange:
        return None
    one = found.strange[place]
    return Named(found.wide.suspects[one.suspect], one.probability)


def _standing_causes(stood: Standing) -> tuple[Cause, ...]:
    """Causes that the unloaded reflectors call for."""
    if stood.fit is None:
        return ()
    quantile, out = student(stood.fit), []
    for k, effect in enumerate(stood.effects):
        value, std = stood.fit.size(k)
        sizes = tuple(
            Amplitude.symmetric(p, float(v), float(s), quantile)
            for p, v, s in zip(effect.parameters, value, std, strict=True)
        )
        odds = {one.label: probability for one, probability in stood.rivals[k]}
        rivals = tuple(Named(one, odds[one.label]) for one, _ in stood.rivals[k] if one != effect)
        p_value = stood.p_values[k]
        out.append(Cause(effect, odds[effect.label], sizes, p_value, rivals, gain=stood.gain))
    return tuple(out)


def _drift_causes(drift: Drift | None, causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """The drift that the base reflectors show, unless the displacements have told it already."""
    if drift is None or not drift.named or drift.effect.name in {c.effect.name for c in causes}:
        return ()
    sizes = tuple(
        Amplitude.symmetric(p, float(v), float(s))
        for p, v, s in zip(drift.effect.parameters, drift.velocity, drift.std, strict=True)
    )
    odds = at_most(drift.p_value) / (1 + NAMELESS * drift.undecided)
    return (Cause(drift.effect, odds, sizes, drift.p_value),)


def _noise_causes(whole: tuple[Effect, ...], spread: Scatter) -> tuple[Cause, ...]:
    """Causes of scatter: the readings scatter more than a certificate may be wrong."""
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
        if isinstance(effect, Noise) and p < SURE and spread.known_from == "rigidity":
            size = Amplitude.symmetric(effect.parameters[0], value, std)
            out.append(Cause(effect, at_most(p), (size,), p))
    return tuple(out)


def _change(found: Found, where: Where) -> float:
    """How much the deflection predicted at the test pose moves, mean over targets [m]."""
    pulls = Pulls.at(where.q, where.force, branch=1.0)
    first, last = found.first.model, found.view.model
    old = predict(first.cell, pulls, first.values).displacement
    new = predict(last.cell, pulls, last.values).displacement
    return float(np.mean(np.linalg.norm(new - old, axis=-1)))


def _hypotheses(case: Case, found: Found, moved: bool, helps: bool) -> tuple[Hypothesis, ...]:
    """The accepted causes, and every set with likely rivals in their places; none without causes.

    Args:
        case: The case.
        found: The causes that the displacements called for.
        moved: The robot stands elsewhere than its log says, which the case already knows.
        helps: The causes predict left-out poses better than the joint springs alone do.

    A scale that scatters more than stated calls for the same springs weighed anew.
    """
    if not (found.accepted and helps):
        if not moved and case.force_noise == 1:
            return ()
        return (_hypothesis(case, found.first.model, found.first.seen, 1.0),)
    first, *others = _likely(case, found)
    own = _hypothesis(case, found.view.model, found.seen, first.weight)
    return weighed([own, *(_other(case, found, one) for one in others)])


@dataclass(frozen=True)
class _Set:
    """Causes that may be at work together.

    Attributes:
        suspects: Their indices; those behind the case's own have no name.
        weight: Their probability.
        instead: Which accepted causes are not among them, and what stands for each.
    """

    suspects: tuple[int, ...]
    weight: float
    instead: tuple[tuple[int, int], ...] = ()


def _likely(case: Case, found: Found) -> list[_Set]:
    """Sets of causes with their probability: the accepted ones, then others, likeliest first.

    What stands in one place is independent of what stands in another; something without a name
    stands for one or several of the accepted causes at once.
    """
    label = [suspect.label for suspect in case.suspects]
    strangers = {one.places: one for one in found.strange if one.probability > 0}
    known = math.prod(1.0 - one.probability for one in strangers.values())
    every = sum(one.probability for one in strangers.values())
    sets = []
    for rivals in product(*found.rivals):
        if len({rival.label for rival in rivals}) < len(rivals):
            continue  # one cause cannot stand in two places
        odds = known * math.prod(rival.probability for rival in rivals)
        for forms in product(*(rival.forms for rival in rivals)) if odds > LEAST else ():
            chosen = tuple(suspect for suspect, _ in forms)
            pairs = zip(found.accepted, chosen, strict=True)
            instead = tuple((a, b) for a, b in pairs if label[a] != label[b])
            sets.append(_Set(chosen, odds * math.prod(share for _, share in forms), instead))
    for places, one in strangers.items():
        kept = tuple(a for place, a in enumerate(found.accepted) if place not in places)
        instead = tuple((found.accepted[place], one.suspect) for place in places)
        weight = (1.0 - known) * one.probability / every
        sets.append(_Set((*kept, one.suspect), weight, instead))
    own = next((one for one in sets if one.suspects == found.accepted), _Set(found.accepted, 0.0))
    others = [one for one in sets if one.suspects != found.accepted and one.weight > LEAST]
    return [own, *sorted(others, key=lambda one: -one.weight)]


def _other(case: Case, found: Found, one: _Set) -> Hypothesis:
    """Other causes in the places of the accepted ones, estimated together with the springs."""
    known = len(case.suspects)
    if max(one.suspects) >= known:
        case = replace(case, suspects=case.suspects + case.nameless)
    start = found.view.model.values[: case.cell.robot.n]
    seen = case.fitted(one.suspects, start, found.seen)
    instead = tuple(
        (case.suspects[mine].label, _called(case.suspects[other], other < known))
        for mine, other in one.instead
    )
    return _hypothesis(case, seen.model, seen, one.weight, instead)


def _called(effect: Effect, has_a_name: bool) -> str:
    return effect.label if has_a_name else f"something without a name like {effect.label}"


def _hypothesis(
    case: Case,
    model: Model,
    seen: Sight,
    weight: float,
    instead: tuple[tuple[str, str], ...] = (),
) -> Hypothesis:
    """Springs and causes estimated, with uncertainties times what is left over the scatter.

    A model that leaves more than the readings scatter is wrong somewhere: its uncertainties are
    multiplied by that ratio, as Birge does (Physical Review 40 (1932) 207).
    """
    effects = tuple(case.suspects[i] for i in model.accepted)
    system, estimate = _solved(case, model, seen)
    ratio = max(remainder(case.look(seen)) or 1.0, 1.0) if effects else 1.0
    cov = estimate.cov * ratio**2
    known = identifiable(
        np.array([p.typical for p in estimate.parameters]), estimate.value, np.sqrt(np.diag(cov))
    )
    estimate = replace(estimate, cov=cov, identifiable=estimate.identifiable & known)
    return Hypothesis(weight, effects, model.cell, system, estimate, instead, ratio)


def _solved(case: Case, model: Model, seen: Sight) -> tuple[System, Estimate]:
    """Springs and causes as one linear system about the model's values, and its solution.

    Args:
        case: The case.
        model: Where it is linearised.
        seen: The campaign seen from there, for how far the laws of the causes may be others.
    """
    flat = replace(model.cell, equilibrium="undeformed")
    system = assemble(flat, case.data, model.values)
    bent = predict(model.cell, case.data.pulls, model.values).displacement
    bent = bent - predict(flat, case.data.pulls, model.values).displacement
    c = system.c - bent[case.data.pull, case.data.target].ravel()
    G = scipy.sparse.csr_array(system.errors.G @ scipy.sparse.diags_array(_scales(case, system)))
    errors = replace(system.errors, G=G)
    if model.accepted:
        errors = with_laws(seen, errors, case.laws(model.accepted))
    system = replace(system, c=c, errors=errors)
    estimate = solve(system, model.values)
    if not case.data.noise_stated and not case.look(seen).tells_scatter and estimate.dof:
        # the noise was that of the residuals without the causes
        G = scipy.sparse.csr_array(errors.G * np.sqrt(estimate.chi2 / estimate.dof))
        system = replace(system, errors=replace(errors, G=G))
        estimate = solve(system, model.values)
    return system, estimate
