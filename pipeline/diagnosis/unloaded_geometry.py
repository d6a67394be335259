"""Unloaded geometry: joint zeros, base frame and weight show in unloaded positions, in mm.

Robots deviate from their table by half a millimetre to three, for many reasons at once, and a
wrong joint zero can look like any of them. So a cause is accepted only where it, or two or three
together, explain the positions to within the scatter of the readings, or where one alone explains
nearly all and leaves no more than any robot has. Other errors of the geometry raise no false alarm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from pipeline.base.bootstrap import interval
from pipeline.diagnosis.facts import NOTHING, Fit, Gain, Standing
from pipeline.diagnosis.unloaded_fit import Fits, Unloaded, fitted, unloaded
from pipeline.machine.cell import Cell, load
from pipeline.machine.effect import Effect, Geometry, Observation
from pipeline.reduction.measured import Measured
from pipeline.system.system import Estimate

_LEAST_M = 3e-4
"""Deviations from the table below this, rms, are those of any robot."""

_BELIEVED = 1e-3
"""Causes that leave more than chance does at this p are not the ones..."""

_NEARLY_ALL = 0.15
"""... but for one alone that leaves at most this part of the misfit, and less than LEAST_M."""

_NEEDED = 1e-6
"""Each must make the misfit this improbable where it is missing."""

_MOST = 3


def standing(
    cell: Cell, data: Measured, scale: float, effects: Sequence[Effect], rng: np.random.Generator
) -> Standing:
    """Find causes in the unloaded positions that displacements hardly show.

    Args:
        cell: The paper's model.
        data: The measurements; `unloaded` may be NaN, then nothing is found.
        scale: Scatter of the tracker over its stated standard uncertainty.
        effects: The catalogue.
        rng: Draws the bootstrap of the gain.
    """
    suspects = tuple(effect for effect in effects if effect.shows_unloaded)
    zeros = unloaded(cell, data, scale)
    if zeros is None or not suspects:
        return NOTHING
    fits, exact = Fits(zeros), Fits(zeros.exact)
    miss = exact.left(())
    visible = _visible(zeros, suspects)
    if miss < _LEAST_M or fits(()).p > _NEEDED:
        return Standing(miss, miss, visible)
    nobody = Standing(miss, miss, {})  # where the table is off, one more cause would not be seen
    best = _search(fits, exact, suspects)
    if best is None:
        return nobody
    p_values = tuple(fits(_but(best.effects, k)).p for k in range(len(best.effects)))
    if max(p_values) > _NEEDED:
        return nobody
    return replace(
        nobody,
        visible=visible,
        left_m=exact.left(best.effects),
        fit=best,
        p_values=p_values,
        rivals=tuple(_rivals(fits, best, k, suspects) for k in range(len(best.effects))),
        gain=_gain(fits, exact, suspects, rng),
    )


def as_stiff(cell: Cell, estimate: Estimate) -> Cell:
    """The cell with the stiffnesses that were identified, which set the sag under gravity."""
    known = estimate.identifiable & (estimate.value > 0)
    joints = tuple(
        joint.with_stiffness(float(1 / x)) if told else joint
        for joint, x, told in zip(cell.robot.joints, estimate.value, known, strict=True)
    )
    return replace(cell, robot=replace(cell.robot, joints=joints))


def corrected(cell: Cell, data: Measured, found: Standing) -> Measured:
    """The measurements, with the robot where it was found to be."""
    if found.fit is None:
        return data
    fit = found.fit
    bare = replace(cell, effects=fit.effects)
    q = data.pulls.q
    delta = data.delta[:, None]
    for facet, values in bare.split(fit.values):
        if isinstance(facet, Geometry):
            q = q + (facet.geometry(cell.robot, data.pulls, values) - data.pulls.q)
    loaded = load(bare, data.pulls, fit.values)
    for facet, values in bare.split(fit.values):
        if isinstance(facet, Observation):
            delta = facet.observe(loaded, delta, data.pulls.time, -values)
    return replace(data, pulls=replace(data.pulls, q=q, force=loaded.force), delta=delta[:, 0])


def _but(effects: tuple[Effect, ...], number: int) -> tuple[Effect, ...]:
    return effects[:number] + effects[number + 1 :]


def _search(fits: Fits, exact: Fits, suspects: tuple[Effect, ...]) -> Fit | None:
    """The fewest causes that leave no more than chance; None when three do not."""
    chosen: tuple[Effect, ...] = ()
    alone: Fit | None = None
    for _ in range(min(_MOST, len(suspects))):
        free = [suspect for suspect in suspects if suspect not in chosen]
        best = min((fits((*chosen, suspect)) for suspect in free), key=lambda fit: fit.chi2)
        if best.p > _BELIEVED and _possible(best):
            return best
        chosen, alone = best.effects, alone or best
    return alone if alone and _nearly_all(exact, alone) and _possible(alone) else None


def _nearly_all(exact: Fits, fit: Fit) -> bool:
    """Whether causes explain nearly all of the misfit and leave what any robot has."""
    left = exact.left(fit.effects)
    return left < _LEAST_M and left <= _NEARLY_ALL * exact.left(())


def _visible(zeros: Unloaded, suspects: tuple[Effect, ...]) -> dict[str, float]:
    """Multiples of the typical size from which a cause is tested.

    The deviation then is LEAST_M, and more than scatter and stated errors make likely.
    """
    here, out = zeros.stands((), np.zeros(0)), {}
    for suspect in suspects:
        typical = np.array([p.typical for p in suspect.parameters])
        moved = replace(zeros, at=zeros.stands((suspect,), typical))
        size, fit = Fits(moved.exact).left(()), fitted(moved, ())
        if not np.any(moved.at != here) or size < 1e-9 or fit.dof < 1:
            out[suspect.label] = np.inf
            continue
        beyond = special.chdtri(fit.dof, _NEEDED) - fit.dof
        out[suspect.label] = max(_LEAST_M / size, float(np.sqrt(beyond / fit.chi2)))
    return out


def _possible(fit: Fit) -> bool:
    """Every parameter within its physical bounds, to three standard uncertainties."""
    parameters = [p for effect in fit.effects for p in effect.parameters]
    slack = 3 * np.sqrt(np.diag(fit.cov))
    lower, upper = (np.array([getattr(p, end) for p in parameters]) for end in ("lower", "upper"))
    return bool(np.all((fit.values > lower - slack) & (fit.values < upper + slack)))


def _rivals(
    fits: Fits, best: Fit, number: int, suspects: tuple[Effect, ...]
) -> tuple[tuple[Effect, float], ...]:
    """What could stand in the place of one cause, itself included, likeliest first."""
    rest = _but(best.effects, number)
    others = [s for s in suspects if s not in best.effects]
    made = [best, *(fits((*rest, other)) for other in others)]
    able = [best.effects[number], *others]
    rough = max(1.0, best.chi2 / max(best.dof, 1))  # what is left beside the scatter
    odds = special.softmax([-fit.chi2 / rough / 2 - len(fit.values) for fit in made])
    order = np.argsort(-odds, kind="stable")
    return tuple((able[i], float(odds[i])) for i in order if odds[i] > 1e-3)


def _gain(fits: Fits, exact: Fits, suspects: tuple[Effect, ...], rng: np.random.Generator) -> Gain:
    """Leave out one pose at a time, and choose the causes without it."""
    zeros = exact.zeros
    before, after = np.zeros_like(zeros.at), np.zeros_like(zeros.at)
    chosen = []
    for pose in range(int(zeros.pose.max()) + 1):
        out, rest = zeros.pose == pose, exact.without(pose)
        found = _search(fits.without(pose), rest, suspects)
        effects = found.effects if found else ()
        before[out] = zeros.short(rest(()))[out]
        after[out] = zeros.short(rest(effects))[out]
        chosen.append(tuple(effect.label for effect in effects))
    rows = np.repeat(zeros.pose, 3)
    reduction, ci95 = interval(before.ravel(), after.ravel(), rows, rng)
    return Gain(before.ravel(), after.ravel(), reduction, ci95, tuple(chosen), "unloaded positions")
