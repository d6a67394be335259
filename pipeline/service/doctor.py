"""What is missing on this machine or wrong with a running service, and the remedy."""

from __future__ import annotations

import importlib.metadata as installed
import os
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from pipeline.base.errors import InputError
from pipeline.library import preferences
from pipeline.library.preferences import Preferences
from pipeline.service import server as service
from pipeline.service import watch
from pipeline.service.afar import Afar
from pipeline.service.processes import alive
from pipeline.store import campaign as campaigns
from pipeline.store.campaign import recalled

_PYTHONS = ((3, 11), (3, 14))
"""Oldest and newest Python supported; the Makefile looks for the same."""
_ROOM_BYTES = 2**30
"""Disk space that is required [B]: a gibibyte, more than tables and reports of many campaigns
take."""
_ROOM_FILES = 1000
"""Files for which there must be room: those of ten campaigns."""


@dataclass(frozen=True)
class CheckResult:
    """Result of one check.

    Attributes:
        what: What was checked.
        good: Whether it is in order.
        text: What was found; if it is not in order, the problem and the remedy.
        needed: Whether `run` needs it.
    """

    what: str
    good: bool
    text: str
    needed: bool = True


def examine(root: Path) -> Iterator[CheckResult]:
    """Check everything that `run`, `serve` and the report need."""
    yield _python()
    yield from _libraries()
    for folder in ("data/processed", "reports"):
        yield _writable(root, folder)
    yield _room(root)
    yield _raw(root)
    yield from _preferences(root)
    yield from _service(root)


def _python() -> CheckResult:
    low, high = _PYTHONS
    here = _dotted(sys.version_info[:3])
    good = low <= sys.version_info[:2] <= high
    known = f"Python {_dotted(low)} to {_dotted(high)}"
    way_out = "" if good else f"; build the environment with {known}: make PYTHON=..."
    return CheckResult("Python", good, f"{here}{way_out}")


def _dotted(version: tuple[int, ...]) -> str:
    return ".".join(str(part) for part in version)


def _libraries() -> Iterator[CheckResult]:
    """Check that every required library is installed in a supported version."""
    from packaging.requirements import Requirement

    try:
        wanted = [Requirement(text) for text in installed.requires("rail-stiffness") or []]
    except installed.PackageNotFoundError:
        yield CheckResult("libraries", False, "the project is not installed; run make once")
        return
    sound = True
    for one in wanted:
        if one.marker is not None and not one.marker.evaluate({"extra": ""}):
            continue
        try:
            version = installed.version(one.name)
            wrong = f"version {version} is not supported"
            good = one.specifier.contains(version, prereleases=True)
        except installed.PackageNotFoundError:
            wrong, good = "is missing", False
        if not good:
            sound = False
            yield CheckResult(one.name, False, f"{wrong}; python -m pip install '{one}'")
    if sound:
        yield CheckResult("libraries", True, f"all {len(wanted)} required libraries are installed")


def _writable(root: Path, name: str) -> CheckResult:
    folder = root / name
    there = next(path for path in (folder, *folder.absolute().parents) if path.is_dir())
    good = os.access(there, os.W_OK)
    text = "can be written" if good else f"{there} cannot be written; change its permissions"
    return CheckResult(name, good, text)


def _room(root: Path) -> CheckResult:
    disk = os.statvfs(root.absolute())
    free = disk.f_bavail * disk.f_frsize
    full = disk.f_files > 0 and disk.f_favail < _ROOM_FILES  # some file systems do not count them
    text = f"{free / 2**30:.0f} GiB free" + full * f", for {disk.f_favail} files"
    good = free > _ROOM_BYTES and not full
    return CheckResult("disk", good, text if good else f"{text}; make room")


def _raw(root: Path) -> CheckResult:
    try:
        found = len(campaigns.every(root))
    except InputError as problem:
        return CheckResult("campaigns", False, str(problem))
    if found:
        return CheckResult("campaigns", True, f"{found} under {root / 'data' / 'raw'}")
    text = "none under data/raw; `pipeline init NAME`, `pipeline simulate`, or another --root"
    return CheckResult("campaigns", False, text, needed=False)


