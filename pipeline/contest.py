"""The league on disk: the in-process games, and games through real files and the command line."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.league.play import play
from pipeline.league.run import League, Played, games
from pipeline.league.secrets import KNOWN, STRANGE
from pipeline.league.table import page
from pipeline.robot import load


def contest(league: League, tell: Callable[[str], None], log: Path | None) -> list[Played]:
    """Play the league; each game becomes a line of `log`."""
    played = []
    for game in games(league, tell):
        played.append(game)
        s = game.score
        tell(f"{len(played):5d} {game.kind:8s}{'+'.join(s.truth) or 'nothing':40s}{s.verdict}")
        if log is not None:
            with log.open("a", encoding="utf-8") as file:
                file.write(json.dumps(_line(game)) + "\n")
    return played


def _line(game: Played) -> dict[str, Any]:
    s = game.score
    return {
        "kind": game.kind,
        "truth": s.truth,
        "size": game.size,
        "verdict": s.verdict,
        "named": s.named,
        "listed": s.listed,
        "right": s.right,
        "gain": s.gain,
        "seconds": round(game.seconds, 3),
    }


def seal(secrets: dict[str, float], seed: int, raw: Path, sealed: Path, name: str) -> None:
    """The generator's part: raw files here, the truth there.

    Args:
        secrets: Labels with their sizes in typical ones.
        seed: Of the game.
        raw: Folder data/raw of a project.
        sealed: Folder for the truth; the pipeline is never told of it.
        name: Of the campaign.
    """
    known = {secret.label: secret for secret in (*KNOWN, *STRANGE)}
    chosen = [(known[label], size) for label, size in secrets.items()]
    game = play(load("kr500_rail"), chosen, np.random.default_rng(seed), name=name)
    folder = raw / name
    folder.mkdir(parents=True, exist_ok=True)
    for file, content in game.files.items():
        (folder / file).write_bytes(content)
    sealed.mkdir(parents=True, exist_ok=True)
    (sealed / f"{name}.json").write_text(json.dumps(game.truth), encoding="utf-8")


def answered(root: Path, name: str) -> dict[str, Any]:
    """The pipeline's part: a process of its own that sees the raw files only."""
    command = [sys.executable, "-m", "pipeline", "run", name, "--json", "--engine", "local"]
    done = subprocess.run(
        [*command, "--root", str(root)], capture_output=True, text=True, check=True
    )
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def opened(sealed: Path, name: str) -> dict[str, Any]:
    """The judge's part: the truth."""
    truth: dict[str, Any] = json.loads((sealed / f"{name}.json").read_text(encoding="utf-8"))
    return truth


def write_page(played: list[Played], command: str, path: Path) -> None:
    """The page of results."""
    path.write_text(page(played, command), encoding="utf-8")
