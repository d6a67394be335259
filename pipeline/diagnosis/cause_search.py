"""Search for causes: they join one by one, are exchanged and dropped; rivals keep their odds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import combinations, islice

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, compared
from pipeline.diagnosis.finding import WRONG_LAW
from pipeline.diagnosis.verdict import CERTAIN
from pipeline.machine.cell import Cell
from pipeline.machine.effect import Effect
from pipeline.machine.effects.nameless import NAMELESS
from pipeline.machine.surroundings import Surrounded
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.detect import LackOfFit, Threshold, lack_of_fit, threshold
from pipeline.system.elimination import eliminate
from pipeline.system.evidence import LEAST_EVIDENCE, ROUNDING, Scores
from pipeline.system.linearised import CurrentModel, Linearised, linearise
from pipeline.system.noise_shape import NoiseShape
from pipeline.system.whitened import Whitened, whiten

_MOST = 3
"""Maximum number of causes named at once; more count as an unknown one."""

_BETTER = 0.1
"""Minimum advantage in log evidence by which a cause replaces another [1]; twins, which differ by
rounding, stay."""

_MOVES = 12
"""Maximum number of exchanges that are tried in turn."""

_FIRST = 12
"""Number of the likeliest causes tried as the first of a pair, with every other one as the second:
of two causes that a single one stood for, one stands out by itself."""

_ASKED = 20
"""Maximum number of the best exchanges that are checked for physically possible magnitudes."""

_TRUSTED = 10.0
"""Multiple of the typical magnitudes up to which a model is linearised [1]: of joint 6 and a tilt
of joint 5, which pulls hardly distinguish, each would be thousands, of opposite signs."""

_FURTHER = 0.1
"""Factor on the detection threshold below which a suspect not worth naming contradicts the
model [1]: the residuals were searched once more after each cause that was named."""


@dataclass(frozen=True, eq=False)
class SearchTask:
    """What stays the same during the search for causes.

    Attributes:
        cell: The joint springs model of the campaign, with the equilibrium that fits better.
        data: The measurements.
        suspects: All causes that move something, in all their forms.
        noise: Scatter of the tracker over its stated standard uncertainty.
        certain_noise: The same where it is certainly larger or nothing is stated, else 1; it
            determines the uncertainties of the answer.
        force_noise: Scatter of the scale over its stated one, relative to the tracker's.
        nameless: Effects that compete with the suspects and are never named.
        refuted: Multiples of the typical magnitude that the unloaded or the base reflectors rule
            out, by label.
        shape: Tails and wander of the noise in the data; None where all readings have equal
            weights.
        surroundings: What a proposed pose must avoid; None where not stated.
    """

    cell: Cell
    data: Measured
    suspects: tuple[Effect, ...]
    noise: float
    certain_noise: float = 1.0
    force_noise: float = 1.0
    nameless: tuple[Effect, ...] = ()
    refuted: Mapping[str, float] = field(default_factory=dict)
    shape: NoiseShape | None = None
    surroundings: Surrounded | None = None

    def linearised(self, model: CurrentModel, near: Linearised | None = None) -> Linearised:
        """The campaign linearised at a model; the errors are those of `near` if given."""
        return linearise(model, self.data, self.suspects, near)

    def whitened(
        self, seen: Linearised, doubt: Sequence[int] = (), in_each: bool = True
    ) -> Whitened:
        """The linearised campaign, whitened; laws of `doubt` are valid within tolerance only."""
        return whiten(seen, self.noise, self.force_noise, self.laws(doubt), in_each)

    def without(self, view: Whitened, gone: Set[int]) -> Whitened:
        """The campaign linearised where some accepted causes of a view do not act.

        What would take their place has no part in what they do: beside a cause, a scale that reads
        a fraction otherwise is that cause itself in proportion, as far as all pulls are alike.
        """
        model = view.model
        own = [np.full(len(self.suspects[i].parameters), i not in gone) for i in model.accepted]
        kept = np.concatenate([np.ones(model.springs, dtype=bool), *own])
        there = replace(model, values=np.where(kept, model.values, 0.0))
        return self.whitened(linearise(there, self.data, view.suspects, view.seen))

    def laws(self, doubt: Sequence[int]) -> list[tuple[int, float]]:
        """The suspects `doubt`, each with the relative tolerance of its law."""
        return [(i, self.suspects[i].tolerance) for i in doubt]

    def only(self, accepted: tuple[int, ...]) -> SearchTask:
        """The task with the accepted causes as its only suspects, then numbered 0, 1, 2."""
        return replace(self, suspects=tuple(self.suspects[i] for i in accepted))

    def fitted(
        self, accepted: tuple[int, ...], start: Array, near: Linearised | None = None
    ) -> Linearised:
        """The campaign linearised at the estimate of some causes, as of `estimated`."""
        return self.linearised(self.estimated(accepted, start, near))

    def estimated(
        self,
        accepted: tuple[int, ...],
        start: Array,
        near: Linearised | None = None,
        rounds: int = 4,
    ) -> CurrentModel:
        """Joint springs and accepted causes estimated together, linearised anew in each round.

        Args:
            accepted: Indices of the causes.
            start: Initial values; causes that are missing there start at zero.
            near: The campaign linearised close by, for its errors.
            rounds: Maximum number of rounds.
        """
        model, few = self.model(accepted, start), self.only(accepted)
        for _ in range(rounds):
            near = few.linearised(replace(model, accepted=tuple(range(len(accepted)))), near)
            view = few.whitened(near)
            values = _solved(view)
            step = np.abs(values - model.values) / view.typical[of_model(view)]
            model = replace(model, values=values)
            if np.max(step, initial=0.0) < 1e-3:
                break
        return model

    def model(self, accepted: tuple[int, ...], start: Array) -> CurrentModel:
        """A model with accepted causes; those missing in `start` start at zero."""
        springs = len(self.cell.parameters)
        cell = self.cell.with_effects(*(self.suspects[i] for i in accepted))
        values = np.zeros(len(cell.parameters))
        values[: min(len(start), len(values))] = start[: len(values)]
        return CurrentModel(cell, values, springs, accepted)


def of_model(view: Whitened) -> Ints:
    """Columns of the model's own parameters, in their order."""
    chosen = [view.columns([i]) for i in view.model.accepted]
    return np.concatenate([np.arange(view.springs), *chosen]).astype(np.int64)


