"""The family of the noise: how heavy the tails of single readings are, and what each is then worth.

A reading's error is normal with covariance lambda C, C the stated one, lambda its own:

    normal:   lambda = s^2                             Student: lambda = s^2 nu / chi2(nu)
    Eq. (18): lambda = 3 Beta(1/2, 1) s^2              blunder: log lambda uniform, one in 100

(Lange, Little and Taylor, J. Am. Stat. Assoc. 84, 1989: Student's t as a mixture; Box and Tiao,
Biometrika 55, 1968, for blunders). What the other readings leave of a reading's error, x ~ N(0,
lambda I + S), says what its lambda is; the product of these densities over all readings, what the
family is. V then has each reading's lambda at its posterior mean over lambda and family, so that
nothing is switched on or off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.base.arrays import Array, Locked

FREEDOM = (2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0)
"""Degrees of freedom of Student's distribution that are tried; more look normal in any campaign."""

_NORMAL = 0.9
"""Probability of the stated family before the data [1]: an assumption, like every prior. A tracker
that is as its certificate says is the rule."""

BLUNDERS = 1e-2
"""Part of all readings that are mistakes, as large as they like [1]: of 1000 rows of a
published stationary series of an absolute tracker 13 are failed locks."""

_SCATTER = 6.0
"""Standard uncertainties below which a reading that is off is scatter, not a mistake [1]: what a
normal reading reaches once in a hundred million."""

_STEP = 0.1
_GRID = np.arange(-3.0, 25.0, _STEP)
"""log lambda: up to an error of ten metres where 0.03 mm is stated."""

_SCALES = np.arange(-14, 15) * _STEP
"""log s^2 that is tried: a scale found in contrasts is known to some ten per cent."""


@dataclass(frozen=True, eq=False)
class Family(Locked):
    """What the noise of single readings is.

    Attributes:
        weight: Probability of the stated family, then of each of `FREEDOM`, shape (1 + f,).
        log_scale: log s^2 of each, shape (1 + f,).
        p_value: Probability of tails as heavy if the stated family were true.
        paper: The stated family is that of Eq. (18).
    """

    weight: Array
    log_scale: Array
    p_value: float
    paper: bool

    @property
    def heavy(self) -> float:
        """Probability that the tails are heavier than stated."""
        return float(self.weight[1:].sum())

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the likeliest Student distribution."""
        return FREEDOM[int(np.argmax(self.weight[1:]))]

    @classmethod
    def stated(cls, paper: bool = False) -> Family:
        """Nothing but what is stated."""
        none = np.zeros(1 + len(FREEDOM))
        return cls(np.append(1.0, none[1:]), none, 1.0, paper)

    def mistaken(self, square: float, axes: int = 3) -> float:
        """Probability that a reading so far off is a blunder and not one of this family.

        Args:
            square: Square of its error in standard uncertainties.
            axes: Coordinates that the square is the sum of.
        """
        seen = np.exp(-0.5 * (axes * _GRID + square * np.exp(-_GRID)))
        own = np.stack([seen @ bulk for bulk in _bulks(self.log_scale, self.paper)])
        odd = BLUNDERS * float(seen @ _blunder())
        return float(self.weight @ (odd / (odd + (1 - BLUNDERS) * own)))

    def drawn(self, n: int, rng: np.random.Generator) -> Array:
        """Lambda of n readings, blunders apart."""
        which = rng.choice(len(self.weight), n, p=self.weight)
        out = 3 * rng.beta(0.5, 1.0, n) if self.paper else np.ones(n)
        for k in range(1, len(self.weight)):
            of = which == k
            nu = FREEDOM[k - 1]
            out[of] *= np.exp(self.log_scale[k]) * nu / rng.chisquare(nu, int(of.sum()))
        return out


def _posterior_mean(found: Family, seen: Array) -> Array:
    """Mean of each reading's lambda given what is seen of it, `seen` as of `likelihood`, (n,)."""
    kept = (1 - BLUNDERS) * _bulks(found.log_scale, found.paper) + BLUNDERS * _blunder()
    joint = seen[None] * kept[:, None, :]
    mean = (joint @ np.exp(_GRID)) / joint.sum(axis=2)
    return np.asarray(found.weight @ mean)


