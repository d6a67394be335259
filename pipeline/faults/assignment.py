"""Which place each thing belongs in: the one test of whether groups or rows were exchanged.

How badly each content fits each place is a square in units of what usually remains. The assignment
of least sum (Kuhn, Naval Research Logistics Quarterly 2, 1955) moves contents only where each move
takes away more than the threshold of its own test, so that equal ones stay. What it moves round in
a ring is one exchange, and counts where every content of it ends as near as contents usually are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from pipeline.base.arrays import Array, Ints

STANDS_OUT = 10.0
"""A content in the wrong place is this many times farther off than usual [1]: what a machine or its
table has, it has in many places."""

_NOWHERE = 10.0
"""A misfit of so many times what a move has to take away is no place at all [1], however far it is:
as many contents as possible find theirs."""

_ENDED = 4
"""A row too few, or written twice, moves so many others at least, and leaves one without place."""


@dataclass(frozen=True)
class Ring:
    """Contents that stand in each other's place.

    Attributes:
        members: The place where each content stands; it belongs in the place that follows, the
            last one in the first.
        ended: The last content belongs nowhere, and nothing belongs in the first place.
    """

    members: tuple[int, ...]
    ended: bool = False

    @property
    def moves(self) -> list[tuple[int, int]]:
        """Where each content stands and where it belongs."""
        pairs = list(zip(self.members, (*self.members[1:], self.members[0]), strict=True))
        return pairs[:-1] if self.ended else pairs

    @property
    def by_one(self) -> bool:
        """Whether three at least are each in the place before or after their own."""
        step = {there - here for here, there in self.moves}
        first = {there - here for here, there in self.moves if abs(there - here) == 1}
        return len(self.members) > 2 and len(first) == 1 and len(step) <= 2

    def where(self, names: Sequence[str]) -> str:
        """`a/b` of two, else the first and the last and how they stand; names of the members."""
        if len(names) == 2:
            return "/".join(sorted(names))
        return f"{min(names)}/{max(names)} {'off by one' if self.by_one else 'shuffled'}"


def shift(order: Ints, step: int, ended: bool) -> Ring:
    """All contents one place away from their own.

    Args:
        order: Places in the order of their file, shape (n,).
        step: Each belongs so many places farther, 1 or -1.
        ended: Whether that at the end belongs nowhere, instead of at the beginning.
    """
    return Ring(tuple(int(k) for k in order[::step]), ended)


def said(ring: Ring, names: Sequence[str], one: str) -> str:
    """Which members they are, in words; `one` is what a member is."""
    if len(names) == 2:
        return " and ".join(sorted(names))
    if ring.by_one:
        return f"{min(names)} to {max(names)} ({len(names)}, off by one {one})"
    return f"{min(names)} to {max(names)} ({len(names)})"


_FEW = 6
"""So many lines are named in a sentence; `readings` has all of them."""


def lines(at: Sequence[str]) -> str:
    """Where it stands, in words."""
    more = len(at) - _FEW
    return ", ".join(at[:_FEW]) + (f" and {more} more lines" if more > 0 else "")


def assigned(cost: Array) -> Ints:
    """The content of each place where the sum is least, whatever it moves, shape (n,)."""
    return np.argsort(optimize.linear_sum_assignment(cost)[1])


def rings(cost: Array, least: float, most: float) -> list[Ring]:
    """Contents that stand in each other's place.

    Args:
        cost: Misfit of each content (row) in each place (column), squared, shape (n, n); its own
            place is on the diagonal.
        least: What each move takes away at least, on the average of its ring.
        most: What is left of each content that is moved, at most.
    """
    n = len(cost)
    if n < 2:
        return []
    moving = np.minimum(cost, _NOWHERE * least) + least * (1 - np.eye(n))
    place = optimize.linear_sum_assignment(moving)[1]
    return [ring for one in _cycles(place) if (ring := _settled(one, cost, most)) is not None]


def _settled(cycle: Sequence[int], cost: Array, most: float) -> Ring | None:
    """The exchange that a cycle is, if its contents end where they belong."""
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
