"""From an ingested campaign to its measurements in F_b: the order of the reduction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline import tables
from pipeline.base.errors import InputError
from pipeline.reduction.case import Case
from pipeline.reduction.days import with_days
from pipeline.reduction.displacements import displacements
from pipeline.reduction.forces import forces
from pipeline.reduction.measured import Measured, measured
from pipeline.reduction.register import Registration, place, register

Step = Callable[[Callable[..., Any]], Callable[..., Any]]
Keep = Callable[[str, "pd.DataFrame | pa.Table | None", pa.Schema], pd.DataFrame]


@dataclass(frozen=True, eq=False)
class Reduced:
    """A campaign's measurements in F_b.

    Attributes:
        data: Pulls and displacements as arrays.
        registration: Registration of the tracker.
        placed: Table PLACED, the readings of the poses in F_b.
        shown: The tables shown to a reader, by name.
    """

    data: Measured
    registration: Registration
    placed: pd.DataFrame
    shown: dict[str, pd.DataFrame]


def conformed(_: str, table: pd.DataFrame | pa.Table | None, promise: pa.Schema) -> pd.DataFrame:
    """Check a table against its schema without keeping it."""
    return tables.frame(tables.conform(table, promise))


def inline(stage: Callable[..., Any]) -> Callable[..., Any]:
    """Execute a stage here and now, not as a task."""
    return stage


@dataclass(frozen=True, eq=False)
class _PlacedTables:
    """The tables between readings and measurements.

    Attributes:
        registration: Registration of the tracker.
        base: Table REGISTRATION.
        placed: Table PLACED.
        forces: Table FORCES.
        displacements: Table DISPLACEMENTS.
    """

    registration: Registration
    base: pd.DataFrame
    placed: pd.DataFrame
    forces: pd.DataFrame
    displacements: pd.DataFrame


def to_displacements(case: Case, keep: Keep = conformed, step: Step = inline) -> _PlacedTables:
    """From readings in the tracker's frame to tables of forces and displacements in F_b."""
    settings = case.settings
    registration = step(register)(settings, case.readings)
    base = keep("20_registration", registration.table, tables.REGISTRATION)
    placed = keep("21_placed", place(registration, case.readings), tables.PLACED)
    if settings.displacements is None:
        pulled = step(forces)(settings, placed, case.loads)
        moved = step(displacements)(settings, placed)
    else:
        pulled, moved = case.forces, case.displacements
    pulled = keep("22_forces", pulled, tables.FORCES)
    moved = keep("23_displacements", moved, tables.DISPLACEMENTS)
    return _PlacedTables(registration, base, placed, pulled, moved)


_MOST = 300
"""Maximum number of displacements of one pose: all its errors form one covariance, whose square
root takes minutes and gigabytes for more. With 300 the scatter of readings is averaged to a
seventeenth, and what the pulls of a pose have in common (its lever arms, its zero, the scale) is
not averaged."""


def _refuse_crowded(data: Measured) -> None:
    """Check that no pose has more than `_MOST` displacements.

    Raises:
        InputError: One has.
    """
    pose, count = np.unique(data.pulls.pose[data.pull], return_counts=True)
    if count.max(initial=0) > _MOST:
        raise InputError(
            f"pose {pose[count.argmax()]} has {count.max()} displacements of targets, more than "
            f"the {_MOST} that are computed together; the stiffnesses hardly gain from so many",
            "leave some of its pulls out, or pull in further poses instead",
        )


def bring(case: Case, keep: Keep = conformed, step: Step = inline) -> Reduced:
    """From readings in the tracker's frame to forces and displacements in F_b, as arrays.

    Raises:
        InputError: A pose has more displacements than are computed together.
    """
    return _brought(case) if keep is conformed and step is inline else _bring(case, keep, step)


@lru_cache(maxsize=2)
def _brought(case: Case) -> Reduced:
    """The same without keeping tables; cached, since correcting a case needs it twice."""
    return _bring(case, conformed, inline)


def _bring(case: Case, keep: Keep, step: Step) -> Reduced:
    got = to_displacements(case, keep, step)
    tables = case.joints, got.forces, got.displacements
    data = measured(case.settings, case.robot, got.registration, *tables, got.placed)
    _refuse_crowded(data)
    data = with_days(data).standing(case.stance, case.tool)
    shown = {
        "readings": case.readings,
        "rejected": case.rejected,
        "registration": got.base,
        "forces": got.forces,
        "displacements": got.displacements,
    }
    return Reduced(data, got.registration, got.placed, shown)
