"""Covariances of an export that are stated in another frame or unit than they are read in.

The columns are read as along the axes of the tracker. Some software states them along the axes of
the base frame, some along the beam and across it; some in another unit, or variances for standard
uncertainties. The scatter in contrasts that no model of the robot can make (`contrasts.pure_error`)
follows the right statement: with L minus twice the restricted log likelihood, the scale s of all
covariances free, plus (ln s / ln 2)^2 as the prior of the scale, another statement has p = n exp((L
- L_0) / 2), with n the number of statements tried, since a likelihood ratio exceeds 1 / p with a
probability of at most p where the statement as read is right (Markov). It is named if the scatter
then also agrees with the stated one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import special

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Bools
from pipeline.faults.conventions import with_covariance
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake
from pipeline.machine import instrument
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.reduction.stations import moved_by
from pipeline.system import alarms
from pipeline.system.assemble import TRACKED
from pipeline.system.contrasts import pure_error
from pipeline.system.restricted import PaddedRows, lowest
from pipeline.system.scatter import TOLERATED_FACTOR
from pipeline.system.whiten import whitener

_FEWEST = 30
"""Minimum number of contrasts to judge covariances by."""

_ROUND = 0.1
"""Minimum range of the variances along the axes, over their mean [1]; below it no frame changes
much."""

_USUAL = 2.0
"""Factor of the scatter over the stated one that is one standard deviation of its logarithm [1], as
for `diagnosis.bounds.FAULTY`: a tracker that is twice as noisy as its certificate is usual."""

_ALIKE = 2.0
"""Maximum ratio of the scatter's normalised quantiles where a single factor is wrong for all
readings [1]: with tails of three degrees of freedom it is 1.3, with a tenth of the readings far off
any number."""


@dataclass(frozen=True)
class _Statement:
    """Another way to state covariances.

    Attributes:
        name: Kind of mistake.
        where: Which of that kind.
        said: Description of the uncertainties, as the end of a sentence.
        within: Maximum remaining ratio of the scatter to the stated one, or its inverse [1].
        means: Function of covariances (m, 3, 3) as read and points (m, 3), in the tracker's frame,
            that returns the covariances that are meant.
    """

    name: str
    where: str
    said: str
    within: float
    means: Callable[[Array, Array], Array]

    def correct(self, own: Bools, case: Case) -> Case:
        """The campaign with the intended covariances of some rows."""
        C = covariance.matrices(case.readings)
        C[own] = self.means(C[own], case.readings[list(XYZ)].to_numpy(float)[own])
        return replace(case, readings=with_covariance(case.readings, covariance.flat(C)))


def _frames(R: Array) -> list[_Statement]:
    """Statements along other axes; R from the tracker's frame to F_b."""
    kind, read = ("sign_or_convention", "covariance_frame"), "were read along the tracker's axes"
    return [
        _Statement(*kind, f"stated along the {along} and {read}", TOLERATED_FACTOR, means)
        for along, means in (
            ("base frame", lambda C, _: R.T @ C @ R),
            ("tracker's beam", _along_beam),
        )
    ]


def _units() -> list[_Statement]:
    """Statements in another unit, or as squares or roots of what is read."""
    kind = "unit_mixup", "covariance"
    out = []
    for power in (-6, -3, 3, 6):
        off = f"{10.0 ** abs(power):,.0f} times too {'small' if power > 0 else 'large'}"
        text = f"{off}, as where another unit of length is meant"
        out.append(_Statement(*kind, text, _USUAL, partial(_times, 10.0**power)))
    for unit, size_m in (("m", 1.0), ("mm", 1e-3)):
        roots = f"variances in {unit}^2 and were read as standard uncertainties in {unit}"
        squares = f"standard uncertainties in {unit} and were read as variances in {unit}^2"
        out.append(_Statement(*kind, roots, _USUAL, partial(_root, size_m)))
        out.append(_Statement(*kind, squares, _USUAL, partial(_square, size_m)))
    return out


def _as_stated(
    asked: Screening, own: Bools, tried: Iterable[_Statement]
) -> Iterator[tuple[_Scatter, _Statement]]:
    """Statements with which the readings scatter as stated, equally along all axes."""
    for one in tried:
        then = _scatter(replace(asked, case=one.correct(own, asked.case), known=None))
        if then is not None and then.alike and abs(np.log(then.scale)) < np.log(one.within):
            yield then, one


def misstated(asked: Screening) -> list[Mistake]:
    """The wrong statement of the covariances, if there is one."""
    case = asked.case
    own = (case.readings["covariance_from"] == "file").to_numpy()
    if not own.any() or case.settings.displacements is not None:
        return []
    seen = _scatter(asked)
    if seen is None:
        return []
    frames, units = _frames(asked.reduced.registration.R), _units()
    tried = frames if _elongated(case, own) else []
    if not (seen.usual or _loose(asked)):
        tried += [one for one in units if _near(one, case, own, seen.scale)]
    found = [*_as_stated(asked, own, tried)]
    if not found:
        return []
    then, best = min(found, key=lambda one: one[0].loss)
    if (plain := _uncorrelated(asked, own)) is not None:
        seen = min(seen, plain, key=lambda one: one.loss)
    p = len(frames + units) * float(np.exp(min(then.loss - seen.loss, 0.0) / 2))
    if p >= alarms.FRAME:
        return []
    return [
        Mistake(
            name=best.name,
            where=best.where,
            evidence=f"the uncertainties of the readings are {best.said}: the reflectors of the "
            f"effector scatter against each other {seen.scale:.3g} times as stated as given, "
            f"{then.scale:.2f} times with that corrected",
            correction="recomputed with the uncertainties that are meant",
            before=seen.scale,
            after=then.scale,
            unit="1",
            p_value=p,
            correct=partial(best.correct, own),
        )
    ]


