"""Whether a proposed pose settles which cause is present, for poor campaigns.

Every plan is poor by construction, as if made in a hurry: one place on the rail, one anchor, one
approach, few poses, near one or two postures of the arm. The hidden cause is one that, by linear
theory, this plan detects but does not distinguish from all others, while a plan of 16 random poses
does; no outcome is used for the choice. Machine, secrets, judge and operator are the league's: the
operator measures the first pose that result.json proposes in the usual load steps and asks again,
up to four times.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special

from bench.league.hidden import SECRETS
from bench.league.judge import Score, same, score
from bench.league.play import TOOLS, Plan
from bench.league.run import ABLE, MOST, Asked, League, followed, largest, shown_by, yardstick
from bench.league.table import rivalled, share, wrong
from pipeline.base.arrays import Array
from pipeline.design.poses import default_anchors, draw_poses, feasible
from pipeline.diagnosis.facts import SEPARATED
from pipeline.diagnosis.finding import Finding
from pipeline.diagnosis.isolability import twins
from pipeline.machine.robot import Robot, load
from pipeline.machine.robot.axes import rounded
from pipeline.service.executor import InProcesses, in_order

SEED, PLANS = 2027, 96
EACH = 3
"""Number of causes hidden from one plan, drawn from those it detects but does not distinguish."""
GOOD = 8
"""Number of plans of 16 poses with which the poor ones are compared."""
TIMES = (1.5, 2.0)
"""Size relative to the smallest that the good plan distinguishes."""
STANDS = ((1, 10.0), (2, 10.0), (1, 25.0))
"""Number of postures of the arm, and range of the poses about them in each joint [deg]."""
POSES = (5, 6, 7, 8)


@dataclass(frozen=True)
class Answer:
    """One answer.

    Attributes:
        score: Its score.
        pair: The two causes that remain closest with the first proposed pose; empty without one.
        sigmas: Distance between them, now and with that pose.
        reasons: Reasons of the verdict.
    """

    score: Score
    pair: tuple[str, ...]
    sigmas: tuple[float, float]
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Game:
    """One poor campaign, then the same with one more proposed pose each time."""

    plan: int
    secret: str
    answers: tuple[Answer, ...]

    @property
    def first(self) -> Score:
        """Score of the campaign as first measured."""
        return self.answers[0].score

    def within(self, most: int, hit: Callable[[Score], bool]) -> bool:
        """Whether an answer after at most `most` poses satisfies `hit`."""
        return any(hit(answer.score) for answer in self.answers[1 : 1 + most])


def run() -> Iterable[tuple[str, float, str]]:
    """What one pose and up to four achieve for `ambiguous`; promises kept; errors."""
    jobs = [(SEED, number) for number in range(PLANS)]
    games = [game for some in in_order(InProcesses(), games_of, jobs) for game in some]
    yield from counted(games)


def counted(games: Sequence[Game]) -> Iterable[tuple[str, float, str]]:
    """Rows of the benchmark."""
    said = Counter(game.first.verdict for game in games)
    yield "games", len(games), ", ".join(f"{n} {verdict}" for verdict, n in said.most_common())
    opened = [game for game in games if game.first.verdict == "ambiguous"]
    proposed = [game for game in opened if game.first.apart is not None]
    rivals = [game for game in proposed if rivalled(game.first)]
    others = [game for game in proposed if not rivalled(game.first)]
    apart = [game for game in rivals if (game.first.apart or 0.0) >= SEPARATED]
    soon = [game for game in apart if game.answers[0].sigmas[1] >= SEPARATED]
    for what, some in (
        (f"rivals that four poses separate by {SEPARATED}", apart),
        (f"rivals that the first pose separates by {SEPARATED}", soon),
        ("all rivals with a pose proposed", rivals),
        ("no rival, a pose proposed", others),
    ):
        for most, within in ((1, "one pose"), (2, "up to two"), (MOST, "up to four")):
            yield _row(f"{what}: settled by {within}", [g.within(most, settled) for g in some])
            yield _row("  name right and certain", [g.within(most, certain) for g in some])
    left = Counter(_reason(g) for g in apart if not g.within(1, settled))
    for why, count in left.most_common():
        yield f"by one pose not: {why}", count, f"of {len(apart)}"
    left = Counter(_reason(g, 0) for g in opened if g.first.apart is None)
    for why, count in left.most_common():
        yield f"nothing to propose: {why}", count, f"of {len(opened)} ambiguous"
    yield _row("wrong name for certain, before any pose", [wrong(g.first) for g in games])
    yield _row("wrong name for certain after a pose", [g.within(MOST, wrong) for g in opened])
    yield from _promises(opened)


def _row(what: str, hits: Sequence[bool]) -> tuple[str, float, str]:
    return what, float(np.mean(hits)) if hits else np.nan, share(hits)


def certain(one: Score) -> bool:
    """Whether the name is right, twins counted as one, and no rival is likely."""
    return one.verdict in ("explained", "ambiguous") and one.right and not rivalled(one)


def settled(one: Score) -> bool:
    """Whether the name is right under `explained`; for twins, as far as that is possible."""
    paired = any(" = " in said.label and said.true for said in one.stated)
    paid = one.gain is not None and one.gain[1] > 0
    return one.right and (one.verdict == "explained" or (paired and paid and certain(one)))


def _reason(game: Game, at: int = 1) -> str:
    """Why an answer is not settled, in words without names."""
    one = game.answers[min(at, len(game.answers) - 1)]
    if one.score.verdict != "ambiguous":
        return f"{one.score.verdict}, the right name" if one.score.right else one.score.verdict
    if Finding.GAIN_UNCERTAIN in one.reasons:
        return "the gain at left-out poses is not certain"
    if Finding.OUTSIDE_CATALOGUE_POSSIBLE in one.reasons:
        return "something without a name"
    known = twins(load("kr500_rail"))
    if not rivalled(one.score) and any(known.of(name) for name in one.score.named):
        return "a twin"
    return "a rival"


def _promises(opened: Sequence[Game]) -> Iterable[tuple[str, float, str]]:
    """For the closest pair including the true cause: probability that this leads by 20 to 1.

    With log odds L for it before and d further sigmas, L + d^2 / 2 is expected, with scatter d.
    """
    known, promised, kept = twins(load("kr500_rail")), [], []
    for game in opened:
        before, true = game.answers[0], same(game.secret, known)
        pair = {same(name, known) for name in before.pair}
        now = _odds(before.score)
        if len(game.answers) < 2 or len(pair) < 2 or not pair <= set(now) or true not in pair:
            continue
        (other,) = pair - {true}
        low, high = before.sigmas
        d = np.sqrt(max(high**2 - low**2, 1e-6))
        lead = np.log(now[true] / now[other])
        promised.append(float(special.ndtr((lead + d**2 / 2 - np.log(20)) / d)))
        then = _odds(game.answers[1].score)
        kept.append(then.get(true, 0.0) > 20 * then.get(other, 0.0))
    mean = float(np.mean(promised)) if promised else np.nan
    yield "promised: the true one of a pair leads by 20 to 1", mean, "mean probability"
    yield _row("  kept", kept)


def _odds(one: Score) -> dict[str, float]:
    return {said.label: said.probability for said in one.stated}


def games_of(job: tuple[int, int]) -> list[Game]:
    """The games of one poor plan.

    Args:
        job: Seed of all plans, number of this one.
    """
    seed, number = job
    robot, rules = load("kr500_rail"), League().rules
    rng = np.random.default_rng((seed, 1, number))
    poses = POSES[number // len(STANDS) % len(POSES)]
    plan = poor(robot, rng, *STANDS[number % len(STANDS)], poses)
    good, mine = yardstick((seed, 9, number % GOOD), rules), shown_by(plan, rules, rng)
    most, able = largest(robot), []
    for name in ABLE:
        size = rng.uniform(*TIMES) * good.named.get(name, np.inf)
        found = mine.seen.get(name, np.inf) <= size
        if found and size < mine.named[name] and size <= most.get(name, 0.0):
            able.append((name, size))
    games = []
    for name, size in (able[k] for k in rng.permutation(len(able))[:EACH]):
        own = (seed, 2, number, ABLE.index(name))
        asked = followed(robot, plan, [(SECRETS[name], size)], own, rules)
        games.append(Game(number, name, tuple(_answer(one, robot) for one in asked)))
    return games


def _answer(asked: Asked, robot: Robot) -> Answer:
    said: dict[str, Any] = asked.answer["diagnosis"] if asked.answer else {}
    first = next(iter(said.get("next_poses", [])), None)
    return Answer(
        score(asked.truth, asked.answer, twins(robot)),
        tuple(first["separates"]) if first else (),
        (first["sigmas_before"], first["sigmas_after"]) if first else (0.0, 0.0),
        tuple(said.get("reasons", ())),
    )


def poor(robot: Robot, rng: np.random.Generator, stands: int, deg: float, poses: int) -> Plan:
    """One place on the rail, one anchor, one approach, poses near a few postures of the arm.

    Args:
        robot: The KR500 on its rail.
        rng: Draws tool, anchor, postures and poses.
        stands: Number of postures of the arm.
        deg: Maximum distance of each joint from them [deg].
        poses: Total number of poses.
    """
    tool, anchors = np.array(TOOLS[rng.integers(len(TOOLS))]), default_anchors(robot)
    anchor, alone = anchors[rng.integers(len(anchors))][None], np.zeros(1, dtype=np.int64)
    middles = [draw_poses(robot, tool, anchor, alone, rng)[0]]
    while len(middles) < stands:
        other = draw_poses(robot, tool, anchor, alone, rng)
        other[:, 0] = middles[0][0]
        middles += list(other[feasible(robot, other, tool, anchor)])
    around = [middles[k % stands] for k in range(poses)]
    return Plan(
        tool=tool,
        q=np.vstack([_near(robot, rng, q, deg, tool, anchor) for q in around]),
        anchor=np.repeat(anchor, poses, axis=0),
        approach=np.ones(poses),
        isotropic=bool(rng.random() < 0.6),
        scatter=float(rng.uniform(*League().rules.scatter)),
    )


def _near(
    robot: Robot, rng: np.random.Generator, q: Array, deg: float, tool: Array, anchor: Array
) -> Array:
    """A feasible pose near another one, at the same place on the rail."""
    while True:
        off = np.deg2rad(rng.uniform(-deg, deg, (16, robot.n))) * ~robot.prismatic
        moved = rounded(robot, q + off)
        moved = moved[((moved >= robot.lower) & (moved <= robot.upper)).all(axis=1)]
        good = moved[feasible(robot, moved, tool, np.repeat(anchor, len(moved), axis=0))]
        if len(good):
            return np.asarray(good[0])
