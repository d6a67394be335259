"""Commands that the page runs: each a process of its own, in a folder that is nobody's."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
import time
from collections.abc import Coroutine, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.base.environment import NOBODYS
from pipeline.base.errors import InputError

_LONGEST_S = 120.0
"""A command that only looks at files takes no longer."""

_MOST_WORDS = 20_000
"""Letters of what a command says beside its answer that are kept."""


_LONGEST_LINE = 2**22
"""Bytes of a line of records."""


@dataclass(frozen=True)
class Said:
    """What a command said.

    Attributes:
        code: Its exit code; negative if a signal ended it.
        content: The JSON on its output; empty where there was none.
        output: Its output as it is.
        words: What it said beside it, line by line.
    """

    code: int
    content: Mapping[str, Any]
    output: bytes
    words: tuple[str, ...]

    @property
    def records(self) -> list[dict[str, Any]]:
        """Every line of its output that is a record."""
        return [found for line in self.output.splitlines() if (found := _content(line))]

    @property
    def runs_next(self) -> bool:
        """Of `check`: whether it says to run the campaign next, whatever else it notes."""
        words = str(self.content.get("next", "")).split()
        return self.accepted and not self.content.get("wrong") and words[:2] == ["pipeline", "run"]

    @property
    def accepted(self) -> bool:
        """Whether it did what it was asked, perhaps with rows left out."""
        known = bool(self.content) and "error" not in self.content
        return known and self.code in (0, InputError.exit_code)


async def begun(*words: str | Path) -> asyncio.subprocess.Process:
    """A command of ours, running; it and its children end together."""
    return await asyncio.create_subprocess_exec(
        sys.executable,
        *("-P", "-m", "pipeline", *map(str, words)),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        cwd=NOBODYS,
        start_new_session=True,
        limit=_LONGEST_LINE,
        env={**os.environ, "COLUMNS": "200", "NO_COLOR": "1"},
    )


def _stopped(process: asyncio.subprocess.Process, how: int = signal.SIGINT) -> None:
    """Stop a command and all that it has started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, how)


async def ended(process: asyncio.subprocess.Process, longest_s: float | None = None) -> Said:
    """What a command says until it ends."""
    try:
        output, words = await asyncio.wait_for(process.communicate(), longest_s)
    except (TimeoutError, asyncio.CancelledError):
        _stopped(process, signal.SIGKILL)
        await process.wait()
        raise
    text = words.decode("utf-8", "replace")[-_MOST_WORDS:]
    lines = tuple(one for one in text.splitlines() if one.strip())
    return Said(process.returncode or 0, _content(output), output, lines)


def _content(output: bytes) -> dict[str, Any]:
    """The last line of an output that is a record."""
    for line in reversed(output.splitlines()):
        with contextlib.suppress(ValueError):
            if isinstance(found := json.loads(line), dict):
                return found
    return {}


async def command(*words: str | Path) -> Said:
    """What a command says that only looks."""
    return await ended(await begun(*words), _LONGEST_S)


@dataclass
class _Run:
    """One campaign that is being computed, or was.

    Attributes:
        process: The command.
        began: When, by the monotonic clock.
        said: What it said in the end; None while it runs.
        cancelled: Whether somebody stopped it.
    """

    process: asyncio.subprocess.Process
    began: float
    said: Said | None = None
    cancelled: bool = False
    took_s: float = 0.0

    async def follow(self) -> None:
        """Until it ends."""
        self.said = await ended(self.process)
        self.took_s = time.monotonic() - self.began

    @property
    def seconds(self) -> float:
        """How long it takes, or took."""
        return self.took_s if self.said else time.monotonic() - self.began


@dataclass
class Runs:
    """All campaigns that this page has begun to compute, by name."""

    of: dict[str, _Run] = field(default_factory=dict)
    live: dict[str, Live] = field(default_factory=dict)
    _one: asyncio.Lock = field(default_factory=asyncio.Lock)
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)

    async def begin(self, root: Path, name: str) -> _Run:
        """Compute a campaign; one that is running already goes on."""
        async with self._one:
            there = self.of.get(name)
            if there is not None and there.said is None:
                return there
            words: Sequence[str | Path] = (
                "run",
                "--root",
                root,
                "--engine",
                "local",
                "--json",
                "--",
                name,
            )
            self.of[name] = run = _Run(await begun(*words), time.monotonic())
            self._followed(run.follow())
            return run

    async def look_on(self, root: Path, name: str) -> None:
        """Judge a campaign while it is measured; one that is judged already goes on."""
        async with self._one:
            there = self.live.get(name)
            if there is None or not there.running:
                words = ("watch", "--live", "--json", "--root", root, "--", name)
                self.live[name] = live = Live(await begun(*words))
                self._followed(live.follow())

    def look_away(self, name: str) -> None:
        """No longer."""
        if (live := self.live.get(name)) is not None and live.running:
            _stopped(live.process)

    def _followed(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def cancel(self, name: str) -> None:
        """Stop one; what it has not finished is discarded, as after Ctrl-C."""
        run = self.of.get(name)
        if run is not None and run.said is None:
            run.cancelled = True
            _stopped(run.process)

    async def close(self) -> None:
        """Stop all."""
        for name in self.of:
            self.cancel(name)
        for name in self.live:
            self.look_away(name)
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(asyncio.gather(*self._tasks, return_exceptions=True), 5.0)


@dataclass
class Live:
    """One campaign that is judged while it is measured.

    Attributes:
        process: `pipeline watch --live --json`.
        updates: What it has told so far.
        words: What it said beside, once it has ended.
    """

    process: asyncio.subprocess.Process
    updates: list[dict[str, Any]] = field(default_factory=list)
    words: tuple[str, ...] | None = None

    async def follow(self) -> None:
        """Until it ends."""
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        async for line in self.process.stdout:
            if found := _content(line):
                self.updates.append(found)
        words = (await self.process.stderr.read()).decode("utf-8", "replace")
        self.words = tuple(one for one in words[-_MOST_WORDS:].splitlines() if one.strip())
        await self.process.wait()

    @property
    def running(self) -> bool:
        """Whether it still looks."""
        return self.words is None


def stage(processed: Path, since: float) -> str:
    """Which table of the campaign was written last, by its number and name.

    Args:
        processed: Folder of its tables.
        since: Time of the day when the run began [s].
    """
    if not processed.is_dir():
        return ""
    found = []
    for one in processed.glob("*.parquet"):
        with contextlib.suppress(FileNotFoundError):  # the run puts another in its place
            found.append((one.stat().st_mtime, one.stem))
    newest = max((one for one in found if one[0] >= since - 1.0), default=(0.0, ""))[1]
    return newest.partition("_")[2].replace("_", " ")
