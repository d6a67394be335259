"""Readings of the scale that contradict all others: a digit too many, two lines exchanged.

A pull's reading is freed in addition to the model and given all other pulls; its difference from
the log, in standard deviations, is the test statistic: the suspect of pull i is the whitened column
dc/df_i, u(f_i) = N_i^-1/2 [N]. The pull of the largest drop is flagged, and tested again at the
reading that fits best, because a reading of ten times the force spoils the estimate, and with it
every column and every standard deviation. If another pull then stands out as much, both are freed
together, and so on: two wrong readings mask each other while one of them stays (Hadi and Simonoff,
Procedures for the identification of multiple outliers in linear models, J. Am. Stat. Assoc. 88,
1993).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.tails import chi2_beyond
from pipeline.faults.conventions import symbol
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake, outlying, without_pulls
from pipeline.faults.typing_errors import WITHIN, intended
from pipeline.machine.cell import Cell
from pipeline.machine.effect import HUNG, MOUNTED
from pipeline.readers.logs import FORCE, SCALE
from pipeline.reduction.case import Case
from pipeline.reduction.forces import reading_std
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Scale
from pipeline.system import alarms, odds
from pipeline.system.assemble import assemble, by_force
from pipeline.system.estimate import least_squares
from pipeline.system.score_tests import Base, ScoreTests
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import Whitener, whitener

_MATTERS = 0.03
"""Minimum error of a mistyped reading as a fraction of the force [1]."""

_STATED = 6.0
"""Minimum error of a mistyped reading in stated standard uncertainties of the scale [1]."""

_FEWEST, _MOST = 8, 1000
"""Minimum and maximum number of pulls: fewer do not single one out; more are not measured by hand,
and each adds a column."""

_PART, _TOGETHER = 4, 12
"""At most one reading in `_PART`, and `_TOGETHER` in all, are taken to be wrong."""

_DOMINATES = 4.0
"""Minimum ratio of the deviation of mistyped readings to that of any other reading after
correction [1]: a force law or a joint affects many pulls."""

_LEFT = 0.1
"""Maximum fraction of a pull's contradiction that may remain after correction [1]; other faults
leave more."""

_CONFIRMS = 0.25
"""Minimum fraction of the expected drop that a wrong reading causes without any one target [1]."""

_SOFT = 2.0
"""Maximum ratio of a pose's stiffness to the expected one, or its inverse, that a machine can
cause [1]."""

_MANY = 3
"""Minimum number of pulls of a pose that are not all mistyped by one factor [1]."""

_ALIKE = 1e-3
"""P-value above which the pulls of a pose are taken to be off by one common factor [1]."""

_ROUNDS = 8
"""Maximum number of iterations to the reading that fits best."""


@dataclass(frozen=True, eq=False)
class _Righted(Locked):
    """The campaign with some readings of the scale replaced by those that fit best.

    Attributes:
        pulls: Indices of the pulls, shape (m,).
        fits: Best fitting reading of the scale in each [N], shape (m,).
        off: Difference of the log from it [N], shape (m,).
        system: The linear system with these readings.
        base: The model's columns.
        freed: Every pull's reading freed in addition, one at a time.
        each: Displacement per newton more in the pull of each row [m/N], shape (M,).
        scatter: Scatter of the readings over the noise in use, from contrasts [1].
    """

    pulls: Ints
    fits: Array
    off: Array
    system: System
    base: Base
    freed: ScoreTests
    each: Array
    scatter: float

    @property
    def normal(self) -> Array:
        """1 / u(f)^2 of each of the pulls [1/N^2], shape (m,)."""
        return np.asarray(self.freed.N[self.pulls, 0, 0])

    @property
    def drop(self) -> Array:
        """Increase of the sum of squares with the reading as logged, shape (m,)."""
        return np.asarray(self.off**2 * self.normal)

    @property
    def std(self) -> Array:
        """Standard uncertainty of each best fitting reading [N], shape (m,).

        A misfit beyond chance widens it: the model is not complete then.
        """
        rest, dof = self.base.rest, max(self.base.dof, 1)
        fits = self.system.noise_stated and chi2_beyond(rest, dof) >= odds.FITS
        return np.asarray(np.sqrt((1.0 if fits else rest / dof) / self.normal))

    @property
    def next(self) -> int:
        """The pull that stands out most among the others."""
        return int(np.argmax(self._others))

    @property
    def _others(self) -> Array:
        others = self.freed.drop.copy()
        others[self.pulls] = -1.0
        return others

    @property
    def alone(self) -> bool:
        """Whether no other pull stands out nearly as much as any of these."""
        return bool(self.drop.min() > _DOMINATES**2 * self._others.max())

    @property
    def clear(self) -> bool:
        """Whether no other pull stands out beyond scatter, nor could be one of these instead.

        The scatter is that of contrasts: what a law leaves in all pulls would hide the others.
        """
        most = self._others.max()
        chance = len(self._others) * chi2_beyond(most / self.scatter**2, 1) >= odds.FITS
        return bool(chance and self.drop.min() > most + odds.DECIDES)

    @cached_property
    def white(self) -> Whitener:
        """Whitener of the rows."""
        return whitener(self.system.errors, self.system.rows.pose)

    def _free(self, rows: Bools) -> Array:
        """Whitened columns that free each of some rows."""
        at = np.flatnonzero(rows)
        columns = np.zeros((len(rows), len(at)))
        columns[at, np.arange(len(at))] = 1.0
        return self.white(columns)

    def logged(self, pull: int, off: float) -> tuple[Array, Base]:
        """Whitened column of a pull's reading, and the base with that reading as logged."""
        column = self.white(self.each * (self.system.rows.pull == pull))
        return column, self.base.against(self.base.blocks.rows(self.base.left) - off * column)

    @property
    def explained(self) -> bool:
        """Whether these readings are all that was wrong with their pulls."""
        for pull, drop in zip(self.pulls, self.drop, strict=True):
            left = self.base.beside_all(self._free(self.system.rows.pull == pull))
            if left.drop >= _LEFT * drop and _chance(left, self.system) < odds.FITS:
                return False
        return True

    @property
    def confirmed(self) -> bool:
        """Whether they would be found without the tracker's reading of any one target.

        Otherwise the tails of its noise in that reading may be all that is wrong.
        """
        target = self.system.rows.target
        for pull, off in zip(self.pulls, self.off, strict=True):
            column, base = self.logged(int(pull), float(off))
            mine = self.system.rows.pull == pull
            names = set(target[mine])
            for one in names if len(names) > 1 else ():
                left = base.more(self._free(mine & (target == one))).beside_all(column[:, None])
                if left.drop < _CONFIRMS * off**2 * left.N[0, 0]:
                    return False
        return True

    @property
    def p(self) -> Array:
        """P-value of each reading as logged, with the model from the corrected readings, (m,)."""
        found = []
        for pull, off, drop in zip(self.pulls, self.off, self.drop, strict=True):
            g = self.freed.N[..., 0] * off
            logged = replace(self.freed, g=g, rest=self.freed.rest + float(drop))
            found.append(_chance(logged, self.system)[pull])
        return np.array(found)


