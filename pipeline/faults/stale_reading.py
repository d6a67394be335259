"""Readings of the chain that repeat the other end's: a pull without direction, left out as read.

Any other stale reading is in the campaign, and in the wrong place: the tests of readings name it.
"""

from __future__ import annotations

from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake, outlying
from pipeline.reduction.case import Case


def stale(case: Case) -> list[Mistake]:
    """Stale readings that left their pull out."""
    if not case.stale:
        return []
    used = set(zip(case.readings["file"], case.readings["line"], strict=True))
    return [
        outlying(
            f"{one.group}/{one.target}",
            f"the reading {one.group}/{one.target} ({one.file}:{one.line}) repeats that of "
            f"{one.of} before it to the last digit: it was not measured again",
            "computed without this pull, whose direction is unknown",
            before=0.0,
            unit="mm",
            correct=lambda case: case,
            at=(f"{one.file}:{one.line}",),
        )
        for one in case.stale
        if (one.file, one.line) not in used
    ]


FAULT = Fault("outlier", "outlying reading", lambda asked: stale(asked.case), in_files=True)