def _solved(view: Whitened) -> Array:
    """Estimated parameters of the view's model, SI, one damped step from its values.

    x + (N + 1 / r^2)^-1 (g - N x) in typical magnitudes, r = `_TRUSTED` (Marquardt, J. SIAM 11,
    1963); common errors, which have a prior, are not damped.
    """
    base, mine = view.base, of_model(view)
    own = np.array([k for k, c in enumerate(base) if not view.springs <= c < view.first], np.int64)
    own = own[np.argsort(np.argsort(mine))]  # as in the model, its causes in their order
    N, x = view.M[np.ix_(base, base)], np.zeros(len(base))
    x[own] = view.model.values / view.typical[mine]
    gradient = view.M[base, -1] - N @ x
    N[own, own] += _TRUSTED**-2
    x += linear.inverse(N) @ gradient  # without noise no damping is felt
    return np.asarray(x[own] * view.typical[mine])


@dataclass(frozen=True, eq=False)
class Replacement:
    """One cause that could replace an accepted one.

    Attributes:
        label: Name and place.
        suspect: Index of its best form.
        probability: Probability given that one cause is present in that place.
        forms: Each of its forms with its share of that probability, all forms equally likely a
            priori.
    """

    label: str
    suspect: int
    probability: float
    forms: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True, eq=False)
