"""Anchors of campaign.toml that the pulls contradict: which single place, or column, is wrong.

A chain without reflectors goes to the place of the anchor that its row names. If that place is
mistyped, all pulls there are wrong in direction, by one displacement of the point. With y_i the
displacements of pull i, f_i its force, G_i(u) those per newton along u with typical springs,

    y_i = f_i G_i(u_i) x + e_i,    u_i = (p_a - near_i) / |p_a - near_i|,

each hypothesis frees the place p_a of one anchor, in one coordinate as by a mistyped number or in
all, or takes the column of anchors to be off by one from some row on. They compete as the entries
of [tool] and [base_frame] do, by the restricted likelihood of `faults.entries.Rows`, averaged over
the size of errors of the model: the flat density of a free place is one per metre in each axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.quantities import plain
from pipeline.faults.anchor import ends
from pipeline.faults.assignment import in_words, lines, misplacement, shift
from pipeline.faults.conventions import with_places
from pipeline.faults.entries import Rows
from pipeline.faults.exchanged_pulls import LEAST_SHIFTED, PullMoves, response, rows_of
from pipeline.faults.fault import Screening
from pipeline.faults.mistake import Mistake, length, lines_of, outlying
from pipeline.faults.typing_errors import GUESSES, WITHIN, intended
from pipeline.readers.reflector_sets import CLEARLY_NEARER
from pipeline.reduction.case import Case
from pipeline.system import odds
from pipeline.system.blocks import Blocks

_SPRINGS = np.geomspace(3e-3, 0.3, 5)
"""Sizes of errors of the joint springs that are averaged over [1]: of the deflection of each joint,
alike in all pulls of a pose, and of each displacement."""
_AT_FIRST = 0.01
"""Such a size before the hypotheses are known [1]."""
_LEAST_M = 0.01
"""Smallest error of a place that is told [m]: a shackle is as large."""
_FEWEST = 3
"""Minimum number of pulls towards an anchor of which the place is tested, in two poses or more."""
_FAR = 6.0
"""Misfit of a pull over the usual one from which on it is left out [1]."""
_RIVAL = 0.05
"""Minimum likelihood of another anchor, over that of the best one, to be listed [1]."""
_UNSEEN = 1e-6
"""Largest response to a joint's spring, over that to any, that no pull shows [1]."""
_STEPS = 12
"""Maximum number of Gauss-Newton steps."""
_STRIDE_M = 0.5
"""Longest step of a place [m]."""
_SETTLED_M = 1e-5
"""Step of a place after which it is found [m]."""
_TRIED_M = np.concatenate([[0.0], *np.multiply.outer((1, -1), np.geomspace(0.03, 300.0, 40))])
"""Errors of one coordinate from which places are sought [m]: with its point in the wrong place, a
number in a hall is up to a hundred times too large."""


