"""pipeline.toml in the project's root: how often to look for campaigns, where, and whom to tell."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, field_validator

from pipeline.base.errors import InputError, UsageError, first_wrong
from pipeline.base.strict import Strict

FILE = "pipeline.toml"


class Service(Strict):
    """`serve` and `watch`.

    Attributes:
        interval_s: Seconds from one look at data/raw to the next.
        cron: A cron line instead of the interval; `serve` only.
        quiet_s: A folder counts as complete when nothing in it changes for so long [s].
        port: Prefect's page on this machine; the reports are one port further.
    """

    interval_s: Annotated[float, Field(ge=5, le=86400)] = 60.0
    cron: str | None = None
    quiet_s: Annotated[float, Field(ge=0, le=3600)] = 5.0
    port: Annotated[int, Field(ge=1024, le=65534)] = 4200

    @field_validator("cron")
    @classmethod
    def five_fields(cls, line: str | None) -> str | None:
        """Only what is a cron line."""
        if line is not None:
            from cronsim import CronSim, CronSimError

            try:
                CronSim(line, datetime(2000, 1, 1))
            except CronSimError as problem:
                raise ValueError(f'"{line}" is no cron line, such as "0 6 * * 1-5"') from problem
        return line


class Notify(Strict):
    """Whom to tell when a verdict changes.

    Attributes:
        webhook: Address that takes a JSON object by POST; its `text` is what chats show.
    """

    webhook: str | None = None

    @field_validator("webhook")
    @classmethod
    def on_the_web(cls, address: str | None) -> str | None:
        """Only addresses of the web."""
        if address is not None and not address.startswith(("https://", "http://")):
            raise ValueError("an address begins with https:// or http://")
        return address


class Storage(Strict):
    """Campaigns that live on object storage.

    Attributes:
        raw: Address of the campaign folders, such as s3://bucket/raw; copied to data/raw.
        reports: Where reports/ is put after a run.
        processed: Where the tables of data/processed are put after a run.
    """

    raw: str | None = None
    reports: str | None = None
    processed: str | None = None

    @field_validator("raw", "reports", "processed")
    @classmethod
    def an_address(cls, address: str | None) -> str | None:
        """Not a folder of this machine."""
        if address is not None and "://" not in address:
            raise ValueError("an address looks like s3://bucket/folder")
        return address


class Preferences(Strict):
    """A whole pipeline.toml; all of it may be missing."""

    service: Service = Service()
    notify: Notify = Notify()
    storage: Storage = Storage()


def load(root: Path, said: Mapping[str, Any] | None = None) -> Preferences:
    """The preferences of a project.

    Args:
        root: The project's root.
        said: What the command line says about the service instead.

    Raises:
        InputError: pipeline.toml is not TOML, or has a word or value it cannot have.
        UsageError: The command line says what it cannot have.
    """
    try:
        content = tomllib.loads(_text(root / FILE))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise InputError(
            f"not valid TOML ({problem})", "correct that place", file=FILE
        ) from problem
    _validated(content)  # before the command line outdoes it, so that each gets its own blame
    content["service"] = {**content.get("service", {}), **(said or {})}
    try:
        return _validated(content)
    except InputError as problem:
        raise UsageError(f"--{problem.thing.partition('.')[2].replace('_s:', ':')}") from problem


def _validated(content: dict[str, Any]) -> Preferences:
    try:
        return Preferences.model_validate(content)
    except ValidationError as problem:
        words, message = first_wrong(problem)
        where = ".".join(words)
        raise InputError(
            f"{where}: {message}",
            "correct it as docs/serve.md or docs/object-storage.md describes",
            file=FILE,
        ) from problem


def _text(path: Path) -> str:
    return path.read_text("utf-8-sig") if path.is_file() else ""
