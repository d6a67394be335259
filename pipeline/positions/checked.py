"""`check` of a campaign of absolute positions."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.answer.contract import Rejected
from pipeline.answer.inputs import rejected_entries
from pipeline.app.outcome import Outcome
from pipeline.base.errors import InputError, listed
from pipeline.base.quantities import plain
from pipeline.base.shown import typed
from pipeline.faults.mistake import Mistake
from pipeline.positions.initial import begin
from pipeline.positions.left_out import distances
from pipeline.positions.mechanism import linearised
from pipeline.positions.position_rows import PositionSheet, farther_than_real, position_rows
from pipeline.positions.positioned import Positioned, as_read, usable
from pipeline.positions.remarks import remarks
from pipeline.store.campaign import Raw


def of_positions(name: str, raw: Raw) -> Outcome:
    """Contents of a campaign of positions, and its distance from the robot's table."""
    with raw.placing():
        table, rejects = as_read(raw.settings, raw.robot, raw.files)
        wrong, sheet = position_rows(PositionSheet(raw.robot, raw.settings, table))
        read = usable(raw.settings, raw.robot, sheet.rows, rejects)
    readings, off_m = read.readings, _off_m(raw, read)
    rejected = rejected_entries(read.rejected)
    series = [str(one) for one in readings.names]
    far = [*farther_than_real(off_m)]
    said = remarks(raw.settings, readings)
    notes = [*map(_told, rejected), *(one.evidence for one in wrong), *far, *said]
    todo = f"pipeline {'check' if far else 'run'} {typed(name)}"
    used = {"poses": len(readings), "targets": len(readings.targets), "rejected": len(rejected)}
    off = f"{plain(1e3 * off_m, 2)}"
    count = ", ".join(f"{number} {what}" for what, number in used.items())
    return Outcome(
        campaign=name,
        content={
            "campaign": name,
            **used,
            "series": series,
            "off_mm": 1e3 * off_m,
            "notes": notes,
            "mistakes": [*map(_entry, wrong)],
            "next": todo,
        },
        text="\n".join(
            [
                f"{name}: {count}",
                f"  series       {listed(one or 'one' for one in series)}",
                f"  stands       {off} mm from the table, median, tool and frames fitted",
                f"  next         {'look into this, then: ' if far else ''}{todo}",
            ]
        ),
        exit_code=InputError.exit_code if [*rejected, *wrong] else 0,
        complaints=[f"{name}: {note}" for note in notes],
    )


def _told(one: Rejected) -> str:
    return f"{one.file}:{one.line}: {one.reason}"


def _entry(one: Mistake) -> dict[str, Any]:
    return {"name": one.name, "where": one.where, "readings": list(one.at)}


def _off_m(raw: Raw, read: Positioned) -> float:
    """Median distance of the targets from their places by the robot's table [m]."""
    points = {target: np.array(point) for target, point in raw.settings.tool.items()}
    start = begin(raw.robot, read.readings, points)
    rows = linearised(read.readings, start, read.weights)
    return float(np.nanmedian(distances(rows.y, rows.read)))