@dataclass(frozen=True, eq=False)
class _Pulls(Locked):
    """What the hypotheses explain: m pulls towards n anchors.

    Attributes:
        moved: Their displacements, and those per newton of the joints that they show.
        each: Those per newton along each axis of F_b, by joint, shape (m, c, k, 3) [m/N].
        near: Near end of each chain [m], F_b, shape (m, 3).
        place: Its anchor, shape (m,).
        at: Places of the anchors [m], F_b, shape (n, 3).
        pose: Pose of each, shape (m,).
        row: Row of the loads of each, shape (m,).
    """

    moved: PullMoves
    each: Array
    near: Array
    place: Ints
    at: Array
    pose: Ints
    row: Ints

    @classmethod
    def of(cls, asked: Screening) -> _Pulls | None:
        """Those of a campaign whose rows name anchors; None where too few do."""
        if not asked.case.anchors or (moved := PullMoves.of(asked)) is None:
            return None
        near, place, at = ends(asked, moved)
        known = len(asked.case.settings.anchors)
        axes = np.repeat(np.eye(3), len(moved.pull), axis=0)
        every = np.split(response(asked, np.tile(moved.pull, 3), axes), 3)
        size = np.abs(moved.G).max(axis=(0, 1))
        seen = size > _UNSEEN * size.max()
        moved, each = replace(moved, G=moved.G[..., seen]), np.stack(every, axis=-1)[:, :, seen]
        pose = asked.reduced.data.pulls.pose[moved.pull]
        row = rows_of(asked.case, asked.reduced.data, moved.pull)
        whole = cls(moved, each, near, place, at[:known], pose, row)
        left = whole.only((place >= 0) & (place < known))
        return left if len(left.place) > _FEWEST else None

    def only(self, kept: Bools) -> _Pulls:
        """Some of them."""
        some = {name: getattr(self, name)[kept] for name in ("each", "near", "place", "pose")}
        return replace(self, moved=self.moved.only(kept), row=self.row[kept], **some)

    def along(self, place: Ints, at: Array) -> tuple[Array, Array]:
        """Displacements per joint by each force towards a place, and by a metre of that place.

        Args:
            place: Anchor of each pull, shape (m,).
            at: Their places [m], shape (n, 3).

        Returns:
            f G(u), shape (m, c, k) [m], and its derivative by p, shape (m, c, k, 3) [1].
        """
        to = at[place] - self.near
        away = np.linalg.norm(to, axis=1)[:, None]
        u = to / away
        across = (np.eye(3) - u[:, :, None] * u[:, None, :]) / away[:, :, None]
        by_force = self.moved.force[:, None, None, None] * self.each
        return (by_force @ u[:, None, :, None])[..., 0], by_force @ across[:, None]

    def noise(self, s: float) -> Array:
        """Usual mean square that a model with errors of size s leaves of each [m^2], shape (m,)."""
        return np.asarray(self.moved.noise**2 + s**2 * np.mean(self.moved.y**2, axis=1))


@dataclass(frozen=True, eq=False)
class _Claim(Locked):
    """What may be wrong.

    Attributes:
        place: Anchor of each pull, shape (m,).
        anchor: Whose place is free; -1 for none.
        free: Directions in which it is, shape (3, j).
        begin: Index of the pull, in the order of the log, from which on rows are off by one.
        step: Which way: 1 for rows that belong to the row after.
    """

    place: Ints
    anchor: int = -1
    free: Array = field(default_factory=lambda: np.zeros((3, 0)))
    begin: int = 0
    step: int = 0

    def only(self, kept: Bools) -> _Claim:
        """The same of some pulls."""
        return replace(self, place=self.place[kept])


@dataclass(frozen=True, eq=False)
class _Fit(Locked):
    """Fit of one hypothesis.

    Attributes:
        claim: The hypothesis.
        evidence: Logarithm of its restricted likelihood.
        s: Likeliest size of the errors of the springs [1].
        at: Place of its free anchor [m], shape (3,).
        std: Its standard uncertainty per axis [m], 0 where it is not free.
        left: Mean square that is left of each pull [m^2], shape (m,).
    """

    claim: _Claim
    evidence: float
    s: float
    at: Array
    std: Array
    left: Array


def misplaced(asked: Screening) -> list[Mistake]:
    """The one anchor whose place, or the row from which on their column, the pulls contradict.

    It must be likelier than that none is wrong by odds of 100 for each hypothesis, and likelier
    without any one pose, too. Where causes may hide in what it leaves, it leaves `CLEARLY_NEARER`
    times less: what a cause does in some poses may look like a direction.
    """
    pulls = _Pulls.of(asked)
    if pulls is None or not _suspicious(pulls):
        return []
    pulls, (none, *found) = _without_far(pulls)
    best = max(found, key=lambda fit: fit.evidence, default=none)
    if not _certain(pulls, best, none):
        return []
    if _of_one_pose(pulls, best.claim):
        return []
    if best.claim.step:
        return [_of_column(asked, pulls, best, none)]
    others = {
        fit.claim.anchor: None for fit in found if fit.evidence > best.evidence + np.log(_RIVAL)
    }
    instead = [one for one in others if one not in (-1, best.claim.anchor)]
    off_m = float(np.linalg.norm(best.at - pulls.at[best.claim.anchor]))
    return [_of_place(asked.case, pulls, best, none, instead)] if off_m > _LEAST_M else []


