"""Outbuilding: files other than our own CSV.

Exports of trackers, recognised by distinctive marks, each with a `Reader` in a file of its own
(docs/add-a-reader.md), which `readers` tries in addition to its own plain CSV; any other table, as
described by [tracker.mapping] or the intake; workbooks; readings without names, identified by the
order in which they were taken; logs that are no plain tables, with the reasons for the rows that
are left out; and point lists and recordings of the robot's controller, as a table of joint values.
Without this folder a file can be read only if its columns are ours and all of its rows are whole,
and a chain only if its ends have reflectors.

Door: `DIALECTS`; `mapped.read`, `workbook.opened`, `assignment.assigned`, `anchored.with_ends` and
`again`; for logs `_log_form.opened`, `_log_rows.typed`, `of_controller`, `joined`.
Tests: `tests/dialects/`.
"""

from __future__ import annotations

from pipeline.dialects import (
    emscon,
    leica_6dof,
    recorded,
    spatial_analyzer,
    table,
    taught,
    titled,
    tracker_pilot,
    xyz,
)
from pipeline.dialects.taught import joined
from pipeline.readers import TABLE, Reader

__all__ = ["DIALECTS", "joined", "of_controller"]

DIALECTS: dict[str, Reader] = {
    "plain": titled.READER,
    "spatialanalyzer": spatial_analyzer.READER,
    "emscon": emscon.READER,
    "leica_6dof": leica_6dof.READER,
    "tracker_pilot": tracker_pilot.READER,
    "xyz": xyz.READER,
    TABLE: table.READER,
}
"""Readers in the order in which they are tried; any other table comes last. `plain` is our own CSV,
recognised also by similar titles, and takes the place of the reader of that key in `readers`."""


def of_controller(data: bytes) -> bytes | None:
    """Joint values of a controller's points or recording as a table; None if it is neither."""
    return taught.table(data) or recorded.table(data)
