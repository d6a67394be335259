"""Play cases in processes with limits, and keep the results so that a later run can continue."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from multiprocessing import connection, get_context
from pathlib import Path
from types import FrameType
from typing import Any

from bench.exam import JSON, Kept, code_of, package

SECONDS = 60.0
"""Maximum CPU time for one case [s], so that a busy machine causes no time-out: beyond it hangs.
The diagnosis of a campaign that nothing explains takes up to 40 s; `table.SLOW_MS` lists these."""

PATIENCE = 10
"""Maximum wall time in multiples of that [1]: on a busy machine a case gets a tenth of one."""

GRACE = 5.0
"""Further time after which an unresponsive process is killed [s]."""

MEMORY = 6 * 2**30
"""Maximum address space of one process [B]."""

Row = dict[str, Any]
Play = Callable[[int, str], Row]


class _TimeUp(BaseException):
    """The case has taken too long."""


def _alarm(signum: int, frame: FrameType | None) -> None:
    raise _TimeUp


def limited(play: Play, number: int, to: str, seconds: float) -> Row:
    """Result of a case, also if it exceeds its limits of time or memory."""
    began = time.process_time()
    signal.signal(signal.SIGALRM, _alarm)
    signal.signal(signal.SIGPROF, _alarm)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE * seconds)
    try:
        row = play(number, to)
    except _TimeUp as problem:
        row = {"outcome": "hang", "why": f"more than {seconds:g} s at {_stack(problem)}"}
    except MemoryError as problem:
        row = {"outcome": "memory", "why": _stack(problem)}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
    took = round(1e3 * (time.process_time() - began))
    return {"case": number, "to": to, **row, "ms": took}


def _stack(problem: BaseException) -> str:
    """Lines of the project's code in a traceback, innermost last."""
    own = [f for f in traceback.extract_tb(problem.__traceback__) if "/pipeline/" in f.filename]
    places = [f"{f.filename.rpartition('/pipeline/')[2]}:{f.lineno} {f.name}" for f in own]
    return " > ".join(places[-3:])


def case_row(number: int, to: str) -> Row:
    """Make a case, play it and judge it."""
    from bench.fuzz import judge as court
    from bench.fuzz.catalogue import case
    from bench.fuzz.play import as_row, play

    made = case(number)
    about = {"base": made.base, "mutations": [mutation.name for mutation in made.mutations]}
    try:
        played = play(made.files, to, lambda seen: court.suspicious(made, seen), made.shown)
        outcome = court.judge(made, played)
    except (_TimeUp, MemoryError) as problem:
        word = "memory" if isinstance(problem, MemoryError) else "hang"
        return {**about, "outcome": word, "why": _stack(problem)}
    return {**about, "outcome": outcome.word, "why": outcome.why, **as_row(played)}


def _work(pipe: connection.Connection, play: Play, seconds: float) -> None:
    """Play the cases received through the pipe."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if play is case_row:
        _warm()
    pipe.send(None)
    while True:
        try:
            number, to = pipe.recv()
        except EOFError:
            return
        pipe.send(limited(play, number, to, seconds))


def _warm() -> None:
    """Import and compute what is needed once, so that it does not count as time of a case."""
    from bench.fuzz.bases import NAMES
    from bench.fuzz.judge import clean

    for name in NAMES:
        clean(name)


@dataclass(eq=False)
class _Worker:
    """A process that plays cases, and its current case."""

    play: Play
    seconds: float
    at: tuple[int, str] | None = None
    since: float = 0.0

    def __post_init__(self) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(
            target=_work, args=(theirs, self.play, self.seconds), daemon=True
        )
        self.process.start()
        theirs.close()

    def give(self, number: int, to: str) -> None:
        self.at, self.since = (number, to), time.monotonic()
        self.pipe.send((number, to))

    def end(self) -> None:
        self.pipe.close()
        self.process.kill()
        self.process.join()


def played(
    asked: Iterable[tuple[int, str]],
    jobs: int = 1,
    play: Play = case_row,
    seconds: float = SECONDS,
) -> Iterator[Row]:
    """Yield results of cases, each a number and a depth, in the order in which they finish."""
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    left = iter(asked)
    workers = [_Worker(play, seconds) for _ in range(jobs)]
    try:
        while workers:
            ready = connection.wait([w.pipe for w in workers], timeout=0.5)
            for worker in list(workers):
                if worker.pipe in ready:
                    row = _heard(worker)
                elif worker.at and time.monotonic() - worker.since > PATIENCE * seconds + GRACE:
                    row = {"outcome": "hang", "why": "no signal reached it, the process was killed"}
                else:
                    continue
                if worker.at is not None and row is not None:
                    yield {"case": worker.at[0], "to": worker.at[1], **row}
                if row is not None and "ms" not in row:  # dead or unresponsive
                    worker.end()
                    workers[workers.index(worker)] = worker = _Worker(play, seconds)
                    continue
                worker.at = None
                further = next(left, None)
                if further is None:
                    worker.end()
                    workers.remove(worker)
                else:
                    worker.give(*further)
    finally:
        for worker in workers:
            worker.end()


def _heard(worker: _Worker) -> Row | None:
    """Message received through the pipe; None if the worker is ready for its first case."""
    try:
        row: Row | None = worker.pipe.recv()
    except (EOFError, OSError) as problem:
        worker.process.join(5)
        if worker.at is None:
            raise RuntimeError("a process that plays cases could not begin") from problem
        return {"outcome": "killed", "why": f"exit code {worker.process.exitcode}"}
    return row


# --- results -------------------------------------------------------------------------------------


@cache
def commit() -> str:
    """Short hash of the commit; with a plus if files differ from it."""
    git = ["git", "-C", str(Path(__file__).parent)]
    found = [
        subprocess.run([*git, *words], capture_output=True, text=True, check=False).stdout.strip()
        for words in (["rev-parse", "--short", "HEAD"], ["status", "--porcelain", "-uno"])
    ]
    return found[0] + ("+" if found[1] else "")


@cache
def code() -> str:
    """Hash of the code under test and of this fuzzer: results of other code are not reused."""
    return code_of([*package("app", "design"), *Path(__file__).parent.glob("*.*")])


def contest(
    cases: Iterable[int], to: str, results: Path, jobs: int = 1, seconds: float = SECONDS
) -> list[Row]:
    """Play the cases that are not yet in the file of results, and return the results of all."""
    cases, kept = list(cases), Kept(results, code(), JSON)
    rows = kept.rows()
    left = [(number, to) for number in cases if _key(number, to) not in rows]
    for row in played(left, min(jobs, len(left)), seconds=seconds):
        key = _key(row["case"], to)
        rows[key] = {**row, "commit": commit()}
        kept.add(key, rows[key])
        if sys.stderr.isatty():
            sys.stderr.write(f"\r{len(rows)} cases")
    return [rows[key] for key in (_key(number, to) for number in cases) if key in rows]


def _key(number: int, to: str) -> str:
    return f"{to}-{number}"
