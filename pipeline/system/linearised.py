"""One campaign linearised at one model, in metres, before any weighting."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.machine.cell import Cell, jacobian, load, predict, sensitivity
from pipeline.machine.effect import Effect, Loaded
from pipeline.machine.robot.configuration import rotation_about, velocity
from pipeline.reduction.measured import Measured
from pipeline.system.assemble import assemble
from pipeline.system.system import Errors, RowIndex, System


@dataclass(frozen=True, eq=False)
class CurrentModel:
    """The current model: a cell with accepted causes, and the values of all its parameters.

    Attributes:
        cell: Joint springs, then the accepted effects.
        values: Their parameters, shape (k,).
        springs: How many of the parameters are joint springs.
        accepted: Index of each accepted effect among the suspects.
    """

    cell: Cell
    values: Array
    springs: int
    accepted: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Linearised(Locked):
    """A campaign linearised at a model, in metres, before any weighting.

    Attributes:
        model: The model.
        data: The measurements.
        suspects: Causes that are tested.
        rows: Identity of each row.
        errors: Errors of c, as stated.
        B: Columns of the springs, shape (M, k).
        Z: Columns of the suspects, shape (M, K).
        y: c linearised at the model, shape (M,).
        motions: Rigid motions of the effector, shape (M, 6).
    """

    model: CurrentModel
    data: Measured
    suspects: tuple[Effect, ...]
    rows: RowIndex
    errors: Errors
    B: Array
    Z: Array
    y: Array
    motions: Array

    @property
    def system(self) -> System:
        """The springs alone as a linear system."""
        data, parameters = self.data, self.model.cell.parameters[: self.model.springs]
        return System(
            parameters, self.rows, self.B, self.y, self.errors, data.noise_stated, data.found_m
        )

    def beside(self, more: tuple[Effect, ...]) -> Linearised:
        """The same with further effects appended to the suspects."""
        if not more:
            return self
        flat = replace(self.model.cell, equilibrium="undeformed")
        at = (self.data.pull, self.data.target)
        columns = sensitivity(flat, self.data.pulls, self.model.values, more)[at]
        Z = np.concatenate([self.Z, columns.reshape(len(self.rows), -1)], axis=1)
        return replace(self, suspects=self.suspects + more, Z=Z)

    def bent(self, equilibrium: str) -> Linearised:
        """The same springs with another equilibrium: c is reduced by its second-order part."""
        cell = replace(self.model.cell, equilibrium=equilibrium)
        at = (self.data.pull, self.data.target)
        old, new = (
            predict(one, self.data.pulls, self.model.values).displacement[at].ravel()
            for one in (self.model.cell, cell)
        )
        return replace(self, model=replace(self.model, cell=cell), y=self.y + old - new)


def linearise(
    model: CurrentModel,
    data: Measured,
    suspects: tuple[Effect, ...],
    near: Linearised | None = None,
) -> Linearised:
    """Linearise springs and suspects at a model.

    y = delta - d(x0) + B x0 [m], d the model's displacements and B their derivative at its values
    x0, so that y = B x + Z z + G e to first order; rows in F_b, three to a displacement.

    Args:
        model: The model.
        data: The measurements.
        suspects: Causes to test.
        near: The campaign linearised at a model so close that its errors can be reused; they are
            computed anew when it is not given.
    """
    flat = replace(model.cell, equilibrium="undeformed")
    at = (data.pull, data.target)
    M = 3 * len(data.pull)
    if near is None:
        system = assemble(flat, data, model.values)
        B, rows, errors = system.B, system.rows, system.errors
        motions = _rigid(model.cell, load(model.cell, data.pulls, model.values))[at].reshape(M, 6)
    else:
        B = jacobian(flat, data.pulls, model.values)[at].reshape(M, -1)
        rows, errors, motions = near.rows, near.errors, near.motions
    accepted = dict(accepted_columns(model, suspects))
    if len(accepted) == len(owners(suspects)):
        Z = np.zeros((M, len(accepted)))
    else:
        Z = sensitivity(flat, data.pulls, model.values, suspects)[at].reshape(M, -1)
    for column, index in accepted.items():
        Z[:, column] = B[:, index]
    moved = predict(model.cell, data.pulls, model.values).displacement[at].ravel()
    return Linearised(
        model=model,
        data=data,
        suspects=suspects,
        rows=rows,
        errors=errors,
        B=B[:, : model.springs],
        Z=Z,
        y=data.delta.ravel() - moved + B @ model.values,
        motions=motions,
    )


def accepted_columns(model: CurrentModel, suspects: tuple[Effect, ...]) -> list[tuple[int, int]]:
    """Pairs: column among the suspects', index among the model's parameters."""
    ends = np.cumsum([0, *(len(effect.parameters) for effect in suspects)])
    pairs, index = [], model.springs
    for accepted in model.accepted:
        for column in range(ends[accepted], ends[accepted + 1]):
            pairs.append((int(column), index))
            index += 1
    return pairs


def owners(suspects: tuple[Effect, ...]) -> Ints:
    """Index of the suspect of each suspect column, shape (K,)."""
    return np.repeat(np.arange(len(suspects)), [len(effect.parameters) for effect in suspects])


def _rigid(cell: Cell, loaded: Loaded) -> Array:
    """Measured coordinates of six rigid motions of the effector, (m, t, 3, 6)."""
    m = len(loaded.pulls)
    centre = loaded.points.mean(axis=1)
    axes = [np.broadcast_to(row, (m, 3)) for row in np.eye(3)]
    turns = [rotation_about(np.zeros((m, 3)), axis) for axis in axes]
    around = velocity(np.stack(turns, axis=1), loaded.points - centre[:, None])
    along = np.broadcast_to(np.eye(3), (*loaded.points.shape, 3))
    moved = np.concatenate([along, np.moveaxis(around, 2, 3)], axis=-1)
    return cell.tool.coordinates(loaded.configuration, moved)
