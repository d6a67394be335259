"""Which cause is it? Causes join one by one, are exchanged and dropped; rivals keep their odds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from scipy import special

from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.diagnosis.finding import ROUGH
from pipeline.machine.cell import Cell
from pipeline.machine.effect import Effect
from pipeline.machine.effects.nameless import NAMELESS
from pipeline.machine.room import Room
from pipeline.reduction.measured import Measured
from pipeline.system.detect import Lack, Threshold, lack_of_fit, threshold
from pipeline.system.elimination import coefficients, eliminate
from pipeline.system.evidence import ROUNDING, Scores
from pipeline.system.linearised import CurrentModel, Linearised, linearise
from pipeline.system.shape import Shape
from pipeline.system.whitened import Whitened, whiten

_MOST = 3
"""So many causes at once can be named; more is an unknown one."""

WORTH = 3.0
"""A further cause must be worth this much log evidence (20 to 1)."""

_BETTER = 0.1
"""A cause takes another's place when its log evidence is larger by this: the likelier one leads,
and twins, which differ by rounding, stay."""

_MOVES = 12
"""So many moves in a row: the evidence grows with each, so that few are made."""

_FIRST = 12
"""So many of the likeliest causes are tried as the likelier one of a pair, with every other one: a
part of what was mixed up stands out by itself beside what stays."""

_ASKED = 20
"""So many of the best moves are asked whether the sizes are possible."""

_FURTHER = 0.1
"""A suspect that was not worth naming contradicts the model only this far below the threshold:
what is left was searched once more after each cause that was named."""


@dataclass(frozen=True, eq=False)
class SearchCase:
    """What does not change while causes are sought.

    Attributes:
        cell: The paper's model of the campaign, with the equilibrium that fits better.
        data: The measurements.
        suspects: All causes that move something, in all their forms.
        noise: Scatter of the tracker over its stated standard uncertainty.
        certain_noise: The same where it is certainly larger or nothing is stated, else 1: what the
            uncertainties of the answer rest on.
        force_noise: Scatter of the scale over its stated one, relative to the tracker's.
        nameless: What competes with the suspects and is never named.
        refuted: Multiples of the typical size from which the unloaded reflectors would show a
            cause and do not, by label.
        shape: Tails and wander of the noise as the data carry them; None where all readings are
            alike.
        room: What a proposed pose must leave free; None where nobody says.
    """

    cell: Cell
    data: Measured
    suspects: tuple[Effect, ...]
    noise: float
    certain_noise: float = 1.0
    force_noise: float = 1.0
    nameless: tuple[Effect, ...] = ()
    refuted: Mapping[str, float] = field(default_factory=dict)
    shape: Shape | None = None
    room: Room | None = None

    def linearised(self, model: CurrentModel, near: Linearised | None = None) -> Linearised:
        """The campaign linearised at a model, with the errors of a near one where it is given."""
        return linearise(model, self.data, self.suspects, near)

    def whitened(self, seen: Linearised, doubt: Sequence[int] = ()) -> Whitened:
        """The linearised campaign, whitened; the laws of `doubt` hold to their tolerance only."""
        return whiten(seen, self.noise, self.force_noise, self.laws(doubt))

    def laws(self, doubt: Sequence[int]) -> list[tuple[int, float]]:
        """Suspects, each with the fraction to which its law is known."""
        return [(i, self.suspects[i].tolerance) for i in doubt]

    def only(self, accepted: tuple[int, ...]) -> SearchCase:
        """The case that asks about the accepted causes alone, which are then 0, 1, 2."""
        return replace(self, suspects=tuple(self.suspects[i] for i in accepted))

    def fitted(
        self, accepted: tuple[int, ...], start: Array, near: Linearised | None = None
    ) -> Linearised:
        """The campaign linearised at the estimate of some causes; see `estimated`."""
        return self.linearised(self.estimated(accepted, start, near))

    def estimated(
        self,
        accepted: tuple[int, ...],
        start: Array,
        near: Linearised | None = None,
        rounds: int = 4,
    ) -> CurrentModel:
        """Joint springs and accepted causes estimated together, linearised anew each round.

        Args:
            accepted: Indices of the causes.
            start: Values to begin with; causes that are missing there begin at zero.
            near: The campaign linearised close by, for its errors.
            rounds: At most.
        """
        model, few = self.model(accepted, start), self.only(accepted)
        for _ in range(rounds):
            near = few.linearised(replace(model, accepted=tuple(range(len(accepted)))), near)
            view = few.whitened(near)
            values = _solved(view, view.base)
            step = np.abs(values - model.values) / view.typical[of_model(view)]
            model = replace(model, values=values)
            if np.max(step, initial=0.0) < 1e-3:
                break
        return model

    def model(self, accepted: tuple[int, ...], start: Array) -> CurrentModel:
        """A model with accepted causes; those missing in `start` begin at zero."""
        springs = len(self.cell.parameters)
        cell = self.cell.with_effects(*(self.suspects[i] for i in accepted))
        values = np.zeros(len(cell.parameters))
        values[: min(len(start), len(values))] = start[: len(values)]
        return CurrentModel(cell, values, springs, accepted)


def of_model(view: Whitened) -> Ints:
    """Columns of the model's own parameters in their order."""
    chosen = [view.columns([i]) for i in view.model.accepted]
    return np.concatenate([np.arange(view.springs), *chosen]).astype(np.int64)


