"""Single readings that contradict all others: Baarda's w-test, reading by reading.

A reading is shifted by an unknown vector [m] in F_b: a suspect of three columns in addition to the
model (see `system.score_tests`; Baarda, A Testing Procedure for Use in Geodetic Networks, 1968, for
three coordinates). A pose that is read as one has six, and is one reading of its state. A p-value
is multiplied by the number of readings (Bonferroni). Where the model fits, the scatter is estimated
from the residuals, at least as stated. The model is that of the joint springs; where these do not
fit even without the outliers, a free stiffness of every pose, so that nothing the robot does in
proportion to the pull passes for a bad reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy import special

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.quantities import plain
from pipeline.faults.assignment import lines
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake, apart, left_out, length, lines_of, of_group, outlying
from pipeline.machine import instrument
from pipeline.machine.six import radius
from pipeline.reduction.bring import Reduced
from pipeline.reduction.case import Case
from pipeline.reduction.measured import Measured
from pipeline.reduction.register import XYZ
from pipeline.system import odds
from pipeline.system.blocks import Blocks
from pipeline.system.contrasts import Stack, Zeros, own_columns, stacked, ways
from pipeline.system.score_tests import Base, ScoreTests
from pipeline.system.simultaneous import ActiveSuspects, Suspects, active_suspects, cost, sizes
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import Whitener, whitener

_SMALLEST_M = 8e-5
"""Minimum error of a reading that is reported [m]."""

_NOTHING = 1e-30
"""Lower limit of a variance, below which it is rounding [1]."""

_TOO_FEW = 16.0
"""Minimum expected sum of squares that can confirm or refute a shift [1]."""

_CONFIRMS = 0.25
"""Minimum fraction of the expected sum of squares that must be found [1]; chance leaves less in 1
of 100."""

_PAPER_TAIL = 4.9
"""Minimum shift in standard deviations with the noise of Eq. (18) [1], which scatters along one
direction: a shift counts by its length, whatever its direction."""


@dataclass(frozen=True, eq=False)
class TargetReadings(Locked):
    """Every reading of the measured targets, or of the effector's pose, poses ascending.

    Attributes:
        pose: Pose of each reading, shape (n,).
        target: Index of its target, 0 for a pose, shape (n,).
        pull: Index of its pull; -1 for zeros, shape (n,).
        nth: Index of the zero in its pose, by time; 0 for loaded readings, shape (n,).
        of: Number of zeros of its target in its pose, shape (n,).
    """

    pose: Ints
    target: Ints
    pull: Ints
    nth: Ints
    of: Ints


@dataclass(frozen=True, eq=False)
class Shifted(Locked):
    """A campaign's readings, and the effect of a shift of each on the rows.

    Attributes:
        stack: Rows of c, and repeated zeros.
        white: Its whitener.
        readings: Every reading.
        blocks: Readings by pose.
        D: Whitened columns of each reading [1/m], shape (poses, rows, readings, 3), 6 for a pose.
    """

    stack: Stack
    white: Whitener
    readings: TargetReadings
    blocks: Blocks
    D: Array

    def beside(self, base: Base) -> ScoreTests:
        """The best shift of every reading [m], given a base."""
        return base.beside(self.D).rows(self.blocks)

    def springs(self, system: System, more: Array | None = None) -> Base:
        """Base with springs, causes and common errors, and further columns (R, k) [1]."""
        B = np.zeros((len(self.stack.c), system.B.shape[1]))
        B[: len(system.B)] = system.B * system.typical
        return self.white.base(B if more is None else np.hstack([B, more]), self.stack.c)

    def poses_free(self, data: Measured) -> Base:
        """Base with six rigid motions in proportion to the pull, for each way of each pose."""
        size = np.linalg.norm(data.pulls.force, axis=1)
        return self._free(ways(data.pulls), size / size.max())

    def pulls_free(self, data: Measured) -> Base:
        """Base with any rigid motion of the effector in each pull."""
        return self._free(Blocks.of(data.pulls.pose).place, np.ones(len(data.pulls.pose)))

    def _free(self, number: Ints, share: Array) -> Base:
        """Base with a share of six rigid motions for the pulls of each number in each pose."""
        number, share = (np.append(one, 0)[self.stack.pull] for one in (number, share))
        columns = own_columns(self.stack.modes * share[:, None], number)
        return self.white.own_base(columns, self.stack.c)

    def told(
        self, held: ActiveSuspects, suspects: Suspects, free: tuple[Base, Base], seen: bool
    ) -> list[bool]:
        """Whether each reading in `held` is more than a sign of a weak model.

        With free poses and with free pulls its shift must be found again.

        Args:
            held: Readings that are off together.
            suspects: All readings.
            free: Bases with a free stiffness of each pose, and with free motions of each pull.
            seen: Whether the base with free pulls must be able to see it.
        """
        out = []
        for place, k in enumerate(held.which.tolist()):
            rest, shift = held.which[held.which != k], held.size[place]
            found = [suspects.beside(one, rest)[1] for one in free]
            sure = confirmed(found[0], k, shift, held.variance)
            sure &= confirmed(found[1], k, shift, held.variance, seen)
            out.append(bool(sure))
        return out

    def held(self, base: Base, suspects: Suspects, least: float) -> ActiveSuspects:
        """Readings that are off together, given the motion of every state that moved as a whole.

        Outliers of one pull, or of one zero, may be a motion of the effector as one body; the
        readings are then tested again with this motion in the base. Sizes are those with the model
        alone, as the motion may be part of the shift. A pose that is read as one is such a motion
        itself.
        """
        first, held = base, active_suspects(base, suspects, least)
        if self.D.shape[3] > 3:
            return held
        for _ in range(int(self.stack.pull.max(initial=0)) + 1):
            whole = self._moved_as_a_whole(held, base, suspects)
            if not whole:
                break
            base = base.more(np.hstack([self._rigid(base, k) for k in sorted(whole)]))
            held = active_suspects(base, suspects, least)
        return replace(held, size=sizes(first, suspects, held.which))

    def _moved_as_a_whole(self, held: ActiveSuspects, base: Base, suspects: Suspects) -> set[int]:
        """A reading of each pull, or zero, in which a motion of the whole effector is likelier."""
        pose, out = self.readings.pose, set[int]()
        for one in np.unique(pose[held.which]):
            mine = held.which[pose[held.which] == one]
            others = np.setdiff1d(held.which, mine)
            beside = base.more(suspects.rows(base, others)) if len(others) else base
            states = np.column_stack([self.readings.pull, self.readings.nth])[mine]
            first = mine[np.unique(states, axis=0, return_index=True)[1]]
            moved = [self._rigid(beside, k) for k in first]
            every = beside.beside_all(np.hstack([*moved, suspects.rows(beside, mine)]))
            at = np.arange(6 * len(first) + 3 * len(mine))
            rigid, own = at[: 6 * len(first)].reshape(-1, 6), at[6 * len(first) :].reshape(-1, 3)
            gains = [_as_one(every, mode, own, held.variance) for mode in rigid]
            if max(gains) > 0:
                out.add(int(first[int(np.argmax(gains))]))
        return out

    def _rigid(self, base: Base, k: int) -> Array:
        """Six motions of the effector in the pull of a reading, or in all pulls from its zero."""
        one, stack = self.readings, self.stack
        share = shown(stack.pull, stack.which, one.pull[k], one.nth[k], one.of[k])
        share = np.where(stack.pose == one.pose[k], share, 0.0)
        rigid = self.white.by_pose(stack.modes * share[:, None])
        return np.vstack([rigid, np.zeros((len(base.blocks.index) - len(rigid), 6))])


def _as_one(every: ScoreTests, rigid: Ints, own: Ints, variance: float) -> float:
    """Advantage of a motion of the effector in one state over outlying readings.

    By twice the log likelihood with its priors, compared with all held readings of the pose as
    outliers; those that stand out in addition to the motion, the farthest first, remain outliers.

    Args:
        every: Motions of the states of a pose and its held readings, as one suspect.
        rigid: Columns of the motion, shape (6,).
        own: Columns of the readings, shape (n, 3).
        variance: Variance of the rows.
    """
    alone = float(every.parts(own.reshape(1, -1)).drop[0])
    each = float(cost(alone / len(own) / variance, 3))
    left, best = own, -np.inf
    while len(left):
        drop = float(every.parts(rigid[None]).drop[0])
        motion = float(cost(drop / variance, 6))
        best = max(best, (drop - alone) / variance - motion + len(left) * each)
        wider = np.array([np.append(rigid, one) for one in left])
        far = int(np.argmax(every.parts(wider).drop))
        rigid, left = wider[far], np.delete(left, far, axis=0)
    return best


def outliers(asked: Screening) -> list[Mistake]:
    """All readings that contradict the others, if chance does not explain them.

    They are tested with the model if that fits without them, else with a free stiffness of every
    pose. The scatter is the median of the residuals there, at least as stated: a certificate may be
    conservative, but chance must not create outliers. If a reading of another pose would explain as
    much, there are too few readings to name any of them.
    """
    case, reduced, system = asked.case, asked.reduced, asked.system
    shifted = shifted_readings(case, reduced, asked.zeros, system, asked.estimate)
    suspects = Suspects(shifted.D, shifted.blocks)
    free = shifted.poses_free(reduced.data), shifted.pulls_free(reduced.data)
    least = 1.0 if system.noise_stated else _NOTHING
    held = shifted.held(shifted.springs(system), suspects, least)
    fits = _fits(held, suspects.beside(free[1], held.which)[0], least)
    if not fits:
        held = shifted.held(free[0], suspects, least)
        fits = _fits(held, suspects.beside(free[1], held.which)[0], least)
    told = shifted.told(held, suspects, free, seen=not fits)
    p, size = held.p(), np.linalg.norm(held.size, axis=1)
    least_m = smallest(reduced.placed, float(np.sqrt(held.variance)))
    rivals, pose = suspects.rivals(held), shifted.readings.pose
    alone = [bool((pose[of] == pose[k]).all()) for k, of in zip(held.which, rivals, strict=True)]
    found = []
    for k in np.argsort(-held.drop, kind="stable"):
        if told[k] and alone[k] and size[k] > least_m:
            alike = [int(held.which[k]), *rivals[k].tolist()]
            row, *others = (_row(case, reduced, shifted.readings, j) for j in alike)
            known = float(np.sqrt(held.drop[k] / held.variance)), float(p[k]), others
            if asked.cell.tool.six:
                found.append(_bad_pose(case, row, held.size[k], *known))
            else:
                found.append(bad_reading(row, "all other readings", float(size[k]), *known))
    return found


def _fits(held: ActiveSuspects, pulls: Base, least: float) -> bool:
    """Whether a model leaves no more than the scatter that no motion of a pull explains."""
    if pulls.dof < 1 or held.base.dof < 1:
        return True
    scatter = max(pulls.rest / pulls.dof, least)
    left = held.base.rest / held.base.dof
    return bool(special.fdtrc(held.base.dof, pulls.dof, left / scatter) >= odds.FITS)


def shifted_readings(
    case: Case, reduced: Reduced, zeros: Zeros, system: System, estimate: Estimate
) -> Shifted:
    """Every reading as a suspect.

    Args:
        case: The campaign.
        reduced: Its measurements.
        zeros: Its repeated zeros.
        system: Its linear system.
        estimate: Solution of the model that readings are tested with.
    """
    stack = stacked(system, estimate.residual, reduced.data, zeros, case.cell)
    white = whitener(stack.errors, stack.pose)
    six = case.tool.six
    readings = _readings(stack, _zero_counts(reduced.placed, case.settings.measured), six)
    blocks = Blocks.of(readings.pose)
    return Shifted(stack, white, readings, blocks, _columns(stack, white, readings, blocks, six))


def confirmed(freer: ScoreTests, k: int, shift: Array, variance: float, seen: bool = False) -> bool:
    """Whether a freer model finds as much of the shift as it would of a true one.

    A weakness of the model can look like a bad reading; with free poses or pulls it vanishes. A
    true shift v drops T = v' N v there, N of the freer model; `_CONFIRMS` of it must be found.

    Args:
        freer: Every reading's shift with the freer model.
        k: Index of the reading.
        shift: Its shift [m].
        variance: Variance of the readings over the stated one.
        seen: Whether the freer model must be able to see it; if it cannot, nothing is confirmed.
    """
    expected = float(shift @ freer.N[k] @ shift) / variance
    if expected < _TOO_FEW:
        return not seen
    return float(freer.drop[k]) / variance > _CONFIRMS * expected


def smallest(readings: pd.DataFrame, scale: float) -> float:
    """The smallest shift that is reported [m]."""
    paper = (readings["covariance_from"] == "paper").any()
    return _PAPER_TAIL * instrument.PAPER_SIGMA_M * scale if paper else _SMALLEST_M


def _zero_counts(placed: pd.DataFrame, measured: list[str]) -> dict[tuple[int, int], int]:
    rows = placed[(placed["state"] == "unloaded") & placed["target"].isin(measured)]
    at = pd.Index(measured).get_indexer(pd.Index(rows["target"]))
    keys, number = np.unique(
        np.column_stack([rows["pose"].to_numpy(int), at]), axis=0, return_counts=True
    )
    return {(int(pose), int(t)): int(n) for (pose, t), n in zip(keys, number, strict=True)}


def _readings(stack: Stack, counts: dict[tuple[int, int], int], six: bool) -> TargetReadings:
    """The readings that the rows of a stack are made of."""
    rows = np.column_stack([stack.pose, np.where(six, 0, stack.target), stack.pull])
    there = sorted({(int(pose), int(t)) for pose, t, _ in rows})
    zeros = [(*one, -1, nth, counts[one]) for one in there for nth in range(counts.get(one, 0))]
    loaded = {(int(p), int(t), int(i), 0, counts.get((int(p), int(t)), 0)) for p, t, i in rows}
    every = [*zeros, *(one for one in loaded if one[2] >= 0)]
    return TargetReadings(*np.array(sorted(every), dtype=np.int64).reshape(-1, 5).T)


def _columns(
    stack: Stack, white: Whitener, readings: TargetReadings, blocks: Blocks, six: bool
) -> Array:
    """Effect of a unit shift of each reading on the rows of its pose, whitened."""
    target, axis = (
        (0 * stack.target, 3 * stack.target + stack.axis) if six else (stack.target, stack.axis)
    )
    row_target, row_pull, which, axis = (
        white.blocks.padded(part)[:, :, None] for part in (target, stack.pull, stack.which, axis)
    )
    target, pull, nth, of = (
        blocks.padded(part)[:, None, :]
        for part in (readings.target, readings.pull, readings.nth, readings.of)
    )
    there = white.blocks.there[:, :, None] & blocks.there[:, None, :]
    moved = shown(row_pull, which, pull, nth, of) * (there & (row_target == target))
    D = moved[..., None] * np.eye(6 if six else 3)[axis]
    return np.asarray(np.einsum("pab,pbni->pani", white.inverse, D, optimize=True))


def shown(row_pull: Ints, which: Ints, pull: Ints | int, nth: Ints | int, of: Ints | int) -> Array:
    """Part of the shift of a reading that a row of its target in its pose shows.

    A loaded reading moves its own row by one; zero n of N moves every loaded row by -1/N, its own
    difference to the mean of those before by one, and those after it by -1/k, with k their index.

    Args:
        row_pull: Pull of each row, -1 for a repeated zero.
        which: Number of the difference of zeros of each row.
        pull: Pull of the reading, -1 for a zero.
        nth: Number n of the zero.
        of: Number N of zeros.
    """
    later = np.where(which > nth, -1.0 / np.maximum(which, 1), 0.0)
    zero = np.where(row_pull < 0, np.where(which == nth, 1.0, later), -1.0 / np.maximum(of, 1))
    return np.where(pull >= 0, row_pull == pull, zero)


def bad_reading(
    row: pd.Series,
    others: str,
    size: float,
    sigmas: float,
    p: float | None = None,
    rivals: Sequence[pd.Series] = (),
) -> Mistake:
    """The mistake of a single reading that contradicts others.

    Args:
        row: The reading.
        others: What it contradicts, for the sentence.
        size: Its error [m].
        sigmas: The same in standard deviations.
        p: Probability by chance that any reading is off as far; a sum, which may exceed 1. None
            where chance plays no part.
        rivals: Readings that may be wrong instead.
    """
    rows = pd.DataFrame([row, *rivals])
    names = (rows["group"].astype(str) + "/" + rows["target"].astype(str)).tolist()
    at = lines_of(rows)
    each = [f"{name} ({place})" for name, place in zip(names, at, strict=True)]
    one = f"the reading {each[0]}" if len(rows) == 1 else f"one of {', '.join(each)}"
    return _off(names, one, length(size), others, sigmas, size=size, p_value=p, at=at)


def _off(
    names: Sequence[str], told: str, far: str, others: str, sigmas: float, **known: Any
) -> Mistake:
    """The mistake of the first of some readings, or of one of them if nothing tells which.

    Args:
        names: Their names.
        told: Which of them is meant, in words.
        far: How far off it is, with the unit.
        others: What it contradicts.
        sigmas: How far off in standard deviations.
        known: As in `Mistake`.
    """
    doubt = "" if len(names) == 1 else ", and nothing tells which of them it is"
    return outlying(
        names[0],
        f"{told} is {far} off from where {others} put it, {apart(sigmas)}{doubt}",
        f"recomputed without {' and '.join(names)}",
        before=sigmas,
        correct=partial(left_out, at=known["at"]),
        instead=tuple(names[1:]),
        **known,
    )


def _bad_pose(
    case: Case, row: pd.Series, size: Array, sigmas: float, p: float, rivals: Sequence[pd.Series]
) -> Mistake:
    """The mistake of a pose that was read as one, of size s and L w [m], as of `bad_reading`."""
    groups = [str(one["group"]) for one in (row, *rivals)]
    at = tuple(
        dict.fromkeys(line for g in groups for line in of_group(case, g, case.settings.measured))
    )
    turned = float(np.linalg.norm(size[3:])) / radius(case.tool.points)
    one = f"the pose {groups[0]}" if not rivals else f"one of the poses {', '.join(groups)}"
    far = f"{length(float(np.linalg.norm(size[:3])))} and {plain(1e3 * turned, 3)} mrad"
    known = {"size": float(np.linalg.norm(size)), "p_value": p, "at": at, "axes": 6}
    return _off(groups, f"{one} ({lines(at)})", far, "all other readings", sigmas, **known)


def lock_lost(found: Mistake, case: Case) -> Mistake:
    """The mistake, with a note if (0, 0, 0) was recorded, as by a tracker without a lock."""
    if not found.of_reading:
        return found
    rows, (group, _, target) = case.readings, found.where.rpartition("/")
    here = rows[(rows["group"] == group) & (rows["target"] == target)]
    if not len(here) or here[list(XYZ)].to_numpy(float).any():
        return found
    return replace(
        found, evidence=f"{found.evidence}: it was recorded as (0, 0, 0), as after a lost lock"
    )


def _row(case: Case, reduced: Reduced, readings: TargetReadings, best: int) -> pd.Series:
    """The reading in table PLACED."""
    placed, data = reduced.placed, reduced.data
    name = case.settings.measured[readings.target[best]]
    rows = placed[(placed["pose"] == readings.pose[best]) & (placed["target"] == name)]
    if readings.pull[best] >= 0:
        repeat = data.pulls.repeat[readings.pull[best]]
        return rows[(rows["state"] == "loaded") & (rows["repeat"] == repeat)].iloc[0]
    rows = rows[rows["state"] == "unloaded"].sort_values("time", kind="stable")
    return rows.iloc[readings.nth[best]]


FAULT = Fault("outlier", outliers)