class NamelessReplacement:
    """Something outside the catalogue that could replace an accepted cause.

    Attributes:
        probability: Probability that it is nothing of the catalogue.
        suspect: Index of the likeliest nameless effect, counted after the suspects.
        places: Which of the accepted causes it replaces by itself.
    """

    probability: float
    suspect: int
    places: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class SearchResult(Locked):
    """Result of the search.

    Attributes:
        seen: The campaign linearised at the joint springs and all accepted causes.
        plain: The same, whitened.
        wide: The same, with the nameless effects.
        view: `plain` with the laws of the accepted causes uncertain by their tolerance.
        first: The campaign whitened at the joint springs alone.
        single: Causes that could be the only one, likeliest first.
        scores: Statistics of the suspects given the joint springs alone.
        threshold: Detection threshold calibrated for them.
        lack_first: Lack of fit of the joint springs alone.
        lack: Lack of fit of the model with the causes.
        left: Smallest p-value of a further suspect.
        accepted: Indices of the accepted suspects.
        p_values: P-value of each accepted cause given all others.
        rivals: For each accepted cause, itself and those that could replace it, likeliest first.
        strange: For each accepted cause, what could replace it from outside the catalogue; empty
            where nothing competes.
        refused: Labels of causes that would need a physically impossible magnitude.
        rough: Remainder ratio with the causes at their best within tolerance; None if unknown.
        beyond: P-value by scatter of the likeliest law outside the catalogue that is not accepted.
    """

    seen: Linearised
    plain: Whitened
    wide: Whitened
    view: Whitened
    first: Whitened
    single: tuple[Replacement, ...]
    scores: Scores
    threshold: Threshold
    lack_first: LackOfFit
    lack: LackOfFit
    left: float
    accepted: tuple[int, ...]
    p_values: tuple[float, ...]
    rivals: tuple[tuple[Replacement, ...], ...]
    strange: tuple[NamelessReplacement, ...]
    refused: tuple[str, ...]
    rough: float | None
    beyond: float = 1.0

    @property
    def detected(self) -> bool:
        """Whether the joint springs alone fail to explain the data."""
        listed = bool(self.scores.p().min() < self.threshold.p)
        return listed or self.lack_first.found or self.structured

    @property
    def structured(self) -> bool:
        """Whether some law stands out of the scatter, but not with certainty as that law."""
        return self.beyond < alarms.STRUCTURE

    @property
    def stranger(self) -> NamelessReplacement | None:
        """The likeliest replacement from outside the catalogue."""
        return max(self.strange, key=lambda one: one.probability, default=None)

    @property
    def explains(self) -> bool:
        """Whether causes are accepted that leave nothing but scatter."""
        return bool(self.accepted) and self.clean and (self.rough or 1.0) <= WRONG_LAW

    @property
    def clean(self) -> bool:
        """Whether nothing is left to explain."""
        return not (self.left < _FURTHER * self.threshold.p or self.lack.found or self.structured)


def remainder(view: Whitened) -> float | None:
    """Remainder ratio of a model: rms residual over rms scatter of the readings, if known."""
    if not view.tells_scatter:
        return None
    base = view.base
    rest = float(eliminate(view.M, base)[-1, -1]) / view.dof(base)
    return float(np.sqrt(max(rest, ROUNDING) / max(view.scatter / view.scatter_dof, ROUNDING)))


def search(task: SearchTask, start: Array, rng: np.random.Generator) -> SearchResult:
    """Add the likeliest cause, exchange and drop, until nothing is left or three are accepted."""
    seen = task.fitted((), start)
    first = task.whitened(seen)
    score = first.beside(first.base)
    limit = threshold(first, first.base, score.dof, rng)
    refused: dict[str, None] = {}
    end = lone = _stand(task, seen, ())
    if lone.p.min() < limit.p or lone.lack.found:
        end = _fewer(task, _grow(task, lone, limit, refused), limit, refused)
    rivals, p_values = _rivals(task, end.plain)
    wide = task.whitened(end.seen.beside(task.nameless))
    return SearchResult(
        seen=end.seen,
        plain=end.plain,
        wide=wide,
        view=end.view,
        first=first,
        single=_odds(task, score, (), 0.0),
        scores=score,
        threshold=limit,
        lack_first=lone.lack,
        lack=end.lack,
        left=float(end.now.p().min()),
        accepted=end.seen.model.accepted,
        p_values=p_values,
        rivals=rivals,
        strange=_strange(task, wide),
        refused=tuple(refused),
        rough=remainder(task.whitened(end.seen, end.seen.model.accepted, in_each=False)),
    )


