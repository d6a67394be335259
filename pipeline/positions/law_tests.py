"""Search for laws outside the catalogue in the residuals of table and springs.

At each pose, a law of joint j appears in u_j = z_j' e and w_j = z_j' z_j, with z_j the whitened
motion of the joint and e the whitened residual. A candidate g explains

    T = (g'u)' [g' diag(w) g - (g'P) N^-1 (P'g)]^-1 (g'u),     P = z_j' D,

in addition to the columns D of everything that is estimated in any case, with N = D'D plus priors.
The largest T of thousands of candidates is compared with the largest in copies without a law: the
signs of the residuals are flipped by blocks of poses, neighbours in time or on the rail, which
keeps what neighbours have in common and destroys any dependence on the robot's configuration.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import optimize, sparse, special

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.positions import law_sums, random_curve
from pipeline.positions.calibrate import Calibration
from pipeline.positions.estimate import ReadRows
from pipeline.positions.law_sums import LawSums
from pipeline.positions.laws import Inputs, JointLaw, LawVariable
from pipeline.positions.mechanism import frame_of, layout
from pipeline.positions.readings import PositionReadings
from pipeline.system import alarms

_STEP = 0.25
"""Distance of the orders that are tried [1]."""

_ORDERS = np.arange(0.5, 300.01, _STEP)
"""Periods per turn that are tried [1]: eccentric wheels have one, and a motor makes some 300 turns
at most per turn of its joint, an estimate for heavy robots."""

NEAR = np.linspace(-0.5, 0.5, 81)
"""Orders tried about the one found by the search [1], periods per turn."""

_COUPLED = (1.0, 2.0, 3.0)
"""Periods per turn of another joint that are tried [1]: what turns with it acts once, twice or
three times per turn."""

_BLOCK, _BLOCKS = 8, 20
"""Maximum number of consecutive poses whose residuals share one sign in a copy, and minimum number
of such blocks: b blocks make 2^(b - 1) different copies, sixteen of 40 poses by eights."""

_FLIPS = 200
"""Number of copies without a law."""


@dataclass(frozen=True, eq=False)
class _LawScore(Locked):
    """Residuals projected on the joints' motions, and what is needed to test laws on them.

    Attributes:
        u: z_j' e at each joint and pose, of the readings and then of the copies,
            shape (n, 1 + copies, m).
        w: z_j' z_j, shape (m, n).
        Z: z_j, shape (m, r, n).
        rows: The whitened rows of the estimate.
        P: z_j' D, shape (n, m, dense).
        Q: z_j' K for each joint, shapes (m, knots).
        cov: N^-1 including the priors, shape (k, k).
        left: Whitened residuals, shape (m, r).
        copied: Residuals that the copies are made of, rescaled to the size of the noise,
            shape (m, r).
        x: Estimates from the copies, shape (k, copies).
    """

    u: Array
    w: Array
    Z: Array
    rows: ReadRows
    P: Array
    Q: list[sparse.csr_array]
    cov: Array
    left: Array
    copied: Array
    x: Array

    def projected(self, left: Array, joint: int) -> Array:
        """z_j' e of whitened residuals (m, r), shape (1, m)."""
        return np.einsum("mr,mr->m", self.Z[..., joint], left)[None]

    def products(self, g: LawSums, joint: int) -> Array:
        """X' z_j g of functions g: their products with all that is estimated, (K, l k)."""
        return np.vstack([g.of(self.P[joint]).T, g.of(self.Q[joint]).T])


