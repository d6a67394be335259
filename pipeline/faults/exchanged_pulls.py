"""Readings of the scale, and states of a pose, that are in each other's place.

The displacements of a pull tell what the scale should have read. With y_i the displacements of pull
i, G_i x those per newton along its chain, and x the compliances on which most pulls agree,

    f_i = (G_i x)'y_i / |G_i x|^2

is that reading. Which logged force belongs to each pull is an assignment (see `assignment`): of two
rows or of a column that is off by one or shuffled. The same test is applied to all states of one
pose: whether an unloaded group and a pull have each other's readings. Exchanging the groups of two
load steps of a pose is equivalent to exchanging their rows; both are named.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import chain, product

import numpy as np
import pandas as pd
from scipy import special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.quantities import plain
from pipeline.faults.assignment import Ring, assigned, in_words, lines, misplacement, rings, shift
from pipeline.faults.exchanged import regrouped
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake, lines_of
from pipeline.machine.cell import jacobian
from pipeline.machine.effect import MOUNTED
from pipeline.reduction.case import Case
from pipeline.reduction.measured import STILL_M, Measured
from pipeline.reduction.register import XYZ
from pipeline.system import alarms

_Key = tuple[int, int]
"""Pose and repeat of a pull."""

FEWEST, MOST = 6, 400
"""Minimum and maximum number of pulls: fewer do not single one out, and a longer log is not written
by hand."""

_MODEL = 0.003
"""Minimum fraction of a force by which the joint springs miss a pull [1]."""

_MATTERS = 0.03
"""Relative change of a force below which an exchange does not matter [1]."""

_APART = 5.0
"""Ratio to the usual deviation, rms over coordinates, from which on a state of a pose is taken to
have the readings of another state [1]."""

LEAST_SHIFTED = 4
"""Minimum number of rows that are off by one from some row on; fewer are exchanges."""

_ROUNDS = 12
"""Maximum number of reweightings, or of assignments."""


@dataclass(frozen=True, eq=False)
class PullMoves(Locked):
    """Displacements of every pull, and those per newton along it.

    Attributes:
        pull: Index among the measured pulls, shape (m,).
        y: Displacements [m], 0 where a target was not read, shape (m, c).
        G: Response to one newton with typical compliances, shape (m, c, k).
        force: As logged [N], shape (m,).
        std: Standard uncertainty of the scale [N], shape (m,).
        noise: Standard uncertainty of a displacement per coordinate [m].
    """

    pull: Ints
    y: Array
    G: Array
    force: Array
    std: Array
    noise: float

    @classmethod
    def of(cls, asked: Screening) -> PullMoves | None:
        """All pulls except payloads, which have no reading of a scale.

        None where there are too few or too many of them, or their targets were not read singly.
        """
        data = asked.reduced.data
        if asked.case.settings.displacements is not None or data.poses:
            return None
        size = np.linalg.norm(data.pulls.force, axis=1)
        which = np.flatnonzero((data.pulls.by != MOUNTED) & (size > 0))
        if not FEWEST <= len(which) <= MOST:
            return None
        y = np.zeros((len(size), len(asked.case.cell.tool.read), 3))
        y[data.pull, data.target] = data.delta
        return cls(
            which,
            y.reshape(len(size), -1)[which],
            response(asked, which, data.pulls.force[which] / size[which, None]),
            size[which],
            data.reading_std[which],
            displacement_std(data),
        )

    def solved(self, force: Array) -> Array:
        """Compliances on which most pulls agree with these forces, by least sums of norms.

        Each norm is relative to the geometric mean of the displacement and of that by the force:
        one that is ten times too large would otherwise outweigh all others.
        """
        x, size = np.ones(self.G.shape[2]), np.linalg.norm(self.y, axis=1)
        for k in range(_ROUNDS + 1):
            moves = force[:, None] * (self.G @ x)
            scale = np.sqrt(size * np.linalg.norm(moves, axis=1)) + self.noise
            left = np.linalg.norm(self.y - moves, axis=1) if k else scale
            weight = 1 / np.sqrt(scale * np.maximum(left, _MODEL * scale))
            A = (weight * force)[:, None, None] * self.G
            new = linear.least_squares(A.reshape(-1, len(x)), (weight[:, None] * self.y).ravel())
            if np.abs(new - x).max() < 1e-6 * np.abs(new).max():
                break
            x = new
        return np.asarray(new)

    def only(self, which: Bools | Ints) -> PullMoves:
        """Some of the pulls."""
        some = {name: getattr(self, name)[which] for name in ("pull", "y", "G", "force", "std")}
        return replace(self, **some)

    @property
    def least(self) -> float:
        """Minimum chi-square by which a force contradicts a pull."""
        return float(special.chdtri(1, alarms.EXCHANGED / len(self.force) ** 2))

    def usual(self, square: Array) -> Array:
        """Usual mean square that the springs leave of each pull [m^2], shape (m,).

        It is that of noise, and a part of the displacement, the median of what is beyond noise.

        Args:
            square: Mean square that they leave of it [m^2], shape (m,).
        """
        whole = np.mean(self.y**2, axis=1)
        beyond = np.maximum(square - self.noise**2, 0.0) / np.maximum(whole, self.noise**2)
        return np.asarray(self.noise**2 + max(float(np.median(beyond)), _MODEL**2) * whole)

    def due(self, x: Array) -> tuple[Array, Array]:
        """Force by the displacements of each pull, and its standard uncertainty [N]."""
        g = self.G @ x
        square = np.maximum(np.sum(g**2, axis=1), (STILL_M / self.force.max()) ** 2)
        return np.sum(g * self.y, axis=1) / square, self.noise / np.sqrt(square)


@dataclass(frozen=True, eq=False)
class OrderFit(Locked):
    """Compliances for one order of the forces.

    Attributes:
        x: Compliances in typical ones, shape (k,).
        cost: Misfit of each logged force (row) in each pull (column), chi-square, shape (m, m).
        model: Usual misfit of a pull as a fraction of its force [1].
        left: Mean misfit as a fraction of the force, each at most 1; smaller is better.
    """

    x: Array
    cost: Array
    model: float
    left: float


def response(asked: Screening, pulls: Ints, force: Array) -> Array:
    """Displacements by forces in some pulls, for each of the typical compliances [m].

    0 where a target was not read.

    Args:
        asked: The campaign.
        pulls: Indices among the measured pulls, shape (n,).
        force: Forces in F_b [N], shape (n, 3).

    Returns:
        Shape (n, c, k).
    """
    data, cell = asked.reduced.data, asked.case.cell
    typical = np.array([p.typical for p in cell.parameters])
    under = replace(data.pulls.part(pulls), force=force)
    found = jacobian(cell, under, asked.start) * typical
    read = np.zeros((len(data.pulls), found.shape[1]), dtype=bool)
    read[data.pull, data.target] = True
    found[~read[pulls]] = 0.0
    return found.reshape(len(pulls), -1, len(typical))


def displacement_std(data: Measured) -> float:
    """Standard uncertainty of a displacement per coordinate [m], at least `STILL_M`."""
    if not data.noise_stated:
        std = data.found_m or STILL_M
    else:
        both = np.einsum("dii->d", data.loaded_cov + data.zero_cov) / 3
        std = float(np.sqrt(np.median(both)))
    return std if std > STILL_M else STILL_M  # also where the scatter is unknown


def exchanged_pulls(asked: Screening) -> list[Mistake]:
    """Unloaded groups and pulls of a pose that were exchanged, else exchanged rows of the loads."""
    if (moved := PullMoves.of(asked)) is None:
        return []
    given = ordered(moved, np.arange(len(moved.force)))
    if (np.diag(given.cost) <= moved.least).all() and given.model < USUAL_MISFIT:
        return []
    return _states(asked, moved) or _loads(asked, moved, given)


def ordered(moved: PullMoves, order: Ints) -> OrderFit:
    """The fit with logged force `order[i]` in pull i."""
    return _beside(moved, moved.solved(moved.force[order]), order)


def _beside(moved: PullMoves, x: Array, order: Ints) -> OrderFit:
    due, own = moved.due(x)
    force = moved.force[order]
    part = np.abs(due / force - 1)
    model = max(1.4826 * float(np.median(part)), _MODEL)  # for a normal distribution
    var = own**2 + moved.std**2 + (model * force) ** 2
    cost = (moved.force[:, None] - due) ** 2 / var * _straight(moved, x, due)
    return OrderFit(x, cost, model, float(np.mean(np.minimum(part, 1.0))))


def _straight(moved: PullMoves, x: Array, due: Array) -> Bools:
    """Mask of pulls with displacements that a force can cause, unlike bad readings, shape (m,)."""
    square = np.mean((moved.y - due[:, None] * (moved.G @ x)) ** 2, axis=1)
    return np.asarray(square <= _APART**2 * moved.usual(square))


def misfit(case: Case) -> float:
    """Mean misfit of the pulls as a fraction of their force, each at most 1; NaN if unknown."""
    moved = PullMoves.of(Screening(case, case.cell, case.robot.nominal_compliance))
    return np.nan if moved is None else ordered(moved, np.arange(len(moved.force))).left


@lru_cache(maxsize=1)
def odd_forces(asked: Screening) -> dict[_Key, bool]:
    """Whether the logged force of each pull, (pose, repeat), contradicts its displacements.

    Empty where there are too few or too many pulls.
    """
    if (moved := PullMoves.of(asked)) is None:
        return {}
    fit = ordered(moved, np.arange(len(moved.force)))
    return dict(zip(_keys(asked, moved), (np.diag(fit.cost) > moved.least).tolist(), strict=True))


def _keys(asked: Screening, moved: PullMoves) -> list[_Key]:
    """Pose and repeat of each pull."""
    of = asked.reduced.data.pulls
    return [*zip(of.pose[moved.pull].tolist(), of.repeat[moved.pull].tolist(), strict=True)]


# --- rows of the loads ----------------------------------------------------------------------------


def _loads(asked: Screening, moved: PullMoves, given: OrderFit) -> list[Mistake]:
    """Exchanged rows of the loads, for the order of forces that leaves fewest pulls unexplained."""
    row, least = rows_of(asked.case, asked.reduced.data, moved.pull), moved.least
    every = ((_fitting(moved, one, least), one) for one in _orders(moved, given, least, row) if one)
    fits = [(fit, one) for fit, one in every if fit]
    for fit, found in sorted(fits, key=partial(_unexplained, least=least)):
        moves = row[[k for ring in found for k in ring.members]]
        pose = asked.reduced.data.pulls.pose[moved.pull]
        happens = partial(_happens, pose=pose, most=bool(2 * len(moves) > np.ptp(moves) + 1))
        kept = [one for one in found if _changes(moved, one) and _both(fit, one, least)]
        if kept := [*filter(happens, kept)]:
            return [of_loads(asked, moved, fit, one) for one in kept]
    return []


def _unexplained(one: tuple[OrderFit, list[Ring]], least: float) -> tuple[int, int]:
    """Number of pulls whose force does not fit, except those left without one; then of moves.

    A run that is off by one is a single move.
    """
    fit, found = one
    wrong = np.diag(fit.cost[ordering(found, len(fit.cost))]) > least
    without = sum(wrong[ring.members[0]] for ring in found if ring.ended)
    return int(wrong.sum() - without), sum(1 if r.by_one else len(r.moves) for r in found)


def _orders(moved: PullMoves, given: OrderFit, least: float, row: Ints) -> Iterator[list[Ring]]:
    """Possible moves in the column of forces, the simplest first; some may be none."""
    yield rings(given.cost, least, least)
    at = np.argsort(row)  # pulls in the order of the log
    for step in (1, -1):
        begins = dict.fromkeys((0, *_since(moved, at, step)))
        for ended, begin in product((False, True), begins):
            yield [shift(at[begin:], step, ended)]
    yield _sorted(moved, least)


def _since(moved: PullMoves, at: Ints, step: int) -> set[int]:
    """Rows from which on the forces may be off by one, by compliances of all rows and of all later.

    Args:
        moved: The pulls.
        at: Pulls in the order of the log, shape (m,).
        step: Direction in which each force belongs, 1 or -1.
    """
    some, found = moved.only(at), set[int]()
    late, last = np.roll(some.force, step), len(at) - LEAST_SHIFTED
    for force in (some.force, late):
        for _ in range(_ROUNDS):
            due = some.due(some.solved(force))[0]
            off, other = (np.minimum(np.abs(due / one - 1), 1.0) for one in (some.force, late))
            own = off if step == 1 else off - other  # nothing belongs in the first of these places
            begin = int(np.argmin((np.cumsum(off - other) - own)[: last + 1]))
            new = np.where(np.arange(len(at)) < begin, some.force, late)
            if (new == force).all():
                break
            force = new
        found.add(begin)
    return found


def ordering(found: Sequence[Ring], count: int) -> Ints:
    """Index of the logged force that belongs to each pull."""
    order = np.arange(count)
    for here, there in chain.from_iterable(ring.moves for ring in found):
        order[there] = here
    return order


def _fitting(moved: PullMoves, found: Sequence[Ring], least: float) -> OrderFit | None:
    """The fit with re-estimated compliances; None if anything does not fit where it is moved."""
    fit = ordered(moved, ordering(found, len(moved.force)))
    here, there = np.concatenate([ring.moves for ring in found]).T
    after, before = fit.cost[here, there], fit.cost[here, here]
    fits = bool((after <= least).all() and (before - after).mean() > least)
    return fit if fits and fit.model < USUAL_MISFIT else None


USUAL_MISFIT = 0.1
"""Maximum usual misfit from the joint springs as a fraction of the force, where forces are
right [1]: friction, clearance and transmission errors are below."""


def _sorted(moved: PullMoves, least: float) -> list[Ring]:
    """A column in any order, starting from typical stiffnesses."""
    count = len(moved.force)
    x = np.ones(moved.G.shape[2])
    due = moved.due(x)[0]
    x = x * float(np.median(due[due > 0]) / np.median(moved.force)) if (due > 0).any() else x
    order = np.arange(count)
    for _ in range(_ROUNDS):
        new = assigned(_beside(moved, x, order).cost)
        if (new == order).all():
            break
        order, x = new, moved.solved(moved.force[new])
    return rings(ordered(moved, order).cost, least, least)


def _happens(ring: Ring, pose: Ints, most: bool) -> bool:
    """Whether such exchanges occur in logs: rows of two poses, or most rows within a range.

    A few scattered rows that would all fit better in a cycle are the effect of a cause on the poses
    that it affects.
    """
    return most or len(np.unique(pose[list(ring.members)])) <= _OF_POSES


_OF_POSES = 2
"""Maximum number of poses whose rows are exchanged at a time: two entries, or all of one pose for
all of another."""


def _both(fit: OrderFit, ring: Ring, least: float) -> bool:
    """Whether both of two rows are wrong where they are; otherwise a single number was mistyped."""
    own = fit.cost[list(ring.members), list(ring.members)]
    return len(own) > 2 or bool((own > least).all())


def _changes(moved: PullMoves, ring: Ring) -> bool:
    """Whether the exchange changes a force by more than `_MATTERS`."""
    here, there = np.array(ring.moves).T
    return bool((np.abs(moved.force[here] / moved.force[there] - 1) > _MATTERS).any())


def rows_of(case: Case, data: Measured, which: Ints | slice = slice(None)) -> Ints:
    """Row of the loads of some pulls, by default of each, shape (m,)."""
    key = pd.MultiIndex.from_frame(case.loads[["pose", "repeat"]])
    mine = pd.MultiIndex.from_arrays([data.pulls.pose[which], data.pulls.repeat[which]])
    return np.asarray(key.get_indexer(mine), dtype=np.int64)


def of_loads(
    asked: Screening, moved: PullMoves, fit: OrderFit, ring: Ring, anchors: bool = False
) -> Mistake:
    """The mistake that forces in rows of the loads, and anchors, are in each other's place."""
    case, which = asked.case, moved.pull[list(ring.members)]
    rows = case.loads.iloc[rows_of(case, asked.reduced.data, which)]
    file = str(rows["file"].iloc[0])
    every = _keys(asked, moved)
    keys = [every[k] for k in ring.members]
    names = [f"pose{p:02d} rep{r}" for p, r in keys]
    at = lines_of(rows)
    where, also = f"{file} {ring.where(names)}", ""
    groups = _groups_of(case, keys) if len(keys) == 2 and keys[0][0] == keys[1][0] else None
    if groups is not None:
        where, here = groups
        at = (*at, *here)
        also = ", or the readings of these groups"
    here, there = np.array(ring.moves).T
    due = moved.due(fit.x)[0][there]
    worst = int(np.argmax(np.abs(moved.force[there] - moved.force[here])))
    before = float(np.sqrt(fit.cost[here, here].max()))
    after = float(np.sqrt(fit.cost[here, there].max()))
    true = {every[i]: every[j] for i, j in ring.moves}
    what = f"{file}: the forces{' and anchors' if anchors else ''} of {in_words(ring, names)}"
    stand = misplacement(ring, "row")
    pull = names[[*ring.members].index(int(there[worst]))]
    return Mistake(
        name="exchanged",
        where=where,
        evidence=f"{what} stand {stand}{also} ({lines(at)}): {pull} was logged with "
        f"{plain(moved.force[there[worst]], 5)} N, and moved as by {plain(due[worst], 4)} N, which "
        f"{plain(moved.force[here[worst]], 5)} N of another row matches",
        correction=f"recomputed with {where} exchanged",
        before=before,
        after=after,
        unit="sigma",
        correct=partial(_reloaded, true=true, lost=keys[: ring.ended], anchors=anchors),
        at=at,
        places=len(moved.force) * (len(moved.force) - 1) // 2,
    )


