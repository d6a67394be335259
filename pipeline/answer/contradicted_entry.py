"""Entries of campaign.toml that the readings contradict: sentences for `check` and `run`."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.base.errors import place
from pipeline.base.quantities import plain as in_digits
from pipeline.base.toml import line_of
from pipeline.faults.entries import DoubtfulEntry, wrong_entries
from pipeline.reduction.case import Case


def entry_findings(case: Case, text: str) -> list[str]:
    """A sentence on a wrong entry, with its line; one per candidate if several are possible.

    Args:
        case: The campaign, with the mistakes in its readings corrected.
        text: Its campaign.toml.
    """
    if case.settings.tracker is None:
        return []
    found = wrong_entries(case)
    return [
        f"{place('campaign.toml', line_of(text, one.path))}{contradicted(text, one, found)}."
        for one in found
    ]


def contradicted(text: str, one: DoubtfulEntry, found: Sequence[DoubtfulEntry]) -> str:
    """How the readings contradict an entry, and what to do."""
    if not one.names:
        return f"[{one.table}] is in {one.unit}, as the distances as read show; write it in metres"
    if len(one.names) == 2:
        line = line_of(text, [one.table, one.names[1]])
        return (
            f"{one.names[0]} and {one.names[1]} (line {line}) in [{one.table}] have each other's "
            "coordinates; exchange them"
        )
    where = ", ".join(f"{x:.4f}" for x in one.found)
    other = [" and ".join(rival.names) or rival.table for rival in found if rival is not one]
    maybe = f" (or {' or '.join(other)})" if other else ""
    return (
        f"{one.names[0]} in [{one.table}] is {in_mm(one.off_m)} from where the readings place it"
        f"{maybe}: about [{where}], ± {in_mm(float(one.std.max()))}; measure it again, and correct "
        "the line"
    )


def in_mm(metres: float) -> str:
    """A length [m] in mm, to three significant digits."""
    return f"{in_digits(1e3 * metres, 3)} mm"
