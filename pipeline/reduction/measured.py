"""One campaign's measurements as arrays, in F_b, SI."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings
from pipeline.base.errors import InputError, listed
from pipeline.machine import six
from pipeline.machine.cell import Tool
from pipeline.machine.effect import MOUNTED, Pulls
from pipeline.machine.known_robot import KnownRobot
from pipeline.machine.robot import Robot, configure
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction._index import coded, found, numbered, places, pull_numbers
from pipeline.reduction.effector import tool
from pipeline.reduction.idle import Idle, idle
from pipeline.reduction.register import Registration
from pipeline.reduction.settings import Instrument, Scale, Settings
from pipeline.reduction.weights import PULL

STILL_M = 1e-6
"""Minimum repeatability of a point, or of a distance between two, for any instrument [m]: the
refractive index of air changes by 1e-6 per kelvin (Edlen, Metrologia 2, 1966), over a beam of
metres within one reading."""

_FORCE = ["fx_n", "fy_n", "fz_n"]
_AT = ["at_x_m", "at_y_m", "at_z_m"]
_DELTA = ["dx_m", "dy_m", "dz_m"]


@dataclass(frozen=True, eq=False)
class Measured(Locked):
    """One campaign's measurements as arrays, in F_b, SI: input of all systems.

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
        scale: Settings of the scale.
        body: Number of each pull's weight or payload, -1 where a chain pulls, shape (m,).
        mass_std: Standard uncertainty of its weight, one error for each body [N], shape (m,).
        center_std: Standard uncertainty of its centre per axis, flange frame, one error for each
            body [m], shape (m,).
        noise_stated: False if the covariances of readings are relative, 1 m^2 each, and with them
            those of zeros and directions.
        rotation_found: Whether `rotation_cov` rests on the scatter of the base reflectors.
        found_m: Factor by which the relative ones have been multiplied [m], None if by none.
        tracked: Whether the instrument is a laser tracker; else its noise is judged by the data
            alone.
        bends: Whether what an undeformed cell neglects, the robot's own deflection, is an error.
        tool_std: Standard uncertainty per axis of the nominal targets of the tool [m].
        load_point_std: The same of its load point [m], None if it is that of the targets.
        joint_std: Standard uncertainty of the joints' zeros [m] or [rad], shape (n,).
        zero_times: Times of the zeros of each pull's pose after the first reading [s], padded with
            NaN and NaN where unknown, shape (m, z).
        wander: F with F F' the covariance of the instrument's wander between the displacements of a
            pose [m], shape (d, 3, k); None where none is estimated.
        heavy: Probability that the tails are heavier than stated, for which readings are
            reweighted: their residuals are then smaller than their noise, but effects of a model
            are not.
        poses: Whether position and rotation of the effector were read, as targets 0 and 1.
        paper: Whether the stated noise is that of Eq. (18), whose variance is random.
        length_rel: Relative standard uncertainty of the instrument's lengths [1], from its
            certificate.
        day: Day of each pull, counted from 0, shape (m,); empty where no pose was repeated on
            another day.
        day_rel: Relative standard uncertainty of all displacements of a day [1], see `days`.
        idle: Unloaded readings of poses without a pull, of all poses if `poses`; None where there
            are none.
        tracker: Position of the tracker in F_b [m], shape (3,); None where unknown.
        stance: Estimates from absolute positions of the same robot; None without any.
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
    scale: Scale
    noise_stated: bool
    tool_std: float = 0.0
    load_point_std: float | None = None
    joint_std: Array = field(default_factory=lambda: np.zeros(0))
    body: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    mass_std: Array = field(default_factory=lambda: np.zeros(0))
    center_std: Array = field(default_factory=lambda: np.zeros(0))
    rotation_found: bool = False
    found_m: float | None = None
    bends: bool = False
    zero_times: Array = field(default_factory=lambda: np.zeros((0, 0)))
    wander: Array | None = None
    paper: bool = False
    heavy: float = 0.0
    poses: bool = False
    tracked: bool = True
    length_rel: float = 0.0
    day: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    day_rel: float = 0.0
    idle: Idle | None = None
    tracker: Array | None = None
    stance: KnownRobot | None = None

    def __post_init__(self) -> None:
        """Fill in that pulls without further data have no body."""
        if len(self.body) != len(self.pulls):
            nothing = np.zeros(len(self.pulls))
            object.__setattr__(self, "body", np.full(len(self.pulls), PULL))
            object.__setattr__(self, "mass_std", nothing)
            object.__setattr__(self, "center_std", nothing)
        super().__post_init__()

    @property
    def shifts(self) -> Bools:
        """Displacements that a shift of the instrument affects: all but rotations, shape (d,)."""
        return np.asarray(~(self.poses & (self.target == 1)))

    def standing(self, stance: KnownRobot | None, tool: Tool) -> Measured:
        """The same given absolute positions: unloaded points as by the corrected table alone.

        The motion of the unloaded points due to weight, laws of joints and a crooked rail is
        subtracted, and so is the pose in F_b of the instrument's frame of the positions, which
        their readings cannot determine.

        Args:
            stance: Estimates from the positions; None without any.
            tool: The effector with the points estimated there.
        """
        if stance is None:
            return self
        blocks = [(self.pulls.q[self.pull], self.target, self.unloaded)]
        if self.idle is not None:
            blocks.append((self.idle.pulls.q, self.idle.target, self.idle.at))
        q, target, at = (np.concatenate(part) for part in zip(*blocks, strict=True))
        if self.poses:  # displacements are position and rotation, not targets
            at[: len(self.target)], target = np.nan, target % len(tool.points)
        there = configure(stance.robot, q).points(tool.points)[np.arange(len(q)), target]
        off = stance.moved(q, tool.targets[target])
        at = _in_frame(at, there + off) - off
        unloaded, rest = np.split(at, [len(self.target)])
        alone = self.idle and replace(self.idle, at=rest)
        return replace(self, unloaded=unloaded, idle=alone, stance=stance)

    @property
    def tells_noise(self) -> bool:
        """Whether the scatter of the readings is known independently of the residuals."""
        return self.noise_stated or self.found_m is not None

    def enough(self, n: int) -> bool:
        """Whether there is any coordinate, or more than n if the noise is estimated from them."""
        return self.delta.size > (0 if self.tells_noise else n)

    def scaled(self, factor: float) -> Measured:
        """The same with the standard uncertainties of readings, zeros, directions multiplied."""
        return replace(
            self,
            loaded_cov=self.loaded_cov * factor**2,
            zero_cov=self.zero_cov * factor**2,
            direction_cov=self.direction_cov * factor**2,
            idle=self.idle and self.idle.scaled(factor),
        )

    def reweighed(self, loaded: Array, zero: Array) -> Measured:
        """The same with the covariances of each loaded reading and of its zero multiplied, (d,)."""
        return replace(
            self,
            loaded_cov=self.loaded_cov * loaded[:, None, None],
            zero_cov=self.zero_cov * zero[:, None, None],
        )

    def in_metres(self, found_m: float | None) -> Measured:
        """The same with a tracker noise [m] in place of the unstated one; None: unchanged."""
        if found_m is None:
            return self
        return replace(self.scaled(found_m / (self.found_m or 1.0)), found_m=found_m)


