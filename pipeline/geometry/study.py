"""A campaign of absolute positions from readings to what is identified, step by step.

Table as delivered, then its letters, then springs under the arm's own weight, then laws that nobody
listed: each step with what it is worth at poses that were left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.base.arrays import Array, Bools, Locked
from pipeline.geometry import blunders, leftout, search
from pipeline.geometry.begin import begin
from pipeline.geometry.identify import Identified, Wanted
from pipeline.geometry.mechanism import Mechanism, Weights, linearised
from pipeline.geometry.named import Data, NamedLaw, with_laws
from pipeline.geometry.readings import Readings
from pipeline.geometry.scatter import start
from pipeline.geometry.worth import Parting, distances, partings
from pipeline.machine.robot import Robot
from pipeline.machine.robot.weight import weighs

_ROUNDS = 10
"""Estimates without the readings that are off; each but the last changes which these are."""

_MOST_OFF = 0.5
"""Part of the readings that may be off [1]; beyond it nothing is the rule."""

_GROSS = 20.0
"""Residuals of the nominal table beyond so many medians are blunders before any estimate."""


class Moved(NamedTuple):
    """From which pose of a series on the instrument stood elsewhere, how far, and by what chance.

    Shift and turn are those of the robot's base in its frame.
    """

    series: str
    pose: int
    shift_m: float
    turn_rad: float
    p: float


class Bad(NamedTuple):
    """A reading that was left out: of which pose and target, how far off, and by what chance."""

    file: str
    line: int
    off_m: float
    series: str = ""
    pose: int = 0
    target: str = ""
    p: float = 0.0


class Step(StrEnum):
    """What a model holds beside tool and frames."""

    TABLE = "nominal table"
    LETTERS = "geometric parameters"
    SPRINGS = "springs under the arm's weight"
    LAWS = "laws"


@dataclass(frozen=True, eq=False)
class Stage(Locked):
    """A model and what it misses at left-out poses.

    Attributes:
        step: Which.
        found: The estimate.
        errors: Of positions by what is left out [m], NaN where not read, each (m, t).
    """

    step: Step
    found: Identified
    errors: dict[Parting, Array]

    def mean(self, parting: Parting, mine: Bools | slice = slice(None)) -> float:
        """Mean distance [m] over some poses."""
        return float(np.nanmean(self.errors[parting][mine]))


@dataclass(frozen=True, eq=False)
class Study(Locked):
    """All of it.

    Attributes:
        stages: From the nominal table to the whole model.
        laws: Named, the largest first.
        bad: Readings that were left out, with their distance from the model [m].
        moved: When the instrument moved; what was read afterwards is a series of its own.
        every: All readings, those included.
    """

    stages: tuple[Stage, ...]
    laws: tuple[NamedLaw, ...]
    bad: tuple[Bad, ...]
    moved: tuple[Moved, ...] = ()
    every: Data | None = None

    @property
    def final(self) -> Identified:
        """The whole model."""
        return self.stages[-1].found


def study(
    robot: Robot,
    readings: Readings,
    weights: Weights,
    tool: dict[str, Array],
    sigma_m: float | None,
    stated: tuple[float, float],
    rng: np.random.Generator,
) -> Study:
    """Identify a robot from absolute positions.

    Args:
        robot: As delivered.
        readings: All series.
        weights: What pulls at the arm.
        tool: Nominal points of targets, flange frame [m], where they are known.
        sigma_m: Noise of a coordinate, None where it is not stated.
        stated: Roughness of lengths [m] and angles [rad] in the robot file, NaN where not stated.
        rng: Draws copies and intervals.
    """
    every = Data(readings, weights, stated, start(robot, sigma_m))
    begun = begin(robot, readings, tool)
    gross = _gross(every, begun)
    data = every.without(gross)
    nominal = data.identify(begun, Wanted(False, False))
    table = data.identify(nominal.mechanism, Wanted(springs=False))
    springs = table
    if weighs(robot) or weights.any:
        springs = data.identify(table.mechanism, Wanted(), table)
    every, of, chances = _apart(every, data, springs, rng)
    if chances:
        data = every.without(gross)
        nominal, table, springs = (
            data.again(_with_frames(one, of)) for one in (nominal, table, springs)
        )
    data, springs, late = _without_blunders(every, data, springs, gross)
    if not np.array_equal(late.which, gross):
        nominal, table = data.again(nominal), data.again(table)
    parts = partings(data.readings, rng)
    whole = with_laws(data, springs, parts, rng)
    before = data
    # curves show what springs hide
    data, found, late = _without_blunders(every, data, whole.found, late.which)
    if data is not before:
        nominal, table, springs = (data.again(one) for one in (nominal, table, springs))
        whole, parts = replace(whole, found=found), partings(data.readings, rng)
    steps = ((Step.TABLE, nominal), (Step.LETTERS, table), (Step.SPRINGS, springs),
             (Step.LAWS, whole.found))  # fmt: skip
    stages = tuple(
        Stage(step, found, {k: distances(found, part) for k, part in parts.items()})
        for step, found in steps
    )
    bad = tuple(_listed(every.readings, late))
    return Study(stages, whole.laws, bad, tuple(_moves(whole.found, chances)), every)


# --- the instrument -------------------------------------------------------------------------------


def _apart(
    every: Data, data: Data, found: Identified, rng: np.random.Generator
) -> tuple[Data, list[int], dict[str, float]]:
    """All readings with another series wherever the instrument moved, by some of them.

    Returns:
        All readings, what series each of them was before, and by what chance each began, by name.
    """
    of = list(range(len(data.readings.names)))
    chances: dict[str, float] = {}
    for _ in range(_MOST_MOVES):
        moved = search.moved(found, search.flips(data.readings, rng))
        if moved is None:
            break
        first = _place(every.readings, data.readings, moved.pose)
        data = replace(data, readings=data.readings.apart(moved.pose))
        every = replace(every, readings=every.readings.apart(first))
        new = int(data.readings.series[moved.pose])
        of.insert(new, of[new - 1])
        chances[str(data.readings.names[new])] = moved.p
        found = data.again(_with_frames(found, np.insert(np.arange(len(of) - 1), new, new - 1)))
    return every, of, chances


def _place(every: Readings, some: Readings, pose: int) -> int:
    """Which of all poses one of some is."""
    same = (every.file == some.file[pose]) & (every.line == some.line[pose])
    return int(np.argmax(same))


_MOST_MOVES = 8
"""An instrument that moves more often wanders."""


def _with_frames(found: Identified, of: Sequence[int] | Array) -> Identified:
    """The estimate with a frame for every series, that of the series that it was before."""
    mechanism = replace(found.mechanism, frames=found.mechanism.frames[list(of)])
    return replace(found, mechanism=mechanism)


def _moves(found: Identified, chances: dict[str, float]) -> Iterator[Moved]:
    """How far the robot's base is from where the instrument saw it before."""
    readings, frames = found.readings, found.mechanism.frames
    for name, p in chances.items():
        k = readings.names.tolist().index(name)
        first = int(np.flatnonzero(readings.series == k)[0])
        shift = frames[k, :3, 3] - frames[k - 1, :3, 3]
        turn = Rotation.from_matrix(frames[k - 1, :3, :3].T @ frames[k, :3, :3]).magnitude()
        yield Moved(
            str(readings.names[k - 1]),
            int(readings.pose[first]),
            float(np.linalg.norm(shift)),
            float(turn),
            p,
        )


