"""Coverage of the stated intervals under every verdict, and false alarms of wear due to causes.

The stiffnesses at the top of result.json are those of the model that the verdict recommends; those
of the joint springs alone, on the data as given, are listed as well. Machines, causes and campaigns
are the league's, so the truth is known.

- Coverage: campaigns with one cause, with none and with a blunder in the raw files, counted by
  their verdict, until there are enough of each.
- Alarms: two campaigns of one robot, the first with a cause that was explained. The effect of the
  cause must not look like wear, and wear must still be found.

ANSWER_LOG names the file of finished games, one line of JSON each; an interrupted run is continued
from it.
"""

from __future__ import annotations

import json
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from bench.league.hidden import SECRETS
from bench.league.hidden_effect import NOMINAL
from bench.league.judge import label
from bench.league.play import NAMES, Plan, Rules, drawn, play
from bench.league.run import ABLE, PLANS, answer_of, largest, yardstick
from pipeline.answer.contract import Stiffness
from pipeline.base import files
from pipeline.base.arrays import Array
from pipeline.fleet.history import Change, changes
from pipeline.machine.robot import Robot, load
from pipeline.service.executor import InProcesses
from pipeline.simulate.blunders import INCH_M, KGF_N
from pipeline.store.campaign import code_version

SEED = 2030
TARGETS = {"explained": 200, "ambiguous": 100, "bad_data": 100, "adequate": 100}
"""Number of campaigns wanted with each verdict."""
MOST = 2500
"""Maximum number of games for coverage, including those whose cause would need an implausible
size."""
ROUND = 16
"""Number of games of one kind that are distributed together."""
TIMES = {"planted": (2.0,), "doubtful": (1.0, 0.7), "spoiled": (2.0,), "clean": ()}
"""Kinds of games: size of the cause relative to the smallest identifiable one."""
FEEDS = {
    "planted": "explained",
    "doubtful": "ambiguous",
    "spoiled": "bad_data",
    "clean": "adequate",
}
"""Verdict for which games of a kind are played."""
ROBOTS = 100
SOFTER = 0.05
"""Wear of one joint, relative to its stiffness [1]."""
TRIES = 30
"""Maximum number of campaigns tried to obtain a verdict; the cause changes after every third."""

LISTS = {"stiffness": "top level", "joint_springs": "joint springs"}
ENTRY = ("name", "value", "std", "ci95", "identifiable", "compliance", "compliance_std")
Json = dict[str, Any]
Row = tuple[str, float, str]


@dataclass(frozen=True)
class Job:
    """One game for coverage (`kind` of `TIMES`), or the campaigns of one `robot`."""

    kind: str
    number: int

    @property
    def key(self) -> str:
        """Its name in the log."""
        return f"{self.kind}-{self.number}"

    def seed(self, *more: int) -> tuple[int, ...]:
        """Seed of what is drawn for it; `more` distinguishes its draws."""
        return (SEED, [*TIMES, "robot"].index(self.kind), self.number, *more)


def run() -> Iterable[Row]:
    """Coverage by verdict, for both lists of stiffnesses; then false alarms and detected wear."""
    path = Path(os.environ.get("ANSWER_LOG", "data/processed/bench-answer.jsonl"))
    kept = _kept(path)
    some = partial(_played, kept=kept, path=path)
    yield from coverage_rows(_enough(some))
    yield from alarm_rows(some([Job("robot", number) for number in range(ROBOTS)]))


# --- games on disk --------------------------------------------------------------------------------


def _kept(path: Path) -> dict[str, Json]:
    """Games of an earlier run by key, without an incomplete last line."""
    if not path.is_file():
        return {}
    whole = path.read_text("utf-8").split("\n")[:-1]
    games = [json.loads(line) for line in whole]
    if any((game["code"], game["seed"]) != (code_version(), SEED) for game in games):
        sys.exit(
            f"{path} holds games of other code or of another seed; remove it to start anew, or "
            "name another file in ANSWER_LOG"
        )
    files.write(path, "".join(f"{line}\n" for line in whole).encode())
    return {game["key"]: game for game in games}


