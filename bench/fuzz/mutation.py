"""What a mutation is, and the few things that all of them need."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

Files = Mapping[str, bytes]
Act = Callable[[Files, np.random.Generator], Files]
T = TypeVar("T")

TOML = "campaign.toml"


@dataclass(frozen=True)
class Mutation:
    """One way to spoil a campaign.

    Attributes:
        name: Family and what is done, `cell:one nan`.
        act: From files to files; gives them back unchanged where it has nothing to act on.
        meant: Why another answer is right; empty where it must not pass unsaid.
        covered: Blind spots that own up to it, names of causes.
    """

    name: str
    act: Act
    meant: str = ""
    covered: tuple[str, ...] = ()

    @property
    def family(self) -> str:
        """Mutations of one kind; a case draws the family first."""
        return self.name.partition(":")[0]


def one(rng: np.random.Generator, among: Sequence[T]) -> T:
    """One of them, drawn."""
    return among[int(rng.integers(len(among)))]


def two(rng: np.random.Generator, count: int) -> tuple[int, int]:
    """Two different numbers below `count`, the smaller first; twice the same where there is one."""
    if count < 2:
        return 0, 0
    a, b = sorted(rng.choice(count, 2, replace=False).tolist())
    return a, b


def raw(text: str) -> str:
    """UTF-8 bytes as Latin-1 letters, in which all files are edited."""
    return text.encode("utf-8", "surrogatepass").decode("latin-1")


def text(data: bytes) -> str:
    """Any bytes as letters, to be given back by `data_of`."""
    return data.decode("latin-1")


def data_of(edited: str) -> bytes:
    """The bytes of a text that was edited."""
    return edited.encode("latin-1", "replace")


def tables(files: Files) -> list[str]:
    """Names of all that is no TOML."""
    return [name for name in files if not name.endswith(".toml")]


def with_text(files: Files, name: str, edit: Callable[[str], str]) -> Files:
    """Files with the text of one of them edited."""
    if name not in files:
        return files
    return {**files, name: data_of(edit(text(files[name])))}
