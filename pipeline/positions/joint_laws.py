"""Adopt and name joint laws: curves, waves, and further laws that predict held-out poses better."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.tails import NORMAL_95
from pipeline.machine.effects._anatomy import rail
from pipeline.positions import law_tests, random_curve
from pipeline.positions.calibrate import Calibration, ModelStructure, calibrate, likeliest, tried
from pipeline.positions.catalogue_causes import CatalogueCause, CatalogueLaw, causes, chances, helps
from pipeline.positions.cross_validation import NO_GAIN, LeftOutGain, LeftOutPoses, Partition
from pipeline.positions.estimate import FIXED_SIGMA, solved
from pipeline.positions.laws import JointLaw, LawKind, LawVariable
from pipeline.positions.mechanism import ArmWeights, Mechanism, layout
from pipeline.positions.readings import PositionReadings
from pipeline.positions.scatter import PoseScatter
from pipeline.system import alarms

_HALF = 0.5
"""Minimum fraction of a curve's variance over the poses that one wave must explain to replace
it [1]."""


@dataclass(frozen=True, eq=False)
class NamedLaw(Locked):
    """A law outside the catalogue that the readings call for.

    Attributes:
        joint: Joint that it moves, from 1.
        kind: `periodic`, `smooth`, `step` or `coupling`.
        variable: `angle`, `torque`, `temperature` or `time`.
        source: Joint whose angle or torque is the variable, from 1; None for temperature and time.
        order: Periods per turn (per metre of a sliding joint), or degree; for a curve 1 / l in
            1/turn, with its correlation length l.
        amplitude: Half the height of a wave or step; all of a step in time, with its sign; root two
            times the standard deviation of a curve; otherwise the value at the end of the range
            [m] or [rad].
        std: Its standard uncertainty.
        range: Range of the variable in the readings.
        p: Probability that any law appears as large by chance.
        since: Series and pose from which on a step in time has happened; None for others.
        number: Index among the mechanism's laws, from 0; None for a curve.
        gain: Reduction of the error at left-out poses whose neighbours in time are kept.
        carried: The same at left-out series, or parts of joint space if there is one series only.
    """

    joint: int
    kind: LawKind
    variable: LawVariable
    source: int | None
    order: float
    amplitude: float
    std: float
    range: tuple[float, float]
    since: tuple[str, int] | None = None
    number: int | None = None
    p: float = 1.0
    gain: LeftOutGain = NO_GAIN
    carried: LeftOutGain = NO_GAIN


@dataclass(frozen=True, eq=False)
class LawSearchData:
    """Data and settings of an estimate.

    Attributes:
        readings: The readings.
        weights: Gravity and payloads on the arm.
        stated: Roughness of lengths [m] and angles [rad] in the robot file.
        noise: Initial scatter of the readings about the model.
    """

    readings: PositionReadings
    weights: ArmWeights
    stated: tuple[float, float]
    noise: PoseScatter

    def identify(
        self, begun: Mechanism, wanted: ModelStructure, earlier: Calibration | None = None
    ) -> Calibration:
        """Estimate, from priors and scatter of an earlier estimate if given.

        If its elastic elements differ, the earlier scales of groups are not used.
        """
        known, noise = None, self.noise
        if earlier is not None:
            known, noise = earlier.known, earlier.scatter
            if earlier.wanted.yields != wanted.yields:
                known = replace(known, groups={})
        return calibrate(begun, self.readings, self.weights, wanted, noise, self.stated, known)

    def again(self, found: Calibration) -> Calibration:
        """Estimate the same model from these readings."""
        return self.identify(found.mechanism, found.wanted, found)

    def without(self, bad: Bools) -> LawSearchData:
        """The data without some readings (m, t), and without poses where none is left."""
        at = np.where(bad[..., None], np.nan, self.readings.at)
        left = (~np.isnan(at[..., 0])).any(axis=1)
        readings = replace(self.readings, at=at).part(np.flatnonzero(left))
        return replace(self, readings=readings, weights=self.weights.part(np.flatnonzero(left)))


@dataclass(frozen=True, eq=False)
class NamedModel:
    """The model with its laws, and which of them are named.

    Attributes:
        found: The estimate.
        laws: Named laws outside the catalogue.
        causes: Named causes of the catalogue.
    """

    found: Calibration
    laws: tuple[NamedLaw, ...]
    causes: tuple[CatalogueCause, ...]


def _candidates(base: Calibration, names: Sequence[CatalogueLaw]) -> list[JointLaw]:
    """Laws to be tested in addition to those of the catalogue."""
    known = {_key(one.law) for one in names}
    bed = base.wanted.bed  # motion along the rail belongs to it
    every = law_tests.candidates(base.linear.inputs, base.mechanism.table.prismatic)
    return [
        law
        for law in every
        if _key(law) not in known and not (bed and law.joint == 1 and _own_angle(law))
    ]


def with_laws(
    data: LawSearchData,
    base: Calibration,
    names: tuple[CatalogueLaw, ...],
    parts: dict[Partition, Ints],
    rng: np.random.Generator,
) -> NamedModel:
    """Search for laws in addition to the catalogue, then for more in addition to the curves found.

    Args:
        data: The data.
        base: Estimate with the laws of the catalogue.
        names: Causes of these laws.
        parts: Partitions of the poses for cross-validation.
        rng: Source of copies and intervals.
    """
    # beside laws yet unknown, scales vanish that return when these are found
    base = replace(base, known=replace(base.known, returning=True))
    signs = law_tests.flips(data.readings, rng, rail=rail(base.mechanism.table))
    every = _candidates(base, names)
    clues = law_tests.law_tests(base, signs, every, base.mechanism.table.prismatic.tolist())
    bed = base.wanted.bed
    clues = [clue for clue in clues if clue.law is not None or not (bed and clue.joint == 1)]
    judge = LeftOutPoses(parts, rng)
    found, p = _of_own_angles(data, base, clues, judge)
    found, further = _of_all_else(data, found, every, signs, judge)
    found = _of_outputs(data, found, judge)
    p |= further
    found, was = _of_shafts(data, found)
    p |= {now: p[then] for now, then in was.items() if then in p}
    p |= _by_copies(found, names, p, signs)
    return NamedModel(found, _named(found, p, judge), causes(found, names, signs, judge))


def _by_copies(
    found: Calibration, names: Sequence[CatalogueLaw], known: dict[_Key, float], signs: Array
) -> dict[_Key, float]:
    """p-values of laws without a cause in the catalogue that the search did not find."""
    laws = found.mechanism.laws
    plain = [
        k
        for k, law in enumerate(laws)
        if (not names[k].name if k < len(names) else _key(law) not in known)
    ]
    chance = chances(found, [_of_law(found.mechanism, k) for k in plain], signs)
    return {_key(laws[k]): c for k, c in zip(plain, chance, strict=True)}


def _bent(clues: Sequence[law_tests.LawTest]) -> dict[int, float]:
    """Joints, from 0, with errors over their own angles, and the probability of each by chance."""
    bent: dict[int, float] = {}
    for clue in clues:
        if clue.p < alarms.LAW and (clue.law is None or _own_angle(clue.law)):
            bent[clue.joint - 1] = min(clue.p, bent.get(clue.joint - 1, 1.0))
    return bent


def _of_own_angles(
    data: LawSearchData,
    springs: Calibration,
    clues: Sequence[law_tests.LawTest],
    judge: LeftOutPoses,
) -> tuple[Calibration, dict[_Key, float]]:
    """Estimate with curves, or waves, over the joints' own angles, and their p-values."""
    bent = _bent(clues)
    if not bent:
        return springs, {}
    joints = sorted(bent)
    curved, _ = likeliest(
        springs,
        [
            replace(springs.wanted, curves=tuple((j, length) for j in joints))
            for length in random_curve.LENGTHS[False]
        ],
    )
    curved = curved or springs  # never: the first is tried, too
    found = data.identify(curved.mechanism, curved.wanted, curved)
    waves = [law for j in joints if (law := _one_wave(springs, found, clues, j)) is not None]
    found = _better(data, found, [(law,) for law in waves], judge)
    found = _better(
        data,
        found,
        [_series(found, j, found.mechanism.laws) for j, _ in found.wanted.curves],
        judge,
    )
    p = {_curve_of(j): chance for j, chance in bent.items()}
    own = filter(_own_angle, found.mechanism.laws)
    return found, p | {_key(law): bent.get(law.joint - 1, 1.0) for law in own}


