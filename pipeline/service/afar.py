"""A folder on object storage, asked by a process of its own within limits of time and memory.

A driver answers when the storage has: where that never is, the process that asks is ended.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, Pipe
from typing import Any

from pipeline.base.errors import CannotWrite, InputError
from pipeline.service.processes import PYTHON, at_most, follow
from pipeline.service.storage import Marks, Store

_LISTING_S = 300.0
"""How long a listing may take; one of a million objects takes half of it [s]."""
_OBJECT_S = 60.0
"""How long an object may take, without its bytes [s]."""
_BYTES_A_S = 2.5e5
"""Rate at which it has to come or go, or the process is ended [B/s]."""
_EACH_S = 0.5
"""Time that an object takes without having lost any [s]: the way to the storage and back."""
_LOST_S = 300.0
"""Time that objects may lose together, each what it takes above its bytes and `_EACH_S` [s]."""
_LISTING, _OBJECT = 2**31, 5 * 2**30
"""What the process may take: a million objects a third of it, or one of 2 GB, read twice [B]."""


@dataclass
class Afar(Store):
    """A folder on object storage; the process lives from one question to the next.

    It ends with the `with` block.
    """

    _line: Connection | None = field(default=None, init=False)
    _process: subprocess.Popen[bytes] | None = field(default=None, init=False)
    _left_s: float = field(default=_LOST_S, init=False)

    def __exit__(self, *_: object) -> None:
        """End the process."""
        if self._line is not None and self._process is not None:
            self._line.close()
            self._process.kill()
            self._process.wait()
        self._line = self._process = None

    def marks(self) -> Marks:
        """As `Store.marks`, which see.

        Raises:
            InputError: Also if it does not end.
        """
        many = "give a folder that holds campaigns alone, or see to the storage"
        if self._left_s <= 0:
            thing = f"{self.shown} cannot be read (its objects come too slowly)"
            raise InputError(thing, "run it again in a moment", passing=True)
        found = json.loads(self._asked("marks", limit_s=_LISTING_S, way_out=many))
        return {name: (size, put) for name, (size, put) in found.items()}

    def has(self, name: str) -> bool:
        """As `Store.has`, which see."""
        return bool(json.loads(self._timed(0, "has", name)))

    def read(self, name: str, mark: tuple[int, float]) -> bytes:
        """As `Store.read`, which see.

        Raises:
            InputError: Also if it comes too slowly.
        """
        return self._timed(mark[0], "read", name, mark)

    def write(self, name: str, data: bytes) -> None:
        """As `Store.write`, which see.

        Raises:
            CannotWrite: Also if it goes too slowly.
        """
        self._timed(len(data), "write", name, data=data)

    def _timed(self, size: int, *question: Any, data: bytes = b"") -> bytes:
        """The answer about an object, whose time is deducted from what all may lose."""
        began, due_s = time.monotonic(), max(size, 0) / _BYTES_A_S
        limit_s = due_s + _EACH_S + max(0.0, min(_OBJECT_S, self._left_s))
        try:
            return self._asked(*question, data=data, limit_s=limit_s)
        finally:
            self._left_s -= max(0.0, time.monotonic() - began - due_s - _EACH_S)

    def _asked(
        self,
        *question: Any,
        limit_s: float,
        data: bytes = b"",
        way_out: str = "see to the network or the storage, then run it again",
    ) -> bytes:
        """The answer of the process, which is ended if there is none."""
        line = self._line or self._start()
        try:
            line.send_bytes(json.dumps([self.url, *question]).encode())
            line.send_bytes(data)
            if not line.poll(limit_s):
                raise EOFError
            said, answer = json.loads(line.recv_bytes()), line.recv_bytes()
        except (EOFError, OSError):
            self.__exit__()
            raise self._unanswered(question, limit_s, way_out) from None
        if said is None:
            return answer
        raise InputError(**said) if isinstance(said, dict) else CannotWrite(said)

    def _unanswered(
        self, question: Sequence[Any], limit_s: float, way_out: str
    ) -> InputError | CannotWrite:
        what, within = "/".join([self.shown, *question[1:2]]), _memory(question[0]) / 2**30
        why = f"(no answer within {limit_s:.0f} s and {within:g} GiB)"
        if question[0] == "write":
            return CannotWrite(f"{what} cannot be written {why}; {way_out}.")
        return InputError(f"{what} cannot be read {why}", way_out, passing=True)

    def _start(self) -> Connection:
        self._line, theirs = Pipe()
        command = [*PYTHON, __name__, str(theirs.fileno()), str(os.getpid())]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
        )
        theirs.close()
        return self._line


def _memory(what: str) -> int:
    return _LISTING if what == "marks" else _OBJECT


def main(line: str, parent: str) -> None:
    """Answer what is asked over the connection until it is closed.

    Args:
        line: File descriptor of the connection to the parent.
        parent: Process whose end also ends this one.
    """
    follow(int(parent))
    stores: dict[str, Store] = {}
    with Connection(int(line)) as asked, contextlib.suppress(EOFError, OSError, MemoryError):
        while True:
            url, what, *words = json.loads(asked.recv_bytes())
            data = asked.recv_bytes()
            at_most(_memory(what))
            words += [data] if what == "write" else []
            said, answer = _answered(stores.setdefault(url, Store(url)), what, words)
            asked.send_bytes(json.dumps(said).encode())
            asked.send_bytes(answer)


def _answered(
    store: Store, what: str, words: Sequence[Any]
) -> tuple[dict[str, Any] | str | None, bytes]:
    """What went wrong, or None, and the answer."""
    try:
        answer = getattr(store, what)(*words)
    except InputError as problem:
        return problem.parts, b""
    except CannotWrite as problem:
        return str(problem), b""
    return None, answer if isinstance(answer, bytes) else json.dumps(answer).encode()


if __name__ == "__main__":
    main(*sys.argv[1:])