@dataclass(frozen=True, eq=False)
class _Stand:
    """A set of accepted causes, and the statistics of the others given them.

    Attributes:
        seen: The campaign linearised there.
        plain: The same, whitened.
        view: The same, with the laws of the accepted causes uncertain by their tolerance.
        now: Statistics of the suspects given them, in `view`.
        lack: Lack of fit in `view`.
        p: P-values of the suspects' F tests in `plain`, shape (n,).
    """

    seen: Linearised
    plain: Whitened
    view: Whitened
    now: Scores
    lack: LackOfFit
    p: Array


def _stand(task: SearchTask, seen: Linearised, rough: Sequence[int]) -> _Stand:
    plain = task.whitened(seen)
    view = task.whitened(seen, rough) if rough else plain
    now = statistics_given(task.suspects, view.beside(view.base), seen.model.accepted)
    p = plain.beside(plain.base).p() if rough else now.p()
    return _Stand(seen, plain, view, now, lack_of_fit(view, view.base, now), p)


def _grow(
    task: SearchTask, end: _Stand, limit: Threshold, refused: dict[str, None], most: int = _MOST
) -> _Stand:
    """Add the likeliest cause, then exchange until no move improves; repeat until nothing joins."""
    tried: set[tuple[int, ...]] = {()}
    while len(end.seen.model.accepted) < most and _open(end, limit):
        added = _add(task, end.view, end.now, end.p < limit.p, refused)
        if added is None:
            break
        accepted = merged(task.suspects, (*end.seen.model.accepted, added))
        start = _solved(end.view)
        if len(accepted) == len(end.seen.model.accepted):  # a law was extended
            start = start[: end.view.springs]
        better = _exchange(task, task.fitted(accepted, start, end.seen), limit.p)
        if tuple(sorted(better.model.accepted)) in tried:
            break  # what was added was dropped at once: no further move
        tried.add(tuple(sorted(better.model.accepted)))
        end = _stand(task, better, better.model.accepted)
    return end


def _open(end: _Stand, limit: Threshold) -> bool:
    """Whether something is left to explain."""
    return bool(end.p.min() < limit.p) or end.lack.found


def _fewer(task: SearchTask, end: _Stand, limit: Threshold, refused: dict[str, None]) -> _Stand:
    """Backward search where the maximum number of causes leaves something: add one, then drop.

    A cause that stood for a mixture of others is the first to become dispensable given all of them.
    """
    if len(end.seen.model.accepted) < _MOST or not _open(end, limit):
        return end
    seen = _grow(task, end, limit, dict(refused), _MOST + 1).seen
    while len(seen.model.accepted) > _MOST:
        seen = _dropped(task, seen)
    if set(seen.model.accepted) == set(end.seen.model.accepted):
        return end
    both = end, _stand(task, seen, seen.model.accepted)
    return max(both, key=lambda one: _worth(task, one.plain))


def _worth(task: SearchTask, view: Whitened) -> float:
    """Log evidence of springs and accepted causes, minus `LEAST_EVIDENCE` for each of these.

    Up to a constant of the campaign, wherever it is linearised: p(y | springs) ~ rest^(-dof / 2).
    """
    accepted = view.model.accepted
    alone = _beside(task, view, ())
    springs = -0.5 * alone.dof * float(np.log(alone.rest))
    return springs + _chained(task, view, (), accepted) - LEAST_EVIDENCE * len(accepted)


def _dropped(task: SearchTask, seen: Linearised) -> Linearised:
    """The campaign without the most dispensable cause, after all exchanges from there."""
    accepted, view = seen.model.accepted, task.whitened(seen)
    drops = (next(_moves(task, view, (place,), 0)) for place in range(len(accepted)))
    rest = max(drops, key=lambda move: move.gain).of(task.suspects, accepted)
    return _exchange(task, task.fitted(rest, _solved(view)[: view.springs], seen))


