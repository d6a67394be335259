"""Execution of work on the workers of a Dask cluster that is already running."""

from __future__ import annotations

import contextlib
import importlib
import itertools
import logging
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

from pipeline.base.errors import Unfinished, UsageError
from pipeline.base.shown import printable
from pipeline.service.executor import SEE, ItemResult, Sent, tried

S = TypeVar("S")
T = TypeVar("T")

_REACHED_S = 10.0
"""Time allowed for a scheduler to answer [s]."""

_DESERTED_S = 60.0
"""A cluster without a worker for so long gets none, and a worker that is not heard of for so long
stands still [s]; its scheduler waits for that one for five to ten minutes."""


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

    def results(self, work: Callable[[S], T], items: Iterable[S]) -> Iterator[ItemResult[S, T]]:
        """Yield results in the order in which they finish.

        Raises:
            UsageError: No scheduler answers, or it has no workers.
            Unfinished: The scheduler is gone, or has had no worker for a while.
        """
        with _connected(self.address) as client:
            left, at_work = iter(items), _AtWork(client, work)
            try:
                while True:
                    room = max(1, self._threads(client)) - len(at_work.waiting)
                    for item in itertools.islice(left, max(0, room)):
                        at_work.give(item)
                    if not at_work.waiting:
                        return
                    for future in self._ended(at_work):
                        if future in at_work.waiting:  # and not of an item that is done
                            yield self._done(at_work.taken(future), future)
            finally:
                client.cancel([*at_work.waiting])

    def _ended(self, at_work: _AtWork[S, T]) -> list[Any]:
        """Those that have ended, one at least."""
        client = at_work.client
        while True:
            with contextlib.suppress(TimeoutError), client.as_current():
                waiting = [*at_work.waiting]
                return [*_dask().wait(waiting, _DESERTED_S, "FIRST_COMPLETED").done]
            if not self._threads(client):
                thing = f"the cluster at {self.address} has no worker any more"
                raise Unfinished(thing, "start some and run it again to go on")
            at_work.go_round()

    def _threads(self, client: Any) -> int:
        """Number of items that the cluster can work on at the same time."""
        try:
            return sum(client.nthreads().values())
        except OSError:
            raise self._lost() from None

    def _lost(self) -> Unfinished:
        thing = f"the scheduler at {self.address} is gone"
        return Unfinished(thing, "start it and run it again to go on")

    def _done(self, item: S, future: Any) -> ItemResult[S, T]:
        """Result of an item."""
        try:
            return ItemResult(item, *future.result())
        except _dask().KilledWorker:
            return ItemResult(item, None, Unfinished("its worker was lost again and again", SEE))
        except _dask().CancelledError:
            raise self._lost() from None
        except Exception as problem:  # of transfer: `tried` catches those of the work
            words = printable(f"{type(problem).__name__}: {problem}", 200)
            thing = f"what its worker has made of it cannot be read here ({words})"
            return ItemResult(item, None, Unfinished(thing, SEE))


@dataclass
class _AtWork(Generic[S, T]):
    """What a cluster is at.

    Attributes:
        client: Of its scheduler.
        work: What is done with each item.
        waiting: Items by what will be made of them; one may be there twice.
        heard: When each worker was last heard of, as its scheduler says.
    """

    client: Any
    work: Callable[[S], T]
    waiting: dict[Any, S] = field(default_factory=dict)
    heard: dict[str, float] = field(default_factory=dict)

    def give(self, item: S, **where: Any) -> None:
        """Have an item worked on."""
        made = self.client.submit(_one_at_a_time, self.work, item, pure=False, **where)
        self.waiting[made] = item

    def taken(self, future: Any) -> S:
        """The item of what has ended; whoever else is at it may stop."""
        item = self.waiting.pop(future)
        twins = [one for one, other in self.waiting.items() if other is item]
        self.client.cancel(twins)
        for one in twins:
            del self.waiting[one]
        return item

    def go_round(self) -> None:
        """Give items to another worker whose own was not heard of since the last time, too.

        Its machine may be stopped, asleep or cut off. Where it goes on, the work is done twice and
        kept once.
        """
        known = self.client.scheduler_info(n_workers=-1)["workers"]
        now = {worker: float(entry["last_seen"]) for worker, entry in known.items()}
        still = [worker for worker, last in now.items() if self.heard.get(worker) == last]
        self.heard, awake = now, [*{*now} - {*still}]
        if not (still and awake):
            return
        theirs = {key for keys in self.client.processing(still).values() for key in keys}
        times = Counter(map(id, self.waiting.values()))
        for future, item in [*self.waiting.items()]:
            if future.key in theirs and times[id(item)] == 1:
                self.give(item, workers=awake)


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
