"""Minimise one smooth function from many starts at once, inside a box.

Projected BFGS. In every round each active start tries one point, and all of these are evaluated
together; each start keeps its own inverse Hessian, step length and termination.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Bools, Ints

Function = Callable[[Array], tuple[Array, Array]]
"""From points (k, d): values (k,) and gradients (k, d). A value may be NaN or infinite."""

_FIRST_STEP, _LONGEST_STEP = 0.05, 0.3
"""Largest move of any coordinate of the unit box, before and after the curvature is known [1]."""
_SHRINK, _SHORTEST = 0.35, 1e-5
"""Factor on a rejected step, and the length at which the direction is given up [1]."""


@dataclass(frozen=True, eq=False)
class _Found:
    """End points of the starts.

    Attributes:
        x: Shape (k, d).
        value: Shape (k,), in the order of the starts.
    """

    x: Array
    value: Array


@dataclass(eq=False)
class _State:
    """Active starts; rows are overwritten as they move.

    Attributes:
        x: Current point of each start, shape (k, d).
        value: Shape (k,).
        slope: Gradient, shape (k, d).
        way: Search direction, shape (k, d).
        length: Fraction of `way` that is tried next, shape (k,).
        free: Coordinates that are not held by the box, shape (k, d).
        H: Inverse Hessians, shape (k, d, d).
        fresh: Whether H is still the identity, shape (k,).
        stalled: Number of consecutive steps without gain, shape (k,).
    """

    x: Array
    value: Array
    slope: Array
    way: Array
    length: Array
    free: Bools
    H: Array
    fresh: Bools
    stalled: Ints


def descend(
    function: Function, start: Array, rounds: int = 600, gain: float = 1e-9, patience: int = 5
) -> _Found:
    """Descend from every start, inside the unit box.

    Args:
        function: The function to minimise.
        start: Shape (k, d), in [0, 1].
        rounds: Maximum number of points that every start tries.
        gain: Relative gain below which a step counts as none.
        patience: Number of consecutive steps without gain after which a start ends.
    """
    x = np.clip(start, 0.0, 1.0)
    k, d = x.shape
    value, slope = function(x)
    state = _State(
        x=x,
        value=value,
        slope=slope,
        way=np.zeros((k, d)),
        length=np.ones(k),
        free=np.ones((k, d), bool),
        H=np.broadcast_to(np.eye(d), (k, d, d)).copy(),
        fresh=np.ones(k, bool),
        stalled=np.zeros(k, int),
    )
    _aim(state, np.arange(k))
    for _ in range(rounds):
        rows = np.flatnonzero(state.stalled < patience)
        if not len(rows):
            break
        _try(function, state, rows, gain)
    return _Found(state.x, state.value)


def _try(function: Function, state: _State, rows: Ints, gain: float) -> None:
    """Try one more point for each start: accept it on sufficient decrease."""
    x, value, slope = state.x[rows], state.value[rows], state.slope[rows]
    trial = np.clip(x + state.length[rows, None] * state.way[rows], 0.0, 1.0)
    found, found_slope = function(trial)
    promised = np.einsum("ki,ki->k", slope, trial - x)
    good = found <= value + 1e-4 * np.minimum(promised, 0.0)
    state.length[rows[~good]] *= _SHRINK
    lost = rows[~good & (state.length[rows] < _SHORTEST)]
    _forget(state, lost)
    rows, trial, found, found_slope = rows[good], trial[good], found[good], found_slope[good]
    little = value[good] - found <= gain * np.maximum(1.0, np.abs(value[good]))
    state.stalled[rows] = np.where(little, state.stalled[rows] + 1, 0)
    state.stalled[lost] += 1
    free = state.free[rows]
    _learn(state, rows, (trial - x[good]) * free, (found_slope - slope[good]) * free)
    state.x[rows], state.value[rows], state.slope[rows] = trial, found, found_slope
    _aim(state, np.concatenate([rows, lost]))


def _aim(state: _State, rows: Ints) -> None:
    """Quasi-Newton direction among the free coordinates, limited in length."""
    x, slope = state.x[rows], state.slope[rows]
    free = ~(((x <= 0) & (slope > 0)) | ((x >= 1) & (slope < 0)))
    slope = slope * free
    way = -np.einsum("kij,kj->ki", state.H[rows], slope) * free
    downhill = np.einsum("ki,ki->k", way, slope)
    size = np.linalg.norm(way, axis=1) * np.linalg.norm(slope, axis=1)
    astray = ~(downhill < -1e-12 * size)
    _forget(state, rows[astray])
    way[astray] = -slope[astray]
    limit = np.where(state.fresh[rows], _FIRST_STEP, _LONGEST_STEP)
    longest = np.abs(way).max(axis=1).clip(1e-300)
    state.way[rows] = way * np.minimum(1.0, limit / longest)[:, None]
    state.free[rows], state.length[rows] = free, 1.0


def _forget(state: _State, rows: Ints) -> None:
    """Restart with the steepest descent."""
    state.H[rows] = np.eye(state.x.shape[1])
    state.fresh[rows] = True


def _learn(state: _State, rows: Ints, step: Array, turn: Array) -> None:
    """BFGS update of the inverse Hessian where the curvature along the step is positive."""
    curve = np.einsum("ki,ki->k", step, turn)
    size = np.linalg.norm(step, axis=1) * np.linalg.norm(turn, axis=1)
    good = curve > np.maximum(1e-10 * size, 1e-300)
    rows, s, y, sy = rows[good], step[good], turn[good], curve[good, None]
    H = state.H[rows]
    fresh = state.fresh[rows]
    H[fresh] *= (sy[fresh] / np.einsum("ki,ki->k", y[fresh], y[fresh])[:, None])[:, :, None]
    Hy = np.einsum("kij,kj->ki", H, y)
    t = s / sy
    half = (1 + np.einsum("ki,ki->k", y, Hy)[:, None] / sy) / 2 * s - Hy
    outer = half[:, :, None] * t[:, None]
    H += outer
    H += outer.swapaxes(1, 2)
    state.H[rows] = H
    state.fresh[rows] = False
