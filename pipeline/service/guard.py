"""A guard around whatever a service does with a campaign: limits of time and memory, a process.

The campaign is worked at in a process of its own (worker.py), which takes a few of them and is then
replaced, so that memory stays as it is however many there are. One that hangs, grows without end or
crashes costs its own result and nothing else.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from types import TracebackType
from typing import Any

from pipeline.app.outcome import Outcome, failed
from pipeline.base.errors import Unfinished
from pipeline.base.preferences import Service
from pipeline.service.executor import gone
from pipeline.service.processes import PYTHON
from pipeline.store.campaign import CampaignFolder

_TAKES = 8
"""Campaigns per process: importing the libraries takes as long as computing one small campaign."""

_GRACE_S = 20.0
"""How long a process may take to send its last logs and end [s]."""

PAGES = "overview"
"""In place of a campaign's name, where the page over all of them is drawn."""


@dataclass
class _Worker:
    """A process and the line to it; `taken` jobs so far."""

    process: subprocess.Popen[bytes]
    line: Connection
    taken: int = 0


class Guard:
    """Works at campaigns in other processes; what goes wrong there is an outcome here."""

    def __init__(self, root: Path, engine: str, limits: Service) -> None:
        """Start nothing yet.

        Args:
            root: The project's root.
            engine: `local` or `prefect`.
            limits: `limit_s` and `memory_gib` of a campaign.
        """
        self.root, self.engine, self.limits = root, engine, limits
        self._worker: _Worker | None = None

    def __enter__(self) -> Guard:
        """Ready."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        problem: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the process; nobody waits for a campaign that is not wanted any more."""
        self._end(at_once=kind is not None)

    def campaign(self, campaign: CampaignFolder) -> Outcome:
        """Bring one campaign up to date."""
        return self._asked(campaign.name, {"folder": os.fspath(campaign.folder)})

    def pages(self) -> Outcome | None:
        """Bring the page over all campaigns up to date; what went wrong, if anything did."""
        made = self._asked(PAGES, {"pages": True})
        return made if made.exit_code else None

    def _asked(self, name: str, job: Mapping[str, Any]) -> Outcome:
        """What became of a job, the end of its process included."""
        try:
            worker = self._worker or self._start()
            worker.taken += 1
            worker.line.send_bytes(json.dumps(job).encode())
            if not worker.line.poll(self.limits.limit_s):
                self._end(at_once=True)
                return failed(name, self._too_slow())
            made = Outcome(**json.loads(worker.line.recv_bytes()))
        except (EOFError, OSError):  # the line broke: the process is gone
            return failed(name, self._gone())
        if worker.taken >= _TAKES:
            self._end()
        return made

    def _start(self) -> _Worker:
        ours, theirs = Pipe()
        memory = int(self.limits.memory_gib * 2**30)
        words = [self.root, self.engine, theirs.fileno(), os.getpid(), memory]
        process = subprocess.Popen(
            [*PYTHON, "pipeline.service.worker", *map(str, words)],
            stdin=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            start_new_session=True,  # Ctrl-C is for the service, which ends its workers
        )
        theirs.close()
        self._worker = _Worker(process, ours)
        return self._worker

    def _too_slow(self) -> Unfinished:
        return Unfinished(
            f"not finished after {self.limits.limit_s:g} s, the limit for one campaign",
            "look for what is too large in its files, or raise limit_s in pipeline.toml",
        )

    def _gone(self) -> Unfinished:
        return Unfinished(
            gone(self._end(at_once=True)),
            "see whether `pipeline run` computes it, and how much memory it needs",
        )

    def _end(self, at_once: bool = False) -> int | None:
        """End the process; its exit code."""
        worker, self._worker = self._worker, None
        if worker is None:
            return None
        worker.line.close()  # which it takes for the end of its work
        process = worker.process
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(1.0 if at_once else _GRACE_S)
        with contextlib.suppress(ProcessLookupError):  # and whatever it has started
            os.killpg(process.pid, signal.SIGKILL)
        return process.wait()
