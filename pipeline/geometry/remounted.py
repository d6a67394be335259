"""Targets that were mounted anew between two series.

A holder that is taken off and put on again carries its targets millimetres to decimetres from where
they were, and turns them. In every series p = R (o_i + F_i l) + t holds for the poses i, with R and
t of its own, and with points l of the flange that are common to all series as long as nobody
touched them. Where no points in common with earlier series leave the targets of a series as near as
a table as delivered places them, and points of its own do, they are targets of their own there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.base.arrays import Array
from pipeline.geometry.gross_errors import BETTER, GROSS_ERROR_M
from pipeline.geometry.initial import common_points, some_of, with_tips
from pipeline.geometry.readings import PositionReadings
from pipeline.machine.robot import Robot, configure


class Remount(NamedTuple):
    """Series in which the targets stand elsewhere on the flange, and their names there."""

    series: tuple[str, ...]
    targets: tuple[str, ...]


class _Mounting(NamedTuple):
    """Series with the same points of the targets, and these points [m], flange frame, (t, 3)."""

    series: list[int]
    points: Array


def remounted(
    robot: Robot, readings: PositionReadings, tool: dict[str, Array]
) -> tuple[PositionReadings, dict[str, Array], tuple[Remount, ...]]:
    """The readings with targets of their own for each mounting but the first, points, mountings.

    Args:
        robot: Robot as in its file, without gross errors.
        readings: All series.
        tool: Nominal points of targets, flange frame [m], where known.
    """
    here, at, count = configure(robot, readings.q), with_tips(readings), len(readings.targets)
    each = [some_of(readings, s) for s in range(len(readings.names))]
    unknown = np.full((at.shape[1], 3), np.nan)
    mountings: list[_Mounting] = []
    for s in sorted((s for s, mine in enumerate(each) if len(mine)), key=lambda s: -len(each[s])):
        points, off = common_points(here, at, [each[s]], unknown)
        for k, one in enumerate(mountings):
            shared = [*one.series, s]
            both, off_both = common_points(here, at, [each[j] for j in shared], unknown, one.points)
            if off > GROSS_ERROR_M or off_both <= max(GROSS_ERROR_M, BETTER * off):
                mountings[k] = _Mounting(shared, both)
                break
        else:
            mountings.append(_Mounting([s], points))
    if len(mountings) < 2:
        return readings, tool, ()
    remounts: list[Remount] = []
    tool = dict(zip(readings.targets, mountings[0].points[:count], strict=True))
    for one in mountings[1:]:
        readings = readings.mounted_anew(one.series, count)
        new = readings.targets[-count:].tolist()
        tool |= zip(new, one.points[:count], strict=True)
        remounts.append(Remount(tuple(readings.names[one.series].tolist()), tuple(new)))
    return readings, tool, tuple(remounts)