def _of_all_else(
    data: LawSearchData,
    found: Calibration,
    others: Sequence[JointLaw],
    signs: Array,
    judge: LeftOutPoses,
) -> tuple[Calibration, dict[_Key, float]]:
    """Estimate with further laws, the likeliest first, until none of any joint carries over."""
    p: dict[_Key, float] = {}
    free = [one for one in others if not any(_alike(one, law) for law in found.mechanism.laws)]
    while len(p) < law_tests.MOST_LAWS:
        more = found
        for law, chance in _first_of_joints(law_tests.law_tests(found, signs, free)):
            sharp = law_tests.sharpened(found, law)
            more = _carried(data, found, sharp, judge)
            free = [one for one in free if not _alike(one, law)]
            if more is not found:
                p[_key(sharp)] = chance
                break
        if more is found:
            break
        found = more
    return found, p


def _first_of_joints(clues: Sequence[law_tests.LawTest]) -> list[tuple[JointLaw, float]]:
    """The first significant law of each joint with its p-value, the likeliest first."""
    first: dict[int, tuple[JointLaw, float]] = {}
    for clue in clues:
        if clue.law is not None and clue.p < alarms.LAW:
            first.setdefault(clue.joint, (clue.law, clue.p))
    return list(first.values())


def _carried(
    data: LawSearchData, found: Calibration, law: JointLaw, judge: LeftOutPoses
) -> Calibration:
    """The estimate with a further law if that carries over, first about one linearisation."""
    new = (*found.mechanism.laws, law)
    more = tried(found, replace(found.wanted, laws=new))
    part = _of_law(more.mechanism, len(new) - 1)
    for step in (lambda one: one, data.again):
        more = step(more)
        if not (helps(more, part) and judge.carries(more, part, found, law.once)):
            return found
    return more


