"""Execution of work on the workers of a Dask cluster that is already running."""

from __future__ import annotations

import contextlib
import importlib
import itertools
import logging
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

from pipeline.base.errors import Unfinished, UsageError
from pipeline.base.shown import printable
from pipeline.service.executor import SEE, Done, Sent, tried

S = TypeVar("S")
T = TypeVar("T")

_REACHED_S = 10.0
"""Time allowed for a scheduler to answer [s]."""

_DESERTED_S = 60.0
"""A cluster without a worker for so long gets none [s]."""


@dataclass(frozen=True)
class Cluster:
    """Executor on the workers of a Dask cluster, as `executor.Executor`.

    They must have the same project installed. The scheduler decides how often an item is restarted
    whose worker was lost (`distributed.scheduler.allowed-failures`).

    Attributes:
        address: Address of its scheduler, `tcp://host:port`.
    """

    address: str
    near: ClassVar[bool] = False

    def results(self, work: Callable[[S], T], items: Iterable[S]) -> Iterator[Done[S, T]]:
        """Yield results in the order in which they finish.

        Raises:
            UsageError: No scheduler answers, or it has no workers.
            Unfinished: The scheduler is gone, or has had no worker for a while.
        """
        with _connected(self.address) as client:
            left, waiting = iter(items), dict[Any, S]()
            try:
                while True:
                    room = max(1, self._threads(client)) - len(waiting)
                    for item in itertools.islice(left, max(0, room)):
                        waiting[client.submit(_one_at_a_time, work, item, pure=False)] = item
                    if not waiting:
                        return
                    for future in self._ended(client, [*waiting]):
                        yield self._done(waiting.pop(future), future)
            finally:
                client.cancel([*waiting])

    def _ended(self, client: Any, futures: list[Any]) -> list[Any]:
        """Those that have ended, one at least."""
        while True:
            with contextlib.suppress(TimeoutError), client.as_current():
                return [*_dask().wait(futures, _DESERTED_S, "FIRST_COMPLETED").done]
            if not self._threads(client):
                thing = f"the cluster at {self.address} has no worker any more"
                raise Unfinished(thing, "start some and run it again to go on")

    def _threads(self, client: Any) -> int:
        """Number of items that the cluster can work on at the same time."""
        try:
            return sum(client.nthreads().values())
        except OSError:
            raise self._lost() from None

    def _lost(self) -> Unfinished:
        thing = f"the scheduler at {self.address} is gone"
        return Unfinished(thing, "start it and run it again to go on")

    def _done(self, item: S, future: Any) -> Done[S, T]:
        """Result of an item."""
        try:
            return Done(item, *future.result())
        except _dask().KilledWorker:
            return Done(item, None, Unfinished("its worker was lost again and again", SEE))
        except _dask().CancelledError:
            raise self._lost() from None
        except Exception as problem:  # of transfer: `tried` catches those of the work
            words = printable(f"{type(problem).__name__}: {problem}", 200)
            thing = f"what its worker has made of it cannot be read here ({words})"
            return Done(item, None, Unfinished(thing, SEE))


_ALONE = threading.Lock()
"""Held during the work on an item: a worker with several threads draws one report at a time."""


def _one_at_a_time(work: Callable[[S], T], item: S) -> Sent[T]:
    with _ALONE:
        return tried(work, item)


@contextlib.contextmanager
def _connected(address: str) -> Iterator[Any]:
    """Connect a client to the scheduler, which must have workers."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # our own sentence instead
    try:
        client = _dask().Client(address, timeout=_REACHED_S, set_as_default=False)
    except (OSError, ValueError) as problem:
        raise UsageError(
            f"no Dask scheduler answers at {address}: start one with `dask scheduler`, or correct "
            "the address, such as tcp://cluster.example:8786"
        ) from problem
    with client:
        if not client.nthreads():
            raise UsageError(
                f"the Dask scheduler at {address} has no workers: start some with "
                f"`dask worker {address} --nthreads 1`"
            )
        yield client


def _dask() -> Any:
    try:
        return importlib.import_module("distributed")
    except ImportError:
        raise UsageError(
            "a cluster needs the package distributed: pip install 'rail-stiffness[cluster]'"
        ) from None
