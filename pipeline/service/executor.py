"""Executors of work: in this process or in several; service/cluster.py has a Dask cluster.

The work is a function that can be pickled and that depends on its item alone, so that results do
not depend on where they are computed; results are returned in the order in which they finish.
"""

from __future__ import annotations

import contextlib
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

from pipeline.base.environment import OWN_VARIABLES
from pipeline.base.errors import PipelineError, Unfinished

S = TypeVar("S")
T = TypeVar("T")

Sent = tuple[T | None, Exception | None]
"""What a worker sends back: the value of an item, or why there is none."""

_AGAIN = 2
"""Maximum number of restarts of an item whose process was lost."""

_GRACE_S = 5.0
"""Time allowed for a process whose connection broke to end by itself [s]."""

SEE = "see whether it is computed alone, and how much memory it needs"


@dataclass(frozen=True)
class ItemResult(Generic[S, T]):
    """Result of one item.

    Attributes:
        item: Item of the work.
        value: Value returned; None if the work failed.
        problem: Exception raised; None if there was none.
    """

    item: S
    value: T | None
    problem: Exception | None = None

    @property
    def result(self) -> T:
        """Value returned by the work.

        Raises:
            Exception: The exception raised by the work.
            Unfinished: Its process was lost repeatedly.
        """
        if self.problem is not None:
            raise self.problem
        return self.value  # type: ignore[return-value]  # None only if the work returns it


class Executor(Protocol):
    """Executes work on many items.

    Attributes:
        near: Whether the work has access to the folders of this machine.
    """

    near: ClassVar[bool]

    def results(self, work: Callable[[S], T], items: Iterable[S]) -> Iterator[ItemResult[S, T]]:
        """Yield the result of each item as it finishes; items are consumed as capacity allows.

        Closing the iterator stops the work.
        """


def in_order(executor: Executor, work: Callable[[S], T], items: Iterable[S]) -> list[T]:
    """Values of all items, in their order.

    Raises:
        Exception: That of the first item that fails.
    """
    found = executor.results(partial(_numbered, work), enumerate(items))
    return [value for _, value in sorted((one.item[0], one.result) for one in found)]


def _numbered(work: Callable[[S], T], numbered: tuple[int, S]) -> T:
    return work(numbered[1])


def tried(work: Callable[[S], T], item: S) -> Sent[T]:
    """Value of the work or its exception, in a form that can be pickled."""
    try:
        return work(item), None
    except Exception as problem:
        return None, _portable(problem)


def _portable(problem: Exception) -> Exception:
    """The exception if it can be pickled, else its text; a note contains the traceback."""
    if isinstance(problem, PipelineError):  # its message says everything
        return problem
    problem.add_note("".join(traceback.format_exception(problem)).rstrip())
    try:
        pickle.loads(pickle.dumps(problem))
    except Exception:
        plain = RuntimeError(f"{type(problem).__name__}: {problem}")
        plain.add_note(problem.__notes__[-1])
        return plain
    return problem


@dataclass(frozen=True)
class InThisProcess:
    """In this process, one item after another."""

    near: ClassVar[bool] = True

    def results(self, work: Callable[[S], T], items: Iterable[S]) -> Iterator[ItemResult[S, T]]:
        """Yield results in the order of the items."""
        for item in items:
            try:
                done = ItemResult[S, T](item, work(item))
            except Exception as problem:
                done = ItemResult[S, T](item, None, problem)
            yield done


@dataclass(frozen=True)
class InProcesses:
    """In several processes of this machine.

    Attributes:
        number: Number of processes; by default that of the cores.
    """

    number: int = field(default_factory=lambda: os.cpu_count() or 1)
    near: ClassVar[bool] = True

    def results(self, work: Callable[[S], T], items: Iterable[S]) -> Iterator[ItemResult[S, T]]:
        """Yield results as they finish; an item is restarted twice if its process is lost."""
        os.environ |= OWN_VARIABLES  # inherited by the processes
        left = iter(items)
        workers: list[_Worker[S, T]] = []
        try:
            for _, item in zip(range(self.number), left, strict=False):
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
    """A process and its current item; the process is replaced when it is lost."""

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
        """Start work on an item."""
        self.item, self._lost = item, 0
        self._send()

    def _send(self) -> None:
        with contextlib.suppress(OSError):  # it has ended, which the next read shows
            self.line.send(self.item)

    def given_next(self, left: Iterator[S]) -> bool:
        """Start work on the next item, or end the process if there is none."""
        for item in left:
            self.give(item)
            return True
        self.end()
        return False

    def heard(self) -> ItemResult[S, T] | None:
        """Result of the item; None if it is restarted."""
        try:
            return ItemResult(self.item, *self.line.recv())
        except (EOFError, OSError):
            self._process.join(_GRACE_S)
        code = self.end()
        self._start()
        if self._lost == _AGAIN:
            return ItemResult(self.item, None, Unfinished(gone(code), SEE))
        self._lost += 1
        self._send()
        return None

    def end(self) -> int | None:
        """End the process; return its exit code."""
        self.line.close()
        self._process.kill()
        self._process.join()
        return self._process.exitcode


def _listen(line: connection.Connection, work: Callable[[S], T]) -> None:
    """Work on items received from the connection until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C reaches all: avoids a traceback from here
    parent = parent_process()
    assert parent is not None
    threading.Thread(target=_follow, args=(parent,), daemon=True).start()
    with contextlib.suppress(EOFError, OSError):  # the other end is closed
        while True:
            _answer(line, tried(work, line.recv()))


def _answer(line: connection.Connection, made: Sent[Any]) -> None:
    try:
        line.send(made)
    except OSError:
        raise
    except Exception as problem:  # it cannot be pickled; nothing has been sent yet
        line.send((None, _portable(problem)))


def _follow(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)  # files are written completely or not at all, and locks end with the process


def gone(code: int | None) -> str:
    """Describe how a process ended before its work was done, from its exit code."""
    if code == -signal.SIGKILL:
        return "its process was killed, by the system when memory was short or by somebody"
    if code is not None and code < 0:
        return f"its process crashed ({signal.Signals(-code).name})"
    return f"its process ended (exit code {code})"