def scale_outliers(asked: Screening) -> list[Mistake]:
    """The readings of the scale that contradict all other pulls, if they are few.

    Those that dominate no other, though none stands out beyond chance, and two of a pose that are
    off by one factor, are `rivalled`: a cause not yet in the model does as much where it acts most.
    """
    data, system, estimate = asked.reduced.data, asked.system, asked.estimate
    count = len(data.pulls)
    if not _FEWEST <= count <= _MOST:
        return []
    white = whitener(system.errors, system.rows.pose)
    freed = _freed(asked.cell, data, system, estimate, white)[1]
    best = int(np.argmax(freed.drop))
    if _chance(freed, system)[best] > alarms.SCALE:
        return []
    scale = asked.case.settings.scale or Scale()
    which = [best]
    for _ in range(min(count // _PART, _TOGETHER)):
        righted = _righted(asked, np.array(which), scale)
        if righted is None or not _matters(righted, scale):
            return []
        if righted.alone or righted.clear:
            return _judged(asked, righted)
        which.append(righted.next)
    return []


def _judged(asked: Screening, righted: _Righted) -> list[Mistake]:
    """The readings as mistakes, if they are; `rivalled` where a cause may do as much.

    They must explain their pulls' misfit, and neither chance, a pose nor a law explain them. Two
    pulls share one factor too easily for a pose, and one law too easily for typing errors.
    """
    data = asked.reduced.data
    unlikely, alike = bool((righted.p <= alarms.SCALE).all()), _by_pose(data, righted)
    sure = unlikely and righted.explained and righted.confirmed and alike < _MANY
    rivalled = alike > 0 or not righted.alone
    if not sure or (rivalled and _by_law(asked, righted)):
        return []
    each = zip(righted.pulls, righted.fits, righted.std, righted.p, strict=True)
    known = asked.case, data, righted.pulls
    found = (_finding(*known, int(pull), *map(float, rest)) for pull, *rest in each)
    return [replace(one, rivalled=rivalled) for one in found]


def _by_law(asked: Screening, righted: _Righted) -> bool:
    """Whether the law of a cause, free in the pull of such a reading, explains it about as well.

    With a the whitened column of the reading, o its error [N], and z that of the law in this pull
    alone, T = (z'P (y + o a))^2 / z'P z, with P and y as in `system.score_tests`.
    """
    laws = asked.laws
    if laws is None:
        return False
    pull = righted.system.rows.pull
    own = laws.G[:, np.flatnonzero(~laws.common)].toarray()
    for k, off, drop in zip(righted.pulls, righted.off, righted.drop, strict=True):
        each = own[:, np.abs(own[pull == k]).max(axis=0, initial=0.0) > 0]
        logged = righted.logged(int(k), float(off))[1]
        found = logged.beside(righted.white(each)[None, :, :, None]).of_block(0)
        if (found.drop > drop - odds.DECIDES).any():
            return True
    return False


def _matters(righted: _Righted, scale: Scale) -> bool:
    """Whether each reading's error exceeds the scale's uncertainty and a relevant size by far."""
    fits, off = righted.fits, np.abs(righted.off)
    given = np.minimum(fits + off, np.abs(fits - off))
    least = np.maximum(_MATTERS * np.minimum(fits, given), _STATED * reading_std(scale, fits))
    return bool((off >= least).all())


def _by_pose(data: Measured, righted: _Righted) -> int:
    """Number of pulls of a pose that are all off by one factor, hence by the machine there; else 0.

    f_i = k r_i with readings r_i and best fits f_i of uncertainties u_i: chi2 of the best k, with
    one degree of freedom less than pulls. A factor beyond `_SOFT` is not the machine's.
    """
    pose, read, most = data.pulls.pose, np.linalg.norm(data.pulls.force, axis=1), 0
    for one in np.unique(pose[righted.pulls]).tolist():
        mine = pose[righted.pulls] == one
        if mine.sum() < max(2, int((pose == one).sum())):
            continue
        r, f, w = read[righted.pulls[mine]], righted.fits[mine], righted.normal[mine]
        k = float((w * r) @ f / ((w * r) @ r))
        alike = chi2_beyond(w @ (f - k * r) ** 2, mine.sum() - 1) > _ALIKE
        if alike and 1 / _SOFT < k < _SOFT:
            most = max(most, int(mine.sum()))
    return most


def _righted(asked: Screening, pulls: Ints, scale: Scale) -> _Righted | None:
    """The campaign with some pulls at the readings that fit best; None if nothing fits."""
    data = asked.reduced.data
    fits = _fitting(asked, pulls, scale)
    if fits is None:
        return None
    right = _reading(data, pulls, fits, scale)
    system, estimate = asked.identified(right, asked.estimate.value)
    white = whitener(system.errors, system.rows.pose)
    base, freed = _freed(asked.cell, right, system, estimate, white)
    off = np.linalg.norm(data.pulls.force[pulls], axis=1) - fits
    each = by_force(asked.cell, right, estimate.value)
    return _Righted(pulls, fits, off, system, base, freed, each, asked.spread[0])


def _freed(
    cell: Cell, data: Measured, system: System, estimate: Estimate, white: Whitener
) -> tuple[Base, ScoreTests]:
    """The base of the model's columns, and every pull's reading freed in addition [1/N]."""
    columns = np.zeros((len(system.rows), len(data.pulls)))
    columns[np.arange(len(columns)), system.rows.pull] = by_force(cell, data, estimate.value)
    typical = system.typical
    base = Base.of(white(system.B) * typical, white(estimate.residual))
    return base, base.beside(white(columns)[None, ..., None]).of_block(0)


def _chance(freed: ScoreTests, system: System) -> Array:
    """P-value of each drop times their number; with a stated noise, the scatter is at least 1."""
    variance = freed.variance(1.0) if system.noise_stated else freed.variance()
    return np.asarray(freed.drop.size * freed.p(variance))


def _fitting(asked: Screening, pulls: Ints, scale: Scale) -> Array | None:
    """Best fitting readings of the scale in some pulls, all others unchanged [N], shape (m,).

    None if nothing fits. Gauss-Newton: the forces f of the pulls and the parameters x by c = B
    x + (dc/df) df, weighted. Downward steps are taken in 1/force: where ten times the force has
    made the springs ten times too stiff, the displacements of the pull are linear in that.
    """
    data, values = asked.reduced.data.in_metres(asked.system.found_m), asked.estimate.value
    force = np.linalg.norm(data.pulls.force[pulls], axis=1)
    for _ in range(_ROUNDS):
        now = _reading(data, pulls, force, scale)
        system = asked.widened(assemble(asked.cell, now, values))
        here = system.rows.pull[:, None] == pulls
        each = by_force(asked.cell, now, values)[:, None] * here
        white = whitener(system.errors, system.rows.pose)
        typical = np.array([*(p.typical for p in system.parameters), *force])
        A = white(np.column_stack([system.B, each]))
        start = np.append(values, np.zeros(len(pulls)))
        found = least_squares(A, white(system.c), typical, start)[0]
        values, step = found[: -len(pulls)], found[-len(pulls) :]
        if not np.isfinite(step).all():
            return None
        force = np.where(step > 0, force + step, force**2 / (force - np.minimum(step, 0.0)))
        if (np.abs(step) < 1e-6 * force).all():
            break
    return force


def _reading(data: Measured, pulls: Ints, force: Array, scale: Scale) -> Measured:
    """The measurements with other readings of the scale in some pulls [N]."""
    forces, std = data.pulls.force.copy(), data.reading_std.copy()
    forces[pulls] *= (force / np.linalg.norm(forces[pulls], axis=1))[:, None]
    std[pulls] = reading_std(scale, force)
    return replace(data, pulls=replace(data.pulls, force=forces), reading_std=std)


def _finding(
    case: Case, data: Measured, wrong: Ints, pull: int, fits: float, std: float, p: float
) -> Mistake:
    given = float(np.linalg.norm(data.pulls.force[pull]))
    pose, repeat = int(data.pulls.pose[pull]), int(data.pulls.repeat[pull])
    row = _row(case, data, pull)
    where, at = f"{row['file']} pose{pose:02d} rep{repeat}", (f"{row['file']}:{row['line']}",)
    sigmas = abs(given - fits) / std
    hung = data.pulls.by[pull] == HUNG
    one, unit = (case.settings.gravity.m_s2, "kg") if hung else (1.0, "N")
    units = dict[str, float]()
    shown, agreed, within, as_shown = given / one, fits / one, std / one, unit
    if not hung:
        log = case.settings.loads_log
        shown, agreed = (log.gain * force + log.zero_n for force in (given, fits))
        per, as_shown = _unit(float(row["unit_n"]))
        shown, agreed, within = shown / per, agreed / per, log.gain * std / per
        units = {symbol(name): size / per for name, size in FORCE.items() if size != per}
    text = f"{row['payload']}, " if data.pulls.by[pull] == MOUNTED else ""
    meant = _another(case, data, wrong, fits, std)
    meant = meant or _meant(shown, agreed, within, as_shown, units)
    return outlying(
        where,
        f"the reading {where} (line {row['line']}) says {text}{shown:.6g} {as_shown}, and "
        f"all other pulls agree with {agreed:.6g} +- {within:.2g} {as_shown}, "
        f"{sigmas:.0f} standard deviations away{meant}",
        "recomputed without this pull",
        before=sigmas,
        size=abs(given - fits) / one,
        size_unit=unit,
        p_value=p,
        axes=1,
        correct=partial(without_pulls, pulls={(pose, repeat)}),
        at=at,
    )


def _unit(size_n: float) -> tuple[float, str]:
    """The unit of a log [N] and its symbol; N if it is none that a scale shows."""
    known = (one for one, size in SCALE.items() if np.isclose(size, size_n, rtol=1e-9))
    name = next(known, None)
    return (size_n, symbol(name)) if name else (1.0, "N")


def _row(case: Case, data: Measured, pull: int) -> pd.Series[Any]:
    """The row of the log of a pull."""
    at = data.pulls.pose[pull], data.pulls.repeat[pull]
    return case.loads[(case.loads["pose"] == at[0]) & (case.loads["repeat"] == at[1])].iloc[0]


def _another(case: Case, data: Measured, wrong: Ints, fits: float, std: float) -> str:
    """Another wrong row with the number that fits, in words, as of two in each other's place."""
    off = np.abs(np.linalg.norm(data.pulls.force[wrong], axis=1) - fits)
    if off.min() > WITHIN * std:
        return ""
    line = _row(case, data, int(wrong[np.argmin(off)]))["line"]
    return f"; the number of line {line} may have been meant"


def _meant(given: float, fits: float, std: float, unit: str, units: Mapping[str, float]) -> str:
    """The number that was probably meant, in words; `units` as of `intended`."""
    found = intended(given, fits, std, units)
    return "" if found is None else f"; {found[1]}, {found[0]:.6g} {unit} may have been meant"


FAULT = Fault("outlier", scale_outliers)
