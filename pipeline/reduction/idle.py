"""Unloaded positions that belong to no displacement: data for the DH parameters of the robot.

They are those of poses without a pull; and, where an instrument reads one 6D pose, those of every
pose, since the displacements are then not those of targets.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.base import covariance
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import Robot
from pipeline.reduction.displacements import zeros
from pipeline.reduction.settings import Settings
from pipeline.tables import XYZ


@dataclass(frozen=True, eq=False)
class Idle(Locked):
    """Positions of the targets of such poses, z of them.

    Attributes:
        pulls: The robot at each of them, under no load.
        target: Index of its target in the tool, shape (z,).
        at: Its position [m], F_b, shape (z, 3).
        cov: Covariance of the position [m^2], shape (z, 3, 3); 1 m^2 over the number of readings
            where no noise is stated.
        turned: Covariance of the rotation of each pose at the radius of the targets [m^2], shape
            (p, 3, 3), where all targets of a pose were computed from one 6D pose, of which `cov` is
            that of the position; else None.
    """

    pulls: Pulls
    target: Ints
    at: Array
    cov: Array
    turned: Array | None = None

    def __len__(self) -> int:
        """Number of positions z."""
        return len(self.target)

    @property
    def poses(self) -> int:
        """Number of such poses."""
        return len(np.unique(self.pulls.pose))

    def scaled(self, factor: float) -> Idle:
        """The same with the standard uncertainties of positions and rotations multiplied."""
        return replace(self.with_rotation(factor), cov=self.cov * factor**2)

    def with_rotation(self, factor: float) -> Idle:
        """The same with the standard uncertainties of the rotations multiplied."""
        return replace(self, turned=None if self.turned is None else self.turned * factor**2)

    def in_poses(self, targets: int, rotation: Callable[[Array], Array]) -> Idle:
        """Those that have all targets, computed from one 6D pose.

        Args:
            targets: Number of targets.
            rotation: Gives the covariance of the rotation from that of the position, (p, 3, 3)
                both.
        """
        every = np.flatnonzero(np.bincount(self.pulls.pose)[self.pulls.pose] == targets)
        cov = self.cov[every].reshape(-1, targets, 3, 3).mean(axis=1)
        return Idle(
            self.pulls.part(every),
            self.target[every],
            self.at[every],
            np.repeat(cov, targets, axis=0),
            rotation(cov),
        )


def idle(
    settings: Settings, robot: Robot, joints: pd.DataFrame, placed: pd.DataFrame, pulled: Ints
) -> Idle:
    """Unloaded readings of all poses except the pulled ones.

    Args:
        settings: Names of the measured targets.
        robot: The robot, for its joints.
        joints: Table of joint values, `tables.joints(robot)`.
        placed: Table PLACED, F_b.
        pulled: Poses that are left out, shape (p,).
    """
    read = zeros(settings, placed)
    read = read[~read["pose"].isin(pulled)].merge(joints, on="pose")
    read = read.sort_values(["pose", "target"])
    C = covariance.numbers(read, covariance.columns("zero_c"))
    if covariance.stated(covariance.known(C)):
        cov = covariance.full(C)
    else:
        cov = np.eye(3) / read["zero_count"].to_numpy(float)[:, None, None]
    none = np.zeros(len(read))
    time = read["zero_time_s"].to_numpy(float)
    columns = [tables.joint_column(joint.name, joint.prismatic) for joint in robot.joints]
    return Idle(
        pulls=Pulls(
            pose=read["pose"].to_numpy(np.int64),
            repeat=none.astype(np.int64),
            q=read[columns].to_numpy(float),
            force=np.zeros((len(read), 3)),
            branch=none,
            approach=read["approach"].to_numpy(float),
            time=time,
            time_zero=time,
        ),
        target=read["target"].to_numpy(np.int64),
        at=read[[f"zero_{axis}" for axis in XYZ]].to_numpy(float),
        cov=cov,
    )
