"""Laws that nobody listed, searched in what table and springs leave.

At each pose a law of joint j shows in u_j = z_j' e and w_j = z_j' z_j, z_j the whitened motion of
the joint and e the whitened residual: a candidate g explains

    T = (g'u)' [g' diag(w) g - (g'P) N^-1 (P'g)]^-1 (g'u),     P = z_j' D,

beside the columns D of all that is estimated in any case, with N their products. Thousands of
candidates are tried, and the largest T of them all is held against the largest that arises where
there is no law: residuals of blocks of poses, neighbours in time or on the rail, with their signs
flipped, which keeps what neighbours share and destroys what depends on the robot.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.geometry import curves
from pipeline.geometry.estimate import ReadRows
from pipeline.geometry.identify import Identified
from pipeline.geometry.laws import Inputs, JointLaw, Variable
from pipeline.geometry.mechanism import frame_of
from pipeline.geometry.readings import PositionReadings
from pipeline.system import alarms

_ORDERS = np.arange(0.5, 130.01, 0.25)
"""Periods per turn: eccentric wheels have one, gears of robots up to some hundred teeth."""

_COUPLED = (1.0, 2.0, 3.0)
"""Periods per turn of another joint: what turns with it pulls once, twice or three times."""

_BLOCK = 8
"""Poses whose residuals keep their signs to each other."""

FLIPS = 200
"""Copies without a law."""


@dataclass(frozen=True, eq=False)
class Score(Locked):
    """What is left of the readings, joint by joint, and what of it a law could explain.

    Attributes:
        u: z_j' e at each pose and joint, of the readings and then of copies without a law, shape
            (1 + copies, m, n).
        w: z_j' z_j, shape (m, n).
        rows: The whitened rows of the estimate.
        P: z_j' D, shape (m, n, dense).
        Q: z_j' K, shape (m, n, 2 c).
        cov: N^-1 with the priors, shape (k, k).
        left: Whitened residuals, shape (m, r).
        copied: Those of which the copies are made, as large as noise, shape (m, r).
        x: What the estimates of the copies are, shape (k, copies).
    """

    u: Array
    w: Array
    rows: ReadRows
    P: Array
    Q: Array
    cov: Array
    left: Array
    copied: Array
    x: Array

    def products(self, g: Array, joint: int) -> Array:
        """X'z_j g of columns g (m, k): what they share with all that is estimated, (K, k)."""
        head = self.P[:, joint].T @ g
        tail = np.zeros((self.rows.knots, g.shape[1]))
        for k in range(self.Q.shape[2]):
            np.add.at(tail, self.rows.at[:, k], self.Q[:, joint, k, None] * g)
        return np.vstack([head, tail])


@dataclass(frozen=True, eq=False)
class MoveTime(Locked):
    """A time from which on the instrument stood elsewhere.

    Attributes:
        pose: The first of its series that was read from there.
        p: Chance of so much somewhere if it never moved.
    """

    pose: int
    p: float


def score(found: Identified, signs: Array, copied: Array | None = None) -> Score:
    """The residuals of an estimate, and of copies whose residuals have other signs.

    Args:
        found: The estimate.
        signs: Of each copy, shape (copies, m).
        copied: Whitened residuals of which the copies are made, shape (m, r); those of the estimate
            when not given.
    """
    rows, cov = found.rows, found.solution.cov
    Z = rows.W @ found.linear.Z[:, found.linear.used, : found.mechanism.table.n]
    e = rows.y - rows.along(found.solution.x)
    left = _as_noise(rows.variance(cov), e if copied is None else copied)
    P, Q = (np.swapaxes(Z, 1, 2) @ one for one in (rows.D, rows.K))
    own = np.einsum("mrn,mr->mn", Z, left)
    D = np.einsum("mrd,mr->md", rows.D, left)
    K = np.einsum("mrk,mr->mk", rows.K, left)
    seen = np.zeros((len(cov), len(signs)))
    dense = D.shape[1]
    seen[:dense] = D.T @ signs.T
    for k in range(K.shape[1]):
        np.add.at(seen[dense:], rows.at[:, k], (signs * K[:, k]).T)
    x = cov @ seen
    u = np.empty((1 + len(signs), *own.shape))
    u[0] = np.einsum("mrn,mr->mn", Z, e)
    for joint in range(own.shape[1]):
        beside = P[:, joint] @ x[:dense]
        for k in range(K.shape[1]):
            beside += Q[:, joint, k, None] * x[dense:][rows.at[:, k]]
        u[1:, :, joint] = signs * own[:, joint] - beside.T
    return Score(u, np.einsum("mrn,mrn->mn", Z, Z), rows, P, Q, cov, e, left, x)


