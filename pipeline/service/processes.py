"""Processes that start each other: whom Ctrl-C reaches, and who ends with whom."""

from __future__ import annotations

import contextlib
import datetime
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Iterator

from pipeline.base.shown import say

PYTHON = (sys.executable, "-P", "-m")
"""Runs a module of ours; never one that lies in the current folder, where anybody may write."""

PARENT = "PIPELINE_SERVE_PID"
"""The process of `pipeline serve`, for the processes that it starts."""

ROOT = "PIPELINE_ROOT"
"""The project's root, for the scan: the only thing that says where it looks and writes."""

REPORTS_URL = "PIPELINE_REPORTS_URL"
"""Where the folder reports/ is on the web; links in Prefect's page begin with it."""


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


def log(line: str) -> None:
    """One line on stdout with its time, for what runs by itself: it is read the next morning."""
    say(f"{datetime.datetime.now():%Y-%m-%d %H:%M:%S} {line}")


def follow(parent: int) -> None:
    """End this process when `parent` is gone: a run that outlives its service blocks the next."""
    direct = os.getppid() == parent  # then the number cannot be another process's by now

    def look() -> None:
        while os.getppid() == parent if direct else alive(parent):
            time.sleep(1)
        os._exit(1)  # files are written whole or not at all, locks end with the process

    threading.Thread(target=look, daemon=True).start()


def alive(process: int) -> bool:
    """Whether there is a process of this number."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # there is, of somebody else
        return True
    return True


def at_most(memory: int) -> None:
    """No more data in this process than so many bytes; some systems have no such limit."""
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    if most == resource.RLIM_INFINITY or memory < most:
        resource.setrlimit(resource.RLIMIT_DATA, (memory, most))