def _solved(view: Whitened, base: Ints) -> Array:
    """Parameters of the view's model, estimated, SI."""
    found = dict(zip(base.tolist(), coefficients(view.M, base), strict=True))
    mine = of_model(view)
    return np.array([found[c] for c in mine.tolist()]) * view.typical[mine]


@dataclass(frozen=True, eq=False)
class Replacement:
    """One cause that could replace an accepted one.

    Attributes:
        label: Name and place.
        suspect: Index of its best form.
        probability: Given that one cause stands there.
        forms: Each of its forms with the share of that probability, all forms likely beforehand.
    """

    label: str
    suspect: int
    probability: float
    forms: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Stranger:
    """What could replace an accepted cause and is not in the catalogue.

    Attributes:
        probability: That it is nothing of the catalogue.
        suspect: Index of the likeliest of what competes without a name, behind the suspects.
        places: Which of the accepted causes it stands for, alone.
    """

    probability: float
    suspect: int
    places: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Found(Locked):
    """What the search ends with.

    Attributes:
        seen: The campaign linearised at the joint springs and all accepted causes.
        plain: The same, whitened.
        wide: The same, with what competes without a name.
        view: The same, with the laws of the accepted causes uncertain by their tolerance.
        first: The campaign whitened at the joint springs alone.
        single: Causes that could be the only one, likeliest first.
        scores: Suspects beside the joint springs alone.
        threshold: Calibrated for them.
        lack_first: Lack of fit of the joint springs alone.
        lack: Lack of fit of the model with the causes.
        left: Smallest p of a further suspect.
        accepted: Indices of the accepted suspects.
        p_values: Of each accepted cause when it joined, beside all others.
        rivals: For each accepted cause, itself and those that could stand there, likeliest first.
        strange: For each accepted cause, the probability that it is outside the catalogue; empty
            where nothing competes.
        refused: Labels of causes that would need a physically impossible size.
    """

    seen: Linearised
    plain: Whitened
    wide: Whitened
    view: Whitened
    first: Whitened
    single: tuple[Replacement, ...]
    scores: Scores
    threshold: Threshold
    lack_first: Lack
    lack: Lack
    left: float
    accepted: tuple[int, ...]
    p_values: tuple[float, ...]
    rivals: tuple[tuple[Replacement, ...], ...]
    strange: tuple[Stranger, ...]
    refused: tuple[str, ...]

    @property
    def detected(self) -> bool:
        """True when the joint springs alone do not explain the data."""
        return bool(self.scores.p().min() < self.threshold.p) or self.lack_first.found

    @property
    def stranger(self) -> Stranger | None:
        """The likeliest that is nothing of the catalogue."""
        return max(self.strange, key=lambda one: one.probability, default=None)

    @property
    def rough(self) -> float | None:
        """What is left with the causes over what the readings scatter; None where unknown."""
        return remainder(self.plain)

    @property
    def explains(self) -> bool:
        """True when causes are accepted that leave nothing but scatter."""
        return bool(self.accepted) and self.clean and (self.rough or 1.0) <= ROUGH

    @property
    def clean(self) -> bool:
        """True when nothing is left to explain."""
        return not self.lack.found and self.left >= _FURTHER * self.threshold.p