def _as_noise(H: Array, left: Array) -> Array:
    """Residuals (m, r) of each pose as large as the noise that they are of, (1 - H)^-1/2 e.

    An estimate takes the part H (m, r, r) of it out, and another one from copies takes it once
    more: of 70 poses copies without a law reached a fifth less than readings without any.
    """
    share, along = linear.directions(np.eye(H.shape[1]) - H)
    inside = np.einsum("mrk,mr->mk", along, left) / np.sqrt(np.maximum(share, _LEAST_LEFT))
    return np.asarray(np.einsum("mrk,mk->mr", along, inside))


_LEAST_LEFT = 0.05
"""Part of a reading's noise that an estimate leaves at least; of less nothing is known."""


def blocks(readings: PositionReadings) -> Ints:
    """Block of each pose: neighbours in the order of measurement, of one series, (m,)."""
    place = np.zeros(len(readings), dtype=np.int64)
    for series in range(len(readings.names)):
        mine = np.flatnonzero(readings.series == series)
        place[mine] = np.arange(len(mine)) // _BLOCK
    _, out = np.unique(np.stack([readings.series, place]), axis=1, return_inverse=True)
    return np.asarray(out, dtype=np.int64)


def flips(
    readings: PositionReadings, rng: np.random.Generator, count: int = FLIPS, rail: bool = False
) -> Array:
    """Signs of copies without a law, shape (count, m).

    Blocks are neighbours in time and, of every second copy on a rail, stations: what poses of
    either share stays in the copies. Parts of joint space would keep what a joint does there.
    """
    every, stops = [blocks(readings)], stations(readings)
    if rail and len(np.unique(stops)) >= _BLOCK:
        every.append(stops)
    return np.stack([
        rng.choice([-1.0, 1.0], int(block.max()) + 1)[block]
        for block in (every[k % len(every)] for k in range(count))
    ])  # fmt: skip


def stations(readings: PositionReadings) -> Ints:
    """Where the carriage stood: places of the first joint more than `_APART_M` apart, (m,)."""
    along = readings.q[:, 0]
    order = np.argsort(along, kind="stable")
    out = np.empty(len(along), dtype=np.int64)
    out[order] = np.cumsum(np.append(0, np.diff(along[order]) > _APART_M))
    return out


_APART_M = 0.02
"""A carriage that goes to a station anew comes nearer to where it stood."""


def candidates(inputs: Inputs, prismatic: Bools) -> Iterator[JointLaw]:
    """Every law that is tried, of every joint; the curves are tried beside them."""
    n = inputs.q.shape[1]
    for joint in range(1, n + 1):
        for order in _ORDERS[_shortest(inputs.q[:, joint - 1]) > _ORDERS].tolist():
            yield JointLaw(joint, "periodic", "angle", joint, order)
        yield from _of_torque(inputs, joint)
        for other in range(1, n + 1):
            if other != joint and not prismatic[other - 1]:
                for order in _COUPLED:
                    yield JointLaw(joint, "coupling", "angle", other, order)
        yield from _of_surroundings(inputs, joint)
        yield from steps_in_time(inputs, joint)


