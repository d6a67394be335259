"""Scatter used by a diagnosis: the tracker's, and the scale's with every suspect estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse
from scipy import special

from pipeline.base.tails import chi2_beyond
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

_TRIED = np.linspace(0.0, np.log(16.0), 17)
"""Trial log ratios of the scatter of the scale to its stated one, relative to the tracker's [1]:
ten times is a fault."""

_BEFORE = special.softmax(-0.5 * (_TRIED / np.log(2.0)) ** 2)
"""Prior weight of each: log-normal, one standard deviation is a factor of 2, never smaller."""


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
    over the tracker's. Its weights are the prior's times exp(-L(t) / 2), the factor is their mean,
    and p = P[chi2(1) > L(0) - min L] / 2, as t is at the bound under the null (Self and Liang, J.
    Am. Stat. Assoc. 82, 1987).

    Returns:
        Factor on its stated scatter, relative to the tracker's, its standard uncertainty and its
        p-value; 1, 0 and 1 unless a larger scatter is likelier than the stated one.
    """
    errors = system.errors
    typical = np.concatenate([view.typical[: view.springs], view.typical[view.first :]])
    X = view.raw[:, :-1] * typical
    beyond = Base.of(X, system.c)
    exact = beyond.rest < _EXACT**2 * (system.c @ system.c)
    if exact or not (errors.source == "force_reading").any() or beyond.dof < _FEWEST:
        return _AS_SAID
    own = np.where(errors.common, 1.0, tracker)
    wide = replace(errors, G=scipy.sparse.csr_array(errors.G @ scipy.sparse.diags_array(own)))
    Q, scale = beyond.blocks.rows(beyond.Q), [("force_reading",)]
    loss = PaddedRows.beside(replace(system, errors=wide), Q, scale).whole
    better = -0.5 * np.array([loss(np.array([t])) for t in _TRIED])
    better -= better[0]
    weight = _BEFORE * np.exp(better - better.max())
    if special.logsumexp(better, b=_BEFORE) <= 0:
        return _AS_SAID
    t = float(weight @ _TRIED / weight.sum())
    std = float(np.sqrt(weight @ (_TRIED - t) ** 2 / weight.sum()))
    p = float(chi2_beyond(2 * better.max(), 1) / 2)
    return float(np.exp(t)), float(np.exp(t)) * std, p
