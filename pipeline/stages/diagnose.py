"""Stage 7. What the model gets wrong: detect, name, extend, measure the gain, ask for more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import scipy.sparse
from scipy import special, stats

from pipeline.cell import Cell, predict
from pipeline.diagnosis.blindspots import blind_spots, smallest_visible
from pipeline.diagnosis.evidence import ROUNDING, clean
from pipeline.diagnosis.gain import Gain, alone, gain, rms
from pipeline.diagnosis.identify import ROUGH, Case, Found, by_label, of_model, search
from pipeline.diagnosis.isolability import Twins, twins
from pipeline.diagnosis.nextpose import Candidates, Proposal, candidates, propose
from pipeline.diagnosis.noise import SURE, Scatter, scatter
from pipeline.diagnosis.separability import separation
from pipeline.diagnosis.standing import Standing, as_stiff, corrected, standing, student
from pipeline.diagnosis.verdict import (
    Amplitude,
    Cause,
    Clue,
    Diagnosis,
    Misfit,
    Named,
    location,
)
from pipeline.diagnosis.view import SOFT, Sight, View, coefficients, eliminate, same_gear
from pipeline.effects import Effect, Elastic, Noise, Pulls, catalogue
from pipeline.effects.nameless import nameless
from pipeline.errors import InputError
from pipeline.results import Array, Estimate, Parameter, System
from pipeline.stages.assemble import Measured, assemble
from pipeline.stages.estimate import solve
from pipeline.stages.validate import Where
from pipeline.stages.variance import at_most

EQUILIBRIA = ("deformed", "undeformed")

CERTAIN = 0.95
"""A cause less probable than this among its rivals is not named singly."""

UNKNOWN = 0.5
"""What has no name stands where a cause was sought if it is likelier than this."""

SHOWN = 5
"""So many causes are shown that could be the only one."""

POINTS_M = 3e-4
"""Standard uncertainty per axis of the tool's points [m] where the campaign states none."""


def diagnose(
    cell: Cell,
    data: Measured,
    estimate: Estimate,
    where: Where,
    rng: np.random.Generator,
    effects: tuple[Effect, ...] | None = None,
) -> Diagnosis:
    """Find what the paper's model misses in one campaign.

    Args:
        cell: The paper's model.
        data: The measurements.
        estimate: Its joint springs.
        where: The test pose, for the change of the predicted deflection.
        rng: Source of all draws (threshold, bootstrap, candidate poses).
        effects: The catalogue to search; that of the robot when not given.
    """
    whole = catalogue(cell.robot) if effects is None else effects
    known = twins(cell.robot)
    case, spread = case_of(cell, data, estimate, whole, known)
    hung = as_stiff(cell, estimate)
    stood = standing(hung, data, spread.tracker, whole, rng)
    if stood.effects:
        data = corrected(hung, data, stood)
        case, spread = case_of(cell, data, estimate, whole, known)
    case = replace(case, refuted=stood.visible)
    case, spread, found = _searched(case, spread, estimate.value, rng)
    worth = _gain(case, found, rng)
    causes = _causes(case, found, worth, where, known) + _noise_causes(whole, spread)
    verdict, why = _verdict(found, causes, worth)
    if verdict == "explained" and found.accepted and case.force_noise > 1:
        verdict = "ambiguous"
        why = (
            "What the causes leave is scatter only if the scale scatters "
            f"{case.force_noise * case.noise:.0f} times as much as stated."
        )
    if found.first.soft_p < SOFT:
        verdict = "unexplained"
        why = "The reflectors move against each other under load: a loose nest or a soft effector."
    if verdict == "adequate" and _too_much(spread, data.noise_stated):
        verdict, why = "unexplained", "The residuals are larger than any certificate may be wrong."
    if stood.effects:
        stands = _standing_causes(stood)
        verdict, why = _with_standing(verdict, why, stands, stood)
        causes = stands + causes
    system, extended = _extended(case, found, bool(stood.effects))
    single = [(r.suspect, r.probability) for r in found.single[:SHOWN]]
    final = found.view
    before = worth.before if worth else _alone(found.first)
    return Diagnosis(
        verdict=verdict,
        why=why,
        causes=causes,
        alone=alone(found.first, single, rng) if worth else (),
        blind_spots=blind_spots(whole, final, final.base, found.threshold.p, known, stood.visible),
        next_poses=_next_poses(case, found, causes, worth, known, rng),
        refused=found.refused,
        clues=_clues(found),
        threshold=found.threshold.p,
        lack_of_fit=(found.lack_first.p_poses, found.lack_first.p_pulls),
        remainder=(found.lack.p_poses, found.lack.p_pulls, found.left),
        misfits=_misfits(found.first),
        scatter=spread,
        equilibrium=case.cell.equilibrium,
        apart=separation(found.first, [f[0] for f in by_label(case.suspects).values()]),
        apart_labels=tuple(by_label(case.suspects)),
        system=system,
        estimate=extended,
        left_out_before_m=before,
        left_out_after_m=worth.after if worth else before,
        noise_floor_m=rms(found.first.spread),
        stood_off_m=(stood.miss_m, stood.left_m),
    )


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
    data = replace(data, tool_std=data.tool_std or POINTS_M)
    plain = Case(replace(cell, equilibrium="undeformed"), data, suspects, 1.0)
    start = plain.model((), estimate.value)
    seen = plain.sight(start)
    spread = scatter(plain.look(seen), seen.errors, data.noise_stated)
    case = replace(
        plain, noise=spread.tracker, force_noise=spread.force, nameless=nameless(cell.robot)
    )
    return replace(case, cell=replace(case.cell, equilibrium=_bent(case, seen))), spread


