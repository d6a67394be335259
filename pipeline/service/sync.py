"""Campaigns on object storage: copied to data/raw before the work, answers copied back afterwards.

Copies are recorded, so that only changed objects are transferred and no file made here is ever
replaced or removed.
"""

from __future__ import annotations

import errno
import time
import unicodedata
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from pydantic import TypeAdapter

from pipeline.app.outcome import Outcome, failed
from pipeline.base import files
from pipeline.base.errors import CannotWrite, InputError, PipelineError
from pipeline.base.shown import printable
from pipeline.library.preferences import Storage
from pipeline.service.afar import Afar
from pipeline.service.storage import Store
from pipeline.store.campaign import MOST_ENTRIES, dump, recalled, unfit

_NOTE = "storage.json"
_HERE = "storage"
"""Name used instead of a campaign's for errors of the storage itself."""

_FRESH_S = 3.0
"""Age below which an object may still change unnoticed [s]: storage states times in whole
seconds."""


@dataclass
class _Note:
    """Record of the synchronisation, kept beside the tables.

    Attributes:
        copied: Object -> size, time and hash of what was copied here.
        put: Local file -> size and time of what was copied to the storage.
        told: Complaints already reported by `watch` and `serve`.
    """

    copied: dict[str, tuple[int, float | None, str]] = field(default_factory=dict)
    put: dict[str, list[int]] = field(default_factory=dict)
    told: list[str] = field(default_factory=list)

    @staticmethod
    def of(root: Path) -> _Note:
        """The record as saved, or an empty one."""
        try:
            return TypeAdapter(_Note).validate_python(recalled(_processed(root) / _NOTE))
        except (OSError, ValueError):  # ValidationError is one
            return _Note()

    def keep(self, root: Path) -> None:
        """Save the record."""
        files.write(_processed(root) / _NOTE, dump(asdict(self)))


def _processed(root: Path) -> Path:
    return root / "data" / "processed"


