"""The actual scatter of the readings.

The tracker's comes from the rigidity of the effector, the scale's from displacements of a pull that
are off in one proportion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse
from scipy import optimize, stats

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.system import alarms
from pipeline.system.system import Errors, Scatter
from pipeline.system.whiten import whitener
from pipeline.system.whitened import Whitened

TOLERATED = 1.3
"""A certificate that is wrong by less than this factor is not reported."""

_LEAST = 0.01
"""Readings that scatter less than this part of the stated noise are not from an instrument."""

_LEAST_M = 1e-7
"""The same where no noise is stated [m]."""

_TRIED = (1.0, 1.4, 2.0, 3.0, 5.0, 8.0, 13.0)
"""Scatter of the scale over its stated one, relative to the tracker's."""

_BEND = 0.1
"""Differences of log scale for the curvature at the best one."""


def scatter(view: Whitened, errors: Errors, stated: bool) -> Scatter:
    """Estimate both scales; needs no model of the arm, as every suspect may be at work.

    s^2 = Q / nu,    u(s) = s / sqrt(2 nu),    p = P[chi2(nu) > Q / `TOLERATED`^2],

    Q the sum of squares, in stated variances, of what no rigid motion of the effector explains, nu
    its degrees of freedom; with too few reflectors those of the joint springs' residuals.

    Args:
        view: The campaign from the joint springs alone, with nothing scaled.
        errors: Its errors as stated.
        stated: False when the campaign states no noise.
    """
    if view.tells_scatter:
        dof, square, source = view.scatter_dof, view.scatter, "rigidity"
    else:
        dof, square, source = _all_suspects_out(view)
    tracker = max(float(np.sqrt(square / dof)), _LEAST if stated else _LEAST_M)
    p = float(stats.chi2.sf(square / TOLERATED**2, dof)) if stated else 1.0
    force, force_std, force_p = _force(view, errors)
    tracker_std = tracker / float(np.sqrt(2 * dof))
    return Scatter(tracker, tracker_std, p, force, force_std, force_p, source)


def _all_suspects_out(view: Whitened) -> tuple[int, float, str]:
    """Residual of the springs alone: with one reflector nothing better is known."""
    base = view.base
    X = view.A[:, base]
    residual = view.A[:, -1] - X @ linear.least_squares(X, view.A[:, -1])
    return view.rows_left, float(residual @ residual), "residuals"


def _force(view: Whitened, errors: Errors) -> tuple[float, float, float]:
    """The scale's scatter by restricted maximum likelihood, springs and all suspects estimated.

    L is minus twice the log likelihood of `_restricted`, t the log scale: u(t) = sqrt(2 / L''), and
    p = P[chi2(1) > L(0) - min L] / 2, as t is at the bound under the null (Self and Liang, J. Am.
    Stat. Assoc. 82, 1987).

    Returns:
        Factor on its stated scatter, relative to the tracker's, its standard uncertainty and its
        p-value; 1, 0 and 1 unless the data say otherwise.
    """
    if not (errors.source == "force_reading").any() or not view.tells_scatter:
        return 1.0, 0.0, 1.0
    loss = _restricted(view, errors)
    if not np.isfinite(loss(0.0)):
        return 1.0, 0.0, 1.0
    tried = np.log(_TRIED)
    losses = [loss(x) for x in tried]
    best = float(tried[int(np.argmin(losses))])
    p = float(stats.chi2.sf(losses[0] - min(losses), 1) / 2)
    if p >= alarms.SCATTER:
        return 1.0, 0.0, 1.0
    x = float(optimize.minimize_scalar(loss, bounds=(best - 0.5, best + 0.5), method="bounded").x)
    curvature = (loss(x + _BEND) - 2 * loss(x) + loss(x - _BEND)) / _BEND**2
    std = float(np.sqrt(2 / curvature)) if curvature > 0 else np.inf
    return float(np.exp(x)), float(np.exp(x)) * std, p


def _restricted(view: Whitened, errors: Errors) -> Callable[[float], float]:
    """Minus twice the restricted log likelihood by the log scale t of the force readings.

    L(t) = log|V_t| + log|X' V_t^-1 X| + nu log(y' P_t y), up to a constant: y is c, X springs,
    suspects and common errors, V_t = G G' without the latter and with the columns of the force
    readings times exp(t), y' P_t y the weighted sum of squares that X leaves, nu = M - rank X; the
    scale of V_t as a whole is profiled out (Patterson and Thompson, Biometrika 58, 1971).

    The fixed effects are thinned to independent ones once: were their rank counted anew at every
    scale, a direction near the limit would come and go and pass for evidence.
    """
    force = errors.source == "force_reading"
    typical = np.concatenate([view.typical[: view.springs], view.typical[view.first :]])
    fixed = view.raw[:, :-1] * typical

    def whitened(log_scale: float) -> tuple[Array, Array, float]:
        scale = np.where(force, np.exp(log_scale), 1.0)
        G = scipy.sparse.csr_array(errors.G @ scipy.sparse.diags_array(scale))
        white = whitener(replace(errors, G=G), view.rows.pose)
        X = np.column_stack([white.by_pose(fixed), white.common])
        return X, white.by_pose(view.raw[:, -1]), _log_det(white.inverse)

    X, y, _ = whitened(0.0)
    U, size, Vt = np.linalg.svd(X, full_matrices=False)
    kept = size > 1e-9 * size[0]
    thin, dof = Vt[kept].T / size[kept], len(y) - int(kept.sum())
    exact = float(y @ y - np.sum((U[:, kept].T @ y) ** 2)) < 1e-10 * float(y @ y)
    if dof < 10 or exact:  # exact data have no scatter to speak of
        return lambda _: np.inf

    def loss(log_scale: float) -> float:
        X, y, log_det = whitened(log_scale)
        Q, R = np.linalg.qr(X @ thin)
        square = float(y @ y - np.sum((Q.T @ y) ** 2))
        return 2 * float(np.log(np.abs(np.diag(R))).sum()) + dof * np.log(square) - 2 * log_det

    return loss


def _log_det(inverse: Array) -> float:
    """Log determinant of V^-1/2."""
    return float(np.sum(np.log(np.einsum("pss->ps", inverse))))
