"""`python -m bench.league.priors`: effect of learnt priors on the league's figures.

A fleet of other machines is played first, in which some causes are common; the priors learnt from
it are put into campaign.toml of new games: half of the same fleet, half with all causes equally
common. Each is played without priors, with the learnt ones, and with odds and sizes drawn from the
limits of what campaign.toml allows, which is worse than any fleet can teach.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from bench.exam import JSON, Kept, code_of, package
from bench.league.hidden import SECRETS
from bench.league.judge import score
from bench.league.play import drawn, play
from bench.league.run import KNOWN_LABELS, NEVER, League, answer_of, largest, yardstick
from bench.league.table import share, wrong
from pipeline.answer.contract import Answer
from pipeline.diagnosis.isolability import twins
from pipeline.fleet.experience import experience, toml
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load

SEED = 20261124
TEACHING, GAMES, PLANS = 22, 20, 4
COMMON = ("rail_roll", "tool_flex", "joint_tilt:3", "scale_zero", "link_bending:forearm")
"""Causes that most machines of the fleet have."""

ARMS = ("none", "learnt", "extreme")
RULES = League().rules


def files(number: int, common: bool) -> tuple[dict[str, bytes], dict]:
    """A machine with one cause near the smallest size that its plan shows, or none."""
    rng = np.random.default_rng([SEED, number])
    robot, plan_seed = load("kr500_rail"), (SEED, number % PLANS)
    plan, known = drawn(robot, np.random.default_rng(plan_seed), RULES), yardstick(plan_seed, RULES)
    most, names = largest(robot), [name for name in KNOWN_LABELS if name not in NEVER]
    sizes = {name: 2.0 * known.named.get(name, np.inf) for name in names}
    able = [name for name in names if sizes[name] < most.get(name, np.inf)]
    usual = [name for name in COMMON if name in able]
    pool = usual if common and usual and rng.random() < 0.8 else able
    hidden = [str(rng.choice(pool))] if rng.random() < 0.8 else []
    factor = float(rng.choice([0.5, 1.0]))
    secrets = [(SECRETS[name], factor * sizes[name]) for name in hidden]
    game = play(robot, plan, secrets, np.random.default_rng([SEED, number, 1]), RULES)
    return dict(game.files), game.truth


def taught() -> str:
    """[priors] learnt from the fleet."""
    names = {effect.name for effect in catalogue(load("kr500_rail"))}
    answers = []
    for number in range(TEACHING):
        found = answer_of(
            _with(files(number, common=True)[0], f'\n[robot_unit]\nserial = "{number}"\n')
        )
        if found is not None:
            answers.append(Answer.model_validate(found, strict=False))
    return toml(experience(answers, names))


def extreme(number: int) -> str:
    """Odds and sizes of every cause at the limits of what is allowed."""
    rng = np.random.default_rng([SEED, number, 2])
    names = sorted({effect.name for effect in catalogue(load("kr500_rail"))})
    return "".join(
        f"[priors.{name}]\nodds = {rng.choice([0.25, 4.0])}\nsize = {rng.choice([0.34, 3.0])}\n"
        for name in names
    )


def _with(content: Mapping[str, bytes], more: str) -> dict[str, bytes]:
    return {**content, "campaign.toml": content["campaign.toml"] + b"\n" + more.encode()}


def played(log: Path) -> Iterator[tuple[str, dict]]:
    """Every game with every kind of priors; those that are kept are not played again."""
    kept = Kept(log, code_of(package()), JSON)
    rows, robot = kept.rows(), load("kr500_rail")
    if "taught" not in rows:
        rows["taught"] = {"priors": taught()}
        kept.add("taught", rows["taught"])
    for number in range(1000, 1000 + GAMES):
        content, truth = files(number, common=number % 2 == 0)
        more = ("", rows["taught"]["priors"], extreme(number))
        for arm, priors in zip(ARMS, more, strict=True):
            key = f"{number}-{arm}"
            if key not in rows:
                found = score(truth, answer_of(_with(content, priors)), twins(robot))
                told = {name: getattr(found, name) for name in _SHOWN} | {"wrong": wrong(found)}
                rows[key] = told | {"hidden": len(truth["secrets"])}
                kept.add(key, rows[key])
            yield arm, rows[key]


_SHOWN = ("right", "in_list", "detected", "verdict")


def main() -> None:
    """Print the table."""
    games = list(played(Path(sys.argv[1]) if sys.argv[1:] else Path("reports/league-priors.jsonl")))
    for arm in ARMS:
        mine = [one for name, one in games if name == arm]
        told = [one for one in mine if one["hidden"]]
        cells = (
            share(one["right"] for one in told),
            share(one["in_list"] for one in told if one["detected"]),
            share(one["wrong"] for one in told),
            share(one["verdict"] == "adequate" for one in mine if not one["hidden"]),
        )
        sys.stdout.write(f"| {arm} | {' | '.join(cells)} |\n")


if __name__ == "__main__":
    main()
