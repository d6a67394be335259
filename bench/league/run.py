"""The league: its list of games, and how one is played, from its seed alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, wraps
from typing import Any

import numpy as np
from scipy import special

from bench.league.hidden import SECRETS
from bench.league.hidden_effect import Secret
from bench.league.in_catalogue import KNOWN
from bench.league.judge import Score, foretold, score
from bench.league.outside_catalogue import STRANGE
from bench.league.play import Plan, Rules, at_further_poses, drawn, play
from bench.league.visible import identifiable
from pipeline.answer.results import CampaignAnswer
from pipeline.base.errors import PipelineError
from pipeline.diagnosis.blindspots import needed, smallest_visible
from pipeline.diagnosis.diagnose import search_task
from pipeline.diagnosis.isolability import twins
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import Robot, load
from pipeline.prediction.model import IdentifiedModel
from pipeline.reduction.bring import Step, bring, inline
from pipeline.run import campaign_answer, ingested
from pipeline.store.campaign import in_memory
from pipeline.system.detect import threshold
from pipeline.system.estimate import identify, left_out
from pipeline.system.fit import fit
from pipeline.system.whitened import Whitened

TOO_LARGE = 12.0
"""Size in typical ones beyond which a fault would not be tolerated in practice [1]."""

NEVER = ("scale_gain", "rail_yaw")
"""Exact twins of the stiffnesses, undetectable in principle."""

KINDS = ("single", "pair", "strange", "power", "doubtful", "clean")
"""Kinds of games; their positions are part of the seeds."""

STEPS = (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0)
"""Sizes of the power curves, in multiples of the smallest identifiable size."""

DOUBTFUL = (0.7, 1.0, 1.3)
"""Sizes at which a name is often open."""

CURVES = (
    "rail_roll",
    "rail_backlash",
    "joint_tilt:3",
    "link_bending:forearm",
    "joint_asymmetry:4",
    "joint_hardening:3",
    "joint_lost_motion:2",
    "joint_hysteresis:4",
    "compensator",
    "chain_offset",
    "scale_zero",
)
"""One cause of each kind, for the power curves."""

PLANS = 30
"""Number of plans shared by games with sized causes, so that each is sized once."""

MOST = 4
"""Maximum number of proposed poses that are followed."""


@dataclass(frozen=True)
class League:
    """Which games are played, and how often.

    Attributes:
        clean: Games without a secret.
        single: Games per known secret.
        pairs: Games with two known secrets.
        strange: Games per secret outside the catalogue.
        power: Games per size and cause of the power curves.
        doubtful: Games per size and known secret in which proposed poses are followed.
        times: Size over the smallest identifiable one, of singles and pairs.
        seed: Seed of everything.
        rules: How campaigns are measured.
    """

    clean: int = 1000
    single: int = 6
    pairs: int = 100
    strange: int = 15
    power: int = 6
    doubtful: int = 1
    times: float = 2.0
    seed: int = 2026
    rules: Rules = field(default_factory=Rules)


@dataclass(frozen=True)
class Fixture:
    """One game before it is played.

    Attributes:
        kind: One of `KINDS`.
        secrets: Labels of the secrets.
        times: Size over the smallest identifiable one; 0 if sizes are drawn.
        seed: Seed of machine and noise.
        plan: Seed of the plan.
    """

    kind: str
    secrets: tuple[str, ...]
    times: float
    seed: tuple[int, ...]
    plan: tuple[int, ...]

    @property
    def key(self) -> str:
        """Its name among the games that are kept."""
        return "-".join(str(number) for number in self.seed)


@dataclass(frozen=True)
class Played:
    """A game with its scores.

    Attributes:
        key: Key of its fixture.
        kind: Kind of its fixture.
        secrets: Labels of the secrets.
        times: Size over the smallest identifiable one; 0 if sizes were drawn.
        sizes: In typical sizes; empty if the plan would show a secret only at an implausible size,
            and the game was not played.
        power: Predicted probability that the first secret is detected.
        missed_mm: Cross-validation error of the joint springs without noise, for singles.
        scores: Of the campaign, then with one proposed pose more each time.
        seconds: CPU time from files to the first answer.
        diagnosing: Part of it used by the diagnosis.
        cost: Total CPU time.
    """

    key: str
    kind: str
    secrets: tuple[str, ...]
    times: float
    sizes: tuple[float, ...]
    power: float
    missed_mm: float
    scores: tuple[Score, ...]
    seconds: float
    diagnosing: float
    cost: float

    @property
    def score(self) -> Score:
        """Score of the campaign as planned."""
        return self.scores[0]


def fixtures(league: League) -> list[Fixture]:
    """All games, with the kinds mixed evenly: the first half of the list is half a league."""
    kinds = (
        _each(league, "single", KNOWN_LABELS, (league.times,), league.single),
        [_pair(league, i) for i in range(league.pairs)],
        [
            Fixture("strange", (name,), 0.0, _seed(league, "strange", k, i), (league.seed, 7, k, i))
            for i in range(league.strange)
            for k, name in enumerate(secret.label for secret in STRANGE)
        ],
        _each(league, "power", CURVES, STEPS, league.power),
        _each(league, "doubtful", ABLE, DOUBTFUL, league.doubtful),
        [
            Fixture("clean", (), 0.0, _seed(league, "clean", i), (league.seed, 8, i))
            for i in range(league.clean)
        ],
    )
    placed = [(i / len(kind), k, one) for k, kind in enumerate(kinds) for i, one in enumerate(kind)]
    return [one for _, _, one in sorted(placed, key=lambda each: each[:2])]


KNOWN_LABELS = tuple(secret.label for secret in KNOWN)
ABLE = tuple(name for name in KNOWN_LABELS if name not in NEVER)


def _seed(league: League, kind: str, *numbers: int) -> tuple[int, ...]:
    return (league.seed, KINDS.index(kind), *numbers)


def _each(
    league: League, kind: str, labels: tuple[str, ...], steps: tuple[float, ...], count: int
) -> list[Fixture]:
    return [
        Fixture(
            kind,
            (name,),
            times,
            _seed(league, kind, KNOWN_LABELS.index(name), round(100 * times), i),
            (league.seed, 9, (5 * k + i) % PLANS),
        )
        for i in range(count)
        for times in steps
        for k, name in enumerate(labels)
    ]


def _pair(league: League, number: int) -> Fixture:
    """Two causes in two different parts of the cell."""
    seed = _seed(league, "pair", number)
    order = np.random.default_rng(seed).permutation(len(ABLE))
    first, *rest = [SECRETS[ABLE[k]] for k in order]
    other = next(secret for secret in rest if secret.place != first.place)
    plan = (league.seed, 9, number % PLANS)
    return Fixture("pair", (first.label, other.label), league.times, seed, plan)


def played(fixture: Fixture, league: League) -> Played:
    """Play one game; the result does not depend on process or order."""
    began = time.process_time()
    robot = load("kr500_rail")
    plan = drawn(robot, np.random.default_rng(fixture.plan), league.rules)
    sizes = _sizes(fixture, plan, league, robot)
    head = (fixture.key, fixture.kind, fixture.secrets, fixture.times)
    most = largest(robot)
    if any(
        size > most.get(name, np.inf) for name, size in zip(fixture.secrets, sizes, strict=True)
    ):
        return Played(
            *head, sizes=(), power=0.0, missed_mm=0.0, scores=(), seconds=0, diagnosing=0, cost=0
        )
    power = 0.0
    if fixture.kind == "power":
        power = yardstick(fixture.plan, league.rules).power(fixture.secrets[0], sizes[0])
    missed = missed_mm(fixture, plan, sizes, league, robot) if fixture.kind == "single" else 0.0
    follow = MOST if fixture.kind == "doubtful" else 0
    scores, spent = _followed(fixture, plan, sizes, league, robot, follow)
    return Played(*head, sizes, power, missed, scores, *spent, time.process_time() - began)


def _sizes(fixture: Fixture, plan: Plan, league: League, robot: Robot) -> tuple[float, ...]:
    """Sizes of the secrets in typical ones."""
    if not fixture.times:
        rng = np.random.default_rng([*fixture.seed, 1])
        return tuple(rng.uniform(0.7, 2.5, len(fixture.secrets)).tolist())
    if fixture.secrets[0] in NEVER:
        return (1.0,)
    known = yardstick(fixture.plan, league.rules)
    return tuple(fixture.times * known.named.get(name, np.inf) for name in fixture.secrets)


def _followed(
    fixture: Fixture,
    plan: Plan,
    sizes: tuple[float, ...],
    league: League,
    robot: Robot,
    most: int,
) -> tuple[tuple[Score, ...], tuple[float, float]]:
    """Scores of the campaign, and with one more proposed pose each time while a name is open."""
    secrets = [(SECRETS[name], size) for name, size in zip(fixture.secrets, sizes, strict=True)]
    asked = list(followed(robot, plan, secrets, fixture.seed, league.rules, most))
    scores = tuple(score(one.truth, one.answer, twins(robot)) for one in asked)
    if fixture.kind != "strange" and asked[0].model is not None:
        truth = at_further_poses(robot, plan, secrets, fixture.seed, league.rules)
        found = asked[0].model.at_load_point(truth.q, truth.force)
        said = foretold(truth.moved, found.displacement, found.std)
        scores = (replace(scores[0], deflections=said), *scores[1:])
    return scores, (asked[0].seconds, asked[0].diagnosing)


@dataclass(frozen=True, eq=False)
class Asked:
    """One campaign and the answer of the pipeline.

    Attributes:
        truth: As sealed by `play`.
        answer: result.json; None if the pipeline rejected the campaign.
        model: The identified robot; None likewise.
        seconds: CPU time from files to the answer.
        diagnosing: Part of it used by the diagnosis.
    """

    truth: dict[str, Any]
    answer: dict[str, Any] | None
    model: IdentifiedModel | None
    seconds: float
    diagnosing: float


def followed(
    robot: Robot,
    plan: Plan,
    secrets: Sequence[tuple[Secret, float]],
    seed: Sequence[int],
    rules: Rules,
    most: int = MOST,
) -> Iterator[Asked]:
    """A campaign, and the same with one more proposed pose each time while a name is open.

    The operator pulls in the usual steps at the first proposed pose, then asks again.

    Args:
        robot: The KR500 on its rail.
        plan: Where and with what.
        secrets: The secrets, each with its size in typical sizes.
        seed: Seed of machine, secrets and noise.
        rules: How it is measured.
        most: Maximum number of proposed poses that are followed.
    """
    for further in range(most + 1):
        game = play(robot, plan, secrets, np.random.default_rng(seed), rules)
        began, clock = time.process_time(), Clock()
        found = _answered(game.files, clock)
        seconds = time.process_time() - began
        answer = found and found.answer.as_json()
        model = found and found.model
        yield Asked(game.truth, answer, model, seconds, clock.seconds.get("diagnose", 0.0))
        said: dict[str, Any] = answer["diagnosis"] if answer else {"verdict": "refused"}
        if further == most or said["verdict"] != "ambiguous" or not said["next_poses"]:
            return
        plan = plan.further(*_where(said["next_poses"][0], robot))


def missed_mm(
    fixture: Fixture, plan: Plan, sizes: tuple[float, ...], league: League, robot: Robot
) -> float:
    """Cross-validation error of the joint springs on the same machine without noise [mm]."""
    secrets = [(SECRETS[name], size) for name, size in zip(fixture.secrets, sizes, strict=True)]
    calm, still = replace(plan, scatter=0.0), replace(league.rules, scale_n=0.0)
    files = play(robot, calm, secrets, np.random.default_rng(fixture.seed), still).files
    case = ingested(in_memory(files))
    system, _ = identify(case.cell, bring(case).data, robot.nominal_compliance)
    return float(1e3 * np.sqrt(np.nanmean(left_out(system) ** 2)))


def _where(proposal: Mapping[str, Any], robot: Robot) -> tuple[np.ndarray, np.ndarray, float]:
    """Joint values [m] or [rad], anchor [m] and approach of a proposal."""
    q = np.where(robot.prismatic, proposal["q"], np.deg2rad(proposal["q"]))
    return q, np.array(proposal["anchor_m"]), float(proposal.get("approach") or 1.0)


class Clock:
    """Executes stages and records their CPU times.

    Attributes:
        seconds: CPU time by name of the stage.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: Callable[..., Any]) -> Callable[..., Any]:
        """The stage with timing."""

        @wraps(stage)
        def timed(*args: Any, **kwargs: Any) -> Any:
            began = time.process_time()
            done = stage(*args, **kwargs)
            spent = time.process_time() - began
            self.seconds[stage.__name__] = self.seconds.get(stage.__name__, 0.0) + spent
            return done

        return timed