def _groups_of(case: Case, keys: Sequence[_Key]) -> tuple[str, tuple[str, ...]] | None:
    """The groups of two pulls as `a/b`, and the lines of their readings."""
    rows, names, at = case.readings, list[str](), list[str]()
    for pose, repeat in keys:
        here = rows[(rows["pose"] == pose) & (rows["repeat"] == repeat)]
        here = here[here["state"] == "loaded"]
        if not len(here):
            return None
        names.append(str(here["group"].iloc[0]))
        at += lines_of(here)
    return "/".join(sorted(names)), tuple(at)


def _reloaded(case: Case, true: dict[_Key, _Key], lost: Sequence[_Key], anchors: bool) -> Case:
    """The loads with forces and masses, and anchors, in the rows where they belong."""
    keys = zip(case.loads["pose"].astype(int), case.loads["repeat"].astype(int), strict=True)
    at = {key: k for k, key in enumerate(keys)}
    source = np.arange(len(at))
    source[[at[key] for key in true.values()]] = [at[key] for key in true]
    moved = {name: case.loads[name].array[source] for name in ("force_n", "mass_kg")}
    loads = case.loads.assign(**moved).reset_index(drop=True).drop(index=[at[key] for key in lost])
    named = {there: case.anchors[here] for here, there in true.items() if anchors}
    return replace(case, loads=loads, anchors={**case.anchors, **named})


