"""The family of the noise: how heavy the tails of single readings are, and what each is then worth.

A reading's error is normal with covariance lambda C, C the stated one, lambda its own:

    normal:   lambda = s^2                             Student: lambda = s^2 nu / chi2(nu)
    Eq. (18): lambda = 3 Beta(1/2, 1) s^2              bursts:  lambda = s^2, or k^2 s^2 in a part
    blunder:  log lambda uniform, in a part that nobody knows

(Lange, Little and Taylor, J. Am. Stat. Assoc. 84, 1989: Student's t as a mixture; Tukey, A survey
of sampling from contaminated distributions, 1960, for bursts; Box and Tiao, Biometrika 55, 1968,
for blunders). What the other readings leave of a reading's error, x ~ N(0,
lambda I + S), says what its lambda is; the product of these densities over all readings, what the
family is. V then has each reading's lambda at its posterior mean over lambda and family, so that
nothing is switched on or off.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy import special

from pipeline.base.arrays import Array, Locked
from pipeline.system.odds import DECIDES

FREEDOM = (3.0, 4.0, 5.0, 7.0, 10.0, 15.0)
"""Degrees of freedom of Student's distribution that are tried; more look normal in any campaign."""

BURSTS = ((0.03, 3.0), (0.03, 5.0), (0.1, 3.0))
"""Part of the readings in bursts that is tried, and how much wider these are.

Noise has a bound: no law that is tried throws more than `THROWN` of its readings beyond `AWAY`
times the width of its core. What a campaign holds beyond that are mistakes."""

AWAY = 10.0
"""Widths of the core from which a reading is far off [1]: a normal one is never there."""

THROWN = 0.013
"""Part of its readings that an instrument in order throws so far at most [1]: of 1000 rows of a
published stationary series of an absolute tracker 13 are farther off, and these are failed locks.
Student's with 3 degrees of freedom throws 0.8 %, bursts five times as wide 0.8 %."""

_LAWS = 1 + len(FREEDOM) + len(BURSTS)
"""The stated family, Student's and bursts, in this order."""

_OTHER = 0.0045
"""Probability of each other family before the data [1]: an assumption, like every prior, by which
some one in twenty is not as stated. A tracker that is as its certificate says is the rule."""

_MISTAKES = (1e-4, 1e-3, 1e-2, 1e-1)
"""Parts of all readings that are mistakes, as large as they like, that are tried [1]: nobody knows
how careful a campaign was. Of 1000 rows of a published stationary series of an absolute tracker 13
are failed locks; with one in 10 000 most campaigns have none; with one in ten it is no campaign,
and yet they are no noise."""

_COUNTS = 0.01
"""A family less likely than this explains nothing [1]."""

_SCATTER = 6.0
"""Standard uncertainties below which a reading that is off is scatter, not a mistake [1]: what a
normal reading reaches once in a hundred million."""

LIKELY = 0.5
"""Probability beyond which something rather is there than not [1]."""

_REACH = (2.4, 4.8, 22.0)
"""Over so many e-folds of lambda the mistakes of a campaign spread, from the least on, that are
tried [1]: up to 20 or 66 standard uncertainties, or ten metres. Many of one origin are of one
order, and noise of a part of the readings would pass for them if they had to be of any."""

_ALIKE = (0.025, 0.025, 0.95)
"""Probability of each before the data [1]: an assumption; of any order is the rule."""

_STEP = 0.1
"""Of the grid below, in natural logarithms [1]."""
_GRID = np.arange(-3.0, 25.0, _STEP)
"""log lambda: up to an error of ten metres where 0.03 mm is stated."""

_WIDTHS = np.append(np.arange(-34, -14, 2), np.arange(-14, 15)) * _STEP
"""log s^2 that is tried: a scale found in contrasts holds core, tails and mistakes; a tenth of the
readings ten standard uncertainties off make nine tenths of it, and tails with nu = 3 two thirds of
the rest."""