def remainder(view: Whitened) -> float | None:
    """What a model leaves over what the readings scatter, root mean squares; None if unknown."""
    if not view.tells_scatter:
        return None
    base = view.base
    rest = float(eliminate(view.M, base)[-1, -1]) / view.dof(base)
    noise = max(view.scatter / view.scatter_dof, ROUNDING)
    return float(np.sqrt(max(rest, ROUNDING) / noise))


def search(case: SearchCase, start: Array, rng: np.random.Generator) -> Found:
    """Add the likeliest cause, exchange and drop, until nothing is left or three are in."""
    seen = case.fitted((), start)
    first = case.whitened(seen)
    score = first.beside(first.base)
    limit = threshold(first, first.base, score.dof, rng)
    refused: dict[str, None] = {}
    end = lone = _stand(case, seen, ())
    if lone.p.min() < limit.p or lone.lack.found:
        end = _fewer(case, _grow(case, lone, limit, refused), limit, refused)
    rivals, p_values = _rivals(case, end.plain)
    wide = case.whitened(end.seen.beside(case.nameless))
    return Found(
        seen=end.seen,
        plain=end.plain,
        wide=wide,
        view=end.view,
        first=first,
        single=_odds(case, score, (), 0.0),
        scores=score,
        threshold=limit,
        lack_first=lone.lack,
        lack=end.lack,
        left=float(end.now.p().min()),
        accepted=end.seen.model.accepted,
        p_values=p_values,
        rivals=rivals,
        strange=_strange(case, wide),
        refused=tuple(refused),
    )


@dataclass(frozen=True, eq=False)
class _Stand:
    """Some causes accepted, and the statistics of the others beside them.

    Attributes:
        seen: The campaign linearised there.
        plain: The same, whitened.
        view: The same, with the laws of the accepted causes uncertain by their tolerance.
        now: Suspects beside them, in `view`.
        lack: Lack of fit in `view`.
        p: F tests of the suspects in `plain`, shape (n,).
    """

    seen: Linearised
    plain: Whitened
    view: Whitened
    now: Scores
    lack: Lack
    p: Array


def _stand(case: SearchCase, seen: Linearised, rough: Sequence[int]) -> _Stand:
    plain = case.whitened(seen)
    view = case.whitened(seen, rough) if rough else plain
    now = given(case.suspects, view.beside(view.base), seen.model.accepted)
    p = plain.beside(plain.base).p() if rough else now.p()
    return _Stand(seen, plain, view, now, lack_of_fit(view, view.base, now), p)


def _grow(
    case: SearchCase, end: _Stand, limit: Threshold, refused: dict[str, None], most: int = _MOST
) -> _Stand:
    """Add the likeliest, then move until no move is better, and so on until nothing joins."""
    tried: set[tuple[int, ...]] = {()}
    while len(end.seen.model.accepted) < most and _open(end, limit):
        added = _add(case, end.view, end.now, end.p < limit.p, refused)
        if added is None:
            break
        accepted = joined(case, end.seen.model.accepted, added)
        start = _solved(end.view, end.view.base)
        if len(accepted) == len(end.seen.model.accepted):  # a law was extended
            start = start[: end.view.springs]
        better = _exchange(case, case.fitted(accepted, start, end.seen), limit.p)
        if tuple(sorted(better.model.accepted)) in tried:
            break  # what was added was dropped at once: no further move
        tried.add(tuple(sorted(better.model.accepted)))
        end = _stand(case, better, better.model.accepted)
    return end


def _open(end: _Stand, limit: Threshold) -> bool:
    """Whether something is left to explain."""
    return bool(end.p.min() < limit.p) or end.lack.found


def _fewer(case: SearchCase, end: _Stand, limit: Threshold, refused: dict[str, None]) -> _Stand:
    """The other way round, where as many as can be named leave something: one more, then fewer.

    What was mixed up when few had joined is the first to be dispensable beside all of its parts.
    """
    if len(end.seen.model.accepted) < _MOST or not _open(end, limit):
        return end
    seen = _grow(case, end, limit, dict(refused), _MOST + 1).seen
    while len(seen.model.accepted) > _MOST:
        seen = _dropped(case, seen)
    if set(seen.model.accepted) == set(end.seen.model.accepted):
        return end
    return max(end, _stand(case, seen, seen.model.accepted), key=lambda one: _worth(case, one))


