"""`check` of a campaign of absolute positions."""

from __future__ import annotations

import numpy as np

from pipeline.answer.inputs import rejected_entries
from pipeline.app.outcome import Outcome
from pipeline.base.errors import InputError, listed
from pipeline.base.quantities import plain
from pipeline.base.shown import typed
from pipeline.faults.position_rows import Sheet, position_rows
from pipeline.geometry.begin import begin
from pipeline.geometry.leftout import distances
from pipeline.geometry.mechanism import linearised
from pipeline.geometry.positioned import as_read, usable
from pipeline.store.campaign import Raw

_FAR_M = 0.02
"""Median distance of the targets from the nominal robot [m] from which a unit, a sense or a
convention is wrong: tables are off by millimetres."""


def of_positions(name: str, raw: Raw) -> Outcome:
    """What a campaign of positions holds, and how far it is from the robot's table."""
    with raw.placing():
        table, rejects = as_read(raw.settings, raw.robot, raw.files)
        wrong, sheet = position_rows(Sheet(raw.robot, raw.settings, table))
        read = usable(raw.settings, raw.robot, sheet.rows, rejects)
    readings = read.readings
    points = {target: np.array(point) for target, point in raw.settings.tool.items()}
    rows = linearised(readings, begin(raw.robot, readings, points), read.weights)
    off_m = float(np.nanmedian(distances(rows.y, rows.read)))
    rejected = rejected_entries(read.rejected)
    series = listed(str(one) or "one" for one in readings.names)
    notes = [f"{one.file}:{one.line}: {one.reason}" for one in rejected]
    notes += [one.evidence for one in wrong]
    todo = f"pipeline run {typed(name)}"
    if off_m > _FAR_M:
        todo = f"pipeline check {typed(name)}"
        notes.append(
            f"the targets are {plain(1e3 * off_m, 3)} mm from where the robot file "
            "places them, farther than on any real robot: check the units and signs of the joint "
            "values and the robot file"
        )
    used = {"poses": len(readings), "targets": len(readings.targets), "rejected": len(rejected)}
    off = f"{plain(1e3 * off_m, 2)}"
    count = ", ".join(f"{number} {what}" for what, number in used.items())
    return Outcome(
        campaign=name,
        content={
            "campaign": name,
            **used,
            "series": [str(one) for one in readings.names],
            "off_mm": 1e3 * off_m,
            "notes": notes,
            "mistakes": [
                {"name": one.name, "where": one.where, "readings": list(one.at)} for one in wrong
            ],
            "next": todo,
        },
        text="\n".join(
            [
                f"{name}: {count}",
                f"  series       {series}",
                f"  stands       {off} mm from the table, median, tool and frames fitted",
                f"  next         {'' if off_m <= _FAR_M else 'look into this, then: '}{todo}",
            ]
        ),
        exit_code=InputError.exit_code if rejected or wrong else 0,
        complaints=[f"{name}: {note}" for note in notes],
    )
