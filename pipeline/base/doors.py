"""Doors of the outbuildings: imported by name on request, never before.

An outbuilding is a folder that the core can do without. The core refers to what it offers of one as
"module:name", so that a package without the folder lacks that offer only.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from pipeline.base.errors import UsageError


def opened(door: str) -> Any:
    """Import the object behind a door.

    Args:
        door: "module:name".

    Raises:
        UsageError: This installation lacks the outbuilding.
    """
    module, _, name = door.partition(":")
    try:
        return getattr(import_module(module), name)
    except ModuleNotFoundError as missing:
        if not is_there(door):
            folder = _folder(module)
            raise UsageError(
                f"this installation comes without {folder}: install the whole package"
            ) from missing
        raise


def found(door: str) -> Any | None:
    """The object behind a door; None if this installation lacks the outbuilding."""
    return opened(door) if is_there(door) else None


def is_there(door: str) -> bool:
    """Whether this installation has the outbuilding of a door, without importing it."""
    found = find_spec(_folder(door))
    return found is not None and found.origin is not None  # not a removed package's empty folder


def _folder(door: str) -> str:
    """Package below pipeline/ to which a door leads."""
    return ".".join(door.partition(":")[0].split(".")[:2])