def _worth(case: SearchCase, end: _Stand) -> float:
    """Log evidence of all accepted causes, less `WORTH` for each."""
    accepted = end.seen.model.accepted
    return _chained(case, end.plain, (), accepted) - WORTH * len(accepted)


def _dropped(case: SearchCase, seen: Linearised) -> Linearised:
    """Without the cause that the others dispense with best, and after all moves from there."""
    accepted, view = seen.model.accepted, case.whitened(seen)
    rest = [tuple(a for a in accepted if a != one) for one in accepted]
    worth = [
        float(_beside(case, view, others).log_evidence[one])
        for one, others in zip(accepted, rest, strict=True)
    ]
    start = _solved(view, view.base)[: view.springs]
    return _exchange(case, case.fitted(rest[int(np.argmin(worth))], start, seen))


def by_label(suspects: Sequence[Effect]) -> dict[str, list[int]]:
    """Forms of each cause."""
    out: dict[str, list[int]] = {}
    for i, effect in enumerate(suspects):
        out.setdefault(effect.label, []).append(i)
    return out


def _add(
    case: SearchCase, view: Whitened, now: Scores, found: Bools, refused: dict[str, None]
) -> int | None:
    """The likeliest further cause of a possible size.

    It must be detected beyond the scatter, and keep its evidence when the laws of the accepted
    ones hold to their tolerance only.
    """
    for i in _likeliest(now):
        label = case.suspects[i].label
        if now.log_evidence[i] < WORTH:
            return None
        if not found[i] or not may_join(case.suspects, view.model.accepted, int(i)):
            continue
        if _possible(case, now, int(i)):
            return int(i)
        refused[label] = None
    return None


def may_join(suspects: Sequence[Effect], accepted: Sequence[int], more: int) -> bool:
    """Whether no cause of its name and place is there, but a law that it extends."""
    one = suspects[more]
    mine = (suspects[i] for i in accepted if suspects[i].label == one.label)
    return all(extends(one, other) for other in mine)


def joined(case: SearchCase, accepted: Sequence[int], more: int) -> tuple[int, ...]:
    """Causes and one more behind them."""
    return merged(case.suspects, (*accepted, more))


def given(suspects: Sequence[Effect], now: Scores, beside: Sequence[int]) -> Scores:
    """Statistics beside some causes, a law's extension at its odds once the law is there.

    What that law paid for its place and variable is not paid twice.
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
    """Some suspects without the laws that others of them extend."""
    return tuple(i for i in chosen if not any(extends(suspects[k], suspects[i]) for k in chosen))


def extends(one: Effect, other: Effect) -> bool:
    """Whether one is a law that nobody listed, and another such law with a further shape."""
    return one.law is not None and other.law is not None and one.law.extends(other.law)


def _likeliest(now: Scores) -> Ints:
    """Suspects by their evidence; twins, which differ by rounding, in the catalogue's order."""
    return np.argsort(-np.round(now.log_evidence, 6), kind="stable")


def _possible(case: SearchCase, now: Scores, suspect: int) -> bool:
    """True unless an estimate is beyond its bounds by more than two sigmas.

    Bounds are what physics allows and what the unloaded reflectors do not refute.
    """
    k = len(case.suspects[suspect].parameters)
    value, std = now.size[suspect, :k], np.sqrt(np.diag(now.cov[suspect]))[:k]
    most = case.refuted.get(case.suspects[suspect].label, np.inf)
    assert now.bounds is not None
    lower, upper = now.bounds[:, suspect, :k]
    slack = 2 * std + 0.3
    low, high = np.maximum(lower, -most) - slack, np.minimum(upper, most) + slack
    return bool(np.all((value > low) & (value < high)))


def _exchange(case: SearchCase, seen: Linearised, limit: float = 0.0) -> Linearised:
    """Exchange and drop accepted causes until no move makes the evidence better.

    Args:
        case: The case.
        seen: The campaign linearised at the causes to begin with.
        limit: Two causes may take the place of one where the p of each, beside the other, is below.
    """
    tried = {frozenset(seen.model.accepted)}
    for _ in range(_MOVES):
        view = case.whitened(seen)
        better = _better(case, view, tried, limit)
        if better is None:
            return seen
        tried.add(frozenset(better))
        seen = case.fitted(better, _solved(view, view.base)[: view.springs], seen)
    return seen


