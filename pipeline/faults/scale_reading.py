"""A reading of the scale that contradicts all others: a digit too many, another row's unit.

A pull's reading is set free beside the model and beside all other pulls; how far it then is from
the log, in standard deviations, is the test: the suspect of pull i is the whitened column dc/df_i,
u(f_i) = N_i^-1/2 [N]. The pull of the largest drop is flagged, and tested again at the reading that
fits best: a reading of ten times the force spoils the estimate, and with it every column and every
standard deviation.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from pipeline.base.arrays import Array
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake, outlying
from pipeline.machine.cell import Cell
from pipeline.machine.effect import HUNG, MOUNTED
from pipeline.reduction.case import Case
from pipeline.reduction.forces import reading_std
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Scale
from pipeline.system import alarms
from pipeline.system.assemble import assemble, by_force
from pipeline.system.beside import Base, Beside
from pipeline.system.estimate import identify, least_squares
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import Whitener, whitener

_MATTERS = 0.03
"""A reading off by a smaller part of the force was not mistyped."""

_STATED = 6.0
"""Nor is one off by less than this many stated standard uncertainties of the scale."""

FEWEST, MOST = 8, 1000
"""Fewer pulls do not single one out; more are no campaign by hand, and each is a column."""

_DOMINATES = 4.0
"""A mistyped reading stands out this much more than any other once it is right: what a force law
or a joint does, it does in many pulls."""

_LEFT = 0.1
"""Part of what its pull contradicted that may be left there: other faults leave more."""

_ROUNDS = 8
"""Iterations to the reading that fits best."""


def scale_outlier(
    case: Case, cell: Cell, data: Measured, system: System, estimate: Estimate
) -> list[Mistake]:
    """The reading of the scale that contradicts all other pulls, if it is the only one.

    Args:
        case: The campaign.
        cell: The model beside which readings are judged.
        data: The measurements.
        system: Their linear system.
        estimate: Its solution.
    """
    pulls = len(data.pulls)
    if not FEWEST <= pulls <= MOST:
        return []
    white = whitener(system.errors, system.rows.pose)
    freed = _freed(cell, data, system, estimate, white)[1]
    best = int(np.argmax(freed.drop))
    if _chance(freed, system)[best] > alarms.READING:
        return []
    scale = case.settings.scale or Scale()
    given = float(np.linalg.norm(data.pulls.force[best]))
    fits = _fitting(cell, data.in_metres(system.found_m), estimate.value, best, scale)
    if fits is None:
        return []
    off = abs(given - fits)
    if off < _MATTERS * min(given, fits) or off < _STATED * float(
        reading_std(scale, np.asarray(fits))
    ):
        return []
    right = _reading(data, best, fits, scale)
    system, estimate = identify(cell, right, estimate.value)
    white = whitener(system.errors, system.rows.pose)
    base, freed = _freed(cell, right, system, estimate, white)
    normal = float(freed.N[best, 0, 0])
    drop = off**2 * normal
    # the reading as given, beside a model that the reading as it should be has not spoilt
    given_again = replace(freed, g=freed.N[..., 0] * off, rest=freed.rest + drop)
    p = float(_chance(given_again, system)[best])
    alone = drop > _DOMINATES**2 * float(np.delete(freed.drop, best).max())
    mine = np.flatnonzero(system.rows.pull == best)
    rows = np.zeros((len(system.rows), len(mine)))
    rows[mine, np.arange(len(mine))] = 1.0  # the pull left out as a whole: each of its rows is free
    alone &= bool(base.beside_all(white(rows)).drop < _LEFT * drop)
    if p > alarms.READING or not alone:
        return []
    return [_finding(case, data, best, given, fits, normal, drop, p)]


def _freed(
    cell: Cell, data: Measured, system: System, estimate: Estimate, white: Whitener
) -> tuple[Base, Beside]:
    """The model's columns, and beside them every pull's reading set free, one at a time [1/N]."""
    columns = np.zeros((len(system.rows), len(data.pulls)))
    columns[np.arange(len(columns)), system.rows.pull] = by_force(cell, data, estimate.value)
    typical = system.typical
    base = Base.of(white(system.B) * typical, white(estimate.residual))
    return base, base.beside(white(columns)[None, ..., None]).of_block(0)


def _chance(freed: Beside, system: System) -> Array:
    """Probability of each drop, times their number; where a noise is stated, s is 1 at least."""
    variance = freed.variance(1.0) if system.noise_stated else freed.variance()
    return np.asarray(len(freed.drop) * freed.p(variance))


def _fitting(cell: Cell, data: Measured, values: Array, pull: int, scale: Scale) -> float | None:
    """What the scale should have read in a pull, all others as they are [N]; None if nothing fits.

    Gauss-Newton: the force f of the pull and the parameters x by c = B x + (dc/df) df, weighted.
    Steps downwards are taken in 1/force: where ten times the force has made the springs ten times
    too stiff, what the pull moved is linear in that.
    """
    force = float(np.linalg.norm(data.pulls.force[pull]))
    for _ in range(_ROUNDS):
        system = assemble(cell, _reading(data, pull, force, scale), values)
        here = system.rows.pull == pull
        one = by_force(cell, _reading(data, pull, force, scale), values) * here
        white = whitener(system.errors, system.rows.pose)
        typical = np.array([*(p.typical for p in system.parameters), force])
        A = white(np.column_stack([system.B, one]))
        found = least_squares(A, white(system.c), typical, np.append(values, 0.0))[0]
        values, step = found[:-1], float(found[-1])
        if not np.isfinite(step):
            return None
        force = force + step if step > 0 else force**2 / (force - step)
        if abs(step) < 1e-6 * force:
            break
    return force


def _reading(data: Measured, pull: int, force: float, scale: Scale) -> Measured:
    """The same with another reading of the scale in one pull [N]."""
    forces, std = data.pulls.force.copy(), data.reading_std.copy()
    forces[pull] *= force / np.linalg.norm(forces[pull])
    std[pull] = reading_std(scale, np.asarray(force))
    return replace(data, pulls=replace(data.pulls, force=forces), reading_std=std)


def _finding(
    case: Case,
    data: Measured,
    pull: int,
    given: float,
    fits: float,
    normal: float,
    drop: float,
    p: float,
) -> Mistake:
    pose, repeat = int(data.pulls.pose[pull]), int(data.pulls.repeat[pull])
    loads = case.loads
    row = loads[(loads["pose"] == pose) & (loads["repeat"] == repeat)].iloc[0]
    where = f"{row['file']} pose{pose:02d} rep{repeat}"
    sigmas = float(np.sqrt(drop))
    hung = data.pulls.by[pull] == HUNG
    one, unit = (case.settings.gravity.m_s2, "kg") if hung else (1.0, "N")
    said = f"{row['payload']}, " if data.pulls.by[pull] == MOUNTED else ""
    return outlying(
        where,
        f"the reading {where} (line {row['line']}) says {said}{given / one:.6g} {unit}, and "
        f"all other pulls agree with {fits / one:.6g} +- {normal**-0.5 / one:.2g} {unit}, "
        f"{sigmas:.0f} standard deviations away",
        "recomputed without this pull",
        before=sigmas,
        size=abs(given - fits) / one,
        size_unit=unit,
        p_value=p,
        beside_model=True,
        correct=partial(_without, pose=pose, repeat=repeat),
        at=(f"{row['file']}:{row['line']}",),
    )


def _without(case: Case, pose: int, repeat: int) -> Case:
    """The campaign without a line of the scale's log."""
    loads = case.loads
    return replace(case, loads=loads[(loads["pose"] != pose) | (loads["repeat"] != repeat)])


FAULT = Fault(
    "outlier",
    "outlying reading",
    lambda asked: scale_outlier(
        asked.case, asked.cell, asked.reduced.data, asked.system, asked.estimate
    ),
    beside_model=True,
)
