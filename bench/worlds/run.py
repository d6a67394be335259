"""Games of the worlds: drawn from their seeds, played in several processes, kept as they finish."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar
from zlib import crc32

import numpy as np
import pandas as pd
from pydantic import ConfigDict, TypeAdapter

from bench import exam
from bench.exam import Kept, code_of, package
from bench.exam import seeds as seeds_of
from bench.league import judge as league
from bench.league.hidden import SECRETS
from bench.league.hidden_effect import Secret
from bench.league.run import ABLE, largest, shown_in
from bench.worlds.cell import Cell, build
from bench.worlds.files import line, raw
from bench.worlds.judge import Json, Judged, Spoilt, Truth, forces_doubted, judged, shift
from bench.worlds.payloads import departs
from bench.worlds.visible import Adjustment, from_table
from bench.worlds.worlds import WORLDS, World
from pipeline.base.arrays import Array
from pipeline.base.errors import PipelineError
from pipeline.diagnosis.isolability import twins
from pipeline.machine.robot import load
from pipeline.reduction.bring import conformed
from pipeline.run import campaign_answer
from pipeline.service.executor import Executor
from pipeline.store.campaign import in_memory

SEEDS = Path(__file__).with_name("seeds.txt")
"""One integer per game; game k of every world has the k-th."""

SHELL = ("app", "report", "design")
"""Folders of the package that do not contribute to an answer."""

SHOWN = ("__init__.py", "__main__.py", "table.py", "page.py", "figures.py", "contest.py")
"""Files of the benches that display games and make none."""

TIMES = 2.0
"""Size of a hidden cause over the smallest identifiable one [1]."""


@dataclass(frozen=True)
class Fixture:
    """One game before it is played.

    Attributes:
        world: Name of the world.
        number: Position of its seed in the file, from 0.
        seed: Seed of everything.
        cause: Whether a cause of the league is hidden.
    """

    world: str
    number: int
    seed: int
    cause: bool

    @property
    def kind(self) -> str:
        """The world, with or without a cause."""
        return f"{self.world}+cause" if self.cause else self.world


@dataclass(frozen=True)
class Played:
    """A game with its result.

    Attributes:
        world: Kind of its fixture.
        seed: Seed of its fixture.
        judged: Result of the judge.
        spoilt: Readings that were spoilt.
        cause: Label of the hidden cause; empty for none.
        size: Its size, in typical sizes.
        named: Whether it was named, and nothing else (twins as one).
        sizes: True amplitudes with those of the answer.
        before: Result of the judge for the same campaign without its errors.
        moved: Changes of compliances and deflections due to the errors, in standard uncertainties.
        wrong: Payload that campaign.toml states wrong; empty for none.
        apart: Contradiction of torques and statement in standard uncertainties, expected over the
            noise; 0 without torques.
        said: For forces that are too large: whether something was reported.
        seconds: CPU time of the answer.
    """

    __pydantic_config__: ClassVar = ConfigDict(ser_json_inf_nan="constants")

    world: str
    seed: int
    judged: Judged
    spoilt: tuple[Spoilt, ...] = ()
    cause: str = ""
    size: float = 0.0
    named: bool = False
    sizes: tuple[league.Size, ...] = ()
    before: Judged | None = None
    moved: tuple[float, float] | None = None
    wrong: str = ""
    apart: float = 0.0
    said: bool = False
    seconds: float = 0.0


ROW = TypeAdapter(Played)


def fixtures(
    worlds: Sequence[str], games: int, first: int, cause: bool, seeds: Path
) -> list[Fixture]:
    """Games of these worlds, one of each in turn.

    Raises:
        InputError: The file of seeds is shorter.
    """
    every = seeds_of(seeds, first, games)
    return [
        Fixture(world, first + k, seed, cause) for k, seed in enumerate(every) for world in worlds
    ]


@cache
def code() -> str:
    """Hash of the code that makes an answer, and of the exam itself."""
    here = Path(__file__).parent
    exams = [*here.glob("*.py"), *(here.parent / "league").glob("*.py")]
    return code_of([*package(*SHELL), *(path for path in exams if path.name not in SHOWN)])


@dataclass(frozen=True, eq=False)
class Asked:
    """Answer of the pipeline for some files.

    Attributes:
        answer: result.json; None if there is none.
        outcome: answered, refused or crashed.
        message: Why there is none.
        reliability: Table of that name, if there is one.
    """

    answer: dict[str, Any] | None
    outcome: str
    message: str
    reliability: pd.DataFrame | None


def asked(content: Mapping[str, bytes]) -> Asked:
    """Answer of `pipeline run` for these files, without writing."""
    kept: dict[str, pd.DataFrame] = {}

    def keep(name: str, table: Any, promise: Any) -> pd.DataFrame:
        kept[name.partition("_")[2]] = held = conformed(name, table, promise)
        return held

    try:
        answer = campaign_answer("game", in_memory(content), keep).answer.as_json()
    except PipelineError as problem:
        return Asked(None, "refused", str(problem), None)
    except Exception as problem:  # whatever ends the command with code 1 is a finding
        return Asked(None, "crashed", f"{type(problem).__name__}: {problem}", None)
    return Asked(answer, "answered", "", kept.get("reliability"))


def played(fixture: Fixture) -> Played:
    """Play one game; the result does not depend on process or order."""
    world, seed = WORLDS[fixture.world], fixture.seed
    robot = load(world.robot)
    plan = world.plan(robot, seed)
    hidden = world.hides(robot, seed)
    if fixture.cause:
        innocent = build(robot, plan, world.rules, seed)
        hidden = (_sized(innocent, world, seed),)
    cell = build(robot, plan, world.rules, seed, hidden)
    clean, record, factor = _recorded(cell, world, seed)
    began = time.process_time()
    said = asked(_files(cell, world, record, factor))
    seconds = time.process_time() - began
    other = asked(_files(cell, world, clean, 1.0)) if world.compared else None
    spoilt = _spoilt(cell, clean, record, other)
    truth = Truth(
        stiffness=cell.stiffness.tolist(),
        deflection=None if hidden else cell.deflection(),
        spoilt=spoilt,
        secrets=tuple(secret.label for secret, _ in hidden),
        allowed=world.allowed,
        family=world.family,
        payloads=cell.payloads,
    )
    word = Judged(said.outcome, said.message)
    wrong, apart = _stated_wrong(cell)
    game = Played(fixture.kind, seed, word, spoilt, wrong=wrong, apart=apart, seconds=seconds)
    if said.answer is None:
        return game
    game = replace(game, judged=judged(truth, said.answer))
    if other is not None and other.answer is not None:
        game = _beside(game, said.answer, other.answer, truth)
    return _on_cause(game, cell, said.answer, world, hidden[0]) if hidden else game


def _stated_wrong(cell: Cell) -> tuple[str, float]:
    """The wrongly stated payload, and its distance from what the torques show."""
    for k, one in enumerate(cell.payloads):
        if one.wrong:
            under = np.flatnonzero(cell.which == k)
            far = departs(cell.one, cell.course, cell.log, one, under)[0] if cell.log else 0.0
            return one.name, far
    return "", 0.0


def _recorded(cell: Cell, world: World, seed: int) -> tuple[Array, Array, float]:
    """Record of the tracker without and with blunders [m], and the factor of the forces."""
    rng = np.random.default_rng([seed, 3, crc32(world.name.encode())])
    for_noise, for_spoil, for_factor = rng.spawn(3)
    clean = np.round(cell.local + world.errors(cell, for_noise), 7)
    record = clean.copy()
    for at, instead in world.spoil(cell.slots, clean, for_spoil).items():
        record[at] = np.round(instead, 7)
    return clean, record, float(np.exp(for_factor.uniform(*np.log(world.factors))))


def _files(cell: Cell, world: World, record: Array, factor: float) -> dict[str, bytes]:
    return raw(cell, record, world.stated, world.instrument, factor, world.timed)


def _spoilt(cell: Cell, clean: Array, record: Array, other: Asked | None) -> tuple[Spoilt, ...]:
    """The readings that differ, with the smallest detectable error of each."""
    at = np.flatnonzero((clean != record).any(axis=1))
    if not len(at):
        return ()
    table = other.reliability if other is not None else None
    own = Adjustment(cell)
    out = []
    for i in at.tolist():
        off = record[i] - clean[i]
        size = float(np.linalg.norm(off))
        way = cell.axes @ off / size
        told = None if table is None else from_table(table, line(i), way)
        visible = own.smallest(i, way) if told is None else told
        slot = cell.slots[i]
        name = f"{slot.group}/{slot.target}"
        out.append(Spoilt(name, line(i), size, visible, _companions(cell, i)))
    return tuple(out)


def _companions(cell: Cell, reading: int) -> tuple[str, ...]:
    """The reading, or if it belongs to a pull, all of that pull in both files."""
    slot = cell.slots[reading]
    if slot.state not in ("loaded", "chain"):
        return (f"tracker.csv:{line(reading)}",)
    group = [line(k) for k, other in enumerate(cell.slots) if other.group == slot.group]
    return (*(f"tracker.csv:{k}" for k in group), f"loads.csv:{line(slot.pull)}")


def _beside(game: Played, answer: Json, before: Json, truth: Truth) -> Played:
    """Add the comparison with the answer for the same campaign without its errors."""
    calm = Truth(truth.stiffness, truth.deflection, allowed=truth.allowed)
    return replace(
        game,
        before=judged(calm, before),
        moved=shift(answer, before),
        said=forces_doubted(answer, before),
    )


def _on_cause(
    game: Played, cell: Cell, answer: Json, world: World, hidden: tuple[Secret, float]
) -> Played:
    """Add the score of the league's judge, with the world's allowed causes removed."""
    said = answer["diagnosis"]
    left = [cause for cause in said["causes"] if cause["name"] not in world.allowed]
    answer = {**answer, "diagnosis": {**said, "causes": left}}
    truth = {"secrets": list(cell.amplitudes), "stiffness": cell.stiffness.tolist()}
    score = league.score(truth, answer, twins(cell.robot))
    secret, size = hidden
    right = score.right or any(secret.label in cause["twins"] for cause in left)
    return replace(game, cause=secret.label, size=size, named=right, sizes=score.sizes)


def _sized(cell: Cell, world: World, seed: int) -> tuple[Secret, float]:
    """A cause at twice the size that the campaign, with stated noise, could identify."""
    rng = np.random.default_rng([seed, 4])
    record = cell.local + world.as_stated(cell, rng)
    known, most = shown_in(_files(cell, world, record, 1.0), rng), largest(cell.robot)
    able = [name for name in ABLE if name not in world.allowed]
    sizes = {name: TIMES * known.named.get(name, np.inf) for name in able}
    sensible = [name for name in able if sizes[name] <= most.get(name, np.inf)]
    name = str(rng.choice(sensible))
    return SECRETS[name], sizes[name]


def contest(wanted: Sequence[Fixture], log: Path, executor: Executor) -> list[Played]:
    """Play what is left of these games, as `exam.contest`."""
    return exam.contest(wanted, played, _key, code, kept(log), executor)


def kept(log: Path) -> Kept[Played]:
    """Games of this code that are kept."""
    return Kept(log, code(), ROW)


def _key(fixture: Fixture) -> str:
    return f"{fixture.kind}-{fixture.seed}"
