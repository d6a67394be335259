"""Reliability of the readings, with name and line of each, and influence of each pull.

The effect of an error is given on quantities of interest: the stiffnesses (to first order their
compliances), the sizes of the causes, and the deflection at the test pose.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.annex.redundancy import (
    Reliability,
    Solution,
    influence,
    of_base,
    reliability,
    solution,
)
from pipeline.answer.contract import LEAST_CONTROLLED, Carried, Controlled
from pipeline.answer.recommended import ModelValues
from pipeline.answer.results import ReadingControl
from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings, compared
from pipeline.machine.cell import Cell, jacobian
from pipeline.machine.effect import Effect, Pulls
from pipeline.reduction.case import Case
from pipeline.reduction.measured import Measured
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.system.assemble import by_inputs
from pipeline.system.fit import Fitted
from pipeline.system.system import System

_AXES = np.array(["x", "y", "z"], dtype=object)

_NONE = 1e-7
"""Ratio to the largest error of the same source up to which an error is rounding [1], such as that
of a chain's direction along itself: variances have sixteen digits, their roots eight."""


@dataclass(frozen=True, eq=False)
class _QuantitiesOfInterest(Locked):
    """Linear quantities of interest a' x of a model.

    Attributes:
        name: Names such as `k_theta2`, `dl_x`, `P1 dz`, shape (q,).
        of: Coefficients a, shape (q, k); the k parameters themselves come first.
        stated: Whether each is a stiffness or a deflection, and not a parameter of a cause, shape
            (q,).
    """

    name: Strings
    of: Array
    stated: Bools


def _asked(cell: Cell, values: Array, where: PoseOfInterest) -> _QuantitiesOfInterest:
    """Quantities of interest: springs, causes and the deflection at the test pose.

    Args:
        cell: Model of joint springs and causes.
        values: Values of its parameters, shape (k,).
        where: The test pose.
    """
    flat, n, k = replace(cell, equilibrium="undeformed"), cell.robot.n, len(values)
    A = jacobian(flat, Pulls.at(where.q, where.force), values).reshape(-1, k)
    names = [f"k_{joint.name}" for joint in cell.robot.joints]
    names += [parameter.name for parameter in cell.parameters[n:]]
    names += [f"{target} d{axis}" for target in cell.tool.read for axis in "xyz"]
    number = np.arange(len(names))
    return _QuantitiesOfInterest(
        np.array(names, dtype=object), np.vstack([np.eye(k), A]), (number < n) | (number >= k)
    )


def control(values: ModelValues, where: PoseOfInterest) -> ReadingControl:
    """Control of the readings in the first hypothesis of a model."""
    first, fitted = values.first, values.fitted
    system, x = first.system, first.estimate.value
    about = _asked(first.cell, x, where)
    at = solution(system, about.of, first.ratio)
    force, turn = by_inputs(replace(first.cell, equilibrium="undeformed"), fitted.data, x)
    inputs = _Inputs.of(system, fitted.data, force, turn)
    named = inputs.table(system, _names(fitted.case, fitted.reduced.placed))
    table = pd.DataFrame(named | _told(reliability(system, at), inputs.size, about))
    parts = [table[inputs.kept], *_base(fitted, at, turn, about)]
    readings, pulls = pd.concat(parts, ignore_index=True), _influence(system, at, about)
    return ReadingControl(
        readings, pulls, controlled_entries(readings), carried_entries(pulls, values)
    )


def _influence(system: System, at: Solution, about: _QuantitiesOfInterest) -> pd.DataFrame:
    """Table INFLUENCE: effect of every pull on every determined parameter."""
    k, rows = len(system.parameters), system.rows
    known = np.flatnonzero(np.isfinite(at.std[:k]))
    first = np.unique(rows.pull, return_index=True)[1]
    return pd.DataFrame(
        {
            "pose": np.repeat(rows.pose[first], len(known)),
            "repeat": np.repeat(rows.repeat[first], len(known)),
            "what": np.tile(about.name[known], len(first)),
            "moves_sigmas": influence(system, at)[:, known].ravel(),
        }
    )


def _told(
    found: Reliability, size: Array, about: _QuantitiesOfInterest
) -> dict[str, Array | Strings]:
    """Columns of RELIABILITY with the results; `size` is u of each error in its unit, (E,)."""
    moves = found.moves[:, about.stated]
    most = np.argmax(compared(moves), axis=1)
    return {
        "r": found.r,
        "w": found.w,
        "smallest_visible": np.multiply(
            found.visible, size, out=found.visible.copy(), where=size > 0
        ),
        "moves_sigmas": moves[np.arange(len(most)), most],
        "moves_most": about.name[about.stated][most],
    }