def score(found: Calibration, signs: Array, copied: Array | None = None) -> _LawScore:
    """Projected residuals of an estimate, and of copies with flipped signs.

    Args:
        found: The estimate.
        signs: Signs of each copy, shape (copies, m).
        copied: Whitened residuals that the copies are made of, shape (m, r); by default those of
            the estimate.
    """
    rows, known = found.rows, found.by_readings
    n, dense, cov = found.mechanism.table.n, rows.D.shape[2], known.cov
    Z = rows.W @ found.linear.Z[:, found.linear.used, :n]
    e = rows.y - rows.along(found.solution.x)
    left = _as_noise(found.held, e if copied is None else copied)
    own, P, K = (np.swapaxes(Z, 1, 2) @ one for one in (left[..., None], rows.D, rows.K))
    P, Q = np.ascontiguousarray(np.swapaxes(P, 0, 1)), list(map(rows.by_knots, np.split(K, n, 1)))
    D, K = (left[:, None] @ one for one in (rows.D, rows.K))
    x = cov @ np.vstack([one.T @ signs.T for one in (D[:, 0], rows.by_knots(K))])
    u = np.empty((n, 1 + len(signs), len(e)))
    u[:, 0] = np.einsum("mrn,mr->nm", Z, e)
    for joint in range(n):
        beside = P[joint] @ x[:dense] + Q[joint] @ x[dense:]
        u[joint, 1:] = signs * own[:, joint, 0] - beside.T
    return _LawScore(u, np.einsum("mrn,mrn->mn", Z, Z), Z, rows, P, Q, cov, e, left, x)


def _as_noise(H: Array, left: Array) -> Array:
    """Residuals (m, r) of each pose rescaled to the size of the noise, (1 - H)^-1/2 e.

    An estimate absorbs the part H (m, r, r) of the noise, and the estimate from a copy absorbs it
    again: with 70 poses, copies without a law reached T a fifth smaller than readings without one.
    """
    share, along = linear.directions(np.eye(H.shape[1]) - H)
    inside = np.einsum("mrk,mr->mk", along, left) / np.sqrt(np.maximum(share, _LEAST_LEFT))
    return np.asarray(np.einsum("mrk,mk->mr", along, inside))


_LEAST_LEFT = 0.05
"""Lower limit of the fraction of the noise that remains in the residuals [1], against division by
zero."""


