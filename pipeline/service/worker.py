"""Process in which a service computes campaigns, one after another; its parent is guard.py."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import sys
from dataclasses import asdict
from multiprocessing.connection import Connection
from pathlib import Path

from pipeline.app.outcome import Compute, Outcome, guarded, outcome
from pipeline.service.guard import PAGES
from pipeline.service.processes import follow
from pipeline.store.campaign import CampaignFolder


def main(root: str, engine: str, line: str, parent: str, memory: str) -> None:
    """Carry out the jobs received over the connection until it is closed.

    Args:
        root: Root of the project.
        engine: `local` or `prefect`.
        line: File descriptor of the connection to the parent.
        parent: Process whose end also ends this one.
        memory: Maximum memory of a campaign [bytes].
    """
    follow(int(parent))
    os.dup2(2, 1)  # whatever some library prints is no data
    _at_most(int(memory))
    with Connection(int(line)) as jobs:
        compute = _engine(engine)
        with contextlib.suppress(EOFError, OSError):  # the parent is gone
            while True:
                made = _done(Path(root), json.loads(jobs.recv_bytes()), compute)
                jobs.send_bytes(json.dumps(asdict(made)).encode())


def _at_most(memory: int) -> None:
    """No more data than so many bytes; some systems have no such limit."""
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    if most == resource.RLIM_INFINITY or memory < most:
        resource.setrlimit(resource.RLIMIT_DATA, (memory, most))


def _engine(engine: str) -> Compute:
    if engine == "prefect":
        from pipeline.service.flow import within

        return within
    from pipeline.run import run

    return run


def _done(root: Path, job: dict[str, str], compute: Compute) -> Outcome:
    if "folder" in job:
        return outcome(CampaignFolder(root, Path(job["folder"])), compute)
    return guarded(PAGES, lambda: _pages(root))


def _pages(root: Path) -> Outcome:
    from pipeline.answer import archive

    archive.refresh(root)
    return Outcome(PAGES, {}, "")


if __name__ == "__main__":
    main(*sys.argv[1:])