def by_label(suspects: Sequence[Effect]) -> dict[str, list[int]]:
    """Indices of the forms of each cause, by label."""
    out: dict[str, list[int]] = {}
    for i, effect in enumerate(suspects):
        out.setdefault(effect.label, []).append(i)
    return out


def _add(
    task: SearchTask, view: Whitened, now: Scores, found: Bools, refused: dict[str, None]
) -> int | None:
    """The likeliest further cause of a possible magnitude.

    It must be detected beyond the scatter, and keep its evidence when the laws of the accepted ones
    are valid within their tolerance only.
    """
    for i in _likeliest(now):
        if now.log_evidence[i] < LEAST_EVIDENCE:
            return None
        if not found[i] or not may_join(task.suspects, view.model.accepted, int(i)):
            continue
        if _possible(task, now, int(i)):
            return int(i)
        refused[task.suspects[i].label] = None
    return None


def may_join(suspects: Sequence[Effect], accepted: Sequence[int], more: int) -> bool:
    """Whether no cause with its label is accepted, except a law that it extends."""
    one = suspects[more]
    mine = (suspects[i] for i in accepted if suspects[i].label == one.label)
    return all(extends(one, other) for other in mine)


def statistics_given(suspects: Sequence[Effect], now: Scores, beside: Sequence[int]) -> Scores:
    """Statistics given some causes; extensions of an accepted law get their prior odds.

    The prior odds of place and variable, which that law has paid, are not counted twice.
    """
    laws = [i for i in beside if suspects[i].law is not None]
    pairs = [(k, i) for i in laws for k, one in enumerate(suspects) if extends(one, suspects[i])]
    if not pairs:
        return now
    odds = np.zeros(now.g.shape[-2])
    for k, i in pairs:
        odds[k] = -np.log(suspects[i].odds)
    return replace(now, log_odds=now.log_odds + odds)


def merged(suspects: Sequence[Effect], chosen: Sequence[int]) -> tuple[int, ...]:
    """The chosen suspects without laws that others of them extend."""
    return tuple(i for i in chosen if not any(extends(suspects[k], suspects[i]) for k in chosen))


def extends(one: Effect, other: Effect) -> bool:
    """Whether one is a law outside the catalogue, and `other` such a law with fewer shapes."""
    return one.law is not None and other.law is not None and one.law.extends(other.law)


def _likeliest(now: Scores) -> Ints:
    """Suspects by evidence, largest first; twins, equal but for rounding, in catalogue order."""
    return np.argsort(-compared(now.log_evidence), kind="stable")


def _possible(task: SearchTask, now: Scores, suspect: int) -> bool:
    """False if an estimate exceeds its bounds by more than two standard uncertainties and `_SLACK`.

    Bounds are physical, of the size and of the compliance that it changes, and those from the
    unloaded reflectors.
    """
    k = len(task.suspects[suspect].parameters)
    value, std = now.size[suspect, :k], np.sqrt(np.diag(now.cov[suspect]))[:k]
    most = task.refuted.get(task.suspects[suspect].label, np.inf)
    assert now.bounds is not None
    assert now.yielding is not None
    lower, upper = now.bounds[:, suspect, :k]
    slack = 2 * std + _SLACK
    low, high = np.maximum(lower, -most) - slack, np.minimum(upper, most) + slack
    left, spread = now.yielding.distance(now.size, now.cov)
    least = -2 * spread - _SLACK * np.linalg.norm(now.yielding.normal, axis=1)
    return bool(np.all((value > low) & (value < high)) and left[suspect] >= least[suspect])


_SLACK = 0.3
"""Excess over a bound that says nothing, in typical sizes [1]: a law is known to such a part."""


