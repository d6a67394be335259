"""Identification of a robot from a campaign of absolute positions, step by step.

Nominal table, then its DH parameters, then springs under the arm's own weight, then laws outside
the catalogue: each step with its error at left-out poses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy import special
from scipy.spatial.transform import Rotation

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings
from pipeline.base.bootstrap import interval
from pipeline.geometry.arm_weight import usual
from pipeline.machine.effects._anatomy import rail
from pipeline.machine.robot import Robot
from pipeline.machine.robot.weight import weighs
from pipeline.positions import law_tests, left_out, outliers
from pipeline.positions.calibrate import Calibration, ModelStructure, likeliest, tried
from pipeline.positions.catalogue_causes import (
    OTHER_MASSES,
    CatalogueCause,
    CatalogueLaw,
    listed,
    renewed,
    weight,
)
from pipeline.positions.cross_validation import (
    LeftOutGain,
    LeftOutPoses,
    Partition,
    distances,
    partings,
)
from pipeline.positions.gross_errors import TableMistake, corrected
from pipeline.positions.initial import begin
from pipeline.positions.joint_laws import LawSearchData, NamedLaw, NamedModel, with_laws
from pipeline.positions.mechanism import ArmWeights, Mechanism, layout, linearised
from pipeline.positions.readings import PositionReadings
from pipeline.positions.scatter import start
from pipeline.positions.yielding import balanced, other_forms, yielding
from pipeline.system import alarms

_ROUNDS = 10
"""Maximum number of estimates in the search for outliers."""

_MOST_OFF = 0.5
"""Maximum fraction of outliers among the readings [1]; beyond it the search ends."""

_GROSS = 20.0
"""Multiple of the median residual of the nominal table beyond which a reading is left out before
any estimate [1]."""


class MovedSince(NamedTuple):
    """Motion of the robot's base, or of a target on the effector, from a pose of a series on.

    Attributes:
        series: Name of the series.
        pose: Number of the pose.
        target: Name of the target; empty if the base moved in the frame of the instrument.
        p: Probability that chance yields such a motion.
        motion: Translation [m] and rotation [rad] in F_b, or in the frame of the target, (6,).
        std: Their standard uncertainties.
    """

    series: str
    pose: int
    target: str
    p: float
    motion: Array = np.zeros(6)
    std: Array = np.zeros(6)

    @property
    def shift_m(self) -> float:
        """Length of the translation [m]."""
        return float(np.linalg.norm(self.motion[:3]))

    @property
    def turn_rad(self) -> float:
        """Angle of the rotation [rad]."""
        return float(np.linalg.norm(self.motion[3:]))


class BadReading(NamedTuple):
    """A reading that was left out: file and line, series, pose, target, deviation and p-value."""

    file: str
    line: int
    off_m: float
    series: str = ""
    pose: int = 0
    target: str = ""
    p: float = 0.0


class ModelStage(StrEnum):
    """Stages of the model, each in addition to tool and frames."""

    TABLE = "nominal table"
    LETTERS = "geometric parameters"
    SPRINGS = "springs under the arm's weight"
    CATALOGUE = "causes of the catalogue"
    LAWS = "laws"


@dataclass(frozen=True, eq=False)
class StageResult(Locked):
    """A model and its errors at left-out poses.

    Attributes:
        step: Stage of the model.
        found: The estimate.
        errors: Errors of positions for each partition [m], NaN where not read, each (m, t).
    """

    step: ModelStage
    found: Calibration
    errors: dict[Partition, Array]

    def mean(self, parting: Partition, mine: Bools | slice = slice(None)) -> float:
        """Mean error [m] over some poses."""
        return float(np.nanmean(self.errors[parting][mine]))


@dataclass(frozen=True, eq=False)
class Study(Locked):
    """Result of a campaign of positions.

    Attributes:
        stages: From the nominal table to the complete model.
        laws: Laws outside the catalogue, the largest gain first.
        bad: Readings that were left out.
        moved: Moves of the instrument or of targets; readings since form a series, or are of a
            target, of their own.
        causes: Causes of the catalogue, the largest gain first.
        mistakes: Gross errors of the robot file, corrected in all other results.
        every: All readings, including those left out.
    """

    stages: tuple[StageResult, ...]
    laws: tuple[NamedLaw, ...]
    bad: tuple[BadReading, ...]
    moved: tuple[MovedSince, ...] = ()
    causes: tuple[CatalogueCause, ...] = ()
    mistakes: tuple[TableMistake, ...] = ()
    every: LawSearchData | None = None

    @property
    def final(self) -> Calibration:
        """The complete estimate."""
        return self.stages[-1].found

    def ending(self, found: Calibration) -> Study:
        """The study with another estimate of the complete model."""
        stages = (*self.stages[:-1], replace(self.stages[-1], found=found))
        return replace(self, stages=stages, causes=renewed(self.causes, found))


def study(
    robot: Robot,
    readings: PositionReadings,
    weights: ArmWeights,
    tool: dict[str, Array],
    sigma_m: float | None,
    stated: tuple[float, float],
    rng: np.random.Generator,
) -> Study:
    """Identify a robot from absolute positions.

    Args:
        robot: Robot as delivered.
        readings: All series.
        weights: Gravity and payloads on the arm.
        tool: Nominal points of targets, flange frame [m], where known.
        sigma_m: Noise of a coordinate [m], None where it is not stated.
        stated: Roughness of lengths [m] and angles [rad] in the robot file, NaN where not stated.
        rng: Source of copies and intervals.
    """
    robot, mistakes = corrected(robot, readings, weights, tool)
    every = LawSearchData(readings, weights, stated, start(robot, sigma_m))
    begun = begin(robot, readings, tool)
    gross = _gross(every, begun)
    data = every.without(gross)
    base, names = _base(data, begun)
    other = _otherwise(data, base, rng)
    base = other.found if other else base
    every, data, base, (frames, points), since = _apart(every, data, base, rng)
    begun = _framed(begun, frames, points)
    data, base, late = _without_blunders(every, data, base, gross[:, points])
    parts = partings(data.readings, rng, rail(robot))
    whole = with_laws(data, base, names, parts, rng)
    if balanced(robot) and not other:  # where a balancer hides what the links weigh
        base, whole, other = _searched_otherwise(data, base, whole, names, parts, rng)
    before = data
    # curves reveal outliers that springs leave hidden
    data, found, late = _without_blunders(every, data, whole.found, late.which)
    if data is not before:
        whole, parts = replace(whole, found=found), partings(data.readings, rng, rail(robot))
    steps = *_steps(data, begun, base, names), (ModelStage.LAWS, whole.found)
    stages = tuple(
        StageResult(step, found, {k: distances(found, part) for k, part in parts.items()})
        for step, found in steps
    )
    bad = tuple(_listed(every.readings, late))
    moved = tuple(_moves(whole.found, since))
    weighed = other if weighs(robot) else _weigh(stages[1].found, stages[2].found, rng)
    form = OTHER_MASSES if other else ""
    sag = weighed.causes(whole.found, form) if weighed else ()
    return Study(stages, whole.laws, bad, moved, (*sag, *whole.causes), mistakes, every)


class _Weighed(NamedTuple):
    """A model with estimated link masses, its p-value and its gains."""

    found: Calibration
    p: float
    gains: tuple[LeftOutGain, LeftOutGain]

    def causes(self, found: Calibration, form: str) -> tuple[CatalogueCause, ...]:
        """The weight as a cause, with the amounts of the complete model; none if none is known."""
        one = weight(found)
        near, far = self.gains
        known = replace(one, form=form or one.form, p=self.p, gain=near, carried=far)
        return (known,) if known.amounts else ()


def _weigh(before: Calibration, after: Calibration, rng: np.random.Generator) -> _Weighed | None:
    """Compare a model with estimated link masses with the one before; None if it is not better.

    It is better if the likelihood ratio is significant and held-out poses are certainly predicted
    better.
    """
    p = float(np.exp(min(before.likely - after.likely, 0.0)))
    refuted = _of_masses(before)
    if after is before or min(p, refuted) >= alarms.SUSPECT:
        return None
    parts = partings(after.readings, rng, rail(after.mechanism.table))
    last = Partition.SERIES if Partition.SERIES in parts else Partition.SPACE
    near, far = (_gain(before, after, parts[one], rng) for one in (Partition.BETWEEN, last))
    sure = near.sure and far.sure
    return _Weighed(after, min(p, refuted), (near, far)) if sure or refuted < p else None


def _of_masses(found: Calibration) -> float:
    """Probability of masses as far from the stated ones as estimated, if these hold to their sigma.

    T = sum over v of (v' z)^2 / (1 - c_v) ~ chi2, z their deviations over the stated sigma, v and
    c_v the axes of their posterior covariance in these units; axes of which the readings tell less
    than a twentieth are left out.
    """
    at = layout(found.mechanism).moments
    if found.wanted.moments or not found.solution.x[at].size:
        return 1.0
    mean, std = found.known.mean[at], found.known.std[at]
    values, axes = linear.directions(found.solution.cov[at, at] / np.outer(std, std))
    told = values < 1 - _TOLD
    z = axes[:, told].T @ ((found.solution.x[at] - mean) / std)
    return (
        float(special.chdtrc(int(told.sum()), np.sum(z**2 / (1 - values[told]))))
        if told.any()
        else 1.0
    )


_TOLD = 0.05
"""Least part of a prior variance that readings take away where they tell of a mass [1]."""


def _gain(
    before: Calibration, after: Calibration, part: Ints, rng: np.random.Generator
) -> LeftOutGain:
    """Reduction of the error of a coordinate of held-out targets, from their distances."""
    off = [distances(found, part) for found in (before, after)]
    seen = np.isfinite(off[0])
    block = np.broadcast_to(law_tests.blocks(after.readings)[:, None], seen.shape)[seen]
    one, two = (distance[seen] for distance in off)
    before_m, after_m = (linear.rms(distance) / np.sqrt(3.0) for distance in (one, two))
    return LeftOutGain(before_m, after_m, interval(one, two, block, rng)[1])


def _heavy(data: LawSearchData, robot: Robot) -> bool:
    return bool(weighs(robot) or data.weights.any or data.weights.gravity.any())


def _base(data: LawSearchData, begun: Mechanism) -> tuple[Calibration, tuple[CatalogueLaw, ...]]:
    """Estimate with DH parameters, springs and all laws of the catalogue, and these laws."""
    robot = begun.table
    heavy = _heavy(data, robot)
    moments = heavy and not weighs(robot)
    tried = replace(begun, moments=usual(robot)[0]) if moments else begun
    tau = linearised(data.readings, tried, data.weights).inputs.tau
    names = listed(robot, data.readings.q, tau)
    yields = yielding(robot, tau) if heavy else ()
    wanted = ModelStructure(springs=heavy, yields=yields, moments=moments, bed=rail(robot),
                            laws=tuple(one.law for one in names))  # fmt: skip
    table = data.identify(begun, ModelStructure(springs=False))
    # scales return once it is known whether masses are estimated: these take what curves do
    table = replace(table, known=replace(table.known, returning=moments))
    found = data.identify(table.mechanism, wanted, table)
    best = _formed(found)
    now = found if best == found.wanted else data.identify(found.mechanism, best, found)
    return now, names


def _formed(found: Calibration) -> ModelStructure:
    """The structure with the likeliest form of each gear law that the readings show."""
    wanted, known = found.wanted, None
    there, tau = found.mechanism, found.linear.inputs.tau
    x, std = found.solution.x, np.sqrt(np.diag(found.solution.cov))
    at = layout(there).yields.start
    for k, one in enumerate(there.elements):
        if np.abs(x[at] / std[at]) > _SHOWN:
            others = [
                replace(wanted, yields=(*wanted.yields[:k], other, *wanted.yields[k + 1 :]))
                for other in other_forms(there.table, tau, one)
            ]
            best, known = likeliest(found, [wanted, *others], known)
            wanted = best.wanted if best else wanted
        at += len(one.parameters)
    return wanted


_SHOWN = 2.0
"""Estimate of a gear law over its standard uncertainty from which on its form is chosen by the
readings [1]."""


def _otherwise(
    data: LawSearchData, found: Calibration, rng: np.random.Generator
) -> _Weighed | None:
    """Estimate with link masses other than in the robot file, if it is certainly better.

    One linearisation shows whether it may be; another weight of the arm acts at all its poses.
    """
    other = replace(found.wanted, moments=True)
    if not weighs(found.mechanism.table) or not _weigh(found, tried(found, other), rng):
        return None
    return _weigh(found, data.identify(found.mechanism, other, found), rng)


def _searched_otherwise(
    data: LawSearchData,
    base: Calibration,
    whole: NamedModel,
    names: tuple[CatalogueLaw, ...],
    parts: dict[Partition, Ints],
    rng: np.random.Generator,
) -> tuple[Calibration, NamedModel, _Weighed | None]:
    """Base, laws, and link masses other than in the robot file; each at the end of its search."""
    trial = _otherwise(data, whole.found, rng)
    if trial is None:
        return base, whole, None
    wanted = replace(base.wanted, moments=True)
    begun = data.identify(trial.found.mechanism, wanted, trial.found)
    again = with_laws(data, begun, names, parts, rng)
    other = _weigh(whole.found, again.found, rng)
    return (begun, again, other) if other else (base, whole, None)


def _steps(
    data: LawSearchData, begun: Mechanism, base: Calibration, names: Sequence[CatalogueLaw]
) -> Iterator[tuple[ModelStage, Calibration]]:
    """Stages before the laws; `base` has all of the catalogue, and waves that any gear may have."""
    plain = list(_plain(data, begun))
    yield from zip((ModelStage.TABLE, ModelStage.LETTERS, ModelStage.SPRINGS), plain, strict=True)
    wanted = replace(base.wanted, laws=tuple(one.law for one in names if one.name))
    if wanted != plain[-1].wanted:
        yield ModelStage.CATALOGUE, data.identify(base.mechanism, wanted, base)


def _plain(data: LawSearchData, begun: Mechanism) -> Iterator[Calibration]:
    """Nominal table, DH parameters, and springs in addition, for comparison."""
    robot = begun.table
    yield (first := data.identify(begun, ModelStructure(False, False)))
    yield (table := data.identify(first.mechanism, ModelStructure(springs=False)))
    heavy = _heavy(data, robot)
    yield (
        data.identify(table.mechanism, ModelStructure(moments=not weighs(robot)), table)
        if heavy
        else table
    )


# --- the instrument -------------------------------------------------------------------------------


def _apart(
    every: LawSearchData, data: LawSearchData, found: Calibration, rng: np.random.Generator
) -> tuple[LawSearchData, LawSearchData, Calibration, tuple[Ints, Ints], dict[str, MovedSince]]:
    """Split series wherever the instrument moved, and targets wherever they did.

    Rail, joints and time are in the estimate already and compete; a move is accepted only if
    held-out stations or joint angles are then certainly predicted better.

    Returns:
        All readings, the readings in use, the estimate from these, the original index of each
            series and of each target, and the moves by the names of new series and targets.
    """
    was, on_rail = data.readings, rail(found.mechanism.table)
    of = np.arange(len(was.names)), np.arange(len(was.targets))
    since: dict[str, MovedSince] = {}
    for _ in range(law_tests.MOST_MOVES):
        here = data.readings
        moved = law_tests.move(found, law_tests.flips(here, rng, rail=on_rail))
        if moved is None:
            break
        then = replace(data, readings=here.apart(moved.pose, moved.targets))
        # frames and points of new series and targets are those of the original ones at first
        frames = _origins(here.names, then.readings.names)
        points = _origins(here.targets, then.readings.targets)
        trial = then.again(replace(found, mechanism=_framed(found.mechanism, frames, points)))
        if not LeftOutPoses(partings(here, rng, on_rail), rng).better(trial, found):
            break
        file, line = here.file[moved.pose], here.line[moved.pose]
        first = int(np.argmax((every.readings.file == file) & (every.readings.line == line)))
        every = replace(every, readings=every.readings.apart(first, moved.targets))
        of = of[0][frames], of[1][points]
        at = str(here.names[here.series[moved.pose]]), int(here.pose[moved.pose])
        on = zip(then.readings.targets, was.targets[of[1]], strict=True)
        for name, target in (*((name, "") for name in then.readings.names), *on):
            if name not in here.names and name not in here.targets:
                since[str(name)] = MovedSince(*at, str(target), moved.p)
        data, found = then, trial
    return every, data, found, of, since


def _origins(before: Strings, after: Strings) -> Ints:
    """Index before a move of each name after it, (k,); a new one follows the one that it was."""
    return np.asarray(np.cumsum(np.isin(after, before)) - 1)


def _framed(mechanism: Mechanism, frames: Ints, tool: Ints) -> Mechanism:
    return replace(mechanism, frames=mechanism.frames[frames], tool=mechanism.tool[tool])


def _moves(found: Calibration, since: dict[str, MovedSince]) -> Iterator[MovedSince]:
    """Motions of the robot's base in the frame of the instrument, and of targets."""
    readings, there, where = found.readings, found.mechanism, layout(found.mechanism)
    for name, one in since.items():
        names, frames, start = (
            (readings.targets, there.tool, where.tool.start)
            if one.target
            else (readings.names, there.frames, where.frames.start)
        )
        k = names.tolist().index(name)
        was, now = frames[k - 1, :3], frames[k, :3]
        shift = was[:, :3].T @ (now[:, 3] - was[:, 3])
        turn = Rotation.from_matrix(was[:, :3].T @ now[:, :3]).as_rotvec()
        both = np.eye(len(found.cov))[start + 6 * k + np.r_[3:6, :3]]
        both -= np.roll(both, -6, axis=1)
        std = np.sqrt(np.diag(both @ found.cov @ both.T))
        yield one._replace(motion=np.append(shift, turn), std=std)


# --- blunders -------------------------------------------------------------------------------------


def _gross(data: LawSearchData, begun: Mechanism) -> Bools:
    """Readings far off the nominal robot, relative to the median residual, (m, t)."""
    rows = linearised(data.readings, begun, data.weights)
    off = left_out.distances(rows.y, rows.read)
    return np.asarray(off > _GROSS * np.nanmedian(off))


def _without_blunders(
    every: LawSearchData, data: LawSearchData, found: Calibration, held: Bools
) -> tuple[LawSearchData, Calibration, outliers.Outliers]:
    """The data without outliers, the estimate from them, and the outliers.

    Args:
        every: All readings.
        data: The readings that the estimate is from.
        found: The estimate.
        held: Readings that are left out already, shape (m, t).
    """
    off = outliers.find_outliers(found, every.readings, every.weights, held)
    for _ in range(_ROUNDS):
        if np.array_equal(off.which, held) or off.which.sum() > _MOST_OFF * off.which.size:
            break
        held = off.which
        data = every.without(held)
        found = data.again(found)
        off = outliers.find_outliers(found, every.readings, every.weights, held)
    return data, found, off._replace(which=held)


def _listed(readings: PositionReadings, off: outliers.Outliers) -> Iterator[BadReading]:
    """Readings that are left out, with their distance from the model [m]."""
    for m, t in np.argwhere(off.which).tolist():
        yield BadReading(
            file=str(readings.file[m]),
            line=int(readings.line[m]),
            off_m=float(off.size_m[m, t]),
            series=str(readings.names[readings.series[m]]),
            pose=int(readings.pose[m]),
            target=str(readings.targets[t]),
            p=float(off.p[m, t]),
        )
