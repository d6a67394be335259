"""Which Prefect server is spoken to, and what must stand in the environment before Prefect is.

Nothing here imports Prefect, which takes seconds.
"""

from __future__ import annotations

import base64
import contextlib
import http.client
import importlib.util
import json
import os
import secrets
import shutil
import sqlite3
import urllib.error
import urllib.request
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar

from filelock import FileLock, Timeout
from pydantic import ValidationError

from pipeline.base import files
from pipeline.base.errors import CannotWrite, UsageError
from pipeline.base.strict import Strict
from pipeline.service.processes import REPORTS_URL
from pipeline.store.campaign import recalled

HERE = "127.0.0.1"
"""Only this machine sees the pages."""

HOME = ".prefect"
"""Prefect's own files, under the project's root."""
_DATABASE = "prefect.db"
PASSWORD, KEY, SERVING = "password", "key", "serving.json"
"""Files in HOME: Prefect's runs; what the API asks for, as user:password; what lets a browser in
without it, once; where we are served."""
ENTER = "/enter/"
"""Where that key is shown to the server of Prefect's page."""

PATIENCE_S = 120.0
"""How long Prefect's server may take to start [s]; on a busy machine it can need a minute."""

RUNNING, LOOKED = "service.json", "look.json"
"""Files in data/processed: who serves this project, and when data/raw was last looked at."""

LOCK, LOOKING = ".service.lock", ".look.lock"
"""Beside them, held by who serves, and by a worker that looks; no campaign's own folder begins with
a dot."""

_LATE = 3
"""A look that is so many intervals late will not come."""
SLOW_S = 120.0
"""Nor one so long after it was due [s], however short the interval."""
_STEP_S = 3600.0
"""How long a step of a look may take beside a campaign: the first copy of an object storage [s]."""

_ROOM = 2**25
"""Bytes that Prefect's database and its journal take in the first runs, and as much again."""

_KEPT_S = 30 * 86400
"""How long Prefect remembers a run [s]; the results are not Prefect's and stay."""


class Running(Strict):
    """Who serves a project.

    Attributes:
        process: `pipeline serve` or `watch`.
        every_s: From one look to the next [s]; None where a cron line says when.
    """

    process: int
    every_s: float | None

    @classmethod
    def of(cls, root: Path) -> Running | None:
        """As noted; None where nobody serves it."""
        return _noted(cls, root / "data" / "processed" / RUNNING)


class Looked(Strict):
    """When data/raw was last looked at, by this machine's clock [s].

    Attributes:
        began: The beginning of the look.
        alive: The beginning of the last step in it, a campaign or less.
        ended: Its end; None while it is at work, or when it was killed.
        campaign: The one that is at work in that step, as it is shown; empty where none is.
        drawn: The page over all campaigns is of what there was at its end.
    """

    began: float
    alive: float = 0.0
    ended: float | None = None
    campaign: str = ""
    drawn: bool = False

    def hangs(self, now: float, limit_s: float) -> bool:
        """Whether one step takes longer than any may, where a campaign may take `limit_s`."""
        return self.ended is None and now - max(self.began, self.alive) > limit_s + _STEP_S

    def overdue(self, now: float, every_s: float | None) -> bool:
        """Whether the next look should have begun long ago; nobody knows where cron says when."""
        if every_s is None or self.ended is None:
            return False
        return now - self.ended > max(_LATE * every_s, SLOW_S)

    @classmethod
    def of(cls, root: Path) -> Looked | None:
        """As noted; None before the first."""
        return _noted(cls, root / "data" / "processed" / LOOKED)


@contextlib.contextmanager
def looking(root: Path) -> Iterator[bool]:
    """Whether nobody else looks at data/raw for a team; within the block nobody does."""
    processed = root / "data" / "processed"
    with files.writing(processed):
        processed.mkdir(parents=True, exist_ok=True)
    lock = FileLock(processed / LOOKING)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        yield False
        return
    try:
        yield True
    finally:
        lock.release()


_Note = TypeVar("_Note", bound=Strict)


def _noted(kind: type[_Note], path: Path) -> _Note | None:
    try:
        return kind.model_validate(recalled(path))
    except ValidationError:
        return None


