"""Cross-validation gain of the causes: poses are left out, and causes chosen again without them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.base.arrays import Array, compared
from pipeline.base.bootstrap import interval
from pipeline.diagnosis.cause_search import (
    SearchTask,
    may_join,
    merged,
    statistics_given,
)
from pipeline.diagnosis.facts import CrossValidation, NamelessEqual, SoleCause
from pipeline.system.elimination import coefficients
from pipeline.system.evidence import LEAST_EVIDENCE
from pipeline.system.whitened import Whitened

_ASKED = 6
"""Number of nameless effects that are tested for predicting as well."""


def alone(
    first: Whitened, likely: Sequence[tuple[int, float]], rng: np.random.Generator
) -> tuple[SoleCause, ...]:
    """Cross-validation error with each of some causes by itself, estimated without each pose.

    Args:
        first: The campaign from the joint springs alone.
        likely: Suspects, each with its probability.
        rng: Source of the bootstrap.
    """
    pose, springs = first.pose[: len(first.rows)], np.arange(first.first)
    before = first.left_out(springs)
    each = [first.left_out(np.concatenate([springs, first.columns([k])])) for k, _ in likely]
    return tuple(
        SoleCause(first.suspects[k], probability, *interval(before, mine, pose, rng))
        for (k, probability), mine in zip(likely, each, strict=True)
    )


def beside(extended: Whitened, others: Sequence[int], rng: np.random.Generator) -> CrossValidation:
    """What is lost without one cause: the model with all of them, and with the others alone."""
    kept = np.concatenate([np.arange(extended.first), extended.columns(others)])
    before, after = extended.left_out(kept), extended.left_out(extended.base)
    pose = extended.pose[: len(extended.rows)]
    return CrossValidation(before, after, *interval(before, after, pose, rng), ())


def as_good(
    wide: Whitened, place: int, known: int, rng: np.random.Generator
) -> tuple[NamelessEqual, ...]:
    """Nameless effects that predict as well in the place of an accepted cause.

    Of those that reduce the sum of squares most, each that certainly reduces the cross-validation
    error and is not certainly worse than the cause (both at 95 %, poses drawn with replacement).
    Unlike the probabilities, which rest on usual magnitudes, this rests on the readings alone.

    Args:
        wide: The campaign whitened at the accepted causes, with the nameless effects.
        place: Index of the accepted cause.
        known: Number of suspects that have a name.
        rng: Source of the bootstrap.
    """
    pose, accepted = wide.pose[: len(wide.rows)], wide.model.accepted
    rest = [a for k, a in enumerate(accepted) if k != place]
    base = np.concatenate([np.arange(wide.first), wide.columns(rest)])
    own = wide.left_out(np.concatenate([base, wide.columns([accepted[place]])]))
    drop, before, out = wide.beside(base).drop[known:], wide.left_out(base), []
    for suspect in known + np.argsort(-compared(drop), kind="stable")[:_ASKED]:
        mine = wide.columns([suspect])
        columns = np.concatenate([base, mine])
        after = wide.left_out(columns)
        reduction, ci95 = interval(before, after, pose, rng)
        _, (_, better) = interval(own, after, pose, rng)
        if ci95[0] > 0 and better > 0:
            times = float(np.abs(coefficients(wide.M, columns)[-len(mine) :]).max())
            out.append(NamelessEqual(wide.suspects[suspect], reduction, ci95, times))
    return tuple(sorted(out, key=lambda one: -compared(one.reduction)))


def gain(
    task: SearchTask, first: Whitened, extended: Whitened, limit: float, rng: np.random.Generator
) -> CrossValidation:
    """Leave out one pose with all its pulls at a time; choose causes and estimate without it.

    Cross-validation with the choice inside each fold (Stone, J. Roy. Stat. Soc. B 36, 1974).

    Args:
        task: What stays the same during the search.
        first: The campaign from the joint springs alone.
        extended: The campaign from the model with the accepted causes.
        limit: P-value below which a cause may join.
        rng: Source of the bootstrap.
    """
    laws = [task.suspects[i].law for i in extended.model.accepted]
    most = sum(1 if law is None else len(law.shapes) for law in laws)
    pose = first.pose[: len(first.rows)]
    before = first.left_out(np.arange(first.first))
    after, chosen = np.zeros(len(pose)), []
    for left in range(first.poses):
        rows, M = pose == left, extended.without(left)
        names = _choose(task, extended, M, most, limit, int(rows.sum()))
        base = np.concatenate([np.arange(extended.first), extended.columns(names)])
        after[rows] = extended.raw[rows, -1] - extended.predicted(base, M, rows)
        chosen.append(tuple(task.suspects[i].label for i in names))
    reduction, ci95 = interval(before, after, pose, rng)
    return CrossValidation(before, after, reduction, ci95, tuple(chosen))


def _choose(
    task: SearchTask, view: Whitened, M: Array, most: int, limit: float, fewer: int
) -> tuple[int, ...]:
    """Causes chosen from the remaining poses, one after the other."""
    names: tuple[int, ...] = ()
    for _ in range(most):
        base = np.concatenate([np.arange(view.first), view.columns(names)])
        now = statistics_given(task.suspects, view.beside(base, M, fewer), names)
        free = [i for i in range(len(task.suspects)) if may_join(task.suspects, names, i)]
        best = free[int(np.argmax(compared(now.log_evidence[free])))]
        if now.log_evidence[best] < LEAST_EVIDENCE or now.p()[best] > limit:
            break
        names = merged(task.suspects, (*names, best))
    return names
