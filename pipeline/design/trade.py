"""Give up some of the criterion for the power to diagnose: exchange poses, loads and approaches.

The pure optimum repeats few poses under the greatest load. Causes are separated by other poses,
loads, branches and approaches. The exchange starts from the pure optimum and takes those swaps
that separate more causes while the figure stays within what is allowed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.errors import InputError
from pipeline.design.criteria import relative_std
from pipeline.design.discriminate import Lens, named_from, rows
from pipeline.design.information import information, station
from pipeline.design.limits import kept
from pipeline.design.problem import Problem, with_steps
from pipeline.design.schedule import crossed, starts
from pipeline.design.search import Plan
from pipeline.design.space import Box


@dataclass(frozen=True, eq=False)
class Visits(Locked):
    """Poses with what is done at each of them.

    Attributes:
        q: Joint values [m] or [rad], shape (c, n).
        anchor: Their common anchor [m], shape (3,).
        approach: Which way the carriage came, +1 or -1, shape (c,).
        programme: Index of the load steps of each, shape (c,).
        informations: About the scaled compliances, shape (c, n, n).
        columns: Whitened columns [springs | suspects] of each, c arrays of shape (R, W).
    """

    q: Array
    anchor: Array
    approach: Array
    programme: Ints
    informations: Array
    columns: tuple[Array, ...]

    @property
    def products(self) -> Array:
        """Products of the columns of all of them together, shape (W, W)."""
        X = np.concatenate(self.columns)
        return np.asarray(X.T @ X)

    def taken(self, which: Ints) -> Visits:
        """Some of them, in that order."""
        return Visits(
            self.q[which],
            self.anchor,
            self.approach[which],
            self.programme[which],
            self.informations[which],
            tuple(self.columns[i] for i in which),
        )


@dataclass(frozen=True, eq=False)
class Aim:
    """What may be given up for the diagnosis, and what a pose may be pulled with.

    Attributes:
        allowed: Largest figure over that of the pure optimum.
        poses: Number of poses.
        programmes: Load steps [N] that a pose may get; negative where the turnbuckle is slackened
            to the step from above.
        pool: Random poses that are offered.
        restarts: Beginnings.
    """

    allowed: float
    poses: int
    programmes: tuple[Array, ...]
    pool: int = 200
    restarts: int = 2


@dataclass(frozen=True, eq=False)
class Mixed(Locked):
    """A plan for the criterion and for the diagnosis.

    Attributes:
        visits: Its poses.
        figure: The criterion, in its unit.
        relative_std: Standard uncertainty of each compliance over its nominal size, shape (n,).
        named_from: Size from which each cause is separated from every rival, typical sizes, (g,).
    """

    visits: Visits
    figure: float
    relative_std: Array
    named_from: Array

    @property
    def named(self) -> int:
        """How many causes can be named at typical size."""
        return int(np.sum(self.named_from <= 1))

    @property
    def worth(self) -> float:
        """What the exchange makes large."""
        return float(_worth(self.named_from[None])[0])


def trade(
    view: Lens,
    plan: Plan,
    aim: Aim,
    rng: np.random.Generator,
    sweeps: int = 5,
    tried: int = 120,
) -> Iterator[Mixed]:
    """Exchange poses of a plan until more causes can be named; best so far after every sweep.

    Args:
        view: The causes.
        plan: The pure optimum; its anchor stays.
        aim: What may be given up, and what a pose may be pulled with.
        rng: Draws the poses and which exchanges are tried.
        sweeps: Times that every pose is up for exchange, from each of `aim.restarts` beginnings.
        tried: Exchanges tried for each, as many again of poses near its own.
    """
    most = aim.allowed * plan.figure
    offers = _offers(view, plan, aim, rng)
    best: Mixed | None = None
    for _ in range(aim.restarts):
        chosen = _beginning(view, plan, aim, rng)
        for _ in range(sweeps):
            for slot in rng.permutation(len(chosen.q)):
                among = offers[len(aim.programmes[chosen.programme[slot]])]
                some = among.taken(rng.integers(len(among.q), size=tried))
                near = _near(view, chosen, int(slot), aim, rng, tried // 4)
                chosen = _exchanged(view, chosen, int(slot), _joined([some, near]), most)
            now = _mixed(view, chosen)
            if now.figure <= most and (best is None or now.worth > best.worth):
                best = now
            if best is not None:
                yield best
    if best is None:
        raise InputError(
            f"no plan of {aim.poses} poses with these load steps stays within "
            f"{aim.allowed:g} times the best figure",
            "allow more, or plan more poses with single pulls",
        )


def _beginning(view: Lens, plan: Plan, aim: Aim, rng: np.random.Generator) -> Visits:
    """Poses of the plan in random order, some with the longer programmes, readings as planned."""
    lengths = _lengths(aim, view.problem.readings)
    order = rng.permutation(np.resize(np.arange(len(plan.q)), aim.poses))
    by_length: dict[int, int] = {}
    for k, steps in enumerate(aim.programmes):
        by_length.setdefault(len(steps), k)
    direction = station(view.problem.experiment, plan.q, plan.anchor).direction.T
    approach = crossed(direction, plan.q[:, 0])
    parts = []
    for size in sorted(set(lengths)):
        rows_ = order[np.flatnonzero(lengths == size)]
        k = by_length[size]
        programme = aim.programmes[k]
        parts.append(visits(view, plan.q[rows_], plan.anchor, approach[rows_], k, programme))
    return _joined(parts)


def _lengths(aim: Aim, readings: int) -> Ints:
    """Pulls at each pose, short ones first, that make up the readings."""
    sizes = sorted({len(steps) for steps in aim.programmes})
    lengths = np.full(aim.poses, sizes[0])
    for pose in range(aim.poses):
        more = [n for n in sizes if lengths.sum() - lengths[pose] + n <= readings]
        lengths[pose] = more[-1] if more else sizes[0]
    if lengths.sum() != readings:
        raise InputError(
            f"{readings} readings cannot be shared among {aim.poses} poses with "
            f"{' or '.join(str(size) for size in sizes)} pulls each",
            "change diagnosis.poses or diagnosis.programmes",
        )
    return lengths


def _offers(view: Lens, plan: Plan, aim: Aim, rng: np.random.Generator) -> dict[int, Visits]:
    """Poses with every programme and approach, by the number of pulls."""
    problem = view.problem
    pool = feasible_poses(problem, plan.anchor, rng, aim.pool)
    q = np.vstack([plan.q, pool])
    out: dict[int, list[Visits]] = {}
    for k, steps in enumerate(aim.programmes):
        for way in _ways(problem):
            part = visits(view, q, plan.anchor, np.full(len(q), way), k, steps)
            out.setdefault(len(steps), []).append(part)
    return {size: _joined(parts) for size, parts in out.items()}


def _ways(problem: Problem) -> tuple[float, ...]:
    """Approaches that a pose may have."""
    fixed = {"up": (1.0,), "down": (-1.0,)}.get(problem.spec.limits.approach)
    return fixed or ((1.0, -1.0) if problem.robot.joints[0].prismatic else (1.0,))


def _near(
    view: Lens, chosen: Visits, slot: int, aim: Aim, rng: np.random.Generator, count: int
) -> Visits:
    """Poses near one of a plan, with its own programme and approach, that keep the limits."""
    problem = view.problem
    span = problem.upper - problem.lower
    reach = 10.0 ** rng.uniform(-2.5, -0.7, (count, 1))
    q = chosen.q[slot] + reach * span * rng.standard_normal((count, len(span)))
    q = np.clip(q, problem.lower, problem.upper)
    q = q[kept(problem.limits, station(problem.experiment, q, chosen.anchor))]
    k = int(chosen.programme[slot])
    way = np.full(len(q), chosen.approach[slot])
    return visits(view, q, chosen.anchor, way, k, aim.programmes[k])


def _joined(parts: list[Visits]) -> Visits:
    """Several sets of visits as one."""
    return Visits(
        q=np.concatenate([part.q for part in parts]),
        anchor=parts[0].anchor,
        approach=np.concatenate([part.approach for part in parts]),
        programme=np.concatenate([part.programme for part in parts]),
        informations=np.concatenate([part.informations for part in parts]),
        columns=tuple(column for part in parts for column in part.columns),
    )


def visits(
    view: Lens, q: Array, anchor: Array, approach: Array, programme: int, steps: Array
) -> Visits:
    """Poses with the same load steps; times as if all plans had visits of this length."""
    problem = view.problem
    experiment = with_steps(problem, steps)
    start_s = starts(np.full(max(problem.poses, 1), len(steps)))
    start_s = np.full(len(q), start_s.mean())
    return Visits(
        q=q,
        anchor=anchor,
        approach=approach,
        programme=np.full(len(q), programme),
        informations=information(experiment, station(experiment, q, anchor)),
        columns=tuple(rows(view, q, anchor, approach, steps, start_s)),
    )


def _mixed(view: Lens, chosen: Visits) -> Mixed:
    """What a set of visits is worth."""
    M = chosen.informations.sum(axis=0)[None]
    return Mixed(
        visits=chosen,
        figure=_figure(view.problem, chosen),
        relative_std=relative_std(M)[0],
        named_from=named_from(view, chosen.products[None])[0],
    )


def _figure(problem: Problem, chosen: Visits) -> float:
    return float(problem.criterion.figure(chosen.informations.sum(axis=0)[None])[0])


def _exchanged(view: Lens, chosen: Visits, slot: int, offers: Visits, most: float) -> Visits:
    """The visits with the one at `slot` replaced by the best offer, if that is an improvement."""
    problem = view.problem
    rest = chosen.informations.sum(axis=0) - chosen.informations[slot]
    M = rest + offers.informations
    figure = np.nan_to_num(problem.criterion.figure(M), nan=np.inf)
    now = _figure(problem, chosen)
    if now > most:  # first come within what is allowed
        best = int(np.argmin(figure))
        return _with(chosen, slot, offers, best) if figure[best] < now else chosen
    good = (figure <= most) & (relative_std(M) <= problem.most_std).all(axis=1)
    if not good.any():
        return chosen
    offers = offers.taken(np.flatnonzero(good))
    mine = chosen.columns[slot]
    others = chosen.products - mine.T @ mine
    worth = _worth(named_from(view, np.array([others + X.T @ X for X in offers.columns])))
    best = int(np.argmax(worth))
    if worth[best] <= _worth(named_from(view, chosen.products[None]))[0] + 1e-9:
        return chosen
    return _with(chosen, slot, offers, best)


def _worth(named: Array) -> Array:
    """Near the number of causes that can be named; rises smoothly as one comes into reach."""
    return np.sum(1 / (1 + np.minimum(named, 1e3) ** 4), axis=1)


def _with(chosen: Visits, slot: int, offers: Visits, which: int) -> Visits:
    def put(ours: Any, theirs: Any) -> Any:
        out = ours.copy()
        out[slot] = theirs[which]
        return out

    columns = list(chosen.columns)
    columns[slot] = offers.columns[which]
    return Visits(
        put(chosen.q, offers.q),
        chosen.anchor,
        put(chosen.approach, offers.approach),
        put(chosen.programme, offers.programme),
        put(chosen.informations, offers.informations),
        tuple(columns),
    )


def feasible_poses(problem: Problem, anchor: Array, rng: np.random.Generator, count: int) -> Array:
    """Random poses that keep the limits with the chain at this anchor, (c, n), c <= count."""
    box = Box(problem, 1)
    found = np.empty((0, problem.robot.n))
    for _ in range(40):
        q = box.opened(rng.uniform(size=(2000, box.size)))[0][:, 0]
        good = kept(problem.limits, station(problem.experiment, q, anchor))
        found = np.vstack([found, q[good]])[:count]
        if len(found) == count:
            break
    return found