def _bent(case: Case, seen: Sight) -> str:
    """The equilibrium, on the straight or the deflected robot, that fits better."""
    views = [case.look(seen.bent(equilibrium)) for equilibrium in EQUILIBRIA]
    return EQUILIBRIA[int(np.argmin([eliminate(v.M, v.base)[-1, -1] for v in views]))]


def _gain(case: Case, found: Found, rng: np.random.Generator) -> Gain | None:
    if not found.accepted or found.first.poses < 4:
        return None
    return gain(case, found.first, found.plain, found.threshold.p, rng)


def _alone(view: View) -> Array:
    """Residuals of the joint springs [m]."""
    base = np.arange(view.first)
    x = coefficients(view.M, base)[: view.springs] * view.typical[: view.springs]
    return view.raw[:, -1] - view.raw[:, : view.springs] @ x


def _too_much(spread: Scatter, stated: bool) -> bool:
    """With one reflector nothing tells scatter from misfit but the certificate."""
    return stated and spread.known_from == "residuals" and spread.tracker_p < SURE


def _verdict(found: Found, causes: tuple[Cause, ...], worth: Gain | None) -> tuple[str, str]:
    """One word and one sentence."""
    if not found.detected:
        if causes:
            said = ", ".join(cause.effect.name for cause in causes)
            return "explained", f"The readings scatter more than stated ({said}); else nothing."
        return "adequate", "The joint springs explain what was measured."
    if not found.accepted:
        return "unexplained", "Something is missing from the model, and no known cause explains it."
    names = " and ".join(cause.effect.label for cause in causes if cause.gain is not None)
    if found.rough > ROUGH:
        return (
            "unexplained",
            f"{names} explains most, but what is left is {found.rough:.1f} times the scatter "
            "of the readings: the place is likely, the law is another.",
        )
    if not found.clean:
        return "unexplained", f"Beside {names} something remains that no known cause explains."
    stranger = found.stranger
    unnamed = stranger.probability if stranger else 0.0
    looks = found.wide.suspects[stranger.suspect].signature if stranger else ""
    if unnamed > UNKNOWN:
        return (
            "unexplained",
            f"{names} comes nearest, but something that the catalogue has no name for explains "
            f"more: it looks like {looks}.",
        )
    if worth is not None and worth.ci95[0] <= 0:
        return "ambiguous", f"{names} fits, but does not predict left-out poses better for certain."
    twice = _two_laws(found, causes)
    if twice:
        return (
            "ambiguous",
            f"Joint {twice} turns by a law of its own: {names} describe it only together.",
        )
    doubtful = [c for c in causes if c.twins or c.probability < CERTAIN]
    if doubtful:
        told = "; ".join(
            " or ".join([c.effect.label, *(r.effect.label for r in c.rivals[:3])]) for c in doubtful
        )
        return "ambiguous", f"The data cannot tell {told}."
    if unnamed > 1 - CERTAIN:
        return (
            "ambiguous",
            f"The data cannot tell {names} from something that the catalogue has no name for, "
            f"which looks like {looks}.",
        )
    return (
        "explained",
        f"With {names} in the model nothing is left but the scatter of the readings.",
    )


