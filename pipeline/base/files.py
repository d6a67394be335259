"""Bytes to disk, whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from pipeline.base.errors import CannotWrite, InputError

FULL = (errno.ENOSPC, errno.EDQUOT)
BEGUN = ".*.????????"
"""What the names of half-written files are like."""
CLOSED = (errno.EACCES, errno.EPERM, errno.EROFS)


def write(path: Path, data: bytes) -> None:
    """Replace `path` by `data` in one step; a reader sees the old or the new, never a part.

    Raises:
        CannotWrite: The disk refuses.
    """
    with writing(path):
        _write(path, data)


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Say in one sentence what the disk refuses to write at `path`.

    Raises:
        CannotWrite: With the way out.
    """
    try:
        yield
    except OSError as problem:
        thing = f"{path} cannot be written ({problem.strerror or problem})"
        raise CannotWrite(f"{thing}; {_way_out(path, problem)}.") from problem


def _way_out(path: Path, problem: OSError) -> str:
    if isinstance(problem, FileExistsError | NotADirectoryError):
        for above in (path, *path.parents):
            if os.path.exists(above) and not os.path.isdir(above):
                return f"{above} is no folder, move it out of the way"
    if problem.errno in FULL:
        return "free some space and run it again"
    if problem.errno in CLOSED:
        return "get the permission to write there, or work in a copy with --root"
    return "check what is there, then run it again"


def _write(path: Path, data: bytes) -> None:
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


def place(folder: Path, content: Mapping[str, bytes]) -> None:
    """Put a whole folder in its place in one step; an old one of that name goes.

    Raises:
        CannotWrite: The disk refuses; the old folder is still there.
    """
    with writing(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        # not beside the folder, where a half-written one would count
        temporary = Path(tempfile.mkdtemp(dir=folder.parent.parent, prefix=f".{folder.name}."))
        try:
            for name, data in content.items():
                write(temporary / "new" / name, data)
            _replace(folder, temporary)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


def _replace(folder: Path, temporary: Path) -> None:
    replaced = folder.exists()
    if replaced:
        os.rename(folder, temporary / "old")
    try:
        os.rename(temporary / "new", folder)
    except OSError:
        if replaced:
            os.rename(temporary / "old", folder)
        raise


def sweep(folder: Path, pattern: str = f"**/{BEGUN}") -> None:
    """Remove what a killed `write` left behind; only while the folder's lock is held."""
    for path in leftovers(folder, pattern):
        path.unlink(missing_ok=True)


def leftovers(folder: Path, pattern: str = f"**/{BEGUN}") -> list[Path]:
    """Files in a folder that a `write` has begun; what nobody works at is of a killed one."""
    return [path for path in folder.glob(pattern) if path.is_file()]


def text(data: bytes, file: str) -> str:
    """The words of a file that people write.

    Raises:
        InputError: Not UTF-8.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise InputError("is not UTF-8", "save it as UTF-8", file=file) from problem


def sha256(data: bytes) -> str:
    """Hash of some bytes, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()