def fetch(root: Path, storage: Storage) -> list[Outcome]:
    """Copy new and changed objects to data/raw; return what was rejected, and why."""
    if storage.raw is None:
        return []
    note, refused = _Note.of(root), dict[str, PipelineError]()
    try:
        with Afar(storage.raw) as store:
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
    """Bring the copy of one campaign up to date; return why this failed, or None.

    Raises:
        PipelineError: Storage or disk fail in a way that affects all campaigns.
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
            store.marks()  # raises if the storage is unreachable, not only this object
        return problem
    except (OSError, ValueError) as problem:
        return InputError(f"it cannot be copied ({printable(str(problem), 200)})", _RENAME)
    return None


_OF_THE_DISK = (*files.DISK_FULL, errno.EROFS)
"""Errors of the disk that concern every file, not only those of one campaign."""

_RENAME = "rename it in the storage, or take it out"

_LONGEST = 240
"""Maximum number of bytes in the name of a file or folder: file systems allow 255, and temporary
names have 10 more."""

_MOST_BYTES = 2**32
"""Maximum size of the objects of a campaign together [B]: two of the largest files that are
read."""


def _refuse_odd(campaign: str, marks: _Marks) -> None:
    """Check, before any is read, that all objects of a campaign can be files of one folder.

    Raises:
        InputError: They cannot, on any operating system, or there are too many.
    """
    if why := unfit(campaign):
        raise InputError(why, _RENAME)
    for name in marks:
        if why := misnamed(name, marks):
            raise InputError(f'the object "{printable(name, 120)}" {why}', _RENAME)
    size = sum(size for size, _ in marks.values())
    if len(marks) > MOST_ENTRIES or size > _MOST_BYTES:
        thing = f"it has {len(marks)} objects of {size / 2**30:.3g} GiB together"
        most = f"more than the {MOST_ENTRIES} or {_MOST_BYTES / 2**30:g} GiB that are copied"
        raise InputError(f"{thing}, {most}", "take out what is no measurement")


def misnamed(name: str, others: Collection[str]) -> str:
    """Why this cannot be the name of a file below a folder that has others; empty if it can."""
    if {"", ".", ".."} & {*name.split("/")}:
        return "has an empty or dotted part in its name"
    if "\\" in name or any(unicodedata.category(letter) in ("Cc", "Cs") for letter in name):
        return "has a backslash or a control character in its name"
    longest = max(len(part.encode()) for part in name.split("/"))
    if longest > _LONGEST:
        return f"has {longest} bytes in a part of its name"
    twice = any(str(above) in others for above in PurePosixPath(name).parents)
    return "is a file and a folder" if twice else ""


def _campaigns(marks: _Marks) -> dict[str, dict[str, tuple[int, float]]]:
    """Objects by campaign: folders one level down that contain a campaign.toml."""
    found: dict[str, dict[str, tuple[int, float]]] = {}
    for name, mark in marks.items():
        campaign, _, inner = name.partition("/")
        if inner and not campaign.startswith("."):
            found.setdefault(campaign, {})[name] = mark
    return {name: inside for name, inside in found.items() if f"{name}/campaign.toml" in inside}


def _take(raw: Path, store: Store, campaign: str, marks: _Marks, note: _Note) -> None:
    """Bring the copy of one campaign up to date, completely or not at all.

    Raises:
        InputError: It cannot be read, or another file is in its place.
    """
    now, copied = time.time(), note.copied
    new = {
        name: store.read(name, mark)
        for name, mark in marks.items()
        if copied.get(name, ())[:2] != mark or not (raw / name).is_file()
    }
    gone = _taken_out(store, campaign, marks, note)
    for name in (*new, *gone):
        if not _ours_to_change(raw / name, copied.get(name), new.get(name)):
            raise InputError(
                f"{raw / name} is not what was copied from {store.shown}",
                "move it or its folder away, or rename the campaign there",
            )
    for name in sorted(new, key=lambda name: name.endswith("/campaign.toml")):  # it comes last
        _put_here(raw / name, new[name])
        size, put = marks[name]
        settled = now - put > _FRESH_S
        copied[name] = (size, put if settled else None, files.sha256(new[name]))
    for name in gone:
        with files.writing(raw / name):
            (raw / name).unlink(missing_ok=True)
        del copied[name]


def _taken_out(store: Store, campaign: str, marks: _Marks, note: _Note) -> list[str]:
    """Copied objects that are no longer in the storage.

    Raises:
        InputError: One of them is there, and not listed.
    """
    gone = [name for name in note.copied if name.startswith(f"{campaign}/") and name not in marks]
    if there := [name for name in gone if store.has(name)]:
        thing = f"{store.shown} does not list {there[0]}, which is there"
        raise InputError(thing, "run it again in a moment", passing=True)
    return gone


def _put_here(path: Path, data: bytes) -> None:
    """Write a copy unless it is there already; a new time would look like a changed campaign."""
    if not path.is_file() or path.read_bytes() != data:
        files.write(path, data)


def _ours_to_change(path: Path, copied: tuple[Any, ...] | None, data: bytes | None) -> bool:
    """Whether nothing is there, or our own copy, or already the new content."""
    if not path.is_file():
        return not path.exists()
    here = path.read_bytes()
    return here == data or (copied is not None and files.sha256(here) == copied[2])


def unreported(root: Path, refused: list[Outcome]) -> list[Outcome]:
    """Complaints not reported at the last scan, so that a lasting problem is reported once."""
    note = _Note.of(root)
    every = sorted(line for outcome in refused for line in outcome.complaints)
    new = [outcome for outcome in refused if not set(outcome.complaints) <= set(note.told)]
    if every != note.told:
        note.told = every
        note.keep(root)
    return new


def publish(root: Path, storage: Storage) -> list[Outcome]:
    """Copy changed reports and tables to the storage; return what was rejected, and why."""
    folders = ((root / "reports", storage.reports), (_processed(root), storage.processed))
    wanted = [(folder, Afar(url)) for folder, url in folders if url is not None]
    if not wanted:
        return []
    note, refused = _Note.of(root), []
    for folder, store in wanted:
        try:
            with store:
                _put(root, folder, store, note)
        except PipelineError as problem:
            refused.append(failed(_HERE, problem))
    note.keep(root)
    return refused


def _put(root: Path, folder: Path, store: Store, note: _Note) -> None:
    sent: dict[str, str] = {}  # names there, and here
    try:
        for path in sorted(folder.rglob("*")):
            if not path.is_file() or not _public(path):
                continue
            stat, name = path.stat(), path.relative_to(root).as_posix()
            mark, there = [stat.st_size, stat.st_mtime_ns], path.relative_to(folder).as_posix()
            if note.put.get(name) != mark:
                store.write(there, path.read_bytes())
                note.put[name], sent[there] = mark, name
    finally:
        _see_kept(store, note, sent)


def _see_kept(store: Store, note: _Note, sent: Mapping[str, str]) -> None:
    """Have sent again what the storage does not list as it was sent.

    Raises:
        CannotWrite: It has lost some of it.
    """
    try:
        there = store.marks() if sent else {}
    except InputError:  # a key may write and not list
        return
    lost = [name for name in sent if there.get(name, ())[:1] != (note.put[sent[name]][0],)]
    for name in lost:
        del note.put[sent[name]]
    if lost:
        thing = f"it has lost {len(lost)} of {len(sent)} files that were sent"
        words = f"{store.shown}/{lost[0]} cannot be written ({thing}); run it again in a moment."
        raise CannotWrite(words)


def _public(path: Path) -> bool:
    """Whether a file is an answer or a table, not a lock, a record or a virtual truth."""
    if path.name.startswith("."):
        return False
    return path.suffix != ".json" or path.name in ("result.json", "manifest.json")