# --- unloaded groups and pulls of a pose ----------------------------------------------------------

_STATE = ["group", "repeat"]
"""What tells states of a pose apart: rounds before and after the pulls may share a name."""

_State = tuple[str, int]


def _states(asked: Screening, moved: PullMoves) -> list[Mistake]:
    """Poses in which an unloaded group and a pull have each other's readings of the effector.

    The compliances are those of all other poses: a pose of few would otherwise fit itself.
    """
    placed, pulls = asked.reduced.placed, asked.reduced.data.pulls
    rows = placed[placed["target"].isin(asked.case.settings.measured)]
    rows = rows.drop_duplicates([*_STATE, "target"])
    found = []
    for pose in rows["pose"].unique().tolist():
        here = rows[rows["pose"] == pose]
        mine = pulls.pose[moved.pull] == pose
        if not mine.any() or (~mine).sum() < FEWEST:
            continue
        others = moved.only(~mine)
        fit = ordered(others, np.arange(len(others.force)))
        own = moved.only(mine)
        due = dict(
            zip(pulls.repeat[own.pull].tolist(), own.force[:, None] * (own.G @ fit.x), strict=True)
        )
        known = moved.noise, fit.model
        for ring, names, before, after in _in_pose(asked.case, here, due, *known):
            found.append(_of_states(asked.case, pose, ring, names, before, after))
    return found


