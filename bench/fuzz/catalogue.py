"""Every mutation, and the case of a number: which campaign is spoilt by which of them."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from bench.fuzz import in_bytes, in_practice, in_robot, in_settings, in_tables
from bench.fuzz.bases import NAMES, base
from bench.fuzz.mutation import Files, Mutation, one

SEED = 2026

MUTATIONS: tuple[Mutation, ...] = (
    *in_bytes.MUTATIONS,
    *in_tables.MUTATIONS,
    *in_settings.MUTATIONS,
    *in_robot.MUTATIONS,
    *in_practice.MUTATIONS,
)

FAMILIES: dict[str, list[Mutation]] = defaultdict(list)
for _mutation in MUTATIONS:
    FAMILIES[_mutation.family].append(_mutation)

_OFTEN = ("cell", "joints", "loads", "readings", "points")
"""Families drawn twice as often: what campaigns really suffer from."""

_COUNTS = (1, 1, 1, 1, 2, 2, 3)


@dataclass(frozen=True, eq=False)
class Case:
    """A spoilt campaign.

    Attributes:
        number: Of which everything else is a function.
        base: Name of the clean campaign.
        mutations: What was done to it, in this order.
        files: What it became.
        shown: Whether its report is made, too.
    """

    number: int
    base: str
    mutations: tuple[Mutation, ...]
    files: Files
    shown: bool = False

    @property
    def meant(self) -> bool:
        """Whether another answer is right."""
        return any(mutation.meant for mutation in self.mutations)

    @property
    def covered(self) -> set[str]:
        """Blind spots that own up to it."""
        return {name for mutation in self.mutations for name in mutation.covered}


def case(number: int) -> Case:
    """The case of a number."""
    rng = np.random.default_rng([SEED, number])
    name, count, shown = one(rng, NAMES), one(rng, _COUNTS), bool(rng.random() < 0.1)
    families = [*FAMILIES, *(each for each in _OFTEN if each in FAMILIES)]
    files, done = base(name), []
    for _ in range(40):  # many mutations have nothing to act on in some campaigns
        mutation = one(rng, FAMILIES[one(rng, families)])
        spoilt = mutation.act(files, rng)
        if dict(spoilt) != dict(files):
            files = spoilt
            done.append(mutation)
        if len(done) == count:
            break
    return Case(number, name, tuple(done), files, shown)
