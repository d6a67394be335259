"""Where work is carried out: in this process or in several; service/cluster.py has a Dask cluster.

The work is a function that can be pickled and that depends on its item alone, so that results are
the same wherever they come from; only their order is that in which they end.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import connection, get_context, parent_process
from multiprocessing.context import SpawnProcess
from multiprocessing.process import BaseProcess
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from pipeline.base.environment import OURS
from pipeline.base.errors import PipelineError, Unfinished

S = TypeVar("S")
T = TypeVar("T")

Sent = tuple[T | None, Exception | None]
"""What travels back: the value of an item, or why there is none."""

_AGAIN = 2
"""How often an item is begun again whose process was lost."""

_GRACE_S = 5.0
"""How long a process whose line broke may take to end by itself [s]."""

SEE = "see whether it is computed alone, and how much memory it needs"


@dataclass(frozen=True)
class Done(Generic[S, T]):
    """What became of one item.

    Attributes:
        item: What the work was done on.
        value: What it gave; None where it failed.
        problem: Why it failed; None where it did not.
    """

    item: S
    value: T | None
    problem: Exception | None = None

    @property
    def result(self) -> T:
        """What the work gave.

        Raises:
            Exception: What the work has raised.
            Unfinished: Its process was lost again and again.
        """
        if self.problem is not None:
            raise self.problem
        return self.value  # type: ignore[return-value]  # None only where the work gives it


class Executor(Protocol):
    """Carries out work on many items.

    Attributes:
        near: Whether the work sees the folders of this machine.
    """

    near: ClassVar[bool]

    def results(self, work: Callable[[S], T], items: Iterable[S]) -> Iterator[Done[S, T]]:
        """What becomes of each item, as it ends; items are taken when there is room for them.

        Who stops listening stops the work.
        """


def in_order(executor: Executor, work: Callable[[S], T], items: Iterable[S]) -> list[T]:
    """What the work gives for each item, in their order.

    Raises:
        Exception: Of the first item that fails.
    """
    found = executor.results(partial(_numbered, work), enumerate(items))
    return [value for _, value in sorted((one.item[0], one.result) for one in found)]


def _numbered(work: Callable[[S], T], numbered: tuple[int, S]) -> T:
    return work(numbered[1])


def tried(work: Callable[[S], T], item: S) -> Sent[T]:
    """What the work gives, or why it fails, as something that can travel."""
    try:
        return work(item), None
    except Exception as problem:
        return None, _portable(problem)


def _portable(problem: Exception) -> Exception:
    """The problem where it can be pickled, else its words; a note says where it has happened."""
    if isinstance(problem, PipelineError):  # a sentence, which says all
        return problem
    problem.add_note("".join(traceback.format_exception(problem)).rstrip())
    try:
        pickle.loads(pickle.dumps(problem))
    except Exception:
        told = RuntimeError(f"{type(problem).__name__}: {problem}")
        told.add_note(problem.__notes__[-1])
        return told
    return problem


@dataclass(frozen=True)
class Here:
    """In this process, one after another."""

    near: ClassVar[bool] = True

    def results(self, work: Callable[[S], T], items: Iterable[S]) -> Iterator[Done[S, T]]:
        """In the order of the items."""
        for item in items:
            try:
                done = Done[S, T](item, work(item))
            except Exception as problem:
                done = Done[S, T](item, None, problem)
            yield done


@dataclass(frozen=True)
class Processes:
    """In so many processes of this machine.

    Attributes:
        number: How many; as many as there are cores when not given.
    """

    number: int = field(default_factory=lambda: os.cpu_count() or 1)
    near: ClassVar[bool] = True

    def results(self, work: Callable[[S], T], items: Iterable[S]) -> Iterator[Done[S, T]]:
        """As they end; an item whose process is lost is begun again in another, at most twice."""
        os.environ |= OURS  # which they inherit
        left = iter(items)
        workers: list[_Worker[S, T]] = []
        try:
            for item in itertools.islice(left, self.number):
                workers.append(_Worker(work))
                workers[-1].give(item)
            while workers:
                ready = connection.wait([worker.line for worker in workers])
                for worker in [one for one in workers if one.line in ready]:
                    done = worker.heard()
                    if done is None:
                        continue
                    yield done
                    if not worker.given_next(left):
                        workers.remove(worker)
        finally:
            for worker in workers:
                worker.end()


class _Worker(Generic[S, T]):
    """A process and the item that it is at; another process when it is lost."""

    item: S
    line: connection.Connection
    _process: SpawnProcess

    def __init__(self, work: Callable[[S], T]) -> None:
        self._work, self._lost = work, 0
        self._start()

    def _start(self) -> None:
        spawn = get_context("spawn")
        self.line, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_listen, args=(theirs, self._work), daemon=True)
        self._process.start()
        theirs.close()

    def give(self, item: S) -> None:
        """Have an item worked on."""
        self.item, self._lost = item, 0
        self._send()

    def _send(self) -> None:
        with contextlib.suppress(OSError):  # it is gone, which shows when it is listened to
            self.line.send(self.item)

    def given_next(self, left: Iterator[S]) -> bool:
        """Have the next item worked on, or end where there is none."""
        for item in left:
            self.give(item)
            return True
        self.end()
        return False

    def heard(self) -> Done[S, T] | None:
        """What has become of the item; None where it is begun again."""
        try:
            return Done(self.item, *self.line.recv())
        except (EOFError, OSError):
            self._process.join(_GRACE_S)
        code = self.end()
        self._start()
        if self._lost == _AGAIN:
            return Done(self.item, None, Unfinished(gone(code), SEE))
        self._lost += 1
        self._send()
        return None

    def end(self) -> int | None:
        """End the process; its exit code."""
        self.line.close()
        self._process.kill()
        self._process.join()
        return self._process.exitcode


def _listen(line: connection.Connection, work: Callable[[S], T]) -> None:
    """Work on what comes over the line until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C reaches all: no traceback of this one
    parent = parent_process()
    assert parent is not None
    threading.Thread(target=_follow, args=(parent,), daemon=True).start()
    with contextlib.suppress(EOFError, OSError):  # nobody is there any more
        while True:
            _answer(line, tried(work, line.recv()))


def _answer(line: connection.Connection, made: Sent[Any]) -> None:
    try:
        line.send(made)
    except OSError:
        raise
    except Exception as problem:  # it cannot be pickled, of which nothing was sent yet
        line.send((None, _portable(problem)))


def _follow(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)  # files are written whole or not at all, locks end with the process


def gone(code: int | None) -> str:
    """How a process ended that had work to do, from its exit code."""
    if code == -signal.SIGKILL:
        return "its process was killed, by the system when memory was short or by somebody"
    if code is not None and code < 0:
        return f"its process crashed ({signal.Signals(-code).name})"
    return f"its process ended (exit code {code})"
