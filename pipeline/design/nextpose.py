"""Which pose would separate the causes: the one with the smallest probability of a wrong name.

For two causes with odds p and q that further readings separate by d standard deviations, the
probability of naming the wrong one is at most sqrt(p q) exp(-d^2 / 8) (Bhattacharyya's bound for
two normals with one covariance: Kailath, IEEE Trans. Communication Technology 15, 1967). Summed
over all open pairs, with the d^2 that a pose adds, this is the objective to minimise. Among poses
that make it small enough, the one that the measured poses predict best is proposed: it depends
least on a model that may be wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints, Locked, compared
from pipeline.design.poses import default_anchors, draw_poses, try_poses
from pipeline.design.room import room_of
from pipeline.design.separability import left_by, sizes
from pipeline.diagnosis.cause_search import SearchTask
from pipeline.diagnosis.facts import SEPARATED, Determining, ProposedPose, SeparatingPose
from pipeline.machine.cell import sensitivity
from pipeline.machine.effect import Effect, Pulls
from pipeline.machine.robot import configure, rating
from pipeline.reduction.measured import Measured
from pipeline.system.elimination import eliminate
from pipeline.system.whitened import Whitened

_SETTLED = 0.002
"""Probability of a wrong name that is small enough for a further pose [1]."""

_CANDIDATES = 240
"""Number of random candidate poses."""

_LIGHT = 0.25
"""Size of weak pulls relative to the largest [1]: proposed as well where the campaign's steps are
all large."""

_OPEN = 1e2
"""Prior standard uncertainty of every parameter, in typical sizes [1]: uninformative, only against
rounding."""

_SPRINGS = "joint_springs"
"""Name of the alternative to a cause when nothing else could replace it."""


@dataclass(frozen=True, eq=False)
class PlaceQuestion:
    """Which cause acts in one place.

    Attributes:
        who: Possible suspects, the identified one first; None for the joint springs alone.
        odds: Probability of each.
        rest: Accepted causes that are not in question.
    """

    who: tuple[int | None, ...]
    odds: tuple[float, ...]
    rest: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Candidates(Locked):
    """Reachable poses, each pulled in the usual steps.

    Attributes:
        pulls: The pulls, those of one pose together, `pose` counting from 0.
        anchor: Anchor of the chain of each pose [m], shape (m, 3).
    """

    pulls: Pulls
    anchor: Array

    @property
    def steps(self) -> int:
        """Load steps of each pose."""
        return len(self.pulls.pose) // len(self.anchor)

    def pose(self, number: int) -> ProposedPose:
        """One of them."""
        first, k = number * self.steps, self.steps
        force = self.pulls.force[first : first + k]
        return ProposedPose(
            q=self.pulls.q[first],
            anchor=self.anchor[number],
            force=force[np.argmax(np.linalg.norm(force, axis=1))],
            steps=k,
            approach=float(self.pulls.approach[first]),
        )


def candidates(task: SearchTask, rng: np.random.Generator) -> Candidates:
    """Random reachable poses with the load steps of the campaign's fullest pose.

    The force is that of the hardest pull, but at most the weight that the robot carries: it is not
    yet known whether that pull was written down correctly.

    Args:
        task: What stays the same during the search.
        rng: Draws the poses.

    Returns:
        The candidates; fewer, or none, where the cell leaves little room.
    """
    robot, tool, done = task.cell.robot, task.cell.tool, task.data.pulls
    anchors = default_anchors(robot)
    which = np.arange(_CANDIDATES) % len(anchors)
    points = np.vstack([tool.load_point, tool.points])
    stated = task.surroundings
    room = None if stated is None else room_of(robot, tool.named, stated, done.range_n[1])
    if room is None:
        q = draw_poses(robot, points, anchors, which, rng)
    else:
        q = try_poses(robot, points, anchors, which, rng, room)
        found = ~np.isnan(q[:, 0])
        q, which = q[found], which[found]
    at = configure(robot, q).points(points)[:, 0]
    chain = anchors[which] - at
    unit = chain / np.linalg.norm(chain, axis=1, keepdims=True)
    usual, size = _fullest(task.data), np.linalg.norm(done.force, axis=1)
    most = min(size.max(), rating.weight_n(robot) or np.inf)
    steps = size[usual] / size[usual].max() * most
    series = [steps] if steps.min() < 0.6 * steps.max() else [steps, _LIGHT * steps]
    here, k = np.tile(np.arange(len(q)), len(series)), len(usual)
    late = np.nanmax(done.time, initial=0.0)
    pulls = Pulls(
        pose=np.repeat(np.arange(len(here)), k),
        repeat=np.tile(np.arange(1, k + 1), len(here)),
        q=np.repeat(q[here], k, axis=0),
        force=np.repeat(unit[here], k, axis=0) * np.repeat(series, len(q), axis=0).reshape(-1, 1),
        branch=np.tile(done.branch[usual], len(here)),
        approach=np.repeat(rng.choice([-1.0, 1.0], len(q))[here], k),
        time=np.full(len(here) * k, late + 600.0),
        time_zero=np.full(len(here) * k, late + 300.0),
    )
    return Candidates(pulls, anchors[which][here])


def _fullest(data: Measured) -> Ints:
    """Read pulls of the first of those poses that have the most.

    A pull counts only if it was read: all its readings may be left out although its force is known.
    """
    read = np.intersect1d(data.pull, np.arange(len(data.pulls)))
    pose = data.pulls.pose[read]
    numbers, count = np.unique(pose, return_counts=True)
    return np.asarray(read[pose == numbers[np.argmax(count)]])


def propose(
    view: Whitened, questions: Sequence[PlaceQuestion], among: Candidates, most: int = 4
) -> list[SeparatingPose]:
    """Poses that separate the causes best, one after the other until all pairs are apart.

    All of them are different: repeating a pose adds information only if that pose has no systematic
    error. Pairs that no series of poses separates are left out.

    Args:
        view: The campaign from the model with all accepted causes.
        questions: The open questions.
        among: Reachable poses.
        most: Maximum number of poses.
    """
    contest = _Contest.of(view, questions)
    more = contest.products(view, among)
    open_pairs = np.ones(len(contest.pairs), dtype=bool)
    stand = np.unique(among.pulls.q[:: among.steps], axis=0, return_inverse=True)[1].reshape(-1)
    for _ in range(2):
        chosen, apart = _series(contest, more, stand, open_pairs, most)
        helped = apart[-1] >= 1.05 * apart[0] + 0.05
        if (helped >= open_pairs).all():
            break
        open_pairs &= helped
        if not open_pairs.any():
            return []
    out = []
    for count, best in enumerate(chosen, 1):
        closest = int(np.argmin(np.where(open_pairs, apart[count], np.inf)))
        out.append(
            SeparatingPose(
                separates=contest.labels(view, closest),
                at=among.pose(best),
                before=float(apart[0][closest]),
                after=float(apart[count][closest]),
                poses=count,
            )
        )
    return out


def determine(view: Whitened, among: Candidates) -> tuple[Determining, ...]:
    """For each joint the pose that makes its compliance most certain.

    u_k^2 = [(N + N_pose + I / w^2)^-1]_kk, N the products of the whitened columns of springs,
    common errors and accepted causes, in typical sizes, and w an uninformative prior.

    Args:
        view: The campaign from the model with all accepted causes.
        among: Reachable poses.
    """
    accepted = [PlaceQuestion((one,), (1.0,), ()) for one in view.model.accepted]
    contest = _Contest.of(view, accepted)
    prior = np.eye(len(contest.M)) / _OPEN**2
    now = contest.M + prior
    each = np.concatenate([now[None], now + contest.products(view, among)])
    inverse = np.diagonal(linear.regular_inverse(each), axis1=1, axis2=2)
    before, after = np.sqrt(inverse[0]), np.sqrt(inverse[1:])
    best = np.argmin(compared(after), axis=0)
    return tuple(
        Determining(among.pose(int(best[k])), float(before[k]), float(after[best[k], k]))
        for k in range(view.springs)
    )


def _series(
    contest: _Contest, more: Array, stand: Ints, open_pairs: Array, most: int
) -> tuple[list[int], Array]:
    """Poses one after the other; sigmas between all pairs before and after each, (s + 1, pairs).

    Args:
        contest: The causes in question.
        more: Normal equations that each candidate adds.
        stand: Number of the robot's pose in each candidate.
        open_pairs: Pairs that some series of poses separates.
        most: Maximum number of poses.
    """
    M, chosen, free = contest.M, list[int](), np.ones(len(stand), dtype=bool)
    apart = [contest.apart(M)]
    weight = np.where(open_pairs, contest.weight, 0.0)
    far_fetched = contest.leverage(more)
    while len(chosen) < most and free.any():
        after = contest.apart(M + more)
        wrong = np.exp(-np.maximum(after**2 - apart[0] ** 2, 0.0) / 8) @ weight
        enough = (wrong <= _SETTLED) & contest.rivals
        order = np.where(enough, far_fetched, np.inf) if (enough & free).any() else wrong
        best = int(np.argmin(np.where(free, compared(order), np.inf)))
        chosen.append(best)
        free &= stand != stand[best]
        apart.append(after[best])
        M = M + more[best]
        if wrong[best] <= _SETTLED and (after[best][open_pairs] >= SEPARATED).all():
            break
    return chosen, np.array(apart)


def _pairs(questions: Sequence[PlaceQuestion]) -> Iterator[tuple[int, int, int]]:
    """Number of a question, and two of its suspects."""
    for number, one in enumerate(questions):
        for a, b in combinations(range(len(one.who)), 2):
            yield number, a, b


@dataclass(frozen=True, eq=False)
class _Contest(Locked):
    """All causes in question in addition to the springs: only their columns.

    Attributes:
        questions: The open questions.
        effects: Those whose columns follow the springs and the common errors.
        at: Columns of M of each of them.
        columns: Columns of the view that M is made of.
        M: Products of these columns.
        pairs: Question, and two causes that are possible there.
        weight: Square root of the product of their odds, shape (pairs,).
        size: The fitted size of each possible cause without the others, by question.
    """

    questions: tuple[PlaceQuestion, ...]
    effects: tuple[Effect, ...]
    at: dict[int | None, Ints]
    columns: Ints
    M: Array
    pairs: tuple[tuple[int, int, int], ...]
    weight: Array
    size: tuple[tuple[Array, ...], ...]

    @classmethod
    def of(cls, view: Whitened, questions: Sequence[PlaceQuestion]) -> _Contest:
        every = [i for one in questions for i in (*one.rest, *one.who) if i is not None]
        suspects = list(dict.fromkeys(every))
        parts = [view.columns([i]) for i in suspects]
        ends = view.first + np.cumsum([len(part) for part in parts])
        at: dict[int | None, Ints] = {None: np.zeros(0, dtype=np.int64)}
        for i, part, end in zip(suspects, parts, ends, strict=True):
            at[i] = np.arange(end - len(part), end)
        columns = np.concatenate([np.arange(view.first), *parts])
        pairs = [*_pairs(questions)]
        weight = [np.sqrt(questions[n].odds[a] * questions[n].odds[b]) for n, a, b in pairs]
        return cls(
            questions=tuple(questions),
            effects=tuple(view.suspects[i] for i in suspects),
            at=at,
            columns=columns,
            M=view.M[np.ix_(columns, columns)],
            pairs=tuple(pairs),
            weight=np.array(weight),
            size=tuple(sizes(view, one.who, one.rest) for one in questions),
        )

    @property
    def rivals(self) -> bool:
        """False where only the gain of a cause is open: the more a pose shows of it, the better."""
        return not any(None in one.who for one in self.questions)

    def labels(self, view: Whitened, pair: int) -> tuple[str, str]:
        number, a, b = self.pairs[pair]
        who = self.questions[number].who
        one, other = (_SPRINGS if i is None else view.suspects[i].label for i in (who[a], who[b]))
        return one, other

    def _taken(self, question: PlaceQuestion) -> Ints:
        """Columns that are estimated whichever cause it is."""
        first = len(self.M) - sum(len(columns) for columns in self.at.values())
        return np.concatenate([np.arange(first), *(self.at[i] for i in question.rest)])

    def apart(self, M: Array) -> Array:
        """Sigmas between the two of each pair, for products M of shape (..., W, W): (..., pairs).

        d^2 = z' S_aa z - h' (S_bb + I / w^2)^-1 h,  h = S_ba z, S the products M after elimination
        of what is estimated anyway, w the widest prior: the part of a, at its fitted size z, that
        remains when b is fitted, both limited to the sizes that the evidence considers possible;
        the smaller of both directions.
        """
        left = [eliminate(M, self._taken(one)) for one in self.questions]
        out = []
        for number, a, b in self.pairs:
            S, size = left[number], self.size[number]
            one, other = (self.at[self.questions[number].who[k]] for k in (a, b))
            there = [
                left_by(S, true, size[k], rest)
                for true, k, rest in ((one, a, other), (other, b, one))
                if len(true)
            ]
            out.append(np.min(there, axis=0))
        return np.stack(out, axis=-1)

    def leverage(self, more: Array) -> Array:
        """Variance of the prediction at each candidate, identified causes included, shape (m,).

        trace(N^-1 X' X): N the products of the columns of springs and identified causes in the
        measured poses, X the same whitened columns in the candidate.
        """
        named = [self.at[one.who[0]] for one in self.questions]
        base = np.unique(np.concatenate([self._taken(one) for one in self.questions] + named))
        inverse = linear.inverse(self.M[np.ix_(base, base)])
        return np.einsum("ij,mji->m", inverse, more[:, base[:, None], base])

    def products(self, view: Whitened, among: Candidates) -> Array:
        """Contribution of each candidate to M, with the noise of the fullest pose: (m, W, W)."""
        flat = replace(view.model.cell, equilibrium="undeformed")
        pulls, values, rows = among.pulls, view.model.values, view.rows
        m, t = len(among.anchor), len(flat.tool.read)
        B = sensitivity(flat, pulls, values, flat.effects[:1])
        whole = np.zeros((len(pulls.pose), t, 3, len(self.columns)))
        whole[..., : view.springs] = B
        if self.effects:
            whole[..., view.first :] = sensitivity(flat, pulls, values, self.effects)
        whole = whole.reshape(m, -1, *whole.shape[1:]) * view.typical[self.columns]
        usual = _fullest(view.seen.data)
        mine = np.flatnonzero(np.isin(rows.pull, usual))
        target = np.repeat(view.seen.data.target, 3)[mine]
        X = whole[:, np.searchsorted(usual, rows.pull[mine]), target, rows.axis[mine]]
        blocks = view.white.blocks
        place = blocks.place[mine]
        inverse = view.white.inverse[blocks.index[mine[0]]][np.ix_(place, place)]
        X = inverse @ X / view.noise
        return np.asarray(np.swapaxes(X, 1, 2) @ X)