def _certain(pulls: _Pulls, best: _Fit, none: _Fit) -> bool:
    """Whether a hypothesis holds; False also where nothing is determined."""
    needed = odds.DECIDES / 2 + np.log(max(_count(pulls), 1))
    clear = best.s <= max(none.s / CLEARLY_NEARER, _SPRINGS[0])
    return bool(clear and best.evidence - none.evidence >= needed)


def _of_one_pose(pulls: _Pulls, claim: _Claim) -> bool:
    """Whether the pulls of one pose alone contradict the log: then that pose is wrong."""
    other = claim.place != pulls.place if claim.step else claim.place == claim.anchor
    if len(np.unique(pulls.pose)) < 2:
        return False
    for pose in np.unique(pulls.pose[other]).tolist():
        rest, kept = pulls.only(pulls.pose != pose), claim.only(pulls.pose != pose)
        x = rest.moved.solved(rest.moved.force)
        there, none = (
            _fit(rest, one, _begin(rest, one, x), x) for one in (kept, _Claim(rest.place))
        )
        if -np.inf < there.evidence <= none.evidence:
            return True
    return False


def _without_far(pulls: _Pulls) -> tuple[_Pulls, list[_Fit]]:
    """Pulls without those that the likeliest hypothesis leaves far off, and the fits to them."""
    found = _fits(pulls, [*_columns(pulls)])
    best = max(found, key=lambda fit: fit.evidence)
    usual = best.left / pulls.noise(best.s)
    if not (far := usual > _FAR**2 * np.median(usual)).any():
        return pulls, found
    columns = [fit.claim.only(~far) for fit in found if fit.claim.step]
    return pulls.only(~far), _fits(pulls.only(~far), columns)


def _count(pulls: _Pulls) -> int:
    """Number of hypotheses."""
    return len([*_places(pulls)]) + 2 * max(len(pulls.place) - LEAST_SHIFTED, 0)


def _places(pulls: _Pulls) -> Iterator[_Claim]:
    """Each anchor of some pulls with each of its coordinates free, and all."""
    axes = np.eye(3)
    for anchor in np.unique(pulls.place).tolist():
        mine = pulls.place == anchor
        if mine.sum() >= _FEWEST and len(np.unique(pulls.pose[mine])) > 1:
            for free in (axes[:, :1], axes[:, 1:2], axes[:, 2:], axes):
                yield _Claim(pulls.place, anchor, free)


def _suspicious(pulls: _Pulls) -> bool:
    """Whether the springs leave more than the least, or some anchor elsewhere is likelier."""
    x = pulls.moved.solved(pulls.moved.force)
    none = _rows(pulls, _Claim(pulls.place), pulls.at, x).averaged(_SPRINGS)
    near = (_rows(pulls, one, pulls.at, x).averaged(_SPRINGS)[0] for one in _places(pulls))
    return none[1] > _SPRINGS[0] or max(near, default=-np.inf) > none[0]


def _fits(pulls: _Pulls, columns: list[_Claim]) -> list[_Fit]:
    """The hypothesis that nothing is wrong, each of `_places`, and the best of the columns."""
    x = pulls.moved.solved(pulls.moved.force)
    claims = [_Claim(pulls.place), *_places(pulls), *columns]
    return [_fit(pulls, one, _begin(pulls, one, x), x) for one in claims]


def _rows(pulls: _Pulls, claim: _Claim, at: Array, x: Array) -> Rows:
    """Rows of a hypothesis, linearised at compliances x and places `at`, in blocks of poses."""
    A, by_place = pulls.along(claim.place, at)
    mine = (claim.place == claim.anchor)[:, None, None]
    D = mine * np.einsum("mckj,k->mcj", by_place, x) @ claim.free
    blocks, own = _by_pose(pulls, (A * x).reshape(-1, len(x)))
    each, eye = np.repeat(pulls.noise(1.0) - pulls.noise(0.0), A.shape[1]), np.eye(own.shape[1])
    return Rows(
        y=blocks.padded((pulls.moved.y - A @ x).ravel()),
        X=blocks.padded(np.concatenate([A, D], axis=2).reshape(-1, len(x) + D.shape[2])),
        noise=pulls.moved.noise**2 * np.broadcast_to(eye, (len(own), *eye.shape)),
        model=own @ np.swapaxes(own, 1, 2) + eye * blocks.padded(each)[:, None, :],
    )


