"""Campaigns that live on object storage: a copy under data/raw before the work, answers back after.

What was copied is remembered, so that only changed objects travel and nothing that somebody made
here is ever replaced or removed.
"""

from __future__ import annotations

import errno
import time
import unicodedata
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from pydantic import TypeAdapter

from pipeline.app.outcome import Outcome, failed
from pipeline.base import files
from pipeline.base.errors import CannotWrite, InputError, PipelineError
from pipeline.base.preferences import Storage
from pipeline.base.shown import printable
from pipeline.service.storage import Store
from pipeline.store.campaign import MOST_ENTRIES, dump, recalled, unfit

_NOTE = "storage.json"
_HERE = "storage"
"""In place of a campaign's name, where the storage itself is in trouble."""

_FRESH_S = 3.0
"""Storage tells times in seconds: an object this young may still change without a sign of it."""


@dataclass
class _Note:
    """What is known of the storage, kept beside the tables.

    Attributes:
        copied: Object -> size, time and hash of what was copied here.
        put: File of ours -> size and time of what was put there.
        told: Complaints that `watch` and `serve` have made.
    """

    copied: dict[str, tuple[int, float | None, str]] = field(default_factory=dict)
    put: dict[str, list[int]] = field(default_factory=dict)
    told: list[str] = field(default_factory=list)

    @staticmethod
    def of(root: Path) -> _Note:
        """As it was left, or an empty one."""
        try:
            return TypeAdapter(_Note).validate_python(recalled(_processed(root) / _NOTE))
        except (OSError, ValueError):  # ValidationError is one
            return _Note()

    def keep(self, root: Path) -> None:
        """Leave it for the next time."""
        files.write(_processed(root) / _NOTE, dump(asdict(self)))


def _processed(root: Path) -> Path:
    return root / "data" / "processed"


def fetch(root: Path, storage: Storage) -> list[Outcome]:
    """Copy what is new or changed in the storage to data/raw; what was refused, and why."""
    if storage.raw is None:
        return []
    store, note = Store(storage.raw), _Note.of(root)
    refused: dict[str, PipelineError] = {}
    try:
        for name, marks in _campaigns(store.marks()).items():
            problem = _left_out(root / "data" / "raw", store, name, marks, note)
            if problem is not None:
                refused[name or _HERE] = problem
    except PipelineError as problem:
        refused[_HERE] = problem
    note.keep(root)
    return [failed(name, problem) for name, problem in refused.items()]


_Marks = Mapping[str, tuple[int, float]]


def _left_out(
    raw: Path, store: Store, campaign: str, marks: _Marks, note: _Note
) -> PipelineError | None:
    """Bring one campaign's copy up to date; why that is not done, None where it is.

    Raises:
        PipelineError: The storage or the disk refuses, as it would refuse the others.
    """
    try:
        _refuse_odd(campaign, marks)
        _take(raw, store, campaign, marks, note)
    except CannotWrite as problem:
        if isinstance(problem.__cause__, OSError) and problem.__cause__.errno in _OF_THE_DISK:
            raise
        return problem
    except InputError as problem:
        if problem.passing:
            store.marks()  # fails where it is the storage that is away, and not one object
        return problem
    except (OSError, ValueError) as problem:
        return InputError(f"it cannot be copied ({printable(str(problem), 200)})", _RENAME)
    return None


_OF_THE_DISK = (*files.FULL, errno.EROFS)
"""What the disk says to every file, not to those of one campaign."""

_RENAME = "rename it in the storage, or take it out"

_LONGEST = 240
"""Bytes in the name of a file or folder: file systems allow 255, half-written ones have 10 more."""

_MOST_BYTES = 2**32
"""Of the objects of a campaign together: two of the largest files that are read [B]."""


def _refuse_odd(campaign: str, marks: _Marks) -> None:
    """See that all objects of a campaign can be files of one folder, before one is read.

    Raises:
        InputError: They cannot, whatever the operating system would make of them.
    """
    if why := unfit(campaign):
        raise InputError(why, _RENAME)
    for name in marks:
        twice = any(above in marks for above in _above(name))
        if why := _odd(name) or ("is a file and a folder" if twice else ""):
            raise InputError(f'the object "{printable(name, 120)}" {why}', _RENAME)
    size = sum(size for size, _ in marks.values())
    if len(marks) > MOST_ENTRIES or size > _MOST_BYTES:
        thing = f"it has {len(marks)} objects of {size / 2**30:.3g} GiB together"
        most = f"more than the {MOST_ENTRIES} or {_MOST_BYTES / 2**30:g} GiB that are copied"
        raise InputError(f"{thing}, {most}", "take out what is no measurement")


