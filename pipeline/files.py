"""Bytes to disk, whole or not at all."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from pathlib import Path


def write(path: Path, data: bytes) -> None:
    """Replace `path` by `data` in one step; a reader sees the old or the new, never a part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)  # mkstemp makes files that only their owner can read
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)
        raise


def sweep(folder: Path) -> None:
    """Remove what a killed `write` left behind; only while the folder's lock is held."""
    for path in folder.rglob(".*.????????"):
        if path.is_file():
            path.unlink(missing_ok=True)


def sha256(data: bytes) -> str:
    """Hash of some bytes, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()