def _by_pose(pulls: _Pulls, rows: Array) -> tuple[Blocks, Array]:
    """Blocks of the coordinates of each pose, and some rows (m c, k) in them."""
    blocks = Blocks.of(np.repeat(pulls.pose, len(rows) // len(pulls.pose)))
    return blocks, blocks.padded(rows)


def _begin(pulls: _Pulls, claim: _Claim, x: Array) -> Array:
    """Place of the anchor of a hypothesis, off in one coordinate, that fits compliances x best."""
    if claim.anchor < 0:
        return np.zeros(3)
    mine = pulls.only(pulls.place == claim.anchor)
    axes = claim.free.T if claim.free.shape[1] == 1 else np.eye(3)
    tried = pulls.at[claim.anchor] + (_TRIED_M[:, None, None] * axes).reshape(-1, 3)
    each = np.einsum("mckj,k->mcj", mine.each, x)
    u = linear.normed(tried[:, None] - mine.near)
    off = mine.moved.y - mine.moved.force[:, None] * np.einsum("mcj,tmj->tmc", each, u)
    return np.asarray(tried[np.argmin((np.mean(off**2, axis=2) / mine.noise(_AT_FIRST)).sum(1))])


def _fit(pulls: _Pulls, claim: _Claim, begin: Array, x: Array) -> _Fit:
    """Fit of a hypothesis, from a place of its anchor and compliances on."""
    at, k, s = pulls.at.copy(), len(x), float(np.median(_SPRINGS))
    at[claim.anchor] = begin if claim.anchor >= 0 else at[claim.anchor]
    for _ in range(_STEPS):
        step = _rows(pulls, claim, at, x).solved(s)[0]
        move = claim.free @ step[k:]
        x, stride = x + step[:k], float(np.linalg.norm(move))
        at[claim.anchor] += move * min(1.0, _STRIDE_M / max(stride, linear.TINY))
        if stride < _SETTLED_M and np.abs(step[:k]).max() < _SETTLED_M:
            break
    rows = _rows(pulls, claim, at, x)
    evidence, s = rows.averaged(_SPRINGS)
    with np.errstate(invalid="ignore"):  # infinite where the pulls do not determine it
        cov = claim.free @ rows.solved(s)[1][k:, k:] @ claim.free.T
    left = np.mean((pulls.moved.y - pulls.along(claim.place, at)[0] @ x) ** 2, axis=1)
    return _Fit(claim, evidence, s, at[claim.anchor], np.sqrt(np.diag(cov)), left)


# --- a place --------------------------------------------------------------------------------------


def _of_place(case: Case, pulls: _Pulls, best: _Fit, none: _Fit, instead: list[int]) -> Mistake:
    """The mistake of one place, put where it was meant to be, or where the pulls say."""
    names, number = [*case.settings.anchors], best.claim.anchor
    name, stated = names[number], pulls.at[number]
    meant = _meant(best, stated)
    right = best.at if meant is None else meant[0]
    mine = best.claim.place == number
    count = int(mine.sum())
    place = ", ".join(f"{x:.4f}" for x in best.at)
    off, std = length(float(np.linalg.norm(right - stated))), length(float(best.std.max()))
    slip = "" if meant is None else meant[1]
    before, after = _rms_mm(none, mine), _rms_mm(best, mine)
    return outlying(
        name,
        f"the anchor {name} is {off} from its place in [anchors]: its {count} pulls go to "
        f"[{place}] m in F_b, ± {std} per axis{slip}. The joint springs then leave "
        f"{plain(after, 2)} mm rms of their displacements instead of {plain(before, 2)} mm",
        f"recomputed with {name} at [{', '.join(f'{x:.7g}' for x in right)}] m",
        unit="mm",
        before=before,
        after=after,
        size=float(np.linalg.norm(right - stated)),
        places=_count(pulls),
        instead=tuple(names[n] for n in instead),
        entry=("anchors", name),
        correct=partial(with_places, "anchors", {name: tuple(right.tolist())}),
    )


def _meant(best: _Fit, stated: Array) -> tuple[Array, str] | None:
    """The place that was meant, one slip in one number away, and what happened to that number."""
    if best.claim.free.shape[1] != 1:
        return None
    axis = int(np.argmax(best.claim.free[:, 0]))
    given, fits, std = (float(one[axis]) for one in (stated, best.at, best.std))
    if abs(given + fits) <= WITHIN * std:
        found: tuple[float, str] | None = (-given, "the wrong sign")
    else:
        found = intended(abs(given), abs(fits), std) if given * fits > 0 else None
    if found is None or found[1] in GUESSES:
        return None
    number = float(np.copysign(found[0], fits))
    at = stated.copy()
    at[axis] = number
    return at, f"; {number:.7g} was probably meant by its {'xyz'[axis]}, {given:.7g}: {found[1]}"


# --- a column that is off by one ------------------------------------------------------------------


def _columns(pulls: _Pulls) -> Iterator[_Claim]:
    """The likeliest row from which on all name the anchor of the row before, or after.

    Which anchor belongs to the row at the open end nobody wrote down: the one that fits best.
    """
    order, m = np.argsort(pulls.row), len(pulls.row)
    weight = 1 / np.sqrt(pulls.noise(_AT_FIRST))[:, None]
    y = weight * pulls.moved.y
    A = [weight[..., None] * pulls.along(np.full(m, n), pulls.at)[0] for n in range(len(pulls.at))]
    N = np.array([a.mT @ a for a in A])
    g = np.array([(a.mT @ y[..., None])[..., 0] for a in A])
    pull, least, best = np.arange(m), np.inf, _Claim(pulls.place)
    for begin, step in product(range(m - LEAST_SHIFTED + 1), (1, -1)):
        rows = order[begin:][::step]  # each row has what belongs to the next one
        place = pulls.place.copy()
        place[rows[1:]] = pulls.place[rows[:-1]]
        others = np.delete(pull, rows[0])
        n = N[place[others], others].sum(axis=0) + N[:, rows[0]]
        b = g[place[others], others].sum(axis=0) + g[:, rows[0]]
        left = -np.einsum("ni,nij,nj->n", b, linear.shortest(n), b)
        place[rows[0]] = int(np.argmin(left))
        if left.min() < least:
            least, best = float(left.min()), _Claim(place, begin=begin, step=step)
    if (best.place != pulls.place).any():
        yield best


def _of_column(asked: Screening, pulls: _Pulls, best: _Fit, none: _Fit) -> Mistake:
    """The mistake that rows are off by one, from the first to the last that is wrong."""
    case, names = asked.case, [*asked.case.settings.anchors]
    order, now = np.argsort(pulls.row), best.claim.place
    wrong = np.flatnonzero((now != pulls.place)[order])
    rows = order[wrong.min() : wrong.max() + 1]
    of = case.loads.iloc[pulls.row[rows]]
    ring = shift(np.arange(len(rows)), best.claim.step, ended=True)
    keys = list(zip(of["pose"].astype(int), of["repeat"].astype(int), strict=True))
    said = [f"pose{p:02d} rep{r}" for p, r in keys]
    file, at = str(of["file"].iloc[0]), lines_of(of)
    where = f"{file} {ring.where(said)}"
    before, after = _rms_mm(none, rows), _rms_mm(best, rows)
    return Mistake(
        name="exchanged",
        where=where,
        evidence=f"{file}: the anchors of {in_words(ring, said)} stand {misplacement(ring, 'row')} "
        f"({lines(at)}): towards those of the other rows the joint springs leave {plain(after, 2)} "
        f"mm rms of the displacements instead of {plain(before, 2)} mm",
        correction=f"recomputed with the anchors of {where} moved by one row",
        before=before,
        after=after,
        places=_count(pulls),
        correct=partial(
            _named, {key: names[n] for key, n in zip(keys, now[rows].tolist(), strict=True)}
        ),
        at=at,
    )


def _rms_mm(fit: _Fit, rows: Ints | Bools) -> float:
    """Rms that a hypothesis leaves of the displacements of some pulls [mm]."""
    return 1e3 * float(np.sqrt(fit.left[rows].mean()))


def _named(true: dict[tuple[int, int], str], case: Case) -> Case:
    """The campaign with some pulls, (pose, repeat), towards other anchors."""
    return replace(case, anchors={**case.anchors, **true})