def _whole_states(
    case: Case, here: pd.DataFrame, pulls: dict[int, Array]
) -> tuple[Array, Array, Bools, list[_State]] | None:
    """Completely read states of a pose; None unless both kinds are there.

    Returns:
        Positions (s, 3 t) [m], displacement by the pull of each, which are unloaded, and their
            groups with the number of the state.
    """
    measured = case.settings.measured
    at = here.pivot(index=_STATE, columns="target", values=XYZ)
    at = at.reorder_levels([1, 0], axis=1).reindex(
        columns=pd.MultiIndex.from_product([measured, XYZ])
    )
    first = here.drop_duplicates(_STATE).set_index(_STATE).loc[at.index]
    zero = (first["state"] == "unloaded").to_numpy()
    repeat = at.index.get_level_values("repeat").to_numpy(int)
    known = (zero | np.isin(repeat, [*pulls])) & at.notna().all(axis=1).to_numpy()
    if known.sum() < 2 or not zero[known].any() or zero[known].all():
        return None
    Y, zero, repeat = at.to_numpy(float)[known], zero[known], repeat[known]
    nothing = np.zeros(Y.shape[1])
    due = [nothing if z else pulls[int(k)] for z, k in zip(zero, repeat, strict=True)]
    return Y, np.array(due), zero, [(str(name), int(k)) for name, k in at.index[known]]


