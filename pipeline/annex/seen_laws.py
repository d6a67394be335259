"""The law of each identified cause, and its estimate from every single pull."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline.annex import promises
from pipeline.base.arrays import Array
from pipeline.diagnosis.average import Hypothesis
from pipeline.machine.cell import load
from pipeline.machine.effect import Effect, Elastic, Loaded, Noise
from pipeline.machine.effects import unlisted
from pipeline.machine.robot.configuration import torque, velocity
from pipeline.reduction.measured import Measured

_OF = {
    "angle": ("angle", "rad"),
    "position": ("position", "m"),
    "torque": ("torque", "N m"),
    "force": ("load", "N"),
    "time": ("time", "s"),
}
"""Name and unit of the variable over which a law outside the catalogue is drawn."""

_LEVER = 0.05
"""Sensitivity of a pull's rows to a motion, over the median one, below which the pull is omitted
[1]."""


@dataclass(frozen=True)
class _Axis:
    """Name and unit of a variable."""

    name: str
    unit: str


@dataclass(frozen=True, eq=False)
class _Seen:
    """One motion or parameter y of a cause as a law of a variable x.

    Attributes:
        of: Name and unit of x.
        x: Variable at each pull, shape (m,).
        lies: Name and unit of y.
        law: y at each pull according to the law, shape (m,).
        by: Change of each row per unit of y [m], shape (M,).
    """

    of: _Axis
    x: Array
    lies: _Axis
    law: Array
    by: Array


def laws(found: Hypothesis, data: Measured) -> pd.DataFrame:
    """Table LAWS: partial residuals, pull by pull.

    A cause moves the rows of pull i by b_i y_i, where y_i is its law. Its estimate from this pull
    alone is

        y^_i = b_i'(r_i + b_i y_i) / b_i'b_i,    u(y^_i) = s / sqrt(b_i'b_i),

    with r the residuals of the complete model and s their standard deviation; everything else stays
    as identified (component-plus-residual, Larsen and McCleary, Technometrics 14, 1972).

    Args:
        found: Joint springs and causes.
        data: The measurements from which they were estimated.
    """
    found = replace(found, system=found.system.of_pulls)
    loaded = load(found.cell, data.pulls, found.estimate.value)
    parts = [
        _rows(effect, place, one, found, data)
        for effect, values, B in _effects(found)
        for place, one in enumerate(_seen(effect, values, B, loaded, found), 1)
    ]
    empty = pd.DataFrame(columns=promises.LAWS.names)
    return pd.concat(parts, ignore_index=True) if parts else empty


def _effects(found: Hypothesis) -> Iterator[tuple[Effect, Array, Array]]:
    """Each cause with the values of its parameters, shape (k,), and their columns of B, (M, k)."""
    first = found.cell.robot.n
    for effect in found.effects:
        mine = slice(first, first := first + len(effect.parameters))
        if not isinstance(effect, Noise):
            yield effect, found.estimate.value[mine], found.system.B[:, mine]


def _seen(
    effect: Effect, values: Array, B: Array, loaded: Loaded, found: Hypothesis
) -> Iterator[_Seen]:
    """The motions of an elastic cause, or the parameters of any other."""
    if isinstance(effect, Elastic):
        yield from _motions(effect, values, loaded, found)
        return
    of, x = _variable(effect, loaded)
    for k, parameter in enumerate(effect.parameters):
        unit = "" if parameter.unit == "1" else parameter.unit
        law = np.full(len(x), values[k])
        yield _Seen(of, x, _Axis(parameter.name, unit), law, B[:, k])


def _motions(effect: Elastic, values: Array, loaded: Loaded, found: Hypothesis) -> Iterator[_Seen]:
    """Motion of each virtual joint over the torque or force on it.

    A law outside the catalogue that is a variation of compliance has one virtual joint, which all
    its amplitudes move; its compliance is given over the variable of the law.
    """
    screws = effect.screws(loaded)
    tau = torque(screws, loaded.load_point, loaded.force)
    law = effect.response(loaded, tau) * values[list(effect.parameter_of)]
    moved = velocity(screws, loaded.points).transpose(0, 1, 3, 2)  # pull, target, xyz, joint
    read = found.cell.tool.coordinates(loaded.configuration, moved)
    rows = found.system.rows
    target = {name: k for k, name in enumerate(found.cell.tool.read)}
    which = np.array([target[name] for name in rows.target])
    turns = np.linalg.norm(screws[:, :, :3], axis=2).max(axis=0) > 0
    if effect.law is not None and effect.law.part in unlisted.YIELDING:
        of = _Axis(*_OF[effect.law.variable])
        by = read[rows.pull, which, rows.axis, 0] * tau[rows.pull, 0]
        own = law.sum(axis=1) / np.where(tau[:, 0] == 0, np.inf, tau[:, 0])
        lies = _Axis("compliance", effect.parameters[0].unit)
        yield _Seen(of, unlisted.variable(effect.law, loaded), lies, own, by)
        return
    for v in range(tau.shape[1]):
        of = _Axis("torque", "N m") if turns[v] else _Axis("force", "N")
        lies = _Axis("turn", "rad") if turns[v] else _Axis("shift", "m")
        yield _Seen(of, tau[:, v], lies, law[:, v], read[rows.pull, which, rows.axis, v])


def _variable(effect: Effect, loaded: Loaded) -> tuple[_Axis, Array]:
    """Variable of a cause that is not elastic: time for the instrument, otherwise the load."""
    time = loaded.pulls.time
    if effect.place == "metrology" and np.isfinite(time).all() and np.ptp(time) > 0:
        return _Axis("time", "s"), time
    return _Axis("load", "N"), np.linalg.norm(loaded.force, axis=1)


def _rows(
    effect: Effect, place: int, one: _Seen, found: Hypothesis, data: Measured
) -> pd.DataFrame:
    """Rows of LAWS for the pulls that a cause moves."""
    pull, m = found.system.rows.pull, len(data.pulls)
    square = np.bincount(pull, one.by**2, m)
    along = np.bincount(pull, one.by * found.estimate.residual, m)
    moved = square > _LEVER**2 * np.median(square[square > 0]) if square.any() else square > 0
    at = np.flatnonzero(moved)
    return pd.DataFrame(
        {
            "cause": effect.label,
            "part": place,
            "pose": data.pulls.pose[at],
            "repeat": data.pulls.repeat[at],
            "of": one.of.name,
            "x_unit": one.of.unit,
            "x": one.x[at],
            "is": one.lies.name,
            "y_unit": one.lies.unit,
            "y": one.law[at] + along[at] / square[at],
            "y_std": found.estimate.residual_std_m / np.sqrt(square[at]),
            "law": one.law[at],
        }
    )