@dataclass(frozen=True)
class _Move:
    """Causes that go, and those that take their places.

    Attributes:
        gain: What is won: log evidence less `WORTH` for each cause, beside those that stay.
        out: Places of those that go.
        into: What comes instead: none, one or two.
    """

    gain: float
    out: tuple[int, ...]
    into: tuple[int, ...]

    def of(self, suspects: Sequence[Effect], accepted: Sequence[int]) -> tuple[int, ...]:
        """The causes after it, each newcomer in the place of one that went."""
        at, some = self.out[0], list(accepted)
        for place in reversed(self.out):
            del some[place]
        return merged(suspects, (*some[:at], *self.into, *some[at:]))


def _ranked(case: SearchCase, view: Whitened, most: int) -> list[_Move]:
    """Moves that gain, those that gain most first."""
    places = range(len(view.model.accepted))
    outs = [*combinations(places, 1), *combinations(places, 2)]
    moves = [m for out in outs for m in _moves(case, view, out, most) if m.gain > _BETTER]
    return sorted(moves, key=lambda one: (-round(one.gain, 6), one.out, one.into))


def _better(
    case: SearchCase, view: Whitened, tried: Set[frozenset[int]], limit: float = 0.0
) -> tuple[int, ...] | None:
    """Better causes than the accepted ones that were not accepted before: by the best move."""
    accepted = view.model.accepted
    most = 2 if limit and len(accepted) < _MOST else 0
    asked = 0
    for move in _ranked(case, view, most):
        after = move.of(case.suspects, accepted)
        if frozenset(after) in tried:
            continue
        if asked == _ASKED:
            return None
        asked += 1
        least = limit if len(move.into) > len(move.out) else 1.0
        if all(_may_stand(case, view, after, i, least) for i in move.into):
            return after
    return None


def _may_stand(
    case: SearchCase, view: Whitened, causes: Sequence[int], one: int, limit: float
) -> bool:
    """Whether a cause has a possible size beside the others, and a p within the limit."""
    now = _beside(case, view, tuple(i for i in causes if i != one))
    return bool(now.p()[one] <= limit) and _possible(case, now, one)


def _moves(case: SearchCase, view: Whitened, out: tuple[int, ...], most: int) -> Iterator[_Move]:
    """All that can be done where some causes go: none, one, or as many as go come, or `most`."""
    accepted = view.model.accepted
    gone = [accepted[place] for place in out]
    rest = tuple(a for place, a in enumerate(accepted) if place not in out)
    now = _beside(case, view, rest)
    mine = _chained(case, view, rest, gone) - WORTH * len(gone)
    if rest:
        yield _Move(-mine, out, ())
    free = [i for i in range(len(case.suspects)) if may_join(case.suspects, rest, i)]
    for i in free:
        yield _Move(float(now.log_evidence[i]) - WORTH - mine, out, (i,))
    if max(len(out), most) > 1:
        for pair, evidence in _in_pairs(case, view, rest, now, free):
            yield _Move(evidence - 2 * WORTH - mine, out, pair)


def _in_pairs(
    case: SearchCase, view: Whitened, rest: tuple[int, ...], now: Scores, free: Sequence[int]
) -> Iterator[tuple[tuple[int, int], float]]:
    """Pairs of causes that come beside the rest, the likelier one first, with their evidence."""
    for first in _leading(case, now, free):
        already = float(now.log_evidence[first])
        then = _beside(case, view, (*rest, first))
        for i in free:
            if now.log_evidence[i] <= already and may_join(case.suspects, (first,), i):
                yield (first, i), already + float(then.log_evidence[i])


def _leading(case: SearchCase, now: Scores, free: Sequence[int]) -> list[int]:
    """The likeliest causes, each in its best form."""
    best: dict[str, int] = {}
    allowed = set(free)
    for i in _likeliest(now).tolist():
        if i in allowed:
            best.setdefault(case.suspects[i].label, i)
    return list(best.values())[:_FIRST]


def _chained(case: SearchCase, view: Whitened, rest: Sequence[int], causes: Sequence[int]) -> float:
    """Log evidence of causes beside others: the likelier one first, each next beside those before.

    The same in whatever order the causes were found.
    """
    total, left, known = 0.0, list(causes), tuple(rest)
    while left:
        now = _beside(case, view, known).log_evidence
        first = max(left, key=lambda i: (round(float(now[i]), 6), -i))
        total += float(now[first])
        known = (*known, first)
        left.remove(first)
    return total


