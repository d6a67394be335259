"""Estimate x and its uncertainty from c = B x + G e by generalised least squares."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools
from pipeline.machine.cell import Cell
from pipeline.reduction.measured import Measured
from pipeline.system import score_tests
from pipeline.system.assemble import TRACKED, assemble
from pipeline.system.restricted import PaddedRows, lowest
from pipeline.system.system import Estimate, Goodness, System
from pipeline.system.whiten import Whitener, whitener

MISFIT_P = 0.01
"""A misfit that chance produces less often than this counts as a misfit of the model [1]."""

_TRACKER_M = 1e-4
"""Upper limit of the noise of a laser tracker for displacements in a hall (MPE of the AT500 class)
[m]."""

_STEADY = 1e-9
"""Relative change of a parameter between iterations below which it has converged [1]; it affects no
digit that is read."""

_NO_NOISE_M = 1e-12
"""Residuals below this are rounding [m]."""


def is_plausible(estimate: Estimate, tracked: bool = True) -> bool:
    """Whether chance alone may have caused the misfit.

    Args:
        estimate: The estimate; without a stated noise its residuals are compared with the largest
            noise of a laser tracker.
        tracked: Whether a laser tracker measured; nothing is known beforehand of other instruments.
    """
    if estimate.p_value is None:
        return not tracked or estimate.residual_std_m < _TRACKER_M
    return estimate.p_value >= MISFIT_P


def solve(system: System, start: Array) -> Estimate:
    """Generalised least squares with columns scaled to their typical size.

    x = (B' V^-1 B)^-1 B' V^-1 c,    cov(x) = s^2 (B' V^-1 B)^-1,    chi2 = r' V^-1 r,  r = c - B x,

    with s^2 = chi2 / (M - rank) where V is still relative, else 1 (Aitken, Proc. Roy. Soc.
    Edinburgh 55, 1935). V is that of c, shape (M, M), all in F_b.

    A singular value then says by how many standard uncertainties this combination of parameters, at
    typical size, moves the data, and a column of rounding noise stays negligible. Combinations that
    move nothing keep `start`, and the parameters in them have infinite uncertainty.

    Args:
        system: The system; its covariance is used in full.
        start: Values of undetermined parameters, shape (k,).
    """
    white, typical = whitener(system.errors, system.rows.pose), system.typical
    value, cov, chi2, rank = least_squares(white(system.B), white(system.c), typical, start)
    residual = system.c - system.B @ value
    dof = len(system.rows) - rank
    scale = chi2 / max(dof, 1) if system.relative else 1.0
    dark = np.isinf(cov)
    cov = np.where(dark, np.inf, np.where(dark, 0.0, cov) * scale)  # a perfect fit has scale 0
    std = np.sqrt(np.diag(cov))
    of = Goodness.of if system.noise_stated else Goodness.untold
    return Estimate(
        parameters=system.parameters,
        value=value,
        cov=cov,
        identifiable=identifiable(typical, value, std),
        residual=residual,
        goodness=of(chi2 / scale if scale else 0.0, dof),
        noise_from="stated" if system.noise_stated else "residuals",
        residual_std_m=float(np.sqrt(residual @ residual / max(dof, 1))),
        quantile=float(
            special.ndtri(0.975) if system.noise_stated else special.stdtrit(dof, 0.975)
        ),
    )


def identifiable(typical: Array, value: Array, std: Array) -> Bools:
    """Parameters known to better than half their size, typical or estimated, (k,).

    2 u(x) < max(typical, |x|), or max(typical, |x| / 2) where u(x) > 3 typical: an estimate as
    large as that is likely scatter, and must be known to a quarter.
    """
    size = np.abs(value) / np.where(std > 3 * typical, 2, 1)
    return np.asarray(2 * std < np.maximum(typical, size), dtype=bool)


def least_squares(
    A: Array, y: Array, typical: Array, start: Array
) -> tuple[Array, Array, float, int]:
    """Least squares on whitened rows, columns scaled to their typical size.

    x = start + D (A D)+ (y - A start) and cov(x) = D (D A'A D)+ D with D = diag(typical) and the
    pseudoinverse of `linear`.

    Args:
        A: Whitened B, shape (M, k).
        y: Whitened c, shape (M,).
        typical: Typical size of each parameter, shape (k,).
        start: Values of undetermined parameters, shape (k,).

    Returns:
        Values (k,), covariance (k, k) with infinite variances where undetermined, chi2, rank.
    """
    inverse = linear.pseudoinverse(A * typical)
    value = start + typical * inverse(y - A @ start)
    rest = y - A @ value
    return value, inverse.cov * np.outer(typical, typical), float(rest @ rest), inverse.rank


def identify(
    cell: Cell, data: Measured, start: Array, near: Array | None = None
) -> tuple[System, Estimate]:
    """Estimate the parameters of a cell from the measurements of one campaign.

    A noise of the tracker that is neither stated nor found yet is estimated from the residuals, in
    addition to the stated errors: at `start`, and twice more at the solution so obtained.

    Args:
        cell: The model.
        data: The measurements.
        start: Values of undetermined parameters, shape (k,).
        near: First values; `start` when not given, shape (k,).
    """
    value = np.asarray(start, dtype=float)
    if not data.noise_stated and data.found_m is None:
        for _ in range(2):
            found_m = tracker_noise(assemble(cell, data, value))
            value = solve(assemble(cell, data.in_metres(found_m), value), value).value
        data = data.in_metres(tracker_noise(assemble(cell, data, value)))
    return _iterate(lambda values: assemble(cell, data, values), start, near)


def tracker_noise(system: System) -> float:
    """Standard uncertainty per axis of a reading [m] for which V = s^2 V_tracker + V_rest fits.

    It maximises the restricted likelihood of the residuals, see `restricted`. With nothing but the
    tracker's errors, s^2 = r' V_tracker^-1 r / (M - k).

    Args:
        system: A system whose noise of the tracker is still relative.
    """
    blocks = PaddedRows.of(system, system.B * system.typical, [TRACKED])
    if blocks.dof < 1 or blocks.rough < np.log(_NO_NOISE_M) + 4:  # only rounding is left
        return _NO_NOISE_M
    (log_s,) = lowest(blocks.of_scales(np.array([True])), np.array([blocks.rough]))
    return float(np.exp(log_s))


def _iterate(
    assembled: Callable[[Array], System],
    start: Array,
    near: Array | None = None,
    rounds: int = 12,
) -> tuple[System, Estimate]:
    """Solve, re-linearise B and the covariance at the solution, and repeat until x converges.

    Args:
        assembled: The system about given parameter values.
        start: Values of undetermined parameters, shape (k,).
        near: First values; `start` when not given, shape (k,).
        rounds: Maximum number of iterations.
    """
    value = np.asarray(start if near is None else near, dtype=float)
    for _ in range(rounds):
        system = assembled(value)
        estimate = solve(system, np.asarray(start, dtype=float))
        step = np.abs(estimate.value - value)
        value = estimate.value
        if np.all(step <= _STEADY * np.abs(value)):
            break
    return system, estimate


def left_out(system: System, white: Whitener | None = None) -> Array:
    """Residuals of each pose when that pose with all its pulls is left out of the estimate.

    r_p = c_p - B_p x_p, with x_p estimated from the remaining poses with the whole V; see
    `score_tests.left_out`.

    Returns:
        Unweighted residuals [m], shape (M,); NaN where the other poses do not determine x.
    """
    white = white or whitener(system.errors, system.rows.pose)
    B = system.B * system.typical
    X = np.hstack([white.with_priors(B), white.columns])
    rows = np.hstack([B, np.zeros_like(white.common)])
    left, lost = score_tests.left_out(X, white.with_priors(system.c), white.key, rows, system.c)
    return np.where(lost, np.nan, left)
