"""What a folder of object storage lists, and how its address is understood."""

from __future__ import annotations

from typing import Any
from urllib.parse import urlsplit
from uuid import uuid4

_OURS = ("s3", "gs", "gcs", "abfs", "abfss", "file")
"""Addresses that pyarrow knows without fsspec."""
_MOST = 1_000_000
"""Objects of a listing: of fifty campaigns at least."""
NO_END = f"more than {_MOST} objects"
NO_STORAGE = "it has whatever it is asked for"


def opened(url: str) -> tuple[Any, str]:
    """The file system of an address, and the folder in it."""
    from pyarrow import fs

    if urlsplit(url).scheme in _OURS:
        found: tuple[Any, str] = fs.FileSystem.from_uri(url)
        return found
    import fsspec

    driver, path = fsspec.core.url_to_fs(url)
    return fs.PyFileSystem(fs.FSSpecHandler(driver)), path


def listed(files: Any, folder: str) -> list[tuple[str, int, float]]:
    """Name, size [B] and time [s since 1970] of every object below a folder of a file system.

    Raises:
        OSError: It cannot be read, has no end, or what answers is no storage.
    """
    from pyarrow import fs

    try:
        found = files.get_file_info(fs.FileSelector(folder, recursive=True))
    except FileNotFoundError:  # a folder of object storage is there once it holds something
        found = []
    if len(found) > _MOST:
        raise OSError(NO_END)
    if not found:
        _see_that_it_knows(files, folder)
    start = folder.rstrip("/") + "/"
    return [
        (info.path.removeprefix(start), info.size, (info.mtime_ns or 0) / 1e9)
        for info in found
        if info.type == fs.FileType.File and info.path.startswith(start)
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
