"""Scatter used by a diagnosis: the tracker's, and the scale's with every suspect estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse

from pipeline.base.tails import chi2_beyond
from pipeline.system import alarms
from pipeline.system.restricted import PaddedRows
from pipeline.system.score_tests import Base
from pipeline.system.system import ScatterRatio, System
from pipeline.system.whitened import Whitened

TOLERATED_FACTOR = 1.3
"""Factor by which a certificate may be wrong without being reported [1]."""

_LEAST = 0.01
"""Minimum scatter relative to the stated noise [1]; less does not come from an instrument."""

_LEAST_M = 1e-7
"""Minimum scatter where no noise is stated [m]."""

_EXACT = 1e-5
"""Residuals below this fraction of the displacements are not the scatter of a scale [1]."""

_FEWEST = 10
"""Minimum degrees of freedom for the scatter of the scale to be estimated."""

_TRIED = (1.0, 1.4, 2.0, 3.0, 5.0, 8.0, 13.0)
"""Trial ratios of the scatter of the scale to its stated one, relative to the tracker's [1]."""

_BEND = 0.1
"""Step in log scale for the curvature at the optimum [1]."""


def scatter(view: Whitened, system: System, known: tuple[float, float]) -> ScatterRatio:
    """Scatter of tracker and scale, relative to the noise that the data are weighted with.

    The tracker's is that of the campaign's contrasts, which no model of the robot can produce:
    p = P[chi2(nu) > nu s^2 / `TOLERATED_FACTOR`^2] with nu = (u(s) / s)^-2 / 2. Where they cannot
    resolve it, it is that of the residuals of the joint springs.

    Args:
        view: The campaign from the joint springs alone, with nothing scaled.
        system: Its rows and errors as they are weighted.
        known: The tracker's noise found in contrasts over the one in use, and its relative standard
            uncertainty; infinite where they cannot resolve it.
    """
    tracker, relative = known
    dof, source = 0.5 / relative**2, "contrasts"
    if not np.isfinite(relative):
        dof, source = float(view.rows_left), "residuals"
        if dof < 1:  # as many stiffnesses as coordinates: no residual degrees of freedom
            return ScatterRatio(1.0, np.inf, 1.0, *_AS_SAID, source)
        tracker = float(np.sqrt(Base.of(view.A[:, view.base], view.A[:, -1]).rest / dof))
    stated = system.noise_stated
    tracker = max(tracker, _LEAST if stated else _LEAST_M)
    p = float(chi2_beyond(dof * (tracker / TOLERATED_FACTOR) ** 2, dof)) if stated else 1.0
    force, force_std, force_p = _force(view, system, tracker) if source == "contrasts" else _AS_SAID
    return ScatterRatio(
        tracker, tracker / float(np.sqrt(2 * dof)), p, force, force_std, force_p, source
    )


_AS_SAID = (1.0, 0.0, 1.0)


def _force(view: Whitened, system: System, tracker: float) -> tuple[float, float, float]:
    """The scale's scatter by restricted likelihood, with springs and all suspects estimated.

    L is minus twice the log likelihood of `restricted.PaddedRows`, t the log of the scale's factor
    over the tracker's: u(t) = sqrt(2 / L''), and p = P[chi2(1) > L(0) - min L] / 2, as t is at the
    bound under the null (Self and Liang, J. Am. Stat. Assoc. 82, 1987).

    Returns:
        Factor on its stated scatter, relative to the tracker's, its standard uncertainty and its
        p-value; 1, 0 and 1 unless the factor is significant.
    """
    errors = system.errors
    typical = np.concatenate([view.typical[: view.springs], view.typical[view.first :]])
    beyond = Base.of(view.raw[:, :-1] * typical, system.c)
    exact = beyond.rest < _EXACT**2 * (system.c @ system.c)
    if exact or not (errors.source == "force_reading").any() or beyond.dof < _FEWEST:
        return _AS_SAID
    own = np.where(errors.common, 1.0, tracker)
    wide = replace(errors, G=scipy.sparse.csr_array(errors.G @ scipy.sparse.diags_array(own)))
    Q, scale = beyond.blocks.rows(beyond.Q), [("force_reading",)]
    loss = PaddedRows.beside(replace(system, errors=wide), Q, scale).whole
    losses = [loss(np.array([t])) for t in np.log(_TRIED)]
    p = float(chi2_beyond(losses[0] - min(losses), 1) / 2)
    if p >= alarms.SCATTER:
        return _AS_SAID
    from scipy import optimize  # slow to import, and seldom needed

    best = float(np.log(_TRIED)[int(np.argmin(losses))])
    t = optimize.minimize_scalar(lambda t: loss(np.array([t])), bounds=(best - 0.5, best + 0.5)).x
    bent = [loss(np.array([t + step])) for step in (_BEND, 0.0, -_BEND)]
    curvature = (bent[0] - 2 * bent[1] + bent[2]) / _BEND**2
    std = float(np.sqrt(2 / curvature)) if curvature > 0 else np.inf
    return float(np.exp(t)), float(np.exp(t)) * std, p
