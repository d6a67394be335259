"""A growing folder: its files up to the last complete line."""

from __future__ import annotations

from pathlib import Path

from pipeline.base import files
from pipeline.base.errors import InputError

_LARGEST = 256 << 20
"""Maximum size of one file [B], a matter of taste: a tracker with 1000 readings per second fills
it in an hour."""

_MOST = 1000
"""Maximum number of files of a folder; a campaign has ten, with one file per pose some hundreds."""

_TABLES = (".csv", ".txt", ".tsv", ".xyz", ".dat", ".log", ".asc")
"""Suffixes of tables to which instruments and controllers append lines."""


def snapshot(folder: Path) -> dict[str, bytes]:
    """Content of the files of a folder by name, without a line that is still being written.

    Raises:
        InputError: A file cannot be read or changes while it is read, or there are too many files.
    """
    paths = sorted(one for one in folder.iterdir() if one.is_file() and not _passing(one.name))
    if len(paths) > _MOST:
        raise InputError(
            f"{folder} holds {len(paths)} files", "name the folder of one campaign alone"
        )
    return {
        path.name: whole_lines(path.name, files.read(path, path.name, _LARGEST)) for path in paths
    }


def _passing(name: str) -> bool:
    """Whether a file is a temporary one of an editor or a spreadsheet."""
    return name.startswith((".", "~$")) or name.endswith((".tmp", "~"))


def whole_lines(name: str, data: bytes) -> bytes:
    """A text table up to its last line break; other files unchanged."""
    if not name.lower().endswith(_TABLES) or b"\0" in data:
        return data
    return data[: max(data.rfind(b"\n"), data.rfind(b"\r")) + 1]
