"""Entries: commands that get a campaign without its truth, and whose answers are kept."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bench.open_league import sealed
from pipeline.base import files
from pipeline.base.errors import UsageError

ONE, ALL = ("{campaign}", "{folder}"), ("{campaigns}", "{folders}")
"""Placeholders of a command: name under data/raw or folder of a campaign; or those of all remaining
campaigns, as separate words, in which case it prints one line for each."""


@dataclass(frozen=True)
class Entry:
    """A program that plays.

    Attributes:
        name: Name in the tables.
        words: Words of its command, with `ONE` or `ALL` in it.
    """

    name: str
    words: tuple[str, ...]

    @classmethod
    def of(cls, text: str) -> Entry:
        """Parse `ours=pipeline run {campaign} --json`.

        Raises:
            UsageError: It is not a name and a command, or has no placeholder.
        """
        name, equals, command = text.partition("=")
        if not equals or not re.fullmatch(r"[\w.-][\w. -]*", name) or not command.strip():
            raise UsageError(f'--entry "{text}" is not of the form NAME=COMMAND')
        words = tuple(shlex.split(command))
        if not any(of in one for one in words for of in (*ONE, *ALL)):
            raise UsageError(f"the command of {name} says nowhere what to play: {', '.join(ONE)}")
        return cls(name, words)

    @property
    def at_once(self) -> bool:
        """Whether one process plays all games."""
        return any(word in ALL for word in self.words)

    def command(self, folders: Sequence[Path]) -> list[str]:
        """Command for some campaigns, or for the first if it plays them one by one."""
        all_ = {ALL[0]: [one.name for one in folders], ALL[1]: [str(one) for one in folders]}
        one = folders[0]
        return [
            put
            for word in self.words
            for put in all_.get(word, [word.replace(ONE[0], one.name).replace(ONE[1], str(one))])
        ]


@dataclass(frozen=True)
class Played:
    """Result of one game.

    Attributes:
        entry: Name of the entry.
        game: Name of the campaign.
        command: Command as typed, for the record.
        exit_code: Exit code of the process; None if it had not ended by then.
        cpu_s: CPU time, user and system [s]: as stated by the answer, else that of the process if
            it played this game alone, else None.
        answer: A JSON object that it printed; None if there is none.
    """

    entry: str
    game: str
    command: str
    exit_code: int | None
    cpu_s: float | None
    answer: dict[str, Any] | None


def place(games: Path, entry: str, game: str) -> Path:
    """Where an answer is kept."""
    return games / sealed.ANSWERS / entry / f"{game}.json"


def play(games: Path, entries: Sequence[Entry]) -> Iterator[Played]:
    """Let every entry play what it has not played yet.

    Raises:
        InputError: The games are not sealed, or differ from what was sealed.
    """
    every = list(sealed.manifest(games).games)
    for entry in entries:
        left = [one for one in every if not place(games, entry.name, one).exists()]
        for some in [left] if entry.at_once else [[one] for one in left]:
            for done in _played(games, some, entry) if some else ():
                files.write(
                    place(games, entry.name, done.game), json.dumps(asdict(done), indent=1).encode()
                )
                yield done


def _played(games: Path, names: list[str], entry: Entry) -> Iterator[Played]:
    """Run one command in a temporary project that contains only these campaigns."""
    command = shlex.join(entry.words)
    with tempfile.TemporaryDirectory() as root:
        folders = [Path(root) / "data" / "raw" / name for name in names]
        for folder in folders:
            shutil.copytree(games / folder.name, folder)
        process = _Process(entry.command(folders), Path(root))
        left = dict.fromkeys(names)
        for said in process.objects():
            game = said.get("campaign", names[0]) if entry.at_once else names[0]
            if entry.at_once and game in left:
                del left[game]
                yield Played(entry.name, game, command, None, said.get("cpu_s"), said)
        for game in left:
            last = None if entry.at_once else process.last
            spent = (last or {}).get("cpu_s", None if entry.at_once else process.cpu_s)
            yield Played(entry.name, game, command, process.exit_code, spent, last)


class _Process:
    """A command, and the JSON objects that it prints, one per line.

    Attributes:
        last: The last of them.
        exit_code: Exit code, once it has ended.
        cpu_s: CPU time including its children, once it has ended [s].
    """

    def __init__(self, words: list[str], root: Path) -> None:
        self.words, self.root = words, root
        self.last: dict[str, Any] | None = None
        self.exit_code: int | None = None
        self.cpu_s = 0.0

    def objects(self) -> Iterator[dict[str, Any]]:
        """Yield every object until the command ends; closing the iterator ends the command."""
        begun = os.times()
        try:
            process = subprocess.Popen(
                self.words,
                cwd=self.root,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
        except OSError as problem:
            raise UsageError(
                f"{self.words[0]} cannot be carried out ({problem.strerror})"
            ) from problem
        with process, _ended(process):
            for line in process.stdout or ():
                if (said := _object(line)) is not None:
                    self.last = said
                    yield said
            self.exit_code = process.wait()
        ended = os.times()
        self.cpu_s = round(sum(ended[2:4]) - sum(begun[2:4]), 2)


@contextmanager
def _ended(process: subprocess.Popen[str]) -> Iterator[None]:
    """Leave no process behind."""
    try:
        yield
    finally:
        if process.poll() is None:
            process.kill()


def _object(line: str) -> dict[str, Any] | None:
    try:
        said = json.loads(line)
    except ValueError:
        return None
    return said if isinstance(said, dict) else None