def likelihood(square: Array, variance: Array, now: Array) -> Array:
    """Density of what is seen of each reading at each log lambda of the grid, shape (n, K).

    N(x; 0, lambda I + S) along three axes; S = diag(v) - lambda_now, v the variance of x now.

    Args:
        square: Squares of x, shape (n, 3).
        variance: v, shape (n, 3).
        now: lambda that each reading has in V now, shape (n,).
    """
    others = np.maximum(variance - now[:, None], 1e-9)
    out = np.zeros((len(square), len(_GRID)))
    for axis in range(3):
        total = others[:, axis, None] + np.exp(_GRID)
        out -= 0.5 * (np.log(total) + square[:, axis, None] / total)
    return np.asarray(np.exp(out - out.max(axis=1, keepdims=True)))


def family(seen: Array, paper: bool) -> tuple[Family, Array]:
    """The family that the readings show, and each reading's lambda.

    p = P[chi2(1) > 2 (L_Student - L_stated)] / 2, L the log likelihoods at their best scale and
    freedom: 1 / nu is at the end of its range under the null (Self and Liang, J. Am. Stat. Assoc.
    82, 1987).

    Args:
        seen: `likelihood` of every reading, shape (n, K).
        paper: The stated family is that of Eq. (18).
    """
    odd = _blunder()
    own = np.stack([_stated(scale, paper) for scale in _SCALES])
    bulks = [own, *(np.stack([_student(nu, s, paper) for s in _SCALES]) for nu in FREEDOM)]
    priors = (1 - BLUNDERS) * np.stack(bulks) + BLUNDERS * odd  # (1 + f, scales, K)
    logs = np.log(np.einsum("nk,fsk->fsn", seen, priors) + 1e-300).sum(axis=2)
    best = logs.max(axis=1)
    free = np.append(best[0], special.logsumexp(logs[1:], axis=1) - np.log(len(_SCALES)))
    free[0] = special.logsumexp(logs[0]) - np.log(len(_SCALES))
    before = np.append(_NORMAL, np.full(len(FREEDOM), (1 - _NORMAL) / len(FREEDOM)))
    weight = special.softmax(free + np.log(before))
    scale = _SCALES[logs.argmax(axis=1)]
    p = 0.5 * float(special.chdtrc(1, max(2 * (best[1:].max() - best[0]), 0.0)))
    scale[0] = 0.0  # what is stated, or was found in contrasts, holds
    told = Family(weight, scale, p, paper)
    return told, _posterior_mean(told, seen)


def _bulks(log_scale: Array, paper: bool) -> Array:
    """Share of each log lambda under the stated family, and under each of `FREEDOM`, (1 + f, K)."""
    student = [_student(nu, s, paper) for nu, s in zip(FREEDOM, log_scale[1:], strict=True)]
    return np.stack([_stated(float(log_scale[0]), paper), *student])


def _stated(log_scale: float, paper: bool) -> Array:
    """Share of each log lambda of the grid under the stated family, shape (K,)."""
    if paper:  # density of 3 s^2 b in log lambda, b ~ Beta(1/2, 1): sqrt(b) / 2
        share = np.exp(_GRID - log_scale) / 3
        return _normed(np.where(share <= 1, np.sqrt(share), 0.0))
    at = int(np.argmin(np.abs(_GRID - log_scale)))
    return np.eye(len(_GRID))[at]


def _student(nu: float, log_scale: float, paper: bool) -> Array:
    """The same under Student's with nu degrees of freedom: lambda = s^2 nu / chi2(nu)."""
    bulk = _normed(np.exp(-0.5 * nu * (_GRID - log_scale + np.exp(log_scale - _GRID))))
    if not paper:
        return bulk
    own = _stated(0.0, True)
    start = int(np.argmin(np.abs(_GRID)))
    return _normed(np.convolve(bulk, own)[start : start + len(_GRID)])


def _blunder() -> Array:
    return _normed((np.log(_SCATTER**2) <= _GRID).astype(float))


def _normed(share: Array) -> Array:
    return np.asarray(share / share.sum())
