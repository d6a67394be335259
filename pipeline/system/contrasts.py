"""Contrasts: differences between readings that no model of the robot can produce, noise alone.

They are changes of the effector's own triangle, repeated zeros, and repeated pulls. A wrong model
of the robot is therefore not mistaken for noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy.sparse

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.machine.cell import Cell
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import configure
from pipeline.reduction.measured import Measured
from pipeline.reduction.register import XYZ
from pipeline.reduction.settings import Settings
from pipeline.system.blocks import Blocks
from pipeline.system.system import Errors, RowIndex, System

_SAME_FORCE = 0.03
"""Maximum relative difference of force between a repeat and the first pull of its group [1]; a
turnbuckle can be set to that."""


_SAME_DIRECTION = 0.005
"""Maximum angle between their forces [rad]: a chain hung into the same place again."""


_ONE_WAY = 0.1
"""Angle between two forces of a pose up to which its springs move the effector in proportion to
their sizes [rad]: one chain turns by less while the robot yields, and an error of its square, 1 %,
does not matter."""

ZEROS = -1
"""Pull index that marks a contrast between zeros."""


@dataclass(frozen=True, eq=False)
class Zeros(Locked):
    """Differences between unloaded readings of one target in one pose.

    Attributes:
        pose: Shape (n,).
        target: Index into the tool's targets, shape (n,).
        which: Number of the difference within its pose and target, shape (n,).
        delta: [m], F_b, shape (n, 3).
        cov: [m^2], shape (n, 3, 3).
    """

    pose: Ints
    target: Ints
    which: Ints
    delta: Array
    cov: Array

    @classmethod
    def none(cls) -> Zeros:
        """The empty set: no zero was repeated."""
        nothing = np.zeros(0, np.int64)
        return cls(nothing, nothing, nothing, np.zeros((0, 3)), np.zeros((0, 3, 3)))


def repeated_zeros(settings: Settings, placed: pd.DataFrame) -> Zeros:
    """Every further unloaded reading minus the mean of those before it.

    delta_n = p_n - (p_0 + ... + p_(n-1)) / n [m], cov C_n + (C_0 + ... + C_(n-1)) / n^2 [m^2], F_b:
    Helmert contrasts.

    These differences are independent of each other and of the mean, which is the zero of the pose.

    Args:
        settings: Names of the measured targets.
        placed: Table PLACED, F_b.
    """
    names = pd.Index(settings.measured)
    rows = placed[(placed["state"] == "unloaded") & placed["target"].isin(names)]
    rows = rows.sort_values("time", kind="stable")
    groups = rows.groupby(["pose", "target"])
    nth = groups.cumcount().to_numpy()
    every = [*XYZ, *covariance.columns()]
    past = (groups[every].cumsum() - rows[every]).to_numpy()
    count = np.maximum(nth, 1)[:, None]
    C_past = covariance.symmetric(past[:, 3:] / count**2)
    again = nth > 0
    return Zeros(
        pose=rows["pose"].to_numpy(np.int64)[again],
        target=np.asarray(names.get_indexer(pd.Index(rows["target"])), dtype=np.int64)[again],
        which=np.asarray(nth, dtype=np.int64)[again],
        delta=(rows[XYZ].to_numpy() - past[:, :3] / count)[again],
        cov=(covariance.matrices(rows) + C_past)[again],
    )


def pure_error(system: System, residual: Array, data: Measured, zeros: Zeros, cell: Cell) -> System:
    """Contrasts of the campaign that no model of the robot can produce, as a system without x.

    K' (f c) with K' modes = 0 and K' K = I within each group of rows, f = `to_first`: error
    contrasts, whose factors are K' f G.

    One free rigid motion of the effector is projected out of each group of equal pulls, another out
    of each repeated zero; with fewer than three targets, the zeros are assumed not to move instead.
    Pulls of a group are scaled to the force of the first, so that a misfit proportional to the
    force cancels too.

    Args:
        system: The system, for its errors.
        residual: c - B x [m]; the model only accounts for small differences of direction in a
            group.
        data: The measurements that the system was made from.
        zeros: Repeated zeros, may be empty.
        cell: For the positions of the targets.
    """
    stack = stacked(system, residual, data, zeros, cell)
    errors = stack.errors
    K = _contrasts(stack.group, stack.modes)
    contrasts = K.shape[1]
    at = np.asarray(np.abs(K).argmax(axis=0)).ravel()
    rows = RowIndex(
        pose=stack.pose[at],
        repeat=np.zeros(contrasts, np.int64),
        target=np.full(contrasts, "", dtype=object),
        axis=np.zeros(contrasts, np.int64),
        pull=np.where(at < 3 * len(data.pull), 0, ZEROS),
    )
    G = scipy.sparse.csr_array(K.T @ scipy.sparse.diags_array(stack.to_first) @ errors.G)
    return System(
        parameters=(),
        rows=rows,
        B=np.zeros((contrasts, 0)),
        c=K.T @ (stack.to_first * stack.c),
        errors=Errors(G, errors.source, errors.common),
        noise_stated=system.noise_stated,
        found_m=system.found_m,
    )


@dataclass(frozen=True, eq=False)
class Stack(Locked):
    """All readings of displacements of one campaign: rows of c, then repeated zeros.

    Attributes:
        c: Values [m], shape (R,).
        errors: Their errors.
        pose: Pose number of each row, shape (R,).
        target: Index of its target, shape (R,).
        axis: 0, 1, 2 for x, y, z of F_b, shape (R,).
        pull: Index of its pull, -1 for repeated zeros, shape (R,).
        which: Number of the difference of zeros, 0 for rows of c, shape (R,).
        group: Equal pulls share a number, and so do the targets of one repeated zero, shape (R,).
        modes: Effect of six small rigid motions of the effector on the row, shape (R, 6).
        to_first: Force of the first pull of its group over its own, shape (R,).
    """

    c: Array
    errors: Errors
    pose: Ints
    target: Ints
    axis: Ints
    pull: Ints
    which: Ints
    group: Ints
    modes: Array
    to_first: Array


def stacked(system: System, c: Array, data: Measured, zeros: Zeros, cell: Cell) -> Stack:
    """Rows of c (or of residuals, shape (M,)) followed by the repeated zeros."""
    first = np.unique(data.pulls.pose, return_index=True)[1]
    q = dict(zip(data.pulls.pose[first].tolist(), data.pulls.q[first], strict=True))
    zeros = _in_poses(zeros, q, cell) if cell.tool.six else zeros
    known = np.isin(zeros.pose, list(q))
    zero_pose, zero_target = zeros.pose[known], zeros.target[known]
    pose = np.concatenate([data.pulls.pose[data.pull], zero_pose])
    values, which = np.unique(pose, return_inverse=True)
    axes = configure(cell.robot, np.array([q[p] for p in values.tolist()])).flange_axes[which]
    target = np.concatenate([data.target, zero_target])
    modes = _rigid(cell, axes, target)
    repeats, to_first = _repeats(data)
    brought = np.repeat(np.append(to_first[data.pull], np.ones(len(zero_pose))), 3)
    group = np.concatenate([repeats[data.pull], zero_pose * 1000 + zeros.which[known]])
    group[len(data.pull) :] += group[: len(data.pull)].max() + 1
    if len(set(data.target.tolist())) < 3:
        modes[len(data.pull) :] = 0.0
    C = zeros.cov[known]
    if not data.noise_stated:
        nth = zeros.which[known][:, None, None]
        C = (system.found_m or 1.0) ** 2 * np.eye(3) * (1 + 1 / nth)
    if cell.tool.six:
        C = C * _turning(data)[zero_target][:, None, None]
    factors = covariance.factors(C)
    own = scipy.sparse.block_diag(list(factors), format="csr") if len(factors) else None
    G, source, common = system.errors.G, system.errors.source, system.errors.common
    if own is not None:
        G = scipy.sparse.csr_array(scipy.sparse.block_diag([G, own], format="csr"))
        source = np.concatenate([source, np.full(own.shape[1], "zero", dtype=object)])
        common = np.concatenate([common, np.zeros(own.shape[1], dtype=bool)])
    d = len(data.pull)
    return Stack(
        c=np.concatenate([c, zeros.delta[known].ravel()]),
        errors=Errors(G, source, common),
        pose=np.repeat(pose, 3),
        target=np.repeat(target, 3),
        axis=np.tile(np.arange(3), len(pose)),
        pull=np.repeat(np.append(data.pull, np.full(len(zero_pose), -1)), 3),
        which=np.repeat(np.append(np.zeros(d, np.int64), zeros.which[known]), 3),
        group=np.repeat(group, 3),
        modes=modes.reshape(-1, 6),
        to_first=brought,
    )


def ways(pulls: Pulls) -> Ints:
    """Number of each pull's way of loading within its pose, from 0: kind, point, direction, (m,).

    Whatever a robot does in proportion to the load is then one motion for each way: pulls towards
    two anchors move the effector differently.
    """
    unit = pulls.force / np.linalg.norm(pulls.force, axis=1, keepdims=True)
    like = _like(_loaded_alike(pulls), unit, _ONE_WAY)
    leader, number = np.unique(like, return_inverse=True)
    return Blocks.of(pulls.pose[leader]).place[number.ravel()]


def own_columns(columns: Array, number: Ints) -> Array:
    """Columns (M, k) of their own for the rows of each number, shape (M, k n)."""
    own = np.eye(int(number.max(initial=0)) + 1)[number]
    return np.asarray((own[:, :, None] * columns[:, None, :]).reshape(len(number), -1))


def _turning(data: Measured) -> Array:
    """Mean variance of positions and of rotations, relative to that of positions, shape (2,)."""
    own = np.einsum("dii->d", data.loaded_cov)
    mean = np.bincount(data.target, own) / np.bincount(data.target)
    return np.asarray(mean / mean[0])


def _rigid(cell: Cell, axes: Array, target: Ints) -> Array:
    """Effect of six small rigid motions of the effector on the given targets, shape (n, 3, 6)."""
    if cell.tool.six:
        return np.eye(6).reshape(2, 3, 6)[target]
    tool = cell.tool.points - cell.tool.points.mean(axis=0)
    return linear.motions(np.einsum("rij,rj->ri", axes, tool[target]))


def _in_poses(zeros: Zeros, q: Mapping[int, Array], cell: Cell) -> Zeros:
    """Differences of whole poses in place of those of targets, where all targets were read.

    Their covariance is the mean of those of the targets; see `measured.in_poses`.
    """
    t = len(cell.tool.points)
    order = np.lexsort((zeros.target, zeros.which, zeros.pose))
    order = order[np.isin(zeros.pose[order], list(q))]
    key = np.column_stack([zeros.pose, zeros.which])[order]
    _, number, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    order = order[(count == t)[number.ravel()]]
    first = order[::t]
    if not len(first):
        return Zeros.none()
    here = configure(cell.robot, np.array([q[p] for p in zeros.pose[first].tolist()]))
    delta = cell.tool.coordinates(here, zeros.delta[order].reshape(-1, t, 3))
    cov = zeros.cov[order].reshape(-1, t, 3, 3).mean(axis=1)
    return Zeros(
        pose=np.repeat(zeros.pose[first], 2),
        target=np.tile([0, 1], len(first)),
        which=np.repeat(zeros.which[first], 2),
        delta=delta.reshape(-1, 3),
        cov=np.repeat(cov, 2, axis=0),
    )


def _repeats(data: Measured) -> tuple[Ints, Array]:
    """Group pulls that repeat each other, and scale each to the force of the first of its group.

    Repeats agree in pose, kind of load, force, point of action and branch. Where the branch is
    unknown, the previous pull and the last pull of a different force must agree too: friction
    depends on the direction of approach, and the chain may have been released between two pulls.

    Returns:
        Number of each pull's group, and force of the group's first over its own, both (m,).
    """
    pulls = data.pulls
    order = np.lexsort((pulls.repeat, pulls.time, pulls.pose))
    pose, force, branch = pulls.pose[order], pulls.force[order], pulls.branch[order]
    like = _like(_loaded_alike(pulls)[order], force, _SAME_DIRECTION)
    before = np.where(branch[:, None] == 0, _before(pose, like), -1)
    key = np.column_stack([like, branch.astype(np.int64), before])
    _, first, number = np.unique(key, axis=0, return_index=True, return_inverse=True)
    size = np.linalg.norm(force, axis=1)
    group, to_first = np.empty(len(order), dtype=np.int64), np.empty(len(order))
    group[order], to_first[order] = number.ravel(), size[first][number.ravel()] / size
    return group, to_first


def _loaded_alike(pulls: Pulls) -> Ints:
    """Number shared by pulls of one pose with one kind of load at one point, shape (m,)."""
    key = np.column_stack([pulls.pose, pulls.by, np.nan_to_num(pulls.acts_at)])
    return np.asarray(np.unique(key, axis=0, return_inverse=True)[1].ravel(), dtype=np.int64)


def _like(pose: Ints, force: Array, angle: float) -> Ints:
    """Index of the first pull of the same pose with a force similar to this angle [rad], (m,)."""
    like = np.full(len(pose), -1, dtype=np.int64)
    while (free := np.flatnonzero(like < 0)).size:
        _, first, which = np.unique(pose[free], return_index=True, return_inverse=True)
        leader = free[first][which]
        size = np.linalg.norm(force[leader], axis=1)
        along = np.einsum("mi,mi->m", force[free], force[leader]) / size
        across = np.sqrt(np.maximum(np.sum(force[free] ** 2, axis=1) - along**2, 0.0))
        near = np.abs(along / size - 1) <= _SAME_FORCE
        near = (near & (across <= angle * size)) | (free == leader)
        like[free[near]] = leader[near]
    return like


def _before(pose: Ints, like: Ints) -> Ints:
    """`like` of the previous pull and of the last different one, -1 where there is none, (m, 2)."""
    place = np.arange(len(pose))
    new = np.ones(len(pose), dtype=bool)
    new[1:] = (pose[1:] != pose[:-1]) | (like[1:] != like[:-1])
    last = np.column_stack([place, np.flatnonzero(new)[np.cumsum(new) - 1]]) - 1
    return np.where((last >= 0) & (pose[last] == pose[:, None]), like[last], -1)


def _contrasts(group: Ints, modes: Array) -> scipy.sparse.csc_array:
    """Orthonormal columns orthogonal to the modes of each group, shape (rows, contrasts)."""
    order = np.argsort(group, kind="stable")
    ends = np.flatnonzero(np.diff(group[order])) + 1
    blocks, at = [], []
    for rows in np.split(order, ends):
        blocks.append(linear.complement(modes[rows]))
        at.append(rows)
    K = scipy.sparse.block_diag(blocks, format="csr")
    back = np.empty(len(group), dtype=np.int64)
    back[np.concatenate(at)] = np.arange(len(group))
    return scipy.sparse.csc_array(K[back])