# --- blunders -------------------------------------------------------------------------------------


def _gross(data: Data, begun: Mechanism) -> Bools:
    """Readings that stand metres from a nominal robot whose others stand millimetres, (m, t)."""
    rows = linearised(data.readings, begun, data.weights)
    off = leftout.distances(rows.y, rows.read)
    return np.asarray(off > _GROSS * np.nanmedian(off))


def _without_blunders(
    every: Data, data: Data, found: Identified, held: Bools
) -> tuple[Data, Identified, blunders.Off]:
    """What is left without the readings that are off, the estimate from it, and these.

    Args:
        every: All readings.
        data: Those of them that the estimate is from.
        found: The estimate.
        held: Readings that are out already, shape (m, t).
    """
    off = blunders.off(found, every.readings, every.weights, held)
    for _ in range(_ROUNDS):
        if np.array_equal(off.which, held) or off.which.sum() > _MOST_OFF * off.which.size:
            break
        held = off.which
        data = every.without(held)
        found = data.again(found)
        off = blunders.off(found, every.readings, every.weights, held)
    return data, found, off._replace(which=held)


def _listed(readings: Readings, off: blunders.Off) -> Iterator[Bad]:
    """Readings that are left out, with their distance from the model [m]."""
    for m, t in np.argwhere(off.which).tolist():
        yield Bad(
            file=str(readings.file[m]),
            line=int(readings.line[m]),
            off_m=float(off.size_m[m, t]),
            series=str(readings.names[readings.series[m]]),
            pose=int(readings.pose[m]),
            target=str(readings.targets[t]),
            p=float(off.p[m, t]),
        )
