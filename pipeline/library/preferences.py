"""pipeline.toml in the project's root: service, notification, storage, fleet and certificates."""

from __future__ import annotations

import os
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field

from pipeline.base import files, toml
from pipeline.base.errors import InputError, UsageError
from pipeline.base.language import Language
from pipeline.base.strict import FileName, Strict, checked

FILE = "pipeline.toml"


def _cron(line: str) -> str:
    from cronsim import CronSim, CronSimError

    try:
        CronSim(line, datetime(2000, 1, 1))
    except CronSimError as problem:
        raise ValueError(f'"{line}" is no cron line, such as "0 6 * * 1-5"') from problem
    return line


def _on_the_web(address: str) -> str:
    if not address.startswith(("https://", "http://")):
        raise ValueError("an address begins with https:// or http://")
    if not all("!" <= sign <= "~" for sign in address):
        raise ValueError("an address has neither blanks nor umlauts; write xn--... or %20")
    parts = urlsplit(address)  # raises for brackets that do not match
    if not parts.hostname or parts.port == 0:  # and the port for one that is no number
        raise ValueError("an address names a host, and perhaps a port from 1 to 65535")
    return address


def _elsewhere(address: str) -> str:
    """Check that it is an address, not a folder of this machine."""
    if "://" not in address:
        raise ValueError("an address looks like s3://bucket/folder")
    return address


_Address = Annotated[str, AfterValidator(_elsewhere)]


class Service(Strict):
    """Settings of `serve` and `watch`.

    Attributes:
        interval_s: Time between two scans of data/raw [s].
        cron: A cron line instead of the interval; `serve` only.
        quiet_s: A folder counts as complete if nothing in it changes for this time [s].
        port: Port of Prefect's page on this machine; the reports are on the next one.
        limit_s: Maximum time for one campaign before it is abandoned [s].
        memory_gib: Maximum memory for one campaign [GiB], likewise.
    """

    interval_s: Annotated[float, Field(ge=5, le=86400)] = 60.0
    cron: Annotated[str, AfterValidator(_cron)] | None = None
    quiet_s: Annotated[float, Field(ge=0, le=3600)] = 5.0
    port: Annotated[int, Field(ge=1024, le=65534)] = 4200
    limit_s: Annotated[float, Field(ge=10, le=86400)] = 900.0
    memory_gib: Annotated[float, Field(ge=1, le=1024)] = 8.0

    @property
    def every_s(self) -> float | None:
        """Time between two scans [s]; None if a cron line is given."""
        return None if self.cron else self.interval_s


class Notify(Strict):
    """Notification when a verdict changes.

    Attributes:
        webhook: Address that accepts a JSON object by POST; chats display its `text`.
    """

    webhook: Annotated[str, AfterValidator(_on_the_web)] | None = None


class Storage(Strict):
    """Campaigns on object storage.

    Attributes:
        raw: Address of the campaign folders, such as s3://bucket/raw; copied to data/raw.
        reports: Address to which reports/ is copied after a run.
        processed: Address to which the tables of data/processed are copied after a run.
    """

    raw: _Address | None = None
    reports: _Address | None = None
    processed: _Address | None = None


class _FleetPreferences(Strict):
    """Settings for all robots together.

    Attributes:
        scatter: Expected standard deviation of a stiffness from day to day, relative and in
            addition to its uncertainty [1]; 0.01 if not given. Repeated campaigns update it.
    """

    scatter: Annotated[float, Field(ge=1e-4, le=0.5)] | None = None


class _CertificatePreferences(Strict):
    """Settings of certificates.

    Attributes:
        language: Language if campaign.toml does not state one.
        templates: Folder below the root with the additions of the house; docs/house.md.
    """

    language: Language = Language.EN
    templates: FileName | None = None


class Preferences(Strict):
    """Content of pipeline.toml; every part is optional."""

    service: Service = Service()
    notify: Notify = Notify()
    storage: Storage = Storage()
    fleet: _FleetPreferences = _FleetPreferences()
    report: _CertificatePreferences = _CertificatePreferences()


def load(root: Path, options: Mapping[str, Any] | None = None) -> Preferences:
    """Load the preferences of a project.

    Args:
        root: The project's root.
        options: Options of the command line that override those of the service.

    Raises:
        InputError: pipeline.toml is not TOML, or has an unknown key or invalid value.
        UsageError: An option of the command line is invalid.
    """
    path = root / FILE
    text = files.words(path, FILE, toml.LARGEST_TEXT) if os.path.lexists(path) else ""
    content = toml.loads(text, FILE)
    _validated(content, text)  # before options override it, so that errors name the right source
    content["service"] = {**content.get("service", {}), **(options or {})}
    try:
        return _validated(content)
    except InputError as problem:
        raise UsageError(f"--{problem.thing.partition('.')[2].replace('_s:', ':')}") from problem


def storage(root: Path) -> Storage | None:
    """The object storage of a project; None if it states none.

    Raises:
        InputError: As `load`.
    """
    stated = load(root).storage
    return None if stated == Storage() else stated


def _validated(content: dict[str, Any], text: str = "") -> Preferences:
    way_out = "correct it as docs/serve.md, docs/object-storage.md or docs/house.md describes"
    return checked(Preferences, content, FILE, "", way_out, text)
