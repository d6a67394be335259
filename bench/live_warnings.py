"""What is said while it is measured when something creeps in: a scale's zero, warmth, a knock.

    python -m bench.live_warnings knock 0-20 2      # 20 campaigns, two poses after the knock
    python -m bench.live_warnings clean 0-20 16

One line of JSON for each virtual campaign of the demo's plan (16 poses), read up to some pose; with
pose 16 the base reflectors are read again. Kinds: `zero15` (the scale's zero moves by 15 N before
one of the poses 6 to 9), `drift` (0.15 mm and 10 urad over the campaign, steady in time),
`driftmid` (the same, base reflectors read before pose 9, too), `knock` (0.8 mm and 0.1 mrad before
one of the poses 6 to 9), `clean`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping

import numpy as np

from pipeline import identify, load_campaign, simulate_campaign
from pipeline.live.update import update_of

SEEDS = 8_200_000
"""Seed of the first game."""

POSES = 16

SHIFT_MM, TURN = {"drift": 0.15, "knock": 0.8}, {"drift": 1e-5, "knock": 1e-4}
"""Size of the translation [mm] and of the rotation [rad] about the tracker."""


def play(kind: str, game: int, until: int) -> dict[str, object]:
    """One campaign up to a pose; below 6 that many poses after the change."""
    made = simulate_campaign(seed=SEEDS + game, name="hall", stiffness_spread=0.3)
    files, rng = dict(made.campaign.files), np.random.default_rng(game)
    titles, *lines = files["tracker.csv"].decode().splitlines(keepends=True)
    since = int(rng.integers(6, 10))
    pose = min(since + until if until < 6 else until, POSES)
    if kind.startswith("zero"):
        files["loads.csv"] = _zero(files["loads.csv"], float(kind[4:]), since)
    shift, axis = (one / np.linalg.norm(one) for one in rng.normal(size=(2, 3)))
    if kind == "driftmid":
        first = next(k for k, line in enumerate(lines) if line.startswith("pose09"))
        time = lines[first - 1].rpartition(",")[2]
        ends = [line for line in lines if line.startswith("base_end")]
        lines[first:first] = [
            f"{line.replace('_end', '_mid').rpartition(',')[0]},{time}" for line in ends
        ]
    if (law := kind.removesuffix("mid")) in SHIFT_MM:
        lines = [
            _moved(line, part * SHIFT_MM[law] * shift, part * TURN[law] * axis)
            for line, part in zip(lines, _course(law, lines, since), strict=True)
        ]
    read = [line for line in lines if _read(line, pose)]
    table = "".join([titles, *read]).encode()
    campaign = load_campaign(files | {"tracker.csv": table}, name="hall")
    update = update_of(campaign, identify(campaign))
    return {
        "kind": kind, "game": game, "since": since, "pose": pose, "verdict": update.verdict,
        "warnings": update.warnings, "suspects": [one.where for one in update.suspects],
    }  # fmt: skip


def _zero(loads: bytes, by_n: float, since: int) -> bytes:
    """The log with forces from some pose on higher by as much."""
    head, *rows = (line.split(",") for line in loads.decode().splitlines())
    for row in rows:
        row[2] = f"{float(row[2]) + by_n * (int(row[0]) >= since):.2f}"
    return "\n".join([*map(",".join, [head, *rows]), ""]).encode()


def _course(law: str, lines: list[str], since: int) -> list[float]:
    """Part of the motion that each reading has."""
    if law == "drift":
        return [k / len(lines) for k in range(len(lines))]
    return [float(line[:8] == "base_end" or _pose(line) >= since) for line in lines]


def _pose(line: str) -> int:
    return int(line[4:6]) if line.startswith("pose") else 0


def _read(line: str, pose: int) -> bool:
    """Whether a line is there once a pose is measured."""
    when: Mapping[str, int] = {"base_start": 0, "base_mid": 9, "base_end": POSES}
    return when.get(line.partition(",")[0], _pose(line)) <= pose


def _moved(line: str, shift: np.ndarray, turn: np.ndarray) -> str:
    group, target, *xyz, time = line.split(",")
    p = np.array(xyz, float)
    return ",".join([group, target, *(f"{x:.4f}" for x in p + shift + np.cross(turn, p)), time])


if __name__ == "__main__":
    low, high = map(int, sys.argv[2].split("-"))
    for number in range(low, high):
        print(json.dumps(play(sys.argv[1], number, int(sys.argv[3]))), flush=True)
