"""How much the readings really scatter.

The tracker's share comes from the effector's own rigidity, the scale's from readings that are off
as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse
from scipy import stats

from pipeline.diagnosis.view import View
from pipeline.results import Array, Errors
from pipeline.stages.whiten import whitener

TOLERATED = 1.3
"""A certificate that is wrong by less than this is not worth a word."""

SURE = 0.001
"""How unlikely scatter must be before it is called larger than stated."""

LEAST = 0.01
"""Readings that scatter less than this part of the stated noise are not from an instrument."""

LEAST_M = 1e-7
"""The same where no noise is stated [m]."""

TRIED = (1.0, 1.4, 2.0, 3.0, 5.0, 8.0, 13.0)
"""Scatter of the scale over its stated one, relative to the tracker's."""


@dataclass(frozen=True)
class Scatter:
    """Scatter found over scatter stated.

    Attributes:
        tracker: Of the tracker's readings.
        tracker_std: Its standard uncertainty.
        tracker_p: Probability of so much if it were `TOLERATED` at most.
        force: Of the scale's readings, relative to the tracker's; 1 unless the data say otherwise.
        force_p: Probability of so much more by chance.
        known_from: `rigidity` of the effector, or `residuals`.
    """

    tracker: float
    tracker_std: float
    tracker_p: float
    force: float
    force_p: float
    known_from: str


def scatter(view: View, errors: Errors, stated: bool) -> Scatter:
    """Estimate both scales; needs no model of the arm, as every suspect may be at work.

    Args:
        view: The campaign from the joint springs alone, with nothing scaled.
        errors: Its errors as stated.
        stated: False when the campaign states no noise.
    """
    if view.scatter_dof >= 10:
        dof, square, source = view.scatter_dof, view.scatter, "rigidity"
    else:
        dof, square, source = _all_suspects_out(view)
    tracker = max(float(np.sqrt(square / dof)), LEAST if stated else LEAST_M)
    p = float(stats.chi2.sf(square / TOLERATED**2, dof)) if stated else 1.0
    force, force_p = _force(view, errors)
    return Scatter(tracker, tracker / float(np.sqrt(2 * dof)), p, force, force_p, source)


def _all_suspects_out(view: View) -> tuple[int, float, str]:
    """Residual of the springs alone: with one reflector nothing better is known."""
    base = view.base
    X = view.A[:, base]
    residual = view.A[:, -1] - X @ np.linalg.lstsq(X, view.A[:, -1], rcond=1e-12)[0]
    return view.rows_left, float(residual @ residual), "residuals"


def _force(view: View, errors: Errors) -> tuple[float, float]:
    """The scale's share by restricted maximum likelihood, springs and all suspects estimated."""
    if not (errors.source == "force_reading").any() or view.scatter_dof < 10:
        return 1.0, 1.0
    likelihood = [_restricted(view, errors, factor) for factor in TRIED]
    if not np.isfinite(likelihood[0]):
        return 1.0, 1.0
    best = int(np.argmax(likelihood))
    p = float(stats.chi2.sf(2 * (likelihood[best] - likelihood[0]), 1) / 2)
    return (TRIED[best], p) if p < SURE else (1.0, 1.0)


def _restricted(view: View, errors: Errors, factor: float) -> float:
    scale = np.where(errors.source == "force_reading", factor, 1.0)
    G = scipy.sparse.csr_array(errors.G @ scipy.sparse.diags_array(scale))
    white = whitener(replace(errors, G=G), view.rows.pose)
    typical = np.concatenate([view.typical[: view.springs], view.typical[view.first :]])
    X = np.column_stack([white.by_pose(view.raw[:, :-1] * typical), white.common])
    y = white.by_pose(view.raw[:, -1])
    U, size, _ = np.linalg.svd(X, full_matrices=False)
    kept = size > 1e-9 * size[0]
    square = float(y @ y - np.sum((U[:, kept].T @ y) ** 2))
    dof = len(y) - int(kept.sum())
    if dof < 10 or square < 1e-10 * float(y @ y):  # exact data have no scatter to speak of
        return -np.inf
    log_size = float(np.sum(np.log(size[kept])))
    return _log_det(white.inverse) - log_size - dof / 2 * float(np.log(square))


def _log_det(inverse: Array) -> float:
    """Log determinant of V^-1/2."""
    return float(np.sum(np.log(np.einsum("pss->ps", inverse))))