def _two_laws(found: Found, causes: Sequence[Cause]) -> int | str | None:
    """The joint whose gear needs two laws of the catalogue at once: it has a third one."""
    effects = [cause.effect for cause in causes[: len(found.accepted)]]
    for one, other in combinations(effects, 2):
        if same_gear(one, other):
            return one.where
    return None


def _causes(
    case: Case, found: Found, worth: Gain | None, where: Where, known: Twins
) -> tuple[Cause, ...]:
    if not found.accepted:
        return ()
    change = _change(found, where)
    sizes = _amplitudes(case, found.plain)
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
                twins=_twins_of(effect.label, known),
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
    assert stood.fit is not None
    quantile, out = student(stood.fit), []
    for k, effect in enumerate(stood.effects):
        value, std = stood.fit.size(k)
        sizes = tuple(
            Amplitude(p, float(v), float(s), (float(v - quantile * s), float(v + quantile * s)))
            for p, v, s in zip(effect.parameters, value, std, strict=True)
        )
        odds = {one.label: probability for one, probability in stood.rivals[k]}
        rivals = tuple(Named(one, odds[one.label]) for one, _ in stood.rivals[k] if one != effect)
        p_value = stood.p_values[k]
        out.append(
            Cause(effect, odds[effect.label], sizes, p_value, rivals, None, (), stood.gain, None)
        )
    return tuple(out)


def _with_standing(
    verdict: str, why: str, stands: tuple[Cause, ...], stood: Standing
) -> tuple[str, str]:
    """Verdict and sentence of the displacements, with what the unloaded reflectors say."""
    names = " and ".join(cause.effect.label for cause in stands)
    said = (
        f"The unloaded reflectors stand {1e3 * stood.miss_m:.2g} mm off where the robot's table "
        f"puts them, and {1e3 * stood.left_m:.2g} mm with {names}."
    )
    sure = all(cause.probability >= CERTAIN for cause in stands)
    if verdict == "adequate":
        return ("explained" if sure else "ambiguous"), said
    return (verdict if sure or verdict != "explained" else "ambiguous"), f"{said} {why}"


def _twins_of(label: str, known: Twins) -> tuple[str, ...]:
    return tuple(b if a == label else a for a, b in known.pairs if label in (a, b))


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
            interval = (value - 1.96 * std, value + 1.96 * std)
            size = Amplitude(effect.parameters[0], value, std, interval)
            out.append(Cause(effect, at_most(p), (size,), p, (), None, (), None, None))
    return tuple(out)


def _change(found: Found, where: Where) -> float:
    """How much the deflection predicted at the test pose moves, mean over targets [m]."""
    zero = np.zeros(1)
    pulls = Pulls(
        zero.astype(np.int64),
        zero.astype(np.int64),
        where.q[None],
        where.force[None],
        zero + 1,
        zero,
        zero,
        zero,
    )
    first, last = found.first.model, found.view.model
    old = predict(first.cell, pulls, first.values).displacement
    new = predict(last.cell, pulls, last.values).displacement
    return float(np.mean(np.linalg.norm(new - old, axis=-1)))