def _better(
    data: LawSearchData,
    bent: Calibration,
    waves: Sequence[tuple[JointLaw, ...]],
    judge: LeftOutPoses,
) -> Calibration:
    """The estimate with waves of one joint each in place of its curve.

    They are taken where the readings are likelier, about one linearisation first, and held-out
    poses are predicted as well.
    """
    found = bent
    for laws in filter(None, waves):
        rest = tuple(one for one in found.wanted.curves if one[0] != laws[0].joint - 1)
        wanted = replace(found.wanted, laws=(*found.mechanism.laws, *laws), curves=rest)
        if tried(found, wanted, found.likely).likely < found.likely:
            continue
        trial = data.identify(found.mechanism, wanted, found)
        if trial.likely > found.likely and judge.as_good(trial, found):
            found = trial
    return found


def _series(found: Calibration, joint: int, known: Sequence[JointLaw]) -> tuple[JointLaw, ...]:
    """Further waves of what turns with a joint, from 0; those that are not there shrink to none."""
    span = float(np.ptp(found.readings.q[:, joint]))
    if found.mechanism.table.prismatic[joint]:
        return ()
    return tuple(
        law
        for law in law_tests.of_output(joint + 1)
        if law.order * span > np.pi and not any(_alike(law, one) for one in known)
    )


def _of_outputs(data: LawSearchData, found: Calibration, judge: LeftOutPoses) -> Calibration:
    """The estimate with all waves of what turns with any joint, if the readings are likelier so.

    Their scales begin where the search ended, and as usual: the likelier end counts, if held-out
    poses are predicted as well. Each hides others as long as it is not there, and waves of other
    orders, or curves, stand in their places.
    """
    joints = range(found.mechanism.table.n)
    laws = tuple(law for law in found.mechanism.laws if not law_tests.beside_output(law))
    laws += tuple(law for j in joints for law in _series(found, j, laws))
    rest = tuple(one for one in found.wanted.curves if found.mechanism.table.prismatic[one[0]])
    soft = replace(found.wanted, soft=bool(found.wanted.yields or found.wanted.bed))
    for wanted in (replace(soft, laws=laws, curves=rest), soft):
        if wanted != found.wanted and (best := _likelier(data, found, wanted, judge)):
            return best
    return found


def _likelier(
    data: LawSearchData, found: Calibration, wanted: ModelStructure, judge: LeftOutPoses
) -> Calibration | None:
    """The likelier of the estimates from two starts, if it is better than the one found.

    Of many poses the start that is likelier about one linearisation goes first, from there, and
    the other one only if that ends no better than the one found.
    """
    starts = [found, replace(found, known=replace(found.known, groups={}))]
    few, least = len(found.readings.q) <= _FEW, found.likely
    if not few:
        about = sorted((tried(one, wanted, least) for one in starts), key=lambda one: -one.likely)
        starts = [one for one in about if one.likely > least]
    ends = (data.identify(one.mechanism, wanted, one) for one in starts)
    better = (one for one in ends if one.likely > least)
    best = max(better, key=lambda one: one.likely, default=None) if few else next(better, None)
    return best if best and judge.as_good(best, found) else None


