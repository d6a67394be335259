"""Campaigns judged while they are measured: blunders told at once, no alarm without one, the end.

    python -m bench.live FILE --games 100

Each campaign is a virtual one of the demo's plan. Another program (bench/instrument.py) writes it
into a folder step by step, every third campaign by writing the whole export anew; the folder is
looked at while half a line, or half a file, is there, and after every pose; about a blunder after
every step. Every other campaign has a blunder of one reading from the third pose on, in a random
direction, 0.3 to 3 mm. How many standard uncertainties it moves its residual by when it is read,
and pose by pose later, is computed from the truth. The tolerance is drawn beside the true
deflection at the test pose. Games that stand in FILE are not played again.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.exam import JSON, Kept, code_of, package
from bench.league.table import share
from pipeline import identify, load_campaign, simulate_campaign
from pipeline.library.campaign import Campaign
from pipeline.live.complete_lines import snapshot
from pipeline.live.update import Update
from pipeline.live.updates import QUIET_S, LiveState
from pipeline.machine.robot import Robot, configure

SEEDS = 7_000_000
"""Seed of the first game; no other benchmark uses seeds from here on."""

SIZE_M = (0.3, 3.0)
"""Range of the size of blunders [mm]."""

BESIDE = (0.5, 2.0)
"""Range of the tolerance relative to the true deflection [1]."""

Q, FORCE_N = [8.5, -10.0, 35.0, 39.0, 81.0, 22.0, -10.0], [-124.5, -175.4, -209.1]
"""The demo's test pose [m], [deg], and its force [N]."""

STEP = 1e-6
"""Step of a central difference [m or rad]."""


SIGMA_M = 3e-5
"""Noise of a reading per axis [m], as stated by the campaign."""

VISIBLE = 7.0
"""Size of a blunder from which it must be reported, as the shift of its residual in standard
uncertainties [1]."""

TARGETS = ("P1", "P2", "P3")


@dataclass(frozen=True)
class Blunder:
    """A wrong reading.

    Attributes:
        step: Step of the measurement.
        target: Name of the target.
        line: Line in the export.
        off_m: Error [m], F_b.
    """

    step: int
    target: str
    line: int
    off_m: np.ndarray


def play(game: int) -> dict[str, Any]:
    """One campaign: what was reported, and when."""
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
    bad = _spoil(steps, base, made.campaign, rng) if game % 2 else None
    sizes = _sizes(made, steps, bad) if bad else {}
    with tempfile.TemporaryDirectory() as place, instrument(Path(place)) as write:
        folder = Path(place)
        head, *loads = files.pop("loads.csv").decode().splitlines(keepends=True)
        files |= {"loads.csv": head.encode(), "tracker.csv": "".join([titles, *base]).encode()}
        for name, data in files.items():
            (folder / name).write_bytes(data)
        how = "append" if game % 3 else "rewrite"
        told = list(_fed(folder, write, steps, loads, bad, how, rng))
        result = identify(load_campaign(snapshot(folder), name="hall"))
    end = told[-1][1]
    here = "" if bad is None else f"tracker.csv:{bad.line}"
    first = next((k for k, one in told if any(_hits(one, here))), None)
    false = sum(not all(_hits(one, here)) for _, one in told)
    stop = next(((one.poses, one.stop) for _, one in told if one.stop.now), None)
    right = "pass" if true_mm <= most else "fail"
    u = 1e-3 * float((result.answer.test_pose and result.answer.test_pose.std_mm) or np.nan)
    return {
        "game": game, "how": how, "blunder": None if bad is None else bad.step, "told": first,
        "sizes": sizes, "false": false, "poses": len({step[0][:6] for step in steps}),
        "end": [one.value for one in end.stiffness] == [one.value for one in result.stiffness]
        and end.verdict == result.verdict and end.searched,
        "away": abs(most - true_mm) / (1e3 * u), "ratio": most / true_mm, "right": right,
        "stop": None if stop is None else {"poses": stop[0], "text": stop[1].text,
                                           "saved": stop[1].saved_poses,
                                           "right": stop[1].text.endswith(right)},
    }  # fmt: skip