@dataclass(frozen=True)
class _Core:
    """How wide the noise is in its middle, tails and mistakes apart.

    Attributes:
        scale: s over the stated one [1].
        std: Its relative standard uncertainty.
        p_value: Probability of a core as wide or wider if it were as stated, with any tails.
    """

    scale: float
    std: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Family(Locked):
    """What the noise of single readings is.

    Attributes:
        weight: Probability of the stated family, each of `FREEDOM` and of `BURSTS`, shape (f,).
        log_scale: log s^2 of each, over the noise that was in use, shape (f,).
        mistakes: Part of the readings that are mistakes beside each, posterior mean, shape (f,).
        p_value: Probability of tails as heavy if the stated family were true.
        paper: The stated family is that of Eq. (18).
        profile: Log likelihood at each of `_WIDTHS`, the law beside it the likeliest, shape (k,).
        widest: Variance of a reading where the beam makes it largest, over the stated one [1].
        reach: Which part of its mistakes spreads over each of `_REACH`, shape (f, w).
    """

    weight: Array
    log_scale: Array
    mistakes: Array
    p_value: float
    paper: bool
    profile: Array = field(default_factory=lambda: np.zeros(len(_WIDTHS)))
    widest: float = 1.0
    reach: Array = field(default_factory=lambda: np.tile(np.eye(len(_REACH))[-1], (_LAWS, 1)))

    @property
    def heavy(self) -> float:
        """Probability that the tails are heavier than stated."""
        return float(self.weight[1:].sum())

    @property
    def likely_heavy(self) -> bool:
        """Whether the tails rather are heavier than stated than not."""
        return self.heavy > LIKELY

    @property
    def rather(self) -> Family:
        """The same where the tails rather are heavier than not, else the stated family."""
        stated = np.eye(len(self.weight))[0]
        return self if self.likely_heavy else replace(self, weight=stated)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the likeliest Student distribution."""
        return FREEDOM[int(np.argmax(self.weight[1 : 1 + len(FREEDOM)]))]

    def core(self, used: float) -> _Core:
        """The width of the core beside whatever tails are likeliest with it.

        p = P[chi2(1) > 2 (max L - L_0)] / 2 where s is larger than stated, else no less than a
        half: L the profile, L_0 that of the stated width, s = 1 / used, or the narrowest tried.

        Args:
            used: Standard uncertainty in V over the stated one [1].
        """
        best = int(np.argmax(self.profile))
        stated = -2 * float(np.log(used))
        more = self.profile[best] - float(np.interp(stated, _WIDTHS, self.profile))
        p = 0.5 * float(special.chdtrc(1, 2 * max(more, 0.0)))
        odds = special.softmax(self.profile)
        std = float(np.sqrt(odds @ (_WIDTHS - odds @ _WIDTHS) ** 2)) / 2
        scale = used * float(np.exp(_WIDTHS[best] / 2))
        return _Core(scale, std, p if _WIDTHS[best] > stated else 1 - p)

    @classmethod
    def stated(cls, paper: bool = False) -> Family:
        """Nothing but what is stated."""
        none = np.zeros(_LAWS)
        usual = float(np.exp(np.mean(np.log(_MISTAKES))))
        return cls(np.append(1.0, none[1:]), none, none + usual, 1.0, paper)

    def mistaken(self, square: float, axes: int = 3) -> float:
        """Probability that a reading so far off is a blunder and not one of this family.

        Args:
            square: Square of its error in standard uncertainties, as stated or, where readings
                scatter more, as found.
            axes: Coordinates that the square is the sum of.
        """
        seen = np.exp(-0.5 * (axes * _GRID + square / self.widest * np.exp(-_GRID)))
        own, odd = (law @ seen for law in self._laws)
        return float(self.weight @ (odd / (odd + own)))

    @property
    def _laws(self) -> tuple[Array, Array]:
        """Share of each log lambda of readings in order, and of mistakes, shape (f, K) each."""
        part = self.mistakes[:, None]
        odd = np.einsum("fw,wfk->fk", self.reach, _blunders(self.log_scale))
        return (1 - part) * _bulks(self.log_scale, self.paper), part * odd

    def away(self, distance: float, others: Array) -> Array:
        """Mean chance that readings are so far off, mistakes apart, shape (f,).

        x ~ N(0, lambda + S) in each coordinate, its squares over max(1, S) summed. Of the families
        with a weight of a hundredth at least.

        Args:
            distance: In standard uncertainties [1].
            others: Variance S of what the other readings say of each, shape (n, 3).
        """
        unit = np.maximum(others, 1.0)
        widest = ((np.exp(_GRID)[:, None, None] + others) / unit).max(axis=2)
        each = special.chdtrc(3, distance**2 / widest).mean(axis=1)
        return (_bulks(self.log_scale, self.paper) @ each)[self.weight >= _COUNTS]

    @property
    def width(self) -> float:
        """Width of the core of the likeliest family over the noise that was in use [1]."""
        return float(np.exp(self.log_scale[int(np.argmax(self.weight))] / 2))

    def of(self, used: float) -> Family:
        """The same over the stated noise, `used` times which was in use."""
        return replace(self, log_scale=self.log_scale + 2 * np.log(used))

    def drawn(self, n: int, rng: np.random.Generator) -> Array:
        """Lambda of n readings, blunders apart."""
        which = rng.choice(len(self.weight), n, p=self.weight)
        out = 3 * rng.beta(0.5, 1.0, n) if self.paper else np.ones(n)
        for k, nu in enumerate(FREEDOM, 1):
            of = which == k
            out[of] *= nu / rng.chisquare(nu, int(of.sum()))
        for k, (part, width) in enumerate(BURSTS, 1 + len(FREEDOM)):
            of = which == k
            out[of] *= np.where(rng.random(int(of.sum())) < part, width**2, 1.0)
        return out * np.exp(self.log_scale[which])


def _posterior_mean(found: Family, seen: Array) -> Array:
    """Mean of each reading's lambda given what is seen of it, `seen` as of `likelihood`, (n,)."""
    own, odd = found._laws
    joint = seen[None] * (own + odd)[:, None, :]
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
    tried = _tried(paper)
    own = (seen @ tried.reshape(-1, seen.shape[1]).T).T.reshape(*tried.shape[:2], len(seen))
    each = np.array([[_logs(own, odd, b) for odd in _odd(seen)] for b in _MISTAKES])
    each += np.log(_ALIKE)[:, None, None]
    logs = special.logsumexp(each, axis=(0, 1)) - np.log(len(_MISTAKES))  # (f, scales)
    best = logs.max(axis=1)
    free = special.logsumexp(logs, axis=1) - np.log(len(_WIDTHS))
    before = np.append(1 - (_LAWS - 1) * _OTHER, np.full(_LAWS - 1, _OTHER))
    weight = special.softmax(free + np.log(before))
    scale = _WIDTHS[logs.argmax(axis=1)]
    student = best[1 : 1 + len(FREEDOM)]
    p = 0.5 * float(special.chdtrc(1, max(2 * (student.max() - best[0]), 0.0)))
    among = special.softmax(special.logsumexp(each, axis=3), axis=(0, 1))
    part = np.einsum("b,bwf->fw", np.array(_MISTAKES), among)
    mistakes, reach = part.sum(axis=1), part / part.sum(axis=1, keepdims=True)
    if 2 * (best[0] - logs[0, np.abs(_WIDTHS).argmin()]) < DECIDES:
        scale[0] = 0.0  # what is stated, or was found in contrasts, holds
    told = Family(weight, scale, mistakes, p, paper, logs.max(axis=0), reach=reach)
    return told, _posterior_mean(told, seen)