_FEW = 500
"""Poses up to which whole estimates are made without asking one linearisation first [1]: each takes
seconds. Sixty scales that begin as usual, or that have vanished, are not near their ends in it."""


def _of_shafts(data: LawSearchData, found: Calibration) -> tuple[Calibration, dict[_Key, _Key]]:
    """The estimate with the orders of waves of what turns faster than joints as the end shows them.

    Each was sharpened beside all that was not found yet. The second value maps keys of these laws
    to those that they had.
    """
    laws = tuple(_resharpened(found, k) for k in range(len(found.mechanism.laws)))
    wanted = replace(found.wanted, laws=laws)
    if wanted == found.wanted:
        return found, {}
    best = data.identify(found.mechanism, wanted, found)
    if best.likely <= found.likely:
        return found, {}
    return best, {_key(a): _key(b) for a, b in zip(laws, found.mechanism.laws, strict=True)}


def _resharpened(found: Calibration, number: int) -> JointLaw:
    """A wave at the order that explains most of what the estimate leaves without it."""
    law = found.mechanism.laws[number]
    if law.kind != "periodic" or law_tests.beside_output(law) or law_tests.is_of_output(law):
        return law
    std = found.known.std.copy()
    std[_of_law(found.mechanism, number)] = FIXED_SIGMA
    known = replace(found.known, std=std)
    without = solved(found.rows, found.mechanism, known)
    return law_tests.sharpened(replace(found, known=known, solution=without), law)


_Key = tuple[str, int, str, int | None, float, float]


def _key(law: JointLaw) -> _Key:
    """Key that distinguishes laws."""
    at = law.middle if law.once else 0.0
    return law.kind, law.joint, law.variable, law.source, law.order, at


def _curve_of(joint: int) -> _Key:
    """Key of the curve of a joint, from 0."""
    return "curve", joint + 1, "angle", joint + 1, 0.0, 0.0


def _of_law(mechanism: Mechanism, number: int) -> slice:
    """Slice of the amplitudes of a law in the parameter vector."""
    first = layout(mechanism).laws.start + sum(law.amplitudes for law in mechanism.laws[:number])
    return slice(first, first + mechanism.laws[number].amplitudes)


def _alike(one: JointLaw, other: JointLaw) -> bool:
    """Whether two laws are the same, or waves of orders that few turns hardly distinguish."""
    same = _key(replace(one, order=0.0)) == _key(replace(other, order=0.0))
    return same and abs(one.order - other.order) < _APART


_APART = 1.0
"""Difference of the orders of two waves of a joint, below which one takes the other's place [1]."""


def _own_angle(law: JointLaw) -> bool:
    return law.variable == "angle" and law.source == law.joint


def _one_wave(
    springs: Calibration, found: Calibration, clues: Sequence[law_tests.LawTest], joint: int
) -> JointLaw | None:
    """The wave that may take the place of a joint's curve, if any.

    It explains at least `_HALF` of the curve over the poses, or is significant by itself: a curve
    between few poses contains none of a wave much shorter than it, and would only hide it.
    """
    every = ((c.law, c.p) for c in clues if c.law and c.joint == joint + 1)
    first, p = next((one for one in every if one[0].kind == "periodic"), (None, 1.0))
    if first is None:
        return None
    orders = first.order + law_tests.NEAR
    shares = _shares(found, joint, orders)
    best = int(np.argmax(shares))
    if shares[best] >= _HALF:
        return replace(first, order=float(orders[best]))
    return law_tests.sharpened(springs, first) if p < alarms.LAW else None


def _shares(found: Calibration, joint: int, orders: Array) -> Array:
    """Fraction of the variance of a joint's curve that a wave of each order explains.

    Waves of the model over the same angle are taken from the curve first: it may be in their place.
    """
    q, inputs, there = found.readings.q[:, joint], found.linear.inputs, found.mechanism
    f = next(one.value(q, knots) for one, knots in there.curved() if one.screw == joint)
    own = [law.basis(inputs) for law in there.laws if law.joint == joint + 1 and _own_angle(law)]
    return _share(f, np.hstack([np.ones((len(q), 1)), *own]), orders * q[:, None])


