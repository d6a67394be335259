"""Choice of the Prefect server, and the environment that must be set before Prefect is imported.

Nothing here but `see_settings` imports Prefect, which takes seconds.
"""

from __future__ import annotations

import base64
import contextlib
import http.client
import importlib
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
from platform import node
from typing import Any, TypeVar

from filelock import FileLock, Timeout
from pydantic import Field, ValidationError

from pipeline.base import files
from pipeline.base.environment import elsewhere
from pipeline.base.errors import CannotWrite, UsageError
from pipeline.base.shown import printable
from pipeline.base.strict import Strict
from pipeline.service.processes import REPORTS_URL
from pipeline.store.campaign import recalled

HERE = "127.0.0.1"
"""Address for pages that only this machine can see."""

HOME = ".prefect"
"""Folder of Prefect's own files, under the project's root."""
_DATABASE = "prefect.db"
PASSWORD, KEY, SERVING = "password", "key", "serving.json"
"""Files in HOME: login of the API, as user:password; one-time key that lets a browser in without
it; addresses at which the project is served."""
ENTER = "/enter/"
"""Path at which that key is shown to the server of Prefect's page."""

PATIENCE_S = 120.0
"""Time allowed for Prefect's server to start [s]; on a busy machine it can need a minute."""

RUNNING, LOOKED = "service.json", "look.json"
"""Files in data/processed: who serves this project, and when data/raw was last looked at."""

LOCK, _LOOKING = ".service.lock", ".look.lock"
"""Beside them, held by who serves, and by a worker that looks; no campaign's own folder begins with
a dot."""

_LATE = 3
"""Delay, in intervals, after which a scan is considered overdue [1]."""
SLOW_S = 120.0
"""Minimum delay after which a scan is considered overdue [s], however short the interval."""
_STEP_S = 3600.0
"""Maximum time of a step of a scan in addition to a campaign [s]: the first copy of an object
storage."""

_ROOM = 2**25
"""Minimum free space for Prefect's database [B]: its size and its journal's in the first runs,
twice."""

_KEPT_S = 30 * 86400
"""Time for which Prefect keeps a run [s]; the results are not Prefect's and stay."""


class Running(Strict):
    """Service at work for a project.

    Attributes:
        process: Process number of `pipeline serve` or `watch`.
        every_s: Interval between scans [s]; None if a cron line sets the times.
        host: Name of its machine, where that number holds.
    """

    process: int
    every_s: float | None
    host: str = Field(default_factory=node)

    @property
    def afar(self) -> str:
        """` on HOST`, or empty if it is this machine."""
        return "" if self.host == node() else f" on {printable(self.host, 80)}"

    @classmethod
    def of(cls, root: Path) -> Running | None:
        """Read the service of a project; None if there is none."""
        return noted(cls, root / "data" / "processed" / RUNNING)


class LastScan(Strict):
    """Times of the last scan of data/raw, by this machine's clock [s].

    Attributes:
        began: Beginning of the scan.
        alive: Beginning of its last step, which is one campaign or less.
        ended: End of the scan; None while it is at work, or if it was killed.
        campaign: Campaign of that step, as it is shown; empty if there is none.
        drawn: Whether the page over all campaigns was up to date at its end.
    """

    began: float
    alive: float = 0.0
    ended: float | None = None
    campaign: str = ""
    drawn: bool = False

    def hangs(self, now: float, limit_s: float) -> bool:
        """Whether a step takes longer than any may, if a campaign may take `limit_s`."""
        return self.ended is None and now - max(self.began, self.alive) > limit_s + _STEP_S

    def overdue(self, now: float, every_s: float | None) -> bool:
        """Whether the next scan should have begun long ago; False if a cron line sets the times."""
        if every_s is None or self.ended is None:
            return False
        return now - self.ended > max(_LATE * every_s, SLOW_S)

    @classmethod
    def of(cls, root: Path) -> LastScan | None:
        """Read the last scan of a project; None before the first."""
        return noted(cls, root / "data" / "processed" / LOOKED)


@contextlib.contextmanager
def held(lock: Path, patience_s: float = -1.0) -> Iterator[bool]:
    """Hold a lock within the block, which ends with its process; yield whether nobody else has it.

    Args:
        lock: Its file.
        patience_s: How long others are waited for [s]; negative for ever.

    Raises:
        CannotWrite: The disk cannot be written.
    """
    own = FileLock(lock)
    with files.writing(lock), contextlib.suppress(Timeout):
        lock.parent.mkdir(parents=True, exist_ok=True)
        own.acquire(timeout=patience_s)
    try:
        yield own.is_locked
    finally:
        own.release()


def looking(root: Path) -> contextlib.AbstractContextManager[bool]:
    """Whether nobody else looks at data/raw for a team; within the block nobody does."""
    return held(root / "data" / "processed" / _LOOKING, 0.0)


