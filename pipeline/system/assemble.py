"""Assemble c = B x + G e from joint values, forces and displacements; Eqs. (19), (20)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse

from pipeline.base import covariance
from pipeline.base.arrays import Array, Ints
from pipeline.machine.cell import Cell, jacobian, predict, sensitivity
from pipeline.machine.effect import Wrench
from pipeline.machine.robot import Robot
from pipeline.reduction.measured import Measured
from pipeline.system.system import Errors, RowIndex, System

TRACKED = ("tracker", "zero", "direction")
"""Sources of error whose standard uncertainty is proportional to the noise of the tracker."""

POSITIONS = "positions"
"""Source of error: what an estimate from absolute positions of the same robot leaves uncertain."""

_WILD = 20.0
"""Compliance in typical sizes above which it is not taken for that of a spring [1]; a negative one
is not either."""

_SMALL_M = 1e-5
"""Step used for the direction errors where the noise of the tracker is unknown [m]; the result is
divided by it."""


def assemble(cell: Cell, data: Measured, values: Array) -> System:
    """The system linearised about `values`, each source of error as a factor of its covariance.

    B = dd/dx at x0 = `values` and c = delta + (B x0 - d(x0)) [m], where d is the displacement
    predicted by the model, so that c = B x holds to first order for a nonlinear model; for the
    paper's model the correction is zero. Rows are sorted by pose, repeat, target and axis.

    Args:
        cell: The model.
        data: The measurements.
        values: Parameters about which B and the force errors are linearised, shape (k,).
    """
    values = np.asarray(values, dtype=float)
    k = len(values)
    B = jacobian(cell, data.pulls, values)[data.pull, data.target].reshape(-1, k)
    model = predict(cell, data.pulls, values).displacement[data.pull, data.target].ravel()
    return System(
        parameters=cell.parameters,
        rows=_rows(data),
        B=B,
        c=data.delta.ravel() + (B @ values - model),
        errors=errors(cell, data, values),
        noise_stated=data.noise_stated,
        found_m=data.found_m,
    )


def _rows(data: Measured) -> RowIndex:
    pull = np.repeat(data.pull, 3)
    return RowIndex(
        pose=data.pulls.pose[pull],
        repeat=data.pulls.repeat[pull],
        target=np.repeat(data.name, 3),
        axis=np.tile(np.arange(3), len(data.pull)),
        pull=pull,
    )


def errors(cell: Cell, data: Measured, values: Array) -> Errors:
    """G of c = B x + G e: tracker, shared zero, wander, force, weights, scale, frame, geometry.

    Column j is (dc/dv_j) u(v_j) for an independent input v_j, or (dc/dv) L with L L' = cov(v), so
    that G G' is the law of propagation J cov(v) J' (GUM, JCGM 100:2008, and JCGM 102:2011). A force
    f enters through the model, dc/df = -dd/df; a small rotation w of the frame as w x delta - dd/df
    (w x f).

    All columns are in metres, except those proportional to a tracker noise that is neither stated
    nor found. The last column, where it is used, is common to all rows: what c = B x neglects, the
    geometry of the deflected robot.
    """
    return with_readings(inputs(cell, data, values), data)


def with_readings(others: Sequence[ErrorBlock], data: Measured) -> Errors:
    """Combine the errors of the readings, with the covariances of `data`, and all `others`."""
    d, factors = len(data.pull), covariance.factors
    tracker = ErrorBlock("tracker", False, factors(data.loaded_cov), np.arange(d), d)
    zero = ErrorBlock("zero", False, factors(data.zero_cov), data.zero, data.zero.max() + 1)
    return _together([tracker, zero, *others])


def inputs(cell: Cell, data: Measured, values: Array) -> list[ErrorBlock]:
    """Errors of every input except the readings, arguments as for `errors`.

    They do not depend on how the readings are weighted.
    """
    d, m = len(data.pull), len(data.pulls)
    unit = 1.0 if data.noise_stated or data.found_m else _SMALL_M
    modes = _of_force(data, unit, _of_scale(cell, data, values))
    ends = np.cumsum([mode.shape[1] for mode in modes.values()])[:-1]
    moved = np.split(_moved(cell, data, values, np.concatenate([*modes.values()], 1)), ends, 2)
    pulled = dict(zip(modes, moved, strict=True))
    turn = covariance.factors(data.rotation_cov[None])[0].T
    scaled = _scaled(cell, data, values)
    blocks = [
        ErrorBlock("force_reading", False, pulled.pop("force_reading"), data.pull, m),
        ErrorBlock("direction", False, pulled.pop("direction") / unit, data.pull, m),
        *_by_time(data, scaled),
    ]
    once = {
        "tracker_scale": data.length_rel * scaled,
        "registration": _turned(cell, data, values, turn),
    } | pulled
    once["payload_center"] = _centers(cell, data, values)
    once["geometry"] = _geometry(cell, data, values)
    if data.stance is not None:
        once[POSITIONS] = _beside_positions(cell, data, values)
    if data.bends and cell.equilibrium == "undeformed":
        once["second_order"] = second_order(cell, data, values)[..., None]
    blocks += [ErrorBlock(source, True, part, np.zeros(d, int), 1) for source, part in once.items()]
    return blocks


def _by_time(data: Measured, scaled: Array) -> Iterator[ErrorBlock]:
    """Errors common to the readings of one pose (wander) or of one day, where they are nonzero.

    Args:
        data: The measurements.
        scaled: Effect of a relative error of all displacements, per unit, shape (d, 3, 1) [m].
    """
    if data.wander is not None and data.wander.any():
        pose = np.unique(data.pulls.pose, return_inverse=True)[1][data.pull]
        yield ErrorBlock("wander", False, data.wander, pose, int(pose.max()) + 1)
    if data.day_rel:
        day = data.day[data.pull]
        yield ErrorBlock("day", True, data.day_rel * scaled, day, int(day.max()) + 1)


def _scaled(cell: Cell, data: Measured, values: Array) -> Array:
    """Effect of a relative error of all displacements, per unit, shape (d, 3, 1) [m].

    It is proportional to the predicted displacements: with the measured ones, small displacements
    would get too much weight and the estimate would be too stiff (Peelle's pertinent puzzle).
    """
    if not (data.day_rel or data.length_rel):
        return np.zeros((len(data.pull), 3, 1))
    moved = predict(cell, data.pulls, values).displacement[data.pull, data.target]
    return np.asarray((moved * data.shifts[:, None])[..., None])


def _of_scale(cell: Cell, data: Measured, values: Array) -> tuple[float, float]:
    """Standard uncertainties of the scale's gain [1] and zero [N], with those of all effects."""
    scale = data.scale
    of = [(facet, mine) for facet, mine in cell.split(values) if isinstance(facet, Wrench)]
    gain = np.linalg.norm([scale.gain_sigma, *(facet.gain_std(mine) for facet, mine in of)])
    zero = np.linalg.norm([scale.zero_sigma_n, *(facet.zero_std(mine) for facet, mine in of)])
    return float(gain), float(zero)


def _of_force(data: Measured, unit: float, scale: tuple[float, float]) -> dict[str, Array]:
    """Change of each force per standard uncertainty of each source of error, (m, r, 3) [N].

    Args:
        data: The measurements.
        unit: Factor of the directions [1].
        scale: Standard uncertainties of the scale's gain [1] and zero [N].
    """
    force, (gain_std, zero_std_n) = data.pulls.force, scale
    size = np.linalg.norm(force, axis=1, keepdims=True)
    along = (force / size)[:, None]
    return {
        "force_reading": along * data.reading_std[:, None, None],
        "direction": np.swapaxes(covariance.factors(data.direction_cov), 1, 2)
        * size[:, None]
        * unit,
        "force_gain": (data.pulls.pulled * force)[:, None] * gain_std,
        "force_zero": data.pulls.pulled[..., None] * along * zero_std_n,
        "payload_mass": along * (_of_body(data) * data.mass_std).T[..., None],
    }


def _of_body(data: Measured) -> Array:
    """Which weight or payload loads each pull, one row per body, shape (b, m)."""
    return np.asarray(data.body == np.unique(data.body[data.body >= 0])[:, None])


@dataclass(frozen=True, eq=False)
class ErrorBlock:
    """Errors of one source: displacement d has `factor[d]` (3, r) times those of `owner[d]`."""

    source: str
    common: bool
    factor: Array
    owner: Ints
    owners: int


def _together(blocks: list[ErrorBlock]) -> Errors:
    """G of all sources, without columns that are zero."""
    ends = np.cumsum([block.owners * block.factor.shape[2] for block in blocks]).tolist()
    firsts = [0, *ends[:-1]]
    value = np.concatenate([block.factor.ravel() for block in blocks])
    row, column = (np.concatenate(some) for some in zip(*map(_where, blocks, firsts), strict=True))
    there = value != 0
    value, row, column = value[there], row[there], column[there]
    used = np.flatnonzero(np.bincount(column, minlength=ends[-1]))
    at = np.searchsorted(used, column)
    shape = (3 * len(blocks[0].factor), len(used))
    of = np.searchsorted(ends, used, side="right")
    return Errors(
        scipy.sparse.coo_array((value, (row, at)), shape).tocsr(),
        np.array([block.source for block in blocks], dtype=object)[of],
        np.array([block.common for block in blocks])[of],
    )


def _where(block: ErrorBlock, first: int) -> tuple[Ints, Ints]:
    """Row and column in G of every entry of a block whose first column is `first`."""
    d, _, r = block.factor.shape
    row = np.broadcast_to(np.arange(3 * d).reshape(d, 3, 1), (d, 3, r))
    column = np.broadcast_to((block.owner[:, None] * r + np.arange(r))[:, None, :], (d, 3, r))
    return row.ravel(), first + column.ravel()


def _moved(cell: Cell, data: Measured, values: Array, modes: Array) -> Array:
    """Change of c due to small changes of the force, modes (m, r, 3) [N]; shape (d, 3, r) [m].

    The model is evaluated at the force as read, so c - B x moves against the change.
    """
    return -_force_differences(cell, data, values, modes)


def by_force(cell: Cell, data: Measured, values: Array) -> Array:
    """Displacement per newton of additional pull, shape (3 d,) [m/N]; rows as in `assemble`."""
    force = data.pulls.force
    along = (force / np.linalg.norm(force, axis=1, keepdims=True))[:, None, :]
    return _force_differences(cell, data, values, along)[..., 0].ravel()


def by_inputs(cell: Cell, data: Measured, values: Array) -> tuple[Array, Array]:
    """Sensitivity of c to 1 N along each axis of F_b and to 1 rad of the tracker about each.

    Rows as in `assemble`, signs as in the columns of its G, shapes (3 d, 3) [m/N] and
    (3 d, 3) [m/rad].
    """
    modes = np.broadcast_to(np.eye(3), (len(data.pulls), 3, 3))
    moved = _moved(cell, data, values, modes), _turned(cell, data, values, np.eye(3))
    return moved[0].reshape(-1, 3), moved[1].reshape(-1, 3)


def _turned(cell: Cell, data: Measured, values: Array, turns: Array) -> Array:
    """Change of c due to small rotations (r, 3) [rad] of the tracker, shape (d, 3, r) [m].

    Displacement and measured force direction rotate together; the force of a weight does not, since
    its direction is not measured.
    """
    moved = np.stack([np.cross(turn, data.delta) for turn in turns], axis=-1)
    read = data.pulls.pulled * data.pulls.force
    modes = np.stack([np.cross(turn, read) for turn in turns], axis=1)
    return moved - _force_differences(cell, data, values, modes)


def _geometry(cell: Cell, data: Measured, values: Array) -> Array:
    """Effect on c of one sigma of each tool coordinate and of each joint zero, (d, 3, r) [m]."""
    points = np.vstack([cell.tool.load_point, cell.tool.points])
    moves = data.tool_std * np.eye(points.size).reshape(-1, *points.shape)
    if data.load_point_std is not None:
        moves[:3, 0] = data.load_point_std * np.eye(3)
    turns = data.joint_std[:, None] * np.eye(cell.robot.n)
    if data.stance is not None:  # their uncertainty is part of the stance
        read = [name in data.stance.points for name in cell.tool.named]
        moves[np.repeat(read, 3)] = 0.0
        turns[[one.joint - 1 for one in data.stance.letters if one.name == "joint_offset"]] = 0.0
    wrong = [(_with_points(cell, points + move), data.pulls) for move in moves if move.any()]
    wrong += [(cell, replace(data.pulls, q=data.pulls.q + turn)) for turn in turns if turn.any()]
    here = predict(cell, data.pulls, values).displacement
    modes = [here - predict(other, pulls, values).displacement for other, pulls in wrong]
    if not modes:
        return np.zeros((len(data.pull), 3, 0))
    return np.stack([mode[data.pull, data.target] for mode in modes], axis=-1)


def by_stance(cell: Cell, data: Measured, values: Array) -> Array:
    """Effect on c of each error of table and points, `KnownRobot.parts`, (d, 3, r) [m]."""
    assert data.stance is not None
    stance = data.stance

    def seen(robot: Robot, points: Mapping[str, Array]) -> Array:
        at = np.array([points.get(name, at) for name, at in cell.tool.named.items()])
        other = replace(_with_points(cell, at), robot=robot)
        return predict(other, data.pulls, values).displacement[data.pull, data.target]

    here = seen(stance.robot, stance.points)
    modes = [here - seen(*one) for one in stance.variants]
    return np.stack(modes, axis=-1) if modes else np.zeros((*here.shape, 0))


def _beside_positions(cell: Cell, data: Measured, values: Array) -> Array:
    """Effect on c of errors of absolute positions via table, points and elements, (d, 3, r) [m].

    The elements of `KnownRobot` are held in the cell at the values estimated from positions;
    their errors are K a + W w.
    """
    assert data.stance is not None
    stance, n = data.stance, len(data.stance.compliance)
    _, K, W = stance.parts
    of_table = by_stance(cell, data, values)
    if not stance.held:
        return of_table
    held = sensitivity(cell, data.pulls, values, stance.held)[data.pull, data.target]
    return np.concatenate([of_table - held @ K[n:], -held @ W[n:]], axis=-1)


def _centers(cell: Cell, data: Measured, values: Array) -> Array:
    """Effect on c of one sigma of the centre of each payload along each axis, (d, 3, r) [m]."""
    here = predict(cell, data.pulls, values).displacement
    modes = []
    for mine in _of_body(data) * data.center_std:
        for axis in np.eye(3) if mine.any() else ():
            moved = replace(data.pulls, acts_at=data.pulls.acts_at + mine[:, None] * axis)
            modes.append(here - predict(cell, moved, values).displacement)
    if not modes:
        return np.zeros((len(data.pull), 3, 0))
    return np.stack([mode[data.pull, data.target] for mode in modes], axis=-1)


def second_order(cell: Cell, data: Measured, values: Array) -> Array:
    """Displacement that the deflected geometry of the robot adds to c = B x, shape (d, 3) [m].

    An implausible estimated compliance (negative or beyond `_WILD`), as of a joint that the data
    hardly load, is replaced by its nominal value.
    """
    typical = np.array([p.typical for p in cell.parameters])
    sane = (values > 0) & (values < _WILD * typical)
    x = np.where(sane, values, cell.robot.nominal_compliance)
    flat, bent = (
        predict(replace(cell, equilibrium=kind), data.pulls, x).displacement
        for kind in ("undeformed", "deformed")
    )
    return np.asarray((bent - flat)[data.pull, data.target])


def _with_points(cell: Cell, points: Array) -> Cell:
    """The cell with other tool points, load point first."""
    return replace(cell, tool=replace(cell.tool, load_point=points[0], points=points[1:]))


def _force_differences(cell: Cell, data: Measured, values: Array, modes: Array) -> Array:
    """Central differences of the displacements by force modes (m, r, 3) [N], (d, 3, r) [m]."""
    change = np.moveaxis(modes, 1, 0) / 2
    ahead, behind = data.pulls.force + change, data.pulls.force - change
    pulls = data.pulls.under(np.concatenate([ahead, behind]))
    moved = predict(cell, pulls, values).displacement
    moved = moved.reshape(2, len(change), len(data.pulls), *moved.shape[1:])
    return np.moveaxis((moved[0] - moved[1])[:, data.pull, data.target], 0, -1)