def _shortest(q: Array) -> float:
    """Order of the shortest wave that the values of a joint can show: two of them to a wave."""
    values = np.unique(np.round(q, 3))
    return np.pi * (len(values) - 1) / max(float(np.ptp(values)), 1e-3)


def steps_in_time(inputs: Inputs, joint: int) -> Iterator[JointLaw]:
    """A joint that stands elsewhere from some time on: it slipped, or was referenced anew."""
    return _steps(inputs, joint, times(inputs))


def _steps(inputs: Inputs, joint: int, poses: Iterable[int]) -> Iterator[JointLaw]:
    """The same before some of the poses."""
    when = inputs.series + inputs.time
    for pose in poses:
        before, after = when[[pose - 1, pose]]
        if before < after:
            yield JointLaw(joint, "step", "time", None, 0.0, float(0.5 * (before + after)))


def times(inputs: Inputs) -> list[int]:
    """Poses before which something may have happened: every fortieth of all, blocks apart."""
    m = len(inputs.q)
    apart = max(m // _TIMES, _BLOCK)
    return list(range(apart, m - apart + 1, apart))


_TIMES = 40
"""Poses of a series from which on the instrument may have moved: tried so many, evenly."""


def _of_torque(inputs: Inputs, joint: int) -> Iterator[JointLaw]:
    tau = inputs.tau[:, joint - 1]
    scale = float(np.abs(tau).max())
    if scale > 0:
        for degree in (2.0, 3.0):
            yield JointLaw(joint, "smooth", "torque", joint, degree, 0.0, scale)


def _of_surroundings(inputs: Inputs, joint: int) -> Iterator[JointLaw]:
    surroundings: tuple[tuple[Variable, Array], ...] = (
        ("temperature", inputs.temperature),
        ("time", inputs.time),
    )
    for name, v in surroundings:
        if np.isfinite(v).all() and np.ptp(v) > 0:
            yield JointLaw(joint, "smooth", name, None, 1.0, float(v.mean()), float(np.ptp(v)) / 2)


@dataclass(frozen=True, eq=False)
class LawClue(Locked):
    """How much a law would explain.

    Attributes:
        law: The law; None for a curve over the joint's own angle.
        joint: Which it moves, from 1.
        statistic: T; of a curve h' R h, which compares with other curves only.
        p: Chance of so much somewhere, in residuals without any law.
    """

    law: JointLaw | None
    joint: int
    statistic: float
    p: float


def explained(here: Score, laws: Sequence[JointLaw], inputs: Inputs) -> Array:
    """T of laws of one joint with as many amplitudes each, for readings and copies.

    Returns:
        Shape (laws, 1 + copies).
    """
    joint, k = laws[0].joint - 1, laws[0].amplitudes
    g = np.concatenate([law.basis(inputs) for law in laws], axis=1)
    shared = here.products(g, joint)
    known = here.cov @ shared
    num = (here.u[:, :, joint] @ g).T.reshape(len(laws), k, -1)
    whole, info = np.empty((len(laws), k)), np.empty((len(laws), k, k))
    for a in range(k):
        for b in range(k):
            own = (g[:, a::k] * g[:, b::k]).T @ here.w[:, joint]
            info[:, a, b] = own - np.einsum("dk,dk->k", shared[:, a::k], known[:, b::k])
            if a == b:
                whole[:, a] = own
    inverse, _ = linear.left(info, np.maximum(whole, _NOTHING))
    return np.asarray(np.einsum("lks,lkj,ljs->ls", num, inverse, num))


_NOTHING = 1e-30
"""Of a column that is zero."""


def _most_by_a_joint(here: Score, inputs: Inputs) -> float:
    """The most that a joint explains which stands elsewhere from some time on."""
    every = range(1, inputs.q.shape[1] + 1)
    return max(
        float(explained(here, list(steps_in_time(inputs, joint)), inputs)[:, 0].max())
        for joint in every
    )


def moved(found: Identified, signs: Array) -> MoveTime | None:
    """Whether the instrument stood elsewhere from some pose of a series on; None where it did not.

    Six columns, zero before that pose, of turn and shift of the frame of its series. Joints that
    stand elsewhere from some time on explain the same readings; the model with the larger
    T - k log N is preferred, k its amplitudes and N the number of readings (Schwarz, Annals of
    Statistics 6, 1978). T is held against that of copies of what the likeliest move leaves (ter
    Braak, in Bootstrapping and Related Techniques, 1992): a move is most of what it disturbs, and
    copies with it in them would reach as much.

    Args:
        found: The estimate.
        signs: Of copies whose residuals have other signs, shape (copies, m).
    """
    inputs, plain = found.linear.inputs, score(found, signs[:0])
    at = [pose for pose in times(inputs) if inputs.series[pose - 1] == inputs.series[pose]]
    if not at:
        return None
    seen = [_frame_moved(found, plain, pose, signs[:0]) for pose in at]
    best = int(np.argmax([one.T[0] for one in seen]))
    here = score(found, signs, seen[best].left(found, plain))
    frames = np.stack([_frame_moved(found, here, pose, signs).T for pose in at])
    cost = float(np.log(found.linear.read.sum()))
    rival = _most_by_a_joint(here, inputs) - cost
    p = _beyond(frames[:, 1:].max(axis=0), frames[best, :1]).item()
    if p >= alarms.MOVED or frames[best, 0] - 6 * cost < rival:
        return None
    own = inputs.series[at[best]]
    beside = [pose for pose in _near(inputs, at[best]) if inputs.series[pose - 1] == own]
    beside = [pose for pose in beside if inputs.series[pose] == own]
    none = signs[:0]
    return MoveTime(max(beside, key=lambda k: float(_frame_moved(found, plain, k, none).T[0])), p)


class _FrameMoved(NamedTuple):
    """The instrument's having moved before a pose of a series.

    Attributes:
        T: Of readings and copies, (1 + copies,).
        after: Poses that it changes.
        F: Derivatives of their rows by turn and shift, (m', r, 6).
        shared: What these have in common with all parameters, (k, 6).
        size: Of the move, (6,).
    """

    T: Array
    after: slice | Ints
    F: Array
    shared: Array
    size: Array

    def left(self, found: Identified, here: Score) -> Array:
        """What the move leaves of the readings, (m, r)."""
        left = here.left + found.rows.along(here.cov @ (self.shared @ self.size))
        left[self.after] -= self.F @ self.size
        return left


def _frame_moved(found: Identified, here: Score, pose: int, signs: Array) -> _FrameMoved:
    series = int(found.readings.series[pose])
    at = np.flatnonzero(found.readings.series == series)
    at = at[at >= pose]
    neighbours = at[-1] - at[0] + 1 == len(at)  # a slice of an array is no copy
    after = slice(at[0], at[-1] + 1) if neighbours else at
    rows = found.rows
    D = rows.D[after]
    dense, F = D.shape[2], D[:, :, frame_of(found.mechanism, series)]
    shared, flat = np.zeros((len(here.cov), 6)), F.reshape(-1, 6)
    shared[:dense] = D.reshape(-1, dense).T @ flat
    beside = np.swapaxes(rows.K[after], 1, 2) @ F
    for k in range(rows.K.shape[2]):
        np.add.at(shared[dense:], rows.at[after, k], beside[:, k])
    own, copied = (np.einsum("mrk,mr->mk", F, one[after]) for one in (here.left, here.copied))
    num = np.column_stack([own.sum(axis=0), copied.T @ signs[:, after].T])
    num[:, 1:] -= shared.T @ here.x[:, : len(signs)]
    whole = flat.T @ flat
    inverse, _ = linear.left(whole - shared.T @ here.cov @ shared, np.diag(whole))
    T = np.asarray(np.einsum("ks,kl,ls->s", num, inverse, num))
    return _FrameMoved(T, after, F, shared, inverse @ num[:, 0])


def sharpened(here: Score, law: JointLaw, inputs: Inputs) -> JointLaw:
    """A step in time before the pose that explains most, beside that of the search."""
    if not law.once:
        return law
    pose = int(np.argmax(inputs.series + inputs.time > law.middle))
    near = list(_steps(inputs, law.joint, _near(inputs, pose)))
    T = explained(here, near, inputs)[:, 0]
    return near[int(np.argmax(T))]


def _near(inputs: Inputs, pose: int) -> range:
    """Poses between the one before and the one after of `times`."""
    apart = max(len(inputs.q) // _TIMES, _BLOCK)
    return range(max(pose - apart + 1, 1), min(pose + apart, len(inputs.q)))


def curved(here: Score, joint: int, q: Array, slides: bool) -> Array:
    """How much smooth curves over a joint's own angle would explain: h' R h, (1 + copies,).

    h = K'u, what the residuals say of each knot, R the correlation of the knots.
    """
    length = curves.LENGTHS[slides][0]
    one = curves.over(joint, q[:, joint], slides, length, 1.0)
    h = here.u[:, :, joint] @ one.rows(q[:, joint])
    return np.asarray(np.einsum("sk,kl,sl->s", h, one.shape(), h))


def clues(
    here: Score, inputs: Inputs, laws: Sequence[JointLaw], bent: Sequence[bool] = ()
) -> list[LawClue]:
    """All laws and curves, the largest share of the sum of squares first.

    Each T is standardised by what it reaches in the copies. p is the chance that the largest of
    all lies as far beyond: among the copies, and by an extreme-value distribution fitted to theirs.

    Args:
        here: Residuals.
        inputs: What laws are of.
        laws: Those that are tried.
        bent: For each joint whether it slides, where curves are tried too; empty where not.
    """
    kinds = sorted({(law.joint, law.amplitudes) for law in laws})
    of: list[tuple[JointLaw | None, int]] = []
    T: list[Array] = []
    for kind in kinds:
        mine = [law for law in laws if (law.joint, law.amplitudes) == kind]
        T.append(explained(here, mine, inputs))
        of += [(law, law.joint) for law in mine]
    for joint, slides in enumerate(bent):
        T.append(curved(here, joint, inputs.q, slides)[None])
        of.append((None, joint + 1))
    each = np.concatenate(T)
    p = beyond_copies(each)
    found = [
        LawClue(law, joint, float(t), float(chance))
        for (law, joint), t, chance in zip(of, each[:, 0], p, strict=True)
    ]
    return sorted(found, key=lambda clue: -clue.statistic)


def beyond_copies(T: Array) -> Array:
    """Chance of as much of any candidate in the copies, of each row of (k, 1 + copies)."""
    told = T.any(axis=1)  # what the readings say nothing of is in no copy
    out = np.ones(len(T))
    if told.any():
        out[told] = _chance(_standard(T[told]))
    return out


def _chance(z: Array) -> Array:
    """Chance of as much somewhere in the copies, of each row of (k, 1 + copies) standardised."""
    most = z[:, 1:].max(axis=0)
    rank = (1 + (most >= z[:, :1]).sum(axis=1)) / (1 + len(most))
    return np.where(rank > 1 / len(most), rank, _beyond(most, z[:, 0]))


def _beyond(most: Array, found: Array) -> Array:
    """Chance of more than was found, by an extreme-value distribution fitted to the copies."""
    from scipy import stats  # half a second to import, and laws of joints alone need it

    return np.asarray(stats.gumbel_r.sf(found, *stats.gumbel_r.fit(most)))


def _standard(T: Array) -> Array:
    """Sums of squares (k, copies), each standardised by all others of its law, by cube roots."""
    root = np.cbrt(np.maximum(T, 0.0))
    n = root.shape[1] - 1
    mean = (root.sum(axis=1, keepdims=True) - root) / n
    square = ((root**2).sum(axis=1, keepdims=True) - root**2) / n
    return np.asarray((root - mean) / np.sqrt(np.maximum(square - mean**2, 1e-18)))
