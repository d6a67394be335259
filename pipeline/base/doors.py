"""The doors of the outbuildings: found by name when somebody asks for them, never imported before.

An outbuilding is a folder that the core can do without. What the core offers of it stands where it
is offered as "module:name", so that a package without the folder misses that offer alone.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from pipeline.base.errors import UsageError


def opened(door: str) -> Any:
    """What stands behind a door.

    Args:
        door: "module:name".

    Raises:
        UsageError: This installation comes without the outbuilding.
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
    """What stands behind a door; None where this installation comes without the outbuilding."""
    return opened(door) if is_there(door) else None


def is_there(door: str) -> bool:
    """Whether this installation has the outbuilding of a door; nothing of it is imported."""
    found = find_spec(_folder(door))
    return found is not None and found.origin is not None  # not what an old folder has left behind


def _folder(door: str) -> str:
    """The package below pipeline/ that a door leads into."""
    return ".".join(door.partition(":")[0].split(".")[:2])
