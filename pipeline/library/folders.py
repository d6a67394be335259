"""A folder written as a whole."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from pipeline.base import files


def replace_folder(folder: Path, content: Mapping[str, bytes]) -> None:
    """Write a whole folder atomically; an old one of that name is replaced.

    Raises:
        CannotWrite: The file system refuses; the old folder is still there.
    """
    with files.writing(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        # in the same file system as the folder; a name with a dot is that of no campaign
        temporary = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
        try:
            for name, data in content.items():
                files.write(temporary / "new" / name, data)
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