def _preferences(root: Path) -> Iterator[CheckResult]:
    """Check pipeline.toml, and the object storage that it names."""
    there = (root / preferences.FILE).is_file()
    text, what = "is valid" if there else "not found (optional)", preferences.FILE
    try:
        address = preferences.load(root).storage.raw
        yield CheckResult(what, True, text)
        if address is not None:
            what = "storage"
            with Afar(address) as store:
                yield CheckResult(what, True, f"{len(store.marks())} objects at {store.shown}")
    except InputError as problem:
        yield CheckResult(what, False, str(problem))


def _service(root: Path) -> Iterator[CheckResult]:
    """Check whether a service runs, its scans, and the campaigns it could not finish."""
    running = service.Running.of(root)
    afar = "" if running is None else running.afar
    yield _server(root, afar)
    if running is None or not (afar or alive(running.process)):
        yield CheckResult("service", True, "not running; `pipeline serve` starts it", needed=False)
        return
    unseen = f"{afar}, as it noted; ask there" * bool(afar)
    yield CheckResult("service", True, f"runs as process {running.process}{unseen}")
    yield looks(root, running)
    yield from _waiting(root, _wanted(root).notify.webhook)


def _wanted(root: Path) -> Preferences:
    """Preferences from pipeline.toml; defaults if it is invalid, which is reported elsewhere."""
    try:
        return preferences.load(root)
    except InputError:
        return Preferences()


def looks(root: Path, running: service.Running) -> CheckResult:
    """Check when data/raw was last scanned, and whether that is as scheduled."""
    wanted, look, now = _wanted(root).service, service.LastScan.of(root), time.time()
    if look is None:
        return CheckResult("looks", True, "none yet", needed=False)
    log = root / service.HOME / "schedule.log"
    at = datetime.fromtimestamp(look.began).isoformat(" ", "seconds")
    last = look.began if look.ended is None else look.ended
    if last > now + service.SLOW_S:
        return CheckResult(
            "looks", False, f"the last was at {at}: this machine's clock was set back"
        )
    if look.ended is None:
        ok = not look.hangs(now, wanted.limit_s + wanted.quiet_s)
        return CheckResult("looks", ok, f"one is at work since {at}", needed=not ok)
    if look.overdue(now, running.every_s):
        text = f"none since {at}; is the schedule paused on Prefect's page? {log} may say why"
        return CheckResult("looks", False, text)
    return CheckResult("looks", True, f"the last was at {at}")


def _waiting(root: Path, webhook: str | None) -> Iterator[CheckResult]:
    """Report campaigns that will be tried again, and verdicts that the webhook did not accept."""
    with suppress(InputError):  # where none can be listed, `_raw` says so
        for campaign in campaigns.every(root):
            seen = watch.recall(campaign)
            if seen.verdict == "failed":
                again = datetime.fromtimestamp(seen.tried + seen.pause_s).isoformat(" ", "minutes")
                text = f"tried {seen.attempts} times, again at {again}: {seen.said}"
                yield CheckResult(campaign.name, False, text, needed=False)
            elif webhook and seen.settled and seen.verdict != seen.told:
                text = f"the webhook did not accept that it is {seen.verdict}; see [notify]"
                yield CheckResult(campaign.name, False, text, needed=False)


def _server(root: Path, afar: str) -> CheckResult:
    api = os.environ.get("PREFECT_API_URL")
    if api:
        good = service.answers(api)
        text = "answers" if good else "does not answer; start it or unset PREFECT_API_URL"
        return CheckResult("Prefect server", good, f"{api} {text}")
    home = root / service.HOME
    if os.path.isdir(home) and not os.access(home, os.R_OK | os.X_OK):
        text = f"not known: {home} is another user's, ask as who serves"
        return CheckResult("Prefect server", True, text, needed=False)
    noted = recalled(home / service.SERVING)
    urls = service.serving(root)
    if urls:
        return CheckResult("Prefect server", True, f"answers at {urls['page']}")
    if noted and afar:
        return CheckResult("Prefect server", True, f"is that of the service{afar}", needed=False)
    if noted:
        log = home / "server.log"
        text = f"does not answer; a running `serve` starts it again, and {log} may say why"
        return CheckResult("Prefect server", False, text)
    return CheckResult("Prefect server", True, "not running (not required)", needed=False)
