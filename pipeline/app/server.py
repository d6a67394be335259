"""Prefect's server on this machine, and what must stand before Prefect is imported.

Nothing here imports Prefect.
"""

from __future__ import annotations

import contextlib
import functools
import http.server
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.base import files
from pipeline.base.errors import UsageError
from pipeline.store.campaign import dump

HOME = ".prefect"
"""Prefect's own files, under the project's root."""

HERE = "127.0.0.1"
PATIENCE_S = 120.0

REPORTS_URL = "PIPELINE_REPORTS_URL"
"""Where the folder reports/ is on the web; links in Prefect's page begin with it."""


PARENT = "PIPELINE_SERVE_PID"
"""The process of `pipeline serve`, for the processes that it starts."""


def settle(root: Path) -> None:
    """Settings that must stand in the environment before Prefect is imported.

    What the user has set already stays: with PREFECT_API_URL the flow runs on that server, else on
    the one of `pipeline serve` where it runs. Logs go to Prefect's page in full; on the screen
    they would bury the one sentence that matters.
    """
    os.environ.setdefault("PREFECT_HOME", str(root.resolve() / HOME))
    os.environ.setdefault("DO_NOT_TRACK", "1")
    os.environ.setdefault("PREFECT_SERVER_ANALYTICS_ENABLED", "false")
    os.environ.setdefault("PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS", f"{PATIENCE_S:.0f}")
    os.environ.setdefault("PREFECT_SERVER_DATABASE_TIMEOUT", "60")  # a busy disk locks SQLite
    os.environ.setdefault("PREFECT_SERVER_DATABASE_CONNECTION_TIMEOUT", "60")
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")
    here = serving(root)
    if here is not None and "PREFECT_API_URL" not in os.environ:
        os.environ["PREFECT_API_URL"] = here["api"]
        os.environ.setdefault(REPORTS_URL, here["reports"])


def free(port: int, patience_s: float = 20.0) -> None:
    """Wait for a port; a server that was stopped a moment ago may still hold it."""
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HERE, port))
            except OSError:
                time.sleep(0.5)
            else:
                return
    raise UsageError(f"port {port} is taken by another program: choose another with --port")


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


@contextlib.contextmanager
def running(root: Path, port: int) -> Iterator[None]:
    """Prefect's server as a process that ends with this one, however this one ends."""
    command = [sys.executable, "-m", "prefect", "server", "start", "--host", HERE]
    command += ["--port", str(port)]
    log = root / HOME / "server.log"
    with files.writing(log):
        log.parent.mkdir(parents=True, exist_ok=True)
        log.write_bytes(b"")
    with log.open("wb") as kept:
        leash = subprocess.Popen(
            [sys.executable, "-m", "pipeline.app.supervise", *command],
            env={**os.environ, "PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL": "WARNING"},
            stdin=subprocess.PIPE,
            stdout=kept,
            stderr=kept,
            start_new_session=True,  # Ctrl-C is for this process, which stops the server last
        )
        try:
            _answering(f"http://{HERE}:{port}/api", leash, log)
            yield
        finally:
            leash.communicate()


def _answering(api: str, process: subprocess.Popen[bytes], log: Path) -> None:
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and process.poll() is None:
        if answers(api):
            return
        time.sleep(0.3)
    raise UsageError(f"Prefect's server did not start: {log} says why")


def answers(api: str) -> bool:
    """Whether a Prefect server answers at this address, .../api."""
    try:
        with urllib.request.urlopen(f"{api.rstrip('/')}/health", timeout=2) as answer:
            return bool(answer.status == 200)
    except (urllib.error.URLError, OSError):
        return False


@contextlib.contextmanager
def reports(root: Path, port: int) -> Iterator[None]:
    """The reports under an address of this machine: a browser follows no link to a file."""
    folder = root / "reports"
    with files.writing(folder):
        folder.mkdir(exist_ok=True)
    handler = functools.partial(_Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer((HERE, port), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield
        finally:
            server.shutdown()


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


@contextlib.contextmanager
def recorded(root: Path, urls: dict[str, str]) -> Iterator[None]:
    """A note of where this project is served, for `run` and for a second `serve`."""
    note = root / HOME / "serving.json"
    files.write(note, dump(urls))
    try:
        yield
    finally:
        note.unlink(missing_ok=True)


def serving(root: Path) -> dict[str, str] | None:
    """Where this project is served now; None where it is not."""
    try:
        urls: dict[str, str] = json.loads((root / HOME / "serving.json").read_bytes())
    except (FileNotFoundError, ValueError):
        return None
    return urls if answers(urls["api"]) else None


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