def _in_frame(at: Array, there: Array) -> Array:
    """Move points (n, 3) [m] as one body to where they should be, unless that is grossly far."""
    seen = np.isfinite(at).all(axis=1) & np.isfinite(there).all(axis=1)
    if seen.sum() < _FEWEST:
        return at
    R, t = linear.rigid(at[seen], there[seen])
    moved = at @ R.T + t
    return moved if np.linalg.norm(moved - at, axis=1)[seen].max() < GROSS_DISTANCE_M else at


_FEWEST = 12
"""Minimum number of points to fit a frame, those of four poses: fewer fit in any frame."""


def measured(
    settings: Settings,
    robot: Robot,
    registration: Registration,
    joints: pd.DataFrame,
    forces: pd.DataFrame,
    displacements: pd.DataFrame,
    placed: pd.DataFrame | None = None,
) -> Measured:
    """Join the tables of a campaign into arrays; rows without a partner are left out.

    Args:
        settings: Names of the tool's targets, and the uncertainties of scale, tool and joints.
        robot: The robot, for its joints.
        registration: Registration of the tracker, with its uncertainty.
        joints: Table of joint values, `tables.joints(robot)`.
        forces: Table FORCES.
        displacements: Table DISPLACEMENTS.
        placed: Table PLACED, for the times of the zeros and for poses without a pull; both are
            unknown without it.
    """
    targets, off = settings.measured, settings.joints
    pulls = forces.merge(joints, on="pose").sort_values(["pose", "repeat"], ignore_index=True)
    rows = displacements[displacements["target"].isin(targets)]
    pull = found(pull_numbers(pulls), pull_numbers(rows))
    target = places(rows["target"], targets)
    order = np.lexsort((target, pull))
    order = order[pull[order] >= 0]
    rows, pull, target = rows.iloc[order], pull[order], target[order]
    zero_time = rows.groupby(pull)["zero_time_s"].mean().reindex(range(len(pulls))).to_numpy()
    zero_times = _zero_times(placed, pulls["pose"].to_numpy())
    loaded_cov, zero_cov, stated = _covariances(rows)
    data = Measured(
        pulls=_pulls(settings, robot, pulls, zero_time, zero_times),
        pull=pull,
        target=target,
        name=rows["target"].to_numpy(object),
        delta=_side_by_side(rows, _DELTA),
        unloaded=_side_by_side(rows, ["zero_x_m", "zero_y_m", "zero_z_m"]),
        loaded_cov=loaded_cov,
        zero_cov=zero_cov,
        zero=_zeros(rows),
        reading_std=pulls["reading_std_n"].to_numpy(float),
        direction_cov=covariance.matrices(pulls, covariance.columns("u", "")),
        rotation_cov=registration.cov[:3, :3],
        scale=settings.scale or Scale(),
        noise_stated=stated,
        tool_std=settings.tool_uncertainty.sigma_m,
        load_point_std=settings.tool_uncertainty.load_point_sigma_m,
        joint_std=np.where(robot.prismatic, off.sigma_m, off.sigma_rad),
        body=pulls["body"].to_numpy(np.int64),
        mass_std=pulls["mass_std_n"].to_numpy(float),
        center_std=pulls["center_std_m"].to_numpy(float),
        rotation_found=registration.from_scatter,
        zero_times=zero_times,
        paper=placed is not None and bool((placed["covariance_from"] == "paper").any()),
        tracked=settings.instrument.kind == "laser_tracker",
        length_rel=settings.instrument.length_sigma_rel,
        tracker=registration.tracker if len(registration.table) else None,
    )
    effector = tool(settings)
    if placed is not None:
        pulled = np.unique(data.pulls.pose[data.pull])
        alone = idle(settings, robot, joints, placed, pulled[:0] if effector.six else pulled)
        data = replace(data, idle=alone if len(alone) else None)
    return _in_poses(data, robot, effector, settings.instrument) if effector.six else data