def _base(
    fitted: Fitted, at: Solution, turn: Array, about: _QuantitiesOfInterest
) -> Iterator[pd.DataFrame]:
    """Rows of RELIABILITY for the readings of the base reflectors."""
    registration = fitted.reduced.registration
    rows = registration.table
    if not len(rows):
        return
    begin = 0
    for base in of_base(registration, at, turn, fitted.data.rotation_cov):
        size = np.linalg.norm(base.error, axis=1)
        mine = rows.iloc[begin : (begin := begin + len(size) // 3)]
        named = mine["group"].astype(str) + "/" + mine["target"].astype(str)
        yield pd.DataFrame(
            {
                "source": "base",
                "reading": np.repeat(named.to_numpy(object), 3),
                "file": np.repeat(mine["file"].astype(str).to_numpy(object), 3),
                "line": np.repeat(mine["line"].to_numpy(), 3),
                "axis": _nearest(base.error),
                "unit": "m",
                **_told(base.each, size, about),
            }
        )


@dataclass(frozen=True, eq=False)
class _Inputs(Locked):
    """The input of which each column of G is an error.

    Attributes:
        source: Source of error, shape (E,).
        first: First row that the error affects, shape (E,).
        size: Standard uncertainty of the error in `unit`, shape (E,).
        unit: `m`, `rad`, `N`, or `1` for relative errors and standard uncertainties, shape (E,).
        along: Vector of the error in F_b; zero where it has no direction, shape (E, 3).
    """

    source: Strings
    first: Ints
    size: Array
    unit: Strings
    along: Array

    @classmethod
    def of(cls, system: System, data: Measured, force: Array, turn: Array) -> _Inputs:
        """Find by least squares the input error v that causes each column g: S v = g, S = dc/dv.

        Args:
            system: Rows and errors.
            data: The measurements from which they were assembled.
            force: dc/df, shape (M, 3) [m/N].
            turn: dc/dw for a rotation w of the tracker, shape (M, 3) [m/rad].
        """
        G, source = system.errors.G.tocoo(), system.errors.source
        E, f = len(source), data.pulls.force[data.pull].repeat(3, axis=0)
        newtons = np.linalg.norm(f, axis=1, keepdims=True)
        read = np.tile(np.eye(3), (len(data.pull), 1))
        along_chain = np.sum(force * f, axis=1, keepdims=True)
        inputs = {
            "tracker": ("m", read),
            "zero": ("m", read),
            "direction": ("rad", force * newtons),
            "force_reading": ("N", along_chain / newtons),
            "force_zero": ("N", along_chain / newtons),
            "force_gain": ("1", along_chain),
            "registration": ("rad", turn),
        }
        first = np.full(E, len(system.rows), dtype=np.int64)
        np.minimum.at(first, G.col, G.row)
        size, along = (first < len(system.rows)).astype(float), np.zeros((E, 3))
        unit = np.full(E, "1", dtype=object)
        for name, (in_unit, S) in inputs.items():
            mine = source == name
            v = _made_of(G.row, G.col, G.data, S, E)[mine]
            size[mine], unit[mine] = np.linalg.norm(v, axis=1), in_unit
            if v.shape[1] == 3:
                along[mine] = v
        return cls(source, first, size, unit, along)

    @property
    def kept(self) -> Bools:
        """Whether each error is more than rounding, shape (E,)."""
        names, which = np.unique(self.source.astype(str), return_inverse=True)
        largest = np.zeros(len(names))
        np.maximum.at(largest, which, self.size)
        return np.asarray(self.size > _NONE * largest[which])

    def table(self, system: System, names: _Names) -> dict[str, Any]:
        """Columns of RELIABILITY that identify each error.

        Args:
            system: The system, for its rows.
            names: Names of the readings.
        """
        rows, at = system.rows, np.minimum(self.first, len(system.rows) - 1)
        each = zip(self.source, rows.pose[at], rows.repeat[at], rows.target[at], strict=True)
        reading, file, line = zip(*(_named(names, *one) for one in each), strict=True)
        return {
            "source": self.source,
            "reading": reading,
            "file": file,
            "line": line,
            "axis": _nearest(self.along),
            "unit": self.unit,
        }


_Names = Mapping[tuple[str, int, int, str], tuple[str, str, int]]
"""Name, file and line of each reading by source, pose, repeat (0 for a zero) and target."""


def _named(
    names: _Names, source: str, pose: int, repeat: int, target: str
) -> tuple[str | None, str | None, int | None]:
    """Name, file and line of the reading of an error; None if it is not of a single reading."""
    if source in ("force_reading", "direction"):
        target = ""
    elif source not in ("tracker", "zero"):
        return None, None, None
    known = names.get((source, pose, 0 if source == "zero" else repeat, target))
    plain = f"pose {pose} repeat {repeat}{target and '/'}{target}"
    return known or (plain, None, None)


def _made_of(row: Ints, column: Ints, value: Array, S: Array, count: int) -> Array:
    """Least-squares solutions v of S v = g for sparse columns g.

    Args:
        row: Rows of the entries of all columns g.
        column: Columns of the entries.
        value: Values of the entries.
        S: Sensitivities, shape (M, i).
        count: Number of columns.

    Returns:
        Solutions, shape (count, i).
    """
    i = S.shape[1]
    N, h = np.empty((count, i, i)), np.empty((count, i))
    for a in range(i):
        h[:, a] = np.bincount(column, S[row, a] * value, count)
        for b in range(i):
            N[:, a, b] = np.bincount(column, S[row, a] * S[row, b], count)
    return np.asarray(np.einsum("eij,ej->ei", linear.inverse(N), h))


def _nearest(along: Array) -> Strings:
    """Axis of F_b nearest to each direction, or None for a zero vector, shape (E,)."""
    axis = _AXES[np.argmax(compared(np.abs(along)), axis=1)]
    axis[~along.any(axis=1)] = None
    return axis


def _names(case: Case, placed: pd.DataFrame) -> _Names:
    """Names, files and lines of the readings of a campaign.

    The zeros of a target in a pose count as one reading, with the line of the first; the direction
    of a chain has the line of its first end, or of the log that names the anchor it goes to.
    """
    ends, loads = case.settings.naming.chain, case.loads
    logs = set(loads["file"])
    out: dict[tuple[str, int, int, str], tuple[str, str, int]] = {}
    zeros: dict[tuple[str, int, int, str], list[str]] = {}
    columns = ("pose", "repeat", "target", "state", "group", "file", "line")
    for pose, repeat, target, state, group, file, line in zip(
        *(placed[name].tolist() for name in columns), strict=True
    ):
        if target in ends:
            if state == "loaded":
                name = f"{group}/{'direction to its anchor' if file in logs else '-'.join(ends)}"
                out.setdefault(("direction", pose, repeat, ""), (name, file, line))
        elif state == "loaded":
            out["tracker", pose, repeat, target] = f"{group}/{target}", file, line
        else:
            key = "zero", pose, 0, target
            groups = zeros.setdefault(key, [])
            groups.append(group)
            first = out.setdefault(key, ("", file, line))
            out[key] = f"{', '.join(groups)}/{target}", *first[1:]
    for pose, repeat, file, line in zip(
        *(loads[name].tolist() for name in ("pose", "repeat", "file", "line")), strict=True
    ):
        out["force_reading", pose, repeat, ""] = f"{file} pose{pose:02d} rep{repeat}", file, line
    return out


def controlled_entries(control: pd.DataFrame) -> tuple[Controlled, ...]:
    """`reliability`: the errors with the lowest redundancy r in table RELIABILITY."""
    least = control.sort_values("r", key=compared, kind="stable", na_position="last")[
        :LEAST_CONTROLLED
    ]
    return tuple(Controlled(**_plain(row)) for row in least.to_dict("records"))


def _plain(row: Mapping[Hashable, Any]) -> dict[str, Any]:
    """A row with None for empty cells."""
    cells = {str(name): None if pd.isna(cell) else cell for name, cell in row.items()}
    return cells | {"line": None if cells["line"] is None else int(cells["line"])}


def carried_entries(carried: pd.DataFrame, values: ModelValues) -> tuple[Carried, ...]:
    """`influence`: the pull with the largest effect on each stiffness and on each cause."""
    of = {one.name: effect for effect in values.first.effects for one in effect.parameters}
    key = [of[what].label if what in of else what for what in carried["what"]]
    size = pd.Series(compared(carried["moves_sigmas"]), carried.index)
    most = carried.loc[size.groupby(key, sort=False).idxmax()]
    return tuple(_carried(row, of.get(row["what"])) for row in most.to_dict("records"))


def _carried(row: Mapping[Hashable, Any], effect: Effect | None) -> Carried:
    name, where = (effect.name, effect.where) if effect else (None, None)
    return Carried(name=name, where=where, **{str(key): cell for key, cell in row.items()})
