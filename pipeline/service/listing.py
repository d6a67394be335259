"""What a folder of object storage lists, found by a process of its own.

A driver lists a folder in one call, which ends when the storage says so: where it never does, with
the process that makes the call, within limits of time and memory.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any
from urllib.parse import urlsplit
from uuid import uuid4

from pipeline.service.processes import PYTHON, at_most, follow

Marks = dict[str, tuple[int, float]]
"""Objects by their name: size in bytes, and when each was put there [s since 1970]."""

_OURS = ("s3", "gs", "gcs", "abfs", "abfss", "file")
"""Addresses that pyarrow knows without fsspec."""
_LONGEST_S = 300.0
"""How long a listing may take; one of a million objects takes half of it [s]."""
_MEMORY = 2**31
"""What it may take: a million objects take a third of it [B]."""
_MOST = 1_000_000
"""Objects of a listing: of fifty campaigns at least."""
NO_END = f"no end within {_LONGEST_S:g} s, {_MEMORY / 2**30:g} GiB and {_MOST} objects"
NO_STORAGE = "it has whatever it is asked for"


def place(url: str) -> tuple[Any, str]:
    """The file system of an address, and the folder in it."""
    from pyarrow import fs

    if urlsplit(url).scheme in _OURS:
        found: tuple[Any, str] = fs.FileSystem.from_uri(url)
        return found
    import fsspec

    driver, path = fsspec.core.url_to_fs(url)
    return fs.PyFileSystem(fs.FSSpecHandler(driver)), path


def marks(url: str) -> Marks:
    """Every object below, by its name from there.

    Raises:
        OSError: It cannot be reached or read, in the driver's words, or has no end.
    """
    command, address = [*PYTHON, "pipeline.service.listing"], url.encode()  # a key may be in it
    try:
        ended = subprocess.run(command, input=address, capture_output=True, timeout=_LONGEST_S)
    except subprocess.TimeoutExpired:
        raise OSError(NO_END) from None
    found = json.loads(ended.stdout or json.dumps(NO_END))  # it ends without a word for its memory
    if isinstance(found, str):
        raise OSError(found)
    return {name: (size, put) for name, size, put in found}


def listed(url: str) -> list[tuple[str, int, float]]:
    """Name, size and time of every object below.

    Raises:
        OSError: It cannot be read, has no end, or what answers is no storage.
    """
    from pyarrow import fs

    files, folder = place(url)
    try:
        found = files.get_file_info(fs.FileSelector(folder, recursive=True))
    except FileNotFoundError:  # a folder of object storage is there once it holds something
        found = []
    if len(found) > _MOST:
        raise OSError(NO_END)
    if not found:
        _see_that_it_knows(files, folder)
    start = len(folder.rstrip("/")) + 1
    return [
        (info.path[start:], info.size, (info.mtime_ns or 0) / 1e9)
        for info in found
        if info.type == fs.FileType.File
    ]


def _see_that_it_knows(files: Any, folder: str) -> None:
    """See that who lists nothing knows what is not there: a page to log in at has everything.

    Raises:
        OSError: It has an object that nobody has put there.
    """
    from pyarrow import fs

    try:
        nobodys = files.get_file_info(f"{folder.rstrip('/')}/{uuid4()}")
    except OSError:  # it lists, and tells nothing of single objects
        return
    if nobodys.type == fs.FileType.File:
        raise OSError(NO_STORAGE)


def main() -> None:
    """Tell what the address on stdin lists, or why that is not known."""
    follow(os.getppid())
    at_most(_MEMORY)
    try:
        found: object = listed(sys.stdin.read())
    except MemoryError:
        return
    except (OSError, ValueError, ImportError) as problem:
        found = str(problem) or type(problem).__name__
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