def _exchange(task: SearchTask, seen: Linearised, limit: float = 0.0) -> Linearised:
    """Exchange and drop accepted causes until no move improves the evidence.

    What a move promises where the campaign is linearised it must keep where it is linearised anew:
    beside a gross mistake it promised 60 and lost 80, twelve times in a row.

    Args:
        task: What stays the same during the search.
        seen: The campaign linearised at the initial causes.
        limit: P-value that each of two causes must reach given the other to take the place of one.
    """
    tried, view = {frozenset(seen.model.accepted)}, task.whitened(seen)
    for _ in range(_MOVES):
        better = _better(task, view, tried, limit)
        if better is None:
            break
        tried.add(frozenset(better))
        there = task.fitted(better, _solved(view)[: view.springs], seen)
        if _worth(task, after := task.whitened(there)) > _worth(task, view):
            seen, view = there, after
    return seen


@dataclass(frozen=True)
class _Move:
    """Causes that leave, and those that take their places.

    Attributes:
        gain: Change of log evidence minus `LEAST_EVIDENCE` for each cause, given those that stay.
        out: Places of those that leave.
        into: Their replacement: none, one or two.
    """

    gain: float
    out: tuple[int, ...]
    into: tuple[int, ...]

    def of(self, suspects: Sequence[Effect], accepted: Sequence[int]) -> tuple[int, ...]:
        """The causes after the move, newcomers in the place of the first one that left."""
        at, some = self.out[0], list(accepted)
        for place in reversed(self.out):
            del some[place]
        return merged(suspects, (*some[:at], *self.into, *some[at:]))


def _better(
    task: SearchTask, view: Whitened, tried: Set[frozenset[int]], limit: float = 0.0
) -> tuple[int, ...] | None:
    """The causes after the best possible move to a set not yet tried; None if there is none."""
    for move, after in islice(_untried(task, view, tried, limit), _ASKED):
        least = limit if len(move.into) > len(move.out) else 1.0
        possible = all(_may_stand(task, view, after, i, least) for i in move.into)
        if possible and _gains(task, view, move):
            return after
    return None


def _untried(
    task: SearchTask, view: Whitened, tried: Set[frozenset[int]], limit: float
) -> Iterator[tuple[_Move, tuple[int, ...]]]:
    """Moves that gain to sets not yet tried, the best first, and the causes after them."""
    accepted = view.model.accepted
    most = 2 if limit and len(accepted) < _MOST else 0
    outs = [out for count in (1, 2) for out in combinations(range(len(accepted)), count)]
    gains = [m for out in outs for m in _moves(task, view, out, most) if m.gain > _BETTER]
    for move in sorted(gains, key=lambda one: (-compared(one.gain), one.out, one.into)):
        after = move.of(task.suspects, accepted)
        if frozenset(after) not in tried:
            yield move, after


def _gains(task: SearchTask, view: Whitened, move: _Move) -> bool:
    """Whether a move has a gain where those that leave do not act."""
    if not move.into:
        return True
    gone = [view.model.accepted[place] for place in move.out]
    rest = [a for a in view.model.accepted if a not in gone]
    there = task.without(view, {*gone})
    mine, theirs = (_chained(task, there, rest, causes) for causes in (gone, move.into))
    return theirs - mine > _BETTER + LEAST_EVIDENCE * (len(move.into) - len(gone))


def _may_stand(
    task: SearchTask, view: Whitened, causes: Sequence[int], one: int, limit: float
) -> bool:
    """Whether a cause has a possible magnitude given the others and a p-value within the limit."""
    now = _beside(task, view, tuple(i for i in causes if i != one))
    return bool(now.p()[one] <= limit) and _possible(task, now, one)