@cache
def _tried(paper: bool) -> Array:
    """`_bulks` at every scale, shape (f, widths, K)."""
    return np.stack([_bulks(np.full(_LAWS, scale), paper) for scale in _WIDTHS], axis=1)


def _bulks(log_scale: Array, paper: bool) -> Array:
    """Share of each log lambda under each family, blunders apart, shape (f, K)."""
    scale = iter(log_scale.tolist())
    stated = [_stated(next(scale), paper)]
    student = [_student(nu, next(scale), paper) for nu in FREEDOM]
    bursts = [_bursts(part, width, next(scale), paper) for part, width in BURSTS]
    return np.stack([*stated, *student, *bursts])


def _stated(log_scale: float, paper: bool) -> Array:
    """Share of each log lambda of the grid under the stated family, shape (K,)."""
    if paper:  # density of 3 s^2 b in log lambda, b ~ Beta(1/2, 1): sqrt(b) / 2
        share = np.exp(_GRID - log_scale) / 3
        return _normed(np.where(share <= 1, np.sqrt(share), 0.0))
    at = int(np.argmin(np.abs(_GRID - log_scale)))
    return np.eye(len(_GRID))[at]


def _bursts(part: float, width: float, log_scale: float, paper: bool) -> Array:
    """The same where a part of the readings is wider."""
    wide = _stated(log_scale + 2 * np.log(width), paper)
    return (1 - part) * _stated(log_scale, paper) + part * wide


def _student(nu: float, log_scale: float, paper: bool) -> Array:
    """The same under Student's with nu degrees of freedom: lambda = s^2 nu / chi2(nu)."""
    bulk = _normed(np.exp(-0.5 * nu * (_GRID - log_scale + np.exp(log_scale - _GRID))))
    if not paper:
        return bulk
    own = _stated(0.0, True)
    start = int(np.argmin(np.abs(_GRID)))
    return _normed(np.convolve(bulk, own)[start : start + len(_GRID)])


def _least(log_scale: Array) -> Array:
    """Least log lambda of a mistake, `_SCATTER` standard uncertainties but for bursts, (f,)."""
    own = np.array([1.0, *(nu / (nu - 2) for nu in FREEDOM), *np.ones(len(BURSTS))])
    return np.asarray(log_scale + np.log(_SCATTER**2 * own))


def _blunders(log_scale: Array) -> Array:
    """Share of each log lambda of mistakes, spread over each of `_REACH`, shape (w, f, K)."""
    above = _GRID - _least(log_scale)[:, None]
    reach = np.array(_REACH)[:, None, None]
    inside = (above > -0.5 * _STEP) & (above < reach - 0.5 * _STEP)
    return np.asarray(inside * _STEP / reach)


def _odd(seen: Array) -> Iterator[Array]:
    """Likelihood of every reading as such a mistake, at all scales, shape (f, scales, n) each."""
    summed = np.vstack([np.zeros(len(seen)), np.cumsum(seen.T, axis=0)])
    start = np.array(
        [np.searchsorted(_GRID + 0.5 * _STEP, _least(np.full(_LAWS, s))) for s in _WIDTHS]
    ).T
    for reach in _REACH:
        end = np.minimum(start + round(reach / _STEP), len(_GRID))
        yield (summed[end] - summed[start]) * _STEP / reach


def _logs(own: Array, odd: Array, part: float) -> Array:
    """Log likelihood of all readings, a part of which are mistakes, shape (f, scales)."""
    return np.asarray(np.log((1 - part) * own + part * odd + 1e-300).sum(axis=2))


def _normed(share: Array) -> Array:
    return np.asarray(share / share.sum())