def _beside(case: SearchCase, view: Whitened, causes: Sequence[int]) -> Scores:
    """Every suspect beside springs and some causes."""
    base = np.concatenate([np.arange(view.first), view.columns(causes)])
    return given(case.suspects, view.beside(base), causes)


def _rivals(
    case: SearchCase, view: Whitened
) -> tuple[tuple[tuple[Replacement, ...], ...], tuple[float, ...]]:
    accepted = view.model.accepted
    out, p_values = [], []
    for place in range(len(accepted)):
        rest = accepted[:place] + accepted[place + 1 :]
        now = _beside(case, view, rest)
        p_values.append(float(now.p()[accepted[place]]))
        out.append(_odds(case, now, rest))
    return tuple(out), tuple(p_values)


def _odds(
    case: SearchCase, now: Scores, rest: Sequence[int], least: float = 1e-3
) -> tuple[Replacement, ...]:
    """Probabilities of all causes possible in one place, forms taken together."""
    labels, logs, best, shares = [], [], [], []
    for label, every in by_label(case.suspects).items():
        forms = [i for i in every if may_join(case.suspects, rest, i)]
        if not forms:
            continue
        labels.append(label)
        logs.append(_together(case, now, forms))
        best.append(forms[int(np.argmax(now.log_evidence[forms]))])
        share = special.softmax(now.log_evidence[forms])
        shares.append(tuple(zip(forms, share.tolist(), strict=True)))
    probability = special.softmax(np.array(logs))
    ranked = np.argsort(-np.round(logs, 6), kind="stable")  # twins in the catalogue's order
    order = [i for i in ranked if probability[i] >= least]
    return tuple(Replacement(labels[i], best[i], float(probability[i]), shares[i]) for i in order)


def lone_odds(case: SearchCase, found: Found) -> list[tuple[int, float]]:
    """Each cause as the only one, in its best form, with its odds against none.

    Beforehand some cause is as likely as none, and all of them are alike.
    """
    every, now = by_label(case.suspects).values(), found.scores
    best = [forms[int(np.argmax(now.log_evidence[forms]))] for forms in every]
    odds = [float(np.exp(_together(case, now, forms))) / len(best) for forms in every]
    return list(zip(best, odds, strict=True))


def _strange(case: SearchCase, wide: Whitened) -> tuple[Stranger, ...]:
    """For each accepted cause: how likely something without a name stands in its place.

    Either in its place alone, or in the place of several causes that only together look like it.
    """
    accepted = wide.model.accepted
    if not accepted or not case.nameless:
        return ()
    out = [Stranger(0.0, len(case.suspects))] * len(accepted)
    for count in range(1, len(accepted) + 1):
        for gone in combinations(range(len(accepted)), count):
            stranger = _instead(case, wide, gone)
            for place in gone:
                if stranger.probability > out[place].probability:
                    out[place] = stranger
    return tuple(out)


def _instead(case: SearchCase, wide: Whitened, gone: Sequence[int]) -> Stranger:
    """Probability of one thing without a name instead of the causes in some places."""
    accepted = wide.model.accepted
    rest = tuple(a for place, a in enumerate(accepted) if place not in gone)
    known = len(case.suspects)
    first, named = None, 0.0
    for place in gone:
        base = np.concatenate([np.arange(wide.first), wide.columns(rest)])
        now = wide.beside(base)
        first = now if first is None else first
        named += float(now.log_evidence[accepted[place]])
        rest = (*rest, accepted[place])
    assert first is not None
    if len(gone) == 1:
        taken = {case.suspects[a].label for a in rest[:-1]}
        free = [f for label, f in by_label(case.suspects).items() if label not in taken]
        named = float(special.logsumexp([_together(case, first, forms) for forms in free]))
    others = first.log_evidence[known:]
    strange = float(special.logsumexp(others)) + np.log(NAMELESS)
    suspect = known + int(np.argmax(others))
    return Stranger(float(special.expit(strange - named)), suspect, tuple(gone))


def _together(case: SearchCase, now: Scores, forms: Sequence[int]) -> float:
    """Log evidence of a cause, its forms equally likely; laws have shared their odds already."""
    shared = 1 if case.suspects[forms[0]].law is not None else len(forms)
    return float(special.logsumexp(now.log_evidence[list(forms)]) - np.log(shared))