def _moves(task: SearchTask, view: Whitened, out: tuple[int, ...], most: int) -> Iterator[_Move]:
    """All moves in which the causes `out` leave and none, one, or a pair takes their places.

    That with none is the first, if any cause is left.
    Pairs are tried where two leave, or where `most` is two: two others then, since one that stays
    and one beside it would be an addition, for which the law of the first is uncertain.
    """
    accepted = view.model.accepted
    gone = [accepted[place] for place in out]
    rest = tuple(a for place, a in enumerate(accepted) if place not in out)
    now = _beside(task, view, rest)
    mine = _chained(task, view, rest, gone) - LEAST_EVIDENCE * len(gone)
    if rest:
        yield _Move(-mine, out, ())
    free = [i for i in range(len(task.suspects)) if may_join(task.suspects, rest, i)]
    for i in free:
        yield _Move(float(now.log_evidence[i]) - LEAST_EVIDENCE - mine, out, (i,))
    if max(len(out), most) > 1:
        stays = [task.suspects[i].label for i in gone if len(out) == 1]
        free = [i for i in free if task.suspects[i].label not in stays]
        for pair, evidence in _in_pairs(task, view, rest, now, free):
            yield _Move(evidence - 2 * LEAST_EVIDENCE - mine, out, pair)


def _in_pairs(
    task: SearchTask, view: Whitened, rest: tuple[int, ...], now: Scores, free: Sequence[int]
) -> Iterator[tuple[tuple[int, int], float]]:
    """Pairs of causes that may join the rest, the likelier one first, with their evidence."""
    for first in _leading(task, now, free):
        already = float(now.log_evidence[first])
        then = _beside(task, view, (*rest, first))
        for i in free:
            if now.log_evidence[i] <= already and may_join(task.suspects, (first,), i):
                yield (first, i), already + float(then.log_evidence[i])


def _leading(task: SearchTask, now: Scores, free: Sequence[int]) -> list[int]:
    """The likeliest causes, each in its best form."""
    best: dict[str, int] = {}
    ordered = _likeliest(now)
    for i in ordered[np.isin(ordered, free)].tolist():
        best.setdefault(task.suspects[i].label, i)
    return list(best.values())[:_FIRST]


def _chained(task: SearchTask, view: Whitened, rest: Sequence[int], causes: Sequence[int]) -> float:
    """Log evidence of causes given others: the likeliest first, each next one given those before.

    It does not depend on the order in which the causes were found.
    """
    total, left, known = 0.0, list(causes), tuple(rest)
    while left:
        now = _beside(task, view, known).log_evidence
        first = max(left, key=lambda i: (compared(now[i]), -i))
        total += float(now[first])
        known = (*known, first)
        left.remove(first)
    return total


def _beside(task: SearchTask, view: Whitened, causes: Sequence[int]) -> Scores:
    """Statistics of every suspect given springs and some causes."""
    base = np.concatenate([np.arange(view.first), view.columns(causes)])
    return statistics_given(task.suspects, view.beside(base), causes)


def _rivals(
    task: SearchTask, view: Whitened
) -> tuple[tuple[tuple[Replacement, ...], ...], tuple[float, ...]]:
    accepted = view.model.accepted
    out, p_values = [], []
    for place in range(len(accepted)):
        rest = accepted[:place] + accepted[place + 1 :]
        now = _beside(task, task.without(view, {accepted[place]}), rest)
        p_values.append(float(now.p()[accepted[place]]))
        out.append(_odds(task, now, rest))
    return tuple(out), tuple(p_values)


def _odds(
    task: SearchTask, now: Scores, rest: Sequence[int], least: float = 1e-3
) -> tuple[Replacement, ...]:
    """Probabilities of all causes possible in one place, their forms taken together.

    What they usually amount to names none of several laws that are one in these data.
    """
    labels, logs, best, shares = [], [], [], []
    for label, every in by_label(task.suspects).items():
        forms = [i for i in every if may_join(task.suspects, rest, i)]
        if not forms:
            continue
        labels.append(label)
        logs.append(_together(task, now, forms))
        best.append(forms[int(np.argmax(compared(now.log_evidence[forms])))])
        share = special.softmax(now.log_evidence[forms])
        shares.append(tuple(zip(forms, share.tolist(), strict=True)))
    odds = np.array(logs)
    if special.softmax(odds).max() >= CERTAIN:
        odds = _by_data(task, now, best, odds)
    probability = special.softmax(odds)
    ranked = np.argsort(-compared(odds), kind="stable")  # twins in the catalogue's order
    order = [i for i in ranked if probability[i] >= least]
    return tuple(Replacement(labels[i], best[i], float(probability[i]), shares[i]) for i in order)


