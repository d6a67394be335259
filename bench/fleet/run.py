"""Monitoring of fleets campaign by campaign, with results kept as they finish."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from bench.fleet.detectors import DETECTORS
from bench.fleet.world import CAMPAIGNS, KINDS, YEAR, Robot, fleet
from pipeline.base import files

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
    seed = int(SEEDS.read_text("utf-8").split()[number])
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


def contest(wanted: Iterable[tuple[str, int]], log: Path, code: str) -> Iterator[Watched]:
    """Yield the results that are kept from this code, and the others as they are computed.

    Args:
        wanted: Kinds and numbers of fleets.
        log: File with one JSON line per fleet.
        code: Version of the code.
    """
    kept = {}
    if log.is_file():
        for line in log.read_text("utf-8").splitlines():
            one = json.loads(line)
            kept[one["code"], one["kind"], one["number"]] = one["robots"]
    for kind, number in wanted:
        robots = kept.get((code, kind, number))
        if robots is None:
            began = time.process_time()
            robots = [asdict(one) for one in watch(kind, number)]
            seconds = round(time.process_time() - began, 2)
            log.parent.mkdir(parents=True, exist_ok=True)
            line = {"code": code, "kind": kind, "number": number, "seconds": seconds}
            with log.open("a", encoding="utf-8") as file:
                file.write(json.dumps({**line, "robots": robots}) + "\n")
        yield from (Watched(**one) for one in robots)


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
    wear = [here.parents[2] / "pipeline" / "fleet" / "wear" / f"{name}.py" for name in _WATCHES]
    mine = [here.with_name(f"{name}.py") for name in ("world", "detectors", "run")]
    return files.sha256(b"".join(path.read_bytes() for path in (*mine, *wear)))[:12]


_WATCHES = ("machine", "beside", "scatter", "alarm")
"""Files of pipeline/fleet/wear that raise alarms."""