def _odd(name: str) -> str:
    """Why an object can be no file; empty where it can."""
    if {"", ".", ".."} & {*name.split("/")}:
        return "has an empty or dotted part in its name"
    if "\\" in name or any(unicodedata.category(letter) in ("Cc", "Cs") for letter in name):
        return "has a backslash or a control character in its name"
    longest = max(len(part.encode()) for part in name.split("/"))
    return f"has {longest} bytes in a part of its name" if longest > _LONGEST else ""


def _above(name: str) -> set[str]:
    """The folders that a file of this name is in."""
    return {str(one) for one in PurePosixPath(name).parents}


def _campaigns(marks: _Marks) -> dict[str, dict[str, tuple[int, float]]]:
    """Objects by campaign: folders one level down that hold a campaign.toml."""
    found: dict[str, dict[str, tuple[int, float]]] = {}
    for name, mark in marks.items():
        campaign, _, inner = name.partition("/")
        if inner and not campaign.startswith("."):
            found.setdefault(campaign, {})[name] = mark
    return {name: inside for name, inside in found.items() if f"{name}/campaign.toml" in inside}


def _take(raw: Path, store: Store, campaign: str, marks: _Marks, note: _Note) -> None:
    """Bring one campaign's copy up to date: all of it, or with a complaint nothing.

    Raises:
        InputError: It cannot be read, or there is something else in its place.
    """
    now, copied = time.time(), note.copied
    new = {
        name: store.read(name, mark)
        for name, mark in marks.items()
        if copied.get(name, ())[:2] != mark or not (raw / name).is_file()
    }
    gone = [name for name in copied if name.startswith(f"{campaign}/") and name not in marks]
    for name in (*new, *gone):
        if not _ours_to_change(raw / name, copied.get(name), new.get(name)):
            raise InputError(
                f"{raw / name} is not what was copied from {store.shown}",
                "move it or its folder away, or rename the campaign there",
            )
    for name in sorted(new, key=lambda name: name.endswith("/campaign.toml")):  # which makes it one
        _put_here(raw / name, new[name])
        size, put = marks[name]
        settled = now - put > _FRESH_S
        copied[name] = (size, put if settled else None, files.sha256(new[name]))
    for name in gone:
        with files.writing(raw / name):
            (raw / name).unlink(missing_ok=True)
        del copied[name]


def _put_here(path: Path, data: bytes) -> None:
    """Write a copy, unless it is here; a new time would be a new campaign."""
    if not path.is_file() or path.read_bytes() != data:
        files.write(path, data)


def _ours_to_change(path: Path, copied: tuple[Any, ...] | None, data: bytes | None) -> bool:
    """Nothing is there, or our own copy, or what is to be there anyway."""
    if not path.is_file():
        return not path.exists()
    here = path.read_bytes()
    return here == data or (copied is not None and files.sha256(here) == copied[2])


def untold(root: Path, refused: list[Outcome]) -> list[Outcome]:
    """Those that were not there at the last look, so that a lasting trouble is told once."""
    note = _Note.of(root)
    told = sorted(line for outcome in refused for line in outcome.complaints)
    new = [outcome for outcome in refused if not set(outcome.complaints) <= set(note.told)]
    if told != note.told:
        note.told = told
        note.keep(root)
    return new


def publish(root: Path, storage: Storage) -> list[Outcome]:
    """Put changed reports and tables into the storage; what was refused, and why."""
    folders = ((root / "reports", storage.reports), (_processed(root), storage.processed))
    wanted = [(folder, Store(url)) for folder, url in folders if url is not None]
    if not wanted:
        return []
    note, refused = _Note.of(root), []
    for folder, store in wanted:
        try:
            _put(root, folder, store, note)
        except PipelineError as problem:
            refused.append(failed(_HERE, problem))
    note.keep(root)
    return refused


def _put(root: Path, folder: Path, store: Store, note: _Note) -> None:
    for path in sorted(folder.rglob("*")):
        if not path.is_file() or not _public(path):
            continue
        stat, name = path.stat(), path.relative_to(root).as_posix()
        mark = [stat.st_size, stat.st_mtime_ns]
        if note.put.get(name) != mark:
            store.write(path.relative_to(folder).as_posix(), path.read_bytes())
            note.put[name] = mark


def _public(path: Path) -> bool:
    """Answers and tables, not locks, notes or what is true of a virtual campaign."""
    if path.name.startswith("."):
        return False
    return path.suffix != ".json" or path.name in ("result.json", "manifest.json")
