"""The folder of a campaign: dropped files, archives, and detection of changes."""

from __future__ import annotations

import hashlib
import re
import shutil
import threading
import unicodedata
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from pipeline.base import files
from pipeline.base.errors import UsageError
from pipeline.base.shown import printable
from pipeline.base.toml import LARGEST_TEXT

TOML = "campaign.toml"

MOST_BYTES = 256 * 2**20
"""Maximum size of one file, and of all files of an archive together [B]."""

_MOST_FILES = 500
"""Maximum number of files of an archive."""

_PART = 2**20
"""Number of bytes read at once."""

_NAME = re.compile(r"(?![.-])[^/\\\x00-\x1f\x7f<>:\"|?*]{1,120}(?<![. ])")
"""File names valid on every system, neither hidden nor similar to a command-line option."""


def named(name: str, what: str = "file") -> str:
    """The name, if it is valid.

    Raises:
        UsageError: It is not a valid name of a file or folder.
    """
    if not _NAME.fullmatch(name) or not name.isprintable():
        shown = name if name.isprintable() else name.encode("unicode_escape").decode()
        raise UsageError(f'"{shown[:80]}" cannot name a {what}: give it a plain name')
    return name


@dataclass(frozen=True)
class Desk:
    """One campaign's folder.

    Attributes:
        root: Root of the project.
        name: Name of the campaign.
    """

    root: Path
    name: str

    @property
    def folder(self) -> Path:
        """Folder of its files."""
        return self.root / "data" / "raw" / named(self.name, "campaign")

    @property
    def reports(self) -> Path:
        """Folder of its report."""
        return self.root / "reports" / named(self.name, "campaign")

    def begun(self) -> None:
        """Make its folder, if it is not there yet.

        Raises:
            UsageError: Another campaign has a name that some system takes for this one.
        """
        alike = [one for one in campaigns(self.root) if _alike(one) == _alike(self.name)]
        if alike and self.name not in alike:
            raise UsageError(f"another campaign is called {alike[0]}: open it, or take another")
        self.folder.mkdir(parents=True, exist_ok=True)

    def names(self) -> list[str]:
        """Names of the campaign's files, including campaign.toml; `folder/name` of those below."""
        return sorted(one.relative_to(self.folder).as_posix() for one in _files(self.folder))

    def file(self, name: str) -> Path:
        """Path of one of its files.

        Raises:
            UsageError: There is no such file.
        """
        if name not in self.names():
            shown = printable(name, 200)
            raise UsageError(f"there is no file {shown} in this campaign: it may have been removed")
        return self.folder / name

    def text(self) -> str | None:
        """Text of campaign.toml; None if there is none yet.

        Raises:
            UsageError: It is too large to be read.
        """
        if TOML not in self.names():
            return None
        path = self.folder / TOML
        _see_small(TOML, path.stat().st_size)
        return path.read_text("utf-8", "replace")

    def written(self, text: str, seen: str) -> None:
        """Replace campaign.toml, unless it has been changed since it was read.

        Args:
            text: The new text.
            seen: Digest of the text that was read.

        Raises:
            UsageError: It was changed elsewhere.
        """
        if seen != self.digest(TOML):
            raise UsageError(
                "campaign.toml was changed elsewhere since this page was loaded: load it again"
            )
        files.write(self.folder / TOML, text.encode())

    def digest(self, *only: str) -> str:
        """Digest of all files or of some, to detect changes."""
        found = hashlib.sha256()
        for name in only or self.names():
            path = self.folder / name
            data = path.read_bytes() if path.is_file() else b""
            found.update(f"{name}\0{len(data)}\0".encode() + hashlib.sha256(data).digest())
        return found.hexdigest()

    def taken(self, name: str, data: bytes, instead: bool = False) -> list[str]:
        """Store a file, or the files of an archive; return the names that are new or changed.

        Raises:
            UsageError: It is too large, has an invalid name, or another file of that name exists.
        """
        inside = list(_unpacked(data)) if name.lower().endswith(".zip") else [(name, data)]
        with _ALONE:  # another tab may drop a file of this name
            new = [one for one, content in inside if self._is_new(one, content, instead)]
            for one, content in inside:
                if one in new:
                    files.write(self.folder / one, content)
        return new

    def _is_new(self, name: str, data: bytes, instead: bool) -> bool:
        _see_small(named(name), len(data))
        there = {_alike(one): one for one in self.names()}.get(_alike(name))
        if there is None:
            return True
        same = (self.folder / there).read_bytes() == data
        if not same and not (instead and there == name):
            raise UsageError(f"another file {there} is in this campaign: replace it, or rename one")
        return not same

    def copied(self, other: Desk) -> None:
        """Copy all files except campaign.toml to another folder, which must not exist yet."""
        other.folder.mkdir(parents=True)
        for name in self.names():
            if name != TOML:
                (other.folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(self.folder / name, other.folder / name)

    def removed(self, name: str) -> None:
        """Delete a file.

        Raises:
            UsageError: There is no such file.
        """
        self.file(name).unlink()


_ALONE = threading.Lock()
"""Held while files are compared with those of a folder and written."""


def _alike(name: str) -> str:
    """The same for names that some system takes for one: in capitals, or with accents apart."""
    return unicodedata.normalize("NFC", name.casefold())


def _see_small(name: str, size: int) -> None:
    """Raise UsageError if a file of that name has more bytes than are read."""
    toml = name.lower().endswith(".toml")
    if size > (most := LARGEST_TEXT if toml else MOST_BYTES):
        raise UsageError(f"{name} has more than {most // 2**20} MB: split it")


def _files(folder: Path) -> Iterator[Path]:
    """Files of a folder and of those below it; links and hidden ones are not followed."""
    left = [folder] if folder.is_dir() else []
    while left:  # without calling itself: however deep
        for one in left.pop().iterdir():
            if one.is_symlink() or not _NAME.fullmatch(one.name):
                continue
            if one.is_dir():
                left.append(one)
            elif one.is_file():
                yield one


def _unpacked(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Files of an archive by name without folder, within limits whatever sizes it declares.

    Raises:
        UsageError: It is not a valid archive, or contains too much.
    """
    import io

    left, seen = MOST_BYTES, set[str]()
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            inside = [one for one in archive.infolist() if not one.is_dir() and _wanted(one)]
            if len(inside) > _MOST_FILES:
                raise UsageError(f"the archive holds more than {_MOST_FILES} files: drop some only")
            for one in inside:
                name = named(PurePosixPath(one.filename.replace("\\", "/")).name)
                if _alike(name) in seen:
                    raise UsageError(f"the archive holds two files {name}: rename one of them")
                seen.add(_alike(name))
                content = _read(archive, one, left)
                left -= len(content)
                yield name, content
    except files.UNREADABLE_ZIP as problem:
        way_out = "unpack it first, or make it again"
        raise UsageError(f"the archive cannot be unpacked ({problem}): {way_out}") from None


def _wanted(one: zipfile.ZipInfo) -> bool:
    """Whether a file is neither a system's own nor an archive within the archive."""
    path = PurePosixPath(one.filename.replace("\\", "/"))
    own = any(part.startswith((".", "__MACOSX")) for part in path.parts)
    return not own and path.suffix.lower() != ".zip"


def _read(archive: zipfile.ZipFile, one: zipfile.ZipInfo, most: int) -> bytes:
    parts, size = [], 0
    with archive.open(one) as file:
        while part := file.read(_PART):
            size += len(part)
            if size > most:
                raise UsageError(
                    f"the archive holds more than {MOST_BYTES // 2**20} MB: drop some files only"
                )
            parts.append(part)
    return b"".join(parts)


def campaigns(root: Path) -> list[str]:
    """Names of all campaigns of a project."""
    raw = root / "data" / "raw"
    if not raw.is_dir():
        return []
    return sorted(one.name for one in raw.iterdir() if one.is_dir() and _NAME.fullmatch(one.name))
