"""Assignment of contents to places: the common test of whether groups or rows were exchanged.

The misfit of each content in each place is a square in units of the usual residual. The assignment
of least sum (Kuhn, Naval Research Logistics Quarterly 2, 1955) moves contents only where each move
reduces it by more than the threshold of its own test, so that equal ones stay. Each cycle of moves
is one exchange, and counts if every content in it then fits as well as contents usually do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from pipeline.base.arrays import Array, Ints

OUTSTANDING_MISFIT = 10.0
"""Minimum misfit of a content in the wrong place over the usual one [1]; errors of a machine or its
table would occur in many places."""

_NOWHERE = 10.0
"""Misfit, over the reduction required of a move, above which a place counts as no place at all [1],
so that as many other contents as possible find theirs."""

_FEW = 6
"""Maximum number of lines or members named in a sentence [1]; `readings` has all of them."""

_ENDED = 4
"""Minimum number of contents in a cycle with one content that fits nowhere, as a missing or
repeated row causes."""


@dataclass(frozen=True)
class Ring:
    """Contents that are in each other's place.

    Attributes:
        members: Place of each content; it belongs in the place that follows, the last one in the
            first.
        ended: Whether the last content belongs nowhere, and nothing belongs in the first place.
    """

    members: tuple[int, ...]
    ended: bool = False

    @property
    def moves(self) -> list[tuple[int, int]]:
        """Present and correct place of each content."""
        pairs = list(zip(self.members, (*self.members[1:], self.members[0]), strict=True))
        return pairs[:-1] if self.ended else pairs

    @property
    def by_one(self) -> bool:
        """Whether three or more contents are each one place before or after their own."""
        step = {there - here for here, there in self.moves}
        first = {there - here for here, there in self.moves if abs(there - here) == 1}
        return len(self.members) > 2 and len(first) == 1 and len(step) <= 2

    def among(self, places: Ints) -> Ring:
        """The ring with its members, which are indices of some places, as these places."""
        return replace(self, members=tuple(int(places[k]) for k in self.members))

    def where(self, names: Sequence[str]) -> str:
        """`a/b` for two members, else first and last and how they are arranged, by their names."""
        if len(names) == 2:
            return "/".join(sorted(names))
        return f"{min(names)}/{max(names)} {'off by one' if self.by_one else 'shuffled'}"


def shift(order: Ints, step: int, ended: bool) -> Ring:
    """All contents one place away from their own.

    Args:
        order: Places in the order of their file, shape (n,).
        step: Direction in which each belongs, 1 or -1.
        ended: Whether the last content belongs nowhere, instead of in the first place.
    """
    return Ring(tuple(int(k) for k in order[::step]), ended)


def in_words(ring: Ring, names: Sequence[str]) -> str:
    """The members in words: a range of neighbours, others one by one."""
    if ring.by_one and max(ring.members) - min(ring.members) < len(names):
        return f"{min(names)} to {max(names)} ({len(names)})"
    ordered = [name for _, name in sorted(zip(ring.members, names, strict=True))]
    few = ordered if len(ordered) <= _FEW else [*ordered[:_FEW], f"{len(ordered) - _FEW} more"]
    return f"{', '.join(few[:-1])} and {few[-1]}"


def misplacement(ring: Ring | None, one: str) -> str:
    """How contents are arranged, and where the last one belongs; `one` is a noun for a place."""
    if ring is None or not ring.by_one:
        return "in each other's place"
    late = any(there - here == -1 for here, there in ring.moves)
    if late and ring.ended:
        return f"one {one} too late; those of the first belong nowhere"
    if late:
        return f"one {one} too late; those of the first belong to the last"
    if ring.ended:
        return f"one {one} too early; those of the last belong nowhere"
    return f"one {one} too early; those of the last belong to the first"


def lines(at: Sequence[str]) -> str:
    """Lines of the files, in words, each once; successive ones as `loads.csv:8–31`."""
    runs: list[list[str]] = []
    for each in dict.fromkeys(at):
        if runs and each == _next(runs[-1][-1]):
            runs[-1].append(each)
        else:
            runs.append([each])
    ends = [(run[0], run[-1].rpartition(":")[2], len(run)) for run in runs]
    said = [first if n == 1 else f"{first}–{last}" for first, last, n in ends]
    more = sum(map(len, runs[_FEW:]))
    return ", ".join(said[:_FEW]) + (f" and {more} more lines" if more > 0 else "")


def _next(line: str) -> str:
    """The line after `file:line`; empty if it is none."""
    file, _, number = line.rpartition(":")
    return f"{file}:{int(number) + 1}" if number.isdecimal() else ""


def assigned(cost: Array) -> Ints:
    """The content of each place in the assignment of least sum, moves being free, shape (n,)."""
    return np.argsort(optimize.linear_sum_assignment(cost)[1])


def rings(cost: Array, least: float, most: float) -> list[Ring]:
    """Contents that are in each other's place.

    Args:
        cost: Squared misfit of each content (row) in each place (column), shape (n, n); its own
            place is on the diagonal.
        least: Minimum reduction by each move, on the average of its cycle.
        most: Maximum remaining misfit of each content that is moved.
    """
    n = len(cost)
    if n < 2:
        return []
    moving = np.minimum(cost, _NOWHERE * least) + least * (1 - np.eye(n))
    place = optimize.linear_sum_assignment(moving)[1]
    return [ring for one in _cycles(place) if (ring := _settled(one, cost, most)) is not None]


def _settled(cycle: Sequence[int], cost: Array, most: float) -> Ring | None:
    """The exchange of a cycle, if its contents fit where they are moved."""
    after = (*cycle[1:], cycle[0])
    left = [k for k, (i, j) in enumerate(zip(cycle, after, strict=True)) if not cost[i, j] <= most]
    if len(cycle) > 1 and not left:
        return Ring(tuple(cycle))
    if len(left) == 1 and len(cycle) >= _ENDED:
        k = left[0] + 1
        return Ring((*cycle[k:], *cycle[:k]), ended=True)
    return None


def _cycles(place: Ints) -> list[list[int]]:
    left, found = set(range(len(place))), []
    while left:
        ring = [min(left)]
        while int(place[ring[-1]]) != ring[0]:
            ring.append(int(place[ring[-1]]))
        left -= set(ring)
        found.append(ring)
    return found
