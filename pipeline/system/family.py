"""The noise family: how heavy the tails of single readings are, and the weight each then gets.

A reading's error is normal with covariance lambda C, C the stated one, lambda its own:

    normal:   lambda = s^2                             Student: lambda = s^2 nu / chi2(nu)
    Eq. (18): lambda = 3 Beta(1/2, 1) s^2              bursts:  lambda = s^2, or k^2 s^2 in a part
    blunder:  log lambda uniform, in an unknown fraction
    spells:   lambda = s^2, or k^2 s^2 in successive states of the campaign

(Lange, Little and Taylor, J. Am. Stat. Assoc. 84, 1989: Student's t as a mixture; Tukey, A survey
of sampling from contaminated distributions, 1960, for bursts; Box and Tiao, Biometrika 55, 1968,
for blunders). The estimate of a reading's error from the other readings, x ~ N(0, lambda I + S),
determines the likelihood of its lambda; the product of these densities over all readings determines
the likelihood of the family; a spell (`spells.py`) is of successive states, and a reading is judged
by what the others of its time are like. V then has each reading's lambda at its posterior mean over
lambda, spells and family, so no test switches anything on or off.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import product

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.system.odds import DECIDES
from pipeline.system.spells import States

FREEDOM = (3.0, 4.0, 5.0, 7.0, 10.0, 15.0)
"""Trial degrees of freedom of Student's distribution; more look normal in any campaign."""

BURSTS = ((0.03, 3.0), (0.03, 5.0), (0.1, 3.0))
"""Trial pairs: fraction of the readings in bursts, and their width relative to the others.  Noise
is bounded: no trial law has more than `FAILED_LOCKS` of its readings beyond `FAR_OFF` times the
width of its core. What a campaign holds beyond that are mistakes."""

SPELLS = ((0.2, 3.0), (0.04, 5.0))
"""Trial pairs: fraction of the states in a spell, and the width of the readings there relative to
the others, within the same bound."""

TARGETS = ((1.0, 2.0), (1.0, 3.0), (1.0, 5.0), (1.0, 8.0), (0.3, 3.0), (0.3, 5.0), (0.3, 8.0))
"""Trial pairs of one target: fraction of its readings that are wider, and their width relative to
the others [1]: a nest gives way always, or where the pull or the pose loads it."""

FAR_OFF = 10.0
"""Distance from which a reading is far off, in widths of the core [1]: never reached by a normal
one."""

FAILED_LOCKS = 0.013
"""Maximum fraction of readings that an instrument in order produces so far off [1]: of 1000 rows of
a published stationary series of an absolute tracker 13 are farther off, and these are failed locks.
Student's with 3 degrees of freedom gives 0.8 %, bursts five times as wide 0.8 %."""

_FAMILIES = 1 + len(FREEDOM) + len(BURSTS) + len(SPELLS)
"""Number of families: the stated one, Student's, bursts and spells, in this order."""

_SPELL = np.arange(_FAMILIES) >= _FAMILIES - len(SPELLS)
"""Which of them have spells, shape (f,)."""

_SHARES = np.array([share for share, _ in SPELLS])
"""Fraction of the states in a spell under each of those."""

_NO_STATE = -1, -1
"""Key of readings that belong to no pose."""

_OTHER = 0.0045
"""Prior probability of each other family [1]: an assumption, like every prior, by which about one
campaign in twenty-five is not as stated. A tracker that meets its certificate is the rule."""

_MISTAKES = (1e-4, 1e-3, 1e-2, 1e-1)
"""Trial fractions of all readings that are mistakes of any size [1]: how careful a campaign was is
unknown. Of 1000 rows of a published stationary series of an absolute tracker 13 are failed locks;
with one in 10 000 most campaigns have none; one in ten is hardly a campaign any more, and yet these
are not noise."""

_COUNTS = 0.01
"""Minimum probability of a family that may explain readings far off [1]."""

_SCATTER = 6.0
"""Standard uncertainties below which an outlier is scatter, not a mistake [1]: a normal reading
reaches this once in a hundred million."""