def _played(jobs: Sequence[Job], kept: dict[str, Json], path: Path) -> list[Json]:
    """Games in the order of the jobs; those not in the log are played."""
    left = [job for job in jobs if job.key not in kept]
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as out:
        for done in InProcesses().results(game_of, left):
            game = done.result
            if game["code"] != code_version():
                sys.exit("the code changed while games were played; start again")
            line = json.dumps(game, allow_nan=False)
            out.write(f"{line}\n")
            out.flush()
            kept[game["key"]] = json.loads(line)
    return [kept[job.key] for job in jobs]


def _enough(some: Callable[[Sequence[Job]], list[Json]]) -> list[Json]:
    """Rounds of games until each verdict has its number, independent of the number of processes."""
    games: list[Json] = []
    next_of = dict.fromkeys(FEEDS, 0)
    while len(games) < MOST:
        count = Counter(game["verdict"] for game in games)
        asked = [kind for kind, verdict in FEEDS.items() if count[verdict] < TARGETS[verdict]]
        if not asked:
            break
        games += some([Job(kind, next_of[kind] + i) for i in range(ROUND) for kind in asked])
        next_of |= {kind: next_of[kind] + ROUND for kind in asked}
    return games


def game_of(job: Job) -> Json:
    """One line of the log, independent of process and order."""
    played = robot_game if job.kind == "robot" else coverage_game
    return {"key": job.key, "code": code_version(), "seed": SEED, **played(job)}


# --- coverage: games ------------------------------------------------------------------------------


