"""Names of groups: one for two places, or those of an unloaded and a loaded group exchanged.

Readings of a target in one state may contradict each other.

Ingest uses none of such readings, as nothing says which is right, and what depends on them is left
out with them. A shot that was repeated on the spot, microns apart, is a row lost; readings apart by
more than a robot gives way, or all pulls of a pose, are a mistake in the record.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from pipeline.faults.assignment import lines
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.joint_row import without_poses
from pipeline.faults.mistake import Mistake, as_it_is, length
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction._raw_readings import Contradiction, ExchangedNames


def named_twice(asked: Screening) -> Iterator[Mistake]:
    """Groups that have the name of others, and poses that are lost by contradictions."""
    case = asked.case
    yield from map(_of_names, case.renamed)
    pulled = set(case.readings.loc[case.readings["state"] == "loaded", "pose"])
    by_pose: dict[int, list[Contradiction]] = {}
    for one in case.contradictions:
        by_pose.setdefault(one.pose, []).append(one)
    for pose, ones in by_pose.items():
        if pose not in pulled or max(one.apart_m for one in ones) > GROSS_DISTANCE_M:
            yield _of_pose(pose, ones, lost=pose not in pulled)


def _of_names(one: ExchangedNames) -> Mistake:
    unloaded, loaded = one.groups
    return Mistake(
        name="exchanged",
        where="/".join(one.groups),
        evidence=f"the groups {unloaded} and {loaded} of pose {one.pose} have each other's names "
        f"({lines(one.at)}): the ends of the chain were read in the unloaded one, and not in the "
        "loaded one",
        correction="computed with their names exchanged",
        before=1.0,
        unit="1",
        correct=as_it_is,
        at=one.at,
    )


def _of_pose(pose: int, ones: list[Contradiction], lost: bool) -> Mistake:
    worst = max(ones, key=lambda one: one.apart_m)
    groups = list(dict.fromkeys(one.group for one in ones))
    at = tuple(place for one in ones for place in one.at)
    more = f" (so do others in {len(groups)} groups of pose {pose})" if len(ones) > 1 else ""
    left = f"pose {pose}" if lost else "these readings"
    return Mistake(
        name="exchanged",
        where=groups[0] if len(groups) == 1 else f"{groups[0]}/{groups[-1]}",
        evidence=f"{worst.at[0]} and {worst.at[-1]} both have the name {worst.group}/"
        f"{worst.target} and are {length(worst.apart_m)} apart{more}: which of them has its name "
        f"by mistake nothing in the files says ({lines(at)})",
        correction=f"computed without {left}",
        before=1e3 * worst.apart_m,
        correct=partial(without_poses, poses=[pose]) if lost else as_it_is,
        at=at,
    )


FAULT = Fault("exchanged", lambda asked: list(named_twice(asked)), in_files=True)
