"""Stage 5. Joint values, forces and displacements in, c = B x + G e out: Eqs. (19), (20)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
import scipy.sparse

from pipeline.base import covariance
from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings
from pipeline.machine.cell import Cell, jacobian, predict
from pipeline.machine.effects import Pulls
from pipeline.machine.robot import Robot
from pipeline.store import tables
from pipeline.system.system import Errors, Rows, System

FORCE = ["fx_n", "fy_n", "fz_n"]
DELTA = ["dx_m", "dy_m", "dz_m"]
TRACKED = ("tracker", "zero", "direction")
"""Sources of error that are in proportion to the noise of the tracker."""

WILD = 20.0
"""A compliance beyond so many typical ones, or below zero, is no spring's."""

SMALL_M = 1e-5
"""Where that noise is not known, directions err by this much, and what it does is divided by it."""


@dataclass(frozen=True, eq=False)
class Measured(Locked):
    """One campaign's measurements as arrays, in F_b, SI: all that the systems are made from.

    Attributes:
        pulls: What was set and read in each pull, m of them.
        pull: Pull of each displacement, shape (d,).
        target: Index of its target in the tool, shape (d,).
        name: Name of its target, shape (d,).
        delta: Displacements [m], shape (d, 3).
        unloaded: Unloaded positions [m], NaN when unknown, shape (d, 3).
        loaded_cov: Covariance of the loaded readings [m^2], shape (d, 3, 3).
        zero_cov: Covariance of the zeros [m^2], shape (d, 3, 3).
        zero: Number of the zero that the displacement is measured from, shape (d,).
        reading_std: Standard uncertainty of the scale readings [N], shape (m,).
        direction_cov: Covariance of the direction cosines, shape (m, 3, 3).
        rotation_cov: Covariance of the registration's rotation [rad^2], shape (3, 3).
        gain_std: Relative standard uncertainty of the scale's gain.
        noise_stated: False: the covariances of readings are relative, 1 m^2 each, and so are those
            of zeros and directions.
        rotation_found: Whether `rotation_cov` rests on the scatter of the base reflectors.
        found_m: What the relative ones have been multiplied by [m], None if by nothing.
        bends: Whether what an undeformed cell leaves out, the robot's own deflection, is an error.
        tool_std: Standard uncertainty per axis of the tool's nominal points [m].
        joint_std: Standard uncertainty of the joints' zeros [m] or [rad], shape (n,).
    """

    pulls: Pulls
    pull: Ints
    target: Ints
    name: Strings
    delta: Array
    unloaded: Array
    loaded_cov: Array
    zero_cov: Array
    zero: Ints
    reading_std: Array
    direction_cov: Array
    rotation_cov: Array
    gain_std: float
    noise_stated: bool
    tool_std: float = 0.0
    joint_std: Array = field(default_factory=lambda: np.zeros(0))
    rotation_found: bool = False
    found_m: float | None = None
    bends: bool = False

    def scaled(self, factor: float) -> Measured:
        """The same with the standard uncertainties of readings, zeros, directions multiplied."""
        return replace(
            self,
            loaded_cov=self.loaded_cov * factor**2,
            zero_cov=self.zero_cov * factor**2,
            direction_cov=self.direction_cov * factor**2,
        )

    def in_metres(self, found_m: float | None) -> Measured:
        """The same with a noise of the tracker in place of the unstated one [m]; None: as it is."""
        if found_m is None:
            return self
        return replace(self.scaled(found_m / (self.found_m or 1.0)), found_m=found_m)