PRESENT = 0.5
"""Probability above which something is taken to be present [1]."""

_REACH = (2.4, 4.8, 22.0)
"""Trial ranges of the mistakes of a campaign, in e-folds of lambda above the smallest [1]: up to 20
or 66 standard uncertainties, or ten metres. Many mistakes of one origin are of one order of
magnitude; if any size were required, noise in a part of the readings would pass for them."""

_ALIKE = (0.025, 0.025, 0.95)
"""Prior probability of each of these ranges [1]: an assumption; mistakes of any size are the
rule."""

_STEP = 0.1
"""Step of the grid below, in natural logarithms [1]."""
_GRID = np.arange(-3.0, 25.0, _STEP)
"""log lambda: up to an error of ten metres where 0.03 mm is stated."""

_WIDTHS = np.append(np.arange(-34, -14, 2), np.arange(-14, 15)) * _STEP
"""Trial values of log s^2: a scale found in contrasts includes core, tails and mistakes; a tenth of
the readings being ten standard uncertainties off makes up nine tenths of it, and tails with nu = 3
two thirds of the rest."""


@dataclass(frozen=True)
class _Core:
    """Width of the core of the noise, tails and mistakes excluded.

    Attributes:
        scale: s over the stated one [1].
        std: Its relative standard uncertainty.
        p_value: Probability of a core this wide or wider if it were as stated, with any tails.
    """

    scale: float
    std: float
    p_value: float


