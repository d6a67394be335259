"""Ways into result.json: keys that are missing or null leave their part out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pipeline.report.record import Block, Section


def at(tree: Any, *path: str) -> Any:
    """The value at a path of keys, None where any of them is missing."""
    for key in path:
        if not isinstance(tree, Mapping):
            return None
        tree = tree.get(key)
    return tree


def items(tree: Any, *path: str) -> list[Any]:
    """The list at a path of keys, empty where there is none."""
    value = at(tree, *path)
    return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else []


def section_of(key: str, title: str, blocks: Iterable[Block | None]) -> Section | None:
    """A part with the blocks that are there, None when none is."""
    kept = tuple(block for block in blocks if block is not None)
    return Section(key, title, kept) if kept else None


def joint_name(one: Mapping[str, Any]) -> str:
    """What a stiffness is called."""
    return str(one.get("name") or f"joint {one.get('joint')}")


def bracketed(text: str) -> str:
    """A value with its uncertainty, in brackets where a unit follows."""
    return f"({text})" if "±" in text and not text.startswith("(") else text