def blocks(readings: PositionReadings) -> Ints:
    """Block of each pose, (m,): consecutive poses of one series."""
    place = np.zeros(len(readings), dtype=np.int64)
    long = int(np.clip(len(readings) // _BLOCKS, 1, _BLOCK))
    for series in range(len(readings.names)):
        mine = np.flatnonzero(readings.series == series)
        place[mine] = np.arange(len(mine)) // long
    _, out = np.unique(np.stack([readings.series, place]), axis=1, return_inverse=True)
    return np.asarray(out, dtype=np.int64)


def flips(
    readings: PositionReadings, rng: np.random.Generator, count: int = _FLIPS, rail: bool = False
) -> Array:
    """Signs of the copies without a law, shape (count, m).

    Blocks are neighbours in time and, in every second copy on a rail of `_BLOCKS` stations or more,
    these: what the poses of a block have in common stays in the copies. Blocks in joint space would
    preserve a joint law.
    """
    every, stops = [blocks(readings)], stations(readings)
    if rail and len(np.unique(stops)) >= _BLOCKS:
        every.append(stops)
    return np.stack([
        rng.choice([-1.0, 1.0], int(block.max()) + 1)[block]
        for block in (every[k % len(every)] for k in range(count))
    ])  # fmt: skip


def stations(readings: PositionReadings) -> Ints:
    """Station of each pose, (m,): values of the first joint more than `_APART_M` apart."""
    along = readings.q[:, 0]
    order = np.argsort(along, kind="stable")
    out = np.empty(len(along), dtype=np.int64)
    out[order] = np.cumsum(np.append(0, np.diff(along[order]) > _APART_M))
    return out


_APART_M = 0.02
"""Minimum distance of two stations of the carriage [m]; a return to the same station is closer."""


def candidates(inputs: Inputs, prismatic: Bools) -> Iterator[JointLaw]:
    """Every law that is tried, of every joint; curves are tried in addition."""
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
        yield from _steps(inputs, joint, _times(inputs))


def _shortest(q: Array) -> float:
    """Highest order that the values of a joint can resolve: two values per period.

    Of unequal distances the median counts: half of the neighbouring values are nearer, and a grid
    of poses has equal ones.
    """
    values = np.unique(np.round(q, 3))
    return np.pi / float(np.median(np.diff(values))) if len(values) > 1 else 0.0


def _steps(inputs: Inputs, joint: int, poses: Iterable[int]) -> Iterator[JointLaw]:
    """Steps in time of a joint's zero, which slipped or was referenced anew before given poses."""
    when = inputs.series + inputs.time
    for pose in poses:
        before, after = when[[pose - 1, pose]]
        if before < after:
            yield JointLaw(joint, "step", "time", None, 0.0, float(0.5 * (before + after)))


def _times(inputs: Inputs) -> list[int]:
    """Poses before which a step is tried: at most some forty, at least a block apart."""
    m = len(inputs.q)
    apart = max(m // _TIMES, _BLOCK)
    return list(range(apart, m - apart + 1, apart))


_TIMES = 40
"""Number of times at which a step or a move of the instrument is tried, evenly spaced."""


def _of_torque(inputs: Inputs, joint: int) -> Iterator[JointLaw]:
    tau = inputs.tau[:, joint - 1]
    scale = float(np.abs(tau).max())
    if scale > 0:
        for degree in (2.0, 3.0):
            yield JointLaw(joint, "smooth", "torque", joint, degree, 0.0, scale)


def _of_surroundings(inputs: Inputs, joint: int) -> Iterator[JointLaw]:
    surroundings: tuple[tuple[LawVariable, Array], ...] = (
        ("temperature", inputs.temperature),
        ("time", inputs.time),
    )
    for name, v in surroundings:
        if np.isfinite(v).all() and np.ptp(v) > 0:
            yield JointLaw(joint, "smooth", name, None, 1.0, float(v.mean()), float(np.ptp(v)) / 2)


def is_of_output(law: JointLaw) -> bool:
    """Whether a wave is of what turns with the joint, whose error is the same after every turn."""
    own = law.kind == "periodic" and law.source == law.joint
    return own and law.order <= _BOLTS and law.order == round(law.order)


def beside_output(law: JointLaw) -> bool:
    """Whether a wave stands in the place of one of what turns with the joint."""
    own = law.kind == "periodic" and law.source == law.joint
    return own and law.order < _BOLTS + 0.5 and law.order != round(law.order)


def of_output(joint: int) -> tuple[JointLaw, ...]:
    """Every such wave of a joint, from 1."""
    orders = map(float, range(1, _BOLTS + 1))
    return tuple(JointLaw(joint, "periodic", "angle", joint, order) for order in orders)


_BOLTS = 12
"""Most periods per turn of what turns with a joint [1]: flanges and reducers have up to a dozen
bolts, and each one's error repeats itself a whole number of times in a turn; other orders are of
shafts that turn faster."""


@dataclass(frozen=True, eq=False)
class LawTest(Locked):
    """Test of one law.

    Attributes:
        law: The law; None for a curve over the joint's own angle.
        joint: Joint that it moves, from 1.
        statistic: T; for a curve h' R h, which is comparable with other curves only.
        p: Probability that any candidate appears as large in residuals without a law.
    """

    law: JointLaw | None
    joint: int
    statistic: float
    p: float


@dataclass(frozen=True, eq=False)
class _JointLaws(Locked):
    """Laws of one joint with as many amplitudes k each, and what tests of them share.

    Attributes:
        laws: The l laws.
        inputs: Variables of the laws at the poses.
        g: Sums with their functions.
        shared: Products of their columns with all that is estimated, shape (K, l k).
        inverse: Covariance of each law's amplitudes in addition to these, shape (l, k, k).
    """

    laws: tuple[JointLaw, ...]
    inputs: Inputs
    g: LawSums
    shared: Array
    inverse: Array

    @property
    def joint(self) -> int:
        """Their joint, from 0."""
        return self.laws[0].joint - 1

    @classmethod
    def of(cls, here: _LawScore, laws: Sequence[JointLaw], inputs: Inputs) -> _JointLaws:
        joint, g = laws[0].joint - 1, law_sums.sums(laws, inputs, _STEP)
        shared = here.products(g, joint)
        x, y = (v.reshape(len(v), len(laws), -1) for v in (shared, here.cov @ shared))
        own = g.weighed(here.w[:, joint])
        info = own - np.einsum("dla,dlb->lab", x, y)
        whole = np.einsum("lkk->lk", own)
        inverse = linear.left(info, np.maximum(whole, _NOTHING))[0]
        return cls(tuple(laws), inputs, g, shared, inverse)

    def _score(self, u: Array) -> Array:
        return self.g.of(u.T).reshape(*self.inverse.shape[:2], -1)

    def explained(self, u: Array) -> Array:
        """T of each law for projected residuals u of the joint (s, m), shape (l, s)."""
        num = self._score(u)
        return np.asarray(np.einsum("lks,lks->ls", num, self.inverse @ num))

    def without(self, here: _LawScore, left: Array, which: int) -> Array:
        """Whitened residuals (m, r) after an estimate with one of the laws."""
        k = self.inverse.shape[1]
        size = self.inverse[which] @ self._score(here.projected(left, self.joint))[which, :, 0]
        own = slice(k * which, k * which + k)
        f = self.laws[which].basis(self.inputs) @ size
        moved = here.Z[..., self.joint] * f[:, None]
        return left - moved + here.rows.along(here.cov @ (self.shared[:, own] @ size))


def _of_joints(here: _LawScore, laws: Iterable[JointLaw], inputs: Inputs) -> list[_JointLaws]:
    """Laws by joint, number of amplitudes, kind and family."""
    kinds: dict[tuple[int, int, str, bool], list[JointLaw]] = {}
    for law in laws:
        kind = law.joint, law.amplitudes, law.kind, is_of_output(law)
        kinds.setdefault(kind, []).append(law)
    return [_JointLaws.of(here, kinds[kind], inputs) for kind in sorted(kinds)]


def _without_laws(here: _LawScore, every: Sequence[_JointLaws]) -> Array:
    """Whitened residuals after all laws that are significant by chi-square alone, (m, r).

    In copies of residuals that contain a law it reaches a T of its own, and is hidden by it (ter
    Braak, in Bootstrapping and Related Techniques, 1992).
    """
    left = here.left
    for _ in range(MOST_LAWS if every else 0):
        T = [one.explained(here.projected(left, one.joint))[:, 0] for one in every]
        p = [_by_chi_square(every, one, t.max()) for one, t in zip(every, T, strict=True)]
        best = int(np.argmin(p))
        if p[best] >= alarms.LAW:
            break
        left = every[best].without(here, left, int(np.argmax(T[best])))
    return left


MOST_LAWS = 18
"""Maximum number of laws of one robot: three of each of six joints."""


def _by_chi_square(every: Sequence[_JointLaws], one: _JointLaws, T: Array | float) -> Array:
    """Probability that any law of a family reaches T of laws of one joint by chance (Bonferroni).

    It is multiplied by the number of families.
    """
    families = [is_of_output(each.laws[0]) for each in every]
    sizes = [len(each.laws) for each in every]
    mine = is_of_output(one.laws[0])
    count = len(set(families)) * sum(n for n, of in zip(sizes, families, strict=True) if of == mine)
    return np.asarray(count * special.gammaincc(0.5 * one.inverse.shape[1], 0.5 * T))


_NOTHING = 1e-30
"""Lower limit of the squared length of a whitened column [1], against division by zero."""


def _most_by_a_joint(here: _LawScore, inputs: Inputs) -> float:
    """The largest T of a step in time of any joint."""
    joints, times = range(1, inputs.q.shape[1] + 1), _times(inputs)
    steps = [law for joint in joints for law in _steps(inputs, joint, times)]
    return max(
        float(one.explained(here.u[one.joint, :1]).max()) for one in _of_joints(here, steps, inputs)
    )


class Move(NamedTuple):
    """What stands elsewhere from some pose on: the instrument, or targets on the effector.

    Attributes:
        pose: Index of the first pose after it, of its series if the instrument moved.
        targets: Indices of the targets, which moved as one body; none if the instrument did.
        p: Probability that chance yields such a move anywhere.
    """

    pose: int
    targets: tuple[int, ...] = ()
    p: float = 1.0

    def since(self, found: Calibration) -> Ints:
        """The poses after it."""
        series = found.readings.series
        later = np.arange(len(series)) >= self.pose
        return np.flatnonzero(later & (bool(self.targets) | (series == series[self.pose])))

    def columns(self, found: Calibration, D: Array) -> Array:
        """Derivatives by its rotation and translation (m, r, 6), from those by all (m, r, k)."""
        there = found.mechanism
        if not self.targets:
            return D[:, :, frame_of(there, int(found.readings.series[self.pose]))]
        own = D[:, :, layout(there).tool].reshape(*D.shape[:2], -1, 6)[:, :, list(self.targets)]
        if len(self.targets) == 1:
            return np.asarray(own[:, :, 0])
        frames = [there.tool[k] for k in self.targets]
        return np.asarray(np.einsum("mrtk,tkl->mrl", own, np.stack([*map(_as_one, frames)])))

    def near(self, found: Calibration, poses: Iterable[int]) -> list[Move]:
        """The same at other poses, if the instrument moved those of its series."""
        series = found.readings.series
        every = (self._replace(pose=pose) for pose in poses)
        return [one for one in every if one.targets or series[one.pose - 1] == series[one.pose]]


def _as_one(frame: Array) -> Array:
    """Rotation and translation of a target in its own frame by those of the flange, (6, 6)."""
    R, p = frame[:3, :3], frame[:3, 3]
    out = np.kron(np.eye(2), R.T)
    out[3:, :3] = R.T @ np.cross(np.eye(3), p).T
    return np.asarray(out)


def move(found: Calibration, signs: Array) -> Move | None:
    """What stood elsewhere from some pose on; None if nothing did.

    A move has columns that are zero before that pose: rotation and translation of the frame of its
    series, of a target, of which a point has no rotation, or of all targets as one body. A step in
    time of a joint's zero explains similar readings; the model with the larger T - k log N is
    preferred, with k its amplitudes and N the number of readings (Schwarz, Annals of Statistics 6,
    1978). T is compared with that of copies of the residuals after all likely moves (ter Braak, in
    Bootstrapping and Related Techniques, 1992), because copies that still contained a move would
    reach the same T.

    Args:
        found: The estimate.
        signs: Signs of the copies, shape (copies, m).
    """
    inputs, plain, six = found.linear.inputs, score(found, signs[:0]), found.readings.six
    every = tuple(range(len(six)))
    places = [Move(0), *(Move(0, (one,)) for one in every), *[Move(0, every)][: len(six) - 1]]
    moves = [one for place in places for one in place.near(found, _times(inputs))]
    if not moves:
        return None
    alone = [len(one.targets) == 1 and not six[one.targets[0]] for one in moves]
    free = np.where(alone, 3, 6)
    cost = float(np.log(found.linear.read.sum()))
    left, best = _without_moves(found, plain, moves, free)
    here = score(found, signs, left)
    T = _moved(found, here, moves, signs).T
    rival = _most_by_a_joint(here, inputs) - cost
    p = _beyond(T[:, 1:].max(axis=0), T[best, :1]).item()
    if p >= alarms.MOVED or T[best, 0] - free[best] * cost < rival:
        return None
    beside = moves[best].near(found, _near(inputs, moves[best].pose))
    near = _moved(found, plain, beside, signs[:0]).T[:, 0]
    return beside[int(np.argmax(near))]._replace(p=p)


def _without_moves(
    found: Calibration, here: _LawScore, moves: Sequence[Move], free: Ints
) -> tuple[Array, int]:
    """Whitened residuals (m, r) after all moves that are significant by chi-square, and the first.

    Of several moves each hides the others: none stands out of copies that contain them.
    """
    cost, first = float(np.log(found.linear.read.sum())), []
    for _ in range(MOST_MOVES):
        seen = _moved(found, here, moves, np.zeros((0, len(found.readings))))
        best = int(np.argmax(seen.T[:, 0] - free * cost))
        first.append(best)
        here = replace(here, left=seen.left(found, here, best))
        if len(moves) * special.gammaincc(0.5 * free[best], 0.5 * seen.T[best, 0]) >= alarms.MOVED:
            break
    return here.left, first[0]


MOST_MOVES = 8
"""Maximum number of moves; what moves more often drifts."""


class _Moved(NamedTuple):
    """T and sizes of p moves.

    Attributes:
        moves: The moves.
        T: T of readings and copies, (p, 1 + copies).
        shared: Products of the six columns with all parameters, (p, k, 6).
        size: Estimated moves, (p, 6).
    """

    moves: Sequence[Move]
    T: Array
    shared: Array
    size: Array

    def left(self, found: Calibration, here: _LawScore, which: int) -> Array:
        """Whitened residuals after one of the moves, (m, r)."""
        one, size = self.moves[which], self.size[which]
        left = here.left + found.rows.along(here.cov @ (self.shared[which] @ size))
        since = one.since(found)
        left[since] -= one.columns(found, found.rows.D[since]) @ size
        return left


def _moved(found: Calibration, here: _LawScore, moves: Sequence[Move], signs: Array) -> _Moved:
    """Moves, those of the same body before ascending poses.

    Sums over the poses from one to the next are added up from the last backwards.
    """
    series, count, width = found.readings.series, len(moves), 1 + len(signs)
    shared, own = np.zeros((count, len(here.cov), 6)), np.zeros((count, 6, 6))
    num = np.zeros((count, 6, width))
    bodies: dict[tuple[int, ...], list[int]] = {}
    for k, one in enumerate(moves):
        bodies.setdefault(one.targets or (-1, int(series[one.pose])), []).append(k)
    for mine in bodies.values():
        at = moves[mine[0]].since(found)
        cuts = np.searchsorted(at, [moves[k].pose for k in mine])
        for k, part in zip(mine, np.split(at, cuts[1:]), strict=True):
            some = found.rows.of(part)
            F = moves[k].columns(found, some.D)
            shared[k], own[k] = some.products(F), np.einsum("mrk,mrl->kl", F, F)
            e, copied = (np.einsum("mrk,mr->km", F, r[part]) for r in (here.left, here.copied))
            num[k] = np.column_stack([e.sum(axis=1), copied @ signs[:, part].T])
        for sums in (shared, own, num):
            sums[mine] = np.cumsum(sums[mine][::-1], axis=0)[::-1]
    num[:, :, 1:] -= np.swapaxes(shared, 1, 2) @ here.x[:, : len(signs)]
    known = np.einsum("pka,pkb->pab", shared, here.cov @ shared)
    inverse, _ = linear.left(own - known, np.einsum("pkk->pk", own))
    T = np.einsum("pks,pkl,pls->ps", num, inverse, num, optimize=True)
    return _Moved(moves, T, shared, np.einsum("pkl,pl->pk", inverse, num[:, :, 0]))


def sharpened(found: Calibration, law: JointLaw) -> JointLaw:
    """The order of a wave, or the pose of a step in time, that explains most near the one found."""
    inputs = found.linear.inputs
    if law.once:
        pose = int(np.argmax(inputs.series + inputs.time > law.middle))
        near = list(_steps(inputs, law.joint, _near(inputs, pose)))
    elif law.kind == "periodic":
        near = [replace(law, order=order) for order in (law.order + NEAR).tolist() if order > 0]
    else:
        return law
    here = score(found, np.zeros((0, len(inputs.q))))
    T = _JointLaws.of(here, near, inputs).explained(here.u[law.joint - 1])
    return near[int(np.argmax(T))]


def _near(inputs: Inputs, pose: int) -> range:
    """Poses between the neighbouring ones of `_times`."""
    apart = max(len(inputs.q) // _TIMES, _BLOCK)
    return range(max(pose - apart + 1, 1), min(pose + apart, len(inputs.q)))


def _curved(here: _LawScore, joint: int, q: Array, slides: bool) -> Array:
    """Score of smooth curves over a joint's own angle: h' R h, (1 + copies,).

    h = K'u is the score of each knot, R the correlation of the knots.
    """
    length = random_curve.LENGTHS[slides][0]
    one = random_curve.over(joint, q[:, joint], slides, length, 1.0)
    h = here.u[joint] @ one.rows(q[:, joint])
    return np.asarray(np.einsum("sk,kl,sl->s", h, one.shape(), h))


def law_tests(
    found: Calibration, signs: Array, laws: Sequence[JointLaw], bent: Sequence[bool] = ()
) -> list[LawTest]:
    """Tests of all laws and curves, those of the joint that is the least likely by chance first.

    Of the significant ones of a joint the one that explains most comes first.

    Each T is standardised by its values in the copies, which for laws are made of the residuals
    after all that is certainly one. p is the probability of the largest of all standardised values
    of its family being as large, times the number of families (Bonferroni): from its rank among the
    copies, and beyond them from an extreme-value distribution fitted to them. It is at least that
    of T by chi-square against all laws of the family. Waves of what turns with a joint are one
    family (`is_of_output`), all else is another: a few dozen of the likeliest waves need not stand
    out of thousands of other orders.

    Args:
        found: The estimate.
        signs: Signs of the copies, shape (copies, m).
        laws: Laws that are tried.
        bent: For each joint whether it slides, where curves are to be tried, too; else empty.
    """
    inputs, plain = found.linear.inputs, score(found, signs[:0])
    tried = _of_joints(plain, laws, inputs)
    here = score(found, signs, _without_laws(plain, tried))
    of: list[tuple[JointLaw | None, int, float, float]] = []
    T: list[Array] = []
    for one in tried:
        each = one.explained(here.u[one.joint])
        T.append(each)
        least = _by_chi_square(tried, one, each[:, 0])
        of += zip(one.laws, [one.joint + 1] * len(each), each[:, 0], least, strict=True)
    plain = score(found, signs) if len(bent) else plain  # no chi-square bounds p of a curve
    for joint, slides in enumerate(bent):
        each = _curved(plain, joint, inputs.q, slides)
        T.append(each[None])
        of.append((None, joint + 1, each[0], 0.0))
    if not of:
        return []
    of_output = np.array([law is not None and is_of_output(law) for law, *_ in of], dtype=bool)
    return _least_likely_first([
        LawTest(law, joint, float(t), float(min(max(p, least), 1.0)))
        for (law, joint, t, least), p in zip(of, _beyond_family(of_output, T), strict=True)
    ])  # fmt: skip


def _least_likely_first(found: Sequence[LawTest]) -> list[LawTest]:
    """Joints by their least likely law or curve, and of one joint the significant ones by T."""
    least: dict[tuple[int, bool], float] = {}
    for one in found:
        kind = one.joint, one.law is None
        least[kind] = min(one.p, least.get(kind, 1.0))
    return sorted(
        found,
        key=lambda one: (least[one.joint, one.law is None], one.p >= alarms.LAW, -one.statistic),
    )


def _beyond_family(of_output: Bools, T: Sequence[Array]) -> Array:
    """Probability that any candidate of its family is as large, times the number of families."""
    families, every = np.unique(of_output), np.concatenate(T)
    out = np.empty(len(every))
    for family in families:
        mine = of_output == family
        out[mine] = len(families) * beyond_copies(every[mine])
    return out


def beyond_copies(T: Array) -> Array:
    """Probability that any candidate is as large in the copies, per row of T (k, 1 + copies)."""
    determined = T.any(axis=1)  # False where the readings contain no information, as the copies do
    out = np.ones(len(T))
    if determined.any():
        out[determined] = _chance(_standard(T[determined]))
    return out


def _chance(z: Array) -> Array:
    """Probability that any row is as large in the copies, for each row of z (k, 1 + copies)."""
    most = z[:, 1:].max(axis=0)
    rank = (1 + (most >= z[:, :1]).sum(axis=1)) / (1 + len(most))
    return np.where(rank > 1 / len(most), rank, _beyond(most, z[:, 0]))


def _beyond(most: Array, found: Array) -> Array:
    """Tail probability of a value, from an extreme-value distribution fitted to the copies."""
    middle, width = gumbel(most)
    return np.asarray(-np.expm1(-np.exp(-(found - middle) / width)))


def gumbel(most: Array) -> tuple[float, float]:
    """Location and scale of the likeliest extreme-value distribution of largest values (k,).

    s solves  s = mean - sum x w / sum w,  w = exp(-x / s);  location = -s log mean w.
    """
    x = most - most.mean()
    least, spread = -float(x.min()), float(np.ptp(x))
    if not spread:
        return float(most.mean()), linear.TINY

    def off(log_scale: float) -> float:
        w = np.exp(-(x + least) / np.exp(log_scale))
        return float(np.exp(log_scale) + x @ w / w.sum())

    s = float(np.exp(optimize.brentq(off, np.log(1e-3 * least), np.log(10 * spread), xtol=1e-13)))
    return float(most.mean() - least - s * np.log(np.mean(np.exp(-(x + least) / s)))), s


def _standard(T: Array) -> Array:
    """Cube roots of sums of squares (k, 1 + copies), each standardised by the others of its row."""
    root = np.cbrt(np.maximum(T, 0.0))
    n = root.shape[1] - 1
    mean = (root.sum(axis=1, keepdims=True) - root) / n
    square = ((root**2).sum(axis=1, keepdims=True) - root**2) / n
    return np.asarray((root - mean) / np.sqrt(np.maximum(square - mean**2, 1e-18)))
