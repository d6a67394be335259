"""A target with a wrong position in [tool]; uncorrected, its lever would be wrong."""

from __future__ import annotations

from functools import partial

from pipeline.base.quantities import plain
from pipeline.faults.conventions import FEWEST_POSES, unloaded, with_places
from pipeline.faults.entries import TOOL_M, DoubtfulEntry, wrong_entries
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake
from pipeline.reduction.case import Case

_CLEAR_SIGMAS = 5.0
"""Minimum error of a point in standard uncertainties to be corrected [1]; a smaller one is kept and
reported as a finding."""


def tool_point(case: Case) -> list[Mistake]:
    """The one target that the unloaded reflectors contradict, moved to where they place it."""
    if len(case.settings.measured) < 3 or unloaded(case)["pose"].nunique() < FEWEST_POSES:
        return []
    found = wrong_entries(case)
    least = _CLEAR_SIGMAS * max(case.settings.tool_uncertainty.sigma_m, TOOL_M)
    if len(found) != 1 or found[0].table != "tool" or len(found[0].names) != 1:
        return []
    return [_finding(found[0])] if found[0].off_m > least else []


def _finding(entry: DoubtfulEntry) -> Mistake:
    (name,), size = entry.names, entry.off_m
    where = ", ".join(f"{x:.4f}" for x in entry.found)
    off, std = (f"{plain(1e3 * x, 3)} mm" for x in (size, float(entry.std.max())))
    return Mistake(
        name="tool_point",
        where=name,
        evidence=f"the target {name} is {off} from its place in [tool]: the readings place it at "
        f"[{where}] m in the flange frame, ± {std} per axis",
        correction=f"recomputed with {name} at [{where}] m",
        before=1e3 * size,
        size=size,
        size_unit="m",
        entry=("tool", name),
        correct=partial(with_places, "tool", {name: tuple(entry.found.tolist())}),
    )


FAULT = Fault("tool_point", lambda asked: tool_point(asked.case), in_files=True)