def _amplitudes(case: Case, view: View) -> list[tuple[Amplitude, ...]]:
    """Sizes of the accepted causes, springs estimated along; scatter as the residual has it."""
    base = view.base
    value = coefficients(view.M, base)
    N = view.M[np.ix_(base, base)]
    size = np.sqrt(np.diag(N))
    values, vectors = np.linalg.eigh(N / np.outer(size, size))
    seen = values > 1e-11
    half = vectors[:, seen] / np.sqrt(values[seen]) / size[:, None]
    dof = view.rows_left - (len(base) - view.first)
    rest = float(eliminate(view.M, base)[-1, -1])
    std = np.sqrt(np.sum(half**2, axis=1) * max(rest / dof, 0.0))
    std[(np.abs(vectors[:, ~seen]) > 1e-4).any(axis=1)] = np.inf
    quantile = float(stats.t.ppf(0.975, dof))
    out = []
    for suspect in view.model.accepted:
        at = [int(np.flatnonzero(base == c)[0]) for c in view.columns([suspect])]
        effect = case.suspects[suspect]
        sizes = []
        for k, parameter in zip(at, effect.parameters, strict=True):
            here = value[k] * parameter.typical
            mine = std[k] * parameter.typical
            interval = (here - quantile * mine, here + quantile * mine)
            if not isinstance(effect, Elastic) and np.isfinite(mine):
                interval = profile(view, suspect, parameter, here, mine, rest / dof)
            sizes.append(Amplitude(parameter, float(here), float(mine), interval))
        out.append(tuple(sizes))
    return out


def profile(
    view: View, suspect: int, parameter: Parameter, value: float, std: float, variance: float
) -> tuple[float, float]:
    """95 % interval where chi-square, everything else refitted, has risen by 3.84.

    Elastic causes are linear in their parameters and have none of this; force and geometry bend
    it. One step of the secant rule from 1.96 standard uncertainties is enough for what they bend.
    """
    out = []
    for side in (-1.96, 1.96):
        rise = _rise(view, suspect, parameter, value + side * std) / variance
        out.append(value + side * std * float(np.sqrt(3.84 / max(rise, 1.0))))
    return out[0], out[1]


def _rise(view: View, suspect: int, parameter: Parameter, at: float) -> float:
    """Rise of chi-square when one parameter is held, the others refitted.

    The others follow the linear model; what bends shows in the prediction at these values, and
    they follow once more.
    """
    names = [p.name for p in view.suspects[suspect].parameters]
    fixed = int(view.columns([suspect])[names.index(parameter.name)])
    free = view.base[view.base != fixed]
    A = view.A.copy()
    A[:, -1] -= A[:, fixed] * (at / view.typical[fixed])
    found = dict(zip(free.tolist(), coefficients(A.T @ A, free), strict=True))
    found[fixed] = at / view.typical[fixed]
    mine = of_model(view)
    values = np.array([found[c] for c in mine.tolist()]) * view.typical[mine]
    data = view.seen.data
    moved = predict(view.model.cell, data.pulls, values).displacement[data.pull, data.target]
    B = view.raw[:, np.where(mine < view.springs, mine, mine - view.common)]
    white = view.white.by_pose(data.delta.ravel() - moved.ravel() + B @ values) / view.noise
    A[: len(white), -1] = white - A[: len(white), fixed] * (at / view.typical[fixed])
    best = float(eliminate(view.M, view.base)[-1, -1])
    return float(eliminate(A.T @ A, free)[-1, -1]) - best


def _extended(case: Case, found: Found, moved: bool) -> tuple[System | None, Estimate | None]:
    """Springs and causes as one linear system about the final values, and its solution.

    Args:
        case: The case.
        found: The causes that the displacements called for.
        moved: The robot stands elsewhere than its log says, which the case already knows.
    """
    if not found.accepted and not moved:
        return None, None
    model = found.view.model
    flat = replace(model.cell, equilibrium="undeformed")
    system = assemble(flat, case.data, model.values)
    bent = predict(model.cell, case.data.pulls, model.values).displacement
    bent = bent - predict(flat, case.data.pulls, model.values).displacement
    c = system.c - bent[case.data.pull, case.data.target].ravel()
    scale = np.where(system.errors.source == "force_reading", case.force_noise, 1.0) * case.noise
    G = scipy.sparse.csr_array(system.errors.G @ scipy.sparse.diags_array(scale))
    system = replace(system, c=c, errors=replace(system.errors, G=G))
    return system, solve(system, model.values)


