"""The league on disk: games in several processes, kept as they finish, and games by command."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from bench.league.hidden import SECRETS
from bench.league.page import page
from bench.league.play import Rules, drawn, play
from bench.league.run import Fixture, League, Played, fixtures, played
from pipeline.app.progress import Progress
from pipeline.base import files
from pipeline.base.errors import InputError, Interrupted
from pipeline.machine.robot import load
from pipeline.service.executor import Executor
from pipeline.store.campaign import code_version

LINE = TypeAdapter(Played)


def contest(league: League, log: Path, executor: Executor, minutes: float = np.inf) -> list[Played]:
    """Play the league or what is left of it; the games do not depend on where they are played.

    Args:
        league: Which games are played, and how often.
        log: File with one line per finished game; games in it are not played again.
        executor: Where games are played.
        minutes: Time after which no further game is begun; with 0, only finished ones count.

    Returns:
        The finished games, in the order of the league.

    Raises:
        Interrupted: With the number of games that are kept.
        InputError: The log is of another seed, or of other code while games are left.
    """
    wanted = fixtures(league)
    kept, code = _kept(log, league)
    left = [fixture for fixture in wanted if fixture.key not in kept and minutes]
    if left and code != code_version():
        raise InputError(
            f"holds games of other code, and {len(left)} are left to play",
            "remove it to start the league anew, or give another --log",
            file=str(log),
        )
    with (
        Progress(len(left)) as progress,
        files.writing(log),
        log.open("a", encoding="utf-8") as out,
    ):
        for game in _all(left, league, executor, minutes, len(wanted), log):
            progress.now(f"{game.kind}: {' + '.join(game.secrets) or 'nothing'}")
            out.write(LINE.dump_json(game).decode() + "\n")
            out.flush()
            kept[game.key] = game
            progress.done()
    return [kept[fixture.key] for fixture in wanted if fixture.key in kept]


def _all(
    left: list[Fixture],
    league: League,
    executor: Executor,
    minutes: float,
    total: int,
    log: Path,
) -> Iterable[Played]:
    """Games in the order in which they finish."""
    done, end = total - len(left), time.monotonic() + 60 * minutes
    try:
        for game in executor.results(partial(played, league=league), _begun(left, end)):
            yield game.result
            done += 1
    except KeyboardInterrupt:
        raise Interrupted(
            f"Interrupted; {done} of {total} games are kept in {log}, and the same command "
            f"goes on from there."
        ) from None


def _begun(left: Iterable[Fixture], end: float) -> Iterator[Fixture]:
    """The next game, and further ones until a time of `time.monotonic`."""
    for number, fixture in enumerate(left):
        if number and time.monotonic() > end:
            return
        yield fixture


def _kept(log: Path, league: League) -> tuple[dict[str, Played], str]:
    """Games of an earlier run and the code that played them, without an incomplete last line.

    Raises:
        InputError: They are of another seed or of other rules.
    """
    rules = json.loads(json.dumps({"seed": league.seed, "rules": asdict(league.rules)}))
    if not log.is_file() or not log.stat().st_size:
        head = rules | {"code": code_version()}
        files.write(log, (json.dumps(head) + "\n").encode())
        return {}, code_version()
    first, *lines = log.read_text("utf-8").split("\n")
    head = json.loads(first)
    if {name: head.get(name) for name in rules} != rules:
        raise InputError(
            "holds games of another seed or of other rules",
            "remove it to start the league anew, or give another --log",
            file=str(log),
        )
    whole = lines[:-1]  # text behind the last line end is incomplete
    files.write(log, "\n".join([first, *whole, ""]).encode())
    return {game.key: game for game in map(LINE.validate_json, whole)}, str(head["code"])


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


def write_page(games: list[Played], total: int, command: str, log: Path, path: Path) -> None:
    """Write the page of results with its pictures; text written by hand is kept."""
    from bench.league.figures import figures  # matplotlib takes half a second to import

    code = json.loads(log.read_text("utf-8").partition("\n")[0])["code"]
    old = path.read_text("utf-8") if path.is_file() else ""
    files.write(path, page(games, total, command, code, old).encode())
    for name, picture in figures(games).items():
        files.write(path.parent / "figures" / name, picture)
