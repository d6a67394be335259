"""The league on disk: games in several processes, kept as they finish, and games by command."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from bench import exam
from bench.exam import Kept, code_of, package
from bench.league.hidden import SECRETS
from bench.league.page import page
from bench.league.play import Rules, drawn, play
from bench.league.run import Fixture, League, Played, fixtures, played
from pipeline.base import files
from pipeline.machine.robot import load
from pipeline.service.executor import Executor

ROW = TypeAdapter(Played)


def code(league: League) -> str:
    """Version of what plays: the package, and the seed and the rules of the league."""
    rules = json.dumps({"seed": league.seed, "rules": asdict(league.rules)})
    return f"{code_of(package())}-{files.sha256(rules.encode())[:8]}"


def contest(league: League, log: Path, executor: Executor, minutes: float = np.inf) -> list[Played]:
    """Play the league or what is left of it; arguments as for `exam.contest`."""
    made = partial(code, league)
    kept, play = Kept(log, made(), ROW), partial(played, league=league)
    return exam.contest(fixtures(league), play, _key, made, kept, executor, minutes)


def _key(fixture: Fixture) -> str:
    return fixture.key


def seal(secrets: dict[str, float], seed: int, raw: Path, sealed: Path, name: str) -> None:
    """Generate a campaign: raw files in one folder, the truth in another.

    Args:
        secrets: Labels with their sizes in typical sizes.
        seed: Seed of the game.
        raw: Folder data/raw of a project.
        sealed: Folder for the truth, to which the pipeline has no access.
        name: Name of the campaign.
    """
    robot, rng = load("kr500_rail"), np.random.default_rng(seed)
    plan = drawn(robot, rng, Rules())
    chosen = [(SECRETS[label], size) for label, size in secrets.items()]
    game = play(robot, plan, chosen, rng, name=name)
    for file, content in game.files.items():
        files.write(raw / name / file, content)
    files.write(sealed / f"{name}.json", json.dumps(game.truth).encode())


def answers(root: Path, names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Answers by the command, in a separate process that sees the raw files only."""
    command = [sys.executable, "-m", "pipeline", "run", *names, "--json", "--engine", "local"]
    done = subprocess.run(
        [*command, "--root", str(root)], capture_output=True, text=True, check=True
    )
    said = [json.loads(line) for line in done.stdout.splitlines()]
    return {answer["campaign"]: answer for answer in said}


def opened(sealed: Path, name: str) -> dict[str, Any]:
    """The sealed truth."""
    truth: dict[str, Any] = json.loads((sealed / f"{name}.json").read_text(encoding="utf-8"))
    return truth


def write_page(games: list[Played], total: int, command: str, code: str, path: Path) -> None:
    """Write the page of results with its pictures; text written by hand is kept."""
    from bench.league.figures import figures  # matplotlib takes half a second to import

    old = path.read_text("utf-8") if path.is_file() else ""
    files.write(path, page(games, total, command, code, old).encode())
    for name, picture in figures(games).items():
        files.write(path.parent / "figures" / name, picture)
