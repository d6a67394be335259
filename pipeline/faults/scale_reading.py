"""Readings of the scale that contradict all others, singly or by another zero in a group of them.

A pull's reading is freed in addition to the model and given all other pulls; its difference from
the log, in standard deviations, is the test statistic: the suspect of pull i is the whitened column
dc/df_i, u(f_i) = N_i^-1/2 [N]. The pull of the largest drop is flagged, and tested again at the
reading that fits best, because a reading of ten times the force spoils the estimate, and with it
every column and every standard deviation. If another pull then stands out as much, both are freed
together, and so on: two wrong readings mask each other while one of them stays (Hadi and Simonoff,
Procedures for the identification of multiple outliers in linear models, J. Am. Stat. Assoc. 88,
1993).

A scale that was not zeroed before a pose is one suspect more: the sum of the columns of the pulls
of that pose, or of all since it or up to it, which explains all of them by one number of newtons.
Groups may contain each other, and single readings that are wrong as well. Another gain since a pose
is none: a machine that warms up softens alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.quantities import plain, with_std
from pipeline.base.tails import chi2_beyond
from pipeline.faults.assignment import lines
from pipeline.faults.conventions import symbol
from pipeline.faults.exchanged_pulls import rows_of
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake, apart, lines_of, outlying, pulls_of, without_pulls
from pipeline.faults.typing_errors import GUESSES, WITHIN, factor, intended
from pipeline.machine.cell import Cell
from pipeline.machine.effect import HUNG, MOUNTED, PULLED
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

_SEVERAL = 2
"""Minimum number of pulls of which the scale had another zero."""

_ROUNDS = 8
"""Maximum number of iterations to the reading that fits best."""


@dataclass(frozen=True, eq=False)
class _Errors(Locked):
    """Errors of the scale in some pulls: a wrong reading, or another zero in several.

    Attributes:
        of: 1 in pulls that have it, else 0, shape (m, n).
        poses: Number of poses in which it is alike, shape (n,); 0 for a single reading.
    """

    of: Array
    poses: Ints

    @classmethod
    def among(cls, case: Case, data: Measured) -> _Errors:
        """Every reading; the zero in each pose, in all since it, and in all before it.

        A group has two pulls or more, and is not all of them.
        """
        pulls, row = data.pulls, case.loads["line"].to_numpy()[rows_of(case, data)]
        begun = np.array([row[pulls.pose == pose].min() for pose in pulls.pose])
        pulled, at = pulls.by == PULLED, np.unique(begun)[:, None]
        groups = np.concatenate([begun == at, begun >= at, begun < at]) & pulled
        groups = np.unique(groups, axis=0)[::-1]  # those of early poses first
        size = groups.sum(axis=1)
        groups = groups[(size >= _SEVERAL) & (size < pulled.sum())]
        poses = np.array([len(np.unique(pulls.pose[one])) for one in groups], dtype=np.int64)
        single = np.eye(len(row))
        none = np.zeros(len(row), dtype=np.int64)
        return cls(np.vstack([single, groups]).T, np.concatenate([none, poses]))

    @property
    def single(self) -> Bools:
        """Whether each is of one reading, shape (n,)."""
        return np.asarray(self.poses == 0)

    @property
    def there(self) -> Bools:
        """Whether a pull has it, shape (m, n)."""
        return np.asarray(self.of != 0)

    def only(self, which: Ints | Bools) -> _Errors:
        """Some of them."""
        return _Errors(self.of[:, which], self.poses[which])

    def beside(self, held: _Errors) -> Bools:
        """Those beside which every group has two pulls without a wrong reading, shape (n,).

        A reading is wrong once, and some pull has the usual zero.
        """
        wrong = np.any(held.there[:, held.single], axis=1)
        groups = held.there[:, ~held.single]
        few = (groups & ~wrong[:, None]).sum(axis=0) <= _SEVERAL
        taken = wrong | np.any(groups[:, few], axis=1)
        alone = ~(self.there & taken[:, None]).any(axis=0)
        enough = (self.there & ~wrong[:, None]).sum(axis=0) >= _SEVERAL
        usual = ~(self.there | np.any(groups, axis=1)[:, None]).all(axis=0)
        return np.asarray(np.where(self.single, alone, enough & usual))


def _in_proportion(read: Array, pulled: Bools) -> Array:
    """Error of each reading per newton of the mean reading of the pulls [1], shape (m,)."""
    return np.asarray(read / read[pulled].mean() if pulled.any() else read)


@dataclass(frozen=True, eq=False)
class _Righted(Locked):
    """The campaign with some readings of the scale replaced by those that fit best.

    Attributes:
        among: All errors that the scale may have, n.
        which: Those that are held, shape (k,).
        fits: Best fitting reading of the scale in each pull [N], shape (m,).
        off: Difference of the log from it [N], shape (m,).
        size: Size of each that is held [N], shape (k,).
        system: The linear system with these readings.
        base: The model's columns.
        freed: Every error freed in addition, one at a time.
        each: Displacement per newton more in the pull of each row [m/N], shape (M,).
        scatter: Scatter of the readings over the noise in use, from contrasts [1].
        scale: The scale as stated.
    """

    among: _Errors
    which: Ints
    fits: Array
    off: Array
    size: Array
    system: System
    base: Base
    freed: ScoreTests
    each: Array
    scatter: float
    scale: Scale

    @property
    def held(self) -> _Errors:
        """The errors that are held."""
        return self.among.only(self.which)

    @property
    def pulls(self) -> Ints:
        """A pull of each that is held, shape (k,)."""
        return np.asarray(np.argmax(self.held.there, axis=0))

    @property
    def normal(self) -> Array:
        """1 / u^2 of each that is held [1/N^2], shape (k,)."""
        return np.asarray(self.freed.N[self.which, 0, 0])

    @property
    def drop(self) -> Array:
        """Increase of the sum of squares with each as logged, shape (k,)."""
        return np.asarray(self.size**2 * self.normal)

    @property
    def std(self) -> Array:
        """Standard uncertainty of each size [N], shape (k,).

        A misfit beyond chance widens it: the model is not complete then.
        """
        rest, dof = self.base.rest, max(self.base.dof, 1)
        fits = self.system.noise_stated and chi2_beyond(rest, dof) >= odds.FITS
        return np.asarray(np.sqrt((1.0 if fits else rest / dof) / self.normal))

    @property
    def next(self) -> int:
        """What stands out most beside the held ones."""
        return int(np.argmax(self._others))

    @cached_property
    def _others(self) -> Array:
        return np.where(self.among.beside(self.held), self.drops(self.base), -1.0)

    @property
    def more(self) -> Ints:
        """The held ones and the next."""
        return np.sort(np.append(self.which, self.next))

    @property
    def matters(self) -> bool:
        """Whether each error exceeds the scale's uncertainty and a relevant size by far."""
        fits, held = self.fits, self.held
        off = np.abs(held.of * self.size)
        given = np.minimum(fits + np.abs(self.off), np.abs(fits - np.abs(self.off)))
        least = np.maximum(
            _MATTERS * np.minimum(fits, given), _STATED * reading_std(self.scale, fits)
        )
        return bool((off.sum(axis=0) >= least @ held.there).all())

    @property
    def alone(self) -> bool:
        """Whether nothing else stands out nearly as much as any of these."""
        return bool(self.drop.min() > _DOMINATES**2 * self._others.max())

    @property
    def clear(self) -> bool:
        """Whether nothing else stands out beyond scatter, nor could be one of these instead.

        The scatter is that of contrasts: what a law leaves in all pulls would hide the others.
        """
        most = self._others.max()
        chance = len(self._others) * chi2_beyond(most / self.scatter**2, 1) >= odds.FITS
        return bool(chance and self.drop.min() > most + odds.DECIDES)

    @cached_property
    def white(self) -> Whitener:
        """Whitener of the rows."""
        return whitener(self.system.errors, self.system.rows.pose)

    def rows(self, error: int) -> Bools:
        """Rows of the pulls of an error."""
        return np.asarray(self.among.there[self.system.rows.pull, error])

    def _free(self, rows: Bools) -> Array:
        """Whitened columns that free each of some rows."""
        at = np.flatnonzero(rows)
        columns = np.zeros((len(rows), len(at)))
        columns[at, np.arange(len(at))] = 1.0
        return self.white(columns)

    def logged(self, error: int, off: float) -> tuple[Array, Base]:
        """Whitened column of an error, and the base with its readings as logged."""
        column = self._columns[:, error]
        return column, self.base.against(self.base.blocks.rows(self.base.left) - off * column)

    @property
    def explained(self) -> bool:
        """Whether these errors are all that was wrong with their pulls."""
        for error, drop in zip(self.which, self.drop, strict=True):
            left = self.base.beside_all(self._free(self.rows(error)))
            if left.drop >= _LEFT * drop and _chance(left, self.system) < odds.FITS:
                return False
        return True

    @property
    def confirmed(self) -> bool:
        """Whether they would be found without the tracker's reading of any one target.

        Otherwise the tails of its noise in that reading may be all that is wrong.
        """
        target = self.system.rows.target
        for error, off in zip(self.which, self.size, strict=True):
            column, base = self.logged(int(error), float(off))
            mine = self.rows(error)
            names = set(target[mine])
            for one in names if len(names) > 1 else ():
                left = base.more(self._free(mine & (target == one))).beside_all(column[:, None])
                if left.drop < _CONFIRMS * off**2 * left.N[0, 0]:
                    return False
        return True

    @property
    def p(self) -> Array:
        """P-value of each as logged, with the model from the corrected readings, (k,)."""
        found = []
        for error, off, drop in zip(self.which, self.size, self.drop, strict=True):
            g = self.freed.N[..., 0] * off
            logged = replace(self.freed, g=g, rest=self.freed.rest + float(drop))
            found.append(_chance(logged, self.system)[error])
        return np.array(found)

    @property
    def proven(self) -> bool:
        """Whether they are beyond chance, and all that was wrong in more than one target."""
        return bool((self.p <= alarms.SCALE).all()) and self.explained and self.confirmed

    @cached_property
    def _columns(self) -> Array:
        """Whitened column of each error, shape (M, n)."""
        return self.white(self.each[:, None] * self.among.of[self.system.rows.pull])

    @cached_property
    def _laws(self) -> Array:
        """The same for the other law of the pulls of each group, and a zero of all, (M, n + 1)."""
        among, pull = self.among, self.system.rows.pull
        group = among.there & ~among.single
        pulled = np.asarray(group.any(axis=1))
        other = _in_proportion(self.fits, pulled)[:, None]
        return self.white(self.each[:, None] * np.column_stack([group * other, pulled])[pull])

    def drops(self, base: Base) -> Array:
        """Drop of the sum of squares by each error beside a base, shape (n,).

        -1 for a group where the other law of its pulls does nearly as much, as in a pose where the
        machine is softer, or a zero of all pulls.
        """
        both = self._columns, self._laws
        drop, law = (base.beside(one[None, ..., None]).of_block(0).drop for one in both)
        least = np.maximum(law[:-1], law[-1]) + odds.DECIDES
        return np.where(self.among.single | (drop >= least), drop, -1.0)

    @cached_property
    def exchanged(self) -> Ints:
        """The held ones, each exchanged for what explains the log better beside all others.

        One that the others make needless is left out.
        """
        off = self.white(self.each * self.off[self.system.rows.pull])
        logged = self.base.against(self.base.blocks.rows(self.base.left) - off)
        which = self.which
        for one in self.which:
            others = which[which != one]
            drop = self.drops(logged.more(self._columns[:, others]) if len(others) else logged)
            drop = np.where(self.among.beside(self.among.only(others)), drop, -1.0)
            best = int(np.argmax(drop))
            best = best if drop[best] >= drop[one] + odds.DECIDES else int(one)
            which = np.append(others, best) if drop[best] >= odds.DECIDES else others
        return np.sort(which)


