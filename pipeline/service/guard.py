"""Guard for the work on campaigns: limits of time and memory, in a separate process.

Campaigns are computed in a process of their own (worker.py), which is replaced after a few of them,
so that memory does not grow with their number. One that hangs, grows without bound or crashes loses
only its own result.
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
from pipeline.library.preferences import Service
from pipeline.service.executor import gone
from pipeline.service.processes import PYTHON
from pipeline.store.campaign import CampaignFolder

_TAKES = 8
"""Number of campaigns per process: importing the libraries takes as long as one small campaign."""

_GRACE_S = 20.0
"""Time allowed for a process to send its last logs and end [s]."""

PAGES = "overview"
"""Name used instead of a campaign's for the page over all campaigns."""


@dataclass
class _Worker:
    """A process, the connection to it, and the number of jobs given to it so far."""

    process: subprocess.Popen[bytes]
    line: Connection
    taken: int = 0


class Guard:
    """Computes campaigns in other processes; failures there are returned as outcomes."""

    def __init__(self, root: Path, engine: str, limits: Service) -> None:
        """Initialise, without starting a process.

        Args:
            root: The project's root.
            engine: `local` or `prefect`.
            limits: `limit_s` and `memory_gib` of a campaign.
        """
        self.root, self.engine, self.limits = root, engine, limits
        self._worker: _Worker | None = None

    def __enter__(self) -> Guard:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        problem: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the process; at once after an exception."""
        self._end(at_once=kind is not None)

    def campaign(self, campaign: CampaignFolder) -> Outcome:
        """Bring one campaign up to date."""
        return self._asked(campaign.name, {"folder": os.fspath(campaign.folder)})

    def pages(self) -> Outcome | None:
        """Bring the page over all campaigns up to date; return the failure, if any."""
        made = self._asked(PAGES, {"pages": True})
        return made if made.exit_code else None

    def _asked(self, name: str, job: Mapping[str, Any]) -> Outcome:
        """Outcome of a job, also if its process ends or is too slow."""
        try:
            worker = self._worker or self._start()
            worker.taken += 1
            worker.line.send_bytes(json.dumps(job).encode())
            if not worker.line.poll(self.limits.limit_s):
                self._end(at_once=True)
                return failed(name, self._too_slow())
            made = Outcome(**json.loads(worker.line.recv_bytes()))
        except (EOFError, OSError):  # the connection broke: the process has ended
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
            start_new_session=True,  # Ctrl-C is meant for the service, which ends its workers
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
        """End the process; return its exit code."""
        worker, self._worker = self._worker, None
        if worker is None:
            return None
        worker.line.close()  # which tells it that its work is over
        process = worker.process
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(1.0 if at_once else _GRACE_S)
        with contextlib.suppress(ProcessLookupError):  # and any process that it started
            os.killpg(process.pid, signal.SIGKILL)
        return process.wait()