def _cheapest(Y: Array, due: Array, zero: Bools, usual: Array) -> tuple[Array, int]:
    """Misfit of every content in every place [1], for the reference state with the best assignment.

    Beside it the number of states that are off as recorded, for the reference with the fewest.

    Args:
        Y: Positions as read [m], shape (s, 3 t).
        due: Displacement by the pull of each state [m], shape (s, 3 t).
        zero: States without a pull, shape (s,).
        usual: Variance of each state [m^2], shape (s,).
    """
    some = int(np.flatnonzero(zero)[0])
    costs, off = [], len(Y)
    for j in range(len(Y)):
        for k in {j, some}:  # all contents in all places, if content j is in place k
            square = np.mean((Y[:, None] - (Y[j] - due[k]) - due) ** 2, axis=2)
            costs.append(np.asarray(square / (usual + usual[k])))
            if j == k:
                off = min(off, int((np.diag(costs[-1]) > _APART**2).sum()))
    return min(costs, key=_total), off


def _in_pose(
    case: Case, here: pd.DataFrame, pulls: dict[int, Array], noise: float, model: float
) -> Iterator[tuple[Ring, list[_State], float, float]]:
    """Exchanges of unloaded with loaded states in a pose, and misfits before and after."""
    states = _whole_states(case, here, pulls)
    if states is None:
        return
    Y, due, zero, names = states
    best, off = _cheapest(Y, due, zero, noise**2 + model**2 * np.mean(due**2, axis=1))
    if (_assigned(best)[1] > _APART**2).sum() >= off:  # a pull the other way is no exchange
        return
    for ring in rings(best, _APART**2, _APART**2):
        kinds = zero[list(ring.members)]
        if kinds.any() and not kinds.all() and not ring.ended:
            before = max(best[i, i] for i, _ in ring.moves)
            after = max(best[i, j] for i, j in ring.moves)
            yield ring, names, float(np.sqrt(before)), float(np.sqrt(after))