@contextmanager
def instrument(folder: Path) -> Iterator[Any]:
    """The writing program as a function of file, text and mode; it pauses half way once."""
    command = [sys.executable, "-m", "bench.instrument", str(folder)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:

        def write(file: str, text: str, how: str, half_way: Any = None) -> None:
            process.stdin.write(json.dumps({"file": file, "text": text, "how": how}) + "\n")
            process.stdin.flush()
            assert process.stdout.readline() == "half\n"
            if half_way is not None:
                half_way()
            process.stdin.write("\n")
            process.stdin.flush()
            assert process.stdout.readline() == "whole\n"

        yield write
        process.stdin.close()


def _fed(
    folder: Path,
    write: Any,
    steps: list[list[str]],
    loads: list[str],
    bad: Blunder | None,
    how: str,
    rng: np.random.Generator,
) -> Iterator[tuple[int, Update]]:
    """Updates, each with the step after which it occurred."""
    state, forces = LiveState("hall"), iter(loads)
    torn = int(rng.integers(len(steps)))  # the whole file is examined half written at this step
    for k, step in enumerate(steps):
        if "_loaded" in step[0]:
            write("loads.csv", next(forces), "append")
        told: list[Update | None] = []
        last = k + 1 == len(steps) or steps[k + 1][0][:6] != step[0][:6]
        near = bad is not None and abs(k - bad.step) <= 1
        looked = last or near or k == torn

        def look(k: int = k, told: list[Update | None] = told) -> None:
            told.append(state.look(snapshot(folder), 8.0 * k))

        half = look if looked and (how == "append" or k == torn) else None
        write("tracker.csv", "".join(step), how, half)
        if looked:
            told.append(state.look(snapshot(folder), 8.0 * k + 4.0))
        yield from ((k, one) for one in told if one is not None)
    if (late := state.look(snapshot(folder), 8.0 * k + 2 * QUIET_S)) is not None:
        yield k, late


def _true(campaign: Campaign, truth: Mapping[str, Any]) -> float:
    """Deflection |J c J' f| of the load point at the test pose [m]."""
    robot, f = campaign.robot, np.array(FORCE_N)
    q = np.where(robot.prismatic, Q, np.deg2rad(Q))
    J = _jacobians(robot, q, np.array([truth["tool"]["load_point"]]))[0]
    stiffness = np.array([one["value"] for one in truth["stiffness"]])
    return float(np.linalg.norm(J @ (J.T @ f / stiffness)))


def _jacobians(robot: Robot, q: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Derivatives of points of the flange by the joints, by central differences, (t, 3, n)."""
    there = [configure(robot, q + way * STEP * np.eye(robot.n)).points(points) for way in (1, -1)]
    return np.moveaxis((there[0] - there[1]) / (2 * STEP), 0, -1)


def _spoil(
    steps: list[list[str]], base: list[str], campaign: Campaign, rng: np.random.Generator
) -> Blunder:
    """Spoil the loaded reading of a target at a random step."""
    loaded = [k for k, step in enumerate(steps) if "_loaded" in step[0] and step[0][4:6] >= "03"]
    k = int(rng.choice(loaded))
    j = int(rng.choice([j for j, line in enumerate(steps[k]) if line.split(",")[1] in TARGETS]))
    group, target, *xyz, time = steps[k][j].split(",")
    way = rng.standard_normal(3)
    way *= np.exp(rng.uniform(*np.log(SIZE_M))) / np.linalg.norm(way)
    moved = [f"{float(x) + d:.4f}" for x, d in zip(xyz, way, strict=True)]
    steps[k][j] = ",".join([group, target, *moved, time])
    before = 1 + len(base) + sum(len(step) for step in steps[:k]) + j
    return Blunder(k, target, before + 1, 1e-3 * _turn(base, campaign) @ way)


def _turn(base: list[str], campaign: Campaign) -> np.ndarray:
    """Rotation from the tracker's frame to F_b, by the base reflectors (Kabsch)."""
    said = campaign.raw.settings.base_frame
    rows = [line.split(",") for line in base]
    seen = np.array([[float(x) for x in row[2:5]] for row in rows])
    known = np.array([said[row[1]] for row in rows])
    U, _, V = np.linalg.svd((seen - seen.mean(0)).T @ (known - known.mean(0)))
    D = np.diag([1.0, 1.0, np.sign(np.linalg.det(V.T @ U.T))])
    return V.T @ D @ U.T


def _sizes(made: Any, steps: list[list[str]], bad: Blunder) -> dict[str, float]:
    """Shift of the blunder's residual in standard uncertainties, at its step and pose ends.

    lambda^2 = d' (P / sigma^2) d of its three coordinates, where P projects out the unknowns: a
    compliance of each joint, and the unloaded position of each target in each pose. Errors of
    forces are neglected.
    """
    robot, tool = made.campaign.robot, made.truth["tool"]
    names = made.campaign.files["joints.csv"].decode().splitlines()[1:]
    q = {int(r.split(",")[0]): np.array([float(x) for x in r.split(",")[1:8]]) for r in names}
    forces = {(one["pose"], one["repeat"]): np.array(one["force_n"]) for one in made.truth["pulls"]}
    rows, unloaded, mine, ends = [], [], None, {}
    for k, step in enumerate(steps):
        pose, repeat = int(step[0][4:6]), int(step[0][10])
        at = np.where(robot.prismatic, q[pose], np.deg2rad(q[pose]))
        J = _jacobians(robot, at, np.array([tool[name] for name in ("load_point", *TARGETS)]))
        f = forces.get((pose, repeat), np.zeros(3))
        if k == bad.step:
            mine = len(rows) + 3 * TARGETS.index(bad.target)
        rows += [*(J[1:] * (J[0].T @ f)).reshape(9, -1)]
        unloaded += [9 * (pose - 1) + i for i in range(9)]
        last = k + 1 == len(steps) or steps[k + 1][0][:6] != step[0][:6]
        if mine is not None and (last or k == bad.step):
            B = np.array(rows)
            scale = np.abs(B).max(axis=0)
            Q = np.linalg.qr(
                np.hstack([B / np.where(scale > 0, scale, 1), np.eye(9 * pose)[unloaded]])
            )[0]
            part = Q[mine : mine + 3]
            left = bad.off_m @ (np.eye(3) - part @ part.T) @ bad.off_m
            ends[str(k)] = float(np.sqrt(left) / SIGMA_M)
    return ends


def _hits(update: Update, line: str) -> list[bool]:
    """For each suspect, whether the blunder is among its lines."""
    return [line in one.readings for one in update.suspects]


def _pose_of(step: int) -> int:
    """Pose of a step; each pose has five."""
    return step // 5


def _in_time(one: dict[str, Any], visible: int, poses: int) -> bool:
    """Whether it was reported at most `poses` poses after it became visible."""
    told = one["told"]
    return told is not None and _pose_of(told) - _pose_of(visible) <= poses


def summary(games: list[dict[str, Any]]) -> str:
    """Counts with 95 % intervals."""
    spoilt = [one for one in games if one["blunder"] is not None]
    clean = [one for one in games if one["blunder"] is None]
    ended = [one["stop"] for one in games if one["stop"]]
    when = [
        (one, min((int(k) for k, size in one["sizes"].items() if size >= VISIBLE), default=None))
        for one in spoilt
    ]
    far = [one for one in games if one["away"] >= 2]
    saved = [one["stop"]["saved"] / one["poses"] if one["stop"] else 0.0 for one in far]
    counts = {
        "blunders of 7 sigma at the time of reading told at once": [
            one["told"] == one["blunder"] for one, seen in when if seen == one["blunder"]
        ],
        "those that later poses show told within two poses of it": [
            _in_time(one, seen, 2) for one, seen in when if seen not in (None, one["blunder"])
        ],
        "clean campaigns with a false alarm": [one["false"] > 0 for one in clean],
        "campaigns with a blunder in which another reading was suspected too": [
            one["false"] > 0 for one in spoilt
        ],
        "decisions right where it said stop": [one["right"] for one in ended],
        "the end is the run": [one["end"] for one in games],
    }
    out = [f"{what}: {share(hits)}" for what, hits in counts.items() if hits]
    if saved:
        out.append(
            f"poses saved, tolerance 2 u and more away ({len(far)} games): "
            f"median {100 * np.median(saved):.0f} %"
        )
    return "\n".join(out)


def main() -> None:
    """Play the missing games, and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--games", type=int, default=100)
    asked = parser.parse_args()
    kept = Kept(asked.file, code_of([*package("report"), Path(__file__)]), JSON)
    games = kept.rows()
    for game in range(asked.games):
        if str(game) not in games:
            games[str(game)] = play(game)
            kept.add(str(game), games[str(game)])
    print(summary(list(games.values())))  # a command of the bench


if __name__ == "__main__":
    main()