def has_room(home: Path) -> None:
    """See that Prefect's database can grow, instead of waiting for a server that never starts.

    Raises:
        CannotWrite: It cannot.
    """
    free = shutil.disk_usage(home).free
    if free < _ROOM:
        raise CannotWrite(
            f"{home} has {free / 2**20:.0f} MiB left, Prefect's database needs {_ROOM >> 20}; "
            "free some space, or use --engine local."
        )


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
    the one of `pipeline serve` where it runs, else on one of its own, which ends with it. The last
    two are closed to other origins, and to whoever does not know the password. Logs go to Prefect's
    page in full; on the screen they would bury the one sentence that matters.

    Raises:
        UsageError: The environment names a proxy that Prefect cannot work with.
    """
    _see_proxies()
    given = os.environ.setdefault
    given("PREFECT_HOME", str(root.resolve() / HOME))
    given("PREFECT_PROFILES_PATH", os.devnull)
    given("PREFECT_LOGGING_SETTINGS_PATH", _logging())
    given("DO_NOT_TRACK", "1")
    given("PREFECT_SERVER_ANALYTICS_ENABLED", "false")
    given("PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS", f"{PATIENCE_S:.0f}")
    given("PREFECT_SERVER_DATABASE_TIMEOUT", "60")  # a busy disk locks SQLite
    given("PREFECT_SERVER_DATABASE_CONNECTION_TIMEOUT", "60")
    given("PREFECT_SERVER_SERVICES_DB_VACUUM_ENABLED", "events,flow_runs")
    given("PREFECT_SERVER_SERVICES_DB_VACUUM_RETENTION_PERIOD", str(_KEPT_S))
    given("PREFECT_SERVER_CORS_ALLOWED_ORIGINS", "")
    given("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")
    if "PREFECT_API_URL" in os.environ:
        return
    here = serving(root)
    if here is not None:
        os.environ["PREFECT_API_URL"] = here["api"]
        given(REPORTS_URL, here["reports"])
    password = known_password(root) if here is not None else secrets.token_urlsafe(16)
    if password is not None:
        given("PREFECT_SERVER_API_AUTH_STRING", password)
        given("PREFECT_API_AUTH_STRING", password)


def _see_proxies() -> None:
    """Prefect's client has a connection for each proxy, also where none of them is asked."""
    if {*urllib.request.getproxies()} <= {"no"}:
        return
    import httpx

    try:
        httpx.Client().close()
    except (ImportError, ValueError, httpx.InvalidURL) as problem:
        raise UsageError(
            f"Prefect cannot work with the proxies of the environment ({problem}): correct or "
            "unset http_proxy, https_proxy and all_proxy, or use --engine local or watch"
        ) from problem


def _logging() -> str:
    """Prefect's own settings of its logs, else it takes a file of its home, which can run code."""
    package = importlib.util.find_spec("prefect")  # which imports nothing
    assert package is not None
    assert package.origin is not None
    return str(Path(package.origin).parent / "logging" / "logging.yml")


def known_password(root: Path) -> str | None:
    """The password of this project's server; None for those who may not read it."""
    try:
        return (root / HOME / PASSWORD).read_text()
    except (OSError, ValueError):
        return None


def answers(api: str) -> bool:
    """Whether a Prefect server answers at this address, .../api."""
    try:
        with urllib.request.urlopen(f"{api.rstrip('/')}/health", timeout=2) as answer:
            return bool(answer.status == 200)
    except (OSError, http.client.HTTPException, ValueError):
        return False


def works(api: str) -> bool:
    """Whether a Prefect server answers, also what it has to look up; a slow disk is no failure."""
    try:
        _asked(f"{api}/deployments/count")
    except urllib.error.HTTPError as refused:
        if refused.code >= http.HTTPStatus.INTERNAL_SERVER_ERROR:
            return False
    except (OSError, http.client.HTTPException, ValueError):
        pass
    return answers(api)


def paused(api: str) -> bool:
    """Whether somebody has paused the schedule on Prefect's page."""
    try:
        return any(one["paused"] for one in _asked(f"{api}/deployments/filter"))
    except (OSError, http.client.HTTPException, ValueError, LookupError, TypeError):
        return False


def _asked(address: str) -> Any:
    """What this project's server answers to a question of its API."""
    key = base64.b64encode(os.environ.get("PREFECT_API_AUTH_STRING", "").encode()).decode()
    head = {"Content-Type": "application/json", "Authorization": f"Basic {key}"}
    with urllib.request.urlopen(urllib.request.Request(address, b"{}", head), timeout=5) as answer:
        return json.loads(answer.read())


def mended(root: Path) -> str:
    """Move a database aside that Prefect cannot read; what to say of it, empty where it is sound.

    Prefect would neither start on it nor make another. It only has what the pages of earlier runs
    show: answers and reports are not in it.

    Raises:
        CannotWrite: It cannot be moved.
    """
    base = root / HOME / _DATABASE
    why = _damage(base)
    if not why:
        return ""
    aside = f".damaged-{datetime.now():%Y%m%d-%H%M%S}"
    for part in ("", "-wal", "-shm"):
        path = base.with_name(base.name + part)
        with files.writing(path):
            if path.exists():
                path.rename(path.with_name(path.name + aside))
    moved = base.with_name(base.name + aside)
    return f"{base} cannot be read ({why}); it is {moved} now, and Prefect begins a new one."


def _damage(base: Path) -> str:
    """What is wrong with a database; empty where it is sound, not there, or held by somebody."""
    if not base.exists():
        return ""
    if not base.is_file():
        return "it is no file"
    try:
        with contextlib.closing(sqlite3.connect(base, timeout=1)) as known:
            (said,) = known.execute("pragma quick_check(1)").fetchone()
            if known.execute(
                "select 1 from sqlite_master where name = 'alembic_version'"
            ).fetchone():
                known.execute("select (select count(*) from flow_run), count(*) from deployment")
    except sqlite3.OperationalError as problem:
        return str(problem) if "no such table" in str(problem) else ""
    except sqlite3.DatabaseError as problem:
        return str(problem)
    return "" if said == "ok" else said.splitlines()[-1]


def serving(root: Path) -> dict[str, str] | None:
    """Where this project is served now; None where it is not."""
    urls = recalled(root / HOME / SERVING)
    if not isinstance(urls, dict) or not {"page", "api", "reports"} <= {*urls}:
        return None
    return urls if answers(str(urls["api"])) else None