def _total(cost: Array) -> float:
    """Cost of the best assignment, its moves included."""
    order, own = _assigned(cost)
    return float(own.sum()) + _APART**2 * int((order != np.arange(len(cost))).sum())


def _assigned(cost: Array) -> tuple[Ints, Array]:
    """Content of each place by the best assignment, and its misfit there [1]."""
    order = ordering(rings(cost, _APART**2, np.inf), len(cost))
    return order, np.asarray(cost[order, np.arange(len(cost))])


def _of_states(
    case: Case, pose: int, ring: Ring, names: list[_State], before: float, after: float
) -> Mistake:
    mine = [names[k][0] for k in ring.members]
    true = {names[i][0]: names[j][0] for i, j in ring.moves}
    rows = case.readings[case.readings["target"].isin(case.settings.measured)]
    states = pd.MultiIndex.from_frame(rows[_STATE].astype({"group": str}))
    at = lines_of(rows[states.isin([names[k] for k in ring.members])])
    where = ring.where(mine)
    what = f"the readings of {in_words(ring, mine)} in pose {pose}"
    stand = misplacement(ring, "group")
    return Mistake(
        name="exchanged",
        where=where,
        evidence=f"{what} stand {stand} ({lines(at)}): as recorded, the effector is up to "
        f"{plain(before, 2)} times as far as usual from where the pulls put it, and "
        f"{plain(after, 2)} times with them exchanged",
        correction=f"recomputed with {where} exchanged",
        before=before,
        after=after,
        unit="sigma",
        correct=partial(regrouped, true=true, out=frozenset(), at=at),
        at=at,
    )


FAULT = Fault("exchanged", exchanged_pulls, in_files=True)
