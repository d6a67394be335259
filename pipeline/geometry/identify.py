"""One estimate of table, tool, frames, springs and laws, linearised where the robot stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.geometry import curves as curve
from pipeline.geometry.estimate import (
    HELD,
    Prior,
    Rows,
    Solution,
    again,
    larger,
    padded,
    prior,
    rougher,
    rows,
    solved,
)
from pipeline.geometry.laws import Law
from pipeline.geometry.mechanism import Linear, Mechanism, Weights, layout, linearised
from pipeline.geometry.readings import Readings
from pipeline.geometry.scatter import Scatter

_ROUNDS = 3
"""Linearisations; tables are off by some milliradians, so that two leave nanometres."""

_STEPS = 4
"""Steps of scatter and sizes between two linearisations."""

_SIZE = {True: 1e-4, False: 2e-4}
"""Of a curve before any data: sliding [m], turning [rad]."""


@dataclass(frozen=True)
class Wanted:
    """What is estimated beside tool and frames.

    Attributes:
        table: Letters of the table.
        springs: Compliances under the arm's weight.
        laws: Laws of joints.
        curves: Joints with a curve of their own, from 0, and its length.
    """

    table: bool = True
    springs: bool = True
    laws: tuple[Law, ...] = ()
    curves: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Identified(Locked):
    """A mechanism with all that it was estimated from.

    Attributes:
        mechanism: The estimate.
        readings: What it is of.
        weights: What pulled at the arm.
        known: Priors, with their scales as found.
        scatter: What no model holds.
        linear: The readings about the estimate.
        rows: The same, whitened.
        solution: The parameters with their covariance.
        wanted: What was estimated.
    """

    mechanism: Mechanism
    readings: Readings
    weights: Weights
    known: Prior
    scatter: Scatter
    linear: Linear
    rows: Rows
    solution: Solution
    wanted: Wanted

    @property
    def left(self) -> Array:
        """Readings minus mechanism [m], [rad], shape (m, 6 t), F_b."""
        e = self.rows.y - self.rows.along(self.solution.x)
        return linear.solve(self.rows.W, e)


def identify(
    begun: Mechanism,
    readings: Readings,
    weights: Weights,
    wanted: Wanted,
    scatter: Scatter,
    stated: tuple[float, float] = (np.nan, np.nan),
    known: Prior | None = None,
) -> Identified:
    """Estimate a mechanism.

    Args:
        begun: Where to begin; its laws and curves are those of `wanted` from then on.
        readings: What it is to explain.
        weights: What pulled at the arm.
        wanted: What is estimated.
        scatter: What no model holds, to begin with.
        stated: Roughness of lengths [m] and angles [rad] as the robot file states it.
        known: Priors of an earlier estimate, to begin with.
    """
    mechanism = _equipped(begun, readings, wanted)
    usual = prior(mechanism, stated, weights.payloads)
    known = _only(_scaled(usual, mechanism, known), mechanism, wanted)
    for _ in range(_ROUNDS):
        here = linearised(readings, mechanism, weights)
        for _ in range(_STEPS):
            whitened = rows(here, mechanism, scatter)
            found = solved(whitened, mechanism, known)
            scatter = again(whitened, here, found, scatter)
            known = _only(rougher(known, found), mechanism, wanted)
            mechanism = larger(mechanism, found)
        mechanism = mechanism.moved(found.x, layout(mechanism))
    here = linearised(readings, mechanism, weights)
    whitened = rows(here, mechanism, scatter)
    found = solved(whitened, mechanism, known)
    mechanism = mechanism.moved(found.x, layout(mechanism))
    return Identified(mechanism, readings, weights, known, scatter, here, whitened, found, wanted)


def _scaled(new: Prior, mechanism: Mechanism, earlier: Prior | None) -> Prior:
    """Priors of a mechanism with the scales of an earlier estimate."""
    if earlier is None:
        return new
    std = new.std.copy()
    std[layout(mechanism).letters] = earlier.std[: len(new.turns)]
    return replace(new, std=std, free=earlier.free)


def _only(known: Prior, mechanism: Mechanism, wanted: Wanted) -> Prior:
    """The prior with everything held that is not to be estimated."""
    where = layout(mechanism)
    std, mean = known.std.copy(), known.mean.copy()
    if not wanted.table:
        std[where.letters] = HELD
    if not wanted.springs:
        std[where.compliance], mean[where.compliance] = HELD, 0.0
    return replace(known, std=std, mean=mean)


def _equipped(begun: Mechanism, readings: Readings, wanted: Wanted) -> Mechanism:
    """A mechanism with the laws and curves that are wanted, at zero where they are new."""
    slides = begun.table.prismatic
    fresh = tuple(
        curve.over(j, readings.q[:, j], bool(slides[j]), length, _SIZE[bool(slides[j])])
        for j, length in wanted.curves
    )
    amplitudes = np.zeros(sum(law.amplitudes for law in wanted.laws))
    if begun.laws == wanted.laws[: len(begun.laws)]:
        amplitudes = padded(begun.amplitudes, len(amplitudes))
    return replace(
        begun,
        laws=wanted.laws,
        amplitudes=amplitudes,
        curves=fresh,
        knots=np.zeros(sum(one.count for one in fresh)),
    )


def likeliest_length(found: Identified, joints: Sequence[int], lengths: Sequence[float]) -> float:
    """The length of the curves of some joints under which the readings are likeliest.

    The scatter and all sizes are estimated anew for each length, about the same linearisation.
    """
    best, length_of = -np.inf, lengths[0]
    known, scatter = found.known, found.scatter
    for length in lengths:
        wanted = tuple((j, length) for j in joints)
        mechanism = _equipped(found.mechanism, found.readings, Wanted(curves=wanted))
        mechanism = replace(
            mechanism, laws=found.mechanism.laws, amplitudes=found.mechanism.amplitudes
        )
        for _ in range(_STEPS):
            whitened = rows(found.linear, mechanism, scatter)
            solution = solved(whitened, mechanism, known)
            scatter = again(whitened, found.linear, solution, scatter)
            mechanism = larger(mechanism, solution)
        whitened = rows(found.linear, mechanism, scatter)
        solution = solved(whitened, mechanism, known)
        evidence = solution.evidence + float(linear.log_det(whitened.W).sum())
        if evidence < best:
            break
        best, length_of = evidence, length
    return length_of