def _clues(found: Found) -> tuple[Clue, ...]:
    view, now = found.first, found.scores
    S = eliminate(view.M, view.base)
    seen = smallest_visible(view, view.base, found.threshold.p)
    out = []
    for forms in by_label(view.suspects).values():
        i = max(forms, key=lambda i: now.log_evidence[i])
        columns = view.columns([i])
        whole = float(np.trace(view.M[np.ix_(columns, columns)]))
        left = float(np.trace(S[np.ix_(columns, columns)]))
        absorbed = 1.0 - left / whole if whole > 0 else 1.0
        out.append(
            Clue(
                view.suspects[i],
                float(now.p[i]),
                float(now.log_evidence[i]),
                min(max(absorbed, 0.0), 1.0),
                float(np.min([seen[j] for j in forms])),
            )
        )
    return tuple(out)


def _misfits(view: View) -> tuple[Misfit, ...]:
    """Which place of the cell takes most of the misfit when all its suspects join at once."""
    S = eliminate(view.M, view.base)
    dof = view.rows_left
    rest = max(float(S[-1, -1]), ROUNDING * dof)
    places: dict[str, list[int]] = {}
    for i, effect in enumerate(view.suspects):
        places.setdefault(location(effect), []).append(i)
    out = []
    for place, members in places.items():
        columns = view.columns(members)
        G, h, rank = clean(
            S[np.ix_(columns, columns)][None], S[columns, -1][None], view.M[columns, columns][None]
        )
        k = int(rank[0])
        if not k or dof - k < 5:
            continue
        T = float(h[0] @ np.linalg.pinv(G[0], rcond=1e-9, hermitian=True) @ h[0])
        T = min(max(T, 0.0), rest)
        left = max((rest - T) / (dof - k), ROUNDING)
        p = float(special.fdtrc(k, dof - k, (T / k) / left))
        out.append(Misfit(place, T / rest, p))
    return tuple(sorted(out, key=lambda m: m.p_value))


def _next_poses(
    case: Case,
    found: Found,
    causes: Sequence[Cause],
    worth: Gain | None,
    known: Twins,
    rng: np.random.Generator,
) -> tuple[Proposal, ...]:
    """For every undecided pair the pulls that would decide it, as far as any can."""
    pairs = _undecided(found, causes, worth, known)
    if not pairs:
        return ()
    try:
        among: Candidates = candidates(case, rng)
    except InputError:
        return ()
    out: list[Proposal] = []
    for mine, rival in pairs:
        rest = [i for i in found.accepted if i != mine]
        out += propose(found.wide, (mine, rival), rest, among)
    return tuple(out)


def _undecided(
    found: Found, causes: Sequence[Cause], worth: Gain | None, known: Twins, most: int = 3
) -> list[tuple[int, int | None]]:
    """Accepted causes, each with what it must still be told from; None stands for nothing at all.

    Twins are left out: no pull helps, a sensor does (`needs` of the causes).
    """
    pairs: list[tuple[int, int | None]] = []
    for place, mine in enumerate(found.accepted):
        cause = causes[place]
        never = (cause.effect.label, *_twins_of(cause.effect.label, known))
        rivals = [r for r in found.rivals[place] if r.label not in never and r.probability > 0.02]
        if cause.probability < CERTAIN:
            pairs += [(mine, r.suspect) for r in rivals]
        if found.strange and found.strange[place].probability > 1 - CERTAIN:
            pairs.append((mine, found.strange[place].suspect))
    if not pairs and worth is not None and worth.ci95[0] <= 0:
        pairs = [
            (mine, None) for mine, c in zip(found.accepted, causes, strict=False) if not c.twins
        ]
    return pairs[:most]
