"""Atomic reading and writing of files."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import lzma
import os
import secrets
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from pipeline.base.errors import CannotWrite, InputError
from pipeline.base.shown import too_large

DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
UNREADABLE_ZIP = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, OSError),
    *(NotImplementedError, RuntimeError, ValueError),
)
"""What `zipfile` raises for an archive that is damaged, encrypted or packed in another way."""
_BEGUN = ".*.????????"
"""Pattern of the names of unfinished files."""
_CLOSED = (errno.EACCES, errno.EPERM, errno.EROFS)


def write(path: Path, data: bytes) -> None:
    """Replace `path` by `data` atomically; a reader sees the old or the new file, never a part.

    Raises:
        CannotWrite: The file system refuses.
    """
    with writing(path):
        _write(path, data)


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Convert errors of the file system at `path` into one sentence.

    Raises:
        CannotWrite: With the way out.
    """
    try:
        yield
    except OSError as problem:
        thing = f"{path} cannot be written ({problem.strerror or problem})"
        raise CannotWrite(f"{thing}; {_way_out(path, problem)}.") from problem


def refused(problem: BaseException) -> CannotWrite | None:
    """What to say if the disk is full, read-only, or a file another user's; None otherwise."""
    match problem:
        case OSError(errno=number) if number in DISK_FULL:
            why = f"The answer cannot be written ({problem.strerror})"
        case OSError(errno=number, filename=str(name)) if number in _CLOSED:
            why = f"{name} cannot be used ({problem.strerror})"
        case _:
            return None
    return CannotWrite(f"{why}; {_way_out(Path(), problem)}.")


def _way_out(path: Path, problem: OSError) -> str:
    if isinstance(problem, FileExistsError | NotADirectoryError):
        for above in (path, *path.parents):
            if os.path.exists(above) and not os.path.isdir(above):
                return f"{above} is no folder, move it out of the way"
    if problem.errno in DISK_FULL:
        return "free some space and run it again"
    if problem.errno in _CLOSED:
        return "get the permission, close what has it open, or work in a copy with --root"
    return "check what is there, then run it again"


def _write(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    # subject to the umask; files of tempfile are readable by their owner only
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)
        raise


def sweep(folder: Path, pattern: str = f"**/{_BEGUN}") -> None:
    """Remove what a killed `write` left behind; only while the folder's lock is held."""
    for path in leftovers(folder, pattern):
        path.unlink(missing_ok=True)


def leftovers(folder: Path, pattern: str = f"**/{_BEGUN}") -> list[Path]:
    """Temporary files of `write` in a folder; without a writer they stem from a killed one."""
    return [path for path in folder.glob(pattern) if path.is_file()]


def read(
    path: Path,
    file: str,
    most: int,
    missing: InputError | None = None,
    begins: Callable[[bytes], object] = len,
) -> bytes:
    """Read a file written by others, which may be anything and may still be growing.

    Args:
        path: Path of the file.
        file: Its name, for messages.
        most: Maximum size in bytes; nothing is read of a larger file.
        missing: Error to raise if there is no such file.
        begins: Raises if the first bytes are not those of an expected file.

    Raises:
        InputError: Missing, unreadable, not a file, too large, or changed while it was read.
    """
    refused = partial(InputError, file=file)
    try:
        before = path.stat()
        if not (stat.S_ISREG(before.st_mode) or stat.S_ISDIR(before.st_mode)):
            thing = "is no file but a device or a pipe, which never ends"
            raise refused(thing, "put a copy of the file itself there")
        if before.st_size > most:
            raise refused(too_large(before.st_size, most), "split it, or give the right file")
        with path.open("rb") as opened:
            begins(opened.read(TYPE_BYTES))
            opened.seek(0)
            data = opened.read(before.st_size + 1)
            after = os.fstat(opened.fileno())
    except (FileNotFoundError, ValueError) as problem:  # ValueError: a null byte in the name
        raise missing or refused("there is no such file", "check the path") from problem
    except OSError as problem:
        thing, way_out = "cannot be read", "check the file and its permissions"
        why = f"{thing} ({problem.strerror or problem})"
        raise refused(why, way_out, passing=problem.errno not in HOPELESS_ERRORS) from problem
    if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
        way_out = "run again when the export is finished"
        raise refused("changed while it was read", way_out, passing=True)
    return data


TYPE_BYTES = 4096
"""Number of initial bytes that identify the type of a file."""
HOPELESS_ERRORS = (errno.ENAMETOOLONG, errno.EISDIR, errno.ELOOP)
"""Errors for which trying again does not help."""


def words(path: Path, file: str, most: int, missing: InputError | None = None) -> str:
    """Read a text file written by people.

    Raises:
        InputError: As `read`, or it is not UTF-8.
    """
    return text(read(path, file, most, missing), file)


def text(data: bytes, file: str) -> str:
    """Decode a text file written by people.

    Raises:
        InputError: Not UTF-8.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise InputError("is not UTF-8", "save it as UTF-8", file=file) from problem


def sha256(data: bytes) -> str:
    """SHA-256 hash, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()