def scale_outliers(asked: Screening) -> list[Mistake]:
    """The readings of the scale, and its zeros, that contradict all other pulls, if they are few.

    Those that dominate no other, though none stands out beyond chance, and two of a pose that are
    off by one factor, are `rivalled`: a cause not yet in the model does as much where it acts most.
    """
    data = asked.reduced.data
    if not _FEWEST <= len(data.pulls) <= _MOST:
        return []
    among = _Errors.among(asked.case, data)
    start = _righted(asked, among, _NONE)
    if start is None or _chance(start.freed, start.system)[start.next] > alarms.SCALE:
        return []
    starts = [start]
    if (among.poses > 1).any():  # several poses may look like all since one
        starts += filter(None, [_righted(asked, among.only(among.poses < 2), _NONE)])
    for one in starts:
        righted = _together(asked, one)
        if righted is not None and (found := _judged(asked, righted)):
            return found
    return []


_NONE: Ints = np.zeros(0, np.int64)
"""No error."""


def _together(asked: Screening, start: _Righted) -> _Righted | None:
    """The errors beside which nothing else stands out; None if there are none, or too many."""
    among, which, tried = start.among, start.more, set[tuple[int, ...]]()
    most = min(len(among.of) // _PART, _TOGETHER)
    righted: _Righted | None = None
    while 0 < len(which) <= most and tuple(which) not in tried:
        tried.add(tuple(which))
        before, righted = righted, _righted(asked, among, which)
        if righted is None and before is not None:  # exchanged for a zero that leaves no force
            which = before.more
        elif righted is None or not righted.matters:
            return None
        elif tuple(righted.exchanged) not in tried:  # two in each other's place are both wrong
            which = righted.exchanged
        elif righted.alone or righted.clear:
            return righted
        else:
            which = righted.more
    return None


def _judged(asked: Screening, righted: _Righted) -> list[Mistake]:
    """The errors as mistakes, if they are; `rivalled` where a cause may do as much.

    They must explain their pulls' misfit, and neither chance, a pose nor a law explain them. Two
    pulls share one factor too easily for a pose, and one law too easily for typing errors.
    """
    data = asked.reduced.data
    alike = _by_pose(data, righted)
    sure = alike < _MANY and righted.proven
    rivalled = alike > 0 or not righted.alone or bool(righted.held.poses.max() > 1)
    if not sure or (rivalled and _by_law(asked, righted)):
        return []
    each = zip(righted.which, righted.std, righted.p, strict=True)
    found = (_named(asked.case, data, righted, int(k), *map(float, rest)) for k, *rest in each)
    return [replace(one, rivalled=rivalled) for one in found]


def _by_law(asked: Screening, righted: _Righted) -> bool:
    """Whether the law of a cause, free in the pulls of such an error, explains it about as well.

    It must explain it better where no other pull stands out.

    With a the whitened column of the error, o its size [N], and z that of the law in these pulls
    alone, T = (z'P (y + o a))^2 / z'P z, with P and y as in `system.score_tests`.
    """
    laws = asked.laws
    if laws is None:
        return False
    own = laws.G[:, np.flatnonzero(~laws.common)].toarray()
    for k, off, drop in zip(righted.which, righted.size, righted.drop, strict=True):
        each = own[:, np.abs(own[righted.rows(int(k))]).max(axis=0, initial=0.0) > 0]
        logged = righted.logged(int(k), float(off))[1]
        found = logged.beside(righted.white(each)[None, :, :, None]).of_block(0)
        if (found.drop > drop - (0.0 if righted.clear else odds.DECIDES)).any():
            return True
    return False


def _by_pose(data: Measured, righted: _Righted) -> int:
    """Number of pulls of a pose that are all off by one factor, hence by the machine there; else 0.

    f_i = k r_i with readings r_i and best fits f_i of uncertainties u_i: chi2 of the best k, with
    one degree of freedom less than pulls. A factor beyond `_SOFT` is not the machine's.
    """
    pose, read, most = data.pulls.pose, np.linalg.norm(data.pulls.force, axis=1), 0
    single = righted.held.single
    pulls, normal = righted.pulls[single], righted.normal[single]
    for one in np.unique(pose[pulls]).tolist():
        mine = pose[pulls] == one
        if mine.sum() < max(2, int((pose == one).sum())):
            continue
        r, f, w = read[pulls[mine]], righted.fits[pulls[mine]], normal[mine]
        k = float((w * r) @ f / ((w * r) @ r))
        alike = chi2_beyond(w @ (f - k * r) ** 2, mine.sum() - 1) > _ALIKE
        if alike and 1 / _SOFT < k < _SOFT:
            most = max(most, int(mine.sum()))
    return most


def _righted(asked: Screening, among: _Errors, which: Ints) -> _Righted | None:
    """The campaign with the readings that fit best beside some errors; None if nothing fits."""
    data, scale = asked.reduced.data, asked.case.settings.scale or Scale()
    read = np.linalg.norm(data.pulls.force, axis=1)
    size = _fitting(asked, among.only(which), scale) if len(which) else np.zeros(0)
    if size is None:
        return None
    fits = read - among.of[:, which] @ size
    right = _reading(data, fits, scale) if len(which) else data
    system, estimate = asked.identified(right, asked.estimate.value)
    white = whitener(system.errors, system.rows.pose)
    base, freed = _freed(asked.cell, right, system, estimate, white, among.of)
    each, off = by_force(asked.cell, right, estimate.value), read - fits
    return _Righted(
        among, which, fits, off, size, system, base, freed, each, asked.spread[0], scale
    )


def _freed(
    cell: Cell,
    data: Measured,
    system: System,
    estimate: Estimate,
    white: Whitener,
    of: Array | None = None,
) -> tuple[Base, ScoreTests]:
    """The base of the model's columns, and every error freed in addition [1/N].

    `of` (m, n) is the error of each pull per newton; by default every reading is freed by itself.
    """
    of = np.eye(len(data.pulls)) if of is None else of
    columns = by_force(cell, data, estimate.value)[:, None] * of[system.rows.pull]
    base = Base.of(white(system.B) * system.typical, white(estimate.residual))
    return base, base.beside(white(columns)[None, ..., None]).of_block(0)


def _chance(freed: ScoreTests, system: System) -> Array:
    """P-value of each drop times their number; with a stated noise, the scatter is at least 1."""
    variance = freed.variance(1.0) if system.noise_stated else freed.variance()
    return np.asarray(freed.drop.size * freed.p(variance))


def _fitting(asked: Screening, held: _Errors, scale: Scale) -> Array | None:
    """Best fitting sizes of some errors of the scale [N], shape (k,).

    None if nothing fits. Gauss-Newton: the errors and the parameters x by c = B x + (dc/df) df,
    weighted. Downward steps of a single reading f are taken in 1/f: where ten times the force has
    made the springs ten times too stiff, the displacements of the pull are linear in that.
    """
    data, values = asked.reduced.data.in_metres(asked.system.found_m), asked.estimate.value
    read, count = np.linalg.norm(data.pulls.force, axis=1), held.poses.size
    sizes = np.zeros(count)
    for _ in range(_ROUNDS):
        force = read - held.of @ sizes
        if force.min() <= 0:
            return None
        now = _reading(data, force, scale)
        system = asked.widened(assemble(asked.cell, now, values))
        each = by_force(asked.cell, now, values)[:, None] * held.of[system.rows.pull]
        white = whitener(system.errors, system.rows.pose)
        size = force @ held.there / held.there.sum(axis=0)
        typical = np.array([*(p.typical for p in system.parameters), *size])
        A = white(np.column_stack([system.B, each]))
        start = np.append(values, np.zeros(count))
        found = least_squares(A, white(system.c), typical, start)[0]
        values, step = found[:-count], found[-count:]
        if not np.isfinite(step).all():
            return None
        down = (step < 0) & held.single
        step = np.where(down, size**2 / (size - np.minimum(step, 0.0)) - size, step)
        sizes = sizes - step
        if (np.abs(step) < 1e-6 * size).all():
            break
    return sizes if (held.of @ sizes < read).all() else None


def _reading(data: Measured, force: Array, scale: Scale) -> Measured:
    """The measurements with other readings of the scale in some pulls; all of them given [N]."""
    read, std = np.linalg.norm(data.pulls.force, axis=1), data.reading_std.copy()
    forces = data.pulls.force * (force / read)[:, None]
    std[force != read] = reading_std(scale, force[force != read])
    return replace(data, pulls=replace(data.pulls, force=forces), reading_std=std)


def _named(case: Case, data: Measured, righted: _Righted, k: int, std: float, p: float) -> Mistake:
    """The mistake of one of the errors, the k-th of all."""
    pulls, one = np.flatnonzero(righted.among.of[:, k]), righted.among.only(np.array([k]))
    if one.single[0]:
        return _finding(case, data, righted, int(pulls[0]), std, p)
    loads = case.loads.iloc[rows_of(case, data)[pulls]].sort_values("line")
    off = float(righted.size[righted.which == k][0])
    at, poses = lines_of(loads), np.unique(data.pulls.pose[pulls])
    where, which = f"pose{poses[0]:02d}", f"the {len(at)} forces of pose {poses[0]} ({lines(at)})"
    if len(poses) > 1:
        where += f"-pose{poses[-1]:02d}"
        which = f"the {len(at)} forces of poses {poses[0]} to {poses[-1]} ({lines(at)})"
    return outlying(
        f"{loads['file'].iloc[0]} {where}",
        _told(which, off, std),
        "recomputed without these pulls",
        before=abs(off) / std,
        size=float(abs(off)),
        size_unit="N",
        p_value=p,
        axes=1,
        correct=partial(without_pulls, pulls=pulls_of(loads)),
        at=at,
    )


def _told(which: str, off: float, std: float) -> str:
    """By how many newtons the forces of a group are too large or too small, in words."""
    size, within = plain(abs(off), 3), plain(std, 2)
    by = f"are {size} N ± {within} N too large"
    by = by if off > 0 else f"are {size} N ± {within} N too small"
    return f"{which} {by}, all alike, {apart(abs(off) / std)}: the scale was not zeroed there"


def _finding(
    case: Case, data: Measured, righted: _Righted, pull: int, std: float, p: float
) -> Mistake:
    given, fits = float(np.linalg.norm(data.pulls.force[pull])), float(righted.fits[pull])
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
    meant = _another(case, data, righted.pulls[righted.held.single], fits, std)
    meant = meant or _meant(shown, agreed, within, as_shown, units)
    return outlying(
        where,
        f"the reading {where} (line {row['line']}) says {text}{shown:.6g} {as_shown}, and "
        f"all other pulls agree with {with_std(agreed, within)} {as_shown}, "
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
    if found is None:
        return ""
    text = f"; {found[1]}, {found[0]:.6g} {unit} may have been meant"
    times = factor(given, fits, std) if found[1] in GUESSES else None
    if times is None:
        return text
    return f"{text}, but {plain(given / times, 4)} {unit} times {times:.1f} agrees as well"


FAULT = Fault("outlier", scale_outliers)