def measured(
    robot: Robot,
    targets: Strings,
    joints: pd.DataFrame,
    forces: pd.DataFrame,
    displacements: pd.DataFrame,
    rotation_cov: Array,
    gain_std: float,
    tool_std: float = 0.0,
    joint_std: Array | None = None,
    rotation_found: bool = False,
) -> Measured:
    """Join the tables of a campaign into arrays; rows without a partner are left out.

    Args:
        robot: The robot, for the names of its joints.
        targets: Names of the tool's targets, shape (t,).
        joints: Table of joint values, `tables.joints(robot)`.
        forces: Table FORCES.
        displacements: Table DISPLACEMENTS.
        rotation_cov: As in `Measured`.
        gain_std: As in `Measured`.
        tool_std: As in `Measured`.
        joint_std: As in `Measured`; none where not given.
        rotation_found: As in `Measured`.
    """
    pulls = forces.merge(joints, on="pose").sort_values(["pose", "repeat"], ignore_index=True)
    key = pd.MultiIndex.from_frame(pulls[["pose", "repeat"]])
    rows = displacements[displacements["target"].isin(targets)]
    pull = key.get_indexer(pd.MultiIndex.from_frame(rows[["pose", "repeat"]]))
    target = pd.Index(targets).get_indexer(pd.Index(rows["target"]))
    order = np.lexsort((target, pull))
    order = order[pull[order] >= 0]
    rows, pull, target = rows.iloc[order], pull[order], target[order]
    zero_time = rows.groupby(pull)["zero_time_s"].mean().reindex(range(len(pulls))).to_numpy()
    loaded_cov, zero_cov, stated = _covariances(rows)
    values = [tables.joint_column(j.name, j.prismatic) for j in robot.joints]
    return Measured(
        pulls=Pulls(
            pose=pulls["pose"].to_numpy(np.int64),
            repeat=pulls["repeat"].to_numpy(np.int64),
            q=pulls[values].to_numpy(float),
            force=pulls[FORCE].to_numpy(float),
            branch=pulls["branch"].to_numpy(float),
            approach=pulls["approach"].to_numpy(float),
            time=pulls["time_s"].to_numpy(float),
            time_zero=zero_time,
        ),
        pull=pull,
        target=target,
        name=rows["target"].to_numpy(object),
        delta=rows[DELTA].to_numpy(float),
        unloaded=rows[["zero_x_m", "zero_y_m", "zero_z_m"]].to_numpy(float),
        loaded_cov=loaded_cov,
        zero_cov=zero_cov,
        zero=np.asarray(rows.groupby(["pose", "target"]).ngroup(), dtype=np.int64),
        reading_std=pulls["reading_std_n"].to_numpy(float),
        direction_cov=covariance.matrices(pulls, covariance.columns("u", "")),
        rotation_cov=rotation_cov,
        gain_std=gain_std,
        noise_stated=stated,
        tool_std=tool_std,
        joint_std=np.zeros(robot.n) if joint_std is None else joint_std,
        rotation_found=rotation_found,
    )


def _covariances(rows: pd.DataFrame) -> tuple[Array, Array, bool]:
    of = [
        covariance.numbers(rows, covariance.columns(f"{state}_c")) for state in ("loaded", "zero")
    ]
    loaded, zero = (covariance.full(six) for six in of)
    if all(covariance.stated(covariance.known(six)) for six in of):
        return loaded, zero, True
    count = rows["zero_count"].to_numpy(float)
    share = np.divide(1.0, count, out=np.zeros_like(count), where=count > 0)
    unit = np.broadcast_to(np.eye(3), loaded.shape)
    return unit.copy(), unit * share[:, None, None], False


