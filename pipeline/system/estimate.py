"""Stage 6. c = B x + G e in, x with its uncertainty out: generalised least squares."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools
from pipeline.machine.cell import Cell
from pipeline.reduction.measured import Measured
from pipeline.system import beside
from pipeline.system.assemble import TRACKED, assemble
from pipeline.system.restricted import PaddedRows, lowest
from pipeline.system.system import Estimate, Goodness, System
from pipeline.system.whiten import Whitener, whitener

MISFIT_P = 0.01
"""A misfit that chance produces less often than this is a misfit [1]."""

_TRACKER_M = 1e-4
"""A laser tracker measures displacements in a hall to this or better (MPE of the AT500 class)
[m]."""

_STEADY = 1e-9
"""Relative change of a parameter from one round to the next that moves no digit one reads [1]."""

_NO_NOISE_M = 1e-12
"""Residuals below this are rounding [m]."""


def fits(estimate: Estimate, tracked: bool = True) -> bool:
    """Whether chance alone may have made the misfit.

    Args:
        estimate: The estimate; where it states no noise, a laser tracker's is the largest.
        tracked: Whether a laser tracker measured; of other instruments nothing is known beforehand.
    """
    if estimate.p_value is None:
        return not tracked or estimate.residual_std_m < _TRACKER_M
    return estimate.p_value >= MISFIT_P


def solve(system: System, start: Array, white: Whitener | None = None) -> Estimate:
    """Generalised least squares with columns in their typical size.

    x = (B' V^-1 B)^-1 B' V^-1 c,    cov(x) = s^2 (B' V^-1 B)^-1,    chi2 = r' V^-1 r,  r = c - B x,

    with s^2 = chi2 / (M - rank) where V is still relative, else 1 (Aitken, Proc. Roy. Soc.
    Edinburgh 55, 1935). V is that of c, shape (M, M), all in F_b.

    The singular values then read "how many standard uncertainties this mix of parameters moves
    the data at typical size", and a column of rounding noise stays what it is. Mixes that move
    nothing keep `start`, and the parameters in them have infinite uncertainty.

    Args:
        system: The system; its covariance is used in full.
        start: Where undetermined parameters stay, shape (k,).
        white: The system's whitener, if it is at hand.
    """
    white = white or whitener(system.errors, system.rows.pose)
    typical = system.typical
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
    """Parameters known to better than half their size, the typical or the estimated one, (k,).

    2 u(x) < max(typical, |x|), or max(typical, |x| / 2) where u(x) > 3 typical: an estimate as
    large as that is likely scatter, and must be known to a quarter.
    """
    size = np.abs(value) / np.where(std > 3 * typical, 2, 1)
    return np.asarray(2 * std < np.maximum(typical, size), dtype=bool)


def least_squares(
    A: Array, y: Array, typical: Array, start: Array
) -> tuple[Array, Array, float, int]:
    """Least squares on whitened rows, columns in their typical size.

    x = start + D (A D)+ (y - A start) and cov(x) = D (D A'A D)+ D with D = diag(typical) and the
    pseudoinverse of `linear`.

    Args:
        A: Whitened B, shape (M, k).
        y: Whitened c, shape (M,).
        typical: Typical size of each parameter, shape (k,).
        start: Where undetermined parameters stay, shape (k,).

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
    """The parameters of a cell from one campaign's measurements; x starts at `start`, or `near`.

    A noise of the tracker that is not stated is found from the residuals, beside the errors that
    are stated, about the first solution and about the next.
    """
    value = np.asarray(start, dtype=float)
    if not data.noise_stated and data.found_m is None:
        for _ in range(2):
            found_m = tracker_noise(assemble(cell, data, value))
            weighed = data.in_metres(found_m)
            value = solve(assemble(cell, weighed, value), value).value
        data = data.in_metres(tracker_noise(assemble(cell, data, value)))
    return _iterate(lambda values: assemble(cell, data, values), start, near)


def tracker_noise(system: System) -> float:
    """Standard uncertainty per axis of a reading [m] for which V = s^2 V_tracker + V_rest fits.

    It minimises the restricted likelihood of the residuals, see `restricted`. With nothing but the
    tracker's errors that is s^2 = r' V_tracker^-1 r / (M - k).

    Args:
        system: A system whose noise of the tracker is still relative.
    """
    typical = system.typical
    blocks = PaddedRows.of(system, system.B * typical, [TRACKED])
    if blocks.dof < 1 or blocks.rough < np.log(_NO_NOISE_M) + 4:  # nothing is left but rounding
        return _NO_NOISE_M
    (log_s,) = lowest(blocks.of_scales(np.array([True])), np.array([blocks.rough]))
    return float(np.exp(log_s))


def _iterate(
    assembled: Callable[[Array], System],
    start: Array,
    near: Array | None = None,
    rounds: int = 12,
) -> tuple[System, Estimate]:
    """Solve, take B and the covariance at the solution, and solve again until x stands still.

    Args:
        assembled: The system about given parameter values.
        start: Where undetermined parameters stay, shape (k,).
        near: First values; `start` when not given, shape (k,).
        rounds: At most so many.
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

    r_p = c_p - B_p x_p, x_p from the poses that stay with the whole V; see `beside.left_out`.

    Returns:
        Unweighted residuals [m], shape (M,); NaN where the rest does not determine x.
    """
    white = white or whitener(system.errors, system.rows.pose)
    B = system.B * system.typical
    X = np.hstack([white.with_priors(B), white.columns])
    rows = np.hstack([B, np.zeros_like(white.common)])
    left, lost = beside.left_out(X, white.with_priors(system.c), white.key, rows, system.c)
    return np.where(lost, np.nan, left)
