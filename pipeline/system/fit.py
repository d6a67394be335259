"""The joint springs of one campaign, with the noise that its data show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Ints
from pipeline.machine.cell import Cell
from pipeline.machine.effect import Noise
from pipeline.machine.effects import catalogue
from pipeline.machine.effects.nameless import nameless
from pipeline.machine.robot import Robot
from pipeline.machine.six import ROWS
from pipeline.reduction.bring import Reduced
from pipeline.reduction.case import Case
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Settings
from pipeline.system.assemble import TRACKED, assemble
from pipeline.system.contrasts import pure_error, repeated_zeros, stacked
from pipeline.system.estimate import identify
from pipeline.system.linearised import CurrentModel, Linearised, linearise
from pipeline.system.noise_shape import NoiseShape, goodness, shape
from pipeline.system.restricted import PaddedRows, maximum
from pipeline.system.system import Errors, Estimate, System
from pipeline.system.variance import UNDETERMINED, Components, noise, rescaled, resting_on
from pipeline.system.wander import unit_m

_SEED = 20261122
"""Seed of the random draws; another one changes results within their stated scatter."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """A campaign with its joint springs.

    Attributes:
        case: The campaign.
        reduced: Its measurements with the stated noise.
        plain: Its measurements with the size of the noise in use, all readings alike.
        data: `plain` with the shape of the noise, as it is used.
        system: c = B x with that noise.
        estimate: The estimate of x.
        noise: Noise found in addition to the stated one.
        shape: Tails and wander of the noise.
    """

    case: Case
    reduced: Reduced
    plain: Measured
    data: Measured
    system: System
    estimate: Estimate
    noise: Components
    shape: NoiseShape

    @property
    def excess(self) -> Components:
        """Noise in excess of the stated one, without counting tails as size."""
        return self.noise.beside(self.shape.family) if self.shape.tailed else self.noise

    @property
    def scatter(self) -> float:
        """Rms scatter of the readings over the stated one, tails and wander included [1]."""
        return self.shape.wide_m / unit_m(self.reduced.data)

    @property
    def used(self) -> float:
        """Noise of the tracker in use over the stated one [1]."""
        return float(self.noise.scale[0]) if self.noise.used and self.noise.replaced[0] else 1.0

    def as_noisy(self, data: Measured) -> Measured:
        """Measurements of the same campaign with the size of the noise in use."""
        return rescaled(data, self.noise) if self.noise.used else data

    def shaped(self, found: NoiseShape) -> Fitted:
        """The same campaign weighted with another shape of the noise."""
        near = self.estimate.value
        return _shaped(self.case, self.reduced, self.plain, self.noise, found, near)

    def standing(self, robot: Robot, moved: Callable[[Measured], Measured]) -> Fitted:
        """The same campaign with another table of its robot.

        Args:
            robot: The robot with the valid table.
            moved: Converts measurements to that robot.
        """
        case = replace(self.case, robot=robot)
        reduced = replace(self.reduced, data=moved(self.reduced.data))
        plain, data, near = moved(self.plain), moved(self.data), self.estimate.value
        return _weighed(case, reduced, plain, data, self.noise, self.shape, near)


def fit(case: Case, reduced: Reduced, taken: bool = False) -> Fitted:
    """Identify the joint springs, with the noise found where it contradicts the stated one.

    Args:
        case: The campaign.
        reduced: Its measurements.
        taken: As in `Components`.
    """
    data, start = reduced.data, case.robot.nominal_compliance
    if data.poses and not data.noise_stated:
        data = apart(case.settings, case.cell, reduced.placed, data, start)
    data = replace(data, bends=data.noise_stated)  # residuals alone do not say what is noise
    system, estimate = identify(case.cell, data, start)
    data = data.in_metres(system.found_m)
    found = noise(case.settings, case.cell, reduced.placed, data, system, estimate, taken)
    if found.used:
        data = replace(rescaled(data, found), bends=True)
        estimate = identify(case.cell, data, start)[1]
    if data.noise_stated:
        of = shape(beside_everything(case.cell, data, estimate.value))
    else:  # noise from residuals has the shape of the misfit
        of = NoiseShape.unseen(data)
    return _shaped(case, reduced, data, found, of, estimate.value)


def beside_everything(cell: Cell, data: Measured, values: Array) -> Linearised:
    """Linearise a campaign at its joint springs, all known and nameless effects as suspects."""
    known = (one for one in catalogue(cell.robot, data.pulls) if not isinstance(one, Noise))
    model = CurrentModel(replace(cell, equilibrium="undeformed"), values, len(values))
    return linearise(model, replace(data, bends=False), (*known, *nameless(cell.robot)))


def _shaped(
    case: Case, reduced: Reduced, plain: Measured, found: Components, of: NoiseShape, near: Array
) -> Fitted:
    return _weighed(case, reduced, plain, of.on(plain), found, of, near)


def _weighed(
    case: Case,
    reduced: Reduced,
    plain: Measured,
    data: Measured,
    found: Components,
    of: NoiseShape,
    near: Array,
) -> Fitted:
    """Joint springs of weighted measurements; the misfit is tested with the shape of the noise."""
    system, estimate = identify(case.cell, data, case.robot.nominal_compliance, near)
    if estimate.p_value is not None:
        alike = assemble(case.cell, of.alike(data), estimate.value)
        left = goodness(alike, of, np.random.default_rng(_SEED))
        estimate = replace(estimate, goodness=left)
    if found.used and not estimate.goodness.tails:  # the F test assumes normal noise
        estimate = resting_on(estimate, found)
    return Fitted(case, reduced, plain, data, system, estimate, found, of)


_TURNED = "turned"
"""Name of the sources `tracker` and `zero` where they act on a rotation."""

_FEWEST = 24
"""Minimum number of contrasts to resolve two noises: a dozen each, as one noise needs."""


def apart(
    settings: Settings, cell: Cell, placed: pd.DataFrame, data: Measured, start: Array
) -> Measured:
    """The measurements with rotations weighted by their own noise, relative to that of positions.

    Position s and rotation L w of a pose are six coordinates in metres (`machine.six`), read by one
    instrument with two noises. If both were weighted alike, springs that rest on the noisier kind
    would get too small an uncertainty. The ratio of the two is estimated by restricted likelihood,
    V = s_p^2 V_p + s_r^2 V_r + V_rest, from contrasts that no model of the robot can produce, or
    from the residuals of the joint springs where these are too few.

    Args:
        settings: Names of the measured targets.
        cell: The joint springs.
        placed: Table PLACED, for repeated zeros.
        data: Six coordinates of poses whose noise is not stated.
        start: First values of the compliances, shape (n,).
    """
    system, estimate = identify(cell, data, start)
    zeros = repeated_zeros(settings, placed)
    stack = stacked(system, estimate.residual, data, zeros, cell)
    pure = pure_error(system, estimate.residual, data, zeros, cell)
    contrasts = replace(pure, errors=_by_kind(stack.errors, pure.errors, stack.target))
    own = np.repeat(data.target, 3)
    residuals = replace(system, errors=_by_kind(system.errors, system.errors, own))
    for rows in (contrasts, residuals):
        ratio = _ratio(rows)
        if ratio is not None:
            variance = np.where(data.target == ROWS.index("rotation"), ratio**2, 1.0)
            idle = data.idle and data.idle.with_rotation(ratio)
            return replace(data.reweighed(variance, variance), idle=idle)
    return data


def _by_kind(seen: Errors, errors: Errors, kind: Ints) -> Errors:
    """Errors with separate sources for rotations, according to the row that each moves most."""
    row = np.asarray(abs(seen.G).argmax(axis=0)).ravel()
    turns = kind[row] == ROWS.index("rotation")
    mine = turns & np.isin(seen.source.astype(str), ("tracker", "zero"))
    return replace(errors, source=np.where(mine, _TURNED, errors.source))


def _ratio(system: System) -> float | None:
    """Noise of rotations over that of positions, None where the rows cannot resolve it."""
    if len(system.rows) - system.B.shape[1] < _FEWEST:
        return None
    columns = system.B * system.typical if system.B.shape[1] else system.B
    blocks = PaddedRows.of(system, columns, [TRACKED, (_TURNED,)])
    log_scale, std, _ = maximum(blocks, np.array([True, True]))
    return float(np.exp(log_scale[1] - log_scale[0])) if (std < UNDETERMINED).all() else None
