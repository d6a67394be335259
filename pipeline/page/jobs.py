"""Commands that the page runs, each in its own process and in a neutral folder."""

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
"""Time limit of a command that only reads [s]."""

_MOST_WORDS = 20_000
"""Maximum number of characters kept of a command's stderr."""


_LONGEST_LINE = 2**22
"""Maximum length of a line of output [B]."""


@dataclass(frozen=True)
class CommandOutput:
    """Output of a command.

    Attributes:
        code: Exit code; negative if ended by a signal.
        content: Last JSON object on stdout; empty if there is none.
        output: stdout, unchanged.
        words: Lines of stderr.
    """

    code: int
    content: Mapping[str, Any]
    output: bytes
    words: tuple[str, ...]

    @property
    def records(self) -> list[dict[str, Any]]:
        """All lines of stdout that are JSON objects."""
        return [found for line in self.output.splitlines() if (found := _content(line))]

    @property
    def runs_next(self) -> bool:
        """For `check`: whether the campaign can be run next, whatever else is noted."""
        words = str(self.content.get("next", "")).split()
        return self.accepted and not self.content.get("wrong") and words[:2] == ["pipeline", "run"]

    @property
    def accepted(self) -> bool:
        """Whether the command succeeded, perhaps with rows rejected."""
        known = bool(self.content) and "error" not in self.content
        return known and self.code in (0, InputError.exit_code)


async def _begun(*words: str | Path) -> asyncio.subprocess.Process:
    """Start a command of this project; it and its children are ended together."""
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
    """Stop a command and all its children."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, how)


async def _ended(
    process: asyncio.subprocess.Process, longest_s: float | None = None
) -> CommandOutput:
    """Wait for a command to end; return its output."""
    try:
        output, words = await asyncio.wait_for(process.communicate(), longest_s)
    except (TimeoutError, asyncio.CancelledError):
        _stopped(process, signal.SIGKILL)
        await process.wait()
        raise
    text = words.decode("utf-8", "replace")[-_MOST_WORDS:]
    lines = tuple(one for one in text.splitlines() if one.strip())
    return CommandOutput(process.returncode or 0, _content(output), output, lines)


def _content(output: bytes) -> dict[str, Any]:
    """The last line of an output that is a JSON object."""
    for line in reversed(output.splitlines()):
        with contextlib.suppress(ValueError):
            if isinstance(found := json.loads(line), dict):
                return found
    return {}


async def command(*words: str | Path) -> CommandOutput:
    """Run a command that only reads; return its output."""
    return await _ended(await _begun(*words), _LONGEST_S)


@dataclass
class _Run:
    """The run of one campaign, active or finished.

    Attributes:
        process: The command.
        began: Start, by the monotonic clock [s].
        said: Its output; None while it runs.
        cancelled: Whether the user stopped it.
        took_s: Duration of a finished run [s].
    """

    process: asyncio.subprocess.Process
    began: float
    said: CommandOutput | None = None
    cancelled: bool = False
    took_s: float = 0.0

    async def follow(self) -> None:
        """Wait until it ends."""
        self.said = await _ended(self.process)
        self.took_s = time.monotonic() - self.began

    @property
    def seconds(self) -> float:
        """Duration so far, or in total [s]."""
        return self.took_s if self.said else time.monotonic() - self.began


@dataclass
class Runs:
    """All runs and live judgements started by this page, by campaign."""

    of: dict[str, _Run] = field(default_factory=dict)
    live: dict[str, LiveJob] = field(default_factory=dict)
    _one: asyncio.Lock = field(default_factory=asyncio.Lock)
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)

    async def begin(self, root: Path, name: str) -> _Run:
        """Start the run of a campaign, unless it is already running."""
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
            self.of[name] = run = _Run(await _begun(*words), time.monotonic())
            self._followed(run.follow())
            return run

    async def look_on(self, root: Path, name: str) -> None:
        """Start judging a campaign while it is measured, unless that is already running."""
        async with self._one:
            there = self.live.get(name)
            if there is None or not there.running:
                words = ("watch", "--live", "--json", "--root", root, "--", name)
                self.live[name] = live = LiveJob(await _begun(*words))
                self._followed(live.follow())

    def look_away(self, name: str) -> None:
        """Stop judging a campaign."""
        if (live := self.live.get(name)) is not None and live.running:
            _stopped(live.process)

    def _followed(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def cancel(self, name: str) -> None:
        """Stop a run; unfinished output is discarded, as after Ctrl-C."""
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
class LiveJob:
    """Live judgement of a campaign while it is measured.

    Attributes:
        process: `pipeline watch --live --json`.
        updates: Updates so far.
        words: Lines of stderr, once it has ended.
    """

    process: asyncio.subprocess.Process
    updates: list[dict[str, Any]] = field(default_factory=list)
    words: tuple[str, ...] | None = None

    async def follow(self) -> None:
        """Collect updates until it ends."""
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
        """Whether it is still running."""
        return self.words is None


def stage(processed: Path, since: float) -> str:
    """Name of the table of the campaign that was written last.

    Args:
        processed: Folder of its tables.
        since: When the run began, wall-clock time [s].
    """
    if not processed.is_dir():
        return ""
    found = []
    for one in processed.glob("*.parquet"):
        with contextlib.suppress(FileNotFoundError):  # the run puts another in its place
            found.append((one.stat().st_mtime, one.stem))
    newest = max((one for one in found if one[0] >= since - 1.0), default=(0.0, ""))[1]
    return newest.partition("_")[2].replace("_", " ")