def _pulls(
    settings: Settings, robot: Robot, pulls: pd.DataFrame, zero_time: Array, zero_times: Array
) -> Pulls:
    """What loads the robot, and where it stands."""
    time = pulls["time_s"].to_numpy(float)
    later = np.sum(zero_times > time[:, None], axis=1)
    values = [tables.joint_column(j.name, j.prismatic) for j in robot.joints]
    return Pulls(
        pose=pulls["pose"].to_numpy(np.int64),
        repeat=pulls["repeat"].to_numpy(np.int64),
        q=_side_by_side(pulls, values),
        force=_side_by_side(pulls, _FORCE),
        branch=pulls["branch"].to_numpy(float),
        approach=pulls["approach"].to_numpy(float),
        time=time,
        time_zero=zero_time,
        by=pulls["by"].to_numpy(np.int64),
        acts_at=_side_by_side(pulls, _AT),
        body=_payloads(settings, pulls),
        zeros_after=later / np.maximum(np.isfinite(zero_times).sum(axis=1), 1),
    )


def _side_by_side(table: pd.DataFrame, names: Sequence[str]) -> Array:
    """Columns as numbers, (rows, names): as from `table[names]`, in a quarter of the time."""
    return np.array(covariance.numbers(table, names)).T


def _zeros(rows: pd.DataFrame) -> Ints:
    """Number of the zero of each row: one per target and pose, in order."""
    codes, words = coded(rows["target"])
    return np.unique(rows["pose"].to_numpy(np.int64) * len(words) + codes, return_inverse=True)[1]


