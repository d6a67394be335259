"""Noise along and across the laser beam, where one figure is stated for both.

A tracker measures its range with a laser and its directions with encoders: along the beam it is
several times better, and across it worse the farther away a target is. With u the direction from
its station to a target, r the distance and r0 its mean over a campaign,

    C(a, b, g) = M C M,    M = a u u' + b (r / r0)^g (I - u u'),

C as stated. For each g of `_GROWTH`, a and b maximise the restricted likelihood (`restricted`) of
the residuals of springs and causes. The odds of each g, and of any deviation from the stated
proportion at all, follow from Laplace's approximation of the evidence of a / b (MacKay, Neural
Computation 4, 1992). V takes the posterior means of the variances, so no test switches anything on
or off.

A wrong model makes residuals larger, never smaller. Of the two parts, therefore, only the smaller
one is used as found; the other is limited so that the total variance of the readings equals the
stated one, as when the rms of three axes is the stated figure, and is no smaller than it. Whether
the total is larger than stated is decided by contrasts (`variance`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from pipeline.base.arrays import Array, Locked
from pipeline.base.linear import rms
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.parted import PartedRows
from pipeline.system.restricted import lowest
from pipeline.system.system import System

_GROWTH = (0.0, 1 / 3, 2 / 3, 1.0)
"""Trial exponents of the distance for the part across the beam [1]: from none to that of angles
alone; 15 um + 6 um/m of a data sheet corresponds to 0.7 from 3 to 14 m."""

_AS_STATED = 0.5
"""Prior probability that both parts are in the stated proportion [1]: an assumption, like every
prior; one figure for all axes is a guess as often as a finding."""

_BETTER = 0.9
"""Prior probability that the range is the more precise part if they are not in that proportion [1]:
data sheets state 0.5 to 20 um for interferometers and absolute distance meters, 10 to 30 um + 2 to
7 um/m for encoders."""

_LEAST, _MOST = 0.1, 2.0
"""Limits of the ratio of range to transverse part [1]: an interferometer, and a target so near that
the angles hardly matter."""

_FEWEST = 30
"""Minimum degrees of freedom of the residuals for two parts to be estimated."""

_LIKELY = 0.5
"""Probability above which something is taken to be present [1]."""

_WORTH = 1.3
"""Minimum factor between stated and found noise for a part to be reported [1], as for
certificates."""

_OWN = ("tracker", "zero")
"""Sources of error whose covariances are split by the beam. Chain directions, which depend on it
too, hardly matter and stay as stated."""


@dataclass(frozen=True, eq=False)
class BeamNoise(Locked):
    """The two parts of the noise, relative to the stated ones.

    Attributes:
        along: Standard uncertainty along the beam that is used [1].
        across: Standard uncertainty across the beam that is used for each displacement, shape
            (d,) [1].
        found: Both at the maximum of the likelihood, at the mean distance, whatever is used.
        std: Their relative standard uncertainties.
        probability: Posterior probability that they are not in the stated proportion.
        p_value: Probability of a proportion this far from the stated one by chance.
    """

    along: float
    across: Array
    found: tuple[float, float] = (1.0, 1.0)
    std: tuple[float, float] = (np.inf, np.inf)
    probability: float = 0.0
    p_value: float = 1.0

    @classmethod
    def stated(cls, data: Measured) -> BeamNoise:
        """Both parts as stated."""
        return cls(1.0, np.ones(len(data.pull)))

    @property
    def better(self) -> bool:
        """Whether the range is significantly better than stated, by more than a factor `_WORTH`."""
        sure = self.probability > _LIKELY and self.p_value < alarms.COMPONENT
        return sure and self.along * _WORTH < 1

    def on(self, data: Measured) -> Measured:
        """The measurements with both parts applied to the covariances of their readings."""
        return _times(data, self.along, self.across)

    def off(self, data: Measured) -> Measured:
        """The measurements with the stated covariances again, the inverse of `on`."""
        return _times(data, 1 / self.along, 1 / self.across)

    @property
    def widest(self) -> float:
        """Largest variance of a part of a reading relative to the stated one, at least 1 [1]."""
        return max(1.0, self.along**2, float(self.across.max()) ** 2)

    def change(self, other: BeamNoise) -> float:
        """Largest difference between the log variances of two results [1]."""
        across = np.abs(np.log(self.across / other.across)).max()
        return 2 * float(max(across, abs(np.log(self.along / other.along))))


def beam(data: Measured, system: System, Q: Array, dof: int) -> BeamNoise:
    """Estimate both parts from the rows of a campaign.

    L is minus twice the restricted log likelihood, L_0 that of the stated proportion,
    t = log(a / b), w its standard uncertainty and f its prior density: the odds of each of k
    exponents g are exp((L_0 - L) / 2) f(t) w sqrt(2 pi) / k, and p = P[chi2(2) > L_0 - min L].

    Args:
        data: The measurements.
        system: Their rows and errors, linearised at a model.
        Q: Orthonormal columns that span springs and causes, shape (M, k).
        dof: Degrees of freedom of the residuals.
    """
    stated, beams = BeamNoise.stated(data), _beams(data)
    if beams is None or dof < _FEWEST:
        return stated
    u, r = beams
    ratio, grown = _proportion(data, u), r[:, None] ** np.array(_GROWTH)
    more, along, across = _fitted(system, Q, u, grown)
    if not np.isfinite(more).all():  # rows without noise cannot resolve its parts
        return stated
    along = across * np.clip(along / across, _LEAST / ratio, _MOST / ratio)
    std = np.sqrt(np.array([1.5, 0.75]) / dof)  # of one axis and of two, by dof
    logs = 0.5 * (more + np.log(2 * np.pi * (std @ std))) + _log_prior(along / across * ratio)
    weight = special.softmax(np.append(0.0, logs))
    used = [_taken(*one, ratio) for one in zip(along, (across * grown).T, strict=True)]
    best = int(np.argmax(more))
    return BeamNoise(
        along=float(np.sqrt(weight @ np.square([1.0, *(a for a, _ in used)]))),
        across=np.sqrt(weight @ np.square([stated.across, *(b for _, b in used)])),
        found=(float(along[best]), float(across[best])),
        std=(float(std[0]), float(std[1])),
        probability=1 - float(weight[0]),
        p_value=float(special.chdtrc(2, max(float(more[best]), 0.0))),
    )


def _fitted(system: System, Q: Array, u: Array, grown: Array) -> tuple[Array, Array, Array]:
    """L_0 - L, a and b for each exponent of the distance, shapes (k,).

    Args:
        system: As for `beam`.
        Q: As for `beam`.
        u: Directions of the beams, shape (d, 3).
        grown: (r / r0)^g, shape (d, k).
    """
    own = np.isin(system.errors.source.astype(str), _OWN)
    try:
        rows = PartedRows.of(system, Q, u, own)
    except np.linalg.LinAlgError:  # readings without noise
        none = np.full(grown.shape[1], np.nan)
        return none, none, none
    found, tried = np.full(2, rows.rough), list[list[float]]()
    stated = rows.alike()
    for size in grown.T:
        blocks = rows.grown(size)
        found = lowest(blocks.loss, found)
        tried.append([stated - blocks.whole(found), *np.exp(found)])
    more, along, across = np.array(tried).T
    return more, along, across


def _log_prior(ratio: Array) -> Array:
    """Log of the prior odds density of the ratio of range to transverse part, per log ratio."""
    better, worse = _BETTER / -np.log(_LEAST), (1 - _BETTER) / np.log(_MOST)
    density = np.where(ratio < 1, better, worse) / len(_GROWTH)
    return np.asarray(np.log(density * (1 - _AS_STATED) / _AS_STATED))


def _taken(along: float, across: Array, ratio: float) -> tuple[float, Array]:
    """Both parts as they may be used: the smaller as found, the total variance at most as stated.

    Args:
        along: Part along the beam as found.
        across: Part across the beam as found, of each displacement, shape (d,).
        ratio: Range over transverse part as stated.
    """
    share = ratio**2 / (ratio**2 + 2)  # share of the range in the variance of a reading
    mean = float(rms(across))
    if min(along, mean) >= 1:
        return 1.0, np.ones(len(across))
    most = along, mean
    if along < mean:
        most = along, min(mean, float(np.sqrt((1 - share * along**2) / (1 - share))))
    else:
        most = min(along, float(np.sqrt((1 - (1 - share) * mean**2) / share))), mean
    both = max(1.0, 1 / max(most))
    return both * most[0], across * (both * most[1] / mean)


def _beams(data: Measured) -> tuple[Array, Array] | None:
    """Directions from the station to the targets, (d, 3), and distances over their mean, (d,).

    None where the station is unknown or the noise is not that of a tracker's readings.
    """
    if data.tracker is None or data.poses or not data.tracked or data.paper:
        return None
    to = data.unloaded - data.tracker
    r = np.linalg.norm(to, axis=1)
    if not (np.isfinite(r).all() and r.all()):
        return None
    return to / r[:, None], np.asarray(r / r.mean())


def _proportion(data: Measured, u: Array) -> float:
    """Range over transverse part as stated, rms over the loaded readings [1]."""
    along = float(np.einsum("di,dij,dj->", u, data.loaded_cov, u))
    return float(np.sqrt(2 * along / (float(np.einsum("dii->", data.loaded_cov)) - along)))


def _times(data: Measured, along: float, across: Array) -> Measured:
    """The measurements with both parts of their covariances multiplied."""
    beams = _beams(data)
    if beams is None or (along == 1.0 and (across == 1.0).all()):
        return data
    P = beams[0][:, :, None] * beams[0][:, None, :]
    M = along * P + across[:, None, None] * (np.eye(3) - P)
    return replace(data, loaded_cov=M @ data.loaded_cov @ M, zero_cov=M @ data.zero_cov @ M)
