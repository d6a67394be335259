"""Size of the noise from the data, variance components by restricted likelihood.

V = sum_s scale_s^2 G_s G_s' + the rest as stated, shape (M, M) [m^2]; the scales minimise

    log|V| + log|X' V^-1 X| + y' V^-1 (y - X b),    b = (X' V^-1 X)^-1 X' V^-1 y,

y the contrasts and X the fixed effects (Patterson and Thompson, Biometrika 58 (1971) 545).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import scipy.sparse
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked, Strings
from pipeline.base.tails import CHI2_95, chi2_below, chi2_beyond
from pipeline.machine.cell import Cell
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Settings
from pipeline.system import alarms
from pipeline.system.assemble import TRACKED
from pipeline.system.contrasts import ZEROS, pure_error, repeated_zeros
from pipeline.system.family import Family
from pipeline.system.restricted import PaddedRows, maximum
from pipeline.system.system import Estimate, Goodness, System
from pipeline.system.whiten import whitener

_SCALED: Mapping[str, tuple[str, ...]] = {
    "tracker": TRACKED,
    "force_reading": ("force_reading",),
}
"""The components, and the sources of error whose standard uncertainty each of them multiplies."""


NAMES = {"tracker": "tracker_noise", "force_reading": "force_noise"}
"""Name in the contract of each component that is larger than stated."""


UNDETERMINED = 0.5
"""Relative standard uncertainty of a scale above which the data do not determine it [1]."""


_FAR = 10.0
"""Factor by which readings must scatter less than stated for the stated noise to be contradicted
from below [1]. Stating the MPE, or the expanded uncertainty, for the standard one makes 2 of it,
the noise at the far end of the rail for that nearby another 2 or 3; units of length begin to differ
here (cm and mm)."""

_LEAST_M = 1e-7
"""Scatter below which displacements are computed, not read [m]: exports are rounded to as much."""

_FEWEST = 12
"""Minimum number of contrasts to determine any component."""


@dataclass(frozen=True, eq=False)
class Components(Locked):
    """Noise found, as factors on the stated standard uncertainties.

    Attributes:
        name: `tracker`, `force_reading`, shape (n,).
        scale: Factor on the stated standard uncertainty; 1 where undetermined, shape (n,).
        std: Relative standard uncertainty of `scale`; infinite where undetermined, (n,).
        p_value: Probability of a scale this large or larger if the stated noise were true, (n,).
        dof: Degrees of freedom of the contrasts.
        stated: False when the campaign states no noise of the tracker; its scale then is in m.
        chi2: Weighted sum of squares of the contrasts of pulls, which are a part of the misfit of
            every model, with the noise as it is used.
        chi2_dof: Their number.
        taken: Whether the tracker's scale is used although it is not significantly larger: with the
            stated noise the misfit of the model is significant, with this one it is not.
        p_smaller: Probability of a scale this small or smaller if the noise were a tenth of the
            stated one (`_FAR`), shape (n,); empty where not computed.
    """

    name: Strings
    scale: Array
    std: Array
    p_value: Array
    dof: int
    stated: bool
    chi2: float = 0.0
    chi2_dof: int = 0
    taken: bool = False
    p_smaller: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def smaller(self) -> Bools:
        """Components significantly smaller than the stated ones over `_FAR`, shape (n,)."""
        p = self.p_smaller if len(self.p_smaller) else np.ones(len(self.name))
        return np.asarray(p < alarms.COMPONENT)

    @property
    def larger(self) -> Bools:
        """Components that are significantly larger than stated, shape (n,)."""
        return self.p_value < alarms.COMPONENT

    @property
    def replaced(self) -> Bools:
        """Components whose estimate replaces the stated or missing noise, shape (n,).

        Stated noise that the data contradict, from above or from below, is treated as none.
        """
        missing = (self.name == "tracker") & (not self.stated)
        taken = (self.name == "tracker") & self.taken
        return np.asarray(
            self.larger | self.smaller | taken | (missing & np.isfinite(self.std)), dtype=bool
        )

    @property
    def used(self) -> bool:
        """Whether any component is replaced."""
        return bool(self.replaced.any())

    @property
    def left(self) -> tuple[float, float]:
        """Scale of the tracker relative to the noise in use, and its relative uncertainty."""
        used = self.replaced[0] or not self.stated
        return (1.0 if used else float(self.scale[0])), float(self.std[0])

    def of(self, name: str) -> float:
        """Scale of one component."""
        return float(self.scale[list(self.name).index(name)])

    def beside(self, family: Family) -> Components:
        """The same, but the tracker's scale is that of the core, given the tails of a family.

        A variance includes core and tails: an excess that the tails explain is removed.
        """
        mine = self.name == "tracker"
        if not (mine & self.larger).any():
            return self
        core = family.core(float(self.scale[mine][0]))
        return replace(
            self,
            scale=np.where(mine, core.scale, self.scale),
            std=np.where(mine, core.std, self.std),
            p_value=np.where(mine, np.maximum(self.p_value, core.p_value), self.p_value),
        )


def variance_components(
    system: System,
    design: Array | None = None,
    names: Sequence[str] = ("tracker", "force_reading"),
) -> Components:
    """Scales of the noise components by restricted maximum likelihood.

    Fixed effects are the columns of `design`; the residual is normal with
    V = sum s^2 G_s G_s' + stated rest, including the errors common to all poses. For an answer that
    no wrong model of the robot can spoil, give the system of `pure_error`; for residuals of a
    model, the campaign's own. The standard uncertainties are the larger of those from the
    information and from the scatter between poses, so that tails longer than normal do not make
    them too small.

    Args:
        system: c, and its errors by source.
        design: Fixed effects, shape (M, k); B of the system when not given.
        names: Components to find, keys of `_SCALED`.
    """
    X = system.B if design is None else design
    log_scale, std = np.zeros(len(names)), np.full(len(names), np.inf)
    p = np.ones(len(names))
    if len(system.rows) - X.shape[1] < _FEWEST:
        return _components(system, names, log_scale, std, p, len(system.rows))
    blocks = PaddedRows.of(system, X, [_SCALED[name] for name in names])
    known = np.array([_told(system, _SCALED[name]) for name in names])
    if known.any():
        log_scale[known], std[known], p[known] = maximum(blocks, known)
    return _components(system, names, log_scale, std, p, blocks.dof)


def _components(
    system: System, names: Sequence[str], log_scale: Array, std: Array, p: Array, dof: int
) -> Components:
    lost = ~(std < UNDETERMINED)
    log_scale, std = np.where(lost, 0.0, log_scale), np.where(lost, np.inf, std)
    name = np.array(names, object)
    missing = (name == "tracker") & (not system.noise_stated)
    scale = np.exp(log_scale) * np.where(missing, system.found_m or 1.0, 1.0)
    nu = 0.5 / std**2
    below = chi2_below(nu * (_FAR * scale) ** 2, nu)
    unread = scale * np.array([_stated_m(system, _SCALED[one]) for one in names]) < _LEAST_M
    return Components(
        name,
        scale,
        std,
        np.where(lost | missing, 1.0, p),
        dof,
        system.noise_stated,
        p_smaller=np.where(lost | missing | unread, 1.0, below),
    )


def _stated_m(system: System, sources: Sequence[str]) -> float:
    """Displacement caused by sources of error as stated, rms [m]."""
    G = system.errors.G[:, np.isin(system.errors.source.astype(str), sources)]
    return float(np.sqrt(G.power(2).sum() / max(G.shape[0], 1)))


def _told(system: System, sources: Sequence[str]) -> bool:
    mine = np.isin(system.errors.source.astype(str), sources)
    return bool(mine.any()) and bool(abs(system.errors.G[:, mine]).sum() > 0)


def rescaled(data: Measured, found: Components) -> Measured:
    """The same measurements with the noise that was found where it replaces the stated one.

    A tracker noisier than stated also registered the base frame less well, unless the uncertainty
    of the registration already comes from the scatter of the base reflectors.
    """
    used = found.replaced | ~np.array([found.stated, True])
    tracker, force = np.where(used, found.scale, 1.0).tolist()
    told = data.rotation_found or not found.stated
    return replace(
        data.scaled(tracker / (data.found_m or 1.0)),
        rotation_cov=data.rotation_cov * (1.0 if told else tracker**2),
        reading_std=data.reading_std * force,
        noise_stated=True,
        found_m=None,
    )


def resting_on(estimate: Estimate, found: Components) -> Estimate:
    """The estimate with a noise that is itself estimated: Student's quantile and test of misfit.

    The noise was fitted to the contrasts, so they cannot test the model: the rest of chi2 is
    compared with them, see `Goodness.beyond`. nu = (u(scale) / scale)^-2 / 2 is also that of
    Student's t (GUM, JCGM 100:2008, Eq. (G.3)); of several scales the least certain counts.
    """
    nu = 0.5 / float(np.max(found.std[found.replaced])) ** 2
    part = found.chi2, found.chi2_dof
    return replace(
        estimate,
        goodness=Goodness.beyond(estimate.chi2, estimate.dof, part, nu),
        noise_from="replicates",
        quantile=float(special.stdtrit(nu, 0.975)),
    )


def noise(
    settings: Settings,
    cell: Cell,
    placed: pd.DataFrame,
    data: Measured,
    system: System,
    estimate: Estimate,
    taken: bool = False,
) -> Components:
    """The noise of a campaign from its repeats, its repeated zeros and its effector's triangle."""
    zeros = repeated_zeros(settings, placed)
    pure = pure_error(system, estimate.residual, data, zeros, cell)
    found = _with_scale(variance_components(pure), system, estimate)
    found = replace(found, taken=taken and found.left[0] > 1)
    return replace(found, **_of_pulls(pure, found)) if found.used else found


