"""Outbuilding: files that are none of our own CSV.

Exports of trackers told by their marks, each a `Reader` in a file of its own
(docs/add-a-reader.md), which `readers` tries beside its own plain CSV; any other table, as
[tracker.mapping] or the intake says; workbooks; readings without names, by the order they were
taken in; and what the controller of a robot keeps, points and recordings, as a table of joint
values. Without this folder a file is read whose columns are ours, all rows of it readings.

Door: `DIALECTS`; `mapped.read`, `workbook.opened`, `assignment.assigned`; for logs `of_controller`.
Tests: `tests/readers/`, `tests/dialects/`.
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
from pipeline.readers import TABLE, Reader

DIALECTS: dict[str, Reader] = {
    "plain": titled.READER,
    "spatialanalyzer": spatial_analyzer.READER,
    "emscon": emscon.READER,
    "leica_6dof": leica_6dof.READER,
    "tracker_pilot": tracker_pilot.READER,
    "xyz": xyz.READER,
    TABLE: table.READER,
}
"""In the order in which they are tried; any other table is the last."""


def of_controller(data: bytes) -> bytes | None:
    """A controller's points or recording as a table of joint values; None where it is neither."""
    return taught.table(data) or recorded.table(data)
