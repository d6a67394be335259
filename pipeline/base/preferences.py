"""pipeline.toml in the project's root: how often to look for campaigns, where, and whom to tell."""

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
    """Not a folder of this machine."""
    if "://" not in address:
        raise ValueError("an address looks like s3://bucket/folder")
    return address


_Address = Annotated[str, AfterValidator(_elsewhere)]


class Service(Strict):
    """`serve` and `watch`.

    Attributes:
        interval_s: Seconds from one look at data/raw to the next.
        cron: A cron line instead of the interval; `serve` only.
        quiet_s: A folder counts as complete when nothing in it changes for so long [s].
        port: Prefect's page on this machine; the reports are one port further.
        limit_s: What takes longer than this for one campaign is given up [s].
        memory_gib: As for time, its memory [GiB].
    """

    interval_s: Annotated[float, Field(ge=5, le=86400)] = 60.0
    cron: Annotated[str, AfterValidator(_cron)] | None = None
    quiet_s: Annotated[float, Field(ge=0, le=3600)] = 5.0
    port: Annotated[int, Field(ge=1024, le=65534)] = 4200
    limit_s: Annotated[float, Field(ge=10, le=86400)] = 900.0
    memory_gib: Annotated[float, Field(ge=1, le=1024)] = 8.0

    @property
    def every_s(self) -> float | None:
        """Seconds from one look to the next; None where a cron line says when."""
        return None if self.cron else self.interval_s


class Notify(Strict):
    """Whom to tell when a verdict changes.

    Attributes:
        webhook: Address that takes a JSON object by POST; its `text` is what chats show.
    """

    webhook: Annotated[str, AfterValidator(_on_the_web)] | None = None


class Storage(Strict):
    """Campaigns that live on object storage.

    Attributes:
        raw: Address of the campaign folders, such as s3://bucket/raw; copied to data/raw.
        reports: Where reports/ is put after a run.
        processed: Where the tables of data/processed are put after a run.
    """

    raw: _Address | None = None
    reports: _Address | None = None
    processed: _Address | None = None


class Fleet(Strict):
    """All robots together.

    Attributes:
        scatter: What a stiffness is expected to differ by from day to day beyond its uncertainty,
            one standard deviation [1]; 0.01 where nobody says. Campaigns that tell it correct it.
    """

    scatter: Annotated[float, Field(ge=1e-4, le=0.5)] | None = None


class Certificates(Strict):
    """Certificates.

    Attributes:
        language: Of those whose campaign.toml says none.
        templates: Folder below the root with what the house adds to them; docs/house.md.
    """

    language: Language = Language.EN
    templates: FileName | None = None


class Preferences(Strict):
    """A whole pipeline.toml; all of it may be missing."""

    service: Service = Service()
    notify: Notify = Notify()
    storage: Storage = Storage()
    fleet: Fleet = Fleet()
    report: Certificates = Certificates()


def load(root: Path, said: Mapping[str, Any] | None = None) -> Preferences:
    """The preferences of a project.

    Args:
        root: The project's root.
        said: What the command line says about the service instead.

    Raises:
        InputError: pipeline.toml is not TOML, or has a word or value it cannot have.
        UsageError: The command line says what it cannot have.
    """
    path = root / FILE
    text = files.words(path, FILE, toml.LARGEST) if os.path.lexists(path) else ""
    content = toml.loads(text, FILE)
    _validated(content, text)  # before the command line outdoes it, so that each gets its own blame
    content["service"] = {**content.get("service", {}), **(said or {})}
    try:
        return _validated(content)
    except InputError as problem:
        raise UsageError(f"--{problem.thing.partition('.')[2].replace('_s:', ':')}") from problem


def _validated(content: dict[str, Any], text: str = "") -> Preferences:
    way_out = "correct it as docs/serve.md, docs/object-storage.md or docs/house.md describes"
    return checked(Preferences, content, FILE, "", way_out, text)