def coverage_game(job: Job) -> Json:
    """One campaign: what was planted, the truth, and the values of the answer."""
    robot, hidden, blunder = load("kr500_rail"), "", ""
    steps = TIMES[job.kind]
    if job.kind == "spoiled":
        blunder = list(BLUNDERS)[job.number % len(BLUNDERS)]
        steps = steps if job.number // len(BLUNDERS) % 2 else ()
    if steps:
        hidden = ABLE[job.number % len(ABLE)]
    times = steps[job.number % len(steps)] if steps else 0.0
    plan, size = (
        sized(robot, hidden, times, job.number // len(ABLE)) if hidden else (_plan(job, robot), 0.0)
    )
    game = {"cause": hidden, "times": times, "blunder": blunder, "size": size}
    if size is None:
        return game | {"verdict": "too large"}
    secrets = [(SECRETS[hidden], size)] if hidden else []
    played = play(robot, plan, secrets, np.random.default_rng(job.seed(0)))
    raw = played.files
    if blunder:
        raw = raw | BLUNDERS[blunder](raw, np.random.default_rng(job.seed(1)))
    return game | {"truth": played.truth["stiffness"]} | stated(answer_of(raw))


def _plan(job: Job, robot: Robot, *more: int) -> Plan:
    return drawn(robot, np.random.default_rng(job.seed(2, *more)), Rules())


def sized(robot: Robot, cause: str, times: float, turn: int) -> tuple[Plan, float | None]:
    """One of the shared plans, and the size of the cause for it [typical sizes].

    Args:
        robot: The KR500 on its rail.
        cause: Label of the hidden cause.
        times: Size relative to the smallest identifiable one.
        turn: How often all causes have been used; it selects the plan.

    Returns:
        The plan and the size, which is None if it would be implausibly large.
    """
    seed = (SEED, 9, (5 * ABLE.index(cause) + turn) % PLANS)
    size = times * yardstick(seed, Rules()).named.get(cause, np.inf)
    plan = drawn(robot, np.random.default_rng(seed), Rules())
    return plan, size if size <= largest(robot).get(cause, np.inf) else None


def stated(answer: Mapping[str, Any] | None) -> Json:
    """Part of result.json that is kept: verdict, names and both lists of stiffnesses."""
    if answer is None:
        return {"verdict": "refused"}
    diagnosis = answer["diagnosis"]
    springs = answer.get("joint_springs") or answer
    return {
        "verdict": diagnosis["verdict"],
        "named": [label(cause) for cause in diagnosis["causes"]],
        "recommended": answer.get("recommended"),
        "stiffness": _entries(answer["stiffness"]),
        "joint_springs": _entries(springs["stiffness"]),
    }


def _entries(stiffness: Sequence[Mapping[str, Any]]) -> list[Json]:
    return [{name: entry[name] for name in ENTRY} for entry in stiffness]


# --- coverage: blunders in the raw files ----------------------------------------------------------

Files = Mapping[str, bytes]
Cells = list[list[str]]


def _edited(raw: Files, file: str, edit: Callable[[Cells], None]) -> dict[str, bytes]:
    """A table with its cells changed; columns and line ends are unchanged."""
    head, *lines = raw[file].decode().splitlines()
    cells = [line.split(",") for line in lines]
    edit(cells)
    return {file: "".join(f"{line}\n" for line in [head, *map(",".join, cells)]).encode()}


def _tracker_in(raw: Files, rng: np.random.Generator, unit_m: float) -> dict[str, bytes]:
    """Label the tracker's columns as millimetres although they contain another unit."""

    def edit(cells: Cells) -> None:
        for row in cells:
            row[2:5] = [f"{1e-3 * float(value) / unit_m:.7f}" for value in row[2:5]]

    return _edited(raw, "tracker.csv", edit)


def _loads_in_kgf(raw: Files, rng: np.random.Generator) -> dict[str, bytes]:
    """Give the loads in kilograms-force."""

    def edit(cells: Cells) -> None:
        for row in cells:
            row[2] = f"{float(row[2]) / KGF_N:.2f}"

    return _edited(raw, "loads.csv", edit)


def _shifted_reading(raw: Files, rng: np.random.Generator) -> dict[str, bytes]:
    """Shift one reading, of any reflector, by 0.5 to 5 mm in a random direction."""

    def edit(cells: Cells) -> None:
        row, off = cells[rng.integers(len(cells))], rng.standard_normal(3)
        off *= rng.uniform(0.5, 5.0) / np.linalg.norm(off)
        row[2:5] = [f"{float(value) + d:.4f}" for value, d in zip(row[2:5], off, strict=True)]

    return _edited(raw, "tracker.csv", edit)


def _swapped_targets(raw: Files, rng: np.random.Generator) -> dict[str, bytes]:
    """Exchange the names of two reflectors in one group."""

    def edit(cells: Cells) -> None:
        group = rng.choice([row[0] for row in cells if row[1] == NAMES[0]])
        one, other = rng.choice(NAMES, 2, replace=False).tolist()
        for row in cells:
            if row[0] == group:
                row[1] = {one: other, other: one}.get(row[1], row[1])

    return _edited(raw, "tracker.csv", edit)


def _reversed_pull(raw: Files, rng: np.random.Generator) -> dict[str, bytes]:
    """Exchange the names of the two chain reflectors in one pull."""

    def edit(cells: Cells) -> None:
        group = rng.choice([row[0] for row in cells if row[1] == "Pl1"])
        for row in cells:
            if row[0] == group:
                row[1] = {"Pl1": "Pl2", "Pl2": "Pl1"}.get(row[1], row[1])

    return _edited(raw, "tracker.csv", edit)


def _wrong_digit(raw: Files, rng: np.random.Generator) -> dict[str, bytes]:
    """Change one digit of one load, that of thousands or hundreds of newtons."""

    def edit(cells: Cells) -> None:
        row = cells[rng.integers(len(cells))]
        at = int(rng.integers(row[2].index(".") - 2))
        others = [digit for digit in "0123456789" if digit != row[2][at]]
        row[2] = row[2][:at] + str(rng.choice(others)) + row[2][at + 1 :]

    return _edited(raw, "loads.csv", edit)


def _lost_sign(raw: Files, rng: np.random.Generator) -> dict[str, bytes]:
    """Change the sign of one joint angle of one pose."""

    def edit(cells: Cells) -> None:
        row, joint = cells[rng.integers(len(cells))], int(rng.integers(2, 8))
        row[joint] = f"{-float(row[joint]):.6f}"

    return _edited(raw, "joints.csv", edit)


BLUNDERS: dict[str, Callable[[Files, np.random.Generator], dict[str, bytes]]] = {
    "tracker in inches": partial(_tracker_in, unit_m=INCH_M),
    "loads in kgf": _loads_in_kgf,
    "shifted reading": _shifted_reading,
    "swapped targets": _swapped_targets,
    "reversed pull": _reversed_pull,
    "tracker in metres": partial(_tracker_in, unit_m=1.0),
    "wrong digit": _wrong_digit,
    "lost sign": _lost_sign,
}
"""Blunders between cell and folder: functions from raw files to spoiled ones."""


# --- coverage: counted ----------------------------------------------------------------------------


def coverage_rows(games: Sequence[Json]) -> Iterator[Row]:
    """Rows of the first part."""
    said = Counter(game["verdict"] for game in games)
    yield "games", len(games), ", ".join(f"{n} {verdict}" for verdict, n in said.most_common())
    for verdict in TARGETS:
        some = [game for game in games if game["verdict"] == verdict]
        if not some:
            yield f"{verdict}: campaigns", 0, ""
            continue
        kinds = Counter(_planted(game) for game in some)
        yield f"{verdict}: campaigns", len(some), _listed(kinds)
        for which, words in LISTS.items():
            yield from _covered_rows(f"{verdict}, {words}", some, which)
        wider = [ratio for game in some for ratio in _wider(game)]
        yield (
            f"{verdict}: width, top level over joint springs",
            float(np.median(wider)) if wider else np.nan,
            f"median of {len(wider)} joints with both limits in both",
        )
    adequate = [game for game in games if game["verdict"] == "adequate"]
    for what in ("nothing hidden", "one cause"):
        some = [game for game in adequate if _planted(game) == what]
        held = [hit for game in some for hit in _held(game, "stiffness")]
        yield f"adequate, {what}: intervals hold the truth", *_share(held, "intervals")
    yield from _worst_causes([game for game in games if game["verdict"] == "explained"])


def _planted(game: Json) -> str:
    cause = "one cause" if game["cause"] else "nothing hidden"
    return f"{cause} and a blunder" if game["blunder"] else cause


def _listed(count: Counter[str]) -> str:
    return ", ".join(f"{n} {what}" for what, n in count.most_common())


def _covered_rows(what: str, games: Sequence[Json], which: str) -> Iterator[Row]:
    held = [hit for game in games for hit in _held(game, which)]
    some = [_has(entry) for game in games for entry in game[which]]
    half = sum(None in e["ci95"] for game in games for e in game[which] if _has(e))
    far = [worst for game in games if (worst := _farthest(game, which)) is not None]
    yield (
        f"{what}: 95 % intervals hold the truth",
        *_share(held, f"intervals, {half} of them with one limit"),
    )
    yield f"{what}: joints with a stiffness", *_share(some, "joints")
    yield (
        "  worst joint of a campaign [std], 95 % of campaigns below",
        float(np.quantile(far, 0.95)) if far else np.nan,
        "2.7 for seven independent normal errors",
    )


def _has(entry: Json) -> bool:
    """Whether a joint has an interval, with one or two limits."""
    return entry["identifiable"] and entry["ci95"] != [None, None]


def _held(game: Json, which: str) -> list[bool]:
    """For each joint with an interval, whether it contains the truth; a missing limit is infinite.

    A strut in parallel to the shoulder's gear adds stiffness, in part constant, that no pull can
    separate from the gear's; the true value of that joint is then a matter of definition, and it is
    left out.
    """
    return [
        (entry["ci95"][0] or 0.0) <= true <= (entry["ci95"][1] or np.inf)
        for entry, true in zip(game[which], game["truth"], strict=True)
        if _has(entry) and (game["cause"], entry["name"]) != ("compensator", "k_theta3")
    ]


def _farthest(game: Json, which: str) -> float | None:
    """Largest error of a stiffness relative to its standard uncertainty."""
    far = [
        abs(entry["value"] - true) / entry["std"]
        for entry, true in zip(game[which], game["truth"], strict=True)
        if entry["value"] is not None
    ]
    return max(far, default=None)


def _wider(game: Json) -> list[float]:
    """Relative width of the interval at the top level over that of the joint springs alone."""
    return [
        _width(one) / _width(other)
        for one, other in zip(game["stiffness"], game["joint_springs"], strict=True)
        if all(e["value"] is not None and None not in e["ci95"] for e in (one, other))
    ]


def _width(entry: Json) -> float:
    low, high = entry["ci95"]
    return (high - low) / entry["value"]


def _worst_causes(games: Sequence[Json]) -> Iterator[Row]:
    """Coverage at the top level by cause, the three lowest."""
    held: dict[str, list[bool]] = {}
    for game in games:
        held.setdefault(game["cause"] or "nothing", []).extend(_held(game, "stiffness"))
    told = {cause: hits for cause, hits in held.items() if hits}
    for cause in sorted(told, key=lambda name: np.mean(told[name]))[:3]:
        yield f"explained, among the lowest: {cause}", *_share(told[cause], "intervals")


def _share(hits: Sequence[bool], what: str, aim: str = "") -> tuple[float, str]:
    """A fraction, and its 95 % interval by Clopper and Pearson."""
    if not hits:
        return np.nan, f"of 0 {what}"
    test = stats.binomtest(sum(hits), len(hits))
    low, high = test.proportion_ci(0.95, method="exact")
    return float(np.mean(hits)), f"{aim}{low:.3f} to {high:.3f}, of {len(hits)} {what}"


# --- alarms ---------------------------------------------------------------------------------------


def robot_game(job: Job) -> Json:
    """Campaigns of one robot: with a cause, without, later, and later with one joint softer."""
    robot, rules, joint = load("kr500_rail"), Rules(), job.number % len(NOMINAL)
    rng = np.random.default_rng(job.seed(0))
    true = 1 / NOMINAL * rng.uniform(1 - rules.spread, 1 + rules.spread, robot.n)
    worn = true * np.where(np.arange(robot.n) == joint, 1 - SOFTER, 1.0)
    return {
        "joint": joint,
        "explained": _explained(job, robot, true),
        "adequate": _adequate(job, robot, true, 1),
        "same": _adequate(job, robot, true, 2),
        "worn": _adequate(job, robot, worn, 2),
    }


def _explained(job: Job, robot: Robot, stiffness: Array) -> Json | None:
    """The first campaign with an explained cause; None if all tries fail."""
    for attempt in range(TRIES):
        cause = ABLE[(job.number + attempt // 3) % len(ABLE)]
        plan, size = sized(robot, cause, 2.0, job.number + attempt)
        if size is None:
            continue
        rng = np.random.default_rng(job.seed(3, attempt))
        made = play(robot, plan, [(SECRETS[cause], size)], rng, stiffness=stiffness)
        said = stated(answer_of(made.files))
        if said["verdict"] == "explained":
            return said | {"cause": cause, "attempt": attempt}
    return None


def _adequate(job: Job, robot: Robot, stiffness: Array, which: int) -> Json | None:
    """The first clean campaign with the verdict adequate; None if all tries fail.

    Args:
        job: The robot's job.
        robot: The KR500 on its rail.
        stiffness: True stiffnesses.
        which: Number of the series of plans and noise, the same for worn and unworn robot.
    """
    for attempt in range(TRIES):
        plan = _plan(job, robot, which, attempt)
        rng = np.random.default_rng(job.seed(4, which, attempt))
        said = stated(answer_of(play(robot, plan, [], rng, stiffness=stiffness).files))
        if said["verdict"] == "adequate":
            return said | {"attempt": attempt}
    return None


def alarm_rows(games: Sequence[Json]) -> Iterator[Row]:
    """Rows of the second part."""
    for first in ("explained", "adequate"):
        for which, words in LISTS.items():
            what, aim = f"{first} first, {words}", "aim <= 0.02; "
            sound = [_changes(game, first, "same", which) for game in games if _both(game, first)]
            alarms = [any(change.sure for change in found) for found in sound]
            yield f"{what}: false alarm", *_share(alarms, "pairs", aim)
            worn = [
                _softer(_changes(game, first, "worn", which)[game["joint"]])
                for game in games
                if _both(game, first, "worn")
            ]
            yield (
                f"{what}: {100 * SOFTER:g} % softer joint found",
                *_share(worn, "pairs, joints in turn"),
            )


def _both(game: Json, first: str, second: str = "same") -> bool:
    return game[first] is not None and game[second] is not None


def _changes(game: Json, first: str, second: str, which: str) -> list[Change]:
    before, after = (
        [Stiffness.model_construct(**entry) for entry in game[name][which]]  # with what was kept
        for name in (first, second)
    )
    return changes(before, after)


def _softer(change: Change) -> bool:
    return change.sure and (change.sigmas or 0.0) > 0