def _by_data(task: SearchTask, now: Scores, causes: Sequence[int], logs: Array) -> Array:
    """Log evidence of causes, those that are one with the likeliest by likelihood alone.

    With as many unknowns and 1 - T / T_best < t^2, T their drops and t the smaller tolerance, their
    effects differ by less than both are known to; only where both sizes are possible.
    """
    first, drop = causes[int(np.argmax(compared(logs)))], now.drop[list(causes)]
    known = np.array([task.suspects[i].tolerance for i in causes])
    known = np.minimum(known, task.suspects[first].tolerance)
    one = (now.rank[list(causes)] == now.rank[first]) & (drop > (1 - known**2) * now.drop[first])
    one &= [bool(near) and _possible(task, now, i) for near, i in zip(one, causes, strict=True)]
    gain = -0.5 * now.dof * np.log1p(-np.minimum(drop / now.rest, 1 - ROUNDING))
    likely = logs.max() + gain - gain[list(causes).index(first)]
    return np.where(one, np.maximum(logs, likely), logs)


def further_odds(task: SearchTask, found: SearchResult) -> list[tuple[int, float]]:
    """Each further cause in its best form, with its posterior odds against the accepted ones alone.

    A priori some further cause is as likely as none, and all causes are equally likely.
    """
    view, accepted = found.view, found.view.model.accepted
    now = statistics_given(task.suspects, view.beside(view.base), accepted)
    named = {task.suspects[i].label for i in accepted}
    every = [
        forms
        for label, forms in by_label(task.suspects).items()
        if label not in named and task.suspects[forms[0]].law is None
    ]
    best = [forms[int(np.argmax(compared(now.log_evidence[forms])))] for forms in every]
    odds = [float(np.exp(_together(task, now, forms))) / len(best) for forms in every]
    return list(zip(best, odds, strict=True))


def _strange(task: SearchTask, wide: Whitened) -> tuple[NamelessReplacement, ...]:
    """For each accepted cause, the likeliest replacement by something nameless.

    It replaces either that cause alone, or several causes that only together resemble it.
    """
    accepted = wide.model.accepted
    if not accepted or not task.nameless:
        return ()
    out = [NamelessReplacement(0.0, len(task.suspects))] * len(accepted)
    for count in range(1, len(accepted) + 1):
        for gone in combinations(range(len(accepted)), count):
            stranger = _instead(task, wide, gone)
            for place in gone:
                if stranger.probability > out[place].probability:
                    out[place] = stranger
    return tuple(out)


def _instead(task: SearchTask, wide: Whitened, gone: Sequence[int]) -> NamelessReplacement:
    """Probability of one nameless effect instead of the causes in some places."""
    accepted = wide.model.accepted
    rest = tuple(a for place, a in enumerate(accepted) if place not in gone)
    known = len(task.suspects)
    first, named = None, 0.0
    view = task.without(wide, {accepted[place] for place in gone})
    for place in gone:
        now = view.beside(np.concatenate([np.arange(wide.first), wide.columns(rest)]))
        first = now if first is None else first
        named += float(now.log_evidence[accepted[place]])
        rest = (*rest, accepted[place])
    assert first is not None
    if len(gone) == 1:
        taken = {task.suspects[a].label for a in rest[:-1]}
        free = [f for label, f in by_label(task.suspects).items() if label not in taken]
        named = float(special.logsumexp([_together(task, first, forms) for forms in free]))
    others = first.log_evidence[known:]
    strange = float(special.logsumexp(others)) + np.log(NAMELESS)
    suspect = known + int(np.argmax(compared(others)))
    return NamelessReplacement(float(special.expit(strange - named)), suspect, tuple(gone))


def _together(task: SearchTask, now: Scores, forms: Sequence[int]) -> float:
    """Log evidence of a cause, its forms equally likely; laws have shared their odds already."""
    shared = 1 if task.suspects[forms[0]].law is not None else len(forms)
    return float(special.logsumexp(now.log_evidence[list(forms)]) - np.log(shared))