def _payloads(settings: Settings, pulls: pd.DataFrame) -> Strings:
    """Name of the payload of each pull, empty where there is none, shape (m,)."""
    names = np.array([*settings.payload, ""], dtype=object)
    mounted = pulls["by"].to_numpy() == MOUNTED
    return np.asarray(names[np.where(mounted, pulls["body"].to_numpy(np.int64), -1)])


def _in_poses(data: Measured, robot: Robot, effector: Tool, stated: Instrument) -> Measured:
    """The same with position and rotation of the effector in place of its targets.

    The errors of both are those of a target, for the rotation at the radius of the targets, unless
    its own standard uncertainty is stated.

    Raises:
        InputError: No pull has all targets, or sigma_rad is stated without a noise of the
            positions.
    """
    count = np.bincount(data.pull, minlength=len(data.pulls))
    t = len(effector.points)
    rows = (count == t)[data.pull]
    pull = data.pull[rows][::t]
    if not len(pull):
        raise InputError(
            f"no pull has all targets of a measured pose ({listed(effector.targets)})",
            'export them all, or set measures = "points" in [instrument]',
            file="campaign.toml",
        )
    if stated.sigma_rad is not None and not data.noise_stated:
        raise InputError(
            "[instrument] states sigma_rad but no noise of the positions",
            "state [tracker] sigma_m, too, or leave sigma_rad out so that both are estimated from "
            "the data",
            file="campaign.toml",
        )
    here = configure(robot, data.pulls.q[pull])
    delta = effector.coordinates(here, data.delta[rows].reshape(-1, t, 3))
    loaded, zero = (
        cov[rows].reshape(-1, t, 3, 3).mean(axis=1) for cov in (data.loaded_cov, data.zero_cov)
    )
    rad = stated.sigma_rad if data.noise_stated else None
    own = None if rad is None else (six.radius(effector.points) * rad) ** 2 * np.eye(3)

    def rotation(position: Array) -> Array:
        """Covariance of the rotation; for a mean of several readings it is smaller."""
        if own is None:
            return position
        one = np.trace(loaded, axis1=1, axis2=2).mean()
        return np.asarray((np.trace(position, axis1=1, axis2=2) / one)[:, None, None] * own)

    kind = np.tile([0, 1], len(pull))
    which = np.unique(data.pulls.pose[pull], return_inverse=True)[1]
    return replace(
        data,
        poses=True,
        pull=np.repeat(pull, 2),
        target=kind,
        name=effector.read[kind],
        delta=delta.reshape(-1, 3),
        unloaded=np.full((2 * len(pull), 3), np.nan),
        idle=data.idle and data.idle.in_poses(t, rotation),
        loaded_cov=np.stack([loaded, rotation(loaded)], axis=1).reshape(-1, 3, 3),
        zero_cov=np.stack([zero, rotation(zero)], axis=1).reshape(-1, 3, 3),
        zero=2 * np.repeat(which, 2) + kind,
    )


def _zero_times(placed: pd.DataFrame | None, pose: Ints) -> Array:
    """Times of the zeros of each pull's pose, one time for all its targets, (m, z)."""
    if placed is None or not len(pose):
        return np.full((len(pose), 1), np.nan)
    zeros = placed[placed["state"] == "unloaded"]
    times = zeros.groupby(["pose", "group"], observed=True)["time_s"].mean()
    own, which = numbered(times.index.get_level_values("pose").to_numpy(np.int64))
    nth = np.arange(len(which)) - np.searchsorted(which, which)
    wide = np.full((len(own) + 1, nth.max(initial=-1) + 1), np.nan)  # last: no pose
    wide[which, nth] = times.to_numpy(float)
    return wide[found(own, pose)]


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
