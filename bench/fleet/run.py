"""Monitoring of fleets campaign by campaign, with results kept as they finish."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter

import pipeline
from bench import exam
from bench.exam import Kept, code_of
from bench.fleet.detectors import DETECTORS
from bench.fleet.world import CAMPAIGNS, KINDS, YEAR, Robot, fleet
from pipeline.service.executor import Executor

SEEDS = Path(__file__).with_name("seeds.txt")
"""One integer per fleet; fleet k of every kind has the k-th."""


@dataclass(frozen=True)
class Watched:
    """Result of one robot under one detector.

    Attributes:
        kind: Kind of the fleet.
        number: Number of the fleet.
        detector: Name of the detector.
        worn: Whether something has changed.
        found: Campaign that raised the alarm, from 1; None if none did.
        years: Time from the first campaign to the alarm, or to the last campaign.
    """

    kind: str
    number: int
    detector: str
    worn: bool
    found: int | None
    years: float


def watch(kind: str, number: int) -> list[Watched]:
    """All robots of one fleet under all detectors."""
    (seed,) = exam.seeds(SEEDS, number, 1)
    robots = fleet(KINDS[kind], seed)
    out = []
    for name, detector in DETECTORS.items():
        alarms = [detector(robots, count) for count in range(1, CAMPAIGNS + 1)]
        for k, robot in enumerate(robots):
            found = next((c for c, one in enumerate(alarms, 1) if one[k]), None)
            out.append(Watched(kind, number, name, robot.worn, found, _years(robot, found)))
    return out


def _years(robot: Robot, found: int | None) -> float:
    return float(robot.day[(found or CAMPAIGNS) - 1] - robot.day[0]) / YEAR


ROWS = TypeAdapter(list[Watched])


def contest(wanted: Sequence[tuple[str, int]], log: Path, executor: Executor) -> list[Watched]:
    """All robots of these fleets, as `exam.contest`."""
    kept = Kept(log, code(), ROWS)
    every = exam.contest(wanted, _played, _key, code, kept, executor)
    return [one for robots in every for one in robots]


def _played(fixture: tuple[str, int]) -> list[Watched]:
    return watch(*fixture)


def _key(fixture: tuple[str, int]) -> str:
    return f"{fixture[0]}-{fixture[1]}"


def wanted(worn: int, others: int, first: int = 0) -> list[tuple[str, int]]:
    """Fleets with wear in one joint, two and all in turn, then those of every other kind.

    Args:
        worn: Number of fleets with wear.
        others: Number of fleets of each other kind.
        first: Number of the first fleet of each kind.
    """
    thirds = ("one", "two", "all")
    rest = [kind for kind in KINDS if kind not in thirds]
    return [(thirds[k % 3], first + k) for k in range(worn)] + [
        (kind, first + k) for kind in rest for k in range(others)
    ]


def code() -> str:
    """Hash of the code of detectors and simulation."""
    here = Path(__file__)
    wear = Path(pipeline.__file__).parent / "fleet" / "wear"
    mine = [here.with_name(f"{name}.py") for name in ("world", "detectors", "run")]
    return code_of([*mine, *wear.glob("*.py")])