def assemble(cell: Cell, data: Measured, values: Array) -> System:
    """The linear system about `values`, with every source of error as a factor of its covariance.

    c is corrected so that c = B x holds for a model that is not linear; for the paper's model
    nothing is corrected. Rows are sorted by pose, repeat, target and axis.

    Args:
        cell: The model.
        data: The measurements.
        values: Parameters about which B and the force errors are taken, shape (k,).
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


def _rows(data: Measured) -> Rows:
    pull = np.repeat(data.pull, 3)
    return Rows(
        pose=data.pulls.pose[pull],
        repeat=data.pulls.repeat[pull],
        target=np.repeat(data.name, 3),
        axis=np.tile(np.arange(3), len(data.pull)),
        pull=pull,
    )


def errors(cell: Cell, data: Measured, values: Array) -> Errors:
    """G of c = B x + G e: tracker, shared zero, force (reading, direction, gain), frame, geometry.

    All in metres, but what is in proportion to a noise of the tracker that nobody stated. Last,
    where it counts, what c = B x leaves out: the geometry of the deflected robot, once.
    """
    d, m = len(data.pull), len(data.pulls)
    blocks = [
        _Block("tracker", False, covariance.factors(data.loaded_cov), np.arange(d), d),
        _Block("zero", False, covariance.factors(data.zero_cov), data.zero, data.zero.max() + 1),
    ]
    force = data.pulls.force
    size = np.linalg.norm(force, axis=1, keepdims=True)
    reading = (force / size * data.reading_std[:, None])[:, None, :]
    gain = force[:, None, :] * data.gain_std
    unit = 1.0 if data.noise_stated or data.found_m else SMALL_M
    direction = np.swapaxes(covariance.factors(data.direction_cov), 1, 2) * size[:, None, :] * unit
    moved = _moved(cell, data, values, np.concatenate([reading, direction, gain], axis=1))
    turn = covariance.factors(data.rotation_cov[None])[0].T
    blocks += [
        _Block("force_reading", False, moved[..., :1], data.pull, m),
        _Block("direction", False, moved[..., 1:4] / unit, data.pull, m),
        _Block("registration", True, _turned(cell, data, values, turn), np.zeros(d, int), 1),
        _Block("force_gain", True, moved[..., 4:], np.zeros(d, int), 1),
        _Block("geometry", True, _geometry(cell, data, values), np.zeros(d, int), 1),
    ]
    if data.bends and cell.equilibrium == "undeformed":
        bent = second_order(cell, data, values)[..., None]
        blocks.append(_Block("second_order", True, bent, np.zeros(d, int), 1))
    parts = [_sparse(block) for block in blocks]
    return Errors(
        G=scipy.sparse.hstack([part for part, *_ in parts], format="csr"),
        source=np.concatenate([source for _, source, _ in parts]),
        common=np.concatenate([common for *_, common in parts]),
    )


@dataclass(frozen=True, eq=False)
class _Block:
    """Errors of one source: displacement d feels `factor[d]` (3, r) by `owner[d]`."""

    source: str
    common: bool
    factor: Array
    owner: Ints
    owners: int


def _sparse(block: _Block) -> tuple[scipy.sparse.csr_array, Strings, Bools]:
    d, _, r = block.factor.shape
    row = np.broadcast_to(np.arange(3 * d).reshape(d, 3, 1), (d, 3, r))
    column = np.broadcast_to((block.owner[:, None] * r + np.arange(r))[:, None, :], (d, 3, r))
    shape = (3 * d, block.owners * r)
    coo = scipy.sparse.coo_array((block.factor.ravel(), (row.ravel(), column.ravel())), shape)
    coo.eliminate_zeros()
    used = np.flatnonzero(np.bincount(coo.col, minlength=shape[1]))
    return (
        coo.tocsc()[:, used],
        np.full(len(used), block.source, dtype=object),
        np.full(len(used), block.common),
    )


def _moved(cell: Cell, data: Measured, values: Array, modes: Array) -> Array:
    """What small changes of the force, modes (m, r, 3) [N], do to c; shape (d, 3, r) [m].

    The model is asked at the force as read, so c - B x moves against the change.
    """
    return -_force_differences(cell, data, values, modes)


def by_force(cell: Cell, data: Measured, values: Array) -> Array:
    """What one newton more along each pull moves, shape (3 d,) [m/N]; rows as in `assemble`."""
    force = data.pulls.force
    along = (force / np.linalg.norm(force, axis=1, keepdims=True))[:, None, :]
    return _force_differences(cell, data, values, along)[..., 0].ravel()


def _turned(cell: Cell, data: Measured, values: Array, turns: Array) -> Array:
    """What small rotations (r, 3) [rad] of the tracker do: displacement and force turn together."""
    moved = np.stack([np.cross(turn, data.delta) for turn in turns], axis=-1)
    modes = np.stack([np.cross(turn, data.pulls.force) for turn in turns], axis=1)
    return moved - _force_differences(cell, data, values, modes)


def _geometry(cell: Cell, data: Measured, values: Array) -> Array:
    """What wrong tool points and wrong zeros of the joints do, each by one sigma, (d, 3, r) [m]."""
    points = np.vstack([cell.tool.load_point, cell.tool.points])
    moves = data.tool_std * np.eye(points.size).reshape(-1, *points.shape)
    turns = data.joint_std[:, None] * np.eye(cell.robot.n)
    wrong = [(_with_points(cell, points + move), data.pulls) for move in moves if move.any()]
    wrong += [(cell, replace(data.pulls, q=data.pulls.q + turn)) for turn in turns if turn.any()]
    here = predict(cell, data.pulls, values).displacement
    modes = [here - predict(other, pulls, values).displacement for other, pulls in wrong]
    if not modes:
        return np.zeros((len(data.pull), 3, 0))
    return np.stack([mode[data.pull, data.target] for mode in modes], axis=-1)


def second_order(cell: Cell, data: Measured, values: Array) -> Array:
    """How the deflected robot's geometry moves the targets beyond c = B x, shape (d, 3) [m].

    A spring that came out wild, as what hardly shows does, counts as its table has it.
    """
    typical = np.array([p.typical for p in cell.parameters])
    sane = (values > 0) & (values < WILD * typical)
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
    """Central differences of the displacements by force modes (m, r, 3), shape (d, 3, r)."""
    change = np.moveaxis(modes, 1, 0) / 2
    ahead, behind = data.pulls.force + change, data.pulls.force - change
    pulls = data.pulls.under(np.concatenate([ahead, behind]))
    moved = predict(cell, pulls, values).displacement
    moved = moved.reshape(2, len(change), len(data.pulls), *moved.shape[1:])
    return np.moveaxis((moved[0] - moved[1])[:, data.pull, data.target], 0, -1)
