"""Poses in which reflectors were read and nothing was pulled: they tell of the robot's table."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.base import covariance
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import Robot
from pipeline.reduction.displacements import zeros
from pipeline.reduction.register import XYZ
from pipeline.reduction.settings import Settings


@dataclass(frozen=True, eq=False)
class Idle(Locked):
    """Positions of the targets of such poses, z of them.

    Attributes:
        pulls: The robot at each of them, under no load.
        target: Index of its target in the tool, shape (z,).
        at: Where it stands [m], F_b, shape (z, 3).
        cov: Covariance of that [m^2], shape (z, 3, 3); 1 m^2 over the number of readings where no
            noise is stated.
    """

    pulls: Pulls
    target: Ints
    at: Array
    cov: Array

    def __len__(self) -> int:
        """Number of positions z."""
        return len(self.target)

    @property
    def poses(self) -> int:
        """Number of such poses."""
        return len(np.unique(self.pulls.pose))

    def scaled(self, factor: float) -> Idle:
        """The same with the standard uncertainties of the readings multiplied."""
        return replace(self, cov=self.cov * factor**2)


def idle(
    settings: Settings, robot: Robot, joints: pd.DataFrame, placed: pd.DataFrame, pulled: Ints
) -> Idle:
    """Unloaded readings of poses without a pull.

    Args:
        settings: Names of the measured targets.
        robot: The robot, for its joints.
        joints: Table of joint values, `tables.joints(robot)`.
        placed: Table PLACED, F_b.
        pulled: Poses in which something was pulled.
    """
    read = zeros(settings, placed)
    read = read[~read["pose"].isin(pulled)].merge(joints, on="pose")
    read = read.sort_values(["pose", "target"], ignore_index=True)
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
