"""Result of an estimate from absolute positions as passed to pulls of the same robot, and back."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Strings
from pipeline.base.tails import chi2_beyond
from pipeline.geometry.arm_weight import usual
from pipeline.machine.cell import Tool
from pipeline.machine.effect import Elastic
from pipeline.machine.robot import configure
from pipeline.machine.robot.weight import carried, work
from pipeline.positions.calibrate import Calibration
from pipeline.positions.estimate import (
    Posterior,
    by_a_factor,
    damping,
    determined_joints,
    padded,
    precision,
    rows,
    softened,
)
from pipeline.positions.mechanism import (
    ArmWeights,
    Mechanism,
    by_frame,
    derivatives,
    layout,
    linearised,
)
from pipeline.positions.positions_estimate import PositionsEstimate, soften
from pipeline.positions.random_curve import between_knots
from pipeline.positions.stated_tool import StatedTool
from pipeline.positions.yielding import by_weight_alone
from pipeline.reduction.bring import bring
from pipeline.reduction.case import Case
from pipeline.reduction.measured import Measured
from pipeline.system import alarms
from pipeline.system.estimate import identify as estimate_of


@dataclass(frozen=True, eq=False)
class _Unloaded:
    """Joint deviations and targets under the own weight, as `PositionsEstimate.unloaded`."""

    mechanism: Mechanism
    weights: ArmWeights
    which: Ints

    def __call__(self, q: Array) -> tuple[Array, Array]:
        m, never = len(q), np.full(len(q), np.nan)
        weights = replace(self.weights, carried=np.zeros(m, dtype=np.int64))
        stand = self.mechanism.stand(q, weights, never, never, never)
        plain = stand.here.points(self.mechanism.tool[:, :3, 3])
        return stand.here.q - q, (stand.at - plain)[:, self.which]


@dataclass(frozen=True, eq=False)
class _Unsure:
    """Uncertainty of an estimate at other poses, as `PositionsEstimate.unsure`."""

    found: Calibration

    def __call__(self, q: Array, names: Strings) -> Array:
        there, read = self.found.mechanism, self.found.readings.targets.tolist()
        target = np.array([read.index(one) if one in read else 0 for one in names.tolist()])
        at, X, _, _ = _there(self.found, there, q, target, ())
        beside = slice(layout(there).compliance.start, None)
        moves = X[:, beside] @ linear.factor(self.found.solution.cov[beside, beside])
        frame = linear.orthonormal(by_frame(at[:, None])[:, :3].reshape(-1, _FRAME))
        U, s, _ = linear.principal(moves - frame @ (frame.T @ moves))
        much = s > _LITTLE_M * np.sqrt(len(moves))
        return (U[:, : len(s)] * s)[:, much].reshape(len(q), 3, -1)


_LITTLE_M = 1e-6
"""Rms motion of the readings by one standard error that is left out [m]: a fifth of the best noise
of a tracker."""


@dataclass(frozen=True, eq=False)
class _Reopened:
    """`stance` with some elements free, as `PositionsEstimate.reopened`; results are cached."""

    found: Calibration
    tool: StatedTool
    kept: dict[tuple[int, ...], PositionsEstimate] = field(default_factory=dict)

    def __call__(self, free: tuple[int, ...]) -> PositionsEstimate:
        if free not in self.kept:
            self.kept[free] = stance(opened(self.found, free), self.tool, free)
        return self.kept[free]


def opened(found: Calibration, free: Collection[int]) -> Calibration:
    """The estimate in which some elements, by number, have wide priors.

    The prior makes all elements equally rough, up to their usual size; it must not hold an element
    near zero that stands out from the others, or that the pulls call for and the weight hardly
    moves.
    """
    if not free:
        return found
    std, places = found.known.std.copy(), list(_places(found.mechanism))
    for k in free:
        std[places[k]] = _FREE * found.known.most[places[k]]
    return _anew(replace(found, known=replace(found.known, std=std)))


_FREE = 1e3
"""Standard deviation of a wide prior over the usual size [1]."""


def stance(found: Calibration, tool: StatedTool, free: Collection[int] = ()) -> PositionsEstimate:
    """Result of the positions as passed to the pulls.

    An element that the weight does not call for is set to zero, like causes that pulls do not call
    for; the estimate is then conditional on that. It calls for one only if it also does where the
    prior of this is wide: usual sizes of an element are no evidence for it. Laws of gears, which
    are part of the joints' motion, keep their uncertainty.

    Args:
        found: The complete estimate.
        tool: Points of the tool that pulls may have read, too, and their load point.
        free: Numbers of elements that other evidence than the weight calls for.
    """
    reopened = None if free else _Reopened(found, tool)
    held = set(_held(found, free))
    if len(held) > len(free):
        held &= set(_held(opened(found, held), free))
        found = opened(found, held)
    mechanism, (apart, factor) = found.mechanism, _apart(found)
    which = [k for k, name in enumerate(found.readings.targets) if name in tool.points]
    n, effects = mechanism.table.n, tuple(mechanism.elements[k] for k in sorted(held))
    z, C = _with_none(found, apart, _parameters(found, effects), which)
    soft: Array = np.append(np.ones(n), soften(effects).astype(float))
    s, along = len(soft), z * padded(soft, len(z))
    return PositionsEstimate(
        robot=mechanism.robot,
        letters=mechanism.letters,
        points={str(found.readings.targets[k]): mechanism.tool[k, :3, 3] for k in which},
        compliance=z[:n],
        told=determined_joints(mechanism, found.known, z[:n], np.diag(C)[:n]),
        held=effects,
        yields=z[n:s],
        cov=C + factor * np.outer(along, along),
        unloaded=_Unloaded(
            mechanism, found.weights, np.array(which or range(len(mechanism.tool)), dtype=np.int64)
        ),
        factor=factor,
        moments=mechanism.moments,
        gravity=found.weights.gravity,
        elements=mechanism.elements,
        unsure=_Unsure(found),
        reopened=reopened,
    ).carrying(tool, alarms.MISFIT)


def _apart(found: Calibration) -> tuple[Array, float]:
    """Covariance without the common factor of all masses, and its variance, zero where known."""
    v, cov = softened(found.mechanism), found.solution.cov
    factor = 1 / float(v @ linear.cholesky(cov).solve(v)) if found.mechanism.unknown else 0.0
    return cov - factor * np.outer(v, v), factor


def _with_none(
    found: Calibration, apart: Array, held: Sequence[int], which: Sequence[int]
) -> tuple[Array, Array]:
    """Springs, held elements, errors of letters and points, given that all other elements are zero.

    Args:
        found: The complete estimate.
        apart: Covariance of all parameters, without the common factor of unknown masses.
        held: Indices of the parameters of the elements that are held.
        which: Indices of the points.

    Returns:
        Values (s,) and covariance (s, s).
    """
    there, x = found.mechanism, found.mechanism.at(layout(found.mechanism))
    none = _rigid(there, held)
    T = _chosen(found, held, which)
    gain = T @ apart[:, none] @ linear.inverse(apart[np.ix_(none, none)])
    z, C = T @ x - gain @ x[none], T @ apart @ T.T - gain @ apart[none] @ T.T
    z[there.table.n + len(held) :] = 0.0
    return z, C


def _rigid(there: Mechanism, held: Sequence[int]) -> list[int]:
    """Indices of the parameters of elements, other than laws of gears, that are not held."""
    bearing = zip(there.elements, _places(there), strict=True)
    return [k for one, at in bearing if one.element != "gear" for k in at if k not in held]


def as_estimated(case: Case, found: Calibration) -> tuple[Case, Calibration, float]:
    """A campaign of pulls with the robot as estimated from its positions.

    Where the masses are not stated, the springs by the pulls determine the weight of the arm.

    Args:
        case: The campaign of pulls.
        found: The complete estimate from its positions.

    Returns:
        The campaign, the estimate with the weight that the pulls determine, and by how much this is
        less than usual.
    """
    tool = StatedTool.of(case.settings)
    known = stance(found, tool)
    there = case.standing(known)
    if not known.factor:
        return there, found, 1.0
    estimate = estimate_of(there.cell, bring(there).data, there.robot.nominal_compliance)[1]
    n = found.mechanism.table.n
    pulled = estimate.value[:n], estimate.cov[:n, :n], estimate.identifiable[:n]
    found = _with_masses(found, _parameters(found, known.held), *pulled)
    return case.standing(stance(found, tool)), found, _without_masses(found)


def _without_masses(found: Calibration) -> float:
    """Torques of the usual weight of an arm on its rotary joints, over those of `_with_masses`."""
    there = found.mechanism
    here, none = configure(there.robot, found.readings.q), np.zeros((len(found.readings), 3))
    beside = found.known.mean[layout(there).moments].reshape(-1, 4)
    often, now = (
        work(here.twists, carried(here, found.weights.gravity, one, none[:, 0], none))
        for one in (usual(there.table)[0], beside)
    )
    turns = ~there.table.prismatic
    return float(np.sum((often * now)[:, turns]) / np.sum(now[:, turns] ** 2))


def _held(found: Calibration, free: Collection[int]) -> Iterator[int]:
    """Numbers of the elements that the weight or `free` calls for."""
    mechanism, (apart, _) = found.mechanism, _apart(found)
    x = mechanism.at(layout(mechanism))
    for k, at in enumerate(_places(mechanism)):
        said = linear.inverse(apart[np.ix_(at, at)])
        if by_weight_alone(mechanism.elements[k]):
            continue
        if k in free or chi2_beyond(float(x[at] @ said @ x[at]), len(at)) < alarms.SUSPECT:
            yield k


def _places(mechanism: Mechanism) -> Iterator[list[int]]:
    """Indices of the parameters of each element."""
    first = layout(mechanism).yields.start
    for effect in mechanism.elements:
        yield list(range(first, first := first + len(effect.parameters)))


def _parameters(found: Calibration, held: Sequence[Elastic]) -> list[int]:
    """Indices of the parameters of some elements."""
    places = list(_places(found.mechanism))
    return [k for one in held for k in places[found.mechanism.elements.index(one)]]


def _chosen(found: Calibration, held: Sequence[int], which: Sequence[int]) -> Array:
    """Rows that select springs, elements, letters and points from all parameters, (s, k)."""
    where, one = layout(found.mechanism), np.eye(len(found.solution.x))
    points = []
    for k in which:
        first = where.tool.start + 6 * k + 3
        points.append(found.mechanism.tool[k, :3, :3] @ one[first : first + 3])
    return np.concatenate([one[where.compliance], one[list(held)], one[where.letters], *points])


def _with_masses(
    found: Calibration, held: Sequence[int], value: Array, cov: Array, by_pulls: Bools
) -> Calibration:
    """The estimate with masses that nobody states, about the springs by pulls.

    Weight determines products of a compliance and a moment, and what is assumed of the moments may
    be wrong by any factor, for each link another one. An assumption must be no evidence against
    springs: the moments that the readings call for beside the springs of the pulls become the means
    of their priors, and these springs those of the springs. What the readings alone tell of the
    springs then moves the estimate away from there. Elements that the weight does not call for are
    rigid, as in the pulls: with unknown masses they share the sag with the springs as they like.

    Args:
        found: The complete estimate.
        held: Indices of the parameters of the elements that are held; others are zero.
        value: Compliances by the pulls alone, shape (n,).
        cov: Their covariance, shape (n, n).
        by_pulls: Joints that these determine, shape (n,).
    """
    where, size = layout(found.mechanism), len(found.solution.x)
    mine, now = np.flatnonzero(by_pulls & (value > 0)), found.mechanism.at(where)
    at, none = where.compliance.start + mine, _rigid(found.mechanism, held)
    std = found.known.std.copy()
    std[none] = _NONE * found.known.most[none]
    N, said = np.zeros((size, size)), np.zeros(size)
    N[np.ix_(at, at)] = linear.inverse(cov[np.ix_(mine, mine)])
    said[at] = N[np.ix_(at, at)] @ (value[mine] - now[at])
    there = _with(replace(found, known=replace(found.known, std=std)), N, said)
    mean, moments = found.known.mean.copy(), there.mechanism.moments.ravel()
    mean[at], mean[where.moments] = value[mine], moments
    std[at] = np.maximum(std[at], value[mine])
    std[where.moments] = np.maximum(std[where.moments], np.abs(moments))
    return _anew(replace(there, known=replace(found.known, mean=mean, std=std)))


_NONE = 1e-3
"""Standard deviation of an element that nothing calls for, over its usual size [1]."""


def _anew(found: Calibration) -> Calibration:
    """The estimate from its readings with other priors.

    The common factor of masses that nobody states stays as it is, and uncertain.
    """
    nothing = np.zeros(len(found.solution.x))
    if not found.wanted.moments:
        return _with(found, np.zeros((len(nothing),) * 2), nothing)
    d = damping(found.mechanism, found.known)
    held = _with(found, np.outer(d, d), nothing)
    free = by_a_factor(held.rows, held.mechanism, held.solution, held.weights.any)
    return replace(held, solution=free)


def beside_pulls(
    found: Calibration, known: PositionsEstimate, value: Array, cov: Array
) -> Calibration:
    """The complete estimate updated by what pulls add on springs, elements, table and points.

    With z0, C0 the values of `stance` and z, C_z those including the pulls, the pulls contribute

        N = C_z^-1 - C0^-1,    N z1 = C_z^-1 z - C0^-1 z0,

    which is added to rows and priors of the positions as a further observation: with z = T x

        (X'X + P + T'N T) x = X'y + P m + T'N z1,

    with repeated linearisation, since the product of a weight and a compliance is nonlinear.

    The readings determine the sag and the pulls the springs; the masses, stated ones within their
    uncertainty, follow.

    Args:
        found: The estimate from the positions alone, with the weight of the arm determined by
            pulls.
        known: Its `stance`.
        value: z: springs and elements, and errors of letters and points, shape (s,).
        cov: Their covariance C_z, shape (s, s).
    """
    there, where = found.mechanism, layout(found.mechanism)
    targets, held = found.readings.targets.tolist(), _parameters(found, known.held)
    T = _chosen(found, held, [targets.index(name) for name in known.points if name in targets])
    own = slice(len(T))  # without the load point, which has no parameters
    size, value = np.sqrt(np.diag(known.cov)[own]), value[own]
    T /= size[:, None]
    before, after = (
        linear.inverse(one[own, own] / size / size[:, None]) for one in (known.cov, cov)
    )
    share, along = linear.directions(after - before)
    N = (along * np.maximum(share, 0.0)) @ along.T
    zero = np.zeros(len(T) - known.springs)
    z0 = np.concatenate([known.compliance, known.yields, zero]) / size
    # errors of letters and points are relative to this estimate
    now = np.concatenate([(T @ there.at(where))[: known.springs], zero])
    said = after @ (value / size) - before @ z0 - N @ now
    return _with(found, T.T @ N @ T, T.T @ said)


def _with(found: Calibration, N: Array, said: Array) -> Calibration:
    """The estimate with N u = said added as an observation of its change u."""
    where, mean = layout(found.mechanism), padded(found.known.mean, len(said))
    P, gone = precision(found.mechanism, found.known)[0], np.zeros(len(said))
    begun = found.mechanism.at(where)
    for _ in range(_TURNS):
        here = found.mechanism.at(where)
        left = replace(found.rows, y=found.rows.y - found.rows.along(here))
        whole = linear.cholesky(left.N + P + N)
        step = whole.solve(left.b - P @ (begun + gone - mean) + said - N @ gone)
        gone += step
        found = _about(found, found.mechanism.moved(here + step, where), whole.root)
    return found


_TURNS = 4
"""Number of linearisations in an update by pulls; they converge quadratically."""


def unloaded_p_value(
    found: Calibration,
    known: PositionsEstimate,
    data: Measured,
    tool: Tool,
    gears: Collection[int] = (),
) -> float:
    """P-value of the pulls' unloaded readings under the model estimated from the positions.

    Chi-square of the unloaded readings about the model, with its covariance, the scatter of its
    joints and the noise of the readings, where the instrument's frame is free; 1 where too few
    targets were read, or 6D poses.

    Args:
        found: The complete estimate, from the positions alone.
        known: Its `stance`.
        data: The pulls, reduced with the robot of `known`.
        tool: Their targets.
        gears: Joints, from 1, whose gear has another law by the pulls: their motion by the weight
            alone at poses outside the positions is free, too.
    """
    row = np.unique(data.zero, return_index=True)[1]
    row = row[np.isfinite(data.unloaded[row]).all(axis=1)]
    names = data.name[row]
    fresh = [k for k, name in enumerate(tool.targets) if name not in known.points]
    wide, cov = _with_targets(found, tool.points[fresh])
    if len(row) <= _FRAME + len(fresh) + len(gears) or data.poses:
        return 1.0
    turned, read = data.pulls.q[data.pull[row]], found.readings.targets.tolist()
    order = [*read, *tool.targets[fresh].tolist()]
    target = np.array([len(order) - 1 - order[::-1].index(str(name)) for name in names])
    at, X, S, further = _there(found, wide, turned - known.unloaded(turned)[0], target, gears)
    left = (data.unloaded[row] + known.moved(turned, names) - at).ravel()
    pose = np.repeat(data.pulls.pose[data.pull[row]], 3)
    V = X @ cov @ X.T + (S @ S.T) * (pose[:, None] == pose)
    W = linear.whitening(V + scipy.linalg.block_diag(*data.zero_cov[row]))
    frame = by_frame(at[:, None])[:, :3].reshape(len(left), _FRAME)
    white = linear.complement(W @ np.hstack([frame, further])).T @ W @ left
    return float(chi2_beyond(float(white @ white), len(white)))


def _with_targets(found: Calibration, points: Array) -> tuple[Mechanism, Array]:
    """The mechanism with further tool points (t, 3) of unknown position, and its covariance."""
    frames = np.tile(np.eye(4), (len(points), 1, 1))
    frames[:, :3, 3] = points
    wide = replace(found.mechanism, tool=np.concatenate([found.mechanism.tool, frames]))
    last, where = layout(found.mechanism).tool.stop, layout(wide)
    fresh = np.arange(last, where.tool.stop)
    cov, old = np.zeros((where.size, where.size)), np.delete(np.arange(where.size), fresh)
    cov[np.ix_(old, old)] = found.solution.cov
    cov[fresh, fresh] = _ANYWHERE_M**2
    return wide, cov


_ANYWHERE_M = 0.01
"""Standard deviation of a reflector that only the pulls read about its stated position [m]."""


def _there(
    found: Calibration, mechanism: Mechanism, q: Array, target: Ints, gears: Collection[int]
) -> tuple[Array, Array, Array, Array]:
    """Position of a target of the unloaded robot at each pose, and its derivatives.

    Returns:
        Positions [m], F_b, (m, 3), and derivatives by all parameters (3 m, k), by the error of each
        joint in units of its standard deviation (3 m, n), and by another stiffness or play of some
        gears according to the sign of their torque (3 m, 2 g).
    """
    m = len(q)
    never, weights = np.full(m, np.nan), replace(found.weights, carried=np.zeros(m, dtype=np.int64))
    stand = mechanism.stand(q, weights, never, never, never)
    D, Z = derivatives(mechanism, stand, weights)
    K, knot = between_knots(mechanism.curves, q, Z)
    X = np.zeros((*D.shape[:2], layout(mechanism).size))
    X[..., : D.shape[2]] = D
    for k in range(knot.shape[1]):
        X[np.arange(m), :, D.shape[2] + knot[:, k]] += K[..., k]
    mine = np.arange(m)[:, None], 6 * target[:, None] + np.arange(3)
    S = Z[..., : mechanism.table.n] * found.scatter.joints
    which = np.array(sorted(gears), dtype=np.int64) - 1
    tau = stand.tau[:, which]
    size = np.abs(tau).max(axis=0, initial=0.0)
    sides = np.concatenate([np.abs(tau) / np.where(size > 0, size, 1.0), np.sign(tau)], axis=1)
    G = np.tile(Z[..., which], 2) * sides[:, None]
    return (
        stand.at[np.arange(m), target],
        X[mine].reshape(3 * m, -1),
        S[mine].reshape(3 * m, -1),
        G[mine].reshape(3 * m, -1),
    )


_FRAME = 6
"""Number of coordinates of a frame."""


def _about(found: Calibration, moved: Mechanism, root: Array) -> Calibration:
    """The estimate with another mechanism, its readings linearised about that.

    `root` is upper triangular, and root root' the covariance of the parameters.
    """
    here = linearised(found.readings, moved, found.weights)
    where = layout(moved)
    none = np.zeros_like(found.solution.knots)
    solution = Posterior(moved.at(where), root, none, found.solution.evidence)
    return replace(
        found,
        mechanism=moved,
        linear=here,
        rows=rows(here, moved, found.scatter),
        solution=solution,
    )
