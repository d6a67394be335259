"""Give up some of the criterion for diagnostic power: exchange poses, loads and approaches.

The pure optimum repeats few poses under the greatest load. Causes are separated by other poses,
loads, branches and approaches. The exchange starts from the pure optimum and accepts those swaps
that separate more causes while the figure stays within what is allowed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.errors import InputError
from pipeline.design.criteria import relative_std
from pipeline.design.discriminate import CauseTests, named_from, rows
from pipeline.design.information import information, station
from pipeline.design.limits import kept
from pipeline.design.problem import Problem, with_steps
from pipeline.design.schedule import crossed, starts
from pipeline.design.search import Plan
from pipeline.design.space import PlanCoordinates
from pipeline.design.spec import DiagnosisSpec


@dataclass(frozen=True, eq=False)
class _Visit(Locked):
    """A pose with its pulls.

    Attributes:
        q: Joint values [m] or [rad], shape (n,).
        approach: Direction from which the carriage came, +1 or -1.
        steps: Load steps [N], shape (s,); negative where the turnbuckle is slackened to the step.
        information: About the scaled compliances, shape (n, n).
        columns: Whitened columns [springs | suspects], shape (R, W).
    """

    q: Array
    approach: float
    steps: Array
    information: Array
    columns: Array


@dataclass(frozen=True, eq=False)
class CompromisePlan(Locked):
    """A plan for the criterion and for the diagnosis.

    Attributes:
        visits: Its poses.
        anchor: Their common anchor [m], shape (3,).
        figure: The criterion, in its unit.
        relative_std: Standard uncertainty of each compliance over its nominal size, shape (n,).
        named_from: Size from which each cause is separated from every rival, typical sizes, (g,).
    """

    visits: tuple[_Visit, ...]
    anchor: Array
    figure: float
    relative_std: Array
    named_from: Array

    @property
    def named(self) -> int:
        """Number of causes that can be named at typical size."""
        return int(np.sum(self.named_from <= 1))

    @property
    def worth(self) -> float:
        """The objective that the exchange maximises."""
        return float(_worth(self.named_from[None])[0])


def trade(
    view: CauseTests,
    plan: Plan,
    asked: DiagnosisSpec,
    rng: np.random.Generator,
    sweeps: int = 5,
    tried: int = 120,
    pool: int = 200,
    restarts: int = 2,
) -> Iterator[CompromisePlan]:
    """Exchange poses of a plan until more causes can be named; yield the best after every sweep.

    Args:
        view: The causes.
        plan: The pure optimum; its anchor is kept.
        asked: The admissible loss, and the load steps of a pose.
        rng: Draws the poses and the exchanges that are tried.
        sweeps: Number of times that every pose is tried for exchange, per restart.
        tried: Number of exchanges tried for each, and a quarter as many with poses near its own.
        pool: Number of random poses on offer.
        restarts: Number of starts.

    Raises:
        InputError: No plan stays within what is allowed.
    """
    most = asked.allowed * plan.figure
    offers = _offers(view, plan, asked, rng, pool)
    best: CompromisePlan | None = None
    for _ in range(restarts):
        chosen = _beginning(view, plan, asked, rng)
        for _ in range(sweeps):
            for slot in rng.permutation(len(chosen)):
                among = offers[len(chosen[slot].steps)]
                some = [among[i] for i in rng.integers(len(among), size=tried)]
                near = _near(view, chosen[slot], plan.anchor, rng, tried // 4)
                chosen = _exchanged(view, chosen, int(slot), [*some, *near], most)
            now = CompromisePlan(
                visits=tuple(chosen),
                anchor=plan.anchor,
                figure=float(view.problem.criterion.figure(_information(chosen)[None])[0]),
                relative_std=relative_std(_information(chosen)[None])[0],
                named_from=named_from(view, products(chosen)[None])[0],
            )
            if now.figure <= most and (best is None or now.worth > best.worth):
                best = now
            if best is not None:
                yield best
    if best is None:
        raise InputError(
            f"no plan of {asked.poses} poses with these load steps stays within "
            f"{asked.allowed:g} times the best figure",
            "allow more, or plan more poses with single pulls",
        )


def products(visits: Sequence[_Visit]) -> Array:
    """Products of the columns of several visits together, shape (W, W)."""
    X = np.concatenate([visit.columns for visit in visits])
    return np.asarray(X.T @ X)


def _information(visits: Sequence[_Visit]) -> Array:
    """Joint information of several visits about the scaled compliances, shape (n, n)."""
    return np.sum([visit.information for visit in visits], axis=0)


def _beginning(
    view: CauseTests, plan: Plan, asked: DiagnosisSpec, rng: np.random.Generator
) -> list[_Visit]:
    """Poses of the plan in random order, some with the longer programmes, readings as planned."""
    lengths = _lengths(asked, view.problem.spec.plan.readings)
    order = rng.permutation(np.resize(np.arange(len(plan.q)), asked.poses))
    direction = station(view.problem.experiment, plan.q, plan.anchor).direction.T
    approach = crossed(direction, plan.q[:, 0])
    out = []
    for size in sorted(set(lengths)):
        which = order[lengths == size]
        steps = next(np.array(own) for own in asked.programmes if len(own) == size)
        out += _visits(view, plan.q[which], plan.anchor, approach[which], steps)
    return out


def _lengths(asked: DiagnosisSpec, readings: int) -> Ints:
    """Number of pulls at each pose that add up to the readings.

    Raises:
        InputError: No combination of the programmes does.
    """
    sizes = sorted({len(steps) for steps in asked.programmes})
    lengths = np.full(asked.poses, sizes[0])
    for pose in range(asked.poses):
        more = [n for n in sizes if lengths.sum() - lengths[pose] + n <= readings]
        lengths[pose] = more[-1] if more else sizes[0]
    if lengths.sum() != readings:
        raise InputError(
            f"{readings} readings cannot be shared among {asked.poses} poses with "
            f"{' or '.join(str(size) for size in sizes)} pulls each",
            "change diagnosis.poses or diagnosis.programmes",
        )
    return lengths


def _offers(
    view: CauseTests, plan: Plan, asked: DiagnosisSpec, rng: np.random.Generator, pool: int
) -> dict[int, list[_Visit]]:
    """Poses with every programme and approach, by the number of pulls."""
    q = np.vstack([plan.q, feasible_poses(view.problem, plan.anchor, rng, pool)])
    out: dict[int, list[_Visit]] = {len(steps): [] for steps in asked.programmes}
    for steps in asked.programmes:
        for way in _ways(view.problem):
            approach = np.full(len(q), way)
            out[len(steps)] += _visits(view, q, plan.anchor, approach, np.array(steps))
    return out


def _ways(problem: Problem) -> tuple[float, ...]:
    """Approaches that a pose may have."""
    fixed = {"up": (1.0,), "down": (-1.0,)}.get(problem.spec.limits.approach)
    return fixed or ((1.0, -1.0) if problem.robot.joints[0].prismatic else (1.0,))


def _near(
    view: CauseTests, visit: _Visit, anchor: Array, rng: np.random.Generator, count: int
) -> list[_Visit]:
    """Poses near one of a plan, with its own load steps and approach, that keep the limits."""
    problem = view.problem
    span = problem.upper - problem.lower
    reach = 10.0 ** rng.uniform(-2.5, -0.7, (count, 1))
    q = visit.q + reach * span * rng.standard_normal((count, len(span)))
    q = np.clip(q, problem.lower, problem.upper)
    q = q[kept(problem.limits, station(problem.experiment, q, anchor), problem.room)]
    return _visits(view, q, anchor, np.full(len(q), visit.approach), visit.steps)


def _visits(
    view: CauseTests, q: Array, anchor: Array, approach: Array, steps: Array
) -> list[_Visit]:
    """Poses with the same load steps; times as if all poses had this number of pulls."""
    experiment = with_steps(view.problem, steps)
    start_s = starts(np.full(view.problem.poses, len(steps))).mean()
    informations = information(experiment, station(experiment, q, anchor))
    columns = rows(view, q, anchor, approach, steps, np.full(len(q), start_s))
    each = zip(q, approach, informations, columns, strict=True)
    return [_Visit(at, way, steps, known, X) for at, way, known, X in each]


def _exchanged(
    view: CauseTests, chosen: list[_Visit], slot: int, offers: list[_Visit], most: float
) -> list[_Visit]:
    """The visits with the one at `slot` replaced by the best offer, if that is an improvement."""
    criterion, mine, whole = view.problem.criterion, chosen[slot], _information(chosen)
    M = whole - mine.information + np.array([offer.information for offer in offers])
    figure = np.nan_to_num(criterion.figure(M), nan=np.inf)
    now = criterion.figure(whole[None])[0]
    if now > most:  # first come within what is allowed
        best = int(np.argmin(figure))
        better = figure[best] < now
    else:
        known = relative_std(M) <= view.problem.limits.max_relative_std
        good = (figure <= most) & known.all(axis=1)
        if not good.any():
            return chosen
        others = products(chosen) - mine.columns.T @ mine.columns
        tried = [others + products([offers[i]]) for i in np.flatnonzero(good)]
        worth = _worth(named_from(view, np.array(tried)))
        best = int(np.flatnonzero(good)[np.argmax(worth)])
        better = worth.max() > _worth(named_from(view, products(chosen)[None]))[0] + 1e-9
    return [*chosen[:slot], offers[best], *chosen[slot + 1 :]] if better else chosen


def _worth(named: Array) -> Array:
    """Smooth approximation of the number of causes that can be named."""
    return np.sum(1 / (1 + np.minimum(named, 1e3) ** 4), axis=1)


def feasible_poses(problem: Problem, anchor: Array, rng: np.random.Generator, count: int) -> Array:
    """Random poses that keep the limits with the chain at this anchor, (c, n), c <= count."""
    box = PlanCoordinates(problem, 1)
    found = np.empty((0, problem.robot.n))
    for _ in range(40):
        q = box.opened(rng.uniform(size=(2000, box.size)))[0][:, 0]
        good = kept(problem.limits, station(problem.experiment, q, anchor), problem.room)
        found = np.vstack([found, q[good]])[:count]
        if len(found) == count:
            break
    return found
