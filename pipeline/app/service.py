"""By itself through Prefect: on this machine alone, or on a team's own server.

Also what must stand before Prefect is imported; nothing here imports it early.
"""

from __future__ import annotations

import contextlib
import functools
import http.server
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.app.processes import PARENT, REPORTS_URL, sheltered
from pipeline.base import files
from pipeline.base.errors import UsageError
from pipeline.store.campaign import dump, recalled

HOME = ".prefect"
"""Prefect's own files, under the project's root."""

_HERE = "127.0.0.1"
"""Only this machine sees the pages."""

_PATIENCE_S = 120.0
"""How long Prefect's server may take to start [s]; on a busy machine it can need a minute."""


@contextlib.contextmanager
def up(root: Path, port: int) -> Iterator[dict[str, str]]:
    """Prefect's server and the reports' on this machine, for as long as the block runs.

    Args:
        root: The project's root.
        port: Of Prefect's page; the reports get the next.

    Yields:
        The addresses: `page`, `api`, `reports`.

    Raises:
        UsageError: The port is taken, or Prefect's server does not start.
        KeyboardInterrupt: After the block; Prefect's runner swallows it and comes back.
    """
    already = serving(root)
    if already is not None:
        raise UsageError(f"{root.resolve()} is served already: see {already['page']}")
    page = f"http://{_HERE}:{port}"
    urls = {"page": page, "api": f"{page}/api", "reports": f"http://{_HERE}:{port + 1}"}
    _free(port)
    _free(port + 1)
    os.environ["PREFECT_API_URL"] = urls["api"]
    os.environ[REPORTS_URL] = urls["reports"]
    os.environ[PARENT] = str(os.getpid())
    settle(root)
    with (
        sheltered(signal.SIGTERM),  # which Prefect's runner takes for a wish to stop
        running(root, port),
        _reports(root, port + 1),
        _recorded(root, urls),
    ):
        yield urls
    raise KeyboardInterrupt


def join(root: Path) -> None:
    """Make the Prefect server of PREFECT_API_URL the one that is spoken to.

    Raises:
        UsageError: PREFECT_API_URL is not set, or nobody answers there.
    """
    api = os.environ.get("PREFECT_API_URL", "").rstrip("/")
    if not api:
        raise UsageError(
            "PREFECT_API_URL is not set: give the address of your Prefect server, "
            "such as http://prefect.example:4200/api"
        )
    if not answers(api):
        raise UsageError(
            f"no Prefect server answers at {api}: start it, or correct PREFECT_API_URL"
        )
    settle(root)


def settle(root: Path) -> None:
    """Settings that must stand in the environment before Prefect is imported.

    What the user has set already stays: with PREFECT_API_URL the flow runs on that server, else on
    the one of `pipeline serve` where it runs. Logs go to Prefect's page in full; on the screen
    they would bury the one sentence that matters.
    """
    os.environ.setdefault("PREFECT_HOME", str(root.resolve() / HOME))
    os.environ.setdefault("DO_NOT_TRACK", "1")
    os.environ.setdefault("PREFECT_SERVER_ANALYTICS_ENABLED", "false")
    os.environ.setdefault("PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS", f"{_PATIENCE_S:.0f}")
    os.environ.setdefault("PREFECT_SERVER_DATABASE_TIMEOUT", "60")  # a busy disk locks SQLite
    os.environ.setdefault("PREFECT_SERVER_DATABASE_CONNECTION_TIMEOUT", "60")
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")
    here = serving(root)
    if here is not None and "PREFECT_API_URL" not in os.environ:
        os.environ["PREFECT_API_URL"] = here["api"]
        os.environ.setdefault(REPORTS_URL, here["reports"])


def _free(port: int, patience_s: float = 20.0) -> None:
    """Wait for a port; a server that was stopped a moment ago may still hold it."""
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        try:
            socket.create_server((_HERE, port)).close()
            return
        except OSError:
            time.sleep(0.5)
    raise UsageError(f"port {port} is taken by another program: choose another with --port")


@contextlib.contextmanager
def running(root: Path, port: int) -> Iterator[None]:
    """Prefect's server as a process that ends with this one, however this one ends."""
    command = [sys.executable, "-m", "prefect", "server", "start", "--host", _HERE]
    command += ["--port", str(port)]
    log = root / HOME / "server.log"
    files.write(log, b"")
    with log.open("wb") as kept:
        leash = subprocess.Popen(
            [sys.executable, "-m", "pipeline.app.processes", *command],
            env={**os.environ, "PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL": "WARNING"},
            stdin=subprocess.PIPE,
            stdout=kept,
            stderr=kept,
            start_new_session=True,  # Ctrl-C is for this process, which stops the server last
        )
        try:
            _answering(f"http://{_HERE}:{port}/api", leash, log)
            yield
        finally:
            leash.communicate()


def _answering(api: str, process: subprocess.Popen[bytes], log: Path) -> None:
    until = time.monotonic() + _PATIENCE_S
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
    except OSError:
        return False


@contextlib.contextmanager
def _reports(root: Path, port: int) -> Iterator[None]:
    """The reports under an address of this machine: a browser follows no link to a file."""
    folder = root / "reports"
    with files.writing(folder):
        folder.mkdir(exist_ok=True)
    handler = functools.partial(_Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer((_HERE, port), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield
        finally:
            server.shutdown()


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


@contextlib.contextmanager
def _recorded(root: Path, urls: dict[str, str]) -> Iterator[None]:
    """A note of where this project is served, for `run` and for a second `serve`."""
    note = root / HOME / "serving.json"
    files.write(note, dump(urls))
    try:
        yield
    finally:
        note.unlink(missing_ok=True)


def serving(root: Path) -> dict[str, str] | None:
    """Where this project is served now; None where it is not."""
    urls: dict[str, str] | None = recalled(root / HOME / "serving.json")
    return urls if urls and answers(urls["api"]) else None
