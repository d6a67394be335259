"""What is missing on this machine, and how to get it."""

from __future__ import annotations

import importlib.metadata as installed
import os
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.app import preferences, service
from pipeline.app.storage import Store
from pipeline.base.errors import InputError
from pipeline.store import campaign as campaigns

_PYTHONS = ((3, 11), (3, 14))
"""Oldest and newest Python that it runs on; the Makefile looks for the same."""
_ROOM_BYTES = 2**30
"""A gibibyte: more than tables and reports of many campaigns take."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        what: The thing.
        good: It is as it should be.
        said: What was found; where it is not good, what is wrong and the way out.
        needed: `run` cannot do without it.
    """

    what: str
    good: bool
    said: str
    needed: bool = True


def examine(root: Path) -> Iterator[Finding]:
    """Look at everything that `run`, `serve` and the report need."""
    yield _python()
    yield from _libraries()
    for folder in ("data/processed", "reports"):
        yield _writable(root, folder)
    yield _room(root)
    yield _raw(root)
    yield from _preferences(root)
    yield _service(root)


def _python() -> Finding:
    low, high = _PYTHONS
    here = _dotted(sys.version_info[:3])
    good = low <= sys.version_info[:2] <= high
    known = f"Python {_dotted(low)} to {_dotted(high)}"
    way_out = "" if good else f"; build the environment with {known}: make PYTHON=..."
    return Finding("Python", good, f"{here}{way_out}")


def _dotted(version: tuple[int, ...]) -> str:
    return ".".join(str(part) for part in version)


def _libraries() -> Iterator[Finding]:
    """Every library the project asks for, in a version that it can work with."""
    from packaging.requirements import Requirement

    try:
        wanted = [Requirement(text) for text in installed.requires("rail-stiffness") or []]
    except installed.PackageNotFoundError:
        yield Finding("libraries", False, "the project is not installed; run make once")
        return
    sound = True
    for one in wanted:
        if one.marker is not None and not one.marker.evaluate({"extra": ""}):
            continue
        try:
            version = installed.version(one.name)
            wrong = f"{version} does not work here"
            good = one.specifier.contains(version, prereleases=True)
        except installed.PackageNotFoundError:
            wrong, good = "is missing", False
        if not good:
            sound = False
            yield Finding(one.name, False, f"{wrong}; python -m pip install '{one}'")
    if sound:
        yield Finding("libraries", True, f"all {len(wanted)} that are asked for are there")


def _writable(root: Path, name: str) -> Finding:
    folder = root / name
    there = next(path for path in (folder, *folder.absolute().parents) if path.is_dir())
    good = os.access(there, os.W_OK)
    said = "can be written" if good else f"{there} cannot be written; change its permissions"
    return Finding(name, good, said)


def _room(root: Path) -> Finding:
    free = shutil.disk_usage(root.absolute()).free
    good = free > _ROOM_BYTES
    said = f"{free / 2**30:.0f} GiB free"
    return Finding("disk", good, said if good else f"{said}; make room")


def _raw(root: Path) -> Finding:
    found = len(campaigns.every(root))
    if found:
        return Finding("campaigns", True, f"{found} under {root / 'data' / 'raw'}")
    said = "none under data/raw; `pipeline init NAME`, `pipeline simulate`, or another --root"
    return Finding("campaigns", False, said, needed=False)


def _preferences(root: Path) -> Iterator[Finding]:
    """pipeline.toml, and the object storage that it names."""
    there = (root / preferences.FILE).is_file()
    said, what = "is valid" if there else "is not there, and need not be", preferences.FILE
    try:
        address = preferences.load(root).storage.raw
        yield Finding(what, True, said)
        if address is not None:
            what, store = "storage", Store(address)
            yield Finding(what, True, f"{len(store.marks())} objects at {store.shown}")
    except InputError as problem:
        yield Finding(what, False, str(problem))


def _service(root: Path) -> Finding:
    api = os.environ.get("PREFECT_API_URL")
    if api:
        good = service.answers(api)
        said = "answers" if good else "does not answer; start it or unset PREFECT_API_URL"
        return Finding("Prefect server", good, f"{api} {said}")
    urls = service.serving(root)
    said = f"runs at {urls['page']}" if urls else "not running; `pipeline serve` starts it"
    return Finding("service", True, said, needed=False)