@dataclass(frozen=True)
class LoosestTarget:
    """The target whose readings scatter more than those of the others.

    Attributes:
        target: Its index.
        width: Scatter of its readings over that of the others, root mean square [1].
        probability: Posterior probability that this, and no other law, is the noise.
        p_value: Probability of a target this wide, of all targets, if the stated family were true.
    """

    target: int
    width: float
    probability: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Family(Locked):
    """Distribution of the noise of single readings.

    Attributes:
        weight: Probability of the stated family, each of `FREEDOM`, `BURSTS` and `SPELLS`, (f,).
        log_scale: log s^2 of each, relative to the noise in use when it was found, shape (f,).
        mistakes: Fraction of the readings that are mistakes under each, posterior mean, shape (f,).
        p_value: Probability of tails this heavy if the stated family were true.
        paper: Whether the stated family is that of Eq. (18).
        profile: Log likelihood at each of `_WIDTHS`, maximised over the families, shape (k,).
        widest: Variance of a reading where the beam makes it largest, over the stated one [1].
        reach: Fraction of its mistakes in each range of `_REACH`, shape (f, w).
        states: The states of the poses.
        noisy: Probability that each of them is in a spell, under each family, shape (f, t).
        loosest: The target that scatters most; None where there is one target only.
    """

    weight: Array
    log_scale: Array
    mistakes: Array
    p_value: float
    paper: bool
    profile: Array = field(default_factory=lambda: np.zeros(len(_WIDTHS)))
    widest: float = 1.0
    reach: Array = field(default_factory=lambda: np.tile(np.eye(len(_REACH))[-1], (_FAMILIES, 1)))
    states: States = field(default_factory=States.none)
    noisy: Array = field(default_factory=lambda: np.zeros((_FAMILIES, 0)))
    loosest: LoosestTarget | None = None

    @property
    def heavy(self) -> float:
        """Probability that the tails are heavier than stated."""
        return float(self.weight[1:].sum())

    @property
    def likely_heavy(self) -> bool:
        """Whether tails heavier than stated are more likely than not."""
        return self.heavy > PRESENT

    @property
    def in_spells(self) -> bool:
        """Whether the noise comes in spells."""
        return float(self.weight[_SPELL].sum()) > PRESENT

    @property
    def rather(self) -> Family:
        """This family if heavier tails are more likely than not, else the stated one."""
        return self if self.likely_heavy else replace(self, weight=np.eye(len(self.weight))[0])

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the likeliest Student distribution."""
        return FREEDOM[int(np.argmax(self.weight[1 : 1 + len(FREEDOM)]))]

    def core(self, used: float) -> _Core:
        """Width of the core, with the tails that are likeliest for it.

        p = P[chi2(1) > 2 (max L - L_0)] / 2 where s is larger than stated, else 1 minus that: L is
        the profile, L_0 its value at the stated width, s = 1 / used, or at the narrowest trial
        width.

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
        """The stated family with certainty."""
        none = np.zeros(_FAMILIES)
        usual = float(np.exp(np.mean(np.log(_MISTAKES))))
        return cls(np.append(1.0, none[1:]), none, none + usual, 1.0, paper)

    def mistaken(
        self,
        square: float,
        axes: int = 3,
        state: tuple[int, int] | None = None,
        near: Sequence[tuple[float, float]] = (),
    ) -> float:
        """Probability that a reading this far off is a blunder and not part of this family.

        Args:
            square: Squared error in standard uncertainties, as stated or, where readings scatter
                more, as found.
            axes: Number of coordinates that the square is the sum of.
            state: Its key in `States`; None for a reading of the base.
            near: Of each other reading of its round of the base its square, and the number of
                coordinates that the square tells of.
        """
        quiet, wide, odd = self._likely(np.array([[square, axes]]))[:, :, 0]
        noisy = self._noisy(np.array([state or _NO_STATE]))[:, 0]
        if near:  # a round is of no state: it is in a spell if its own readings say so
            others = self._likely(np.array(near))
            gain = np.log((others[1] + others[2]) / (others[0] + others[2])).sum(axis=1)
            noisy[_SPELL] = special.expit(gain[_SPELL] + special.logit(_SHARES))
        return float(self.weight @ ((1 - noisy) * odd / (odd + quiet) + noisy * odd / (odd + wide)))

    def _likely(self, off: Array) -> Array:
        """Likelihood outside of spells, in one, and as mistakes, shape (3, f, n).

        Args:
            off: Squared error of each, and its number of coordinates, shape (n, 2).
        """
        spread = off[:, :1] / self.widest * np.exp(-_GRID)
        return np.stack(self._laws) @ np.exp(-0.5 * (off[:, 1:] * _GRID + spread)).T

    def _noisy(self, keys: Ints) -> Array:
        """Probability under each family that readings of these states are in a spell, (f, n)."""
        return self.noisy @ self.states.among(keys)

    @property
    def _laws(self) -> tuple[Array, Array, Array]:
        """Probability of each log lambda and of being good, in a spell, or wrong, (f, K) each."""
        part = self.mistakes[:, None]
        odd = np.einsum("fw,wfk->fk", self.reach, _blunders(self.log_scale))
        quiet, wide = _bulks(self.log_scale, self.paper)
        return (1 - part) * quiet, (1 - part) * wide, part * odd

    def away(self, distance: float, others: Array, keys: Ints) -> Array:
        """Mean probability of readings this far off, mistakes excluded, shape (f,).

        x ~ N(0, lambda + S) in each coordinate, its squares over max(1, S) summed. Only families
        with a weight of at least a hundredth are returned.

        Args:
            distance: In standard uncertainties [1].
            others: Variance S of each reading's prediction from the others, shape (n, 3).
            keys: Its pose and pull as in `States`, shape (n, 2).
        """
        unit = np.maximum(others, 1.0)
        widest = ((np.exp(_GRID)[:, None, None] + others) / unit).max(axis=2)
        each = special.chdtrc(3, distance**2 / widest)
        laws = _bulks(self.log_scale, self.paper)
        quiet, wide = (law @ each for law in laws)
        for k, (_, width) in enumerate(SPELLS, _FAMILIES - len(SPELLS)):  # the others are as wide
            more = ((np.exp(_GRID)[:, None, None] + width**2 * others) / unit).max(axis=2)
            wide[k] = laws[1][k] @ special.chdtrc(3, distance**2 / more)
        noisy = self._noisy(keys)
        return ((1 - noisy) * quiet + noisy * wide).mean(axis=1)[self.weight >= _COUNTS]

    def among_spells(self, mean: Array, start: Array, away: Array) -> Array:
        """Variances of readings (n,) with which it is asked again where the noise has spells.

        Only those of gross errors change: what a reading says of the spell of its pose is how far
        it is from the others of a quiet pose, and nothing once they are taken to be noisy. The
        farthest of a pose is taken for one of them, as it spoils the estimates of its neighbours.

        Args:
            mean: Their posterior means.
            start: Their first ones.
            away: Squared distance of each from the others, in standard uncertainties.
        """
        pose = self.states.pose[self.states.of]
        most = np.full(len(self.states.key), _SCATTER**2)
        np.maximum.at(most, pose, away)
        return np.where(mean > FAR_OFF**2, mean, np.where(away == most[pose], away * start, start))

    @property
    def width(self) -> float:
        """Width of the core of the likeliest family relative to the noise that was in use [1]."""
        return float(np.exp(self.log_scale[int(np.argmax(self.weight))] / 2))

    def of(self, used: float) -> Family:
        """The same family relative to the stated noise; the noise in use was `used` times that."""
        return replace(self, log_scale=self.log_scale + 2 * np.log(used))

    def drawn(self, keys: Ints, draws: int, rng: np.random.Generator) -> Array:
        """Random lambda of readings (n, 2) of `States`, blunders excluded, shape (n, draws).

        Spells are where they probably were.
        """
        shape = len(keys), draws
        which = rng.choice(len(self.weight), shape, p=self.weight)
        out = 3 * rng.beta(0.5, 1.0, shape) if self.paper else np.ones(shape)
        for k, nu in enumerate(FREEDOM, 1):
            of = which == k
            out[of] *= nu / rng.chisquare(nu, int(of.sum()))
        for k, (part, width) in enumerate(BURSTS, 1 + len(FREEDOM)):
            of = which == k
            out[of] *= np.where(rng.random(int(of.sum())) < part, width**2, 1.0)
        for k, (_, width) in enumerate(SPELLS if self.in_spells else (), _FAMILIES - len(SPELLS)):
            noisy = rng.random((len(self.states.key), draws)) < self.noisy[k][:, None]
            out[(self.states.among(keys).T @ noisy) & (which == k)] *= width**2
        return np.asarray(out * np.exp(self.log_scale[which]))