_Note = TypeVar("_Note", bound=Strict)


def noted(kind: type[_Note], path: Path) -> _Note | None:
    """A note of a service or on a campaign; None if it is missing or damaged."""
    try:
        return kind.model_validate(recalled(path))
    except ValidationError:
        return None


def has_room(home: Path) -> None:
    """Check that Prefect's database can grow, instead of waiting for a server that never starts.

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
    """Use the Prefect server of PREFECT_API_URL.

    Raises:
        UsageError: PREFECT_API_URL is not set, or no server answers there.
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
    """Set the environment variables that Prefect reads when it is imported.

    Values set by the user are kept: with PREFECT_API_URL the flow runs on that server, otherwise on
    the one of `pipeline serve` if that is running, otherwise on a temporary one. The last two are
    closed to other origins, and to whoever does not know the password. Logs go to Prefect's page in
    full; on the screen they would bury the one message that matters.

    Raises:
        UsageError: The environment names proxies or certificates that Prefect cannot work with.
    """
    _see_connections()
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


def _see_connections() -> None:
    """Check proxies and certificates: Prefect's client reads them, even if they are unused."""
    import httpx

    try:
        httpx.Client().close()
    except (ImportError, ValueError, OSError, httpx.InvalidURL) as problem:
        raise UsageError(
            "Prefect cannot work with the proxies or certificates of the environment "
            f"({problem}): correct or unset http_proxy, https_proxy, all_proxy, no_proxy and "
            "SSL_CERT_FILE, or use --engine local or watch"
        ) from problem


def see_settings() -> None:
    """Import Prefect, in a folder that contains no settings, with those of `settle`.

    Raises:
        UsageError: It rejects one that the user has set.
    """
    try:
        with elsewhere():
            importlib.import_module("prefect.context")
            importlib.import_module("prefect.logging.configuration").setup_logging()
    except Exception as problem:  # a setting may name a file of any kind
        why = " ".join(str(problem).split())
        raise UsageError(
            f"Prefect rejects its settings ({printable(why, 200)}): correct or unset the "
            "PREFECT_... variables of the environment, or use --engine local or watch"
        ) from problem


def _logging() -> str:
    """Prefect's own log settings; otherwise it reads a file of its home, which can run code."""
    package = importlib.util.find_spec("prefect")  # imports nothing
    assert package is not None
    assert package.origin is not None
    return str(Path(package.origin).parent / "logging" / "logging.yml")


def known_password(root: Path) -> str | None:
    """Password of this project's server; None for those who may not read it."""
    try:
        return (root / HOME / PASSWORD).read_text()
    except (OSError, ValueError):
        return None


def answers(api: str) -> bool:
    """Whether a Prefect server answers at this address, which ends in /api."""
    try:
        with urllib.request.urlopen(f"{api.rstrip('/')}/health", timeout=2) as answer:
            return bool(answer.status == 200)
    except (OSError, http.client.HTTPException, ValueError):
        return False


def works(api: str) -> bool:
    """Whether a Prefect server answers, including from its database; slowness is not a failure."""
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
    """Answer of this project's server to a request to its API."""
    key = base64.b64encode(os.environ.get("PREFECT_API_AUTH_STRING", "").encode()).decode()
    head = {"Content-Type": "application/json", "Authorization": f"Basic {key}"}
    with urllib.request.urlopen(urllib.request.Request(address, b"{}", head), timeout=5) as answer:
        return json.loads(answer.read())


def mended(root: Path) -> str:
    """Move a database away that Prefect cannot read; return a message, empty if it is sound.

    Prefect would neither start with it nor create a new one. It contains only what the pages of
    earlier runs show: answers and reports are not in it.

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
    """What is wrong with a database; empty if it is sound, missing or locked."""
    if not base.exists():
        return ""
    if not base.is_file():
        return "it is no file"
    try:
        with contextlib.closing(sqlite3.connect(base, timeout=1)) as known:
            (found,) = known.execute("pragma quick_check(1)").fetchone()
            if known.execute(
                "select 1 from sqlite_master where name = 'alembic_version'"
            ).fetchone():
                known.execute("select (select count(*) from flow_run), count(*) from deployment")
    except sqlite3.OperationalError as problem:
        return str(problem) if "no such table" in str(problem) else ""
    except sqlite3.DatabaseError as problem:
        return str(problem)
    return "" if found == "ok" else found.splitlines()[-1]


def serving(root: Path) -> dict[str, str] | None:
    """Addresses at which this project is served now; None if it is not."""
    urls, running = recalled(root / HOME / SERVING), Running.of(root)
    if running is not None and running.afar:  # its addresses are those of its machine
        return None
    if not isinstance(urls, dict) or not {"page", "api", "reports"} <= {*urls}:
        return None
    return urls if answers(str(urls["api"])) else None