def _share(f: Array, beside: Array, phase: Array) -> Array:
    """Fraction of f f' (n,) that a wave of each phase (n, w) explains beside columns (n, k)."""
    X = linear.orthonormal(beside)
    waves = np.stack([np.cos(phase), np.sin(phase)], axis=1).reshape(len(f), -1)
    f, rest = (one - X @ (X.T @ one) for one in (f, waves))
    left, whole = (one.reshape(len(f), 2, -1) for one in (rest, waves))
    known, _ = linear.left(
        np.einsum("mij,mkj->jik", left, left), np.einsum("mij,mij->ji", whole, whole), _PROJECTED
    )
    g = np.einsum("mij,m->ji", left, f)
    return np.asarray(np.einsum("ji,jik,jk->j", g, known, g) / max(float(f @ f), linear.TINY))


_PROJECTED = 1e-20
"""Squared fraction of a column that rounding leaves of what is projected out of it [1]."""


def _named(found: Calibration, p: dict[_Key, float], judge: LeftOutPoses) -> tuple[NamedLaw, ...]:
    """The significant laws, of a certain size, that certainly predict held-out poses better."""
    out = []
    for law, key, part in _slices(found):
        if p.get(key, 1.0) >= alarms.LAW or abs(law.amplitude) <= NORMAL_95 * law.std:
            continue
        near, carried = judge.gains(found, part, law.since is not None)
        if near.sure and carried.sure:
            out.append(replace(law, p=p[key], gain=near, carried=carried))
    return tuple(sorted(out, key=lambda law: -law.gain.reduction))


def _slices(found: Calibration) -> Iterator[tuple[NamedLaw, _Key, slice]]:
    """Each law and curve as it would be named, its key, and the slice of its parameters."""
    mechanism, x, cov = found.mechanism, found.solution.x, found.cov
    where, inputs = layout(mechanism), found.linear.inputs
    for k, law in enumerate(mechanism.laws):
        part = _of_law(mechanism, k)
        one = NamedLaw(
            law.joint,
            law.kind,
            law.variable,
            law.source,
            law.order,
            *_size(x[part], cov[part, part], signed=law.once),
            range=_ends(law.of(inputs)),
            since=_since(law, found) if law.once else None,
            number=k,
        )
        yield one, _key(law), part
    at = where.knots.start
    for curve in mechanism.curves[: len(found.wanted.curves)]:
        part = slice(at, at + curve.count)
        q = inputs.q[:, curve.joint]
        turn = 1.0 if mechanism.table.prismatic[curve.joint] else 2 * np.pi
        one = NamedLaw(
            curve.joint + 1,
            "smooth",
            "angle",
            curve.joint + 1,
            turn / curve.length,
            *_bend(curve, q, x[part], cov[part, part]),
            range=_ends(q),
        )
        yield one, _curve_of(curve.joint), part
        at = part.stop


def _since(law: JointLaw, found: Calibration) -> tuple[str, int]:
    """Series and pose that followed a step in time."""
    pose = int(np.argmax(law.of(found.linear.inputs) > law.middle))
    series = int(found.readings.series[pose])
    return str(found.readings.names[series]), int(found.readings.pose[pose])


def _ends(v: Array) -> tuple[float, float]:
    return float(v.min()), float(v.max())


def _size(x: Array, cov: Array, *, signed: bool) -> tuple[float, float]:
    """Amplitude of a law, with the sign of a single one if asked, and its standard uncertainty."""
    size = float(x[0] if signed else np.linalg.norm(x))
    slope = x / (size or 1e-300)
    return size, float(np.sqrt(slope @ cov @ slope))


def _bend(curve: random_curve.Curve, q: Array, x: Array, cov: Array) -> tuple[float, float]:
    """Root two times the standard deviation of a curve over the poses, and its uncertainty."""
    rows = curve.rows(q).toarray()
    rows = rows - rows.mean(axis=0)
    f = rows @ x
    std = float(np.sqrt(np.mean(f**2)))
    slope = rows.T @ f / len(f) / max(std, 1e-300)
    return float(np.sqrt(2.0)) * std, float(np.sqrt(2.0 * slope @ cov @ slope))
