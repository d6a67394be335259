"""Laws outside the catalogue, where this leaves structure in the displacements.

Thousands of columns (`effects/unlisted.py`) are tested in addition to the springs, or to the causes
of the catalogue. A law may join the suspects only if the largest statistic of all of them is
explained neither by scatter nor by structure unrelated to it:

- scatter: p = 1 - (1 - p_F)^m, with m the number of independent tests according to draws of the
  noise model (`detect.threshold`),
- structure: the residuals of whole poses with flipped signs, which keep what the pulls of a pose
  have in common and destroy any dependence on the robot's configuration (decision 27).

From then on it is a suspect like any other: its evidence must exceed that of the catalogue's
causes, with prior odds that account for all that was tried, and it must improve predictions of
left-out poses.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, compared
from pipeline.diagnosis.cause_search import (
    SearchResult,
    SearchTask,
    extends,
    search,
    statistics_given,
)
from pipeline.diagnosis.verdict import CERTAIN
from pipeline.machine.cell import load
from pipeline.machine.effect import Effect
from pipeline.machine.effects import unlisted
from pipeline.machine.effects.nameless import NAMELESS, nameless
from pipeline.system import alarms
from pipeline.system.detect import threshold
from pipeline.system.evidence import LEAST_EVIDENCE, Scores
from pipeline.system.score_tests import Base
from pipeline.system.whitened import Whitened

_FLIPS = 3000
"""Number of copies with flipped signs of poses: the smallest p is a third of `alarms.LAW`."""

_COUNTED = 20
"""Number of parts up to which copies are drawn without replacement; above it, only one in 2^20
copies equals the data."""

_DRAWS = 1000
"""Number of draws of scatter."""

_WITHIN = 7.0
"""Difference in log evidence from the best law up to which a law is kept [1], 1000 to 1."""

_FORMS = 6
"""Maximum number of laws kept of one place; on few poses, aliases of the true wave are among
them."""

_MOST = 6
"""Maximum number of places kept."""

_SEED = 20261123
"""Seed of separate draws, so that campaigns without such laws keep their other draws."""


def with_unlisted_laws(
    task: SearchTask, found: SearchResult, start: Array
) -> tuple[SearchTask, SearchResult]:
    """Extend the suspects by laws outside the catalogue, and search again.

    Laws are also tested where the catalogue explains the data: what its own tests do not see may
    stand out in one of theirs, whether nothing was detected or a listed cause absorbed a part.

    Where no law is found in addition to the catalogue, or where the laws do not improve predictions
    of left-out poses, the result keeps only how improbable the likeliest of them is by scatter.

    Args:
        task: What stays the same during the search.
        found: Result with the catalogue.
        start: Initial compliances.
    """
    rng, every = np.random.default_rng(_SEED), _every(task, found)
    before, beyond = found, 1.0
    if not _open_(found, rng):
        laws, beyond = _likely(task, found, found.accepted, every, rng)
        if not laws:
            return task, replace(found, beyond=beyond)
    task, found = _extended(*_searched(task, found, (), every, start, rng), start, rng)
    if found.accepted:
        again = _searched(task, found, found.accepted, every, start, rng)
        task, found = _extended(*again, start, rng)
    return task, replace(found, beyond=beyond) if found is before else found


def _extended(
    task: SearchTask, found: SearchResult, start: Array, rng: np.random.Generator
) -> tuple[SearchTask, SearchResult]:
    """Add further shapes of the accepted laws to the suspects, where they are significant.

    They are sought given these laws alone: other accepted causes may be what a law lacks.
    """
    mine = tuple(i for i in found.accepted if task.suspects[i].law is not None)
    model = found.first.model
    loaded = load(model.cell, task.data.pulls, model.values)
    laws = [task.suspects[i] for i in mine]
    every = [unlisted.extensions(task.cell.robot, loaded, one) for one in laws]
    return _searched(task, found, mine, tuple(chain(*every)), start, rng)


def _every(task: SearchTask, found: SearchResult) -> tuple[Effect, ...]:
    """All laws, sharing the prior odds of the nameless among them."""
    model, robot = found.first.model, task.cell.robot
    loaded = load(model.cell, task.data.pulls, model.values)
    return unlisted.effects(robot, loaded, NAMELESS * len(nameless(robot)))


def _searched(
    task: SearchTask,
    found: SearchResult,
    beside: tuple[int, ...],
    every: tuple[Effect, ...],
    start: Array,
    rng: np.random.Generator,
) -> tuple[SearchTask, SearchResult]:
    """Result with laws among the suspects, if one is accepted and carries over to other poses."""
    laws, _ = _likely(task, found, beside, every, rng)
    if not laws:
        return task, found
    wider = replace(task, suspects=task.suspects + tuple(laws), nameless=())
    other = search(wider, start, rng)
    new = _named(wider, other) - _named(task, found)
    if not new or not _carries(wider, other, rng):
        return task, found
    before = dict(zip((task.suspects[i] for i in found.accepted), found.p_values, strict=True))
    chance = [(before | laws).get(wider.suspects[i], 0.0) for i in other.accepted]
    p_values = tuple(map(max, other.p_values, chance))
    return wider, replace(other, p_values=p_values)


def _open_(found: SearchResult, rng: np.random.Generator) -> bool:
    """Whether something was detected that the catalogue does not certainly explain.

    This is so if something is left, if something nameless may take a cause's place, or if left-out
    poses are not certainly predicted better.
    """
    if not found.detected:
        return False
    stranger = found.stranger.probability if found.stranger else 0.0
    return (
        not found.explains
        or stranger > 1 - CERTAIN
        or found.plain.unproven(np.zeros(0, dtype=np.int64), rng) > 0
    )


def _named(task: SearchTask, found: SearchResult) -> set[tuple[str, str]]:
    return {(e.label, e.form) for i in found.accepted if (e := task.suspects[i]).law is not None}


def _likely(
    task: SearchTask,
    found: SearchResult,
    beside: tuple[int, ...],
    laws: tuple[Effect, ...],
    rng: np.random.Generator,
) -> tuple[dict[Effect, float], float]:
    """Laws that are significant given some causes, likeliest first, each with its p-value.

    And the smallest p-value by scatter alone of all that are likelier than not.

    Args:
        task: What stays the same during the search.
        found: Result of the search.
        beside: Causes of the base.
        laws: All laws that are tried.
        rng: Source of the draws.
    """
    if not laws:
        return {}, 1.0
    view, first = _view(task, found, beside, laws), len(beside)
    now = statistics_given(view.suspects, view.beside(view.base), range(first))
    evidence, p = now.log_evidence[first:], now.p()[first:]
    if not ((evidence > LEAST_EVIDENCE) & (p < alarms.LAW)).any():  # the family's p is not smaller
        return {}, 1.0
    limit = threshold(view, view.base, now.dof, rng, _DRAWS)
    by_scatter = -np.expm1(limit.independent * np.log1p(-np.minimum(p, 1 - 1e-15)))
    able = (evidence > LEAST_EVIDENCE) & (by_scatter < alarms.LAW)
    if not able.any():
        return {}, 1.0
    beyond = float(by_scatter[able].min())
    fresh = [one.law is None or one.law.more is None for one in laws]
    by_structure = np.where(fresh, _by_structure(view, now)[first:], 0.0)
    chance = np.maximum(by_scatter, _least_of_place(laws, np.where(able, by_structure, 1.0)))
    able &= chance < alarms.LAW
    if not able.any():
        return {}, beyond
    able &= evidence > evidence[able].max() - _WITHIN
    ranked = [int(i) for i in np.argsort(-compared(evidence), kind="stable") if able[i]]
    robot = task.cell.robot
    kept = _with_room(laws, ranked)
    return {unlisted.worded(robot, laws[i]): float(chance[i]) for i in kept}, beyond


def _least_of_place(laws: Sequence[Effect], chance: Array) -> Array:
    """For each law the least chance of all laws of its place, shape (n,).

    That something there follows a law is what structure tells; which law it is, the evidence does.
    """
    places, of = np.unique([one.label for one in laws], return_inverse=True)
    least = np.full(len(places), np.inf)
    np.minimum.at(least, of, chance)
    return least[of]


def _with_room(laws: Sequence[Effect], ranked: Sequence[int]) -> Iterator[int]:
    """The first laws of a ranking, up to `_MOST` places and `_FORMS` forms of each."""
    of: Counter[str] = Counter()
    for i in ranked:
        label = laws[i].label
        if 0 < of[label] < _FORMS or (label not in of and len(of) < _MOST):
            of[label] += 1
            yield i


def _view(
    task: SearchTask, found: SearchResult, accepted: tuple[int, ...], laws: tuple[Effect, ...]
) -> Whitened:
    """The campaign given some causes, with every law as a further suspect.

    Causes of the catalogue are valid within their tolerance only: what lies within it needs no
    further law. What an accepted law lacks is for its further shapes (`_extended`).
    """
    few, every = task.only(accepted), tuple(range(len(accepted)))
    near = found.seen if accepted else found.first.seen
    if accepted in ((), found.accepted):
        model = few.model(every, near.model.values)
    else:
        model = few.estimated(every, near.model.values[: task.cell.robot.n], near)
    listed = [i for i in every if few.suspects[i].law is None]
    return few.whitened(few.linearised(model, near).beside(laws), listed)


def _by_structure(view: Whitened, now: Scores) -> Array:
    """Probability of as large a statistic anywhere, given random signs of poses' residuals, (n,).

    The same signs each time: a law that was significant is so when it is asked again.

    T_j = g' N^+ g of each copy, g = sum over poses of s_p D_p' P y. Blocks of different ranks are
    compared by -dof / 2 ln(1 - T / rest) - rank / 2 ln dof (Schwarz, Annals of Statistics 6, 1978),
    with rest the residual of the copy given the base. That is smaller than the residual of y, to
    which the base was fitted; with the latter, chance would pass for a law more often than stated.
    """
    base = Base.of(view.A[:, view.base], view.A[:, -1])
    left = base.blocks.rows(base.left)
    D = base.beyond(view.A[:, view.first : view.first + len(view.owner)])
    parts, known = (_of_poses(view, X * left[:, None]) for X in (D, base.blocks.rows(base.Q)))
    signs = _signs(len(parts), np.random.default_rng(_SEED))
    rest = base.rest - np.sum((signs @ known) ** 2, axis=1)
    at = view.at
    size, axes = linear.directions(now.cov)
    g = parts[:, np.maximum(at - view.first, 0)] * (at >= 0)
    half = np.einsum("pni,nij->pnj", g, axes) * np.sqrt(np.maximum(size, 0.0))
    most = np.full(len(signs), -np.inf)
    for rank in np.unique(now.rank[now.rank > 0]):
        mine = half[:, now.rank == rank]
        each = (signs @ mine.reshape(len(parts), -1)).reshape(len(signs), -1, at.shape[1])
        drop = np.sum(each**2, axis=2)
        most = np.maximum(most, _likelihood(drop.max(axis=1) / rest, rank, now.dof))
    own = _likelihood(now.drop / now.rest, now.rank, now.dof)
    return np.asarray((1 + (most[:, None] >= own * (1 - 1e-9)).sum(axis=0)) / (1 + len(signs)))


def _signs(n: int, rng: np.random.Generator) -> Array:
    """Signs of n parts, shape (c, n): of few parts all different up to sign, none all equal.

    Otherwise the data would be among their own copies and count against themselves.
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
    """Gain in log likelihood by shares of the sum of squares, minus Schwarz's penalty."""
    explained = np.clip(share, 0.0, 1 - 1e-12)
    return np.asarray(-0.5 * dof * np.log1p(-explained) - 0.5 * rank * np.log(dof))