def _with_scale(found: Components, system: System, estimate: Estimate) -> Components:
    """Add the scale's scatter from residuals, if contrasts cannot resolve it and it is far smaller.

    A wrong model makes residuals larger, never smaller: they can contradict the stated noise from
    below, only contrasts can from above. With L the loss of `restricted.PaddedRows` at the log
    scale t, p = P[chi2(1) > L(-log FAR) - min L] / 2; the scale used is the largest with L - min L
    within the 95 % of chi2(1), since only an upper limit may be given.
    """
    k = list(found.name).index("force_reading")
    stated_m = _stated_m(system, _SCALED["force_reading"])
    known = np.isfinite(found.std[k]) or not found.stated
    if known or linear.rms(estimate.residual) > stated_m:
        return found
    blocks = PaddedRows.of(system, system.B, [_SCALED[str(name)] for name in found.name])
    tried = np.where(np.arange(len(found.name)) == k, _LOWER[:, None], np.log(found.scale))
    loss = np.array([blocks.whole(log_scale) for log_scale in tried])
    beyond = loss - loss.min()
    p = float(chi2_beyond(beyond[0], 1)) / 2
    if p >= alarms.COMPONENT:
        return found
    mine = found.name == "force_reading"
    largest = float(_LOWER[int(np.argmax(beyond <= CHI2_95))])
    return replace(
        found,
        scale=np.where(mine, np.exp(largest), found.scale),
        std=np.where(mine, np.sqrt(0.5 / blocks.dof), found.std),
        p_smaller=np.where(mine, p, found.p_smaller),
    )


_LOWER = -np.log(_FAR) * np.linspace(1.0, 6.0, 61)
"""Trial log scales, from a tenth to a millionth of the stated noise."""


def _of_pulls(pure: System, found: Components) -> dict[str, Any]:
    """`chi2` and `chi2_dof` of the contrasts between pulls."""
    rows = np.flatnonzero(pure.rows.pull != ZEROS)
    factor = np.ones(len(pure.errors.source))
    for name in found.name[found.replaced]:
        unit = (pure.found_m or 1.0) if name == "tracker" else 1.0
        factor[np.isin(pure.errors.source.astype(str), _SCALED[name])] = found.of(name) / unit
    G = scipy.sparse.csr_array(pure.errors.G[rows] @ scipy.sparse.diags_array(factor))
    white = whitener(replace(pure.errors, G=G), pure.rows.pose[rows])
    return {"chi2": float(np.sum(white(pure.c[rows]) ** 2)), "chi2_dof": len(rows)}
