"""Laws that nobody listed, where the catalogue leaves structure in the displacements.

Thousands of columns (`effects/unlisted.py`) stand beside the springs, or beside the causes that the
catalogue offers. A law may join the suspects only if the largest statistic of all of them is as
large neither by scatter nor by structure that has nothing to do with it:

- scatter: p = 1 - (1 - p_F)^m, m the number of independent tests that draws of the noise model find
  (`detect.threshold`),
- structure: the residuals of whole poses with their signs flipped, which keeps what the pulls of a
  pose share and destroys what depends on where the robot stands (decision 27).

From there on it is a suspect like any other: it must beat the listed causes on the evidence, with
odds that hold all that was tried, and predict poses that were left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.bootstrap import interval
from pipeline.diagnosis.identify import WORTH, Found, SearchCase, extends, given, search
from pipeline.diagnosis.verdict import CERTAIN
from pipeline.machine.cell import load
from pipeline.machine.effect import Effect
from pipeline.machine.effects import unlisted
from pipeline.machine.effects.nameless import NAMELESS, nameless
from pipeline.system import alarms
from pipeline.system.beside import Base
from pipeline.system.detect import threshold
from pipeline.system.evidence import Scores
from pipeline.system.whitened import Whitened

_FLIPS = 3000
"""Copies whose poses have other signs: the smallest p is a third of `alarms.LAW`."""

_COUNTED = 20
"""Parts up to which copies are drawn without replacement: beyond, one in 2^20 is the campaign."""

_DRAWS = 1000
"""Draws of scatter."""

_WITHIN = 7.0
"""Laws within so much log evidence of the best one (1000 to 1) may be in its place."""

_FORMS = 6
"""So many laws of one place: what aliases with the wave that is there, on few poses, is carried."""

_MOST = 6
"""So many places."""

_SEED = 20261123
"""Of draws of its own, so that campaigns without such laws draw what they drew."""


def beyond(case: SearchCase, found: Found, start: Array) -> tuple[SearchCase, Found]:
    """The case and what is found in it, with laws that nobody listed among the suspects.

    Whether the catalogue explains the data is asked of the laws, too: what its own tests do not
    see may stand out in one of theirs, whether nothing was detected or a listed cause takes a part.

    The same as before where nothing generated is found beside what the catalogue offers, or where
    that does not predict left-out poses better.

    Args:
        case: The case.
        found: What the catalogue makes of it.
        start: Compliances to begin with.
    """
    rng, every = np.random.default_rng(_SEED), _every(case, found)
    if open_(found, rng) or _likely(case, found, found.accepted, every, rng):
        case, found = _extended(*_searched(case, found, (), every, start, rng), start, rng)
        if found.accepted:
            again = _searched(case, found, found.accepted, every, start, rng)
            case, found = _extended(*again, start, rng)
    return case, found


def _extended(
    case: SearchCase, found: Found, start: Array, rng: np.random.Generator
) -> tuple[SearchCase, Found]:
    """With further shapes of the accepted laws among the suspects, where they are found.

    They are sought beside these laws alone: what else was accepted may be what a law lacks.
    """
    mine = tuple(i for i in found.accepted if case.suspects[i].law is not None)
    model = found.first.model
    loaded = load(model.cell, case.data.pulls, model.values)
    laws = [case.suspects[i] for i in mine]
    every = [unlisted.extensions(case.cell.robot, loaded, one) for one in laws]
    return _searched(case, found, mine, tuple(chain(*every)), start, rng)


def _every(case: SearchCase, found: Found) -> tuple[Effect, ...]:
    """All laws, with the odds of what has no name shared among them."""
    model, robot = found.first.model, case.cell.robot
    loaded = load(model.cell, case.data.pulls, model.values)
    return unlisted.effects(robot, loaded, NAMELESS * len(nameless(robot)))


def _searched(
    case: SearchCase,
    found: Found,
    beside: tuple[int, ...],
    every: tuple[Effect, ...],
    start: Array,
    rng: np.random.Generator,
) -> tuple[SearchCase, Found]:
    """With laws among the suspects, where one is accepted and carries over to other poses."""
    laws = _likely(case, found, beside, every, rng)
    if not laws:
        return case, found
    wider = replace(case, suspects=case.suspects + tuple(laws), nameless=())
    other = search(wider, start, rng)
    new = _named(wider, other) - _named(case, found)
    if not new or not _carries(wider, other, rng):
        return case, found
    before = dict(zip((case.suspects[i] for i in found.accepted), found.p_values, strict=True))
    chance = [(before | laws).get(wider.suspects[i], 0.0) for i in other.accepted]
    p_values = tuple(map(max, other.p_values, chance))
    return wider, replace(other, p_values=p_values)


def open_(found: Found, rng: np.random.Generator) -> bool:
    """Whether something was detected that the catalogue does not certainly explain.

    It leaves something, something nameless may stand there, or left-out poses are not certainly
    predicted better.
    """
    if not found.detected:
        return False
    stranger = found.stranger.probability if found.stranger else 0.0
    return (
        not found.explains
        or stranger > 1 - CERTAIN
        or _gain(found.plain, np.zeros(0, dtype=np.int64), rng) <= 0
    )


def _gain(
    view: Whitened, kept: Ints, rng: np.random.Generator, tests: Bools | slice = slice(None)
) -> float:
    """Lower end of the 95 % interval of what a model gains over some columns of its causes.

    By the cross-validation error, all estimated without each pose, poses drawn with replacement.
    """
    base = np.concatenate([np.arange(view.first), kept])
    before, after = view.left_out(base), view.left_out(view.base)
    pose = np.unique(view.pose[: len(view.rows)][tests], return_inverse=True)[1]
    return interval(before[tests], after[tests], pose, rng)[1][0]


def _named(case: SearchCase, found: Found) -> set[tuple[str, str]]:
    effects = [case.suspects[i] for i in found.accepted]
    return {(one.label, one.form) for one in effects if one.law is not None}


def _likely(
    case: SearchCase,
    found: Found,
    beside: tuple[int, ...],
    laws: tuple[Effect, ...],
    rng: np.random.Generator,
) -> dict[Effect, float]:
    """Laws that chance does not make beside some causes, likeliest first, each with that chance.

    Args:
        case: The case.
        found: What is found in it.
        beside: Causes of the base.
        laws: All that are tried.
        rng: Source of the draws.
    """
    if not laws:
        return {}
    view, first = _view(case, found, beside, laws), len(beside)
    now = given(view.suspects, view.beside(view.base), range(first))
    evidence, p = now.log_evidence[first:], now.p()[first:]
    if not ((evidence > WORTH) & (p < alarms.LAW)).any():  # among many it is no rarer
        return {}
    limit = threshold(view, view.base, now.dof, rng, _DRAWS)
    by_scatter = -np.expm1(limit.independent * np.log1p(-np.minimum(p, 1 - 1e-15)))
    able = (evidence > WORTH) & (by_scatter < alarms.LAW)
    if not able.any():
        return {}
    fresh = [one.law is None or one.law.more is None for one in laws]
    by_structure = np.where(fresh, _by_structure(view, now, rng)[first:], 0.0)
    chance = np.maximum(by_scatter, by_structure)
    able &= chance < alarms.LAW
    if not able.any():
        return {}
    able &= evidence > evidence[able].max() - _WITHIN
    ranked = [int(i) for i in np.argsort(-evidence, kind="stable") if able[i]]
    robot = case.cell.robot
    return {unlisted.worded(robot, laws[i]): float(chance[i]) for i in _with_room(laws, ranked)}


def _with_room(laws: Sequence[Effect], ranked: Sequence[int]) -> Iterator[int]:
    """Of some laws, the likeliest first, so many places and so many forms of each."""
    of: Counter[str] = Counter()
    for i in ranked:
        label = laws[i].label
        if 0 < of[label] < _FORMS or (label not in of and len(of) < _MOST):
            of[label] += 1
            yield i


def _view(
    case: SearchCase, found: Found, accepted: tuple[int, ...], laws: tuple[Effect, ...]
) -> Whitened:
    """The campaign beside some causes, with every law as a suspect behind them.

    Those that are listed hold to their tolerance only: what is within it needs no further law. What
    a law lacks that nobody listed, its further shapes say (`_extended`).
    """
    few, every = case.only(accepted), tuple(range(len(accepted)))
    near = found.seen if accepted else found.first.seen
    if accepted in ((), found.accepted):
        model = few.model(every, near.model.values)
    else:
        model = few.estimated(every, near.model.values[: case.cell.robot.n], near)
    listed = [i for i in every if few.suspects[i].law is None]
    return few.whitened(few.linearised(model, near).beside(laws), listed)


def _by_structure(view: Whitened, now: Scores, rng: np.random.Generator) -> Array:
    """Chance of so much anywhere with the residuals of whole poses at random signs, (n,).

    T_j = g' N^+ g of each copy, g = sum over poses of s_p D_p' P y. Blocks of other ranks compare
    by -dof / 2 ln(1 - T / rest) - rank / 2 ln dof (Schwarz, Annals of Statistics 6, 1978), rest
    being what the base leaves of the copy: it explains more of one than of y, which it was fitted
    to, and against the rest of y chance would pass for a law more often than stated.
    """
    base = Base.of(view.A[:, view.base], view.A[:, -1])
    left = base.blocks.rows(base.left)
    D = base.beyond(view.A[:, view.first : view.first + len(view.owner)])
    parts, known = (_of_poses(view, X * left[:, None]) for X in (D, base.blocks.rows(base.Q)))
    signs = _signs(len(parts), rng)
    rest = base.rest - np.sum((signs @ known) ** 2, axis=1)
    at = view.at
    size, axes = linear.directions(now.cov)
    g = parts[:, np.maximum(at - view.first, 0)] * (at >= 0)
    half = np.einsum("pni,nij->pnj", g, axes) * np.sqrt(np.maximum(size, 0.0))
    most = np.full(len(signs), -np.inf)
    for rank in np.unique(now.rank[now.rank > 0]):
        mine = half[:, now.rank == rank]
        drop = np.sum(
            (signs @ mine.reshape(len(parts), -1)).reshape(len(signs), -1, at.shape[1]) ** 2, axis=2
        )
        most = np.maximum(most, _likelihood(drop.max(axis=1) / rest, rank, now.dof))
    own = _likelihood(now.drop / now.rest, now.rank, now.dof)
    return np.asarray((1 + (most[:, None] >= own * (1 - 1e-9)).sum(axis=0)) / (1 + len(signs)))


def _signs(n: int, rng: np.random.Generator) -> Array:
    """Other signs of n parts, shape (c, n), no two alike up to a common sign, none all alike.

    The data themselves among the copies of few poses would be counted as their own rivals.
    """
    if n > _COUNTED:
        return np.asarray(rng.choice([-1.0, 1.0], (_FLIPS, n)))
    drawn = 1 + rng.permutation(2 ** (n - 1) - 1)[:_FLIPS]
    return np.asarray(1.0 - 2.0 * (drawn[:, None] >> np.arange(n) & 1), dtype=float)


def _of_poses(view: Whitened, rows: Array) -> Array:
    """Sums over the rows of each pose, (p + 1, any); those of priors, pose -1, are the last."""
    sums = np.zeros((view.poses + 1, rows.shape[1]))
    np.add.at(sums, view.pose, rows)
    return sums


def _likelihood(share: Array, rank: Array | Ints, dof: int) -> Array:
    """Gain in log likelihood of parts of the sum of squares, less its expectation by chance."""
    explained = np.clip(share, 0.0, 1 - 1e-12)
    return np.asarray(-0.5 * dof * np.log1p(-explained) - 0.5 * rank * np.log(dof))


def _carries(case: SearchCase, found: Found, rng: np.random.Generator) -> bool:
    """Whether every accepted law makes left-out poses better, estimated without each of them.

    At 95 %, poses drawn with replacement, beside all else that is accepted; all of them, or those
    at which the law is taught also without them.
    """
    laws = [i for i in found.accepted if case.suspects[i].law is not None]
    return all(_carried(case, found, law, rng) for law in laws)


def _carried(case: SearchCase, found: Found, law: int, rng: np.random.Generator) -> bool:
    """The same of one law."""
    rest, taught = _without(case, found, law), _taught(case, found, law)
    if _gain(found.plain, rest, rng) > 0:
        return True
    return not taught.all() and _gain(found.plain, rest, rng, taught) > 0


def _taught(case: SearchCase, found: Found, law: int) -> Bools:
    """Readings of poses at which a law is taught also without them, shape (m,).

    Beyond the others' range it states nothing but that it is uncertain (`unlisted.beyond`): an
    error there is none of the law.
    """
    view, one = found.plain, case.suspects[law].law
    pose = view.pose[: len(view.rows)]
    if one is None or not unlisted.follows(one):
        return np.ones(len(pose), dtype=bool)
    model, pulls = found.seen.model, case.data.pulls
    v = unlisted.variable(one, load(model.cell, pulls, model.values))[view.rows.pull]
    inside = np.zeros(len(pose), dtype=bool)
    for k in np.unique(pose):
        own, others = v[pose == k], v[pose != k]
        inside[pose == k] = (own >= others.min()) & (own <= others.max())
    return inside


def _without(case: SearchCase, found: Found, law: int) -> Ints:
    """Columns of all that is accepted but a law; but its last shape, where it extends another."""
    view, one = found.plain, case.suspects[law]
    rest = view.columns([i for i in found.accepted if i != law])
    less = (len(other.parameters) for other in case.suspects if extends(one, other))
    return np.concatenate([rest, view.columns([law])[: next(less, 0)]])
