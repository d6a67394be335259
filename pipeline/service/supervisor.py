"""`pipeline serve`: keep Prefect's server, the reports and the schedule running.

Each is a process of its own that is restarted when it ends or no longer answers. The supervisor
itself uses neither Prefect nor any campaign, so that little in it can fail.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.base import files
from pipeline.base.environment import NOBODYS
from pipeline.base.errors import UsageError
from pipeline.base.shown import printable
from pipeline.library.preferences import Preferences, Service
from pipeline.service import notify
from pipeline.service import server as service
from pipeline.service.processes import PARENT, PYTHON, REPORTS_URL, ROOT
from pipeline.store.campaign import dump

_LOOK_S = 1.0
"""Interval between two checks of the processes [s]."""
_SILENT_S = 60.0
"""Time without an answer after which a server is restarted [s]."""
_GRACE_S = 10.0
"""Time allowed for a process to end on request before it is killed [s]."""
_LONGEST_S = 60.0
"""Maximum pause before a process that ends repeatedly is restarted [s]."""
_STEADY_S = 600.0
"""Run time after which a process counts as sound, so that it is restarted without a pause [s]."""
_SET_BACK_S = 30.0
"""Lag of the clock from which it counts as set back [s]; smaller steps are those of a time
server."""
_LOG_BYTES = 2**24
"""Size from which a log is truncated [B]."""

_Tell = Callable[[str], object]
"""Receives one line per event."""


@dataclass
class _Child:
    """A process to be kept running.

    Attributes:
        what: Its name in messages.
        command: Command that starts it.
        log: File for its error output.
        answers: Whether it still works.
        shown: Whether its output goes to the screen.
        before: Called before it is started.
        since: When it was started, wall-clock time [s].
    """

    what: str
    command: Sequence[str]
    log: Path
    answers: Callable[[], bool]
    shown: bool = False
    before: Callable[[], object] = str
    since: float = 0.0
    _process: subprocess.Popen[bytes] | None = None
    _fails: int = 0
    _began: float = 0.0
    _heard: float = 0.0

    def start(self) -> None:
        """Start it, with an empty log."""
        self.before()
        files.write(self.log, b"")
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=None if self.shown else log,
                stderr=log,
                cwd=NOBODYS,
                start_new_session=True,  # Ctrl-C is meant for this process, which ends the others
            )
        self._began = self._heard = time.monotonic()
        self.since = time.time()

    @property
    def code(self) -> int | None:
        """Its exit code; None while it runs."""
        return None if self._process is None else self._process.poll()

    def look(self, tell: _Tell) -> None:
        """Restart it if necessary."""
        now = time.monotonic()
        if self._process is None:
            if now - self._began > min(2.0**self._fails, _LONGEST_S):
                self.start()
            return
        code = self.code
        if code is None and self.answers():
            self._heard = now
        if code is None and now - self._heard < _SILENT_S:
            self._cut_log()
            return
        text = "answers no more" if code is None else f"ended (exit code {code})"
        tell(f"{self.what} {text} and is started again; {self.log} may say why.")
        self._fails = 0 if now - self._began > _STEADY_S else self._fails + 1
        self.stop()
        self._began = now

    def _cut_log(self) -> None:
        with contextlib.suppress(OSError):
            if self.log.stat().st_size > _LOG_BYTES:
                os.truncate(self.log, 0)

    def stop(self) -> None:
        """End it and every process that it started."""
        process, self._process = self._process, None
        if process is None:
            return
        for number in (signal.SIGTERM, signal.SIGKILL):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_GRACE_S)


def serve(root: Path, preferences: Preferences, tell: _Tell) -> None:
    """Serve a project until told to stop.

    Args:
        root: The project's root.
        preferences: Port and schedule.
        tell: Receives the addresses of the pages, and every restart.

    Raises:
        UsageError: It is already served, a port is taken, or Prefect's server does not start.
        KeyboardInterrupt: Ctrl-C.
    """
    port = preferences.service.port
    with alone(root, preferences.service), _asked_to_stop() as asked:
        urls = settled(root, port)
        server = _Child(
            "Prefect's server",
            [*PYTHON, "pipeline.service.gate", str(root.absolute() / "reports"), str(port)],
            root / service.HOME / "server.log",
            lambda: service.works(urls["api"]),
            before=lambda: _mended(root, schedule, tell),
        )
        schedule = _Child(
            "The schedule",
            [*PYTHON, "pipeline.service.schedule", preferences.service.model_dump_json()],
            root / service.HOME / "schedule.log",
            lambda: not _stuck(root, preferences.service, schedule.since, urls["api"]),
            shown=True,
        )
        try:
            _started(server, asked)
            schedule.start()
            with _noted(root / service.HOME / service.SERVING, urls):
                tell(f"{urls['page']}  Prefect's page: runs, results, logs")
                tell(f"{root / service.HOME / service.PASSWORD}  what it asks for")
                if sys.stdout.isatty():  # a journal may be read by others
                    tell(f"{urls['page']}{service.ENTER}{key(root)}  or, once, this link to it")
                tell(f"{urls['reports']}  the reports, and how every campaign stands")
                notify.systemd("READY=1")
                ahead = _ahead_s()
                while not asked.wait(_LOOK_S):
                    if ahead - _ahead_s() > _SET_BACK_S:
                        tell("The clock was set back; whatever waits for a moment begins anew.")
                        schedule.stop()
                        server.stop()  # its own services now wait for times far in the future
                    ahead = _ahead_s()
                    for child in (server, schedule):
                        _looked(child, tell)
                    notify.systemd("WATCHDOG=1")
        finally:
            notify.systemd("STOPPING=1")
            schedule.stop()
            server.stop()


def _mended(root: Path, schedule: _Child, tell: _Tell) -> None:
    """Replace a damaged database; the schedule, which was stored in it, is restarted."""
    if sentence := service.mended(root):
        tell(sentence)
        schedule.stop()


def _stuck(root: Path, wanted: Service, since: float, api: str) -> bool:
    """Whether a scan begun since then hangs, or the next one is overdue."""
    look, now = service.LastScan.of(root), time.time()
    if look is None or look.began < since:
        look = service.LastScan(began=since, ended=since)
    if look.hangs(now, wanted.limit_s + wanted.quiet_s):
        return True
    return look.overdue(now, wanted.every_s) and not service.paused(api)


def _ahead_s() -> float:
    """Lead of the wall clock over the monotonic clock [s]."""
    return time.time() - time.monotonic()


def _looked(child: _Child, tell: _Tell) -> None:
    try:
        child.look(tell)
    except Exception as problem:  # full disk, no more processes: the next check may succeed
        tell(f"{child.what} cannot be supervised ({problem}); tried again.")
        time.sleep(_LOOK_S)


def _started(server: _Child, asked: threading.Event) -> None:
    until = time.monotonic() + service.PATIENCE_S
    server.start()
    while time.monotonic() < until and server.code is None and not asked.is_set():
        if server.answers():
            return
        time.sleep(0.3)
    if not asked.is_set():
        *_, last = ["it is silent", *server.log.read_text(errors="replace").split("\n")[:-1]]
        why = printable(last.rstrip("."), 400)
        raise UsageError(f"Prefect's server did not start ({why}); {server.log} says more")


@contextlib.contextmanager
def alone(root: Path, wanted: Service) -> Iterator[None]:
    """Ensure that a project has one service only: a second one would process the same campaigns.

    Args:
        root: The project's root.
        wanted: Schedule, recorded for `doctor`.

    Raises:
        UsageError: There is another service.
        CannotWrite: The disk cannot be written.
    """
    note = root / "data" / "processed" / service.RUNNING
    with service.held(note.with_name(service.LOCK), 0.0) as first:
        running = service.Running.of(root)
        if not first:
            by = f" by process {running.process}{running.afar}" if running else ""
            raise UsageError(f"{root.resolve()} is served already{by}: stop that first")
        running = service.Running(process=os.getpid(), every_s=wanted.every_s)
        with _noted(note, running.model_dump()):
            yield


@contextlib.contextmanager
def _asked_to_stop() -> Iterator[threading.Event]:
    """Event set on SIGTERM and Ctrl-C; after clean-up, Ctrl-C raises KeyboardInterrupt."""
    asked, by = threading.Event(), []

    def ask(number: int, _: object) -> None:
        by.append(number)
        asked.set()

    before = {number: signal.signal(number, ask) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if signal.SIGINT in by:
        raise KeyboardInterrupt


def settled(root: Path, port: int) -> dict[str, str]:
    """Set the environment of processes to come; return addresses `page`, `api`, `reports`."""
    page = f"http://{service.HERE}:{port}"
    urls = {"page": page, "api": f"{page}/api", "reports": f"http://{service.HERE}:{port + 1}"}
    _free(port)
    _free(port + 1)
    with files.writing(root / "reports"):
        (root / "reports").mkdir(exist_ok=True)
    password = _password(root)
    os.environ |= {
        "PREFECT_API_URL": urls["api"],
        "PREFECT_SERVER_API_AUTH_STRING": password,
        "PREFECT_API_AUTH_STRING": password,
        "PREFECT_UI_API_URL": urls["api"],
        REPORTS_URL: urls["reports"],
        ROOT: str(root.resolve()),
        PARENT: str(os.getpid()),
    }
    service.settle(root)
    return urls


def _password(root: Path) -> str:
    """The password, kept so that browsers need not ask again, in a file only its owner can read."""
    known = service.known_password(root)
    path, new = root / service.HOME / service.PASSWORD, f"pipeline:{secrets.token_urlsafe(16)}"
    with files.writing(path):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if known and re.fullmatch(r"[!-~]+:[!-~]+", known):
            path.chmod(0o600)
            return known
        return _secret(path, new)  # also replaces half a password, from a full disk


def key(root: Path) -> str:
    """A new key to Prefect's page, valid once, in a file that only its owner can read."""
    return _secret(root / service.HOME / service.KEY, secrets.token_urlsafe(32))


def _secret(path: Path, words: str) -> str:
    path.unlink(missing_ok=True)
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(words)
    return words


def _free(port: int, patience_s: float = 20.0) -> None:
    """Wait until a port is free; a server stopped a moment ago may still hold it."""
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        try:
            socket.create_server((service.HERE, port)).close()
            return
        except OSError:
            time.sleep(0.5)
    raise UsageError(f"port {port} is taken by another program: choose another with --port")


@contextlib.contextmanager
def _noted(note: Path, content: object) -> Iterator[None]:
    """Record something for other commands, as long as it holds."""
    files.write(note, dump(content))
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            note.unlink(missing_ok=True)