def _with_spells(found: Family, seen: Array, states: States) -> tuple[Family, Array]:
    """The family with the spells of each pose, and the posterior mean of each reading's lambda.

    Args:
        found: The family.
        seen: As from `likelihood`, shape (n, K).
        states: Of these readings.
    """
    quiet, wide, odd = found._laws
    laws = quiet + odd + linear.TINY, wide + odd + linear.TINY  # readings may be beyond all
    chance = [law @ seen.T for law in laws]  # (f, n)
    mean = [(law * np.exp(_GRID)) @ seen.T / p for law, p in zip(laws, chance, strict=True)]
    noisy = np.zeros((_FAMILIES, len(states.key)))
    noisy[_SPELL] = states.noisy(np.log(chance[1] / chance[0])[_SPELL], _SHARES)
    each = noisy[:, states.of]
    lam = found.weight @ ((1 - each) * mean[0] + each * mean[1])
    return replace(found, states=states, noisy=noisy), np.asarray(lam)


def likelihood(square: Array, variance: Array, now: Array) -> Array:
    """Likelihood of each log lambda of the grid for each reading, shape (n, K), maximum 1.

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


def family(
    seen: Array, states: States, paper: bool, targets: Ints | None = None
) -> tuple[Family, Array]:
    """Estimate the family from the readings, and each reading's lambda.

    p = P[chi2(1) > 2 (L_Student - L_stated)] / 2, L the log likelihoods at their best scale and
    freedom: 1 / nu is at the end of its range under the null (Self and Liang, J. Am. Stat. Assoc.
    82, 1987). Spells count only where they are likelier than not, and if theirs is larger. One
    target that scatters more than the others competes with every family; it gives no weights.

    Args:
        seen: `likelihood` of every reading, shape (n, K).
        states: The states of these readings.
        paper: Whether the stated family is that of Eq. (18).
        targets: Target of each reading, shape (n,); None where one may not be looser than others.
    """
    own, wide = (
        (seen @ law.reshape(-1, seen.shape[1]).T).T.reshape(*law.shape[:2], len(seen))
        for law in _tried(paper)
    )
    each = np.array([[_logs(own, wide, odd, b, states) for odd in _odd(seen)] for b in _MISTAKES])
    each += np.log(_ALIKE)[:, None, None]
    logs = special.logsumexp(each, axis=(0, 1)) - np.log(len(_MISTAKES))  # (f, scales)
    free = special.logsumexp(logs, axis=1) - np.log(len(_WIDTHS))
    if _odds(free)[_SPELL].sum() <= PRESENT:
        logs[_SPELL], free[_SPELL] = -np.inf, -np.inf
    weight, best = _odds(free), logs.max(axis=1)
    scale = _WIDTHS[logs.argmax(axis=1)]
    heavier = np.append(best[1 : 1 + len(FREEDOM)], best[_SPELL])
    p = 0.5 * float(special.chdtrc(1, max(2 * (heavier.max() - best[0]), 0.0)))
    among = special.softmax(special.logsumexp(each, axis=3), axis=(0, 1))
    part = np.einsum("b,bwf->fw", np.array(_MISTAKES), among)
    mistakes, reach = part.sum(axis=1), part / part.sum(axis=1, keepdims=True)
    if 2 * (best[0] - logs[0, np.abs(_WIDTHS).argmin()]) < DECIDES:
        scale[0] = 0.0  # keep the scale that is stated or was found in contrasts
    told = Family(weight, scale, mistakes, p, paper, logs.max(axis=0), reach=reach)
    if targets is not None and len(np.unique(targets)) > 1:
        of_targets = _of_targets(seen, targets, own[0], paper)
        told = replace(told, loosest=_loosest(of_targets, free, float(best[0])))
    return _with_spells(told, seen, states)


def _of_targets(seen: Array, targets: Ints, own: Array, paper: bool) -> Array:
    """Log likelihood where one target is wider and all else as stated, shape (w, scales, t).

    Args:
        seen: As for `family`.
        targets: As for `family`.
        own: Likelihood of each reading as a good one, shape (scales, n).
        paper: As for `family`.
    """
    laws = np.array([[_bursts(*one, scale, paper) for scale in _WIDTHS] for one in TARGETS])
    wide, which, each = laws @ seen.T, np.eye(int(targets.max()) + 1)[targets], []
    for part, (odd, alike) in product(_MISTAKES, zip(_odd(seen), _ALIKE, strict=True)):
        quiet = np.log((1 - part) * own + part * odd[0] + 1e-300)
        noisy = np.log((1 - part) * wide + part * odd[0] + 1e-300)
        each.append(quiet.sum(axis=1)[:, None] + (noisy - quiet) @ which + np.log(alike))
    return np.asarray(special.logsumexp(each, axis=0) - np.log(len(_MISTAKES)))


def _loosest(logs: Array, free: Array, stated: float) -> LoosestTarget:
    """The likeliest target, against every family and all other targets.

    A priori a law of one target is as likely as any law of all readings that is not as stated.

    Args:
        logs: As from `_of_targets`.
        free: Log likelihood of each family, shape (f,).
        stated: That of the stated one at its best scale.
    """
    widths, scales, count = logs.shape
    mine = special.logsumexp(logs, axis=(0, 1)) - np.log(widths * scales * count)
    odds = special.softmax(np.append(mine + np.log(_BEFORE[1:].sum()), free + np.log(_BEFORE)))
    best = int(np.argmax(mine))
    part, more = TARGETS[int(np.argmax(logs[:, :, best].max(axis=1)))]
    width = float(np.sqrt(1 - part + part * more**2))
    p = 0.5 * count * float(special.chdtrc(1, max(2 * (logs.max() - stated), 0.0)))
    return LoosestTarget(best, width, float(odds[best]), min(p, 1.0))


_BEFORE = np.append(1 - np.count_nonzero(~_SPELL[1:]) * _OTHER, np.full(_FAMILIES - 1, _OTHER))
"""Prior probability of each family [1], shape (f,)."""


def _odds(free: Array) -> Array:
    """Probability of each family by its log likelihood, shape (f,)."""
    return np.asarray(special.softmax(free + np.log(_BEFORE)))


@cache
def _tried(paper: bool) -> Array:
    """`_bulks` at every scale, shape (2, f, widths, K)."""
    return np.stack([_bulks(np.full(_FAMILIES, scale), paper) for scale in _WIDTHS], axis=2)


def _bulks(log_scale: Array, paper: bool) -> Array:
    """Probability of each log lambda under each family, blunders excluded, shape (2, f, K).

    Of a reading of a quiet pose, and of one in a spell; they differ where there are spells only.
    """
    scale = iter(log_scale.tolist())
    stated = [_stated(next(scale), paper)]
    student = [_student(nu, next(scale), paper) for nu in FREEDOM]
    bursts = [_bursts(part, width, next(scale), paper) for part, width in BURSTS]
    spells = [(next(scale), 2 * np.log(width)) for _, width in SPELLS]
    quiet = [_stated(one, paper) for one, _ in spells]
    wide = [_stated(one + more, paper) for one, more in spells]
    both = [*stated, *student, *bursts]
    return np.stack([np.stack([*both, *quiet]), np.stack([*both, *wide])])


def _stated(log_scale: float, paper: bool) -> Array:
    """Probability of each log lambda of the grid under the stated family, shape (K,)."""
    if paper:  # density of 3 s^2 b in log lambda, b ~ Beta(1/2, 1): sqrt(b) / 2
        share = np.exp(_GRID - log_scale) / 3
        return _normed(np.where(share <= 1, np.sqrt(share), 0.0))
    return np.eye(len(_GRID))[int(np.argmin(np.abs(_GRID - log_scale)))]


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
    """Least log lambda of a mistake: `_SCATTER` standard uncertainties without bursts, (f,)."""
    own = np.ones(_FAMILIES)
    own[1 : 1 + len(FREEDOM)] = [nu / (nu - 2) for nu in FREEDOM]
    return np.asarray(log_scale + np.log(_SCATTER**2 * own))


def _blunders(log_scale: Array) -> Array:
    """Probability of each log lambda of mistakes in each range of `_REACH`, shape (w, f, K)."""
    above = _GRID - _least(log_scale)[:, None]
    reach = np.array(_REACH)[:, None, None]
    return np.asarray(((above > -0.5 * _STEP) & (above < reach - 0.5 * _STEP)) * _STEP / reach)


def _odd(seen: Array) -> Iterator[Array]:
    """For each of `_REACH`: likelihood of every reading as a mistake, shape (f, scales, n)."""
    summed = np.vstack([np.zeros(len(seen)), np.cumsum(seen.T, axis=0)])
    start = np.array(
        [np.searchsorted(_GRID + 0.5 * _STEP, _least(np.full(_FAMILIES, s))) for s in _WIDTHS]
    ).T
    for reach in _REACH:
        end = np.minimum(start + round(reach / _STEP), len(_GRID))
        yield (summed[end] - summed[start]) * _STEP / reach


def _logs(own: Array, wide: Array, odd: Array, part: float, states: States) -> Array:
    """Log likelihood of all readings, a fraction `part` of them mistakes, shape (f, scales).

    Args:
        own: Likelihood of each as a good one outside of spells, shape (f, scales, n).
        wide: The same in a spell.
        odd: The same as a mistake.
        part: Fraction of mistakes.
        states: The states of the readings.
    """
    quiet = np.log((1 - part) * own + part * odd + 1e-300)
    noisy = np.log((1 - part) * wide[_SPELL] + part * odd[_SPELL] + 1e-300)
    logs = quiet.sum(axis=2)
    logs[_SPELL] += states.ratio(noisy - quiet[_SPELL], _SHARES[:, None])
    return np.asarray(logs)


def _normed(share: Array) -> Array:
    return np.asarray(share / share.sum())
