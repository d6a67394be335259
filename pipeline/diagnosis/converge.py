"""One iteration over mistakes, noise and causes, each judged given the others.

The state consists of mistakes in single readings and pulls, the noise (scale and shape) and the
causes. Each move changes one of them given the other two: readings are screened again from
everything in the files, given springs, causes and the tails of all doubtful readings together; the
noise is estimated again given the causes; causes are sought again in the remaining readings. It
ends where no move changes anything. Mistakes in whole files were corrected before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.diagnosis.diagnose import diagnose
from pipeline.diagnosis.drift import motion
from pipeline.diagnosis.facts import Diagnosed, FoundCause
from pipeline.diagnosis.noise_bounds import bounds
from pipeline.faults.base_reading import astray
from pipeline.faults.screen import Screened, ScreeningBase, files_beside, files_of, singles_of
from pipeline.machine.effects.nameless import NAMELESS
from pipeline.reduction.bring import Reduced, Step, bring
from pipeline.reduction.case import Case
from pipeline.reduction.measured import Measured
from pipeline.reduction.pose_of_interest import PoseOfInterest, place_of_interest
from pipeline.system import alarms
from pipeline.system.family import FAR_OFF, Family
from pipeline.system.fit import Fitted, fit
from pipeline.system.linearised import Linearised, linearise
from pipeline.system.noise_shape import NoiseShape, shape, tails
from pipeline.system.odds import DECIDES
from pipeline.system.outlying import OutlyingReadings, far
from pipeline.system.simultaneous import cost

_SEED = 20261103
"""Seed of the draws; another one changes numbers within their stated scatter."""

_LAWS = 1000
"""Number of laws outside the catalogue that are tested on a robot [1], to an order of magnitude."""

_ROUNDS = 6
"""Maximum number of changes of the mistakes; if states recur in a cycle they are equally good, and
the one with the fewest mistakes is used."""


@dataclass(frozen=True, eq=False)
class _Converged:
    """State that no single move changes.

    Attributes:
        screened: Mistakes in the data.
        right: The campaign without them, weighted by the estimated noise.
        where: The test pose.
        diagnosis: The causes, and what the model lacks.
    """

    screened: Screened
    right: Fitted
    where: PoseOfInterest
    diagnosis: Diagnosed


def converge(case: Case, reduced: Reduced, given: Fitted, step: Step) -> _Converged:
    """Mistakes, noise and causes of a campaign.

    Args:
        case: The campaign as given.
        reduced: Its measurements.
        given: Its joint springs.
        step: How a stage is carried out.
    """
    files = step(files_of)(case, reduced)
    held = step(singles_of)(files, None if files.findings else reduced)
    end = _ended(case, files, held, given, step)
    for other in step(_supposed)(case, files, end):
        found = _ended(case, files, other, given, step)
        if found.diagnosis.settled and _cost(found) < _cost(end) - DECIDES:
            return _bounded(found)
    return _bounded(end)


def _ended(case: Case, files: Screened, held: Screened, given: Fitted, step: Step) -> _Converged:
    """The state that no single move changes, from some mistakes on."""
    ends: list[_Converged] = []
    for _ in range(_ROUNDS):
        ends.append(_noise_and_causes(held, given, step))
        moved = step(_screened)(case, files, ends[-1])
        if moved.key == held.key:
            return replace(ends[-1], screened=moved)
        held = moved
        again = [k for k, one in enumerate(ends) if one.screened.key == held.key]
        if again:
            break
    ends = ends[again[0] :] if again else ends[-2:]  # the cycle, or the last two
    return min(ends, key=lambda one: len(one.screened.findings))


def _supposed(case: Case, files: Screened, end: _Converged) -> tuple[Screened, ...]:
    """Mistakes instead of a law that nobody listed, or of a larger scatter of the scale, each once.

    A few wrong forces widen the scatter of all, within which none of them stands out, and hide a
    cause: readings are screened with the scatter as stated, beside the likeliest cause that was
    sought with it, then beside the two likeliest, and so on. Another zero of the scale since a pose
    is nearly a law in time: beside a law outside the catalogue, readings are screened without, and
    beside the causes that were found with it.
    """
    said, found = end.diagnosis, dict[object, Screened]()
    springs, own = files.case.cell, len(files.case.cell.effects)
    listed, start = [e for e in said.modelled if e.law is None], files.case.robot.nominal_compliance
    cells = [springs, *([springs.with_effects(*listed)] if listed else [])] if _strange(end) else []
    bases = [(one, np.pad(start, (0, len(one.parameters) - len(start)))) for one in cells]
    if (model := said.as_stated) is not None:
        for count in range(own, len(model.cell.effects) + 1):
            cell = springs.with_effects(*model.cell.effects[own:count])
            bases.append((cell, model.values[: len(cell.parameters)]))
    for cell, start in bases:
        base = ScreeningBase(cell, start, _tails(files, end), said.seen.suspects)
        one = singles_of(files_beside(case, files, base), None, base)
        found.setdefault(one.key, one)
    return tuple(one for key, one in found.items() if key != end.screened.key)


def _strange(end: _Converged) -> list[FoundCause]:
    """The laws outside the catalogue that were found."""
    return [one for one in end.diagnosis.causes if one.effect.law is not None]


def _cost(end: _Converged) -> float:
    """Minus twice the log likelihood of scatter, mistakes and strange laws, with their priors.

    2 n ln s + (ln s / ln 2)^2 + sum cost(z^2), n pulls, s the scatter of the scale over the stated
    one and z the deviations of what is wrong; a law was found among `_LAWS` others, the prior of
    which it shares. The residuals over the scatter in use are alike.
    """
    log = float(np.log(max(end.diagnosis.scatter.scale, 1.0)))
    wrong = sum(float(cost(one.before**2, one.axes)) for one in end.screened.findings)
    for one in _strange(end):
        times = abs(one.height.value / one.height.std) if one.height else 1.0
        wrong += float(cost(times**2, len(one.amplitudes))) + 2 * np.log(_LAWS / NAMELESS)
    return 2 * len(end.right.data.pulls) * log + (log / np.log(2.0)) ** 2 + wrong


def _bounded(end: _Converged) -> _Converged:
    """The state with its noise and misfit compared with their bounds."""
    right, said = end.right, end.diagnosis
    left = OutlyingReadings.none()
    if right.plain.noise_stated:
        seen = _seen(right, said)
        base = astray(right.reduced.registration, float(right.noise.scale[0]), FAR_OFF)
        # a gross error spoils what a single iteration finds of the tails
        left = far(seen, tails(seen, seen.model.accepted)[1], base, right.used)
    best = said.hypotheses[0] if said.hypotheses else right
    kept = bounds(right, best.system, best.estimate, left, said.scatter.scale)
    away = [one for one in end.screened.doubted if one.before > FAR_OFF and one.may_be_noise]
    kept = replace(kept, doubted=tuple(at for one in away for at in one.at))
    return replace(end, diagnosis=replace(said, facts=replace(said.facts, bounds=kept)))


def _noise_and_causes(held: Screened, given: Fitted, step: Step) -> _Converged:
    """Noise and causes, given some mistakes."""
    right = step(fit)(held.case, bring(held.case)) if held.findings else given
    where = place_of_interest(held.case.settings.test_pose, right.case.robot, right.data.pulls)
    return _weighed(_Converged(held, right, where, _diagnosed(right, where, step)), step)


def _screened(case: Case, files: Screened, end: _Converged) -> Screened:
    """Readings and pulls screened, and the noise estimated, given the causes."""
    said, family = end.diagnosis, _tails(files, end)
    cell, start = files.case.cell, files.case.robot.nominal_compliance
    richer = cell.with_effects(*said.modelled)
    if said.estimate is not None and richer.parameters == said.estimate.parameters:
        cell, start = richer, said.estimate.value
    nothing = not end.screened.findings and not end.screened.doubted
    if nothing and cell is not richer:
        return end.screened
    base = ScreeningBase(cell, start, family, said.seen.suspects)
    return singles_of(files_beside(case, files, base), None, base)


def _tails(files: Screened, end: _Converged) -> Family | None:
    """Tails of all readings given the accepted model, including those that noise may have moved.

    None where no noise is stated, so that it is estimated from the residuals only.
    """
    right, seen = end.right, end.diagnosis.seen
    if not right.plain.noise_stated:
        return None
    case = end.screened.without_doubt(files)
    reduced = right.reduced if case is right.case else bring(case)
    data = _as_scattered(right.as_noisy(reduced.data), end.diagnosis)
    found = tails(linearise(seen.model, data, seen.suspects), seen.model.accepted)[1]
    return found.of(right.used)


def _diagnosed(right: Fitted, where: PoseOfInterest, step: Step) -> Diagnosed:
    """The diagnosis; every one uses the same draws."""
    rng = np.random.default_rng(_SEED)
    cell, data = right.case.cell, right.data
    effects, moved = motion(right)
    noted = right.noise, right.shape, right.case.settings
    return step(diagnose)(cell, data, right.estimate, where, rng, effects, moved, *noted)


def _weighed(end: _Converged, step: Step) -> _Converged:
    """The campaign weighted by the noise that is estimated given the accepted model.

    First its shape; where the model lacks something, only if such noise is likely whatever the
    machine does, and completes the model. Then its scale: where the residuals exceed the stated
    noise but not that of the contrasts, the latter is used.
    """
    right, said, where = end.right, end.diagnosis, end.where
    if not right.plain.noise_stated or not (said.settled or _noise_likely(right, said)):
        return end
    seen = _beside(right, said)
    if seen.differs(right.shape):
        weighed = right.shaped(seen)
        again = _diagnosed(weighed, where, step)
        if not (said.settled or again.settled):
            return end
        right, said, seen = weighed, again, _beside(weighed, again)
    right = replace(right, shape=seen)
    end = replace(end, right=right, diagnosis=said)
    p = said.facts.stated_p
    if right.noise.used or p is None or not p < alarms.MISFIT <= said.facts.misfit_p:
        return end
    right = replace(step(fit)(right.case, right.reduced, taken=True), shape=seen).shaped(seen)
    return replace(end, right=right, diagnosis=_diagnosed(right, where, step))


def _noise_likely(right: Fitted, said: Diagnosed) -> bool:
    """Whether heavier tails or a wander are likelier than not, whatever the machine does.

    It is tested given everything that a machine could do, which leaves few residuals to show it; if
    not likely there, given the accepted model with a stiffness of its own for each pose.
    """
    return right.shape.likely or _beside(right, said, loose=True).likely


def _beside(right: Fitted, said: Diagnosed, loose: bool = False) -> NoiseShape:
    """Shape of the noise given the accepted model; `loose` as of `shape`."""
    return shape(_seen(right, said), said.seen.model.accepted, loose)


def _seen(right: Fitted, said: Diagnosed) -> Linearised:
    """The campaign linearised at the accepted model, with noise of no shape."""
    return replace(said.seen, data=_as_scattered(right.shape.off(said.seen.data), said))


def _as_scattered(data: Measured, said: Diagnosed) -> Measured:
    """The measurements with the scatter of the scale that was found; tails would take it."""
    return replace(data, reading_std=said.scatter.scale * data.reading_std)