def _uncorrelated(asked: Screening, own: Bools) -> _Scatter | None:
    """Scatter where the correlations are those of a beam, by its variances alone; else None.

    They are added where a file states none (`instrument.correlated`), and need not be there.
    """
    stations = asked.case.stations
    shot = moved_by(asked.case.readings, [one.back for one in stations])
    C, points = covariance.matrices(shot), shot[list(XYZ)].to_numpy(float)
    beams = instrument.correlated(points[own], np.einsum("mii->mi", C[own]))
    if beams is None:
        return None
    added = np.isclose(covariance.flat(C[own]), beams, 1e-6, 0.0).all(axis=1)
    C[np.flatnonzero(own)[added]] *= np.eye(3)
    alone = moved_by(with_covariance(shot, covariance.flat(C)), stations)
    return _scatter(replace(asked, case=replace(asked.case, readings=alone), known=None))


@dataclass(frozen=True)
class _Scatter:
    """Scatter of the contrasts under a statement.

    Attributes:
        loss: Minus twice the restricted log likelihood, plus the penalty by the prior of the scale.
        scale: Scatter over the stated one [1].
        alike: Whether all readings scatter by one factor more or less than stated.
    """

    loss: float
    scale: float
    alike: bool

    @property
    def usual(self) -> bool:
        """Whether the readings scatter about as stated."""
        return bool(abs(np.log(self.scale)) <= np.log(_USUAL))


def _loose(asked: Screening) -> bool:
    """Whether the readings scatter about as stated without those of one target."""
    case, rows = asked.case, asked.case.readings
    names = {*rows["target"]} & {*case.settings.measured}
    each = (rows[rows["target"] != name] for name in names if len(names) > 1)
    of = (replace(asked, case=replace(case, readings=one), known=None) for one in each)
    return any(one is not None and one.usual for one in map(_scatter, of))


def _scatter(asked: Screening) -> _Scatter | None:
    """Scatter of the campaign as it is stated; None with too few contrasts."""
    left = asked.estimate.residual
    pure = pure_error(asked.system, left, asked.reduced.data, asked.zeros, asked.cell)
    if len(pure.rows) < _FEWEST:
        return None
    blocks = PaddedRows.of(pure, pure.B, [TRACKED])
    t = lowest(blocks.of_scales(np.array([True])), np.array([blocks.rough]))
    w = np.abs(whitener(pure.errors, pure.rows.pose).by_pose(pure.c))
    part = np.array([0.1, 0.5, 0.9])
    sizes = np.quantile(w, part) / special.ndtri((1 + part) / 2)
    scale = float(np.exp(t[0]))
    prior = float(np.log(scale) / np.log(_USUAL)) ** 2
    return _Scatter(blocks.whole(t) + prior, scale, bool(sizes.max() < _ALIKE * sizes.min()))


def _near(one: _Statement, case: Case, own: Bools, scale: float) -> bool:
    """Whether the scatter would be about the stated one, judging by the size of the covariances."""
    before, after = (
        np.median(np.einsum("mii->m", covariance.matrices(made.readings)[own]))
        for made in (case, one.correct(own, case))
    )
    return bool(abs(np.log(scale) + 0.5 * np.log(before / after)) < 2 * np.log(one.within))


def _elongated(case: Case, own: Bools) -> bool:
    values = linear.directions(covariance.matrices(case.readings[own]))[0]
    return bool(np.median(np.ptp(values, axis=1) / values.mean(axis=1)) > _ROUND)


def _times(factor: float, C: Array, _: Array) -> Array:
    return factor**2 * C


def _root(unit_m: float, C: Array, _: Array) -> Array:
    """Intended covariance where C is the square of variances, in units of a length."""
    size, axes = linear.directions(C)
    root = np.sqrt(np.maximum(size, 0.0))
    return np.asarray(unit_m * (axes * root[:, None, :]) @ np.swapaxes(axes, 1, 2))


def _square(unit_m: float, C: Array, _: Array) -> Array:
    return C @ C / unit_m**2


def _along_beam(C: Array, points: Array) -> Array:
    """Covariances along the beam to each point, then across it level and upright."""
    along = linear.normed(points)
    level = linear.normed(np.cross([0.0, 0.0, 1.0], along))
    axes = np.stack([along, level, np.cross(along, level)], axis=2)
    return np.asarray(axes @ C @ np.swapaxes(axes, -1, -2))


FAULT = Fault("sign_or_convention", misstated, in_files=True)
