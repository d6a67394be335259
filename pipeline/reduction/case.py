"""A campaign between ingest and estimate, as a value: corrections change copies of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline import tables
from pipeline.base.arrays import Array, Ints
from pipeline.machine.cell import Cell, Tool, paper_cell
from pipeline.machine.known_robot import KnownRobot
from pipeline.machine.robot import Robot
from pipeline.readers import Faces
from pipeline.reduction._raw_readings import (
    NONE_LOST,
    Contradiction,
    ExchangedNames,
    RepeatedReading,
    UnusedReadings,
)
from pipeline.reduction.effector import tool
from pipeline.reduction.set_aside import NamedAside
from pipeline.reduction.settings import Settings
from pipeline.reduction.stations import Station


@dataclass(frozen=True)
class ExportTreatment:
    """What was done to an export, or left out of it, before it was used.

    Attributes:
        file: Its name.
        faces: Two faces that were averaged, or None.
        untimed: Name of a time column without times, and one of its cells; None where it has times.
        settled: What known reflectors or campaign.toml settled that the export leaves open, in
            sentences.
    """

    file: str
    faces: Faces | None
    untimed: str | None
    settled: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class FilesAsRead:
    """What reading the files of a campaign found beside its tables.

    Attributes:
        displacements: Table DISPLACEMENTS of a campaign that arrives reduced, else None.
        forces: Table FORCES of a campaign that arrives reduced, else None.
        torques: Torques of the joints in their log: pose, repeat (NaN where it has none), tau1 ...;
            None where it has none.
        stale: Readings that repeat another one of their state, whether or not they are left out.
        contradictions: Readings of one target in one state that differ, left out.
        renamed: Groups that had each other's name, which were given their own.
        lost: Readings of known targets that are not used.
        unused: Groups of the exports none of whose readings is used.
        treated: Exports that were not used unchanged.
        aside: What campaign.toml sets aside.
        anchors: Where the chain of a pull (pose, repeat) ends that has no reflectors: its name in
            `Settings.anchors` or `Settings.base_frame`.
        anchors_read: The same as read, where it is not stated: tracker's frame [m].
    """

    displacements: pa.Table | None = None
    forces: pa.Table | None = None
    torques: pd.DataFrame | None = None
    stale: tuple[RepeatedReading, ...] = ()
    contradictions: tuple[Contradiction, ...] = ()
    renamed: tuple[ExchangedNames, ...] = ()
    lost: UnusedReadings = NONE_LOST
    unused: tuple[str, ...] = ()
    treated: tuple[ExportTreatment, ...] = ()
    aside: tuple[NamedAside, ...] = ()
    anchors: Mapping[tuple[int, int], str] = field(default_factory=dict)
    anchors_read: Mapping[tuple[int, int], Array] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Case(FilesAsRead):
    """The ingested campaign.

    Attributes:
        settings: campaign.toml.
        robot: Its robot.
        readings: Table READINGS, empty for a campaign that arrives reduced.
        loads: Table LOADS, likewise.
        joints: Table `tables.joints(robot)`.
        rejected: Table REJECTED.
        stations: Later stations of the tracker; readings are as from the first one.
        stance: Estimates from absolute positions of the same robot, if any.
    """

    settings: Settings
    robot: Robot
    readings: pd.DataFrame
    loads: pd.DataFrame
    joints: pd.DataFrame
    rejected: pd.DataFrame
    stations: tuple[Station, ...] = ()
    stance: KnownRobot | None = None

    def standing(self, stance: KnownRobot) -> Case:
        """The same with the robot's table, tool and joint values estimated from positions."""
        points = {name: tuple(at.tolist()) for name, at in stance.points.items()}
        known = {name: at for name, at in points.items() if name in self.settings.tool}
        q = self.joints[self.joint_columns].to_numpy(float)
        there = dict(zip(self.joint_columns, stance.joints(q).T, strict=True))
        return replace(
            self,
            settings=self.settings.model_copy(update={"tool": self.settings.tool | known}),
            robot=stance.robot,
            joints=self.joints.assign(**there),
            stance=stance,
        )

    @property
    def tool(self) -> Tool:
        """The effector: its load point and the targets that are measured."""
        return tool(self.settings)

    @property
    def cell(self) -> Cell:
        """The paper's model of it, corrected by the stance if there is one."""
        cell = paper_cell(self.robot, self.tool)
        cell = replace(cell, equilibrium=self.settings.model.equilibrium)
        return cell if self.stance is None else self.stance.on(cell)

    @property
    def joint_columns(self) -> list[str]:
        """Columns of the joint values in `joints`."""
        return [tables.joint_column(j.name, j.prismatic) for j in self.robot.joints]

    def q(self, poses: Ints) -> Array:
        """Joint values of some poses [m] or [rad], shape (len(poses), n)."""
        known, values = self._logged
        row = known.get_indexer_for(pd.Index(poses))
        if (row < 0).any():  # ingest keeps no pose without a row of the log
            raise KeyError(f"no joint values of poses {np.asarray(poses)[row < 0]}")
        return values[row]

    @cached_property
    def _logged(self) -> tuple[pd.Index[int], Array]:
        """The poses of the joint log, and their joint values, shape (p, n)."""
        columns = [self.joints[name].to_numpy(float) for name in self.joint_columns]
        return pd.Index(self.joints["pose"]), np.column_stack(columns)