def answer_of(files: Mapping[str, bytes], step: Step = inline) -> dict[str, Any] | None:
    """Answer of `pipeline run` for these files, without writing; None if it rejects them."""
    found = _answered(files, step)
    return found and found.answer.as_json()


def _answered(files: Mapping[str, bytes], step: Step) -> CampaignAnswer | None:
    try:
        return campaign_answer("game", in_memory(files), step=step)
    except PipelineError:
        return None


def largest(robot: Robot) -> dict[str, float]:
    """Largest plausible size of each cause, in typical ones, within its physical bounds."""
    return {
        effect.label: min(
            TOO_LARGE, *(max(p.upper, -p.lower) / p.typical for p in effect.parameters)
        )
        for effect in catalogue(robot)
    }


@dataclass(frozen=True, eq=False)
class Yardstick:
    """Sizes that one plan can show, by linear theory, in typical sizes.

    Attributes:
        named: Smallest size at which a cause is detected and separated from all others.
        seen: Size that is detected with 80 % power, by the cause's best form.
        count: Number of parameters of that form.
        p: Threshold of one cause's test.
    """

    named: dict[str, float]
    seen: dict[str, float]
    count: dict[str, int]
    p: float

    def power(self, name: str, size: float) -> float:
        """Probability that a cause of this size is detected by its own test."""
        if name not in self.seen:
            return self.p
        k = self.count[name]
        strength = needed(k, self.p) * (size / self.seen[name]) ** 2
        return float(1 - special.chndtr(special.chdtri(k, self.p), k, strength))


