"""Worth of a part of a model: the reduction of the error at left-out poses."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.bootstrap import interval
from pipeline.positions import law_tests, left_out
from pipeline.positions.calibrate import Calibration
from pipeline.positions.left_out import LeftOut
from pipeline.positions.mechanism import frame_of
from pipeline.positions.readings import PositionReadings


class Partition(StrEnum):
    """How the poses are partitioned for cross-validation."""

    BETWEEN = "every tenth pose"
    SPACE = "a tenth of joint space"
    STATION = "a tenth of the stations"
    SERIES = "one series"


@dataclass(frozen=True, eq=False)
class LeftOutGain(Locked):
    """Error of left-out positions with and without a part of the model.

    Attributes:
        before: Rms error of a coordinate without it [m].
        after: Rms error of a coordinate with it [m].
        ci95: 95 % confidence interval of 1 - after / before [1].
    """

    before: float
    after: float
    ci95: tuple[float, float]

    @property
    def reduction(self) -> float:
        """1 - after / before."""
        return 1 - self.after / self.before if self.before > 0 else 0.0

    @property
    def sure(self) -> bool:
        """Whether the error certainly falls."""
        return self.ci95[0] > 0


NO_GAIN = LeftOutGain(0.0, 0.0, (0.0, 0.0))
"""Gain where none was computed."""


def partings(
    readings: PositionReadings, rng: np.random.Generator, rail: bool
) -> dict[Partition, Ints]:
    """Part of each pose, (m,), per partition; stations and series where there are several."""
    out = {
        Partition.BETWEEN: left_out.by_turns(readings),
        Partition.SPACE: left_out.by_space(readings, rng),
    }
    if rail and len(np.unique(stops := law_tests.stations(readings))) >= left_out.PARTS:
        out[Partition.STATION] = stops % left_out.PARTS
    if len(np.unique(readings.series)) > 1:
        out[Partition.SERIES] = readings.series
    return out


def distances(found: Calibration, part: Ints) -> Array:
    """Distance of each target from its prediction without the part of its pose [m], (m, t).

    Each series is first fitted to its readings as a rigid body: the position of the instrument is
    not part of the robot, and a wrong table would predict it wrongly.
    """
    errors = left_out.errors(found, part)
    off = errors.copy()
    position = np.tile(np.arange(6) < 3, errors.shape[1] // 6)
    for series in range(len(found.readings.names)):
        frame = frame_of(found.mechanism, series)
        seen = found.readings.read & position & (found.readings.series == series)[:, None]
        K = found.linear.D[..., frame][seen]
        if len(K) > K.shape[1]:
            off[seen] = errors[seen] - K @ linear.least_squares(K, errors[seen])
    return left_out.distances(off, found.readings.read)


class LeftOutPoses:
    """Worth of parameters at left-out poses."""

    def __init__(self, parts: dict[Partition, Ints], rng: np.random.Generator) -> None:
        self._parts = parts
        self._rng = rng
        self._made: tuple[Calibration | None, dict[Partition, tuple[LeftOut, Array]]] = (None, {})
        self._beside: tuple[Calibration | None, dict[Partition, Array]] = (None, {})

    def _far(self, once: bool = False) -> Partition:
        """Whole series, which what happened once cannot predict, or parts of joint space.

        At left-out stations the unknown rail hides what a joint does.
        """
        series = Partition.SERIES in self._parts and not once
        return Partition.SERIES if series else Partition.SPACE

    def gains(
        self, found: Calibration, part: slice | Ints, once: bool = False
    ) -> tuple[LeftOutGain, LeftOutGain]:
        """Gains at every tenth pose left out, and at left-out series or parts of joint space.

        Args:
            found: The estimate.
            part: Indices of the parameters.
            once: Whether they describe something that happened once, which other series cannot
                predict.
        """
        near, far = (self._gain(found, one, part) for one in (Partition.BETWEEN, self._far(once)))
        return near, far

    def carries(
        self, found: Calibration, part: slice, before: Calibration, once: bool = False
    ) -> bool:
        """Whether both errors certainly fall, each over its standard uncertainty.

        In metres, a few poses that the others hardly determine would decide alone. The uncertainty
        is that of the estimate before, which many trials share, and of the parameters.
        """
        ways = Partition.BETWEEN, self._far(once)
        return all(self._gain(found, one, part, before).sure for one in ways)

    def as_good(self, one: Calibration, other: Calibration) -> bool:
        """Whether the first predicts held-out poses as well as the second, within chance.

        Errors count over their standard uncertainty, of which both estimates have a part.
        """
        parts = [(found, LeftOut(found, self._parts[self._far()])) for found in (other, one)]
        std = np.hypot(*(_positions(found, part.std) for found, part in parts))
        before, after = (_positions(found, part.errors()) for found, part in parts)
        return self._compared(one.readings, before, after, std).ci95[1] >= 0

    def better(self, one: Calibration, other: Calibration) -> bool:
        """Whether the first certainly predicts held-out stations or parts of joint space better."""
        at = Partition.STATION if Partition.STATION in self._parts else Partition.SPACE
        found = other, one
        errors = (_positions(each, left_out.errors(each, self._parts[at])) for each in found)
        return self._compared(one.readings, *errors).ci95[0] > 0

    def _gain(
        self,
        found: Calibration,
        parting: Partition,
        without: slice | Ints,
        beside: Calibration | None = None,
    ) -> LeftOutGain:
        if self._made[0] is not found:
            self._made = found, {}
        known = self._made[1]
        if parting not in known:
            parts = LeftOut(found, self._parts[parting])
            known[parting] = parts, _positions(found, parts.errors())
        parts, with_it = known[parting]
        std = None
        if beside is not None:
            var = self._var(beside, parting) + _positions(found, parts.var_by(without))
            std = np.sqrt(var)
        before = _positions(found, parts.errors(without))
        return self._compared(found.readings, before, with_it, std)

    def _var(self, found: Calibration, parting: Partition) -> Array:
        """Variance of left-out positions about an estimate that several are compared with, (k,)."""
        if self._beside[0] is not found:
            self._beside = found, {}
        known = self._beside[1]
        if parting not in known:
            known[parting] = _positions(found, LeftOut(found, self._parts[parting]).std) ** 2
        return known[parting]

    def _compared(
        self, readings: PositionReadings, before: Array, after: Array, std: Array | None = None
    ) -> LeftOutGain:
        """Gain from errors of left-out positions (k,).

        The interval is that of errors over `std` where it is given.
        """
        seen = _shifts(readings)
        block = np.broadcast_to(law_tests.blocks(readings)[:, None], seen.shape)[seen]
        size = np.ones(len(before)) if std is None else std
        _, ci95 = interval(before / size, after / size, block, self._rng)
        return LeftOutGain(linear.rms(before), linear.rms(after), ci95)


def _shifts(readings: PositionReadings) -> Bools:
    return readings.read & np.tile(np.arange(6) < 3, len(readings.targets))


def _positions(found: Calibration, errors: Array) -> Array:
    """The part of errors (m, 6 t) that is of positions, pose by pose, (k,)."""
    return np.asarray(errors[_shifts(found.readings)])
