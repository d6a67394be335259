"""Outbuilding: files that other makers' programs write, told by their marks.

Exports of trackers, each a `Reader` in a file of its own (docs/add-a-reader.md), which `readers`
tries beside its own plain CSV; and what the controller of a robot keeps, points and recordings, as
a table of joint values. Without this folder a file is read as any table is, by its titles or by
[tracker.mapping].

Door: `DIALECTS`; for logs `of_controller`.
Tests: `tests/readers/`, `tests/dialects/`.
"""

from __future__ import annotations

from pipeline.dialects import (
    emscon,
    leica_6dof,
    recorded,
    spatial_analyzer,
    taught,
    tracker_pilot,
    xyz,
)
from pipeline.readers import Reader

DIALECTS: dict[str, Reader] = {
    "spatialanalyzer": spatial_analyzer.READER,
    "emscon": emscon.READER,
    "leica_6dof": leica_6dof.READER,
    "tracker_pilot": tracker_pilot.READER,
    "xyz": xyz.READER,
}


def of_controller(data: bytes) -> bytes | None:
    """A controller's points or recording as a table of joint values; None where it is neither."""
    return taught.table(data) or recorded.table(data)
