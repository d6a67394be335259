"""Campaigns judged while they are measured: blunders told at once, no alarm without one, the end.

    python -m bench.live FILE --games 100

Each campaign is a virtual one of the demo's plan, fed pose by pose, and step by step about its
blunder. Every other one has a blunder of one reading from the third pose on, in a random direction,
0.3 to 3 mm: seven and more standard uncertainties of a difference of two readings. The tolerance is
drawn beside the true deflection at the test pose. Games that stand in FILE are not played again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bench.league.table import share
from pipeline import simulate_campaign
from pipeline.library.campaign import Campaign
from pipeline.live.watching import QUIET_S, Live
from pipeline.machine.robot import configure

SEEDS = 7_000_000
"""The first game's seed; no other exam uses those from here on."""

SIZE_M = (0.3, 3.0)
"""Blunders [mm]."""

BESIDE = (0.5, 2.0)
"""Tolerance over the true deflection."""

Q, FORCE_N = [8.5, -10.0, 35.0, 39.0, 81.0, 22.0, -10.0], [-124.5, -175.4, -209.1]
"""The demo's test pose [m], [deg], and its force [N]."""

STEP = 1e-6
"""Of a central difference [m] or [rad]."""


def play(game: int) -> dict[str, Any]:
    """One campaign: what was told, and when."""
    rng = np.random.default_rng(SEEDS + game)
    made = simulate_campaign(seed=SEEDS + game, name="hall", stiffness_spread=0.3)
    files = dict(made.campaign.files)
    true_mm = 1e3 * _true(made.campaign, made.truth)
    most = true_mm * float(np.exp(rng.uniform(*np.log(BESIDE))))
    files["campaign.toml"] += (
        f"\n[test_pose]\nq = {Q}\nforce_n = {FORCE_N}\n[tolerance]\ndeflection_mm = {most:.4f}\n"
    ).encode()
    titles, *lines = files.pop("tracker.csv").decode().splitlines(keepends=True)
    base = [line for line in lines if line.startswith("base_start")]
    groups = dict.fromkeys(line.partition(",")[0] for line in lines if line.startswith("pose"))
    steps = [[line for line in lines if line.startswith(f"{one},")] for one in groups]
    bad = _spoil(steps, rng) if game % 2 else None
    state, came, told = Live("hall"), base, []
    for k, step in enumerate(steps):
        came = came + step
        pose = step[0][:6]
        last = k + 1 == len(steps) or steps[k + 1][0][:6] != pose
        near = bad is not None and abs(k - bad) <= 1
        if last or near:
            now = {**files, "tracker.csv": "".join([titles, *came]).encode()}
            update = state.look(now, 8.0 * k) or (state.look(now, 8.0 * k + 2 * QUIET_S))
            if update is not None:
                told.append((k, update))
    first = next((k for k, one in told if any(_hits(one, steps, bad))), None)
    false = sum(not all(_hits(one, steps, bad)) for _, one in told)
    stop = next(((one.poses, one.stop) for _, one in told if one.stop.now), None)
    right = "pass" if true_mm <= most else "fail"
    return {
        "game": game, "blunder": bad, "told": first, "false": false,
        "late": None if first is None or bad is None else _poses(steps, bad, first),
        "ratio": most / true_mm, "right": right,
        "stop": None if stop is None else {"poses": stop[0], "text": stop[1].text,
                                           "saved": stop[1].saved_poses,
                                           "right": stop[1].text.endswith(right)},
    }  # fmt: skip


def _true(campaign: Campaign, truth: Mapping[str, Any]) -> float:
    """Deflection J c J' f of the load point at the test pose [m], J by central differences."""
    robot, f = campaign.robot, np.array(FORCE_N)
    q = np.where(robot.prismatic, Q, np.deg2rad(Q))
    point = np.array(truth["tool"]["load_point"])[None]
    there = [
        configure(robot, q + way * STEP * np.eye(robot.n)).points(point)[:, 0] for way in (1, -1)
    ]
    J = (there[0] - there[1]).T / (2 * STEP)
    stiffness = np.array([one["value"] for one in truth["stiffness"]])
    return float(np.linalg.norm(J @ (J.T @ f / stiffness)))


def _spoil(steps: list[list[str]], rng: np.random.Generator) -> int:
    """A loaded reading of a target off by a random step; which step it is of."""
    loaded = [k for k, step in enumerate(steps) if "_loaded" in step[0] and step[0][4:6] >= "03"]
    k = int(rng.choice(loaded))
    j = int(rng.choice([j for j, line in enumerate(steps[k]) if line.split(",")[1][:2] in TARGETS]))
    group, target, *xyz, time = steps[k][j].split(",")
    way = rng.standard_normal(3)
    way *= np.exp(rng.uniform(*np.log(SIZE_M))) / np.linalg.norm(way)
    moved = [f"{float(x) + d:.4f}" for x, d in zip(xyz, way, strict=True)]
    steps[k][j] = ",".join([group, target, *moved, time])
    return k


TARGETS = ("P1", "P2", "P3")


def _hits(update: Any, steps: list[list[str]], bad: int | None) -> list[bool]:
    """Of each suspect, whether it is the blunder."""
    group = None if bad is None else steps[bad][0].partition(",")[0]
    return [one.where.partition("/")[0] == group for one in update.suspects]


def _poses(steps: list[list[str]], bad: int, told: int) -> int:
    """How many poses later it was told; 0 within its own."""
    return int(steps[told][0][4:6]) - int(steps[bad][0][4:6])


def summary(games: list[dict[str, Any]]) -> str:
    """Counts with 95 % intervals."""
    spoilt = [one for one in games if one["blunder"] is not None]
    clean = [one for one in games if one["blunder"] is None]
    ended = [one["stop"] for one in games if one["stop"]]
    far = [one for one in games if not 0.8 < one["ratio"] < 1.25]
    saved = [one["stop"]["saved"] if one["stop"] else 0 for one in far]
    counts = {
        "blunders told within their pose": [one["late"] == 0 for one in spoilt],
        "blunders told within two poses": [one["late"] in (0, 1, 2) for one in spoilt],
        "clean campaigns with a false alarm": [one["false"] > 0 for one in clean],
        "decisions right where it said stop": [one["right"] for one in ended],
    }
    out = [f"{what}: {share(hits)}" for what, hits in counts.items()]
    if saved:
        out.append(f"poses saved, tolerance off by a quarter and more: median {np.median(saved):g}")
    return "\n".join(out)


def main() -> None:
    """Play what is missing, and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--games", type=int, default=100)
    asked = parser.parse_args()
    text = asked.file.read_text() if asked.file.exists() else ""
    games = [json.loads(line) for line in text.splitlines()]
    done = {one["game"] for one in games}
    with asked.file.open("a") as out:
        for game in range(asked.games):
            if game not in done:
                games.append(play(game))
                print(json.dumps(games[-1]), file=out, flush=True)  # into the file
    print(summary(games))  # a command of the bench


if __name__ == "__main__":
    main()
