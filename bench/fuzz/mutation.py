"""The type of a mutation, and functions that all of them need."""

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
        name: Family and action, `cell:one nan`.
        act: Function from files to files; returns them unchanged if it does not apply.
        meant: Why a different answer is right; empty if it requires a warning.
        covered: Blind spots that include its effect, as names of causes.
    """

    name: str
    act: Act
    meant: str = ""
    covered: tuple[str, ...] = ()

    @property
    def family(self) -> str:
        """Group of mutations; a case draws the family first."""
        return self.name.partition(":")[0]


def one(rng: np.random.Generator, among: Sequence[T]) -> T:
    """One random element."""
    return among[int(rng.integers(len(among)))]


def two(rng: np.random.Generator, count: int) -> tuple[int, int]:
    """Two different random numbers below `count` in order; (0, 0) if there are fewer than two."""
    if count < 2:
        return 0, 0
    a, b = sorted(rng.choice(count, 2, replace=False).tolist())
    return a, b


def raw(text: str) -> str:
    """UTF-8 bytes as Latin-1 characters, in which all files are edited."""
    return text.encode("utf-8", "surrogatepass").decode("latin-1")


def text(data: bytes) -> str:
    """Any bytes as characters, to be converted back by `data_of`."""
    return data.decode("latin-1")


def data_of(edited: str) -> bytes:
    """Bytes of an edited text."""
    return edited.encode("latin-1", "replace")


def tables(files: Files) -> list[str]:
    """Names of all files that are not TOML."""
    return [name for name in files if not name.endswith(".toml")]


def with_text(files: Files, name: str, edit: Callable[[str], str]) -> Files:
    """Files with the text of one of them edited."""
    if name not in files:
        return files
    return {**files, name: data_of(edit(text(files[name])))}