def _carries(task: SearchTask, found: SearchResult, rng: np.random.Generator) -> bool:
    """Whether every accepted law certainly improves predictions of left-out poses.

    At 95 %, poses drawn with replacement, given everything else that is accepted; over all poses,
    or over those whose values lie within the range of the other poses.
    """
    return all(_carried(task, found, i, rng) for i in found.accepted if task.suspects[i].law)


def _carried(task: SearchTask, found: SearchResult, law: int, rng: np.random.Generator) -> bool:
    """Whether one law certainly improves predictions of left-out poses."""
    rest, taught = _without(task, found, law), _taught(task, found, law)
    if not found.plain.unproven(rest, rng):
        return True
    return not taught.all() and not found.plain.unproven(rest, rng, taught)


def _taught(task: SearchTask, found: SearchResult, law: int) -> Bools:
    """Readings of poses whose variable is within the range of all other poses, shape (m,).

    Beyond that range a law only states that it is uncertain (`unlisted.beyond`), so that an error
    there does not count against it.
    """
    view, one = found.plain, task.suspects[law].law
    pose = view.pose[: len(view.rows)]
    if one is None or not unlisted.follows(one):
        return np.ones(len(pose), dtype=bool)
    model, pulls = found.seen.model, task.data.pulls
    v = unlisted.variable(one, load(model.cell, pulls, model.values))[view.rows.pull]
    inside = np.zeros(len(pose), dtype=bool)
    for k in np.unique(pose):
        others = v[pose != k]
        inside[pose == k] = unlisted.outside(v[pose == k], others.min(), others.max()) < 1
    return inside


def _without(task: SearchTask, found: SearchResult, law: int) -> Ints:
    """Columns of everything accepted except a law, or of an extension only its last shape."""
    view, one = found.plain, task.suspects[law]
    rest = view.columns([i for i in found.accepted if i != law])
    less = (len(other.parameters) for other in task.suspects if extends(one, other))
    return np.concatenate([rest, view.columns([law])[: next(less, 0)]])
