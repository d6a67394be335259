"""The league: many games, one table, at sizes that the plan can just name, times two."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.diagnosis.isolability import Twins, twins
from pipeline.diagnosis.separability import identifiable
from pipeline.effects import catalogue
from pipeline.league.judge import Score, diagnosed, reduced, score
from pipeline.league.play import Game, Rules, drawn, play
from pipeline.league.secrets import KNOWN, STRANGE, Secret
from pipeline.robot import Robot, load
from pipeline.stages.diagnose import case_of
from pipeline.stages.estimate import identify

TOO_LARGE = 12.0
"""Sizes beyond this many typical ones are no fault that anybody would live with."""

NEVER = ("scale_gain", "rail_yaw")
"""Exact twins of the stiffnesses: nothing shows, by nature."""

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Played:
    """A game with its score.

    Attributes:
        kind: clean | single | pair | strange | twins | again.
        score: What came of it.
        seconds: Of the diagnosis.
        size: Of the first secret, in typical sizes.
    """

    kind: str
    score: Score
    seconds: float
    size: float


@dataclass(frozen=True)
class League:
    """Whom it plays and how often.

    Attributes:
        clean: Games without a secret.
        single: Games per known secret.
        pairs: Games with two known secrets.
        strange: Games per secret outside the catalogue.
        times: Size over the smallest identifiable one.
        seed: Of everything.
        rules: How campaigns are measured.
    """

    clean: int = 1000
    single: int = 6
    pairs: int = 100
    strange: int = 15
    times: float = 2.0
    seed: int = 2026
    rules: Rules = field(default_factory=Rules)


def games(league: League, tell: Tell = lambda _: None) -> Iterator[Played]:
    """Play the whole league, in process."""
    robot = load("kr500_rail")
    known = twins(robot)
    for i in range(league.clean):
        yield _played(robot, known, "clean", [], [league.seed, 0, i], league)
    for k, secret in enumerate(KNOWN):
        for i in range(league.single):
            seed = [league.seed, 1, k, i]
            sized = _sized(robot, known, [secret], seed, league)
            if sized is None:
                tell(f"{secret.label}: this plan cannot name it at any sensible size")
                continue
            yield _played(robot, known, "single", sized, seed, league)
    for i in range(league.pairs):
        seed = [league.seed, 2, i]
        pick = np.random.default_rng(seed).permutation(len(KNOWN))
        able = [KNOWN[k] for k in pick if KNOWN[k].label not in NEVER]
        pair = [able[0], next(s for s in able[1:] if s.place != able[0].place)]
        sized = _sized(robot, known, pair, seed, league)
        if sized is not None:
            yield _played(robot, known, "pair", sized, seed, league)
    for k, secret in enumerate(STRANGE):
        for i in range(league.strange):
            seed = [league.seed, 3, k, i]
            size = float(np.random.default_rng(seed).uniform(0.7, 2.5))
            yield _played(robot, known, "strange", [(secret, size)], seed, league)


def _played(
    robot: Robot,
    known: Twins,
    kind: str,
    secrets: list[tuple[Secret, float]],
    seed: list[int],
    league: League,
) -> Played:
    game = play(robot, secrets, np.random.default_rng(seed), league.rules)
    return _judged(robot, known, kind, game, secrets)


def _judged(
    robot: Robot, known: Twins, kind: str, game: Game, secrets: list[tuple[Secret, float]]
) -> Played:
    began = time.perf_counter()
    found = diagnosed(robot, game.files)
    seconds = time.perf_counter() - began
    size = secrets[0][1] if secrets else 0.0
    return Played(kind, score(robot, game.truth, found, known), seconds, size)


def _sized(
    robot: Robot, known: Twins, secrets: list[Secret], seed: list[int], league: League
) -> list[tuple[Secret, float]] | None:
    """The secrets at `times` the smallest identifiable size of the same campaign without them."""
    if any(secret.label in NEVER for secret in secrets):
        return [(secret, 1.0) for secret in secrets]
    least = smallest(robot, known, seed, league)
    sized = [(secret, league.times * least.get(secret.label, np.inf)) for secret in secrets]
    most = largest(robot)
    return sized if all(size <= most[secret.label] for secret, size in sized) else None


def largest(robot: Robot) -> dict[str, float]:
    """Largest sensible size of each cause, in typical ones: inside its physical bounds."""
    return {
        effect.label: min(
            TOO_LARGE, *(max(p.upper, -p.lower) / p.typical for p in effect.parameters)
        )
        for effect in catalogue(robot)
    }


def smallest(robot: Robot, known: Twins, seed: list[int], league: League) -> dict[str, float]:
    """Smallest identifiable size of every cause, by the linear theory, for one seed's campaign."""
    game = play(robot, [], np.random.default_rng(seed), league.rules)
    _, cell, data = reduced(robot, game.files)
    _, estimate = identify(cell, data, robot.nominal_compliance)
    case, _ = case_of(cell, data, estimate)
    seen = case.sight(case.model((), estimate.value))
    return identifiable(case.look(seen), known)


def again(
    robot: Robot,
    secrets: list[tuple[Secret, float]],
    seed: list[int],
    league: League,
    most: int = 4,
) -> list[str]:
    """Play, then follow the proposed next pose, up to `most` times; the verdicts on the way."""
    known = twins(robot)
    rules = league.rules
    tool_rng = np.random.default_rng(seed).spawn(4)
    from pipeline.league.play import TOOLS  # the tool that `play` will draw

    tool = np.array(TOOLS[tool_rng[0].integers(len(TOOLS))])
    q, anchor = drawn(robot, tool, rules, tool_rng[1])
    verdicts = []
    for _ in range(most + 1):
        game = play(robot, secrets, np.random.default_rng(seed), rules, (q, anchor))
        found = diagnosed(robot, game.files)
        one = score(robot, game.truth, found, known)
        verdicts.append("right" if one.confident and one.right else found.verdict)
        if verdicts[-1] != "ambiguous" or not found.next_poses:
            break
        q = np.vstack([q, found.next_poses[0].q])
        anchor = np.vstack([anchor, found.next_poses[0].anchor])
        rules = replace(rules, poses=len(q))
    return verdicts
