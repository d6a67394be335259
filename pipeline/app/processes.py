"""Processes that start each other: whom Ctrl-C reaches, and who ends with whom.

`python -m pipeline.app.processes COMMAND` runs COMMAND until whoever started it is gone: the parent
holds the other end of stdin and never writes; the end of file is the end of the parent, even of one
that was killed and could tell nobody.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

PARENT = "PIPELINE_SERVE_PID"
"""The process of `pipeline serve`, for the processes that it starts."""

REPORTS_URL = "PIPELINE_REPORTS_URL"
"""Where the folder reports/ is on the web; links in Prefect's page begin with it."""

_GRACE_S = 10.0
"""How long a command may take to end when it is told to, before it is killed [s]."""


def stop_on_sigterm() -> None:
    """End as an ordinary exit on SIGTERM, so that everything is put away."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))


@contextlib.contextmanager
def sheltered(end: int) -> Iterator[None]:
    """Ctrl-C reaches every process of a terminal; within the block it is for this one alone.

    What is started here inherits the blocked signal, so that Prefect's processes end when they are
    told to and print no tracebacks. A thread takes it, through the wakeup file because some library
    may have a thread that gets it first, and sends `end` to this process.

    Args:
        end: The signal that ends the work in the block, such as SIGTERM; a KeyboardInterrupt, as
            long as nobody else in the block handles it.

    Raises:
        KeyboardInterrupt: After the block, when it was Ctrl-C that ended it: Prefect's runner, told
            to stop, calls that a good end.
    """
    if threading.current_thread() is not threading.main_thread():  # which gets all signals
        yield
        return
    over, asked = threading.Event(), threading.Event()
    taken, given = os.pipe()

    def take() -> None:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        while (number := os.read(taken, 1)) and not over.is_set():
            if number[0] == signal.SIGINT:
                asked.set()
                os.kill(os.getpid(), end)

    os.set_blocking(given, False)
    taker = threading.Thread(target=take, daemon=True)
    ended = signal.signal(end, signal.default_int_handler)
    interrupted = signal.signal(signal.SIGINT, lambda *_: None)
    woken = signal.set_wakeup_fd(given, warn_on_full_buffer=False)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    taker.start()
    try:
        yield
    except SystemExit:
        if not asked.is_set():
            raise
    finally:
        over.set()
        os.write(given, b"\0")
        taker.join()
        signal.set_wakeup_fd(woken)
        os.close(taken)
        os.close(given)
        signal.signal(end, ended)
        signal.signal(signal.SIGINT, interrupted)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    if asked.is_set():
        raise KeyboardInterrupt


def follow(parent: int) -> None:
    """End this process when `parent` is gone: a run that outlives its service blocks the next."""

    def look() -> None:
        while True:
            try:
                os.kill(parent, 0)
            except ProcessLookupError:
                os._exit(1)  # files are written whole or not at all, locks end with the process
            time.sleep(1)

    threading.Thread(target=look, daemon=True).start()


def main() -> int:
    """Run the command; its exit code."""
    process = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)
    threading.Thread(target=_end_with_stdin, args=[process], daemon=True).start()
    return process.wait()


def _end_with_stdin(process: subprocess.Popen[bytes]) -> None:
    sys.stdin.buffer.read()
    process.terminate()
    try:
        process.wait(_GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()


if __name__ == "__main__":
    sys.exit(main())
