"""Processes that start each other: which of them Ctrl-C reaches, and which end together."""

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

from pipeline.app.outcome import Outcome
from pipeline.base.shown import printable, say

PYTHON = (sys.executable, "-P", "-m")
"""Command that runs a module of ours; never one in the current folder, which anybody may write
to."""

PARENT = "PIPELINE_SERVE_PID"
"""Variable with the number of the process `pipeline serve`, for the processes that it starts."""

ROOT = "PIPELINE_ROOT"
"""Variable with the project's root; it alone says where the scan reads and writes."""

REPORTS_URL = "PIPELINE_REPORTS_URL"
"""Variable with the web address of the folder reports/; links on Prefect's page begin with it."""


def stop_on_sigterm() -> None:
    """End with an ordinary exit on SIGTERM, so that everything is cleaned up."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))


@contextlib.contextmanager
def sheltered(end: int) -> Iterator[None]:
    """Let Ctrl-C reach only this process within the block, not every process of the terminal.

    Processes started here inherit the blocked signal, so that Prefect's processes end when they are
    told to and print no tracebacks. A thread receives the signal and sends `end` to this process;
    it uses the wakeup file descriptor, since a thread of some library may get the signal first.

    Args:
        end: Signal that ends the work in the block, such as SIGTERM; it raises KeyboardInterrupt
            unless the block installs another handler.

    Raises:
        KeyboardInterrupt: After the block, if Ctrl-C ended it: Prefect's runner, told to stop,
            treats that as success.
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
    """Print a line with its time, for unattended processes: it is read the next morning."""
    say(f"{datetime.datetime.now():%Y-%m-%d %H:%M:%S} {line}")


def follow(parent: int) -> None:
    """End this process when `parent` is gone: a run that outlives its service blocks the next."""
    direct = os.getppid() == parent  # then the number cannot belong to another process

    def look() -> None:
        while os.getppid() == parent if direct else alive(parent):
            time.sleep(1)
        os._exit(1)  # files are written whole or not at all; locks end with the process

    threading.Thread(target=look, daemon=True).start()


def alive(process: int) -> bool:
    """Whether a process with this number exists."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # it exists, and belongs to another user
        return True
    return True


def at_most(memory: int) -> None:
    """No more data in this process than so many bytes; some systems have no such limit."""
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    if most == resource.RLIM_INFINITY or memory < most:
        resource.setrlimit(resource.RLIMIT_DATA, (memory, most))


def event(made: Outcome) -> str:
    """One line on a campaign for the screen."""
    if made.complaints and made.verdict is None:
        return made.complaints[0]
    text = " ".join(made.content.get("verdict_sentence", [])[:1])
    return f"{printable(made.campaign)}: {text or made.text}"