@lru_cache(maxsize=2 * PLANS)
def yardstick(plan: tuple[int, ...], rules: Rules) -> Yardstick:
    """Sizes that a random plan can show.

    Args:
        plan: Seed of the plan.
        rules: How it is measured.
    """
    rng = np.random.default_rng(plan)
    return shown_by(drawn(load("kr500_rail"), rng, rules), rules, rng)


def shown_by(plan: Plan, rules: Rules, rng: np.random.Generator) -> Yardstick:
    """Measure a machine without hidden causes by a plan; return the sizes it can show.

    Args:
        plan: Where and with what.
        rules: How it is measured.
        rng: Source of the machine and the noise.
    """
    return shown_in(play(load("kr500_rail"), plan, [], rng.spawn(1)[0], rules).files, rng)


def shown_in(files: Mapping[str, bytes], rng: np.random.Generator) -> Yardstick:
    """Sizes that a campaign of a machine without hidden causes can show.

    Args:
        files: Content of its raw folder.
        rng: For the threshold.
    """
    case = ingested(in_memory(files))
    fitted = fit(case, bring(case))
    asked, _ = search_task(fitted.case.cell, fitted.data, fitted.estimate)
    view = asked.whitened(asked.linearised(asked.model((), fitted.estimate.value)))
    dof = view.rows_left - (len(view.base) - view.first)
    p = threshold(view, view.base, dof, rng).p
    return Yardstick(identifiable(view, twins(load("kr500_rail"))), *_visible(view, p), p)


def _visible(view: Whitened, p: float) -> tuple[dict[str, float], dict[str, int]]:
    seen: dict[str, float] = {}
    count: dict[str, int] = {}
    for effect, size in zip(view.suspects, smallest_visible(view, view.base, p), strict=True):
        if size < seen.get(effect.label, np.inf):
            seen[effect.label], count[effect.label] = float(size), len(effect.parameters)
    return seen, count
