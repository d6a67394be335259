"""The frame of every exam: games from seeds, played anywhere, kept as they finish, and a page.

An exam brings what it draws (fixtures), how a fixture is played and judged (a function of it alone,
so that results do not depend on process or order), and its tables.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from pydantic import ConfigDict, TypeAdapter

import pipeline
from pipeline.app.progress import Progress
from pipeline.base import files
from pipeline.base.errors import InputError, Interrupted
from pipeline.service.executor import Executor

F = TypeVar("F", bound=Hashable)
R = TypeVar("R")

END = "<!-- to here -->"

JSON = TypeAdapter(dict[str, Any], config=ConfigDict(ser_json_inf_nan="constants"))
"""Rows that are plain JSON."""


def seeds(path: Path, first: int, count: int) -> list[int]:
    """A number of seeds from a file of whole numbers.

    Raises:
        InputError: It contains fewer.
    """
    every = [int(word) for word in path.read_text("utf-8").split()]
    if first + count > len(every):
        raise InputError(
            f"holds {len(every)} seeds, and game {first + count} is asked for",
            "ask for fewer games, or give a longer file with --seeds",
            file=str(path),
        )
    return every[first : first + count]


def package(*without: str) -> list[Path]:
    """Files of the package, but for some of its folders."""
    here = Path(pipeline.__file__).parent
    every = [path.relative_to(here) for path in here.rglob("*") if path.is_file()]
    return [here / path for path in every if not {"__pycache__", *without} & {*path.parts}]


def code_of(paths: Iterable[Path]) -> str:
    """Hash of all files on which a result depends."""
    lines = (f"{path.name}:{files.sha256(path.read_bytes())}\n" for path in sorted(paths))
    return files.sha256("".join(lines).encode())[:16]


@dataclass(frozen=True)
class Kept(Generic[R]):
    """Rows of finished games in a file, one line of JSON each.

    Attributes:
        path: The file.
        code: Version of what makes the rows; those of another one stay, and do not count.
        row: Type of the rows.
    """

    path: Path
    code: str
    row: TypeAdapter[R]

    def rows(self) -> dict[str, R]:
        """Rows of this code by their keys; an incomplete last line is removed."""
        if not self.path.is_file():
            return {}
        text = self.path.read_text("utf-8")
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            files.write(self.path, whole.encode())
        every = map(json.loads, whole.splitlines())
        return {
            one["key"]: self.row.validate_python(one["row"])
            for one in every
            if one.get("code") == self.code
        }

    def add(self, key: str, row: R) -> None:
        """Append a row."""
        made = json.dumps({"code": self.code, "key": key})
        line = f'{made[:-1]}, "row": {self.row.dump_json(row).decode()}}}\n'
        with files.writing(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a", encoding="utf-8") as out:
                out.write(line)


def contest(
    wanted: Sequence[F],
    play: Callable[[F], R],
    key: Callable[[F], str],
    code: Callable[[], str],
    kept: Kept[R],
    executor: Executor,
    minutes: float = np.inf,
) -> list[R]:
    """Play what is left of these games; they do not depend on where they are played.

    Args:
        wanted: The games.
        play: Makes a row of a game, which depends on it alone; can be pickled.
        key: Name of a game among those that are kept.
        code: Version of what plays, in the process that does.
        kept: Where rows are kept; games in it are not played again.
        executor: Where games are played.
        minutes: Time after which no further game is begun; with 0, only finished ones count.

    Returns:
        The finished games, in their order.

    Raises:
        Interrupted: With the number of games that are kept.
        InputError: The code has changed on the way.
    """
    rows = kept.rows()
    left = [one for one in wanted if key(one) not in rows and minutes]
    begun = _begun(left, time.monotonic() + 60 * minutes)
    with Progress(len(left)) as progress:
        try:
            for game in executor.results(partial(_made, play, code), begun):
                by, row = game.result
                if by != kept.code:
                    raise InputError(
                        "would hold games of code that changed on the way",
                        "run it again",
                        file=str(kept.path),
                    )
                name = key(game.item)
                progress.now(name)
                kept.add(name, row)
                rows[name] = row
                progress.done()
        except KeyboardInterrupt:
            done = sum(key(one) in rows for one in wanted)
            raise Interrupted(
                f"Interrupted; {done} of {len(wanted)} games are kept in {kept.path}, and the same "
                "command goes on from there."
            ) from None
    return [rows[key(one)] for one in wanted if key(one) in rows]


def _made(play: Callable[[F], R], code: Callable[[], str], fixture: F) -> tuple[str, R]:
    """A row, and the version of the code that made it."""
    return code(), play(fixture)


def _begun(left: Iterable[F], end: float) -> Iterator[F]:
    """The next game, and further ones until a time of `time.monotonic`."""
    for number, fixture in enumerate(left):
        if number and time.monotonic() > end:
            return
        yield fixture


def between(old: str, begin: str, written: str) -> str:
    """A page with new text between a mark and `END`; without the mark it is appended."""
    before, found, rest = old.partition(begin)
    _, ended, after = rest.partition(END)
    if not (found and ended):
        before, after = old, "\n"
    return f"{before}{begin}\n{written}\n{END}{after}"


def write_between(page: Path, begin: str, title: str, written: Iterable[str]) -> None:
    """Write lines into a Markdown page between two marks; text outside of them is unchanged."""
    old = page.read_text("utf-8") if page.is_file() else f"# {title}\n\n"
    files.write(page, between(old, begin, "\n".join(written)).encode())
